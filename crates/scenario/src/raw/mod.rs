//! The files as people write them: keys with units, ranges of single values. Converted to SI in
//! [`crate::check`], nowhere else.
//!
//! Ranges here are of plausibility; what depends on a second value is checked there.

mod needle;
mod phantom;
mod probe;
mod robot;
mod scenario;
mod settings;
mod timeline;

pub(crate) use needle::RawNeedle;
pub(crate) use phantom::{RawInclusion, RawMaterial, RawMaterials, RawPassage, RawPhantom};
pub(crate) use probe::{RawPrecision, RawProbe};
pub(crate) use robot::{RawNeedleRobot, RawOpw, RawPose, RawRobot};
pub(crate) use scenario::{
    RawCalibration, RawDelays, RawInsertion, RawManual, RawPlacement, RawScenario, RawView,
};
pub(crate) use settings::{
    RawGuess, RawInit, RawLimits, RawMethod, RawProfile, RawSearchPattern, RawServo, RawSimilarity,
    RawTracker, RawUpdate, RawWarp,
};
pub(crate) use timeline::{RawBound, RawDisturbance, RawKnock, RawNormal, RawRandomize};
