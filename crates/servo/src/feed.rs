//! How fast the needle goes in.

use sonoloop_types::{Point, Setup};

/// Beyond this much more than the nominal depth of the target the needle is never fed: the hidden errors of
/// a calibration are millimetres, so farther means that the picture misleads.
const DEPTH_MARGIN_M: f64 = 8e-3;
/// The target counts as reached this close before it; the feed has become slower than any tracker's noise.
const ARRIVED_M: f64 = 0.15e-3;

/// Distance along the nominal needle axis from the tip (as seen, base frame) to the target, metres.
pub fn remaining_m(setup: &Setup, tip_in_base: &Point) -> f64 {
    (setup.target_in_base - tip_in_base).dot(&setup.needle_axis_in_base)
}

/// True when the tip as seen stands at the target.
pub fn arrived(remaining_m: f64) -> bool {
    remaining_m <= ARRIVED_M
}

/// Feed for a tip that is tracked and has `remaining_m` to go: full speed, then proportional to the rest.
///
/// `travelled_since_m` is what the needle went since the picture was taken, so that a delayed picture does not
/// carry it past the target; `depth_m` the measured depth, when there is one.
pub fn feed_m_s(setup: &Setup, remaining_m: f64, travelled_since_m: f64, depth_m: Option<f64>) -> f64 {
    let servo = &setup.servo;
    let rest_m = remaining_m - travelled_since_m;
    if arrived(rest_m) {
        return 0.0;
    }
    let nominal_depth_m = (setup.target_in_base - setup.entry_in_base).dot(&setup.needle_axis_in_base);
    if depth_m.is_some_and(|depth_m| depth_m > nominal_depth_m + DEPTH_MARGIN_M) {
        return 0.0;
    }
    let full_m_s = servo.feed_m_s.min(setup.limits.max_feed_m_s);
    full_m_s * (rest_m / servo.approach_m).min(1.0)
}
