//! Fewer and stronger columns where the slice is thick.
//!
//! The lattice is as close as the lateral beam and the thinnest slice ask for; where the slice is several times as thick, several
//! times too many columns meet it. There every second row is left out, and of the rest every second one again, as far as
//! those left still stand close enough; they are stronger by as much as the others' power. In between the ones fade out and
//! the others grow, so that speckle changes smoothly as the probe moves. A probe that is turned crosswise has columns left
//! out along the rows instead, and one halfway between none.
//!
//! Complex Gaussian amplitudes stay Gaussian, and the mean power is one: what speckle looks like does not change, nor how it
//! decorrelates with elevation, for a slice of one thickness. Power ripples by up to 5 % (8 % crosswise, at a yaw of 75°).
//! A body that is thinner in elevation than the rows left stand apart, 1.6 σ of the slice, is met by one of them or by none: it
//! shows too strongly or not, where all rows would show it faintly.

use crate::{
    lattice::{Lattice, ROWS_PER_SIGMA},
    shear::Affine,
};

/// Sets of columns, the first of which is left out first.
pub const CLASSES: usize = 4;
/// How many times as far apart as they stand rows might stand where half of them begin to fade, and where they are gone.
const FADING: f64 = 1.85;
const GONE: f64 = 2.6;
/// Steps of what thins over the inverse spacing of rows, so that small turns of the probe keep the tables that depend on it.
const STEPS: f64 = 64.0;

/// Which columns are left out where, in the pictures of one attitude.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Thinning {
    /// Whether rows are left out, or columns of every row.
    rows: bool,
    /// How many times as far apart rows might stand, per metre of the slice's σ.
    per_m: f64,
    /// Sets that differ.
    pub classes: usize,
}

impl Thinning {
    #[cfg(test)]
    pub const NONE: Self = Self { rows: true, per_m: 0.0, classes: 1 };

    /// For columns with these x′ and e′, in slices with a σ of up to `thickest_m`.
    pub fn new(lattice: &Lattice, x: Affine, e: Affine, thickest_m: f64) -> Self {
        let [dx_m, dy_m] = lattice.spacing_m();
        // From a column to the next, and to that of the next row.
        let along = [x.per_ix, e.per_ix];
        let across = [x.per_iy + Lattice::SHIFT * x.per_ix, e.per_iy + Lattice::SHIFT * e.per_ix];
        let area_m2 = (along[0] * across[1] - along[1] * across[0]).abs();
        // cos 2ψ of the yaw ψ: 1 where rows run along the picture, −1 where they cross it.
        let [a, b] = [(x.per_ix / dx_m).powi(2), (x.per_iy / dy_m).powi(2)];
        let lengthwise = (a - b) / (a + b);
        let rows = lengthwise >= 0.0;
        let spared = (2.0 * lengthwise.abs()).min(1.0);
        // Seen along the lines that stay, which are that far apart in σ of the slice.
        let lines_m = if rows { along[0] } else { across[0] }.abs();
        let per_m = ROWS_PER_SIGMA * spared * lines_m / area_m2;
        let per_m = (per_m * dy_m * STEPS).floor() / (dy_m * STEPS);
        let classes = 1 + (1..CLASSES).filter(|&k| left(per_m * thickest_m, k) < 1.0).count();
        Self { rows, per_m, classes }
    }

    /// The set of a column.
    #[inline(always)]
    pub fn class(&self, ix: i32, iy: i32) -> usize {
        let line = if self.rows { iy } else { Lattice::straight(ix, iy) };
        (line.trailing_zeros() as usize).min(self.classes - 1)
    }

    /// The set of those of a row's columns that are left out last.
    pub fn of_row(&self, iy: i32) -> usize {
        if self.rows { self.class(0, iy) } else { self.classes - 1 }
    }

    /// Factor of a set's amplitudes where the slice has this σ.
    pub fn gain(&self, class: usize, sigma_m: f64) -> f64 {
        let ratio = self.per_m * sigma_m;
        // Of two halves one keeps this share of its amplitude, and the other has the power that it loses besides.
        let stronger: f64 = (1..=class).map(|k| 2.0 - left(ratio, k).powi(2)).product();
        let left = if class + 1 < self.classes { left(ratio, class + 1) } else { 1.0 };
        stronger.sqrt() * left
    }
}

/// How much of the amplitude of the k-th half is left where rows might stand `ratio` times as far apart.
fn left(ratio: f64, k: usize) -> f64 {
    let share = (ratio / f64::from(1u32 << (k - 1)) - FADING) / (GONE - FADING);
    let share = share.clamp(0.0, 1.0);
    1.0 - share * share * (3.0 - 2.0 * share)
}

#[cfg(test)]
mod tests {
    use super::*;

    const SIGMA_LATERAL_M: f64 = 0.15e-3;

    fn lattice() -> Lattice {
        Lattice::of_rows(ROWS_PER_SIGMA * SIGMA_LATERAL_M)
    }

    /// x′ and e′ of the columns under an upright probe.
    fn turned(yaw_deg: f64) -> [Affine; 2] {
        let [dx_m, dy_m] = lattice().spacing_m();
        let (sin, cos) = libm::sincos(yaw_deg.to_radians());
        [[cos * dx_m, sin * dy_m], [-sin * dx_m, cos * dy_m]].map(|[per_ix, per_iy]| Affine {
            at_zero: 0.0,
            per_ix,
            per_iy,
        })
    }

    /// Mean power of the speckle about a place in the slice, from all columns that reach it, over the mean everywhere.
    fn power(yaw_deg: f64, sigma_m: f64, [x_m, e_m]: [f64; 2]) -> f64 {
        let lattice = lattice();
        let [x, e] = turned(yaw_deg);
        let thinning = Thinning::new(&lattice, x, e, sigma_m);
        let reach = (5.0 * sigma_m / lattice.row_spacing_m) as i32 + 4;
        let columns = (-reach..=reach).flat_map(|iy| (-reach - 2..=reach + 2).map(move |ix| [ix, iy]));
        let sum: f64 = columns
            .map(|[ix, iy]| {
                let gain = thinning.gain(thinning.class(ix, iy), sigma_m);
                let [u, v] = [(x.at(ix, iy) - x_m) / SIGMA_LATERAL_M, (e.at(ix, iy) - e_m) / sigma_m];
                gain * gain * libm::exp(-u * u - v * v)
            })
            .sum();
        let [dx_m, dy_m] = lattice.spacing_m();
        sum * dx_m * dy_m / (core::f64::consts::PI * SIGMA_LATERAL_M * sigma_m)
    }

    /// The most that the mean power is off one anywhere, for slices of 1.4 σ of the lateral beam, as thin as probes have
    /// them, to eight.
    fn ripple(yaw_deg: f64) -> f64 {
        let places = (0..40).map(|i| {
            let steps = [f64::from(i) * 0.618, f64::from(i) * 0.414];
            steps.map(|steps| steps.fract() * 4.0 * lattice().row_spacing_m)
        });
        let sigmas = [1.4, 1.6, 1.9, 2.1, 2.3, 2.6, 3.5, 4.2, 4.6, 5.2, 7.0, 8.0];
        places
            .flat_map(|place| sigmas.map(|sigma| power(yaw_deg, sigma * SIGMA_LATERAL_M, place)))
            .fold(0.0, |most, power| (power - 1.0).abs().max(most))
    }

    #[test]
    fn truth_mean_power_is_that_of_all_columns_at_any_place_and_yaw() {
        for yaw_deg in [0.0, 4.0, 8.0, 12.0, 20.0, 30.0, 40.0, 45.0, -10.0, 135.0, 172.0] {
            let ripple = ripple(yaw_deg);
            assert!(ripple < 0.055, "{ripple:.3} at {yaw_deg}°");
        }
        for yaw_deg in [60.0, 68.0, 76.0, 82.0, 90.0, 98.0, 115.0, 270.0] {
            let ripple = ripple(yaw_deg);
            assert!(ripple < 0.085, "{ripple:.3} at {yaw_deg}°");
        }
    }

    #[test]
    fn a_thick_slice_has_few_columns_lengthwise_and_crosswise() {
        for (yaw_deg, part) in [(0.0, 0.125), (20.0, 0.125), (90.0, 0.125), (45.0, 1.0)] {
            let [x, e] = turned(yaw_deg);
            let sigma_m = 14.0 * SIGMA_LATERAL_M;
            let thinning = Thinning::new(&lattice(), x, e, sigma_m);
            let places = (0..64).flat_map(|iy| (0..64).map(move |ix| [ix, iy]));
            let drawn =
                places.filter(|&[ix, iy]| thinning.gain(thinning.class(ix, iy), sigma_m) > 0.0).count();
            assert!((drawn as f64 / 4096.0 - part).abs() < 0.02, "{drawn} of 4096 at {yaw_deg}°");
        }
    }

    #[test]
    fn small_turns_keep_what_is_left_out() {
        let at = |yaw_deg: f64| {
            let [x, e] = turned(yaw_deg);
            Thinning::new(&lattice(), x, e, 8.0 * SIGMA_LATERAL_M)
        };
        let changes = (0..1000).filter(|&i| at(f64::from(i) * 0.01) != at(f64::from(i + 1) * 0.01)).count();
        assert!(changes < 4, "{changes} in ten degrees");
    }
}
