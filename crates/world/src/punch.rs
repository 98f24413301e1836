//! Flat circular punch on an elastic layer that is bonded to a rigid base.
//!
//! F = κ·2aE*·δ: on a half-space κ = 1 (Johnson, Contact Mechanics, 1985, §3.8); a layer of thickness h resists more. With
//! the pressure as ∫₀ᵃ φ(t)·cos(ξt) dt in Hankel space the mixed boundary problem becomes a Fredholm equation of the
//! second kind (Lebedev and Ufliand 1958; Hayes et al. 1972, doi 10.1016/0021-9290(72)90010-3),
//! ψ(x) − (2/π)∫₀ᵃ ψ(t) ∫₀^∞ M(ξh)·cos(ξx)·cos(ξt) dξ dt = 1, κ the mean of ψ, where 1 − M(s) is how much a layer gives
//! way under a pressure of wave number s/h, as a share of what a half-space does.

use nalgebra::{DMatrix, DVector};

/// Places of ψ; more change κ by less than 10⁻³.
const PLACES: usize = 24;
/// Steps and end of the integral over s: M(12) is below 10⁻⁷.
const STEPS: usize = 600;
const LAST_S: f64 = 12.0;

/// κ for a punch of radius `radius_m` on a layer of `thickness_m` whose Poisson's ratio is `poisson`.
pub(crate) fn layer_factor(radius_m: f64, thickness_m: f64, poisson: f64) -> f64 {
    let ratio = radius_m / thickness_m;
    let step = LAST_S / STEPS as f64;
    let s = |k: usize| (k as f64 + 0.5) * step;
    let place = |i: usize| (i as f64 + 0.5) / PLACES as f64 * ratio;
    let cosines = DMatrix::from_fn(STEPS, PLACES, |k, i| libm::cos(s(k) * place(i)));
    let weighted = DMatrix::from_fn(STEPS, PLACES, |k, i| (1.0 - yielding(s(k), poisson)) * cosines[(k, i)]);
    let kernel = cosines.tr_mul(&weighted);
    let share = std::f64::consts::FRAC_2_PI * ratio * step / PLACES as f64;
    let equations = DMatrix::identity(PLACES, PLACES) - kernel * share;
    // M < 1 keeps the equations regular for any layer; one too thin for these places would not be, and is none here.
    equations.lu().solve(&DVector::from_element(PLACES, 1.0)).map_or(1.0, |psi| psi.mean())
}

/// How far the bonded layer gives way to a pressure of wave number s per thickness, as a share of a half-space.
fn yielding(s: f64, poisson: f64) -> f64 {
    let k = 3.0 - 4.0 * poisson;
    let [sinh, cosh] = [libm::sinh(2.0 * s), libm::cosh(2.0 * s)];
    (2.0 * k * sinh - 4.0 * s) / (2.0 * k * cosh + 4.0 * s * s + 1.0 + k * k)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn truth_published_factors_of_a_flat_punch() {
        // Hayes et al. 1972, table 1: κ for a/h of 0.2, 0.4, 0.6, 0.8 and 1. [memory]
        let published =
            [(0.5, [1.281, 1.683, 2.211, 2.855, 3.609]), (0.3, [1.207, 1.472, 1.784, 2.124, 2.480])];
        for (poisson, factors) in published {
            for (i, factor) in factors.into_iter().enumerate() {
                let ratio = 0.2 * (i as f64 + 1.0);
                let is = layer_factor(ratio, 1.0, poisson);
                assert!((is / factor - 1.0).abs() < 5e-3, "ν {poisson}, a/h {ratio}: {is}");
            }
        }
    }

    #[test]
    fn truth_a_thick_layer_is_a_half_space() {
        assert!((layer_factor(1e-3, 1.0, 0.49) - 1.0).abs() < 2e-3);
    }
}
