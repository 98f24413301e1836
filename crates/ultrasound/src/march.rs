//! Sums of loss and delay along the directions of the aperture, row of knots by row of knots.

use crate::{beam::Beam, paths::Plane};

/// Parts of the aperture.
pub const DIRECTIONS: usize = 8;

/// Weight of a part of the aperture: a triangle, as a tapered aperture has.
fn weight(direction: usize) -> f32 {
    1.0 - offset(direction).abs() as f32
}

/// Middle of a part of the aperture in half apertures, −1 to 1.
pub fn offset(direction: usize) -> f64 {
    (2 * direction + 1) as f64 / DIRECTIONS as f64 - 1.0
}

/// Ends of a part of an aperture of `wanted_m` around `x_m`.
pub fn part_of_aperture(direction: usize, x_m: f64, wanted_m: f64) -> [f64; 2] {
    let low = x_m + wanted_m * (direction as f64 / DIRECTIONS as f64 - 0.5);
    [low, low + wanted_m / DIRECTIONS as f64]
}

/// State at one row of knots.
#[derive(Default)]
pub struct March {
    across: usize,
    /// One-way transmission of the centre frequency, and delay, from the face on; by direction.
    transmission: Vec<f32>,
    delay_m: Vec<f32>,
    before: Vec<f32>,
    /// Of the direction under way: weight, and weight times transmission.
    share: Vec<f32>,
    pub part: Vec<f32>,
    total: Vec<f32>,
    /// Means over the aperture: of the paths alone, and with what stands in the way.
    pub clear: Vec<f32>,
    pub amplitude: Vec<f32>,
    /// The latter without steel.
    pub unshaded: Vec<f32>,
    pub mean_delay_m: Vec<f32>,
}

impl March {
    /// Back to the face.
    pub fn start(&mut self, across: usize) {
        self.across = across;
        for (by_direction, value) in [(&mut self.transmission, 1.0), (&mut self.delay_m, 0.0)] {
            by_direction.clear();
            by_direction.resize(DIRECTIONS * across, value);
        }
        self.clear_sums();
    }

    /// Down by one row of knots, whose steps let so much through and delay so much. Knots lie as far apart across as
    /// down.
    #[inline(always)]
    pub fn step(&mut self, beam: &Beam, transmission: &[f32], delay_m: &[f32]) {
        for direction in 0..DIRECTIONS {
            // What is here now was beside here one row above, on the side that the ray comes from.
            let shift = (offset(direction) * beam.half_cone()) as f32;
            let here = direction * self.across..(direction + 1) * self.across;
            let (sums, before) = (&mut self.transmission[here.clone()], &mut self.before);
            shifted(sums, before, shift);
            sums.iter_mut().zip(transmission).for_each(|(sum, step)| *sum *= step);
            let sums = &mut self.delay_m[here];
            shifted(sums, before, shift);
            sums.iter_mut().zip(delay_m).for_each(|(sum, step)| *sum += step);
        }
    }

    pub fn clear_sums(&mut self) {
        let across = self.across;
        let Self { total, clear, amplitude, unshaded, mean_delay_m, .. } = self;
        let sums = [total, clear, amplitude, unshaded, mean_delay_m];
        for sums in sums {
            sums.clear();
            sums.resize(across, 0.0);
        }
        self.share.resize(across, 0.0);
        self.part.resize(across, 0.0);
    }

    /// Weight of one direction at each knot: the array may end before it.
    #[inline(always)]
    pub fn weigh(&mut self, direction: usize, plane: &Plane, wanted_m: f64, half_aperture_m: f64) {
        let part_m = wanted_m / DIRECTIONS as f64;
        let from_m = plane.first_x_m + wanted_m * (direction as f64 / DIRECTIONS as f64 - 0.5);
        let (knot_m, half_m) = (plane.step_m() as f32, half_aperture_m as f32);
        let (from_m, part_m, weight) = (from_m as f32, part_m as f32, weight(direction) / part_m as f32);
        for (i, share) in self.share.iter_mut().enumerate() {
            let low = from_m + i as i32 as f32 * knot_m;
            // Comparisons, as `min` and `max` also look for what is no number.
            let high = if low + part_m < half_m { low + part_m } else { half_m };
            let low = if low > -half_m { low } else { -half_m };
            let length_m = high - low;
            *share = if length_m > 0.0 { weight * length_m } else { 0.0 };
        }
    }

    /// Weight times transmission of one direction.
    #[inline(always)]
    pub fn transmit(&mut self, direction: usize) {
        let transmission = &self.transmission[direction * self.across..][..self.across];
        for (i, clear) in self.clear.iter_mut().enumerate() {
            self.part[i] = self.share[i] * transmission[i];
            *clear += self.part[i];
        }
    }

    /// Adds one direction to the sum without steel.
    #[inline(always)]
    pub fn sum_unshaded(&mut self) {
        for (unshaded, part) in self.unshaded.iter_mut().zip(&self.part) {
            *unshaded += part;
        }
    }

    /// Adds one direction to the sums.
    #[inline(always)]
    pub fn sum(&mut self, direction: usize) {
        let delay_m = &self.delay_m[direction * self.across..][..self.across];
        for (i, &delay_m) in delay_m.iter().enumerate() {
            self.total[i] += self.share[i];
            self.amplitude[i] += self.part[i];
            self.mean_delay_m[i] += self.share[i] * delay_m;
        }
    }

    /// Turns sums into means.
    #[inline(always)]
    pub fn divide(&mut self) {
        for (i, total) in self.total.iter().enumerate() {
            let scale = if *total > 0.0 { 1.0 / total } else { 0.0 };
            self.clear[i] *= scale;
            self.amplitude[i] *= scale;
            self.unshaded[i] *= scale;
            self.mean_delay_m[i] *= scale;
        }
    }
}

/// Moves values by a part of a knot, those beyond the end staying as they are. `before` is scratch.
#[inline(always)]
fn shifted(values: &mut [f32], before: &mut Vec<f32>, shift: f32) {
    before.clear();
    before.extend_from_slice(values);
    let last = values.len() - 1;
    let (from, to) =
        if shift > 0.0 { (&before[1..], &mut values[..last]) } else { (&before[..last], &mut values[1..]) };
    for (value, &beside) in to.iter_mut().zip(from) {
        *value += shift.abs() * (beside - *value);
    }
}
