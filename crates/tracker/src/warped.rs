//! Registration over rigid and affine warps: the same Gauss–Newton with Levenberg–Marquardt damping, composed in the
//! template's coordinates.

use sonoloop_types::{Reason, Warp};

use crate::region::Region;
use crate::register::{Failure, NEAR_PX, Registrar, Registration, eigenvalue_ratio};
use crate::sums::affine_sums;
use crate::template::Template;
use crate::tracker::distance;
use crate::warp::{Moments, Placement, normal_equations, solve, step};

/// Damping λ to begin with; a step that is taken divides it by ten, one that is taken back multiplies it.
const FIRST_DAMPING: f64 = 1e-3;
const LEAST_DAMPING: f64 = 1e-6;
/// A residual that grows by less has not grown: bilinear sampling smooths by what fraction of a pixel the template lies off the
/// grid, and the mean square of a sharp patch's noise changes by some per cent with that alone. Without this, right steps were
/// taken back, and half of the iterations went into ever shorter ones.
const GROWTH: f64 = 1.1;
/// With this much the steps are too short to matter.
const MOST_DAMPING: f64 = 1e3;

/// A placement and the normal equations there.
#[derive(Debug, Clone, Copy)]
struct Accepted {
    place: Placement,
    sums: Moments,
    /// The smallest mean square residual so far.
    least: f64,
}

impl Registrar {
    /// Finds `template` in `region` over the settings' warp, from `start` on; `change` is Δ, how much brighter the image
    /// has become.
    pub(crate) fn run_warped(
        &mut self,
        region: &Region,
        template: &Template,
        change: f32,
        start: Placement,
    ) -> Result<Registration, Failure> {
        let half_px = self.window.half_px();
        let mut place = start;
        let mut damping = FIRST_DAMPING;
        let mut accepted: Option<Accepted> = None;
        let mut adapted_at: Option<Placement> = None;
        let mut approaching = self.approaches();
        let mut before_px = None;
        for iteration in 1..=self.max_iterations {
            let fail = |reason| Failure { reason, iterations: iteration };
            self.sample(region, &place).map_err(fail)?;
            if self.is_conditional() && !approaching {
                let stale = adapted_at.is_none_or(|then| {
                    self.adapts_again() && place.corner_distance(&then, half_px) > NEAR_PX
                });
                if stale {
                    self.adapt(template);
                    adapted_at = Some(place);
                    accepted = None;
                }
            }
            let comparison = self.comparison(template, change, adapted_at.is_some());
            let sums = affine_sums(comparison.0, &comparison.1);
            let mean_square = sums.squares / sums.weight;
            match accepted {
                Some(before) if mean_square > GROWTH * before.least => {
                    damping *= 10.0;
                    before_px = None;
                    if damping > MOST_DAMPING {
                        return Ok(before.registration(iteration));
                    }
                }
                _ => {
                    damping = (damping / 10.0).max(LEAST_DAMPING);
                    let least = accepted.map_or(mean_square, |before| before.least.min(mean_square));
                    accepted = Some(Accepted { place, sums, least });
                }
            }
            // `accepted` was set just now, or matched.
            let Some(from) = accepted else { return Err(fail(Reason::Singular)) };
            if from.sums.lacks_texture() {
                return Err(fail(Reason::Singular));
            }
            let delta = self.step_from(&from.sums, damping).ok_or_else(|| fail(Reason::Singular))?;
            let next = from.place.compose(delta);
            let moved_px = next.corner_distance(&from.place, half_px);
            // Written so that NaN fails.
            let near = distance(next.centre_px, start.centre_px) <= self.leash_px;
            if !(near && next.is_sane() && moved_px <= self.window.side as f64 / 2.0) {
                return Err(fail(Reason::Diverged));
            }
            place = next;
            if approaching {
                approaching = moved_px >= NEAR_PX && iteration < Self::MAX_APPROACH;
                accepted = if approaching { accepted } else { None };
            } else if self.has_converged(moved_px, before_px) {
                return Ok(Accepted { place, ..from }.registration(iteration));
            }
            before_px = Some(moved_px);
        }
        let conditioning = accepted.map_or(0.0, |accepted| accepted.conditioning());
        Ok(Registration { place, iterations: self.max_iterations, conditioning })
    }

    /// The damped step; over the translation alone where the whole warp has none.
    fn step_from(&self, sums: &Moments, damping: f64) -> Option<[[f64; 2]; 3]> {
        let half_px = self.window.half_px();
        [self.warp, Warp::Translation].iter().find_map(|&warp| {
            let (count, matrix, vector) = normal_equations(warp, sums);
            let parameters = [damping, 10.0 * damping]
                .iter()
                .find_map(|&damping| solve(count, &matrix, &vector, damping))?;
            Some(step(warp, &parameters[..count], half_px))
        })
    }
}

impl Accepted {
    fn conditioning(&self) -> f64 {
        let [uu, uv, vv] = self.sums.gradients[0];
        eigenvalue_ratio(uu, uv, vv)
    }

    fn registration(&self, iterations: u32) -> Registration {
        Registration { place: self.place, iterations, conditioning: self.conditioning() }
    }
}
