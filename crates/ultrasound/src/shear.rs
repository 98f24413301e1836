//! The working grid of one pose: rows across depth, lines along the phantom's columns.

use sonoloop_types::{ImageGeometry, Point, Pose, Vector};

use crate::{
    beam::{Beam, PROFILE_REACH},
    elevation::STRIDE,
    fast::floor_side_by_side,
    lattice::Lattice,
    motion::Motion,
    thinning::Thinning,
};

/// Below this cosine between the beam and the phantom's vertical no tissue is drawn (60°).
const MIN_COSINE: f64 = 0.5;
/// What a row that runs along the picture may come nearer to it.
const ALONG_M: f64 = 1e-6;
/// Steps of a slope per unit.
const SLOPES: f64 = 32_768.0;

/// A value that is affine in the place of a column.
#[derive(Debug, Clone, Copy)]
pub struct Affine {
    pub at_zero: f64,
    pub per_ix: f64,
    pub per_iy: f64,
}

impl Affine {
    pub fn at(&self, ix: i32, iy: i32) -> f64 {
        self.in_row(iy) + self.per_ix * f64::from(ix)
    }

    /// Value at ix = 0 of row iy, its shift included.
    pub fn in_row(&self, iy: i32) -> f64 {
        self.at_zero + self.per_iy * f64::from(iy) + self.per_ix * Lattice::shift(iy)
    }
}

/// Places about the picture's plane.
#[derive(Debug, Clone, Copy, Default)]
pub struct Slab {
    /// Range of e′ of the columns that meet it.
    pub elevations_m: [f64; 2],
    /// Half its thickness, at most.
    pub reach_m: f64,
}

impl Slab {
    /// The same and what lies so far beside it.
    pub fn wider(self, by_m: f64) -> Self {
        let [low_m, high_m] = self.elevations_m;
        Self { elevations_m: [low_m - by_m, high_m + by_m], reach_m: self.reach_m + by_m }
    }
}

/// How the phantom's columns run through the probe frame, and the sheared grid laid along them.
///
/// On a column x = x′ + t·z and e = e′ + s·z in the probe frame; at rest its scatterers lie
/// `row_step_m`·`rows_per_scatterer` of depth apart. Row r is at depth r·row_step; line l is at x′ = first_line + l·line_pitch.
#[derive(Debug, Clone)]
pub struct Shear {
    pub row_step_m: f64,
    /// Rows from one scatterer of a column at rest to the next.
    pub rows_per_scatterer: f64,
    /// A multiple of [`STRIDE`].
    pub rows: usize,
    /// t = dx/dz along a column.
    pub lateral_slope: f64,
    /// s = de/dz along a column.
    pub elevation_slope: f64,
    pub line_pitch_m: f64,
    pub first_line_m: f64,
    pub lines: usize,
    /// |x| beyond which a scatterer reaches no displayed line.
    pub reach_m: f64,
    /// How far the lines' ends may lie from the column that their tissue belongs to, see [`crate::motion::Motion::aside_m`].
    beside_m: f64,
    /// x′ of a column.
    pub x: Affine,
    /// e′ of a column.
    pub e: Affine,
    /// Depth of scatterer 0 of a column, in rows.
    pub top_row: Affine,
    /// Which columns are left out where.
    pub thinning: Thinning,
    /// Columns that may matter: `[[ix_min, ix_max], [iy_min, iy_max]]`, inclusive.
    pub columns: [[i32; 2]; 2],
}

impl Shear {
    /// `None` when the pose shows no tissue: not finite, or tilted beyond 60°. `reach_m` is half the displayed width and
    /// the reach of the lateral filter, `motion` how tissue has moved, `half` the range of column indices.
    pub fn new(
        phantom_from_probe: &Pose,
        beam: &Beam,
        lattice: &Lattice,
        geometry: &ImageGeometry,
        reach_m: f64,
        motion: Option<&Motion>,
        half: [i32; 2],
    ) -> Option<Self> {
        let (aside_m, rows_per_scatterer) =
            motion.map_or((0.0, 1.0), |motion| (motion.aside_m(), beam.grain.rows_per_scatterer));
        let probe_from_phantom = phantom_from_probe.inverse();
        let down = probe_from_phantom * Vector::new(0.0, 0.0, -1.0);
        let origin = probe_from_phantom * Point::origin();
        let finite = down.iter().chain(origin.coords.iter()).all(|v| v.is_finite());
        if !finite || down.z < MIN_COSINE {
            return None;
        }
        // Slopes are rounded, so that a probe that is held in its attitude keeps the tables that depend on it. A
        // column is drawn at most 0.7 µm beside its place 48 mm down, and 0.4 µm too deep at 30° (0.03 rad).
        let round = |slope: f64| (slope * SLOPES).round() / SLOPES;
        let (t, s) = (round(down.x / down.z), round(down.y / down.z));
        let row_step_m = lattice.depth_step_m / (1.0 + t * t + s * s).sqrt() / rows_per_scatterer;
        let deepest_m = f64::from(geometry.height_px.saturating_sub(1)) * geometry.spacing_m
            + PROFILE_REACH * beam.most_sigma_axial_m();
        let rows = ((deepest_m / row_step_m) as usize + 1).next_multiple_of(STRIDE);
        let line_pitch_m = geometry.spacing_m / beam.grain.lines_per_px as f64;
        let first_line_m = -reach_m - (t * deepest_m).max(0.0) - line_pitch_m;
        let last_line_m = reach_m - (t * deepest_m).min(0.0) + line_pitch_m;

        let spacing_m = [lattice.column_spacing_m, lattice.row_spacing_m];
        let at = |ix: f64, iy: f64| {
            let [x_m, y_m] = [(ix + 0.5) * spacing_m[0], (iy + 0.5) * spacing_m[1]];
            probe_from_phantom * Point::new(x_m, y_m, -0.5 * lattice.depth_step_m)
        };
        let affine = |value: &dyn Fn(Point) -> f64| {
            let at_zero = value(at(0.0, 0.0));
            Affine { at_zero, per_ix: value(at(1.0, 0.0)) - at_zero, per_iy: value(at(0.0, 1.0)) - at_zero }
        };

        let [_, thickest_m] = beam.sigma_elevation_range_m();
        let elevation_m = beam.grain.elevation_reach * thickest_m;
        let mut bounds = [[f64::INFINITY, f64::NEG_INFINITY]; 2];
        for corner in 0..8u8 {
            let sign = |bit: u8| if corner & bit == 0 { -1.0 } else { 1.0 };
            let z_m = if corner & 4 == 0 { 0.0 } else { deepest_m };
            let point = phantom_from_probe * Point::new(sign(1) * reach_m, sign(2) * elevation_m, z_m);
            for (bound, value) in bounds.iter_mut().zip([point.x, point.y]) {
                *bound = [bound[0].min(value - aside_m), bound[1].max(value + aside_m)];
            }
        }
        let columns = [0, 1].map(|axis| {
            let limit = f64::from(half[axis]);
            // Rows are shifted by up to two thirds.
            let low = (bounds[axis][0] / spacing_m[axis] - 7.0 / 6.0).ceil().clamp(-limit, limit);
            let high = (bounds[axis][1] / spacing_m[axis] - 0.5).floor().clamp(-limit - 1.0, limit - 1.0);
            [low as i32, high as i32]
        });
        let (x, e) = (affine(&|p| p.x - t * p.z), affine(&|p| p.y - s * p.z));
        Some(Self {
            thinning: Thinning::new(lattice, x, e, thickest_m),
            row_step_m,
            rows_per_scatterer,
            rows,
            lateral_slope: t,
            elevation_slope: s,
            line_pitch_m,
            first_line_m,
            lines: ((last_line_m - first_line_m) / line_pitch_m) as usize + 2,
            reach_m,
            beside_m: 2.0 * aside_m,
            x,
            e,
            top_row: affine(&|p| p.z / row_step_m),
            columns,
        })
    }

    /// Columns of lattice row iy that can meet the picture within a slab.
    pub fn overlap(&self, slab: Slab, iy: i32) -> core::ops::Range<i32> {
        let mut range = self.columns[0].map(f64::from);
        let last_line_m = self.first_line_m + self.line_pitch_m * self.lines as f64;
        let lines_m = [self.first_line_m - self.beside_m, last_line_m + self.beside_m];
        // A column that leans meets the slab where z is next to −e′/s, and is then at x′ − e′·t/s.
        let (x, e) = (self.x, self.e);
        let (lean, aside_m) = if self.elevation_slope.abs() > 1e-3 {
            let lean = self.lateral_slope / self.elevation_slope;
            (lean, self.reach_m + self.beside_m + lean.abs() * slab.reach_m)
        } else {
            (0.0, f64::INFINITY)
        };
        let there = Affine {
            at_zero: x.at_zero - lean * e.at_zero,
            per_ix: x.per_ix - lean * e.per_ix,
            per_iy: x.per_iy - lean * e.per_iy,
        };
        for (value, [low, high]) in [(e, slab.elevations_m), (x, lines_m), (there, [-aside_m, aside_m])] {
            let at_zero = value.in_row(iy);
            let farthest = self.columns[0].map(|ix| f64::from(ix.abs()));
            if value.per_ix.abs() * farthest[0].max(farthest[1]) < ALONG_M {
                // The row runs along the picture.
                if at_zero < low - ALONG_M || at_zero > high + ALONG_M {
                    return 0..0;
                }
                continue;
            }
            let (a, b) = ((low - at_zero) / value.per_ix, (high - at_zero) / value.per_ix);
            range = [range[0].max(a.min(b) - 1.0), range[1].min(a.max(b) + 1.0)];
        }
        if range[0] > range[1] { 0..0 } else { range[0] as i32..range[1] as i32 + 1 }
    }

    /// First and last row, in fractions, at which a column of this e′ lies within `reach_m` of the plane.
    pub fn elevations_at(&self, e_m: f64, reach_m: f64) -> [f64; 2] {
        let rows = self.rows as f64;
        let per_row = self.elevation_slope * self.row_step_m;
        if per_row.abs() < 1e-12 {
            return if e_m.abs() <= reach_m { [0.0, rows] } else { [rows, 0.0] };
        }
        let (a, b) = ((-reach_m - e_m) / per_row, (reach_m - e_m) / per_row);
        [a.min(b).max(0.0), a.max(b).min(rows)]
    }

    /// Rows of the lattice that may matter.
    pub fn rows_across(&self) -> core::ops::RangeInclusive<i32> {
        let [first, last] = self.columns[1];
        first..=last
    }

    /// Rows `lo..hi` of the whole strides in which |at_zero + slope·z| ≤ bound somewhere; none where `lo` is not below `hi`.
    #[inline(always)]
    pub fn strides_within(&self, at_zero_m: f64, slope: f64, bound_m: f64) -> [i64; 2] {
        let rows = self.rows as f64;
        let per_row = slope * self.row_step_m;
        if per_row.abs() < 1e-12 {
            return if at_zero_m.abs() <= bound_m { [0, self.rows as i64] } else { [0, 0] };
        }
        let (a, b) = ((-bound_m - at_zero_m) / per_row, (bound_m - at_zero_m) / per_row);
        // Comparisons, as `min` and `max` also look for what is no number.
        let (low, high) = if a < b { (a, b) } else { (b, a) };
        let within = |row: f64| {
            let row = if row > 0.0 { row } else { 0.0 };
            if row < rows { row } else { rows }
        };
        let [first, end] = [-floor_side_by_side(-within(low)), floor_side_by_side(within(high + 1.0))];
        let stride = STRIDE as i64;
        [first & -stride, if first < end { (end + stride - 1) & -stride } else { 0 }]
    }
}

#[cfg(test)]
mod tests {
    use super::{Affine, STRIDE, Shear, Thinning};

    #[test]
    fn strides_are_those_with_a_row_within_the_bound() {
        let none = Affine { at_zero: 0.0, per_ix: 0.0, per_iy: 0.0 };
        let shear = Shear {
            row_step_m: 0.07e-3,
            rows_per_scatterer: 1.0,
            rows: 640,
            lateral_slope: 0.0,
            elevation_slope: 0.0,
            line_pitch_m: 0.1e-3,
            first_line_m: 0.0,
            lines: 1,
            reach_m: 0.0,
            beside_m: 0.0,
            x: none,
            e: none,
            top_row: none,
            thinning: Thinning::NONE,
            columns: [[0; 2]; 2],
        };
        for slope in [0.0, 0.011, -0.13, 0.577] {
            for at_zero_m in (-40..=40).map(|k| 0.713e-3 * f64::from(k)) {
                for bound_m in [0.3e-3, 2e-3, 20e-3] {
                    let within =
                        |row: &usize| (at_zero_m + slope * shear.row_step_m * *row as f64).abs() <= bound_m;
                    let rows: Vec<usize> = (0..shear.rows).filter(within).collect();
                    let [lo, hi] = shear.strides_within(at_zero_m, slope, bound_m).map(|row| row as usize);
                    match (rows.first(), rows.last()) {
                        (Some(first), Some(last)) => {
                            let exact = [first / STRIDE * STRIDE, (last + 1).next_multiple_of(STRIDE)];
                            assert_eq!([lo, hi], exact, "{at_zero_m} {slope} {bound_m}");
                        }
                        _ => assert!(lo >= hi, "{at_zero_m} {slope} {bound_m}: {lo}..{hi}"),
                    }
                }
            }
        }
    }
}
