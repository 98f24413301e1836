//! `pictures.mjpeg`: every image of a run at half its size or less, one JPEG after another, which is what players and ffmpeg
//! know as motion JPEG. Reports show these.

use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::Path;

use image::GrayImage;
use image::codecs::jpeg::JpegEncoder;
use image::imageops::thumbnail;
use sonoloop_types::Image;

use super::OutputError;
use crate::record::ImageStore;

/// Name of the file.
pub(crate) const PICTURES: &str = "pictures.mjpeg";

/// Pictures are halved, or divided further, until they are no wider than this.
const MOST_WIDTH_PX: u32 = 320;
/// JPEG quality: speckle of 320×240 pixels comes to some 12 kB.
const QUALITY: u8 = 70;

/// Writes the first `count` pictures.
pub(super) fn write_pictures(path: &Path, pixels: &ImageStore, count: usize) -> Result<(), OutputError> {
    let file = File::create(path).map_err(|source| OutputError::at(path, source))?;
    let mut writer = BufWriter::new(file);
    for index in 0..count {
        let image = pixels.get(index).map_err(OutputError::Pictures)?;
        writer.write_all(&jpeg(&image)?).map_err(|source| OutputError::at(path, source))?;
    }
    writer.flush().map_err(|source| OutputError::at(path, source))
}

/// A picture made small enough, in grey.
pub(crate) fn jpeg(image: &Image) -> Result<Vec<u8>, OutputError> {
    let divisor = image.width_px.div_ceil(MOST_WIDTH_PX).max(1);
    let (width_px, height_px) = (image.width_px / divisor, (image.height_px / divisor).max(1));
    let full = GrayImage::from_raw(image.width_px, image.height_px, image.pixels.clone()).unwrap_or_default();
    let small = thumbnail(&full, width_px, height_px);
    let mut bytes = Vec::new();
    JpegEncoder::new_with_quality(&mut bytes, QUALITY).encode_image(&small)?;
    Ok(bytes)
}

/// The single JPEG files in a stream of them; `None` where it is no such stream or ends in the middle of a picture.
pub(crate) fn split(mut stream: &[u8]) -> Option<Vec<&[u8]>> {
    let mut pictures = Vec::new();
    while !stream.is_empty() {
        let (picture, rest) = stream.split_at_checked(length(stream)?)?;
        pictures.push(picture);
        stream = rest;
    }
    Some(pictures)
}

/// Bytes of the JPEG file at the start: segments with their lengths up to the scan, whose data has no marker but its end
/// (ITU-T T.81, B.1.1).
fn length(bytes: &[u8]) -> Option<usize> {
    const SCAN: u8 = 0xDA;
    if !bytes.starts_with(&[0xFF, 0xD8]) {
        return None;
    }
    let mut at = 2;
    loop {
        let &[0xFF, marker, high, low] = bytes.get(at..at + 4)? else { return None };
        at += 2 + usize::from(u16::from_be_bytes([high, low]));
        if marker == SCAN {
            let end = bytes.get(at..)?.windows(2).position(|pair| pair == [0xFF, 0xD9])?;
            return Some(at + end + 2);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn noise(width_px: u32, height_px: u32, seed: u32) -> Image {
        let mut word = seed | 1;
        let pixels = (0..width_px * height_px).map(|_| {
            word = word.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            (word >> 24) as u8
        });
        Image::from_pixels(width_px, height_px, pixels.collect()).unwrap()
    }

    #[test]
    fn a_stream_comes_apart_into_the_pictures_it_was_made_of() {
        let images: Vec<Image> = (0..4).map(|k| noise(640, 480, 77 * k)).collect();
        let mut store = ImageStore::new().unwrap();
        images.iter().for_each(|image| store.push(image).unwrap());
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join(PICTURES);
        write_pictures(&path, &store, 3).unwrap();
        let stream = std::fs::read(&path).unwrap();
        let pictures = split(&stream).unwrap();
        assert_eq!(pictures, images[..3].iter().map(|image| jpeg(image).unwrap()).collect::<Vec<_>>());
        for picture in pictures {
            let decoded = image::load_from_memory(picture).unwrap();
            assert_eq!((decoded.width(), decoded.height()), (320, 240));
        }
        for broken in [&stream[..stream.len() - 1], &stream[1..], b"\xFF\xD8\xFF", b"no picture"] {
            assert_eq!(split(broken), None);
        }
        assert_eq!(split(&[]), Some(vec![]));
    }

    #[test]
    fn a_small_picture_keeps_its_size() {
        let decoded = image::load_from_memory(&jpeg(&noise(128, 96, 5)).unwrap()).unwrap();
        assert_eq!((decoded.width(), decoded.height()), (128, 96));
    }
}
