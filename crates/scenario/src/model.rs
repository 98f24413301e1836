//! The checked scenario: SI units and radians, every bound already held. Nothing downstream checks again.

use std::path::PathBuf;

use serde::{Deserialize, Serialize};
use sonoloop_types::{
    Acoustics, Limits, NeedleSpec, Point, Pose, ProbeSpec, ServoSettings, TrackerSettings, Vector, View,
};

/// One experiment, resolved for one seed.
#[derive(Debug, Clone)]
pub struct Scenario {
    /// Short name, also of the output.
    pub name: String,
    /// One sentence for lists and reports.
    pub description: String,
    /// The file it came from.
    pub source: PathBuf,
    /// Seed of everything random in the run.
    pub seed: u64,
    /// Longest simulated time, in ticks.
    pub duration_ticks: u64,
    /// The run ends after this many images; `None`: with the needle at rest at its target.
    pub images: Option<u64>,
    /// Ticks between images; divides the tick rate.
    pub image_period_ticks: u64,
    /// Lateral or transverse.
    pub view: View,
    /// The arm that carries the probe.
    pub arm: ArmSpec,
    /// The robot that holds and feeds the needle.
    pub needle_robot: NeedleRobotSpec,
    /// The probe and its scanner.
    pub probe: ProbeSpec,
    /// The needle.
    pub needle: NeedleSpec,
    /// The phantom.
    pub phantom: PhantomSpec,
    /// Where the needle goes.
    pub insertion: InsertionSpec,
    /// How the probe stands at the start.
    pub placement: PlacementSpec,
    /// Errors of calibration that are drawn from the seed and told to nobody.
    pub calibration: CalibrationSpec,
    /// Bounds of commands.
    pub limits: Limits,
    /// Tracker settings.
    pub tracker: TrackerSettings,
    /// Servo settings.
    pub servo: ServoSettings,
    /// Delays of image and command.
    pub delays: DelaySpec,
    /// What goes wrong and when, by ascending tick.
    pub disturbances: Vec<Disturbance>,
    /// What must hold at the end.
    pub expect: Vec<Expectation>,
    /// The file as resolved (overrides and draws applied), YAML.
    pub resolved_yaml: String,
}

/// A six-joint arm read from URDF, and where it stands.
#[derive(Debug, Clone)]
pub struct ArmSpec {
    /// Name shown in reports.
    pub name: String,
    /// The robot description, parsed and checked: six actuated joints between the two links.
    pub urdf: urdf_rs::Robot,
    /// Name of the link that is the `base` frame.
    pub base_link: String,
    /// Name of the link that is the `flange` frame.
    pub flange_link: String,
    /// Names of the six actuated joints from base to flange.
    pub joint_names: [String; 6],
    /// Where the base stands.
    pub world_from_base: Pose,
    /// Nominal mount of the probe.
    pub flange_from_probe: Pose,
    /// Joint angles from which the inverse kinematics starts.
    pub home_rad: [f64; 6],
    /// Acceleration limit of every joint.
    pub max_acceleration_rad_s2: f64,
    /// Jerk limit of every joint.
    pub max_jerk_rad_s3: f64,
    /// Parameters of the analytic inverse kinematics, when the wrist allows it.
    pub opw: Option<OpwSpec>,
}

/// Ortho-parallel base, spherical wrist: Brandstötter et al. 2014's parameters.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct OpwSpec {
    /// a1, a2, b, c1, c2, c3, c4 in metres.
    pub lengths_m: [f64; 7],
    /// Joint offsets.
    pub offsets_rad: [f64; 6],
    /// Joint signs, ±1.
    pub signs: [i8; 6],
}

/// The robot that holds the needle by its hub and feeds it: three slides, then two turns.
#[derive(Debug, Clone)]
pub struct NeedleRobotSpec {
    /// Name shown in reports.
    pub name: String,
    /// The robot description, parsed and checked: three prismatic and two revolute joints between the two links.
    pub urdf: urdf_rs::Robot,
    /// Name of the link that is the robot's base frame.
    pub base_link: String,
    /// Name of the link that holds the hub: origin where the needle begins, z along the needle.
    pub hub_link: String,
    /// Names of the five actuated joints from base to hub.
    pub joint_names: [String; 5],
    /// Where the base stands, nominally.
    pub world_from_base: Pose,
    /// Fastest feed.
    pub max_feed_m_s: f64,
    /// Acceleration and deceleration of the feed.
    pub max_acceleration_m_s2: f64,
    /// Longest insertion.
    pub max_depth_m: f64,
    /// Feed stops for good when the force on the needle exceeds this.
    pub max_force_n: f64,
    /// Feed stops when no valid command came for this long.
    pub watchdog_ticks: u64,
}

/// A block of tissue mimic with inclusions.
#[derive(Debug, Clone, PartialEq)]
pub struct PhantomSpec {
    /// Name shown in reports.
    pub name: String,
    /// Extent along x, y, z.
    pub size_m: [f64; 3],
    /// Index of the background material.
    pub background: u16,
    /// Materials, background and inclusions count into this list.
    pub materials: Vec<Material>,
    /// Inclusions; where two overlap the later one counts.
    pub inclusions: Vec<Inclusion>,
}

/// One material.
#[derive(Debug, Clone, PartialEq)]
pub struct Material {
    /// Name in the materials file.
    pub name: String,
    /// What sound meets.
    pub acoustics: Acoustics,
    /// Young's modulus; `None` for liquids, which bear no probe.
    pub youngs_modulus_pa: Option<f64>,
    /// How a needle gets through; `None` where none does.
    pub needle: Option<PassageSpec>,
}

/// How a material lets a needle through. Forces are those on a 22G needle.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PassageSpec {
    /// Friction on the shaft per buried length.
    pub friction_n_m: f64,
    /// Force on the tip while it cuts.
    pub cutting_n: f64,
    /// Force on the tip at which it pierces the material's face.
    pub puncture_n: f64,
    /// a₁ of the force a₁x + a₂x² on a face that has given way by x.
    pub stiffness_n_m: f64,
    /// a₂ of the same.
    pub stiffening_n_m2: f64,
    /// Distance from the tip at which 1/e of what it carries along is left.
    pub drag_decay_m: f64,
    /// Share of the needle's own curvature that its bevel steers into.
    pub bending: f64,
}

impl PassageSpec {
    /// How far the face gives way until it is pierced, for a tip that comes with a force of `from_n`: the root of
    /// from + a₁x + a₂x² = puncture. 0 where `from_n` is enough, infinite where the face yields without force.
    pub fn dent_m(&self, from_n: f64) -> f64 {
        let missing_n = self.puncture_n - from_n;
        if missing_n <= 0.0 {
            return 0.0;
        }
        let (a1, a2) = (self.stiffness_n_m, self.stiffening_n_m2);
        // Citardauq form: no difference of near numbers, and good for a₂ = 0.
        2.0 * missing_n / (a1 + (a1 * a1 + 4.0 * a2 * missing_n).sqrt())
    }
}

/// A body inside the phantom.
#[derive(Debug, Clone, PartialEq)]
pub struct Inclusion {
    /// Name shown in errors and reports.
    pub name: String,
    /// Its shape about its own origin.
    pub shape: Shape,
    /// Where it lies.
    pub phantom_from_inclusion: Pose,
    /// Index of its material.
    pub material: u16,
}

/// Shapes of inclusions, centred on their own origin.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Shape {
    /// Half axes along x, y, z.
    Ellipsoid {
        /// Half axes.
        radii_m: [f64; 3],
    },
    /// Axis along z.
    Cylinder {
        /// Radius.
        radius_m: f64,
        /// Whole length.
        length_m: f64,
    },
    /// Edges along x, y, z.
    Cuboid {
        /// Whole edge lengths.
        size_m: [f64; 3],
    },
}

/// Where the needle goes, nominally.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct InsertionSpec {
    /// Entry on the phantom's top face, world frame.
    pub entry_in_world: Point,
    /// Unit direction of the needle, world frame (z < 0).
    pub axis_in_world: Vector,
    /// Turn of the bevel about the needle's axis; 0 bends in the vertical plane of the needle.
    pub bevel_roll_rad: f64,
    /// Depth along the needle at the start.
    pub start_depth_m: f64,
    /// Depth along the needle at which the target lies.
    pub target_depth_m: f64,
    /// Success: the tip ends within this distance of the target.
    pub target_tolerance_m: f64,
    /// The hand that inserts the needle, where the needle robot does not.
    pub hand: Option<HandSpec>,
}

/// A hand that inserts the needle. Pairs are least and largest.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct HandSpec {
    /// Speed while it pushes.
    pub speed_m_s: [f64; 2],
    /// Time that it pushes between two pauses.
    pub pause_every_s: [f64; 2],
    /// Length of a pause.
    pub pause_s: [f64; 2],
    /// Amplitude of the tremor at the hub, along each axis across the needle.
    pub tremor_m: f64,
    /// Amplitude of the slow swings at the hub, likewise.
    pub swing_m: f64,
    /// Time from a cue to its effect.
    pub reaction_ticks: [u64; 2],
}

/// How the operator has placed the probe.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PlacementSpec {
    /// Where the tip stands in the picture at the start, lateral offset from the middle.
    pub tip_lateral_m: f64,
    /// Set force of the contact controller.
    pub contact_force_n: f64,
    /// Turn of the picture about the probe's axis away from the view's own direction.
    pub yaw_rad: f64,
    /// Tilt about the array (x): the plane leans in elevation.
    pub tilt_rad: f64,
    /// Standard deviation of the operator's misalignment of plane and tip.
    pub alignment_sigma_m: f64,
    /// Standard deviation of the operator's misalignment in yaw.
    pub alignment_sigma_rad: f64,
}

/// Standard deviations of hidden errors; each run draws them from its seed.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CalibrationSpec {
    /// Needle entry, each axis.
    pub needle_sigma_m: f64,
    /// Needle direction.
    pub needle_sigma_rad: f64,
    /// Probe mount, each axis.
    pub probe_sigma_m: f64,
    /// Probe mount's orientation.
    pub probe_sigma_rad: f64,
    /// Needle robot's base as the arm's base sees it, each axis: the robot-to-robot calibration.
    pub robot_sigma_m: f64,
    /// Orientation of the needle robot's base.
    pub robot_sigma_rad: f64,
    /// Noise of each of the arm's joint encoders, per image.
    pub encoder_sigma_rad: f64,
    /// Noise of the needle robot's measured depth, per image.
    pub encoder_sigma_m: f64,
    /// Operator's click on the tip, each axis.
    pub click_sigma_px: f64,
    /// Noise of the measured force.
    pub force_sigma_n: f64,
}

/// Delays between world and tracker.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct DelaySpec {
    /// From taking a picture to handing it out.
    pub image_ticks: u64,
    /// From the answer to its effect, ≥ 1.
    pub command_ticks: u64,
}

/// One thing that goes wrong.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Disturbance {
    /// When.
    pub tick: u64,
    /// What.
    pub kind: DisturbanceKind,
}

/// The kinds of disturbance.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum DisturbanceKind {
    /// The probe slips in its holder: the true mount changes by `offset` (in the probe frame) over
    /// `duration_ticks`; no measured value shows it.
    ProbeKnock {
        /// Probe before the slip from probe after it.
        probe_from_slipped: Pose,
        /// How long the slip takes.
        duration_ticks: u64,
    },
    /// The probe is lifted off the surface and put back.
    LiftOff {
        /// Height above the surface.
        height_m: f64,
        /// How long it stays up.
        duration_ticks: u64,
    },
    /// The receiver's gain steps.
    GainChange {
        /// New gain on top of the probe's own.
        gain_db: f64,
    },
    /// The needle's echo steps.
    NeedleBrightness {
        /// New level on top of the needle's own.
        gain_db: f64,
    },
    /// The tracker is killed without warning and started again.
    TrackerKilled {
        /// How long it is gone.
        down_ticks: u64,
    },
    /// From now on pictures arrive later.
    ImageDelay {
        /// New image delay.
        image_ticks: u64,
    },
    /// From now on commands take effect later.
    CommandDelay {
        /// New command delay, ≥ 1.
        command_ticks: u64,
    },
    /// Gel is missing under a part of the array.
    GelLost {
        /// Left end along the array, from its middle.
        from_m: f64,
        /// Right end.
        to_m: f64,
        /// Air between elements and surface.
        gap_m: f64,
        /// How long until it is filled again.
        duration_ticks: u64,
    },
    /// The receiver's electronic noise steps.
    Noise {
        /// New noise on top of the probe's own.
        gain_db: f64,
    },
    /// Something between probe and surface takes sound from a part of the array.
    Shadow {
        /// Its middle along the array, from the array's.
        x_m: f64,
        /// Its length along the array.
        width_m: f64,
        /// Loss of sound that passes it there and back.
        loss_db: f64,
        /// How long it is there.
        duration_ticks: u64,
    },
    /// The scanner hands out the last picture again; measurements go on.
    FrozenImages {
        /// How long.
        duration_ticks: u64,
    },
    /// Pictures are lost before they are published.
    DroppedImages {
        /// Share of them, 0…1; which, the seed draws.
        share: f64,
        /// How long.
        duration_ticks: u64,
    },
    /// The arm stops and obeys nothing, then goes on.
    ArmStall {
        /// How long.
        duration_ticks: u64,
    },
    /// The tracker gets images and does not answer.
    TrackerHung {
        /// How long.
        duration_ticks: u64,
    },
    /// What the tracker sends is garbage, drawn from the seed.
    TrackerGarbage {
        /// How long.
        duration_ticks: u64,
    },
    /// The phantom moves.
    PhantomMoves(PhantomMotion),
}

/// How the phantom moves as a whole; vectors in the world frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum PhantomMotion {
    /// To and fro until the end of the run, ½(1 − cos) of the time.
    Breathing {
        /// From one end of a breath to the other.
        reach_m: Vector,
        /// One breath.
        period_ticks: u64,
        /// Where in a breath it begins; 0 is the end that all others lie along `reach_m` from.
        phase_rad: f64,
    },
    /// Slowly aside.
    Drift {
        /// How fast.
        velocity_m_s: Vector,
        /// For how long.
        duration_ticks: u64,
    },
    /// Aside, once.
    Step {
        /// How far.
        shift_m: Vector,
        /// How long it takes.
        duration_ticks: u64,
    },
}

/// A bound on one metric.
#[derive(Debug, Clone, PartialEq)]
pub struct Expectation {
    /// Name of the metric as in `summary.json`.
    pub metric: String,
    /// What it must keep.
    pub bound: Bound,
}

/// What a metric must keep. A metric without a value keeps nothing.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(untagged)]
pub enum Bound {
    /// Equal to a truth value (`success: true`).
    Is(bool),
    /// Within [min, max], either end open.
    Range {
        /// Least value.
        #[serde(skip_serializing_if = "Option::is_none")]
        min: Option<f64>,
        /// Largest value.
        #[serde(skip_serializing_if = "Option::is_none")]
        max: Option<f64>,
    },
}
