//! How tip and picture lie to one another.

use sonoloop_scenario::Scenario;
use sonoloop_types::{Point, Pose, ProbeSpec, View};

use crate::contact::{Contact, element_x_m};
use crate::needle_path::Path;
use crate::timeline::Timeline;

/// Tip and picture at one instant.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Sight {
    /// In the frame of the path, which is the phantom's unless the needle sways.
    pub tip_on_path: Point,
    pub tip_in_probe: Point,
    /// Where a tracker should point.
    pub reference_px: [f64; 2],
    /// Signed distance of the tip from the plane; transverse along the needle, positive once it is through.
    pub plane_to_tip_m: f64,
}

/// Projects the tip, or in a transverse view finds where the needle's axis meets the plane. A needle that
/// lies in the plane of a transverse view has no such point: its tip stands in.
pub(crate) fn sight(scenario: &Scenario, path: &Path, probe_from_path: &Pose, depth_m: f64) -> Sight {
    let tip_on_path = Point::from(path.pose_at(depth_m).translation.vector);
    let tip_in_probe = probe_from_path * tip_on_path;
    let geometry = &scenario.probe.geometry;
    let projected = (geometry.px_from_probe(&tip_in_probe), tip_in_probe.y);
    let (reference_px, plane_to_tip_m) = match scenario.view {
        View::Lateral => projected,
        View::Transverse => path.crossing_m(probe_from_path, depth_m).map_or(projected, |crossing_m| {
            let crossing = path.along_from(depth_m, crossing_m);
            (geometry.px_from_probe(&(probe_from_path * crossing)), depth_m - crossing_m)
        }),
    };
    Sight { tip_on_path, tip_in_probe, reference_px, plane_to_tip_m }
}

/// Visible: the tip within half the −6 dB slice thickness of the plane, inside the picture and under the array, and as much
/// of the aperture that images it in contact as leaves −6 dB of its echo: sent and heard by a share s, s² of its amplitude.
/// An element in a shadow counts by the amplitude that it lets through one way. A picture that stands shows nothing.
pub(crate) fn visible(
    probe: &ProbeSpec,
    contact: &Contact,
    timeline: &Timeline,
    phantom_from_probe: &Pose,
    tip_in_probe: &Point,
) -> bool {
    let half_slice_m = probe.slice_thickness_m(tip_in_probe.z) / 2.0;
    let in_slice = tip_in_probe.y.abs() <= half_slice_m;
    let in_picture = probe.geometry.contains(probe.geometry.px_from_probe(tip_in_probe), 0.0);
    let under_array = tip_in_probe.x.abs() <= probe.aperture_m() / 2.0;
    if !(in_slice && in_picture && under_array) || timeline.images_frozen() {
        return false;
    }
    // The aperture grows with depth; near the face the element above the tip remains.
    let reach_m = (0.5 * tip_in_probe.z / probe.f_number).max(probe.pitch_m / 2.0);
    let (mut active, mut through) = (0.0, 0.0);
    for x_m in (0..probe.elements).map(|element| element_x_m(probe, element)) {
        if (x_m - tip_in_probe.x).abs() <= reach_m {
            active += 1.0;
            let touches = contact.gap_m(phantom_from_probe, x_m) == 0.0;
            through += if touches { timeline.through(x_m) } else { 0.0 };
        }
    }
    // s² ≥ ½.
    2.0 * through * through >= active * active
}

#[cfg(test)]
mod tests {
    use nalgebra::UnitQuaternion;
    use sonoloop_types::Vector;

    use super::*;
    use crate::fixture;

    #[test]
    fn truth_a_tip_stays_visible_until_the_lost_aperture_takes_half_its_echo() {
        let (mut probe, phantom) = (fixture::probe(), fixture::phantom());
        probe.f_number = 2.0;
        let contact = Contact::new(&probe, &phantom);
        let timeline = Timeline::new(&fixture::scenario().delays);
        let tip = Point::new(0.0, 0.0, 20e-3);
        // 5 mm of aperture to either side; 0.707 of it touches while contact begins left of 5 − 7.07 mm.
        let edge_m = 5e-3 - 10e-3 * std::f64::consts::FRAC_1_SQRT_2;
        for (begins_m, expected) in [(edge_m - 0.4e-3, true), (edge_m + 0.4e-3, false)] {
            let lean_rad = -0.05;
            let rotation = UnitQuaternion::from_axis_angle(&Vector::x_axis(), std::f64::consts::PI)
                * UnitQuaternion::from_axis_angle(&Vector::y_axis(), lean_rad);
            // The face meets the surface at x = begins_m; right of it it is pressed in.
            let along = rotation * Vector::x();
            let centre = -along * begins_m;
            let pose = Pose::from_parts(Vector::new(0.0, 0.0, centre.z).into(), rotation);
            assert!(along.z < 0.0, "the right end is pressed in");
            assert_eq!(visible(&probe, &contact, &timeline, &pose, &tip), expected, "{begins_m}");
        }
    }
}
