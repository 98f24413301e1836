//! The nouns that travel between sonoloop's stages, one concept per file.
//!
//! `scenario → world → Slice → ultrasound → Image ══wire══> tracker → Estimate → servo → Command
//! ══wire══> world`. SI units and radians throughout, `f64` for poses and control, `f32` for pixels.
//! Transforms are named `a_from_b`; adjacent names cancel.

mod acquisition;
mod command;
mod disc;
mod drag;
mod estimate;
mod event;
mod geometry;
mod image;
mod indentation;
mod needle;
mod probe;
mod settings;
mod setup;
mod slice;
mod tissue;
mod truth;

pub use acquisition::{Acquisition, ArmStatus, CommandReceipt, Refusal};
pub use command::{Command, EndReason};
pub use disc::Disc;
pub use drag::Drag;
pub use estimate::{Confirmation, Estimate, Reason, TrackState};
pub use event::{Event, EventKind};
pub use geometry::{ImageGeometry, View};
pub use image::Image;
pub use indentation::Indentation;
pub use needle::{NeedlePath, NeedleSpec};
pub use probe::{Effects, ElevationSample, Precision, ProbeSpec};
pub use settings::{
    Guess, Init, Method, Optimisation, Profile, SearchPattern, ServoSettings, Similarity, TrackerSettings,
    UpdateStrategy, Warp,
};
pub use setup::{Limits, Setup};
pub use slice::Slice;
pub use tissue::{Acoustics, ColumnSegment, Tissue};
pub use truth::Truth;

/// A rigid transform between two frames, named `a_from_b`.
pub type Pose = nalgebra::Isometry3<f64>;
/// A point; its name ends in the frame it is given in.
pub type Point = nalgebra::Point3<f64>;
/// A direction or displacement; its name ends in the frame it is given in.
pub type Vector = nalgebra::Vector3<f64>;

/// Simulated time runs in ticks of one millisecond.
pub const TICKS_PER_SECOND: u64 = 1000;
