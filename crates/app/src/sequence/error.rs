use std::io;
use std::path::{Path, PathBuf};

/// Longest piece of a foreign value that is repeated in a message.
const SHOWN_CHARS: usize = 60;

/// A sequence that cannot be read or written: which file, and why. One line.
#[derive(Debug, thiserror::Error)]
#[error("{}: {problem}", .path.display())]
pub struct SequenceError {
    /// The file, or the folder.
    pub path: PathBuf,
    /// What is wrong with it.
    pub problem: SequenceProblem,
}

/// What is wrong with a sequence.
#[derive(Debug, thiserror::Error)]
pub enum SequenceProblem {
    /// The operating system refused.
    #[error("{0}")]
    Io(#[from] io::Error),
    /// There is nothing in it.
    #[error("the file is empty")]
    Empty,
    /// It does not begin like one.
    #[error("not an .mha sequence: the first line must be \"ObjectType = Image\"")]
    NotMeta,
    /// A header line has no `Key = Value`, or is far too long.
    #[error("header line {line} is not \"Key = Value\"")]
    HeaderLine {
        /// Counted from 1.
        line: usize,
    },
    /// The header ends without its last key.
    #[error("the header has no ElementDataFile")]
    HeaderEnd,
    /// A key that must be there is not.
    #[error("{0} is missing")]
    Missing(&'static str),
    /// A value that cannot be used.
    #[error("{key} = {value} must be {bound}")]
    Value {
        /// The key.
        key: String,
        /// Its value, cut when long.
        value: String,
        /// What it must be.
        bound: &'static str,
    },
    /// The images end early.
    #[error("the data end in image {image} of {images} (counted from 0)")]
    Truncated {
        /// The image that is not whole.
        image: usize,
        /// Images the header announces.
        images: usize,
    },
    /// There is more than the header says.
    #[error("more data follow than {images} images")]
    Excess {
        /// Images the header announces.
        images: usize,
    },
    /// The compressed data are damaged.
    #[error("the compressed data are damaged in image {image} (counted from 0)")]
    Damaged {
        /// The image that cannot be unpacked.
        image: usize,
    },
    /// A folder without pictures.
    #[error("the folder holds no .png files")]
    NoPictures,
    /// A picture that cannot be decoded.
    #[error("{0}")]
    Picture(#[from] image::ImageError),
    /// A picture of another size.
    #[error("{width_px} × {height_px} px, but the first image has {} × {} px", .first_px[0], .first_px[1])]
    Size {
        /// Columns.
        width_px: u32,
        /// Rows.
        height_px: u32,
        /// Columns and rows of the first image.
        first_px: [u32; 2],
    },
}

impl SequenceProblem {
    /// A value that cannot be used.
    pub(super) fn value(key: &str, value: &str, bound: &'static str) -> Self {
        let shown: String = value.chars().filter(|c| !c.is_control()).take(SHOWN_CHARS).collect();
        Self::Value { key: key.to_owned(), value: shown, bound }
    }

    /// Names the file.
    pub(super) fn at(self, path: &Path) -> SequenceError {
        SequenceError { path: path.to_owned(), problem: self }
    }
}
