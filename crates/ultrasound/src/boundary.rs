//! Echoes of the surfaces between materials.
//!
//! A smooth surface is a mirror: the aperture sees it where it faces the probe, and of a strong one nothing some
//! twenty degrees off. It is drawn as facets, one per column of the lattice near the plane of the picture. In elevation each
//! stands for the whole slice, the surface being a plane there; laterally facets interfere as the surface does. Every
//! surface is rough as well; that part is a layer of stronger scatterers, made in `columns`.

use sonoloop_types::{Point, Slice, Vector};

use crate::{
    beam::{Beam, NEPER_PER_DB, amplitude_from_db},
    columns::Columns,
    echo::Echo,
    fast::exp_minus,
    instructions::{Instructions, wide},
    lattice::Lattice,
    motion::Motion,
    shear::{Shear, Slab},
};

/// Echo of a plane that reflects all, at normal incidence, over unit speckle. [derived] A backscatter coefficient of
/// 3e-3 per cm and sr, half a pulse of 0.15 mm and the aperture's 0.1 sr return 4e-6 of what the plane returns.
pub const PLANE_LEVEL_DB: f64 = 54.0;
/// Level of a surface's roughness over its mirror's. [assumed]
pub const ROUGH_SHARE_DB: f64 = -26.0;
/// Mirrors below this over unit speckle are left out.
const FLOOR_DB: f64 = -10.0;
/// Mirrors that the beam sees less of than this over unit speckle are left out, in neper: −14 dB.
const LEAST_NP: f64 = -1.6;
/// σ of the window across the plane, in rows of the lattice, and its reach in σ.
const WINDOW: f64 = 0.5;
const WINDOW_REACH: f64 = 3.0;
/// Facets between which the phase turns by less are single points; others are cut into points so far apart at most.
const ONE_POINT_RAD: f64 = 1.5;
const POINT_RAD: f64 = 1.5;
/// σ of a facet's row of points in distances between facets, and its reach in σ: the sum of neighbours ripples by
/// 2·exp(−2π²·0.36) = 0.2 %, −56 dB.
const PATCH_SIGMA: f64 = 0.6;
const PATCH_REACH: f64 = 3.0;
/// Passages between the two faces of a layer that are drawn.
const REVERBERATIONS: i32 = 5;
/// Products of two faces' reflections below this make no reverberation that shows.
const MIN_REVERBERATION: f64 = 0.1;
/// Faces that diverge by more than this slope do not reverberate.
const MAX_WEDGE: f64 = 0.1;
/// Neighbours belong to one surface when it is not steeper than this between them.
const MAX_SLOPE: f64 = 2.0;
/// Slopes beside its own that the beam sees of a patch anyway.
const SEEN_BEND: f64 = 0.1;

/// Where a column passes from one material into another.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Boundary {
    /// Depth in the phantom frame, negative.
    pub z_m: f64,
    /// The materials above and below.
    pub between: [u16; 2],
    /// Share of the pressure that is reflected, (Z₂ − Z₁)/(Z₂ + Z₁).
    pub reflection: f64,
    /// Displayed thickness of the material below.
    pub thickness_m: f64,
}

impl Boundary {
    /// Loss of a passage, one way: both ways together leave 1 − R².
    pub fn entry_loss_np(&self) -> f64 {
        -0.5 * libm::log((1.0 - self.reflection * self.reflection).max(1e-6))
    }

    pub fn shows(&self) -> bool {
        self.reflection.abs() > amplitude_from_db(FLOOR_DB - PLANE_LEVEL_DB)
    }
}

/// A patch of a surface around a column of the lattice: what tells whether it shows. It is small, as most do not and the time
/// goes into fetching them.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Facet {
    /// Depth in the phantom frame, negative; to 4 nm, or 3e-4 rad of the echo's phase.
    pub z_m: f32,
    /// ln of the mirror's level over unit speckle.
    pub level_np: f32,
    /// Least and most of dz/dx and of dz/dy on the patch, phantom frame: the same where the surface is next to flat. On the
    /// top of a thread they lie far apart, and it echoes wherever columns happen to meet it.
    pub slopes: [[f32; 2]; 2],
}

/// What a facet reflects.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Mirror {
    pub reflection: f64,
    /// dz/dx and dz/dy at the column, and metres per which either grows by one; 0 where it hardly changes.
    pub slope: [f64; 2],
    pub bend_m: [f64; 2],
    /// Distance of the echoes between this face and the next, and their ratio; 0 without.
    pub spacing_m: f64,
    pub ratio: f64,
}

/// The facets of a column's boundaries, with slopes from the columns around it.
pub fn facets(
    own: &[Boundary],
    [dx_m, dy_m]: [f64; 2],
    [ix, iy]: [i32; 2],
    reverberates: bool,
    mut boundaries: impl FnMut(i32, i32) -> Vec<Boundary>,
) -> Vec<(Facet, Mirror)> {
    // Column of a row beside this one that stands on the straight line so many after this column's.
    let beside = |lines: i32, iy_beside: i32| {
        let x = f64::from(lines) + Lattice::SHIFT * f64::from(iy_beside - iy);
        let ix = ix + lines + iy_beside.div_euclid(3) - iy.div_euclid(3);
        ([x * dx_m, f64::from(iy_beside - iy) * dy_m], [ix, iy_beside])
    };
    let around = [
        beside(-1, iy),
        beside(1, iy),
        beside(0, iy - 1),
        beside(1, iy - 1),
        beside(-1, iy + 1),
        beside(0, iy + 1),
    ]
    .map(|(offset_m, [ix, iy])| (offset_m, boundaries(ix, iy)));
    let facets = own.iter().enumerate().filter_map(|(index, boundary)| {
        // The same surface in a column beside, and what material is there at this depth.
        let nearest = |others: &[Boundary]| -> Option<Boundary> {
            let same = others.iter().filter(|other| other.between == boundary.between);
            let distance_m = |other: &Boundary| (other.z_m - boundary.z_m).abs();
            same.min_by(|a, b| distance_m(a).total_cmp(&distance_m(b))).copied()
        };
        let beside_it = |others: &[Boundary]| {
            let below = others.partition_point(|other| other.z_m > boundary.z_m);
            match (below.checked_sub(1), others.get(below)) {
                (Some(above), _) => others[above].between[1],
                (None, Some(below)) => below.between[0],
                (None, None) => own[0].between[0],
            }
        };
        let mut like = 0;
        let mut near = 0;
        let mut parallel = true;
        // Least squares for the plane through this place; the ridge keeps what is not known at zero.
        let (mut xx, mut xy, mut yy, mut xr, mut yr) =
            (1e-6 * dx_m * dx_m, 0.0, 1e-6 * dx_m * dx_m, 0.0, 0.0);
        for ([x_m, y_m], others) in &around {
            let Some(nearest) = nearest(others) else { continue };
            like += 1;
            parallel &= (nearest.thickness_m - boundary.thickness_m).abs() < MAX_WEDGE * dx_m;
            let rise_m = nearest.z_m - boundary.z_m;
            if rise_m.abs() < MAX_SLOPE * dx_m {
                near += 1;
                (xx, xy, yy) = (xx + x_m * x_m, xy + x_m * y_m, yy + y_m * y_m);
                (xr, yr) = (xr + x_m * rise_m, yr + y_m * rise_m);
            }
        }
        // A wall seen edge on is no facet; what has none like it around, as the top of a wire, faces every way.
        if 2 * near < like {
            return None;
        }
        let determinant = xx * yy - xy * xy;
        let slope = [xr * yy - yr * xy, yr * xx - xr * xy].map(|v| v / determinant);
        // The nearest one and the next along an axis.
        let places = |axis: usize, side: i32| match axis {
            0 => [beside(side, iy), beside(2 * side, iy)],
            _ => [beside(0, iy + side), beside(-side, iy + 2 * side)],
        };
        // A thread: what goes on for two columns on one side is flat, or nearly, and ends or has a corner here, which sends next
        // to nothing back.
        let mut ends = |axis: usize, side: i32| {
            let [_, (_, [ix, iy])] = places(axis, side);
            nearest(&boundaries(ix, iy)).is_none()
        };
        let thin = (ends(0, -1) && ends(0, 1)) || (ends(1, -1) && ends(1, 1));
        let mut bend_m = [0.0; 2];
        let slopes = [0, 1].map(|axis| {
            // What is left of depths without the slope across.
            let level_m = |offset_m: [f64; 2], z_m: f64| z_m - slope[1 - axis] * offset_m[1 - axis];
            let sides = [-1, 1].map(|side| {
                let [(offset_m, _), _] = places(axis, side);
                let (_, others) = around.iter().find(|(known_m, _)| *known_m == offset_m)?;
                Some((offset_m, nearest(others), beside_it(others)))
            });
            let [Some(before), Some(after)] = sides.map(|side| side.filter(|_| thin)) else {
                return [slope[axis] as f32; 2];
            };
            let slope_to = |(offset_m, met, _): ([f64; 2], Option<Boundary>, u16)| {
                met.map(|met| (level_m(offset_m, met.z_m) - boundary.z_m) / offset_m[axis])
            };
            // Not met any more it bends away: down if what lies on it is there.
            let away =
                |side: f64, beside: u16| if beside == boundary.between[0] { -side } else { side } * MAX_SLOPE;
            let before = slope_to(before).unwrap_or(away(-1.0, before.2));
            let after = slope_to(after).unwrap_or(away(1.0, after.2));
            let [least, most] = [before.min(after) + SEEN_BEND, before.max(after) - SEEN_BEND];
            if least < most {
                bend_m[axis] = [dx_m, dy_m][axis] / (after - before);
            }
            [least.min(slope[axis]) as f32, most.max(slope[axis]) as f32]
        });
        // Faces that are not parallel send the sound away sideways.
        let far_face = own.get(index + 1).filter(|next| parallel && next.between[0] == boundary.between[1]);
        let ratio = far_face.map_or(0.0, |face| (boundary.reflection * face.reflection).abs());
        let facet = Facet {
            z_m: boundary.z_m as f32,
            level_np: (PLANE_LEVEL_DB * NEPER_PER_DB + libm::log(boundary.reflection.abs())) as f32,
            slopes,
        };
        let mirror = Mirror {
            reflection: boundary.reflection,
            slope,
            bend_m,
            spacing_m: boundary.thickness_m,
            ratio: if reverberates && ratio >= MIN_REVERBERATION { ratio } else { 0.0 },
        };
        Some((facet, mirror))
    });
    facets.collect()
}

/// σ of the window across the plane.
fn window_m(lattice: &Lattice) -> f64 {
    let [_, dy_m] = lattice.spacing_m();
    WINDOW * dy_m
}

/// Where columns stand whose facets are drawn; moved ones come from farther away.
pub fn slab(lattice: &Lattice, shear: &Shear, motion: Option<&Motion>) -> Slab {
    let reach_m = WINDOW_REACH * window_m(lattice) + motion.map_or(0.0, |motion| motion.reach_m(shear));
    let drift_m = -shear.elevation_slope * shear.rows as f64 * shear.row_step_m;
    Slab { elevations_m: [drift_m.min(0.0) - reach_m, drift_m.max(0.0) + reach_m], reach_m }
}

wide! {
    /// Lowest and highest depth, phantom frame, at which columns of a row from `first` on come near the plane.
    fn near_plane(
        shear: &Shear,
        lattice: &Lattice,
        reach_m: f64,
        first: i32,
        iy: i32,
        depths_m: &mut [Vec<f64>; 2],
    ) {
        let [low_m, high_m] = depths_m;
        let (e_m, top_row) = (&shear.e, &shear.top_row);
        let (e_in_row_m, top_in_row) = (e_m.in_row(iy), top_row.in_row(iy));
        let across = (first..).zip(low_m.iter_mut().zip(high_m));
        for (ix, (low_m, high_m)) in across {
            let ix = f64::from(ix);
            let (e_m, top_row) = (e_in_row_m + e_m.per_ix * ix, top_in_row + top_row.per_ix * ix);
            [*high_m, *low_m] = shear
                .elevations_at(e_m, reach_m)
                .map(|row| -((row - top_row) / shear.rows_per_scatterer + 0.5) * lattice.depth_step_m);
        }
    }
}

/// Appends the echoes of the facets near the plane of the picture.
#[expect(clippy::too_many_arguments, reason = "one call site; the arguments are the scene")]
pub fn add_echoes(
    instructions: Instructions,
    beam: &Beam,
    lattice: &Lattice,
    shear: &Shear,
    columns: &Columns,
    slice: &Slice,
    motion: Option<&Motion>,
    echoes: &mut Vec<Echo>,
) {
    let axes = [Vector::x(), Vector::y(), Vector::z()].map(|axis| slice.phantom_from_probe * axis);
    let [dx_m, dy_m] = lattice.spacing_m();
    let window_m = window_m(lattice);
    let upright = axes[2].z.abs();
    let level =
        amplitude_from_db(PLANE_LEVEL_DB) * dx_m * dy_m * upright / (core::f64::consts::TAU * window_m);
    let mirrors = Mirrors { beam, lattice, shear, motion, axes, window_m, level };
    let slab = slab(lattice, shear, motion);
    let mut depths_m = [Vec::new(), Vec::new()];
    for iy in shear.rows_across() {
        let along = shear.overlap(slab, iy);
        depths_m.iter_mut().for_each(|depths_m| depths_m.resize(along.len(), 0.0));
        near_plane(instructions, shear, lattice, slab.reach_m, along.start, iy, &mut depths_m);
        let [low_m, high_m] = &depths_m;
        for (ix, (&low_m, &high_m)) in along.zip(low_m.iter().zip(high_m)) {
            let mut by_place = None;
            for (place, facet) in columns.facets(ix, iy, low_m, high_m) {
                mirrors.add_facet([ix, iy], facet, columns.mirror(place), &mut by_place, echoes);
            }
        }
    }
}

/// What facets are drawn with.
struct Mirrors<'a> {
    beam: &'a Beam,
    lattice: &'a Lattice,
    shear: &'a Shear,
    motion: Option<&'a Motion>,
    /// The probe's axes in the phantom frame: lateral, elevational, down.
    axes: [Vector; 3],
    /// σ of a window across the plane, which makes the facets of several rows stand for one line; its weights sum to one.
    window_m: f64,
    /// Of a facet that reflects all, in the middle of that window.
    level: f64,
}

impl Mirrors<'_> {
    /// Appends the echoes of one facet of a column. `by_place` is what the motion is by the column's place, once it is known.
    fn add_facet(
        &self,
        [ix, iy]: [i32; 2],
        facet: &Facet,
        mirror: &Mirror,
        by_place: &mut Option<[f64; 2]>,
        echoes: &mut Vec<Echo>,
    ) {
        let Self { beam, lattice, shear, motion, axes, window_m, level } = *self;
        let [lateral, elevational, down] = axes;
        let reach_m = WINDOW_REACH * window_m;
        let &Facet { z_m, level_np, slopes } = facet;
        let rest_z_m = f64::from(z_m);
        // Where the patch faces the probe best.
        let facing = [-down.x / down.z, -down.y / down.z];
        let slope: [f64; 2] = core::array::from_fn(|axis| {
            let [least, most] = slopes[axis].map(f64::from);
            facing[axis].clamp(least, most)
        });
        // There is a little beside the column, on a parabola.
        let aside_m: [f64; 2] =
            core::array::from_fn(|axis| (slope[axis] - mirror.slope[axis]) * mirror.bend_m[axis]);
        let rest_z_m = rest_z_m
            + (0..2).map(|axis| 0.5 * (slope[axis] + mirror.slope[axis]) * aside_m[axis]).sum::<f64>();
        let aside_m = Vector::new(aside_m[0], aside_m[1], 0.0);
        let row = shear.top_row.at(ix, iy) + lattice.index_at(rest_z_m) * shear.rows_per_scatterer;
        let mut z_m = row * shear.row_step_m;
        let mut e_m = shear.e.at(ix, iy) + shear.elevation_slope * z_m + aside_m.dot(&elevational);
        let mut x_m = shear.x.at(ix, iy) + shear.lateral_slope * z_m + aside_m.dot(&lateral);
        z_m += aside_m.dot(&down);
        let mut normal = Vector::new(-slope[0], -slope[1], 1.0);
        let hidden =
            |x_m: f64, e_m: f64, z_m: f64| z_m < 0.0 || e_m.abs() > reach_m || x_m.abs() > shear.reach_m;
        if let Some(motion) = motion {
            let [column_x_m, column_y_m] = lattice.column_m(ix, iy);
            let by_place = *by_place.get_or_insert_with(|| motion.by_place(column_x_m, column_y_m));
            let rest = Point::new(column_x_m, column_y_m, rest_z_m) + aside_m;
            let by_m = motion.displacement_of(by_place, rest);
            [x_m, e_m, z_m] = [(x_m, lateral), (e_m, elevational), (z_m, down)]
                .map(|(at_rest_m, axis)| at_rest_m + by_m.dot(&axis));
            if hidden(x_m, e_m, z_m) {
                return;
            }
            normal = moved_normal(motion, rest, by_m, slope);
        }
        if hidden(x_m, e_m, z_m) {
            return;
        }
        // Depth changes by this along the surface, laterally and in elevation.
        let towards = normal.dot(&down);
        let [g_l, g_e] = [lateral, elevational].map(|axis| -normal.dot(&axis) / towards);
        let sigma_m = [beam.sigma_lateral_m * beam.widening(x_m, z_m), beam.sigma_elevation_m(z_m)];
        let turns = [g_l * sigma_m[0], g_e * sigma_m[1]].map(|v| beam.two_k_rad_m * v);
        let fade = -0.5 * (turns[0] * turns[0] + turns[1] * turns[1]);
        let seen_np = f64::from(level_np) + fade;
        if seen_np.is_nan() || seen_np < LEAST_NP {
            return;
        }
        let u = e_m / window_m;
        let across = f64::from(exp_minus((0.5 * (u * u + turns[1] * turns[1])) as f32));
        let amplitude = level * across / sigma_m[0];
        let patch = Patch { x_m, z_m: z_m - g_e * e_m, slope: g_l };
        patch.add(beam, lattice.column_spacing_m, amplitude * mirror.reflection, 0.0, echoes);
        if mirror.ratio > 0.0 {
            // Once through the near face and back, and off the far one; the first such echo is that face's own.
            let far = mirror.ratio / mirror.reflection.abs();
            let mut late = amplitude * (1.0 - mirror.reflection * mirror.reflection) * far;
            for bounce in 2..=REVERBERATIONS {
                late *= mirror.ratio;
                patch.add(beam, lattice.column_spacing_m, late, f64::from(bounce) * mirror.spacing_m, echoes);
            }
        }
    }
}

/// The part of a surface that a facet stands for, in the picture's plane.
struct Patch {
    x_m: f64,
    z_m: f64,
    /// Depth per way along x.
    slope: f64,
}

impl Patch {
    /// Appends its echoes. Facets are 0.25 mm apart, and on a slope of 10° the phase turns once around from one to the
    /// next: they would add up as a grating does. So a facet on a slope is a row of points on its plane, under a Gaussian
    /// that is wide enough for those of neighbours to add up to an even line.
    fn add(&self, beam: &Beam, spacing_m: f64, amplitude: f64, late_m: f64, echoes: &mut Vec<Echo>) {
        let turn_per_m = beam.two_k_rad_m * self.slope.abs();
        if turn_per_m * spacing_m < ONE_POINT_RAD {
            echoes.push(Echo {
                x_m: self.x_m,
                z_m: self.z_m,
                late_m,
                re: amplitude,
                im: 0.0,
                unshaded: false,
            });
            return;
        }
        let reach_m = PATCH_REACH * PATCH_SIGMA * spacing_m;
        let steps = (turn_per_m * reach_m / POINT_RAD).ceil();
        let step_m = reach_m / steps;
        // Riemann's sum of the Gaussian is one.
        let scale = amplitude * step_m / (PATCH_SIGMA * spacing_m * core::f64::consts::TAU.sqrt());
        for i in -(steps as i32)..=steps as i32 {
            let aside_m = f64::from(i) * step_m;
            let u = aside_m / (PATCH_SIGMA * spacing_m);
            let re = scale * f64::from(exp_minus((0.5 * u * u) as f32));
            let (x_m, z_m) = (self.x_m + aside_m, self.z_m + self.slope * aside_m);
            echoes.push(Echo { x_m, z_m, late_m, re, im: 0.0, unshaded: false });
        }
    }
}

/// The normal that a patch of a surface has where it has moved `by_m`; of any length, phantom frame.
fn moved_normal(motion: &Motion, rest: Point, by_m: Vector, slope: [f64; 2]) -> Vector {
    const STEP_M: f64 = 0.1e-3;
    let along = |x: f64, y: f64| {
        let tangent = Vector::new(x, y, x * slope[0] + y * slope[1]);
        tangent + (motion.displacement_m(rest + tangent * STEP_M) - by_m) / STEP_M
    };
    along(1.0, 0.0).cross(&along(0.0, 1.0))
}
