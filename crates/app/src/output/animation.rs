//! An animated GIF without a quantiser: the overlay uses greys and a handful of known colours, so the
//! palette is fixed and every text pixel comes out as drawn.

use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::Path;

use embedded_graphics::prelude::RgbColor;
use gif::{Encoder, Frame, Repeat};
use image::RgbImage;

use super::OutputError;
use super::colour::COLOURS;
use super::overlay::Scale;

/// Greys of the palette. Speckle hides the steps, and 7 instead of 8 bits save a fifth of the file.
const GREYS: usize = 128 - COLOURS.len();

/// Largest file aimed at.
const BUDGET_BYTES: usize = 20_000_000;

/// Browsers slow down what is faster than 50 images per second, and people see no more than this.
const LEAST_PERIOD_MS: u64 = 80;

/// Pictures that can be drawn one by one, at either size.
pub(crate) trait Pictures {
    fn len(&self) -> usize;
    fn period_ms(&self) -> u64;
    fn size_px(&self, scale: Scale) -> (u32, u32);
    fn draw(&self, index: usize, scale: Scale) -> Result<RgbImage, OutputError>;
}

/// How the picture was thinned out to keep within the budget.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Thinning {
    /// Every how many images one is shown.
    pub stride: usize,
    pub scale: Scale,
}

/// Writes the animation and says how it was thinned out. Plays in real time.
pub(crate) fn write_gif(path: &Path, frames: &impl Pictures) -> Result<Thinning, OutputError> {
    let thinning = thinning(frames)?;
    let file = File::create(path).map_err(|source| OutputError::at(path, source))?;
    let writer = BufWriter::new(file);
    let shown: Vec<usize> = (0..frames.len()).step_by(thinning.stride).collect();
    let mut writer = encode(writer, frames, &shown, thinning)?;
    writer.flush().map_err(|source| OutputError::at(path, source))?;
    Ok(thinning)
}

/// The finest thinning whose file, judged by three sample images, keeps within the budget.
fn thinning(frames: &impl Pictures) -> Result<Thinning, OutputError> {
    let least = LEAST_PERIOD_MS.div_ceil(frames.period_ms().max(1)).max(1) as usize;
    let last = frames.len().saturating_sub(1);
    for scale in [Scale::Full, Scale::Half] {
        let samples = [last / 6, last / 2, last * 5 / 6];
        let bytes =
            encode(Vec::new(), frames, &samples, Thinning { stride: 1, scale })?.len() / samples.len();
        // Down to four images per second at full size, below that half the size looks better.
        let most = if scale == Scale::Full { least * 3 } else { usize::MAX };
        let needed = (frames.len() * bytes).div_ceil(BUDGET_BYTES).max(least);
        if needed <= most {
            return Ok(Thinning { stride: needed, scale });
        }
    }
    Ok(Thinning { stride: least, scale: Scale::Half })
}

fn encode<W: Write>(
    writer: W,
    frames: &impl Pictures,
    shown: &[usize],
    thinning: Thinning,
) -> Result<W, OutputError> {
    let (width, height) = frames.size_px(thinning.scale);
    let (width, height) = (width as u16, height as u16);
    let mut encoder = Encoder::new(writer, width, height, &palette())?;
    encoder.set_repeat(Repeat::Infinite)?;
    for (order, &index) in shown.iter().enumerate() {
        let picture = frames.draw(index, thinning.scale)?;
        let mut frame = Frame::from_indexed_pixels(width, height, indices(&picture), None);
        // Hundredths of a second, rounded so that the sum stays true; the last image stands for 2 s.
        let at_cs = |order: usize| (order * thinning.stride) as u64 * frames.period_ms() / 10;
        let is_last = order + 1 == shown.len();
        frame.delay = if is_last { 200 } else { (at_cs(order + 1) - at_cs(order)).min(1000) as u16 };
        encoder.write_frame(&frame)?;
    }
    Ok(encoder.into_inner()?)
}

/// Greys first, then the overlay's colours.
fn palette() -> Vec<u8> {
    let greys = (0..GREYS).flat_map(|index| [grey_level(index); 3]);
    greys.chain(COLOURS.iter().flat_map(|colour| [colour.r(), colour.g(), colour.b()])).collect()
}

fn grey_level(index: usize) -> u8 {
    ((index * 255 + (GREYS - 1) / 2) / (GREYS - 1)) as u8
}

/// Palette index of every pixel; a colour that is neither grey nor known becomes the grey of its green.
fn indices(picture: &RgbImage) -> Vec<u8> {
    let grey = |level: u8| ((usize::from(level) * (GREYS - 1) + 127) / 255) as u8;
    picture
        .pixels()
        .map(|pixel| {
            let [r, g, b] = pixel.0;
            if r == g && g == b {
                return grey(g);
            }
            let known = COLOURS.iter().position(|colour| (colour.r(), colour.g(), colour.b()) == (r, g, b));
            known.map_or(grey(g), |place| (GREYS + place) as u8)
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use image::Rgb;

    use super::*;

    #[test]
    fn palette_has_black_white_and_every_overlay_colour() {
        let palette = palette();
        assert_eq!(palette.len(), 3 * 128);
        assert_eq!((grey_level(0), grey_level(GREYS - 1)), (0, 255));
        for colour in COLOURS {
            let picture = RgbImage::from_pixel(1, 1, Rgb([colour.r(), colour.g(), colour.b()]));
            let index = usize::from(indices(&picture)[0]);
            assert_eq!(palette[3 * index..][..3], picture.as_raw()[..]);
        }
    }

    #[test]
    fn greys_move_by_at_most_half_a_step() {
        let palette = palette();
        for level in 0..=255u8 {
            let index = usize::from(indices(&RgbImage::from_pixel(1, 1, Rgb([level; 3])))[0]);
            assert!(palette[3 * index].abs_diff(level) <= 2, "{level} became {}", palette[3 * index]);
        }
    }
}
