//! Rows that follow a press.
//!
//! Where a probe presses, a column's scatterers no longer lie a row apart. Along one band of lines all of them are
//! pressed nearly alike, so their own rows are laid as far apart as scatterers are there: on those a column is nearly
//! straight again. Each such row is cut into a few, near enough for two of them to stand for a scatterer between, and at
//! the end the band goes over to the rows of the grid.

use sonoloop_types::{Point, Pose, Vector};

use crate::{
    elevation::ElevationTable,
    instructions::{nearest_f32, wide},
    lattice::Lattice,
    motion::Motion,
    shear::Shear,
    splat::BAND,
    tape::{BakedTape, DELAY_REACH, DELAY_TAPS},
};

/// Rows of the grid before its first and after its last that rows of a warp reach.
pub const MARGIN: usize = 24;
/// Rows of a warp that lie equally far apart.
const EVEN: usize = 8;
/// Scatterers lie no closer and no farther than this many rows of the grid, as far as the warp follows them.
const CLOSEST: f64 = 0.25;
const FARTHEST: f64 = 2.0;
/// Two rows a distance h apart that share a scatterer add h²·g(1 − g)/2 of the pulse's second derivative to it, with g the
/// share of one of them: in the mean over g a twelfth of the second difference, which is taken off.
const SHARPEN: f32 = 1.0 / 12.0;

/// The warped rows of one band of lines.
#[derive(Default)]
pub struct Warp {
    /// Depth of each, in rows of the grid.
    pub row: Vec<f32>,
    /// Warped rows per row of the grid, there.
    pub per_row: Vec<f32>,
    /// The slice there, see [`crate::elevation::RowProfile`].
    pub decay: Vec<f32>,
    pub peak: Vec<f32>,
    pub reach_m: Vec<f32>,
    /// Where each row of the grid, from −[`MARGIN`] on, lies among them.
    of_row: Vec<f32>,
}

/// What a warp follows.
pub struct Press<'a> {
    pub lattice: &'a Lattice,
    pub phantom_from_probe: &'a Pose,
    pub motion: &'a Motion,
    /// Rows of the grid per metre of way down and aside.
    pub rows_per_m: [f64; 2],
}

impl Press<'_> {
    /// How far the scatterers lie apart next to a place of the probe's frame, in rows. `moved_m` is how far tissue near by
    /// has moved, and then how far it has there: a step to the fixed point. What it leaves out the scatterers' own places
    /// put right.
    fn spacing(&self, place: Point, moved_m: &mut Vector) -> f64 {
        let rest = self.phantom_from_probe * place - *moved_m;
        let step_m = self.lattice.depth_step_m;
        let depth_m = (-rest.z).max(step_m / 2.0);
        let by_place = self.motion.by_place(rest.x, rest.y);
        let [above, below] = [-0.5, 0.5].map(|steps| self.motion.by_depth(depth_m + steps * step_m));
        let moves = [0, 1].map(|i| by_place[i] * self.rows_per_m[i] * (below[i] - above[i]));
        let [down_m, aside_m] = [0, 1].map(|i| by_place[i] * 0.5 * (above[i] + below[i]));
        *moved_m = self.motion.sideways() * aside_m - Vector::z() * down_m;
        (1.0 + moves[0] + moves[1]).clamp(CLOSEST, FARTHEST)
    }
}

impl Warp {
    /// Lays the rows for the lines next to `line`.
    pub fn lay(&mut self, press: &Press, shear: &Shear, elevation: &ElevationTable, line: usize) {
        let Self { row: rows, per_row, decay, peak, reach_m, of_row } = self;
        for values in [&mut *rows, per_row, decay, peak, reach_m] {
            values.clear();
        }
        of_row.clear();
        let x_m = shear.first_line_m + line as f64 * shear.line_pitch_m;
        let (first, end) = (-(MARGIN as f64), (shear.rows + MARGIN) as f64);
        let mut row = first;
        let mut moved_m = Vector::zeros();
        while row < end {
            let z_m = row.clamp(0.0, shear.rows as f64) * shear.row_step_m;
            let place = Point::new(x_m + shear.lateral_slope * z_m, 0.0, z_m);
            let spacing = press.spacing(place, &mut moved_m);
            let per = (1.0 / spacing) as f32;
            for _ in 0..EVEN {
                let profile = elevation.profile(row);
                // Rows of the grid down to the next one.
                let mut past = first + of_row.len() as f64 - row;
                while past < spacing {
                    of_row.push((rows.len() as f64 + past / spacing) as f32);
                    past += 1.0;
                }
                rows.push(row as f32);
                per_row.push(per);
                decay.push(profile.decay);
                peak.push(profile.peak);
                reach_m.push(profile.reach_m);
                row += spacing;
            }
        }
    }

    /// Rows of the warp.
    pub fn len(&self) -> usize {
        self.row.len()
    }

    /// Where a depth, in rows of the grid, lies among the warped rows; not a number where there are none.
    #[inline(always)]
    pub fn at(&self, row: f32) -> f32 {
        let from_first = row + MARGIN as f32;
        let whole = nearest_f32(from_first - 0.5);
        // What is negative, or no number, becomes an index beyond all.
        match self.of_row.get(whole as usize..).and_then(<[f32]>::first_chunk) {
            Some([above, below]) => above + (from_first - whole as f32) * (below - above),
            None => f32::NAN,
        }
    }

    /// [`Self::at`] of several.
    pub fn warp(&self, rows: &[f32], warped: &mut Vec<f32>) {
        warped.clear();
        warped.extend(rows.iter().map(|&row| self.at(row)));
    }
}

wide! {
    /// Adds the warped rows of a band, each cut into `parts`, to rows of the grid, which are replaced. Both hold, per row,
    /// `BAND` real parts, then as many imaginary ones; `warped` has first the rows themselves, then those a part farther
    /// down, and so on.
    pub fn straighten(warp: &Warp, warped: &[f32], parts: usize, tape: &BakedTape, rows: &mut [f32]) {
        rows.fill(0.0);
        let warped = warped.as_chunks::<{ 2 * BAND }>().0;
        let rows = rows.as_chunks_mut::<{ 2 * BAND }>().0;
        let len = warp.len();
        let at = |place: usize| &warped[place % parts * len + place / parts];
        let (sub_delays, count) = (tape.sub_delays as u32, tape.sub_delays as f32);
        for place in 1..(len - 1) * parts - 1 {
            let (index, part) = (place / parts, place % parts);
            let apart = warp.row[index + 1] - warp.row[index];
            let row = warp.row[index] + apart * (part as f32 / parts as f32);
            // Rounded to delays of the tape's; sub-delay s stands for the fraction s/S − ½.
            let delays = ((row + MARGIN as f32) * count + count / 2.0 + 0.5) as u32;
            let first = (delays / sub_delays) as usize;
            let taps = &tape.delay_filters[(delays % sub_delays) as usize];
            let (above, here, below) = (at(place - 1), at(place), at(place + 1));
            let mut sharp = [0.0; 2 * BAND];
            for (sharp, ((above, here), below)) in sharp.iter_mut().zip(above.iter().zip(here).zip(below)) {
                *sharp = here + SHARPEN * ((here - above) + (here - below));
            }
            // What lies in the grid of the rows from `first` on, which counts from before the margin.
            const BEFORE: usize = MARGIN + DELAY_REACH;
            let skipped = BEFORE.saturating_sub(first).min(DELAY_TAPS);
            let end = (first + DELAY_TAPS).saturating_sub(BEFORE).min(rows.len());
            let begin = (first + skipped - BEFORE).min(end);
            for (row, tap) in rows[begin..end].iter_mut().zip(&taps[skipped..]) {
                for (out, value) in row.iter_mut().zip(&sharp) {
                    *out += tap * value;
                }
            }
        }
    }
}
