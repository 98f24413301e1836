//! The robot that holds the needle by its hub: five joints from the needle's line, and what their limits leave of it.
//!
//! Symbols: a direction of the needle, p hub's z at zero angles, w₄ and w₅ axes of the two turns, θ₄ and θ₅ their
//! angles; all in the robot's base frame.

use nalgebra::{Matrix3, Translation3, Unit, UnitQuaternion};
use sonoloop_scenario::NeedleRobotSpec;
use sonoloop_types::{Point, Pose, Vector};

use crate::WorldError;
use crate::chain::{pose_from_urdf, rotation, walk};

/// Slides, then turns.
const SLIDES: usize = 3;
/// Values of the joints, metres and radians.
type Joints = [f64; 5];

/// One joint.
#[derive(Debug, Clone)]
struct Joint {
    name: String,
    link: String,
    /// Pose of the joint's frame in the frame of the joint before, at 0; fixed joints are folded in.
    previous_from_joint: Pose,
    axis: Unit<Vector>,
    /// Metres or radians.
    lower: f64,
    upper: f64,
    max_speed: f64,
}

/// The robot with a needle on its way along one straight line: the turns stand still, the slides move evenly.
#[derive(Debug, Clone)]
pub(crate) struct NeedleRobot {
    joints: [Joint; 5],
    last_from_hub: Pose,
    /// Joints with the tip at the entry.
    at_entry: Joints,
    /// What each slide travels per metre of depth.
    per_depth: [f64; SLIDES],
}

impl NeedleRobot {
    /// Joints for a needle of `length_m` that goes in at `entry_in_base` along the unit vector `axis_in_base`. Of the two
    /// ways to point the hub the one within the limits is taken, of two within them the smaller turn.
    pub(crate) fn new(
        spec: &NeedleRobotSpec,
        length_m: f64,
        entry_in_base: Point,
        axis_in_base: Vector,
    ) -> Result<Self, WorldError> {
        let (joints, last_from_hub) = read(spec)?;
        let mut robot = Self { joints, last_from_hub, at_entry: [0.0; 5], per_depth: [0.0; SLIDES] };
        let slides = Matrix3::from_columns(&robot.slides_in_base());
        let inverse = slides
            .try_inverse()
            .ok_or_else(|| WorldError::Chain("two slides of the needle robot are parallel".to_owned()))?;
        let [yaw, pitch] = robot.turns_for(&axis_in_base)?;
        robot.at_entry[SLIDES..].copy_from_slice(&[yaw, pitch]);
        let hub_in_base = entry_in_base - axis_in_base * length_m;
        let shift = inverse * (hub_in_base.coords - robot.base_from_hub(&robot.at_entry).translation.vector);
        robot.at_entry[..SLIDES].copy_from_slice(shift.as_slice());
        robot.per_depth = (inverse * axis_in_base).into();
        Ok(robot)
    }

    /// Joints with the tip at a depth.
    pub(crate) fn joints_at(&self, depth_m: f64) -> [f64; 5] {
        let mut joints = self.at_entry;
        for (joint, per_depth) in joints.iter_mut().zip(self.per_depth) {
            *joint += depth_m * per_depth;
        }
        joints
    }

    /// Refuses a depth at which a joint would leave its limits.
    pub(crate) fn check(&self, depth_m: f64) -> Result<(), WorldError> {
        for (index, (joint, value)) in self.joints.iter().zip(self.joints_at(depth_m)).enumerate() {
            if value < joint.lower || value > joint.upper {
                let (unit, scale) = if index < SLIDES { (" mm", 1e3) } else { ("°", 1f64.to_degrees()) };
                return Err(WorldError::NeedleRobotLimit {
                    joint: joint.name.clone(),
                    depth_mm: depth_m * 1e3,
                    value: value * scale,
                    lower: joint.lower * scale,
                    upper: joint.upper * scale,
                    unit,
                });
            }
        }
        Ok(())
    }

    /// Deepest that the slides reach.
    pub(crate) fn max_depth_m(&self) -> f64 {
        let ends = self.slides().filter(|(_, _, per_depth)| *per_depth != 0.0).map(
            |(joint, at_entry, per_depth)| {
                let end = if per_depth > 0.0 { joint.upper } else { joint.lower };
                (end - at_entry) / per_depth
            },
        );
        ends.fold(f64::INFINITY, f64::min)
    }

    /// Fastest feed at which no slide is too fast.
    pub(crate) fn max_feed_m_s(&self) -> f64 {
        self.slides()
            .filter(|(_, _, per_depth)| *per_depth != 0.0)
            .map(|(joint, _, per_depth)| joint.max_speed / per_depth.abs())
            .fold(f64::INFINITY, f64::min)
    }

    /// Poses of the five moved links with the tip at a depth, base frame.
    pub(crate) fn link_poses(&self, depth_m: f64) -> [Pose; 5] {
        self.poses(&self.joints_at(depth_m))
    }

    /// Names of the five moved links.
    pub(crate) fn links(&self) -> [&str; 5] {
        self.joints.each_ref().map(|joint| joint.link.as_str())
    }

    /// From each link's origin to that of the next joint, the base first; from the last link to the hub.
    pub(crate) fn spans(&self) -> Vec<Vector> {
        let joints = self.joints.iter().map(|joint| joint.previous_from_joint.translation.vector);
        joints.chain([self.last_from_hub.translation.vector]).collect()
    }

    fn slides(&self) -> impl Iterator<Item = (&Joint, f64, f64)> {
        self.joints.iter().zip(self.at_entry).zip(self.per_depth).map(|((joint, q), rate)| (joint, q, rate))
    }

    fn poses(&self, values: &Joints) -> [Pose; 5] {
        let mut pose = Pose::identity();
        let mut poses = [pose; 5];
        for (index, (joint, value)) in self.joints.iter().zip(values).enumerate() {
            pose *= joint.previous_from_joint;
            if index < SLIDES {
                pose *= Translation3::from(joint.axis.into_inner() * *value);
            } else {
                pose.rotation *= rotation(&joint.axis, *value);
            }
            poses[index] = pose;
        }
        poses
    }

    fn base_from_hub(&self, values: &Joints) -> Pose {
        self.poses(values)[4] * self.last_from_hub
    }

    /// Directions of the slides. They move no axis, so they hold at any value.
    fn slides_in_base(&self) -> [Vector; SLIDES] {
        let poses = self.poses(&[0.0; 5]);
        std::array::from_fn(|i| poses[i].rotation * self.joints[i].axis.into_inner())
    }

    /// Angles of both turns that point the hub's z along `axis_in_base`: Paden and Kahan's second subproblem (Murray, Li,
    /// Sastry 1994, section 3.2), exp(w₄θ₄)·exp(w₅θ₅)·p = a by way of c = exp(w₅θ₅)·p.
    fn turns_for(&self, axis_in_base: &Vector) -> Result<[f64; 2], WorldError> {
        let poses = self.poses(&[0.0; 5]);
        let [w4, w5] = [3, 4].map(|i| poses[i].rotation * self.joints[i].axis.into_inner());
        let p = self.base_from_hub(&[0.0; 5]).rotation * Vector::z();
        let a = *axis_in_base;
        let cosine = w4.dot(&w5);
        let normal = w4.cross(&w5);
        if normal.norm() < 1e-6 {
            return Err(WorldError::Chain("the two turns of the needle robot are parallel".to_owned()));
        }
        let scale = cosine * cosine - 1.0;
        let alpha = (cosine * w5.dot(&p) - w4.dot(&a)) / scale;
        let beta = (cosine * w4.dot(&a) - w5.dot(&p)) / scale;
        let rest = 1.0 - alpha * alpha - beta * beta - 2.0 * alpha * beta * cosine;
        // Rounding where the cones only touch, as with a vertical needle.
        if rest < -1e-9 {
            return Err(WorldError::NeedleRobotDirection);
        }
        let gamma = rest.max(0.0).sqrt() / normal.norm();
        let both = [gamma, -gamma].map(|gamma| {
            let c = w4 * alpha + w5 * beta + normal * gamma;
            [turn_about(&w4, &c, &a), turn_about(&w5, &p, &c)]
        });
        let size = |angles: &[f64; 2]| angles[0].abs() + angles[1].abs();
        let within = |angles: &[f64; 2]| {
            let joints = self.joints[SLIDES..].iter();
            joints.zip(angles).all(|(joint, angle)| (joint.lower..=joint.upper).contains(angle))
        };
        let least = |a: &[f64; 2], b: &[f64; 2]| size(a).total_cmp(&size(b));
        let best = both.into_iter().filter(within).min_by(least);
        // Of two outside the limits the smaller turn, for `check` to name the joint.
        Ok(best.or_else(|| both.into_iter().min_by(least)).unwrap_or_default())
    }
}

/// Angle about the unit vector `axis` from one vector to another; 0 where either lies on the axis.
fn turn_about(axis: &Vector, from: &Vector, to: &Vector) -> f64 {
    let [from, to] = [from, to].map(|v| v - axis * axis.dot(v));
    if from.norm().min(to.norm()) < 1e-9 {
        return 0.0;
    }
    libm::atan2(axis.dot(&from.cross(&to)), from.dot(&to))
}

fn read(spec: &NeedleRobotSpec) -> Result<([Joint; 5], Pose), WorldError> {
    let mut joints = Vec::with_capacity(5);
    let mut folded = Pose::identity();
    for joint in walk(&spec.urdf, &spec.base_link, &spec.hub_link)? {
        folded *= pose_from_urdf(&joint.origin);
        if joint.joint_type == urdf_rs::JointType::Fixed {
            continue;
        }
        joints.push(Joint {
            name: joint.name.clone(),
            link: joint.child.link.clone(),
            previous_from_joint: folded,
            axis: Unit::new_normalize(Vector::from(joint.axis.xyz.0)),
            lower: joint.limit.lower,
            upper: joint.limit.upper,
            max_speed: joint.limit.velocity,
        });
        folded = Pose::identity();
    }
    let joints = <[Joint; 5]>::try_from(joints)
        .map_err(|found| WorldError::Chain(format!("{} moving joints, 5 are needed", found.len())))?;
    Ok((joints, folded))
}

/// How a base that stands elsewhere than thought moves what the robot holds.
///
/// With no error nothing moves, to the bit: differences are taken before they are added.
pub(crate) fn displaced(
    world_from_nominal_base: &Pose,
    nominal_from_true_base: &Pose,
    point_in_world: Point,
    axis_in_world: Vector,
) -> (Point, Vector) {
    let world_from_base = world_from_nominal_base.rotation;
    let turn =
        UnitQuaternion::from_scaled_axis(world_from_base * nominal_from_true_base.rotation.scaled_axis());
    let arm = point_in_world.coords - world_from_nominal_base.translation.vector;
    let shift = world_from_base * nominal_from_true_base.translation.vector + (turn * arm - arm);
    (point_in_world + shift, turn * axis_in_world)
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::fixture;

    fn spec() -> NeedleRobotSpec {
        fixture::boxed("kuka_kr6_r900").needle_robot
    }

    proptest! {
        /// The hub's pose from the joints, link by link, is where the needle's line wants it at every depth. Entries nearer to
        /// the phantom's middle than 5 mm are left out: the steepest needles are out of reach there.
        #[test]
        fn truth_the_hub_stays_on_the_needles_line(
            x in -0.04..-0.005f64, y in -0.04..-0.005f64, angle in 5f64..85.0, azimuth in 0f64..90.0, depth_m in 0.0..0.14f64,
        ) {
            let spec = spec();
            let (angle, azimuth) = (angle.to_radians(), azimuth.to_radians());
            let axis = Vector::new(angle.cos() * azimuth.cos(), angle.cos() * azimuth.sin(), -angle.sin());
            let entry = Point::new(x, y, 0.0);
            let base_from_world = spec.world_from_base.inverse();
            let robot = NeedleRobot::new(&spec, 0.15, base_from_world * entry, base_from_world * axis).unwrap();
            prop_assert!(robot.check(depth_m).is_ok(), "{:?}", robot.check(depth_m));
            prop_assert!(robot.max_depth_m() >= depth_m);
            let world_from_hub = spec.world_from_base * robot.base_from_hub(&robot.joints_at(depth_m));
            let tip = world_from_hub * Point::new(0.0, 0.0, 0.15);
            prop_assert!((tip - (entry + axis * depth_m)).norm() < 1e-12, "{tip}");
            prop_assert!((world_from_hub.rotation * Vector::z() - axis).norm() < 1e-12);
        }
    }

    #[test]
    fn truth_joints_of_a_needle_along_x_by_hand() {
        // Robot at the origin; 150 mm needle level along its x; wrist 60 mm behind the hub, boom end 0.3 m out, 0.4 m up.
        let robot = NeedleRobot::new(&spec(), 0.15, Point::new(0.5, 0.1, 0.3), Vector::x()).unwrap();
        for (is, by_hand) in
            robot.joints_at(0.02).into_iter().zip([0.52 - 0.15 - 0.06 - 0.3, 0.1, -0.1, 0.0, 0.0])
        {
            assert!((is - by_hand).abs() < 1e-12, "{is} {by_hand}");
        }
        assert!((robot.max_depth_m() - (0.15 - (0.5 - 0.51))).abs() < 1e-12);
        assert!((robot.max_feed_m_s() - 0.05).abs() < 1e-12, "a level needle moves one slide alone");
    }

    #[test]
    fn a_line_that_the_robot_cannot_take_names_the_joint() {
        let robot = NeedleRobot::new(&spec(), 0.15, Point::new(0.5, 0.1, 0.3), -Vector::x()).unwrap();
        let error = robot.check(0.0).unwrap_err().to_string();
        assert!(error.contains("`reach` would stand at 410.0 mm, outside -150.0 mm…150.0 mm"), "{error}");
        let robot = NeedleRobot::new(&spec(), 0.15, Point::new(0.3, 0.1, 0.6), Vector::z()).unwrap();
        let error = robot.check(0.0).unwrap_err().to_string();
        assert!(error.contains("`pitch` would stand at -90.0°, outside 0.0°…90.0°"), "{error}");
    }

    #[test]
    fn a_base_that_stands_where_it_is_thought_moves_nothing_to_the_bit() {
        let base = spec().world_from_base;
        let (point, axis) = (Point::new(-0.031, 0.017, 0.0), Vector::new(0.6, 0.0, -0.8));
        assert_eq!(displaced(&base, &Pose::identity(), point, axis), (point, axis));
        // And one that stands elsewhere as the product of poses says.
        let error = Pose::from_parts(
            Translation3::new(1e-3, -2e-3, 3e-3),
            UnitQuaternion::from_euler_angles(0.01, -0.02, 0.03),
        );
        let moved = base * error * base.inverse();
        let (there, turned) = displaced(&base, &error, point, axis);
        assert!((there - moved * point).norm() < 1e-15 && (turned - moved * axis).norm() < 1e-15);
    }
}
