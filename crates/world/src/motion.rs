//! Jerk-limited motion of six joints towards a moving set point, sampled every tick.
//!
//! rsruckig plans from the present state to the set point, which may itself move; all joints arrive
//! together. The state lies on a grid: the planner's roots go through the platform's arc cosine, and a last
//! bit that differs between CPUs must neither show nor live on from plan to plan.

use rsruckig::prelude::{
    ControlInterface, DataArrayOrVec, InputParameter, Ruckig, RuckigResult, Synchronization,
    ThrowErrorHandler, Trajectory,
};
use sonoloop_scenario::ArmSpec;
use sonoloop_types::TICKS_PER_SECOND;

use crate::chain::{Chain, Joints};

/// Steps per unit of the grid: 0.2 nrad, 4 nrad/s and 0.2 µrad/s², far below any encoder and far above what
/// rounding does.
const ANGLE_GRID: f64 = (1u64 << 32) as f64;
const SPEED_GRID: f64 = (1u64 << 28) as f64;
const ACCELERATION_GRID: f64 = (1u64 << 22) as f64;

/// A plan that has come to its end runs on at most this long before the next one: two control steps.
const RUN_ON_S: f64 = 0.01;

/// Present state of all joints.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct JointState {
    pub angle_rad: Joints,
    pub speed_rad_s: Joints,
    pub acceleration_rad_s2: Joints,
}

/// Moves the joints; holds the plan and where on it they are.
#[derive(Debug, Clone)]
pub(crate) struct Motion {
    planner: Ruckig<6, ThrowErrorHandler>,
    input: InputParameter<6>,
    plan: Trajectory<6>,
    /// Where the next plan is worked out, so that a failure leaves the present one alone.
    draft: Trajectory<6>,
    /// Ticks since the plan began; `None` while the joints stand.
    ticks_on_plan: Option<u64>,
    state: JointState,
    lower_rad: Joints,
    upper_rad: Joints,
}

impl Motion {
    /// Joints at rest.
    pub(crate) fn at_rest(chain: &Chain, spec: &ArmSpec, angle_rad: Joints) -> Self {
        let mut input = InputParameter::<6>::new(None);
        input.synchronization = Synchronization::Time;
        input.max_velocity = DataArrayOrVec::Stack(std::array::from_fn(|i| chain.joints[i].max_speed_rad_s));
        input.max_acceleration = DataArrayOrVec::Stack([spec.max_acceleration_rad_s2; 6]);
        input.max_jerk = DataArrayOrVec::Stack([spec.max_jerk_rad_s3; 6]);
        let lower_rad = std::array::from_fn(|i| chain.joints[i].lower_rad);
        let upper_rad = std::array::from_fn(|i| chain.joints[i].upper_rad);
        input.min_position = Some(DataArrayOrVec::Stack(lower_rad));
        input.max_position = Some(DataArrayOrVec::Stack(upper_rad));
        Self {
            planner: Ruckig::new(None, 1.0 / TICKS_PER_SECOND as f64),
            input,
            plan: Trajectory::new(None),
            draft: Trajectory::new(None),
            ticks_on_plan: None,
            state: JointState { angle_rad, speed_rad_s: [0.0; 6], acceleration_rad_s2: [0.0; 6] },
            lower_rad,
            upper_rad,
        }
    }

    pub(crate) fn state(&self) -> &JointState {
        &self.state
    }

    /// True when nothing moves and nothing is planned.
    pub(crate) fn is_at_rest(&self) -> bool {
        self.ticks_on_plan.is_none()
    }

    /// Plans from the present state towards a set point that moves on with `speed_rad_s`. When no plan
    /// keeps all limits, the joints are brought to rest as fast as the limits allow, and false comes back.
    pub(crate) fn retarget(&mut self, angle_rad: &Joints, speed_rad_s: &Joints) -> bool {
        self.start_from_present_state();
        self.input.control_interface = ControlInterface::Position;
        self.input.synchronization = Synchronization::Time;
        for i in 0..6 {
            let (lower, upper) = self.limits(i);
            let angle = angle_rad[i].clamp(lower, upper);
            let largest = 0.9 * self.input.max_velocity[i];
            let speed = speed_rad_s[i].clamp(-largest, largest);
            // Every plan must end where the joint can still be stopped inside its limits. The plan runs on
            // with its last speed until the next one, so a set point may lie that much farther on.
            let run_on = speed * RUN_ON_S;
            let stop = run_on + self.stopping_distance(i, speed).copysign(speed);
            let stoppable = angle + stop >= lower && angle + stop <= upper;
            self.input.target_position[i] = angle;
            self.input.target_velocity[i] = if stoppable { speed } else { 0.0 };
            self.input.target_acceleration[i] = 0.0;
        }
        if self.plan() {
            return true;
        }
        // A moving set point can be the reason; a standing one is easier.
        self.input.target_velocity = DataArrayOrVec::Stack([0.0; 6]);
        if self.plan() {
            return true;
        }
        // On the edge between two kinds of profile the planner (3.0.1) finds neither: with 20 rad/s² and
        // 400 rad/s³ a way of exactly 2a³/j² = 0.1 rad. A slightly gentler jerk is off the edge.
        let max_jerk = self.input.max_jerk.clone();
        for jerk in self.input.max_jerk.iter_mut() {
            *jerk *= 0.99;
        }
        let planned = self.plan();
        self.input.max_jerk = max_jerk;
        if !planned {
            self.stop();
        }
        planned
    }

    /// Brings the joints to rest.
    pub(crate) fn stop(&mut self) {
        if self.is_at_rest() {
            return;
        }
        self.start_from_present_state();
        self.input.control_interface = ControlInterface::Velocity;
        // Each joint as fast as it can: a joint that waited for the others could run into its limit.
        self.input.synchronization = Synchronization::None;
        self.input.target_velocity = DataArrayOrVec::Stack([0.0; 6]);
        self.input.target_acceleration = DataArrayOrVec::Stack([0.0; 6]);
        let limits = (self.input.min_position.take(), self.input.max_position.take());
        // Stopping has a solution from any state; were there none, the old plan would run to its end.
        self.plan();
        (self.input.min_position, self.input.max_position) = limits;
    }

    /// One tick onwards.
    pub(crate) fn step(&mut self) {
        let Some(ticks) = self.ticks_on_plan.as_mut() else { return };
        *ticks += 1;
        let time_s = *ticks as f64 / TICKS_PER_SECOND as f64;
        let [mut angle, mut speed, mut acceleration] =
            [const { DataArrayOrVec::<f64, 6>::Stack([0.0; 6]) }; 3];
        self.plan.at_time(
            time_s,
            &mut Some(&mut angle),
            &mut Some(&mut speed),
            &mut Some(&mut acceleration),
            &mut None,
            &mut None,
        );
        for i in 0..6 {
            let (lower, upper) = self.limits(i);
            // The plan keeps the limits up to rounding; the state keeps them exactly.
            self.state.angle_rad[i] = on_grid(angle[i], ANGLE_GRID).clamp(lower, upper);
            self.state.speed_rad_s[i] = on_grid(speed[i], SPEED_GRID);
            self.state.acceleration_rad_s2[i] = on_grid(acceleration[i], ACCELERATION_GRID);
        }
        let done = time_s >= self.plan.get_duration();
        if done && self.state.speed_rad_s.iter().all(|v| v.abs() < 1e-9) {
            self.state.speed_rad_s = [0.0; 6];
            self.state.acceleration_rad_s2 = [0.0; 6];
            self.ticks_on_plan = None;
        }
    }

    fn limits(&self, i: usize) -> (f64, f64) {
        (self.lower_rad[i], self.upper_rad[i])
    }

    /// The planner's own watch over positions lets plans pass that end in motion (seen with version 3.0.1),
    /// so its word is checked: jerk and position over every phase. A stop is excused from positions; it is
    /// the shortest way to rest from a state that a checked plan led to.
    fn draft_keeps_limits(&self) -> bool {
        let stopping = self.input.control_interface == ControlInterface::Velocity;
        let Some(profiles) = self.draft.profiles.first() else { return false };
        profiles.iter().enumerate().all(|(i, profile)| {
            let (lower, upper) = self.limits(i);
            let brake = &profile.brake;
            let before = (0..2).filter(|_| brake.duration > 0.0).map(|k| Phase {
                t: brake.t[k],
                p: brake.p[k],
                v: brake.v[k],
                a: brake.a[k],
                j: brake.j[k],
            });
            let after = (0..7).map(|k| Phase {
                t: profile.t[k],
                p: profile.p[k],
                v: profile.v[k],
                a: profile.a[k],
                j: profile.j[k],
            });
            before.chain(after).filter(|phase| phase.t > 0.0).all(|phase| {
                phase.j.abs() <= self.input.max_jerk[i] * (1.0 + 1e-9)
                    && (stopping || phase.stays_within(lower, upper))
            })
        })
    }

    /// Way of a joint from `speed` to rest with acceleration and jerk at their limits, from no acceleration.
    fn stopping_distance(&self, i: usize, speed: f64) -> f64 {
        let (a, j, v) = (self.input.max_acceleration[i], self.input.max_jerk[i], speed.abs());
        // Trapezoid of acceleration when the limit is reached, else a triangle.
        if v > a * a / j { 0.5 * v * (v / a + a / j) } else { v * (v / j).sqrt() }
    }

    fn start_from_present_state(&mut self) {
        for i in 0..6 {
            self.input.current_position[i] = self.state.angle_rad[i];
            self.input.current_velocity[i] = self.state.speed_rad_s[i];
            self.input.current_acceleration[i] = self.state.acceleration_rad_s2[i];
        }
    }

    fn plan(&mut self) -> bool {
        let planned =
            matches!(self.planner.calculate(&self.input, &mut self.draft), Ok(RuckigResult::Working))
                && self.draft_keeps_limits();
        if planned {
            std::mem::swap(&mut self.plan, &mut self.draft);
            self.ticks_on_plan = Some(0);
        }
        planned
    }
}

/// A stretch of a plan with constant jerk: duration and the state at its start, SI.
struct Phase {
    t: f64,
    p: f64,
    v: f64,
    a: f64,
    j: f64,
}

impl Phase {
    fn stays_within(&self, lower: f64, upper: f64) -> bool {
        let Self { t, p, v, a, j } = *self;
        // Rounding of the planner; the state itself is clamped.
        const SLACK_RAD: f64 = 1e-9;
        let inside = |s: f64| {
            let position = p + s * (v + s * (a / 2.0 + s * j / 6.0));
            position >= lower - SLACK_RAD && position <= upper + SLACK_RAD
        };
        // Ends of the phase, and where the speed v + at + jt²/2 changes its sign.
        let turns = if j == 0.0 {
            if a == 0.0 { [0.0; 2] } else { [-v / a; 2] }
        } else {
            let root = (a * a - 2.0 * j * v).max(0.0).sqrt();
            [(-a - root) / j, (-a + root) / j]
        };
        inside(0.0) && inside(t) && turns.into_iter().filter(|s| *s > 0.0 && *s < t).all(inside)
    }
}

fn on_grid(value: f64, steps_per_unit: f64) -> f64 {
    (value * steps_per_unit).round() / steps_per_unit
}

#[cfg(test)]
pub(crate) mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::fixture;

    const DT_S: f64 = 1e-3;

    fn motion(spec: &ArmSpec) -> (Chain, Motion) {
        let chain = Chain::from_spec(spec).unwrap();
        let motion = Motion::at_rest(&chain, spec, spec.home_rad);
        (chain, motion)
    }

    fn arms() -> impl Strategy<Value = ArmSpec> {
        prop_oneof![Just(fixture::kuka()), Just(fixture::in_the_box("ur5e"))]
    }

    /// Position, speed, acceleration and jerk from finite differences of the angles and of the planner's
    /// speeds, against the URDF and the arm's file.
    pub(crate) fn check_step(
        chain: &Chain,
        spec: &ArmSpec,
        before: &JointState,
        after: &JointState,
    ) -> Result<(), TestCaseError> {
        for (i, joint) in chain.joints.iter().enumerate() {
            let q = after.angle_rad[i];
            prop_assert!(q >= joint.lower_rad && q <= joint.upper_rad, "joint {i} at {q}");
            // The grid shows in a difference over one tick: 2.4e-7 rad/s, 4e-6 rad/s², 2.4e-4 rad/s³.
            let speed = (q - before.angle_rad[i]) / DT_S;
            prop_assert!(speed.abs() <= joint.max_speed_rad_s + 1e-6, "joint {i} speed {speed}");
            let acceleration = (after.speed_rad_s[i] - before.speed_rad_s[i]) / DT_S;
            prop_assert!(
                acceleration.abs() <= spec.max_acceleration_rad_s2 + 1e-5,
                "acceleration {acceleration}"
            );
            let jerk = (after.acceleration_rad_s2[i] - before.acceleration_rad_s2[i]) / DT_S;
            prop_assert!(jerk.abs() <= spec.max_jerk_rad_s3 + 1e-3, "joint {i} jerk {jerk}");
            // Speeds are what the angles do: mean speed of the tick within jerk's dt²/12 of the trapezoid.
            let mean = 0.5 * (after.speed_rad_s[i] + before.speed_rad_s[i]);
            prop_assert!((speed - mean).abs() < spec.max_jerk_rad_s3 * DT_S * DT_S + 1e-6, "joint {i}");
        }
        Ok(())
    }

    /// Where between its limits a joint is sent: often right onto one, sometimes beyond.
    fn share() -> impl Strategy<Value = f64> {
        prop_oneof![Just(0.0), Just(1.0), -0.2..1.2f64]
    }

    proptest! {
        #![proptest_config(ProptestConfig { cases: 120, ..ProptestConfig::default() })]

        #[test]
        fn every_limit_holds_at_each_tick(
            spec in arms(),
            targets in prop::collection::vec((prop::array::uniform6(share()), prop_oneof![Just(5), 5u64..400]), 1..20),
        ) {
            let (chain, mut motion) = motion(&spec);
            for (shares, ticks) in targets {
                // Some targets lie outside the limits.
                let target = std::array::from_fn(|i| {
                    let joint = &chain.joints[i];
                    joint.lower_rad + shares[i] * (joint.upper_rad - joint.lower_rad)
                });
                motion.retarget(&target, &[0.0; 6]);
                for _ in 0..ticks {
                    let before = *motion.state();
                    motion.step();
                    check_step(&chain, &spec, &before, motion.state())?;
                }
            }
            motion.stop();
            for _ in 0..5000 {
                let before = *motion.state();
                motion.step();
                check_step(&chain, &spec, &before, motion.state())?;
            }
            prop_assert!(motion.is_at_rest());
        }

        #[test]
        fn a_moving_set_point_keeps_every_limit(
            spec in arms(), amplitude in 0.0..0.4f64, rate_hz in 0.1..3.0f64, phase in 0.0..6.0f64,
        ) {
            let (chain, mut motion) = motion(&spec);
            let home = spec.home_rad;
            for tick in 0..2000u64 {
                if tick % 5 == 0 {
                    let angle = std::f64::consts::TAU * rate_hz * tick as f64 * DT_S + phase;
                    let speed = amplitude * std::f64::consts::TAU * rate_hz * angle.cos();
                    motion.retarget(&home.map(|q| q + amplitude * angle.sin()), &[speed; 6]);
                }
                let before = *motion.state();
                motion.step();
                check_step(&chain, &spec, &before, motion.state())?;
            }
        }
    }

    #[test]
    fn comes_to_rest_exactly_at_its_target() {
        // 0.1 rad is just where the planner alone finds no plan.
        let (_, mut motion) = motion(&fixture::kuka());
        let target = fixture::kuka().home_rad.map(|q| q + 0.1);
        assert!(motion.retarget(&target, &[0.0; 6]));
        for _ in 0..2000 {
            motion.step();
        }
        assert!(motion.is_at_rest());
        for (is, wanted) in motion.state().angle_rad.iter().zip(target) {
            assert!((is - wanted).abs() < 1e-9);
        }
    }
}
