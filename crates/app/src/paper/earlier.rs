//! The claim about earlier methods: the authors' Gabor–RANSAC–Kalman localisation and the template tracker on the same
//! pictures.

use sonoloop_tracker::baseline::BaselineTracker;
use sonoloop_types::{TrackState, View};

use super::sequence::Sequence;
use crate::error::AppError;
use crate::first_fix::insertion_along;
use crate::judge::WRONG_BEYOND_M;

/// What a method says of the tip, against the truth.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(super) struct Claims {
    /// Images with the tip in the slice.
    pub visible: usize,
    /// Of these, images in which it is said to be tracked.
    pub claimed: usize,
    /// Of these, images in which that is more than 2 mm off.
    pub wrong: usize,
    /// Sum of squared tip errors over the claimed ones, px².
    pub squares_px2: f64,
    /// Images with the tip out of the slice.
    pub absent: usize,
    /// Of these, images in which it is said to be tracked all the same.
    pub false_detections: usize,
}

impl Claims {
    /// Root mean square of the tip error over visible images with a claim.
    pub fn rmse_mm(&self, spacing_m: f64) -> Option<f64> {
        (self.claimed > 0).then(|| (self.squares_px2 / self.claimed as f64).sqrt() * spacing_m * 1e3)
    }

    fn add(&mut self, visible: bool, error_px: Option<f64>, spacing_m: f64) {
        if visible {
            self.visible += 1;
        } else {
            self.absent += 1;
            self.false_detections += usize::from(error_px.is_some());
        }
        if let Some(error_px) = error_px.filter(|_| visible) {
            self.claimed += 1;
            self.squares_px2 += error_px * error_px;
            self.wrong += usize::from(error_px * spacing_m > WRONG_BEYOND_M);
        }
    }

    /// Both together.
    pub fn and(self, other: Self) -> Self {
        Self {
            visible: self.visible + other.visible,
            claimed: self.claimed + other.claimed,
            wrong: self.wrong + other.wrong,
            squares_px2: self.squares_px2 + other.squares_px2,
            absent: self.absent + other.absent,
            false_detections: self.false_detections + other.false_detections,
        }
    }
}

/// Both methods on one sequence.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Comparison {
    pub baseline: Claims,
    pub template: Claims,
}

/// Runs the earlier method over the pictures; `None` for a transverse view, in which there is no line to find.
pub(super) fn compare(sequence: &Sequence) -> Result<Option<Comparison>, AppError> {
    if sequence.scenario.view != View::Lateral {
        return Ok(None);
    }
    let spacing_m = sequence.scenario.probe.geometry.spacing_m;
    // As the set-up tells every tracker: the needle's nominal direction, in a picture that lies along it.
    let axis = sequence.scenario.insertion.axis_in_world;
    let mut baseline = BaselineTracker::new(insertion_along(Some([axis.x.hypot(axis.y), -axis.z])));
    let mut comparison = Comparison { baseline: Claims::default(), template: Claims::default() };
    for (index, row) in sequence.rows.iter().enumerate() {
        let image = sequence.image(index)?;
        let answers = [Some(baseline.track(&image)), row.command.map(|command| command.estimate)];
        let [u, v] = row.truth.reference_px;
        let errors_px = answers.map(|estimate| {
            let estimate = estimate.filter(|estimate| estimate.state == TrackState::Tracking)?;
            estimate.tip_px.map(|[told_u, told_v]| (told_u - u).hypot(told_v - v))
        });
        comparison.baseline.add(row.truth.visible, errors_px[0], spacing_m);
        comparison.template.add(row.truth.visible, errors_px[1], spacing_m);
    }
    Ok(Some(comparison))
}
