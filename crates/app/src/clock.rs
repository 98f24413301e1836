//! The clock that a run in real time is paced by.

use std::time::{Duration, Instant};

use sonoloop_types::TICKS_PER_SECOND;

/// Tells a paced run what time it is, in ticks since the first image.
pub trait Clock {
    /// Waits until `tick` is due; returns the present tick, later than that where the run has fallen behind.
    fn wait_until(&mut self, tick: u64) -> u64;
}

/// The machine's own.
#[derive(Debug, Default)]
pub struct WallClock {
    began: Option<Instant>,
}

impl Clock for WallClock {
    fn wait_until(&mut self, tick: u64) -> u64 {
        // Begins when it is first asked: the tracker has started by then.
        let began = *self.began.get_or_insert_with(Instant::now);
        let early =
            Duration::from_nanos(tick * (1_000_000_000 / TICKS_PER_SECOND)).saturating_sub(began.elapsed());
        if !early.is_zero() {
            std::thread::sleep(early);
        }
        let ticks = began.elapsed().as_nanos() * u128::from(TICKS_PER_SECOND) / 1_000_000_000;
        tick.max(ticks as u64)
    }
}
