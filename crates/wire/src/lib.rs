//! The services that join simulator and tracker over iceoryx2, and nothing else.
//!
//! A run has a [`Domain`]: a prefix for shared memory, a root folder for sockets and service files, and a
//! lock that the simulator holds for as long as it lives. [`SimEndpoint`] creates every service in it;
//! [`TrackerEndpoint`] opens them, usually from another process. The truth travels in a second domain
//! ([`TruthPublisher`], [`TruthSubscriber`]) whose name the tracker is not given.
//!
//! All waits are event waits; nothing here polls in a busy loop, and no duration measured here may reach the
//! simulation's state. Everything that comes out of shared memory is checked ([`layout`]) before it becomes
//! one of the nouns of `sonoloop-types`. The byte offsets are published in `docs/wire.md`.

mod clean;
mod domain;
mod error;
pub mod layout;
mod services;
mod sim;
mod termination;
mod tracker;
mod truth;
mod wait;

pub use clean::{CleanReport, clean, clean_in};
pub use domain::{Domain, default_base};
pub use error::WireError;
pub use sim::{Answer, SimEndpoint, TrackerHello};
pub use termination::termination_requested;
pub use tracker::{Next, TrackerEndpoint};
pub use truth::{TruthPublisher, TruthSubscriber};
pub use wait::Wait;

/// Environment variable that tells a tracker the name of its domain.
pub const DOMAIN_VARIABLE: &str = "SONOLOOP_DOMAIN";
/// Environment variable that tells a tracker the root folder of its domain.
pub const ROOT_VARIABLE: &str = "SONOLOOP_ROOT";
/// Largest checkpoint that is carried, bytes.
pub const MAX_CHECKPOINT_BYTES: usize = 1 << 20;
/// Largest side of an image that is carried, pixels.
pub const MAX_IMAGE_SIDE_PX: u32 = 4096;
