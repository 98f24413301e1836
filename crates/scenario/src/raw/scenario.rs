use std::collections::BTreeMap;

use garde::Validate;
use schemars::JsonSchema;
use serde::Deserialize;

use super::{RawBound, RawDisturbance, RawLimits, RawRandomize, RawServo, RawTracker};

/// One experiment. Paths are relative to the file that names them.
#[derive(Debug, Clone, Deserialize, JsonSchema, Validate)]
#[serde(deny_unknown_fields)]
#[garde(allow_unvalidated)]
pub(crate) struct RawScenario {
    /// Short name, also of the output; the file's name when left out.
    #[serde(default)]
    #[garde(length(chars, min = 1, max = 80))]
    pub name: Option<String>,
    /// One sentence for lists and reports.
    #[garde(length(chars, min = 1, max = 400))]
    pub description: String,
    /// Seed of everything random in the run.
    pub seed: u64,
    /// Longest simulated time.
    #[garde(range(min = 0.1, max = 3600.0))]
    pub duration_s: f64,
    /// Ends the run after exactly this many images, also where the needle has been at its target for some time; when left out,
    /// the run ends with the needle at rest there.
    #[serde(default)]
    #[garde(inner(range(min = 1, max = 720000)))]
    pub images: Option<u32>,
    /// Images per second; divides the 1000 ticks of a second.
    #[serde(default = "default_image_rate")]
    #[garde(range(min = 1, max = 200))]
    pub image_rate_hz: u32,
    /// How the picture lies to the needle.
    pub view: RawView,
    /// The arm's file.
    #[garde(length(min = 1))]
    pub robot: String,
    /// The needle robot's file.
    #[garde(length(min = 1))]
    pub needle_robot: String,
    /// The probe's file.
    #[garde(length(min = 1))]
    pub probe: String,
    /// The needle's file.
    #[garde(length(min = 1))]
    pub needle: String,
    /// The phantom's file.
    #[garde(length(min = 1))]
    pub phantom: String,
    /// Where the needle goes.
    #[garde(dive)]
    pub insertion: RawInsertion,
    /// How the operator has placed the probe.
    #[serde(default)]
    #[garde(dive)]
    pub placement: RawPlacement,
    /// Standard deviations of the hidden errors that each seed draws.
    #[serde(default)]
    #[garde(dive)]
    pub calibration: RawCalibration,
    /// Bounds of commands.
    #[serde(default)]
    #[garde(dive)]
    pub limits: RawLimits,
    /// Tracker settings.
    #[serde(default)]
    #[garde(dive)]
    pub tracker: RawTracker,
    /// Servo settings.
    #[serde(default)]
    #[garde(dive)]
    pub servo: RawServo,
    /// Delays of image and command.
    #[serde(default)]
    #[garde(dive)]
    pub delays: RawDelays,
    /// What goes wrong, and when.
    #[serde(default)]
    #[garde(length(max = 1000), dive)]
    pub disturbances: Vec<RawDisturbance>,
    /// What each seed draws.
    #[serde(default)]
    #[garde(length(max = 100), dive)]
    pub randomize: Vec<RawRandomize>,
    /// Bounds on metrics that decide pass or fail.
    #[serde(default)]
    pub expect: BTreeMap<String, RawBound>,
}

fn default_image_rate() -> u32 {
    25
}

/// How the picture lies to the needle.
#[derive(Debug, Clone, Copy, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub(crate) enum RawView {
    /// The needle lies in the picture.
    Lateral,
    /// The needle crosses the picture.
    Transverse,
}

/// Where the needle goes, nominally.
#[derive(Debug, Clone, Deserialize, JsonSchema, Validate)]
#[serde(deny_unknown_fields)]
pub(crate) struct RawInsertion {
    /// Entry on the phantom's top face, x and y in the world frame.
    #[garde(inner(range(min = -500.0, max = 500.0)))]
    pub entry_mm: [f64; 2],
    /// Angle below the horizontal.
    #[garde(range(min = 5.0, max = 85.0))]
    pub angle_deg: f64,
    /// Direction seen from above: 0 along x, 90 along y.
    #[serde(default)]
    #[garde(range(min = -360.0, max = 360.0))]
    pub azimuth_deg: f64,
    /// Turn of the bevel about the needle; 0 bends in the needle's vertical plane.
    #[serde(default)]
    #[garde(range(min = -360.0, max = 360.0))]
    pub bevel_roll_deg: f64,
    /// Depth along the needle at the start.
    #[garde(range(min = 0.0, max = 500.0))]
    pub start_depth_mm: f64,
    /// Depth along the needle at which the target lies.
    #[garde(range(min = 0.1, max = 500.0))]
    pub target_depth_mm: f64,
    /// Success: the tip ends within this distance of the target.
    #[serde(default = "default_tolerance")]
    #[garde(range(min = 0.01, max = 50.0))]
    pub target_tolerance_mm: f64,
    /// A hand inserts the needle; the needle robot stands aside. There is no measured depth and no feed: go, slower and stop
    /// are cues.
    #[serde(default)]
    #[garde(dive)]
    pub manual: Option<RawManual>,
}

/// A hand that inserts the needle. Pairs are [least, largest].
#[derive(Debug, Clone, Deserialize, JsonSchema, Validate)]
#[serde(deny_unknown_fields, default)]
pub(crate) struct RawManual {
    /// Speed while it pushes.
    #[garde(inner(range(min = 0.1, max = 100.0)))]
    pub speed_mm_s: [f64; 2],
    /// Time that it pushes between two pauses.
    #[garde(inner(range(min = 0.1, max = 3600.0)))]
    pub pause_every_s: [f64; 2],
    /// Length of a pause.
    #[garde(inner(range(min = 0.0, max = 60.0)))]
    pub pause_s: [f64; 2],
    /// Amplitude of the tremor (8 to 12 Hz) at the hub, along each axis across the needle.
    #[garde(range(min = 0.0, max = 5.0))]
    pub tremor_mm: f64,
    /// Amplitude of the slow swings at the hub, likewise. The needle turns about its entry.
    #[garde(range(min = 0.0, max = 20.0))]
    pub swing_mm: f64,
    /// Time from a cue to its effect.
    #[garde(inner(range(min = 1, max = 5000)))]
    pub reaction_ms: [u64; 2],
}

impl Default for RawManual {
    fn default() -> Self {
        Self {
            speed_mm_s: [6.0, 14.0],
            pause_every_s: [1.5, 4.0],
            pause_s: [0.2, 0.8],
            tremor_mm: 0.2,
            swing_mm: 1.0,
            reaction_ms: [300, 600],
        }
    }
}

fn default_tolerance() -> f64 {
    2.0
}

/// How the operator has placed the probe.
#[derive(Debug, Clone, Deserialize, JsonSchema, Validate)]
#[serde(deny_unknown_fields, default)]
pub(crate) struct RawPlacement {
    /// Where the tip stands in the picture at the start, from the middle to the right.
    #[garde(range(min = -32.0, max = 32.0))]
    pub tip_lateral_mm: f64,
    /// Set force of the contact controller.
    #[garde(range(min = 0.05, max = 20.0))]
    pub contact_force_n: f64,
    /// Turn about the probe's axis away from the view's own direction.
    #[garde(range(min = -90.0, max = 90.0))]
    pub yaw_deg: f64,
    /// Tilt about the array: the plane leans in elevation.
    #[garde(range(min = -45.0, max = 45.0))]
    pub tilt_deg: f64,
    /// Standard deviation of the operator's misalignment of plane and tip.
    #[garde(range(min = 0.0, max = 10.0))]
    pub alignment_mm: f64,
    /// Standard deviation of the operator's misalignment in yaw.
    #[garde(range(min = 0.0, max = 20.0))]
    pub alignment_deg: f64,
}

impl Default for RawPlacement {
    fn default() -> Self {
        Self {
            tip_lateral_mm: 0.0,
            contact_force_n: 1.0,
            yaw_deg: 0.0,
            tilt_deg: 0.0,
            alignment_mm: 0.2,
            alignment_deg: 0.5,
        }
    }
}

/// Standard deviations of the hidden errors that each seed draws.
#[derive(Debug, Clone, Deserialize, JsonSchema, Validate)]
#[serde(deny_unknown_fields, default)]
pub(crate) struct RawCalibration {
    /// Needle entry, each axis.
    #[garde(range(min = 0.0, max = 20.0))]
    pub needle_mm: f64,
    /// Needle direction.
    #[garde(range(min = 0.0, max = 20.0))]
    pub needle_deg: f64,
    /// Probe mount, each axis.
    #[garde(range(min = 0.0, max = 20.0))]
    pub probe_mm: f64,
    /// Probe mount's orientation.
    #[garde(range(min = 0.0, max = 20.0))]
    pub probe_deg: f64,
    /// Needle robot's base as the arm's base sees it, each axis; comes on top of the needle's own error.
    #[garde(range(min = 0.0, max = 20.0))]
    pub robot_mm: f64,
    /// Orientation of the needle robot's base; some 0.4 m away, 0.1° are 0.8 mm at the entry.
    #[garde(range(min = 0.0, max = 5.0))]
    pub robot_deg: f64,
    /// Noise of each of the arm's joint encoders, drawn for every image.
    #[garde(range(min = 0.0, max = 1.0))]
    pub encoder_deg: f64,
    /// Noise of the needle robot's measured depth, drawn for every image.
    #[garde(range(min = 0.0, max = 5.0))]
    pub encoder_mm: f64,
    /// Operator's click on the tip, each axis.
    #[garde(range(min = 0.0, max = 50.0))]
    pub click_px: f64,
    /// Noise of the measured force.
    #[garde(range(min = 0.0, max = 5.0))]
    pub force_n: f64,
}

impl Default for RawCalibration {
    fn default() -> Self {
        Self {
            needle_mm: 2.0,
            needle_deg: 1.0,
            probe_mm: 2.0,
            probe_deg: 1.0,
            robot_mm: 0.0,
            robot_deg: 0.0,
            encoder_deg: 0.0,
            encoder_mm: 0.0,
            click_px: 1.0,
            force_n: 0.05,
        }
    }
}

/// Delays between world and tracker.
#[derive(Debug, Clone, Deserialize, JsonSchema, Validate)]
#[serde(deny_unknown_fields, default)]
pub(crate) struct RawDelays {
    /// From taking a picture to handing it out.
    #[garde(range(min = 0, max = 2000))]
    pub image_ms: u64,
    /// From the answer to its effect.
    #[garde(range(min = 1, max = 2000))]
    pub command_ms: u64,
}

impl Default for RawDelays {
    fn default() -> Self {
        Self { image_ms: 0, command_ms: 1 }
    }
}
