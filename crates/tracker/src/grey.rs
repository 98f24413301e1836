use sonoloop_simd::{Instructions, wide};
use sonoloop_types::Image;

/// Every which row of a large picture is counted: 15 of 640 × 480 give the median of speckle to some 0.4 grey levels, and
/// counting all takes longer than a registration.
const ROW_STRIDE: usize = 32;
/// Smaller pictures are counted whole.
const SPARSE_FROM: usize = 1 << 16;
/// Fewer lit pixels than this have no meaningful median.
const MIN_COUNTED: usize = 64;
/// Pixels counted together, in eight bits.
const BLOCK: usize = 128;

/// Median grey level of the lit part of a picture, with the histogram's resolution refined inside its bin.
///
/// Pixels of level 0 do not count: the margins beside the aperture are exactly black and would dominate. `None`
/// when (almost) nothing is lit. A gain change is an offset after log compression, so it moves this median and
/// all of the picture by the same amount.
pub(crate) fn lit_median(instructions: Instructions, image: &Image) -> Option<f64> {
    let stride = if image.pixels.len() < SPARSE_FROM { 1 } else { ROW_STRIDE };
    let width = image.width_px as usize;
    let up_to = |level: u8| count_up_to(instructions, &image.pixels, width, stride, level);
    let rows = (image.height_px as usize).div_ceil(stride);
    let dark = up_to(0);
    let lit = rows * width - dark;
    if lit < MIN_COUNTED {
        return None;
    }
    let half = lit as f64 / 2.0;
    // The first level at and below which there is half of what is lit.
    let (mut low, mut high) = (1_u8, 255_u8);
    let mut below = 0;
    while low < high {
        let middle = low + (high - low) / 2;
        let count = up_to(middle) - dark;
        if count as f64 >= half {
            high = middle;
        } else {
            low = middle + 1;
            below = count;
        }
    }
    let here = up_to(low) - dark - below;
    Some(f64::from(low) - 0.5 + (half - below as f64) / here as f64)
}

wide! {
    /// Pixels of a grey level up to `level` in every `stride`th row.
    fn count_up_to(pixels: &[u8], width: usize, stride: usize, level: u8) -> usize {
        let mut count = 0;
        for row in pixels.chunks_exact(width).step_by(stride) {
            let (blocks, rest) = row.as_chunks::<BLOCK>();
            for block in blocks {
                count += usize::from(block.iter().map(|pixel| u8::from(*pixel <= level)).sum::<u8>());
            }
            count += rest.iter().filter(|pixel| **pixel <= level).count();
        }
        count
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn black_margins_do_not_count_and_an_offset_shifts_the_median() {
        let mut image = Image::black(100, 80);
        for v in 0..80 {
            for u in 40..60 {
                image.pixels[v * 100 + u] = 50 + ((u * 7 + v * 13) % 41) as u8;
            }
        }
        let median = lit_median(Instructions::widest(), &image).unwrap();
        assert!((median - 70.0).abs() < 2.0, "{median}");
        image.pixels.iter_mut().filter(|p| **p > 0).for_each(|p| *p += 25);
        assert!((lit_median(Instructions::widest(), &image).unwrap() - median - 25.0).abs() < 1e-9);
    }

    #[test]
    fn every_few_rows_of_a_large_picture_give_the_median_of_all() {
        // 20 to 219, each as often as the others, in no order.
        let level = |k: u32| 20 + (k.wrapping_mul(2_654_435_761) >> 8) % 200;
        let image = Image::from_pixels(640, 480, (0..640 * 480).map(|k| level(k) as u8).collect()).unwrap();
        // The standard error of a median of 9600 is 200/(2·√9600) = 1.
        assert!(
            (lit_median(Instructions::widest(), &image).unwrap() - 119.5).abs() < 3.0,
            "{:?}",
            lit_median(Instructions::widest(), &image)
        );
    }

    #[test]
    fn a_dark_picture_has_no_median() {
        assert_eq!(lit_median(Instructions::widest(), &Image::black(64, 64)), None);
        assert_eq!(lit_median(Instructions::widest(), &Image::black(1, 1)), None);
    }
}
