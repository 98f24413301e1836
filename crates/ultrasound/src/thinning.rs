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
