//! The `sonoloop` program: what joins the crates into runs, files and a command line.
//!
//! [`session`] is the loop itself; [`peer`] and [`remote`] are the two ways to a tracker; [`controller`] is tracker and
//! servo joined; [`live`] shows a run in the browser; [`judge`] turns a recording into metrics and a verdict; [`output`] writes files, [`report`] makes a page of
//! them in the form that [`page`] gives to all reports, and [`replay`] runs them again.

use std::process::ExitCode;

use clap::Parser;

pub mod cli;
pub mod clock;
pub mod commands;
pub mod controller;
pub mod error;
pub mod first_fix;
mod frozen;
mod garbage;
pub mod judge;
pub mod live;
pub mod null;
pub mod output;
pub mod page;
mod paper;
mod parallel;
pub mod paths;
pub mod peer;
pub mod posture;
pub mod progress;
pub mod record;
pub mod remote;
pub mod replay;
pub mod report;
pub mod say;
pub mod scenarios;
pub mod sequence;
pub mod session;
pub mod steering;
pub mod track_recorded;
pub mod tracker_args;

/// Parses the command line, does what it asks, and turns the outcome into the exit code.
pub fn main() -> ExitCode {
    let cli = cli::Cli::parse();
    match commands::dispatch(cli.command) {
        Ok(verdict) => verdict.into(),
        Err(error) => {
            eprintln!("{error}");
            error.exit_code()
        }
    }
}
