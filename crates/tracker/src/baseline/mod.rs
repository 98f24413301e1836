//! The authors' earlier method, as a baseline: the needle is localised in every image, and its tip smoothed.
//!
//! Gabor filter → automatic threshold → bin packing → RANSAC line → tip by probability along the line → Kalman
//! filter: the paper's references 8 to 10, built from what the paper says of them, so filters, thresholds and noise
//! are chosen here and documented where they stand.
//!
//! The paper's introduction says what is wrong with it, and the tests show it: it has no memory of what its needle
//! looked like, so in misalignment it takes the next best bright line for the needle and goes on TRACKING. It is
//! there for comparison, and to find the first tip for a [`Tracker`](crate::Tracker) without a click.
//!
//! Measured on needles over still speckle (20 seeds that no number was chosen by, 3 angles, 5 places of the tip each;
//! background as in the tests, needle amplitude 6), single images of 640 × 480 px:
//!
//! | background | found | within 4 px | median along the needle | median across |
//! |---|---|---|---|---|
//! | 0.1 | 100 % | 100 % | 2.4 px beyond the tip | 0.1 px |
//! | 0.3 | 100 % | 98 % | 2.6 px beyond | 0.1 px |
//! | 0.5 | 100 % | 97 % | 2.7 px beyond | 0.1 px |
//! | 0.8 | 100 % | 92 % | 2.7 px beyond | 0.2 px |
//! | 1.0 | 100 % | 88 % | 2.8 px beyond | 0.2 px |
//!
//! Speckle alone was taken for a needle in none of 2160 images of such seeds. A line of a needle's width and brightness
//! was, in every image once the needle had left the plane; one that goes right across the picture (a fascia) is taken
//! even beside the needle. [`Insertion::angle_rad`] leaves out the directions in which such lines run.
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
mod line;
mod localize;
mod packing;
mod profile;
mod threshold;
mod tip;
mod tracker;

pub use localize::{Entry, Insertion, Localized, Localizer, localize};
pub use tracker::{BRIDGED_IMAGES, BaselineTracker};
