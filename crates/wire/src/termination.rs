//! SIGINT and SIGTERM.
//!
//! iceoryx2 catches both as soon as it makes shared memory, and forgets them: a process that uses it would
//! survive Ctrl-C. So every endpoint installs a flag behind iceoryx2's handler, and every wait looks at it.

use std::sync::{
    Arc, OnceLock,
    atomic::{AtomicBool, Ordering},
};

use iceoryx2::prelude::*;
use signal_hook::consts::{SIGINT, SIGTERM};

static REQUESTED: OnceLock<Arc<AtomicBool>> = OnceLock::new();

/// True once SIGINT or SIGTERM has arrived in a process that has an endpoint.
///
/// The process is not ended by the first signal, so that it can stop the run and tidy up; a second one ends
/// it at once, with exit code 130.
pub fn termination_requested() -> bool {
    REQUESTED.get().is_some_and(|flag| flag.load(Ordering::Relaxed))
}

/// Installs the flag; `node` must have been made with `HandleTerminationRequests`.
pub(crate) fn install(node: &Node<ipc::Service>) {
    REQUESTED.get_or_init(|| {
        // Makes iceoryx2 install its handlers now: installed later, they would displace ours.
        let already = node.wait(std::time::Duration::ZERO).is_err();
        let flag = Arc::new(AtomicBool::new(already));
        for signal in [SIGINT, SIGTERM] {
            // Order matters: the second signal finds the flag set. Failure leaves iceoryx2's behaviour.
            let _ = signal_hook::flag::register_conditional_shutdown(signal, 130, Arc::clone(&flag));
            let _ = signal_hook::flag::register(signal, Arc::clone(&flag));
        }
        flag
    });
}
