//! From paths on the command line to scenarios that can run.

use std::path::{Path, PathBuf};

use sonoloop_scenario::{LoadOptions, Scenario};

use crate::error::AppError;
use crate::session::Session;

/// Loads a scenario and builds its session; every error is bad input.
pub fn prepare(file: &Path, seed: Option<u64>, set: &[String]) -> Result<(Scenario, Session), AppError> {
    let options = LoadOptions { seed, set: set.to_vec(), ..LoadOptions::default() };
    let scenario = sonoloop_scenario::load(file, &options)?;
    let session = Session::new(&scenario)
        .map_err(|error| AppError::BadInput(format!("{}: {error}", file.display())))?;
    Ok((scenario, session))
}

/// The files named, and below the folders named every `*.yaml`, sorted; an error when there is none.
pub fn find(paths: &[PathBuf]) -> Result<Vec<PathBuf>, AppError> {
    let mut files = Vec::new();
    for path in paths {
        if path.is_dir() {
            let before = files.len();
            collect(path, &mut files).map_err(|e| AppError::BadInput(format!("{}: {e}", path.display())))?;
            files[before..].sort();
            if files.len() == before {
                return Err(AppError::BadInput(format!("{}: no *.yaml below this folder", path.display())));
            }
        } else {
            files.push(path.clone());
        }
    }
    Ok(files)
}

fn collect(folder: &Path, files: &mut Vec<PathBuf>) -> std::io::Result<()> {
    for entry in std::fs::read_dir(folder)? {
        let path = entry?.path();
        if path.is_dir() {
            collect(&path, files)?;
        } else if path.extension().is_some_and(|e| e == "yaml") {
            files.push(path);
        }
    }
    Ok(())
}
