use std::fs::File;
use std::io::{self, BufReader, ErrorKind, Read, Seek};
use std::path::{Path, PathBuf};

use flate2::read::ZlibDecoder;
use sonoloop_types::Image;

use super::header::{FieldValues, Header};
use super::{SequenceError, SequenceProblem};

/// Reads one image at a time from an `.mha` file.
#[derive(Debug)]
pub(super) struct MhaReader {
    path: PathBuf,
    header: Header,
    data: Data,
    next: usize,
}

#[derive(Debug)]
enum Data {
    Raw(BufReader<File>),
    Zlib(ZlibDecoder<io::Take<BufReader<File>>>),
}

impl MhaReader {
    /// Reads the header, and refuses a file that is too short or too long for it where that can be seen already.
    pub fn open(path: &Path) -> Result<Self, SequenceError> {
        Self::try_open(path).map_err(|problem| problem.at(path))
    }

    fn try_open(path: &Path) -> Result<Self, SequenceProblem> {
        let file = File::open(path)?;
        let length = file.metadata()?.len();
        let mut input = BufReader::new(file);
        let header = Header::read(&mut input)?;
        let left = length.saturating_sub(input.stream_position()?);
        let images = header.images;
        let per_image = header.image_bytes() as u64;
        let data = match header.compressed {
            None => {
                let expected = per_image * images as u64;
                if left < expected {
                    return Err(SequenceProblem::Truncated { image: (left / per_image) as usize, images });
                }
                if left > expected {
                    return Err(SequenceProblem::Excess { images });
                }
                Data::Raw(input)
            }
            Some(bytes) => {
                if let Some(bytes) = bytes.filter(|bytes| *bytes > left) {
                    let bound = "no more than the file holds (it is truncated)";
                    return Err(SequenceProblem::value("CompressedDataSize", &bytes.to_string(), bound));
                }
                Data::Zlib(ZlibDecoder::new(input.take(bytes.unwrap_or(left))))
            }
        };
        Ok(Self { path: path.to_owned(), header, data, next: 0 })
    }

    pub fn image_count(&self) -> usize {
        self.header.images
    }

    pub fn fields(&self) -> &FieldValues {
        &self.header.fields
    }

    pub fn next_image(&mut self) -> Result<Option<Image>, SequenceError> {
        self.try_next().map_err(|problem| problem.at(&self.path))
    }

    fn try_next(&mut self) -> Result<Option<Image>, SequenceProblem> {
        let (image, images) = (self.next, self.header.images);
        let explain = |error: io::Error| match error.kind() {
            ErrorKind::UnexpectedEof => SequenceProblem::Truncated { image, images },
            ErrorKind::InvalidInput | ErrorKind::InvalidData => SequenceProblem::Damaged { image },
            _ => SequenceProblem::Io(error),
        };
        if image == images {
            return match self.data.read(&mut [0]).map_err(explain)? {
                0 => Ok(None),
                _ => Err(SequenceProblem::Excess { images }),
            };
        }
        let mut stored = vec![0; self.header.image_bytes()];
        self.data.read_exact(&mut stored).map_err(explain)?;
        self.next += 1;
        Ok(Some(self.header.orientation.turn(self.header.size_px, stored)))
    }
}

impl Read for Data {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        match self {
            Self::Raw(input) => input.read(buffer),
            Self::Zlib(input) => input.read(buffer),
        }
    }
}
