//! The services that join simulator and tracker over iceoryx2, and nothing else.
//!
//! A run has a [`Domain`]: a prefix for shared memory, a root folder for sockets and service files, and a
//! lock that the simulator holds for as long as it lives. [`SimEndpoint`] creates every service in it;
//! [`TrackerEndpoint`] opens them, usually from another process. Truth and requests travel in a second domain
//! ([`ObserverHost`], [`Observer`]) whose name the tracker is not given.
//!
//! All waits are event waits; nothing here polls in a busy loop, and no duration measured here may reach the
//! simulation's state. Everything that comes out of shared memory is checked ([`layout`]) before it becomes
//! one of the nouns of `sonoloop-types`. The byte offsets are published in `docs/wire.md`.

mod clean;
mod control;
mod domain;
mod error;
pub mod layout;
mod observer;
mod services;
mod sim;
mod termination;
mod tracker;
mod wait;

pub use clean::{CleanReport, clean, clean_in};
pub use control::{Control, MAX_CONTROL_BYTES};
pub use domain::{Domain, default_base};
pub use error::WireError;
pub use observer::{Observer, ObserverHost};
pub use sim::{Answer, SimEndpoint, TrackerHello};
pub use termination::termination_requested;
pub use tracker::{Next, TrackerEndpoint};
pub use wait::Wait;

/// Environment variable that tells a tracker the name of its domain.
pub const DOMAIN_VARIABLE: &str = "SONOLOOP_DOMAIN";
/// Environment variable that tells a tracker the root folder of its domain.
pub const ROOT_VARIABLE: &str = "SONOLOOP_ROOT";
/// Largest checkpoint that is carried, bytes.
pub const MAX_CHECKPOINT_BYTES: usize = 1 << 20;
/// Largest side of an image that is carried, pixels.
pub const MAX_IMAGE_SIDE_PX: u32 = 4096;
