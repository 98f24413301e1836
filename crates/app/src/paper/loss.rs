//! Figs 5 and 6: a loss and its recovery, image by image.

use sonoloop_tracker::Context;
use sonoloop_types::{Profile, TrackState, TrackerSettings};

use super::sequence::Sequence;
use super::updates::begin;
use crate::error::AppError;

/// The loss that the figures show.
pub(super) struct Loss {
    /// Images (a) tracked, (b) the loss declared, (c) the search, (d) tracked again.
    pub marks: [usize; 4],
    /// NCC with T_n that the paper's configuration gives on the same pictures.
    pub paper_ncc: Vec<Option<f64>>,
    /// Where that configuration says at the end that the tip is: the distance from there; `None` where it says lost.
    pub paper_off_mm: Option<f64>,
}

/// How long before the loss (a) is.
const BEFORE_IMAGES: usize = 10;

/// The longest loss that was recovered from; `None` where there is none.
pub(super) fn loss(sequence: &Sequence) -> Result<Option<Loss>, AppError> {
    let ended = sequence.lost_stretches().into_iter().filter(|(_, end)| *end < sequence.rows.len());
    let Some((first, end)) = ended.max_by_key(|(first, end)| end - first) else { return Ok(None) };
    let marks = [first.saturating_sub(BEFORE_IMAGES), first, (first + end) / 2, end];
    let (paper_ncc, paper_off_mm) = paper(sequence)?;
    Ok(Some(Loss { marks, paper_ncc, paper_off_mm }))
}

fn paper(sequence: &Sequence) -> Result<(Vec<Option<f64>>, Option<f64>), AppError> {
    let mut tracker = begin(sequence, TrackerSettings::profile(Profile::Paper, 20))?;
    let mut values = vec![Some(1.0)];
    for index in 1..sequence.rows.len() {
        let image = sequence.image(index)?;
        values.push(tracker.track(&image, &Context::default()).ncc_previous);
    }
    let [true_u, true_v] = sequence.rows[sequence.rows.len() - 1].truth.reference_px;
    let [u, v] = tracker.tip_px();
    let spacing_mm = sequence.scenario.probe.geometry.spacing_m * 1e3;
    let is_tracking = tracker.state() == TrackState::Tracking;
    Ok((values, is_tracking.then(|| (u - true_u).hypot(v - true_v) * spacing_mm)))
}
