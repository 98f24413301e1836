//! From sheared lines to display columns: the lateral beam, row by row.

use crate::{
    beam::{Beam, PROFILE_REACH, unit_energy_peak},
    instructions::{Instructions, nearest_f32, wide},
    paths::Paths,
    splat::{BAND, CHUNK, Grid},
};

/// Columns filtered together at least.
const BLOCK: usize = crate::paths::ACROSS;
/// Fractions of a line at which taps are kept.
const PHASES: usize = 64;
/// Beam widths kept per unit of widening.
const WIDTHS: f64 = 32.0;
/// Distance of the depths at which beam widths are known. They are taken for chunks of rows, 0.6 mm for a 7.5 MHz probe.
const WIDENING_STEP_M: f64 = 0.1e-3;
/// Terms of the dual's series on each side: 0.268^12 is 1e-7.
const DUAL_TERMS: i32 = 12;

struct Filter {
    radius: usize,
    /// `2·radius` taps for each of `PHASES + 1` fractions.
    taps: Vec<f32>,
}

/// Lateral beam filters for every widening of the beam and every fraction of a line.
///
/// A column splats its share (1 − f, f) on two lines, that is the triangle β. The filter is the least-squares
/// dual of that splat, `D̂ = L̂·β̂ / Σ_k |β̂(ω + 2πk)|²` with `Σ|β̂|² = (2 + cos ω)/3` (Unser 2000, "Sampling —
/// 50 years after Shannon", eqs 19–22), so the mean error over f is the least that two lines allow.
pub struct LateralFilters {
    filters: Vec<Filter>,
    /// Reach of the widest filter, in lines.
    pub radius: usize,
    /// Lines per column of the picture.
    per_px: usize,
    /// How much wider than at the focus the beam is, every [`WIDENING_STEP_M`] down: of each block of columns.
    widening: Vec<Vec<f32>>,
}

impl LateralFilters {
    /// `half_width_m` and `deepest_m` bound the picture, where the beam is widest; `columns` are so many from its left side on.
    pub fn new(beam: &Beam, spacing_m: f64, half_width_m: f64, deepest_m: f64, columns: usize) -> Self {
        let per_px = beam.grain.lines_per_px;
        let line_pitch_m = spacing_m / per_px as f64;
        let widest = beam.most_widening(half_width_m, deepest_m) * Paths::most_stretch();
        let filters: Vec<Filter> = (0..=((widest - 1.0) * WIDTHS).ceil() as usize)
            .map(|i| {
                filter(
                    beam.sigma_lateral_m * (1.0 + i as f64 / WIDTHS),
                    line_pitch_m,
                    beam.grain.lateral_reach,
                )
            })
            .collect();
        let radius = filters.iter().map(|f| f.radius).max().unwrap_or(0);
        let shared = beam.grain.columns_per_width;
        let at_depth = |depth_m: f64| {
            let of_block = |block: usize| {
                let column = block * BLOCK / shared * shared + shared / 2;
                beam.widening(column as f64 * spacing_m - half_width_m, depth_m) as f32
            };
            (0..columns / BLOCK).map(of_block).collect()
        };
        // Rows of the grid reach below the picture by a pulse.
        let deepest_m = deepest_m + PROFILE_REACH * beam.most_sigma_axial_m();
        let depths = 0..(deepest_m / WIDENING_STEP_M) as usize + 2;
        let widening = depths.map(|step| at_depth(step as f64 * WIDENING_STEP_M)).collect();
        Self { filters, radius, per_px, widening }
    }

    /// Which filter each block of columns takes at a depth.
    fn select(&self, paths: &Paths, depth_m: f64, blocks: &mut [u16]) {
        let step = (depth_m * (1.0 / WIDENING_STEP_M) + 0.5) as usize;
        let widening = &self.widening[step.min(self.widening.len() - 1)];
        let most = (self.filters.len() - 1) as f32;
        let stretches = paths.stretches_at(depth_m).chain(core::iter::repeat(1.0));
        for ((index, widening), stretch) in blocks.iter_mut().zip(widening).zip(stretches) {
            let at = (widening * stretch - 1.0) * WIDTHS as f32;
            *index = nearest_f32(at.clamp(0.0, most)) as u16;
        }
    }
}

wide! {
    /// Filters one row, real and imaginary parts side by side. A source starts `radius − 1` lines before the line at or
    /// left of column 0, and `fraction` is how far column 0 lies past that line. `filter_of_block` comes from
    /// [`LateralFilters::select`].
    fn apply(
        filters: &LateralFilters,
        source: [&[f32]; 2],
        fraction: f64,
        filter_of_block: &[u16],
        out: [&mut [f32]; 2],
    ) {
        let LateralFilters { filters, radius, per_px, .. } = filters;
        let [out_re, out_im] = out;
        let phase = (fraction * PHASES as f64 + 0.5) as usize;
        let mut block = 0;
        while let Some(&index) = filter_of_block.get(block) {
            let filter = &filters[usize::from(index)];
            let taps = &filter.taps[phase * 2 * filter.radius..][..2 * filter.radius];
            let column = block * BLOCK;
            let source = source.map(|part| &part[per_px * column + radius - filter.radius..]);
            let out = [&mut out_re[column..], &mut out_im[column..]];
            // Neighbours of equal width go together; sums per column are the same.
            let same = filter_of_block[block..].iter().take(8).take_while(|&&i| i == index).count();
            block += match (same, per_px) {
                (8, 1) => convolve::<{ 8 * BLOCK }, 1>(source, taps, out),
                (4.., 1) => convolve::<{ 4 * BLOCK }, 1>(source, taps, out),
                (2.., 1) => convolve::<{ 2 * BLOCK }, 1>(source, taps, out),
                (_, 1) => convolve::<BLOCK, 1>(source, taps, out),
                (4.., 2) => convolve::<{ 4 * BLOCK }, 2>(source, taps, out),
                (2.., 2) => convolve::<{ 2 * BLOCK }, 2>(source, taps, out),
                (_, 2) => convolve::<BLOCK, 2>(source, taps, out),
                _ => convolve_apart(*per_px, source, taps, out),
            };
        }
    }
}

/// What turns a filled grid into display rows.
pub struct BeamFilters<'a> {
    pub instructions: Instructions,
    pub beam: &'a Beam,
    pub paths: &'a Paths,
    pub lateral: &'a LateralFilters,
    pub grid: &'a Grid,
    pub map: LineMap,
    /// Rows of the grid.
    pub rows: usize,
}

/// `out[j] = Σ_t taps[t]·source[S·j + t]` for N columns of both parts, S lines apart. Returns how many blocks that is.
#[inline(always)]
fn convolve<const N: usize, const S: usize>(
    [re, im]: [&[f32]; 2],
    taps: &[f32],
    [out_re, out_im]: [&mut [f32]; 2],
) -> usize {
    let (mut sum_re, mut sum_im) = ([0.0f32; N], [0.0f32; N]);
    let span = S * (N - 1) + taps.len();
    let width = S * (N - 1) + 1;
    for ((re, im), &tap) in re[..span].windows(width).zip(im[..span].windows(width)).zip(taps) {
        for (s, &v) in sum_re.iter_mut().zip(re.iter().step_by(S)) {
            *s += tap * v;
        }
        for (s, &v) in sum_im.iter_mut().zip(im.iter().step_by(S)) {
            *s += tap * v;
        }
    }
    out_re[..N].copy_from_slice(&sum_re);
    out_im[..N].copy_from_slice(&sum_im);
    N / BLOCK
}

/// [`convolve`] of one block for any distance of the columns, without the wide loads of the two usual ones.
fn convolve_apart(
    per_px: usize,
    [re, im]: [&[f32]; 2],
    taps: &[f32],
    [out_re, out_im]: [&mut [f32]; 2],
) -> usize {
    for (part, out) in [(re, out_re), (im, out_im)] {
        for (column, out) in out[..BLOCK].iter_mut().enumerate() {
            let lines = &part[per_px * column..][..taps.len()];
            *out = lines.iter().zip(taps).map(|(line, tap)| tap * line).sum();
        }
    }
    1
}

/// Taps reach at least `least_reach` σ.
fn filter(sigma_m: f64, line_pitch_m: f64, least_reach: f64) -> Filter {
    let sigma = sigma_m / line_pitch_m;
    let radius = (least_reach * sigma).ceil() as usize;
    // ∬ of a Gaussian of unit area; its second difference is the Gaussian convolved with the triangle.
    let twice_integrated = |y: f64| {
        let u = y / sigma;
        y * 0.5 * libm::erfc(-u * core::f64::consts::FRAC_1_SQRT_2)
            + sigma * libm::exp(-0.5 * u * u) / core::f64::consts::TAU.sqrt()
    };
    let area = unit_energy_peak(sigma_m) * sigma * core::f64::consts::TAU.sqrt();
    let blurred =
        |y: f64| area * (twice_integrated(y + 1.0) - 2.0 * twice_integrated(y) + twice_integrated(y - 1.0));
    let reach = radius as i32 + DUAL_TERMS;
    let pole = 3.0f64.sqrt() - 2.0;
    let mut taps = Vec::with_capacity((PHASES + 1) * 2 * radius);
    for phase in 0..=PHASES {
        let fraction = phase as f64 / PHASES as f64;
        let spread: Vec<f64> = (-reach..=reach).map(|k| blurred(fraction - f64::from(k))).collect();
        for t in 0..2 * radius as i32 {
            let k = t - radius as i32 + 1;
            let mut dual = 0.0;
            let mut power = 3.0f64.sqrt();
            for shift in 0..=DUAL_TERMS {
                let at = |line: i32| spread.get((line + reach) as usize).copied().unwrap_or(0.0);
                dual += power * if shift == 0 { at(k) } else { at(k - shift) + at(k + shift) };
                power *= pole;
            }
            taps.push(dual as f32);
        }
    }
    Filter { radius, taps }
}

/// Where display columns lie on the working grid.
#[derive(Debug, Clone, Copy)]
pub struct LineMap {
    /// Line index of column 0 at row 0, and its change per row.
    pub at_row_0: f64,
    pub per_row: f64,
    pub row_step_m: f64,
}

impl LineMap {
    /// Line index of column 0 at a row.
    fn line_at(&self, row: usize) -> f64 {
        self.at_row_0 + self.per_row * row as f64
    }
}

/// Scratch for one task: a chunk of rows of the grid.
#[derive(Default)]
pub struct LateralScratch {
    /// First row that `rows` holds; `None` before the first.
    first_row: Option<usize>,
    /// Line at the start of every row.
    first_line: i64,
    /// Per row the real parts, then the imaginary ones.
    rows: Vec<f32>,
    blocks: Vec<u16>,
}

impl LateralScratch {
    /// Forgets the picture before.
    pub fn reset(&mut self) {
        self.first_row = None;
    }

    /// Filters one row of the grid into the real and imaginary buffers, of equal length, a multiple of 8. Rows are
    /// asked for in ascending order.
    pub fn filter_row(&mut self, filters: &BeamFilters, row: usize, out: [&mut [f32]; 2]) {
        let columns = out[0].len();
        let first_row = match self.first_row {
            Some(first) if row < first + CHUNK => first,
            _ => self.load(filters, row, columns),
        };
        let line = filters.map.line_at(row);
        let whole = line.floor();
        let radius = filters.lateral.radius;
        let first = (whole as i64 - radius as i64 + 1 - self.first_line) as usize;
        let lines = self.rows.len() / (2 * CHUNK);
        let (re, im) = self.rows[(row - first_row) * 2 * lines..][..2 * lines].split_at(lines);
        let span = filters.lateral.per_px * columns + 2 * radius;
        let source = [&re[first..][..span], &im[first..][..span]];
        apply(filters.instructions, filters.lateral, source, line - whole, &self.blocks, out);
    }

    /// Loads the chunk of `row`; returns its first row.
    fn load(&mut self, filters: &BeamFilters, row: usize, columns: usize) -> usize {
        let BeamFilters { paths, lateral, grid, map, .. } = filters;
        let first_row = row / CHUNK * CHUNK;
        let ends = [first_row, first_row + CHUNK - 1].map(|row| map.line_at(row).floor() as i64);
        let first = ends[0].min(ends[1]) - lateral.radius as i64 + 1;
        let end = ends[0].max(ends[1]) + (lateral.per_px * columns + lateral.radius) as i64 + 1;
        let band = BAND as i64;
        let first_band = first.div_euclid(band);
        let bands = (end - first_band * band + band - 1).div_euclid(band);
        self.first_line = first_band * band;
        self.rows.resize(2 * CHUNK * bands as usize * BAND, 0.0);
        grid.copy_chunk(first_row, first_band, &mut self.rows);
        // Widths change little over a chunk (0.6 mm for a 7.5 MHz probe).
        let depth_m = (first_row + CHUNK / 2) as f64 * map.row_step_m;
        self.blocks.resize(columns / BLOCK, 0);
        lateral.select(paths, depth_m, &mut self.blocks);
        self.first_row = Some(first_row);
        first_row
    }
}
