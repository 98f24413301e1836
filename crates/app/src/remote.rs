//! A tracker in a process of its own, behind the wire.

use std::process::{Child, Command as Process, Stdio};
use std::time::{Duration, Instant};

use rustix::process::{Pid, Signal, kill_process};
use sonoloop_types::{Acquisition, Command, CommandReceipt, EndReason, Image, Setup};
use sonoloop_wire::{Answer as WireAnswer, Domain, SimEndpoint, Wait, WireError};

use crate::peer::{Answer, Peer, PeerError, TrackerName};

/// Longest silence of a tracker, by the clock, before the run ends.
const SILENCE_S: u64 = 10;
/// How long a tracker that was told of the end may take to leave.
const LEAVE: Duration = Duration::from_secs(2);

/// Where the tracker's process comes from.
pub enum TrackerProcess {
    /// This program's own `track` command; as a tracker that does not look, when one is named.
    Own(Option<String>),
    /// A user's command, run by the shell.
    Command(String),
    /// Somebody else starts it.
    Elsewhere {
        /// How long to wait for it.
        wait: Duration,
    },
}

/// The simulator's end of the wire, and the tracker's process.
pub struct Remote {
    // The child goes first, then the endpoint, then the domain.
    child: Option<Child>,
    endpoint: Option<SimEndpoint>,
    domain: Domain,
    process: TrackerProcess,
    name: TrackerName,
    /// Of a paced run: when the picture was posted since which nothing was heard.
    unanswered: Option<Instant>,
}

impl Remote {
    /// Makes the domain; nothing is started yet.
    pub fn create(process: TrackerProcess) -> Result<Self, WireError> {
        let name = TrackerName { name: "unknown".into(), version: String::new() };
        Ok(Self { child: None, endpoint: None, domain: Domain::create()?, process, name, unanswered: None })
    }

    /// The domain that a tracker joins.
    pub fn domain(&self) -> &Domain {
        &self.domain
    }

    fn spawn(&self) -> Result<Option<Child>, PeerError> {
        let mut process = match &self.process {
            TrackerProcess::Elsewhere { .. } => return Ok(None),
            TrackerProcess::Own(null) => {
                let program = std::env::current_exe()
                    .map_err(|e| PeerError::Fault(format!("this program cannot find itself: {e}")))?;
                let mut process = Process::new(program);
                process.args(["track", "--domain", self.domain.name(), "--root"]).arg(self.domain.root());
                if let Some(null) = null {
                    process.args(["--null", null]);
                }
                process
            }
            TrackerProcess::Command(command) => {
                let mut process = Process::new("sh");
                // `exec`: a signal must reach the tracker, not a shell in front of it.
                process.args(["-c", &format!("exec {command}")]);
                process
            }
        };
        process
            .env(sonoloop_wire::DOMAIN_VARIABLE, self.domain.name())
            .env(sonoloop_wire::ROOT_VARIABLE, self.domain.root())
            .stdin(Stdio::null())
            .stdout(Stdio::null());
        let child =
            process.spawn().map_err(|e| PeerError::Fault(format!("the tracker does not start: {e}")))?;
        Ok(Some(child))
    }

    /// Starts the tracker's process and waits until it says that it is ready.
    fn launch(&mut self) -> Result<(), PeerError> {
        self.child = self.spawn()?;
        let timeout = match self.process {
            TrackerProcess::Elsewhere { wait } => wait,
            _ => Duration::from_secs(SILENCE_S),
        };
        let endpoint = self.endpoint.as_ref().ok_or_else(never_started)?;
        let child = &mut self.child;
        match endpoint.wait_ready(timeout, || is_running(child)).map_err(fault)? {
            Wait::Got(hello) => {
                self.name = TrackerName { name: hello.name, version: hello.version };
                Ok(())
            }
            Wait::TimedOut => Err(PeerError::Silent(timeout.as_secs())),
            Wait::Gone => Err(gone(&mut self.child)),
            Wait::Interrupted => Err(PeerError::Interrupted),
        }
    }
}

fn never_started() -> PeerError {
    PeerError::Fault("the wire was never opened".into())
}

fn fault(error: WireError) -> PeerError {
    PeerError::Fault(error.to_string())
}

fn is_running(child: &mut Option<Child>) -> bool {
    child.as_mut().is_none_or(|child| matches!(child.try_wait(), Ok(None)))
}

fn gone(child: &mut Option<Child>) -> PeerError {
    let status = child.as_mut().and_then(|c| c.try_wait().ok().flatten());
    PeerError::Died(status.map_or_else(String::new, |status| format!(" ({status})")))
}

impl Peer for Remote {
    fn name(&self) -> TrackerName {
        self.name.clone()
    }

    fn start(&mut self, setup: &Setup) -> Result<(), PeerError> {
        self.endpoint = Some(SimEndpoint::create(&self.domain, setup).map_err(fault)?);
        self.launch()
    }

    fn exchange(
        &mut self,
        acquisition: &Acquisition,
        image: &Image,
        meanwhile: &mut dyn FnMut(),
    ) -> Result<Option<Answer>, PeerError> {
        let endpoint = self.endpoint.as_mut().ok_or_else(never_started)?;
        endpoint.publish_image(acquisition, image, true).map_err(fault)?;
        meanwhile();
        let child = &mut self.child;
        let waited = endpoint
            .wait_answer(acquisition.sequence, Duration::from_secs(SILENCE_S), || is_running(child))
            .map_err(fault)?;
        match waited {
            Wait::Got(WireAnswer::Command(command)) => Ok(Some(Ok(command))),
            Wait::Got(WireAnswer::Refused(receipt)) => match receipt.refused {
                Some(refusal) => Ok(Some(Err(refusal))),
                None => Err(PeerError::Fault("a refusal without a reason".into())),
            },
            Wait::TimedOut => Err(PeerError::Silent(SILENCE_S)),
            Wait::Gone => Err(gone(&mut self.child)),
            Wait::Interrupted => Err(PeerError::Interrupted),
        }
    }

    fn post(&mut self, acquisition: &Acquisition, image: &Image) -> Result<(), PeerError> {
        if !is_running(&mut self.child) {
            return Err(gone(&mut self.child));
        }
        let endpoint = self.endpoint.as_mut().ok_or_else(never_started)?;
        endpoint.publish_image(acquisition, image, true).map_err(fault)?;
        self.unanswered.get_or_insert_with(Instant::now);
        Ok(())
    }

    fn poll(&mut self) -> Result<Vec<Result<Command, CommandReceipt>>, PeerError> {
        let endpoint = self.endpoint.as_ref().ok_or_else(never_started)?;
        let mut arrived = Vec::new();
        while let Some(answer) = endpoint.try_answer().map_err(fault)? {
            arrived.push(match answer {
                WireAnswer::Command(command) => Ok(command),
                WireAnswer::Refused(receipt) => Err(receipt),
            });
        }
        if !arrived.is_empty() {
            self.unanswered = None;
        }
        match self.unanswered {
            Some(since) if since.elapsed().as_secs() >= SILENCE_S => Err(PeerError::Silent(SILENCE_S)),
            _ => Ok(arrived),
        }
    }

    fn show(&mut self, acquisition: &Acquisition, image: &Image) -> Result<(), PeerError> {
        let endpoint = self.endpoint.as_mut().ok_or_else(never_started)?;
        endpoint.publish_image(acquisition, image, false).map_err(fault)
    }

    /// SIGSTOP and SIGCONT. What the tracker finds when it wakes is not due to be answered, so it does not matter when it
    /// stopped and when it woke.
    fn hang(&mut self, hung: bool) -> Result<(), PeerError> {
        self.unanswered = None;
        let Some(child) = &self.child else { return Ok(()) };
        let signal = if hung { Signal::STOP } else { Signal::CONT };
        kill_process(Pid::from_child(child), signal).map_err(|e| PeerError::Fault(e.to_string()))
    }

    fn strays(&mut self) -> Vec<CommandReceipt> {
        self.endpoint.as_ref().map_or_else(Vec::new, SimEndpoint::take_refusals)
    }

    fn can_kill(&self) -> bool {
        !matches!(self.process, TrackerProcess::Elsewhere { .. })
    }

    fn kill(&mut self) -> Result<(), PeerError> {
        self.unanswered = None;
        if let Some(mut child) = self.child.take() {
            child.kill().and_then(|()| child.wait()).map_err(|e| PeerError::Fault(e.to_string()))?;
        }
        Ok(())
    }

    fn restart(&mut self) -> Result<(), PeerError> {
        let endpoint = self.endpoint.as_ref().ok_or_else(never_started)?;
        if let Some(bytes) = endpoint.latest_checkpoint().map_err(fault)? {
            endpoint.publish_checkpoint(&bytes).map_err(fault)?;
        }
        self.launch()
    }

    fn end(&mut self, reason: EndReason) {
        if let Some(endpoint) = &self.endpoint {
            // A tracker that cannot be told notices that the domain is gone.
            let _ = endpoint.publish_end(reason);
        }
        // One that hangs could not leave.
        let _ = self.hang(false);
        let Some(mut child) = self.child.take() else { return };
        let step = Duration::from_millis(2);
        for _ in 0..LEAVE.as_millis() / step.as_millis() {
            if !matches!(child.try_wait(), Ok(None)) {
                return;
            }
            std::thread::sleep(step);
        }
        let _ = child.kill();
        let _ = child.wait();
    }
}

impl Drop for Remote {
    fn drop(&mut self) {
        if self.child.is_some() {
            self.end(EndReason::Fault);
        }
    }
}
