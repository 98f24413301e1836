//! Which stretches of tape go into which lines of the grid.

use crate::{
    columns::{Columns, Range},
    elevation::{Crossing, ElevationTable, STRIDE},
    fast::floor,
    lattice::{Lattice, TAPE_LENGTH},
    shear::Shear,
    tape::BakedTape,
};

/// One column of the lattice that may cross the slice.
#[derive(Debug, Clone, Copy)]
pub struct Job {
    /// Lines `line` and `line + 1` get the shares `1 − fraction` and `fraction`.
    pub line: u32,
    pub fraction: f32,
    /// Rows `lo..hi` lie inside the picture's width and thickness; multiples of [`STRIDE`].
    pub lo: u32,
    pub hi: u32,
    /// Index into the baked tape at row `lo`.
    pub tape: u32,
    /// Row of the column's scatterer 0.
    pub row_of_0: i32,
    /// Where the column crosses the slice.
    pub crossing: Crossing,
    /// What lies along those rows; `None` where it is one material.
    pub stretches: Option<Range>,
    /// Phase of the column, times the amplitude of the one material.
    pub re: f32,
    pub im: f32,
}

/// Jobs of one picture, sorted by line; columns of equal line keep the order of the lattice.
#[derive(Default)]
pub struct Jobs {
    unsorted: Vec<Job>,
    pub sorted: Vec<Job>,
    /// Jobs of line l are `sorted[starts[l]..starts[l + 1]]`.
    pub starts: Vec<u32>,
    phase_x: Vec<[f64; 2]>,
    phase_y: Vec<[f64; 2]>,
    wraps: Vec<[f64; 2]>,
}

fn product([a, b]: [f64; 2], [c, d]: [f64; 2]) -> [f64; 2] {
    [a * c - b * d, a * d + b * c]
}

impl Jobs {
    pub fn build(
        &mut self,
        shear: &Shear,
        lattice: &Lattice,
        elevation: &ElevationTable,
        columns: &mut Columns,
        tape: &BakedTape,
        phase_per_row_rad: f64,
    ) {
        let [[ix_min, ix_max], [iy_min, iy_max]] = shear.columns;
        let elevations_m = elevation.range_m();
        let sub_delays = tape.sub_delays as i64;
        let turn = |rows: f64| {
            let (sin, cos) = libm::sincos(-phase_per_row_rad * rows);
            [cos, sin]
        };
        self.phase_x.clear();
        self.phase_x.extend((ix_min..=ix_max).map(|ix| turn(shear.top_row.per_ix * f64::from(ix))));
        self.phase_y.clear();
        self.phase_y.extend((iy_min..=iy_max).map(|iy| turn(shear.top_row.in_row(iy))));
        self.wraps.clear();

        self.unsorted.clear();
        for iy in iy_min..=iy_max {
            for ix in shear.overlap(elevations_m, iy) {
                let Some((crossing, [e_lo, e_hi])) = elevation.crossing(shear.e.at(ix, iy)) else { continue };
                let x_m = shear.x.at(ix, iy);
                let (x_lo, x_hi) = shear.rows_within(x_m, shear.lateral_slope, shear.reach_m);
                if x_lo == x_hi {
                    continue;
                }
                let (x_lo, x_hi) = (x_lo / STRIDE * STRIDE, x_hi.next_multiple_of(STRIDE));
                let (lo, hi) = (x_lo.max(e_lo) as i64, x_hi.min(e_hi) as i64);
                let line = (x_m - shear.first_line_m) / shear.line_pitch_m;
                if !(line >= 0.0 && line < (shear.lines - 1) as f64) {
                    continue;
                }
                let delays = floor(shear.top_row.at(ix, iy) * sub_delays as f64 + 0.5) + sub_delays / 2;
                // Exact, and a tenth of the time of two divisions of whole numbers.
                let row_of_0 = floor(delays as f64 / sub_delays as f64);
                let sub_delay = (delays - row_of_0 * sub_delays) as usize;
                let offset = lattice.tape_offset(ix, iy);
                let phase = product(
                    product(self.phase_x[(ix - ix_min) as usize], self.phase_y[(iy - iy_min) as usize]),
                    tape.carrier(offset),
                );
                // Scatterer n lies in row n + row_of_0; what is before n = 0 has no material.
                let lo = lo.max(row_of_0 / STRIDE as i64 * STRIDE as i64);
                if lo >= hi {
                    continue;
                }
                let column = columns.get(ix, iy);
                let [from, to] = [lo, hi].map(|row| (row - row_of_0) as i32);
                let (stretches, amplitude) = match columns.between(column, from, to) {
                    (_, []) => continue,
                    (_, [one]) if one.start <= from && to <= one.end => (None, one.amplitude),
                    (range, _) => (Some(range), 1.0),
                };
                if amplitude == 0.0 {
                    continue;
                }
                let sample = (lo - row_of_0 + (offset + TAPE_LENGTH) as i64) as usize;
                let wrap = sample / TAPE_LENGTH;
                while self.wraps.len() <= wrap {
                    self.wraps.push(turn((self.wraps.len() as f64 - 1.0) * TAPE_LENGTH as f64));
                }
                let [re, im] = product(phase, self.wraps[wrap]);
                self.unsorted.push(Job {
                    line: line as u32,
                    fraction: (line - f64::from(line as u32)) as f32,
                    lo: lo as u32,
                    hi: hi as u32,
                    tape: (sub_delay * tape.stride + sample % TAPE_LENGTH) as u32,
                    row_of_0: row_of_0 as i32,
                    crossing,
                    stretches,
                    re: re as f32 * amplitude,
                    im: im as f32 * amplitude,
                });
            }
        }
        self.sort(shear.lines);
    }

    /// Counting sort by line, stable.
    fn sort(&mut self, lines: usize) {
        self.starts.clear();
        self.starts.resize(lines + 1, 0);
        for job in &self.unsorted {
            self.starts[job.line as usize + 1] += 1;
        }
        for line in 0..lines {
            self.starts[line + 1] += self.starts[line];
        }
        self.sorted.clear();
        self.sorted.extend_from_slice(&self.unsorted);
        let mut next = self.starts.clone();
        for job in &self.unsorted {
            let place = &mut next[job.line as usize];
            self.sorted[*place as usize] = *job;
            *place += 1;
        }
    }
}
