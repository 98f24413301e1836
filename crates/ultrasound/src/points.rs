//! Moved tissue: scatterer by scatterer, each where it has gone.
//!
//! Columns are straight no more, and one tape does not serve them all: its carrier would be off by the strain. On rows
//! that follow the press (`warp`) the scatterers of a column still lie next to one another, so many of them, each with
//! its own weight and phase, are added at a time (`groups`): to two lines and, on each, to the two parts of a row that
//! they lie between. Only where a group goes is decided for all of it, by its ends.

use rayon::prelude::*;
use sonoloop_types::Pose;

use crate::{
    beam::Beam,
    columns::{Columns, Range},
    elevation::ElevationTable,
    fast::floor,
    groups::{GROUP, Group, Steps, add_column, steps},
    instructions::{Instructions, nearest_f32, wide},
    lattice::Lattice,
    motion::Motion,
    shear::{Shear, Slab},
    splat::{BAND, Grid, transpose},
    tape::{BakedTape, DELAY_REACH},
    warp::{Press, Warp, straighten},
};

/// Parts of a row by which a group's last scatterer may lie nearer to, or farther from, its first than the warp's rows do: two
/// rows stand for what lies a quarter of a part beside them as well. Scatterers that drift more are added one by one.
const DRIFT: f32 = 0.5;
/// Bands per task; fixed, though results do not depend on it.
const TASK_BANDS: usize = 2;

/// A column of the lattice, and how far its tissue has moved.
pub struct Column {
    /// x′ and e′ at rest.
    pub x_m: f32,
    pub e_m: f32,
    /// Depth of scatterer 0 at rest, in rows.
    pub top_row: f64,
    /// What [`Flow::sunk`] scales to rows, and what [`Flow::spread`] scales to rows, to a way along lines and in elevation.
    pub rows_down: f32,
    pub rows_aside: f32,
    along_aside_m: f32,
    pub elevation_aside_m: f32,
    /// Place among the grid's lines at rest, and what [`Flow::spread`] scales to lines.
    pub line: f32,
    pub lines_aside: f32,
    pub tape: usize,
    layers: Range,
}

/// What all scatterers of a picture share.
pub struct Flow {
    pub steps: Steps,
    pub parts: usize,
    /// Indices of the first scatterers of a column's groups, and of one group more.
    firsts: Vec<f32>,
    /// [`Motion::by_depth`] of all scatterers of those groups, and of those first ones.
    pub sunk: Vec<f32>,
    pub spread: Vec<f32>,
    sunk_firsts: Vec<f32>,
    spread_firsts: Vec<f32>,
    /// Rows per metre down and aside; metres along lines and in elevation per metre aside.
    rows_per_m: [f64; 2],
    along_per_aside: f64,
    elevation_per_aside: f64,
    /// Rows of the grid that scatterers reach into it from.
    rows: [f32; 2],
    pub turns_per_row: f32,
    along_per_row: f32,
    pub elevation_per_row: f32,
    /// Half the width that shows.
    reach_m: f32,
}

/// Scatterers of moved tissue.
#[derive(Default)]
pub struct Points {
    columns: Vec<Column>,
    /// By band of lines: the columns that reach it, in the lattice's order.
    by_band: Vec<Vec<u32>>,
    scratch: Vec<Scratch>,
}

/// A band under way.
#[derive(Default)]
struct Scratch {
    warp: Warp,
    /// Per line the real parts by part of a row and row, then the imaginary ones.
    by_line: Vec<f32>,
    /// The same by part of a row, row and line.
    by_row: Vec<f32>,
    ends: Ends,
    groups: Vec<Group>,
}

/// Where the first scatterers of a column's groups are.
#[derive(Default)]
struct Ends {
    /// Depth in rows of the grid, and in rows of the warp.
    row: Vec<f32>,
    warped: Vec<f32>,
    e_m: Vec<f32>,
    x_m: Vec<f32>,
    /// Place among the grid's lines.
    line: Vec<f32>,
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
        let Model { instructions, beam, tape, elevation, shear, .. } = model;
        let flow = Flow::new(&model, lattice, tissue, phantom_from_probe, motion);
        self.list(&flow, shear, elevation, lattice, tissue, motion);
        let press = Press { lattice, phantom_from_probe, motion, rows_per_m: flow.rows_per_m };
        let bands = grid.bands(shear.lines);
        self.scratch.resize_with(bands.len().div_ceil(TASK_BANDS), Scratch::default);
        let (columns, by_band) = (&self.columns, &self.by_band);
        let tasks = bands.par_chunks_mut(TASK_BANDS).zip(&mut self.scratch);
        tasks.enumerate().for_each(|(task, (bands, scratch))| {
            let Scratch { warp, by_line, by_row, ends, groups } = scratch;
            for (i, band) in bands.iter_mut().enumerate() {
                let index = task * TASK_BANDS + i;
                warp.lay(&press, shear, elevation, index * BAND + BAND / 2);
                let (parts, len) = (beam.grain.parts_per_row, warp.len());
                // With the lines beside the band, which columns reach into as well; they are dropped.
                let line_size = 2 * parts * len;
                by_line.clear();
                by_line.resize((BAND + 2) * line_size, 0.0);
                let place = Place { flow: &flow, tape, warp, first_line: (index * BAND) as i32 };
                for &column in &by_band[index] {
                    let column = &columns[column as usize];
                    follow(instructions, &flow, column, ends);
                    warp.warp(&ends.row, &mut ends.warped);
                    groups.clear();
                    match parts {
                        2 => find::<2>(&place, tissue, column, ends, groups),
                        _ => find::<4>(&place, tissue, column, ends, groups),
                    }
                    add_column(instructions, &place, column, groups, by_line);
                }
                let by_line = &by_line[line_size..];
                // Every value is overwritten.
                by_row.resize(parts * len * 2 * BAND, 0.0);
                for (part, by_row) in by_row.chunks_exact_mut(len * 2 * BAND).enumerate() {
                    transpose(instructions, &by_line[part * len..], line_size, len, by_row);
                    let imaginary = &by_line[(parts + part) * len..];
                    transpose(instructions, imaginary, line_size, len, &mut by_row[BAND..]);
                }
                straighten(instructions, warp, by_row, parts, tape, band.whole(shear.rows));
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
        self.columns.clear();
        self.by_band.iter_mut().for_each(Vec::clear);
        self.by_band.resize_with(shear.lines.div_ceil(BAND), Vec::new);
        let steepest = f64::from(flow.spread.iter().copied().fold(0.0, f32::max));
        for [ix, iy] in shear.columns_across(slab(elevation, Some(motion))) {
            let layers = tissue.get(ix, iy);
            if tissue.layers(layers).is_empty() {
                continue;
            }
            let [x_m, y_m] = lattice.column_m(ix, iy);
            let [down_m, aside_m] = motion.by_place(x_m, y_m);
            let x_m = shear.x.at(ix, iy);
            let line = |aside_m: f64| {
                let x_m = x_m + aside_m * flow.along_per_aside;
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
                x_m: x_m as f32,
                e_m: shear.e.at(ix, iy) as f32,
                top_row: shear.top_row.at(ix, iy),
                rows_down: (down_m * flow.rows_per_m[0]) as f32,
                rows_aside: (aside_m * flow.rows_per_m[1]) as f32,
                along_aside_m: (aside_m * flow.along_per_aside) as f32,
                line: ((x_m - shear.first_line_m) / shear.line_pitch_m) as f32,
                lines_aside: (aside_m * flow.along_per_aside / shear.line_pitch_m) as f32,
                elevation_aside_m: (aside_m * flow.elevation_per_aside) as f32,
                tape: lattice.tape_offset(ix, iy),
                layers,
            });
        }
    }
}

/// What it takes to add a band's columns.
pub struct Place<'a> {
    pub flow: &'a Flow,
    pub tape: &'a BakedTape,
    pub warp: &'a Warp,
    /// The band's first line.
    first_line: i32,
}

wide! {
    /// Finds where a column's groups begin.
    fn follow(flow: &Flow, column: &Column, ends: &mut Ends) {
        let count = flow.firsts.len();
        for values in [&mut ends.row, &mut ends.e_m, &mut ends.x_m, &mut ends.line] {
            values.resize(count, 0.0);
        }
        let (row, e_m) = (&mut ends.row[..count], &mut ends.e_m[..count]);
        let (x_m, line) = (&mut ends.x_m[..count], &mut ends.line[..count]);
        let (sunk, spread) = (&flow.sunk_firsts[..count], &flow.spread_firsts[..count]);
        let top = column.top_row as f32;
        for i in 0..count {
            row[i] = top + flow.firsts[i] + column.rows_down * sunk[i] + column.rows_aside * spread[i];
        }
        for i in 0..count {
            e_m[i] = column.e_m + flow.elevation_per_row * row[i] + column.elevation_aside_m * spread[i];
        }
        for i in 0..count {
            x_m[i] = column.x_m + column.along_aside_m * spread[i] + flow.along_per_row * row[i];
            line[i] = column.line + column.lines_aside * spread[i];
        }
    }
}

/// Finds the groups of a column that show on a band, where a row has so many parts.
fn find<const PARTS: usize>(
    place: &Place,
    tissue: &Columns,
    column: &Column,
    ends: &Ends,
    groups: &mut Vec<Group>,
) {
    let end = place.flow.sunk.len() - GROUP;
    let mut next = 0;
    for &layer in tissue.layers(column.layers) {
        let (first, last) = (next, (layer.end.max(0) as usize).min(end));
        next = last;
        let amplitude = tissue.filling(layer).amplitude;
        if amplitude == 0.0 || first == last {
            continue;
        }
        for index in first / GROUP..=(last - 1) / GROUP {
            if let Some(group) = place.group::<PARTS>(ends, index) {
                let begin = index * GROUP;
                let [from, to] = [first, last].map(|n| n.saturating_sub(begin).min(GROUP) as f32);
                groups.push(Group { first: begin as u32, from, to, amplitude, ..group });
            }
        }
    }
}

impl Place<'_> {
    /// Where a group goes; `None` where it does not show.
    #[inline(always)]
    fn group<const PARTS: usize>(&self, ends: &Ends, index: usize) -> Option<Group> {
        let Self { flow, warp, first_line, .. } = *self;
        let both = |values: &[f32]| (values[index], values[index + 1]);
        let ((above, below), e_m) = (both(&ends.row), both(&ends.e_m));
        if below < flow.rows[0] || above > flow.rows[1] {
            return None;
        }
        let warped = both(&ends.warped);
        let middle = nearest_f32(0.5 * (warped.0 + warped.1) * PARTS as f32 - 0.5) as usize;
        let at = (middle / PARTS).wrapping_sub(GROUP / 2);
        if at >= warp.len() - GROUP {
            return None;
        }
        let beside = |(a, b): (f32, f32), reach: f32| (a > reach && b > reach) || (a < -reach && b < -reach);
        if beside(e_m, warp.reach_m[at + GROUP / 2]) || beside(both(&ends.x_m), flow.reach_m) {
            return None;
        }
        let line = both(&ends.line);
        let whole = nearest_f32(0.5 * (line.0 + line.1) - 0.5);
        let line = (whole + 1 - first_line) as usize;
        if line > BAND {
            return None;
        }
        Some(Group {
            at: at as u32,
            part: (middle % PARTS) as u32,
            line: line as u32,
            whole_line: whole as f32,
            together: ((warped.1 - warped.0 - GROUP as f32) * PARTS as f32).abs() <= DRIFT,
            ..Group::default()
        })
    }
}

impl Flow {
    fn new(
        model: &Model,
        lattice: &Lattice,
        tissue: &Columns,
        phantom_from_probe: &Pose,
        motion: &Motion,
    ) -> Self {
        let Model { beam, shear, .. } = *model;
        let probe_from_phantom = phantom_from_probe.inverse();
        let down = probe_from_phantom * -sonoloop_types::Vector::z();
        let aside = probe_from_phantom * motion.sideways();
        let scatterers = ((tissue.thickness_m() / lattice.depth_step_m).ceil() as usize + 1 + GROUP)
            .next_multiple_of(GROUP);
        let depth_m = |n: usize| (n as f64 + 0.5) * lattice.depth_step_m;
        let by_depth = |part: usize| -> Vec<f32> {
            (0..scatterers).map(|n| motion.by_depth(depth_m(n))[part] as f32).collect()
        };
        let (sunk, spread) = (by_depth(0), by_depth(1));
        let row_step_m = shear.row_step_m;
        Self {
            steps: steps(),
            parts: beam.grain.parts_per_row,
            firsts: (0..scatterers).step_by(GROUP).map(|n| n as f32).collect(),
            sunk_firsts: sunk.iter().step_by(GROUP).copied().collect(),
            spread_firsts: spread.iter().step_by(GROUP).copied().collect(),
            sunk,
            spread,
            rows_per_m: [down.z / row_step_m, aside.z / row_step_m],
            along_per_aside: aside.x - shear.lateral_slope * aside.z,
            elevation_per_aside: aside.y - shear.elevation_slope * aside.z,
            rows: [-(DELAY_REACH as f32), (shear.rows + DELAY_REACH - 1) as f32],
            turns_per_row: (beam.two_k_rad_m * row_step_m / core::f64::consts::TAU) as f32,
            along_per_row: (shear.lateral_slope * row_step_m) as f32,
            elevation_per_row: (shear.elevation_slope * row_step_m) as f32,
            reach_m: shear.reach_m as f32,
        }
    }
}
