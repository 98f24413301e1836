use serde::{Deserialize, Serialize};

use crate::{ImageGeometry, Point, Pose, ServoSettings, TrackerSettings, Vector, View};

/// Bounds that every command must keep; a command outside them is refused.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Limits {
    /// Fastest feed the needle robot accepts.
    pub max_feed_m_s: f64,
    /// Fastest probe motion the arm is driven at.
    pub max_probe_speed_m_s: f64,
    /// Farthest a target may lie from the probe's pose at the start.
    pub max_probe_travel_m: f64,
    /// Largest turn of a target from the probe's pose at the start.
    pub max_probe_turn_rad: f64,
    /// Contact force that must never be exceeded.
    pub max_contact_force_n: f64,
}

/// What the tracker is told once, before the first image: nominal calibrations, never the truth.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Setup {
    /// Version of the protocol and of the payload layouts.
    pub protocol: u32,
    /// Identifies the run; every message carries it.
    pub run_id: u64,
    /// Ticks per second of simulated time.
    pub tick_rate_hz: u32,
    /// Ticks between images.
    pub image_period_ticks: u64,
    /// Which way the picture lies to the needle.
    pub view: View,
    /// Picture layout, `probe_from_image`.
    pub geometry: ImageGeometry,
    /// Two-way −6 dB slice thickness by depth, (depth_m, width_m).
    pub slice_thickness_m: Vec<[f64; 2]>,
    /// Nominal mount of the probe on the arm's flange.
    pub flange_from_probe: Pose,
    /// Nominal entry of the needle, base frame.
    pub entry_in_base: Point,
    /// Nominal direction of the needle, unit vector, base frame.
    pub needle_axis_in_base: Vector,
    /// The target as the operator marked it in the picture, base frame.
    pub target_in_base: Point,
    /// The operator's click on the tip in image 0, about 1 px off; `None` where the tracker is to find the tip itself.
    pub click_px: Option<[f64; 2]>,
    /// Bounds of commands.
    pub limits: Limits,
    /// How to track.
    pub tracker: TrackerSettings,
    /// How to steer.
    pub servo: ServoSettings,
}
