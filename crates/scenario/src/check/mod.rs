//! Raw files → the model: SI units, and everything that takes more than one value to judge.

mod arm;
mod insertion;
mod library;
mod phantom;
mod scenario;
mod settings;
mod timeline;
mod tools;
mod units;
mod urdf;

pub(crate) use library::Library;
pub(crate) use phantom::{materials, phantom};
pub(crate) use scenario::build;
pub(crate) use tools::{needle, probe};

use std::path::PathBuf;

use crate::LoadError;
use crate::document::Document;

/// The path that `key` of `document` names. That there is nothing is the naming file's mistake.
fn named_file(document: &Document, key: &str, relative: &str) -> Result<PathBuf, LoadError> {
    let path = document.source.sibling(relative);
    if path.exists() {
        Ok(path)
    } else {
        Err(document.fail(key, format!("there is no such file: {}", path.display())))
    }
}
