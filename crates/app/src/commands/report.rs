//! `sonoloop report`: the page of a run, made again from its files.

use std::io::Write;

use crate::cli::FolderArgs;
use crate::error::{AppError, Outcome};
use crate::report::{REPORT, ReportError, page};
use crate::say::say;

/// Writes the page into the run's folder; it is whole before it gets its name.
pub fn report(args: &FolderArgs) -> Result<Outcome, AppError> {
    let text = page(&args.folder).map_err(|error| match error {
        ReportError::Files(error) => AppError::bad_input(format_args!("error: {error}")),
        ReportError::Page(error) => AppError::fault(error),
    })?;
    let target = args.folder.join(REPORT);
    let fault = |error: std::io::Error| AppError::fault(format_args!("{}: {error}", target.display()));
    let mut file = tempfile::Builder::new()
        .prefix(".report.")
        .permissions(readable())
        .tempfile_in(&args.folder)
        .map_err(fault)?;
    file.write_all(text.as_bytes()).map_err(fault)?;
    file.persist(&target).map_err(|error| fault(error.error))?;
    say(target.display());
    Ok(Outcome::Pass)
}

/// As any other file: for everyone, less what the user's mask forbids.
fn readable() -> std::fs::Permissions {
    use std::os::unix::fs::PermissionsExt;
    std::fs::Permissions::from_mode(0o666)
}
