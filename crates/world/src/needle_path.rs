//! Where the needle goes: the path of its tip through the materials.
//!
//! Symbols: s depth along the path, κ curvature, R needle frame in the phantom, p tip.

use libm::sincos;
use nalgebra::{Matrix3, Rotation3, UnitQuaternion};
use sonoloop_types::{NeedlePath, NeedleSpec, Point, Pose, Vector};

use crate::phantom::Anatomy;

/// Distance between the places at which the path looks for another material; what it crosses for less may be missed.
const LOOK_M: f64 = 5e-5;
/// How well a change of material is found.
const EXACT_M: f64 = 1e-9;
/// Distance between the points that the renderer gets: the sagitta at κ = 4.5 /m is 2 µm.
const POINTS_M: f64 = 2e-3;

/// A stretch of the path in one material: an arc.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Piece {
    /// Depth at which it begins.
    pub start_m: f64,
    /// Index of the material; `None` outside the phantom.
    pub material: Option<u16>,
    curvature_per_m: f64,
    phantom_from_needle: Pose,
}

/// The path that the tip takes: a unicycle whose curvature is that of the material.
///
/// dR/ds = R·[−κ e_y]×, dp/ds = R·e_z, with needle frame x on the side that the bevel's face looks to, z
/// along the insertion. Tissue pushes on the face, so the path bends away from it: about −y. κ is the needle's own
/// times the material's `bending`, 0 outside the phantom; arcs join smoothly. The shaft lies in the swept path of the
/// tip.
#[derive(Debug, Clone)]
pub(crate) struct Path {
    /// By ascending depth, at least one.
    pieces: Vec<Piece>,
    /// Depth at which no needle gets on.
    stop_m: Option<f64>,
    bevel_normal_in_needle: Vector,
}

impl Path {
    /// Follows the needle from its entry down to `max_depth_m`, and straight back to the top face where the entry
    /// lies below it. With a roll of 0 the bevel looks up and the path bends down, in the vertical plane of the needle.
    pub(crate) fn new(
        spec: &NeedleSpec,
        anatomy: &Anatomy,
        entry_in_phantom: Point,
        axis_in_phantom: Vector,
        bevel_roll_rad: f64,
        max_depth_m: f64,
    ) -> Self {
        let (sine, cosine) = sincos(spec.bevel_rad);
        let mut path =
            Self { pieces: Vec::new(), stop_m: None, bevel_normal_in_needle: Vector::new(cosine, 0.0, sine) };
        let entry = Pose::from_parts(
            entry_in_phantom.coords.into(),
            needle_rotation(axis_in_phantom, bevel_roll_rad),
        );
        let down = -(entry.rotation * Vector::z()).z;
        let buried_m = if entry_in_phantom.z < 0.0 && down > 1e-6 { -entry_in_phantom.z / down } else { 0.0 };
        if buried_m > 0.0 {
            // A hair below the face, so that the walk begins in the phantom.
            path.walk(-buried_m + EXACT_M, 0.0, entry * along(-buried_m + EXACT_M), 0.0, anatomy);
        }
        path.walk(0.0, max_depth_m, entry, spec.curvature_per_m, anatomy);
        path
    }

    /// Appends the pieces from one depth to another.
    fn walk(&mut self, from_m: f64, to_m: f64, mut pose: Pose, own_per_m: f64, anatomy: &Anatomy) {
        let material_at = |pose: &Pose| anatomy.material_at(&Point::from(pose.translation.vector));
        let mut start_m = from_m;
        loop {
            let material = material_at(&pose);
            let passage = material.map(|index| anatomy.passage(index));
            if passage == Some(None) && self.stop_m.is_none() {
                self.stop_m = Some(start_m);
            }
            let bending = passage.flatten().map_or(0.0, |passage| passage.bending);
            let curvature_per_m = own_per_m * bending;
            self.pieces.push(Piece { start_m, material, curvature_per_m, phantom_from_needle: pose });
            let here = |length_m: f64| pose * arc(curvature_per_m, length_m);
            let mut inside_m = 0.0;
            let mut beyond_m = None;
            while beyond_m.is_none() && start_m + inside_m < to_m {
                let look_m = inside_m + LOOK_M;
                if material_at(&here(look_m)) == material {
                    inside_m = look_m;
                } else {
                    beyond_m = Some(look_m);
                }
            }
            let Some(mut beyond_m) = beyond_m else { return };
            while beyond_m - inside_m > EXACT_M {
                let middle_m = 0.5 * (inside_m + beyond_m);
                if material_at(&here(middle_m)) == material {
                    inside_m = middle_m;
                } else {
                    beyond_m = middle_m;
                }
            }
            pose = here(beyond_m);
            pose.rotation.renormalize();
            start_m += beyond_m;
            if start_m >= to_m {
                return;
            }
        }
    }

    /// The pieces, by ascending depth.
    pub(crate) fn pieces(&self) -> &[Piece] {
        &self.pieces
    }

    /// Depth at which the tip meets what no needle enters.
    pub(crate) fn stop_m(&self) -> Option<f64> {
        self.stop_m
    }

    /// Needle frame with its origin at depth `depth_m`; straight back before the path, its last arc goes on beyond it.
    pub(crate) fn pose_at(&self, depth_m: f64) -> Pose {
        let index = self.pieces.partition_point(|piece| piece.start_m <= depth_m);
        let piece = &self.pieces[index.saturating_sub(1)];
        let curvature_per_m = if index == 0 { 0.0 } else { piece.curvature_per_m };
        piece.phantom_from_needle * arc(curvature_per_m, depth_m - piece.start_m)
    }

    /// Direction of the needle where it enters.
    pub(crate) fn axis_at_entry(&self) -> Vector {
        self.pose_at(0.0).rotation * Vector::z()
    }

    /// [`Self::pose_at`]'s origin.
    pub(crate) fn point_at(&self, depth_m: f64) -> Point {
        Point::from(self.pose_at(depth_m).translation.vector)
    }

    /// What the renderer sees with the tip at `depth_m`: the part of the shaft below the top face.
    pub(crate) fn seen_at(&self, depth_m: f64) -> NeedlePath {
        let tip = self.pose_at(depth_m);
        let tip_in_phantom = Point::from(tip.translation.vector);
        let mut points = Vec::with_capacity((depth_m / POINTS_M) as usize + 3);
        // The true entry may lie a little above or below the face: carry the straight shaft to z = 0.
        let entry = self.pose_at(0.0);
        let along = entry.rotation * Vector::z();
        if entry.translation.vector.z < 0.0 && along.z < -1e-6 {
            let back_m = entry.translation.vector.z / along.z;
            points.push(Point::from(entry.translation.vector - along * back_m));
        }
        let mut above: Option<Point> = None;
        let count = (depth_m / POINTS_M).ceil().max(0.0) as usize;
        let stored = (0..count).map(|i| self.point_at(i as f64 * POINTS_M));
        for point in stored.chain([tip_in_phantom]) {
            if point.z > 0.0 {
                above = Some(point);
                continue;
            }
            if let Some(above) = above.take().filter(|_| points.is_empty()) {
                points.push(above + (point - above) * (above.z / (above.z - point.z)));
            }
            points.push(point);
        }
        if points.is_empty() {
            points.push(tip_in_phantom);
        }
        NeedlePath {
            centreline_in_phantom: points,
            axis_in_phantom: tip.rotation * Vector::z(),
            bevel_normal_in_phantom: tip.rotation * self.bevel_normal_in_needle,
        }
    }

    /// Depth at which the path crosses the plane y = 0 of the probe, searched from `depth_m`, straight on
    /// beyond the tip. `None` when the needle runs along the plane.
    pub(crate) fn crossing_m(&self, probe_from_phantom: &Pose, depth_m: f64) -> Option<f64> {
        let mut s = depth_m;
        for _ in 0..8 {
            // Ahead of the tip there is no path yet: its tangent counts.
            let in_probe = probe_from_phantom * self.on_axis(depth_m, s);
            let slope = (in_probe.rotation * Vector::z()).y;
            // A needle within 3° of the plane has no useful crossing.
            if slope.abs() < 0.05 {
                return None;
            }
            let step = in_probe.translation.vector.y / slope;
            s -= step;
            if step.abs() < 1e-12 {
                break;
            }
        }
        s.is_finite().then_some(s)
    }

    /// Point at depth `s_m` of a needle whose tip is at `depth_m`: on the shaft, or straight ahead of the tip.
    pub(crate) fn along_from(&self, depth_m: f64, s_m: f64) -> Point {
        Point::from(self.on_axis(depth_m, s_m).translation.vector)
    }

    fn on_axis(&self, depth_m: f64, s_m: f64) -> Pose {
        self.pose_at(s_m.min(depth_m)) * along((s_m - depth_m).max(0.0))
    }
}

fn along(length_m: f64) -> Pose {
    Pose::translation(0.0, 0.0, length_m)
}

/// Needle frame for a direction: x in the vertical plane, pointing up at roll 0.
fn needle_rotation(axis: Vector, bevel_roll_rad: f64) -> UnitQuaternion<f64> {
    let z = axis.normalize();
    let up = Vector::z() - z * z.z;
    // A vertical needle has no vertical plane of its own; take the world's xz-plane.
    let x = if up.norm() > 1e-9 { up.normalize() } else { (Vector::x() - z * z.x).normalize() };
    let y = z.cross(&x);
    let upright =
        UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(Matrix3::from_columns(&[
            x, y, z,
        ])));
    upright * UnitQuaternion::from_axis_angle(&Vector::z_axis(), bevel_roll_rad)
}

/// Motion along a circular arc of length `length_m` that bends about −y, in the frame of its start.
fn arc(curvature_per_m: f64, length_m: f64) -> Pose {
    let angle = curvature_per_m * length_m;
    let (sine, cosine) = sincos(angle);
    // sin(θ)/κ and (1 − cos θ)/κ; their series where κ vanishes.
    let (along, aside) = if angle.abs() > 1e-6 {
        (sine / curvature_per_m, 2.0 * libm::sin(angle / 2.0) * libm::sin(angle / 2.0) / curvature_per_m)
    } else {
        (length_m, 0.5 * angle * length_m)
    };
    debug_assert!(cosine <= 1.0);
    Pose::from_parts(
        Vector::new(-aside, 0.0, along).into(),
        UnitQuaternion::from_axis_angle(&Vector::y_axis(), -angle),
    )
}

#[cfg(test)]
mod tests {
    use sonoloop_scenario::{Inclusion, PassageSpec, PhantomSpec, Shape};

    use super::*;
    use crate::fixture;

    fn needle(curvature_per_m: f64) -> NeedleSpec {
        NeedleSpec { curvature_per_m, ..fixture::needle() }
    }

    fn path(spec: &NeedleSpec, entry: Point, axis: Vector, roll_rad: f64, max_m: f64) -> Path {
        Path::new(spec, &Anatomy::new(&fixture::phantom()), entry, axis, roll_rad, max_m)
    }

    /// The fixture's gel, and from 15 mm of depth on a second layer, 20 mm thick, that bends `bending` times as much.
    fn layered(bending: Option<f64>) -> PhantomSpec {
        let mut spec = fixture::phantom();
        let mut layer = spec.materials[0].clone();
        layer.needle = bending.map(|bending| PassageSpec { bending, ..fixture::passage() });
        spec.materials.push(layer);
        spec.inclusions.push(Inclusion {
            name: "layer".into(),
            shape: Shape::Cuboid { size_m: [0.2, 0.1, 0.02] },
            phantom_from_inclusion: Pose::translation(0.0, 0.0, -0.025),
            material: 1,
        });
        spec
    }

    #[test]
    fn truth_deflection_is_half_kappa_l_squared() {
        // κL²/2 at 50 mm is 0.625 mm for 0.5 /m; the next term, κ³L⁴/24, is 33 nm.
        let path = path(&needle(0.5), Point::origin(), -Vector::z(), 0.0, 0.15);
        let tip = path.pose_at(0.05).translation.vector;
        assert!((tip.x.hypot(tip.y) - 0.625e-3).abs() < 5e-8, "{tip}");
    }

    #[test]
    fn truth_path_is_a_circle_of_radius_one_over_kappa() {
        let kappa = 4.5;
        let axis = Vector::new(0.8, 0.0, -0.6);
        let path = path(&needle(kappa), Point::origin(), axis, 0.7, 0.09);
        for s in [0.0003, 0.03, 0.0434567, 0.0599] {
            let chord = path.pose_at(s).translation.vector.norm();
            assert!((chord - 2.0 / kappa * (kappa * s / 2.0).sin()).abs() < 1e-12);
        }
    }

    /// In a vertical insertion the layer begins at a depth that the first arc alone tells: sin(κs)/κ = 15 mm. Beyond it
    /// the tip follows a second circle through the same point with the same tangent.
    #[test]
    fn truth_two_layers_are_two_arcs_that_join_smoothly() {
        let (first, second) = (4.0, 10.0);
        let path = Path::new(
            &needle(first),
            &Anatomy::new(&layered(Some(second / first))),
            Point::origin(),
            -Vector::z(),
            0.0,
            0.03,
        );
        assert_eq!(path.pieces().len(), 2);
        let border_m = (first * 0.015f64).asin() / first;
        let found_m = path.pieces()[1].start_m;
        assert!((found_m - border_m).abs() < 2e-9, "{found_m} {border_m}");
        let angle = first * border_m;
        let aside_m = (1.0 - angle.cos()) / first;
        for rest_m in [1e-4, 5e-3, 0.012] {
            let turned = angle + second * rest_m;
            let by_hand = [
                aside_m + (angle.cos() - turned.cos()) / second,
                0.015 + (turned.sin() - angle.sin()) / second,
            ];
            let pose = path.pose_at(border_m + rest_m);
            let tip = pose.translation.vector;
            assert!((tip.x.hypot(tip.y) - by_hand[0]).abs() < 1e-9, "{tip}");
            assert!((-tip.z - by_hand[1]).abs() < 1e-9, "{tip}");
            let tangent = pose.rotation * Vector::z();
            assert!((tangent.x.hypot(tangent.y) - turned.sin()).abs() < 1e-8, "{tangent}");
        }
        let across = |s: f64| path.pose_at(s).rotation * Vector::z();
        assert!((across(found_m - 1e-9) - across(found_m + 1e-9)).norm() < 1e-7, "no kink");
    }

    #[test]
    fn in_a_liquid_and_above_the_face_the_path_is_straight() {
        let axis = Vector::new(0.6, 0.0, -0.8);
        let anatomy = Anatomy::new(&layered(Some(0.0)));
        let path = Path::new(&needle(4.0), &anatomy, Point::new(-0.02, 0.0, 2e-3), axis, 0.0, 0.06);
        let materials: Vec<_> = path.pieces().iter().map(|piece| piece.material).collect();
        assert_eq!(materials, [None, Some(0), Some(1), Some(0)]);
        let tangent = |s: f64| path.pose_at(s).rotation * Vector::z();
        let at = |index: usize| path.pieces()[index].start_m;
        assert!((at(1) - 2.5e-3).abs() < 2e-9, "the face is where the line meets it: {}", at(1));
        assert!((tangent(0.0) - tangent(at(1))).norm() < 1e-12);
        assert!((tangent(at(2)) - tangent(at(3) - 1e-6)).norm() < 1e-12);
        assert!((tangent(at(1)) - tangent(at(2))).norm() > 0.05, "and bends between them");
    }

    #[test]
    fn a_path_ends_where_no_needle_goes_in() {
        let anatomy = Anatomy::new(&layered(None));
        let path = Path::new(&needle(0.0), &anatomy, Point::origin(), Vector::new(0.6, 0.0, -0.8), 0.0, 0.06);
        assert!((path.stop_m().unwrap() - 0.015 / 0.8).abs() < 2e-9, "{:?}", path.stop_m());
        let free = Anatomy::new(&fixture::phantom());
        let path = Path::new(&needle(0.0), &free, Point::origin(), -Vector::z(), 0.0, 0.05);
        assert_eq!(path.stop_m(), None);
    }

    #[test]
    fn bends_down_away_from_a_bevel_that_looks_up() {
        let axis = Vector::new(0.8, 0.0, -0.6);
        let path = path(&needle(1.0), Point::origin(), axis, 0.0, 0.1);
        let tip = path.pose_at(0.08);
        assert!(tip.translation.vector.z < -0.8 * 0.06 && tip.translation.vector.y.abs() < 1e-12);
        assert!(path.seen_at(0.08).bevel_normal_in_phantom.z > 0.0);
    }

    #[test]
    fn bevel_of_a_right_angle_looks_ahead() {
        let spec = NeedleSpec { bevel_rad: std::f64::consts::FRAC_PI_2, ..needle(0.0) };
        let axis = Vector::new(0.6, 0.0, -0.8);
        let seen = path(&spec, Point::origin(), axis, 0.3, 0.1).seen_at(0.05);
        assert!((seen.bevel_normal_in_phantom - axis).norm() < 1e-12);
    }

    #[test]
    fn centreline_runs_from_the_surface_to_the_tip_in_small_steps() {
        for entry_z in [0.0, 0.003, -0.003] {
            let axis = Vector::new(0.8, 0.0, -0.6);
            let path = path(&needle(0.5), Point::new(0.01, 0.0, entry_z), axis, 0.0, 0.15);
            let depth = 0.0613;
            let seen = path.seen_at(depth);
            let points = &seen.centreline_in_phantom;
            assert!(points[0].z.abs() < 1e-9, "begins on the face: {}", points[0]);
            let tip = path.pose_at(depth).translation.vector;
            assert!((seen.tip_in_phantom().coords - tip).norm() < 1e-12);
            assert!(points.iter().all(|p| p.z <= 1e-12));
            // The first step may span the slide to the face.
            assert!(points.windows(2).skip(1).all(|w| (w[1] - w[0]).norm() <= 2e-3 + 1e-12));
        }
    }
}
