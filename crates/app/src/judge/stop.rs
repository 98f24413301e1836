//! How soon the needle stands after the tracker has declared a loss.

use sonoloop_types::{TICKS_PER_SECOND, TrackState};

use super::loss::STANDING_BELOW_M_S;
use crate::record::Recording;

/// Longest time from the publication of an image whose answer declares LOST to the needle's rest; `None` when no loss was
/// declared. One that is taken back before the needle stands asks for no stop; one at the end of the run counts up to there.
pub(super) fn stop_delay_s(recording: &Recording) -> Option<f64> {
    let mut longest: Option<u64> = None;
    let mut episode = Episode::None;
    let mut answers = recording.images.iter().peekable();
    for row in &recording.ticks {
        while let Some(answer) = answers.next_if(|answer| answer.acquisition.publication_tick <= row.tick) {
            episode = match (answer.state(), episode) {
                (Some(TrackState::Lost), Episode::None) => {
                    Episode::Declared { tick: answer.acquisition.publication_tick }
                }
                (Some(TrackState::Tracking | TrackState::Searching), _) => Episode::None,
                _ => episode,
            };
        }
        if let Episode::Declared { tick } = episode
            && row.feed_m_s.abs() <= STANDING_BELOW_M_S
        {
            longest = longest.max(Some(row.tick.saturating_sub(tick)));
            episode = Episode::Stands;
        }
    }
    if let (Episode::Declared { tick }, Some(last)) = (episode, recording.ticks.last()) {
        longest = longest.max(Some(last.tick.saturating_sub(tick)));
    }
    longest.map(|ticks| ticks as f64 / TICKS_PER_SECOND as f64)
}

/// Where a declared loss has got to.
#[derive(Clone, Copy)]
enum Episode {
    None,
    Declared { tick: u64 },
    Stands,
}
