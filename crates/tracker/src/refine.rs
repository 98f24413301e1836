//! A sharper second look where the surroundings move with the tip.
//!
//! Blur and narrow weight keep a tracker on a tip that moves over speckle that stands still, at a price: they leave a tenth of
//! the pixels and none of the fine detail. Where needle and surroundings move *together* (a wire that the probe passes over, a
//! phantom that moves), nothing is gained by looking away from them. So every image asks which it is: is the ring around the
//! tip more like what it was under the *moved* template, or like what it was at the *same place*? In the first case the
//! paper's own registration, unblurred and unweighted, over the whole warp, starts from what was found and has the last word.
//!
//! Measured, moved over still, leaky means of squared differences after 70 images: 0.01 to 0.02 in rigid scenes, 0.25 to 0.27
//! on real wires, above 0.5 for a needle over still speckle of 0.1 of its rms and above 2 from 0.5 on.

use sonoloop_simd::{Instructions, wide};
use sonoloop_types::{TrackerSettings, UpdateStrategy};

use crate::gaussian::Weights;
use crate::region::Region;
use crate::register::{Registrar, Registration};
use crate::template::Template;
use crate::tracker::distance;
use crate::warp::Placement;
use crate::window::{LANES, Window, lanes, total};

/// σ of what is left out of the ring: the tip itself.
const TIP_SIGMA_PX: f64 = 3.0;
/// Share of an image's evidence in the leaky means: ten images count.
const MEMORY: f64 = 0.1;
/// The surroundings move along when the difference to the moved ring is below this share of that to the still one.
const MOVES_ALONG: f64 = 0.4;
/// A refinement that goes farther than this found something else.
const MAX_MOVE_PX: f64 = 2.0;
/// A patch from within this distance shows a place well enough to judge its surroundings.
const LOOKED_PX: f64 = 0.1;
/// Half-side of the unblurred region beyond the window: room for the warp and for the last place.
const ROOM_PX: usize = 12;

/// The unblurred templates, and what is known about the surroundings.
#[derive(Debug, Clone)]
pub(crate) struct Refinement {
    registrar: Registrar,
    /// One less the weight of the tip.
    ring: Vec<f32>,
    /// T_1, unblurred.
    pub anchor: Template,
    /// The last image's patch, unblurred.
    previous: Template,
    /// Where that was; `None` when the last image was not tracked.
    last: Option<Placement>,
    moved: f64,
    still: f64,
}

impl Refinement {
    /// Whether these settings refine. A template that is always the last patch is not held to the first one.
    pub fn is_wanted(settings: &TrackerSettings) -> bool {
        settings.refine && settings.update != UpdateStrategy::Naive
    }

    pub fn new(instructions: Instructions, settings: &TrackerSettings) -> Self {
        let side = settings.template_px as usize;
        let ring = Weights::new(side, TIP_SIGMA_PX).values().iter().map(|weight| 1.0 - weight).collect();
        let mut refinement = Self {
            registrar: Registrar::new(instructions, settings, settings.warp, 0.0),
            ring,
            anchor: Template::blank(side),
            previous: Template::blank(side),
            last: None,
            moved: 0.0,
            still: 0.0,
        };
        // What lies between the rows of the ring does not count.
        let window = refinement.registrar.window;
        refinement.ring.chunks_exact_mut(window.stride()).for_each(|row| row[side..].fill(0.0));
        refinement
    }

    /// Takes the unblurred T_1 from a region about the tip.
    pub fn begin(&mut self, sharp: &Region, tip_px: [f64; 2], median: Option<f64>) {
        if self.registrar.sample(sharp, &Placement::at(tip_px)).is_ok() {
            self.anchor.refresh(&self.registrar.patch, median);
            self.keep(median);
        }
    }

    /// Half-side of the unblurred region that a refinement needs: half a diagonal, so that a template may turn, and some room.
    pub fn reach(settings: &TrackerSettings) -> usize {
        (settings.template_px as usize * 3).div_ceil(4) + ROOM_PX
    }

    /// The tip was not tracked in this image.
    pub fn pause(&mut self) {
        self.last = None;
    }

    /// T_1 in an unblurred region, from `found` on, and the optimiser's iterations; `None` where the surroundings do not move
    /// along, or nothing was found near.
    pub fn refine(
        &mut self,
        sharp: &Region,
        median: Option<f64>,
        found: &Placement,
    ) -> (Option<Registration>, u32) {
        let change = self.anchor.change_to(median);
        let still = self.last.take().and_then(|last| {
            self.registrar.sample(sharp, &last).ok()?;
            Some(self.difference(median))
        });
        let end = match self.registrar.run(sharp, &self.anchor, change, *found) {
            Ok(end) => end,
            Err(failure) => return (None, failure.iterations),
        };
        let place = end.place;
        if distance(place.centre_px, found.centre_px) > MAX_MOVE_PX {
            return (None, end.iterations);
        }
        // Mostly the patch is that of the optimiser's last look, a fraction of its last step away.
        let half_px = self.registrar.window.half_px();
        if self.registrar.sampled.corner_distance(&place, half_px) > LOOKED_PX
            && self.registrar.sample(sharp, &place).is_err()
        {
            return (None, end.iterations);
        }
        if let Some(still) = still {
            let moved = self.difference(median);
            self.still += MEMORY * (still - self.still);
            self.moved += MEMORY * (moved - self.moved);
        }
        let moves_along = self.moved < MOVES_ALONG * self.still;
        if moves_along || self.registrar.sample(sharp, found).is_ok() {
            self.keep(median);
        }
        (Some(end).filter(|_| moves_along), end.iterations)
    }

    /// Mean squared difference of the patch's ring to the last image's.
    fn difference(&self, median: Option<f64>) -> f64 {
        let change = self.previous.change_to(median);
        let Registrar { instructions, window, patch, .. } = &self.registrar;
        ring_difference(*instructions, *window, &self.ring, patch, &self.previous.padded, change)
    }

    /// The patch is the one to compare with next.
    fn keep(&mut self, median: Option<f64>) {
        self.previous.padded.copy_from_slice(&self.registrar.patch);
        self.previous.median = median;
        self.last = Some(self.registrar.sampled);
    }
}

wide! {
    /// Σ w·(a − Δ − b)² over Σ w.
    fn ring_difference(window: Window, weights: &[f32], a: &[f32], b: &[f32], change: f32) -> f64 {
        let [mut weight_sum, mut sum] = [[0.0_f32; LANES]; 2];
        for y in 0..window.side {
            for x in (0..window.side).step_by(LANES) {
                let weight = lanes(weights, y * window.stride() + x);
                let at = (y + 1) * window.padded_stride() + x + 1;
                let (a, b) = (lanes(a, at), lanes(b, at));
                for k in 0..LANES {
                    let e = a[k] - change - b[k];
                    weight_sum[k] += weight[k];
                    sum[k] += weight[k] * e * e;
                }
            }
        }
        total(&sum) / total(&weight_sum).max(1e-6)
    }
}
