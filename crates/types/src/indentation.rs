use crate::{Point, Vector};

/// Depth over which a layer of any thickness gives way. [assumed] About half the length of a linear array.
const DECAY_M: f64 = 20e-3;
/// How soon the tissue beside the face is at rest. [assumed]
const EDGE_M: f64 = 5e-3;

/// Tissue pressed by a probe's face: where every point of the resting phantom has gone.
///
/// The top face sinks by `depth_m` under the probe's face, less beside it, and the bottom rests:
/// u_z = −δ·f(z)·X(x)·Y(y) with f″ = f/L². A probe's face is long and narrow, so what is pressed away leaves by its long
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
    /// How far the top face is pressed down.
    pub depth_m: f64,
    /// Thickness of the phantom.
    pub thickness_m: f64,
}

impl Indentation {
    /// f and −df/dζ at a depth ζ below the resting top face.
    pub fn by_depth(&self, depth_m: f64) -> [f64; 2] {
        let [left, whole] = [self.thickness_m - depth_m, self.thickness_m].map(|v| v.max(0.0) / DECAY_M);
        let scale = 1.0 / libm::sinh(whole.clamp(1e-6, 50.0));
        let left = left.min(50.0);
        [libm::sinh(left) * scale, libm::cosh(left) * scale / DECAY_M]
    }

    /// δ·X·Y and δ·X·∫Y dy at a place of the resting phantom, which [`Self::by_depth`] scales to the way down and to
    /// the way along [`Self::sideways`].
    pub fn by_place(&self, x_m: f64, y_m: f64) -> [f64; 2] {
        let (sin, cos) = libm::sincos(self.yaw_rad);
        let (dx, dy) = (x_m - self.x_m, y_m - self.y_m);
        let (along, across) = (cos * dx + sin * dy, cos * dy - sin * dx);
        let [half_length_m, half_width_m] = self.half_size_m;
        let step = |v: f64| libm::erf(v / EDGE_M);
        let integral = |v: f64| {
            let u = v / EDGE_M;
            v * libm::erf(u) + EDGE_M / core::f64::consts::PI.sqrt() * libm::exp(-u * u)
        };
        let share = |v: f64, half: f64| 0.5 * (step(v + half) - step(v - half));
        let lengthwise = self.depth_m * share(along, half_length_m);
        let swept = 0.5 * (integral(across + half_width_m) - integral(across - half_width_m));
        [lengthwise * share(across, half_width_m), lengthwise * swept]
    }

    /// Where what is pressed away goes: the face's short direction, phantom frame.
    pub fn sideways(&self) -> Vector {
        let (sin, cos) = libm::sincos(self.yaw_rad);
        Vector::new(-sin, cos, 0.0)
    }

    /// Where a point of the resting phantom is now, minus where it was.
    pub fn displacement_m(&self, rest: Point) -> Vector {
        let [f, slope] = self.by_depth(-rest.z);
        let [down, aside] = self.by_place(rest.x, rest.y);
        self.sideways() * (aside * slope) - Vector::z() * (down * f)
    }

    /// The point of the resting phantom that is at `now`, found from a guess by fixed-point steps; two from a guess a
    /// few tenths of a millimetre off leave a micrometre.
    pub fn rest(&self, now: Point, guess: Point, steps: usize) -> Point {
        (0..steps).fold(guess, |rest, _| now - self.displacement_m(rest))
    }
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
    fn truth_the_face_sinks_and_the_bottom_rests() {
        let top = PRESSED.displacement_m(Point::new(2e-3, -1e-3, 0.0));
        assert!((top.z + 3e-3).abs() < 0.3e-3, "{top}");
        assert!(PRESSED.displacement_m(Point::new(0.0, 0.0, -60e-3)).z.abs() < 1e-12);
        assert!(PRESSED.displacement_m(Point::new(0.06, 0.0, 0.0)).norm() < 1e-9);
    }

    #[test]
    fn the_way_back_is_found() {
        let rest = Point::new(12e-3, 3e-3, -8e-3);
        let now = rest + PRESSED.displacement_m(rest);
        let found = PRESSED.rest(now, now, 30);
        assert!((found - rest).norm() < 1e-9, "{found}");
    }
}
