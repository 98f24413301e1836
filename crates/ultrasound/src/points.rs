//! Moved tissue: scatterer by scatterer, each where it has gone.
//!
//! Columns are straight no more, so no table serves them all; what is kept are the grid, the delay filters that spread a
//! scatterer over rows, and the beam filters after that. Eight scatterers of a column go together: from the first to the
//! next group's first (0.6 mm) their motion is taken as even.

use rayon::prelude::*;
use sonoloop_types::Pose;

use crate::{
    beam::Beam,
    columns::{Columns, Range},
    elevation::{ElevationTable, RowProfile},
    fast::{exp_minus, floor, nearest_f32, turn},
    instructions::{Instructions, wide},
    lattice::Lattice,
    motion::Motion,
    shear::{Shear, Slab},
    splat::{BAND, Grid},
    tape::{BakedTape, DELAY_REACH, DELAY_TAPS},
};

/// Scatterers that go together.
const GROUP: usize = 8;
/// Rows that are added at a time, and the most that two of the scatterers may lie apart then; where tissue is strained to
/// more than its length a group takes two turns.
const WINDOW: usize = 16;
const SPREAD: i32 = (WINDOW - DELAY_TAPS) as i32;
/// The most rows that a group may reach over.
const MOST_APART: usize = 24;
/// Rows before the grid's first and after its last that a group may touch.
const MARGIN: usize = 2 * MOST_APART;

/// A column of the lattice, and how far its tissue has moved.
struct Column {
    /// x′ and e′ at rest.
    x_m: f64,
    e_m: f64,
    /// Depth of scatterer 0 at rest, in rows.
    top_row: f64,
    /// What [`Motion::by_depth`] scales to the way down and to the way aside.
    down_m: f64,
    aside_m: f64,
    tape: usize,
    layers: Range,
}

/// What all scatterers of a picture share.
struct Flow {
    /// [`Motion::by_depth`] of each scatterer of a column, and of a group more.
    by_depth: Vec<[f64; 2]>,
    /// Rows per metre down and aside; metres along lines and in elevation per metre aside.
    rows_per_m: [f64; 2],
    lines_per_aside: f64,
    lines_per_m: f64,
    elevation_per_aside: f64,
}

/// Scatterers of moved tissue.
#[derive(Default)]
pub struct Points {
    columns: Vec<Column>,
    /// By band of lines: the columns that reach it, in the lattice's order.
    by_band: Vec<Vec<u32>>,
    /// Delay filters with zeros around them, so that a window of rows at any distance can be read.
    taps: Vec<[f32; 2 * WINDOW]>,
}

/// Where columns stand at rest that meet the slice.
pub fn slab(elevation: &ElevationTable, motion: Option<&Motion>) -> Slab {
    // What goes down stays on its column's line; e′ changes by what goes aside, see `Motion::aside_m`.
    let margin_m = motion.map_or(0.0, |motion| 2.0 * motion.aside_m());
    let Slab { elevations_m: [low_m, high_m], reach_m } = elevation.slab();
    Slab { elevations_m: [low_m - margin_m, high_m + margin_m], reach_m: reach_m + margin_m }
}

/// What a scatterer's echo is made of.
#[derive(Clone, Copy)]
pub struct Model<'a> {
    pub instructions: Instructions,
    pub beam: &'a Beam,
    pub tape: &'a BakedTape,
    pub elevation: &'a ElevationTable,
    pub shear: &'a Shear,
    pub steps: Steps,
}

impl Points {
    /// Clears the grid and adds every scatterer that shows.
    pub fn fill(
        &mut self,
        model: Model,
        lattice: &Lattice,
        tissue: &Columns,
        phantom_from_probe: &Pose,
        motion: &Motion,
        grid: &mut Grid,
    ) {
        let shear = model.shear;
        let flow = Flow::new(shear, lattice, tissue, phantom_from_probe, motion);
        self.list(&flow, shear, model.elevation, lattice, tissue, motion);
        self.taps.clear();
        self.taps.extend(model.tape.delay_filters.iter().map(|filter| {
            let mut taps = [0.0; 2 * WINDOW];
            taps[WINDOW..WINDOW + DELAY_TAPS].copy_from_slice(filter);
            taps
        }));
        let (this, flow) = (&*self, &flow);
        grid.bands(shear.lines).par_iter_mut().enumerate().for_each(|(index, band)| {
            let first = index * BAND;
            band.fill_whole(model.instructions, shear.rows, MARGIN, |by_line, stride| {
                let lines = first..(first + BAND).min(shear.lines);
                for &column in &this.by_band[index] {
                    let column = &this.columns[column as usize];
                    add_column(
                        model.instructions,
                        &this.taps,
                        &model,
                        flow,
                        tissue,
                        column,
                        &lines,
                        by_line,
                        stride,
                    );
                }
            });
        });
    }

    /// Finds the columns that may show, and the bands that each reaches.
    fn list(
        &mut self,
        flow: &Flow,
        shear: &Shear,
        elevation: &ElevationTable,
        lattice: &Lattice,
        tissue: &Columns,
        motion: &Motion,
    ) {
        self.columns.clear();
        self.by_band.iter_mut().for_each(Vec::clear);
        self.by_band.resize_with(shear.lines.div_ceil(BAND), Vec::new);
        let steepest = flow.by_depth.iter().fold(0.0, |most: f64, by_depth| most.max(by_depth[1]));
        for [ix, iy] in shear.columns_across(slab(elevation, Some(motion))) {
            let layers = tissue.get(ix, iy);
            if tissue.layers(layers).is_empty() {
                continue;
            }
            let [x_m, y_m] = lattice.column_m(ix, iy);
            let [down_m, aside_m] = motion.by_place(x_m, y_m);
            let x_m = shear.x.at(ix, iy);
            let line = |aside_m: f64| {
                let x_m = x_m + aside_m * flow.lines_per_aside;
                floor((x_m - shear.first_line_m) / shear.line_pitch_m)
            };
            let (a, b) = (line(0.0), line(aside_m * steepest));
            let (first, last) = (a.min(b).max(0), (a.max(b) + 1).min(shear.lines as i64 - 1));
            if first > last {
                continue;
            }
            for band in &mut self.by_band[first as usize / BAND..=last as usize / BAND] {
                band.push(self.columns.len() as u32);
            }
            self.columns.push(Column {
                x_m,
                e_m: shear.e.at(ix, iy),
                top_row: shear.top_row.at(ix, iy),
                down_m,
                aside_m,
                tape: lattice.tape_offset(ix, iy),
                layers,
            });
        }
    }
}

wide! {
    /// Adds what a column's scatterers leave on some lines.
    #[expect(clippy::too_many_arguments, reason = "the scene, the column and where it goes")]
    fn add_column(
        taps: &[[f32; 2 * WINDOW]],
        model: &Model,
        flow: &Flow,
        tissue: &Columns,
        column: &Column,
        lines: &core::ops::Range<usize>,
        by_line: &mut [f32],
        stride: usize,
    ) {
        let Model { tape, shear, steps, .. } = model;
        let rows = shear.rows as f64;
        let end = flow.by_depth.len() as i32 - GROUP as i32;
        let mut next = 0;
        for &layer in tissue.layers(column.layers) {
            let (layer_first, layer_end) = (next, layer.end.min(end));
            next = layer_end;
            let amplitude = tissue.filling(layer).amplitude;
            if amplitude == 0.0 {
                continue;
            }
            // Where a group's first scatterer is, and that after its last.
            let mut above = flow.place(model, column, layer_first);
            for first in (layer_first..layer_end).step_by(GROUP) {
                let below = flow.place(model, column, first + GROUP as i32);
                let ends = [core::mem::replace(&mut above, below), below];
                let count = (layer_end - first).min(GROUP as i32) as usize;
                if ends[1].row < -(DELAY_REACH as f64) {
                    continue;
                }
                if ends[0].row > rows + DELAY_REACH as f64 - 1.0 {
                    return;
                }
                // A face wider than any probe's tears the tissue apart under a tilt; margins hold a window.
                if (ends[1].row - ends[0].row).abs() > MOST_APART as f64 {
                    continue;
                }
                let profiles = ends.map(|end| end.profile);
                let reach_m = if profiles[0].reach_m > profiles[1].reach_m { profiles[0].reach_m } else { profiles[1].reach_m };
                let beside = |a: f64, b: f64, reach: f64| (a > reach && b > reach) || (a < -reach && b < -reach);
                if beside(ends[0].e_m, ends[1].e_m, f64::from(reach_m))
                    || beside(ends[0].x_m, ends[1].x_m, shear.reach_m)
                {
                    continue;
                }
                let place = 0.5 * (ends[0].line + ends[1].line);
                let line = floor(place);
                if line + 1 < lines.start as i64 || line >= lines.end as i64 {
                    continue;
                }

                let mut group = Group::new(column.tape + first as usize, tape);
                let rows_apart = (ends[1].row - ends[0].row) as f32 * PER_STEP;
                let e_apart_m = (ends[1].e_m - ends[0].e_m) as f32 * PER_STEP;
                let turns = ends[0].row * model.turns_per_row();
                let turns_apart = rows_apart * model.turns_per_row() as f32;
                let weights = weights(steps, &profiles, reach_m, [ends[0].e_m as f32, e_apart_m]);
                group.weigh(steps, &weights, amplitude, count);
                group.turn(steps, (turns - floor(turns) as f64) as f32, turns_apart);
                let whole_row = floor(ends[0].row);
                let past = (ends[0].row - whole_row as f64) as f32;
                group.place(steps, past, rows_apart, tape.sub_delays);
                let fraction = (place - line as f64) as f32;
                let first_row = whole_row + (MARGIN - DELAY_REACH) as i64;
                let mut done = 0;
                while done < count {
                    let base = group.row[done];
                    let fits = |row: &&i32| (base..=base + SPREAD).contains(*row);
                    let together = group.row[done..count].iter().take_while(fits).count();
                    let part = group.spread(taps, done..done + together, base);
                    let first_row = (first_row + i64::from(base)) as usize;
                    for (line, share) in [(line, 1.0 - fraction), (line + 1, fraction)] {
                        if line < lines.start as i64 || line >= lines.end as i64 {
                            continue;
                        }
                        let line = &mut by_line[(line as usize - lines.start) * 2 * stride..][..2 * stride];
                        let (line_re, line_im) = line.split_at_mut(stride);
                        for (out, part) in [(line_re, &part[0]), (line_im, &part[1])] {
                            for (out, part) in out[first_row..][..WINDOW].iter_mut().zip(part) {
                                *out += share * part;
                            }
                        }
                    }
                    done += together;
                }
            }
        }
    }
}

/// Echoes of some scatterers, and where they go.
#[derive(Default)]
struct Group {
    re: [f32; GROUP],
    im: [f32; GROUP],
    row: [i32; GROUP],
    sub_delay: [i32; GROUP],
}

pub type Steps = [f32; GROUP];

/// 0, 1, 2, …: not known to the compiler, which would do some of them apart, and then all one by one.
pub fn steps() -> Steps {
    core::hint::black_box([0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0])
}

/// Share of the way through a group from one scatterer to the next.
const PER_STEP: f32 = 1.0 / GROUP as f32;

/// Weights of the slice for a group whose first scatterer, and the one after its last, meet these profiles.
#[inline(always)]
fn weights(
    steps: &Steps,
    [above, below]: &[RowProfile; 2],
    reach_m: f32,
    [e_m, e_apart_m]: [f32; 2],
) -> [f32; GROUP] {
    let (decays, peaks) = (below.decay - above.decay, below.peak - above.peak);
    let mut weights = [0.0; GROUP];
    for (weight, step) in weights.iter_mut().zip(steps) {
        let (share, e_m) = (step * PER_STEP, e_m + step * e_apart_m);
        let square = e_m * e_m;
        let inside = (above.peak + share * peaks) * exp_minus(square * (above.decay + share * decays));
        *weight = if square <= reach_m * reach_m { inside } else { 0.0 };
    }
    weights
}

#[expect(
    clippy::needless_range_loop,
    reason = "loops over several arrays side by side, without branches, vectorise"
)]
impl Group {
    #[inline(always)]
    fn new(sample: usize, tape: &BakedTape) -> Self {
        let [re, im] = tape.raw_parts(sample);
        Self { re, im, ..Self::default() }
    }

    #[inline(always)]
    fn weigh(&mut self, steps: &Steps, weights: &[f32; GROUP], amplitude: f32, count: usize) {
        let count = count as f32;
        for i in 0..GROUP {
            let weight = if steps[i] < count { amplitude * weights[i] } else { 0.0 };
            self.re[i] *= weight;
            self.im[i] *= weight;
        }
    }

    /// The phase of depth, −2π·turns.
    #[inline(always)]
    fn turn(&mut self, steps: &Steps, turns: f32, turns_apart: f32) {
        for i in 0..GROUP {
            let [cos, sin] = turn(turns + steps[i] * turns_apart);
            let (re, im) = (self.re[i], self.im[i]);
            self.re[i] = re * cos + im * sin;
            self.im[i] = im * cos - re * sin;
        }
    }

    /// Rounds depths to delays of the tape's; sub-delay s stands for the fraction s/S − ½.
    #[inline(always)]
    fn place(&mut self, steps: &Steps, past: f32, rows_apart: f32, sub_delays: usize) {
        let count = sub_delays as f32;
        let per_row = 1.0 / count;
        for i in 0..GROUP {
            let delays = (past + steps[i] * rows_apart) * count + count / 2.0;
            let delays = nearest_f32(if delays > 0.0 { delays } else { 0.0 });
            // The whole part: exact, as the fraction is never half a row from the middle of one.
            let row = nearest_f32((delays as f32 - (count - 1.0) / 2.0) * per_row);
            self.row[i] = row;
            self.sub_delay[i] = delays - row * sub_delays as i32;
        }
    }

    /// Real and imaginary parts of the rows from `base` on.
    #[inline(always)]
    fn spread(
        &self,
        taps: &[[f32; 2 * WINDOW]],
        part: core::ops::Range<usize>,
        base: i32,
    ) -> [[f32; WINDOW]; 2] {
        let mut sum = [[0.0; WINDOW]; 2];
        for i in part {
            let taps = &taps[self.sub_delay[i] as usize][WINDOW - (self.row[i] - base) as usize..][..WINDOW];
            let [re, im] = &mut sum;
            for ((re, im), tap) in re.iter_mut().zip(im).zip(taps) {
                *re += self.re[i] * tap;
                *im += self.im[i] * tap;
            }
        }
        sum
    }
}

impl Model<'_> {
    /// Turns of the phase from one row to the next.
    #[inline(always)]
    fn turns_per_row(&self) -> f64 {
        self.beam.two_k_rad_m * self.shear.row_step_m / core::f64::consts::TAU
    }
}

/// Where a scatterer is.
#[derive(Clone, Copy)]
struct Place {
    /// Depth in rows.
    row: f64,
    x_m: f64,
    e_m: f64,
    /// Place among the grid's lines.
    line: f64,
    profile: RowProfile,
}

impl Flow {
    fn new(
        shear: &Shear,
        lattice: &Lattice,
        tissue: &Columns,
        phantom_from_probe: &Pose,
        motion: &Motion,
    ) -> Self {
        let probe_from_phantom = phantom_from_probe.inverse();
        let down = probe_from_phantom * -sonoloop_types::Vector::z();
        let aside = probe_from_phantom * motion.sideways();
        let count = (tissue.thickness_m() / lattice.depth_step_m).ceil() as usize + 1;
        let depth_m = |n: usize| (n as f64 + 0.5) * lattice.depth_step_m;
        let rows_per_m = [down.z / shear.row_step_m, aside.z / shear.row_step_m];
        Self {
            by_depth: (0..count + GROUP).map(|n| motion.by_depth(depth_m(n))).collect(),
            rows_per_m,
            lines_per_m: 1.0 / shear.line_pitch_m,
            lines_per_aside: aside.x - shear.lateral_slope * aside.z,
            elevation_per_aside: aside.y - shear.elevation_slope * aside.z,
        }
    }

    #[inline(always)]
    fn place(&self, model: &Model, column: &Column, n: i32) -> Place {
        let Model { shear, elevation, .. } = model;
        let [f, slope] = self.by_depth[n as usize];
        let (down_m, aside_m) = (column.down_m * f, column.aside_m * slope);
        let row = column.top_row + f64::from(n) + down_m * self.rows_per_m[0] + aside_m * self.rows_per_m[1];
        let z_m = row * shear.row_step_m;
        let sheared_m = column.x_m + aside_m * self.lines_per_aside;
        Place {
            row,
            x_m: sheared_m + shear.lateral_slope * z_m,
            e_m: column.e_m + shear.elevation_slope * z_m + aside_m * self.elevation_per_aside,
            line: (sheared_m - shear.first_line_m) * self.lines_per_m,
            profile: elevation.profile(row),
        }
    }
}
