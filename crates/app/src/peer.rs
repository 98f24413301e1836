//! Whoever answers the pictures, near or far.

use serde::{Deserialize, Serialize};
use sonoloop_types::{Acquisition, Command, CommandReceipt, EndReason, Image, Refusal, Setup};

use crate::controller::{Controller, ControllerKind, RestoreError};

/// What came back for a picture: the command, or why its bytes were refused at the door.
pub type Answer = Result<Command, Refusal>;

/// Why a peer cannot go on.
#[derive(Debug, thiserror::Error)]
pub enum PeerError {
    /// No answer for longer than the contract allows.
    #[error("the tracker gave no answer for {0} s")]
    Silent(u64),
    /// Its process ended unasked.
    #[error("the tracker ended although nobody asked it to{0}")]
    Died(String),
    /// The user asked for the end.
    #[error("interrupted")]
    Interrupted,
    /// Anything else.
    #[error("{0}")]
    Fault(String),
}

impl PeerError {
    /// The reason under which a run ends.
    pub fn end_reason(&self) -> EndReason {
        match self {
            Self::Silent(_) => EndReason::TrackerSilent,
            Self::Died(_) => EndReason::TrackerDied,
            Self::Interrupted => EndReason::Interrupted,
            Self::Fault(_) => EndReason::Fault,
        }
    }
}

impl From<RestoreError> for PeerError {
    fn from(error: RestoreError) -> Self {
        Self::Fault(error.to_string())
    }
}

/// Who answers the pictures.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct TrackerName {
    /// As it calls itself; `none` for nobody.
    pub name: String,
    /// Its version.
    pub version: String,
}

impl TrackerName {
    /// Name of this program's own tracker.
    pub const OWN: &'static str = "sonoloop";
    /// Name of nobody.
    pub const NONE: &'static str = "none";

    /// This program's own tracker.
    pub fn own() -> Self {
        Self::of_this_version(Self::OWN)
    }

    /// A tracker that is a part of this program.
    pub fn of_this_version(name: &str) -> Self {
        Self { name: name.to_owned(), version: env!("CARGO_PKG_VERSION").to_owned() }
    }
}

/// A tracker that a session talks to.
pub trait Peer {
    /// Who it is; of a tracker elsewhere, once it was ready.
    fn name(&self) -> TrackerName;
    /// Hands over the set-up and waits until the tracker is ready.
    fn start(&mut self, setup: &Setup) -> Result<(), PeerError>;
    /// Hands over a picture and waits for its answer; `None` when nobody is there to answer. `meanwhile` may be called
    /// once, while another process works on the picture.
    fn exchange(
        &mut self,
        acquisition: &Acquisition,
        image: &Image,
        meanwhile: &mut dyn FnMut(),
    ) -> Result<Option<Answer>, PeerError>;
    /// Hands over a picture and does not wait for its answer.
    fn post(&mut self, _acquisition: &Acquisition, _image: &Image) -> Result<(), PeerError> {
        Ok(())
    }
    /// What has arrived since the last call, oldest first; never waits. Of a refused message with the image that it names.
    fn poll(&mut self) -> Result<Vec<Result<Command, CommandReceipt>>, PeerError> {
        Ok(Vec::new())
    }
    /// Hands over a picture for which no answer is due.
    fn show(&mut self, _acquisition: &Acquisition, _image: &Image) -> Result<(), PeerError> {
        Ok(())
    }
    /// Lets the tracker hang, or lets it go on; a tracker that hangs is only shown pictures. One that cannot be stopped
    /// keeps quiet because no answer is due.
    fn hang(&mut self, _hung: bool) -> Result<(), PeerError> {
        Ok(())
    }
    /// Messages refused at the door since the last call that were no answer to the picture handed over.
    fn strays(&mut self) -> Vec<CommandReceipt> {
        Vec::new()
    }
    /// False where the tracker is somebody else's, who alone can kill it and start it again.
    fn can_kill(&self) -> bool {
        true
    }
    /// Kills the tracker without warning.
    fn kill(&mut self) -> Result<(), PeerError>;
    /// Starts a killed tracker again, with its last checkpoint.
    fn restart(&mut self) -> Result<(), PeerError>;
    /// Tells the tracker that the run is over.
    fn end(&mut self, reason: EndReason);
}

/// A controller in this very process.
pub struct InProcess {
    kind: ControllerKind,
    setup: Option<Setup>,
    controller: Option<Controller>,
    checkpoint: Option<Vec<u8>>,
    keeps_checkpoints: bool,
}

impl InProcess {
    /// `keeps_checkpoints` only where a scenario kills the tracker, which then starts from one.
    pub fn new(kind: ControllerKind, keeps_checkpoints: bool) -> Self {
        Self { kind, setup: None, controller: None, checkpoint: None, keeps_checkpoints }
    }
}

impl Peer for InProcess {
    fn name(&self) -> TrackerName {
        TrackerName::of_this_version(self.kind.name())
    }

    fn start(&mut self, setup: &Setup) -> Result<(), PeerError> {
        self.setup = Some(setup.clone());
        self.controller = Some(Controller::new(setup.clone(), self.kind));
        Ok(())
    }

    fn exchange(
        &mut self,
        acquisition: &Acquisition,
        image: &Image,
        _meanwhile: &mut dyn FnMut(),
    ) -> Result<Option<Answer>, PeerError> {
        let controller =
            self.controller.as_mut().ok_or_else(|| PeerError::Died(" (it is not running)".into()))?;
        let command = controller.answer(acquisition, image);
        if self.keeps_checkpoints {
            self.checkpoint = Some(controller.checkpoint());
        }
        Ok(Some(Ok(command)))
    }

    fn kill(&mut self) -> Result<(), PeerError> {
        self.controller = None;
        Ok(())
    }

    fn restart(&mut self) -> Result<(), PeerError> {
        let setup = self.setup.clone().ok_or_else(|| PeerError::Fault("never started".into()))?;
        self.controller = Some(match &self.checkpoint {
            Some(bytes) => Controller::restore(setup, self.kind, bytes)?,
            None => Controller::new(setup, self.kind),
        });
        Ok(())
    }

    fn end(&mut self, _reason: EndReason) {
        self.controller = None;
    }
}

/// Nobody: pictures are rendered, the needle never moves.
pub struct NoTracker;

impl Peer for NoTracker {
    fn name(&self) -> TrackerName {
        TrackerName::of_this_version(TrackerName::NONE)
    }

    fn start(&mut self, _setup: &Setup) -> Result<(), PeerError> {
        Ok(())
    }

    fn exchange(
        &mut self,
        _acquisition: &Acquisition,
        _image: &Image,
        _meanwhile: &mut dyn FnMut(),
    ) -> Result<Option<Answer>, PeerError> {
        Ok(None)
    }

    fn kill(&mut self) -> Result<(), PeerError> {
        Ok(())
    }

    fn restart(&mut self) -> Result<(), PeerError> {
        Ok(())
    }

    fn end(&mut self, _reason: EndReason) {}
}
