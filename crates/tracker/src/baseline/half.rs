//! The picture at half its resolution, in which the ridges are sought.

use sonoloop_types::Image;

/// Pixels that are worked on side by side; rows are padded to a multiple of it.
pub(crate) const LANE: usize = 16;
/// That many pixels of a row.
pub(crate) type Lane = [f32; LANE];

/// Means of 2 × 2 pixels, less the mean of the lit part of the picture.
///
/// Half pixel (i, j) has its middle at (2i + ½, 2j + ½) in pixels of the picture. Where all four pixels are black it
/// holds zero, that is, the lit part's mean: the margins beside the aperture are exactly black, and their edge would
/// answer like a ridge.
#[derive(Debug, Clone, Default)]
pub(crate) struct Half {
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Rows of grey levels, one after another.
    pub levels: Vec<f32>,
}

impl Half {
    /// Takes the place of the last picture. The odd last row or column of a picture is left out.
    pub fn fill(&mut self, image: &Image) {
        let full = image.width_px as usize;
        [self.width, self.height] = [full / 2, image.height_px as usize / 2];
        self.levels.clear();
        let (mut sum, mut lit) = (0.0_f64, 0_u32);
        for rows in image.pixels.chunks_exact(2 * full) {
            let (upper, lower) = rows.split_at(full);
            for (a, b) in upper.chunks_exact(2).zip(lower.chunks_exact(2)) {
                let four = u16::from(a[0]) + u16::from(a[1]) + u16::from(b[0]) + u16::from(b[1]);
                sum += f64::from(four);
                lit += u32::from(four > 0);
                self.levels.push(f32::from(four) / 4.0);
            }
        }
        let mean = (sum / (4.0 * f64::from(lit.max(1)))) as f32;
        for level in &mut self.levels {
            *level = if *level > 0.0 { *level - mean } else { 0.0 };
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn truth_means_of_four_less_the_mean_of_what_is_lit() {
        let image = Image::from_pixels(5, 3, vec![0, 0, 10, 20, 9, 0, 0, 30, 40, 9, 9, 9, 9, 9, 9]).unwrap();
        let mut half = Half::default();
        half.fill(&image);
        assert_eq!((half.width, half.height), (2, 1));
        assert_eq!(half.levels, [0.0, 0.0], "black counts as the mean, and 25 is the mean");

        half.fill(&Image::from_pixels(4, 2, vec![10, 10, 30, 30, 10, 10, 30, 30]).unwrap());
        assert_eq!(half.levels, [-10.0, 10.0]);
    }
}
