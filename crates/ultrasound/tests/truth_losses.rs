//! Attenuation, backscatter, and contact, read off the picture.

mod common;

use common::{gel, material, needle, needle_in_probe, pose, probe, slice, water};
use sonoloop_types::{Image, ProbeSpec, Tissue};
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

#[test]
fn truth_attenuation_shows_as_the_slope_without_compensation() {
    for attenuation in [0.3, 0.5] {
        let probe = quiet_probe();
        let tissue = Tissue::homogeneous([0.1, 0.06, 0.06], material(Some(0.0), attenuation));
        let image = picture(&probe, &tissue, &slice(pose(0.0, 0.0, 0.0, 0.0, 0.0, 0.0)));
        let fall_db = level_db(&probe, &image, 40..80) - level_db(&probe, &image, 340..380);
        let expected_db = 2.0 * attenuation * 7.54 * 3.0;
        assert!((fall_db / expected_db - 1.0).abs() < 0.1, "{fall_db} dB over 3 cm, not {expected_db}");
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
