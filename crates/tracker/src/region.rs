use core::ops::Range;

use sonoloop_simd::{Instructions, nearest_f32, wide};
use sonoloop_types::Image;

use crate::warp::Placement;
use crate::window::{LANES, Lanes, Part, Window};

/// Values after the last row: a vector that begins inside may end beyond it.
const SLACK: usize = 2 * LANES;

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
    /// Grey levels, row by row, and some values more.
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
    /// Fills the region with the blurred rectangle of `size` pixels from `origin` on; its columns are rounded up to whole
    /// vectors.
    pub fn fill(
        &mut self,
        instructions: Instructions,
        image: &Image,
        taps: &[f32],
        scale: usize,
        origin: [i64; 2],
        size: [usize; 2],
    ) {
        let radius = taps.len() / 2;
        self.begin(origin, size, [image.width_px as usize / scale, image.height_px as usize / scale]);
        let [width, height] = self.size;
        let first = [origin[0] - radius as i64, origin[1] - radius as i64];
        if radius == 0 && scale == 1 && self.is_inside_picture() {
            let pitch = image.width_px as usize;
            let levels = &image.pixels[first[1] as usize * pitch + first[0] as usize..];
            widen(instructions, levels, pitch, width, &mut self.grey[..width * height]);
            return;
        }
        if radius == 0 {
            for (k, line) in self.grey[..width * height].chunks_exact_mut(width).enumerate() {
                read_line(image, scale, self.picture, first[0], first[1] + k as i64, line);
            }
            return;
        }
        self.rows.resize(width * (height + 2 * radius), 0.0);
        self.line.resize(width + 2 * radius, 0.0);
        for (k, out) in self.rows.chunks_exact_mut(width).enumerate() {
            let v = first[1] + k as i64;
            read_line(image, scale, self.picture, first[0], v, &mut self.line);
            convolve(instructions, taps, &self.line, 1, out);
        }
        self.convolve_rows(instructions, taps);
    }

    /// Fills the region with the blurred square of half-side `reach` about the middle of a larger, unblurred one; as
    /// [`fill_about`](Self::fill_about) would.
    pub fn blur(
        &mut self,
        instructions: Instructions,
        sharp: &Self,
        taps: &[f32],
        centre_px: [f64; 2],
        reach: usize,
    ) {
        let radius = taps.len() / 2;
        self.begin(square(centre_px, reach), [2 * reach + 1; 2], sharp.picture);
        let [width, height] = self.size;
        self.rows.resize(width * (height + 2 * radius), 0.0);
        let [left, above] = [0, 1].map(|axis| (self.origin[axis] - sharp.origin[axis]) as usize - radius);
        for (k, out) in self.rows.chunks_exact_mut(width).enumerate() {
            let row = &sharp.grey[(above + k) * sharp.size[0] + left..];
            convolve(instructions, taps, row, 1, out);
        }
        self.convolve_rows(instructions, taps);
    }

    /// Half-side that an unblurred region needs to be blurred into one of half-side `reach`.
    pub const fn sharp_reach(reach: usize, taps: &[f32]) -> usize {
        reach + taps.len() / 2 + LANES
    }

    fn begin(&mut self, origin: [i64; 2], size: [usize; 2], picture: [usize; 2]) {
        self.origin = origin;
        self.size = [size[0].next_multiple_of(LANES), size[1]];
        self.picture = picture;
        // `resize` keeps old values; those of the rectangle are overwritten by whoever calls this.
        self.grey.resize(self.size[0] * self.size[1] + SLACK, 0.0);
    }

    /// Whether none of it lies beyond the picture's edge.
    fn is_inside_picture(&self) -> bool {
        (0..2).all(|k| self.origin[k] >= 0 && self.origin[k] + self.size[k] as i64 <= self.picture[k] as i64)
    }

    fn convolve_rows(&mut self, instructions: Instructions, taps: &[f32]) {
        let [width, height] = self.size;
        for (y, out) in self.grey[..width * height].chunks_exact_mut(width).enumerate() {
            convolve(instructions, taps, &self.rows[y * width..], width, out);
        }
    }

    /// Fills the region with the square of half-side `reach` about a point of the (unscaled) picture.
    pub fn fill_about(
        &mut self,
        instructions: Instructions,
        image: &Image,
        taps: &[f32],
        centre_px: [f64; 2],
        reach: usize,
    ) {
        self.fill(instructions, image, taps, 1, square(centre_px, reach), [2 * reach + 1; 2]);
    }

    /// Bilinear patch through a warp: the pixel (x, y) of the centred template is read at c + A·(x, y).
    ///
    /// Fills `part` of the padded window and one more pixel around it for its gradient, and tells which of the window's
    /// pixels lie inside the picture. `None` when the part leaves the region.
    pub fn sample(
        &self,
        instructions: Instructions,
        place: &Placement,
        window: Window,
        part: Part,
        patch: &mut [f32],
    ) -> Option<Inside> {
        let half = window.half_px();
        // Centred coordinates of the first and last padded column and row; columns begin with a whole vector.
        let first = [part.first_vector() as f64, part.first as f64].map(|k| k - 1.0 - half);
        let last = part.end as f64 - half;
        let relative = |at: [f64; 2]| [0, 1].map(|axis| at[axis] - self.origin[axis] as f64);
        let corners = [[first[0], first[1]], [last, first[1]], [first[0], last], [last, last]];
        // All taps lie between the corners' ones; written so that NaN fails.
        let beyond = self.size.map(|size| size as f64 - 1.0);
        let is_within = |[u, v]: [f64; 2]| u >= 0.0 && v >= 0.0 && u < beyond[0] && v < beyond[1];
        if !corners.iter().all(|corner| is_within(relative(place.map(*corner)))) {
            return None;
        }
        let [width, height] = self.size;
        let stride = window.padded_stride();
        let rows = part.first..part.end + 2;
        let vectors = part.first_vector()..part.end + 2;
        let origin = relative(place.map(first));
        if place.is_translation() {
            let [u, v] = origin.map(libm::floor);
            let fraction = [origin[0] - u, origin[1] - v].map(|f| f as f32);
            let start = v as usize * width + u as usize;
            sample_moved(instructions, &self.grey[start..], width, fraction, rows, vectors, stride, patch);
            Some(self.inside_moved(place.centre_px, window.side))
        } else {
            let [[xx, xy], [yx, yy]] = place.linear;
            let last = [width, height].map(|size| size as f32 - 2.0);
            let lattice = Lattice { origin, along: [xx as f32, yx as f32], down: [xy, yy], last };
            sample_lattice(instructions, &self.grey, width, &lattice, rows, vectors, stride, patch);
            Some(self.inside_warped(place, window.side))
        }
    }

    /// Columns whose u lies inside the picture in every row, and rows whose v does in every column.
    fn inside_warped(&self, place: &Placement, side: usize) -> Inside {
        let half = (side as f64 - 1.0) / 2.0;
        let corners = [[-half, -half], [half, -half], [-half, half], [half, half]];
        let is_within =
            |at: [f64; 2]| [0, 1].iter().all(|&k| at[k] >= 0.0 && at[k] <= self.picture[k] as f64 - 1.0);
        if corners.iter().all(|corner| is_within(place.map(*corner))) {
            return Inside::all(side);
        }
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

    fn inside_moved(&self, centre_px: [f64; 2], side: usize) -> Inside {
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

/// First column and row of the square of half-side `reach` about a point.
fn square(centre_px: [f64; 2], reach: usize) -> [i64; 2] {
    centre_px.map(|c| whole(c) - reach as i64)
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
        if first >= 0 && first + line.len() as i64 - 1 <= last {
            line.iter_mut().zip(&row[first as usize..]).for_each(|(out, level)| *out = f32::from(*level));
            return;
        }
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

/// Vectors summed together, so that a tap is read once for all of them.
const TOGETHER: usize = 5;

wide! {
    /// Adds up `taps` values that lie `step` apart, for every value of `out`: whole vectors.
    fn convolve(taps: &[f32], values: &[f32], step: usize, out: &mut [f32]) {
        let vectors = out.as_chunks_mut::<LANES>().0;
        for (k, out) in vectors.chunks_mut(TOGETHER).enumerate() {
            let values = &values[k * TOGETHER * LANES..];
            if let Ok(out) = <&mut [_; TOGETHER]>::try_from(&mut *out) {
                *out = weighted::<TOGETHER>(taps, values, step);
            } else {
                for (i, out) in out.iter_mut().enumerate() {
                    [*out] = weighted::<1>(taps, &values[i * LANES..], step);
                }
            }
        }
    }
}

#[inline(always)]
fn weighted<const N: usize>(taps: &[f32], values: &[f32], step: usize) -> [Lanes; N] {
    let mut sums = [[0.0; LANES]; N];
    for (tap, weight) in taps.iter().enumerate() {
        let values = &values[tap * step..][..N * LANES];
        for (sums, values) in sums.iter_mut().zip(values.as_chunks::<LANES>().0) {
            for (sum, value) in sums.iter_mut().zip(values) {
                *sum += weight * value;
            }
        }
    }
    sums
}

wide! {
    /// Grey levels of a rectangle as numbers; `levels` begins at its first pixel, its rows lie `pitch` apart.
    fn widen(levels: &[u8], pitch: usize, width: usize, out: &mut [f32]) {
        for (levels, out) in levels.chunks(pitch).zip(out.chunks_exact_mut(width)) {
            for (levels, out) in levels.as_chunks::<LANES>().0.iter().zip(out.as_chunks_mut::<LANES>().0) {
                *out = levels.map(f32::from);
            }
        }
    }
}

wide! {
    /// Patch of a template that has only been moved: four constant weights. `grey` begins at the first pixel's first tap.
    #[expect(clippy::too_many_arguments, reason = "a kernel: plain buffers and where to begin")]
    fn sample_moved(
        grey: &[f32],
        width: usize,
        fraction: [f32; 2],
        rows: Range<usize>,
        columns: Range<usize>,
        stride: usize,
        patch: &mut [f32],
    ) {
        let [fu, fv] = fraction;
        let weights = [(1.0 - fu) * (1.0 - fv), fu * (1.0 - fv), (1.0 - fu) * fv, fu * fv];
        for (k, y) in rows.enumerate() {
            for (i, x) in columns.clone().step_by(LANES).enumerate() {
                let at = k * width + i * LANES;
                let (upper, lower) = (&grey[at..at + LANES + 1], &grey[at + width..at + width + LANES + 1]);
                let out = &mut patch[y * stride + x..][..LANES];
                for lane in 0..LANES {
                    out[lane] = weights[0] * upper[lane]
                        + weights[1] * upper[lane + 1]
                        + weights[2] * lower[lane]
                        + weights[3] * lower[lane + 1];
                }
            }
        }
    }
}

/// Where the pixels of a warped patch are read, in the region's pixels.
struct Lattice {
    /// The first pixel of the first row.
    origin: [f64; 2],
    /// From one pixel of a row to the next, and from one row to the next.
    along: [f32; 2],
    down: [f64; 2],
    /// Pixels right of and below this have no further neighbour.
    last: [f32; 2],
}

wide! {
    /// Patch of a template that has been turned, sheared or scaled.
    #[expect(clippy::too_many_arguments, reason = "a kernel: plain buffers and where to begin")]
    fn sample_lattice(
        grey: &[f32],
        width: usize,
        lattice: &Lattice,
        rows: Range<usize>,
        columns: Range<usize>,
        stride: usize,
        patch: &mut [f32],
    ) {
        // Written as comparisons, since `max` and `min` care for NaN.
        let at_least = |value: f32, low: f32| if value > low { value } else { low };
        let at_most = |value: f32, high: f32| if value < high { value } else { high };
        // The nearest whole number to u − ½ is u's floor, or one less with a fraction of one.
        let floor = |value: f32| nearest_f32(at_least(value - 0.5, 0.0)) as f32;
        let [along_u, along_v] = lattice.along;
        let [last_u, last_v] = lattice.last;
        let row_pitch = width as f32;
        let places = grey.len() - width;
        let (upper, lower) = (&grey[..places], &grey[width..]);
        for (k, y) in rows.enumerate() {
            let [u0, v0] =
                [0, 1].map(|axis| (lattice.origin[axis] + k as f64 * lattice.down[axis]) as f32);
            let first = columns.start;
            let vectors = (columns.end - first).div_ceil(LANES);
            let out = patch[y * stride + first..(y + 1) * stride].as_chunks_mut::<LANES>().0;
            // Hardly turned, most rows read neighbouring pixels of one row: what holds at both ends holds between.
            let end = (columns.end - 1 - first) as f32;
            let (u1, v1) = (u0 + end * along_u, v0 + end * along_v);
            let (column, row) = (floor(u0), floor(v0));
            if floor(u1) == column + end && floor(v1) == row {
                let at = row as usize * width + column as usize;
                let (upper, lower) = (&upper[at..], &lower[at..]);
                for (i, out) in out.iter_mut().take(vectors).enumerate() {
                    let begin = i * LANES;
                    let (upper, lower) = (&upper[begin..=begin + LANES], &lower[begin..=begin + LANES]);
                    for lane in 0..LANES {
                        let step = (begin + lane) as f32;
                        let fu = u0 + step * along_u - (column + step);
                        let fv = v0 + step * along_v - row;
                        let above = upper[lane] + fu * (upper[lane + 1] - upper[lane]);
                        let below = lower[lane] + fu * (lower[lane + 1] - lower[lane]);
                        out[lane] = above + fv * (below - above);
                    }
                }
                continue;
            }
            for (i, out) in out.iter_mut().take(vectors).enumerate() {
                let mut at = [0_u32; LANES];
                let [mut fu, mut fv] = [[0.0_f32; LANES]; 2];
                let begin = (i * LANES) as f32;
                for lane in 0..LANES {
                    let step = begin + lane as f32;
                    // Lanes beyond the row's end may lie anywhere; rounding may leave the corners by a hair.
                    let u = at_most(at_least(u0 + step * along_u, 0.0), last_u);
                    let v = at_most(at_least(v0 + step * along_v, 0.0), last_v);
                    let (column, row) = (floor(u), floor(v));
                    fu[lane] = u - column;
                    fv[lane] = v - row;
                    at[lane] = nearest_f32(row * row_pitch + column) as u32;
                }
                let [mut a, mut b, mut c, mut d] = [[0.0_f32; LANES]; 4];
                for lane in 0..LANES {
                    let left = at[lane] as usize;
                    let right = left + 1;
                    assert!(right < places, "a tap outside of the region");
                    (a[lane], b[lane]) = (upper[left], upper[right]);
                    (c[lane], d[lane]) = (lower[left], lower[right]);
                }
                for lane in 0..LANES {
                    let above = a[lane] + fu[lane] * (b[lane] - a[lane]);
                    let below = c[lane] + fu[lane] * (d[lane] - c[lane]);
                    out[lane] = above + fv[lane] * (below - above);
                }
            }
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

    const WINDOW: Window = Window { side: 8 };
    const ALL: Part = Part { first: 0, end: 8 };

    fn about(image: &Image, taps: &[f32], centre_px: [f64; 2], reach: usize) -> Region {
        let mut region = Region::default();
        region.fill_about(Instructions::widest(), image, taps, centre_px, reach);
        region
    }

    fn patch(region: &Region, place: &Placement) -> Option<(Inside, Vec<f32>)> {
        let mut patch = vec![0.0; WINDOW.padded_len()];
        let inside = region.sample(Instructions::widest(), place, WINDOW, ALL, &mut patch)?;
        Some((inside, WINDOW.pixels(&patch).collect()))
    }

    #[test]
    fn truth_blur_and_bilinear_sampling_keep_a_ramp() {
        let region = about(&ramp(), &blur_taps(1.5), [20.3, 14.6], 9);
        let (inside, patch) = patch(&region, &Placement::at([20.3, 14.6])).unwrap();
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
        let region = about(&ramp(), &[1.0], [20.0, 15.0], 14);
        let place = Placement { centre_px: [20.3, 14.6], linear: [[0.9, -0.3], [0.25, 1.1]] };
        let (inside, warped) = patch(&region, &place).unwrap();
        assert_eq!(inside, Inside::all(8));
        for y in 0..10 {
            for x in 0..10 {
                let [u, v] = place.map([x as f64 - 4.5, y as f64 - 4.5]);
                assert!((f64::from(warped[y * 10 + x]) - (3.0 * u + 2.0 * v)).abs() < 1e-3);
            }
        }
        // Through the identity it is the other way of sampling, to rounding; at whole pixels too.
        for centre_px in [[20.3, 14.6], [20.5, 14.5], [20.0, 15.0]] {
            let (_, plain) = patch(&region, &Placement::at(centre_px)).unwrap();
            let nearly = Placement { linear: [[1.0 + 1e-12, 0.0], [0.0, 1.0]], ..Placement::at(centre_px) };
            let (_, warped) = patch(&region, &nearly).unwrap();
            assert!(plain.iter().zip(&warped).all(|(a, b)| (a - b).abs() < 1e-3));
        }
        assert_eq!(patch(&region, &Placement { centre_px: [8.0, 14.6], ..place }), None);
        assert_eq!(patch(&region, &Placement { centre_px: [f64::NAN, 0.0], ..place }), None);
    }

    #[test]
    fn blurring_a_sharp_region_is_blurring_the_picture() {
        let taps = blur_taps(1.5);
        for centre_px in [[20.3, 14.6], [1.0, 2.0], [38.0, 29.0]] {
            let sharp = about(&ramp(), &[1.0], centre_px, Region::sharp_reach(9, &taps));
            let mut blurred = Region::default();
            blurred.blur(Instructions::widest(), &sharp, &taps, centre_px, 9);
            let expected = about(&ramp(), &taps, centre_px, 9);
            assert_eq!((blurred.origin, blurred.size), (expected.origin, expected.size));
            assert_eq!(blurred.grey, expected.grey);
        }
    }

    #[test]
    fn a_part_is_what_the_whole_has_there() {
        let region = about(&ramp(), &[1.0], [20.0, 15.0], 14);
        let window = Window { side: 20 };
        let (part, all) = (Part { first: 9, end: 11 }, Part { first: 0, end: 20 });
        let turned = Placement { centre_px: [20.3, 14.6], linear: [[0.9, -0.3], [0.25, 0.9]] };
        for place in [Placement::at([20.3, 14.6]), turned] {
            let [mut some, mut whole] = [(); 2].map(|()| vec![0.0; window.padded_len()]);
            region.sample(Instructions::widest(), &place, window, part, &mut some).unwrap();
            region.sample(Instructions::widest(), &place, window, all, &mut whole).unwrap();
            for y in 9..13 {
                for x in 9..13 {
                    let at = y * window.padded_stride() + x;
                    assert!((some[at] - whole[at]).abs() < 1e-4 && some[at] > 0.0);
                }
            }
        }
    }

    #[test]
    fn what_lies_beyond_the_edge_is_named() {
        let region = about(&ramp(), &[1.0], [0.0, 29.0], 9);
        let (inside, _) = patch(&region, &Placement::at([0.0, 29.0])).unwrap();
        // Columns at −3.5 … 3.5 and rows at 25.5 … 32.5.
        assert_eq!(inside, Inside { x: [4, 8], y: [0, 4] });
        assert_eq!(patch(&region, &Placement::at([12.0, 29.0])), None);
        assert_eq!(patch(&region, &Placement::at([f64::NAN, 29.0])), None);
    }

    #[test]
    fn truth_scaled_pixels_are_block_means() {
        let mut region = Region::default();
        region.fill(Instructions::widest(), &ramp(), &[1.0], 2, [0, 0], [20, 15]);
        // Mean of 3u + 2v over the block {2, 3} × {4, 5}.
        assert_eq!(region.grey[2 * region.size[0] + 1], 3.0 * 2.5 + 2.0 * 4.5);
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
                region.fill(Instructions::widest(), &ramp(), &[1.0], scale, [first_u, -3], size);
                let [columns, rows] = region.size;
                assert!(columns >= size[0] && rows == size[1]);
                for (k, grey) in region.grey[..columns * rows].iter().enumerate() {
                    let (u, v) = (first_u + (k % columns) as i64, (k / columns) as i64 - 3);
                    assert_eq!(*grey, mean(u, v), "scale {scale}, ({u}, {v})");
                }
            }
        }
    }
}
