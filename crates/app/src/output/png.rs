use std::io::{self, Write};
use std::path::Path;

use image::codecs::png::PngEncoder;
use image::{ExtendedColorType, ImageEncoder, ImageError, RgbImage};
use sonoloop_types::Image;

/// Writes a picture as 8-bit grey PNG; under its name only once it is complete.
pub fn write_png(path: &Path, image: &Image) -> io::Result<()> {
    let absolute = std::path::absolute(path)?;
    let folder = absolute.parent().ok_or_else(|| io::Error::other("not the name of a file"))?;
    let mut png = Vec::new();
    PngEncoder::new(&mut png)
        .write_image(&image.pixels, image.width_px, image.height_px, ExtendedColorType::L8)
        .map_err(io::Error::other)?;
    let mut file = tempfile::Builder::new().prefix(".png.").tempfile_in(folder)?;
    file.write_all(&png)?;
    #[cfg(unix)]
    {
        // A temporary file is made for its owner alone; the result is for everyone who may read the folder.
        use std::os::unix::fs::PermissionsExt;
        file.as_file().set_permissions(std::fs::Permissions::from_mode(0o644))?;
    }
    file.persist(&absolute)?;
    Ok(())
}

/// A colour picture as the bytes of a PNG.
pub(crate) fn rgb_png(picture: &RgbImage) -> Result<Vec<u8>, ImageError> {
    let mut png = Vec::new();
    let encoder = PngEncoder::new(&mut png);
    encoder.write_image(picture, picture.width(), picture.height(), ExtendedColorType::Rgb8)?;
    Ok(png)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_picture_comes_back_as_it_was() {
        let root = tempfile::tempdir().unwrap();
        let path = root.path().join("picture.png");
        let image = Image::from_pixels(7, 5, (0..35).map(|k| k * 7).collect()).unwrap();
        write_png(&path, &image).unwrap();
        let back = image::open(&path).unwrap().into_luma8();
        assert_eq!((back.dimensions(), back.into_raw()), ((7, 5), image.pixels));
        assert_eq!(std::fs::read_dir(root.path()).unwrap().count(), 1);
        assert!(write_png(&root.path().join("missing/picture.png"), &Image::black(2, 2)).is_err());
    }
}
