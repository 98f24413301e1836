//! Registration over rigid and affine warps: the same Gauss–Newton with Levenberg–Marquardt damping, composed in the
//! template's coordinates.
//!
//! Rows of the window are summed first, over 1, x and x², and then weighted with y: thirteen sums per row instead of the
//! twenty-seven of H and b.

use sonoloop_types::{Reason, Warp};

use crate::region::{Inside, Region};
use crate::register::{
    Failure, LANES, NEAR_PX, Pixels, Reference, Registrar, Registration, Row, eigenvalue_ratio,
};
use crate::template::Template;
use crate::warp::{Moments, Placement, normal_equations, solve, step};

/// Damping λ to begin with; a step that makes the residual smaller divides it by ten, one that does not multiplies it.
const FIRST_DAMPING: f64 = 1e-3;
const LEAST_DAMPING: f64 = 1e-6;
/// With this much the steps are too short to matter.
const MOST_DAMPING: f64 = 1e3;

/// A placement and the normal equations there.
#[derive(Debug, Clone, Copy)]
struct Accepted {
    place: Placement,
    sums: Moments,
    mean_square: f64,
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
        let half_px = (self.side as f64 - 1.0) / 2.0;
        let mut place = start;
        let mut damping = FIRST_DAMPING;
        let mut accepted: Option<Accepted> = None;
        let mut adapted_at: Option<Placement> = None;
        let mut approaching = self.approaches();
        for iteration in 1..=self.max_iterations {
            let fail = |reason| Failure { reason, iterations: iteration };
            let inside = self.sample_warped(region, &place).map_err(fail)?;
            if self.is_conditional() && !approaching {
                let stale = adapted_at.is_none_or(|then| {
                    self.adapts_again() && place.corner_distance(&then, half_px) > NEAR_PX
                });
                if stale {
                    self.adapt(template, inside);
                    adapted_at = Some(place);
                    accepted = None;
                }
            }
            let reference = self.reference(template, change, adapted_at.is_some());
            let sums = moments(&self.weights, &self.patch, self.side, &reference, inside);
            let mean_square = sums.squares / sums.weight;
            match accepted {
                Some(before) if mean_square > before.mean_square => {
                    damping *= 10.0;
                    if damping > MOST_DAMPING {
                        return Ok(before.registration(iteration));
                    }
                }
                _ => {
                    damping = (damping / 10.0).max(LEAST_DAMPING);
                    accepted = Some(Accepted { place, sums, mean_square });
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
            if !(next.is_sane() && moved_px <= self.side as f64 / 2.0) {
                return Err(fail(Reason::Diverged));
            }
            place = next;
            if approaching {
                approaching = moved_px >= NEAR_PX && iteration < Self::MAX_APPROACH;
                accepted = if approaching { accepted } else { None };
            } else if moved_px < self.epsilon_px {
                return Ok(Accepted { place, ..from }.registration(iteration));
            }
        }
        let conditioning = accepted.map_or(0.0, |accepted| accepted.conditioning());
        Ok(Registration { place, iterations: self.max_iterations, conditioning })
    }

    /// The damped step; over the translation alone where the whole warp has none.
    fn step_from(&self, sums: &Moments, damping: f64) -> Option<[[f64; 2]; 3]> {
        let half_px = (self.side as f64 - 1.0) / 2.0;
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

/// The sums of one iteration over the part of the window inside the picture.
fn moments(weights: &[f32], patch: &[f32], side: usize, reference: &Reference, inside: Inside) -> Moments {
    let half = (side as f32 - 1.0) / 2.0;
    let mut sums = Moments::default();
    for k in inside.y[0]..inside.y[1] {
        let row = Line {
            row: Row::new(weights, patch, side, reference, k, inside),
            first_x: (inside.x[0] as f32 - half) / half,
            x_step: 1.0 / half,
        };
        row.add_to(f64::from((k as f32 - half) / half), &mut sums);
    }
    sums
}

/// One row of the window and where its pixels are.
struct Line<'a> {
    row: Row<'a>,
    /// Coordinate x over the half-side of the first pixel, and from one to the next.
    first_x: f32,
    x_step: f32,
}

/// Sums of a row: w, w·e², then for 1, x, x² those with g_u², g_u·g_v, g_v², then for 1, x those with e·g_u, e·g_v.
const SUMS: usize = 2 + 9 + 4;

impl Line<'_> {
    fn add_to(&self, y: f64, sums: &mut Moments) {
        let width = self.row.width();
        let whole = width - width % LANES;
        let mut totals = [[0.0_f32; LANES]; SUMS];
        for start in (0..whole).step_by(LANES) {
            self.add_lanes::<LANES>(start, &mut totals);
        }
        for start in whole..width {
            self.add_lanes::<1>(start, &mut totals);
        }
        let of = totals.map(|lanes| lanes.iter().map(|lane| f64::from(*lane)).sum::<f64>());
        sums.weight += of[0];
        sums.squares += of[1];
        for i in 0..3 {
            let [plain, by_x, by_xx] = [of[2 + i], of[5 + i], of[8 + i]];
            let terms = [plain, by_x, y * plain, by_xx, y * by_x, y * y * plain];
            for (sum, term) in sums.gradients.iter_mut().zip(terms) {
                sum[i] += term;
            }
        }
        for i in 0..2 {
            let [plain, by_x] = [of[11 + i], of[13 + i]];
            for (sum, term) in sums.residuals.iter_mut().zip([plain, by_x, y * plain]) {
                sum[i] += term;
            }
        }
    }

    #[inline(always)]
    fn add_lanes<const N: usize>(&self, start: usize, totals: &mut [[f32; LANES]; SUMS]) {
        let Pixels { weight, gu, gv, e } = self.row.pixels::<N>(start);
        for k in 0..N {
            let x = self.first_x + (start + k) as f32 * self.x_step;
            let (wu, wv) = (weight[k] * gu[k], weight[k] * gv[k]);
            let (uu, uv, vv) = (wu * gu[k], wu * gv[k], wv * gv[k]);
            let (eu, ev) = (wu * e[k], wv * e[k]);
            let terms = [
                weight[k],
                weight[k] * e[k] * e[k],
                uu,
                uv,
                vv,
                x * uu,
                x * uv,
                x * vv,
                x * x * uu,
                x * x * uv,
                x * x * vv,
                eu,
                ev,
                x * eu,
                x * ev,
            ];
            for (total, term) in totals.iter_mut().zip(terms) {
                total[k] += term;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The sums written out pixel by pixel in double precision.
    fn slow(weights: &[f32], patch: &[f32], side: usize, template: &Template, share: f64) -> Moments {
        let mut sums = Moments::default();
        let half = (side as f64 - 1.0) / 2.0;
        let at = |padded: &[f32], x: usize, y: usize| f64::from(padded[y * (side + 2) + x]);
        for k in 0..side {
            for i in 0..side {
                let (x, y) = ((i as f64 - half) / half, (k as f64 - half) / half);
                let gradient = |padded: &[f32]| {
                    [
                        0.5 * (at(padded, i + 2, k + 1) - at(padded, i, k + 1)),
                        0.5 * (at(padded, i + 1, k + 2) - at(padded, i + 1, k)),
                    ]
                };
                let (own, its) = (gradient(patch), gradient(&template.padded));
                let g = [0, 1].map(|axis| (1.0 - share) * own[axis] + share * its[axis]);
                let e = at(patch, i + 1, k + 1) - at(&template.padded, i + 1, k + 1);
                let w = f64::from(weights[k * side + i]);
                sums.weight += w;
                sums.squares += w * e * e;
                for (sum, phi) in sums.gradients.iter_mut().zip([1.0, x, y, x * x, x * y, y * y]) {
                    *sum = [
                        sum[0] + w * phi * g[0] * g[0],
                        sum[1] + w * phi * g[0] * g[1],
                        sum[2] + w * phi * g[1] * g[1],
                    ];
                }
                for (sum, phi) in sums.residuals.iter_mut().zip([1.0, x, y]) {
                    *sum = [sum[0] + w * phi * e * g[0], sum[1] + w * phi * e * g[1]];
                }
            }
        }
        sums
    }

    #[test]
    fn row_sums_are_those_of_every_pixel() {
        let side = 11;
        let noise = |seed: u32| -> Vec<f32> {
            let mut x = seed;
            (0..(side + 2) * (side + 2))
                .map(|_| {
                    x = x.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
                    (x >> 24) as f32
                })
                .collect()
        };
        let (patch, template) = (noise(1), Template::new(side, noise(2), None));
        let weights = crate::gaussian::window_weights(side, 3.0);
        let reference = Reference {
            padded: &template.padded,
            grad_u: &template.grad_u,
            grad_v: &template.grad_v,
            change: 0.0,
            share: 0.5,
        };
        let fast = moments(&weights, &patch, side, &reference, Inside::all(side));
        let exact = slow(&weights, &patch, side, &template, 0.5);
        let close = |a: f64, b: f64| (a - b).abs() <= 1e-4 * (exact.squares + exact.gradients[0][0]);
        assert!(close(fast.weight, exact.weight) && close(fast.squares, exact.squares));
        for (a, b) in fast.gradients.as_flattened().iter().zip(exact.gradients.as_flattened()) {
            assert!(close(*a, *b), "{a} {b}");
        }
        for (a, b) in fast.residuals.as_flattened().iter().zip(exact.residuals.as_flattened()) {
            assert!(close(*a, *b), "{a} {b}");
        }
    }
}
