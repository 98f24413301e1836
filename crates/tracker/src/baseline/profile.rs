//! Grey levels along a line: on it, and in two strips beside it.

use sonoloop_types::Image;

use super::line::Line;

/// Offsets across the line whose mean counts as on it.
const ON_PX: [f64; 3] = [-1.0, 0.0, 1.0];
/// Middle of either strip beside it. Log compression widens a needle; on synthetic ones its flank reaches 5 px.
const BESIDE_PX: f64 = 8.0;

/// Samples of a line inside the picture, one pixel apart, in the direction of insertion.
#[derive(Debug, Clone, Default)]
pub(crate) struct Profile {
    /// First sample (u, v).
    pub from_px: [f64; 2],
    /// Direction of insertion, of unit length.
    pub axis_px: [f64; 2],
    /// Mean on the line less the mean of both strips, grey levels.
    pub contrast: Vec<f64>,
    /// One strip less the other.
    pub aside: Vec<f64>,
}

impl Profile {
    /// Samples `line`, which is walked along `axis_px`; false when it misses the picture.
    pub fn fill(&mut self, image: &Image, line: &Line, axis_px: [f64; 2]) -> bool {
        self.contrast.clear();
        self.aside.clear();
        let Some([first, last]) = inside(image, line.at_px, axis_px) else { return false };
        self.axis_px = axis_px;
        self.from_px = [0, 1].map(|axis| line.at_px[axis] + first * axis_px[axis]);
        for step in 0..=(last - first).floor() as u32 {
            let at = self.at_px(f64::from(step));
            let strip = |middle: f64| {
                let level = |aside: f64| {
                    let across = middle + aside;
                    bilinear(image, [at[0] - across * axis_px[1], at[1] + across * axis_px[0]])
                };
                ON_PX.iter().map(|aside| level(*aside)).sum::<f64>() / ON_PX.len() as f64
            };
            let (left, right) = (strip(-BESIDE_PX), strip(BESIDE_PX));
            self.contrast.push(strip(0.0) - 0.5 * (left + right));
            self.aside.push(left - right);
        }
        true
    }

    /// The place of a (fractional) sample.
    pub fn at_px(&self, sample: f64) -> [f64; 2] {
        [0, 1].map(|axis| self.from_px[axis] + sample * self.axis_px[axis])
    }

    /// The sample nearest to a place.
    pub fn nearest(&self, at_px: [f64; 2]) -> usize {
        let along: f64 = (0..2).map(|axis| (at_px[axis] - self.from_px[axis]) * self.axis_px[axis]).sum();
        (along.round().max(0.0) as usize).min(self.contrast.len() - 1)
    }
}

/// The stretch of a line inside the picture, in pixels from `at_px` along `axis_px` (Liang and Barsky 1984).
fn inside(image: &Image, at_px: [f64; 2], axis_px: [f64; 2]) -> Option<[f64; 2]> {
    let (mut first, mut last) = (f64::NEG_INFINITY, f64::INFINITY);
    for (axis, size) in [image.width_px, image.height_px].into_iter().enumerate() {
        let end = f64::from(size) - 1.0;
        if axis_px[axis] == 0.0 {
            if !(0.0..=end).contains(&at_px[axis]) {
                return None;
            }
            continue;
        }
        let ends = [-at_px[axis] / axis_px[axis], (end - at_px[axis]) / axis_px[axis]];
        first = first.max(ends[0].min(ends[1]));
        last = last.min(ends[0].max(ends[1]));
    }
    (first.is_finite() && last.is_finite() && first <= last).then_some([first, last])
}

/// Grey level between pixels; beyond the border that of its nearest pixel.
fn bilinear(image: &Image, at_px: [f64; 2]) -> f64 {
    let [u, v] = [(at_px[0], image.width_px), (at_px[1], image.height_px)]
        .map(|(c, size)| c.clamp(0.0, f64::from(size) - 1.0));
    let [u0, v0] = [u as u32, v as u32];
    let [fu, fv] = [u - f64::from(u0), v - f64::from(v0)];
    let row = |v: u32| {
        let row = image.row(v.min(image.height_px - 1));
        let [a, b] = [u0, u0 + 1].map(|u| f64::from(row[u.min(image.width_px - 1) as usize]));
        a + fu * (b - a)
    };
    let [upper, lower] = [row(v0), row(v0 + 1)];
    upper + fv * (lower - upper)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn truth_a_bright_row_stands_out_by_its_height() {
        let mut image = Image::from_pixels(60, 40, vec![50; 2400]).unwrap();
        for v in 19..=21 {
            image.pixels[v * 60..][..30].fill(150);
        }
        let mut profile = Profile::default();
        let line = Line { at_px: [10.0, 20.0], along: [1.0, 0.0] };
        assert!(profile.fill(&image, &line, [1.0, 0.0]));
        assert_eq!((profile.from_px, profile.contrast.len()), ([0.0, 20.0], 60));
        assert_eq!((profile.contrast[10], profile.contrast[40], profile.aside[10]), (100.0, 0.0, 0.0));
        assert_eq!((profile.nearest([33.2, 25.0]), profile.nearest([-9.0, 0.0])), (33, 0));
        assert!(!profile.fill(&image, &Line { at_px: [10.0, -5.0], ..line }, [1.0, 0.0]));
        assert!(profile.fill(&image, &Line { at_px: [10.0, 0.0], ..line }, [1.0, 0.0]), "along the border");
    }

    #[test]
    fn truth_between_pixels_and_beyond_the_border() {
        let image = Image::from_pixels(2, 2, vec![0, 10, 20, 30]).unwrap();
        assert_eq!(bilinear(&image, [0.5, 0.5]), 15.0);
        assert_eq!(bilinear(&image, [0.25, 0.0]), 2.5);
        assert_eq!(bilinear(&image, [9.0, -3.0]), 10.0);
    }
}
