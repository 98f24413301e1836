use serde::{Deserialize, Serialize};

use crate::{Estimate, Pose};

/// The controller's answer to one image.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Command {
    /// Sequence number of the image answered.
    pub answers: u64,
    /// What the tracker believes.
    pub estimate: Estimate,
    /// Where the probe should go under the *nominal* calibration, held until replaced; `None` keeps the
    /// last target. Motion along the probe's z belongs to the simulator's force controller.
    pub target_base_from_probe: Option<Pose>,
    /// Speed at which the needle is to be fed, ≥ 0; 0 stops it.
    pub feed_m_s: f64,
    /// Time the controller needed by its own clock, microseconds; for reports only, never for the state.
    pub compute_us: f32,
}

/// Why a run ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum EndReason {
    /// The needle stands at the target.
    TargetReached,
    /// The scenario's time is over.
    TimeOver,
    /// The tracker gave no answer for 10 s of wall clock.
    TrackerSilent,
    /// The tracker process ended although no scenario asked it to.
    TrackerDied,
    /// The run was interrupted.
    Interrupted,
    /// The simulator failed.
    Fault,
}
