//! Units of the files → SI. Division by a power of ten rounds once, so 2 mm is the same number as 0.002.

use nalgebra::{Translation3, UnitQuaternion};
use sonoloop_types::{Pose, TICKS_PER_SECOND};

use crate::raw::RawPose;

pub(super) fn m(mm: f64) -> f64 {
    mm / 1000.0
}

pub(super) fn m3(mm: [f64; 3]) -> [f64; 3] {
    mm.map(m)
}

pub(super) fn rad(deg: f64) -> f64 {
    deg.to_radians()
}

/// Whole ticks nearest to a time; times are bounded, so the cast is exact.
pub(super) fn ticks(seconds: f64) -> u64 {
    libm::round(seconds * TICKS_PER_SECOND as f64) as u64
}

/// Ticks of one millisecond.
pub(super) fn ticks_of_ms(ms: u64) -> u64 {
    ms * TICKS_PER_SECOND / 1000
}

/// Roll, pitch, yaw about fixed axes, as in URDF: Rz·Ry·Rx.
pub(super) fn pose(xyz_mm: [f64; 3], rpy_deg: [f64; 3]) -> Pose {
    let [roll, pitch, yaw] = rpy_deg.map(rad);
    let [x, y, z] = m3(xyz_mm);
    Pose::from_parts(Translation3::new(x, y, z), UnitQuaternion::from_euler_angles(roll, pitch, yaw))
}

pub(super) fn raw_pose(raw: &RawPose) -> Pose {
    pose(raw.xyz_mm, raw.rpy_deg)
}
