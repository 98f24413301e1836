//! Needle-tip tracking in B-mode images: an image in, an [`Estimate`](sonoloop_types::Estimate) out.
//!
//! The method is that of Kaya, Senel, Ahmad and Bebek, "Visual Tracking of Biopsy Needles in 2D Ultrasound Images", corrected
//! where it does not hold, and completed where a tip is lost silently. The tracker knows pictures, and what [`Context`] tells
//! it of measured motion; it knows no arm, no needle robot and no simulator. It runs on recordings as it does in the loop.
//!
//! ```
//! use sonoloop_tracker::{Context, Tracker};
//! use sonoloop_types::{Image, Profile, TrackState, TrackerSettings};
//!
//! // A bright spot over a wavy ground that stands still, three pixels further in every image.
//! let image = |k: u32| {
//!     let level = |u: f64, v: f64| {
//!         let (x, y) = (u - (60.0 + 3.0 * f64::from(k)), v - (50.0 + f64::from(k)));
//!         60.0 + 10.0 * (0.4 * u).sin() * (0.3 * v).cos() + 150.0 * (-(x * x / 18.0 + y * y / 10.0)).exp()
//!     };
//!     let pixels = (0..120).flat_map(|v| (0..200).map(move |u| level(u.into(), v.into()) as u8));
//!     Image::from_pixels(200, 120, pixels.collect()).expect("as many pixels as the size says")
//! };
//! let settings = TrackerSettings::profile(Profile::Robust, 20);
//! let mut tracker = Tracker::new(settings, &image(0), [60.0, 50.0])?;
//! for k in 1..30 {
//!     let estimate = tracker.track(&image(k), &Context::default());
//!     let [u, v] = estimate.tip_px.expect("a tip");
//!     let off_px = (u - (60.0 + 3.0 * f64::from(k))).hypot(v - (50.0 + f64::from(k)));
//!     assert!(estimate.state == TrackState::Tracking && off_px < 1.0);
//! }
//! // Without the spot the tracker says so, and searches.
//! let estimate = tracker.track(&image(1000), &Context::default());
//! assert_eq!(estimate.state, TrackState::Lost);
//! # Ok::<(), sonoloop_tracker::TrackerError>(())
//! ```
//!
//! # Registration
//!
//! Symbols: `T_1` the first template, the *anchor*; `T_n` the *previous* template; `S` the side of both in pixels; `x` a
//! template's pixel, centred on the tip, which is its middle; `a` the warp, a(x) = c + A·x, from there into the picture; `P`
//! the patch I∘a; `w` a weight; `Δ` the change of the whole image's median grey level since a template was taken.
//!
//! A registration minimises the sum of squared differences, paper (2), or of conditional variances, (11), over a translation,
//! a rigid or an affine motion ([`Warp`](sonoloop_types::Warp)):
//!
//! ```text
//! SSD  e(x) = P(x) − Δ − T(x)
//! SCV  e(x) = P(x) − T̂(x),   T̂ = E[P | T], from the joint histogram of P and T, (9) and (10)
//!
//! g = ∇P                first order,  (6)
//! g = ½(∇P + ∇T̂)        second order, (8) and (12)
//! H = Σ w (g ⊗ [x, y, 1]) (g ⊗ [x, y, 1])ᵀ,   b = Σ w e (g ⊗ [x, y, 1])
//! δ = −(H + λ diag H)⁻¹ b,   a ← a ∘ (I + δ)
//! ```
//!
//! For a translation only the 2×2 block of H is there, and λ is next to nothing. Rigid and affine steps are damped after
//! Levenberg and Marquardt; where the whole warp has no solution its translation is taken, and where that has none the state
//! is LOST with [`Reason::Singular`](sonoloop_types::Reason), never an error.
//!
//! After an image T_n becomes the new patch, held to T_1 (strategy 3,
//! [`UpdateStrategy`](sonoloop_types::UpdateStrategy)). The optimiser starts from a guess
//! ([`Guess`](sonoloop_types::Guess)), which coarser resolutions may improve where the tip moves by more than some 3 px per
//! image (`pyramid_levels`). Neither reaches the measurement.
//!
//! The paper reports more than 40 % less time for second order. Measured over rigid scenes, iterations of second over those of
//! first order, SSD, up to 3 px of motion per axis: 0.36 and 0.29 (`paper`, 61×61, translation and affine), 0.22 (`robust`,
//! 61×61), but 0.94 to 1.01 at 20×20, and between for SCV: it gains where an image moves by more than the width of what the
//! sums rest on, speckle of 1 to 2 px at 61×61 and a tip of 5 px at 20×20 (`tests/rigid.rs` has the table).
//!
//! # What the paper says, and what is done
//!
//! - (5) lacks a ½, and (7) should read H·Δp ≈ J(p₀) − J(p). With both, T = I + ½(J + J₀)Δp, so (8) is right as printed.
//! - J(p) is the gradient of the *warped* image in the template's coordinates. It goes with a composed step a ← a ∘ (I + δ),
//!   not with "accumulating Δp", which is the same for small translations only.
//! - ε = 0.01 on ‖Δp‖ mixes pixels with numbers without a unit: here it is the largest motion of a corner, in pixels.
//! - δ in (9) is one for equal bins. T̂(j) = E[P | T = j] is the direction that is meant.
//! - 256 bins on 400 pixels put one to three pixels into each, so that T̂ copies P and nothing is left to minimise. 16 bins
//!   serve 20×20, 32 serve 61×61; poor ones are merged, and T̂ is a broken line over the grey levels, not a staircase.
//! - Strategy 2 is T_{n+1} = I_n∘a_n. Strategy 3 lacks the acceptance test of Matthews, Ishikawa and Baker ("The template
//!   update problem", 2004): T_n is kept where T_1 does not agree.
//! - NCC = −1 means inverted contrast; unrelated is 0.
//! - Recovery at 0.75 below loss at 0.80 would be undone by the next image: T_n is refreshed on recovery, and its test held
//!   off for two images.
//! - A pure translation does not make an affine warp. Over speckle six degrees of freedom drift where two hold the tip.
//! - Needles over bright, still speckle are lost *silently*: the template slides onto the background, and NCC stays at 0.99.
//!   This is what the robust profile is for.
//!
//! # Profiles
//!
//! [`TrackerSettings::profile`](sonoloop_types::TrackerSettings::profile) names two sets of settings, and every setting can be
//! changed on top. `paper` is what the paper says. `robust`, the default, adds
//!
//! - a blur of σ 1.5 px, and a Gaussian weight of σ 3 px about the tip in all sums and all NCCs: only the tip is looked at;
//! - a second, unblurred and unweighted registration where the surroundings are seen to move *with* the tip (`refine`). On
//!   real wires in water it gives back what blur and weight cost, on rigid scenes its
//!   errors are 0.02 px (20×20) and 0.04 px (61×61), those of OpenCV's ECC 0.07 to 0.2 and 0.05. How a
//!   tip has turned is measured by it alone, so only where the surroundings turn along; without `refine`, always;
//! - a guess from the measured motion, or the velocity;
//! - Δ in the squared differences; an SCV that first comes near by plain differences, and takes T̂ anew when it has moved on;
//!   an end of the iteration when what is *left* is short. These go with the profile, and are no settings;
//! - LOST by NCC with T_n below 0.80, with T_1 below 0.70, or by a brightness test, since NCC ignores contrast: less than
//!   half of T_1's contrast is left, or less than nine tenths and the patch differs from T_1 by 0.80 of its contrast;
//! - recovery by a coarse NCC search near the last tip, which widens, and after ten images over the whole image, as far as the
//!   tip may be there; each candidate is refined to where its NCC with T_1 has a peak, held to both templates at 0.85 (T_n as it was when
//!   the tip might last have been found) and to the contrast of T_1, and three images in a row must confirm it.
//!
//! [`limits`] says over which backgrounds, and under what else, the tip is held, and where it is lost, `paper` beside it.
//! [`baseline`] holds the authors' earlier method, which localises the needle in every image by itself: to compare with, and
//! to find a first tip.
//!
//! The same images give the same bytes on every machine: sums run in one fixed order whatever the CPU's vectors are, and the
//! transcendental functions come from `libm`. After the first image of a size no image allocates memory.

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
