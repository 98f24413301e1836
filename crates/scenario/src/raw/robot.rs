use garde::Validate;
use schemars::JsonSchema;
use serde::Deserialize;

/// A six-joint arm: its URDF, where it stands, how it holds the probe.
#[derive(Debug, Clone, Deserialize, JsonSchema, Validate)]
#[serde(deny_unknown_fields)]
#[garde(allow_unvalidated)]
pub(crate) struct RawRobot {
    /// Name shown in reports.
    #[garde(length(chars, min = 1, max = 80))]
    pub name: String,
    /// The robot description, relative to this file.
    #[garde(length(min = 1))]
    pub urdf: String,
    /// Link that is the `base` frame.
    pub base_link: String,
    /// Link that is the `flange` frame; exactly six revolute joints lead to it from the base. A continuous one
    /// counts as limited to one turn either way.
    pub flange_link: String,
    /// Where the base stands.
    #[garde(dive)]
    pub world_from_base: RawPose,
    /// Nominal mount of the probe.
    #[garde(dive)]
    pub flange_from_probe: RawPose,
    /// Joint angles from which the inverse kinematics starts.
    #[garde(inner(range(min = -360.0, max = 360.0)))]
    pub home_deg: [f64; 6],
    /// Acceleration limit of every joint.
    #[garde(range(min = 0.1, max = 1000.0))]
    pub max_acceleration_rad_s2: f64,
    /// Jerk limit of every joint.
    #[garde(range(min = 1.0, max = 100000.0))]
    pub max_jerk_rad_s3: f64,
    /// Parameters of the analytic inverse kinematics, for arms with a spherical wrist.
    #[serde(default)]
    #[garde(dive)]
    pub opw: Option<RawOpw>,
}

/// A rigid transform: position, and roll, pitch, yaw about fixed axes x, y, z (as in URDF).
#[derive(Debug, Clone, Copy, Deserialize, JsonSchema, Validate)]
#[serde(deny_unknown_fields)]
pub(crate) struct RawPose {
    /// Position.
    #[garde(inner(range(min = -10000.0, max = 10000.0)))]
    pub xyz_mm: [f64; 3],
    /// Roll, pitch, yaw.
    #[garde(inner(range(min = -360.0, max = 360.0)))]
    pub rpy_deg: [f64; 3],
}

/// Ortho-parallel base and spherical wrist: the parameters of Brandstötter et al. 2014.
#[derive(Debug, Clone, Copy, Deserialize, JsonSchema, Validate)]
#[serde(deny_unknown_fields)]
pub(crate) struct RawOpw {
    /// a1, a2, b, c1, c2, c3, c4.
    #[garde(inner(range(min = -5000.0, max = 5000.0)))]
    pub lengths_mm: [f64; 7],
    /// Offsets of the joints.
    #[garde(inner(range(min = -360.0, max = 360.0)))]
    pub offsets_deg: [f64; 6],
    /// Signs of the joints, 1 or −1.
    #[garde(inner(range(min = -1, max = 1)))]
    pub signs: [i8; 6],
}

/// The robot that holds and feeds the needle: three slides, then two turns.
#[derive(Debug, Clone, Deserialize, JsonSchema, Validate)]
#[serde(deny_unknown_fields)]
#[garde(allow_unvalidated)]
pub(crate) struct RawNeedleRobot {
    /// Name shown in reports.
    #[garde(length(chars, min = 1, max = 80))]
    pub name: String,
    /// The robot description, relative to this file.
    #[garde(length(min = 1))]
    pub urdf: String,
    /// Link that is the robot's `base` frame.
    pub base_link: String,
    /// Link that holds the needle's hub: origin where the needle begins, z along the needle. Exactly three prismatic
    /// joints and after them two revolute ones lead to it from the base.
    pub hub_link: String,
    /// Where the base stands, nominally.
    #[garde(dive)]
    pub world_from_base: RawPose,
    /// Fastest feed.
    #[garde(range(min = 0.1, max = 200.0))]
    pub max_feed_mm_s: f64,
    /// Acceleration and deceleration of the feed.
    #[garde(range(min = 1.0, max = 10000.0))]
    pub max_acceleration_mm_s2: f64,
    /// Longest insertion.
    #[garde(range(min = 1.0, max = 500.0))]
    pub max_depth_mm: f64,
    /// Feed stops for good when the force on the needle exceeds this.
    #[garde(range(min = 0.1, max = 200.0))]
    pub max_force_n: f64,
    /// Feed stops when no valid command came for this long.
    #[garde(range(min = 1, max = 10000))]
    pub watchdog_ms: u64,
}
