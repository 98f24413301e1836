//! Metrics and verdict: a recording in, numbers and pass or fail out. Judges with the truth, which no
//! tracker sees.

mod facts;
mod loss;
mod metrics;
mod recovery;
mod stop;
#[cfg(test)]
pub(crate) mod test_recording;
#[cfg(test)]
mod tests;
mod tracking;
mod verdict;

pub use facts::Facts;
pub use metrics::{Metrics, Value, metrics};
pub use tracking::{WRONG_BEYOND_M, tip_error_px};
pub use verdict::{Judged, passes, verdict};
