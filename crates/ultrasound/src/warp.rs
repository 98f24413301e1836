//! Rows that follow tissue that has moved.
//!
//! Where a probe presses, a column's scatterers no longer lie a row apart. Along one band of lines all of them are
//! pressed nearly alike, so the band's own rows are laid as far apart as scatterers are there: on those a column is
//! nearly straight again, and runs of it are added as those of a column at rest. At the end the band goes over to the
//! rows of the grid.

use sonoloop_types::{Point, Pose, Vector};

use crate::{
    beam::Beam,
    elevation::{ElevationTable, STRIDE},
    fast::{nearest, turn},
    instructions::{nearest_f32, wide},
    lattice::Lattice,
    motion::Motion,
    runs::KNOT,
    shear::Shear,
    splat::BAND,
    tape::{BakedTape, DELAY_REACH, DELAY_TAPS},
};

/// Rows of the grid before its first and after its last that rows of a warp reach.
const MARGIN: usize = 8;
/// Rows of a warp that lie equally far apart.
const EVEN: usize = STRIDE;
const _: () = assert!(EVEN == KNOT);
/// Scatterers lie no closer and no farther than this many rows of the grid, as far as the warp follows them.
const CLOSEST: f64 = 0.25;
const FARTHEST: f64 = 2.0;

/// The warped rows of one band of lines.
#[derive(Default)]
pub struct Warp {
    /// Depth of each, in rows of the grid.
    row: Vec<f32>,
    /// The slice there, see [`crate::elevation::RowProfile`].
    pub decay: Vec<f32>,
    pub peak: Vec<f32>,
    /// The class of the strain of every [`EVEN`] rows.
    pub class: Vec<i32>,
    /// What the carrier's phase there takes from that of as many rows at rest.
    turn: Vec<[f32; 2]>,
    /// Where each row of the grid, from −[`MARGIN`] on, lies among them, and how far the next one from it.
    of_row: Vec<[f32; 2]>,
}

/// What a warp follows.
pub struct Press<'a> {
    pub beam: &'a Beam,
    pub lattice: &'a Lattice,
    pub phantom_from_probe: &'a Pose,
    pub motion: &'a Motion,
}

impl Press<'_> {
    /// How far the scatterers lie apart next to a place of the probe's frame, in rows. `moved_m` is how far tissue near by
    /// has moved, and then how far it has there: a step to the fixed point. What it leaves out the scatterers' own places
    /// put right.
    fn spacing(&self, shear: &Shear, place: Point, moved_m: &mut Vector) -> f64 {
        let rest = self.phantom_from_probe * place - *moved_m;
        let step_m = self.lattice.depth_step_m;
        let by_place = self.motion.by_place(rest.x, rest.y);
        let [above_m, below_m] = [0.5, -0.5].map(|steps| {
            let z_m = (rest.z + steps * step_m).min(steps * step_m - 0.5 * step_m);
            self.motion.displacement_of(by_place, Point::new(rest.x, rest.y, z_m))
        });
        *moved_m = (above_m + below_m) * 0.5;
        let apart_m = (below_m - above_m).dot(&(self.phantom_from_probe * Vector::z()));
        (shear.rows_per_scatterer + apart_m / shear.row_step_m).clamp(CLOSEST, FARTHEST)
    }
}

impl Warp {
    /// Lays the rows for the lines next to `line`.
    pub fn lay(&mut self, press: &Press, shear: &Shear, elevation: &ElevationTable, line: usize) {
        let Self { row: rows, decay, peak, class, turn: turns, of_row } = self;
        for values in [&mut *rows, decay, peak] {
            values.clear();
        }
        class.clear();
        turns.clear();
        of_row.clear();
        let turns_per_row = press.beam.two_k_rad_m * shear.row_step_m / core::f64::consts::TAU;
        let x_m = shear.first_line_m + line as f64 * shear.line_pitch_m;
        let (first, end) = (-(MARGIN as f64), (shear.rows + MARGIN) as f64);
        let mut row = first;
        let mut moved_m = Vector::zeros();
        while row < end {
            let z_m = row.clamp(0.0, shear.rows as f64) * shear.row_step_m;
            let place = Point::new(x_m + shear.lateral_slope * z_m, 0.0, z_m);
            let spacing = press.spacing(shear, place, &mut moved_m);
            class.push(BakedTape::class(press.beam, 1.0 - spacing / shear.rows_per_scatterer));
            for _ in 0..EVEN {
                let profile = elevation.profile(row);
                // Rows of the grid down to the next one.
                let mut past = first + of_row.len() as f64 - row;
                while past < spacing {
                    of_row.push([(rows.len() as f64 + past / spacing) as f32, 0.0]);
                    past += 1.0;
                }
                let turns_here = turns_per_row * (rows.len() as f64 * shear.rows_per_scatterer - row);
                turns.push(turn((turns_here - nearest(turns_here) as f64) as f32));
                rows.push(row as f32);
                decay.push(profile.decay);
                peak.push(profile.peak);
                row += spacing;
            }
        }
        for next in 1..of_row.len() {
            of_row[next - 1][1] = of_row[next][0] - of_row[next - 1][0];
        }
        of_row.pop();
    }

    /// Rows of the warp, a multiple of [`EVEN`].
    pub fn len(&self) -> usize {
        self.row.len()
    }

    /// First and last class of the strain.
    pub fn classes(&self) -> [i32; 2] {
        let [least, most] = [self.class.iter().min(), self.class.iter().max()];
        [least, most].map(|class| class.copied().unwrap_or(0))
    }

    /// Where a depth, in rows of the grid, lies among the warped rows; those at the ends go on as they are spaced there.
    #[inline(always)]
    pub fn at(&self, row: f32) -> f32 {
        let from_first = row + MARGIN as f32;
        let whole = nearest_f32(from_first - 0.5).clamp(0, self.of_row.len() as i32 - 1);
        let [above, apart] = self.of_row[whole as usize];
        above + (from_first - whole as f32) * apart
    }
}

wide! {
    /// Adds the warped rows of a band to rows of the grid, which are replaced. Both hold, per row, `BAND` real parts, then
    /// as many imaginary ones.
    pub fn straighten(warp: &Warp, warped: &[f32], tape: &BakedTape, rows: &mut [f32]) {
        rows.fill(0.0);
        let warped = warped.as_chunks::<{ 2 * BAND }>().0;
        let rows = rows.as_chunks_mut::<{ 2 * BAND }>().0;
        let (sub_delays, count) = (tape.sub_delays as u32, tape.sub_delays as f32);
        for ((warped, &row), &[cos, sin]) in warped.iter().zip(&warp.row).zip(&warp.turn) {
            // Rounded to delays of the tape's; sub-delay s stands for the fraction s/S − ½.
            let delays = ((row + MARGIN as f32) * count + count / 2.0 + 0.5) as u32;
            let first = (delays / sub_delays) as usize;
            let taps = &tape.grid_filters[(delays % sub_delays) as usize];
            let mut turned = [0.0; 2 * BAND];
            for i in 0..BAND {
                turned[i] = warped[i] * cos - warped[BAND + i] * sin;
            }
            for i in 0..BAND {
                turned[BAND + i] = warped[BAND + i] * cos + warped[i] * sin;
            }
            // What lies in the grid of the rows from `first` on, which counts from before the margin.
            const BEFORE: usize = MARGIN + DELAY_REACH;
            let skipped = BEFORE.saturating_sub(first).min(DELAY_TAPS);
            let end = (first + DELAY_TAPS).saturating_sub(BEFORE).min(rows.len());
            let begin = (first + skipped - BEFORE).min(end);
            for (row, tap) in rows[begin..end].iter_mut().zip(&taps[skipped..]) {
                for (out, value) in row.iter_mut().zip(&turned) {
                    *out += tap * value;
                }
            }
        }
    }
}
