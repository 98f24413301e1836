//! What a run leaves in memory: one row per tick, one per image, the events, and how long things took.

mod hash;
mod store;

pub use hash::{image_hash, xxh64};
pub use store::ImageStore;

use sonoloop_scenario::Scenario;
use sonoloop_types::{Acquisition, Command, EndReason, Event, TrackState, Truth};

/// What really was the case at one tick; the part of [`Truth`] that the judge and the plots need.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TickRow {
    /// Tick of all values below.
    pub tick: u64,
    /// The tip is within the slice, inside the picture, and enough of its aperture in contact.
    pub visible: bool,
    /// Signed distance of the tip from the plane.
    pub plane_to_tip_m: f64,
    /// True insertion depth along the needle.
    pub depth_m: f64,
    /// True speed of the needle along its axis.
    pub feed_m_s: f64,
    /// True contact force along the probe's axis.
    pub contact_force_n: f64,
    /// True force on the needle against the insertion.
    pub needle_force_n: f64,
    /// Smallest distance of any joint to its limit; negative beyond it.
    pub min_joint_margin_rad: f64,
    /// Distance of the tip from the target.
    pub target_distance_m: f64,
    /// Any collision other than probe on phantom.
    pub collision: bool,
}

impl From<&Truth> for TickRow {
    fn from(truth: &Truth) -> Self {
        Self {
            tick: truth.tick,
            visible: truth.visible,
            plane_to_tip_m: truth.plane_to_tip_m,
            depth_m: truth.depth_m,
            feed_m_s: truth.feed_m_s,
            contact_force_n: truth.contact_force_n,
            needle_force_n: truth.needle_force_n,
            min_joint_margin_rad: truth.min_joint_margin_rad,
            target_distance_m: truth.target_distance_m,
            collision: truth.collision,
        }
    }
}

/// One image, what really was the case when it was taken, and the answer to it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ImageRow {
    /// What the rig measured with the image.
    pub acquisition: Acquisition,
    /// [`image_hash`] of its pixels.
    pub hash: u64,
    /// The truth at the image's acquisition tick.
    pub truth: Truth,
    /// The answer to this image; `None` while the tracker is down, and where it never came.
    pub command: Option<Command>,
    /// When this image was handed out: how long ago the image was taken that the command in effect answers.
    pub command_age_ticks: u64,
}

impl ImageRow {
    /// What the tracker said of its target in answer to this image; `None` while it is down.
    pub fn state(&self) -> Option<TrackState> {
        self.command.map(|command| command.estimate.state)
    }

    /// True when the tracker claims to see the tip in this image.
    pub fn is_tracking(&self) -> bool {
        self.state() == Some(TrackState::Tracking)
    }
}

/// A whole run in memory, by ascending tick and sequence number.
#[derive(Debug)]
pub struct Recording {
    /// One row per tick.
    pub ticks: Vec<TickRow>,
    /// One row per image.
    pub images: Vec<ImageRow>,
    /// What happened.
    pub events: Vec<Event>,
    /// Why the run ended.
    pub end: EndReason,
    /// How long things took.
    pub timing: Timing,
    /// The pictures, in the order of `images`; kept only when something asks for them.
    pub pixels: Option<ImageStore>,
    /// The scenario with the disturbances that observers added, which gives the same run again; `None` when nobody
    /// did.
    pub disturbed: Option<Scenario>,
}

/// How long things took by the clock; goes to the summary, never to a file that runs are compared by.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Timing {
    /// Rendering, ms, one entry per image.
    pub render_ms: Vec<f32>,
    /// Stepping the world, ms, one entry per image (all ticks up to it).
    pub physics_ms: Vec<f32>,
    /// Tracking and servoing, µs, one entry per answer.
    pub track_us: Vec<f32>,
    /// From handing out the image to receiving the answer, less the tracker's own time, µs. Pictures are kept meanwhile, and if that
    /// takes longer, it counts.
    pub wire_us: Vec<f32>,
    /// From the first image published to the last answer.
    pub wall_s: f64,
    /// Simulated time over the same stretch.
    pub simulated_s: f64,
    /// Farthest that simulated time fell behind the clock, in ticks, for a run that was paced by it.
    pub behind_ticks: Option<u64>,
}
