use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::Receiver;
use std::time::Duration;

use serde::Serialize;
use sonoloop_types::Truth;
use sonoloop_viewer::{Ask, Board};
use sonoloop_wire::{Control, Domain, Observer, Wait, WireError};

use super::about::about;
use super::lessons::Lessons;
use super::plan::Plan;
use super::row::RowWriter;
use crate::commands::{VERSION, judge, run_id};
use crate::error::{AppError, Outcome};
use crate::judge::passes;
use crate::output;
use crate::peer::{Peer, PeerError};
use crate::record::{ImageRow, ImageStore};
use crate::remote::{Remote, TrackerProcess};
use crate::session::{Shown, Watch};
use crate::steering::{Request, Steering};

/// How long the observer waits for news before it looks what browsers ask for.
const LOOK: Duration = Duration::from_millis(10);
/// How long the run's own observer may take to join.
const JOIN: Duration = Duration::from_secs(10);

/// What follows a run.
pub(super) enum Next {
    /// Another one.
    Run(Plan),
    /// The end of the program.
    Leave(Outcome),
}

/// All runs of one page.
pub(super) struct Runs {
    board: Arc<Board>,
    asks: Receiver<Ask>,
    lessons: Lessons,
    out: Option<PathBuf>,
    /// Speed that the next run begins with.
    speed: Option<f64>,
    /// Nobody has looked yet.
    first: bool,
    /// Runs that came to their end.
    ended: u32,
    outcome: Outcome,
}

/// How a run is now.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
struct Status {
    held: bool,
    speed: Option<f64>,
    /// How it came out, once it is over.
    over: Option<Over>,
    /// Why what was asked for last cannot be done.
    complaint: Option<String>,
}

#[derive(Debug, Clone, PartialEq, Serialize)]
struct Over {
    end: String,
    pass: bool,
    failed: Vec<String>,
}

impl Runs {
    pub fn new(
        board: Arc<Board>,
        asks: Receiver<Ask>,
        lessons: Lessons,
        speed: Option<f64>,
        out: Option<PathBuf>,
    ) -> Self {
        Self { board, asks, lessons, out, speed, first: true, ended: 0, outcome: Outcome::Pass }
    }

    /// Runs a plan, and waits after its end for what is to be run next.
    pub fn run(&mut self, plan: &Plan) -> Result<Next, AppError> {
        let (scenario, session) = plan.prepare(&self.lessons)?;
        let pixels = self.out.as_ref().map(|_| ImageStore::new()).transpose().map_err(AppError::fault)?;
        let run_id = run_id();
        let mut peer = Remote::create(TrackerProcess::Own(None)).map_err(AppError::fault)?;
        let steering = Steering::create(run_id).map_err(AppError::fault)?.beginning(self.speed, self.first);
        let leave = steering.leave();
        let domain = steering.domain().clone();
        let over = AtomicBool::new(false);
        let status = Status { held: self.first, speed: self.speed, ..Status::default() };
        self.board.begin(about(&scenario, plan, &self.lessons).map_err(AppError::fault)?, json(&status));
        let mut relay = Relay {
            board: &self.board,
            asks: &mut self.asks,
            lessons: &self.lessons,
            plan,
            status,
            starts: std::mem::take(&mut self.first),
            next: None,
        };
        let mut watcher = Watcher {
            steering,
            board: &self.board,
            rows: RowWriter::default(),
            columns: output::Setting::of(&scenario).columns_px,
            spacing_m: scenario.probe.geometry.spacing_m,
            pixels: Vec::new(),
        };
        let (recording, error) = std::thread::scope(|scope| {
            let observer = scope.spawn(|| relay.follow(&domain, &leave, &over));
            let outcome = session.run(run_id, &mut peer, &mut watcher, pixels);
            over.store(true, Ordering::Relaxed);
            // An observer that fails leaves the run without controls, which the page says.
            if let Ok(Err(failed)) = observer.join() {
                eprintln!("error: the page has lost the run: {failed}");
            }
            outcome
        });
        let tracker = peer.name();
        drop((peer, watcher, domain));
        self.speed = relay.status.speed;
        if let Some(next) = relay.next {
            return Ok(Next::Run(next));
        }
        if matches!(error, Some(PeerError::Interrupted)) {
            return Ok(Next::Leave(self.outcome));
        }
        let scenario = recording.disturbed.as_ref().unwrap_or(&scenario);
        let (metrics, judged) = judge(scenario, &recording);
        let pass = passes(&judged) && error.is_none();
        let end =
            error.map_or_else(|| output::snake(&recording.end).replace('_', " "), |error| error.to_string());
        let failed = judged.iter().filter(|judged| !judged.pass).map(output::failure_text).collect();
        relay.status.held = false;
        relay.status.over = Some(Over { end, pass, failed });
        relay.post();
        self.outcome = if pass { Outcome::Pass } else { Outcome::Fail };
        self.ended += 1;
        if let Some(folder) = &self.out {
            let folder = folder.join(self.ended.to_string());
            let outcome = output::Outcome {
                scenario,
                recording: &recording,
                metrics: &metrics,
                judged: &judged,
                tracker: &tracker,
                version: VERSION,
            };
            output::write_outcome_with(&folder, &outcome, |_| Ok(())).map_err(AppError::fault)?;
            eprintln!("{}", folder.display());
        }
        let next = relay.await_next();
        Ok(next.map_or(Next::Leave(self.outcome), Next::Run))
    }
}

fn json(status: &Status) -> String {
    // A struct of plain values.
    serde_json::to_string(status).unwrap_or_else(|_| "{}".to_owned())
}

/// Posts what the loop shows.
struct Watcher<'a> {
    steering: Steering,
    board: &'a Board,
    rows: RowWriter,
    /// Columns of the picture that the aperture reaches; the rest is black.
    columns: [u32; 2],
    spacing_m: f64,
    pixels: Vec<u8>,
}

impl Watch for Watcher<'_> {
    fn image(&mut self, row: &ImageRow, shown: &Shown) {
        let Ok((row, scene)) = self.rows.write(row, shown, self.spacing_m) else { return };
        let [left, right] = self.columns.map(|column| column as usize);
        self.pixels.clear();
        for v in 0..shown.image.height_px {
            self.pixels.extend_from_slice(&shown.image.row(v)[left..right]);
        }
        self.board.image(row, scene, &self.pixels);
    }

    fn before_image(&mut self, truth: &Truth, requests: &mut Vec<Request>) -> Result<(), PeerError> {
        self.steering.before_image(truth, requests)
    }

    fn interrupted(&mut self) -> bool {
        sonoloop_wire::termination_requested()
    }
}

/// Between browsers and the run: an observer like any other.
struct Relay<'a> {
    board: &'a Board,
    asks: &'a mut Receiver<Ask>,
    lessons: &'a Lessons,
    plan: &'a Plan,
    status: Status,
    /// The run waits for somebody who looks.
    starts: bool,
    next: Option<Plan>,
}

impl Relay<'_> {
    /// Follows the run until it is over or is to be left.
    fn follow(&mut self, domain: &Domain, leave: &AtomicBool, over: &AtomicBool) -> Result<(), WireError> {
        let domain = Domain::open(domain.name(), domain.root())?;
        let mut observer = Observer::open(&domain, JOIN)?;
        let mut told = false;
        while !over.load(Ordering::Relaxed) {
            match observer.next(LOOK)? {
                Wait::Got((_, held)) => {
                    told = true;
                    if held != self.status.held {
                        self.status.held = held;
                        self.post();
                    }
                }
                Wait::TimedOut => {}
                Wait::Gone | Wait::Interrupted => return Ok(()),
            }
            if told && self.starts && self.status.held && self.board.watchers() > 0 {
                self.starts = false;
                observer.ask(&Control::Resume)?;
            }
            // Before the first truth nothing can be asked; the start comes first, so that it undoes nobody's pause.
            while let Some(ask) = (told && !self.starts).then(|| self.asks.try_recv().ok()).flatten() {
                match ask {
                    Ask::Control(control) => self.pass_on(&observer, control)?,
                    Ask::Restart(restart) => {
                        if self.accept(self.plan.changed(restart)) {
                            leave.store(true, Ordering::Relaxed);
                            return Ok(());
                        }
                    }
                }
            }
        }
        Ok(())
    }

    fn pass_on(&mut self, observer: &Observer, control: Control) -> Result<(), WireError> {
        if let Control::Speed(speed) = control {
            self.status.speed = speed;
        }
        self.status.complaint = None;
        observer.ask(&control)?;
        self.post();
        Ok(())
    }

    /// Takes up a plan that can be run; says what is wrong with another.
    fn accept(&mut self, plan: Plan) -> bool {
        let complaint = plan.check(self.lessons).err().map(|error| error.to_string());
        let accepted = complaint.is_none();
        self.status.complaint = complaint;
        if accepted {
            self.next = Some(plan)
        } else {
            self.post()
        }
        accepted
    }

    fn post(&self) {
        self.board.status(json(&self.status));
    }

    /// After the end: waits for what comes next; `None` when the user leaves.
    fn await_next(&mut self) -> Option<Plan> {
        while !sonoloop_wire::termination_requested() {
            match self.asks.recv_timeout(5 * LOOK) {
                Ok(Ask::Restart(restart)) => {
                    if self.accept(self.plan.changed(restart)) {
                        return self.next.take();
                    }
                }
                Ok(Ask::Control(Control::Speed(speed))) => {
                    self.status.speed = speed;
                    self.post();
                }
                // Nothing is left to hold or to disturb.
                Ok(Ask::Control(_)) => {}
                Err(std::sync::mpsc::RecvTimeoutError::Timeout) => {}
                Err(std::sync::mpsc::RecvTimeoutError::Disconnected) => return None,
            }
        }
        None
    }
}
