//! Names and sizes of the services, and the one place where they are created or opened.

use std::{
    fmt::Debug,
    path::Path as StdPath,
    sync::Once,
    time::{Duration, Instant},
};

use iceoryx2::{
    port::{notifier::Notifier, update_connections::UpdateConnections},
    prelude::*,
    service::port_factory::{event, publish_subscribe},
};

use crate::{
    Domain, WireError,
    layout::{BlobHeader, CommandMessage, EndMessage, ImageHeader, ReadyMessage, TruthMessage},
    termination, termination_requested,
};

pub(crate) type Ipc = ipc::Service;
pub(crate) type Typed<T> = publish_subscribe::PortFactory<Ipc, T, ()>;
pub(crate) type Bytes<H> = publish_subscribe::PortFactory<Ipc, [u8], H>;
pub(crate) type Events = event::PortFactory<Ipc>;

/// What an event means. Listeners look at the messages whatever the number; it is for people who watch.
pub(crate) mod event_id {
    pub(crate) const CREATED: usize = 1;
    pub(crate) const DROPPED: usize = 2;
    pub(crate) const DEAD: usize = 3;
    pub(crate) const MESSAGE: usize = 4;
    pub(crate) const READY: usize = 5;
    pub(crate) const END: usize = 6;
}

/// Trackers come and go, a viewer may watch; the slot of a killed one is free again once the next node starts.
const MAX_NODES: usize = 12;
const MAX_PORTS: usize = 6;
/// Pause between two attempts to open the services.
const RETRY: Duration = Duration::from_millis(5);

/// Create (the simulator) or open (everyone else).
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Mode {
    Create,
    Open,
}

/// Sizes of one publish-subscribe service.
struct Sizes {
    history: usize,
    buffer: usize,
}

/// Every service of the public domain.
pub(crate) struct Services {
    pub(crate) setup: Bytes<BlobHeader>,
    pub(crate) restore: Bytes<BlobHeader>,
    pub(crate) checkpoint: Bytes<BlobHeader>,
    pub(crate) image: Bytes<ImageHeader>,
    pub(crate) image_event: Events,
    pub(crate) command: Typed<CommandMessage>,
    pub(crate) command_event: Events,
    pub(crate) ready: Typed<ReadyMessage>,
    pub(crate) end: Typed<EndMessage>,
}

impl Services {
    pub(crate) fn new(node: &Node<Ipc>, mode: Mode) -> Result<Self, WireError> {
        let latest = || Sizes { history: 1, buffer: 1 };
        Ok(Self {
            setup: bytes(node, mode, "sonoloop/setup", latest())?,
            restore: bytes(node, mode, "sonoloop/restore", latest())?,
            checkpoint: bytes(node, mode, "sonoloop/checkpoint", latest())?,
            image: bytes(node, mode, "sonoloop/image", Sizes { history: 1, buffer: 2 })?,
            command: typed(node, mode, "sonoloop/command", Sizes { history: 0, buffer: 16 })?,
            ready: typed(node, mode, "sonoloop/ready", Sizes { history: 0, buffer: 4 })?,
            end: typed(node, mode, "sonoloop/end", latest())?,
            command_event: events(node, mode, "sonoloop/command")?,
            // Last: a tracker that can open this one finds all the others.
            image_event: events(node, mode, "sonoloop/image")?,
        })
    }
}

/// The services of the observers' domain.
pub(crate) struct ObserverServices {
    pub(crate) truth: Typed<TruthMessage>,
    pub(crate) truth_event: Events,
    pub(crate) control: Bytes<BlobHeader>,
    pub(crate) control_event: Events,
}

impl ObserverServices {
    pub(crate) fn new(node: &Node<Ipc>, mode: Mode) -> Result<Self, WireError> {
        Ok(Self {
            truth: typed(node, mode, "sonoloop/truth", Sizes { history: 1, buffer: 64 })?,
            truth_event: events(node, mode, "sonoloop/truth")?,
            control: bytes(node, mode, "sonoloop/control", Sizes { history: 0, buffer: 16 })?,
            control_event: events(node, mode, "sonoloop/control")?,
        })
    }
}

/// Makes this process's node in `domain`.
pub(crate) fn node(domain: &Domain, name: &str) -> Result<Node<Ipc>, WireError> {
    static QUIET: Once = Once::new();
    // Below Error, iceoryx2 talks about a missing configuration file; IOX2_LOG_LEVEL still asks for more.
    QUIET.call_once(|| set_log_level_from_env_or(LogLevel::Error));

    let node = NodeBuilder::new()
        .name(&NodeName::new(name).map_err(|error| WireError::transport("naming a node", error))?)
        .config(&config(domain.name(), domain.root())?)
        .signal_handling_mode(SignalHandlingMode::HandleTerminationRequests)
        .create::<Ipc>()
        .map_err(|error| {
            WireError::transport(
                format!("joining domain {} in {}", domain.name(), domain.root().display()),
                error,
            )
        })?;
    termination::install(&node);
    Ok(node)
}

/// Tries `open` again, as the simulator may not have made every service yet, until it succeeds, `timeout` is over,
/// the simulator is gone, or a signal arrives.
pub(crate) fn open_until<T>(
    domain: &Domain,
    timeout: Duration,
    open: impl Fn() -> Result<T, WireError>,
) -> Result<T, WireError> {
    let start = Instant::now();
    loop {
        if !domain.is_alive() {
            return Err(domain.not_running());
        }
        match open() {
            Ok(opened) => return Ok(opened),
            Err(_) if termination_requested() => return Err(WireError::Interrupted),
            Err(error) if start.elapsed() >= timeout => return Err(error),
            Err(_) => std::thread::sleep(RETRY),
        }
    }
}

/// iceoryx2's built-in defaults with our prefix and root: a user's own iceoryx2 configuration file must not
/// part simulator and tracker.
fn config(prefix: &str, root: &StdPath) -> Result<Config, WireError> {
    let mut config = Config::default();
    config.global.prefix = FileName::new(prefix.as_bytes())
        .map_err(|error| WireError::transport("setting the prefix", error))?;
    let root = Path::new(root.as_os_str().as_encoded_bytes())
        .map_err(|error| WireError::transport("setting the root folder", error))?;
    config.global.set_root_path(&root);
    Ok(config)
}

fn service_name(name: &str) -> Result<ServiceName, WireError> {
    ServiceName::new(name).map_err(|error| WireError::transport(format!("naming service {name}"), error))
}

fn failure<E: std::fmt::Display>(mode: Mode, name: &str) -> impl FnOnce(E) -> WireError {
    let verb = if mode == Mode::Create { "creating" } else { "opening" };
    let what = format!("{verb} service {name}");
    move |error| WireError::transport(what, error)
}

fn typed<T: Debug + ZeroCopySend + 'static>(
    node: &Node<Ipc>,
    mode: Mode,
    name: &str,
    sizes: Sizes,
) -> Result<Typed<T>, WireError> {
    let builder = node.service_builder(&service_name(name)?).publish_subscribe::<T>();
    match mode {
        Mode::Create => builder
            .max_publishers(MAX_PORTS)
            .max_subscribers(MAX_PORTS)
            .max_nodes(MAX_NODES)
            .history_size(sizes.history)
            .subscriber_max_buffer_size(sizes.buffer)
            .subscriber_max_borrowed_samples(2)
            .enable_safe_overflow(true)
            .create()
            .map_err(failure(mode, name)),
        Mode::Open => builder.open().map_err(failure(mode, name)),
    }
}

fn bytes<H: Debug + ZeroCopySend + 'static>(
    node: &Node<Ipc>,
    mode: Mode,
    name: &str,
    sizes: Sizes,
) -> Result<Bytes<H>, WireError> {
    let builder = node.service_builder(&service_name(name)?).publish_subscribe::<[u8]>().user_header::<H>();
    match mode {
        Mode::Create => builder
            .max_publishers(MAX_PORTS)
            .max_subscribers(MAX_PORTS)
            .max_nodes(MAX_NODES)
            .history_size(sizes.history)
            .subscriber_max_buffer_size(sizes.buffer)
            .subscriber_max_borrowed_samples(2)
            .enable_safe_overflow(true)
            .create()
            .map_err(failure(mode, name)),
        Mode::Open => builder.open().map_err(failure(mode, name)),
    }
}

fn events(node: &Node<Ipc>, mode: Mode, name: &str) -> Result<Events, WireError> {
    let builder = node.service_builder(&service_name(name)?).event();
    match mode {
        Mode::Create => builder
            .max_notifiers(MAX_PORTS)
            .max_listeners(MAX_PORTS)
            .max_nodes(MAX_NODES)
            .notifier_created_event(EventId::new(event_id::CREATED))
            .notifier_dropped_event(EventId::new(event_id::DROPPED))
            .notifier_dead_event(EventId::new(event_id::DEAD))
            .create()
            .map_err(failure(mode, name)),
        Mode::Open => builder.open().map_err(failure(mode, name)),
    }
}

pub(crate) type BytesPublisher<H> = iceoryx2::port::publisher::Publisher<Ipc, [u8], H>;
pub(crate) type BytesSubscriber<H> = iceoryx2::port::subscriber::Subscriber<Ipc, [u8], H>;
pub(crate) type TypedPublisher<T> = iceoryx2::port::publisher::Publisher<Ipc, T, ()>;
pub(crate) type TypedSubscriber<T> = iceoryx2::port::subscriber::Subscriber<Ipc, T, ()>;

/// A publisher of byte messages of at most `bytes`.
///
/// Static memory only: a receiver maps memory that may grow no sooner than it receives, and what a tracker
/// sent just before it ended would be lost. Untouched pages cost nothing.
pub(crate) fn bytes_publisher<H: Debug + ZeroCopySend>(
    service: &Bytes<H>,
    bytes: usize,
) -> Result<BytesPublisher<H>, WireError> {
    service
        .publisher_builder()
        .initial_max_slice_len(bytes.max(1))
        .max_loaned_samples(1)
        .allocation_strategy(AllocationStrategy::Static)
        .create()
        .map_err(|error| WireError::transport("creating a publisher", error))
}

pub(crate) fn typed_publisher<T: Debug + ZeroCopySend>(
    service: &Typed<T>,
) -> Result<TypedPublisher<T>, WireError> {
    service
        .publisher_builder()
        .max_loaned_samples(1)
        .create()
        .map_err(|error| WireError::transport("creating a publisher", error))
}

pub(crate) fn bytes_subscriber<H: Debug + ZeroCopySend>(
    service: &Bytes<H>,
) -> Result<BytesSubscriber<H>, WireError> {
    service
        .subscriber_builder()
        .create()
        .map_err(|error| WireError::transport("creating a subscriber", error))
}

pub(crate) fn typed_subscriber<T: Debug + ZeroCopySend>(
    service: &Typed<T>,
) -> Result<TypedSubscriber<T>, WireError> {
    service
        .subscriber_builder()
        .create()
        .map_err(|error| WireError::transport("creating a subscriber", error))
}

/// Sends `bytes` behind `header`.
pub(crate) fn send_bytes<H: Debug + Default + ZeroCopySend>(
    publisher: &BytesPublisher<H>,
    header: H,
    bytes: &[u8],
) -> Result<(), WireError> {
    let mut sample = publisher
        .loan_slice_uninit(bytes.len())
        .map_err(|error| WireError::transport("borrowing memory for a message", error))?;
    *sample.user_header_mut() = header;
    sample
        .write_from_slice(bytes)
        .send()
        .map_err(|error| WireError::transport("sending a message", error))?;
    Ok(())
}

pub(crate) fn send_typed<T: Debug + Copy + ZeroCopySend>(
    publisher: &TypedPublisher<T>,
    message: T,
) -> Result<(), WireError> {
    publisher.send_copy(message).map_err(|error| WireError::transport("sending a message", error))?;
    Ok(())
}

/// Lets subscribers that came after a message have it from the history: publishers do not notice by
/// themselves.
pub(crate) fn serve_late_comers(publisher: &impl UpdateConnections) -> Result<(), WireError> {
    publisher.update_connections().map_err(|error| WireError::transport("connecting to subscribers", error))
}

/// Wakes the listeners. A listener that died or is full was awake already, or is nobody's loss.
pub(crate) fn notify(notifier: &Notifier<Ipc>, id: usize) {
    let _ = notifier.notify_with_custom_event_id(EventId::new(id));
}

pub(crate) fn notifier(service: &Events) -> Result<Notifier<Ipc>, WireError> {
    service.notifier_builder().create().map_err(|error| WireError::transport("creating a notifier", error))
}

pub(crate) fn listener(service: &Events) -> Result<iceoryx2::port::listener::Listener<Ipc>, WireError> {
    service.listener_builder().create().map_err(|error| WireError::transport("creating a listener", error))
}
