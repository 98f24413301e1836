//! Where scatterers are, and how strong: the lattice in the phantom.

use crate::{beam::Beam, fast::floor_side_by_side};

/// Samples in the shared tape; columns read it at hashed offsets. A column through 60 mm of tissue takes some 800 of them
/// with a 7.5 MHz probe, so parts of it come again in other columns, at other depths and among others: speckle is held
/// against Rayleigh, its grain against the beam, and its decorrelation in elevation, with this length. Four times as long
/// it costs 1 ms per picture while the probe tilts (`benches/README.md`): the delayed copies do not fit the caches.
pub const TAPE_LENGTH: usize = 4096;
const _: () = assert!(TAPE_LENGTH.is_power_of_two());

/// Rows stand this many times σ of the lateral beam apart…
pub const ROWS_PER_SIGMA: f64 = 1.62;
/// …and of the thinnest slice, where that is less than this many times as thick as the beam.
const THINNEST: f64 = 1.2;

/// A regular lattice of scatterers fixed in the phantom frame: columns along z in rows that run along x, as far apart as
/// those and each shifted by a third of that; the n-th scatterer of a column at z = −(n+½)·d.
///
/// The spacing follows the beam so that several scatterers share a resolution cell; with complex Gaussian
/// amplitudes first-order statistics are Rayleigh for any spacing. The mean power ripples by up to 5 % along any
/// direction under a probe tilted by up to 30°, if the slice is 1.4 times as thick as the beam, as real ones are. The shift is a third, as every second row is then shifted by a third as well, and every fourth one: they are
/// what is left where the slice is thick (`thinning`).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Lattice {
    /// Distance between the columns of a row.
    pub column_spacing_m: f64,
    /// Distance between rows, along y.
    pub row_spacing_m: f64,
    /// Distance d between scatterers of a column.
    pub depth_step_m: f64,
    /// Columns, rows and scatterers per metre.
    per_m: [f64; 3],
    seed: u64,
}

impl Lattice {
    pub fn new(beam: &Beam, seed: u64) -> Self {
        let [thinnest_m, _] = beam.sigma_elevation_range_m();
        let row_spacing_m = ROWS_PER_SIGMA * beam.sigma_lateral_m.min(thinnest_m / THINNEST);
        let column_spacing_m = row_spacing_m;
        let depth_step_m = 1.15 * beam.sigma_axial_m;
        Self {
            column_spacing_m,
            row_spacing_m,
            depth_step_m,
            per_m: [column_spacing_m, row_spacing_m, depth_step_m].map(|spacing_m| 1.0 / spacing_m),
            seed: mix(seed ^ 0x6c61_7474_6963_6500),
        }
    }

    #[cfg(test)]
    pub fn of_rows(row_spacing_m: f64) -> Self {
        let spacings_m = [row_spacing_m; 3];
        Self {
            column_spacing_m: row_spacing_m,
            row_spacing_m,
            depth_step_m: row_spacing_m,
            per_m: spacings_m.map(|spacing_m| 1.0 / spacing_m),
            seed: 0,
        }
    }

    /// Shift of a row against the one before along x, in spacings.
    pub const SHIFT: f64 = 1.0 / 3.0;

    /// Shift of a row along x, in spacings; less than one.
    pub fn shift(iy: i32) -> f64 {
        Self::SHIFT * f64::from(iy.rem_euclid(3))
    }

    /// Number of the straight line across the rows that a column stands on.
    pub fn straight(ix: i32, iy: i32) -> i32 {
        ix - iy.div_euclid(3)
    }

    /// Where a column stands, phantom frame.
    pub fn column_m(&self, ix: i32, iy: i32) -> [f64; 2] {
        let along = f64::from(ix) + 0.5 + Self::shift(iy);
        [along * self.column_spacing_m, (f64::from(iy) + 0.5) * self.row_spacing_m]
    }

    /// Distances between columns and between rows.
    pub fn spacing_m(&self) -> [f64; 2] {
        [self.column_spacing_m, self.row_spacing_m]
    }

    /// Column next to a place in the phantom.
    #[inline(always)]
    pub fn nearest(&self, x_m: f64, y_m: f64) -> [i32; 2] {
        // Comparisons, as `min` and `max` also look for what is no number.
        let within = |v: f64| {
            let v = if v > -1e6 { v } else { -1e6 };
            if v < 1e6 { v } else { 1e6 }
        };
        let iy = floor_side_by_side(within(y_m * self.per_m[1]));
        // What is left of a third of a row's number after whole ones.
        let thirds = Self::SHIFT * (iy as i32 as f64 + 0.5);
        let shift = Self::SHIFT * (3.0 * (thirds - floor_side_by_side(thirds) as i32 as f64) - 0.5);
        [floor_side_by_side(within(x_m * self.per_m[0] - shift)) as i32, iy as i32]
    }

    /// Amplitude that makes the speckle's mean power one when profiles have unit energy.
    pub fn amplitude(&self) -> f64 {
        (self.column_spacing_m * self.row_spacing_m * self.depth_step_m).sqrt()
    }

    /// Index into the tape of scatterer 0 of a column.
    pub fn tape_offset(&self, ix: i32, iy: i32) -> usize {
        let key = (u64::from(ix as u32) << 32) | u64::from(iy as u32);
        (mix(self.seed ^ mix(key)) % TAPE_LENGTH as u64) as usize
    }

    /// Index of the scatterer at `z_m` (phantom frame), and how far past it.
    pub fn index_at(&self, z_m: f64) -> f64 {
        -z_m * self.per_m[2] - 0.5
    }

    /// Index of the first scatterer at or below `z_m` (phantom frame).
    pub fn first_below(&self, z_m: f64) -> i32 {
        (-z_m / self.depth_step_m - 0.5).ceil() as i32
    }
}

/// splitmix64's finaliser (Steele, Lea, Flood 2014): a bijection with good avalanche.
pub fn mix(x: u64) -> u64 {
    let x = x.wrapping_add(0x9e37_79b9_7f4a_7c15);
    let x = (x ^ (x >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    let x = (x ^ (x >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    x ^ (x >> 31)
}
