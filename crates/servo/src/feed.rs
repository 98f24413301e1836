//! How fast the needle goes in.

use sonoloop_types::{Acquisition, Point, ServoSettings, Setup};

/// Distance along the nominal needle axis from the tip (as seen, base frame) to the target, metres.
pub fn remaining_m(setup: &Setup, tip_in_base: &Point) -> f64 {
    (setup.target_in_base - tip_in_base).dot(&setup.needle_axis_in_base)
}

/// How long before its publication a picture was taken, seconds.
pub fn age_s(setup: &Setup, acquisition: &Acquisition) -> f64 {
    acquisition.publication_tick.saturating_sub(acquisition.acquisition_tick) as f64
        / f64::from(setup.tick_rate_hz)
}

/// What the needle went since a picture was taken, metres; nothing in a hand, whose feed is not measured.
pub fn travelled_since_m(setup: &Setup, acquisition: &Acquisition) -> f64 {
    acquisition.feed_m_s.unwrap_or(0.0) * age_s(setup, acquisition)
}

/// True when the tip as seen stands at the target.
pub fn arrived(settings: &ServoSettings, remaining_m: f64) -> bool {
    remaining_m <= settings.arrived_m
}

/// Feed for a tip that is tracked and has `remaining_m` to go: full speed, then proportional to the rest.
///
/// `travelled_since_m` is what the needle went since the picture was taken, so that a delayed picture does not
/// carry it past the target; `depth_m` the measured depth, when there is one.
pub fn feed_m_s(setup: &Setup, remaining_m: f64, travelled_since_m: f64, depth_m: Option<f64>) -> f64 {
    let servo = &setup.servo;
    let rest_m = remaining_m - travelled_since_m;
    if arrived(servo, rest_m) {
        return 0.0;
    }
    let nominal_depth_m = (setup.target_in_base - setup.entry_in_base).dot(&setup.needle_axis_in_base);
    if depth_m.is_some_and(|depth_m| depth_m > nominal_depth_m + servo.depth_margin_m) {
        return 0.0;
    }
    let full_m_s = servo.feed_m_s.min(setup.limits.max_feed_m_s);
    // Without an approach the ratio is infinite.
    full_m_s * (rest_m / servo.approach_m).min(1.0)
}
