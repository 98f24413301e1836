//! First- and second-order statistics of the speckle against theory.

mod common;

use common::{gel, needle, pose, probe, slice};
use sonoloop_types::{Effects, Pose, ProbeSpec};
use sonoloop_ultrasound::{Field, Renderer};

fn renderer(seed: u64) -> Renderer {
    Renderer::new(probe(), needle(), gel(), seed)
}

/// The probe with elements so low that their lens changes nothing: the formulas here are those of the focus. What a lens
/// does is in `truth_psf.rs`.
fn without_lens() -> ProbeSpec {
    ProbeSpec { element_height_m: 0.5e-3, ..probe() }
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
    let poses: [MakePose; 4] = [
        |y| pose(0.0, y, 0.0, 0.0, 0.0, 0.0),
        |y| pose(0.3, y, -1.0, 37.0, 4.0, -3.0),
        |y| pose(0.0, y * 0.5, -8.0, 0.0, 20.0, 15.0),
        |y| pose(y, 1.0, -0.5, 90.0, 0.0, 0.0),
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
fn truth_speckle_moves_with_the_tissue_where_columns_fade() {
    // Half a millimetre deeper the picture is the same five pixels higher, but for what the beam changes over half a
    // millimetre: e.g. a slice of twice the σ sees what correlates by √(2·2/(1 + 4)) = 0.89, and its σ halves within 4 mm.
    for (yaw_deg, x_mm, y_mm) in [(0.0, 0.2, 0.7), (90.0, 1.3, -0.4)] {
        let mut renderer = renderer(8);
        let mut field = |z_mm: f64| renderer.field(&slice(pose(x_mm, y_mm, z_mm, yaw_deg, 0.0, 0.0)));
        let (before, after) = (field(-1.0), field(-1.5));
        for first in (40..440).step_by(20) {
            let there = band(&before, first..first + 20).into_iter().map(intensity).collect::<Vec<_>>();
            let here = band(&after, first - 5..first + 15).into_iter().map(intensity).collect::<Vec<_>>();
            let alike = correlation(&there, &here);
            assert!(alike > 0.9, "{alike} at {yaw_deg}°, row {first}");
        }
    }
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

/// Largest distance between the samples' distribution and Rayleigh's of the same power, 1 − exp(−I/E[I]).
fn distance_from_rayleigh(intensities: &mut [f64]) -> f64 {
    let n = intensities.len() as f64;
    let mean = intensities.iter().sum::<f64>() / n;
    intensities.sort_by(f64::total_cmp);
    let steps = intensities.iter().enumerate().map(|(i, intensity)| {
        let theory = 1.0 - (-intensity / mean).exp();
        (theory - i as f64 / n).abs().max(((i + 1) as f64 / n - theory).abs())
    });
    steps.fold(0.0, f64::max)
}

#[test]
fn truth_kolmogorov_smirnov_finds_no_difference_from_rayleigh() {
    // Pixels 0.4 mm apart axially, 1 mm laterally and 4 mm in elevation: more than 5 σ of the pulse and 6 σ
    // of the lateral beam, and a fresh slab for each picture, so the samples are independent.
    let mut samples = [const { Vec::new() }; 3];
    for i in 0..30u64 {
        let y_mm = -20.0 + 4.0 * (i % 10) as f64;
        let field = renderer(40 + i / 10).field(&slice(pose(0.0, y_mm, 0.0, 0.0, 0.0, 0.0)));
        for (samples, first_row) in samples.iter_mut().zip([120, 200, 280]) {
            for row in (first_row..first_row + 40).step_by(4) {
                samples.extend(band(&field, row..row + 1).into_iter().step_by(10).map(intensity));
            }
        }
    }
    for (i, intensities) in samples.iter_mut().enumerate() {
        let root = (intensities.len() as f64).sqrt();
        let distance = distance_from_rayleigh(intensities) * root;
        println!("depth {i}: {} samples, distance·√n {distance:.3}", intensities.len());
        // Estimating the power from the samples tightens the law: for the exponential distribution the 1 %
        // point is 1.308/√n (Stephens 1974), against 1.628/√n for a law known beforehand.
        assert!(distance < 1.308, "depth {i}: {distance}/√n from Rayleigh");
    }
}

/// Correlation of the field with itself `down` rows and `right` columns on, from the middle of the picture.
fn correlation_in_plane(fields: &[Field], rows: core::ops::Range<usize>, down: usize, right: usize) -> f64 {
    let (mut re, mut im, mut power) = (0.0, 0.0, 0.0);
    for field in fields {
        for row in rows.clone() {
            let line = |row: usize, first: usize| &field.values[row * field.columns + first..][..144];
            for (a, b) in line(row, 120).iter().zip(line(row + down, 120 + right)) {
                let [a, b] = [a, b].map(|v| v.map(f64::from));
                re += a[0] * b[0] + a[1] * b[1];
                im += a[1] * b[0] - a[0] * b[1];
                power += (intensity(a) + intensity(b)) / 2.0;
            }
        }
    }
    f64::hypot(re, im) / power
}

#[test]
fn truth_grain_has_the_size_of_the_beam_at_three_depths() {
    // Amplitude profiles exp(−x²/2σ²): the field correlates as exp(−δ²/4σ²), so δ/(2·√(−ln ρ)) is σ. Laterally
    // the −6 dB width is 0.886·λ·F#; axially a Gaussian pulse of bandwidth B·f has σ = c/(4π·B·f/2.355). Taken
    // from the middle of the picture, where the aperture is whole at these depths.
    // The gel takes 0.5 dB/cm/MHz, so the centre frequency falls by 2·z·α′·σ_f², and the beam widens by as much.
    let (c, f, fwhm) = (1540.0, 7.54e6, 2.3548);
    let sigma_f = 0.6 * f / fwhm;
    let lateral_px = |z_cm: f64| {
        let centre = f - 2.0 * z_cm * 0.5 / 8.686 * 1e-6 * sigma_f * sigma_f;
        0.886 * c / centre * 2.0 / fwhm / 1e-4
    };
    let axial_px = c / (4.0 * core::f64::consts::PI * 0.6 * f / fwhm) / 1e-4;
    let fields: Vec<Field> = (0..12u64)
        .map(|i| {
            Renderer::new(without_lens(), needle(), gel(), 5 + i).field(&slice(pose(
                0.0,
                -11.0 + 2.0 * i as f64,
                0.0,
                0.0,
                0.0,
                0.0,
            )))
        })
        .collect();
    for rows in [90..130, 200..240, 340..380] {
        for (what, expected, lags) in [
            ("lateral", lateral_px((rows.start + 20) as f64 * 0.01), [[0, 1], [0, 2], [0, 3]].as_slice()),
            ("axial", axial_px, [[1, 0], [2, 0]].as_slice()),
        ] {
            for &[down, right] in lags {
                let rho = correlation_in_plane(&fields, rows.clone(), down, right);
                let sigma = (down + right) as f64 / (2.0 * (-rho.ln()).sqrt());
                println!("{rows:?} {what} lag {}: σ {sigma:.3} px, theory {expected:.3}", down + right);
                assert!(
                    (sigma / expected - 1.0).abs() < 0.05,
                    "{rows:?} {what}: σ {sigma} px for {expected}"
                );
            }
        }
    }
}

#[test]
fn truth_a_transmit_focus_narrows_the_grain_there() {
    // Sending and receiving are each √2 wider than both together where both are in focus. Far from the transmit
    // focus only receiving is left, √2 wider than at the focus.
    let probe = ProbeSpec {
        transmit_focus_m: Some(0.022),
        effects: Effects { downshift: false, ..Effects::default() },
        ..without_lens()
    };
    let fields: Vec<Field> = (0..10u64)
        .map(|i| {
            let mut renderer = Renderer::new(probe.clone(), needle(), gel(), 5 + i);
            renderer.field(&slice(pose(0.0, -9.0 + 2.0 * i as f64, 0.0, 0.0, 0.0, 0.0)))
        })
        .collect();
    let narrow_px = 0.886 * 1540.0 / 7.54e6 * 2.0 / 2.3548 / 1e-4;
    let sent = |z_m: f64| {
        let cone_px = (z_m - 0.022) / 2.0 / 12f64.sqrt() / 1e-4;
        (1.0 + (cone_px / (2f64.sqrt() * narrow_px)).powi(2)).sqrt()
    };
    for rows in [96..104usize, 216..224, 356..364] {
        let wide = sent((rows.start + 4) as f64 * 1e-4);
        let expected = narrow_px * (2.0 / (1.0 + 1.0 / (wide * wide))).sqrt();
        let rho = correlation_in_plane(&fields, rows.clone(), 0, 2);
        let sigma = 2.0 / (2.0 * (-rho.ln()).sqrt());
        println!("{rows:?}: σ {sigma:.3} px, theory {expected:.3}");
        assert!((sigma / expected - 1.0).abs() < 0.06, "{rows:?}: σ {sigma} px for {expected}");
    }
}
