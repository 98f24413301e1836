//! LOST and RECOVERING: search, candidate, confirmation.

use sonoloop_types::{Confirmation, Estimate, Image, Reason};

use crate::Tracker;
use crate::hysteresis::{Hysteresis, View};
use crate::search::{PEAKS, Peaks};
use crate::shaft;
use crate::tracker::{Context, add, distance};
use crate::warp::Placement;

/// The near search begins this far about the last tip …
const NEAR_PX: f64 = 12.0;
/// … and widens by this with every image lost.
const NEAR_GROWTH_PX: f64 = 3.0;
/// A peak of the coarse search is refined this far to every side before the optimiser runs.
const REFINE_PX: i32 = 2;
/// An optimiser that leaves the peak it began at found something else.
const MAX_MOVE_PX: f64 = 3.0;
/// The needle hardly moves while it is sought, and by a measured way, so of two places alike the nearer one is likelier: what a pixel of
/// distance from the expected place costs in NCC.
const NCC_PER_PX: f64 = 0.002;
/// A candidate that jumps farther than this between images, beyond the measured motion, is another candidate.
const SAME_CANDIDATE_PX: f64 = 4.0;

/// A place scored at full resolution.
#[derive(Debug, Clone, Copy)]
struct Scored {
    at_px: [f64; 2],
    view: View,
    conditioning: Option<f64>,
    accepted: bool,
    /// NCC with T_1, less what the distance from the expected place costs.
    rank: f64,
}

/// What is known of the lost tip beside its looks.
#[derive(Clone, Copy)]
struct Sought<'a> {
    median: Option<f64>,
    /// Where it should be, from its last place and the measured motion.
    centre_px: [f64; 2],
    context: &'a Context<'a>,
}

impl Sought<'_> {
    fn scored(&self, at_px: [f64; 2], view: View, conditioning: Option<f64>, accepted: bool) -> Scored {
        let rank = view.ncc_anchor.unwrap_or(-1.0) - NCC_PER_PX * self.off_px(at_px);
        Scored { at_px, view, conditioning, accepted, rank }
    }

    /// How far a place lies from the expected one, or from the way that the tip may have gone on unmeasured.
    fn off_px(&self, at_px: [f64; 2]) -> f64 {
        let Context { axis_px, unmeasured_px, .. } = *self.context;
        let expected_px = axis_px.map_or(self.centre_px, |[u, v]| {
            let along = (at_px[0] - self.centre_px[0]) * u + (at_px[1] - self.centre_px[1]) * v;
            // Comparisons, as a bound that is no number must not panic.
            let along = if along < unmeasured_px { along } else { unmeasured_px };
            let along = if along > 0.0 { along } else { 0.0 };
            add(self.centre_px, [along * u, along * v])
        });
        distance(at_px, expected_px)
    }

    /// Whether the tip may be at a place at all.
    fn may_be_at(&self, at_px: [f64; 2]) -> bool {
        let Context { reach_px, refused, .. } = *self.context;
        reach_px.is_none_or(|reach_px| self.off_px(at_px) <= reach_px)
            && !refused.iter().any(|disc| disc.contains(at_px))
    }

    /// The square that holds all places within reach: its middle, and half its side.
    fn within_reach(&self) -> Option<([f64; 2], f64)> {
        let Context { axis_px, unmeasured_px, reach_px, .. } = *self.context;
        let [u, v] = axis_px.unwrap_or_default();
        let half_px = 0.5 * unmeasured_px;
        reach_px.map(|reach_px| (add(self.centre_px, [half_px * u, half_px * v]), reach_px + half_px))
    }
}

/// The better of two places: an accepted one before a rejected one, then the higher rank.
fn better(a: Option<Scored>, b: Option<Scored>) -> Option<Scored> {
    match (a, b) {
        (Some(a), Some(b)) => Some(if (b.accepted, b.rank) > (a.accepted, a.rank) { b } else { a }),
        (a, b) => a.or(b),
    }
}

impl Tracker {
    pub(crate) fn seek(
        &mut self,
        image: &Image,
        median: Option<f64>,
        motion_px: Option<[f64; 2]>,
        context: &Context,
    ) -> Estimate {
        let motion = motion_px.unwrap_or_default();
        let expected_px = self.belief.candidate_px.map(|candidate| add(candidate, motion));
        let centre_px = add(self.belief.tip_px, motion);
        let sought = Sought { median, centre_px, context };
        let mut iterations = 0;

        // A candidate that is still where it was needs no search. Once the plane stands it has passed for no bead of the shaft in
        // the same view, and is not asked again while it is tested: as the needle moves, every image has other speckle ahead of it.
        // Before it is believed it is: where a shadow had cut the shaft, the shadow may have gone.
        let mut best = None;
        if let Some(expected_px) = expected_px {
            let asks_shaft = context.confirmation != Confirmation::Counts;
            let again = self.score(image, &sought, asks_shaft, expected_px, &mut iterations);
            best = again.filter(|s| s.accepted && distance(s.at_px, expected_px) <= SAME_CANDIDATE_PX);
        }
        let same = best.is_some();
        if best.is_none() {
            let widened = self.belief.state.lost_images().min(self.settings.whole_image_after);
            let reach_px = NEAR_PX + NEAR_GROWTH_PX * f64::from(widened);
            let peaks = self.search.peaks(image, Some((centre_px, reach_px)));
            best = self.score_all(image, &sought, peaks, &mut iterations);
            // The coarse search knows no contrast: a bright tip may not be among its best, so where it should be is looked at anyway.
            best = better(best, self.score(image, &sought, true, centre_px, &mut iterations));
        }
        // What was seen near the last tip is reported even when it is rejected: over a sweep in elevation its
        // correlation rises towards the tip's plane.
        let near = best;
        if !best.is_some_and(|s| s.accepted)
            && self.belief.state.lost_images() >= self.settings.whole_image_after
        {
            let peaks = self.search.peaks(image, sought.within_reach());
            let far = self.score_all(image, &sought, peaks, &mut iterations);
            best = better(best, far.filter(|s| s.accepted));
        }

        match best {
            Some(found) if found.accepted => {
                self.confirm(image, median, motion, &found, same, context.confirmation, iterations)
            }
            _ => {
                let estimate =
                    self.declare_lost(Reason::NoCandidate, motion_px, near.map(|s| s.view), iterations);
                Estimate { conditioning: near.and_then(|s| s.conditioning), ..estimate }
            }
        }
    }

    /// Counts an image for a candidate, and believes it when there are enough.
    #[expect(clippy::too_many_arguments, reason = "one call site; the arguments are the image's findings")]
    fn confirm(
        &mut self,
        image: &Image,
        median: Option<f64>,
        motion: [f64; 2],
        found: &Scored,
        same: bool,
        confirmation: Confirmation,
        iterations: u32,
    ) -> Estimate {
        self.belief.tip_px = add(self.belief.tip_px, motion);
        self.belief.candidate_px = Some(found.at_px);
        let mut reason = Reason::Candidate;
        if self.belief.state.candidate(&self.settings, same, confirmation) {
            // Other peaks may have been sampled since.
            let reach = self.scoring_reach();
            self.region.fill_about(self.registrar.instructions, image, &self.taps, found.at_px, reach);
            if self.registrar.sample(&self.region, &Placement::at(found.at_px)).is_ok() {
                self.resume(found.at_px, median);
                self.pyramid.remember(image, median, found.at_px);
                reason = Reason::Ok;
            }
        }
        let estimate = self.estimate(reason, found.at_px, Some(found.view), iterations);
        Estimate { conditioning: found.conditioning, ..estimate }
    }

    fn score_all(
        &mut self,
        image: &Image,
        sought: &Sought,
        peaks: Peaks,
        iterations: &mut u32,
    ) -> Option<Scored> {
        let mut best = None;
        for peak in peaks.into_iter().take(PEAKS).flatten() {
            best = better(best, self.score(image, sought, true, peak, iterations));
        }
        best
    }

    /// Refines a place against T_1 and decides whether it may be the tip, where the shaft is asked for too if `asks_shaft`.
    fn score(
        &mut self,
        image: &Image,
        sought: &Sought,
        asks_shaft: bool,
        peak_px: [f64; 2],
        iterations: &mut u32,
    ) -> Option<Scored> {
        let reach = self.scoring_reach();
        self.region.fill_about(self.registrar.instructions, image, &self.taps, peak_px, reach);
        let (start_px, is_peak) = self.refine(peak_px)?;
        let view = self.view_at(&Placement::at(start_px), sought.median).ok()?;

        let change = self.change(&self.anchor, sought.median);
        self.registrar.leash_px = MAX_MOVE_PX;
        let end = self.registrar.run(&self.region, &self.anchor, change, Placement::at(start_px));
        self.registrar.leash_px = f64::INFINITY;
        *iterations += end.map_or_else(|failure| failure.iterations, |end| end.iterations);
        let end = end.ok().filter(|end| distance(start_px, end.place.centre_px) < MAX_MOVE_PX);
        // A registration knows what it minimises, and in a tip whose echo has changed its shape that may lie beside what looks most
        // like T_1, or nowhere near. It sharpens a place; that there is one is for the NCC to say.
        let sharper = end.and_then(|end| Some((end, self.view_at(&end.place, sought.median).ok()?)));
        let sharper = sharper.filter(|(_, ended)| ended.ncc_anchor >= view.ncc_anchor);
        let (at_px, view, conditioning) = match sharper {
            Some((end, ended)) => (end.place.centre_px, ended, Some(end.conditioning)),
            None => (start_px, view, None),
        };
        let axis_px = sought.context.axis_px.filter(|_| asks_shaft);
        let accepted = (sharper.is_some() || is_peak)
            && Hysteresis::accepts(&self.settings, &view)
            && sought.may_be_at(at_px)
            && axis_px.is_none_or(|axis_px| !shaft::goes_on(image, at_px, axis_px));
        Some(sought.scored(at_px, view, conditioning, accepted))
    }

    /// The whole-pixel shift of a place with the best NCC with T_1, and whether it is better than all about it.
    fn refine(&mut self, peak_px: [f64; 2]) -> Option<([f64; 2], bool)> {
        let mut best: Option<(f64, [f64; 2], bool)> = None;
        for dv in -REFINE_PX..=REFINE_PX {
            for du in -REFINE_PX..=REFINE_PX {
                let at = add(peak_px, [f64::from(du), f64::from(dv)]);
                if self.registrar.sample(&self.region, &Placement::at(at)).is_err() {
                    continue;
                }
                let Some(ncc) = self.moments(&self.anchor.padded).and_then(|m| m.ncc()) else { continue };
                if best.is_none_or(|(highest, ..)| ncc > highest) {
                    best = Some((ncc, at, du.abs().max(dv.abs()) < REFINE_PX));
                }
            }
        }
        best.map(|(_, at, is_peak)| (at, is_peak))
    }

    /// Half-side of the region in which one place is scored; never beyond that of tracking.
    fn scoring_reach(&self) -> usize {
        self.registrar.weights.part.reach() + REFINE_PX as usize + 2 * MAX_MOVE_PX as usize
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn distance_costs_nothing_where_the_tip_may_have_gone_on() {
        let view = View {
            ncc_previous: None,
            ncc_anchor: Some(0.9),
            brightness_ratio: None,
            presence: None,
            level: 100.0,
        };
        let rank = |at_px: [f64; 2], axis_px: Option<[f64; 2]>, unmeasured_px: f64| {
            let context = &Context { axis_px, unmeasured_px, ..Context::default() };
            let sought = Sought { median: None, centre_px: [100.0, 100.0], context };
            sought.scored(at_px, view, None, true).rank
        };
        let axis = Some([0.6, 0.8]);
        // Places 50 px ahead, 150 px ahead, 20 px behind, and 50 px ahead and 10 px aside.
        for (at_px, unmeasured_px, far_px) in [
            ([130.0, 140.0], 100.0, 0.0),
            ([190.0, 220.0], 100.0, 50.0),
            ([88.0, 84.0], 100.0, 20.0),
            ([122.0, 146.0], 100.0, 10.0),
            ([130.0, 140.0], 0.0, 50.0),
            ([130.0, 140.0], f64::NAN, 50.0),
        ] {
            let expected = 0.9 - NCC_PER_PX * far_px;
            assert!((rank(at_px, axis, unmeasured_px) - expected).abs() < 1e-9, "{at_px:?} {unmeasured_px}");
        }
        assert!((rank([130.0, 140.0], None, 100.0) - 0.9 + NCC_PER_PX * 50.0).abs() < 1e-9);
    }
}
