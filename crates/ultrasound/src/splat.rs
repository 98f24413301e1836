//! Adding columns to the working grid.

use crate::{
    awake,
    columns::{Columns, Layer, Range},
    elevation::{ElevationTable, STRIDE},
    instructions::{Instructions, transpose, wide},
    jobs::{Job, Jobs},
    per_thread::PerThread,
    shear::Shear,
    tape::{BakedTape, unpack},
};

/// Lines per band. A line gets its columns in the same order whatever the band, so the result depends neither on
/// this nor on the threads. A band's lines fit the inner caches while columns are added to them.
pub const BAND: usize = 16;
/// Rows read together.
pub const CHUNK: usize = STRIDE;

/// Complex working grid in bands of lines.
#[derive(Default)]
pub struct Grid {
    bands: Vec<Band>,
    scratch: PerThread<Scratch>,
}

/// Some neighbouring lines of the grid.
#[derive(Default)]
pub struct Band {
    /// Rows that any column reaches, whole strides.
    lo: usize,
    hi: usize,
    /// Per row `BAND` real parts, then as many imaginary ones.
    rows: Vec<f32>,
}

/// Scratch of one thread.
#[derive(Default)]
struct Scratch {
    /// A band under way: per line all real parts, then all imaginary ones. The first and the last line are those beside the
    /// band, which columns reach into as well; they are dropped.
    by_line: Vec<f32>,
    jobs: Vec<Job>,
}

/// What columns are made of.
#[derive(Clone, Copy)]
pub struct Sources<'a> {
    pub instructions: Instructions,
    pub tape: &'a BakedTape,
    pub elevation: &'a ElevationTable,
    pub columns: &'a Columns,
}

impl Grid {
    /// Clears the grid and adds all jobs.
    pub fn fill(&mut self, shear: &Shear, jobs: &Jobs, sources: Sources) {
        self.bands.resize_with(shear.lines.div_ceil(BAND), Band::default);
        self.scratch.prepare();
        let scratch = &self.scratch;
        awake::for_each(self.bands.iter_mut().enumerate(), |(index, band)| {
            scratch.with(|scratch| band.fill(index, jobs, sources, scratch));
        });
    }

    /// The bands of so many lines, to be filled one by one.
    pub fn bands(&mut self, lines: usize) -> &mut [Band] {
        self.bands.resize_with(lines.div_ceil(BAND), Band::default);
        &mut self.bands
    }

    /// Copies [`CHUNK`] rows from `row` on, a multiple of it, of the bands from `first_band` on; zero beyond the
    /// grid. `out` holds, per row, the real parts of all those lines, then the imaginary ones.
    pub fn copy_chunk(&self, row: usize, first_band: i64, out: &mut [f32]) {
        let lines = out.len() / (2 * CHUNK);
        for index in 0..lines / BAND {
            let band = usize::try_from(first_band + index as i64).ok().and_then(|b| self.bands.get(b));
            let out = out.chunks_exact_mut(2 * lines).map(|row| row.split_at_mut(lines));
            let out = out.map(|(re, im)| (&mut re[index * BAND..][..BAND], &mut im[index * BAND..][..BAND]));
            match band {
                Some(band) if (band.lo..band.hi).contains(&row) => {
                    let rows = band.rows[(row - band.lo) * 2 * BAND..].chunks_exact(2 * BAND);
                    for ((re, im), row) in out.zip(rows) {
                        re.copy_from_slice(&row[..BAND]);
                        im.copy_from_slice(&row[BAND..]);
                    }
                }
                _ => out.for_each(|(re, im)| {
                    re.fill(0.0);
                    im.fill(0.0);
                }),
            }
        }
    }
}

impl Band {
    /// All of so many rows, `BAND` real parts and as many imaginary ones each, to be overwritten.
    pub fn whole(&mut self, rows: usize) -> &mut [f32] {
        (self.lo, self.hi) = (0, rows);
        self.rows.resize(rows * 2 * BAND, 0.0);
        &mut self.rows
    }

    fn fill(&mut self, index: usize, jobs: &Jobs, sources: Sources, scratch: &mut Scratch) {
        let first = index * BAND;
        jobs.of_band(index, &mut scratch.jobs);
        self.lo = scratch.jobs.iter().map(|job| job.lo).min().unwrap_or(0) as usize;
        self.hi = scratch.jobs.iter().map(|job| job.hi).max().unwrap_or(0) as usize;
        let rows = self.hi - self.lo;
        let width = 2 * rows;
        let Scratch { jobs, by_line } = scratch;
        by_line.clear();
        by_line.resize((BAND + 2) * width, 0.0);
        for job in &*jobs {
            let lines = &mut by_line[(job.line as usize + 1 - first) * width..][..2 * width];
            add_column(sources, job, self.lo, lines);
        }
        let by_line = &by_line[width..];
        // `resize` keeps old values; every one is overwritten.
        self.rows.resize(rows * 2 * BAND, 0.0);
        if rows > 0 {
            to_rows(sources.instructions, by_line, rows, &mut self.rows);
        }
    }
}

/// Turns a band's lines, of each the real parts of so many rows and then the imaginary ones, into rows: per row `BAND` real parts,
/// then as many imaginary ones.
pub fn to_rows(instructions: Instructions, by_line: &[f32], rows: usize, out: &mut [f32]) {
    for (lines, first) in [(by_line, 0), (&by_line[rows..], BAND)] {
        transpose(instructions, [BAND, rows], lines, 2 * rows, &mut out[first..], 2 * BAND);
    }
}

/// Adds a column to its two lines, of which a band's first row is `band_lo`.
fn add_column(sources: Sources, job: &Job, band_lo: usize, lines: &mut [f32]) {
    let Sources { instructions, tape, elevation, columns } = sources;
    let (lo, hi) = (job.lo as usize, job.hi as usize);
    let run = Run {
        samples: &tape.samples[job.tape as usize..][..hi - lo],
        weights: elevation.weights(job.weights, hi - lo),
        factor: [job.re, job.im],
        share: [1.0 - job.fraction, job.fraction],
        // Scatterer n lies in row n + row_of_0.
        first: job.lo as i32 - job.row_of_0,
        layers: job.layers,
        columns,
    };
    let (left, right) = lines.split_at_mut(lines.len() / 2);
    let (left_re, left_im) = left.split_at_mut(left.len() / 2);
    let (right_re, right_im) = right.split_at_mut(right.len() / 2);
    let rows = lo - band_lo..hi - band_lo;
    add_run(
        instructions,
        &run,
        &mut left_re[rows.clone()],
        &mut left_im[rows.clone()],
        &mut right_re[rows.clone()],
        &mut right_im[rows],
    );
}

/// A run of one column through the slice: whole strides, so that no loop is left with odd ends.
struct Run<'a> {
    samples: &'a [u32],
    weights: &'a [f32],
    factor: [f32; 2],
    share: [f32; 2],
    /// Scatterer of the first row.
    first: i32,
    /// What lies along the run; one material where there is none.
    layers: Option<Range>,
    columns: &'a Columns,
}

/// Ones before place p, by p.
const BEFORE: [[f32; STRIDE]; STRIDE + 1] = {
    let mut before = [[0.0; STRIDE]; STRIDE + 1];
    let mut place = 0;
    while place <= STRIDE {
        let mut i = 0;
        while i < place {
            before[place][i] = 1.0;
            i += 1;
        }
        place += 1;
    }
    before
};

/// Amplitudes of a stride of scatterers from `n` on, whose first lies in the first layer, or ahead of it: there is nothing.
#[inline(always)]
pub fn amplitudes(n: i32, layers: &[Layer], columns: &Columns) -> [f32; STRIDE] {
    let mut amplitudes = [0.0; STRIDE];
    let mut start = (-n).clamp(0, STRIDE as i32) as usize;
    for &layer in layers {
        let amplitude = columns.filling(layer).amplitude;
        let end = layer.end.saturating_sub(n).min(STRIDE as i32) as usize;
        for (a, (below, above)) in amplitudes.iter_mut().zip(BEFORE[end].iter().zip(&BEFORE[start])) {
            *a += amplitude * (below - above);
        }
        start = end;
        if end == STRIDE {
            break;
        }
    }
    amplitudes
}

wide! {
    /// Adds a run to the real and imaginary parts of its left and right lines.
    fn add_run(
        run: &Run,
        left_re: &mut [f32],
        left_im: &mut [f32],
        right_re: &mut [f32],
        right_im: &mut [f32],
    ) {
        let Run { samples, weights, factor, share, first, layers, columns } = *run;
        let Some(layers) = layers else {
            return add(samples, weights, factor, share, left_re, left_im, right_re, right_im);
        };
        let layers = columns.layers(layers);
        let (size, count) = (STRIDE as i32, samples.len() as i32);
        let mut row = 0;
        for (index, &layer) in layers.iter().enumerate() {
            let left = layer.end.saturating_sub(first + row);
            if left <= 0 {
                continue;
            }
            let whole = (left / size * size).min(count - row);
            let amplitude = columns.filling(layer).amplitude;
            if whole > 0 && amplitude != 0.0 {
                let rows = row as usize..(row + whole) as usize;
                let factor = factor.map(|part| amplitude * part);
                add(
                    &samples[rows.clone()],
                    &weights[rows.clone()],
                    factor,
                    share,
                    &mut left_re[rows.clone()],
                    &mut left_im[rows.clone()],
                    &mut right_re[rows.clone()],
                    &mut right_im[rows],
                );
            }
            row += whole;
            if row == count {
                break;
            }
            if whole == left {
                continue;
            }
            // A stride of several layers.
            let rows = row as usize..row as usize + STRIDE;
            let mut mixed = amplitudes(first + row, &layers[index..], columns);
            for (mixed, weight) in mixed.iter_mut().zip(&weights[rows.clone()]) {
                *mixed *= weight;
            }
            add(
                &samples[rows.clone()],
                &mixed,
                factor,
                share,
                &mut left_re[rows.clone()],
                &mut left_im[rows.clone()],
                &mut right_re[rows.clone()],
                &mut right_im[rows],
            );
            row += size;
        }
    }
}

/// Slices as arguments are known to be apart, and the loop vectorises without checks.
#[inline(always)]
#[expect(clippy::too_many_arguments, reason = "six streams and their factors")]
fn add(
    samples: &[u32],
    weights: &[f32],
    [c_re, c_im]: [f32; 2],
    [a, b]: [f32; 2],
    left_re: &mut [f32],
    left_im: &mut [f32],
    right_re: &mut [f32],
    right_im: &mut [f32],
) {
    let count = samples.len();
    let weights = &weights[..count];
    let (left_re, left_im) = (&mut left_re[..count], &mut left_im[..count]);
    let (right_re, right_im) = (&mut right_re[..count], &mut right_im[..count]);
    for i in 0..count {
        let [re, im] = unpack(samples[i]);
        let [re, im] = [weights[i] * (c_re * re - c_im * im), weights[i] * (c_re * im + c_im * re)];
        left_re[i] += a * re;
        left_im[i] += a * im;
        right_re[i] += b * re;
        right_im[i] += b * im;
    }
}
