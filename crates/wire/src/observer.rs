use std::time::Duration;

use iceoryx2::{
    port::{listener::Listener, notifier::Notifier},
    prelude::Node,
};
use sonoloop_types::Truth;

use crate::{
    Control, Domain, MAX_CONTROL_BYTES, Wait, WireError,
    layout::{BlobHeader, TruthMessage},
    services::{
        self, BytesPublisher, BytesSubscriber, Ipc, Mode, ObserverServices, TypedPublisher, TypedSubscriber,
        event_id,
    },
    sim::receive,
    wait::wait_for,
};

/// The simulator's end of the observers' domain, whose name no tracker is given: tells the truth, takes requests.
pub struct ObserverHost {
    truth: TypedPublisher<TruthMessage>,
    notifier: Notifier<Ipc>,
    control: BytesSubscriber<BlobHeader>,
    listener: Listener<Ipc>,
    _services: ObserverServices,
    _node: Node<Ipc>,
    domain: Domain,
    run_id: u64,
}

/// An observer's end: follows the truth, asks for changes. For judges and viewers.
pub struct Observer {
    truth: TypedSubscriber<TruthMessage>,
    listener: Listener<Ipc>,
    control: BytesPublisher<BlobHeader>,
    notifier: Notifier<Ipc>,
    _services: ObserverServices,
    _node: Node<Ipc>,
    domain: Domain,
    /// That of the first truth.
    run_id: Option<u64>,
}

impl ObserverHost {
    /// Creates the services in `domain`, which must not be the one the tracker is in.
    ///
    /// # Errors
    /// [`WireError::NotRunning`] when `domain` was opened rather than created, [`WireError::Transport`].
    pub fn create(domain: &Domain, run_id: u64) -> Result<Self, WireError> {
        if !domain.is_owner() {
            return Err(domain.not_running());
        }
        let node = services::node(domain, "sonoloop-sim")?;
        let services = ObserverServices::new(&node, Mode::Create)?;
        Ok(Self {
            truth: services::typed_publisher(&services.truth)?,
            notifier: services::notifier(&services.truth_event)?,
            control: services::bytes_subscriber(&services.control)?,
            listener: services::listener(&services.control_event)?,
            _services: services,
            _node: node,
            domain: domain.clone(),
            run_id,
        })
    }

    /// The domain that observers join.
    pub fn domain(&self) -> &Domain {
        &self.domain
    }

    /// Publishes the truth of one tick, and whether the run is held there; never blocks.
    ///
    /// # Errors
    /// [`WireError::Transport`].
    pub fn publish(&self, truth: &Truth, held: bool) -> Result<(), WireError> {
        services::send_typed(&self.truth, TruthMessage::encode(self.run_id, truth, held))?;
        services::notify(&self.notifier, event_id::MESSAGE);
        Ok(())
    }

    /// The next request, or what is wrong with it; waits for one until `timeout`. Those who came meanwhile are
    /// given the newest truth.
    ///
    /// # Errors
    /// [`WireError::Transport`].
    pub fn next_control(&self, timeout: Duration) -> Result<Wait<Result<Control, String>>, WireError> {
        wait_for(
            &self.listener,
            timeout,
            || true,
            || {
                services::serve_late_comers(&self.truth)?;
                let Some(sample) = receive(self.control.receive())? else { return Ok(None) };
                if let Err(defect) = sample.user_header().check(self.run_id) {
                    return Ok(Some(Err(defect.to_string())));
                }
                // A copy first: the sender could still write to shared memory.
                let bytes = sample.payload().iter().take(MAX_CONTROL_BYTES + 1).copied().collect::<Vec<_>>();
                Ok(Some(Control::decode(&bytes)))
            },
        )
    }
}

impl Observer {
    /// Opens the services, trying again until `timeout`.
    ///
    /// # Errors
    /// [`WireError::NotRunning`], [`WireError::Interrupted`], or what kept the services from being opened.
    pub fn open(domain: &Domain, timeout: Duration) -> Result<Self, WireError> {
        services::open_until(domain, timeout, || Self::try_open(domain))
    }

    fn try_open(domain: &Domain) -> Result<Self, WireError> {
        let node = services::node(domain, "sonoloop-viewer")?;
        let services = ObserverServices::new(&node, Mode::Open)?;
        Ok(Self {
            truth: services::typed_subscriber(&services.truth)?,
            listener: services::listener(&services.truth_event)?,
            control: services::bytes_publisher(&services.control, MAX_CONTROL_BYTES)?,
            // Last: its appearance wakes the simulator, which then serves history.
            notifier: services::notifier(&services.control_event)?,
            _services: services,
            _node: node,
            domain: domain.clone(),
            run_id: None,
        })
    }

    /// The next truth, in order, and whether the run is held there; up to 64 wait, then the oldest are lost.
    ///
    /// # Errors
    /// [`WireError::Refused`] when a message is not sound, [`WireError::Transport`].
    pub fn next(&mut self, timeout: Duration) -> Result<Wait<(Truth, bool)>, WireError> {
        let run_id = &mut self.run_id;
        wait_for(
            &self.listener,
            timeout,
            || self.domain.is_alive(),
            || {
                let Some(sample) = receive(self.truth.receive())? else { return Ok(None) };
                let message = *sample.payload();
                let expected = run_id.unwrap_or(message.run_id);
                let told = message.decode(expected);
                let told = told.map_err(|defect| WireError::Refused { message: "truth", defect })?;
                *run_id = Some(expected);
                Ok(Some(told))
            },
        )
    }

    /// Asks for something; the simulator looks before its next image. It does not answer: what it did is in the
    /// truth, and in the run's events.
    ///
    /// # Errors
    /// [`WireError::Control`] when it would be refused, or before the first truth; [`WireError::Transport`].
    pub fn ask(&self, control: &Control) -> Result<(), WireError> {
        let bytes = control.encode().map_err(|detail| WireError::Control { detail })?;
        let run_id = self
            .run_id
            .ok_or_else(|| WireError::Control { detail: "the run has not said its number yet".into() })?;
        services::send_bytes(&self.control, BlobHeader::encode(run_id), &bytes)?;
        services::notify(&self.notifier, event_id::MESSAGE);
        Ok(())
    }
}
