use std::io;
use std::path::{Path, PathBuf};

use crate::report::ReportError;
use crate::sequence::SequenceError;

/// Why the files of a run could not be written.
#[derive(Debug, thiserror::Error)]
pub enum OutputError {
    /// A file or folder could not be written.
    #[error("cannot write {}: {source}", path.display())]
    Write {
        /// Its final name.
        path: PathBuf,
        /// What the system said.
        source: io::Error,
    },
    /// The spooled pictures could not be read back.
    #[error("cannot read the pictures of the run back: {0}")]
    Pictures(#[source] io::Error),
    /// The animated picture could not be encoded.
    #[error("cannot encode the animated picture: {0}")]
    Animation(#[from] gif::EncodingError),
    /// The report could not be made from the files written so far.
    #[error("cannot make the report: {0}")]
    Report(#[source] ReportError),
    /// A picture could not be encoded.
    #[error("cannot encode a picture: {0}")]
    Picture(#[from] image::ImageError),
    /// The recorded sequence could not be written.
    #[error("cannot write the sequence: {0}")]
    Sequence(#[from] SequenceError),
}

impl OutputError {
    pub(super) fn at(path: &Path, source: io::Error) -> Self {
        Self::Write { path: path.to_owned(), source }
    }
}
