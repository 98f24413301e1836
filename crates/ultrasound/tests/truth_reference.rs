//! The fast field against direct summation of the same scatterers in double precision.

mod common;

use common::{material, needle, pose, probe, slice};
use sonoloop_types::{ColumnSegment, Pose, Slice, Tissue};
use sonoloop_ultrasound::{Renderer, reference};

/// RMS of the difference over the RMS of the reference.
fn relative_error(tissue: &Tissue, slice: &Slice) -> f64 {
    let mut renderer = Renderer::new(probe(), needle(), tissue.clone(), 5);
    let fast = renderer.field(slice);
    let exact = reference::field(&probe(), &needle(), tissue, 5, slice);
    assert_eq!(fast.values.len(), exact.len());
    let (mut difference, mut power) = (0.0f64, 0.0f64);
    for (&[re, im], &[exact_re, exact_im]) in fast.values.iter().zip(&exact) {
        difference += (f64::from(re) - exact_re).powi(2) + (f64::from(im) - exact_im).powi(2);
        power += exact_re * exact_re + exact_im * exact_im;
    }
    assert!(power > 0.2 * exact.len() as f64, "the reference is empty");
    (difference / power).sqrt()
}

/// Gel under the right half of the picture only: the sum takes seconds, and this part holds both the middle,
/// where the aperture is whole, and an end of the array.
fn half_gel() -> Tissue {
    Tissue::new([0.06, 0.06, 0.06], vec![material(Some(0.0), 0.5)], |x, y, out| {
        if (-0.002..0.025).contains(&x) && y.abs() < 0.03 {
            out.push(ColumnSegment { top_z_m: 0.0, bottom_z_m: -0.06, material: 0 });
        }
    })
}

fn check(phantom_from_probe: Pose) {
    let error = relative_error(&half_gel(), &slice(phantom_from_probe));
    println!("{:.2} % at {:?}", error * 100.0, phantom_from_probe.translation.vector);
    assert!(error <= 0.05, "error {error:.4} over 5 %");
}

#[test]
fn truth_at_rest_and_moved_by_parts_of_a_pixel() {
    check(pose(0.0, 0.0, 0.0, 0.0, 0.0, 0.0));
    check(pose(1.234, -2.345, -0.5567, 0.0, 0.0, 0.0));
}

#[test]
fn truth_under_yaw() {
    check(pose(0.31, 0.12, -0.2, 33.0, 0.0, 0.0));
}

#[test]
fn truth_under_tilt_of_15_degrees_either_way() {
    check(pose(0.0, 0.0, -6.0, 0.0, 15.0, 0.0));
    check(pose(0.0, 0.0, -6.0, 0.0, 0.0, -15.0));
}

#[test]
fn truth_under_tilt_of_30_degrees_both_ways() {
    check(pose(0.0, 0.0, -12.0, 20.0, -30.0, 30.0));
}
