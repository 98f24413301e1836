//! Tracker and servo joined: a picture and its measurements in, a command out.
//!
//! The same controller answers in the tracker's own process and, with `--in-process`, in the simulator's. It is
//! built from the [`Setup`] alone.

use serde::{Deserialize, Serialize};
use sonoloop_servo::{Servo, ServoState};
use sonoloop_tracker::{Checkpoint, Context, Tracker, snap_to_peak};
use sonoloop_types::{Acquisition, Command, Estimate, Image, Reason, Setup, TrackState};

use crate::null::Null;

/// How far the operator's click may lie beside the tip: three standard deviations of a careful click.
const CLICK_RADIUS_PX: f64 = 3.5;

/// Who answers the pictures.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ControllerKind {
    /// The template tracker.
    Tracker,
    /// A tracker that does not look: see [`Null`].
    Null(Null),
}

/// A controller's checkpoint does not fit this set-up.
#[derive(Debug, thiserror::Error)]
pub enum RestoreError {
    /// The bytes are no checkpoint.
    #[error("the checkpoint cannot be read: {0}")]
    Unreadable(#[from] postcard::Error),
    /// The tracker refuses its part.
    #[error("the checkpoint does not fit: {0}")]
    Tracker(#[from] sonoloop_tracker::TrackerError),
}

#[derive(Serialize, Deserialize)]
struct Saved {
    servo: ServoState,
    tracker: Option<Checkpoint>,
}

/// Image + measurements → command.
pub struct Controller {
    setup: Setup,
    kind: ControllerKind,
    tracker: Option<Tracker>,
    servo: Servo,
}

impl Controller {
    /// A controller that has seen nothing yet.
    pub fn new(setup: Setup, kind: ControllerKind) -> Self {
        let servo = Servo::new(setup.clone());
        Self { setup, kind, tracker: None, servo }
    }

    /// A controller that goes on from the bytes of [`Self::checkpoint`]; its tracker begins LOST.
    pub fn restore(setup: Setup, kind: ControllerKind, bytes: &[u8]) -> Result<Self, RestoreError> {
        let saved: Saved = postcard::from_bytes(bytes)?;
        let tracker = saved.tracker.map(|c| Tracker::restore(setup.tracker, &c)).transpose()?;
        let servo = Servo::restore(setup.clone(), saved.servo);
        Ok(Self { setup, kind, tracker, servo })
    }

    /// All that a restarted controller needs, as bytes that mean nothing to anybody else.
    pub fn checkpoint(&self) -> Vec<u8> {
        let saved = Saved {
            servo: self.servo.state().clone(),
            tracker: self.tracker.as_ref().map(Tracker::checkpoint),
        };
        postcard::to_stdvec(&saved).expect("plain data serialises into memory")
    }

    /// The command that answers a picture.
    pub fn answer(&mut self, acquisition: &Acquisition, image: &Image) -> Command {
        let began = std::time::Instant::now();
        let estimate = match self.kind {
            ControllerKind::Null(null) => null.estimate(&self.setup, acquisition),
            ControllerKind::Tracker => self.track(acquisition, image),
        };
        let command = self.servo.answer(acquisition, &estimate);
        Command { compute_us: began.elapsed().as_secs_f32() * 1e6, ..command }
    }

    fn track(&mut self, acquisition: &Acquisition, image: &Image) -> Estimate {
        let Some(tracker) = &mut self.tracker else {
            // The operator's click is on image 0; a tracker that joins later without a checkpoint has no target.
            if acquisition.sequence != 0 {
                return Estimate::bare(TrackState::Searching, Reason::NoCandidate, None);
            }
            let tip_px = snap_to_peak(image, self.setup.click_px, CLICK_RADIUS_PX);
            return match Tracker::new(self.setup.tracker, image, tip_px) {
                Ok(tracker) => self.tracker.insert(tracker).last_estimate(),
                Err(_) => Estimate::bare(TrackState::Searching, Reason::OutOfImage, None),
            };
        };
        let guidance = self.servo.guidance(acquisition);
        let context = Context {
            motion_px: guidance.motion_px,
            hold_confirmation: guidance.hold_confirmation,
            axis_px: guidance.axis_px,
        };
        tracker.track(image, &context)
    }
}
