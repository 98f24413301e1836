use sonoloop_types::Image;

/// Every which row is counted: 120 of 480 give the median of speckle to a fraction of a grey level.
const ROW_STRIDE: usize = 4;
/// Fewer lit pixels than this have no meaningful median.
const MIN_COUNTED: u32 = 64;

/// Median grey level of the lit part of a picture, with the histogram's resolution refined inside its bin.
///
/// Pixels of level 0 do not count: the margins beside the aperture are exactly black and would dominate. `None`
/// when (almost) nothing is lit. A gain change is an offset after log compression, so it moves this median and
/// all of the picture by the same amount.
pub(crate) fn lit_median(image: &Image) -> Option<f64> {
    // Four tables, since neighbouring pixels are often equal and would wait for one another's increment.
    let mut tables = [[0_u32; 256]; 4];
    for row in image.pixels.chunks_exact(image.width_px as usize).step_by(ROW_STRIDE) {
        for four in row.chunks(4) {
            for (table, level) in tables.iter_mut().zip(four) {
                table[usize::from(*level)] += 1;
            }
        }
    }
    let count = |level: usize| tables.iter().map(|table| table[level]).sum::<u32>();
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
    fn a_dark_picture_has_no_median() {
        assert_eq!(lit_median(&Image::black(64, 64)), None);
        assert_eq!(lit_median(&Image::black(1, 1)), None);
    }
}
