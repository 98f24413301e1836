//! Moved tissue: scatterer by scatterer, each where it has gone.
//!
//! Columns are straight no more, so nothing is shared along them; what is kept are the grid, the delay filters that
//! spread a scatterer over rows, and the beam filters after that. Three to five times slower than columns at rest.

use rayon::prelude::*;
use sonoloop_types::{Indentation, Pose};

use crate::{
    beam::Beam,
    columns::{Columns, Range},
    elevation::ElevationTable,
    fast::floor,
    lattice::Lattice,
    shear::Shear,
    splat::{BAND, Grid},
    tape::{BakedTape, DELAY_REACH, DELAY_TAPS},
};

/// Rows before the grid's first and after its last that a scatterer may touch.
const MARGIN: usize = DELAY_TAPS;
/// Places on the circle at which sine and cosine are kept; between them the first order is exact to 5e-6.
const TURNS: usize = 1024;

/// A column of the lattice, and how far its tissue has moved.
struct Column {
    /// x′ and e′ at rest.
    x_m: f64,
    e_m: f64,
    /// Depth of scatterer 0 at rest, in rows.
    top_row: f64,
    /// What [`Indentation::by_depth`] scales to the way down and to the way aside.
    down_m: f64,
    aside_m: f64,
    tape: usize,
    stretches: Range,
}

/// What all scatterers of a picture share.
struct Motion {
    /// [`Indentation::by_depth`] of each scatterer of a column.
    by_depth: Vec<[f64; 2]>,
    /// Rows per metre down and aside; metres along lines and in elevation per metre aside.
    rows_per_m: [f64; 2],
    lines_per_aside: f64,
    elevation_per_aside: f64,
}

/// Scatterers of moved tissue.
#[derive(Default)]
pub struct Points {
    columns: Vec<Column>,
    /// By band of lines: the columns that reach it, in the lattice's order.
    by_band: Vec<Vec<u32>>,
    turns: Vec<[f32; 2]>,
}

/// What a scatterer's echo is made of.
#[derive(Clone, Copy)]
pub struct Model<'a> {
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
        tissue: &mut Columns,
        phantom_from_probe: &Pose,
        indentation: &Indentation,
        grid: &mut Grid,
    ) {
        let shear = model.shear;
        let motion = Motion::new(shear, lattice, tissue, phantom_from_probe, indentation);
        self.list(&motion, shear, model.elevation, lattice, tissue, indentation);
        if self.turns.is_empty() {
            self.turns.extend((0..TURNS).map(|i| {
                let (sin, cos) = libm::sincos(core::f64::consts::TAU * (i as f64 + 0.5) / TURNS as f64);
                [cos as f32, sin as f32]
            }));
        }
        let (this, tissue, motion) = (&*self, &*tissue, &motion);
        grid.bands(shear.lines).par_iter_mut().enumerate().for_each(|(index, band)| {
            let first = index * BAND;
            band.fill_whole(shear.rows, MARGIN, |by_line, stride| {
                let lines = first..(first + BAND).min(shear.lines);
                for &column in &this.by_band[index] {
                    let column = &this.columns[column as usize];
                    this.add_column(&model, motion, tissue, column, &lines, by_line, stride);
                }
            });
        });
    }

    /// Finds the columns that may show, and the bands that each reaches.
    fn list(
        &mut self,
        motion: &Motion,
        shear: &Shear,
        elevation: &ElevationTable,
        lattice: &Lattice,
        tissue: &mut Columns,
        indentation: &Indentation,
    ) {
        self.columns.clear();
        self.by_band.iter_mut().for_each(Vec::clear);
        self.by_band.resize_with(shear.lines.div_ceil(BAND), Vec::new);
        let steepest = motion.by_depth.iter().fold(0.0, |most: f64, by_depth| most.max(by_depth[1]));
        let [low_m, high_m] = elevation.range_m();
        let margin_m = indentation.depth_m.abs();
        for [ix, iy] in shear.columns_across([low_m - margin_m, high_m + margin_m]) {
            let stretches = tissue.get(ix, iy);
            if tissue.stretches(stretches).is_empty() {
                continue;
            }
            let [x_m, y_m] = lattice.column_m(ix, iy);
            let [down_m, aside_m] = indentation.by_place(x_m, y_m);
            let x_m = shear.x.at(ix, iy);
            let line = |aside_m: f64| {
                let x_m = x_m + aside_m * motion.lines_per_aside;
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
                stretches,
            });
        }
    }

    /// Adds what a column's scatterers leave on some lines.
    #[expect(clippy::too_many_arguments, reason = "the scene, the column and where it goes")]
    fn add_column(
        &self,
        model: &Model,
        motion: &Motion,
        tissue: &Columns,
        column: &Column,
        lines: &core::ops::Range<usize>,
        by_line: &mut [f32],
        stride: usize,
    ) {
        let Model { beam, tape, elevation, shear } = model;
        let turns_per_row = beam.two_k_rad_m * shear.row_step_m / core::f64::consts::TAU;
        let sub_delays = tape.sub_delays as f64;
        let rows = shear.rows as f64;
        let lines_per_m = 1.0 / shear.line_pitch_m;
        for stretch in tissue.stretches(column.stretches).iter().filter(|s| s.amplitude != 0.0) {
            for n in stretch.start..stretch.end.min(motion.by_depth.len() as i32) {
                let [f, slope] = motion.by_depth[n as usize];
                let (down_m, aside_m) = (column.down_m * f, column.aside_m * slope);
                let moved_rows = down_m * motion.rows_per_m[0] + aside_m * motion.rows_per_m[1];
                let row = column.top_row + f64::from(n) + moved_rows;
                if row < -(DELAY_REACH as f64) {
                    continue;
                }
                if row > rows + DELAY_REACH as f64 - 1.0 {
                    return;
                }
                let z_m = row * shear.row_step_m;
                let nearest = (row.max(0.0) + 0.5) as usize;
                let e_m = column.e_m + shear.elevation_slope * z_m + aside_m * motion.elevation_per_aside;
                let Some(weight) = elevation.weight(nearest, e_m as f32) else { continue };
                let sheared_m = column.x_m + aside_m * motion.lines_per_aside;
                if (sheared_m + shear.lateral_slope * z_m).abs() > shear.reach_m {
                    continue;
                }
                let place = (sheared_m - shear.first_line_m) * lines_per_m;
                let line = floor(place);
                let fraction = (place - line as f64) as f32;
                if line + 1 < lines.start as i64 || line >= lines.end as i64 {
                    continue;
                }
                let turn = row * turns_per_row;
                let part = (turn - floor(turn) as f64) * TURNS as f64;
                let knot = (part as usize).min(TURNS - 1);
                let past = ((part - knot as f64 - 0.5) * (core::f64::consts::TAU / TURNS as f64)) as f32;
                let [cos, sin] = self.turns[knot];
                let (cos, sin) = (cos - sin * past, sin + cos * past);
                let [re, im] = tape.raw(column.tape + n as usize);
                let weight = weight * stretch.amplitude;
                let (re, im) = (weight * (re * cos + im * sin), weight * (im * cos - re * sin));
                let delays = floor(row * sub_delays + 0.5) + tape.sub_delays as i64 / 2;
                let whole = floor(delays as f64 / sub_delays);
                let taps = &tape.delay_filters[(delays - whole * tape.sub_delays as i64) as usize];
                let first = (whole + (MARGIN - DELAY_REACH) as i64) as usize;
                for (line, share) in [(line, 1.0 - fraction), (line + 1, fraction)] {
                    if line < lines.start as i64 || line >= lines.end as i64 {
                        continue;
                    }
                    let line = &mut by_line[(line as usize - lines.start) * 2 * stride..][..2 * stride];
                    let (line_re, line_im) = line.split_at_mut(stride);
                    let (re, im) = (share * re, share * im);
                    for (out, tap) in line_re[first..][..DELAY_TAPS].iter_mut().zip(taps) {
                        *out += re * tap;
                    }
                    for (out, tap) in line_im[first..][..DELAY_TAPS].iter_mut().zip(taps) {
                        *out += im * tap;
                    }
                }
            }
        }
    }
}

impl Motion {
    fn new(
        shear: &Shear,
        lattice: &Lattice,
        tissue: &Columns,
        phantom_from_probe: &Pose,
        indentation: &Indentation,
    ) -> Self {
        let probe_from_phantom = phantom_from_probe.inverse();
        let down = probe_from_phantom * -sonoloop_types::Vector::z();
        let aside = probe_from_phantom * indentation.sideways();
        let count = (tissue.thickness_m() / lattice.depth_step_m).ceil() as usize + 1;
        let depth_m = |n: usize| (n as f64 + 0.5) * lattice.depth_step_m;
        Self {
            by_depth: (0..count).map(|n| indentation.by_depth(depth_m(n))).collect(),
            rows_per_m: [down.z / shear.row_step_m, aside.z / shear.row_step_m],
            lines_per_aside: aside.x - shear.lateral_slope * aside.z,
            elevation_per_aside: aside.y - shear.elevation_slope * aside.z,
        }
    }
}
