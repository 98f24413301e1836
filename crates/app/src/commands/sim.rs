//! `sonoloop sim`: the simulator's half, for a tracker that is started elsewhere.

use std::time::Duration;

use super::run::{finish, run_id};
use crate::cli::SimArgs;
use crate::error::{AppError, Outcome};
use crate::paths::no_file_in_the_way;
use crate::remote::{Remote, TrackerProcess};
use crate::scenarios::prepare;
use crate::session::kills_tracker;
use crate::steering::Steering;

/// Creates the domain, says how to join it, waits, runs.
pub fn sim(args: &SimArgs) -> Result<Outcome, AppError> {
    no_file_in_the_way("--out", args.output.out.as_deref())?;
    sonoloop_ultrasound::draw_on_this_thread();
    let (scenario, session) = prepare(&args.scenario.file, args.scenario.seed, &args.scenario.set)?;
    if kills_tracker(&scenario) {
        return Err(AppError::BadInput(format!(
            "error: {}: kills the tracker, which only `sonoloop run` can, as it starts the tracker itself",
            args.scenario.file.display()
        )));
    }
    let process = TrackerProcess::Elsewhere { wait: Duration::from_secs(args.wait_s) };
    let remote = Remote::create(process).map_err(AppError::fault)?;
    let run_id = run_id();
    let steering = Steering::create(run_id).map_err(AppError::fault)?;
    let (domain, observers) = (remote.domain(), steering.domain());
    eprintln!(
        "waiting {} s for a tracker; join with\n  sonoloop track --domain {} --root {}\n\
         observers (docs/wire.md) join with\n  domain {} root {}",
        args.wait_s,
        domain.name(),
        domain.root().display(),
        observers.name(),
        observers.root().display()
    );
    finish(&scenario, session, Box::new(remote), run_id, Some(steering), &args.output)
}
