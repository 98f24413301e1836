//! A shaft that is turned at its entry, and that tissue holds farther in.
//!
//! The buried shaft is a beam on an elastic foundation (Hetényi 1946): turned by θ where it enters, at a place that stays,
//! it lies aside by w(s) = θ·ℓ·exp(−s/ℓ)·sin(s/ℓ) at depth s, ℓ = ⁴√(4EI/k). Steel as thick as a 22G needle in tissue of
//! k = 15 kN/m² has ℓ = 28 mm, and ℓ goes with the diameter. [derived] What is outside is straight. The tissue that gives way
//! for the shaft is not moved in the picture.

use nalgebra::UnitQuaternion;
use sonoloop_types::{NeedlePath, Point, Pose, Vector};

use crate::needle_force::REFERENCE_DIAMETER_M;

/// ℓ of a needle of [`REFERENCE_DIAMETER_M`].
const REFERENCE_REACH_M: f64 = 28e-3;

/// How far a turn at the entry reaches, for a needle of this diameter.
pub(crate) fn reach_m(diameter_m: f64) -> f64 {
    REFERENCE_REACH_M * diameter_m / REFERENCE_DIAMETER_M
}

/// A needle that is turned at its entry, against one at rest.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Sway {
    pub entry: Point,
    /// Unit vector along the needle at rest.
    pub axis: Vector,
    /// θ as axis times angle, across the needle.
    pub turn: Vector,
    /// ℓ.
    pub reach_m: f64,
}

impl Sway {
    /// w/θ and its slope at depth s.
    fn bend(&self, s_m: f64) -> [f64; 2] {
        if s_m <= 0.0 {
            return [s_m, 1.0];
        }
        let u = s_m / self.reach_m;
        let (sine, cosine) = libm::sincos(u);
        let left = libm::exp(-u);
        [self.reach_m * left * sine, left * (cosine - sine)]
    }

    /// Moves what lies near a place of the needle at rest as the needle moves there.
    pub(crate) fn at(&self, rest: Point) -> Pose {
        let [aside_m, slope] = self.bend(self.axis.dot(&(rest - self.entry)));
        let turn = UnitQuaternion::from_scaled_axis(self.turn * slope);
        let moved = rest + self.turn.cross(&self.axis) * aside_m;
        Pose::from_parts((moved.coords - turn * rest.coords).into(), turn)
    }

    /// The needle as it lies now.
    pub(crate) fn needle(&self, rest: NeedlePath) -> NeedlePath {
        let at_tip = self.at(rest.tip_in_phantom());
        NeedlePath {
            centreline_in_phantom: rest.centreline_in_phantom.iter().map(|&p| self.at(p) * p).collect(),
            axis_in_phantom: at_tip * rest.axis_in_phantom,
            bevel_normal_in_phantom: at_tip * rest.bevel_normal_in_phantom,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SWAY: Sway = Sway {
        entry: Point::new(-0.03, 0.01, 0.0),
        axis: Vector::new(0.6, 0.0, -0.8),
        turn: Vector::new(0.0, 0.01, 0.0),
        reach_m: 28e-3,
    };

    #[test]
    fn truth_the_beam_meets_its_equation_and_its_ends() {
        let moved = |s: f64| {
            let p = SWAY.entry + SWAY.axis * s;
            (SWAY.at(p) * p - p).norm()
        };
        assert!(moved(0.0) < 1e-15, "the entry rests");
        // θ at the entry, straight outside, and next to nothing three lengths in.
        assert!((moved(1e-5) / 1e-5 - 0.01).abs() < 1e-5);
        assert!((moved(-0.1) - 0.01 * 0.1).abs() < 1e-12);
        assert!(moved(84e-3) < 0.01 * 28e-3 * 0.05);
        // EI·w⁗ = −k·w, that is w⁗ = −4w/ℓ⁴.
        let w = |s: f64| SWAY.bend(s)[0];
        for s in [10e-3, 30e-3, 55e-3] {
            let h = 1e-3;
            let fourth =
                (w(s - 2.0 * h) - 4.0 * w(s - h) + 6.0 * w(s) - 4.0 * w(s + h) + w(s + 2.0 * h)) / h.powi(4);
            let expected = -4.0 * w(s) / SWAY.reach_m.powi(4);
            assert!((fourth - expected).abs() < 0.01 * 4.0 / SWAY.reach_m.powi(3), "{fourth} {expected}");
            let slope = (w(s + 1e-6) - w(s - 1e-6)) / 2e-6;
            assert!((slope - SWAY.bend(s)[1]).abs() < 1e-6);
        }
    }

    #[test]
    fn a_thicker_needle_is_held_less() {
        // EI goes with the fourth power of the diameter.
        assert!((reach_m(2.0 * REFERENCE_DIAMETER_M) - 56e-3).abs() < 1e-12);
    }
}
