use sonoloop_types::Image;

/// Every which row is counted, and every which pixel of it: 9600 of 640 × 480 give the median of speckle to some 0.2 grey
/// levels, and counting all takes longer than a registration.
const STRIDES: [usize; 2] = [8, 4];
/// Smaller pictures are counted whole.
const SPARSE_FROM: usize = 1 << 16;
/// Fewer lit pixels than this have no meaningful median.
const MIN_COUNTED: u32 = 64;

/// Median grey level of the lit part of a picture, with the histogram's resolution refined inside its bin.
///
/// Pixels of level 0 do not count: the margins beside the aperture are exactly black and would dominate. `None`
/// when (almost) nothing is lit. A gain change is an offset after log compression, so it moves this median and
/// all of the picture by the same amount.
pub(crate) fn lit_median(image: &Image) -> Option<f64> {
    // Two tables, since neighbours are often equal and would wait for one another's increment.
    let mut tables = [[0_u32; 256]; 2];
    let [rows, columns] = if image.pixels.len() < SPARSE_FROM { [1, 1] } else { STRIDES };
    for row in image.pixels.chunks_exact(image.width_px as usize).step_by(rows) {
        for pair in row.chunks(2 * columns) {
            for (table, level) in tables.iter_mut().zip(pair.iter().step_by(columns)) {
                table[usize::from(*level)] += 1;
            }
        }
    }
    let count = |level: usize| tables[0][level] + tables[1][level];
    let lit: u32 = (1..256).map(count).sum();
    if lit < MIN_COUNTED {
        return None;
    }
    let half = f64::from(lit) / 2.0;
    let mut below = 0.0;
    for level in 1..256 {
        let here = f64::from(count(level));
        if below + here >= half {
            return Some(level as f64 - 0.5 + (half - below) / here);
        }
        below += here;
    }
    None
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
        let median = lit_median(&image).unwrap();
        assert!((median - 70.0).abs() < 2.0, "{median}");
        image.pixels.iter_mut().filter(|p| **p > 0).for_each(|p| *p += 25);
        assert!((lit_median(&image).unwrap() - median - 25.0).abs() < 1e-9);
    }

    #[test]
    fn every_few_pixels_of_a_large_picture_give_the_median_of_all() {
        // 20 to 219, each as often as the others, in no order.
        let level = |k: u32| 20 + (k.wrapping_mul(2_654_435_761) >> 8) % 200;
        let image = Image::from_pixels(640, 480, (0..640 * 480).map(|k| level(k) as u8).collect()).unwrap();
        // The standard error of a median of 9600 is 200/(2·√9600) = 1.
        assert!((lit_median(&image).unwrap() - 119.5).abs() < 3.0, "{:?}", lit_median(&image));
    }

    #[test]
    fn a_dark_picture_has_no_median() {
        assert_eq!(lit_median(&Image::black(64, 64)), None);
        assert_eq!(lit_median(&Image::black(1, 1)), None);
    }
}
