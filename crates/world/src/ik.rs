//! Inverse kinematics: analytic proposals where the arm's family allows them, damped least squares
//! otherwise. Both end in the same Newton steps on the URDF's own chain.
//!
//! rs-opw-kinematics calls the platform's sine and arc tangent, whose last bit may depend on the CPU. Its
//! angles are therefore rounded to 1 µrad and only propose a branch; Newton steps on [`Chain`] make them
//! exact, and the result is rounded to 0.1 nrad, so that even a proposal on the other side of a rounding
//! boundary leads to the same bits.

use std::f64::consts::TAU;
use std::fmt;

use nalgebra::{Matrix6, Vector6};
use rs_opw_kinematics::glam::{DQuat, DVec3};
use rs_opw_kinematics::kinematic_traits::{Kinematics, Pose as OpwPose};
use rs_opw_kinematics::kinematics_impl::OPWKinematics;
use rs_opw_kinematics::parameters::opw_kinematics::Parameters;
use sonoloop_scenario::{ArmSpec, OpwSpec};
use sonoloop_types::Pose;

use crate::WorldError;
use crate::chain::{Chain, Joints};

/// A solution is exact when position (m) and rotation (rad) are within this of the target.
const EXACT: f64 = 1e-9;
/// Steps per radian to which a proposal and a result are rounded.
const PROPOSAL_GRID: f64 = (1u64 << 20) as f64;
const RESULT_GRID: f64 = (1u64 << 33) as f64;
/// Steps of damped least squares per start; two dozen are the rule.
const MAX_STEPS: usize = 200;
/// Largest change of one joint in one damped step, radians.
const MAX_STEP_RAD: f64 = 0.3;
/// A solution no farther than this from the present angles (root of the sum of squares) needs no rival. Branches are
/// nearer to one another only beside a singularity.
const SAME_BRANCH_RAD: f64 = 0.5;

/// Why no joint angles reach a pose.
#[derive(Debug, Clone, PartialEq)]
pub enum Unreachable {
    /// No angles at all do.
    OutOfReach {
        /// Distance from the base's origin, metres.
        distance_m: f64,
    },
    /// Angles exist, but one joint would leave its limits.
    JointLimit {
        /// Name of the joint.
        joint: String,
        /// Angle it would need.
        angle_rad: f64,
        /// Least angle.
        lower_rad: f64,
        /// Largest angle.
        upper_rad: f64,
    },
}

impl fmt::Display for Unreachable {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::OutOfReach { distance_m } => {
                write!(f, "out of reach, {:.0} mm from the base", distance_m * 1e3)
            }
            Self::JointLimit { joint, angle_rad, lower_rad, upper_rad } => write!(
                f,
                "joint {joint} would stand at {:.1}°, outside {:.1}°…{:.1}°",
                angle_rad.to_degrees(),
                lower_rad.to_degrees(),
                upper_rad.to_degrees()
            ),
        }
    }
}

/// Solver for one arm.
#[derive(Debug, Clone)]
pub(crate) struct Ik {
    chain: Chain,
    opw: Option<Opw>,
}

#[derive(Debug, Clone)]
struct Opw {
    kinematics: OPWKinematics,
    /// Turns the URDF's flange into the analytic family's, which looks along its own z.
    flange_from_opw: Pose,
}

impl Ik {
    /// Takes the analytic solver when the spec has its parameters, and checks them against the chain.
    pub(crate) fn new(chain: Chain, spec: &ArmSpec) -> Result<Self, WorldError> {
        let opw = spec.opw.as_ref().map(|opw| Opw::new(&chain, opw)).transpose()?;
        Ok(Self { chain, opw })
    }

    /// Angles within the limits that put the flange at `base_from_flange`, nearest to `near`.
    pub(crate) fn solve(&self, base_from_flange: &Pose, near: &Joints) -> Result<Joints, Unreachable> {
        match &self.opw {
            Some(opw) => self.solve_analytic(opw, base_from_flange, near),
            None => self.solve_numeric(base_from_flange, near),
        }
    }

    fn solve_analytic(&self, opw: &Opw, target: &Pose, near: &Joints) -> Result<Joints, Unreachable> {
        let proposals = opw.propose(target, near);
        let mut best: Option<(f64, Joints)> = None;
        for proposal in &proposals {
            let Some(angles) = self.wrap_into_limits(proposal, near) else { continue };
            let away_rad = distance_rad(&angles, near);
            if best.is_none_or(|(least, _)| away_rad < least) {
                best = Some((away_rad, angles));
            }
        }
        if let Some((_, angles)) = best {
            let angles = self.polish(target, angles);
            if self.is_solution(target, &angles) {
                return Ok(angles);
            }
        }
        // A wrist too straight for the analytic branch may still be reached step by step.
        if let Ok(angles) = self.solve_numeric_from(target, near, true) {
            return Ok(angles);
        }
        Err(self.explain(target, proposals.first()))
    }

    fn solve_numeric(&self, target: &Pose, near: &Joints) -> Result<Joints, Unreachable> {
        // From where the arm stands first: what is found close by is the present branch. Else further starts,
        // spread over the first three joints, which decide the branch, and of all that is found the nearest.
        // Fixed, so that the answer depends on nothing but the question.
        const SPREAD_RAD: [[f64; 3]; 9] = [
            [0.0, 0.0, 0.0],
            [0.5, 0.0, 0.0],
            [-0.5, 0.0, 0.0],
            [0.0, 0.4, -0.4],
            [0.0, -0.4, 0.4],
            [1.2, 0.2, 0.2],
            [-1.2, 0.2, 0.2],
            [0.0, 0.8, -1.0],
            [0.0, -0.8, 1.0],
        ];
        let mut free = None;
        let mut best: Option<(f64, Joints)> = None;
        for (attempt, spread) in SPREAD_RAD.into_iter().enumerate() {
            let mut start = *near;
            for (angle, offset) in start.iter_mut().zip(spread) {
                *angle += offset;
            }
            self.clamp(&mut start);
            // Where a limit is in the way, a solution without limits may be a turn of a joint away from one within.
            let found = self.solve_numeric_from(target, &start, true).or_else(|()| {
                let angles = self.solve_numeric_from(target, &start, false)?;
                free.get_or_insert(angles);
                Ok::<_, ()>(angles)
            });
            let Some(angles) = found.ok().and_then(|angles| self.wrap_into_limits(&angles, near)) else {
                continue;
            };
            let away_rad = distance_rad(&angles, near);
            if attempt == 0 && away_rad <= SAME_BRANCH_RAD {
                return Ok(angles);
            }
            if best.is_none_or(|(least, _)| away_rad < least) {
                best = Some((away_rad, angles));
            }
        }
        best.map(|(_, angles)| angles).ok_or_else(|| self.explain(target, free.as_ref()))
    }

    /// Levenberg–Marquardt on the six components of the pose error.
    fn solve_numeric_from(&self, target: &Pose, start: &Joints, within_limits: bool) -> Result<Joints, ()> {
        let mut angles = *start;
        let (pose, mut jacobian) = self.chain.jacobian(&angles);
        let mut error = pose_error(target, &pose);
        let mut damping = 1e-3;
        for _ in 0..MAX_STEPS {
            if error.norm() < EXACT * 1e-2 {
                break;
            }
            let normal = jacobian.transpose() * jacobian + Matrix6::identity() * damping;
            let Some(cholesky) = normal.cholesky() else { return Err(()) };
            let mut step = cholesky.solve(&(jacobian.transpose() * error));
            let largest = step.amax();
            if largest > MAX_STEP_RAD {
                step *= MAX_STEP_RAD / largest;
            }
            let mut next = angles;
            for (angle, change) in next.iter_mut().zip(step.iter()) {
                *angle += change;
            }
            if within_limits {
                self.clamp(&mut next);
            }
            let (next_pose, next_jacobian) = self.chain.jacobian(&next);
            let next_error = pose_error(target, &next_pose);
            if next_error.norm() < error.norm() {
                (angles, jacobian, error) = (next, next_jacobian, next_error);
                damping = (damping * 0.2).max(1e-12);
            } else {
                damping *= 8.0;
                if damping > 1e6 {
                    break;
                }
            }
        }
        let reached = error.norm() < EXACT;
        (reached && (!within_limits || self.chain.margin_rad(&angles) >= 0.0)).then_some(angles).ok_or(())
    }

    /// Newton steps from a start that is already right to a microradian: 10⁻⁶, 10⁻¹², rounding.
    fn polish(&self, target: &Pose, mut angles: Joints) -> Joints {
        for _ in 0..4 {
            let (pose, jacobian) = self.chain.jacobian(&angles);
            let error = pose_error(target, &pose);
            if error.norm() < 1e-14 {
                break;
            }
            // A trace of damping keeps a straight wrist solvable.
            let normal = jacobian.transpose() * jacobian + Matrix6::identity() * 1e-14;
            let Some(cholesky) = normal.cholesky() else { break };
            let step = cholesky.solve(&(jacobian.transpose() * error));
            if step.amax() > 1e-2 {
                break;
            }
            for (angle, change) in angles.iter_mut().zip(step.iter()) {
                *angle += change;
            }
        }
        angles.map(|angle| round_to(angle, RESULT_GRID))
    }

    fn is_solution(&self, target: &Pose, angles: &Joints) -> bool {
        pose_error(target, &self.chain.base_from_flange(angles)).norm() < EXACT
            && self.chain.margin_rad(angles) >= 0.0
    }

    /// The turn of every joint that lies within its limits and nearest to `near`; `None` when one has none.
    fn wrap_into_limits(&self, angles: &Joints, near: &Joints) -> Option<Joints> {
        let mut wrapped = *angles;
        for ((angle, joint), &near) in wrapped.iter_mut().zip(&self.chain.joints).zip(near) {
            let base = *angle + TAU * ((near - *angle) / TAU).round();
            let within = |q: &f64| *q >= joint.lower_rad && *q <= joint.upper_rad;
            let turns = [base, base - TAU, base + TAU, base - 2.0 * TAU, base + 2.0 * TAU];
            *angle = turns.into_iter().find(within)?;
        }
        Some(wrapped)
    }

    fn clamp(&self, angles: &mut Joints) {
        for (angle, joint) in angles.iter_mut().zip(&self.chain.joints) {
            *angle = angle.clamp(joint.lower_rad, joint.upper_rad);
        }
    }

    /// Names the joint that leaves its limits most in a solution found without limits.
    fn explain(&self, target: &Pose, without_limits: Option<&Joints>) -> Unreachable {
        let out_of_reach = Unreachable::OutOfReach { distance_m: target.translation.vector.norm() };
        let Some(angles) = without_limits else { return out_of_reach };
        let excess = |joint: &crate::chain::Joint, q: f64| (joint.lower_rad - q).max(q - joint.upper_rad);
        let worst = self
            .chain
            .joints
            .iter()
            .zip(angles)
            .map(|(joint, &q)| {
                // Of all turns of the joint the one that violates least.
                let turns = [q, q - TAU, q + TAU];
                let least = turns.into_iter().min_by(|a, b| excess(joint, *a).total_cmp(&excess(joint, *b)));
                (joint, least.unwrap_or(q))
            })
            .max_by(|a, b| excess(a.0, a.1).total_cmp(&excess(b.0, b.1)));
        match worst {
            Some((joint, angle_rad)) if excess(joint, angle_rad) > 0.0 => Unreachable::JointLimit {
                joint: joint.name.clone(),
                angle_rad,
                lower_rad: joint.lower_rad,
                upper_rad: joint.upper_rad,
            },
            _ => out_of_reach,
        }
    }
}

impl Opw {
    fn new(chain: &Chain, spec: &OpwSpec) -> Result<Self, WorldError> {
        let [a1, a2, b, c1, c2, c3, c4] = spec.lengths_m;
        if !spec.offsets_rad.iter().all(|offset| offset.abs() <= TAU) {
            return Err(WorldError::Value {
                key: "robot.opw.offsets_deg",
                why: "every offset must lie within ±360".into(),
            });
        }
        let kinematics = OPWKinematics::new(Parameters {
            a1,
            a2,
            b,
            c1,
            c2,
            c3,
            c4,
            offsets: spec.offsets_rad,
            sign_corrections: spec.signs,
            dof: 6,
        });
        // The two models name the same flange up to a constant turn, read off at one posture and checked
        // at others. Rounded, because the platform's sine has a part in it.
        let at = [0.1, -0.7, 0.9, 0.2, 0.6, -0.3];
        let turn = chain.base_from_flange(&at).rotation.inverse() * opw_forward(&kinematics, &at).rotation;
        let flange_from_opw = Pose::from_parts(
            nalgebra::Translation3::identity(),
            nalgebra::UnitQuaternion::new_normalize(nalgebra::Quaternion::from(
                turn.coords.map(|c| round_to(c, 1e9)),
            )),
        );
        let postures = [at, [0.0; 6], [1.0, -1.5, 1.2, 0.4, -1.0, 0.8], [-0.6, -0.4, 0.3, -1.0, 0.5, 2.0]];
        let error_m = postures
            .iter()
            .map(|q| {
                pose_error(&(chain.base_from_flange(q) * flange_from_opw), &opw_forward(&kinematics, q))
                    .norm()
            })
            // Not `f64::max`, which would drop a NaN.
            .fold(0.0, |worst: f64, error| if error <= worst { worst } else { error });
        // Figures of data sheets are round to 0.1 µm; anything above is another arm.
        if error_m.is_nan() || error_m > 1e-6 {
            return Err(WorldError::OpwMismatch { error_mm: error_m * 1e3 });
        }
        Ok(Self { kinematics, flange_from_opw })
    }

    fn propose(&self, base_from_flange: &Pose, near: &Joints) -> Vec<Joints> {
        let pose = base_from_flange * self.flange_from_opw;
        let t = pose.translation.vector;
        let q = pose.rotation.coords;
        let Ok(pose) = OpwPose::try_from_parts(
            DVec3::from_array([t.x, t.y, t.z]),
            DQuat::from_array([q.x, q.y, q.z, q.w]),
        ) else {
            return Vec::new();
        };
        let mut proposals = self.kinematics.inverse_continuing(&pose, near);
        for angle in proposals.iter_mut().flatten() {
            *angle = round_to(*angle, PROPOSAL_GRID);
        }
        proposals
    }
}

/// Root of the sum of squares of the six differences.
fn distance_rad(a: &Joints, b: &Joints) -> f64 {
    a.iter().zip(b).map(|(a, b)| (a - b) * (a - b)).sum::<f64>().sqrt()
}

fn round_to(value: f64, steps_per_unit: f64) -> f64 {
    (value * steps_per_unit).round() / steps_per_unit
}

fn opw_forward(kinematics: &OPWKinematics, angles: &Joints) -> Pose {
    let pose = kinematics.forward(angles);
    let (t, q) = (pose.translation.to_array(), pose.rotation.to_array());
    Pose::from_parts(
        nalgebra::Translation3::new(t[0], t[1], t[2]),
        nalgebra::UnitQuaternion::new_normalize(nalgebra::Quaternion::new(q[3], q[0], q[1], q[2])),
    )
}

/// Translation (m) and rotation vector (rad) that lead from `actual` to `target`, base frame.
fn pose_error(target: &Pose, actual: &Pose) -> Vector6<f64> {
    let linear = target.translation.vector - actual.translation.vector;
    let turn = (target.rotation * actual.rotation.inverse()).scaled_axis();
    Vector6::new(linear.x, linear.y, linear.z, turn.x, turn.y, turn.z)
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::fixture;

    fn solvers() -> (Chain, Ik, Ik) {
        let with = fixture::kuka();
        let without = ArmSpec { opw: None, ..fixture::kuka() };
        let chain = Chain::from_spec(&with).unwrap();
        let (analytic, numeric) = (Ik::new(chain.clone(), &with), Ik::new(chain.clone(), &without));
        (chain, analytic.unwrap(), numeric.unwrap())
    }

    #[test]
    fn truth_chain_and_published_opw_figures_agree() {
        let (chain, analytic, _) = solvers();
        let opw = analytic.opw.unwrap();
        for q in [[0.2, -1.0, 0.7, 1.5, -0.4, 3.0], [-2.0, -2.5, 2.0, -1.0, 1.2, -5.0]] {
            let there = opw_forward(&opw.kinematics, &q);
            let here = chain.base_from_flange(&q);
            assert!((there.translation.vector - here.translation.vector).norm() < 1e-12);
        }
    }

    #[test]
    fn another_arms_parameters_are_refused() {
        let mut spec = fixture::kuka();
        spec.opw.as_mut().unwrap().lengths_m[4] += 0.01;
        let chain = Chain::from_spec(&spec).unwrap();
        assert!(matches!(Ik::new(chain, &spec), Err(WorldError::OpwMismatch { .. })));
    }

    #[test]
    fn a_pose_out_of_reach_is_called_so() {
        let (chain, analytic, numeric) = solvers();
        let mut pose = chain.base_from_flange(&[0.0, -1.5, 1.5, 0.0, 1.2, 0.0]);
        pose.translation.x += 3.0;
        for ik in [analytic, numeric] {
            let why = ik.solve(&pose, &[0.0, -1.5, 1.5, 0.0, 1.2, 0.0]).unwrap_err();
            assert!(matches!(why, Unreachable::OutOfReach { .. }), "{why}");
        }
    }

    #[test]
    fn a_joint_beyond_its_limit_is_named() {
        let mut spec = fixture::kuka();
        let joint = spec.urdf.joints.iter_mut().find(|j| j.name == "joint_a5").unwrap();
        joint.limit.upper = 1.0;
        let chain = Chain::from_spec(&spec).unwrap();
        let wanted = [0.0, -1.5, 1.5, 0.0, 1.2, 0.0];
        let pose = chain.base_from_flange(&wanted);
        let near = [0.0, -1.5, 1.5, 0.0, 0.9, 0.0];
        // The flipped wrist would do; shut it out so that only joint 5 is left to blame.
        for name in ["joint_a4", "joint_a6"] {
            let joint = spec.urdf.joints.iter_mut().find(|j| j.name == name).unwrap();
            (joint.limit.lower, joint.limit.upper) = (-0.5, 0.5);
        }
        let chain = Chain::from_spec(&spec).unwrap();
        let without = ArmSpec { opw: None, ..spec };
        let why = Ik::new(chain, &without).unwrap().solve(&pose, &near).unwrap_err();
        assert!(matches!(&why, Unreachable::JointLimit { joint, .. } if joint == "joint_a5"), "{why}");
    }

    /// Angles within the limits, at shares of each joint's range.
    fn at_shares(chain: &Chain, shares: &[f64; 6]) -> Joints {
        std::array::from_fn(|i| {
            let joint = &chain.joints[i];
            joint.lower_rad + shares[i] * (joint.upper_rad - joint.lower_rad)
        })
    }

    /// Smallest singular value of the Jacobian, metres and radians alike: how far a posture is from where branches meet.
    fn least_singular_value(chain: &Chain, q: &Joints) -> f64 {
        chain.jacobian(q).1.singular_values().min()
    }

    fn shares() -> impl Strategy<Value = [f64; 6]> {
        prop::array::uniform6(0.0..1.0f64)
    }

    proptest! {
        #![proptest_config(ProptestConfig { cases: 500, ..ProptestConfig::default() })]

        /// Over all that the KUKA reaches but the surroundings of its singularities, where branches meet.
        #[test]
        fn both_solvers_come_back_to_the_same_angles(
            shares in shares(), offset in prop::array::uniform6(-0.02..0.02f64),
        ) {
            let (chain, analytic, numeric) = solvers();
            let q = at_shares(&chain, &shares);
            prop_assume!(least_singular_value(&chain, &q) > 0.03);
            let pose = chain.base_from_flange(&q);
            let mut near = q;
            for (n, o) in near.iter_mut().zip(offset) { *n += o; }
            let a = analytic.solve(&pose, &near).unwrap();
            let n = numeric.solve(&pose, &near).unwrap();
            for i in 0..6 {
                // Exact to 1e-9 in the pose; the least singular value turns that into 3e-8 in the angles.
                prop_assert!((a[i] - q[i]).abs() < 1e-7, "analytic {a:?} for {q:?}");
                prop_assert!((n[i] - q[i]).abs() < 1e-7, "numeric {n:?} for {q:?}");
                prop_assert!((a[i] - n[i]).abs() < 1e-7);
            }
        }

        /// The other arm has no analytic solver; its own forward kinematics are held against the maker's table elsewhere.
        #[test]
        fn an_arm_without_spherical_wrist_comes_back_to_the_same_angles(
            shares in shares(), offset in prop::array::uniform6(-0.02..0.02f64),
        ) {
            let spec = fixture::in_the_box("ur5e");
            let chain = Chain::from_spec(&spec).unwrap();
            let ik = Ik::new(chain.clone(), &spec).unwrap();
            let q = at_shares(&chain, &shares);
            prop_assume!(least_singular_value(&chain, &q) > 0.03);
            let mut near = q;
            for (n, o) in near.iter_mut().zip(offset) { *n += o; }
            let found = ik.solve(&chain.base_from_flange(&q), &near).unwrap();
            for i in 0..6 {
                prop_assert!((found[i] - q[i]).abs() < 1e-7, "{found:?} for {q:?}");
            }
        }

        /// From home to anywhere: what is found keeps the limits and is the pose asked for.
        #[test]
        fn from_far_away_the_pose_is_met_within_the_limits(shares in shares()) {
            let (chain, analytic, numeric) = solvers();
            let pose = chain.base_from_flange(&at_shares(&chain, &shares));
            let near = fixture::kuka().home_rad;
            let both = [analytic.solve(&pose, &near), numeric.solve(&pose, &near)];
            for found in both.iter().flatten() {
                prop_assert!(pose_error(&pose, &chain.base_from_flange(found)).norm() < 1e-6);
                prop_assert!(chain.margin_rad(found) >= 0.0);
            }
            prop_assert!(both[0].is_ok(), "{pose}");
        }
    }

    /// Steps from a start find most of what can be reached, not all: 95 % from home to anywhere within the limits.
    /// Targets of a run lie near the present posture, where the tests above hold.
    #[test]
    fn steps_from_home_find_most_of_what_can_be_reached() {
        for name in ["kuka_kr6_r900", "ur5e"] {
            let spec = ArmSpec { opw: None, ..fixture::in_the_box(name) };
            let chain = Chain::from_spec(&spec).unwrap();
            let ik = Ik::new(chain.clone(), &spec).unwrap();
            let found = (0..1000u32)
                .filter(|step| {
                    // Multiples of irrational shares spread evenly.
                    let shares = [0.618_034, 0.754_878, 0.569_840, 0.819_173, 0.671_044, 0.856_675]
                        .map(|share| (f64::from(*step) * share).fract());
                    let pose = chain.base_from_flange(&at_shares(&chain, &shares));
                    ik.solve(&pose, &spec.home_rad).is_ok()
                })
                .count();
            assert!(found >= 900, "{name}: {found} of 1000");
        }
    }
}
