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
/// all of the picture by the same amount. `near` is where it may be expected.
pub(crate) fn lit_median(instructions: Instructions, image: &Image, near: Option<f64>) -> Option<f64> {
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
    // The first level at and below which there is half of what is lit lies in low + 1 ..= high, with so many lit pixels up to
    // each. Begun near the answer the bracket is soon small; the answer is the same.
    let [mut low, mut high] = [(0_u8, 0_usize), (255, lit)];
    let mut halve = |middle: u8| {
        if low.0 < middle && middle < high.0 {
            let count = up_to(middle) - dark;
            let side = if count as f64 >= half { &mut high } else { &mut low };
            *side = (middle, count);
        }
        (low, high)
    };
    if let Some(near) = near {
        halve((near + 2.0).clamp(0.0, 255.0) as u8);
        halve((near - 2.0).clamp(0.0, 255.0) as u8);
    }
    loop {
        let (low, high) = halve(0);
        if high.0 - low.0 <= 1 {
            return Some(f64::from(high.0) - 0.5 + (half - low.1 as f64) / (high.1 - low.1) as f64);
        }
        halve(low.0 + (high.0 - low.0) / 2);
    }
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
        let median = lit_median(Instructions::widest(), &image, None).unwrap();
        assert!((median - 70.0).abs() < 2.0, "{median}");
        image.pixels.iter_mut().filter(|p| **p > 0).for_each(|p| *p += 25);
        assert!((lit_median(Instructions::widest(), &image, None).unwrap() - median - 25.0).abs() < 1e-9);
    }

    #[test]
    fn every_few_rows_of_a_large_picture_give_the_median_of_all() {
        // 20 to 219, each as often as the others, in no order.
        let level = |k: u32| 20 + (k.wrapping_mul(2_654_435_761) >> 8) % 200;
        let image = Image::from_pixels(640, 480, (0..640 * 480).map(|k| level(k) as u8).collect()).unwrap();
        // The standard error of a median of 9600 is 200/(2·√9600) = 1.
        assert!(
            (lit_median(Instructions::widest(), &image, None).unwrap() - 119.5).abs() < 3.0,
            "{:?}",
            lit_median(Instructions::widest(), &image, None)
        );
    }

    #[test]
    fn truth_it_is_the_middle_of_the_sorted_levels_wherever_one_begins() {
        let levels: Vec<u8> =
            (0..9000_u32).map(|k| (k.wrapping_mul(2_654_435_761) >> 20) as u8 % 97 + 31).collect();
        let mut sorted = levels.clone();
        sorted.sort_unstable();
        let image = Image::from_pixels(100, 90, levels).unwrap();
        let median = lit_median(Instructions::widest(), &image, None).unwrap();
        assert!((median - f64::from(sorted[4500])).abs() <= 0.5, "{median} {}", sorted[4500]);
        for near in [-5.0, 0.0, 20.0, median - 2.5, median, median + 2.5, 200.0, 255.0, 1e9] {
            for set in Instructions::available() {
                assert_eq!(lit_median(set, &image, Some(near)), Some(median), "{near}");
            }
        }
    }

    #[test]
    fn a_dark_picture_has_no_median() {
        assert_eq!(lit_median(Instructions::widest(), &Image::black(64, 64), None), None);
        assert_eq!(lit_median(Instructions::widest(), &Image::black(1, 1), Some(90.0)), None);
    }
}
