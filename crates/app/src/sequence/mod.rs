//! Recorded image sequences: `.mha` files of the PLUS kind, read and written, and folders of PNG files, read.
//!
//! Images are handed out one at a time, turned so that depth runs down.

mod error;
mod folder;
mod header;
mod mha;
mod orientation;
#[cfg(test)]
mod tests;
mod writer;

use std::path::Path;

use sonoloop_types::Image;

pub use error::{SequenceError, SequenceProblem};
use folder::PngFolder;
pub use header::FieldValues;
use mha::MhaReader;
pub use writer::SequenceWriter;

/// Larger pictures are taken for a mistake.
const MAX_SIDE_PX: u32 = 8192;

/// A recorded sequence, open at its first image.
#[derive(Debug)]
pub struct Sequence {
    source: Source,
}

#[derive(Debug)]
enum Source {
    Mha(Box<MhaReader>),
    Folder(PngFolder),
}

impl Sequence {
    /// Opens an `.mha` file or a folder of PNG files (in natural order of their names).
    ///
    /// Refuses, with the file, the key and its value, what is not such a sequence.
    pub fn open(path: &Path) -> Result<Self, SequenceError> {
        let source = if path.is_dir() {
            Source::Folder(PngFolder::open(path)?)
        } else {
            Source::Mha(Box::new(MhaReader::open(path)?))
        };
        Ok(Self { source })
    }

    /// Number of images, at least one.
    pub fn image_count(&self) -> usize {
        match &self.source {
            Source::Mha(reader) => reader.image_count(),
            Source::Folder(folder) => folder.image_count(),
        }
    }

    /// The next image, `None` after the last. A damaged image, or bytes left over after the last, are an error.
    pub fn next_image(&mut self) -> Result<Option<Image>, SequenceError> {
        match &mut self.source {
            Source::Mha(reader) => reader.next_image(),
            Source::Folder(folder) => folder.next_image(),
        }
    }

    /// What the file says of its images one by one (`Seq_Frame…` lines); `None` for a folder.
    pub fn fields(&self) -> Option<&FieldValues> {
        match &self.source {
            Source::Mha(reader) => Some(reader.fields()),
            Source::Folder(_) => None,
        }
    }
}
