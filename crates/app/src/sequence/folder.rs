use std::cmp::Ordering;
use std::fs;
use std::path::{Path, PathBuf};

use image::ImageReader;
use sonoloop_types::Image;

use super::{MAX_SIDE_PX, SequenceError, SequenceProblem};

/// Reads the PNG files of a folder in natural order: `a2.png` before `a10.png`.
#[derive(Debug)]
pub(super) struct PngFolder {
    files: Vec<PathBuf>,
    next: usize,
    first_px: Option<[u32; 2]>,
}

impl PngFolder {
    pub fn open(path: &Path) -> Result<Self, SequenceError> {
        let mut files = Self::list(path).map_err(|error| SequenceProblem::Io(error).at(path))?;
        if files.is_empty() {
            return Err(SequenceProblem::NoPictures.at(path));
        }
        files.sort_by(|a, b| natural(&name(a), &name(b)));
        Ok(Self { files, next: 0, first_px: None })
    }

    fn list(path: &Path) -> std::io::Result<Vec<PathBuf>> {
        let mut files = Vec::new();
        for entry in fs::read_dir(path)? {
            let file = entry?.path();
            if file.extension().is_some_and(|ext| ext.eq_ignore_ascii_case("png")) && file.is_file() {
                files.push(file);
            }
        }
        Ok(files)
    }

    pub fn image_count(&self) -> usize {
        self.files.len()
    }

    /// The next picture as grey levels; all must have the size of the first.
    pub fn next_image(&mut self) -> Result<Option<Image>, SequenceError> {
        let Some(file) = self.files.get(self.next) else { return Ok(None) };
        let image = read_png(file).map_err(|problem| problem.at(file))?;
        let size_px = [image.width_px, image.height_px];
        let first_px = *self.first_px.get_or_insert(size_px);
        if size_px != first_px {
            let [width_px, height_px] = size_px;
            return Err(SequenceProblem::Size { width_px, height_px, first_px }.at(file));
        }
        self.next += 1;
        Ok(Some(image))
    }
}

fn read_png(file: &Path) -> Result<Image, SequenceProblem> {
    let mut reader = ImageReader::open(file)?;
    reader.set_format(image::ImageFormat::Png);
    let mut limits = image::Limits::default();
    limits.max_image_width = Some(MAX_SIDE_PX);
    limits.max_image_height = Some(MAX_SIDE_PX);
    reader.limits(limits);
    let grey = reader.decode()?.into_luma8();
    Ok(Image { width_px: grey.width(), height_px: grey.height(), pixels: grey.into_raw() })
}

fn name(path: &Path) -> String {
    path.file_name().unwrap_or_default().to_string_lossy().into_owned()
}

/// Compares runs of digits by their value, everything else letter by letter.
fn natural(a: &str, b: &str) -> Ordering {
    let (mut a_left, mut b_left) = (a.as_bytes(), b.as_bytes());
    loop {
        let (a_digits, b_digits) = (digits(a_left), digits(b_left));
        let order = if a_digits > 0 && b_digits > 0 {
            let [x, y] = [&a_left[..a_digits], &b_left[..b_digits]].map(|run| {
                let zeros = run.iter().take_while(|d| **d == b'0').count();
                &run[zeros..]
            });
            (a_left, b_left) = (&a_left[a_digits..], &b_left[b_digits..]);
            x.len().cmp(&y.len()).then_with(|| x.cmp(y))
        } else {
            match (a_left.split_first(), b_left.split_first()) {
                (Some((x, a_rest)), Some((y, b_rest))) => {
                    (a_left, b_left) = (a_rest, b_rest);
                    x.cmp(y)
                }
                // Equal but for zeros in front of numbers: any fixed order will do.
                (None, None) => return a.cmp(b),
                (x, y) => return x.is_some().cmp(&y.is_some()),
            }
        };
        if order != Ordering::Equal {
            return order;
        }
    }
}

fn digits(text: &[u8]) -> usize {
    text.iter().take_while(|byte| byte.is_ascii_digit()).count()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_ordered_as_people_count() {
        let mut names =
            ["a10.png", "b1.png", "a2.png", "a02.png", "a.png", "a2b.png", "a99999999999999999999.png"];
        names.sort_by(|a, b| natural(a, b));
        let expected =
            ["a.png", "a02.png", "a2.png", "a2b.png", "a10.png", "a99999999999999999999.png", "b1.png"];
        assert_eq!(names, expected);
    }
}
