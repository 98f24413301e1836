use thiserror::Error;

use crate::ik::Unreachable;

/// Why a scenario cannot become a world. Every variant names the key of the scenario that is to blame.
#[derive(Debug, Clone, PartialEq, Error)]
pub enum WorldError {
    /// The robot description does not hold the chain that the arm's file names.
    #[error("robot.urdf: {0}")]
    Chain(String),
    /// The analytic parameters describe another arm than the URDF.
    #[error("robot.opw: the parameters put the flange {error_mm:.3} mm from where the URDF puts it")]
    OpwMismatch {
        /// Largest distance seen over the probed joint angles.
        error_mm: f64,
    },
    /// The arm cannot hold the probe where the operator places it.
    #[error("placement: the arm cannot hold the probe over the needle's tip at the start: {0}")]
    StartUnreachable(Unreachable),
    /// The arm cannot follow the needle to its target.
    #[error(
        "insertion.target_depth_mm: the arm cannot hold the probe over the needle at a depth of {depth_mm:.1} mm: {why}"
    )]
    TargetUnreachable {
        /// Depth at which the arm first fails.
        depth_mm: f64,
        /// What stops it.
        why: Unreachable,
    },
    /// The needle robot cannot hold the needle on its line.
    #[error(
        "insertion: with the tip at a depth of {depth_mm:.1} mm the needle robot's joint `{joint}` would stand at {value:.1}{unit}, outside {lower:.1}{unit}…{upper:.1}{unit}"
    )]
    NeedleRobotLimit {
        /// Name of the joint.
        joint: String,
        /// Depth of the tip.
        depth_mm: f64,
        /// Value that the joint would need.
        value: f64,
        /// Least value.
        lower: f64,
        /// Largest value.
        upper: f64,
        /// Unit of all three.
        unit: &'static str,
    },
    /// No angles of the needle robot point the needle that way.
    #[error("insertion.angle_deg: the needle robot's two turns cannot point the needle that way")]
    NeedleRobotDirection,
    /// The needle robot cannot feed that far.
    #[error(
        "insertion.target_depth_mm = {depth_mm:.1} must be at most {max_mm:.1}: robot's travel or needle's length"
    )]
    TargetTooDeep {
        /// Depth asked for.
        depth_mm: f64,
        /// Deepest possible.
        max_mm: f64,
    },
    /// The needle would leave the phantom before it reaches the target.
    #[error("insertion.target_depth_mm: the needle leaves the phantom at a depth of {depth_mm:.1} mm")]
    TargetOutsidePhantom {
        /// Depth at which the tip leaves.
        depth_mm: f64,
    },
    /// Something touches at the start that must not.
    #[error("{key}: at the start {between} are nearer than {margin_mm:.1} mm")]
    StartCollision {
        /// What to change: where the arm stands, or how the needle goes in.
        key: &'static str,
        /// The two bodies.
        between: String,
        /// The distance that is kept.
        margin_mm: f64,
    },
    /// A number of the scenario is outside what the world can work with.
    #[error("{key}: {why}")]
    Value {
        /// Key in the scenario.
        key: &'static str,
        /// What is wrong with it.
        why: String,
    },
}
