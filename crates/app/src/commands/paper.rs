//! `sonoloop paper`: the paper's experiments, and a report of them.

use crate::cli::PaperArgs;
use crate::error::{AppError, Outcome};
use crate::paper;
use crate::paths::no_file_in_the_way;

/// Runs them as the command line says.
pub fn run(args: &PaperArgs) -> Result<Outcome, AppError> {
    no_file_in_the_way("--out", Some(&args.out))?;
    paper::paper(&args.scenarios, &args.out, args.studies)
}
