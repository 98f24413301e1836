//! How tip and picture lie to one another.

use sonoloop_scenario::Scenario;
use sonoloop_types::{Point, Pose, ProbeSpec, View};

use crate::contact::{Contact, element_x_m};
use crate::needle_path::Path;

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

/// Visible: the tip within half the −6 dB slice thickness of the plane, inside the picture and under the
/// array, and every element within half a beam's width of it in contact.
pub(crate) fn visible(
    probe: &ProbeSpec,
    contact: &Contact,
    phantom_from_probe: &Pose,
    tip_in_probe: &Point,
) -> bool {
    let half_slice_m = probe.slice_thickness_m(tip_in_probe.z) / 2.0;
    let in_slice = tip_in_probe.y.abs() <= half_slice_m;
    let in_picture = probe.geometry.contains(probe.geometry.px_from_probe(tip_in_probe), 0.0);
    let under_array = tip_in_probe.x.abs() <= probe.aperture_m() / 2.0;
    if !(in_slice && in_picture && under_array) {
        return false;
    }
    let reach_m = (probe.lateral_width_m() / 2.0).max(probe.pitch_m / 2.0);
    (0..probe.elements)
        .map(|element| element_x_m(probe, element))
        .filter(|x| (x - tip_in_probe.x).abs() <= reach_m)
        .all(|x| contact.gap_m(phantom_from_probe, x) == 0.0)
}
