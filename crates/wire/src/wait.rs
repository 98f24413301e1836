use std::time::{Duration, Instant};

use iceoryx2::{port::listener::Listener, prelude::*};

use crate::{WireError, termination_requested};

/// How long one event wait lasts before peers and signals are looked at again.
const SLICE: Duration = Duration::from_millis(50);

/// How a wait ended.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Wait<T> {
    /// With what was waited for.
    Got(T),
    /// The time was over.
    TimedOut,
    /// The other side is gone.
    Gone,
    /// SIGINT or SIGTERM arrived.
    Interrupted,
}

/// Looks with `receive`, then sleeps until an event or 50 ms have passed, until something is received, the
/// time is over, `alive` says no, or a signal arrives. What is already there is received whatever the time.
pub(crate) fn wait_for<T>(
    listener: &Listener<ipc::Service>,
    timeout: Duration,
    mut alive: impl FnMut() -> bool,
    mut receive: impl FnMut() -> Result<Option<T>, WireError>,
) -> Result<Wait<T>, WireError> {
    let start = Instant::now();
    let mut last_look = start;
    loop {
        if let Some(received) = receive()? {
            return Ok(Wait::Got(received));
        }
        if termination_requested() {
            return Ok(Wait::Interrupted);
        }
        let elapsed = start.elapsed();
        if last_look.elapsed() >= SLICE {
            last_look = Instant::now();
            if !alive() {
                // What was sent before the end counts.
                return Ok(receive()?.map_or(Wait::Gone, Wait::Got));
            }
        }
        let Some(left) = timeout.checked_sub(elapsed).filter(|left| !left.is_zero()) else {
            return Ok(Wait::TimedOut);
        };
        match listener.timed_wait(|_| {}, left.min(SLICE)) {
            Ok(_) | Err(iceoryx2::port::listener::ListenerWaitError::InterruptSignal) => {}
            Err(error) => return Err(WireError::transport("waiting for an event", error)),
        }
    }
}
