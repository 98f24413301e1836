//! The probes' files against PyMUST's beam: length of the pulse and width of the beam where the lens is in focus, and the slice at
//! every depth. `crates/ultrasound/tests/truth_psf.rs` shows that the renderer draws what a file states, and makes of pulse and
//! beam what PyMUST has at other depths.

mod common;

use sonoloop_scenario::{load_probe, load_probe_with};

fn check(file: &str) {
    let path = common::root().join("robots/probes").join(file);
    let probe = load_probe(&path).unwrap_or_else(|error| panic!("{}", error.render()));
    let reference = include_str!("../../ultrasound/tests/data/psf_pymust.csv");
    // A Gaussian pulse: half-maximum duration times bandwidth is 4·ln 2/π, and depth is c·t/2.
    let band_hz = probe.fractional_bandwidth * probe.centre_frequency_hz;
    let axial_m =
        probe.assumed_sound_speed_m_s * 2.0 * core::f64::consts::LN_2 / core::f64::consts::PI / band_hz;
    let (mut depths, mut stated) = (0, 0);
    let this_probe = format!("{},", probe.name);
    for line in reference.lines().filter(|line| line.starts_with(&this_probe)) {
        let values: Vec<f64> = line.split(',').skip(1).map(|v| v.parse().unwrap()).collect();
        let depth_mm = values[0];
        let widths_m = [axial_m, probe.lateral_width_m(), probe.slice_thickness_m(depth_mm * 1e-3)];
        for (what, (width_m, expected_mm)) in
            ["axial", "lateral", "elevation"].iter().zip(widths_m.iter().zip(&values[1..]))
        {
            let in_focus = (depth_mm * 1e-3 - probe.elevation_focus_m).abs() < 1e-6;
            if *what != "elevation" && !in_focus {
                continue;
            }
            stated += 1;
            let off = width_m * 1e3 / expected_mm - 1.0;
            assert!(off.abs() < 0.15, "{file}: {what} at {depth_mm} mm: {width_m} m for {expected_mm} mm");
        }
        depths += 1;
    }
    assert!(depths >= 9, "{depths} depths");
    assert_eq!(stated, depths + 2, "the lens's focus is a depth of the reference");
}

#[test]
fn truth_l11_5v_has_pymusts_widths() {
    check("l11_5v.yaml");
}

#[test]
fn truth_l12_3v_has_pymusts_widths() {
    check("l12_3v.yaml");
}

#[test]
fn truth_the_picture_is_as_deep_as_asked_for() {
    let path = common::root().join("robots/probes/l12_3v.yaml");
    for depth_mm in [30.0, 48.0, 80.0] {
        let probe = load_probe_with(&path, &[format!("depth_mm={depth_mm}")]);
        let geometry = probe.unwrap_or_else(|error| panic!("{}", error.render())).geometry;
        let bottom_mm = f64::from(geometry.height_px) * geometry.spacing_m * 1e3;
        assert!((bottom_mm - depth_mm).abs() < 1e-9, "{bottom_mm} mm for {depth_mm}");
    }
}
