//! Surfaces between materials: how bright, at which angles, where, and what is under them.

mod common;

use common::{material, needle, pose, probe, slice};
use sonoloop_types::{Acoustics, ColumnSegment, Effects, Image, Point, Pose, ProbeSpec, Tissue, Vector};
use sonoloop_ultrasound::{Field, Renderer};

const SIZE_M: [f64; 3] = [0.1, 0.06, 0.06];

/// Clear liquid, and under a surface that falls by `slope` per metre along x and y another one of `ratio` times its impedance.
fn two_liquids(depth_m: f64, slope: [f64; 2], ratio: f64) -> Tissue {
    let upper = material(None, 0.0);
    let lower = Acoustics { density_kg_m3: upper.density_kg_m3 * ratio, ..upper };
    Tissue::new(SIZE_M, vec![upper, lower], move |x, y, out| {
        let z_m = -depth_m - slope[0] * x - slope[1] * y;
        out.push(ColumnSegment { top_z_m: 0.0, bottom_z_m: z_m, material: 0 });
        out.push(ColumnSegment { top_z_m: z_m, bottom_z_m: -SIZE_M[2], material: 1 });
    })
}

fn field(probe: &ProbeSpec, tissue: &Tissue, pose: Pose) -> Field {
    Renderer::new(probe.clone(), needle(), tissue.clone(), 6).field(&slice(pose))
}

/// Highest power in the middle of the picture, in dB over unit speckle, and its row, between rows too.
fn peak(field: &Field) -> (f64, f64) {
    let column = field.columns / 2;
    let power = |row: usize| {
        let [re, im] = field.values[row * field.columns + column].map(f64::from);
        re * re + im * im
    };
    let best = (1..field.rows - 1).max_by(|&a, &b| power(a).total_cmp(&power(b))).unwrap_or(1);
    let [a, b, c] = [best - 1, best, best + 1].map(|row| power(row).max(1e-30).ln());
    // A Gaussian's logarithm is a parabola.
    let past = 0.5 * (a - c) / (a - 2.0 * b + c);
    ((b - 0.25 * (a - c) * past) * 10.0 / core::f64::consts::LN_10, best as f64 + past)
}

#[test]
fn truth_a_mirror_is_as_bright_as_its_impedances_say() {
    for ratio in [1.05, 1.9, 28.0] {
        let reflection = (ratio - 1.0) / (ratio + 1.0);
        for depth_mm in [13.0, 24.03, 37.0] {
            let tissue = two_liquids(depth_mm * 1e-3, [0.0; 2], ratio);
            let (level_db, row) = peak(&field(&probe(), &tissue, pose(0.0, 0.0, 0.0, 0.0, 0.0, 0.0)));
            let expected_db = 54.0 + 20.0 * f64::log10(reflection);
            assert!((level_db - expected_db).abs() < 1.0, "{ratio}: {level_db} dB for {expected_db}");
            assert!((row - depth_mm * 10.0).abs() < 0.5, "{ratio}: row {row} for {depth_mm} mm");
        }
    }
}

#[test]
fn truth_a_mirror_fades_with_its_angle_as_the_aperture_says() {
    // A line of echoes on a slope turns by 2k·tan θ per metre: through a beam of σ it sums to exp(−(2kσ·tan θ)²/2).
    let two_k = 4.0 * core::f64::consts::PI * 7.54e6 / 1540.0;
    let sigma_m = 0.886 * 1540.0 / 7.54e6 * 2.0 / 2.3548;
    let flat =
        peak(&field(&probe(), &two_liquids(0.024, [0.0; 2], 1.9), pose(0.0, 0.0, 0.0, 0.0, 0.0, 0.0))).0;
    for (yaw_deg, y_mm) in [(0.0, 0.0), (0.0, 0.12), (25.0, 0.07), (55.0, 0.0), (90.0, 0.2)] {
        let pose = pose(0.0, y_mm, 0.0, yaw_deg, 0.0, 0.0);
        let along = pose * Vector::x();
        for slope in [0.05f64, 0.1, 0.13] {
            let expected_db = -4.342_944_8 * (two_k * sigma_m * slope).powi(2);
            let tilted = two_liquids(0.024, [slope * along.x, slope * along.y], 1.9);
            let fall_db = peak(&field(&probe(), &tilted, pose)).0 - flat;
            assert!(
                (fall_db - expected_db).abs() < 1.0,
                "slope {slope} at {yaw_deg}°, {y_mm} mm: {fall_db} for {expected_db}"
            );
        }
        // 10, 14 and 20 degrees: −13, −24 and −50 dB, and the surface's roughness, 26 dB below its mirror. One in a
        // hundred Rayleigh amplitudes is 2.1 times their rms.
        for slope in [0.18f64, 0.25, 0.36] {
            let mirror = (-0.5 * (two_k * sigma_m * slope).powi(2)).exp();
            let steep = two_liquids(0.024, [slope * along.x, slope * along.y], 1.9);
            let seen = 10.0f64.powf((peak(&field(&probe(), &steep, pose)).0 - flat) / 20.0);
            let rough = 2.1 * 10.0f64.powf(-26.0 / 20.0);
            assert!(
                (seen - mirror).abs() < rough,
                "slope {slope} at {yaw_deg}°, {y_mm} mm: {seen} for {mirror}"
            );
        }
    }
}

/// A slab of the second material between two depths, for x in a range, in the first.
fn slab(materials: [Acoustics; 2], depths_m: [f64; 2], x_m: [f64; 2]) -> Tissue {
    Tissue::new(SIZE_M, materials.to_vec(), move |x, _, out| {
        let mut top_z_m = 0.0;
        let inside = x_m[0] <= x && x <= x_m[1];
        for (bottom_m, material) in [(depths_m[0], 0), (depths_m[1], 1)].into_iter().filter(|_| inside) {
            out.push(ColumnSegment { top_z_m, bottom_z_m: -bottom_m, material });
            top_z_m = -bottom_m;
        }
        out.push(ColumnSegment { top_z_m, bottom_z_m: -SIZE_M[2], material: 0 });
    })
}

const WIDE: [f64; 2] = [-1.0, 1.0];

/// Mean power in dB of some rows and columns, counted from the middle.
fn power_db(field: &Field, rows: core::ops::Range<usize>, columns: core::ops::Range<i32>) -> f64 {
    let middle = field.columns as i32 / 2;
    let mut sum = 0.0;
    let mut count = 0.0;
    for row in rows {
        for column in columns.clone() {
            let [re, im] = field.values[row * field.columns + (middle + column) as usize].map(f64::from);
            sum += re * re + im * im;
            count += 1.0;
        }
    }
    10.0 * f64::log10(sum / count)
}

#[test]
fn truth_depths_are_drawn_by_their_time_of_flight() {
    // Clear liquid, a slab of another sound speed, and a mirror under it: a layer of metal.
    for (speed_m_s, tilt_deg) in [(1450.0, 0.0), (1600.0, 0.0), (1620.0, 4.0)] {
        let clear = material(None, 0.0);
        let other = Acoustics { sound_speed_m_s: speed_m_s, density_kg_m3: 1540.0e3 / speed_m_s, ..clear };
        let metal = Acoustics { density_kg_m3: 8000.0, ..clear };
        let bounds_m = [0.0, -0.008, -0.020, -0.03011];
        let tissue = Tissue::new(SIZE_M, vec![clear, other, metal], move |_, _, out| {
            for (i, material) in [0, 1, 0].into_iter().enumerate() {
                out.push(ColumnSegment { top_z_m: bounds_m[i], bottom_z_m: bounds_m[i + 1], material });
            }
            out.push(ColumnSegment { top_z_m: bounds_m[3], bottom_z_m: -SIZE_M[2], material: 2 });
        });
        // Tilting draws all paths longer by 1/cos.
        let cos = f64::to_radians(tilt_deg).cos();
        let (_, row) = peak(&field(&probe(), &tissue, pose(0.0, 0.0, 0.0, 0.0, tilt_deg, 0.0)));
        let expected_mm = (18.11 + 12.0 * 1540.0 / speed_m_s) / cos;
        assert!(
            (row / 10.0 - expected_mm).abs() < 0.05,
            "{speed_m_s} m/s: {} mm for {expected_mm}",
            row / 10.0
        );
        let still = ProbeSpec { effects: Effects { sound_speed: false, ..Effects::default() }, ..probe() };
        let (_, row) = peak(&field(&still, &tissue, pose(0.0, 0.0, 0.0, 0.0, tilt_deg, 0.0)));
        assert!((row / 10.0 - 30.11 / cos).abs() < 0.05, "switched off: {} mm", row / 10.0);
    }
}

#[test]
fn truth_speckle_of_a_slow_phantom_is_that_of_the_assumed_one_moved() {
    // The scatterers are the same, so what is at depth v in the one is at v·c₀/c in the other.
    let [slow, plain] = [1510.0, 1540.0].map(|sound_speed_m_s| {
        let gel = Acoustics { sound_speed_m_s, ..material(Some(0.0), 0.0) };
        field(&probe(), &Tissue::homogeneous(SIZE_M, gel), pose(0.0, 0.0, 0.0, 0.0, 0.0, 0.0))
    });
    let magnitude = |field: &Field, row: f64, column: usize| {
        let at = |row: usize| {
            let [re, im] = field.values[row * field.columns + column].map(f64::from);
            re.hypot(im)
        };
        at(row as usize) + (at(row as usize + 1) - at(row as usize)) * row.fract()
    };
    // Rows whose place in the other picture is nearly a whole one, so that nothing need be interpolated.
    let scale = 1510.0 / 1540.0;
    let rows = (100..470).filter(|&row| (f64::from(row) * scale).fract() < 0.04);
    let (mut difference, mut power, mut count) = (0.0, 0.0, 0);
    for row in rows {
        for column in 0..plain.columns {
            let a = magnitude(&slow, f64::from(row), column);
            let b = magnitude(&plain, (f64::from(row) * scale).floor(), column);
            difference += (a - b) * (a - b);
            power += b * b;
            count += 1;
        }
    }
    assert!(count > 2000, "{count} pixels compared");
    // A shift of 0.04 px alone changes 4 %; the beams' widths at the two depths differ too.
    assert!((difference / power).sqrt() < 0.1, "{:.3} apart", (difference / power).sqrt());
}

/// Level in dB of some rows and columns of a picture, columns counted from the middle, with nothing compensated.
fn level_db(tissue: &Tissue, rows: core::ops::Range<u32>, columns: core::ops::Range<i32>) -> f64 {
    let probe = ProbeSpec {
        noise_level_db: -200.0,
        tgc_db_cm_mhz: 0.0,
        dynamic_range_db: 100.0,
        speckle_level_db: 15.0,
        ..probe()
    };
    let mut image = Image::black(1, 1);
    let scene = slice(pose(0.0, 0.0, 0.0, 0.0, 0.0, 0.0));
    Renderer::new(probe.clone(), needle(), tissue.clone(), 6).render(&scene, &mut image);
    let (first, end) = ((320 + columns.start) as usize, (320 + columns.end) as usize);
    let count = rows.len() * columns.len();
    let sum: f64 = rows.flat_map(|v| image.row(v)[first..end].iter().map(|&g| f64::from(g))).sum();
    sum / count as f64 / 255.0 * 100.0
}

#[test]
fn truth_shadow_is_complete_near_the_body_and_fills_as_the_aperture_sees_past_it() {
    // A strip of half width w at depth z₀ hides from a place on its axis at depth z what lies within w of the middle
    // of the aperture's cone there, (z − z₀)/F# wide. With a triangular aperture the share seen is
    // (1 − 2w·F#/(z − z₀))², both ways its square.
    let gel = material(Some(0.0), 0.0);
    let black = Acoustics { backscatter_db: None, attenuation_db_cm_mhz: 20.0, ..gel };
    let tissue = slab([gel, black], [0.010, 0.012], [-2e-3, 2e-3]);
    let plain = Tissue::homogeneous(SIZE_M, gel);
    let change_db = |rows: core::ops::Range<u32>, columns: core::ops::Range<i32>| {
        level_db(&tissue, rows.clone(), columns.clone()) - level_db(&plain, rows, columns)
    };
    assert!(change_db(130..180, -10..10) < -40.0, "{}", change_db(130..180, -10..10));
    // Nearer than that the shadow fills up to 6 dB faster than rays say: the map that follows them blurs its edge.
    for row in [350u32, 450] {
        let beyond_m = f64::from(row) * 1e-4 - 0.012;
        let seen = 1.0 - 4e-3 * 2.0 / beyond_m;
        let expected_db = 80.0 * seen.log10();
        let measured_db = change_db(row - 12..row + 12, -4..5);
        assert!((measured_db - expected_db).abs() < 2.5, "row {row}: {measured_db} dB for {expected_db}");
    }
    // Beside the body nothing is missing.
    assert!(change_db(100..200, 60..150).abs() < 0.5, "{}", change_db(100..200, 60..150));
}

#[test]
fn truth_strong_reflectors_throw_shadows_and_weak_ones_do_not() {
    let gel = material(Some(0.0), 0.0);
    let plain = Tissue::homogeneous(SIZE_M, gel);
    for (density_ratio, reflection) in [(1.2, 0.2 / 2.2), (5.0, 4.0 / 6.0)] {
        // Both faces of the slab let 1 − R² of the pressure pass, there and back.
        let body = Acoustics { density_kg_m3: gel.density_kg_m3 * density_ratio, ..gel };
        let tissue = slab([gel, body], [0.010, 0.014], WIDE);
        let expected_db = 2.0 * 20.0 * f64::log10(1.0 - reflection * reflection);
        let change_db = level_db(&tissue, 350..470, -150..150) - level_db(&plain, 350..470, -150..150);
        assert!((change_db - expected_db).abs() < 0.6, "{density_ratio}: {change_db} dB for {expected_db}");
    }
}

#[test]
fn truth_echoes_between_two_faces_are_a_thickness_apart() {
    // A plate of steel, 2 mm: shown 2 mm·1540/5790 = 0.53 mm thick.
    let steel = Acoustics { sound_speed_m_s: 5790.0, density_kg_m3: 7900.0, ..material(None, 0.0) };
    let tissue = slab([material(None, 0.0), steel], [0.020, 0.022], WIDE);
    let field = field(&probe(), &tissue, pose(0.0, 0.0, 0.0, 0.0, 0.0, 0.0));
    let power: Vec<f64> = (0..field.rows).map(|row| power_db(&field, row..row + 1, -20..20)).collect();
    let crests: Vec<usize> = (195..235)
        .filter(|&v| power[v] > power[v - 1] && power[v] > power[v + 1] && power[v] > 0.0)
        .collect();
    assert!(crests.len() >= 4, "{crests:?}");
    for pair in crests.windows(2) {
        assert!((pair[1] as f64 - pair[0] as f64 - 5.32).abs() <= 1.0, "{crests:?}");
    }
}

#[test]
fn truth_echoes_inside_a_plate_weaken_as_two_passages_and_its_faces_say() {
    // A bone-like plate and one that lets next to nothing in, 4 mm thick at the assumed speed, so 4 mm apart.
    for density_ratio in [4.3f64, 400.0] {
        let liquid = material(None, 0.0);
        let body = Acoustics { density_kg_m3: liquid.density_kg_m3 * density_ratio, ..liquid };
        let tissue = slab([liquid, body], [0.012, 0.016], WIDE);
        let field = field(&probe(), &tissue, pose(0.0, 0.0, 0.0, 0.0, 0.0, 0.0));
        let peak_db = |depth_px: usize| {
            (depth_px - 2..=depth_px + 2)
                .map(|row| power_db(&field, row..row + 1, -20..20))
                .fold(f64::MIN, f64::max)
        };
        let reflection = (density_ratio - 1.0) / (density_ratio + 1.0);
        let front_db = peak_db(120);
        // Each is R³(1 − R²) of the front's, and R² less with every passage more.
        for (bounce, depth_px) in [(2, 200), (3, 240)] {
            let share = (1.0 - reflection * reflection) * reflection.powi(2 * bounce - 2);
            let (expected_db, seen_db) = (20.0 * share.log10(), peak_db(depth_px) - front_db);
            assert!(
                (seen_db - expected_db).abs() < 1.0,
                "{density_ratio}, {bounce}: {seen_db} dB for {expected_db}"
            );
        }
    }
}

/// Most power within 0.8 mm of a place of the phantom, in dB over unit speckle.
fn power_about_db(field: &Field, pose: Pose, at: Point) -> f64 {
    let at = pose.inverse() * at;
    let (row, column) = ((at.z / 1e-4) as usize, (field.columns / 2) as f64 + at.x / 1e-4);
    let power = |row: usize, column: usize| {
        let [re, im] = field.values[row * field.columns + column].map(f64::from);
        re * re + im * im
    };
    let columns = column as usize - 8..column as usize + 8;
    let places = (row - 8..row + 8).flat_map(|row| columns.clone().map(move |column| (row, column)));
    10.0 * places.map(|(row, column)| power(row, column)).fold(0.0, f64::max).log10()
}

#[test]
fn truth_a_thread_across_the_picture_echoes_wherever_it_lies() {
    // Half a millimetre thick, as columns of the lattice lie a quarter apart: one of them meets it within an eighth of its top,
    // where its surface is 30° steep.
    let body = material(None, 0.0);
    let thread = Acoustics { density_kg_m3: body.density_kg_m3 * 1.5, ..body };
    for (yaw_deg, pitch_deg) in [(0.0, 0.0), (90.0, 0.0), (0.0, 20.0), (90.0, -20.0)] {
        let level_db = |i: i32| {
            let centre_m = f64::from(i) * 0.031e-3;
            let along = move |x: f64, y: f64| if yaw_deg == 0.0 { x } else { y };
            let tissue = Tissue::new(SIZE_M, vec![body, thread], move |x, y, out| {
                let aside_m = along(x, y) - centre_m;
                let half_m = (0.25e-3f64.powi(2) - aside_m * aside_m).max(0.0).sqrt();
                let [top_z_m, bottom_z_m] = [half_m, -half_m].map(|half_m| half_m - 0.024);
                out.push(ColumnSegment { top_z_m: 0.0, bottom_z_m: top_z_m, material: 0 });
                if half_m > 0.0 {
                    out.push(ColumnSegment { top_z_m, bottom_z_m, material: 1 });
                }
                out.push(ColumnSegment { top_z_m: bottom_z_m, bottom_z_m: -SIZE_M[2], material: 0 });
            });
            let pose = pose(0.0, 0.0, 0.0, yaw_deg, 0.0, pitch_deg);
            let field = field(&probe(), &tissue, pose);
            power_about_db(&field, pose, Point::new(along(centre_m, 0.0), along(0.0, centre_m), -0.024))
        };
        let levels_db: Vec<f64> = (-8..8).map(level_db).collect();
        let [least_db, most_db] =
            levels_db.iter().fold([f64::MAX, f64::MIN], |[a, b], &l| [l.min(a), l.max(b)]);
        assert!(
            most_db - least_db < 9.0 && least_db > 20.0,
            "yaw {yaw_deg}°, pitch {pitch_deg}°: {levels_db:.1?} dB"
        );
    }
}

#[test]
fn truth_a_steep_mirror_fades_out_of_plane_too() {
    // A plane that a probe pitched by 30° faces, and 4° off it in elevation.
    let two_k = 4.0 * core::f64::consts::PI * 7.54e6 / 1540.0;
    for pitch_deg in [30.0, -30.0f64] {
        let upright = pose(0.0, 0.0, -2.0, 0.0, 0.0, pitch_deg);
        let axis = upright * Vector::z();
        let tissue = two_liquids(0.024, [axis.x / axis.z, 0.0], 1.9);
        let level_db = |roll_deg: f64| {
            let pose = pose(0.0, 0.0, -2.0, 0.0, roll_deg, pitch_deg);
            peak(&field(&probe(), &tissue, pose))
        };
        let (faced_db, row) = level_db(0.0);
        let sigma_m = probe().slice_thickness_m(row * 1e-4) / 2.3548;
        let off = pose(0.0, 0.0, -2.0, 0.0, 4.0, pitch_deg).inverse() * axis;
        let expected_db = -4.342_944_8 * (two_k * sigma_m * off.y / off.z).powi(2);
        let fall_db = level_db(4.0).0 - faced_db;
        // Roughness, 19 dB below what is left, adds up to 2 dB.
        assert!((fall_db - expected_db).abs() < 2.0, "{fall_db} dB for {expected_db}");
    }
}

#[test]
fn a_plate_ends_without_a_glint() {
    let body = material(None, 0.0);
    let plate = Acoustics { density_kg_m3: body.density_kg_m3 * 1.9, ..body };
    let tissue = slab([body, plate], [0.020, 0.024], [-5e-3, 5e-3]);
    for pitch_deg in [25.0, -25.0] {
        let pose = pose(0.0, 0.0, 0.0, 0.0, 0.0, pitch_deg);
        let field = field(&probe(), &tissue, pose);
        for x_m in [-5e-3, 5e-3] {
            let level_db = power_about_db(&field, pose, Point::new(x_m, 0.0, -0.020));
            // Its roughness is at 18 dB, one in a hundred Rayleigh amplitudes 6.6 dB more; its mirror is at 44.
            assert!(level_db < 26.0, "{level_db} dB at {x_m} m, pitched by {pitch_deg}°");
        }
    }
}
