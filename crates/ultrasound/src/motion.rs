//! Where moved tissue is: [`Indentation`] by tables, and [`Drag`].

use sonoloop_types::{Drag, Indentation, Point, Vector};

use crate::shear::Shear;

/// Distance between the entries of a table. Between them values are linear: at most 40 nm off for a press of 3 mm.
const STEP_M: f64 = 0.05e-3;
const STEPS_PER_M: f64 = 1.0 / STEP_M;
/// The tissue is at rest so far beside the face: erfc(5) is 2e-12.
const BESIDE_M: f64 = 25e-3;

/// A press that moves nothing.
const AT_REST: Indentation = Indentation {
    x_m: 0.0,
    y_m: 0.0,
    yaw_rad: 0.0,
    half_size_m: [STEP_M; 2],
    depth_m: 0.0,
    lean: 0.0,
    thickness_m: STEP_M,
};

/// Tables of one face on one phantom, the press that they serve, and what the needle drags.
pub struct Motion {
    indentation: Indentation,
    drag: Option<Drag>,
    /// [`Indentation::by_depth`] from the resting top face down.
    by_depth: Vec<[f64; 2]>,
    /// [`Indentation::lengthwise`] and [`Indentation::crosswise`] from the face's middle on; the latter's second value is
    /// odd.
    lengthwise: Vec<[f64; 1]>,
    crosswise: Vec<[f64; 2]>,
    sin_cos: (f64, f64),
}

impl Motion {
    /// Of a press, a drag or both, which are sound.
    pub fn new(indentation: Option<&Indentation>, drag: Option<Drag>) -> Self {
        let indentation = indentation.unwrap_or(&AT_REST);
        let [half_length_m, half_width_m] = indentation.half_size_m;
        let places = |reach_m: f64| (0..(reach_m * STEPS_PER_M) as usize + 3).map(|i| i as f64 * STEP_M);
        Self {
            indentation: *indentation,
            drag,
            by_depth: places(indentation.thickness_m).map(|d_m| indentation.by_depth(d_m)).collect(),
            lengthwise: places(half_length_m + BESIDE_M).map(|d_m| [indentation.lengthwise(d_m)]).collect(),
            crosswise: places(half_width_m + BESIDE_M).map(|d_m| indentation.crosswise(d_m)).collect(),
            sin_cos: libm::sincos(indentation.yaw_rad),
        }
    }

    /// Goes on to another press, with the same tables where they serve it.
    pub fn set(&mut self, indentation: Option<&Indentation>, drag: Option<Drag>) {
        let indentation = indentation.unwrap_or(&AT_REST);
        let before = &self.indentation;
        let same =
            before.half_size_m == indentation.half_size_m && before.thickness_m == indentation.thickness_m;
        if !same {
            *self = Self::new(Some(indentation), drag);
        }
        (self.indentation, self.drag) = (*indentation, drag);
        self.sin_cos = libm::sincos(indentation.yaw_rad);
    }

    /// The most that tissue goes sideways, or is dragged. The column that it belongs to may stand twice as far off: seen along columns
    /// that lean by up to 60° a metre of the phantom's horizontal is up to two of the picture's plane.
    pub fn aside_m(&self) -> f64 {
        self.sideways_m() + self.drag.map_or(0.0, |drag| drag.displacement_in_phantom.norm())
    }

    /// The most that tissue goes sideways where nothing drags it, along [`Self::sideways`].
    pub fn sideways_m(&self) -> f64 {
        self.indentation.most_sideways_m()
    }

    /// The most that tissue comes nearer to the picture's plane along the columns, or goes away from it: what goes down stays
    /// on its column, which leans by the slope.
    pub fn reach_m(&self, shear: &Shear) -> f64 {
        shear.elevation_slope.abs() * self.indentation.deepest_m() + 2.0 * self.aside_m()
    }

    /// [`Indentation::sideways`].
    pub fn sideways(&self) -> Vector {
        let (sin, cos) = self.sin_cos;
        Vector::new(-sin, cos, 0.0)
    }

    /// [`Indentation::by_depth`].
    pub fn by_depth(&self, depth_m: f64) -> [f64; 2] {
        between(&self.by_depth, depth_m.max(0.0))
    }

    /// What [`Self::by_depth`] scales to the way down and to the way aside: δ(x)·X·Y and δ(x)·X·∫Y dy at a place of the resting
    /// phantom.
    pub fn by_place(&self, x_m: f64, y_m: f64) -> [f64; 2] {
        let (sin, cos) = self.sin_cos;
        let (dx, dy) = (x_m - self.indentation.x_m, y_m - self.indentation.y_m);
        let (along_m, across_m) = (cos * dx + sin * dy, cos * dy - sin * dx);
        let [x] = between(&self.lengthwise, along_m.abs());
        let [y, swept_m] = between(&self.crosswise, across_m.abs());
        let lengthwise_m = self.indentation.depth_at_m(along_m) * x;
        [lengthwise_m * y, lengthwise_m * swept_m.copysign(across_m)]
    }

    /// Where a point of the resting phantom is now, minus where it was.
    pub fn displacement_m(&self, rest: Point) -> Vector {
        self.displacement_of(self.by_place(rest.x, rest.y), rest)
    }

    /// The same where [`Self::by_place`] is known.
    #[inline]
    pub fn displacement_of(&self, [down, aside]: [f64; 2], rest: Point) -> Vector {
        let [f, slope] = self.by_depth(-rest.z);
        let pressed = self.sideways() * (aside * slope) - Vector::z() * (down * f);
        self.drag.map_or(pressed, |drag| pressed + drag.displacement_m(rest))
    }

    /// What the needle drags.
    pub fn drag(&self) -> Option<&Drag> {
        self.drag.as_ref()
    }
}

/// Linear between the entries of a table; the last ones beyond it.
#[inline]
fn between<const N: usize>(table: &[[f64; N]], at_m: f64) -> [f64; N] {
    let place = (at_m * STEPS_PER_M).min((table.len() - 2) as f64);
    let index = place as usize;
    let share = place - index as f64;
    let (below, above) = (table[index], table[index + 1]);
    core::array::from_fn(|i| below[i] + share * (above[i] - below[i]))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn truth_tables_follow_the_closed_form() {
        let pressed = Indentation {
            x_m: 2e-3,
            y_m: -1e-3,
            yaw_rad: 0.4,
            half_size_m: [22e-3, 6e-3],
            depth_m: 2.5e-3,
            lean: 0.05,
            thickness_m: 60e-3,
        };
        let mut motion =
            Motion::new(Some(&Indentation { depth_m: 1e-3, half_size_m: [9e-3, 2e-3], ..pressed }), None);
        motion.set(Some(&pressed), None);
        for i in 0..2000 {
            let at = f64::from(i);
            let rest =
                Point::new(40e-3 * (at * 0.7).sin(), 20e-3 * (at * 1.1).sin(), -30e-3 * (1.0 + at.sin()));
            let off_m = motion.displacement_m(rest) - pressed.displacement_m(rest);
            assert!(off_m.norm() < 50e-9, "{} nm off at {rest}", off_m.norm() * 1e9);
        }
    }
}
