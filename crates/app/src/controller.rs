//! Tracker and servo joined: a picture and its measurements in, a command out.
//!
//! The same controller answers in the tracker's own process and, with `--in-process`, in the simulator's. It is
//! built from the [`Setup`] alone.

use serde::{Deserialize, Serialize};
use sonoloop_servo::{Servo, ServoState};
use sonoloop_tracker::baseline::{BaselineTracker, Localizer};
use sonoloop_tracker::{Checkpoint, Context, Tracker, snap_to_peak};
use sonoloop_types::{Acquisition, Command, Estimate, Image, Init, Method, Reason, Setup, TrackState};

use crate::first_fix::{first_fix, insertion_along};
use crate::frozen::Frozen;
use crate::null::Null;
use crate::peer::TrackerName;

/// How far the operator's click may lie beside the tip: three standard deviations of a careful click.
const CLICK_RADIUS_PX: f64 = 3.5;

/// Who answers the pictures.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ControllerKind {
    /// The tracker that the set-up asks for.
    Tracker,
    /// A tracker that does not look: see [`Null`].
    Null(Null),
}

impl ControllerKind {
    /// The name under which it answers.
    pub fn name(self) -> &'static str {
        match self {
            Self::Tracker => TrackerName::OWN,
            Self::Null(null) => null.name(),
        }
    }

    /// The one with this name.
    pub fn from_name(name: &str) -> Option<Self> {
        if name == TrackerName::OWN { Some(Self::Tracker) } else { Null::from_name(name).map(Self::Null) }
    }
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
    eyes: Eyes,
    servo: Servo,
    frozen: Frozen,
}

/// Who looks at the pictures.
enum Eyes {
    Null(Null),
    /// Nobody yet: nothing has been clicked on, or found.
    Waiting,
    Searching(Box<Localizer>),
    Template(Box<Tracker>),
    Baseline(Box<BaselineTracker>),
}

impl From<ControllerKind> for Eyes {
    fn from(kind: ControllerKind) -> Self {
        match kind {
            ControllerKind::Null(null) => Self::Null(null),
            ControllerKind::Tracker => Self::Waiting,
        }
    }
}

impl Controller {
    /// A controller that has seen nothing yet.
    pub fn new(setup: Setup, kind: ControllerKind) -> Self {
        let servo = Servo::new(setup.clone());
        let frozen = Frozen::new(setup.tracker.confirmation_images);
        Self { setup, eyes: kind.into(), servo, frozen }
    }

    /// A controller that goes on from the bytes of [`Self::checkpoint`]; its tracker begins LOST, or SEARCHING where it had
    /// found nothing yet or keeps no templates.
    pub fn restore(setup: Setup, kind: ControllerKind, bytes: &[u8]) -> Result<Self, RestoreError> {
        let saved: Saved = postcard::from_bytes(bytes)?;
        let eyes = match saved.tracker {
            Some(checkpoint) => Eyes::Template(Box::new(Tracker::restore(setup.tracker, &checkpoint)?)),
            None => kind.into(),
        };
        let servo = Servo::restore(setup.clone(), saved.servo);
        let frozen = Frozen::new(setup.tracker.confirmation_images);
        Ok(Self { setup, eyes, servo, frozen })
    }

    /// All that a restarted controller needs, as bytes that mean nothing to anybody else.
    pub fn checkpoint(&self) -> Vec<u8> {
        let tracker = match &self.eyes {
            Eyes::Template(tracker) => Some(tracker.checkpoint()),
            _ => None,
        };
        let saved = Saved { servo: self.servo.state().clone(), tracker };
        postcard::to_stdvec(&saved).expect("plain data serialises into memory")
    }

    /// The command that answers a picture.
    pub fn answer(&mut self, acquisition: &Acquisition, image: &Image) -> Command {
        let began = std::time::Instant::now();
        let looks = !matches!(self.eyes, Eyes::Null(_));
        let command = match self.frozen.answer(acquisition, image).filter(|_| looks) {
            Some(command) => command,
            None => {
                let estimate = self.look(acquisition, image);
                let command = self.frozen.confirm(self.servo.answer(acquisition, &estimate));
                self.frozen.remember(acquisition, image, &command);
                command
            }
        };
        Command { compute_us: began.elapsed().as_secs_f32() * 1e6, ..command }
    }

    fn look(&mut self, acquisition: &Acquisition, image: &Image) -> Estimate {
        let guidance = self.servo.guidance(acquisition);
        if matches!(self.eyes, Eyes::Waiting) {
            self.begin(guidance.axis_px);
        }
        match &mut self.eyes {
            Eyes::Null(null) => null.estimate(&self.setup, acquisition),
            Eyes::Baseline(tracker) => tracker.track(image),
            Eyes::Template(tracker) => {
                let context = Context {
                    motion_px: guidance.motion_px,
                    confirmation: guidance.confirmation,
                    axis_px: guidance.axis_px,
                    unmeasured_px: guidance.unmeasured_px,
                    reach_px: Some(guidance.reach_px),
                    refused: &guidance.refused,
                };
                tracker.track(image, &context)
            }
            Eyes::Searching(localizer) => match first_fix(localizer, self.setup.tracker, image) {
                Some(tracker) => self.follow(tracker),
                None => Estimate::bare(TrackState::Searching, Reason::NoCandidate, None),
            },
            Eyes::Waiting => match self.setup.click_px.filter(|_| acquisition.sequence == 0) {
                Some(click_px) => {
                    let tip_px = snap_to_peak(image, click_px, CLICK_RADIUS_PX);
                    match Tracker::new(self.setup.tracker, image, tip_px) {
                        Ok(tracker) => self.follow(tracker),
                        Err(_) => Estimate::bare(TrackState::Searching, Reason::OutOfImage, None),
                    }
                }
                // The operator's click is on image 0; a tracker that joins later without a checkpoint has no target.
                None => Estimate::bare(TrackState::Searching, Reason::NoCandidate, None),
            },
        }
    }

    /// Whoever needs no click begins; `axis_px` is the needle's nominal direction in the picture.
    fn begin(&mut self, axis_px: Option<[f64; 2]>) {
        let insertion = insertion_along(axis_px);
        match (self.setup.tracker.method, self.setup.tracker.init) {
            (Method::Baseline, _) => self.eyes = Eyes::Baseline(Box::new(BaselineTracker::new(insertion))),
            (Method::Template, Init::Localize) => {
                self.eyes = Eyes::Searching(Box::new(Localizer::new(insertion)));
            }
            (Method::Template, Init::Click) => {}
        }
    }

    /// What a new tracker says of the image it was made from.
    fn follow(&mut self, tracker: Tracker) -> Estimate {
        let estimate = tracker.last_estimate();
        self.eyes = Eyes::Template(Box::new(tracker));
        estimate
    }
}
