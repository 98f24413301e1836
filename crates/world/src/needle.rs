//! The needle: its path through the tissue, and how fast it is fed.
//!
//! Symbols: s depth along the path, κ curvature, R needle frame in the phantom, p tip.

use libm::sincos;
use nalgebra::{Matrix3, Rotation3, UnitQuaternion};
use sonoloop_types::{NeedlePath, NeedleSpec, Point, Pose, TICKS_PER_SECOND, Vector};

/// Distance between stored poses of the path.
const SAMPLE_M: f64 = 5e-4;
/// Every so many stored poses one point goes to the renderer: 2 mm, whose sagitta at κ = 4.5 /m is 2 µm.
const POINTS_EVERY: usize = 4;

/// The path that the tip takes: a unicycle of constant curvature.
///
/// dR/ds = R·[−κ e_y]×, dp/ds = R·e_z, with needle frame x on the side that the bevel's face looks to, z
/// along the insertion. Tissue pushes on the face, so the path bends away from it: about −y. The shaft
/// lies in the swept path of the tip.
#[derive(Debug, Clone)]
pub(crate) struct Path {
    /// Needle frames every [`SAMPLE_M`], from depth 0.
    phantom_from_needle: Vec<Pose>,
    curvature_per_m: f64,
    bevel_normal_in_needle: Vector,
}

impl Path {
    /// Follows the needle from its entry down to `max_depth_m`. With a roll of 0 the bevel looks up and the
    /// path bends down, in the vertical plane of the needle.
    pub(crate) fn new(
        spec: &NeedleSpec,
        entry_in_phantom: Point,
        axis_in_phantom: Vector,
        bevel_roll_rad: f64,
        max_depth_m: f64,
    ) -> Self {
        let mut pose = Pose::from_parts(
            entry_in_phantom.coords.into(),
            needle_rotation(axis_in_phantom, bevel_roll_rad),
        );
        let step = arc(spec.curvature_per_m, SAMPLE_M);
        let count = (max_depth_m / SAMPLE_M).ceil() as usize + 1;
        let mut phantom_from_needle = Vec::with_capacity(count);
        for _ in 0..count {
            phantom_from_needle.push(pose);
            pose *= step;
            pose.rotation.renormalize();
        }
        let (sine, cosine) = sincos(spec.bevel_rad);
        Self {
            phantom_from_needle,
            curvature_per_m: spec.curvature_per_m,
            bevel_normal_in_needle: Vector::new(cosine, 0.0, sine),
        }
    }

    /// Needle frame with its origin at depth `depth_m`; straight on beyond either end of the path.
    pub(crate) fn pose_at(&self, depth_m: f64) -> Pose {
        let last = self.phantom_from_needle.len() - 1;
        let index = ((depth_m / SAMPLE_M).floor().max(0.0) as usize).min(last);
        let rest_m = depth_m - index as f64 * SAMPLE_M;
        let inside = depth_m >= 0.0 && index < last;
        let curvature = if inside { self.curvature_per_m } else { 0.0 };
        self.phantom_from_needle[index] * arc(curvature, rest_m)
    }

    /// Direction of the needle where it enters.
    pub(crate) fn axis_at_entry(&self) -> Vector {
        self.phantom_from_needle[0].rotation * Vector::z()
    }

    /// What the renderer sees with the tip at `depth_m`: the part of the shaft below the top face.
    pub(crate) fn seen_at(&self, depth_m: f64) -> NeedlePath {
        let tip = self.pose_at(depth_m);
        let tip_in_phantom = Point::from(tip.translation.vector);
        let axis_in_phantom = tip.rotation * Vector::z();
        let mut points = Vec::with_capacity((depth_m / SAMPLE_M) as usize / POINTS_EVERY + 3);
        // The true entry may lie a little above or below the face: carry the straight shaft to z = 0.
        let entry = &self.phantom_from_needle[0];
        let along = entry.rotation * Vector::z();
        if entry.translation.vector.z < 0.0 && along.z < -1e-6 {
            let back_m = entry.translation.vector.z / along.z;
            points.push(Point::from(entry.translation.vector - along * back_m));
        }
        let mut above: Option<Point> = None;
        let count = (depth_m / SAMPLE_M).ceil().max(0.0) as usize;
        let stored = self.phantom_from_needle.iter().take(count).step_by(POINTS_EVERY);
        let all = stored.map(|pose| Point::from(pose.translation.vector)).chain([tip_in_phantom]);
        for point in all {
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
            axis_in_phantom,
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
        let ahead_m = (s_m - depth_m).max(0.0);
        self.pose_at(s_m.min(depth_m)) * Pose::translation(0.0, 0.0, ahead_m)
    }
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

/// Feed of the needle robot: depth and speed along the path.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Feed {
    pub depth_m: f64,
    pub speed_m_s: f64,
    /// Speed last asked for, already 0 when the robot stopped by itself.
    pub wanted_m_s: f64,
}

/// What the feed keeps.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct FeedLimits {
    pub max_feed_m_s: f64,
    pub max_acceleration_m_s2: f64,
    pub max_depth_m: f64,
}

impl Feed {
    pub(crate) fn at_rest(depth_m: f64) -> Self {
        Self { depth_m, speed_m_s: 0.0, wanted_m_s: 0.0 }
    }

    /// One tick: the speed follows the wanted one within acceleration and speed limits, and comes to rest
    /// at the largest depth at the latest.
    pub(crate) fn step(&mut self, limits: &FeedLimits) {
        let FeedLimits { max_feed_m_s, max_acceleration_m_s2, max_depth_m } = *limits;
        let dt_s = 1.0 / TICKS_PER_SECOND as f64;
        let change = max_acceleration_m_s2 * dt_s;
        let room_m = (max_depth_m - self.depth_m).max(0.0);
        // Discrete stopping: at speed n·change the needle still travels n²·change·dt/2, since each tick
        // moves by the mean of its two speeds. One `change` of reserve covers the tick in progress.
        let stoppable_m_s = ((2.0 * max_acceleration_m_s2 * room_m).sqrt() - change).max(0.0);
        let wanted = self.wanted_m_s.clamp(0.0, max_feed_m_s).min(stoppable_m_s);
        let next = wanted.clamp((self.speed_m_s - change).max(0.0), self.speed_m_s + change);
        let travel_m = 0.5 * (self.speed_m_s + next) * dt_s;
        self.speed_m_s = next;
        self.depth_m = (self.depth_m + travel_m).min(max_depth_m.max(self.depth_m));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fixture;

    fn needle(curvature_per_m: f64) -> NeedleSpec {
        NeedleSpec { curvature_per_m, ..fixture::needle() }
    }

    #[test]
    fn truth_deflection_is_half_kappa_l_squared() {
        // κL²/2 at 100 mm is 2.5 mm for 0.5 /m; the next term, κ³L⁴/24, is 0.5 µm.
        let path = Path::new(&needle(0.5), Point::origin(), -Vector::z(), 0.0, 0.15);
        let tip = path.pose_at(0.1).translation.vector;
        assert!((tip.x.hypot(tip.y) - 2.5e-3).abs() < 1e-6, "{tip}");
    }

    #[test]
    fn truth_path_is_a_circle_of_radius_one_over_kappa() {
        let kappa = 4.5;
        let axis = Vector::new(0.8, 0.0, -0.6);
        let path = Path::new(&needle(kappa), Point::origin(), axis, 0.7, 0.2);
        for s in [0.0003, 0.05, 0.1234567, 0.199] {
            let chord = path.pose_at(s).translation.vector.norm();
            assert!((chord - 2.0 / kappa * (kappa * s / 2.0).sin()).abs() < 1e-12);
        }
    }

    #[test]
    fn bends_down_away_from_a_bevel_that_looks_up() {
        let axis = Vector::new(0.8, 0.0, -0.6);
        let path = Path::new(&needle(1.0), Point::origin(), axis, 0.0, 0.1);
        let tip = path.pose_at(0.1);
        assert!(tip.translation.vector.z < -0.06 && tip.translation.vector.y.abs() < 1e-12);
        assert!(path.seen_at(0.1).bevel_normal_in_phantom.z > 0.0);
    }

    #[test]
    fn bevel_of_a_right_angle_looks_ahead() {
        let spec = NeedleSpec { bevel_rad: std::f64::consts::FRAC_PI_2, ..needle(0.0) };
        let axis = Vector::new(0.6, 0.0, -0.8);
        let seen = Path::new(&spec, Point::origin(), axis, 0.3, 0.1).seen_at(0.05);
        assert!((seen.bevel_normal_in_phantom - axis).norm() < 1e-12);
    }

    #[test]
    fn centreline_runs_from_the_surface_to_the_tip_in_small_steps() {
        for entry_z in [0.0, 0.003, -0.003] {
            let axis = Vector::new(0.8, 0.0, -0.6);
            let path = Path::new(&needle(0.5), Point::new(0.01, 0.0, entry_z), axis, 0.0, 0.15);
            let depth = 0.0613;
            let seen = path.seen_at(depth);
            let points = &seen.centreline_in_phantom;
            assert!(points[0].z.abs() < 1e-12, "begins on the face: {}", points[0]);
            let tip = path.pose_at(depth).translation.vector;
            assert!((seen.tip_in_phantom().coords - tip).norm() < 1e-12);
            assert!(points.iter().all(|p| p.z <= 1e-12));
            // The first step may span the slide to the face.
            assert!(points.windows(2).skip(1).all(|w| (w[1] - w[0]).norm() <= 2e-3 + 1e-12));
        }
    }

    fn limits() -> FeedLimits {
        FeedLimits { max_feed_m_s: 0.02, max_acceleration_m_s2: 0.1, max_depth_m: 0.05 }
    }

    #[test]
    fn feed_keeps_its_limits_and_stops_at_the_end_of_its_travel() {
        let robot = limits();
        let mut feed = Feed::at_rest(0.01);
        feed.wanted_m_s = 1.0;
        let max_depth_m = robot.max_depth_m;
        for _ in 0..20_000 {
            let before = feed;
            feed.step(&robot);
            assert!(feed.speed_m_s <= robot.max_feed_m_s + 1e-15 && feed.speed_m_s >= 0.0);
            let acceleration = (feed.speed_m_s - before.speed_m_s).abs() * 1e3;
            assert!(acceleration <= robot.max_acceleration_m_s2 * (1.0 + 1e-9));
            assert!(feed.depth_m >= before.depth_m && feed.depth_m <= max_depth_m);
        }
        assert!(max_depth_m - feed.depth_m < 1e-5, "{}", max_depth_m - feed.depth_m);
    }

    #[test]
    fn truth_stopping_distance_is_v_squared_over_two_a() {
        let robot = limits();
        let mut feed = Feed { depth_m: 0.0, speed_m_s: 0.01, wanted_m_s: 0.0 };
        for _ in 0..1000 {
            feed.step(&robot);
        }
        let expected = 0.01 * 0.01 / (2.0 * robot.max_acceleration_m_s2);
        assert!((feed.depth_m - expected).abs() < 1e-9 && feed.speed_m_s == 0.0);
    }
}
