use std::fmt::Write as _;
use std::fs::File;
use std::io::{self, BufWriter, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

use flate2::Compression;
use flate2::write::ZlibEncoder;
use sonoloop_types::{Image, Pose};
use tempfile::NamedTempFile;

use super::{SequenceError, SequenceProblem};

/// Writes a zlib-compressed `.mha` sequence of the PLUS kind, image by image.
///
/// Speckle hardly compresses, so the fastest level loses little. The file gets its name in [`Self::finish`];
/// dropped before, a writer leaves nothing behind.
#[derive(Debug)]
pub struct SequenceWriter {
    path: PathBuf,
    size_px: [u32; 2],
    spacing_mm: f64,
    images: usize,
    custom: String,
    names: Vec<String>,
    frames: String,
    data: ZlibEncoder<BufWriter<File>>,
}

impl SequenceWriter {
    /// Begins a sequence of images of `[columns, rows]` pixels, `spacing_mm` apart both ways, depth running down.
    pub fn create(path: &Path, size_px: [u32; 2], spacing_mm: f64) -> Result<Self, SequenceError> {
        let at = |problem: SequenceProblem| problem.at(path);
        if size_px.contains(&0) {
            let value = format!("{} {}", size_px[0], size_px[1]);
            return Err(at(SequenceProblem::value("DimSize", &value, "positive")));
        }
        let data = tempfile::tempfile_in(folder_of(path)).map_err(|error| at(error.into()))?;
        Ok(Self {
            path: path.to_owned(),
            size_px,
            spacing_mm,
            images: 0,
            custom: String::new(),
            names: Vec::new(),
            frames: String::new(),
            data: ZlibEncoder::new(BufWriter::new(data), Compression::fast()),
        })
    }

    /// Says something of the whole sequence.
    pub fn set(&mut self, name: &str, value: &str) -> Result<(), SequenceError> {
        self.check(name, value)?;
        let _ = writeln!(self.custom, "{name} = {value}");
        Ok(())
    }

    /// Adds an image with its time, its transforms (`base_from_probe` is called `ProbeToBase`) and other fields.
    pub fn push(
        &mut self,
        image: &Image,
        timestamp_s: f64,
        transforms: &[(&str, Pose)],
        fields: &[(&str, &str)],
    ) -> Result<(), SequenceError> {
        let size_px = [image.width_px, image.height_px];
        if size_px != self.size_px {
            let [width_px, height_px] = size_px;
            let problem = SequenceProblem::Size { width_px, height_px, first_px: self.size_px };
            return Err(problem.at(&self.path));
        }
        let mut lines = vec![("Timestamp".to_owned(), format!("{timestamp_s:.6}"))];
        lines.push(("ImageStatus".to_owned(), "OK".to_owned()));
        for (name, pose) in transforms {
            lines.push((format!("{name}Transform"), matrix_mm(pose)));
            lines.push((format!("{name}TransformStatus"), "OK".to_owned()));
        }
        lines.extend(fields.iter().map(|(name, value)| ((*name).to_owned(), (*value).to_owned())));
        for (name, value) in &lines {
            self.check(name, value)?;
        }
        self.data.write_all(&image.pixels).map_err(|error| SequenceProblem::from(error).at(&self.path))?;
        for (name, value) in lines {
            let _ = writeln!(self.frames, "Seq_Frame{:04}_{name} = {value}", self.images);
            if !self.names.contains(&name) {
                self.names.push(name);
            }
        }
        self.images += 1;
        Ok(())
    }

    /// Completes the file under its final name.
    pub fn finish(self) -> Result<(), SequenceError> {
        let path = self.path.clone();
        self.try_finish().map_err(|error| SequenceProblem::from(error).at(&path))
    }

    fn try_finish(self) -> io::Result<()> {
        let [width, height] = self.size_px;
        let (images, spacing) = (self.images, self.spacing_mm);
        let mut data = self.data.finish()?.into_inner().map_err(io::IntoInnerError::into_error)?;
        let bytes = data.stream_position()?;
        data.seek(SeekFrom::Start(0))?;
        let mut file = NamedTempFile::new_in(folder_of(&self.path))?;
        write!(
            file,
            "ObjectType = Image\nNDims = 3\nBinaryData = True\nBinaryDataByteOrderMSB = False\n\
             CompressedData = True\nCompressedDataSize = {bytes}\nTransformMatrix = 1 0 0 0 1 0 0 0 1\n\
             Offset = 0 0 0\nCenterOfRotation = 0 0 0\nAnatomicalOrientation = RAI\n\
             ElementSpacing = {spacing} {spacing} 1\nDimSize = {width} {height} {images}\n\
             UltrasoundImageOrientation = MF\nUltrasoundImageType = BRIGHTNESS\n\
             CustomFrameFieldNames = {}\n{}{}ElementType = MET_UCHAR\nElementDataFile = LOCAL\n",
            self.names.join(" "),
            self.custom,
            self.frames,
        )?;
        io::copy(&mut data, &mut file)?;
        file.flush()?;
        make_readable(file.as_file())?;
        file.persist(&self.path)?;
        Ok(())
    }

    /// A name must be one word without separators, a value one line.
    fn check(&self, name: &str, value: &str) -> Result<(), SequenceError> {
        let is_word = !name.is_empty() && name.bytes().all(|b| b.is_ascii_alphanumeric() || b == b'_');
        let is_line = !value.chars().any(char::is_control);
        if is_word && is_line {
            return Ok(());
        }
        Err(SequenceProblem::value(name, value, "a word of letters, digits and _ = one line of text")
            .at(&self.path))
    }
}

/// A rigid transform as PLUS writes it: 4 × 4 row by row, lengths in millimetres.
fn matrix_mm(pose: &Pose) -> String {
    let mut matrix = pose.to_homogeneous();
    for row in 0..3 {
        matrix[(row, 3)] *= 1000.0;
    }
    // The iterator of the transpose runs along the rows.
    let numbers: Vec<String> = matrix.transpose().iter().map(f64::to_string).collect();
    numbers.join(" ")
}

fn folder_of(path: &Path) -> &Path {
    path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."))
}

/// Temporary files are private; a finished one is as readable as any other.
fn make_readable(file: &File) -> io::Result<()> {
    #[cfg(unix)]
    {
        use std::os::unix::fs::PermissionsExt;
        file.set_permissions(std::fs::Permissions::from_mode(0o644))?;
    }
    let _ = file;
    Ok(())
}
