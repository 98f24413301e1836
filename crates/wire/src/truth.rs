use std::time::{Duration, Instant};

use iceoryx2::{
    port::{listener::Listener, notifier::Notifier},
    prelude::Node,
};
use sonoloop_types::Truth;

use crate::{
    Domain, Wait, WireError,
    layout::TruthMessage,
    services::{self, Events, Ipc, Mode, Typed, TypedPublisher, TypedSubscriber, event_id},
    sim::receive,
    termination_requested,
    wait::wait_for,
};

/// Publishes the truth in a domain of its own, whose name no tracker is given.
pub struct TruthPublisher {
    truth: TypedPublisher<TruthMessage>,
    notifier: Notifier<Ipc>,
    _services: (Typed<TruthMessage>, Events),
    _node: Node<Ipc>,
    _domain: Domain,
    run_id: u64,
}

/// Follows the truth; for the judge and the viewer.
pub struct TruthSubscriber {
    truth: TypedSubscriber<TruthMessage>,
    listener: Listener<Ipc>,
    _services: (Typed<TruthMessage>, Events),
    _node: Node<Ipc>,
    domain: Domain,
    run_id: u64,
}

impl TruthPublisher {
    /// Creates the service in `domain`, which must not be the one the tracker is in.
    ///
    /// # Errors
    /// [`WireError::NotRunning`] when `domain` was opened rather than created, [`WireError::Transport`].
    pub fn create(domain: &Domain, run_id: u64) -> Result<Self, WireError> {
        if !domain.is_owner() {
            return Err(WireError::NotRunning { name: domain.name().into(), root: domain.root().into() });
        }
        let node = services::node(domain, "sonoloop-sim")?;
        let services = services::truth(&node, Mode::Create)?;
        Ok(Self {
            truth: services::typed_publisher(&services.0)?,
            notifier: services::notifier(&services.1)?,
            _services: services,
            _node: node,
            _domain: domain.clone(),
            run_id,
        })
    }

    /// Publishes the truth of one tick; never blocks.
    ///
    /// # Errors
    /// [`WireError::Transport`].
    pub fn publish(&self, truth: &Truth) -> Result<(), WireError> {
        services::send_typed(&self.truth, TruthMessage::encode(self.run_id, truth))?;
        services::notify(&self.notifier, event_id::MESSAGE);
        Ok(())
    }
}

impl TruthSubscriber {
    /// Opens the service, trying again until `timeout`.
    ///
    /// # Errors
    /// [`WireError::NotRunning`], [`WireError::Interrupted`], or what kept the service from being opened.
    pub fn open(domain: &Domain, run_id: u64, timeout: Duration) -> Result<Self, WireError> {
        let start = Instant::now();
        loop {
            if !domain.is_alive() {
                return Err(WireError::NotRunning { name: domain.name().into(), root: domain.root().into() });
            }
            match Self::try_open(domain, run_id) {
                Ok(opened) => return Ok(opened),
                Err(_) if termination_requested() => return Err(WireError::Interrupted),
                Err(error) if start.elapsed() >= timeout => return Err(error),
                Err(_) => std::thread::sleep(Duration::from_millis(5)),
            }
        }
    }

    fn try_open(domain: &Domain, run_id: u64) -> Result<Self, WireError> {
        let node = services::node(domain, "sonoloop-viewer")?;
        let services = services::truth(&node, Mode::Open)?;
        Ok(Self {
            truth: services::typed_subscriber(&services.0)?,
            listener: services::listener(&services.1)?,
            _services: services,
            _node: node,
            domain: domain.clone(),
            run_id,
        })
    }

    /// The next truth, in order; up to 64 wait, then the oldest are lost.
    ///
    /// # Errors
    /// [`WireError::Refused`] when a message is not sound, [`WireError::Transport`].
    pub fn next(&self, timeout: Duration) -> Result<Wait<Truth>, WireError> {
        wait_for(
            &self.listener,
            timeout,
            || self.domain.is_alive(),
            || {
                let Some(sample) = receive(self.truth.receive())? else { return Ok(None) };
                let message = *sample.payload();
                message
                    .decode(self.run_id)
                    .map(Some)
                    .map_err(|defect| WireError::Refused { message: "truth", defect })
            },
        )
    }
}
