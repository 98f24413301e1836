//! `sonoloop run`: one scenario, from file to verdict.

use sonoloop_scenario::Scenario;
use sonoloop_types::{Event, Truth};

use crate::cli::{OutputArgs, RunArgs};
use crate::clock::WallClock;
use crate::controller::ControllerKind;
use crate::error::{AppError, Outcome};
use crate::judge::{Facts, Judged, Metrics, metrics, passes, verdict};
use crate::null::Null;
use crate::output::{self, Summary};
use crate::paths::no_file_in_the_way;
use crate::peer::{InProcess, NoTracker, Peer, PeerError};
use crate::progress::Progress;
use crate::record::{ImageRow, ImageStore, Recording};
use crate::remote::{Remote, TrackerProcess};
use crate::say::say;
use crate::scenarios::prepare;
use crate::session::{Nobody, Session, Shown, Watch, kills_tracker};
use crate::steering::{Request, Steering};

/// A run that is over, judged.
pub struct Finished {
    /// `summary.json`'s content.
    pub summary: Summary,
    /// What happened, in order.
    pub events: Vec<Event>,
}

impl Finished {
    /// True when every expectation held.
    pub fn passed(&self) -> bool {
        passes(&self.summary.expectations)
    }

    /// The expectations that failed, as short sentences.
    pub fn failed(&self) -> Vec<String> {
        self.summary.expectations.iter().filter(|j| !j.pass).map(output::failure_text).collect()
    }
}

/// Runs and judges a prepared scenario in this process, without progress or files, and for null trackers without pictures.
pub fn execute_in_process(
    scenario: &Scenario,
    session: Session,
    kind: ControllerKind,
) -> Result<Finished, AppError> {
    let session = if matches!(kind, ControllerKind::Null(_)) { session.undrawn() } else { session };
    let mut peer = InProcess::new(kind, kills_tracker(scenario));
    let (recording, error) = session.run(run_id(), &mut peer, &mut Nobody, None);
    if let Some(error) = error {
        return Err(AppError::fault(error));
    }
    let (metrics, judged) = judge(scenario, &recording);
    let summary = Summary::new(scenario, &peer.name(), VERSION, &metrics, &judged, &recording);
    Ok(Finished { summary, events: recording.events })
}

/// Version of the program.
pub const VERSION: &str = env!("CARGO_PKG_VERSION");

/// Every message of a run carries its id, so that a stray one is told from its own. It never reaches the run's state.
pub fn run_id() -> u64 {
    let since_1970 = std::time::SystemTime::now().duration_since(std::time::UNIX_EPOCH).unwrap_or_default();
    (u64::from(std::process::id()) << 40) ^ since_1970.as_nanos() as u64 | 1
}

/// Runs one scenario as the command line says.
pub fn run(args: &RunArgs) -> Result<Outcome, AppError> {
    no_file_in_the_way("--out", args.output.out.as_deref())?;
    sonoloop_ultrasound::draw_on_this_thread();
    let (scenario, mut session) = prepare(&args.scenario.file, args.scenario.seed, &args.scenario.set)?;
    if args.realtime {
        session = session.paced_by(Box::new(WallClock::default()));
    }
    let peer: Box<dyn Peer> = match args.tracker.as_deref() {
        _ if args.in_process => Box::new(InProcess::new(ControllerKind::Tracker, kills_tracker(&scenario))),
        Some("none") => Box::new(NoTracker),
        None => Box::new(remote(TrackerProcess::Own(None))?),
        Some(name) if Null::from_name(name).is_some() => {
            Box::new(remote(TrackerProcess::Own(Some(name.to_owned())))?)
        }
        Some(command) => Box::new(remote(TrackerProcess::Command(command.to_owned()))?),
    };
    finish(&scenario, session, peer, run_id(), None, &args.output)
}

/// Shows a run's progress, and lets observers in where there may be any.
struct Watchers {
    progress: Progress,
    steering: Option<Steering>,
}

impl Watch for Watchers {
    fn image(&mut self, row: &ImageRow, shown: &Shown) {
        self.progress.image(row, shown);
    }

    fn before_image(&mut self, truth: &Truth, requests: &mut Vec<Request>) -> Result<(), PeerError> {
        self.steering.as_mut().map_or(Ok(()), |steering| steering.before_image(truth, requests))
    }

    fn interrupted(&mut self) -> bool {
        self.progress.interrupted()
    }
}

fn remote(process: TrackerProcess) -> Result<Remote, AppError> {
    Remote::create(process).map_err(AppError::fault)
}

/// Runs a prepared scenario against a peer with progress, prints, writes files, and says how it came out.
pub fn finish(
    scenario: &Scenario,
    session: Session,
    mut peer: Box<dyn Peer>,
    run_id: u64,
    steering: Option<Steering>,
    args: &OutputArgs,
) -> Result<Outcome, AppError> {
    let pixels =
        args.out.as_ref().map(|_| ImageStore::new()).transpose().map_err(|e| {
            AppError::Fault(format!("the pictures cannot be kept in the temporary folder: {e}"))
        })?;
    let mut watchers = Watchers { progress: Progress::new(scenario), steering };
    let (recording, error) = session.run(run_id, peer.as_mut(), &mut watchers, pixels);
    watchers.progress.finish();
    let tracker = peer.name();
    // Shared memory is gone before files are written: a full disk must not leave it behind.
    drop((peer, watchers));
    let scenario = recording.disturbed.as_ref().unwrap_or(scenario);
    let (metrics, judged) = judge(scenario, &recording);
    let outcome = output::Outcome {
        scenario,
        recording: &recording,
        metrics: &metrics,
        judged: &judged,
        tracker: &tracker,
        version: VERSION,
    };
    if let Some(folder) = &args.out {
        let more = |stage: &output::Stage| {
            if args.record { output::write_sequence(stage, &outcome) } else { Ok(()) }
        };
        let video = output::write_outcome_with(folder, &outcome, more).map_err(AppError::fault)?;
        let video = video.map_or_else(String::new, |video| format!(" ({video})"));
        eprintln!("{}{video}", folder.display());
    }
    if let Some(error) = error {
        return Err(AppError::Fault(format!("the run ended early and is not comparable: {error}")));
    }
    let summary = outcome.summary();
    if args.json {
        say(summary.to_json().trim_end());
    } else {
        say(output::metrics_table(&metrics, &judged).trim_end());
        say(speed_text(&summary));
        if let Some(text) = staleness_text(&summary) {
            say(text);
        }
        say(format_args!("{}  seed {}  {}", scenario.name, scenario.seed, output::verdict_text(&judged)));
    }
    Ok(if passes(&judged) { Outcome::Pass } else { Outcome::Fail })
}

/// The metrics of a run, and how they compare with what its scenario expects.
pub fn judge(scenario: &Scenario, recording: &Recording) -> (Metrics, Vec<Judged>) {
    let metrics = metrics(recording, &Facts::of(scenario));
    let judged = verdict(&metrics, &scenario.expect);
    (metrics, judged)
}

/// One line on a run that was paced by the clock.
fn staleness_text(summary: &Summary) -> Option<String> {
    let timing = &summary.timing;
    let ms = |value: Option<f64>| value.map_or("-".to_owned(), |ms| format!("{ms:.0} ms"));
    timing.behind_ms_max.map(|behind_ms| {
        format!(
            "  in real time (another run next time): age of the command in effect {} in the median, {} at most; \
             {} of {} images without an answer; at most {behind_ms:.0} ms behind the clock",
            ms(timing.staleness_ms_p50),
            ms(timing.staleness_ms_max),
            timing.images_without_answer,
            summary.metrics.images,
        )
    })
}

/// One line on speed: what the run cost and which part of it took the time.
fn speed_text(summary: &Summary) -> String {
    let timing = &summary.timing;
    let number = |value: Option<f64>, unit: &str| value.map_or("-".to_owned(), |v| format!("{v:.2} {unit}"));
    format!(
        "  real-time factor {}: {:.2} s simulated in {:.2} s; per image render {}, physics {}, tracking {}, wire {}",
        timing.realtime_factor.map_or("-".to_owned(), |f| format!("{f:.1}")),
        timing.simulated_s,
        timing.wall_s,
        number(timing.render_ms_p50, "ms"),
        number(timing.physics_ms_p50, "ms"),
        number(timing.track_us_p50, "µs"),
        number(timing.wire_us_p50, "µs"),
    )
}
