//! A run shown live in the browser, paused, stepped, disturbed, tuned and started again from there.
//!
//! | module | does |
//! |---|---|
//! | `plan` | which scenario, seed and changed values come next |
//! | `run` | one run: the loop on this thread, an observer of its own domain on another |
//! | `about` | what stands for all of a run: picture, thresholds, robots, phantom, settings |
//! | `row` | what one image adds |
//! | `words` | what the tracker does, in words |
//! | `lessons` | Markdown files and their scenarios |
//!
//! Everything asked for goes over the wire's `control` service, so it is on record; looking changes nothing.

mod about;
mod lessons;
mod plan;
mod row;
mod run;
mod words;

use std::net::SocketAddr;
use std::sync::Arc;

use sonoloop_viewer::{Board, serve};

use crate::cli::ViewArgs;
use crate::error::{AppError, Outcome};
use crate::paths::no_file_in_the_way;
use lessons::Lessons;
use plan::Plan;
use run::{Next, Runs};

/// Serves the page and runs until the user ends it. The outcome is that of the last run that came to its end.
pub fn view(args: &ViewArgs) -> Result<Outcome, AppError> {
    no_file_in_the_way("--out", args.out.as_deref())?;
    let lessons = Lessons::read(&args.lessons)?;
    let mut plan = Plan::new(&args.scenario);
    plan.check(&lessons)?;
    let board = Arc::new(Board::default());
    let server =
        serve(SocketAddr::new(args.address, args.port), Arc::clone(&board)).map_err(AppError::bad_input)?;
    eprintln!("http://{}/  (Ctrl-C ends it)", server.address);
    if !args.address.is_loopback() {
        eprintln!("whoever reaches this address may steer the run: there is no password");
    }
    let mut runs = Runs::new(board, server.asks, lessons, args.speed, args.out.clone());
    loop {
        match runs.run(&plan)? {
            Next::Run(next) => plan = next,
            Next::Leave(outcome) => return Ok(outcome),
        }
    }
}
