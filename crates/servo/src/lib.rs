//! Estimate → Command: follow the tip, stop the needle on a loss, search with the arm, resume.
//!
//! One law per file: [`slide`] keeps the tip in a lateral picture, [`hold`] keeps a lateral plane on the tip, [`along`] keeps a
//! transverse plane on it, [`search`] looks for a lost tip, [`feed`] drives the needle. [`Servo`] decides which of them speaks.
//! Nothing here knows more than a real rig would tell it: measured poses under nominal calibrations, measured
//! depth, and the tracker's estimate.

pub mod along;
pub mod feed;
pub mod hold;
pub mod predict;
pub mod search;
mod servo;
pub mod slide;

pub use servo::{Guidance, Mode, Servo, ServoState};
