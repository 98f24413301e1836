//! The noise that all columns share, and its form for one tilt.

use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;

use crate::{
    beam::Beam,
    fast::nearest,
    instructions::{Instructions, nearest_f32, wide},
    lattice::TAPE_LENGTH,
    shear::Shear,
};

/// Taps of a delay filter, centred.
pub const DELAY_TAPS: usize = 9;
pub const DELAY_REACH: usize = DELAY_TAPS / 2;
/// Samples whose carrier is one turn of that of others: products of two short tables are exact to rounding, far cheaper
/// than a sine per sample, and stay in the caches.
const STRETCH: usize = 64;
/// Rows that columns may have at least; strides that are added together read no farther past the tape's end.
const LEAST_ROWS: usize = 528;
const _: () = assert!(LEAST_ROWS >= crate::block::ROWS);
/// Samples filtered together.
const BLOCK: usize = 16;

pub fn product([a, b]: [f64; 2], [c, d]: [f64; 2]) -> [f64; 2] {
    [a * c - b * d, a * d + b * c]
}

/// Unit-power complex Gaussian samples by Box–Muller.
pub fn gaussian_tape(seed: u64, stream: u64, length: usize) -> Vec<[f32; 2]> {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    rng.set_stream(stream);
    let unit = 1.0 / (1u64 << 53) as f64;
    let mut draw = || (rng.next_u64() >> 11) as f64 * unit;
    (0..length)
        .map(|_| {
            let radius = (-libm::log(1.0 - draw())).sqrt();
            let (sin, cos) = libm::sincos(core::f64::consts::TAU * draw());
            [(radius * cos) as f32, (radius * sin) as f32]
        })
        .collect()
}

/// The tape times its carrier exp(−i·2k·q·step), delayed by each multiple of 1/`sub_delays` row.
///
/// The carrier is put in before the delay filters because they are low-pass around it. It depends on the tilt
/// (a row step is the lattice step times the cosine), so the tape is baked again when the cosine changes.
pub struct BakedTape {
    /// Real and imaginary parts of the unmodulated tape.
    raw: [Vec<f32>; 2],
    /// From one scatterer to the next, and from one row of the grid.
    row_step_m: f64,
    grid_step_m: f64,
    lateral_slope: f64,
    /// exp(+i·2k·q·step) for q below [`STRETCH`], and for its multiples from −`DELAY_REACH` on.
    fine: Vec<[f64; 2]>,
    coarse: Vec<[f64; 2]>,
    /// The raw tape times its carrier, `DELAY_REACH` samples longer at both ends.
    modulated: [Vec<f32>; 2],
    /// `sub_delays` stretches of `stride` samples, each packed by [`pack`].
    pub samples: Vec<u32>,
    /// Samples from one delay to the next.
    pub stride: usize,
    /// Delays per row step.
    pub sub_delays: usize,
    /// What spreads a scatterer over rows, by delay: taps from `DELAY_REACH` rows above on.
    pub delay_filters: Vec<[f32; DELAY_TAPS]>,
    /// The same on rows of the grid, where they are not a scatterer apart.
    pub grid_filters: Vec<[f32; DELAY_TAPS]>,
    /// The tape as it is in strained tissue, where rows, and with them scatterers, lie closer: by class from `first_class`
    /// on, for each of them `sub_delays`·`stride` samples. Its rows are to be turned by 2k times what the strain moves them
    /// by: what a delay filter takes from rows beside is turned back by as much as it lies off. See [`Self::strain`].
    pub strained: Vec<u32>,
    /// As `delay_filters`, by class: real and imaginary parts.
    strained_filters: Vec<Vec<[[f32; 2]; DELAY_TAPS]>>,
    pub first_class: i32,
}

impl BakedTape {
    pub fn new(seed: u64) -> Self {
        let tape = gaussian_tape(seed, 1, TAPE_LENGTH);
        let part = |part: usize| tape.iter().map(|v| v[part]).collect();
        Self {
            raw: [part(0), part(1)],
            row_step_m: 0.0,
            grid_step_m: 0.0,
            grid_filters: Vec::new(),
            lateral_slope: 0.0,
            fine: Vec::new(),
            coarse: Vec::new(),
            modulated: [Vec::new(), Vec::new()],
            samples: Vec::new(),
            stride: 0,
            sub_delays: 0,
            delay_filters: Vec::new(),
            strained: Vec::new(),
            strained_filters: Vec::new(),
            first_class: 0,
        }
    }

    /// Sample of the unmodulated tape.
    pub fn raw(&self, index: usize) -> [f32; 2] {
        let index = index % TAPE_LENGTH;
        [self.raw[0][index], self.raw[1][index]]
    }

    /// exp(+i·2k·q·step), q below the tape's length.
    #[inline]
    pub fn carrier(&self, q: usize) -> [f64; 2] {
        let sample = q + DELAY_REACH;
        product(self.coarse[sample / STRETCH], self.fine[sample % STRETCH])
    }

    /// Prepares the tape for the columns of a grid, but for the samples.
    pub fn bake(&mut self, beam: &Beam, shear: &Shear) {
        let &Shear { row_step_m: grid_step_m, lateral_slope, rows, rows_per_scatterer, .. } = shear;
        let row_step_m = grid_step_m * rows_per_scatterer;
        let stride = TAPE_LENGTH + rows.max(LEAST_ROWS);
        if self.stride >= stride
            && self.row_step_m == row_step_m
            && self.grid_step_m == grid_step_m
            && self.lateral_slope == lateral_slope
        {
            return;
        }
        (self.row_step_m, self.lateral_slope, self.stride) = (row_step_m, lateral_slope, stride);
        self.grid_step_m = grid_step_m;
        self.grid_filters = delay_filters(beam, grid_step_m, lateral_slope);
        self.modulate(beam.two_k_rad_m * row_step_m);
        self.strained.clear();
        self.strained_filters.clear();
        self.delay_filters = delay_filters(beam, row_step_m, lateral_slope);
        self.sub_delays = self.delay_filters.len();
        self.samples.clear();
    }

    /// Fills in the samples for tissue at rest. The tape was baked.
    pub fn rest(&mut self, instructions: Instructions) {
        if !self.samples.is_empty() {
            return;
        }
        let stride = self.stride;
        self.samples.resize(self.sub_delays * stride, 0);
        let (modulated, filters) = (&self.modulated, &self.delay_filters);
        self.samples
            .par_chunks_mut(stride)
            .zip(filters)
            .for_each(|(samples, filter)| filter_samples(instructions, samples, modulated, filter));
    }

    /// So many delays as whole rows and a sub-delay s, which stands for the fraction s/S − ½ of a row.
    #[inline(always)]
    pub fn split(&self, delays: i32) -> (i32, i32) {
        let (sub_delays, per_row) = (self.sub_delays as i32, self.sub_delays as f32);
        let delays = delays + sub_delays / 2;
        // The whole part of delays/sub_delays: the fraction is never half a row from the middle of one.
        let rows = nearest_f32((delays as f32 - (per_row - 1.0) / 2.0) * (1.0 / per_row));
        (rows, delays - rows * sub_delays)
    }

    /// Class of a strain.
    pub fn class(beam: &Beam, strain: f64) -> i32 {
        nearest(strain / beam.grain.strain_step) as i32
    }

    /// Prepares the tape for tissue with strains of these classes, from the first to the last. The tape was baked.
    pub fn strain(&mut self, instructions: Instructions, beam: &Beam, classes: [i32; 2]) {
        let [first, last] = classes;
        if self.strained_filters.is_empty() {
            self.first_class = first;
        }
        let kept = self.first_class..self.first_class + self.strained_filters.len() as i32;
        let (before, after) = (first..kept.start, kept.end..last + 1);
        if before.is_empty() && after.is_empty() {
            return;
        }
        let filters = |class| self.strained_filters_of(beam, f64::from(class) * beam.grain.strain_step);
        let [before, after] = [before, after].map(|classes| classes.map(filters).collect::<Vec<_>>());
        // Those that are kept move up.
        let size = self.sub_delays * self.stride;
        let kept = before.len()..before.len() + kept.len();
        self.strained.resize((kept.end + after.len()) * size, 0);
        self.strained.copy_within(..kept.len() * size, kept.start * size);
        self.first_class -= before.len() as i32;
        self.strained_filters.splice(0..0, before);
        self.strained_filters.extend(after);
        let Self { strained, strained_filters, modulated, stride, sub_delays, .. } = self;
        strained.par_chunks_mut(*stride).enumerate().for_each(|(delay, samples)| {
            let (class, sub_delay) = (delay / *sub_delays, delay % *sub_delays);
            if !kept.contains(&class) {
                filter_strained(instructions, samples, modulated, &strained_filters[class][sub_delay]);
            }
        });
    }

    /// What spreads a scatterer over rows of tissue of a class of strain, by delay.
    pub fn strained_filters(&self, class: i32) -> &[[[f32; 2]; DELAY_TAPS]] {
        &self.strained_filters[(class - self.first_class) as usize]
    }

    fn strained_filters_of(&self, beam: &Beam, strain: f64) -> Vec<[[f32; 2]; DELAY_TAPS]> {
        let filters = delay_filters(beam, self.row_step_m * (1.0 - strain), self.lateral_slope);
        let count = filters.len();
        let phase_per_row_rad = beam.two_k_rad_m * self.row_step_m * strain;
        let turned = filters.iter().enumerate().map(|(s, filter)| {
            let fraction = s as f64 / count as f64 - 0.5;
            core::array::from_fn(|m| {
                let off = m as f64 - DELAY_REACH as f64 - fraction;
                let (sin, cos) = libm::sincos(-phase_per_row_rad * off);
                [filter[m] * cos as f32, filter[m] * sin as f32]
            })
        });
        turned.collect()
    }

    fn modulate(&mut self, phase_per_row_rad: f64) {
        let turn = |q: f64| {
            let (sin, cos) = libm::sincos(phase_per_row_rad * q);
            [cos, sin]
        };
        // Up to a whole block of the delay filters.
        let length = self.stride.next_multiple_of(BLOCK) + 2 * DELAY_REACH;
        let starts =
            (0..length.div_ceil(STRETCH)).map(|stretch| (stretch * STRETCH) as f64 - DELAY_REACH as f64);
        self.coarse.clear();
        self.coarse.extend(starts.map(turn));
        self.fine.clear();
        self.fine.extend((0..STRETCH).map(|q| turn(q as f64)));
        for part in &mut self.modulated {
            part.clear();
            part.reserve(length);
        }
        for sample in 0..length {
            let [cos, sin] = product(self.coarse[sample / STRETCH], self.fine[sample % STRETCH]);
            let [re, im] = self.raw(sample + TAPE_LENGTH - DELAY_REACH).map(f64::from);
            self.modulated[0].push((re * cos + im * sin) as f32);
            self.modulated[1].push((im * cos - re * sin) as f32);
        }
    }
}

wide! {
    fn filter_samples(out: &mut [u32], modulated: &[Vec<f32>; 2], filter: &[f32; DELAY_TAPS]) {
        let [re, im] = modulated;
        for (index, out) in out.chunks_mut(BLOCK).enumerate() {
            let (mut sum_re, mut sum_im) = ([0.0f32; BLOCK], [0.0f32; BLOCK]);
            for (m, &tap) in filter.iter().enumerate() {
                // out[q] = Σ_m K[m]·t[q − m], m from −DELAY_REACH; the modulated tape starts DELAY_REACH samples early.
                let first = index * BLOCK + DELAY_TAPS - 1 - m;
                for (s, &t) in sum_re.iter_mut().zip(&re[first..][..BLOCK]) {
                    *s += tap * t;
                }
                for (s, &t) in sum_im.iter_mut().zip(&im[first..][..BLOCK]) {
                    *s += tap * t;
                }
            }
            for ((o, &re), &im) in out.iter_mut().zip(&sum_re).zip(&sum_im) {
                *o = pack(re, im);
            }
        }
    }
}

wide! {
    /// The same by complex taps.
    fn filter_strained(out: &mut [u32], modulated: &[Vec<f32>; 2], filter: &[[f32; 2]; DELAY_TAPS]) {
        let [re, im] = modulated;
        for (index, out) in out.chunks_mut(BLOCK).enumerate() {
            let (mut sum_re, mut sum_im) = ([0.0f32; BLOCK], [0.0f32; BLOCK]);
            for (m, &[cos, sin]) in filter.iter().enumerate() {
                let first = index * BLOCK + DELAY_TAPS - 1 - m;
                let (re, im) = (&re[first..][..BLOCK], &im[first..][..BLOCK]);
                for i in 0..BLOCK {
                    sum_re[i] += cos * re[i] - sin * im[i];
                }
                for i in 0..BLOCK {
                    sum_im[i] += cos * im[i] + sin * re[i];
                }
            }
            for ((o, &re), &im) in out.iter_mut().zip(&sum_re).zip(&sum_im) {
                *o = pack(re, im);
            }
        }
    }
}

/// Real part in the high half, imaginary part in the low one, each rounded to the upper 16 bits of an f32
/// (0.2 % rms): half the memory to read, and a mask or a shift brings a part back.
#[inline(always)]
fn pack(re: f32, im: f32) -> u32 {
    let rounded = |v: f32| v.to_bits() + 0x7fff + ((v.to_bits() >> 16) & 1);
    (rounded(re) & 0xffff_0000) | (rounded(im) >> 16)
}

/// Real and imaginary part of a packed sample.
#[inline(always)]
pub fn unpack(sample: u32) -> [f32; 2] {
    [f32::from_bits(sample & 0xffff_0000), f32::from_bits(sample << 16)]
}

/// Least-squares delay filters: K_s minimises ∬|PSF(shifted by s/S rows) − Σ_m K_s[m]·PSF(shifted by m)|²,
/// the shifts running along the sheared line, where the point spread is a Gaussian of
/// 1/σ² = 1/σ_z² + slope²/σ_l². Sub-delay s of S stands for the fraction s/S − ½.
fn delay_filters(beam: &Beam, row_step_m: f64, lateral_slope: f64) -> Vec<[f32; DELAY_TAPS]> {
    let [z, l] = [1.0 / beam.sigma_axial_m, lateral_slope / beam.sigma_lateral_m];
    // Overlap of two Gaussians of σ at distance d is exp(−d²/4σ²).
    let decay = row_step_m * row_step_m * (z * z + l * l) / 4.0;
    let overlap = |d: f64| libm::exp(-decay * d * d);
    // The ridge bounds the taps where rows are close and neighbours nearly the same (steep tilts).
    let gram: Matrix = core::array::from_fn(|a| {
        core::array::from_fn(|b| overlap(a as f64 - b as f64) + if a == b { 1e-6 } else { 0.0 })
    });
    let lower = cholesky(&gram);
    let sub_delays = beam.grain.sub_delays;
    (0..sub_delays)
        .map(|s| {
            let fraction = s as f64 / sub_delays as f64 - 0.5;
            let wanted = core::array::from_fn(|m| overlap(m as f64 - DELAY_REACH as f64 - fraction));
            let taps = solve(&lower, wanted);
            core::array::from_fn(|m| taps[m] as f32)
        })
        .collect()
}

type Matrix = [[f64; DELAY_TAPS]; DELAY_TAPS];

/// Lower factor L of a positive definite matrix L·Lᵀ. Written out so that the order of sums is ours.
fn cholesky(matrix: &Matrix) -> Matrix {
    let mut lower = [[0.0; DELAY_TAPS]; DELAY_TAPS];
    for i in 0..DELAY_TAPS {
        for j in 0..=i {
            let known: f64 = (0..j).map(|k| lower[i][k] * lower[j][k]).sum();
            let rest = matrix[i][j] - known;
            lower[i][j] = if i == j { rest.max(1e-12).sqrt() } else { rest / lower[j][j] };
        }
    }
    lower
}

fn solve(lower: &Matrix, mut v: [f64; DELAY_TAPS]) -> [f64; DELAY_TAPS] {
    for i in 0..DELAY_TAPS {
        let known: f64 = (0..i).map(|k| lower[i][k] * v[k]).sum();
        v[i] = (v[i] - known) / lower[i][i];
    }
    for i in (0..DELAY_TAPS).rev() {
        let known: f64 = (i + 1..DELAY_TAPS).map(|k| lower[k][i] * v[k]).sum();
        v[i] = (v[i] - known) / lower[i][i];
    }
    v
}
