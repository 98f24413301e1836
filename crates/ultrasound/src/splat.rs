//! Adding columns to the working grid.

use rayon::prelude::*;

use crate::{
    elevation::ElevationTable,
    jobs::{Job, Jobs},
    shear::Shear,
    tape::BakedTape,
};

/// Lines per band; bands are filled side by side. A line gets its columns in the same order whatever the band,
/// so the result depends neither on this nor on the threads. Narrow bands span few rows of a sheared grid.
const BAND: usize = 48;

/// Rows and lines transposed at a time.
const TILE: usize = 16;

/// Complex working grid, row by row, in bands of lines.
#[derive(Default)]
pub struct Grid {
    bands: Vec<Band>,
    lines: usize,
}

#[derive(Default)]
struct Band {
    /// Rows that any column reaches, whole tiles.
    lo: usize,
    hi: usize,
    /// Per line all real parts, then all imaginary ones, over `hi − lo` rows.
    by_line: Vec<f32>,
    /// Per row all real parts, then all imaginary ones, over the band's lines.
    by_row: Vec<f32>,
}

impl Grid {
    /// Clears the grid and adds all jobs.
    pub fn fill(&mut self, shear: &Shear, jobs: &Jobs, tape: &BakedTape, elevation: &ElevationTable) {
        self.lines = shear.lines;
        self.bands.resize_with(self.lines.div_ceil(BAND), Band::default);
        self.bands.par_iter_mut().enumerate().for_each(|(index, band)| {
            let first = index * BAND;
            band.fill(first, BAND.min(shear.lines - first), jobs, tape, elevation);
            band.transpose();
        });
    }

    /// Copies the lines from `first` on of one row; zero beyond the grid. Real, imaginary parts.
    pub fn copy_row(&self, row: usize, first: i64, re: &mut [f32], im: &mut [f32]) {
        let (mut done, count) = (0, re.len());
        while done < count {
            let line = first + done as i64;
            let inside = line >= 0 && line < self.lines as i64;
            let (index, skip) = (line as usize / BAND, line as usize % BAND);
            let length = match inside {
                true => (BAND - skip).min(count - done),
                false if line < 0 => (-line as usize).min(count - done),
                false => count - done,
            };
            let (re, im) = (&mut re[done..][..length], &mut im[done..][..length]);
            match self.bands.get(index) {
                Some(band) if inside && (band.lo..band.hi).contains(&row) => {
                    let row = &band.by_row[(row - band.lo) * 2 * BAND..][..2 * BAND];
                    re.copy_from_slice(&row[skip..][..length]);
                    im.copy_from_slice(&row[BAND + skip..][..length]);
                }
                _ => {
                    re.fill(0.0);
                    im.fill(0.0);
                }
            }
            done += length;
        }
    }
}

impl Band {
    fn fill(
        &mut self,
        first: usize,
        lines: usize,
        jobs: &Jobs,
        tape: &BakedTape,
        elevation: &ElevationTable,
    ) {
        let from = jobs.starts[first.saturating_sub(1)] as usize;
        let jobs_here = &jobs.sorted[from..jobs.starts[first + lines] as usize];
        let lo = jobs_here.iter().map(|job| job.lo).min().unwrap_or(0) as usize;
        let hi = jobs_here.iter().map(|job| job.lo + job.count).max().unwrap_or(0) as usize;
        (self.lo, self.hi) = (lo / TILE * TILE, hi.next_multiple_of(TILE));
        let width = 2 * (self.hi - self.lo);
        self.by_line.clear();
        self.by_line.resize(lines.next_multiple_of(TILE) * width, 0.0);
        for job in jobs_here {
            let (line, lo) = (job.line as usize, job.lo as usize - self.lo);
            if line < first {
                // The column's left line belongs to the band before.
                add_to_one(&mut self.by_line[..width], job, lo, job.fraction, tape, elevation);
            } else if line + 1 == first + lines {
                let last = (lines - 1) * width;
                add_to_one(&mut self.by_line[last..][..width], job, lo, 1.0 - job.fraction, tape, elevation);
            } else {
                let pair = &mut self.by_line[(line - first) * width..][..2 * width];
                let (left, right) = pair.split_at_mut(width);
                add_to_two(left, right, job, lo, tape, elevation);
            }
        }
    }

    fn transpose(&mut self) {
        let rows = self.hi - self.lo;
        self.by_row.resize(rows * 2 * BAND, 0.0);
        if rows == 0 {
            return;
        }
        for (tile, lines) in self.by_line.chunks_exact(TILE * 2 * rows).enumerate() {
            for part in 0..2 {
                for row in (0..rows).step_by(TILE) {
                    let start = (row * 2 + part) * BAND + tile * TILE;
                    let out = &mut self.by_row[start..][..(TILE - 1) * 2 * BAND + TILE];
                    transpose_tile(&lines[part * rows + row..], 2 * rows, out, 2 * BAND);
                }
            }
        }
    }
}

/// Transposes a tile by quads, which compile to shuffles.
#[inline(always)]
fn transpose_tile(source: &[f32], source_stride: usize, out: &mut [f32], out_stride: usize) {
    for line in (0..TILE).step_by(4) {
        let lines: [&[f32]; 4] = core::array::from_fn(|i| &source[(line + i) * source_stride..][..TILE]);
        for row in (0..TILE).step_by(4) {
            let quad: [[f32; 4]; 4] = core::array::from_fn(|i| core::array::from_fn(|j| lines[i][row + j]));
            for j in 0..4 {
                let column = [quad[0][j], quad[1][j], quad[2][j], quad[3][j]];
                out[(row + j) * out_stride + line..][..4].copy_from_slice(&column);
            }
        }
    }
}

struct Source<'a> {
    re: &'a [f32],
    im: &'a [f32],
    weight: &'a [f32],
}

fn source<'a>(job: &Job, tape: &'a BakedTape, elevation: &'a ElevationTable) -> Source<'a> {
    let (first, count) = (job.tape as usize, job.count as usize);
    Source {
        re: &tape.re[first..][..count],
        im: &tape.im[first..][..count],
        weight: elevation.weights(job.block, job.weight as usize, count),
    }
}

fn parts(line: &mut [f32], lo: usize, count: usize) -> (&mut [f32], &mut [f32]) {
    let half = line.len() / 2;
    let (re, im) = line.split_at_mut(half);
    (&mut re[lo..][..count], &mut im[lo..][..count])
}

fn add_to_two(
    left: &mut [f32],
    right: &mut [f32],
    job: &Job,
    lo: usize,
    tape: &BakedTape,
    elevation: &ElevationTable,
) {
    let s = source(job, tape, elevation);
    let (left_re, left_im) = parts(left, lo, s.re.len());
    let (right_re, right_im) = parts(right, lo, s.re.len());
    let share = [1.0 - job.fraction, job.fraction];
    multiply_add_two(s.re, s.im, s.weight, [job.re, job.im], share, left_re, left_im, right_re, right_im);
}

/// Not inlined: as arguments the slices are known to be apart, and the loop vectorises without checks.
#[inline(never)]
#[expect(clippy::too_many_arguments, reason = "seven streams and their factors")]
fn multiply_add_two(
    re: &[f32],
    im: &[f32],
    weight: &[f32],
    [c_re, c_im]: [f32; 2],
    [a, b]: [f32; 2],
    left_re: &mut [f32],
    left_im: &mut [f32],
    right_re: &mut [f32],
    right_im: &mut [f32],
) {
    let count = re.len();
    let (im, weight) = (&im[..count], &weight[..count]);
    let (left_re, left_im) = (&mut left_re[..count], &mut left_im[..count]);
    let (right_re, right_im) = (&mut right_re[..count], &mut right_im[..count]);
    for i in 0..count {
        let sum_re = weight[i] * (c_re * re[i] - c_im * im[i]);
        let sum_im = weight[i] * (c_re * im[i] + c_im * re[i]);
        left_re[i] += a * sum_re;
        left_im[i] += a * sum_im;
        right_re[i] += b * sum_re;
        right_im[i] += b * sum_im;
    }
}

fn add_to_one(
    line: &mut [f32],
    job: &Job,
    lo: usize,
    share: f32,
    tape: &BakedTape,
    elevation: &ElevationTable,
) {
    let s = source(job, tape, elevation);
    let (line_re, line_im) = parts(line, lo, s.re.len());
    // The same products in the same order as for two lines, so that bands do not show in the sums.
    for i in 0..s.re.len() {
        let re = s.weight[i] * (job.re * s.re[i] - job.im * s.im[i]);
        let im = s.weight[i] * (job.re * s.im[i] + job.im * s.re[i]);
        line_re[i] += share * re;
        line_im[i] += share * im;
    }
}
