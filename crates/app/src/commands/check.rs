//! `sonoloop check`: everything that a run checks before its first tick.

use crate::cli::CheckArgs;
use crate::error::{AppError, Outcome};
use crate::say::say;
use crate::scenarios::{find, prepare};

/// Checks each scenario and says so; fails with the first one's error after all were tried.
pub fn check(args: &CheckArgs) -> Result<Outcome, AppError> {
    let mut first_error = None;
    for file in find(&args.paths)? {
        match prepare(&file, None, &[]) {
            Ok((scenario, _)) => say(format_args!("{}: ok ({})", file.display(), scenario.description)),
            Err(error) => {
                if first_error.is_some() {
                    eprintln!("{error}");
                } else {
                    first_error = Some(error);
                }
            }
        }
    }
    first_error.map_or(Ok(Outcome::Pass), Err)
}
