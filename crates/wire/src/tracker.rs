use std::time::{Duration, Instant};

use iceoryx2::{
    port::{listener::Listener, notifier::Notifier},
    prelude::Node,
};
use sonoloop_types::{Acquisition, Command, EndReason, Image, Setup};

use crate::{
    Domain, MAX_CHECKPOINT_BYTES, Wait, WireError,
    layout::{BlobHeader, CommandMessage, EndMessage, ImageHeader, ReadyMessage},
    services::{
        self, BytesPublisher, BytesSubscriber, Ipc, Mode, Services, TypedPublisher, TypedSubscriber, event_id,
    },
    sim::{check_checkpoint, receive},
    wait::wait_for,
};

/// What a tracker's wait for the next image ended with.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Next {
    /// An image; its pixels are in the caller's [`Image`].
    Image(Acquisition),
    /// The run is over.
    End(EndReason),
    /// The simulator's process is gone.
    SimulatorGone,
    /// No image came in time.
    TimedOut,
    /// SIGINT or SIGTERM arrived.
    Interrupted,
}

enum Message {
    Image(Acquisition),
    End(EndReason),
}

/// The tracker's end: opens the services of a running simulator.
///
/// Not `Send`: it stays in the thread that made it.
pub struct TrackerEndpoint {
    // Ports before services before node before domain: fields are dropped in this order.
    checkpoint: BytesPublisher<BlobHeader>,
    image: BytesSubscriber<ImageHeader>,
    image_listener: Listener<Ipc>,
    command: TypedPublisher<CommandMessage>,
    command_notifier: Notifier<Ipc>,
    ready: TypedPublisher<ReadyMessage>,
    end: TypedSubscriber<EndMessage>,
    _services: Services,
    _node: Node<Ipc>,
    domain: Domain,
    setup: Setup,
    restore: Option<Vec<u8>>,
}

impl std::fmt::Debug for TrackerEndpoint {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("TrackerEndpoint").field("run_id", &self.setup.run_id).finish_non_exhaustive()
    }
}

impl TrackerEndpoint {
    /// Opens the services of `domain`, trying again until `timeout`, and receives the set-up and the
    /// checkpoint to go on from.
    ///
    /// # Errors
    /// [`WireError::NotRunning`] when the simulator is gone, [`WireError::Timeout`], [`WireError::Refused`]
    /// and [`WireError::Setup`] when what it sent is not sound, [`WireError::Interrupted`] by a signal.
    pub fn open(domain: &Domain, timeout: Duration) -> Result<Self, WireError> {
        let start = Instant::now();
        let (node, services) = services::open_until(domain, timeout, || {
            let node = services::node(domain, "sonoloop-tracker")?;
            let services = Services::new(&node, Mode::Open)?;
            Ok((node, services))
        })?;
        // A history is only served to subscribers that exist when the simulator looks, which it does when
        // the notifier below appears: so the notifier comes last.
        let setup_subscriber = services::bytes_subscriber(&services.setup)?;
        let restore_subscriber = services::bytes_subscriber(&services.restore)?;
        let end = services::typed_subscriber(&services.end)?;
        let image = services
            .image
            .subscriber_builder()
            // Only images published from now on: an old one has had its answer, or its silence.
            .history_request(0)
            .create()
            .map_err(|error| WireError::transport("creating a subscriber", error))?;
        let image_listener = services::listener(&services.image_event)?;
        let checkpoint = services::bytes_publisher(&services.checkpoint, MAX_CHECKPOINT_BYTES)?;
        let command = services::typed_publisher(&services.command)?;
        let ready = services::typed_publisher(&services.ready)?;
        let command_notifier = services::notifier(&services.command_event)?;

        let what = |what: &str| WireError::Timeout { what: what.into(), seconds: timeout.as_secs_f64() };
        let alive = || domain.is_alive();
        let left = || timeout.saturating_sub(start.elapsed());
        let setup =
            first(wait_for_bytes(&setup_subscriber, &image_listener, left(), alive, read_setup)?, domain)?
                .ok_or_else(|| what("no set-up came"))?;
        let run_id = setup.run_id;
        let read_restore = |header: BlobHeader, bytes: &[u8]| {
            header.check(run_id).map_err(|defect| WireError::Refused { message: "restore", defect })?;
            check_checkpoint(bytes)?;
            Ok((!bytes.is_empty()).then(|| bytes.to_vec()))
        };
        let restore = first(
            wait_for_bytes(&restore_subscriber, &image_listener, left(), alive, read_restore)?,
            domain,
        )?
        .ok_or_else(|| what("no word about a checkpoint came"))?;
        Ok(Self {
            checkpoint,
            image,
            image_listener,
            command,
            command_notifier,
            ready,
            end,
            _services: services,
            _node: node,
            domain: domain.clone(),
            setup,
            restore,
        })
    }

    /// What the tracker is told of the rig.
    pub fn setup(&self) -> &Setup {
        &self.setup
    }

    /// The checkpoint to go on from; `None` in a first start.
    pub fn restore(&self) -> Option<&[u8]> {
        self.restore.as_deref()
    }

    /// Tells the simulator that images may come. Longer texts than 64 and 32 bytes are cut.
    ///
    /// # Errors
    /// [`WireError::Transport`].
    pub fn announce(&self, name: &str, version: &str) -> Result<(), WireError> {
        services::send_typed(&self.ready, ReadyMessage::encode(self.setup.run_id, name, version))?;
        services::notify(&self.command_notifier, event_id::READY);
        Ok(())
    }

    /// Waits for the newest image for which an answer is due and copies its pixels to `image`, whose memory
    /// is used again. The end of the run, or of the simulator, ends the wait.
    ///
    /// # Errors
    /// [`WireError::Refused`] when a message is not sound, [`WireError::Transport`].
    pub fn next_image(&self, image: &mut Image, timeout: Duration) -> Result<Next, WireError> {
        let run_id = self.setup.run_id;
        let waited = wait_for(
            &self.image_listener,
            timeout,
            || self.domain.is_alive(),
            || {
                if let Some(sample) = receive(self.end.receive())? {
                    let reason = sample
                        .payload()
                        .decode(run_id)
                        .map_err(|defect| WireError::Refused { message: "end", defect })?;
                    return Ok(Some(Message::End(reason)));
                }
                let mut newest = None;
                while let Some(sample) = receive(self.image.receive())? {
                    let header = *sample.user_header();
                    let received = header
                        .decode(run_id, sample.payload().len())
                        .map_err(|defect| WireError::Refused { message: "image", defect })?;
                    if received.answer_due {
                        newest = Some((received, sample));
                    }
                }
                let Some((received, sample)) = newest else { return Ok(None) };
                image.width_px = received.width_px;
                image.height_px = received.height_px;
                image.pixels.clear();
                image.pixels.extend_from_slice(sample.payload());
                Ok(Some(Message::Image(received.acquisition)))
            },
        )?;
        Ok(match waited {
            Wait::Got(Message::Image(acquisition)) => Next::Image(acquisition),
            Wait::Got(Message::End(reason)) => Next::End(reason),
            Wait::Gone => Next::SimulatorGone,
            Wait::TimedOut => Next::TimedOut,
            Wait::Interrupted => Next::Interrupted,
        })
    }

    /// Answers an image.
    ///
    /// # Errors
    /// [`WireError::Transport`].
    pub fn answer(&self, command: &Command) -> Result<(), WireError> {
        self.send_message(CommandMessage::encode(self.setup.run_id, command))
    }

    /// Sends a command message as it is, sound or not; for tests and for faults on purpose.
    ///
    /// # Errors
    /// [`WireError::Transport`].
    pub fn send_message(&self, message: CommandMessage) -> Result<(), WireError> {
        services::send_typed(&self.command, message)?;
        services::notify(&self.command_notifier, event_id::MESSAGE);
        Ok(())
    }

    /// Leaves a checkpoint with the simulator, to be handed to a restarted tracker. Publish it *before* the
    /// answer to the same image: then the simulator has it when it has the answer.
    ///
    /// # Errors
    /// [`WireError::CheckpointTooLarge`] above [`crate::MAX_CHECKPOINT_BYTES`], [`WireError::Transport`].
    pub fn publish_checkpoint(&self, bytes: &[u8]) -> Result<(), WireError> {
        check_checkpoint(bytes)?;
        services::send_bytes(&self.checkpoint, BlobHeader::encode(self.setup.run_id), bytes)
    }
}

fn wait_for_bytes<T>(
    subscriber: &BytesSubscriber<BlobHeader>,
    listener: &Listener<Ipc>,
    timeout: Duration,
    alive: impl FnMut() -> bool,
    mut read: impl FnMut(BlobHeader, &[u8]) -> Result<T, WireError>,
) -> Result<Wait<T>, WireError> {
    wait_for(listener, timeout, alive, || {
        let mut newest = None;
        while let Some(sample) = receive(subscriber.receive())? {
            newest = Some(read(*sample.user_header(), sample.payload())?);
        }
        Ok(newest)
    })
}

fn first<T>(waited: Wait<T>, domain: &Domain) -> Result<Option<T>, WireError> {
    match waited {
        Wait::Got(value) => Ok(Some(value)),
        Wait::TimedOut => Ok(None),
        Wait::Gone => Err(domain.not_running()),
        Wait::Interrupted => Err(WireError::Interrupted),
    }
}

fn read_setup(header: BlobHeader, bytes: &[u8]) -> Result<Setup, WireError> {
    let run_id = header.run().map_err(|defect| WireError::Refused { message: "setup", defect })?;
    // Shared memory may change while it is read: parse a copy.
    let bytes = bytes.to_vec();
    let setup: Setup =
        serde_json::from_slice(&bytes).map_err(|error| WireError::Setup { detail: error.to_string() })?;
    if setup.run_id != run_id {
        return Err(WireError::Setup { detail: "its run id is not the one of its header".into() });
    }
    Ok(setup)
}
