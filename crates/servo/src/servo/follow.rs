//! What is done about a tracked tip: the plane is kept on it, and the needle is fed.

use sonoloop_types::{Acquisition, Estimate, Point, Pose, View};

use super::{FirstFix, Mode, Servo, displaced, offset_from};
use crate::search::Offset;
use crate::{along, feed, slide};

/// Share of an image in the smoothed level of the tip.
const LEVEL_SHARE: f64 = 0.1;
/// Standard deviation of what a hand moves the needle in one image beyond what was foreseen; there is no depth then.
const HAND_WALK_M: f64 = 0.15e-3;

impl Servo {
    /// Transverse: carries the held plane along with the tip, whatever else is going on. Returns by how much, metres along y.
    pub(super) fn carry(&mut self, acquisition: &Acquisition, dt_s: f64) -> f64 {
        let (View::Transverse, Some(held)) = (self.setup.view, self.state.held) else { return 0.0 };
        let advanced_m = match (acquisition.depth_m, self.state.last.and_then(|l| l.depth_m)) {
            (Some(now_m), Some(before_m)) => {
                along::advance_m(&held, &self.setup.needle_axis_in_base, now_m - before_m)
            }
            (None, _) if self.state.mode == Mode::Follow => self.state.hand_m_s * dt_s,
            _ => 0.0,
        };
        self.state.held = Some(held * Pose::translation(0.0, advanced_m, 0.0));
        advanced_m
    }

    /// Follow law for a tracked tip: moves the held pose, adds dither, sets the feed.
    pub(super) fn follow(
        &mut self,
        acquisition: &Acquisition,
        estimate: &Estimate,
        held: Pose,
        advanced_m: f64,
        time_s: f64,
        dt_s: f64,
    ) -> (Option<Pose>, f64) {
        let Some(tip_px) = estimate.tip_px else { return (Some(held), 0.0) };
        let settings = self.setup.servo;
        let tip_in_probe = self.setup.geometry.probe_from_px(tip_px);

        let measured_m = offset_from(&held, &acquisition.base_from_probe, &tip_in_probe).elevation_m;
        let sigma_m = self.slice_sigma_m(tip_in_probe.z);
        let dither_m =
            settings.dither_m * libm::sin(std::f64::consts::TAU * time_s / settings.dither_period_s);
        let (slide_m, correction_m) = match self.setup.view {
            View::Lateral => (
                slide::slide_m(&settings, &tip_in_probe, dt_s),
                self.hold_plane(estimate, measured_m, sigma_m, time_s, dt_s),
            ),
            View::Transverse => {
                if let Some(level) = estimate.tip_level {
                    let smoothed = self.state.tip_level.unwrap_or(level);
                    self.state.tip_level = Some(smoothed + LEVEL_SHARE * (level - smoothed));
                }
                self.state.lead.learn(-measured_m, advanced_m / dt_s);
                (0.0, self.follow_along(acquisition.depth_m.is_none(), dt_s))
            }
        };
        self.state.corrected_m += correction_m;
        let held = held * Pose::translation(slide_m, correction_m, 0.0);
        self.state.held = Some(held);

        let remaining_m = self.remaining_m(acquisition, &tip_in_probe);
        let since_m = feed::travelled_since_m(&self.setup, acquisition);
        if feed::arrived(&settings, remaining_m - since_m) {
            self.state.mode = Mode::Arrived;
            return (Some(held), 0.0);
        }
        let feed_m_s = feed::feed_m_s(&self.setup, remaining_m, since_m, acquisition.depth_m);
        // The set point leads by what the tip will do, so that the plane sets out together with it.
        let lead_m = match self.setup.view {
            View::Lateral => 0.0,
            View::Transverse if acquisition.depth_m.is_none() => self.state.lead.lead_m(self.state.hand_m_s),
            View::Transverse => {
                let along_y = along::advance_m(&held, &self.setup.needle_axis_in_base, feed_m_s);
                self.state.lead.lead_m(along_y)
            }
        };
        let offset = Offset { elevation_m: lead_m + dither_m, yaw_rad: 0.0 };
        (Some(displaced(&held, offset, &tip_in_probe)), feed_m_s)
    }

    /// Lateral: correction of the plane's elevation from the dither, metres.
    fn hold_plane(
        &mut self,
        estimate: &Estimate,
        measured_m: f64,
        sigma_m: f64,
        time_s: f64,
        dt_s: f64,
    ) -> f64 {
        let settings = &self.setup.servo;
        if let Some(level) = estimate.tip_level {
            self.state.hold.push(
                time_s,
                self.state.corrected_m + measured_m,
                level,
                settings.dither_period_s,
                dt_s,
            );
        }
        let feeding = self.state.last_feed_m_s > 0.0;
        let drifted_m = if feeding { self.state.drift_m_s * dt_s } else { 0.0 };
        let Some(centre_m) = self.state.hold.centre_m(sigma_m) else { return drifted_m };
        let wanted_m = (centre_m - self.state.corrected_m).clamp(-sigma_m, sigma_m);
        if wanted_m != 0.0 {
            self.state.first_side = wanted_m.signum();
        }
        let gain_per_s = settings.elevation_gain_per_s;
        if feeding {
            // A twisted or tilted plane leaves the needle at an even pace; critically damped, as below.
            self.state.drift_m_s += 0.25 * gain_per_s * gain_per_s * wanted_m * dt_s;
        }
        drifted_m + (gain_per_s * dt_s).min(1.0) * wanted_m
    }

    /// Transverse: correction of the plane along the needle from the belief about the tip, metres along y.
    fn follow_along(&mut self, by_hand: bool, dt_s: f64) -> f64 {
        let settings = &self.setup.servo;
        let Some(tip_m) = self.state.along.tip_m(self.state.corrected_m) else { return 0.0 };
        let wanted_m = tip_m - self.state.corrected_m;
        let gain_per_s = settings.along_gain_per_s;
        if by_hand {
            // Critically damped: the integral gain is a quarter of the proportional one's square.
            let speed_m_s = self.state.hand_m_s + 0.25 * gain_per_s * gain_per_s * wanted_m * dt_s;
            self.state.hand_m_s = speed_m_s.clamp(0.0, settings.feed_m_s);
        }
        let most_m = settings.slide_speed_m_s * dt_s;
        ((gain_per_s * dt_s).min(1.0) * wanted_m).clamp(-most_m, most_m)
    }

    /// Transverse: what the picture says about where the tip is along the needle, whether it is tracked or lost.
    pub(super) fn observe_along(&mut self, acquisition: &Acquisition, estimate: &Estimate) {
        let (View::Transverse, Some(held)) = (self.setup.view, self.state.held) else { return };
        let (Some(level), Some(tip_px)) = (estimate.tip_level, estimate.tip_px) else { return };
        let settings = &self.setup.servo;
        let by_hand = acquisition.depth_m.is_none();
        let walk_m = if by_hand { settings.along_walk_m.max(HAND_WALK_M) } else { settings.along_walk_m };
        let tip_in_probe = self.setup.geometry.probe_from_px(tip_px);
        let off_m = offset_from(&held, &acquisition.base_from_probe, &tip_in_probe).elevation_m;
        let sigma_m = self.slice_sigma_m(tip_in_probe.z);
        self.state.along.observe(settings, self.state.corrected_m + off_m, level, sigma_m, walk_m);
    }

    /// Way to the target along the nominal needle, metres.
    ///
    /// A lateral picture measures it. A transverse one shows a cross-section wherever the plane is: there the
    /// measured depth counts from where the tip was clicked on, so that a slip along the needle moves no target.
    fn remaining_m(&mut self, acquisition: &Acquisition, tip_in_probe: &Point) -> f64 {
        let seen_m = feed::remaining_m(&self.setup, &(acquisition.base_from_probe * tip_in_probe));
        match (self.setup.view, acquisition.depth_m) {
            (View::Transverse, Some(depth_m)) => {
                let first = *self.state.first_fix.get_or_insert(FirstFix { remaining_m: seen_m, depth_m });
                first.remaining_m - (depth_m - first.depth_m)
            }
            _ => seen_m,
        }
    }

    /// σ of the elevational beam at a depth, from the −6 dB widths of the set-up.
    pub(super) fn slice_sigma_m(&self, depth_m: f64) -> f64 {
        let table = &self.setup.slice_thickness_m;
        let below = table.partition_point(|entry| entry[0] <= depth_m);
        let thickness_m = match (below.checked_sub(1).and_then(|i| table.get(i)), table.get(below)) {
            (Some(a), Some(b)) => a[1] + (depth_m - a[0]) / (b[0] - a[0]) * (b[1] - a[1]),
            (Some(end), None) | (None, Some(end)) => end[1],
            (None, None) => 1e-3,
        };
        thickness_m / 2.355
    }
}
