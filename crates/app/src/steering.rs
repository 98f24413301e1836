//! Observers of a run: they are told the truth, and may hold, slow and disturb the run.

use std::time::{Duration, Instant};

use sonoloop_types::{TICKS_PER_SECOND, Truth};
use sonoloop_wire::{Control, Domain, ObserverHost, Wait, WireError};

use crate::peer::PeerError;

/// How long a held run sleeps before it looks again whether it was interrupted.
const LOOK: Duration = Duration::from_millis(50);

/// A request, taken up before an image. Requests about time change nothing that is simulated.
#[derive(Debug, Clone, PartialEq)]
pub struct Request {
    /// What was asked, as it travelled, or what was wrong with it.
    pub text: String,
    /// The entry of a scenario's `disturbances` that is asked for, as JSON.
    pub disturbance: Option<String>,
}

/// The observers' domain of a run, and what they have asked for so far.
pub struct Steering {
    host: ObserverHost,
    /// Images until the run is held; `None` for a run that goes on.
    images_left: Option<u32>,
    pace: Option<Pace>,
}

/// A run bound to the clock.
struct Pace {
    speed: f64,
    since: Instant,
    since_tick: u64,
}

impl Steering {
    /// Makes the domain. Its name is for observers only.
    pub fn create(run_id: u64) -> Result<Self, WireError> {
        let host = ObserverHost::create(&Domain::create()?, run_id)?;
        Ok(Self { host, images_left: None, pace: None })
    }

    /// The domain that observers join.
    pub fn domain(&self) -> &Domain {
        self.host.domain()
    }

    /// Tells the truth and takes requests; returns when the next image is to be taken.
    pub fn before_image(&mut self, truth: &Truth) -> Result<Vec<Request>, PeerError> {
        self.host.publish(truth).map_err(fault)?;
        let mut requests = Vec::new();
        loop {
            let wait = match (self.images_left, self.early(truth.tick)) {
                (Some(0), _) => LOOK,
                (_, early) => early.min(LOOK),
            };
            match self.host.next_control(wait).map_err(fault)? {
                Wait::Got(Ok(control)) => requests.push(self.take(control, truth.tick)),
                Wait::Got(Err(why)) => {
                    requests.push(Request { text: format!("refused: {why}"), disturbance: None });
                }
                Wait::Interrupted => return Err(PeerError::Interrupted),
                Wait::TimedOut | Wait::Gone if self.images_left == Some(0) => {}
                Wait::TimedOut | Wait::Gone if self.early(truth.tick).is_zero() => break,
                Wait::TimedOut | Wait::Gone => {}
            }
        }
        self.images_left = self.images_left.map(|left| left - 1);
        Ok(requests)
    }

    fn take(&mut self, control: Control, tick: u64) -> Request {
        let text = serde_json::to_string(&control).unwrap_or_else(|error| error.to_string());
        let mut disturbance = None;
        match control {
            Control::Pause => self.images_left = Some(0),
            Control::Resume => self.images_left = None,
            Control::Step(images) => self.images_left = Some(images),
            Control::Speed(speed) => {
                self.pace = speed.map(|speed| Pace { speed, since: Instant::now(), since_tick: tick });
            }
            Control::Disturb(entry) => disturbance = Some(serde_json::Value::Object(entry).to_string()),
        }
        // Time that a held run stood still is not made up for.
        if let Some(pace) = &mut self.pace {
            (pace.since, pace.since_tick) = (Instant::now(), tick);
        }
        Request { text, disturbance }
    }

    /// How much too early `tick` is by the clock.
    fn early(&self, tick: u64) -> Duration {
        let Some(pace) = &self.pace else { return Duration::ZERO };
        let simulated_s = tick.saturating_sub(pace.since_tick) as f64 / TICKS_PER_SECOND as f64;
        Duration::from_secs_f64(simulated_s / pace.speed).saturating_sub(pace.since.elapsed())
    }
}

fn fault(error: WireError) -> PeerError {
    PeerError::Fault(error.to_string())
}
