//! The beam as rendered against PyMUST's: two-way −6 dB widths over depth.
//!
//! The reference, `data/psf_pymust.csv`, is written by `docs/oracle/psf.py`. Widths are read off the speckle,
//! which takes the renderer's whole path: a Gaussian spread of amplitude has an autocovariance √2 as wide, so
//! its −6 dB width is the autocovariance's full width at 1/√2.
//!
//! What the model is given from the reference: F#, centre and bandwidth of the echo's spectrum at the lens's focus, and slice
//! thickness at some depths. So the lateral and axial widths follow by theory, none is fitted; the elevational ones between the
//! given depths test the interpolation.

mod common;

use common::{material, needle, pose, probe, slice};
use sonoloop_types::{ElevationSample, ImageGeometry, ProbeSpec, Tissue};
use sonoloop_ultrasound::{Field, Renderer};

const REFERENCE: &str = include_str!("data/psf_pymust.csv");
const BOUND: f64 = 0.15;
/// Depths of the model's table of slice thickness, in mm; 10, 18, 25 and 35 are left for the interpolation.
const TABLE_MM: [f64; 7] = [8.0, 12.0, 15.0, 20.0, 30.0, 40.0, 45.0];

#[derive(Debug, Clone, Copy)]
struct Row {
    depth_mm: f64,
    axial_mm: f64,
    lateral_mm: f64,
    elevation_mm: f64,
    centre_mhz: f64,
    bandwidth: f64,
}

fn reference(name: &str) -> Vec<Row> {
    let lines = REFERENCE.lines().filter(|line| line.split(',').next() == Some(name));
    let rows: Vec<Row> = lines
        .map(|line| {
            let mut values = line.split(',').skip(1).map(|v| v.parse().expect("a number"));
            let mut next = || values.next().expect("seven columns");
            Row {
                depth_mm: next(),
                axial_mm: next(),
                lateral_mm: next(),
                elevation_mm: next(),
                centre_mhz: next(),
                bandwidth: next(),
            }
        })
        .collect();
    assert!(rows.len() >= 9, "{name}: {} depths", rows.len());
    rows
}

/// The reference has no attenuation, which would widen the beam with depth.
fn lossless() -> Tissue {
    Tissue::homogeneous([0.1, 0.06, 0.06], material(Some(0.0), 0.0))
}

/// The probe as the reference has it. `fine` times finer pixels than usual.
fn spec(rows: &[Row], elements: u32, pitch_m: f64, focus_mm: f64, fine: u32) -> ProbeSpec {
    let at_focus = rows.iter().find(|row| row.depth_mm == focus_mm).expect("the focus is in the reference");
    let geometry = ImageGeometry::default();
    let given = rows.iter().filter(|r| TABLE_MM.contains(&r.depth_mm));
    ProbeSpec {
        elements,
        pitch_m,
        centre_frequency_hz: at_focus.centre_mhz * 1e6,
        fractional_bandwidth: at_focus.bandwidth,
        f_number: 2.0,
        elevation_focus_m: focus_mm * 1e-3,
        elevation: given
            .map(|r| ElevationSample { depth_m: r.depth_mm * 1e-3, width_m: r.elevation_mm * 1e-3 })
            .collect(),
        geometry: ImageGeometry {
            width_px: geometry.width_px * fine,
            height_px: geometry.height_px * fine,
            spacing_m: geometry.spacing_m / f64::from(fine),
        },
        ..probe()
    }
}

/// Rows and columns of a field within 0.5 mm of a depth and 7 mm of the middle, where the aperture is whole.
fn window(field: &Field, spec: &ProbeSpec, depth_mm: f64) -> [core::ops::Range<usize>; 2] {
    let px = |mm: f64| (mm * 1e-3 / spec.geometry.spacing_m).round() as usize;
    let middle = field.columns / 2;
    [px(depth_mm - 0.5)..px(depth_mm + 0.5), middle - px(7.0)..middle + px(7.0)]
}

/// Magnitude of Σ a·b* over a window of `a` and the same of `b`, moved by `down` rows and `right` columns.
#[derive(Debug, Clone, Copy, Default)]
struct Covariance {
    re: f64,
    im: f64,
}

impl Covariance {
    fn add(
        &mut self,
        a: &Field,
        b: &Field,
        [rows, columns]: &[core::ops::Range<usize>; 2],
        down: usize,
        right: usize,
    ) {
        for row in rows.clone() {
            for column in columns.clone() {
                let [p, q] = a.values[row * a.columns + column].map(f64::from);
                let [r, s] = b.values[(row + down) * b.columns + column + right].map(f64::from);
                self.re += p * r + q * s;
                self.im += q * r - p * s;
            }
        }
    }

    fn magnitude(&self) -> f64 {
        self.re.hypot(self.im)
    }
}

/// Twice the shift at which the covariance has fallen to 1/√2, from samples every `step_mm`. Between samples
/// the logarithm is taken as linear in the square of the shift.
fn width_mm(covariance: &[f64], step_mm: f64) -> f64 {
    let log: Vec<f64> = covariance.iter().map(|c| (c / covariance[0]).ln()).collect();
    let level = -0.5 * core::f64::consts::LN_2;
    let above = log.iter().position(|&l| l < level).expect("falls below 1/√2") - 1;
    let share = (log[above] - level) / (log[above] - log[above + 1]);
    let [low, high] = [above, above + 1].map(|i| (i as f64 * step_mm).powi(2));
    2.0 * (low + share * (high - low)).sqrt()
}

/// Prints and collects what is off by more than the bound.
fn compare(
    misses: &mut Vec<String>,
    name: &str,
    what: &str,
    depth_mm: f64,
    measured_mm: f64,
    expected_mm: f64,
) {
    let off = measured_mm / expected_mm - 1.0;
    println!(
        "{name} {depth_mm:>2} mm {what:>9}: {measured_mm:.3} mm, PyMUST {expected_mm:.3}, {:+.1} %",
        100.0 * off
    );
    if off.abs() > BOUND {
        misses.push(format!("{name} {depth_mm} mm {what}: {measured_mm:.3} mm for {expected_mm:.3}"));
    }
}

fn in_plane(name: &str, elements: u32, pitch_m: f64, focus_mm: f64) {
    let rows = reference(name);
    let spec = spec(&rows, elements, pitch_m, focus_mm, 2);
    let lags = 12;
    let step_mm = spec.geometry.spacing_m * 1e3;
    let mut covariances = vec![[[Covariance::default(); 12]; 2]; rows.len()];
    for i in 0..10 {
        let mut renderer = Renderer::new(spec.clone(), needle(), lossless(), 50 + i);
        let field = renderer.field(&slice(pose(0.0, -9.0 + 2.0 * i as f64, 0.0, 0.0, 0.0, 0.0)));
        for (row, [axial, lateral]) in rows.iter().zip(&mut covariances) {
            let window = window(&field, &spec, row.depth_mm);
            for lag in 0..lags {
                axial[lag].add(&field, &field, &window, lag, 0);
                lateral[lag].add(&field, &field, &window, 0, lag);
            }
        }
    }
    let mut misses = Vec::new();
    for (row, covariances) in rows.iter().zip(&covariances) {
        let [axial_mm, lateral_mm] = covariances.map(|c| width_mm(&c.map(|c| c.magnitude()), step_mm));
        compare(&mut misses, name, "axial", row.depth_mm, axial_mm, row.axial_mm);
        compare(&mut misses, name, "lateral", row.depth_mm, lateral_mm, row.lateral_mm);
    }
    assert!(misses.is_empty(), "{misses:#?}");
}

fn across(name: &str, elements: u32, pitch_m: f64, focus_mm: f64) {
    let rows = reference(name);
    let spec = spec(&rows, elements, pitch_m, focus_mm, 1);
    let (step_mm, shifts) = (0.12, 22);
    let mut covariances = vec![vec![Covariance::default(); shifts]; rows.len()];
    for i in 0..8 {
        let mut renderer = Renderer::new(spec.clone(), needle(), lossless(), 80 + i);
        let y_mm = -9.0 + 2.0 * i as f64;
        let here = renderer.field(&slice(pose(0.0, y_mm, 0.0, 0.0, 0.0, 0.0)));
        for shift in 0..shifts {
            let moved_mm = y_mm + shift as f64 * step_mm;
            let moved = renderer.field(&slice(pose(0.0, moved_mm, 0.0, 0.0, 0.0, 0.0)));
            for (row, covariance) in rows.iter().zip(&mut covariances) {
                covariance[shift].add(&here, &moved, &window(&here, &spec, row.depth_mm), 0, 0);
            }
        }
    }
    let mut misses = Vec::new();
    for (row, covariance) in rows.iter().zip(&covariances) {
        let magnitudes: Vec<f64> = covariance.iter().map(Covariance::magnitude).collect();
        let elevation_mm = width_mm(&magnitudes, step_mm);
        compare(&mut misses, name, "elevation", row.depth_mm, elevation_mm, row.elevation_mm);
    }
    assert!(misses.is_empty(), "{misses:#?}");
}

// Elements, pitch and the lens's focus as PyMUST has them.
#[test]
fn truth_axial_and_lateral_widths_of_an_l11_5v_are_pymusts() {
    in_plane("L11-5v", 128, 0.3e-3, 18.0);
}

#[test]
fn truth_axial_and_lateral_widths_of_an_l12_3v_are_pymusts() {
    in_plane("L12-3v", 192, 0.2e-3, 20.0);
}

#[test]
fn truth_slice_thickness_of_an_l11_5v_is_pymusts() {
    across("L11-5v", 128, 0.3e-3, 18.0);
}

#[test]
fn truth_slice_thickness_of_an_l12_3v_is_pymusts() {
    across("L12-3v", 192, 0.2e-3, 20.0);
}
