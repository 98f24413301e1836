//! Files that people write → checked [`Scenario`].
//!
//! Raw serde structs with `deny_unknown_fields` carry the units of the files (`_mm`, `_deg`, `_s`); the
//! model holds SI and radians and has kept every bound.

mod model;

pub use model::{
    ArmSpec, Bound, CalibrationSpec, DelaySpec, Disturbance, DisturbanceKind, Expectation, Inclusion,
    InsertionSpec, Material, NeedleRobotSpec, OpwSpec, PhantomSpec, PlacementSpec, Scenario, Shape,
};
