//! The same test with the needle in a hand: it is asked to go on slowly, and nobody measures what comes of it, nor when.
//!
//! What counts is that the candidate goes on along the needle at all. Registration that slides along a fibre, or tissue that
//! moves that way by itself, would count too. Just before the target there is no room for a test, and a candidate is believed if
//! it lies on the way that the needle may have gone on.

use serde::{Deserialize, Serialize};
use sonoloop_types::Pose;

use super::jog::{Seen, Verdict};
use crate::{feed, predict};

/// What is asked of it. [assumed]
pub(super) const SPEED_M_S: f64 = 1e-3;
/// A candidate that has gone on by so much along the needle, in two pictures one after the other, goes with the hand … [assumed]
const GOES_M: f64 = 0.35e-3;
const GOES_IMAGES: u32 = 2;
/// … and one that has not while the hand was asked for so much is none: 2.4 s, of which a slow reaction and a pause leave 1 s, in which a
/// slow hand goes 0.6 mm. [assumed]
pub(super) const STAYS_M: f64 = 2.4e-3;
/// What moves farther than this from picture to picture is another candidate, or a needle that a hand has not brought to rest yet.
pub(super) const JUMP_PX: f64 = 4.0;
/// How near to the needle's way a candidate must be that cannot be tested: a hand sways by a millimetre. [assumed]
pub(super) const NEAR_M: f64 = 1e-3;

/// What was asked of a hand in one search, and what the candidate under test did.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub(super) struct Hand {
    /// The way that was asked for, up to the last picture.
    asked_m: f64,
    /// What is asked for since then.
    asked_m_s: f64,
    last_s: f64,
    /// Where the candidate was in the last picture, and where that was taken.
    last: Option<([f64; 2], Pose)>,
    /// Pictures in a row that showed it gone on.
    gone_images: u32,
}

impl Hand {
    /// The way that was asked for.
    pub fn asked_m(&self) -> f64 {
        self.asked_m
    }

    /// Another picture was taken.
    pub fn pass(&mut self, time_s: f64) {
        self.asked_m += self.asked_m_s * (time_s - self.last_s);
        self.last_s = time_s;
    }

    /// Asks for a speed from a picture on.
    pub fn ask(&mut self, time_s: f64, feed_m_s: f64) {
        (self.last_s, self.asked_m_s) = (time_s, feed_m_s);
    }

    /// The candidate is not looked at any more.
    pub fn forget(&mut self) {
        (self.last, self.gone_images) = (None, 0);
    }

    /// What a candidate does that was at the first place when the test began, with the probe at `base_from_probe`, and is at the second
    /// one now, `asked_m` later.
    pub fn verdict(
        &mut self,
        seen: &Seen,
        [start_px, px]: [[f64; 2]; 2],
        base_from_probe: &Pose,
        asked_m: f64,
    ) -> Verdict {
        let Seen { setup, acquisition, .. } = *seen;
        let now = &acquisition.base_from_probe;
        // What moved beside the probe.
        let moved_px = |from_px: [f64; 2], before: &Pose| {
            let still = seen.motion_px(from_px, before, 0.0)?;
            Some([0, 1].map(|axis| px[axis] - from_px[axis] - still[axis]))
        };
        let (last_px, last_pose) = self.last.replace((px, *now)).unwrap_or((start_px, *base_from_probe));
        let (Some([u, v]), Some(step), Some(way)) = (
            predict::axis_px(&setup.needle_axis_in_base, now),
            moved_px(last_px, &last_pose),
            moved_px(start_px, base_from_probe),
        ) else {
            return Verdict::Unknown;
        };
        if step[0].hypot(step[1]) > JUMP_PX {
            return Verdict::Jumped;
        }
        let gone = (way[0] * u + way[1] * v) * setup.geometry.spacing_m >= GOES_M;
        self.gone_images = if gone { self.gone_images + 1 } else { 0 };
        // What was asked for since the picture was taken cannot show in it.
        let shown_m = asked_m - SPEED_M_S * feed::age_s(setup, acquisition);
        if self.gone_images >= GOES_IMAGES {
            Verdict::Goes
        } else if shown_m >= STAYS_M {
            Verdict::Stays
        } else {
            Verdict::Unknown
        }
    }
}

#[cfg(test)]
mod tests {
    use sonoloop_types::{Acquisition, Setup, View};

    use super::*;
    use crate::search::jog::Jog;
    use crate::servo::tests::{acquisition, setup};

    const PERIOD_S: f64 = 0.04;
    const TIP_PX: [f64; 2] = [300.0, 150.0];

    /// A hand, and what the candidate does.
    #[derive(Clone, Copy)]
    struct Case {
        px: [f64; 2],
        /// Share of the needle's way that the candidate goes along.
        carries: f64,
        /// Images until the hand obeys, and that a picture is on its way.
        late: [usize; 2],
        /// Its speed over what is asked.
        share: f64,
        sways_px: f64,
        remaining_m: f64,
    }

    const CASE: Case =
        Case { px: TIP_PX, carries: 1.0, late: [8, 0], share: 1.4, sways_px: 0.0, remaining_m: 20e-3 };

    /// Places in the picture along the needle and across it.
    fn beside(px: [f64; 2], along_px: f64, across_px: f64) -> [f64; 2] {
        [px[0] + 0.6 * along_px - 0.8 * across_px, px[1] + 0.8 * along_px + 0.6 * across_px]
    }

    /// With the target that far from the place.
    fn setup_with(px: [f64; 2], remaining_m: f64) -> Setup {
        let mut setup = setup(View::Lateral);
        let place = acquisition(0).base_from_probe * setup.geometry.probe_from_px(px);
        setup.target_in_base = place + setup.needle_axis_in_base * remaining_m;
        setup
    }

    /// Picture `k` of a needle in a hand.
    fn shown(k: u64) -> Acquisition {
        Acquisition { depth_m: None, feed_m_s: None, ..acquisition(k) }
    }

    fn seen<'a>(setup: &'a Setup, acquisition: &'a Acquisition, remaining_m: f64) -> Seen<'a> {
        let time_s = PERIOD_S * acquisition.sequence as f64;
        Seen {
            setup,
            acquisition,
            time_s,
            arriving: false,
            expected_px: TIP_PX,
            remaining_m,
            unmeasured_m: 10e-3,
        }
    }

    /// Tests a candidate until there is a verdict: whether it went along (`None` without one), and the needle's way until the hand has
    /// come to rest.
    fn test(jog: &mut Jog, case: Case) -> (Option<bool>, f64) {
        let Case { px, carries, late: [late, delay], share, sways_px, remaining_m } = case;
        let setup = setup_with(TIP_PX, remaining_m);
        let mut asked = vec![0.0; late];
        let mut ways_m = vec![0.0];
        let mut found = None;
        for k in 0..140 {
            let shown = shown(k);
            let shown = Acquisition { publication_tick: shown.acquisition_tick + 40 * delay as u64, ..shown };
            let way_m: f64 = ways_m[ways_m.len().saturating_sub(1 + delay)];
            let across_px = sways_px * libm::sin(0.1 * k as f64);
            let seen = seen(&setup, &shown, remaining_m);
            let at_px = beside(px, carries * way_m / setup.geometry.spacing_m, across_px);
            let (feed_m_s, given_up) = jog.advance(&seen, Some(at_px).filter(|_| found.is_none()));
            if found.is_none() && (given_up || jog.goes()) {
                found = Some(jog.goes());
            }
            asked.push(if found.is_some() { 0.0 } else { feed_m_s });
            ways_m.push(ways_m[ways_m.len() - 1] + PERIOD_S * share * asked[asked.len() - 1 - late]);
        }
        (found, ways_m[ways_m.len() - 1])
    }

    fn refuses(jog: &Jog) -> bool {
        !jog.refused(&setup(View::Lateral), &acquisition(9)).is_empty()
    }

    /// Seen in the paper's lateral 16: an operator's needle stood 12 mm behind a fibre that was taken for it, and was pushed on to the hub.
    #[test]
    fn what_does_not_go_on_while_a_hand_is_asked_to_is_no_tip() {
        // A quick hand, and a slow one that pauses besides.
        for (late, share) in [(8, 1.4), (35, 0.6)] {
            for delay in [0, 5, 15] {
                for (carries, goes) in [(1.0, true), (0.0, false), (-0.2, false)] {
                    for sways_px in [0.0, 5.0] {
                        let mut jog = Jog::default();
                        let case = Case { carries, late: [late, delay], share, sways_px, ..CASE };
                        let (found, way_m) = test(&mut jog, case);
                        assert_eq!(found, Some(goes), "{late}, {delay}, {carries}, {sways_px}");
                        assert_eq!(refuses(&jog), !goes);
                        assert!(way_m <= share.max(1.0) * setup(View::Lateral).servo.max_jog_m, "{way_m}");
                    }
                }
            }
        }
        // A hand that does nothing cannot be told from a candidate that stands still, which is not believed.
        assert_eq!(test(&mut Jog::default(), Case { share: 0.0, ..CASE }).0, Some(false));
    }

    #[test]
    fn another_candidate_ahead_begins_another_test() {
        let setup = setup_with(TIP_PX, 20e-3);
        let mut jog = Jog::default();
        for k in 0..40 {
            let shown = shown(k);
            let seen = seen(&setup, &shown, 20e-3);
            // Each stands still, 0.6 mm ahead of the one before.
            let (_, given_up) = jog.advance(&seen, Some(beside(TIP_PX, 6.0 * (k / 10) as f64, 0.0)));
            assert!(!jog.goes() && !given_up, "{k}");
            assert_eq!(jog.testing(), k % 10 != 0 || k == 0, "{k}");
        }
    }

    #[test]
    fn a_hand_is_asked_for_no_more_than_a_search_may_feed_nor_past_the_target() {
        let mut jog = Jog::default();
        let decoys = (0..6).map(|i| Case { px: [100.0 + 40.0 * f64::from(i), 100.0], carries: 0.0, ..CASE });
        let last = decoys.map(|case| test(&mut jog, case).0).last();
        assert_eq!(last, Some(None), "nothing is believed any more");
        assert!(jog.asked_m() <= setup(View::Lateral).servo.max_jog_m + PERIOD_S * SPEED_M_S);
        // A decoy behind the tip tells nothing of the way that is left.
        let behind = Case { px: beside(TIP_PX, -50.0, 0.0), carries: 0.0, remaining_m: 1.0e-3, ..CASE };
        let (found, way_m) = test(&mut Jog::default(), behind);
        // This hand goes faster than it is asked to, and stops late.
        assert!(found != Some(true) && way_m <= 1.5e-3, "{found:?}, {way_m}");
    }

    #[test]
    fn a_hand_is_asked_while_the_plane_arrives_but_not_near_the_target() {
        for (remaining_m, asks) in [(20e-3, true), (13e-3, false)] {
            for arriving in [true, false] {
                let setup = setup_with(TIP_PX, remaining_m);
                let shown = shown(0);
                let seen = Seen { arriving, ..seen(&setup, &shown, remaining_m) };
                let (feed_m_s, _) = Jog::default().advance(&seen, None);
                assert_eq!(feed_m_s > 0.0, asks && arriving, "{remaining_m}, {arriving}");
            }
        }
    }

    #[test]
    fn before_the_target_a_candidate_must_lie_on_the_needles_way() {
        for (along_px, across_px, near) in [
            (0.0, 0.0, true),
            (80.0, 5.0, true),
            (80.0, 15.0, false),
            (-15.0, 0.0, false),
            (120.0, 0.0, false),
        ] {
            let px = beside(TIP_PX, along_px, across_px);
            // The candidate stands at the target.
            let setup = setup_with(px, 0.0);
            let shown = shown(0);
            let seen = seen(&setup, &shown, 20e-3);
            let mut jog = Jog::default();
            assert_eq!(jog.advance(&seen, Some(px)), (0.0, false));
            assert_eq!(jog.goes(), near, "{along_px}, {across_px}");
        }
    }
}
