//! Six revolute joints in a row: forward kinematics and Jacobian in f64, read from a URDF.

use std::cmp::Ordering;

use nalgebra::{Matrix6, Translation3, Unit, UnitQuaternion, Vector3, Vector6};
use sonoloop_scenario::ArmSpec;
use sonoloop_types::{Pose, Vector};

use crate::WorldError;

/// Angles of the six joints, radians.
pub(crate) type Joints = [f64; 6];

/// One revolute joint.
#[derive(Debug, Clone)]
pub(crate) struct Joint {
    /// Name in the URDF.
    pub name: String,
    /// Link that the joint turns.
    pub link: String,
    /// Pose of the joint's frame in the frame of the joint before, at angle 0; fixed joints are folded in.
    pub previous_from_joint: Pose,
    /// Axis in the joint's own frame.
    pub axis: Unit<Vector>,
    /// Least angle.
    pub lower_rad: f64,
    /// Largest angle.
    pub upper_rad: f64,
    /// Largest speed.
    pub max_speed_rad_s: f64,
}

/// The chain from the `base` frame to the `flange` frame.
#[derive(Debug, Clone)]
pub(crate) struct Chain {
    pub joints: [Joint; 6],
    /// Flange in the frame of the last joint.
    pub last_from_flange: Pose,
}

/// URDF's `<origin>`: translation, then fixed-axis roll, pitch, yaw.
pub(crate) fn pose_from_urdf(origin: &urdf_rs::Pose) -> Pose {
    let [x, y, z] = origin.xyz.0;
    let [roll, pitch, yaw] = origin.rpy.0;
    Pose::from_parts(Translation3::new(x, y, z), UnitQuaternion::from_euler_angles(roll, pitch, yaw))
}

/// The joints that lead from one link to another, in that order.
pub(crate) fn walk<'a>(
    urdf: &'a urdf_rs::Robot,
    base_link: &str,
    tip_link: &str,
) -> Result<Vec<&'a urdf_rs::Joint>, WorldError> {
    let mut joints = Vec::new();
    let mut link = tip_link;
    while link != base_link {
        let joint = urdf.joints.iter().find(|j| j.child.link == link).ok_or_else(|| {
            WorldError::Chain(format!("no joint leads from link `{base_link}` to link `{link}`"))
        })?;
        joints.push(joint);
        if joints.len() > urdf.joints.len() {
            return Err(WorldError::Chain(format!("the joints above link `{link}` form a ring")));
        }
        link = joint.parent.link.as_str();
    }
    joints.reverse();
    Ok(joints)
}

impl Chain {
    /// Reads the arm's chain; fixed joints are folded into the next moving one.
    pub(crate) fn from_spec(spec: &ArmSpec) -> Result<Self, WorldError> {
        let mut joints = Vec::with_capacity(6);
        let mut folded = Pose::identity();
        for joint in walk(&spec.urdf, &spec.base_link, &spec.flange_link)? {
            folded *= pose_from_urdf(&joint.origin);
            match joint.joint_type {
                urdf_rs::JointType::Fixed => {}
                urdf_rs::JointType::Revolute => {
                    joints.push(read_joint(joint, folded)?);
                    folded = Pose::identity();
                }
                ref other => {
                    return Err(WorldError::Chain(format!(
                        "joint `{}` is {other:?}; only revolute joints move this arm",
                        joint.name
                    )));
                }
            }
        }
        let names: Vec<&str> = joints.iter().map(|j| j.name.as_str()).collect();
        if names != spec.joint_names {
            return Err(WorldError::Chain(format!(
                "the moving joints from base to flange are [{}], not [{}]",
                names.join(", "),
                spec.joint_names.join(", ")
            )));
        }
        let joints = <[Joint; 6]>::try_from(joints)
            .map_err(|found| WorldError::Chain(format!("{} moving joints, 6 are needed", found.len())))?;
        Ok(Self { joints, last_from_flange: folded })
    }

    /// Poses of the six moved links, then of the flange, in the base frame.
    pub(crate) fn link_poses(&self, angles_rad: &Joints) -> [Pose; 7] {
        let mut poses = [Pose::identity(); 7];
        let mut base_from_link = Pose::identity();
        for (i, (joint, &angle)) in self.joints.iter().zip(angles_rad).enumerate() {
            base_from_link *= joint.previous_from_joint;
            base_from_link.rotation *= rotation(&joint.axis, angle);
            poses[i] = base_from_link;
        }
        poses[6] = base_from_link * self.last_from_flange;
        poses
    }

    /// From each link's origin to that of the next joint, the base first; from the last link to the flange.
    pub(crate) fn spans(&self) -> Vec<Vector> {
        let joints = self.joints.iter().map(|joint| joint.previous_from_joint.translation.vector);
        joints.chain([self.last_from_flange.translation.vector]).collect()
    }

    /// Pose of the flange in the base frame.
    pub(crate) fn base_from_flange(&self, angles_rad: &Joints) -> Pose {
        self.link_poses(angles_rad)[6]
    }

    /// Flange pose and geometric Jacobian: rows are linear then angular velocity of the flange, base frame.
    pub(crate) fn jacobian(&self, angles_rad: &Joints) -> (Pose, Matrix6<f64>) {
        let poses = self.link_poses(angles_rad);
        let flange_in_base = poses[6].translation.vector;
        let mut jacobian = Matrix6::zeros();
        for (i, joint) in self.joints.iter().enumerate() {
            // The axis does not move under its own turn, so the turned frame gives it as well.
            let axis_in_base = poses[i].rotation * joint.axis.into_inner();
            let linear = axis_in_base.cross(&(flange_in_base - poses[i].translation.vector));
            jacobian.set_column(
                i,
                &Vector6::new(linear.x, linear.y, linear.z, axis_in_base.x, axis_in_base.y, axis_in_base.z),
            );
        }
        (poses[6], jacobian)
    }

    /// Smallest distance of any joint to its nearer limit; negative outside.
    pub(crate) fn margin_rad(&self, angles_rad: &Joints) -> f64 {
        self.joints
            .iter()
            .zip(angles_rad)
            .map(|(joint, &q)| (q - joint.lower_rad).min(joint.upper_rad - q))
            .fold(f64::INFINITY, f64::min)
    }
}

/// Turn about an axis, with `libm` so that every CPU gives the same bits.
pub(crate) fn rotation(axis: &Unit<Vector>, angle_rad: f64) -> UnitQuaternion<f64> {
    let (sine, cosine) = libm::sincos(angle_rad / 2.0);
    let vector = axis.into_inner() * sine;
    UnitQuaternion::new_unchecked(nalgebra::Quaternion::new(cosine, vector.x, vector.y, vector.z))
}

fn read_joint(joint: &urdf_rs::Joint, previous_from_joint: Pose) -> Result<Joint, WorldError> {
    let [x, y, z] = joint.axis.xyz.0;
    let axis = Unit::try_new(Vector3::new(x, y, z), 1e-9)
        .ok_or_else(|| WorldError::Chain(format!("joint `{}` has an axis of no length", joint.name)))?;
    let (lower_rad, upper_rad) = (joint.limit.lower, joint.limit.upper);
    if lower_rad.partial_cmp(&upper_rad) != Some(Ordering::Less) {
        return Err(WorldError::Chain(format!(
            "joint `{}`: lower limit {lower_rad} must be below upper limit {upper_rad}",
            joint.name
        )));
    }
    if joint.limit.velocity.partial_cmp(&0.0) != Some(Ordering::Greater) {
        return Err(WorldError::Chain(format!(
            "joint `{}`: velocity limit {} must be above 0",
            joint.name, joint.limit.velocity
        )));
    }
    Ok(Joint {
        name: joint.name.clone(),
        link: joint.child.link.clone(),
        previous_from_joint,
        axis,
        lower_rad,
        upper_rad,
        max_speed_rad_s: joint.limit.velocity,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fixture;

    #[test]
    fn truth_home_of_the_kuka_is_the_sum_of_its_links() {
        // All joints at 0: the arm is stretched along x at the height of joints 2 and 3.
        let chain = Chain::from_spec(&fixture::kuka()).unwrap();
        let flange = chain.base_from_flange(&[0.0; 6]).translation.vector;
        assert!((flange - Vector3::new(0.025 + 0.455 + 0.420 + 0.080, 0.0, 0.400 + 0.035)).norm() < 1e-12);
    }

    #[test]
    fn truth_jacobian_matches_finite_differences() {
        let chain = Chain::from_spec(&fixture::kuka()).unwrap();
        let q = [0.3, -1.2, 1.4, 0.5, -0.8, 2.0];
        let (_, jacobian) = chain.jacobian(&q);
        let h = 1e-6;
        for i in 0..6 {
            let (mut plus, mut minus) = (q, q);
            plus[i] += h;
            minus[i] -= h;
            let (a, b) = (chain.base_from_flange(&plus), chain.base_from_flange(&minus));
            let linear = (a.translation.vector - b.translation.vector) / (2.0 * h);
            let angular = (a.rotation * b.rotation.inverse()).scaled_axis() / (2.0 * h);
            let column = jacobian.column(i);
            // Central differences: error of order h² plus rounding ε/h ≈ 2e-10.
            assert!((linear - column.fixed_rows::<3>(0)).norm() < 1e-8, "joint {i}");
            assert!((angular - column.fixed_rows::<3>(3)).norm() < 1e-8, "joint {i}");
        }
    }

    #[test]
    fn a_chain_that_is_not_there_is_named() {
        let mut spec = fixture::kuka();
        spec.flange_link = "nowhere".into();
        let error = Chain::from_spec(&spec).unwrap_err().to_string();
        assert!(error.contains("nowhere"), "{error}");
    }
}
