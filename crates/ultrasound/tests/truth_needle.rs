//! Where the needle is drawn, and how it fades.

mod common;

use common::{gel, needle, needle_in_probe, pose, probe, slice, water};
use sonoloop_types::{ImageGeometry, NeedleSpec, Point, Pose, Slice, Tissue};
use sonoloop_ultrasound::Renderer;

/// Power of the field per pixel of the image, with the given needle.
fn power(spec: &NeedleSpec, tissue: &Tissue, slice: &Slice) -> Vec<f64> {
    let field = Renderer::new(probe(), spec.clone(), tissue.clone(), 4).field(slice);
    let mut power = vec![0.0; 640 * field.rows];
    for (i, [re, im]) in field.values.iter().enumerate() {
        let (row, column) = (i / field.columns, i % field.columns + field.first_px);
        power[row * 640 + column] = f64::from(re * re + im * im);
    }
    power
}

fn with_needle(pose: &Pose, tip_mm: [f64; 3], axis: [f64; 3]) -> Slice {
    Slice { needle: Some(needle_in_probe(pose, tip_mm, axis, 30.0)), ..slice(*pose) }
}

fn tip_only() -> NeedleSpec {
    NeedleSpec { specular_level_db: -200.0, rough_level_db: -200.0, ..needle() }
}

fn truth_px(tip_mm: [f64; 3]) -> [f64; 2] {
    ImageGeometry::default().px_from_probe(&Point::from(tip_mm.map(|v| v * 1e-3)))
}

/// Lateral insertion at an angle, or transverse (towards +e).
fn axes() -> Vec<[f64; 3]> {
    let at = |deg: f64| deg.to_radians().sin_cos();
    let lateral = [20.0, 40.0, 60.0].map(|deg| [at(deg).1, 0.0, at(deg).0]);
    let transverse = [30.0, 60.0].map(|deg| [0.0, at(deg).1, at(deg).0]);
    lateral.into_iter().chain(transverse).collect()
}

#[test]
fn truth_tip_is_drawn_within_half_a_pixel() {
    let poses = [pose(0.0, 0.0, 0.0, 0.0, 0.0, 0.0), pose(1.0, 2.0, -1.0, 25.0, 7.0, -5.0)];
    for pose in &poses {
        for axis in axes() {
            for tip_mm in [[3.21, 0.0, 14.37], [-7.04, 0.0, 25.5], [1.0, 0.0, 38.13]] {
                let power = power(&tip_only(), &water(), &with_needle(pose, tip_mm, axis));
                let total: f64 = power.iter().sum();
                let mean = |value: fn(usize) -> usize| {
                    power.iter().enumerate().map(|(i, p)| value(i) as f64 * p).sum::<f64>() / total
                };
                let [u, v] = truth_px(tip_mm);
                let (du, dv) = (mean(|i| i % 640) - u, mean(|i| i / 640) - v);
                assert!(du.hypot(dv) < 0.5, "off by ({du:.2}, {dv:.2}) px at {tip_mm:?} along {axis:?}");
            }
        }
    }
}

#[test]
fn truth_the_tip_is_the_brightest_part_of_an_oblique_needle() {
    let rest = pose(0.0, 0.0, 0.0, 0.0, 0.0, 0.0);
    for tip_mm in [[3.2, 0.0, 14.4], [4.0, 0.0, 24.0]] {
        for tissue in [water(), gel()] {
            let axis = [0.766, 0.0, 0.643];
            let power = power(&needle(), &tissue, &with_needle(&rest, tip_mm, axis));
            let brightest = power.iter().enumerate().max_by(|a, b| a.1.total_cmp(b.1)).map_or(0, |m| m.0);
            let [u, v] = truth_px(tip_mm);
            let (du, dv) = ((brightest % 640) as f64 - u, (brightest / 640) as f64 - v);
            assert!(du.hypot(dv) < 2.0, "brightest ({du:.1}, {dv:.1}) px from the tip at {tip_mm:?}");
        }
    }
}

#[test]
fn truth_tip_fades_with_elevation_as_the_beam_says() {
    let rest = pose(0.0, 0.0, 0.0, 0.0, 0.0, 0.0);
    for depth_mm in [13.0, 22.0, 35.0] {
        // The tip moves in elevation, its needle with it.
        let peak = |e_mm: f64| {
            let slice = with_needle(&rest, [0.05, e_mm, depth_mm], [0.766, 0.0, 0.643]);
            power(&tip_only(), &water(), &slice).into_iter().fold(0.0, f64::max).sqrt()
        };
        let sigma_mm = probe().slice_thickness_m(depth_mm * 1e-3) * 1e3 / 2.3548;
        for share in [0.5, 1.0, 2.0, 3.0] {
            let expected = (-share * share / 2.0f64).exp();
            let measured = peak(share * sigma_mm) / peak(0.0);
            assert!((measured / expected - 1.0).abs() < 0.02, "{depth_mm} mm, {share} σ: {measured}");
        }
    }
}

#[test]
fn truth_shaft_stands_as_high_over_speckle_as_its_roughness_says() {
    let rest = pose(0.0, 0.0, 0.0, 0.0, 0.0, 0.0);
    let spec = NeedleSpec { specular_level_db: -200.0, tip_level_db: -200.0, ..needle() };
    let (sin, cos) = 40f64.to_radians().sin_cos();
    let mut mean = 0.0;
    let (mut places, runs) = (0, 6);
    for run in 0..runs {
        // Slices of the same thickness, 1 mm, to which levels refer: about 23.5 mm deep.
        let x_mm = -6.0 + 2.0 * f64::from(run);
        let power = power(&spec, &water(), &with_needle(&rest, [x_mm, 0.0, 27.0], [cos, 0.0, sin]));
        for back_mm in (20..80).map(|i| f64::from(i) * 0.1) {
            // The brightest pixel across the shaft stands for its ridge.
            let [u, v] = truth_px([x_mm - back_mm * cos, 0.0, 27.0 - back_mm * sin]);
            let column = u.round() as usize;
            let ridge = (v as usize - 8..v as usize + 5).map(|row| power[row * 640 + column]);
            mean += ridge.fold(0.0, f64::max);
            places += 1;
        }
    }
    let level_db = 10.0 * (mean / f64::from(places)).log10();
    println!("{level_db:.1} dB");
    // The ridge's maximum lies a little over the mean, the spread around the front wall a little under.
    assert!((level_db - spec.rough_level_db).abs() < 3.0, "{level_db} dB");
}

#[test]
fn truth_a_flat_shaft_is_a_mirror_and_an_oblique_one_is_not() {
    let rest = pose(0.0, 0.0, 0.0, 0.0, 0.0, 0.0);
    let spec = NeedleSpec { rough_level_db: -200.0, tip_level_db: -200.0, ..needle() };
    let peak_db = |deg: f64| {
        let (sin, cos) = deg.to_radians().sin_cos();
        let slice = with_needle(&rest, [10.0, 0.0, 24.0], [cos, 0.0, sin]);
        10.0 * power(&spec, &water(), &slice).into_iter().fold(1e-9, f64::max).log10()
    };
    // Level as stated; cos 0 of the sum, and the thickness at 23.6 mm is within 0.3 dB of its reference.
    assert!((peak_db(0.0) - 45.0).abs() < 1.5, "{} dB", peak_db(0.0));
    assert!(peak_db(40.0) < peak_db(0.0) - 40.0, "{} dB at 40°", peak_db(40.0));
}
