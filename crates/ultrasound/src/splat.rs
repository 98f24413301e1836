//! Adding columns to the working grid.

use rayon::prelude::*;

use crate::{
    columns::{Columns, Stretch},
    elevation::{ElevationTable, STRIDE},
    instructions::{Instructions, wide},
    jobs::{Job, Jobs},
    shear::Shear,
    tape::{BakedTape, unpack},
};

/// Lines per band. A line gets its columns in the same order whatever the band, so the result depends neither on
/// this nor on the threads. A band's lines fit the inner caches while columns are added to them.
pub const BAND: usize = 16;
/// Rows read together.
pub const CHUNK: usize = STRIDE;
/// Bands per task; fixed, though results do not depend on it.
const TASK_BANDS: usize = 4;

/// Complex working grid in bands of lines.
#[derive(Default)]
pub struct Grid {
    bands: Vec<Band>,
    scratch: Vec<Scratch>,
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

/// Scratch of one task.
#[derive(Default)]
struct Scratch {
    /// A band under way: per line all real parts, then all imaginary ones.
    by_line: Vec<f32>,
    mixed: Vec<f32>,
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
        self.scratch.resize_with(self.bands.len().div_ceil(TASK_BANDS), Scratch::default);
        let tasks = self.bands.par_chunks_mut(TASK_BANDS).zip(&mut self.scratch);
        tasks.enumerate().for_each(|(task, (bands, scratch))| {
            for (i, band) in bands.iter_mut().enumerate() {
                let index = task * TASK_BANDS + i;
                band.fill(index, BAND.min(shear.lines - index * BAND), jobs, sources, scratch);
            }
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
    /// Fills all rows of all lines. `add` gets the lines one after another and the values per part: real ones, then
    /// imaginary ones, each with `margin` rows more at both ends, which are dropped.
    pub fn fill_whole(
        &mut self,
        instructions: Instructions,
        rows: usize,
        margin: usize,
        add: impl FnOnce(&mut [f32], usize),
    ) {
        let stride = rows + 2 * margin;
        let mut by_line = vec![0.0; BAND * 2 * stride];
        add(&mut by_line, stride);
        (self.lo, self.hi) = (0, rows);
        self.rows.resize(rows * 2 * BAND, 0.0);
        transpose(instructions, &by_line[margin..], 2 * stride, rows, &mut self.rows);
        transpose(instructions, &by_line[stride + margin..], 2 * stride, rows, &mut self.rows[BAND..]);
    }

    fn fill(&mut self, index: usize, lines: usize, jobs: &Jobs, sources: Sources, scratch: &mut Scratch) {
        let first = index * BAND;
        jobs.of_band(index, &mut scratch.jobs);
        self.lo = scratch.jobs.iter().map(|job| job.lo).min().unwrap_or(0) as usize;
        self.hi = scratch.jobs.iter().map(|job| job.hi).max().unwrap_or(0) as usize;
        let rows = self.hi - self.lo;
        let width = 2 * rows;
        let Scratch { jobs, by_line, mixed } = scratch;
        by_line.clear();
        by_line.resize(BAND * width, 0.0);
        for job in &*jobs {
            let line = job.line as usize;
            if line < first {
                // The column's left line belongs to the band before.
                let line = &mut by_line[..width];
                add_column(job, self.lo, sources, mixed, |run| run.add_to_one(line, job.fraction));
            } else if line + 1 == first + lines {
                let line = &mut by_line[(lines - 1) * width..][..width];
                add_column(job, self.lo, sources, mixed, |run| run.add_to_one(line, 1.0 - job.fraction));
            } else {
                let (left, right) = by_line[(line - first) * width..][..2 * width].split_at_mut(width);
                add_column(job, self.lo, sources, mixed, |run| run.add_to_two(left, right, job.fraction));
            }
        }
        // `resize` keeps old values; every one is overwritten.
        self.rows.resize(rows * 2 * BAND, 0.0);
        if rows > 0 {
            transpose(sources.instructions, by_line, width, rows, &mut self.rows);
            transpose(sources.instructions, &by_line[rows..], width, rows, &mut self.rows[BAND..]);
        }
    }
}

/// A run of one column through the slice: whole strides, so that no loop is left with odd ends.
struct Run<'a> {
    samples: &'a [u32],
    weights: &'a [f32],
    factor: [f32; 2],
    instructions: Instructions,
    /// First row, counted from the band's, and one past the last.
    rows: [usize; 2],
}

/// Finds what a job adds. `mixed` is scratch.
#[inline(always)]
fn add_column(job: &Job, band_lo: usize, sources: Sources, mixed: &mut Vec<f32>, add: impl FnOnce(Run)) {
    let (row, count) = (job.lo as usize, (job.hi - job.lo) as usize);
    let mut weights = sources.elevation.weights(job.weights, count);
    if let Some(stretches) = job.stretches {
        // Scatterer n lies in row n + row_of_0.
        let first = job.lo as i32 - job.row_of_0;
        mixed.resize(mixed.len().max(count), 0.0);
        mix(sources.instructions, weights, first, sources.columns.stretches(stretches), &mut mixed[..count]);
        weights = &mixed[..count];
    }
    add(Run {
        samples: &sources.tape.samples[job.tape as usize..][..count],
        weights,
        factor: [job.re, job.im],
        instructions: sources.instructions,
        rows: [row - band_lo, row - band_lo + count],
    });
}

wide! {
    /// Weights times the amplitudes of several materials, of scatterers from `first` on; nothing where there is none.
    fn mix(weights: &[f32], first: i32, stretches: &[Stretch], mixed: &mut [f32]) {
        let count = weights.len() as i32;
        let mut next = 0;
        for stretch in stretches {
            let [start, end] =
                [stretch.start, stretch.end].map(|n| n.saturating_sub(first).clamp(0, count) as usize);
            // A call for nothing takes as long as the loop below.
            if next < start {
                mixed[next..start].fill(0.0);
            }
            for (mixed, weight) in mixed[start..end].iter_mut().zip(&weights[start..end]) {
                *mixed = weight * stretch.amplitude;
            }
            next = end;
        }
        if next < mixed.len() {
            mixed[next..].fill(0.0);
        }
    }
}

impl Run<'_> {
    fn add_to_two(&self, left: &mut [f32], right: &mut [f32], fraction: f32) {
        let (left_re, left_im) = self.parts(left);
        let (right_re, right_im) = self.parts(right);
        let share = [1.0 - fraction, fraction];
        let Self { instructions, samples, weights, factor, .. } = *self;
        add_to_two(instructions, samples, weights, factor, share, left_re, left_im, right_re, right_im);
    }

    fn add_to_one(&self, line: &mut [f32], share: f32) {
        let (line_re, line_im) = self.parts(line);
        // The same products in the same order as for two lines, so that bands do not show in the sums.
        for (i, (&sample, &weight)) in self.samples.iter().zip(self.weights).enumerate() {
            let [re, im] = weighted(sample, weight, self.factor);
            line_re[i] += share * re;
            line_im[i] += share * im;
        }
    }

    fn parts<'l>(&self, line: &'l mut [f32]) -> (&'l mut [f32], &'l mut [f32]) {
        let (re, im) = line.split_at_mut(line.len() / 2);
        let [lo, hi] = self.rows;
        (&mut re[lo..hi], &mut im[lo..hi])
    }
}

#[inline(always)]
fn weighted(sample: u32, weight: f32, [c_re, c_im]: [f32; 2]) -> [f32; 2] {
    let [re, im] = unpack(sample);
    [weight * (c_re * re - c_im * im), weight * (c_re * im + c_im * re)]
}

wide! {
    /// A function of its own: as arguments the slices are known to be apart, and the loop vectorises without checks.
    #[inline(never)]
    #[expect(clippy::too_many_arguments, reason = "six streams and their factors")]
    fn add_to_two(
        samples: &[u32],
        weights: &[f32],
        factor: [f32; 2],
        share: [f32; 2],
        left_re: &mut [f32],
        left_im: &mut [f32],
        right_re: &mut [f32],
        right_im: &mut [f32],
    ) {
        let count = samples.len();
        let weights = &weights[..count];
        let (left_re, left_im) = (&mut left_re[..count], &mut left_im[..count]);
        let (right_re, right_im) = (&mut right_re[..count], &mut right_im[..count]);
        let [a, b] = share;
        for i in 0..count {
            let [re, im] = weighted(samples[i], weights[i], factor);
            left_re[i] += a * re;
            left_im[i] += a * im;
            right_re[i] += b * re;
            right_im[i] += b * im;
        }
    }
}

wide! {
    /// Turns lines, `stride` apart, into rows of a band, by quads.
    fn transpose(source: &[f32], stride: usize, rows: usize, out: &mut [f32]) {
        for line in (0..BAND).step_by(4) {
            let [a, b, c, d] = [0, 1, 2, 3].map(|i| source[(line + i) * stride..][..rows].as_chunks::<4>().0);
            for ((((a, b), c), d), out) in a.iter().zip(b).zip(c).zip(d).zip(out.chunks_mut(4 * 2 * BAND)) {
                for j in 0..4 {
                    out[j * 2 * BAND + line..][..4].copy_from_slice(&[a[j], b[j], c[j], d[j]]);
                }
            }
        }
    }
}
