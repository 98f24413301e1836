//! Estimate → Command: follow the tip, stop the needle on a loss, search with the arm, resume.
//!
//! One law per file: [`follow`] keeps the tip in the picture, [`hold`] keeps the plane on the tip,
//! [`search`] looks for a lost tip, [`feed`] drives the needle. [`Servo`] decides which of them speaks.
//! Nothing here knows more than a real rig would tell it: measured poses under nominal calibrations, measured
//! depth, and the tracker's estimate.

pub mod feed;
pub mod follow;
pub mod hold;
pub mod predict;
pub mod search;
mod servo;

pub use servo::{Guidance, Mode, Servo, ServoState};
