//! True losses: what really left the picture, when it was declared, and how far the needle still went.

use sonoloop_types::TICKS_PER_SECOND;

use super::Facts;
use super::tracking::is_wrong;
use crate::record::{ImageRow, Recording, TickRow};

/// The needle stands below this speed (0.01 mm/s, a thousandth of the usual feed).
pub(super) const STANDING_BELOW_M_S: f64 = 1e-5;

/// One loss: from the first tick that is not visible after having been, until the tip is visible again and
/// the tracker is TRACKING it (within 2 mm), or until the end of the run. Flickers in between belong to it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Loss {
    pub lost_tick: u64,
    /// When the tracker stopped claiming to see the tip; at once when it did not claim it anyway.
    pub declared_tick: Option<u64>,
    /// Depth of the needle at the loss.
    pub lost_depth_m: f64,
    /// Depth of the needle when it came to rest.
    pub stopped_depth_m: Option<f64>,
    /// End of the loss or of the run, and the depth there.
    pub closed_tick: u64,
    pub closed_depth_m: f64,
}

impl Loss {
    fn open(row: &TickRow, believed: bool) -> Self {
        Self {
            lost_tick: row.tick,
            declared_tick: (!believed).then_some(row.tick),
            lost_depth_m: row.depth_m,
            stopped_depth_m: None,
            closed_tick: row.tick,
            closed_depth_m: row.depth_m,
        }
    }

    /// From the loss to its declaration; to the end of the loss when nobody declared it.
    pub fn detection_delay_s(&self) -> f64 {
        let until = self.declared_tick.unwrap_or(self.closed_tick);
        until.saturating_sub(self.lost_tick) as f64 / TICKS_PER_SECOND as f64
    }

    /// Travel of the needle from the loss to its stop; to the end of the loss when it never stopped.
    pub fn travel_m(&self) -> f64 {
        self.stopped_depth_m.unwrap_or(self.closed_depth_m) - self.lost_depth_m
    }
}

/// All losses of a run. An answer counts from its image's publication tick.
pub(super) fn losses(recording: &Recording, facts: &Facts) -> Vec<Loss> {
    let mut losses = Vec::new();
    let mut open: Option<Loss> = None;
    let mut was_visible = false;
    let mut believed = false;
    let mut answers = recording.images.iter().peekable();
    for row in &recording.ticks {
        if was_visible && !row.visible && open.is_none() {
            open = Some(Loss::open(row, believed));
        }
        was_visible = row.visible;
        let mut regained = false;
        while let Some(answer) = answers.next_if(|answer| answer.acquisition.publication_tick <= row.tick) {
            believed = answer.is_tracking();
            regained = open.is_some_and(|loss| regains(answer, &loss, facts));
        }
        let Some(loss) = &mut open else { continue };
        if !believed {
            loss.declared_tick.get_or_insert(row.tick);
        }
        if row.feed_m_s.abs() <= STANDING_BELOW_M_S {
            loss.stopped_depth_m.get_or_insert(row.depth_m);
        }
        loss.closed_tick = row.tick;
        loss.closed_depth_m = row.depth_m;
        if regained && row.visible {
            losses.extend(open.take());
        }
    }
    losses.extend(open);
    losses
}

/// True when an answer rightly claims the tip in an image taken after the loss.
fn regains(answer: &ImageRow, loss: &Loss, facts: &Facts) -> bool {
    answer.acquisition.acquisition_tick > loss.lost_tick && answer.is_tracking() && !is_wrong(answer, facts)
}
