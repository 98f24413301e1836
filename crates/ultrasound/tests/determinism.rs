//! Same slice, same bytes; and no slice is too odd.

mod common;

use common::{gel, material, needle, needle_in_probe, pose, press, probe, slice, water};
use nalgebra::{Translation3, UnitQuaternion, Vector3};
use sonoloop_types::{
    Drag, Image, ImageGeometry, Indentation, NeedlePath, Point, Pose, Precision, ProbeSpec, Slice, Tissue,
    Vector,
};
use sonoloop_ultrasound::{Instructions, Renderer};

fn render(renderer: &mut Renderer, slice: &Slice) -> Vec<u8> {
    let mut image = Image::black(640, 480);
    renderer.render(slice, &mut image);
    image.pixels
}

fn scene(pose: Pose, sequence: u64) -> Slice {
    let needle = Some(needle_in_probe(&pose, [2.0, 0.3, 22.0], [0.766, 0.0, 0.643], 30.0));
    Slice { sequence, needle, ..slice(pose) }
}

fn poses() -> [Pose; 7] {
    [
        pose(0.0, 0.0, 0.0, 0.0, 0.0, 0.0),
        // Pairs that share one of the tables that are kept between pictures, and not the other.
        pose(0.0, 0.0, -2.0, 0.0, 10.0, 0.0),
        pose(0.0, 0.0, -2.0, 0.0, -10.0, 0.0),
        pose(0.0, 0.0, -2.0, 0.0, 0.0, 10.0),
        pose(0.0, 0.0, -2.0, 0.0, 0.0, -10.0),
        pose(0.7, -1.3, -0.4, 31.0, 3.0, -8.0),
        pose(0.0, 0.0, -10.0, -12.0, -28.0, 27.0),
    ]
}

/// All of them, some with pressed or dragged tissue or without contact on the left.
fn scenes(sequence: u64) -> Vec<Slice> {
    let pressed = [pose(0.2, 0.1, -2.0, 5.0, 0.0, 0.0), pose(0.0, 0.5, -6.0, 20.0, -12.0, 15.0)]
        .map(|pose| Slice { indentation: Some(press(&pose, 20e-3, 2e-3)), ..scene(pose, sequence) });
    let mut lifted = scene(pose(0.1, 0.0, 0.0, 0.0, 0.0, 0.0), sequence);
    lifted.element_gap_m[..40].fill(1e-3);
    let drag = Drag {
        centre_in_phantom: Point::new(3e-3, 0.5e-3, -20e-3),
        displacement_in_phantom: Vector::new(1.5e-3, 0.3e-3, -1.2e-3),
        decay_m: 5e-3,
    };
    let dragged =
        [&pressed[0], &scene(poses()[1], sequence)].map(|slice| Slice { drag: Some(drag), ..slice.clone() });
    // In one attitude, whose tape is kept: strained much in the plane, and then more beside it than in it.
    let upright = scene(pose(0.2, 0.1, -4.0, 0.0, 0.0, 0.0), sequence);
    let deep = Slice {
        indentation: Some(press(&pose(0.2, 0.1, -4.0, 0.0, 0.0, 0.0), 20e-3, 4e-3)),
        ..upright.clone()
    };
    let beside = Drag { centre_in_phantom: Point::new(3e-3, 2e-3, -24e-3), ..drag };
    let strained = [deep, Slice { drag: Some(beside), ..upright }];
    let at_rest = poses().map(|pose| scene(pose, sequence));
    at_rest.into_iter().chain(pressed).chain(dragged).chain([lifted]).chain(strained).collect()
}

#[test]
fn bytes_do_not_depend_on_the_number_of_threads() {
    let with_threads = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("a pool");
        pool.install(|| {
            let mut renderer = Renderer::new(probe(), needle(), gel(), 1);
            scenes(3).iter().map(|slice| render(&mut renderer, slice)).collect::<Vec<_>>()
        })
    };
    let one = with_threads(1);
    assert!(one == with_threads(2), "two threads");
    assert!(one == with_threads(4), "four threads");
}

#[test]
fn bytes_do_not_depend_on_what_was_drawn_before() {
    let mut used = Renderer::new(probe(), needle(), gel(), 1);
    for slice in scenes(0) {
        render(&mut used, &slice);
    }
    for slice in scenes(8) {
        let fresh = render(&mut Renderer::new(probe(), needle(), gel(), 1), &slice);
        assert!(render(&mut used, &slice) == fresh);
    }
}

/// The tape is kept for strains that have been met in one attitude: a field is the same, bit by bit, whichever those were.
#[test]
fn fields_do_not_depend_on_the_strains_drawn_before() {
    let place = pose(0.2, 0.1, -4.0, 0.0, 0.0, 0.0);
    for precision in [Precision::Usual, Precision::Fine] {
        let renderer = || Renderer::new(ProbeSpec { precision, ..probe() }, needle(), gel(), 1);
        let pressed =
            |depth_m: f64| Slice { indentation: Some(press(&place, 20e-3, depth_m)), ..slice(place) };
        let mut used = renderer();
        for depth_m in [1e-3, 4e-3, 10e-3, 6e-3, 3e-3, 2e-3, 0.5e-3] {
            let field = used.field(&pressed(depth_m));
            let same = field == renderer().field(&pressed(depth_m));
            assert!(same, "{depth_m} m, {precision:?}");
        }
    }
}

/// On a CPU without wider instructions there is one set only, and nothing to compare.
#[test]
fn bytes_do_not_depend_on_the_instructions_of_the_cpu() {
    for precision in [Precision::Usual, Precision::Fine] {
        let with = |instructions: Instructions| {
            let mut renderer = Renderer::new(ProbeSpec { precision, ..probe() }, needle(), gel(), 1);
            renderer.use_instructions(instructions);
            scenes(3).iter().map(|slice| render(&mut renderer, slice)).collect::<Vec<_>>()
        };
        let plain = with(Instructions::PLAIN);
        for instructions in Instructions::available() {
            println!("{instructions:?}");
            assert!(with(instructions) == plain, "{instructions:?} differ");
        }
    }
}

#[test]
fn a_picture_at_rest_is_the_one_drawn_anew() {
    let mut renderer = Renderer::new(probe(), needle(), gel(), 1);
    let all = scenes(0);
    let pressed = all.iter().position(|slice| slice.indentation.is_some()).expect("a press");
    for index in [0, 1, 2, pressed, pressed + 1] {
        let mut slice = all[index].clone();
        render(&mut renderer, &slice);
        for (sequence, gain_db) in [(1, 0.0), (2, -3.0), (7, 4.0)] {
            (slice.sequence, slice.gain_db, slice.noise_gain_db) = (sequence, gain_db, 2.0 * gain_db);
            let fresh = render(&mut Renderer::new(probe(), needle(), gel(), 1), &slice);
            assert!(render(&mut renderer, &slice) == fresh, "image {sequence} differs");
        }
        // What the field depends on, one by one.
        let mut changed = vec![slice.clone(); 7];
        changed[0].needle_gain_db = -6.0;
        changed[1].needle = None;
        changed[2].element_gap_m[60..90].fill(1e-3);
        let indentation = press(&slice.phantom_from_probe, 20e-3, 1e-3);
        changed[3].indentation = if slice.indentation.is_some() { None } else { Some(indentation) };
        changed[5].drag = scenes(0).into_iter().find_map(|slice| slice.drag);
        changed[4].phantom_from_probe.translation.vector.x += 1e-4;
        changed[6].element_loss_db = vec![20.0; 100];
        for slice in changed {
            let fresh = render(&mut Renderer::new(probe(), needle(), gel(), 1), &slice);
            assert!(render(&mut renderer, &slice) == fresh, "an old field is shown");
        }
    }
}

#[test]
fn only_noise_moves_in_a_static_scene() {
    let mut renderer = Renderer::new(probe(), needle(), gel(), 1);
    let [rest, ..] = poses();
    assert_eq!(renderer.field(&scene(rest, 0)), renderer.field(&scene(rest, 1)));
    let (a, b) = (render(&mut renderer, &scene(rest, 0)), render(&mut renderer, &scene(rest, 1)));
    let rms = |rows: core::ops::Range<usize>| {
        let pairs = a[rows.start * 640..rows.end * 640].iter().zip(&b[rows.start * 640..rows.end * 640]);
        let sum: f64 = pairs.map(|(&a, &b)| (f64::from(a) - f64::from(b)).powi(2)).sum();
        (sum / (rows.len() * 384) as f64).sqrt()
    };
    assert!(rms(0..100) > 0.0, "the noise stands still");
    assert!(rms(0..100) < 2.0, "{} grey levels of noise near the face", rms(0..100));
    assert!(rms(380..480) < 12.0, "{} grey levels of noise at depth", rms(380..480));
}

#[test]
fn another_seed_is_another_tissue() {
    let [rest, ..] = poses();
    let [a, b] = [1, 2].map(|seed| Renderer::new(probe(), needle(), gel(), seed).field(&slice(rest)));
    let (mut ab, mut aa) = (0.0, 0.0);
    for (a, b) in a.values.iter().zip(&b.values) {
        ab += f64::from(a[0] * b[0] + a[1] * b[1]);
        aa += f64::from(a[0] * a[0] + a[1] * a[1]);
    }
    assert!(ab.abs() < 0.05 * aa, "fields of two seeds are alike: {}", ab / aa);
}

#[test]
fn no_pose_is_too_odd() {
    let turn = |x: f64| UnitQuaternion::from_scaled_axis(Vector3::new(x, 0.0, 0.0));
    let at = |x: f64, z: f64| Translation3::new(x, 0.0, z);
    let odd = [
        Pose::identity(),
        Pose::from_parts(at(1e9, 0.0), turn(std::f64::consts::PI)),
        Pose::from_parts(at(0.0, -1e3), turn(std::f64::consts::PI)),
        Pose::from_parts(at(0.0, -1e9), turn(std::f64::consts::PI)),
        Pose::from_parts(at(0.0, 1e9), turn(std::f64::consts::PI)),
        Pose::from_parts(at(0.0, -0.02), turn(0.0)),
        Pose::from_parts(at(0.0, -0.02), turn(std::f64::consts::FRAC_PI_2)),
        Pose::from_parts(at(0.0, 0.0), turn(std::f64::consts::PI - 1.04)),
        Pose::from_parts(at(f64::NAN, 0.0), turn(std::f64::consts::PI)),
        Pose::from_parts(at(0.0, f64::INFINITY), turn(std::f64::consts::PI)),
        Pose::from_parts(at(0.1, 0.0), turn(std::f64::consts::PI)),
    ];
    let mut renderer = Renderer::new(probe(), needle(), gel(), 1);
    for pose in odd {
        let bytes = render(&mut renderer, &scene(pose, 0));
        assert_eq!(bytes.len(), 640 * 480);
        let pressed = Slice { indentation: Some(press(&Pose::identity(), 20e-3, 2e-3)), ..slice(pose) };
        for slice in [slice(pose), pressed] {
            let field = renderer.field(&slice);
            assert!(field.values.iter().flatten().all(|v| v.is_finite()), "{pose:?}");
        }
    }
}

#[test]
fn no_phantom_is_too_wide_for_its_lattice() {
    // The closest columns that a probe's file makes, 16 µm, and the widest phantom, 1 m.
    let probe = ProbeSpec {
        centre_frequency_hz: 25e6,
        f_number: 0.5,
        assumed_sound_speed_m_s: 1300.0,
        elements: 16,
        geometry: ImageGeometry { height_px: 40, ..probe().geometry },
        ..probe()
    };
    let tissue = Tissue::homogeneous([1.0, 1.0, 0.01], material(Some(0.0), 0.5));
    let mut renderer = Renderer::new(probe, needle(), tissue, 1);
    for (x_mm, y_mm) in [(0.0, 0.0), (490.0, 490.0), (-490.0, -490.0)] {
        let field = renderer.field(&slice(pose(x_mm, y_mm, 0.0, 0.0, 0.0, 0.0)));
        let power = field.values.iter().flatten().map(|v| v * v).sum::<f32>() / field.values.len() as f32;
        // A thousand pixels leave 3 %; the rows next to the face are darker.
        assert!((power - 1.0).abs() < 0.3, "power {power} at {x_mm} mm");
    }
}

#[test]
fn no_press_is_too_odd() {
    let turned = pose(0.1, -0.2, -2.0, 40.0, 0.0, 0.0);
    let leant = pose(0.0, 0.0, -8.0, 0.0, -40.0, 35.0);
    let good = Indentation {
        x_m: 0.0,
        y_m: 0.0,
        yaw_rad: 0.3,
        half_size_m: [20e-3, 6e-3],
        depth_m: 2e-3,
        lean: 0.0,
        thickness_m: 0.06,
    };
    // Such a press counts as none.
    let unsound = [
        Indentation { depth_m: f64::NAN, ..good },
        Indentation { depth_m: -1e-3, ..good },
        Indentation { depth_m: -1e9, ..good },
        Indentation { depth_m: 18e-3, ..good },
        Indentation { depth_m: f64::INFINITY, ..good },
        Indentation { half_size_m: [f64::INFINITY, 6e-3], ..good },
        Indentation { half_size_m: [20e-3, 0.0], ..good },
        Indentation { half_size_m: [20e-3, 1e6], ..good },
        Indentation { thickness_m: f64::INFINITY, ..good },
        Indentation { thickness_m: 0.0, ..good },
        Indentation { x_m: f64::NAN, ..good },
        Indentation { yaw_rad: f64::NEG_INFINITY, ..good },
        Indentation { lean: f64::NAN, ..good },
        Indentation { lean: 1.0, ..good },
    ];
    let mut renderer = Renderer::new(probe(), needle(), gel(), 1);
    let at_rest = render(&mut renderer, &scene(turned, 0));
    for indentation in unsound {
        let slice = Slice { indentation: Some(indentation), ..scene(turned, 0) };
        assert!(render(&mut renderer, &slice) == at_rest, "{indentation:?} is no press");
    }
    // Wide faces move tissue far along the lines and across them, deep presses fold it nearly, thin ones stop half-way.
    let odd = [
        good,
        Indentation { depth_m: 0.0, ..good },
        Indentation { lean: 0.03, ..good },
        Indentation { depth_m: -1e-3, lean: -0.1, ..good },
        Indentation { depth_m: 17e-3, ..good },
        Indentation { half_size_m: [1e-12, 1e-12], ..good },
        Indentation { half_size_m: [20e-3, 30e-3], depth_m: 15e-3, ..good },
        Indentation { half_size_m: [20e-3, 30e-3], depth_m: 15e-3, yaw_rad: 1.5, ..good },
        Indentation { half_size_m: [1.0, 1.0], depth_m: 17e-3, yaw_rad: 1.0, ..good },
        Indentation { thickness_m: 5e-3, depth_m: 4e-3, ..good },
        Indentation { thickness_m: 1e-12, depth_m: 1e-13, ..good },
        Indentation { thickness_m: 1.0, yaw_rad: 1e300, ..good },
        Indentation { x_m: 1e300, y_m: -1e300, ..good },
    ];
    for indentation in odd {
        assert!(indentation.is_sound(), "{indentation:?}");
        for pose in [turned, leant] {
            let slice = Slice { indentation: Some(indentation), ..scene(pose, 0) };
            assert_eq!(render(&mut renderer, &slice).len(), 640 * 480);
            assert!(renderer.field(&slice).values.iter().flatten().all(|v| v.is_finite()), "{indentation:?}");
        }
    }
}

#[test]
fn no_drag_is_too_odd() {
    let turned = pose(0.0, 0.0, -3.0, 20.0, 10.0, -10.0);
    let drag = |displacement_in_phantom: Vector, decay_m: f64| Drag {
        centre_in_phantom: Point::new(2e-3, 0.0, -15e-3),
        displacement_in_phantom,
        decay_m,
    };
    let mut renderer = Renderer::new(probe(), needle(), gel(), 1);
    let at_rest = render(&mut renderer, &scene(turned, 0));
    // Such a drag counts as none.
    for unsound in [
        drag(Vector::new(f64::NAN, 0.0, 0.0), 5e-3),
        drag(Vector::new(5e-3, 0.0, 0.0), 5e-3),
        drag(Vector::zeros(), 0.0),
        drag(Vector::zeros(), f64::INFINITY),
        Drag { centre_in_phantom: Point::new(0.0, f64::NAN, 0.0), ..drag(Vector::zeros(), 5e-3) },
    ] {
        assert!(!unsound.is_sound(), "{unsound:?}");
        let slice = Slice { drag: Some(unsound), ..scene(turned, 0) };
        assert!(render(&mut renderer, &slice) == at_rest, "{unsound:?} is no drag");
    }
    // Nearly folded, next to nowhere, far away, everything.
    for odd in [
        drag(Vector::new(0.0, 1e-3, -4e-3), 5e-3),
        drag(Vector::new(1e-6, 0.0, 0.0), 1e-5),
        Drag { centre_in_phantom: Point::new(0.0, 5.0, 0.0), ..drag(Vector::new(1e-3, 0.0, 0.0), 5e-3) },
        drag(Vector::new(0.05, 0.05, 0.05), 0.1),
    ] {
        assert!(odd.is_sound(), "{odd:?}");
        let slice = Slice { drag: Some(odd), ..scene(turned, 0) };
        assert_eq!(render(&mut renderer, &slice).len(), 640 * 480);
        assert!(renderer.field(&slice).values.iter().flatten().all(|v| v.is_finite()), "{odd:?}");
    }
}

#[test]
fn no_needle_is_too_odd() {
    let [rest, ..] = poses();
    let good = needle_in_probe(&rest, [2.0, 0.0, 22.0], [0.766, 0.0, 0.643], 30.0);
    let tip = good.tip_in_phantom();
    let odd = [
        NeedlePath { centreline_in_phantom: vec![], ..good.clone() },
        NeedlePath { centreline_in_phantom: vec![tip], ..good.clone() },
        NeedlePath { centreline_in_phantom: vec![tip, tip, tip], ..good.clone() },
        NeedlePath {
            centreline_in_phantom: vec![tip + Vector::new(f64::NAN, 0.0, 0.0), tip],
            ..good.clone()
        },
        NeedlePath { centreline_in_phantom: vec![tip + Vector::new(1e6, 0.0, 0.0), tip], ..good.clone() },
        NeedlePath { bevel_normal_in_phantom: good.axis_in_phantom, ..good.clone() },
        NeedlePath { bevel_normal_in_phantom: Vector::zeros(), axis_in_phantom: Vector::zeros(), ..good },
    ];
    let mut renderer = Renderer::new(probe(), needle(), water(), 1);
    for needle in odd {
        let slice = Slice { needle: Some(needle), element_gap_m: vec![], gain_db: f64::NAN, ..slice(rest) };
        assert_eq!(render(&mut renderer, &slice).len(), 640 * 480);
        assert!(renderer.field(&slice).values.iter().flatten().all(|v| v.is_finite()));
    }
}
