//! Rows that follow tissue that has moved.
//!
//! Where a probe presses, a column's scatterers no longer lie a row apart. Along one band of lines all of them are
//! pressed nearly alike, so the band's own rows are laid as far apart as scatterers are there: on those a column is
//! nearly straight again, and stretches of it are added as those of a column at rest. At the end the band goes over to the
//! rows of the grid.

use sonoloop_types::{Point, Pose, Vector};

use crate::{
    beam::Beam,
    elevation::{ElevationTable, STRIDE},
    fast::{turn, whole},
    instructions::{Instructions, nearest_f32, wide},
    lattice::Lattice,
    motion::Motion,
    shear::Shear,
    splat::BAND,
    tape::{BakedTape, DELAY_REACH, DELAY_TAPS},
    thinning::CLASSES,
};

/// Rows of the grid before its first and after its last that rows of a warp reach.
const MARGIN: usize = 8;
/// Rows of a warp that lie equally far apart.
const EVEN: usize = STRIDE;
/// Strides from one look at how far apart scatterers lie to the next, where the needle drags none.
const HELD: usize = 2;
/// Steps to the fixed point at the first row.
const FIRST_STEPS: usize = 4;
/// Strides beyond the last one that are known of, for vectors that run over.
pub const BEYOND: usize = 24;
/// Scatterers lie no closer and no farther than this many rows of the grid, as far as the warp follows them.
const CLOSEST: f64 = 0.25;
const FARTHEST: f64 = 2.0;

/// The warped rows of one band of lines.
#[derive(Default)]
pub struct Warp {
    /// Of each stride the depth where it begins, in rows of the grid, and how far its rows lie apart.
    starts: Vec<[f64; 2]>,
    /// That depth again, and of [`BEYOND`] strides after the last, as the next four are.
    pub row_of_stride: Vec<f32>,
    /// The slice there as the columns of each set see it, see [`ElevationTable`].
    pub decay: Vec<f32>,
    pub peak: [Vec<f32>; CLASSES],
    /// The same halfway to where the next one begins.
    pub middle_peak: [Vec<f32>; CLASSES],
    pub reach_m: [Vec<f32>; CLASSES],
    /// The class of the strain from each of those rows to the next, for scatterers that go one by one: others have their own.
    pub class: Vec<i32>,
    /// What the carrier turns by at each row from that of as many rows at rest.
    turn: Vec<[f32; 2]>,
    /// Where each goes over to rows of the grid.
    landing: Vec<Landing>,
    /// Where each row of the grid, from −[`MARGIN`] on, lies among them, and how far the next one from it.
    of_row: Vec<[f32; 2]>,
}

/// Rows of the grid that a warped row is spread over.
#[derive(Debug, Clone, Copy)]
struct Landing {
    /// The first of [`DELAY_TAPS`], which counts from `DELAY_REACH` before the margin.
    first: u32,
    /// Which of [`BakedTape::grid_filters`] spreads it.
    delay: u32,
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
    pub fn lay(
        &mut self,
        instructions: Instructions,
        press: &Press,
        shear: &Shear,
        elevation: &ElevationTable,
        line: usize,
    ) {
        let Self { starts, row_of_stride, decay, peak, middle_peak, reach_m, class, of_row, .. } = self;
        for values in [&mut *row_of_stride, decay] {
            values.clear();
        }
        [&mut *peak, middle_peak, reach_m].into_iter().flatten().for_each(Vec::clear);
        starts.clear();
        class.clear();
        of_row.clear();
        let x_m = shear.first_line_m + line as f64 * shear.line_pitch_m;
        let (first, end) = (-(MARGIN as f64), (shear.rows + MARGIN) as f64);
        let place = |row: f64| {
            let z_m = row.clamp(0.0, shear.rows as f64) * shear.row_step_m;
            Point::new(x_m + shear.lateral_slope * z_m, 0.0, z_m)
        };
        let mut row = first;
        let mut moved_m = Vector::zeros();
        for _ in 0..FIRST_STEPS {
            press.spacing(shear, place(row), &mut moved_m);
        }
        let held = if press.motion.drag().is_some() { 1 } else { HELD };
        let mut spacing = press.spacing(shear, place(row), &mut moved_m);
        let (mut known, mut growth) = (spacing, 0.0);
        while row < end {
            let of_held = class.len() % held;
            if of_held == 0 {
                // As it is in the middle of those strides.
                let middle = row + 0.5 * (held * EVEN) as f64 * spacing;
                let now = press.spacing(shear, place(middle), &mut moved_m);
                (growth, known) = ((now - known) / held as f64, now);
            }
            spacing = (known + (of_held as f64 - 0.5 * (held - 1) as f64) * growth).clamp(CLOSEST, FARTHEST);
            let span = EVEN as f64 * spacing;
            let [here, middle] = [0.0, 0.5].map(|part| elevation.place(row + part * span));
            row_of_stride.push(row as f32);
            decay.push(elevation.decay(here));
            for class in 0..shear.thinning.classes {
                peak[class].push(elevation.peak(class, here));
                middle_peak[class].push(elevation.peak(class, middle));
                reach_m[class].push(elevation.reach_m(class, here));
            }
            // Rows of the grid down to the next stride.
            let (rows, per_row) = ((EVEN * starts.len()) as f64, 1.0 / spacing);
            let mut past = first + of_row.len() as f64 - row;
            while past < span {
                of_row.push([(rows + past * per_row) as f32, 0.0]);
                past += 1.0;
            }
            class.push(BakedTape::class(press.beam, 1.0 - spacing / shear.rows_per_scatterer));
            starts.push([row, spacing]);
            row += span;
        }
        // None shows there.
        row_of_stride.extend((0..BEYOND).map(|beyond| (row + (beyond * EVEN) as f64 * spacing) as f32));
        let last = decay.last().copied().unwrap_or(0.0);
        decay.extend([last; BEYOND]);
        [&mut *peak, middle_peak].into_iter().flatten().for_each(|peak| peak.extend([0.0; BEYOND]));
        reach_m.iter_mut().for_each(|reach_m| reach_m.extend([-1.0; BEYOND]));
        for next in 1..of_row.len() {
            of_row[next - 1][1] = of_row[next][0] - of_row[next - 1][0];
        }
        of_row.pop();
        lay_rows(instructions, self, press.beam, shear);
    }

    /// Rows of the warp, a multiple of [`EVEN`].
    pub fn len(&self) -> usize {
        self.landing.len()
    }

    /// How many times [`EVEN`] rows those are.
    pub fn strides(&self) -> usize {
        self.class.len()
    }

    /// The slice at a place among the rows as columns of a set see it: how quickly it falls off, its peak, and how far it
    /// reaches.
    pub fn slice_at(&self, class: usize, warped: f32) -> [f32; 3] {
        let place = warped.clamp(0.0, (self.len() - 1) as f32) * (1.0 / EVEN as f32);
        let (stride, part) = (place as usize, place.fract());
        let between = |from: f32, to: f32, part: f32| from + part * (to - from);
        let (peak, middle) = (&self.peak[class], self.middle_peak[class][stride]);
        let peak = if part < 0.5 {
            between(peak[stride], middle, 2.0 * part)
        } else {
            between(middle, peak[stride + 1], 2.0 * part - 1.0)
        };
        let (decay, reach_m) = (&self.decay, &self.reach_m[class]);
        // As far as that of a stride that goes as one.
        [between(decay[stride], decay[stride + 1], part), peak, reach_m[stride].max(reach_m[stride + 1])]
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
        let last = (self.of_row.len() - 1) as f32;
        let whole = nearest_f32((from_first - 0.5).clamp(0.0, last));
        let [above, apart] = self.of_row[whole as usize];
        above + (from_first - whole as f32) * apart
    }
}

wide! {
    /// Lays the rows of all strides.
    fn lay_rows(warp: &mut Warp, beam: &Beam, shear: &Shear) {
        let Warp { starts, turn: row_turns, landing: landings, .. } = warp;
        let turns_per_row = beam.two_k_rad_m * shear.row_step_m / core::f64::consts::TAU;
        let rest = shear.rows_per_scatterer;
        let (sub_delays, per_row) = (beam.grain.sub_delays as i32, beam.grain.sub_delays as f32);
        row_turns.resize(EVEN * starts.len(), [0.0; 2]);
        landings.resize(EVEN * starts.len(), Landing { first: 0, delay: 0 });
        let (row_turns, landings) =
            (row_turns.as_chunks_mut::<EVEN>().0, landings.as_chunks_mut::<EVEN>().0);
        let strides = starts.iter().zip(row_turns).zip(landings);
        for (index, ((&[start, spacing], row_turns), landings)) in strides.enumerate() {
            let first = (EVEN * index) as f64;
            let (mut turns, mut rows) = ([0.0; EVEN], [0.0; EVEN]);
            for k in 0..EVEN {
                let row = start + k as i32 as f64 * spacing;
                let turns_here = turns_per_row * ((first + k as i32 as f64) * rest - row);
                turns[k] = (turns_here - whole(turns_here)) as f32;
                rows[k] = row as f32;
            }
            for k in 0..EVEN {
                row_turns[k] = turn(turns[k]);
            }
            for k in 0..EVEN {
                // Rounded to delays of the tape's; sub-delay s stands for the fraction s/S − ½.
                let delays = nearest_f32((rows[k] + MARGIN as f32) * per_row + per_row / 2.0);
                let first = nearest_f32((delays as f32 + 0.5) * (1.0 / per_row) - 0.5);
                landings[k] = Landing { first: first as u32, delay: (delays - first * sub_delays) as u32 };
            }
        }
    }
}

wide! {
    /// Lays the warped rows of a band, which are turned, on rows of the grid, which are replaced. Both hold, per row, `BAND`
    /// real parts, then as many imaginary ones.
    pub fn straighten(warp: &Warp, warped: &mut [f32], tape: &BakedTape, rows: &mut [f32]) {
        let warped = warped.as_chunks_mut::<{ 2 * BAND }>().0;
        let rows = rows.as_chunks_mut::<{ 2 * BAND }>().0;
        for (warped, &[cos, sin]) in warped.iter_mut().zip(&warp.turn) {
            let values = *warped;
            for i in 0..BAND {
                warped[i] = values[i] * cos - values[BAND + i] * sin;
            }
            for i in 0..BAND {
                warped[BAND + i] = values[BAND + i] * cos + values[i] * sin;
            }
        }
        // Warped rows that reach the row at hand.
        let (mut begin, mut end) = (0, 0);
        for (at, row) in rows.iter_mut().enumerate() {
            // Counts from before the margin.
            let at = (at + MARGIN + DELAY_REACH) as u32;
            while end < warped.len() && warp.landing[end].first <= at {
                end += 1;
            }
            while begin < end && warp.landing[begin].first + (DELAY_TAPS as u32) <= at {
                begin += 1;
            }
            let mut sum = [0.0; 2 * BAND];
            for (warped, landing) in warped[begin..end].iter().zip(&warp.landing[begin..end]) {
                let tap = tape.grid_filters[landing.delay as usize][(at - landing.first) as usize];
                for (sum, value) in sum.iter_mut().zip(warped) {
                    *sum += tap * value;
                }
            }
            *row = sum;
        }
    }
}
