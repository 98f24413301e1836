//! One file per command.

mod check;
mod clean;
mod gallery;
mod list;
mod paper;
mod render;
mod replay;
mod report;
mod run;
mod sim;
mod suite;
mod track;
mod view;

use crate::cli::Command;
use crate::error::{AppError, Outcome};

pub use run::{Finished, VERSION, execute_in_process, judge, run_id};

/// Does what the command line asks.
pub fn dispatch(command: Command) -> Result<Outcome, AppError> {
    match command {
        Command::Run(args) => run::run(&args),
        Command::Suite(args) => suite::suite(&args),
        Command::Sim(args) => sim::sim(&args),
        Command::View(args) => crate::live::view(&args),
        Command::Track(args) => track::track(&args),
        Command::Render(args) => render::render(&args),
        Command::Check(args) => check::check(&args),
        Command::List(args) => list::list(&args),
        Command::Report(args) => report::report(&args),
        Command::Replay(args) => replay::replay(&args),
        Command::Paper(args) => paper::run(&args),
        Command::Clean => clean::clean(),
    }
}
