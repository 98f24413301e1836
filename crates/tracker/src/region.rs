use core::ops::Range;

use sonoloop_types::Image;

use crate::warp::Placement;

/// A rectangle of a picture as blurred grey levels, in which patches are sampled.
///
/// Its pixels are `scale × scale` blocks of the picture's (`scale` is 1, 2 or 4); places beyond the picture's
/// edge repeat the edge. Buffers only ever grow, so a region that was filled once at its largest never allocates
/// again.
#[derive(Debug, Clone, Default)]
pub(crate) struct Region {
    /// First column and row, in (scaled) pixels of the picture; may be negative.
    pub origin: [i64; 2],
    /// Columns and rows.
    pub size: [usize; 2],
    /// Grey levels, row by row.
    pub grey: Vec<f32>,
    /// Size of the whole picture in (scaled) pixels.
    pub picture: [usize; 2],
    rows: Vec<f32>,
    line: Vec<f32>,
}

/// The rectangle of template pixels that lie inside the picture: columns, then rows, as half-open ranges.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Inside {
    pub x: [usize; 2],
    pub y: [usize; 2],
}

impl Inside {
    pub fn all(side: usize) -> Self {
        Self { x: [0, side], y: [0, side] }
    }

    pub fn count(&self) -> usize {
        (self.x[1] - self.x[0]) * (self.y[1] - self.y[0])
    }
}

impl Region {
    /// Fills the region with the blurred rectangle of `size` pixels from `origin` on.
    pub fn fill(&mut self, image: &Image, taps: &[f32], scale: usize, origin: [i64; 2], size: [usize; 2]) {
        let [width, height] = size;
        let radius = taps.len() / 2;
        self.origin = origin;
        self.size = size;
        self.picture = [image.width_px as usize / scale, image.height_px as usize / scale];
        // `resize` keeps old values; every one of them is overwritten below.
        self.grey.resize(width * height, 0.0);
        self.rows.resize(width * (height + 2 * radius), 0.0);
        self.line.resize(width + 2 * radius, 0.0);
        for (k, out) in self.rows.chunks_exact_mut(width).enumerate() {
            let v = origin[1] + k as i64 - radius as i64;
            read_line(image, scale, self.picture, origin[0] - radius as i64, v, &mut self.line);
            convolve(taps, |tap| &self.line[tap..], out);
        }
        for (y, out) in self.grey.chunks_exact_mut(width).enumerate() {
            convolve(taps, |tap| &self.rows[(y + tap) * width..], out);
        }
    }

    /// Fills the region with the square of half-side `reach` about a point of the (unscaled) picture.
    pub fn fill_about(&mut self, image: &Image, taps: &[f32], centre_px: [f64; 2], reach: usize) {
        let origin = centre_px.map(|c| whole(c) - reach as i64);
        self.fill(image, taps, 1, origin, [2 * reach + 1; 2]);
    }

    /// Bilinear patch of `side + 2` pixels, centred on a point of the picture: the template's window and one more
    /// pixel all around for its gradient. `None` when the patch leaves the region.
    pub fn sample(&self, centre_px: [f64; 2], side: usize, patch: &mut [f32]) -> Option<Inside> {
        let padded = side + 2;
        let first = centre_px.map(|c| c - (side as f64 - 1.0) / 2.0 - 1.0);
        if !first.iter().all(|f| f.is_finite() && f.abs() < 1e9) {
            return None;
        }
        let floor = first.map(|f| libm::floor(f) as i64);
        let [fu, fv] = [first[0] - floor[0] as f64, first[1] - floor[1] as f64];
        let x = usize::try_from(floor[0] - self.origin[0]).ok()?;
        let y = usize::try_from(floor[1] - self.origin[1]).ok()?;
        if x + padded + 1 > self.size[0] || y + padded + 1 > self.size[1] {
            return None;
        }
        let weights =
            [(1.0 - fu) * (1.0 - fv), fu * (1.0 - fv), (1.0 - fu) * fv, fu * fv].map(|weight| weight as f32);
        for (k, out) in patch.chunks_exact_mut(padded).enumerate() {
            let upper = &self.grey[(y + k) * self.size[0] + x..][..padded + 1];
            let lower = &self.grey[(y + k + 1) * self.size[0] + x..][..padded + 1];
            for (i, out) in out.iter_mut().enumerate() {
                *out = weights[0] * upper[i]
                    + weights[1] * upper[i + 1]
                    + weights[2] * lower[i]
                    + weights[3] * lower[i + 1];
            }
        }
        Some(self.inside_picture(centre_px, side))
    }

    /// The same through a warp: the pixel at (x, y) of the centred template is read at c + A·(x, y).
    pub fn sample_warped(&self, place: &Placement, side: usize, patch: &mut [f32]) -> Option<Inside> {
        if place.is_translation() {
            return self.sample(place.centre_px, side, patch);
        }
        let half = (side as f64 - 1.0) / 2.0;
        let outermost = half + 1.0;
        let relative = |at: [f64; 2]| [0, 1].map(|axis| at[axis] - self.origin[axis] as f64);
        let corners = [[-1.0, -1.0], [1.0, -1.0], [-1.0, 1.0], [1.0, 1.0]]
            .map(|sign: [f64; 2]| relative(place.map(sign.map(|s| s * outermost))));
        // All taps lie between the corners; written so that NaN fails.
        let last = self.size.map(|size| size as f64 - 2.0);
        if !corners.iter().all(|c| c[0] >= 0.0 && c[1] >= 0.0 && c[0] < last[0] && c[1] < last[1]) {
            return None;
        }
        let [[xx, _], [yx, _]] = place.linear.map(|row| row.map(|v| v as f32));
        let width = self.size[0];
        for (k, out) in patch.chunks_exact_mut(side + 2).enumerate() {
            let [u, v] = relative(place.map([-outermost, k as f64 - outermost])).map(|c| c as f32);
            for (i, out) in out.iter_mut().enumerate() {
                // Rounding may leave the corner by a hair.
                let (u, v) = ((u + xx * i as f32).max(0.0), (v + yx * i as f32).max(0.0));
                let (column, row) = (u as usize, v as usize);
                let (fu, fv) = (u - column as f32, v - row as f32);
                let first = row * width + column;
                let (upper, lower) =
                    (&self.grey[first..first + 2], &self.grey[first + width..first + width + 2]);
                let above = upper[0] + fu * (upper[1] - upper[0]);
                let below = lower[0] + fu * (lower[1] - lower[0]);
                *out = above + fv * (below - above);
            }
        }
        Some(self.inside_picture_warped(place, side))
    }

    /// Columns whose u lies inside the picture in every row, and rows whose v does in every column.
    fn inside_picture_warped(&self, place: &Placement, side: usize) -> Inside {
        let half = (side as f64 - 1.0) / 2.0;
        let range = |axis: usize| {
            let last = self.picture[axis] as f64 - 1.0;
            let is_inside = |k: &usize| {
                let along = *k as f64 - half;
                [-half, half].iter().all(|across| {
                    let at = if axis == 0 { [along, *across] } else { [*across, along] };
                    (0.0..=last).contains(&place.map(at)[axis])
                })
            };
            let first = (0..side).find(is_inside).unwrap_or(side);
            let end = (first..side).find(|k| !is_inside(k)).unwrap_or(side);
            [first, end]
        };
        Inside { x: range(0), y: range(1) }
    }

    fn inside_picture(&self, centre_px: [f64; 2], side: usize) -> Inside {
        let first = centre_px.map(|c| c - (side as f64 - 1.0) / 2.0 - 1.0);
        let range = |axis: usize| {
            let start = first[axis] + 1.0;
            let low = libm::ceil(-start).max(0.0);
            let high = (libm::floor(self.picture[axis] as f64 - 1.0 - start) + 1.0).min(side as f64).max(low);
            [(low as usize).min(side), (high as usize).min(side)]
        };
        Inside { x: range(0), y: range(1) }
    }
}

/// Nearest whole number, held within what an image can be.
fn whole(value: f64) -> i64 {
    libm::round(value).clamp(-1e9, 1e9) as i64
}

fn read_line(image: &Image, scale: usize, picture: [usize; 2], first: i64, v: i64, line: &mut [f32]) {
    let v = v.clamp(0, picture[1] as i64 - 1) as usize;
    let last = picture[0] as i64 - 1;
    if scale == 1 {
        let row = image.row(v as u32);
        for (k, out) in line.iter_mut().enumerate() {
            *out = f32::from(row[(first + k as i64).clamp(0, last) as usize]);
        }
        return;
    }
    // Coarse pixels inside the picture, then its outermost ones repeated.
    let length = line.len() as i64;
    let inside = (-first).clamp(0, length)..(last + 1 - first).clamp(0, length);
    let Range { start, end } = inside.start as usize..inside.end as usize;
    if start >= end {
        let nearest = first.clamp(0, last) as usize;
        add_coarse(image, scale, v, nearest, &mut line[..1]);
        let level = line[0];
        line.fill(level);
        return;
    }
    add_coarse(image, scale, v, (first + start as i64) as usize, &mut line[start..end]);
    let (left, right) = (line[start], line[end - 1]);
    line[..start].fill(left);
    line[end..].fill(right);
}

/// Means of `scale`² pixels, for neighbouring coarse pixels of coarse row `v` from `u` on.
fn add_coarse(image: &Image, scale: usize, v: usize, u: usize, line: &mut [f32]) {
    line.fill(0.0);
    debug_assert!(
        scale == 2 || scale == 4,
        "coarse regions are made at half and a quarter of the resolution"
    );
    for dv in 0..scale {
        let row = &image.row((v * scale + dv) as u32)[u * scale..];
        match scale {
            2 => add_pixels::<2>(row, line),
            _ => add_pixels::<4>(row, line),
        }
    }
    let share = 1.0 / (scale * scale) as f32;
    line.iter_mut().for_each(|level| *level *= share);
}

fn add_pixels<const SCALE: usize>(row: &[u8], line: &mut [f32]) {
    for (level, pixels) in line.iter_mut().zip(row.as_chunks::<SCALE>().0) {
        *level += pixels.iter().map(|&level| u32::from(level)).sum::<u32>() as f32;
    }
}

fn convolve<'a>(taps: &[f32], shifted: impl Fn(usize) -> &'a [f32], out: &mut [f32]) {
    out.fill(0.0);
    for (tap, weight) in taps.iter().enumerate() {
        for (out, value) in out.iter_mut().zip(shifted(tap)) {
            *out += weight * value;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::gaussian::blur_taps;

    fn ramp() -> Image {
        Image::from_pixels(
            40,
            30,
            (0..30).flat_map(|v| (0..40).map(move |u| (3 * u + 2 * v) as u8)).collect(),
        )
        .unwrap()
    }

    #[test]
    fn truth_blur_and_bilinear_sampling_keep_a_ramp() {
        let mut region = Region::default();
        region.fill_about(&ramp(), &blur_taps(1.5), [20.3, 14.6], 9);
        let mut patch = [0.0; 100];
        let inside = region.sample([20.3, 14.6], 8, &mut patch).unwrap();
        assert_eq!(inside, Inside::all(8));
        for y in 0..10 {
            for x in 0..10 {
                let expected = 3.0 * (20.3 - 4.5 + x as f64) + 2.0 * (14.6 - 4.5 + y as f64);
                assert!((f64::from(patch[y * 10 + x]) - expected).abs() < 1e-3);
            }
        }
    }

    #[test]
    fn truth_warped_sampling_keeps_a_ramp() {
        let mut region = Region::default();
        region.fill_about(&ramp(), &[1.0], [20.0, 15.0], 14);
        let place = Placement { centre_px: [20.3, 14.6], linear: [[0.9, -0.3], [0.25, 1.1]] };
        let mut patch = [0.0; 100];
        let inside = region.sample_warped(&place, 8, &mut patch).unwrap();
        assert_eq!(inside, Inside::all(8));
        for y in 0..10 {
            for x in 0..10 {
                let [u, v] = place.map([x as f64 - 4.5, y as f64 - 4.5]);
                assert!((f64::from(patch[y * 10 + x]) - (3.0 * u + 2.0 * v)).abs() < 1e-3);
            }
        }
        // Through the identity it is the other way of sampling, to rounding.
        let [mut plain, mut warped] = [[0.0; 100]; 2];
        region.sample([20.3, 14.6], 8, &mut plain).unwrap();
        let nearly = Placement { linear: [[1.0 + 1e-12, 0.0], [0.0, 1.0]], ..Placement::at([20.3, 14.6]) };
        region.sample_warped(&nearly, 8, &mut warped).unwrap();
        assert!(plain.iter().zip(&warped).all(|(a, b)| (a - b).abs() < 1e-3));
        assert_eq!(region.sample_warped(&Placement { centre_px: [8.0, 14.6], ..place }, 8, &mut patch), None);
        assert_eq!(
            region.sample_warped(&Placement { centre_px: [f64::NAN, 0.0], ..place }, 8, &mut patch),
            None
        );
    }

    #[test]
    fn what_lies_beyond_the_edge_is_named() {
        let mut region = Region::default();
        region.fill_about(&ramp(), &[1.0], [0.0, 29.0], 9);
        let mut patch = [0.0; 100];
        let inside = region.sample([0.0, 29.0], 8, &mut patch).unwrap();
        // Columns at −3.5 … 3.5 and rows at 25.5 … 32.5.
        assert_eq!(inside, Inside { x: [4, 8], y: [0, 4] });
        assert_eq!(region.sample([12.0, 29.0], 8, &mut patch), None);
        assert_eq!(region.sample([f64::NAN, 29.0], 8, &mut patch), None);
    }

    #[test]
    fn truth_scaled_pixels_are_block_means() {
        let mut region = Region::default();
        region.fill(&ramp(), &[1.0], 2, [0, 0], [20, 15]);
        // Mean of 3u + 2v over the block {2, 3} × {4, 5}.
        assert_eq!(region.grey[2 * 20 + 1], 3.0 * 2.5 + 2.0 * 4.5);
        assert_eq!(region.picture, [20, 15]);
    }

    #[test]
    fn truth_scaled_pixels_beyond_the_edge_repeat_it() {
        for scale in [2_usize, 4] {
            let [width, height] = [40 / scale as i64, 30 / scale as i64];
            // The block mean of a ramp is its value at the block's middle.
            let middle =
                |k: i64, last: i64| (k.clamp(0, last) * scale as i64) as f32 + (scale - 1) as f32 / 2.0;
            let mean = |u: i64, v: i64| 3.0 * middle(u, width - 1) + 2.0 * middle(v, height - 1);
            let mut region = Region::default();
            // Over every edge, and wholly outside on either side.
            for first_u in [-3, -60, 50] {
                let size = [width as usize + 6, height as usize + 6];
                region.fill(&ramp(), &[1.0], scale, [first_u, -3], size);
                for (k, grey) in region.grey.iter().enumerate() {
                    let (u, v) = (first_u + (k % size[0]) as i64, (k / size[0]) as i64 - 3);
                    assert_eq!(*grey, mean(u, v), "scale {scale}, ({u}, {v})");
                }
            }
        }
    }
}
