//! First- and second-order statistics of the speckle against theory.

mod common;

use common::{gel, needle, pose, probe, slice};
use sonoloop_types::Pose;
use sonoloop_ultrasound::{Field, Renderer};

fn renderer(seed: u64) -> Renderer {
    Renderer::new(probe(), needle(), gel(), seed)
}

/// The field in rows `rows`, away from the picture's sides.
fn band(field: &Field, rows: core::ops::Range<usize>) -> Vec<[f64; 2]> {
    rows.flat_map(|row| field.values[row * field.columns..][20..field.columns - 20].iter())
        .map(|v| v.map(f64::from))
        .collect()
}

fn intensity([re, im]: [f64; 2]) -> f64 {
    re * re + im * im
}

#[test]
fn truth_envelope_is_rayleigh_at_every_depth_and_pose() {
    // Rayleigh: mean/σ = √(π/(4−π)) = 1.913, E[I²]/E[I]² = 2; unit backscatter has unit power.
    type MakePose = fn(f64) -> Pose;
    let poses: [MakePose; 3] = [
        |y| pose(0.0, y, 0.0, 0.0, 0.0, 0.0),
        |y| pose(0.3, y, -1.0, 37.0, 4.0, -3.0),
        |y| pose(0.0, y * 0.5, -8.0, 0.0, 20.0, 15.0),
    ];
    for make in poses {
        let mut samples = [const { Vec::new() }; 3];
        for i in 0..14 {
            let field = renderer(11 + i % 3).field(&slice(make(-10.0 + 1.4 * i as f64)));
            for (samples, rows) in samples.iter_mut().zip([60..110, 180..230, 380..430]) {
                samples.extend(band(&field, rows).into_iter().map(intensity));
            }
        }
        for intensities in samples {
            let n = intensities.len() as f64;
            let mean = intensities.iter().sum::<f64>() / n;
            let second = intensities.iter().map(|i| i * i).sum::<f64>() / n / (mean * mean);
            let envelope = intensities.iter().map(|i| i.sqrt()).sum::<f64>() / n;
            let snr = envelope / (mean - envelope * envelope).sqrt();
            println!("power {mean:.3} snr {snr:.3} second moment {second:.3}");
            assert!((snr - 1.913).abs() < 0.05, "mean over σ is {snr}");
            assert!((second - 2.0).abs() < 0.08, "second moment is {second}");
            assert!((10.0 * mean.log10()).abs() < 0.3, "power is {mean}");
        }
    }
}

/// Correlation coefficient of two lists.
fn correlation(a: &[f64], b: &[f64]) -> f64 {
    let n = a.len() as f64;
    let (mean_a, mean_b) = (a.iter().sum::<f64>() / n, b.iter().sum::<f64>() / n);
    let (mut ab, mut aa, mut bb) = (0.0, 0.0, 0.0);
    for (x, y) in a.iter().zip(b) {
        let (x, y) = (x - mean_a, y - mean_b);
        (ab, aa, bb) = (ab + x * y, aa + x * x, bb + y * y);
    }
    ab / (aa * bb).sqrt()
}

#[test]
fn truth_intensity_decorrelates_with_elevation_as_the_beam_says() {
    // Amplitude weight exp(−e²/2σ²): the field correlates as exp(−δ²/4σ²), the intensity as its square.
    for (row, reach_rows) in [(150, 8), (250, 8), (400, 8)] {
        let sigma_mm = probe().slice_thickness_m(row as f64 * 1e-4) * 1e3 / 2.3548;
        for share in [0.5, 1.0, 1.5] {
            let shift_mm = share * sigma_mm;
            let (mut here, mut moved) = (Vec::new(), Vec::new());
            for i in 0..12u64 {
                let mut renderer = renderer(21 + i % 4);
                let y = -12.0 + 2.0 * i as f64;
                for (list, y) in [(&mut here, y), (&mut moved, y + shift_mm)] {
                    let field = renderer.field(&slice(pose(0.0, y, 0.0, 0.0, 0.0, 0.0)));
                    list.extend(band(&field, row - reach_rows..row + reach_rows).into_iter().map(intensity));
                }
            }
            let expected = (-share * share / 2.0f64).exp();
            let measured = correlation(&here, &moved);
            println!("row {row} shift {share} σ: {measured:.3}, expected {expected:.3}");
            assert!((measured - expected).abs() < 0.05, "row {row}, {share} σ: {measured} for {expected}");
        }
    }
}

#[test]
fn truth_an_axial_shift_turns_the_phase_by_4_pi_over_lambda() {
    let wavelength_mm = 1540.0 / 7.54e6 * 1e3;
    let mut renderer = renderer(3);
    let before = band(&renderer.field(&slice(pose(0.0, 0.0, -1.0, 0.0, 0.0, 0.0))), 50..400);
    for shift_mm in [0.004, 0.011, -0.017] {
        let after = renderer.field(&slice(pose(0.0, 0.0, -1.0 - shift_mm, 0.0, 0.0, 0.0)));
        let (mut re, mut im) = (0.0, 0.0);
        for ([a, b], [c, d]) in band(&after, 50..400).into_iter().zip(&before) {
            re += a * c + b * d;
            im += b * c - a * d;
        }
        // Pressing the probe in brings the scatterers nearer: exp(−i·2k·z) gains +2k·δ.
        let expected = 4.0 * core::f64::consts::PI * shift_mm / wavelength_mm;
        assert!((im.atan2(re) - expected).abs() < 0.02, "{} for {expected}", im.atan2(re));
    }
}

#[test]
fn truth_grain_has_the_width_of_the_beam() {
    // The field's correlation along x is exp(−δ²/4σ_l²) in the middle, where the aperture is whole.
    let sigma_px = 0.886 * 1540.0 / 7.54e6 * 2.0 / 2.3548 / 1e-4;
    let lag = 2;
    let (mut re, mut power) = (0.0, 0.0);
    for i in 0..6 {
        let field = renderer(5).field(&slice(pose(0.0, -6.0 + 2.0 * i as f64, 0.0, 0.0, 0.0, 0.0)));
        for row in (100..250).map(|row| &field.values[row * field.columns..][120..264]) {
            for (a, b) in row.iter().zip(&row[lag..]) {
                re += f64::from(a[0] * b[0] + a[1] * b[1]);
                power += f64::from(a[0] * a[0] + a[1] * a[1]);
            }
        }
    }
    let expected = (-(lag as f64 / sigma_px).powi(2) / 4.0).exp();
    assert!((re / power - expected).abs() < 0.02, "{} for {expected}", re / power);
}
