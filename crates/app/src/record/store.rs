use std::fs::File;
use std::io::{self, Seek, SeekFrom, Write};
use std::os::unix::fs::FileExt;

use sonoloop_types::Image;

/// The pictures of a run, spooled to a nameless temporary file so that a long run needs no more memory
/// than a short one. The file vanishes with the store, also when the process is killed.
#[derive(Debug)]
pub struct ImageStore {
    file: File,
    sizes_px: Vec<(u32, u32)>,
    offsets: Vec<u64>,
    end: u64,
}

impl ImageStore {
    /// An empty store; fails when the temporary folder cannot be written.
    pub fn new() -> io::Result<Self> {
        Ok(Self { file: tempfile::tempfile()?, sizes_px: Vec::new(), offsets: Vec::new(), end: 0 })
    }

    /// Appends a picture; fails when the disk is full. A failed picture is not counted.
    pub fn push(&mut self, image: &Image) -> io::Result<()> {
        self.file.seek(SeekFrom::Start(self.end))?;
        self.file.write_all(&image.pixels)?;
        self.offsets.push(self.end);
        self.sizes_px.push((image.width_px, image.height_px));
        self.end += image.pixels.len() as u64;
        Ok(())
    }

    /// Number of pictures.
    pub fn len(&self) -> usize {
        self.offsets.len()
    }

    /// True before the first picture.
    pub fn is_empty(&self) -> bool {
        self.offsets.is_empty()
    }

    /// Columns and rows of picture `index`.
    pub fn size_px(&self, index: usize) -> Option<(u32, u32)> {
        self.sizes_px.get(index).copied()
    }

    /// Reads picture `index` back, from any thread; `InvalidInput` when there is none.
    pub fn get(&self, index: usize) -> io::Result<Image> {
        let (Some(&offset), Some(&(width_px, height_px))) =
            (self.offsets.get(index), self.sizes_px.get(index))
        else {
            let message = format!("picture {index} of {}", self.len());
            return Err(io::Error::new(io::ErrorKind::InvalidInput, message));
        };
        let mut image = Image::black(width_px, height_px);
        self.file.read_exact_at(&mut image.pixels, offset)?;
        Ok(image)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pictures_come_back_in_any_order() {
        let mut store = ImageStore::new().unwrap();
        assert!(store.is_empty());
        let pictures: Vec<Image> = (0..5u8)
            .map(|k| Image::from_pixels(4, 2 + u32::from(k), vec![k; 4 * (2 + usize::from(k))]).unwrap())
            .collect();
        for picture in &pictures {
            store.push(picture).unwrap();
        }
        assert_eq!(store.len(), 5);
        for index in [3, 0, 4, 1, 2, 2] {
            assert_eq!(store.get(index).unwrap(), pictures[index]);
        }
        assert_eq!(store.get(5).unwrap_err().kind(), io::ErrorKind::InvalidInput);
    }
}
