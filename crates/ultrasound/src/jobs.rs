//! Which stretches of tape go into which lines of the grid.

use crate::{
    awake,
    columns::{Columns, Range},
    elevation::{ElevationTable, STRIDE, Weights},
    fast::nearest,
    instructions::{Instructions, wide},
    lattice::{Lattice, TAPE_LENGTH},
    shear::{Affine, Shear},
    splat::{BAND, Sources},
    tape::{BakedTape, product},
};

/// Parts of the lattice's rows that are listed at a time; fixed, though results do not depend on it.
const PARTS: usize = 8;

/// A run of one column of the lattice through the slice.
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
    /// Weights of the slice from row `lo` on.
    pub weights: Weights,
    /// What lies along those rows; `None` where it is one material.
    pub layers: Option<Range>,
    /// Phase of the column, times the amplitude of the one material.
    pub re: f32,
    pub im: f32,
}

/// Jobs of one picture.
#[derive(Default)]
pub struct Jobs {
    parts: Vec<Part>,
    phase_x: Vec<[f64; 2]>,
    phase_y: Vec<[f64; 2]>,
    wraps: Vec<[f64; 2]>,
}

impl Jobs {
    /// Lists what the columns add to the grid.
    pub fn build(&mut self, shear: &Shear, lattice: &Lattice, sources: Sources, phase_per_row_rad: f64) {
        let Sources { instructions, tape, elevation, columns } = sources;
        let [[ix_min, ix_max], [iy_min, iy_max]] = shear.columns;
        let turn = |rows: f64| {
            let (sin, cos) = libm::sincos(-phase_per_row_rad * rows);
            [cos, sin]
        };
        self.phase_x.clear();
        self.phase_x.extend((ix_min..=ix_max).map(|ix| turn(shear.top_row.per_ix * f64::from(ix))));
        self.phase_y.clear();
        self.phase_y.extend((iy_min..=iy_max).map(|iy| turn(shear.top_row.in_row(iy))));
        self.wraps.clear();
        let samples = 2 * TAPE_LENGTH + tape.stride + columns.most_scatterers();
        self.wraps
            .extend((0..=samples / TAPE_LENGTH).map(|wrap| turn((wrap as f64 - 1.0) * TAPE_LENGTH as f64)));

        self.parts.resize_with(PARTS, Part::default);
        let (phase_x, phase_y, wraps) = (&self.phase_x, &self.phase_y, &self.wraps);
        let list = Listing { shear, lattice, elevation, columns, tape, phase_x, phase_y, wraps };
        let (rows, bands) = ((iy_max - iy_min + 1).max(0) as usize, shear.lines.div_ceil(BAND));
        awake::for_each(self.parts.iter_mut().enumerate(), |(index, part)| {
            part.by_band.iter_mut().for_each(Vec::clear);
            part.by_band.resize_with(bands, Vec::new);
            for row in index * rows / PARTS..(index + 1) * rows / PARTS {
                list.row(instructions, iy_min + row as i32, part);
            }
        });
    }

    /// The jobs of a band of lines by line, those of one line in the lattice's order. `sorted` is replaced.
    pub fn of_band(&self, band: usize, sorted: &mut Vec<Job>) {
        // Line 0 is the last one of the band before, whose columns reach into this one.
        let line = |job: &Job| (job.line as usize + 1) - band * BAND;
        let mut next = [0; BAND + 2];
        let jobs = || self.parts.iter().flat_map(|part| &part.by_band[band]);
        jobs().for_each(|job| next[line(job) + 1] += 1);
        (1..next.len()).for_each(|line| next[line] += next[line - 1]);
        sorted.clear();
        sorted.extend(jobs());
        for job in jobs() {
            let place = &mut next[line(job)];
            sorted[*place] = *job;
            *place += 1;
        }
    }
}

/// Jobs of a part of the lattice.
#[derive(Default)]
struct Part {
    /// By band of lines, in the lattice's order.
    by_band: Vec<Vec<Job>>,
    places: Places,
}

/// Where the columns of a row of the lattice are, side by side.
#[derive(Default)]
struct Places {
    /// Bin of the elevation table.
    bin: Vec<i64>,
    /// Lines, in fractions.
    line: Vec<f64>,
    /// Rows `lo..hi` within the picture's width, whole strides.
    lo: Vec<i64>,
    hi: Vec<i64>,
    /// Depth of scatterer 0 in sub-delays.
    top: Vec<i64>,
}

wide! {
    /// Places `count` columns of a row from `first` on.
    fn place(places: &mut Places, list: &Listing, first: i32, count: usize, iy: i32) {
        let Listing { shear, elevation, tape, .. } = *list;
        let Places { bin, line, lo, hi, top } = places;
        for list in [&mut *bin, lo, hi, top] {
            list.resize(count, 0);
        }
        line.resize(count, 0.0);
        let row = |value: &Affine| (value.in_row(iy), value.per_ix);
        let at = |(in_row, per_ix): (f64, f64), i: usize| in_row + per_ix * f64::from(first + i as i32);
        let (e, x, depth) = (row(&shear.e), row(&shear.x), row(&shear.top_row));
        let (first_line_m, lines_per_m) = (shear.first_line_m, 1.0 / shear.line_pitch_m);
        let per_row = tape.sub_delays as f64;
        for (i, bin) in bin.iter_mut().enumerate() {
            *bin = elevation.bin(at(e, i));
        }
        for (i, line) in line.iter_mut().enumerate() {
            *line = (at(x, i) - first_line_m) * lines_per_m;
        }
        for (i, top) in top.iter_mut().enumerate() {
            *top = nearest(at(depth, i) * per_row);
        }
        for (i, (lo, hi)) in lo.iter_mut().zip(hi).enumerate() {
            [*lo, *hi] = shear.strides_within(at(x, i), shear.lateral_slope, shear.reach_m);
        }
    }
}

/// What jobs are made from.
struct Listing<'a> {
    shear: &'a Shear,
    lattice: &'a Lattice,
    elevation: &'a ElevationTable,
    columns: &'a Columns,
    tape: &'a BakedTape,
    /// Phases along x, along y, and of whole lengths of the tape.
    phase_x: &'a [[f64; 2]],
    phase_y: &'a [[f64; 2]],
    wraps: &'a [[f64; 2]],
}

impl Listing<'_> {
    /// Appends the jobs of one row of the lattice.
    fn row(&self, instructions: Instructions, iy: i32, part: &mut Part) {
        let Self { shear, lattice, elevation, columns, tape, .. } = *self;
        let [[ix_min, _], [iy_min, _]] = shear.columns;
        let deepest = columns.most_scatterers() as i64;
        let Part { by_band, places } = part;
        let along = shear.overlap(elevation.slab(shear.thinning.of_row(iy)), iy);
        place(instructions, places, self, along.start, along.len(), iy);
        let Places { bin, line, lo, hi, top } = &*places;
        let rows = lo.iter().zip(hi);
        let places = bin.iter().zip(line).zip(rows).zip(top);
        for (ix, (((&bin, &line), (&x_lo, &x_hi)), &top)) in along.zip(places) {
            let class = shear.thinning.class(ix, iy);
            let Some((mut weights, runs)) = elevation.crossing(class, bin) else { continue };
            if x_lo >= x_hi || !(line >= 0.0 && line < (shear.lines - 1) as f64) {
                continue;
            }
            let column = columns.get(ix, iy);
            if columns.layers(column).is_empty() {
                continue;
            }
            let (row_of_0, sub_delay) = tape.split(top as i32);
            let (row_of_0, sub_delay) = (i64::from(row_of_0), sub_delay as usize);
            let offset = lattice.tape_offset(ix, iy);
            let phase = product(
                product(self.phase_x[(ix - ix_min) as usize], self.phase_y[(iy - iy_min) as usize]),
                tape.carrier(offset),
            );
            // Scatterer n lies in row n + row_of_0; what is before n = 0 has no material.
            let x_lo = x_lo.max(row_of_0 / STRIDE as i64 * STRIDE as i64);
            for run in runs {
                let (lo, hi) = (x_lo.max(i64::from(run.lo)), x_hi.min(i64::from(run.hi)));
                if lo >= hi || lo - row_of_0 > deepest {
                    continue;
                }
                let [from, to] = [lo, hi].map(|row| (row - row_of_0) as i32);
                let (layers, amplitude) = match columns.between(column, from, to) {
                    (_, &[layer]) => (None, columns.filling(layer).amplitude),
                    (range, _) => (Some(range), 1.0),
                };
                if amplitude == 0.0 {
                    continue;
                }
                let sample = (lo - row_of_0 + (offset + TAPE_LENGTH) as i64) as usize;
                let [re, im] = product(phase, self.wraps[sample / TAPE_LENGTH]);
                weights.first = run.first + lo as u32 - run.lo;
                let job = Job {
                    line: line as u32,
                    fraction: (line - f64::from(line as u32)) as f32,
                    lo: lo as u32,
                    hi: hi as u32,
                    tape: (sub_delay * tape.stride + sample % TAPE_LENGTH) as u32,
                    row_of_0: row_of_0 as i32,
                    weights,
                    layers,
                    re: re as f32 * amplitude,
                    im: im as f32 * amplitude,
                };
                let band = job.line as usize / BAND;
                by_band[band].push(job);
                if job.line as usize % BAND == BAND - 1 && band + 1 < by_band.len() {
                    by_band[band + 1].push(job);
                }
            }
        }
    }
}
