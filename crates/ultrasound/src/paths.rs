//! What sound meets on its way between the array and each place of the picture: loss, delay, and what is in
//! the way.
//!
//! A place is seen by an aperture of depth over F#, cut into directions that are the same everywhere. Loss and
//! delay are summed along each direction by marching down, and the one-way amplitude is the aperture's mean of
//! exp(−loss): so a shadow has a penumbra and fills with depth, and blind elements dim what they would have
//! seen. Sound goes both ways through the same paths; the field takes the square.

use sonoloop_types::{Point, Pose, ProbeSpec, Slice, Vector};

use crate::{
    beam::{Beam, pulse_loss_np},
    columns::{Columns, Layer},
    contact::Contact,
    fast::{NEPER_PER_POWER_DB, exp_minus, power_db},
    instructions::{Instructions, wide},
    lattice::Lattice,
    march::{DIRECTIONS, March},
    motion::Motion,
    needle::Shaft,
    occlusion::Occlusion,
};

/// Pixels between knots of the map, across and down, and how far each pixel lies between two of them.
pub const ACROSS: usize = 4;
const SHARES: [f32; ACROSS] = [0.0, 0.25, 0.5, 0.75];
const DOWN: usize = 4;
/// Knots from one to the next at which it is known how far tissue has moved: 0.8 mm in a picture 48 mm deep.
const COARSE: usize = 2;
/// A place is never drawn farther from its depth than this; the axial filter has no more rows at hand.
pub const MAX_DELAY_M: f64 = 2.5e-3;
/// The centre frequency never falls below this share of the transmitted one: the spectrum is no Gaussian then.
const MIN_FREQUENCY_SHARE: f64 = 0.65;

/// The plane that the map covers: displayed columns and rows.
#[derive(Debug, Clone, Copy)]
pub struct Plane {
    pub columns: usize,
    pub rows: usize,
    pub first_x_m: f64,
    pub spacing_m: f64,
}

impl Plane {
    pub fn knots_across(&self) -> usize {
        self.columns.div_ceil(ACROSS) + 1
    }

    pub fn knots_down(&self) -> usize {
        self.rows / DOWN + 2
    }

    /// How many knots of every [`COARSE`]th there are across and down, the last of them at or beyond the others' last.
    fn coarse(&self) -> (usize, usize) {
        (self.knots_across().div_ceil(COARSE) + 1, self.knots_down().div_ceil(COARSE) + 1)
    }

    pub fn step_m(&self) -> f64 {
        DOWN as f64 * self.spacing_m
    }

    pub fn knot_x_m(&self, i: usize) -> f64 {
        self.first_x_m + (i * ACROSS) as f64 * self.spacing_m
    }
}

/// Maps by knot, rows of knots from the face down.
pub struct Paths {
    plane: Plane,
    /// σ of the pulse's spectrum over its centre frequency, squared; 0 keeps the frequency.
    spread: f32,
    /// Two-way amplitude by displayed depth, one row of pixel columns per row of knots.
    amplitude: Vec<f32>,
    /// Displayed minus true depth, and two-way amplitude, by true depth.
    delay_m: Vec<f32>,
    two_way: Vec<f32>,
    /// Two-way amplitude without the needle's shadow; empty when there is none.
    unshaded: Vec<f32>,
    /// The same two by displayed depth.
    shown_delay_m: Vec<f32>,
    shown_two_way: Vec<f32>,
    /// Transmitted over received centre frequency.
    stretch: Vec<f32>,
    /// True when some delay is not zero.
    pub any_delay: bool,
    pub contact: Contact,
    occlusion: Occlusion,
    /// One-way transmission, and delay, of the step above each knot.
    step_transmission: Vec<f32>,
    step_delay_m: Vec<f32>,
    /// By how far tissue has moved to every [`COARSE`]th knot, along each axis: down one column of knots, then the next.
    moved_m: [Vec<f64>; 3],
    steps: Steps,
    march: March,
}

impl Paths {
    pub fn new(beam: &Beam, probe: &ProbeSpec, plane: Plane) -> Self {
        let knots = plane.knots_across() * plane.knots_down();
        let zeros = || vec![0.0; knots];
        Self {
            plane,
            spread: if probe.effects.downshift { beam.relative_spread_squared() } else { 0.0 },
            amplitude: vec![0.0; plane.knots_down() * plane.columns],
            delay_m: zeros(),
            two_way: zeros(),
            unshaded: Vec::new(),
            shown_delay_m: zeros(),
            shown_two_way: zeros(),
            stretch: vec![1.0; knots],
            any_delay: false,
            contact: Contact::new(probe),
            occlusion: Occlusion::new(probe),
            step_transmission: zeros(),
            step_delay_m: zeros(),
            moved_m: Default::default(),
            steps: Steps::default(),
            march: March::default(),
        }
    }

    /// Fills the maps for one needle and contact, after [`Self::sample`]. `shaft` is the needle's.
    pub fn build(&mut self, instructions: Instructions, beam: &Beam, slice: &Slice, shaft: &Shaft) {
        self.contact.set(slice, &self.plane, beam);
        self.occlusion.trace(beam, slice, shaft, &self.plane);
        self.unshaded.clear();
        if self.occlusion.any() {
            self.unshaded.resize(self.two_way.len(), 0.0);
        }
        self.march.start(self.plane.knots_across());
        march_down(instructions, self, beam);
        self.show();
    }

    /// Where every second knot's tissue has moved from, by a fixed-point step from where that of the one above had.
    fn sample_motion(&mut self, phantom_from_probe: &Pose, motion: &Motion) {
        let step_m = self.plane.step_m();
        let down_m = phantom_from_probe * Vector::z() * (COARSE as f64 * step_m);
        let (across, rows) = self.plane.coarse();
        self.moved_m.iter_mut().for_each(|moved_m| moved_m.resize(across * rows, 0.0));
        for i in 0..across {
            let x_m = self.plane.knot_x_m(COARSE * i);
            let mut point = phantom_from_probe * Point::new(x_m, 0.0, step_m / 2.0);
            let mut moved_m = Vector::zeros();
            for row in 0..rows {
                moved_m = motion.displacement_m(point - moved_m);
                for (all, moved_m) in self.moved_m.iter_mut().zip(moved_m.iter()) {
                    all[i * rows + row] = *moved_m;
                }
                point += down_m;
            }
        }
    }

    /// Loss and delay of every step, read off the tissue's columns; none without a pose.
    pub fn sample(
        &mut self,
        instructions: Instructions,
        lattice: &Lattice,
        tissue: &Columns,
        phantom_from_probe: Option<&Pose>,
        motion: Option<&Motion>,
    ) {
        let across = self.plane.knots_across();
        // Losses until all are known.
        self.step_transmission.fill(0.0);
        self.step_delay_m.fill(0.0);
        let Some(phantom_from_probe) = phantom_from_probe else {
            self.step_transmission.fill(1.0);
            return;
        };
        if let Some(motion) = motion {
            self.sample_motion(phantom_from_probe, motion);
        }
        let step_m = self.plane.step_m();
        let down = phantom_from_probe * Vector::z();
        // Scatterers of a column that one step passes; a step nearly along the layers counts as one point.
        let per_step = (-down.z * step_m / lattice.depth_step_m).max(1e-3) as f32;
        let length_m = step_m as f32 / per_step;
        let down_m = down * step_m;
        let mut steps = core::mem::take(&mut self.steps);
        let moved_m = motion.map(|_| &self.moved_m);
        let (_, rows) = self.plane.coarse();
        for i in 0..across {
            let first = phantom_from_probe * Point::new(self.plane.knot_x_m(i), 0.0, step_m / 2.0);
            steps.count = self.plane.knots_down() - 1;
            let beside = moved_m.map(|moved_m| {
                [i / COARSE, i.div_ceil(COARSE)]
                    .map(|i| [0, 1, 2].map(|axis| &moved_m[axis][i * rows..][..rows]))
            });
            place(instructions, &mut steps, lattice, [first.coords, down_m], beside);
            let mut column = None;
            let mut layers: &[Layer] = &[];
            let mut top = 0.0;
            for row in 1..self.plane.knots_down() {
                let indices = [steps.ix[row - 1], steps.iy[row - 1]];
                let from = steps.number[row - 1] - per_step / 2.0;
                let to = from + per_step;
                if column != Some(indices) {
                    column = Some(indices);
                    layers = tissue.layers(tissue.get(indices[0], indices[1]));
                    top = 0.0;
                }
                // What is above is not met again by going down.
                while let [layer, below @ ..] = layers
                    && (layer.end as f32) < from - per_step
                {
                    (top, layers) = (layer.end as f32, below);
                }
                let (mut loss, mut delay, mut entries) = (0.0, 0.0, 0.0);
                let mut start = top;
                for &layer in layers {
                    if start > to {
                        break;
                    }
                    let end = layer.end as f32;
                    let filling = tissue.filling(layer);
                    let passed_m = (end.min(to) - start.max(from)).max(0.0) * length_m;
                    loss += passed_m * filling.loss_np_m;
                    delay += passed_m * filling.delay;
                    // What a surface reflects is lost one step below it, so that its own echo is not dimmed.
                    if from - per_step < start && start <= to - per_step {
                        entries += filling.entry_loss_np;
                    }
                    start = end;
                }
                self.step_transmission[row * across + i] = loss + entries;
                self.step_delay_m[row * across + i] = delay;
            }
        }
        self.steps = steps;
        self.step_transmission.iter_mut().for_each(|loss| *loss = exp_minus(*loss));
    }

    /// Means over the aperture at one row of knots.
    #[inline(always)]
    fn finish_row(&mut self, beam: &Beam, row: usize) {
        let Self { plane, march, contact, occlusion, spread, .. } = self;
        let across = plane.knots_across();
        let depth_m = row as f64 * plane.step_m();
        march.clear_sums();
        let wanted_m = beam.wanted_aperture_m(depth_m);
        occlusion.reach_row(row, beam, plane);
        for direction in 0..DIRECTIONS {
            march.weigh(direction, plane, wanted_m, beam.half_aperture_m);
            march.transmit(direction);
            if contact.any_weaker {
                contact.shade(direction, plane, wanted_m, &mut march.part);
            }
            if occlusion.any() {
                march.sum_unshaded();
            }
            if occlusion.begun() {
                occlusion.shade(direction, row, beam, depth_m, &mut march.part);
            }
            march.sum(direction);
        }
        march.divide();
        let (spread, most) = (*spread, (1.0 - MIN_FREQUENCY_SHARE) as f32);
        let knots = row * across..(row + 1) * across;
        for (delay_m, mean_m) in self.delay_m[knots.clone()].iter_mut().zip(&march.mean_delay_m) {
            *delay_m = mean_m.clamp(-MAX_DELAY_M as f32, MAX_DELAY_M as f32);
        }
        let (stretch, two_way) = (&mut self.stretch[knots.clone()], &mut self.two_way[knots]);
        receive(spread, most, &march.clear, &march.amplitude, stretch, two_way);
        // Without the needle's own shadow the amplitude differs by a factor, here and there.
        let unshaded = self.unshaded.get_mut(row * across..).unwrap_or_default();
        let sums = march.unshaded.iter().zip(&march.amplitude).zip(&self.two_way[row * across..]);
        for (out, ((unshaded, amplitude), two_way)) in unshaded.iter_mut().zip(sums) {
            let more = if *amplitude > 0.0 { unshaded / amplitude } else { 1.0 };
            *out = two_way * more * more;
        }
    }

    /// Turns what is known by true depth into what display rows need.
    fn show(&mut self) {
        let (across, down) = (self.plane.knots_across(), self.plane.knots_down());
        let step_m = self.plane.step_m() as f32;
        self.any_delay = self.delay_m.iter().any(|&d| d != 0.0);
        if self.any_delay {
            for i in 0..across {
                // Displayed depth grows with the true one, as no material is infinitely fast.
                let shown = |row: usize| row as f32 * step_m + self.delay_m[row * across + i];
                let (mut row, mut from, mut to) = (0, shown(0), shown(1));
                for target in 0..down {
                    let wanted = target as f32 * step_m;
                    while row + 2 < down && to < wanted {
                        row += 1;
                        (from, to) = (to, shown(row + 1));
                    }
                    let share = ((wanted - from) / (to - from).max(1e-9)).clamp(0.0, 1.0);
                    let [above, below] = [row, row + 1].map(|row| row * across + i);
                    let between = |map: &[f32]| map[above] + share * (map[below] - map[above]);
                    self.shown_delay_m[target * across + i] = between(&self.delay_m);
                    self.shown_two_way[target * across + i] = between(&self.two_way);
                }
            }
        } else {
            self.shown_two_way.copy_from_slice(&self.two_way);
        }
        let columns = self.plane.columns;
        let knots = self.shown_two_way.chunks_exact(across);
        for (row, knots) in self.amplitude.chunks_exact_mut(columns).zip(knots) {
            for (part, ends) in row.chunks_mut(ACROSS).zip(knots.windows(2)) {
                for (a, share) in part.iter_mut().zip(SHARES) {
                    *a = ends[0] + (ends[1] - ends[0]) * share;
                }
            }
        }
    }

    /// Amplitudes at the knots above and below a display row, and how far it lies between them.
    pub fn row(&self, row: usize) -> (&[f32], &[f32], f32) {
        let columns = self.plane.columns;
        let (knot, below) = (row / DOWN, row % DOWN);
        let (above, rest) = self.amplitude[knot * columns..].split_at(columns);
        (above, &rest[..columns], below as f32 / DOWN as f32)
    }

    /// Displayed minus true depth at every second knot across from the second one on, for a display row; 8 pixels apart.
    pub fn delays_of_row(&self, row: usize, out: &mut [f32]) {
        let across = self.plane.knots_across();
        let (knot, below) = (row / DOWN, row % DOWN);
        let share = below as f32 / DOWN as f32;
        let rows = &self.shown_delay_m[knot * across..][..2 * across];
        for (block, out) in out.iter_mut().enumerate() {
            let i = (2 * block + 1).min(across - 1);
            *out = rows[i] + share * (rows[across + i] - rows[i]);
        }
    }

    /// Displayed minus true depth of a place of the plane.
    pub fn delay_m(&self, x_m: f64, z_m: f64) -> f64 {
        if self.any_delay { self.at(&self.delay_m, x_m, z_m) } else { 0.0 }
    }

    /// By how much echoes of the needle must be stronger at a place to be drawn as if its shadow were not on them.
    pub fn unshade(&self, x_m: f64, z_m: f64) -> f64 {
        const MOST: f64 = 50.0;
        if self.unshaded.is_empty() {
            return 1.0;
        }
        let shaded = self.at(&self.two_way, x_m, z_m);
        (self.at(&self.unshaded, x_m, z_m) / shaded.max(1e-12)).clamp(1.0, MOST)
    }

    /// Transmitted over received centre frequency at a place: by so much the lateral beam is wider.
    pub fn stretch(&self, x_m: f64, z_m: f64) -> f64 {
        if self.spread == 0.0 { 1.0 } else { self.at(&self.stretch, x_m, z_m) }
    }

    /// The same in the middle between neighbouring knots across, at the row of knots next to a depth.
    pub fn stretches_at(&self, z_m: f64) -> impl Iterator<Item = f32> {
        let across = self.plane.knots_across();
        let row = ((z_m / self.plane.step_m() + 0.5) as usize).min(self.plane.knots_down() - 1);
        self.stretch[row * across..][..across].windows(2).map(|knots| (knots[0] + knots[1]) / 2.0)
    }

    /// The largest [`Self::stretch`] that can be.
    pub fn most_stretch() -> f64 {
        1.0 / MIN_FREQUENCY_SHARE
    }

    fn at(&self, map: &[f32], x_m: f64, z_m: f64) -> f64 {
        let across = self.plane.knots_across();
        let knot = |v: f64, count: usize| {
            let v = v.clamp(0.0, (count - 1) as f64 - 1e-6);
            (v as usize, (v - v as usize as f64) as f32)
        };
        let (i, fx) = knot((x_m - self.plane.first_x_m) / (ACROSS as f64 * self.plane.spacing_m), across);
        let (j, fz) = knot(z_m / self.plane.step_m(), self.plane.knots_down());
        let rows = &map[j * across..][..2 * across];
        let along = |row: &[f32]| row[i] + fx * (row[i + 1] - row[i]);
        let (above, below) = (along(&rows[..across]), along(&rows[across..]));
        f64::from(above + fz * (below - above))
    }
}

/// Stretch and two-way amplitude, where paths alone let so much through, and with what stands in the way.
#[inline(always)]
fn receive(
    spread: f32,
    most: f32,
    clear: &[f32],
    amplitude: &[f32],
    stretch: &mut [f32],
    two_way: &mut [f32],
) {
    let out = stretch.iter_mut().zip(two_way);
    for ((stretch, two_way), (clear, amplitude)) in out.zip(clear.iter().zip(amplitude)) {
        let loss_np = -power_db(*clear) * NEPER_PER_POWER_DB;
        let fall = 2.0 * spread * loss_np;
        *stretch = 1.0 / (1.0 - if fall < most { fall } else { most });
        // Low frequencies get farther than the centre one: see `pulse_loss_np`.
        let gain_np = loss_np - pulse_loss_np(loss_np, spread);
        let one_way = amplitude / exp_minus(gain_np);
        *two_way = one_way * one_way;
    }
}

/// Where the middles of the steps down one column of knots lie in the lattice.
#[derive(Default)]
struct Steps {
    count: usize,
    /// At rest, phantom frame.
    rest_m: [Vec<f64>; 3],
    ix: Vec<i32>,
    iy: Vec<i32>,
    /// Number of the scatterer there, in fractions.
    number: Vec<f32>,
}

wide! {
    /// Finds where the steps lie, from the first one on each farther by the same way, whose tissue has moved as that of the
    /// knots on both sides has.
    fn place(
        steps: &mut Steps,
        lattice: &Lattice,
        first_and_way_m: [Vector; 2],
        beside: Option<[[&[f64]; 3]; 2]>,
    ) {
        let Steps { count, rest_m, ix, iy, number } = steps;
        let [first_m, way_m] = first_and_way_m;
        let count = *count;
        for (axis, rest_m) in rest_m.iter_mut().enumerate() {
            rest_m.resize(count, 0.0);
            let (first_m, way_m) = (first_m[axis], way_m[axis]);
            for (row, rest_m) in rest_m.iter_mut().enumerate() {
                *rest_m = first_m + row as i32 as f64 * way_m;
            }
            let Some([left, right]) = &beside else { continue };
            let (left, right) = (left[axis], right[axis]);
            for (k, rest_m) in rest_m.chunks_mut(COARSE).enumerate() {
                let here = left[k] + right[k];
                let below = left[k + 1] + right[k + 1];
                rest_m[0] -= 0.5 * here;
                if let Some(rest_m) = rest_m.get_mut(1) {
                    *rest_m -= 0.25 * (here + below);
                }
            }
        }
        ix.resize(count, 0);
        iy.resize(count, 0);
        number.resize(count, 0.0);
        let [x_m, y_m, z_m] = rest_m;
        let (ix, iy, number) = (&mut ix[..count], &mut iy[..count], &mut number[..count]);
        let (x_m, y_m, z_m) = (&x_m[..count], &y_m[..count], &z_m[..count]);
        for i in 0..count {
            [ix[i], iy[i]] = lattice.nearest(x_m[i], y_m[i]);
        }
        for i in 0..count {
            number[i] = lattice.index_at(z_m[i]) as f32;
        }
    }
}

wide! {
    /// Row of knots by row of knots, from the face down.
    fn march_down(paths: &mut Paths, beam: &Beam) {
        let across = paths.plane.knots_across();
        for row in 0..paths.plane.knots_down() {
            if row > 0 {
                let steps = row * across..(row + 1) * across;
                let Paths { march, step_transmission, step_delay_m, .. } = &mut *paths;
                march.step(beam, &step_transmission[steps.clone()], &step_delay_m[steps]);
            }
            paths.finish_row(beam, row);
        }
    }
}
