//! Observers of a run: they are told the truth, and may hold, slow and disturb the run.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use sonoloop_types::{TICKS_PER_SECOND, Truth};
use sonoloop_wire::{Control, Domain, ObserverHost, Wait, WireError};

use crate::peer::PeerError;

/// How long a held run sleeps before it looks again whether it was interrupted.
const LOOK: Duration = Duration::from_millis(50);

/// How far a paced run may fall behind before the clock is set anew.
const LAG: Duration = Duration::from_millis(100);
/// Requests taken up before one image of a run that is not held: more must not keep it from going on.
const REQUESTS: usize = 16;

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
    /// Set when the run is to be left, also while it is held.
    left: Arc<AtomicBool>,
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
        Ok(Self { host, images_left: None, pace: None, left: Arc::default() })
    }

    /// Lets the run begin at a pace (as [`Control::Speed`]), and held after its first image.
    pub fn beginning(self, speed: Option<f64>, held: bool) -> Self {
        Self { pace: speed.map(|speed| Pace::new(speed, 0)), images_left: held.then_some(1), ..self }
    }

    /// A flag that ends the run, held or not.
    pub fn leave(&self) -> Arc<AtomicBool> {
        Arc::clone(&self.left)
    }

    /// The domain that observers join.
    pub fn domain(&self) -> &Domain {
        self.host.domain()
    }

    /// Tells the truth and takes requests; returns when the next image is to be taken.
    pub fn before_image(&mut self, truth: &Truth, requests: &mut Vec<Request>) -> Result<(), PeerError> {
        self.host.publish(truth, false).map_err(fault)?;
        if let Some(pace) = &mut self.pace {
            pace.forgive(truth.tick);
        }
        let mut told = false;
        loop {
            if self.left.load(Ordering::Relaxed) {
                return Err(PeerError::Interrupted);
            }
            let held = self.images_left == Some(0);
            if held && !told {
                self.host.publish(truth, true).map_err(fault)?;
            }
            told = held;
            if !held && requests.len() >= REQUESTS {
                break;
            }
            let early = self.pace.as_ref().map_or(Duration::ZERO, |pace| pace.early(truth.tick));
            let wait = if held { LOOK } else { early.min(LOOK) };
            match self.host.next_control(wait).map_err(fault)? {
                Wait::Got(Ok(control)) => requests.push(self.take(control, truth.tick)),
                Wait::Got(Err(why)) => {
                    requests.push(Request { text: format!("refused: {why}"), disturbance: None });
                }
                Wait::Interrupted => return Err(PeerError::Interrupted),
                Wait::TimedOut | Wait::Gone if !held && early.is_zero() => break,
                Wait::TimedOut | Wait::Gone => {}
            }
        }
        self.images_left = self.images_left.map(|left| left - 1);
        Ok(())
    }

    fn take(&mut self, control: Control, tick: u64) -> Request {
        let text = serde_json::to_string(&control).unwrap_or_else(|error| error.to_string());
        let mut disturbance = None;
        let was_held = self.images_left == Some(0);
        match control {
            Control::Pause => self.images_left = Some(0),
            Control::Resume => self.images_left = None,
            Control::Step(images) => self.images_left = Some(images),
            Control::Speed(speed) => self.pace = speed.map(|speed| Pace::new(speed, tick)),
            Control::Disturb(entry) => disturbance = Some(serde_json::Value::Object(entry).to_string()),
        }
        // Time that a held run stood still is not made up for.
        if let Some(pace) = self.pace.as_mut().filter(|_| was_held) {
            *pace = Pace::new(pace.speed, tick);
        }
        Request { text, disturbance }
    }
}

impl Pace {
    fn new(speed: f64, tick: u64) -> Self {
        Self { speed, since: Instant::now(), since_tick: tick }
    }

    /// When `tick` is due, counted from `since`.
    fn due(&self, tick: u64) -> Duration {
        let simulated_s = tick.saturating_sub(self.since_tick) as f64 / TICKS_PER_SECOND as f64;
        Duration::from_secs_f64(simulated_s / self.speed)
    }

    /// How much too early `tick` is by the clock.
    fn early(&self, tick: u64) -> Duration {
        self.due(tick).saturating_sub(self.since.elapsed())
    }

    /// A run that has fallen behind goes on at its pace from here, instead of hurrying.
    fn forgive(&mut self, tick: u64) {
        if self.since.elapsed() > self.due(tick) + LAG {
            *self = Self::new(self.speed, tick);
        }
    }
}

fn fault(error: WireError) -> PeerError {
    PeerError::Fault(error.to_string())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_pace_asks_for_simulated_over_real_seconds() {
        let pace = Pace::new(0.5, 1000);
        assert_eq!(pace.due(1000), Duration::ZERO);
        assert_eq!(pace.due(1500), Duration::from_secs(1));
        // A tick before the pace was set is due at once.
        assert_eq!(pace.due(500), Duration::ZERO);
    }
}
