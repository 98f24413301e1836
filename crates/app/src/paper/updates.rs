//! Fig. 2: the three strategies of updating the template, on the pictures of one insertion.

use sonoloop_tracker::{Context, Tracker, TrackerError};
use sonoloop_types::{Profile, TrackerSettings, UpdateStrategy};

use super::sequence::Sequence;
use crate::error::AppError;

/// The strategies in the paper's order.
pub(super) const STRATEGIES: [(UpdateStrategy, &str); 3] = [
    (UpdateStrategy::None, "1: no update"),
    (UpdateStrategy::Naive, "2: naive update"),
    (UpdateStrategy::DriftCorrected, "3: drift-corrected"),
];

/// What each strategy says under one profile.
pub(super) struct Strategies {
    pub profile: Profile,
    /// By strategy: the tip in every image.
    pub tips_px: [Vec<[f64; 2]>; 3],
    /// By strategy: the distance to the true tip in every image; none where that is not visible.
    pub errors_px: [Vec<Option<f64>>; 3],
}

impl Strategies {
    /// By strategy: root mean square, and the last value.
    pub fn rms_and_last_px(&self) -> [(f64, f64); 3] {
        self.errors_px.each_ref().map(|errors| {
            let known: Vec<f64> = errors.iter().copied().flatten().collect();
            let rms = (known.iter().map(|e| e * e).sum::<f64>() / known.len().max(1) as f64).sqrt();
            (rms, known.last().copied().unwrap_or(f64::NAN))
        })
    }
}

/// Every strategy under both profiles. The tests for a loss are off, so that each goes its own way to the end.
pub(super) fn strategies(sequence: &Sequence) -> Result<[Strategies; 2], AppError> {
    let of_profile = |profile| -> Result<Strategies, AppError> {
        let mut tips_px = [const { Vec::new() }; 3];
        for (tips_px, (update, _)) in tips_px.iter_mut().zip(STRATEGIES) {
            let settings = TrackerSettings {
                update,
                loss_ncc_previous: -1.0,
                loss_ncc_anchor: -1.0,
                loss_brightness_ratio: None,
                ..TrackerSettings::profile(profile, 20)
            };
            *tips_px = tips(sequence, settings)?;
        }
        let errors_px = tips_px.each_ref().map(|tips_px| errors(sequence, tips_px));
        Ok(Strategies { profile, tips_px, errors_px })
    };
    Ok([of_profile(Profile::Paper)?, of_profile(Profile::Robust)?])
}

/// Runs a tracker over all pictures, from the tip with which the sequence's own began.
fn tips(sequence: &Sequence, settings: TrackerSettings) -> Result<Vec<[f64; 2]>, AppError> {
    let mut tracker = begin(sequence, settings)?;
    let mut tips_px = vec![tracker.tip_px()];
    for index in 1..sequence.rows.len() {
        let image = sequence.image(index)?;
        tracker.track(&image, &Context::default());
        tips_px.push(tracker.tip_px());
    }
    Ok(tips_px)
}

/// A tracker that begins where the sequence's own did.
pub(super) fn begin(sequence: &Sequence, settings: TrackerSettings) -> Result<Tracker, AppError> {
    let first = sequence.rows.first().ok_or_else(|| AppError::fault("a sequence without images"))?;
    let told_px = first.command.and_then(|command| command.estimate.tip_px);
    let image = sequence.image(0)?;
    let at_px = told_px.unwrap_or(first.truth.reference_px);
    Tracker::new(settings, &image, at_px)
        .map_err(|error: TrackerError| AppError::fault(format_args!("{}: {error}", sequence.name())))
}

fn errors(sequence: &Sequence, tips_px: &[[f64; 2]]) -> Vec<Option<f64>> {
    let pairs = sequence.rows.iter().zip(tips_px);
    pairs
        .map(|(row, [u, v])| {
            let [true_u, true_v] = row.truth.reference_px;
            row.truth.visible.then(|| (u - true_u).hypot(v - true_v))
        })
        .collect()
}
