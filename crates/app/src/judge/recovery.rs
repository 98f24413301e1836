//! Losses as the tracker declared them, and what came of its recoveries.

use sonoloop_types::{TICKS_PER_SECOND, TrackState};

use super::Facts;
use super::tracking::is_wrong;
use crate::record::ImageRow;

/// What the tracker's own LOST and TRACKING were worth.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(super) struct Declared {
    /// LOST → TRACKING, visible and within 2 mm.
    pub recoveries: u64,
    /// LOST → TRACKING, not visible or more than 2 mm off.
    pub false_recoveries: u64,
    /// LOST declared while visible.
    pub false_losses: u64,
    /// The longest time from LOST to a right recovery.
    pub recovery_time_s: Option<f64>,
}

/// Reads the states image by image. RECOVERING belongs to LOST. A missing answer changes nothing: LOST
/// before and after it is one episode, and LOST after it (a restarted tracker) is no false loss. Each
/// episode that ends in TRACKING counts once, whatever follows.
pub(super) fn declared(images: &[ImageRow], facts: &Facts) -> Declared {
    let mut declared = Declared::default();
    let mut in_episode = false;
    let mut tracker_was_down = false;
    // Runs on through a false recovery: the tip is found only when it is rightly found.
    let mut lost_since_tick = None;
    for row in images {
        let publication_tick = row.acquisition.publication_tick;
        match row.state() {
            None | Some(TrackState::Searching) => {}
            Some(TrackState::Lost | TrackState::Recovering) => {
                if !in_episode && !tracker_was_down && row.truth.visible {
                    declared.false_losses += 1;
                }
                in_episode = true;
                lost_since_tick.get_or_insert(publication_tick);
            }
            Some(TrackState::Tracking) => {
                let wrong = is_wrong(row, facts);
                if in_episode && wrong {
                    declared.false_recoveries += 1;
                } else if in_episode {
                    declared.recoveries += 1;
                    if let Some(since_tick) = lost_since_tick {
                        let ticks = publication_tick.saturating_sub(since_tick);
                        let time_s = ticks as f64 / TICKS_PER_SECOND as f64;
                        declared.recovery_time_s =
                            Some(declared.recovery_time_s.map_or(time_s, |longest| longest.max(time_s)));
                    }
                }
                in_episode = false;
                if !wrong {
                    lost_since_tick = None;
                }
            }
        }
        tracker_was_down = row.command.is_none();
    }
    declared
}
