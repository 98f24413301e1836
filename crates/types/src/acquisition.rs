use serde::{Deserialize, Serialize};

use crate::Pose;

/// What the arm's controller says of itself.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ArmStatus {
    /// Follows its targets.
    Ready,
    /// Holds: no valid command for too long.
    Holding,
    /// Stopped by an imminent collision.
    Collision,
    /// The target cannot be reached within the joint limits.
    Unreachable,
}

/// Why a command was refused.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Refusal {
    /// A value is not finite.
    NotFinite,
    /// A value is outside the limits of the set-up.
    OutOfLimits,
    /// The command belongs to another run.
    OtherRun,
    /// It answers an image that is too old.
    Stale,
    /// It answers an image that was never sent.
    UnknownImage,
    /// Its bytes do not make a command.
    Malformed,
}

/// What became of the last command that arrived.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct CommandReceipt {
    /// The image it answered.
    pub answers: u64,
    /// `None` when it was accepted.
    pub refused: Option<Refusal>,
}

/// What the rig measures with one image: everything a tracker may know beside the picture.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Acquisition {
    /// Number of the image, from 0.
    pub sequence: u64,
    /// Tick at which the picture was taken.
    pub acquisition_tick: u64,
    /// Tick at which it was handed out (later by the image delay).
    pub publication_tick: u64,
    /// Tick of the measured pose below.
    pub pose_tick: u64,
    /// Measured pose of the probe: joint encoders and the *nominal* probe mount.
    pub base_from_probe: Pose,
    /// Measured insertion depth along the needle; `None` when a hand inserts.
    pub depth_m: Option<f64>,
    /// Measured feed; `None` when a hand inserts.
    pub feed_m_s: Option<f64>,
    /// Measured contact force along the probe's axis, positive when pressed.
    pub contact_force_n: f64,
    /// What the arm says of itself.
    pub arm_status: ArmStatus,
    /// What became of the last command; `None` before the first.
    pub last_command: Option<CommandReceipt>,
}
