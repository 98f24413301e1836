//! Needle-tip tracking in B-mode images: an image in, an [`Estimate`](sonoloop_types::Estimate) out.
//!
//! The method is that of Kaya, Senel, Ahmad and Bebek, "Visual Tracking of Biopsy Needles in 2D Ultrasound
//! Images", with the corrections that its two profiles name
//! ([`TrackerSettings::profile`](sonoloop_types::TrackerSettings::profile)). The tracker knows pictures, and what
//! [`Context`] tells it of measured motion; it knows no arm, no needle robot and no simulator.
//!
//! A template moves by a translation, turns too, or is sheared and scaled
//! ([`Warp`](sonoloop_types::Warp)). Steps are composed in the template's coordinates, a ← a ∘ (I + Δ), where its gradients
//! are known; the paper's "accumulating Δp" is the same for small translations only. The tip is the template's middle.
//!
//! The optimiser starts from a guess ([`Guess`](sonoloop_types::Guess)), which coarser resolutions may improve where the tip
//! moves by more than some 3 px per image (`pyramid_levels`). Neither reaches the measurement.
//!
//! Symbols: `T_1` the first template, the *anchor*; `T_n` the *previous* template; `S` the side of both in pixels;
//! `P` the patch of the current image under the template; `w` the Gaussian weight about the tip; `Δ` the change of
//! the whole image's median grey level since a template was taken.
//!
//! [`baseline`] holds the authors' earlier method, which localises the needle in every image by itself: to compare
//! with, and to find a first tip.
//!
//! [`limits`] says over which backgrounds, and under what else, the tip is held, and where it is lost.
//!
//! The same images give the same bytes on every machine: sums run in one fixed order, and the transcendental
//! functions come from `libm`.

pub mod baseline;
mod checkpoint;
mod error;
mod gaussian;
mod grey;
mod guess;
mod hysteresis;
mod kalman;
mod likeness;
#[doc = include_str!("../docs/where_it_breaks.md")]
pub mod limits {}
mod lost;
mod pyramid;
mod refine;
mod region;
mod register;
mod scv;
mod search;
mod settings;
mod shaft;
mod snap;
mod sums;
mod template;
mod tracker;
mod warp;
mod warped;
mod window;

pub use checkpoint::{Checkpoint, SavedTemplate};
pub use error::TrackerError;
pub use settings::check_settings;
pub use snap::snap_to_peak;
pub use tracker::{Context, Tracker};
