//! Moved tissue: every scatterer where it has gone.
//!
//! Columns are straight no more, but along one band of lines all of them are moved nearly alike. On rows that follow the
//! tissue (`warp`) they are nearly straight again, and are added run by run (`runs`).

use core::ops::Range;

use rayon::prelude::*;
use sonoloop_types::{Pose, Vector};

use crate::{
    beam::Beam,
    columns::{self, Columns},
    elevation::ElevationTable,
    fast::{exp_minus, floor},
    instructions::{Instructions, wide},
    lattice::Lattice,
    motion::Motion,
    runs::{KNOT, Knots, LONGEST, Place, ROWS, Run, add_column},
    shear::{Shear, Slab},
    splat::{BAND, Grid, transpose},
    tape::{BakedTape, DELAY_REACH},
    warp::{Press, Warp, straighten},
};

/// Bands per task; fixed, though results do not depend on it.
const TASK_BANDS: usize = 2;
/// Parts of the lattice's rows that are listed at a time; fixed, though results do not depend on it.
const PARTS: usize = 8;

/// A column of the lattice, and how far its tissue has moved.
pub struct Column {
    /// x′ and e′ at rest.
    x_m: f32,
    e_m: f32,
    /// Depth of scatterer 0 at rest, in rows.
    top_row: f32,
    /// What [`Flow::sunk`] scales to rows, and what [`Flow::spread`] scales to rows, to a way along lines and in elevation.
    rows_down: f32,
    rows_aside: f32,
    along_aside_m: f32,
    elevation_aside_m: f32,
    /// Place among the grid's lines at rest, and what [`Flow::spread`] scales to lines.
    line: f32,
    lines_aside: f32,
    /// Squared distance from the axis through the place that the needle drags, along the columns.
    from_drag_m2: f32,
    pub tape: usize,
    pub layers: columns::Range,
}

/// What the needle drags, seen along the columns.
struct Dragged {
    /// Depth of the place that it drags, and of scatterer 0, phantom frame; depth per row of [`Flow::numbers`].
    depth_m: f32,
    first_m: f32,
    m_per_row: f32,
    per_decay_m: f32,
    /// How far it drags that place: in rows, and along lines and in elevation beside what rows bring with them.
    rows: f32,
    along_m: f32,
    elevation_m: f32,
    lines: f32,
}

/// What all scatterers of a picture share.
pub struct Flow {
    /// 0, 1, 2, …, and how many of them go together.
    pub steps: Vec<f32>,
    pub stride: usize,
    /// Of all scatterers of a column: how far they lie below the first one at rest, in rows, and [`Motion::by_depth`].
    pub numbers: Vec<f32>,
    sunk: Vec<f32>,
    spread: Vec<f32>,
    /// The same of every [`KNOT`]th.
    knot_numbers: Vec<f32>,
    knot_sunk: Vec<f32>,
    knot_spread: Vec<f32>,
    /// Rows per metre down and aside; metres along lines and in elevation per metre aside.
    rows_per_m: [f64; 2],
    along_per_aside: f64,
    elevation_per_aside: f64,
    dragged: Option<Dragged>,
    /// Rows of the grid that scatterers reach into it from.
    pub rows: [f32; 2],
    /// Of the carrier, from one scatterer at rest to the next.
    pub turns_per_row: f64,
    along_per_row: f32,
    elevation_per_row: f32,
    /// Half the width that shows.
    pub reach_m: f32,
    /// The most that the slice reaches among [`KNOT`] rows from every [`KNOT`]th row of the grid on; among twice as many, and
    /// so on up to the longest run's.
    widest_m: Vec<Vec<f32>>,
}

/// Scatterers of moved tissue.
#[derive(Default)]
pub struct Points {
    parts: Vec<Part>,
    warps: Vec<Warp>,
    scratch: Vec<Scratch>,
}

/// Columns of a part of the lattice that may show.
#[derive(Default)]
struct Part {
    columns: Vec<Column>,
    /// By band of lines: the columns that reach it, in the lattice's order.
    by_band: Vec<Vec<u32>>,
}

/// A band under way.
#[derive(Default)]
struct Scratch {
    /// Per line the real parts by row, then the imaginary ones.
    by_line: Vec<f32>,
    /// The same by row and line.
    by_row: Vec<f32>,
    knots: Knots,
    runs: Vec<Run>,
    single: Knots,
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
}

impl Points {
    /// Lays the rows of all bands of lines. Returns the first and the last class of the strain there.
    pub fn lay(&mut self, press: &Press, shear: &Shear, elevation: &ElevationTable) -> [i32; 2] {
        self.warps.resize_with(shear.lines.div_ceil(BAND), Warp::default);
        self.warps.par_iter_mut().enumerate().for_each(|(index, warp)| {
            warp.lay(press, shear, elevation, index * BAND + BAND / 2);
        });
        self.warps
            .iter()
            .map(Warp::classes)
            .fold([i32::MAX, i32::MIN], |[least, most], [low, high]| [least.min(low), most.max(high)])
    }

    /// Clears the grid and adds every scatterer that shows, after [`Self::lay`], on a tape that was prepared for its classes.
    pub fn fill(
        &mut self,
        model: Model,
        lattice: &Lattice,
        tissue: &Columns,
        phantom_from_probe: &Pose,
        motion: &Motion,
        grid: &mut Grid,
    ) {
        let Model { instructions, beam, tape, elevation, shear } = model;
        let flow = Flow::new(beam, shear, elevation, lattice, tissue, phantom_from_probe, motion);
        self.list(&flow, shear, elevation, lattice, tissue, motion);
        let bands = grid.bands(shear.lines);
        self.scratch.resize_with(bands.len().div_ceil(TASK_BANDS), Scratch::default);
        let (parts, warps) = (&self.parts, &self.warps);
        let tasks = bands.par_chunks_mut(TASK_BANDS).zip(&mut self.scratch);
        tasks.enumerate().for_each(|(task, (bands, scratch))| {
            let Scratch { by_line, by_row, knots, runs, single } = scratch;
            for (i, band) in bands.iter_mut().enumerate() {
                let index = task * TASK_BANDS + i;
                let warp = &warps[index];
                let len = warp.len();
                // With the lines beside the band, which columns reach into as well; they are dropped.
                by_line.clear();
                by_line.resize((BAND + 2) * 2 * len, 0.0);
                let (first_line, drift_rows) = ((index * BAND) as i32, beam.grain.drift_rows);
                let tapes: Vec<&[u32]> =
                    warp.class.iter().map(|&class| &*tape.strained(class).samples).collect();
                let place = Place { flow: &flow, tape, tapes: &tapes, warp, tissue, drift_rows, first_line };
                for part in parts {
                    for &column in &part.by_band[index] {
                        let column = &part.columns[column as usize];
                        flow.follow_knots(instructions, column, knots);
                        add_column(instructions, &place, column, knots, runs, single, by_line);
                    }
                }
                let by_line = &by_line[2 * len..];
                // Every value is overwritten.
                by_row.resize(len * 2 * BAND, 0.0);
                transpose(instructions, by_line, 2 * len, len, by_row);
                transpose(instructions, &by_line[len..], 2 * len, len, &mut by_row[BAND..]);
                straighten(instructions, warp, by_row, tape, band.whole(shear.rows));
            }
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
        let slab = slab(elevation, Some(motion));
        let widest_m = elevation.slab().reach_m;
        let deepest_m = shear.rows as f64 * shear.row_step_m;
        let steepest = f64::from(flow.spread.iter().copied().fold(0.0, f32::max));
        let bands = shear.lines.div_ceil(BAND);
        let rows = shear.rows_across();
        let (first, count) = (*rows.start(), rows.count());
        self.parts.resize_with(PARTS, Part::default);
        self.parts.par_iter_mut().enumerate().for_each(|(index, Part { columns, by_band })| {
            columns.clear();
            by_band.iter_mut().for_each(Vec::clear);
            by_band.resize_with(bands, Vec::new);
            for iy in index * count / PARTS..(index + 1) * count / PARTS {
                let iy = first + iy as i32;
                for ix in shear.overlap(slab, iy) {
                    let layers = tissue.get(ix, iy);
                    if tissue.layers(layers).is_empty() {
                        continue;
                    }
                    let [x_m, y_m] = lattice.column_m(ix, iy);
                    let [down_m, aside_m] = motion.by_place(x_m, y_m);
                    let from_drag_m2 = motion.drag().map_or(0.0, |drag| {
                        let centre = drag.centre_in_phantom;
                        (x_m - centre.x) * (x_m - centre.x) + (y_m - centre.y) * (y_m - centre.y)
                    });
                    // The most that the needle drags any of the column.
                    let [dragged_m, dragged_lines] = flow.dragged.as_ref().map_or([0.0; 2], |dragged| {
                        let share = exp_minus((from_drag_m2 as f32).sqrt() * dragged.per_decay_m);
                        [dragged.elevation_m, dragged.lines].map(|most| f64::from((share * most).abs()))
                    });
                    let (x_m, e_m) = (shear.x.at(ix, iy), shear.e.at(ix, iy));
                    let elevation_aside_m = aside_m * flow.elevation_per_aside;
                    let [low_m, high_m] = [f64::min, f64::max].map(|most| {
                        e_m + most(0.0, deepest_m * shear.elevation_slope)
                            + most(0.0, elevation_aside_m * steepest)
                    });
                    if low_m - dragged_m > widest_m || high_m + dragged_m < -widest_m {
                        continue;
                    }
                    let line = |aside_m: f64| {
                        let x_m = x_m + aside_m * flow.along_per_aside;
                        floor((x_m - shear.first_line_m) / shear.line_pitch_m)
                    };
                    let (a, b) = (line(0.0), line(aside_m * steepest));
                    let dragged_lines = dragged_lines.ceil() as i64;
                    let first = (a.min(b) - dragged_lines).max(0);
                    let last = (a.max(b) + 1 + dragged_lines).min(shear.lines as i64 - 1);
                    if first > last {
                        continue;
                    }
                    for band in &mut by_band[first as usize / BAND..=last as usize / BAND] {
                        band.push(columns.len() as u32);
                    }
                    columns.push(Column {
                        x_m: x_m as f32,
                        e_m: e_m as f32,
                        top_row: shear.top_row.at(ix, iy) as f32,
                        rows_down: (down_m * flow.rows_per_m[0]) as f32,
                        rows_aside: (aside_m * flow.rows_per_m[1]) as f32,
                        along_aside_m: (aside_m * flow.along_per_aside) as f32,
                        line: ((x_m - shear.first_line_m) / shear.line_pitch_m) as f32,
                        lines_aside: (aside_m * flow.along_per_aside / shear.line_pitch_m) as f32,
                        elevation_aside_m: elevation_aside_m as f32,
                        from_drag_m2: from_drag_m2 as f32,
                        tape: lattice.tape_offset(ix, iy),
                        layers,
                    });
                }
            }
        });
    }
}

impl Flow {
    fn new(
        beam: &Beam,
        shear: &Shear,
        elevation: &ElevationTable,
        lattice: &Lattice,
        tissue: &Columns,
        phantom_from_probe: &Pose,
        motion: &Motion,
    ) -> Self {
        let probe_from_phantom = phantom_from_probe.inverse();
        let down = probe_from_phantom * -Vector::z();
        let aside = probe_from_phantom * motion.sideways();
        // Whole stretches between knots, and the knot at their end.
        let scatterers = tissue.most_scatterers().next_multiple_of(KNOT) + 1;
        let numbers =
            (0..scatterers).map(|n| (n as f64 * shear.rows_per_scatterer) as f32).collect::<Vec<_>>();
        let by_depth = (0..scatterers).map(|n| motion.by_depth((n as f64 + 0.5) * lattice.depth_step_m));
        let (sunk, spread): (Vec<f32>, Vec<f32>) =
            by_depth.map(|[f, slope]| (f as f32, slope as f32)).unzip();
        let row_step_m = shear.row_step_m;
        let knots = |values: &[f32]| values.iter().step_by(KNOT).copied().collect();
        Self {
            steps: (0..ROWS).map(|i| i as f32).collect(),
            stride: KNOT,
            knot_numbers: knots(&numbers),
            knot_sunk: knots(&sunk),
            knot_spread: knots(&spread),
            numbers,
            sunk,
            spread,
            rows_per_m: [down.z / row_step_m, aside.z / row_step_m],
            along_per_aside: aside.x - shear.lateral_slope * aside.z,
            elevation_per_aside: aside.y - shear.elevation_slope * aside.z,
            dragged: motion.drag().map(|drag| {
                let by_m = probe_from_phantom * drag.displacement_in_phantom;
                let along_m = by_m.x - shear.lateral_slope * by_m.z;
                Dragged {
                    depth_m: -drag.centre_in_phantom.z as f32,
                    first_m: (0.5 * lattice.depth_step_m) as f32,
                    m_per_row: (lattice.depth_step_m / shear.rows_per_scatterer) as f32,
                    per_decay_m: (1.0 / drag.decay_m) as f32,
                    rows: (by_m.z / row_step_m) as f32,
                    along_m: along_m as f32,
                    elevation_m: (by_m.y - shear.elevation_slope * by_m.z) as f32,
                    lines: (along_m / shear.line_pitch_m) as f32,
                }
            }),
            rows: [-(DELAY_REACH as f32), (shear.rows + DELAY_REACH - 1) as f32],
            turns_per_row: beam.two_k_rad_m * row_step_m * shear.rows_per_scatterer / core::f64::consts::TAU,
            along_per_row: (shear.lateral_slope * row_step_m) as f32,
            elevation_per_row: (shear.elevation_slope * row_step_m) as f32,
            reach_m: shear.reach_m as f32,
            widest_m: {
                let blocks = (0..=shear.rows / KNOT).map(|block| {
                    let rows = (0..=KNOT).map(|i| (block * KNOT + i) as f64);
                    rows.map(|row| elevation.profile(row).reach_m).fold(0.0, f32::max)
                });
                let mut levels: Vec<Vec<f32>> = vec![blocks.collect()];
                for level in 0..LONGEST.ilog2() as usize {
                    let (below, half) = (&levels[level], 1 << level);
                    let beyond = below.last().copied().into_iter().cycle();
                    let further = below[half.min(below.len())..].iter().copied().chain(beyond);
                    levels.push(below.iter().zip(further).map(|(a, b)| a.max(b)).collect());
                }
                levels
            },
        }
    }

    /// The most that the slice reaches between two rows of the grid, or around one. Those farther apart than the longest run
    /// count up to there from both.
    #[inline]
    pub fn widest_between(&self, above: f32, below: f32) -> f32 {
        let last = self.widest_m[0].len() - 1;
        let [first, end] =
            [above, below].map(|row| ((row * (1.0 / KNOT as f32)).max(0.0) as usize).min(last));
        let level = ((end - first.min(end) + 1).ilog2() as usize).min(self.widest_m.len() - 1);
        let blocks = &self.widest_m[level];
        blocks[first].max(blocks[(end + 1).saturating_sub(1 << level)])
    }

    /// Where a column's knots are, but for the rows of a warp.
    pub fn follow_knots(&self, instructions: Instructions, column: &Column, knots: &mut Knots) {
        let numbers = [&*self.knot_numbers, &*self.knot_sunk, &*self.knot_spread];
        follow(instructions, self, column, numbers, knots);
    }

    /// Whether tissue between knots may move unlike that at both.
    pub fn is_dragged(&self) -> bool {
        self.dragged.is_some()
    }

    /// Where some of its scatterers are.
    pub fn follow_each(
        &self,
        instructions: Instructions,
        column: &Column,
        numbers: Range<usize>,
        single: &mut Knots,
    ) {
        let numbers = [&self.numbers[numbers.clone()], &self.sunk[numbers.clone()], &self.spread[numbers]];
        follow(instructions, self, column, numbers, single);
    }
}

wide! {
    fn follow(flow: &Flow, column: &Column, numbers: [&[f32]; 3], out: &mut Knots) {
        let count = numbers[0].len();
        for values in [&mut out.row, &mut out.e_m, &mut out.x_m, &mut out.line] {
            values.resize(count, 0.0);
        }
        let (row, e_m) = (&mut out.row[..count], &mut out.e_m[..count]);
        let (x_m, line) = (&mut out.x_m[..count], &mut out.line[..count]);
        let [numbers, sunk, spread] = [&numbers[0][..count], &numbers[1][..count], &numbers[2][..count]];
        for i in 0..count {
            row[i] = column.top_row + numbers[i] + column.rows_down * sunk[i] + column.rows_aside * spread[i];
        }
        let Some(dragged) = &flow.dragged else {
            for i in 0..count {
                e_m[i] = column.e_m + flow.elevation_per_row * row[i] + column.elevation_aside_m * spread[i];
            }
            for i in 0..count {
                x_m[i] = column.x_m + column.along_aside_m * spread[i] + flow.along_per_row * row[i];
                line[i] = column.line + column.lines_aside * spread[i];
            }
            return;
        };
        let &Dragged { depth_m, first_m, m_per_row, per_decay_m, .. } = dragged;
        for i in 0..count {
            let below_m = first_m + m_per_row * numbers[i] - depth_m;
            let share = exp_minus((column.from_drag_m2 + below_m * below_m).sqrt() * per_decay_m);
            row[i] += share * dragged.rows;
            e_m[i] = share * dragged.elevation_m;
            x_m[i] = share * dragged.along_m;
            line[i] = share * dragged.lines;
        }
        for i in 0..count {
            e_m[i] += column.e_m + flow.elevation_per_row * row[i] + column.elevation_aside_m * spread[i];
        }
        for i in 0..count {
            x_m[i] += column.x_m + column.along_aside_m * spread[i] + flow.along_per_row * row[i];
            line[i] += column.line + column.lines_aside * spread[i];
        }
    }
}
