use sonoloop_types::{Estimate, Image, Reason, TrackState};

use super::localize::{Insertion, Localizer};
use crate::kalman::{Kalman, Noise};

/// Images in a row without a needle over which the Kalman filter's prediction stands in for the tip.
pub const BRIDGED_IMAGES: u32 = 5;

/// A needle that starts or stops (some 2 px per image) does so within a few images; the localised tip of synthetic needles
/// is some 2.5 px off, mostly along the needle; of its velocity nothing but that needles are slow is known.
const NOISE: Noise = Noise { acceleration_px: 0.5, measurement_px: 2.0, first_velocity_px: 3.0 };

/// The authors' earlier method: localises the needle in every image and smooths its tip with a Kalman filter.
///
/// It begins SEARCHING. An image in which a needle is found is TRACKING, whatever was found, and however far from
/// the last tip it is. In up to [`BRIDGED_IMAGES`] images in a row without one the prediction is the tip and the state
/// stays TRACKING, with [`Reason::NoCandidate`]; from then on it is LOST, the tip stays at the last prediction, and the
/// next needle found begins a new filter. There are no templates, so the estimates hold no correlations.
#[derive(Debug, Clone)]
pub struct BaselineTracker {
    localizer: Localizer,
    /// `None` before the first fix.
    filter: Option<Kalman>,
    /// Images in a row without a needle.
    missed: u32,
}

impl BaselineTracker {
    /// A tracker that has seen nothing yet. No first click: it finds the needle itself.
    pub fn new(insertion: Insertion) -> Self {
        Self { localizer: Localizer::new(insertion), filter: None, missed: 0 }
    }

    /// Looks for the needle in the next image.
    pub fn track(&mut self, image: &Image) -> Estimate {
        match self.localizer.localize(image) {
            Some(found) => {
                let tip_px = self.correct(found.tip_px);
                Estimate::bare(TrackState::Tracking, Reason::Ok, Some(tip_px))
            }
            None => self.bridge(),
        }
    }

    /// Takes in a localised tip and gives the smoothed one.
    fn correct(&mut self, measured_px: [f64; 2]) -> [f64; 2] {
        let filter = match self.filter {
            Some(mut filter) if self.missed <= BRIDGED_IMAGES => {
                filter.predict();
                filter.correct(measured_px);
                filter
            }
            _ => Kalman::new(measured_px, NOISE),
        };
        self.filter = Some(filter);
        self.missed = 0;
        filter.tip_px
    }

    fn bridge(&mut self) -> Estimate {
        let Some(filter) = &mut self.filter else {
            return Estimate::bare(TrackState::Searching, Reason::NoCandidate, None);
        };
        self.missed = self.missed.saturating_add(1);
        let state = if self.missed <= BRIDGED_IMAGES {
            filter.predict();
            TrackState::Tracking
        } else {
            TrackState::Lost
        };
        Estimate::bare(state, Reason::NoCandidate, Some(filter.tip_px))
    }
}
