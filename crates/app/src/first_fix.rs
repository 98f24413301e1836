//! The first tip without an operator: the end of a needle that is found in the picture.

use sonoloop_tracker::baseline::{Entry, Insertion, Localizer};
use sonoloop_tracker::{Tracker, snap_to_peak};
use sonoloop_types::{Image, TrackerSettings};

/// How far from where a needle is found to end the echo of its tip may be.
const SNAP_PX: f64 = 5.0;
/// How far the needle's direction in the picture may lie from the nominal one: five times the 1° σ of a calibration, and as
/// much for how the operator holds the probe.
const ANGLE_TOLERANCE_RAD: f64 = 10.0 * std::f64::consts::PI / 180.0;

/// A tracker of the needle in `image`; `None` where none is found, or no template fits around its tip.
pub fn first_fix(localizer: &mut Localizer, settings: TrackerSettings, image: &Image) -> Option<Tracker> {
    let needle = localizer.localize(image)?;
    Tracker::new(settings, image, snap_to_peak(image, needle.tip_px, SNAP_PX)).ok()
}

/// How a needle comes into the picture that nominally points along `axis_px` (u, v), of unit length; any needle from above
/// where there is no such direction.
pub fn insertion_along(axis_px: Option<[f64; 2]>) -> Insertion {
    let Some([u, v]) = axis_px else { return Insertion::default() };
    let right_angle = std::f64::consts::FRAC_PI_2;
    // A line has no sign: its angle lies within ±90°.
    let angle = if u == 0.0 { right_angle } else { libm::atan(v / u) };
    let entry = match libm::fabs(u) {
        across if across < libm::sin(ANGLE_TOLERANCE_RAD) => Entry::Shallower,
        _ if u > 0.0 => Entry::Left,
        _ => Entry::Right,
    };
    let angle_rad = [angle - ANGLE_TOLERANCE_RAD, angle + ANGLE_TOLERANCE_RAD];
    Insertion { entry, angle_rad: angle_rad.map(|angle| angle.clamp(-right_angle, right_angle)) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn truth_the_needle_is_sought_along_its_nominal_direction() {
        let along = |deg: f64| {
            let Insertion { entry, angle_rad } =
                insertion_along(Some([deg.to_radians().cos(), deg.to_radians().sin()]));
            (entry, angle_rad.map(|angle| angle.to_degrees().round()))
        };
        assert_eq!(along(40.0), (Entry::Left, [30.0, 50.0]));
        assert_eq!(along(140.0), (Entry::Right, [-50.0, -30.0]));
        assert_eq!(along(-20.0), (Entry::Left, [-30.0, -10.0]));
        assert_eq!(along(88.0), (Entry::Shallower, [78.0, 90.0]));
        assert_eq!(insertion_along(None), Insertion::default());
    }
}
