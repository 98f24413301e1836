use std::{cell::RefCell, time::Duration};

use iceoryx2::{
    port::{listener::Listener, notifier::Notifier},
    prelude::Node,
};
use sonoloop_types::{Acquisition, Command, CommandReceipt, EndReason, Image, Refusal, Setup};

use crate::{
    Domain, MAX_CHECKPOINT_BYTES, MAX_IMAGE_SIDE_PX, Wait, WireError,
    layout::{BlobHeader, CommandMessage, EndMessage, ImageHeader, ReadyMessage},
    services::{
        self, BytesPublisher, BytesSubscriber, Ipc, Mode, Services, TypedPublisher, TypedSubscriber, event_id,
    },
    wait::wait_for,
};

/// How a tracker introduces itself.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct TrackerHello {
    /// Its name.
    pub name: String,
    /// Its version.
    pub version: String,
}

/// A message that arrived as a command.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Answer {
    /// A sound command. Whether it keeps the limits is for the simulator to say.
    Command(Command),
    /// One that is refused, and why.
    Refused(CommandReceipt),
}

impl Answer {
    /// Reads a message that arrived as a command in a run whose newest image is `newest_sequence`.
    pub fn read(message: &CommandMessage, run_id: u64, newest_sequence: Option<u64>) -> Self {
        let refused = |answers, refusal| Self::Refused(CommandReceipt { answers, refused: Some(refusal) });
        if let Err(defect) = message.check_origin(run_id) {
            // Of another version or run, `answers` means nothing.
            refused(u64::MAX, defect.refusal())
        } else if Some(message.answers) > newest_sequence {
            refused(message.answers, Refusal::UnknownImage)
        } else {
            match message.decode(run_id) {
                Ok(command) => Self::Command(command),
                Err(defect) => refused(message.answers, defect.refusal()),
            }
        }
    }
}

/// The simulator's end: creates every service of the public domain, publishes images, takes commands.
///
/// Not `Send`: it stays in the thread that made it.
pub struct SimEndpoint {
    // Ports before services before node before domain: fields are dropped in this order.
    setup: BytesPublisher<BlobHeader>,
    restore: BytesPublisher<BlobHeader>,
    checkpoint: BytesSubscriber<BlobHeader>,
    image: BytesPublisher<ImageHeader>,
    image_notifier: Notifier<Ipc>,
    command: TypedSubscriber<CommandMessage>,
    command_listener: Listener<Ipc>,
    ready: TypedSubscriber<ReadyMessage>,
    end: TypedPublisher<EndMessage>,
    _services: Services,
    _node: Node<Ipc>,
    _domain: Domain,
    run_id: u64,
    spacing_m: f64,
    size_px: (u32, u32),
    newest_sequence: Option<u64>,
    refusals: RefCell<Vec<CommandReceipt>>,
    /// Empty when there is none.
    newest_checkpoint: RefCell<Vec<u8>>,
}

impl std::fmt::Debug for SimEndpoint {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("SimEndpoint").field("run_id", &self.run_id).finish_non_exhaustive()
    }
}

impl SimEndpoint {
    /// Creates all services in `domain` and publishes `setup`. Start trackers after this, not before.
    ///
    /// # Errors
    /// [`WireError::NotRunning`] when `domain` was opened rather than created, [`WireError::Setup`] when
    /// `setup` holds a number that JSON cannot carry, [`WireError::Picture`] when its picture is larger than
    /// [`MAX_IMAGE_SIDE_PX`], [`WireError::Transport`].
    pub fn create(domain: &Domain, setup: &Setup) -> Result<Self, WireError> {
        if !domain.is_owner() {
            return Err(domain.not_running());
        }
        let json = setup_json(setup)?;
        let size_px = (setup.geometry.width_px, setup.geometry.height_px);
        let sides = 1..=MAX_IMAGE_SIDE_PX;
        if !sides.contains(&size_px.0) || !sides.contains(&size_px.1) {
            return Err(picture(size_px, "its sides are out of bounds"));
        }
        let node = services::node(domain, "sonoloop-sim")?;
        let services = Services::new(&node, Mode::Create)?;
        let endpoint = Self {
            setup: services::bytes_publisher(&services.setup, json.len())?,
            restore: services::bytes_publisher(&services.restore, MAX_CHECKPOINT_BYTES)?,
            checkpoint: services::bytes_subscriber(&services.checkpoint)?,
            image: services::bytes_publisher(&services.image, size_px.0 as usize * size_px.1 as usize)?,
            image_notifier: services::notifier(&services.image_event)?,
            command: services::typed_subscriber(&services.command)?,
            command_listener: services::listener(&services.command_event)?,
            ready: services::typed_subscriber(&services.ready)?,
            end: services::typed_publisher(&services.end)?,
            _services: services,
            _node: node,
            _domain: domain.clone(),
            run_id: setup.run_id,
            spacing_m: setup.geometry.spacing_m,
            size_px,
            newest_sequence: None,
            refusals: RefCell::default(),
            newest_checkpoint: RefCell::default(),
        };
        services::send_bytes(&endpoint.setup, BlobHeader::encode(setup.run_id), &json)?;
        // "No checkpoint" is a message too, so that a tracker need not guess how long to wait for one.
        services::send_bytes(&endpoint.restore, BlobHeader::encode(setup.run_id), &[])?;
        Ok(endpoint)
    }

    /// Waits until a tracker says that it is ready. `alive` is asked about every 50 ms whether its process
    /// still runs.
    ///
    /// # Errors
    /// [`WireError::Refused`] when its message is not sound, [`WireError::Transport`].
    pub fn wait_ready(
        &self,
        timeout: Duration,
        mut alive: impl FnMut() -> bool,
    ) -> Result<Wait<TrackerHello>, WireError> {
        wait_for(&self.command_listener, timeout, &mut alive, || {
            // The tracker's arrival is what wakes us; give it the set-up.
            self.serve_late_comers()?;
            let Some(sample) = receive(self.ready.receive())? else { return Ok(None) };
            let message = *sample.payload();
            let (name, version) = message
                .decode(self.run_id)
                .map_err(|defect| WireError::Refused { message: "ready", defect })?;
            // Looking once connects us to the new tracker's memory, so that what it sends is ours even if it
            // ends right after its first answer.
            self.fetch_checkpoint()?;
            receive(self.command.has_samples())?;
            Ok(Some(TrackerHello { name, version }))
        })
    }

    /// Publishes one image and wakes who waits for it; never blocks. `answer_due` tells the tracker whether
    /// the simulator waits for its answer: a tracker skips an image for which it does not, so that what it
    /// sees does not depend on when it was stopped and woken.
    ///
    /// # Errors
    /// [`WireError::Picture`] when the size is not the one of the set-up, [`WireError::Transport`].
    pub fn publish_image(
        &mut self,
        acquisition: &Acquisition,
        image: &Image,
        answer_due: bool,
    ) -> Result<(), WireError> {
        let size_px = (image.width_px, image.height_px);
        if size_px != self.size_px || image.pixels.len() != size_px.0 as usize * size_px.1 as usize {
            return Err(picture(size_px, "its size is not the one of the set-up"));
        }
        self.serve_late_comers()?;
        let header = ImageHeader::encode(self.run_id, acquisition, image, self.spacing_m, answer_due);
        services::send_bytes(&self.image, header, &image.pixels)?;
        self.newest_sequence = self.newest_sequence.max(Some(acquisition.sequence));
        services::notify(&self.image_notifier, event_id::MESSAGE);
        Ok(())
    }

    /// Waits for the answer to image `sequence`. `alive` is asked about every 50 ms whether the tracker's
    /// process still runs.
    ///
    /// An answer to `sequence` that does not hold what it should ends the wait as [`Answer::Refused`].
    /// Messages that answer anything else are discarded and kept for [`Self::take_refusals`].
    ///
    /// # Errors
    /// [`WireError::Transport`].
    pub fn wait_answer(
        &self,
        sequence: u64,
        timeout: Duration,
        mut alive: impl FnMut() -> bool,
    ) -> Result<Wait<Answer>, WireError> {
        wait_for(&self.command_listener, timeout, &mut alive, || {
            while let Some(answer) = self.try_answer()? {
                let receipt = match answer {
                    Answer::Command(command) if command.answers == sequence => return Ok(Some(answer)),
                    Answer::Command(command) => {
                        CommandReceipt { answers: command.answers, refused: Some(Refusal::Stale) }
                    }
                    Answer::Refused(receipt) if receipt.answers == sequence => return Ok(Some(answer)),
                    Answer::Refused(receipt) => receipt,
                };
                self.refusals.borrow_mut().push(receipt);
            }
            Ok(None)
        })
    }

    /// The next command that has arrived, if any, whatever image it answers; never waits.
    ///
    /// # Errors
    /// [`WireError::Transport`].
    pub fn try_answer(&self) -> Result<Option<Answer>, WireError> {
        let Some(sample) = receive(self.command.receive())? else { return Ok(None) };
        self.fetch_checkpoint()?;
        // A copy first: the sender could still write to shared memory.
        let message = *sample.payload();
        Ok(Some(Answer::read(&message, self.run_id, self.newest_sequence)))
    }

    /// What [`Self::wait_answer`] discarded since the last call, oldest first. `answers` is `u64::MAX` where
    /// the message did not say.
    pub fn take_refusals(&self) -> Vec<CommandReceipt> {
        self.refusals.take()
    }

    /// The newest checkpoint a tracker has published in this run. In lockstep a tracker publishes it before
    /// it answers, so after the answer to image k it is the one of image k.
    ///
    /// # Errors
    /// [`WireError::Transport`].
    pub fn latest_checkpoint(&self) -> Result<Option<Vec<u8>>, WireError> {
        self.fetch_checkpoint()?;
        let newest = self.newest_checkpoint.borrow();
        Ok((!newest.is_empty()).then(|| newest.clone()))
    }

    /// Hands a checkpoint to the next tracker that starts; call it before starting that.
    ///
    /// # Errors
    /// [`WireError::CheckpointTooLarge`], [`WireError::Transport`].
    pub fn publish_checkpoint(&self, bytes: &[u8]) -> Result<(), WireError> {
        check_checkpoint(bytes)?;
        services::send_bytes(&self.restore, BlobHeader::encode(self.run_id), bytes)
    }

    /// Tells all that the run is over. Late comers are told as well, as long as the endpoint lives.
    ///
    /// # Errors
    /// [`WireError::Transport`].
    pub fn publish_end(&self, reason: EndReason) -> Result<(), WireError> {
        services::send_typed(&self.end, EndMessage::encode(self.run_id, reason))?;
        services::notify(&self.image_notifier, event_id::END);
        Ok(())
    }

    /// A checkpoint lies in its tracker's memory and goes with it, so it is fetched while that lives.
    fn fetch_checkpoint(&self) -> Result<(), WireError> {
        while let Some(sample) = receive(self.checkpoint.receive())? {
            let header = *sample.user_header();
            let bytes = sample.payload();
            if header.check(self.run_id).is_ok() && bytes.len() <= MAX_CHECKPOINT_BYTES {
                let mut newest = self.newest_checkpoint.borrow_mut();
                newest.clear();
                newest.extend_from_slice(bytes);
            }
        }
        Ok(())
    }

    fn serve_late_comers(&self) -> Result<(), WireError> {
        services::serve_late_comers(&self.setup)?;
        services::serve_late_comers(&self.restore)?;
        services::serve_late_comers(&self.end)
    }
}

pub(crate) fn receive<T, E: std::fmt::Display>(received: Result<T, E>) -> Result<T, WireError> {
    received.map_err(|error| WireError::transport("receiving a message", error))
}

pub(crate) fn check_checkpoint(bytes: &[u8]) -> Result<(), WireError> {
    if bytes.len() <= MAX_CHECKPOINT_BYTES {
        Ok(())
    } else {
        Err(WireError::CheckpointTooLarge { bytes: bytes.len(), limit: MAX_CHECKPOINT_BYTES })
    }
}

fn picture((width_px, height_px): (u32, u32), reason: &'static str) -> WireError {
    WireError::Picture { width_px, height_px, reason }
}

/// JSON has no NaN: serde writes `null`, which would fail at the reader. Better to fail here.
fn setup_json(setup: &Setup) -> Result<Vec<u8>, WireError> {
    let json = serde_json::to_vec(setup).map_err(|error| WireError::Setup { detail: error.to_string() })?;
    match serde_json::from_slice::<Setup>(&json) {
        Ok(back) if back == *setup => Ok(json),
        Ok(_) => Err(WireError::Setup { detail: "it reads back differently".into() }),
        Err(error) => Err(WireError::Setup { detail: error.to_string() }),
    }
}
