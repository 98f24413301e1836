//! The authors' earlier method, as a baseline: the needle is localised in every image, and its tip smoothed.
//!
//! Gabor filter (Kaya and Bebek, the paper's reference 8) → automatic threshold and tip by probability along the
//! line (reference 9) → bin packing and Kalman filter (reference 10), with RANSAC for the line. The papers give the
//! parts and not every number, so filters, thresholds and noise are chosen here and documented where they stand.
//!
//! The paper's introduction says what is wrong with it, and the tests show it: it has no memory of what its needle
//! looked like, so in misalignment it takes the next best bright line for the needle and goes on TRACKING. It is
//! there for comparison, and to find the first tip for a [`Tracker`](crate::Tracker) without a click.
//!
//! ```
//! use sonoloop_tracker::baseline::{Insertion, localize};
//! use sonoloop_types::Image;
//!
//! // A needle 5 px wide from the left border down to (200, 120).
//! let mut image = Image::from_pixels(320, 240, vec![60; 320 * 240]).expect("as many pixels as its size");
//! for u in 0..200 {
//!     let axis = 20 + u / 2;
//!     (axis - 2..=axis + 2).for_each(|v| image.pixels[v * 320 + u] = 200);
//! }
//! let needle = localize(&image, Insertion::default()).expect("a needle");
//! assert!((needle.tip_px[0] - 200.0).abs() < 4.0 && (needle.tip_px[1] - 120.0).abs() < 4.0);
//! ```

mod gabor;
mod half;
mod kalman;
mod line;
mod localize;
mod packing;
mod profile;
mod threshold;
mod tip;
mod tracker;

pub use localize::{Entry, Insertion, Localized, Localizer, localize};
pub use tracker::{BRIDGED_IMAGES, BaselineTracker};
