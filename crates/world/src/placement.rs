//! How the operator places the probe, and which poses following the needle will ask of the arm.

use nalgebra::{Matrix3, Rotation3, UnitQuaternion};
use sonoloop_scenario::Scenario;
use sonoloop_types::{Point, Pose, Vector, View};

use crate::WorldError;
use crate::arm::ArmModel;
use crate::chain::Joints;
use crate::contact::Contact;
use crate::hidden::Hidden;
use crate::needle_path::Path;

/// Distance between the depths at which the follow path is checked.
const CHECK_EVERY_M: f64 = 2e-3;

/// The true pose of the probe at tick 0.
///
/// z down; in a lateral view x, in a transverse view y along the needle's horizontal direction at the tip;
/// then the placement's yaw and tilt. The plane holds the true tip (and in a lateral view the needle's
/// axis) up to the operator's misalignment, and the face is pressed with the set force.
pub(crate) fn world_from_probe_at_start(
    scenario: &Scenario,
    path: &Path,
    hidden: &Hidden,
    contact: &Contact,
) -> Pose {
    let placement = &scenario.placement;
    let needle = path.pose_at(scenario.insertion.start_depth_m);
    let axis = needle.rotation * Vector::z();
    let horizontal = Vector::new(axis.x, axis.y, 0.0);
    // A vertical needle has no horizontal direction; the world's x stands in.
    let along = if horizontal.norm() > 1e-6 { horizontal.normalize() } else { Vector::x() };
    let down = -Vector::z();
    let columns = match scenario.view {
        View::Lateral => [along, down.cross(&along), down],
        View::Transverse => [along.cross(&down), along, down],
    };
    let level = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(
        Matrix3::from_columns(&columns),
    ));
    let yaw_rad = placement.yaw_rad + hidden.alignment_rad;
    let rotation = level
        * UnitQuaternion::from_axis_angle(&Vector::z_axis(), yaw_rad)
        * UnitQuaternion::from_axis_angle(&Vector::x_axis(), placement.tilt_rad);

    // Tip in the probe frame is (lateral, misalignment, depth); the depth follows from the press.
    let into = rotation * Vector::z();
    let indentation_m = contact.rest_indentation_m(placement.contact_force_n);
    let in_plane = rotation * Vector::new(placement.tip_lateral_m, hidden.alignment_m, 0.0);
    let level_with_tip = needle.translation.vector - in_plane;
    let face_z = indentation_m * into.z;
    let depth_m = (level_with_tip.z - face_z) / into.z;
    Pose::from_parts((level_with_tip - into * depth_m).into(), rotation)
}

/// Joint angles at the start.
pub(crate) fn angles_at_start(
    model: &ArmModel,
    world_from_probe: &Pose,
    flange_from_true_probe: &Pose,
) -> Result<Joints, WorldError> {
    let base_from_flange =
        model.spec.world_from_base.inverse() * world_from_probe * flange_from_true_probe.inverse();
    model.ik.solve(&base_from_flange, &model.spec.home_rad).map_err(WorldError::StartUnreachable)
}

/// Checks that the tip stays in the phantom and that the arm can follow it down to the target.
pub(crate) fn check_follow_path(
    scenario: &Scenario,
    model: &ArmModel,
    path: &Path,
    world_from_probe: &Pose,
    flange_from_true_probe: &Pose,
    angles_at_start: &Joints,
) -> Result<(), WorldError> {
    let insertion = &scenario.insertion;
    let [size_x, size_y, size_z] = scenario.phantom.size_m;
    let tip_at = |depth_m: f64| Point::from(path.pose_at(depth_m).translation.vector);
    let start = tip_at(insertion.start_depth_m);
    // Lateral: the probe slides along its array; transverse: along its elevation. Both level.
    let slide = world_from_probe.rotation
        * match scenario.view {
            View::Lateral => Vector::x(),
            View::Transverse => Vector::y(),
        };
    let slide = Vector::new(slide.x, slide.y, 0.0).normalize();
    let length_m = (insertion.target_depth_m - insertion.start_depth_m).max(0.0);
    let steps = (length_m / CHECK_EVERY_M).ceil().max(1.0) as usize;
    let mut angles = *angles_at_start;
    for step in 1..=steps {
        let depth_m = insertion.start_depth_m + length_m * step as f64 / steps as f64;
        let tip = tip_at(depth_m);
        if tip.x.abs() > size_x / 2.0 || tip.y.abs() > size_y / 2.0 || tip.z < -size_z {
            return Err(WorldError::TargetOutsidePhantom { depth_mm: depth_m * 1e3 });
        }
        let mut pose = *world_from_probe;
        pose.translation.vector += slide * slide.dot(&(tip - start));
        let base_from_flange = model.spec.world_from_base.inverse() * pose * flange_from_true_probe.inverse();
        angles = model
            .ik
            .solve(&base_from_flange, &angles)
            .map_err(|why| WorldError::TargetUnreachable { depth_mm: depth_m * 1e3, why })?;
    }
    Ok(())
}
