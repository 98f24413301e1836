//! Where in a picture a template may be: weighted NCC at coarse resolution, then the best few peaks.

use sonoloop_simd::{Instructions, wide};
use sonoloop_types::Image;

use crate::gaussian::{axis_weights, blur_taps};
use crate::region::Region;
use crate::template::Template;

/// Candidates kept of one search.
pub(crate) const PEAKS: usize = 4;
/// Weights below exp(−3²/2) ≈ 1 % are not worth their multiplications in a coarse search.
const WINDOW_SIGMAS: f64 = 3.0;
/// Coarse windows wider than this are searched at a quarter of the resolution, not half.
const MAX_HALF_SIDE: usize = 20;
/// Windows whose products are summed side by side, in registers.
const BLOCK: usize = 16;
/// Variance in grey levels squared below which a place counts as flat.
const FLAT: f32 = 1.0;

/// Coarse NCC search of one template. It proposes; the caller scores its proposals at full resolution.
#[derive(Debug, Clone)]
pub(crate) struct Search {
    instructions: Instructions,
    /// Picture pixels per coarse pixel.
    scale: usize,
    /// First template column and row that take part.
    crop: usize,
    /// Coarse side of the window.
    side: usize,
    taps: Vec<f32>,
    axis: Vec<f32>,
    /// Weight × (template − weighted mean), side² values.
    kernel: Vec<f32>,
    /// Contrast of the template: weighted variance × weight sum.
    energy: f32,
    weight_sum: f32,
    region: Region,
    map: Vec<f32>,
    columns: [Vec<f32>; 2],
    sums: [Vec<f32>; 2],
    /// The largest picture there is room for.
    reserved_px: [u32; 2],
}

/// Candidate places, best first; unused entries are `None`.
pub(crate) type Peaks = [Option<[f64; 2]>; PEAKS];

impl Search {
    /// Prepares the search of `template`; no picture up to `picture_px` makes it allocate again.
    pub fn new(
        instructions: Instructions,
        template: &Template,
        blur_sigma_px: f64,
        weight_sigma_px: f64,
        picture_px: [u32; 2],
    ) -> Self {
        let full = template.window.side;
        let wanted = if weight_sigma_px > 0.0 {
            (2.0 * libm::ceil(WINDOW_SIGMAS * weight_sigma_px)) as usize
        } else {
            full
        };
        let window = wanted.min(full).max(8);
        let scale = if window / 2 > MAX_HALF_SIDE { 4 } else { 2 };
        let side = window / scale;
        // The parity of what is cut off keeps the window's middle on the template's, to half a pixel at most.
        let crop = (full - side * scale) / 2;
        let axis = axis_weights(side, weight_sigma_px / scale as f64);
        let mut search = Self {
            instructions,
            scale,
            crop,
            side,
            taps: blur_taps(blur_sigma_px / scale as f64),
            kernel: vec![0.0; side * side],
            energy: 0.0,
            weight_sum: axis.iter().sum::<f32>() * axis.iter().sum::<f32>(),
            axis,
            region: Region::default(),
            map: Vec::new(),
            columns: [Vec::new(), Vec::new()],
            sums: [Vec::new(), Vec::new()],
            reserved_px: [0; 2],
        };
        search.look_for(template);
        search.reserve(picture_px);
        search
    }

    /// Another template of the same size.
    pub fn look_for(&mut self, template: &Template) {
        let width = template.window.padded_stride();
        let mut mean = 0.0;
        for y in 0..self.side {
            for x in 0..self.side {
                let mut sum = 0.0;
                for dy in 0..self.scale {
                    for dx in 0..self.scale {
                        let row = 1 + self.crop + y * self.scale + dy;
                        sum += template.padded[row * width + 1 + self.crop + x * self.scale + dx];
                    }
                }
                let level = sum / (self.scale * self.scale) as f32;
                self.kernel[y * self.side + x] = level;
                mean += self.axis[x] * self.axis[y] * level;
            }
        }
        mean /= self.weight_sum;
        self.energy = 0.0;
        for y in 0..self.side {
            for x in 0..self.side {
                let weight = self.axis[x] * self.axis[y];
                let level = self.kernel[y * self.side + x] - mean;
                self.energy += weight * level * level;
                self.kernel[y * self.side + x] = weight * level;
            }
        }
    }

    /// Makes every buffer as large as a search of the whole picture will need.
    pub fn reserve(&mut self, picture_px: [u32; 2]) {
        let [width_px, height_px] = [0, 1].map(|axis| picture_px[axis].max(self.reserved_px[axis]));
        if [width_px, height_px] == self.reserved_px {
            return;
        }
        self.reserved_px = [width_px, height_px];
        let [width, height] = self.reserved_px.map(|n| n as usize / self.scale);
        self.region.fill(
            self.instructions,
            &Image::black(1, 1),
            &self.taps,
            1,
            [0, 0],
            [width.max(1), height.max(1)],
        );
        self.map.resize(width * height, 0.0);
        self.columns.iter_mut().chain(&mut self.sums).for_each(|buffer| buffer.resize(width, 0.0));
    }

    /// Peaks among the template centres within `reach` pixels of `centre_px` on both axes, `None` for everywhere.
    pub fn peaks(&mut self, image: &Image, about: Option<([f64; 2], f64)>) -> Peaks {
        let picture = [image.width_px, image.height_px].map(|n| n as usize / self.scale);
        // Coarse position k of the window means a template centre of scale·k + this.
        let offset = (self.side * self.scale) as f64 / 2.0 - 0.5;
        let mut first = [0_i64; 2];
        let mut count = [0_usize; 2];
        for axis in 0..2 {
            let last = picture[axis] as i64 - self.side as i64;
            let (mut low, mut high) = (0, last);
            if let Some((centre_px, reach_px)) = about {
                let coarse = |c: f64| ((c - offset) / self.scale as f64).clamp(-1e9, 1e9);
                low = low.max(libm::ceil(coarse(centre_px[axis] - reach_px)) as i64);
                high = high.min(libm::floor(coarse(centre_px[axis] + reach_px)) as i64);
            }
            if high < low {
                return [None; PEAKS];
            }
            first[axis] = low;
            count[axis] = (high - low + 1) as usize;
        }
        let size = [count[0] + self.side - 1, count[1] + self.side - 1];
        self.region.fill(self.instructions, image, &self.taps, self.scale, first, size);
        self.correlate(count);
        let centre = |axis: usize, k: usize| (self.scale as i64 * (first[axis] + k as i64)) as f64 + offset;
        self.best(count).map(|peak| peak.map(|[x, y]| [centre(0, x), centre(1, y)]))
    }

    /// Weighted NCC of the template with every window of the region, into `map`.
    fn correlate(&mut self, [columns, rows]: [usize; 2]) {
        let width = self.region.size[0];
        self.map.resize(columns * rows, 0.0);
        self.columns.iter_mut().for_each(|buffer| buffer.resize(width, 0.0));
        self.sums.iter_mut().for_each(|buffer| buffer.resize(columns, 0.0));
        let [linear, square] = &mut self.columns;
        let [mean, energy] = &mut self.sums;
        let energy_floor = FLAT * self.weight_sum;
        if self.energy <= energy_floor {
            self.map.fill(-1.0);
            return;
        }
        for (y, map) in self.map.chunks_exact_mut(columns).enumerate() {
            // The weights of Σ w I and Σ w I² separate; those of Σ w T I do not.
            let rows = &self.region.grey[y * width..];
            add_rows(self.instructions, rows, width, &self.axis, linear, square);
            add_columns(self.instructions, &self.axis, self.weight_sum, linear, square, mean, energy);
            let (blocks, rest) = map.as_chunks_mut::<BLOCK>();
            let (block_energies, rest_energies) = energy.as_chunks::<BLOCK>();
            for (block, (map, energy)) in blocks.iter_mut().zip(block_energies).enumerate() {
                // Much of a picture is black: the margins beside the aperture, and what lies below the noise.
                if energy.iter().all(|&energy| energy <= energy_floor) {
                    map.fill(-1.0);
                    continue;
                }
                let product =
                    block_products(self.instructions, &self.kernel, self.side, &rows[block * BLOCK..], width);
                *map = scores(self.instructions, &product, energy, self.energy, energy_floor);
            }
            let first = columns - rest.len();
            for (x, (ncc, &energy)) in rest.iter_mut().zip(rest_energies).enumerate() {
                let [product] = products::<1>(&self.kernel, self.side, &rows[first + x..], width);
                *ncc = score(product, energy, self.energy, energy_floor);
            }
        }
    }

    /// The highest local maxima of the map (over 3 × 3), best first; equal ones in reading order.
    fn best(&self, [columns, rows]: [usize; 2]) -> [Option<[usize; 2]>; PEAKS] {
        let mut found: [Option<(f32, [usize; 2])>; PEAKS] = [None; PEAKS];
        for y in 0..rows {
            for x in 0..columns {
                let value = self.map[y * columns + x];
                let worst = found[PEAKS - 1].map_or(0.0, |(value, _)| value);
                if value <= worst || !self.is_peak(columns, rows, x, y, value) {
                    continue;
                }
                let place = found.iter().position(|f| f.is_none_or(|(v, _)| v < value)).unwrap_or(PEAKS - 1);
                found[place..].rotate_right(1);
                found[place] = Some((value, [x, y]));
            }
        }
        found.map(|peak| peak.map(|(_, at)| at))
    }

    fn is_peak(&self, columns: usize, rows: usize, x: usize, y: usize, value: f32) -> bool {
        (y.saturating_sub(1)..(y + 2).min(rows)).all(|v| {
            let row = &self.map[v * columns..][..columns];
            row[x.saturating_sub(1)..(x + 2).min(columns)].iter().all(|near| *near <= value)
        })
    }
}

wide! {
    /// Σ w I and Σ w I² over the rows of a window, for every column.
    fn add_rows(
        rows: &[f32],
        width: usize,
        axis: &[f32],
        linear: &mut [f32],
        square: &mut [f32],
    ) {
        linear.fill(0.0);
        square.fill(0.0);
        for (row, weight) in rows.chunks_exact(width).zip(axis) {
            for ((linear, square), grey) in linear.iter_mut().zip(square.iter_mut()).zip(row) {
                *linear += weight * grey;
                *square += weight * grey * grey;
            }
        }
    }
}

wide! {
    /// The weighted sum of every window, and its contrast Σ w (I − mean)².
    fn add_columns(
        axis: &[f32],
        weight_sum: f32,
        linear: &[f32],
        square: &[f32],
        sums: &mut [f32],
        energy: &mut [f32],
    ) {
        sums.fill(0.0);
        energy.fill(0.0);
        for (x, weight) in axis.iter().enumerate() {
            let values = linear[x..].iter().zip(&square[x..]);
            for ((sum, energy), (linear, square)) in sums.iter_mut().zip(energy.iter_mut()).zip(values) {
                *sum += weight * linear;
                *energy += weight * square;
            }
        }
        for (energy, sum) in energy.iter_mut().zip(sums.iter()) {
            *energy -= sum * sum / weight_sum;
        }
    }
}

wide! {
    /// [`score`] of a block of windows.
    fn scores(
        products: &[f32; BLOCK],
        energies: &[f32; BLOCK],
        template_energy: f32,
        energy_floor: f32,
    ) -> [f32; BLOCK] {
        core::array::from_fn(|k| score(products[k], energies[k], template_energy, energy_floor))
    }
}

/// NCC of one window; −1 where it is flat.
#[inline(always)]
fn score(product: f32, energy: f32, template_energy: f32, energy_floor: f32) -> f32 {
    let ncc = product / (energy * template_energy).sqrt();
    if energy <= energy_floor { -1.0 } else { ncc }
}

wide! {
    /// [`products`] of a whole block.
    fn block_products(kernel: &[f32], side: usize, rows: &[f32], width: usize) -> [f32; BLOCK] {
        products::<BLOCK>(kernel, side, rows, width)
    }
}

/// Σ w T I of N neighbouring windows, the first at the start of `rows`, which lie `width` apart.
#[inline(always)]
fn products<const N: usize>(kernel: &[f32], side: usize, rows: &[f32], width: usize) -> [f32; N] {
    let mut sums = [0.0f32; N];
    for (k, kernel) in kernel.chunks_exact(side).enumerate() {
        for (window, &factor) in rows[k * width..][..side + N - 1].windows(N).zip(kernel) {
            for (sum, &grey) in sums.iter_mut().zip(window) {
                *sum += factor * grey;
            }
        }
    }
    sums
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::warp::Placement;
    use crate::window::Part;

    /// Smoothed noise: a texture in which no two places are alike.
    fn picture() -> Image {
        let mut x = 1_u32;
        let mut noise = || {
            x = x.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            (x >> 24) as u8
        };
        let noise = Image::from_pixels(160, 120, (0..160 * 120).map(|_| noise()).collect()).unwrap();
        let mut smooth = Region::default();
        smooth.fill(Instructions::widest(), &noise, &blur_taps(2.0), 1, [0, 0], [160, 120]);
        let stretched =
            smooth.grey[..160 * 120].iter().map(|grey| (5.0 * (grey - 127.5) + 127.5) as u8).collect();
        Image::from_pixels(160, 120, stretched).unwrap()
    }

    fn cut(image: &Image, centre_px: [f64; 2], side: usize) -> Template {
        let mut region = Region::default();
        region.fill_about(Instructions::widest(), image, &blur_taps(1.5), centre_px, side);
        let mut template = Template::blank(side);
        let (window, all) = (template.window, Part { first: 0, end: side });
        let mut padded = template.padded.clone();
        region.sample(Instructions::widest(), &Placement::at(centre_px), window, all, &mut padded).unwrap();
        template.refresh(&padded, None);
        template
    }

    #[test]
    fn the_best_peak_is_the_place_the_template_came_from() {
        let image = picture();
        for side in [20, 21, 33, 61] {
            for weight_sigma_px in [0.0, 3.0] {
                for centre_px in [[60.5, 40.5], [90.0, 70.0], [47.3, 81.8]] {
                    let mut search = Search::new(
                        Instructions::widest(),
                        &cut(&image, centre_px, side),
                        1.5,
                        weight_sigma_px,
                        [160, 120],
                    );
                    let slack = search.scale as f64;
                    for about in [None, Some(([centre_px[0] + 9.0, centre_px[1] - 8.0], 15.0))] {
                        let [u, v] = search.peaks(&image, about)[0].unwrap();
                        let off = (u - centre_px[0]).abs().max((v - centre_px[1]).abs());
                        assert!(off <= slack, "side {side}, {centre_px:?}: {off} px off");
                    }
                }
            }
        }
    }

    #[test]
    fn truth_the_map_agrees_with_a_plain_weighted_ncc() {
        let mut image = picture();
        let template = cut(&image, [60.0, 40.0], 20);
        // Black on the right: whole blocks of windows are flat, and one is in part.
        for row in image.pixels.chunks_exact_mut(160) {
            row[80..].fill(0);
        }
        let mut search = Search::new(Instructions::widest(), &template, 1.5, 3.0, [160, 120]);
        // Two blocks and a rest.
        let count = [2 * BLOCK + 5, 3];
        search.region.fill(
            Instructions::widest(),
            &image,
            &search.taps,
            2,
            [10, 8],
            [count[0] + search.side - 1, count[1] + search.side - 1],
        );
        search.correlate(count);
        let (side, width) = (search.side, search.region.size[0]);
        let mut flat = 0;
        for y in 0..count[1] {
            for x in 0..count[0] {
                let [mut s, mut ss, mut st] = [0.0_f64; 3];
                for j in 0..side {
                    for i in 0..side {
                        let w = f64::from(search.axis[i] * search.axis[j]);
                        let g = f64::from(search.region.grey[(y + j) * width + x + i]);
                        s += w * g;
                        ss += w * g * g;
                        st += f64::from(search.kernel[j * side + i]) * g;
                    }
                }
                let energy = ss - s * s / f64::from(search.weight_sum);
                let is_flat = energy <= f64::from(FLAT * search.weight_sum);
                flat += usize::from(is_flat);
                let expected = if is_flat { -1.0 } else { st / (energy * f64::from(search.energy)).sqrt() };
                let ncc = f64::from(search.map[y * count[0] + x]);
                assert!((ncc - expected).abs() < 1e-3, "({x}, {y}): {ncc} instead of {expected}");
            }
        }
        assert!((BLOCK..2 * BLOCK * count[1]).contains(&flat), "{flat} flat windows");
    }

    #[test]
    fn nothing_is_found_where_the_template_does_not_fit() {
        let image = picture();
        let mut search =
            Search::new(Instructions::widest(), &cut(&image, [60.0, 40.0], 20), 1.5, 3.0, [160, 120]);
        assert_eq!(search.peaks(&Image::black(5, 5), None), [None; PEAKS]);
        assert_eq!(search.peaks(&Image::black(160, 120), None), [None; PEAKS]);
        assert_eq!(search.peaks(&image, Some(([-500.0, 40.0], 20.0))), [None; PEAKS]);
    }
}
