//! Moved tissue: every scatterer where it has gone.
//!
//! Columns are straight no more, but along one band of lines all of them are moved nearly alike. On rows that follow the
//! tissue (`warp`) they are nearly straight again, and are added stride by stride (`strides`).

use core::ops::Range;

use sonoloop_types::{Pose, Vector};

use crate::{
    awake,
    beam::Beam,
    block::Block,
    columns::{self, Columns},
    elevation::{ElevationTable, STRIDE},
    fast::{exp_minus, floor},
    instructions::{Instructions, wide},
    lattice::Lattice,
    motion::Motion,
    per_thread::PerThread,
    shear::{Shear, Slab},
    splat::{self, Grid},
    strides::{Band, Places, Strides, add_column},
    tape::BakedTape,
    warp::{Press, Warp, straighten},
};

/// Rows at a time that are looked at for whether a column shows there.
const GLANCE: usize = 8 * STRIDE;
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
    pub elevation_aside_m: f32,
    /// Place among the grid's lines at rest, and what [`Flow::spread`] scales to lines.
    line: f32,
    pub lines_aside: f32,
    /// Squared distance from the axis through the place that the needle drags, along the columns.
    from_drag_m2: f32,
    pub tape: usize,
    /// Which of [`crate::thinning::Thinning`]'s sets it belongs to.
    pub class: usize,
    pub layers: columns::Range,
    /// Rows of the grid above and below which none of it shows.
    pub shown: [f32; 2],
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
    /// Scatterers of a column.
    pub scatterers: usize,
    /// Of all of them, from [`BEFORE`] ahead of the first one to some behind the last.
    each: Followed,
    /// Of every [`STRIDE`]th, from each of the first on.
    every_stride: [Followed; STRIDE],
    /// Rows per metre down and aside; metres along lines and in elevation per metre aside.
    rows_per_m: [f64; 2],
    along_per_aside: f64,
    elevation_per_aside: f64,
    dragged: Option<Dragged>,
    /// Scatterer at rest that lies in the middle of a grid, if its column begins at row 0, and rows from one to the next.
    middle: f32,
    pub rows_per_scatterer: f32,
    /// Turns of the carrier from one scatterer at rest to the next.
    pub turns_per_row: f64,
    pub along_per_row: f32,
    pub elevation_per_row: f32,
    /// Half the width that shows.
    pub reach_m: f32,
}

/// Scatterers ahead of a column's first one, and behind its last one, up to which its tissue's motion is known.
const BEFORE: usize = 2 * STRIDE;
const BEHIND: usize = 20 * STRIDE;

/// Of some scatterers of any column: how far they lie below the first one at rest, in rows, and [`Motion::by_depth`].
#[derive(Default)]
struct Followed {
    numbers: Vec<f32>,
    sunk: Vec<f32>,
    spread: Vec<f32>,
}

impl Followed {
    fn part(&self, range: Range<usize>) -> [&[f32]; 3] {
        [&self.numbers, &self.sunk, &self.spread].map(|values| &values[range.clone()])
    }
}

/// Scatterers of moved tissue.
#[derive(Default)]
pub struct Points {
    parts: Vec<Part>,
    warps: Vec<Warp>,
    /// First and last class of the strain.
    classes: [i32; 2],
    scratch: PerThread<Scratch>,
}

/// Columns of a part of the lattice that may show.
#[derive(Default)]
struct Part {
    columns: Vec<Column>,
    /// By band of lines: the columns that reach it, in the lattice's order.
    by_band: Vec<Vec<u32>>,
}

/// A band under way, of one thread.
#[derive(Default)]
struct Scratch {
    /// Per line the real parts by row, then the imaginary ones.
    by_line: Vec<f32>,
    /// The same by row and line.
    by_row: Vec<f32>,
    strides: Strides,
    block: Block,
}

/// Where columns of a set stand at rest that meet the slice.
pub fn slab(elevation: &ElevationTable, class: usize, motion: Option<&Motion>) -> Slab {
    // What goes down stays on its column's line; e′ changes by what goes aside, see `Motion::aside_m`.
    let margin_m = motion.map_or(0.0, |motion| 2.0 * motion.aside_m());
    elevation.slab(class).wider(margin_m)
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
    pub fn lay(
        &mut self,
        instructions: Instructions,
        press: &Press,
        shear: &Shear,
        elevation: &ElevationTable,
    ) -> [i32; 2] {
        self.warps.resize_with(shear.lines.div_ceil(splat::BAND), Warp::default);
        awake::for_each(self.warps.iter_mut().enumerate(), |(index, warp)| {
            warp.lay(instructions, press, shear, elevation, index * splat::BAND + splat::BAND / 2);
        });
        let classes = self.warps.iter().map(Warp::classes);
        self.classes =
            classes.fold([i32::MAX, i32::MIN], |[least, most], [low, high]| [least.min(low), most.max(high)]);
        self.classes
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
        let flow = Flow::new(beam, shear, lattice, tissue, phantom_from_probe, motion);
        self.list(&flow, shear, elevation, lattice, tissue, motion);
        let bands = grid.bands(shear.lines);
        self.scratch.prepare();
        let (parts, warps, classes, scratch) = (&self.parts, &self.warps, self.classes, &self.scratch);
        awake::for_each(bands.iter_mut().enumerate(), |(index, band)| {
            scratch.with(|Scratch { by_line, by_row, strides, block }| {
                let warp = &warps[index];
                let len = warp.len();
                // With the lines beside the band, which columns reach into as well; they are dropped.
                by_line.clear();
                by_line.resize((splat::BAND + 2) * 2 * len, 0.0);
                let first_line = (index * splat::BAND) as i32;
                let (drift_rows, strain_step) = (beam.grain.drift_rows, beam.grain.strain_step as f32);
                let place =
                    Band { flow: &flow, tape, warp, tissue, drift_rows, strain_step, classes, first_line };
                for part in parts {
                    for &column in &part.by_band[index] {
                        add_column(
                            instructions,
                            &place,
                            &part.columns[column as usize],
                            strides,
                            block,
                            by_line,
                        );
                    }
                }
                let by_line = &by_line[2 * len..];
                // Every value is overwritten.
                by_row.resize(len * 2 * splat::BAND, 0.0);
                splat::to_rows(instructions, by_line, len, by_row);
                straighten(instructions, warp, by_row, tape, band.whole(shear.rows));
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
        let thinning = shear.thinning;
        // Columns that come into the slice from beside it.
        let dragged_m = flow.dragged.as_ref().map_or(0.0, |dragged| f64::from(dragged.elevation_m.abs()));
        let beside_m = motion.sideways_m() * flow.elevation_per_aside.abs() + dragged_m;
        let slabs: Vec<Slab> =
            (0..thinning.classes).map(|class| elevation.slab(class).wider(beside_m)).collect();
        let widest = |class: usize, block: usize| {
            let rows = (block * GLANCE..=(block + 1) * GLANCE).step_by(STRIDE);
            let reach_m = |row: usize| f64::from(elevation.reach_m(class, elevation.place(row as f64)));
            rows.map(reach_m).fold(f64::NEG_INFINITY, f64::max)
        };
        let blocks = shear.rows.div_ceil(GLANCE);
        let widest_m: Vec<Vec<f64>> = (0..thinning.classes)
            .map(|class| (0..blocks).map(|block| widest(class, block)).collect())
            .collect();
        let slope = shear.elevation_slope * shear.row_step_m * GLANCE as f64;
        let steepest = f64::from(flow.each.spread.iter().copied().fold(0.0, f32::max));
        let bands = shear.lines.div_ceil(splat::BAND);
        let rows = shear.rows_across();
        let (first, count) = (*rows.start(), rows.count());
        self.parts.resize_with(PARTS, Part::default);
        awake::for_each(self.parts.iter_mut().enumerate(), |(index, Part { columns, by_band })| {
            columns.clear();
            by_band.iter_mut().for_each(Vec::clear);
            by_band.resize_with(bands, Vec::new);
            for iy in index * count / PARTS..(index + 1) * count / PARTS {
                let iy = first + iy as i32;
                for ix in shear.overlap(slabs[thinning.of_row(iy)], iy) {
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
                    let margin_m = dragged_m + elevation_aside_m.abs() * steepest;
                    let class = thinning.class(ix, iy);
                    let widest_m = &widest_m[class];
                    let shows = |block: usize| {
                        let [above_m, below_m] = [block, block + 1].map(|block| e_m + block as f64 * slope);
                        let nearest_m =
                            if above_m * below_m <= 0.0 { 0.0 } else { above_m.abs().min(below_m.abs()) };
                        widest_m[block] > 0.0 && nearest_m <= widest_m[block] + margin_m
                    };
                    let Some(first_shown) = (0..widest_m.len()).position(shows) else { continue };
                    let last_shown = (0..widest_m.len()).rposition(shows).unwrap_or(first_shown);
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
                    for band in &mut by_band[first as usize / splat::BAND..=last as usize / splat::BAND] {
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
                        class,
                        layers,
                        shown: [first_shown, last_shown + 1].map(|block| (block * GLANCE) as f32),
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
        lattice: &Lattice,
        tissue: &Columns,
        phantom_from_probe: &Pose,
        motion: &Motion,
    ) -> Self {
        let probe_from_phantom = phantom_from_probe.inverse();
        let down = probe_from_phantom * -Vector::z();
        let aside = probe_from_phantom * motion.sideways();
        let scatterers = tissue.most_scatterers();
        let mut each = Followed::default();
        let by_depth = |number: f64| motion.by_depth((number + 0.5) * lattice.depth_step_m);
        // Those ahead of the first one go on as it does, so that its stride does not bend.
        let [top, next] = [0.0, 1.0].map(by_depth);
        for i in 0..BEFORE + scatterers + BEHIND {
            let number = i as f64 - BEFORE as f64;
            let ahead = [0, 1].map(|part| top[part] + number * (next[part] - top[part]));
            let [sunk, spread] = if number < 0.0 { ahead } else { by_depth(number) };
            each.numbers.push((number * shear.rows_per_scatterer) as f32);
            each.sunk.push(sunk as f32);
            each.spread.push(spread as f32);
        }
        let every = |first: usize| {
            let every = |values: &[f32]| values[first..].iter().step_by(STRIDE).copied().collect();
            Followed { numbers: every(&each.numbers), sunk: every(&each.sunk), spread: every(&each.spread) }
        };
        let every_stride = core::array::from_fn(every);
        let row_step_m = shear.row_step_m;
        Self {
            scatterers,
            each,
            every_stride,
            middle: (0.5 * shear.rows as f64 / shear.rows_per_scatterer) as f32,
            rows_per_scatterer: shear.rows_per_scatterer as f32,
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
            turns_per_row: beam.two_k_rad_m * row_step_m * shear.rows_per_scatterer / core::f64::consts::TAU,
            along_per_row: (shear.lateral_slope * row_step_m) as f32,
            elevation_per_row: (shear.elevation_slope * row_step_m) as f32,
            reach_m: shear.reach_m as f32,
        }
    }

    /// A scatterer of a column next to the picture's middle, and its row.
    pub fn middle(&self, column: &Column) -> (usize, f32) {
        let number = self.middle - column.top_row * (1.0 / self.rows_per_scatterer);
        let number = (number.max(0.0) as usize).min(self.scatterers);
        let [numbers, sunk, spread] =
            self.each.part(BEFORE + number..BEFORE + number + 1).map(|values| values[0]);
        (number, column.top_row + numbers + column.rows_down * sunk + column.rows_aside * spread)
    }

    /// What [`Self::follow`] takes for so many strides of scatterers from the one with a number on, which may lie up to
    /// [`BEFORE`] ahead of the first one; the last may lie up to [`BEHIND`] behind the last one.
    pub fn every_stride(&self, first: i32, count: usize) -> [&[f32]; 3] {
        let index = (first + BEFORE as i32) as usize;
        self.every_stride[index % STRIDE].part(index / STRIDE..index / STRIDE + count)
    }

    /// Whether the needle drags tissue.
    pub fn is_dragged(&self) -> bool {
        self.dragged.is_some()
    }

    /// Where a column's scatterers are.
    pub fn follow(
        &self,
        instructions: Instructions,
        column: &Column,
        numbers: [&[f32]; 3],
        places: &mut Places,
    ) {
        follow(instructions, self, column, numbers, places);
    }

    /// The same of some with these numbers.
    pub fn follow_each(
        &self,
        instructions: Instructions,
        column: &Column,
        numbers: Range<usize>,
        places: &mut Places,
    ) {
        let numbers = self.each.part(BEFORE + numbers.start..BEFORE + numbers.end);
        follow(instructions, self, column, numbers, places);
    }
}

wide! {
    fn follow(flow: &Flow, column: &Column, numbers: [&[f32]; 3], out: &mut Places) {
        let count = numbers[0].len();
        for values in [&mut out.row, &mut out.e_m, &mut out.x_m, &mut out.line] {
            if values.len() < count {
                values.resize(count, 0.0);
            }
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
