use crate::{Point, Vector};

/// Depth over which a layer of any thickness gives way. [assumed] About half the length of a linear array.
const DECAY_M: f64 = 20e-3;
/// Share of the depth at which layers would fold over one another that a press may have: what is left of the
/// uppermost tissue is a tenth of its thickness. [assumed]
const MOST_OF_FOLD: f64 = 0.9;
/// No face and no phantom is larger.
const LARGEST_M: f64 = 1.0;
/// How soon the tissue beside the face is at rest. [assumed]
const EDGE_M: f64 = 5e-3;

/// Tissue pressed by a probe's face: where every point of the resting phantom has gone.
///
/// The top face sinks by `depth_m` under the probe's face, less beside it, and the bottom rests:
/// u_z = −δ(x)·f(z)·X(x)·Y(y) with f″ = f/L², δ linear along the face where it presses and 0 where it does not. A probe's face is long and narrow, so what is pressed away leaves by its long
/// sides: u_y follows from a divergence of zero, and u_x is zero. x runs along the face, y across it. Derived from
/// these assumptions; there is no memory, so it returns as it went.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Indentation {
    /// Middle of the face, phantom frame.
    pub x_m: f64,
    /// Middle of the face, phantom frame.
    pub y_m: f64,
    /// Turn of the face about the phantom's z.
    pub yaw_rad: f64,
    /// Half the face's length and half its width.
    pub half_size_m: [f64; 2],
    /// How far the top face is pressed down in the face's middle; negative where only one end of a leaning face presses.
    pub depth_m: f64,
    /// How much deeper it is pressed per length along the face: the face leans.
    pub lean: f64,
    /// Thickness of the phantom.
    pub thickness_m: f64,
}

impl Indentation {
    /// True when it is a press that tissue can follow: all numbers finite, sizes and thickness positive and at most 1 m,
    /// the depth at its deeper end not negative and below 0.9·L·tanh(thickness/L). At L·tanh(thickness/L), 20 mm in a thick phantom, the
    /// uppermost layers would pass through one another: −df/dζ at the top is its inverse.
    pub fn is_sound(&self) -> bool {
        let is_size = |v: f64| v > 0.0 && v <= LARGEST_M;
        [self.x_m, self.y_m, self.yaw_rad, self.depth_m, self.lean].iter().all(|v| v.is_finite())
            && self.half_size_m.into_iter().all(is_size)
            && is_size(self.thickness_m)
            && (0.0..MOST_OF_FOLD * DECAY_M * libm::tanh(self.thickness_m / DECAY_M))
                .contains(&self.deepest_m())
    }

    /// How far the top face is pressed down at a distance along the face from its middle, before [`Self::lengthwise`].
    pub fn depth_at_m(&self, along_m: f64) -> f64 {
        let half_m = self.half_size_m[0];
        // No `clamp`: an unsound size must not panic.
        (self.depth_m + self.lean * along_m.max(-half_m).min(half_m)).max(0.0)
    }

    /// At the deeper end.
    pub fn deepest_m(&self) -> f64 {
        self.depth_m + self.lean.abs() * self.half_size_m[0]
    }

    /// The most that any tissue goes sideways: ∫Y dy ends at half the face's width, and the slope is steepest at the top.
    pub fn most_sideways_m(&self) -> f64 {
        let [_, slope] = self.by_depth(0.0);
        self.deepest_m().abs() * self.half_size_m[1] * slope
    }

    /// f and −df/dζ at a depth ζ below the resting top face.
    pub fn by_depth(&self, depth_m: f64) -> [f64; 2] {
        let [left, whole] = [self.thickness_m - depth_m, self.thickness_m].map(|v| v.max(0.0) / DECAY_M);
        let scale = 1.0 / libm::sinh(whole.clamp(1e-6, 50.0));
        let left = left.min(50.0);
        [libm::sinh(left) * scale, libm::cosh(left) * scale / DECAY_M]
    }

    /// X at a distance along the face from its middle.
    pub fn lengthwise(&self, along_m: f64) -> f64 {
        share(along_m, self.half_size_m[0])
    }

    /// Y and ∫Y dy at a distance across the face from its middle.
    pub fn crosswise(&self, across_m: f64) -> [f64; 2] {
        let half_m = self.half_size_m[1];
        let integral = |v: f64| {
            let u = v / EDGE_M;
            v * libm::erf(u) + EDGE_M / core::f64::consts::PI.sqrt() * libm::exp(-u * u)
        };
        [share(across_m, half_m), 0.5 * (integral(across_m + half_m) - integral(across_m - half_m))]
    }

    /// Distances of a place along the face and across it from its middle.
    fn along_and_across_m(&self, x_m: f64, y_m: f64) -> [f64; 2] {
        let (sin, cos) = libm::sincos(self.yaw_rad);
        let (dx, dy) = (x_m - self.x_m, y_m - self.y_m);
        [cos * dx + sin * dy, cos * dy - sin * dx]
    }

    /// Where what is pressed away goes: the face's short direction, phantom frame.
    pub fn sideways(&self) -> Vector {
        let (sin, cos) = libm::sincos(self.yaw_rad);
        Vector::new(-sin, cos, 0.0)
    }

    /// Where a point of the resting phantom is now, minus where it was.
    pub fn displacement_m(&self, rest: Point) -> Vector {
        let [f, slope] = self.by_depth(-rest.z);
        let [along_m, across_m] = self.along_and_across_m(rest.x, rest.y);
        let lengthwise_m = self.depth_at_m(along_m) * self.lengthwise(along_m);
        let [y, swept_m] = self.crosswise(across_m);
        self.sideways() * (lengthwise_m * swept_m * slope) - Vector::z() * (lengthwise_m * y * f)
    }

    /// The point of the resting phantom that is at `now`, for a sound press.
    pub fn rest(&self, now: Point) -> Point {
        // A fixed point; of a sound press each step leaves at most nine tenths of the error.
        (0..200).fold(now, |rest, _| now - self.displacement_m(rest))
    }
}

/// 1 well inside a stretch of twice this half, 0 well outside.
fn share(v: f64, half_m: f64) -> f64 {
    let step = |v: f64| libm::erf(v / EDGE_M);
    0.5 * (step(v + half_m) - step(v - half_m))
}

#[cfg(test)]
mod tests {
    use super::*;

    const PRESSED: Indentation = Indentation {
        x_m: 2e-3,
        y_m: -1e-3,
        yaw_rad: 0.4,
        half_size_m: [22e-3, 6e-3],
        depth_m: 3e-3,
        lean: 0.0,
        thickness_m: 60e-3,
    };

    #[test]
    fn truth_no_volume_is_lost() {
        let step = 1e-6;
        for (x, y, z) in
            [(0.0, 0.0, -5e-3), (10e-3, 4e-3, -12e-3), (-21e-3, -7e-3, -30e-3), (5e-3, 9e-3, -1e-3)]
        {
            let at = |dx: f64, dy: f64, dz: f64| PRESSED.displacement_m(Point::new(x + dx, y + dy, z + dz));
            let divergence = (at(step, 0.0, 0.0) - at(-step, 0.0, 0.0)).x
                + (at(0.0, step, 0.0) - at(0.0, -step, 0.0)).y
                + (at(0.0, 0.0, step) - at(0.0, 0.0, -step)).z;
            assert!((divergence / (2.0 * step)).abs() < 1e-6, "{divergence}");
        }
    }

    #[test]
    fn truth_a_sound_press_keeps_layers_in_order_and_goes_no_farther_aside_than_told() {
        for thickness_m in [5e-3, 20e-3, 60e-3] {
            let fold_m = DECAY_M * (thickness_m / DECAY_M).tanh();
            let pressed = |share: f64| Indentation {
                depth_m: share * fold_m,
                half_size_m: [0.2, 0.1],
                thickness_m,
                ..PRESSED
            };
            let depths = || (0..=1000).map(|i| thickness_m * f64::from(i) / 1000.0);
            let in_order = |pressed: &Indentation| {
                let now = |d: f64| d - pressed.displacement_m(Point::new(2e-3, -1e-3, -d)).z;
                depths().zip(depths().skip(1)).all(|(above, below)| now(above) < now(below))
            };
            assert!(pressed(0.899).is_sound() && in_order(&pressed(0.899)), "{thickness_m} m");
            assert!(!pressed(0.901).is_sound() && !in_order(&pressed(1.01)), "{thickness_m} m");
            let pressed = pressed(0.8);
            let sideways = |y: f64| pressed.displacement_m(Point::new(0.0, y, 0.0)).xy().norm();
            let most_m = (0..400).map(|i| sideways(f64::from(i) * 1e-3)).fold(0.0, f64::max);
            // Reached beside the face, where Y has fallen to nothing.
            assert!((most_m / pressed.most_sideways_m() - 1.0).abs() < 1e-6, "{most_m}");
        }
    }

    #[test]
    fn rest_undoes_the_displacement() {
        for rest in
            [Point::new(1e-3, 2e-3, -4e-3), Point::new(-18e-3, 7e-3, -30e-3), Point::new(5e-3, 0.0, 0.0)]
        {
            let press = Indentation { depth_m: 12e-3, ..PRESSED };
            assert!((press.rest(rest + press.displacement_m(rest)) - rest).norm() < 1e-9);
        }
    }

    #[test]
    fn truth_a_leaning_face_presses_along_a_line_and_only_where_it_presses() {
        // Unturned, 1 mm deep in the middle, 0.1 deeper per length: nothing is pressed left of −10 mm.
        let leaning = Indentation { yaw_rad: 0.0, depth_m: 1e-3, lean: 0.1, ..PRESSED };
        assert!(leaning.is_sound());
        let sunk_m =
            |along_m: f64| -leaning.displacement_m(Point::new(leaning.x_m + along_m, leaning.y_m, 0.0)).z;
        let middle = leaning.crosswise(0.0)[0];
        for along_m in [-9e-3, -4e-3, 0.0, 3e-3, 8e-3] {
            let expected_m = (1e-3 + 0.1 * along_m) * middle * leaning.lengthwise(along_m);
            assert!((sunk_m(along_m) - expected_m).abs() < 1e-12, "{along_m}");
        }
        assert_eq!(sunk_m(-11e-3), 0.0);
        assert!(!Indentation { lean: 1.0, ..leaning }.is_sound(), "its end would fold");
        assert!(!Indentation { lean: f64::NAN, ..leaning }.is_sound());
    }

    #[test]
    fn truth_the_face_sinks_and_the_bottom_rests() {
        let top = PRESSED.displacement_m(Point::new(2e-3, -1e-3, 0.0));
        assert!((top.z + 3e-3).abs() < 0.3e-3, "{top}");
        assert!(PRESSED.displacement_m(Point::new(0.0, 0.0, -60e-3)).z.abs() < 1e-12);
        assert!(PRESSED.displacement_m(Point::new(0.06, 0.0, 0.0)).norm() < 1e-9);
    }
}
