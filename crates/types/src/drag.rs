use crate::{Point, Vector};

/// Tissue that a needle's tip carries along before it pierces it: where every point of the resting phantom has gone.
///
/// u(r) = u₀·exp(−|r − c|/ℓ) for rest points r, phantom frame. What the tip pushes moves as far as the tip has come, and
/// less with distance in every direction. Tissue keeps its order, nothing folds over, while |u₀| < ℓ. The law's form and ℓ
/// are assumed.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Drag {
    /// c, the rest point that the tip pushes, phantom frame.
    pub centre_in_phantom: Point,
    /// u₀, where that point is now minus where it was, phantom frame.
    pub displacement_in_phantom: Vector,
    /// ℓ, the distance at which 1/e of the displacement is left, above 0.
    pub decay_m: f64,
}

impl Drag {
    /// Where a point of the resting phantom is now, minus where it was.
    pub fn displacement_m(&self, rest: Point) -> Vector {
        self.displacement_in_phantom * libm::exp(-(rest - self.centre_in_phantom).norm() / self.decay_m)
    }

    /// True when tissue can follow: all numbers finite, ℓ positive, and |u₀| below 0.9·ℓ, so that nothing folds over.
    pub fn is_sound(&self) -> bool {
        const MOST_OF_FOLD: f64 = 0.9;
        let finite =
            self.centre_in_phantom.iter().chain(self.displacement_in_phantom.iter()).all(|v| v.is_finite());
        finite
            && self.decay_m.is_finite()
            && self.displacement_in_phantom.norm() < MOST_OF_FOLD * self.decay_m
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn truth_all_of_it_at_the_tip_and_one_part_in_e_at_the_decay_length() {
        let drag = Drag {
            centre_in_phantom: Point::new(1e-3, 2e-3, -3e-3),
            displacement_in_phantom: Vector::new(6e-4, 0.0, -8e-4),
            decay_m: 5e-3,
        };
        assert_eq!(drag.displacement_m(drag.centre_in_phantom), drag.displacement_in_phantom);
        let there = drag.displacement_m(drag.centre_in_phantom + Vector::new(0.0, 3e-3, -4e-3));
        assert!((there - drag.displacement_in_phantom / core::f64::consts::E).norm() < 1e-18, "{there}");
    }
}
