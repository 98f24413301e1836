use std::{fmt::Display, path::PathBuf};

use crate::layout::Defect;

/// What can go wrong between the processes.
#[derive(Debug, thiserror::Error)]
pub enum WireError {
    /// A file or folder of the domain cannot be made, read or locked.
    #[error("{what} {}: {source}", path.display())]
    Io {
        /// What was tried.
        what: &'static str,
        /// Where.
        path: PathBuf,
        /// Why it failed.
        source: std::io::Error,
    },
    /// The folder for domains belongs to someone else.
    #[error(
        "{} is not a folder of user {user} (owner {owner}); remove it or choose another folder",
        path.display()
    )]
    ForeignBase {
        /// The folder.
        path: PathBuf,
        /// Its owner's user id.
        owner: u32,
        /// Our user id.
        user: u32,
    },
    /// Unix sockets have short names: the folder's path leaves no room for them.
    #[error("{} is too long by {excess} bytes for the sockets below it; choose a shorter folder", path.display())]
    RootTooLong {
        /// The root folder of the domain.
        path: PathBuf,
        /// By how much.
        excess: usize,
    },
    /// A name that no domain can have.
    #[error("\"{name}\" is not the name of a domain")]
    BadName {
        /// The name given.
        name: String,
    },
    /// No simulator lives in the domain.
    #[error("no simulator runs in domain {name} (root {})", root.display())]
    NotRunning {
        /// Name of the domain.
        name: String,
        /// Its root folder.
        root: PathBuf,
    },
    /// The transport refused something.
    #[error("{what}: iceoryx2 says {detail}")]
    Transport {
        /// What was tried.
        what: String,
        /// iceoryx2's own words.
        detail: String,
    },
    /// The services were not there, or the first message did not come, in time.
    #[error("{what} within {seconds} s")]
    Timeout {
        /// What did not happen.
        what: String,
        /// The limit.
        seconds: f64,
    },
    /// A message does not hold what its layout promises.
    #[error("the {message} message is refused: {defect}")]
    Refused {
        /// Which message.
        message: &'static str,
        /// Why.
        defect: Defect,
    },
    /// The set-up cannot be written as JSON and read back unchanged.
    #[error("the set-up cannot travel as JSON: {detail}")]
    Setup {
        /// Why.
        detail: String,
    },
    /// The picture's size is not the one of the set-up, or out of bounds.
    #[error("a picture of {width_px}×{height_px} px cannot be published: {reason}")]
    Picture {
        /// Columns.
        width_px: u32,
        /// Rows.
        height_px: u32,
        /// Why.
        reason: &'static str,
    },
    /// A checkpoint is larger than the wire carries.
    #[error("a checkpoint of {bytes} bytes is larger than {limit}")]
    CheckpointTooLarge {
        /// Its size.
        bytes: usize,
        /// The bound.
        limit: usize,
    },
    /// A request that the simulator would refuse.
    #[error("the request is refused: {detail}")]
    Control {
        /// Why.
        detail: String,
    },
    /// A termination signal arrived while waiting.
    #[error("interrupted by a signal")]
    Interrupted,
}

impl WireError {
    pub(crate) fn transport(what: impl Display, detail: impl Display) -> Self {
        Self::Transport { what: what.to_string(), detail: detail.to_string() }
    }
}
