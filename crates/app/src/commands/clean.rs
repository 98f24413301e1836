//! `sonoloop clean`: what killed runs left behind.

use crate::error::{AppError, Outcome};
use crate::say::say;

/// Removes the shared memory of every domain whose lock is free.
pub fn clean() -> Result<Outcome, AppError> {
    let report = sonoloop_wire::clean();
    say(format_args!(
        "{} left-over domains removed, {} live runs untouched",
        report.removed.len(),
        report.live
    ));
    if report.failed.is_empty() {
        return Ok(Outcome::Pass);
    }
    let failed: Vec<String> =
        report.failed.iter().map(|(path, why)| format!("{}: {why}", path.display())).collect();
    Err(AppError::Fault(failed.join("\n")))
}
