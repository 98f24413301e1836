//! The arm under position control: set point → joint angles → jerk-limited motion.
//!
//! Two hundred times a second the set point moves on towards the commanded target, no faster than the
//! probe may move; the press along the probe's axis is laid on top; inverse kinematics turn it into joint
//! angles for the planner.

use sonoloop_scenario::ArmSpec;
use sonoloop_types::{ArmStatus, Limits, Pose, TICKS_PER_SECOND, Vector};

use crate::WorldError;
use crate::chain::{Chain, Joints};
use crate::ik::{Ik, Unreachable};
use crate::motion::Motion;

/// Ticks between two set points: 200 Hz.
pub(crate) const CONTROL_TICKS: u64 = 5;
/// Time constant of the set point's approach to its target. Targets come in steps, one per picture; a set point that
/// jumped after them would shake the jerk-limited planner into a limit cycle (0.4 mm at 12 Hz was seen).
const APPROACH_TICKS: u64 = 40;
/// The set point has arrived when no point of the array is farther than this from its target.
const ARRIVED_M: f64 = 1e-6;
/// A joint that had to turn further than this within one control step would have changed its branch.
const MAX_SET_POINT_JUMP_RAD: f64 = 0.2;

/// The unchanging part.
#[derive(Debug, Clone)]
pub(crate) struct ArmModel {
    pub spec: ArmSpec,
    pub chain: Chain,
    pub ik: Ik,
    max_probe_speed_m_s: f64,
    /// Half the array: turns count by how fast they move its ends.
    lever_m: f64,
}

/// What the arm does at one tick.
#[derive(Debug, Clone)]
pub(crate) struct Arm {
    motion: Motion,
    /// Commanded pose, slid along its own z onto the nominal surface plane; base from probe.
    target: Pose,
    /// On its way to the target; base from probe.
    set_point: Pose,
    /// How far the probe is pushed beyond the surface plane along its z.
    press_m: f64,
    /// Joint angles of the set point, and how fast they move.
    set_angles_rad: Joints,
    set_speed_rad_s: Joints,
    status: ArmStatus,
    stalled: bool,
    /// Link poses and flange of this tick, base frame.
    poses: [Pose; 7],
}

impl ArmModel {
    pub(crate) fn new(spec: &ArmSpec, limits: &Limits, aperture_m: f64) -> Result<Self, WorldError> {
        let chain = Chain::from_spec(spec)?;
        let ik = Ik::new(chain.clone(), spec)?;
        Ok(Self {
            spec: spec.clone(),
            chain,
            ik,
            max_probe_speed_m_s: limits.max_probe_speed_m_s,
            lever_m: aperture_m / 2.0,
        })
    }

    /// Slides a probe pose along its own z onto the phantom's undeformed top face: what a target says of
    /// that direction does not count. Returns the slide as well.
    pub(crate) fn onto_surface(&self, base_from_probe: &Pose) -> (Pose, f64) {
        let world_from_probe = self.spec.world_from_base * base_from_probe;
        let down = -(world_from_probe.rotation * Vector::z()).z;
        let slide_m = world_from_probe.translation.vector.z / down.max(0.1);
        (base_from_probe * Pose::translation(0.0, 0.0, slide_m), slide_m)
    }

    fn angles_for(&self, base_from_probe: &Pose, near: &Joints) -> Result<Joints, Unreachable> {
        self.ik.solve(&(base_from_probe * self.spec.flange_from_probe.inverse()), near)
    }
}

impl Arm {
    /// At rest, pressed as far as the pose says.
    pub(crate) fn at_rest(model: &ArmModel, angles_rad: Joints) -> Self {
        let poses = model.chain.link_poses(&angles_rad);
        let (set_point, slide_m) = model.onto_surface(&(poses[6] * model.spec.flange_from_probe));
        Self {
            motion: Motion::at_rest(&model.chain, &model.spec, angles_rad),
            target: set_point,
            set_point,
            press_m: -slide_m,
            set_angles_rad: angles_rad,
            set_speed_rad_s: [0.0; 6],
            status: ArmStatus::Ready,
            stalled: false,
            poses,
        }
    }

    pub(crate) fn status(&self) -> ArmStatus {
        self.status
    }

    pub(crate) fn angles_rad(&self) -> &Joints {
        &self.motion.state().angle_rad
    }

    pub(crate) fn link_poses(&self) -> &[Pose; 7] {
        &self.poses
    }

    pub(crate) fn base_from_flange(&self) -> &Pose {
        &self.poses[6]
    }

    pub(crate) fn press_m(&self) -> f64 {
        self.press_m
    }

    /// Takes a new target; one out of reach is refused and the arm holds.
    pub(crate) fn set_target(&mut self, model: &ArmModel, base_from_probe: &Pose) -> Result<(), Unreachable> {
        let (target, _) = model.onto_surface(base_from_probe);
        if target == self.target && self.status == ArmStatus::Ready {
            return Ok(());
        }
        let pressed = target * Pose::translation(0.0, 0.0, self.press_m);
        match model.angles_for(&pressed, &self.set_angles_rad) {
            Ok(_) => {
                self.target = target;
                if self.status != ArmStatus::Collision {
                    self.status = ArmStatus::Ready;
                }
                Ok(())
            }
            Err(why) => {
                self.target = self.set_point;
                if self.status != ArmStatus::Collision {
                    self.status = ArmStatus::Unreachable;
                }
                Err(why)
            }
        }
    }

    /// A valid command without a target keeps the last one and ends a hold.
    pub(crate) fn keep_target(&mut self) {
        if self.status == ArmStatus::Holding {
            self.status = ArmStatus::Ready;
        }
    }

    /// Stays where it is until the next target; the press goes on.
    pub(crate) fn hold(&mut self) {
        if self.status == ArmStatus::Ready {
            self.status = ArmStatus::Holding;
        }
        self.target = self.set_point;
    }

    /// Stops every joint: something is too near.
    pub(crate) fn stop_for_collision(&mut self) {
        self.status = ArmStatus::Collision;
        self.set_speed_rad_s = [0.0; 6];
        self.motion.stop();
    }

    /// Stops every joint while `stalled`, and sets out again from where the arm came to rest once it no longer is. The
    /// press stands as well; [`Self::control`] must not be called meanwhile.
    pub(crate) fn stall(&mut self, model: &ArmModel, stalled: bool) {
        match (self.stalled, stalled) {
            (false, true) => {
                self.set_speed_rad_s = [0.0; 6];
                self.motion.stop();
            }
            (true, false) if self.status != ArmStatus::Collision => self.release(model),
            _ => {}
        }
        self.stalled = stalled;
        if stalled && self.status != ArmStatus::Collision {
            self.status = ArmStatus::Holding;
        }
    }

    /// Joint angles at the target, to see whether the way there is free.
    pub(crate) fn target_angles(&self, model: &ArmModel) -> Option<Joints> {
        let pressed = self.target * Pose::translation(0.0, 0.0, self.press_m);
        model.angles_for(&pressed, &self.set_angles_rad).ok()
    }

    /// Ends a stop: sets out again from where the arm came to rest.
    pub(crate) fn release(&mut self, model: &ArmModel) {
        let measured = self.poses[6] * model.spec.flange_from_probe;
        let (set_point, slide_m) = model.onto_surface(&measured);
        self.set_point = set_point;
        self.press_m = -slide_m;
        self.set_angles_rad = *self.angles_rad();
        self.status = ArmStatus::Ready;
    }

    /// One control step: moves the set point on, presses at `press_rate_m_s`, plans. `Err` once the set
    /// point itself runs out of reach.
    pub(crate) fn control(&mut self, model: &ArmModel, press_rate_m_s: f64) -> Result<(), Unreachable> {
        if self.status == ArmStatus::Collision {
            return Ok(());
        }
        let dt_s = CONTROL_TICKS as f64 / TICKS_PER_SECOND as f64;
        let set_point =
            advance(&self.set_point, &self.target, model.max_probe_speed_m_s * dt_s, model.lever_m);
        let press_m = self.press_m + press_rate_m_s * dt_s;
        if set_point == self.set_point && press_m == self.press_m && self.set_speed_rad_s == [0.0; 6] {
            return Ok(());
        }
        let pressed = set_point * Pose::translation(0.0, 0.0, press_m);
        let solved = model.angles_for(&pressed, &self.set_angles_rad).and_then(|angles| {
            let jump = |i: usize| (angles[i] - self.set_angles_rad[i]).abs() > MAX_SET_POINT_JUMP_RAD;
            match (0..6).find(|&i| jump(i)) {
                None => Ok(angles),
                Some(i) => Err(Unreachable::JointLimit {
                    joint: model.chain.joints[i].name.clone(),
                    angle_rad: angles[i],
                    lower_rad: self.set_angles_rad[i] - MAX_SET_POINT_JUMP_RAD,
                    upper_rad: self.set_angles_rad[i] + MAX_SET_POINT_JUMP_RAD,
                }),
            }
        });
        match solved {
            Ok(angles) => {
                self.set_speed_rad_s = std::array::from_fn(|i| (angles[i] - self.set_angles_rad[i]) / dt_s);
                self.set_angles_rad = angles;
                (self.set_point, self.press_m) = (set_point, press_m);
                self.motion.retarget(&self.set_angles_rad, &self.set_speed_rad_s);
                Ok(())
            }
            Err(why) => {
                self.target = self.set_point;
                self.set_speed_rad_s = [0.0; 6];
                self.motion.retarget(&self.set_angles_rad, &[0.0; 6]);
                let first = self.status != ArmStatus::Unreachable;
                self.status = ArmStatus::Unreachable;
                if first { Err(why) } else { Ok(()) }
            }
        }
    }

    /// One tick of motion.
    pub(crate) fn step(&mut self, model: &ArmModel) {
        if !self.motion.is_at_rest() {
            self.motion.step();
            self.poses = model.chain.link_poses(self.angles_rad());
        }
    }
}

/// Moves `from` a [`CONTROL_TICKS`]/[`APPROACH_TICKS`] share of the way to `to`, so that no point of the array moves
/// farther than `reach_m`.
fn advance(from: &Pose, to: &Pose, reach_m: f64, lever_m: f64) -> Pose {
    if from == to {
        return *from;
    }
    let shift = to.translation.vector - from.translation.vector;
    let turn = (from.rotation.inverse() * to.rotation).scaled_axis();
    let way_m = shift.norm() + turn.norm() * lever_m;
    if way_m <= ARRIVED_M {
        return *to;
    }
    let share = (CONTROL_TICKS as f64 / APPROACH_TICKS as f64).min(reach_m / way_m);
    Pose::from_parts(
        (from.translation.vector + shift * share).into(),
        from.rotation * nalgebra::UnitQuaternion::from_scaled_axis(turn * share),
    )
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::fixture;
    use crate::motion::tests::check_step;

    /// A target about the start (mm, rad), how many ticks it stands, and how the press goes meanwhile.
    fn target() -> impl Strategy<Value = ([f64; 3], [f64; 3], u64, f64)> {
        (
            [-150.0..150.0f64, -150.0..150.0, -150.0..150.0],
            [-0.5..0.5f64, -0.5..0.5, -0.8..0.8],
            prop_oneof![Just(40), 1u64..600],
            -0.02..0.02f64,
        )
    }

    proptest! {
        #![proptest_config(ProptestConfig { cases: 60, ..ProptestConfig::default() })]

        /// Whatever is asked for, near or out of reach, and whenever: each joint keeps its four limits at every tick.
        #[test]
        fn every_limit_holds_for_random_targets_of_either_arm(
            spec in prop_oneof![Just(fixture::in_the_box("kuka_kr6_r900")), Just(fixture::in_the_box("ur5e"))],
            targets in prop::collection::vec(target(), 1..8),
            stop in 0..8usize,
        ) {
            let limits = Limits { max_probe_speed_m_s: 0.5, ..fixture::scenario().limits };
            let model = ArmModel::new(&spec, &limits, 0.0384).unwrap();
            let mut arm = Arm::at_rest(&model, spec.home_rad);
            let start = *arm.base_from_flange() * spec.flange_from_probe;
            let mut tick = 0u64;
            for (index, (shift_mm, turn_rad, ticks, press_rate_m_s)) in targets.into_iter().enumerate() {
                let [x, y, z] = shift_mm.map(|mm| mm * 1e-3);
                let turn = nalgebra::UnitQuaternion::from_scaled_axis(Vector::from(turn_rad));
                let moved = Pose::from_parts(nalgebra::Translation3::new(x, y, z), turn);
                let _ = arm.set_target(&model, &(start * moved));
                for _ in 0..ticks {
                    tick += 1;
                    if tick.is_multiple_of(CONTROL_TICKS) {
                        let _ = arm.control(&model, press_rate_m_s);
                    }
                    let before = *arm.motion.state();
                    arm.step(&model);
                    check_step(&model.chain, &spec, &before, arm.motion.state())?;
                }
                if index == stop {
                    arm.stop_for_collision();
                }
            }
        }
    }
}
