//! Paths on the command line, looked at before any work is done.

use std::path::Path;

use crate::error::AppError;

/// Refuses a file that is not there. The defaults lie in the repository, so whoever stands elsewhere is told so.
pub fn file_is_there(option: &str, file: &Path) -> Result<(), AppError> {
    if file.exists() {
        return Ok(());
    }
    let place = if file.is_relative() {
        ": looked for relative to the current folder; start in sonoloop's folder or name another file"
    } else {
        ""
    };
    Err(AppError::BadInput(format!("error: {option} {}: there is no such file{place}", file.display())))
}

/// Refuses a folder for results where a file is in the way, at its place or above it. It is made when there is something
/// to put into it.
pub fn no_file_in_the_way(option: &str, folder: Option<&Path>) -> Result<(), AppError> {
    match folder.and_then(|folder| folder.ancestors().find(|part| part.exists() && !part.is_dir())) {
        None => Ok(()),
        Some(file) => {
            Err(AppError::BadInput(format!("error: {option}: {} is a file, not a folder", file.display())))
        }
    }
}
