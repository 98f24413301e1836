//! Registration of a template in an image: Gauss–Newton over a translation, paper (6), (8) and (12).
//!
//! With H = Σ w g gᵀ and b = Σ w e g, where e = P − T̂ and g = ∇P (first order) or ½(∇P + ∇T̂) (second order), the
//! step is Δ = −H⁻¹ b. The factor −2 of the paper's (8) and the ½ of its mean gradient are the same thing. For a
//! translation the compositional update of the warp is plain addition.

use sonoloop_simd::Instructions;
use sonoloop_types::{Optimisation, Profile, Reason, Similarity, TrackerSettings, Warp};

use crate::gaussian::Weights;
use crate::region::Region;
use crate::scv::Conditional;
use crate::sums::{Comparison, translation_sums};
use crate::template::{Template, gradient};
use crate::tracker::distance;
use crate::warp::Placement;
use crate::window::Window;

/// Grey levels per pixel, rms: with less gradient than this there is nothing to hold on to.
pub(crate) const MIN_GRADIENT: f64 = 0.02;
/// Relative Levenberg–Marquardt damping; doubles as the smallest relative pivot.
const DAMPING: f64 = 1e-6;

/// Robust profile: T̂ is first taken when a step of plain differences falls below this, and taken anew when the
/// patch has moved on by as much.
///
/// T̂ from a guess that is several pixels off pairs, under a narrow weight, the needle's grey levels with the
/// background's, and the optimiser then ends anywhere: on rigid scenes that walk by up to 3 px it lost the tip in
/// 34 of 792 images and was 0.5 px off; approached like this, in none and 0.08 px.
pub(crate) const NEAR_PX: f64 = 1.0;

/// A tip's brightest spot lies this near to where it is found, to either side: its echo comes from the facet behind it, and tips of
/// recorded insertions are found 1 to 2.5 px beside their apex. [measured]
const SPOT_PX: f64 = 3.0;

/// Where a registration ended.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Registration {
    pub place: Placement,
    pub iterations: u32,
    /// Smaller over larger eigenvalue of H's part for the translation.
    pub conditioning: f64,
}

/// Why a registration ended without a position.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Failure {
    pub reason: Reason,
    pub iterations: u32,
}

/// Settings and scratch of registrations over one window.
#[derive(Debug, Clone)]
pub(crate) struct Registrar {
    pub(crate) instructions: Instructions,
    similarity: Similarity,
    order: Optimisation,
    /// SCV approaches by plain differences before it takes T̂; the paper takes T̂ at the guess, once per image.
    approach: bool,
    pub(crate) warp: Warp,
    pub(crate) max_iterations: u32,
    pub(crate) epsilon_px: f64,
    /// A registration that goes farther than this from where it began has diverged.
    pub(crate) leash_px: f64,
    pub(crate) window: Window,
    pub weights: Weights,
    /// The last patch sampled, padded.
    pub patch: Vec<f32>,
    /// Where that was.
    pub sampled: Placement,
    adapted: Vec<f32>,
    adapted_u: Vec<f32>,
    adapted_v: Vec<f32>,
    conditional: Conditional,
}

impl Registrar {
    /// The approach ends after this many iterations anyhow.
    pub(crate) const MAX_APPROACH: u32 = 8;

    /// Registers over `warp` under Gaussian weights of σ `weight_sigma_px`, zero for uniform ones.
    pub fn new(
        instructions: Instructions,
        settings: &TrackerSettings,
        warp: Warp,
        weight_sigma_px: f64,
    ) -> Self {
        let window = Window { side: settings.template_px as usize };
        Self {
            instructions,
            similarity: settings.similarity,
            order: settings.optimisation,
            approach: settings.profile == Profile::Robust,
            warp,
            max_iterations: settings.max_iterations,
            epsilon_px: settings.epsilon_px,
            leash_px: f64::INFINITY,
            window,
            weights: Weights::new(window.side, weight_sigma_px),
            patch: vec![0.0; window.padded_len()],
            sampled: Placement::at([0.0; 2]),
            adapted: vec![0.0; window.padded_len()],
            adapted_u: vec![0.0; window.len()],
            adapted_v: vec![0.0; window.len()],
            conditional: Conditional::new(settings.scv_bins, window),
        }
    }

    /// Samples the patch at a placement; `Err` when too little of it lies inside the picture or the region.
    pub fn sample(&mut self, region: &Region, place: &Placement) -> Result<(), Reason> {
        let (window, part) = (self.window, self.weights.part);
        let inside = region.sample(self.instructions, place, window, part, &mut self.patch);
        let inside = inside.ok_or(Reason::Diverged)?;
        self.weights.cut(inside);
        self.sampled = *place;
        if 2 * inside.count() < window.side * window.side { Err(Reason::OutOfImage) } else { Ok(()) }
    }

    /// The highest grey level within [`SPOT_PX`] of the middle of the last patch.
    pub fn peak_level(&self) -> f64 {
        let half = self.window.half_px();
        // No template is smaller than the spot.
        let spot = (half - SPOT_PX).ceil() as usize..(half + SPOT_PX) as usize + 1;
        let mut peak = 0.0_f32;
        for y in spot.clone() {
            let row = &self.patch[(y + 1) * self.window.padded_stride() + 1..][spot.clone()];
            let weights = &self.weights.values()[y * self.window.stride()..][spot.clone()];
            for (&level, &weight) in row.iter().zip(weights) {
                // Beyond the picture's edge there is none.
                if weight > 0.0 && level > peak {
                    peak = level;
                }
            }
        }
        f64::from(peak)
    }

    /// Finds `template` in `region`, from `start` on; `change` is Δ, how much brighter the image has become.
    pub fn run(
        &mut self,
        region: &Region,
        template: &Template,
        change: f32,
        start: Placement,
    ) -> Result<Registration, Failure> {
        match self.warp {
            Warp::Translation => self.run_moved(region, template, change, start),
            Warp::Rigid | Warp::Affine => self.run_warped(region, template, change, start),
        }
    }

    /// Whether T̂ is what the image is compared with, whether plain differences come first, and whether T̂ is taken again
    /// when the patch has moved on.
    pub(crate) fn is_conditional(&self) -> bool {
        self.similarity == Similarity::Scv
    }

    pub(crate) fn approaches(&self) -> bool {
        self.is_conditional() && self.approach
    }

    pub(crate) fn adapts_again(&self) -> bool {
        self.approach
    }

    fn run_moved(
        &mut self,
        region: &Region,
        template: &Template,
        change: f32,
        start: Placement,
    ) -> Result<Registration, Failure> {
        let mut place = start;
        let mut approaching = self.approaches();
        let mut adapted_at: Option<[f64; 2]> = None;
        let mut conditioning = 0.0;
        let mut before_px = None;
        for iteration in 1..=self.max_iterations {
            let fail = |reason| Failure { reason, iterations: iteration };
            self.sample(region, &place).map_err(fail)?;
            let at = place.centre_px;
            let stale = adapted_at.is_none_or(|then| self.approach && distance(at, then) > NEAR_PX);
            if self.is_conditional() && !approaching && stale {
                self.adapt(template);
                adapted_at = Some(at);
            }
            let comparison = self.comparison(template, change, adapted_at.is_some());
            let sums = translation_sums(comparison.0, &comparison.1);
            let (step, ratio) = solve(sums).ok_or_else(|| fail(Reason::Singular))?;
            let length = (step[0] * step[0] + step[1] * step[1]).sqrt();
            if length.is_nan() || length > self.window.side as f64 / 2.0 {
                return Err(fail(Reason::Diverged));
            }
            place = place.compose([step, [0.0; 2], [0.0; 2]]);
            if distance(place.centre_px, start.centre_px) > self.leash_px {
                return Err(fail(Reason::Diverged));
            }
            conditioning = ratio;
            if approaching {
                approaching = length >= NEAR_PX && iteration < Self::MAX_APPROACH;
            } else if self.has_converged(length, before_px) {
                return Ok(Registration { place, iterations: iteration, conditioning });
            }
            before_px = Some(length);
        }
        Ok(Registration { place, iterations: self.max_iterations, conditioning })
    }

    /// Whether an iteration that moved the corners by `moved_px`, after one by `before_px`, was the last.
    ///
    /// The paper stops at a short step. Steps shrink by a factor r each, so what is left after one is r/(1 − r) of it; the
    /// robust profile stops when *that* is short, an iteration earlier.
    pub(crate) fn has_converged(&self, moved_px: f64, before_px: Option<f64>) -> bool {
        let left_px = match before_px {
            Some(before_px) if self.approach && moved_px < 0.5 * before_px => {
                moved_px * moved_px / (before_px - moved_px)
            }
            _ => moved_px,
        };
        left_px < self.epsilon_px
    }

    pub(crate) fn adapt(&mut self, template: &Template) {
        let (weights, part) = (self.weights.values(), self.weights.part);
        self.conditional.adapt(
            self.instructions,
            weights,
            self.window,
            part,
            &template.padded,
            &self.patch,
            &mut self.adapted,
        );
        gradient(&self.adapted, self.window, &mut self.adapted_u, &mut self.adapted_v);
    }

    /// The patch against T̂ once it is `adapted`, else against T itself with its grey levels shifted by the image's change.
    pub(crate) fn comparison<'a>(
        &'a self,
        template: &'a Template,
        change: f32,
        adapted: bool,
    ) -> (Instructions, Comparison<'a>) {
        let part = self.weights.part;
        let [padded, grad_u, grad_v] = if adapted {
            [&self.adapted[..], &self.adapted_u, &self.adapted_v]
        } else {
            [&template.padded[..], &template.grad_u, &template.grad_v]
        };
        let comparison = Comparison {
            window: self.window,
            part,
            weights: self.weights.values(),
            patch: &self.patch,
            padded,
            grad_u,
            grad_v,
            change: if adapted { 0.0 } else { change },
            share: if self.order == Optimisation::SecondOrder { 0.5 } else { 0.0 },
        };
        (self.instructions, comparison)
    }
}

/// The damped step and the ratio of H's eigenvalues; `None` without texture in both directions.
fn solve([weight, uu, uv, vv, eu, ev]: [f64; 6]) -> Option<([f64; 2], f64)> {
    let trace = uu + vv;
    // Written so that NaN fails.
    let textured = trace > weight * MIN_GRADIENT * MIN_GRADIENT;
    if !textured {
        return None;
    }
    let ratio = eigenvalue_ratio(uu, uv, vv);
    let (uu, vv) = (uu * (1.0 + DAMPING), vv * (1.0 + DAMPING));
    let determinant = uu * vv - uv * uv;
    if determinant.is_nan() || determinant <= DAMPING * trace * trace {
        return None;
    }
    Some(([(uv * ev - vv * eu) / determinant, (uv * eu - uu * ev) / determinant], ratio))
}

/// Smaller over larger eigenvalue of a symmetric 2×2 matrix.
pub(crate) fn eigenvalue_ratio(uu: f64, uv: f64, vv: f64) -> f64 {
    let trace = uu + vv;
    let root = ((uu - vv) * (uu - vv) + 4.0 * uv * uv).sqrt();
    ((trace - root) / (trace + root)).max(0.0)
}
