//! Attenuation, backscatter, and contact, read off the picture.

mod common;

use common::{gel, material, needle, needle_in_probe, pose, probe, slice, water};
use sonoloop_types::{Effects, Image, ProbeSpec, Tissue};
use sonoloop_ultrasound::Renderer;

fn picture(probe: &ProbeSpec, tissue: &Tissue, slice: &sonoloop_types::Slice) -> Image {
    let mut image = Image::black(1, 1);
    Renderer::new(probe.clone(), needle(), tissue.clone(), 9).render(slice, &mut image);
    image
}

/// Mean level in dB of a few rows of the displayed columns.
fn level_db(probe: &ProbeSpec, image: &Image, rows: core::ops::Range<u32>) -> f64 {
    let grey: Vec<f64> = rows.flat_map(|v| image.row(v)[140..500].iter().map(|&g| f64::from(g))).collect();
    grey.iter().sum::<f64>() / grey.len() as f64 / 255.0 * probe.dynamic_range_db
}

fn quiet_probe() -> ProbeSpec {
    ProbeSpec { noise_level_db: -200.0, tgc_db_cm_mhz: 0.0, speckle_level_db: 15.0, ..probe() }
}

/// What a Gaussian pulse loses by 2·α·f·z, from its spectrum, in dB: the numbers that a hydrophone would add up.
fn pulse_loss_db(alpha_db_cm_mhz: f64, depth_cm: f64) -> f64 {
    let (centre_mhz, sigma_mhz) = (7.54, 0.6 * 7.54 / 2.3548);
    let peak = |alpha: f64| {
        let spectrum = (0..40_000).map(|i| {
            let f = f64::from(i) * 1e-3 - 10.0;
            (-0.5 * ((f - centre_mhz) / sigma_mhz).powi(2)).exp()
                * 10f64.powf(-2.0 * alpha * f * depth_cm / 20.0)
        });
        spectrum.sum::<f64>()
    };
    20.0 * (peak(0.0) / peak(alpha_db_cm_mhz)).log10()
}

fn fall_db(probe: &ProbeSpec, attenuation_db_cm_mhz: f64) -> f64 {
    let tissue = Tissue::homogeneous([0.1, 0.06, 0.06], material(Some(0.0), attenuation_db_cm_mhz));
    let image = picture(probe, &tissue, &slice(pose(0.0, 0.0, 0.0, 0.0, 0.0, 0.0)));
    level_db(probe, &image, 40..80) - level_db(probe, &image, 340..380)
}

#[test]
fn truth_attenuation_shows_as_the_slope_without_compensation() {
    for attenuation in [0.3, 0.5] {
        // One frequency: 2·α·f·z.
        let narrow =
            ProbeSpec { effects: Effects { downshift: false, ..Effects::default() }, ..quiet_probe() };
        let expected_db = 2.0 * attenuation * 7.54 * 3.0;
        let measured_db = fall_db(&narrow, attenuation);
        assert!(
            (measured_db / expected_db - 1.0).abs() < 0.03,
            "{measured_db} dB over 3 cm, not {expected_db}"
        );
        // The whole pulse, whose low frequencies get farther.
        let expected_db = pulse_loss_db(attenuation, 3.6) - pulse_loss_db(attenuation, 0.6);
        let measured_db = fall_db(&quiet_probe(), attenuation);
        assert!(
            (measured_db / expected_db - 1.0).abs() < 0.03,
            "{measured_db} dB over 3 cm, not {expected_db}"
        );
    }
}

#[test]
fn truth_attenuation_is_recovered_from_a_picture() {
    for truth in [0.2, 0.45, 0.7] {
        let measured_db = fall_db(&quiet_probe(), truth);
        let loss_db = |alpha: f64| pulse_loss_db(alpha, 3.6) - pulse_loss_db(alpha, 0.6);
        let (mut low, mut high) = (0.0, 1.0);
        while high - low > 1e-4 {
            let middle = (low + high) / 2.0;
            if loss_db(middle) < measured_db { low = middle } else { high = middle }
        }
        assert!((low / truth - 1.0).abs() < 0.1, "{low} dB/cm/MHz for {truth}");
    }
}

#[test]
fn without_attenuation_nothing_is_lost() {
    let probe = ProbeSpec { effects: Effects { attenuation: false, ..Effects::default() }, ..quiet_probe() };
    assert!(fall_db(&probe, 0.7).abs() < 0.3, "{} dB", fall_db(&probe, 0.7));
}

#[test]
fn sliders_add_their_gain_at_their_depths() {
    let quiet = ProbeSpec { noise_level_db: -200.0, ..probe() };
    let with = ProbeSpec { tgc_sliders_db: vec![0.0, -6.0, 0.0, 4.0, 4.0], ..quiet.clone() };
    let rest = slice(pose(0.0, 0.0, 0.0, 0.0, 0.0, 0.0));
    let [before, after] = [&quiet, &with].map(|probe| picture(probe, &gel(), &rest));
    // Sliders stand 12 mm apart; half-way between two their mean counts.
    for (rows, gain_db) in [(115..126, -6.0), (175..186, -3.0), (235..246, 0.0), (400..460, 4.0)] {
        let change = level_db(&probe(), &after, rows.clone()) - level_db(&probe(), &before, rows.clone());
        assert!((change - gain_db).abs() < 0.35, "{rows:?}: {change} dB for {gain_db}");
    }
}

#[test]
fn truth_compensation_undoes_the_assumed_attenuation() {
    let probe = ProbeSpec { noise_level_db: -200.0, ..probe() };
    let image = picture(&probe, &gel(), &slice(pose(0.0, 0.0, 0.0, 0.0, 0.0, 0.0)));
    // The mean of a Rayleigh amplitude's dB lies 2.51 dB under its rms: −10·γ/ln 10.
    for rows in [40..90, 200..250, 400..450] {
        let level = level_db(&probe, &image, rows);
        assert!((level - (60.0 - 30.0 - 2.51)).abs() < 0.5, "level {level}");
    }
}

#[test]
fn truth_four_times_the_scatter_power_is_6_db() {
    let probe = ProbeSpec { noise_level_db: -200.0, ..probe() };
    let levels = [0.0, 6.0206].map(|backscatter_db| {
        let tissue = Tissue::homogeneous([0.1, 0.06, 0.06], material(Some(backscatter_db), 0.5));
        let image = picture(&probe, &tissue, &slice(pose(0.0, 0.0, 0.0, 0.0, 0.0, 0.0)));
        level_db(&probe, &image, 100..400)
    });
    assert!((levels[1] - levels[0] - 6.02).abs() < 0.3, "{levels:?}");
}

#[test]
fn gain_shifts_the_grey_level() {
    let probe = ProbeSpec { noise_level_db: -200.0, ..probe() };
    let mut slice = slice(pose(0.0, 0.0, 0.0, 0.0, 0.0, 0.0));
    let before = level_db(&probe, &picture(&probe, &gel(), &slice), 100..300);
    slice.gain_db = -4.0;
    let after = level_db(&probe, &picture(&probe, &gel(), &slice), 100..300);
    assert!((before - after - 4.0).abs() < 0.3, "{before} and {after}");
}

#[test]
fn nothing_of_the_scene_is_left_without_contact() {
    let rest = pose(0.0, 0.0, 1.0, 0.0, 0.0, 0.0);
    let mut lifted = slice(rest);
    lifted.element_gap_m.fill(1e-3);
    let empty = picture(&probe(), &water(), &lifted);
    lifted.needle = Some(needle_in_probe(&rest, [0.0, 0.0, 20.0], [0.8, 0.0, 0.6], 30.0));
    let full = picture(&probe(), &gel(), &lifted);
    assert!(empty == full, "tissue or needle show through air");
    assert!(level_db(&probe(), &full, 120..200) < 3.0, "the picture is not dark");
    assert!(level_db(&probe(), &full, 0..10) > 20.0, "no ringing at the face");
}

#[test]
fn a_blind_part_of_the_array_darkens_its_lines_only() {
    let mut partly = slice(pose(0.0, 0.0, 0.0, 0.0, 0.0, 0.0));
    let whole = picture(&probe(), &gel(), &partly);
    partly.element_gap_m[120..].fill(1e-4);
    let image = picture(&probe(), &gel(), &partly);
    let mean = |image: &Image, columns: core::ops::Range<usize>| -> f64 {
        let rows = 200..300u32;
        rows.flat_map(|v| image.row(v)[columns.clone()].iter().map(|&g| f64::from(g))).sum::<f64>()
    };
    // Element 120 is at +4.8 mm, column 368; at 25 mm the aperture reaches 6.25 mm to each side.
    assert_eq!(mean(&image, 140..290), mean(&whole, 140..290));
    assert!(mean(&image, 445..500) < 0.3 * mean(&whole, 445..500));
}

#[test]
fn truth_a_shadow_takes_its_decibels_from_what_only_shadowed_elements_see() {
    let probe = quiet_probe();
    let mut slice = slice(pose(0.0, 0.0, 0.0, 0.0, 0.0, 0.0));
    slice.needle = Some(needle_in_probe(&slice.phantom_from_probe, [2.0, 0.0, 20.0], [0.8, 0.0, 0.6], 30.0));
    let whole = picture(&probe, &gel(), &slice);
    slice.element_loss_db = vec![0.0; 192];
    assert!(picture(&probe, &gel(), &slice) == whole, "no loss changes something");
    // Right of the middle, 12 dB there and back are 51 of 255 levels of 60 dB.
    slice.element_loss_db[96..].fill(12.0);
    let image = picture(&probe, &gel(), &slice);
    // The aperture of a row is half its depth wide, as F# is 2; speckle is some 2 lines wider.
    for row in 60..300 {
        let reach_px = row / 4 + 6;
        let levels = |image: &Image, column: usize| i32::from(image.pixels[row * 640 + column]);
        for column in (140..320 - reach_px).chain(320 + reach_px..500) {
            let (before, after) = (levels(&whole, column), levels(&image, column));
            let taken = if column < 320 { 0 } else { 51 };
            // Black and white have no decibels; half a level of rounding each.
            if (52..255).contains(&before) {
                assert!((before - after - taken).abs() <= 1, "row {row}, column {column}: {before}, {after}");
            }
        }
    }
    // Half of the aperture takes 6 dB each way: 2·20·log10((1 + 10^(−6/20))/2) = −5.0 dB.
    slice.needle = None;
    let mean = |slice: &sonoloop_types::Slice| {
        let image = picture(&probe, &gel(), slice);
        (100..300u32).map(|row| f64::from(image.row(row)[320])).sum::<f64>() / 200.0 * 60.0 / 255.0
    };
    let shadowed = mean(&slice);
    slice.element_loss_db.clear();
    let taken_db = mean(&slice) - shadowed;
    assert!((taken_db - 5.0).abs() < 0.4, "{taken_db} dB at the edge");
}

#[test]
fn bands_of_ringing_slant_under_a_probe_that_is_lifted_on_one_side() {
    let probe = quiet_probe();
    // From contact in the middle to 0.48 mm at the left end.
    let gap_m = |i: usize| (96.0 - i as f32).max(0.0) * 5e-6;
    let lifted = slice(pose(0.0, 0.0, 0.0, 0.0, 0.0, 0.0));
    let lifted = sonoloop_types::Slice { element_gap_m: (0..192).map(gap_m).collect(), ..lifted };
    let image = picture(&probe, &gel(), &lifted);
    // Mean depth of the second band's upper half, weighted by brightness over that between the bands.
    let band_row = |columns: core::ops::Range<u32>, around: f64| {
        let (first, end) = (around as u32 - 4, around as u32 + 5);
        let level = |row: u32| {
            columns.clone().map(|u| f64::from(image.pixels[(row * 640 + u) as usize])).sum::<f64>()
        };
        let floor = level(first).min(level(end - 1));
        let weights = (first..end).map(|row| (f64::from(row), (level(row) - floor).max(0.0)));
        let [moment, total] = weights.fold([0.0; 2], |[m, t], (row, w)| [m + row * w, t + w]);
        moment / total
    };
    // Twice the lens of 0.9 mm and twice the gel, in rows of 0.1 mm; bands wave by 0.12 mm besides.
    for (columns, gap_mm) in [(140..150, 0.44), (200..210, 0.28), (260..270, 0.15)] {
        let expected = 2.0 * (9.0 + 10.0 * gap_mm);
        let row = band_row(columns, expected);
        assert!((row - expected).abs() < 1.5, "{gap_mm} mm: band in row {row} for {expected}");
    }
}
