//! A candidate for the lost tip must go with the needle: what only looks like a tip stands still while the needle is fed.

use serde::{Deserialize, Serialize};
use sonoloop_types::{Acquisition, Point, Pose, Setup, View};

use crate::{feed, predict};

/// Fastest feed of a test.
const SPEED_M_S: f64 = 5e-3;
/// A needle slower than this stands.
const REST_M_S: f64 = 0.05e-3;
/// What went along with the needle over this way is the tip …
const GOES_M: f64 = 0.3e-3;
/// … and what did not over this way is none.
const STAYS_M: f64 = 0.8e-3;
/// Share of the needle's way by which a candidate may miss where the needle would have carried it.
const MISS: f64 = 0.5;
/// What lies this near to a refused place, in the picture and across it, is the same thing.
const SAME_M: [f64; 2] = [1.5e-3, 2.5e-3];

/// The candidate under test, when the test began.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
struct Start {
    px: [f64; 2],
    base_from_probe: Pose,
    depth_m: f64,
}

/// What a test has come to.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Verdict {
    Unknown,
    Goes,
    Stays,
}

/// The tests of one search.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct Jog {
    start: Option<Start>,
    goes: bool,
    /// Way of the needle in all tests, and its depth in the last picture of a test.
    spent_m: f64,
    last_depth_m: Option<f64>,
    /// Places, base frame, of what did not go along.
    refused: Vec<Point>,
}

impl Jog {
    /// Whether candidates can be tested: the needle moves within the picture, by a robot that knows its depth.
    pub fn applies(setup: &Setup, acquisition: &Acquisition) -> bool {
        setup.view == View::Lateral && acquisition.depth_m.is_some() && setup.servo.max_jog_m > 0.0
    }

    /// True once the candidate has gone with the needle.
    pub fn goes(&self) -> bool {
        self.goes
    }

    /// Whether a candidate was refused before.
    pub fn refuses(&self, setup: &Setup, acquisition: &Acquisition, px: [f64; 2]) -> bool {
        let probe_from_base = acquisition.base_from_probe.inverse();
        let seen = setup.geometry.probe_from_px(px);
        self.refused.iter().any(|place| {
            let off_m = probe_from_base * place - seen;
            off_m.x.hypot(off_m.z) < SAME_M[0] && off_m.y.abs() < SAME_M[1]
        })
    }

    /// Takes a picture in which the plane stands; `px` is the candidate that it shows. Returns the feed, and whether the
    /// candidate was refused just now.
    pub fn advance(&mut self, setup: &Setup, acquisition: &Acquisition, px: Option<[f64; 2]>) -> (f64, bool) {
        let depth_m = acquisition.depth_m.unwrap_or(0.0);
        if self.start.is_some() {
            self.spent_m += (depth_m - self.last_depth_m.unwrap_or(depth_m)).max(0.0);
        }
        self.last_depth_m = Some(depth_m);
        let Some(px) = px else {
            self.stop();
            return (0.0, false);
        };
        let Some(start) = self.start else {
            let seen_in_base = acquisition.base_from_probe * setup.geometry.probe_from_px(px);
            // There is no room for a test just before the target.
            self.goes = feed::remaining_m(setup, &seen_in_base) < STAYS_M;
            if self.goes {
                return (0.0, false);
            }
            // A needle that has not come to rest after the loss yet is let do so.
            if acquisition.feed_m_s.is_some_and(|feed_m_s| feed_m_s.abs() < REST_M_S) && !self.spent(setup) {
                self.start = Some(Start { px, base_from_probe: acquisition.base_from_probe, depth_m });
                return (self.feed_m_s(setup), false);
            }
            return (0.0, false);
        };
        if !self.goes {
            match verdict(setup, acquisition, &start, depth_m - start.depth_m, px) {
                Verdict::Goes => self.goes = true,
                Verdict::Unknown if !self.spent(setup) => {}
                Verdict::Unknown | Verdict::Stays => {
                    self.refused.push(acquisition.base_from_probe * setup.geometry.probe_from_px(px));
                    self.stop();
                    return (0.0, true);
                }
            }
        }
        (self.feed_m_s(setup), false)
    }

    /// Ends a test without a verdict.
    pub fn stop(&mut self) {
        self.start = None;
        self.goes = false;
        self.last_depth_m = None;
    }

    fn spent(&self, setup: &Setup) -> bool {
        self.spent_m >= setup.servo.max_jog_m
    }

    fn feed_m_s(&self, setup: &Setup) -> f64 {
        if self.spent(setup) {
            return 0.0;
        }
        SPEED_M_S.min(setup.servo.feed_m_s).min(setup.limits.max_feed_m_s)
    }
}

/// Compares how a candidate moved with what the needle's way and the probe's would have made of it.
fn verdict(setup: &Setup, acquisition: &Acquisition, start: &Start, fed_m: f64, px: [f64; 2]) -> Verdict {
    let motion_px = |fed_m: f64| {
        predict::motion_px(
            View::Lateral,
            &setup.geometry,
            &setup.needle_axis_in_base,
            start.px,
            &start.base_from_probe,
            &acquisition.base_from_probe,
            fed_m,
        )
    };
    let (Some(with), Some(without)) = (motion_px(fed_m), motion_px(0.0)) else { return Verdict::Unknown };
    let way_px = (with[0] - without[0]).hypot(with[1] - without[1]);
    let miss_px = (px[0] - start.px[0] - with[0]).hypot(px[1] - start.px[1] - with[1]);
    if fed_m >= GOES_M && miss_px <= MISS * way_px {
        Verdict::Goes
    } else if fed_m >= STAYS_M {
        Verdict::Stays
    } else {
        Verdict::Unknown
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::servo::tests::{acquisition, setup};

    /// Tests what is seen at `px` while the needle obeys and `carries` takes that share of its way; returns the feed's way, and
    /// whether the candidate went along (`None` where the test did not end).
    fn test(jog: &mut Jog, setup: &Setup, mut px: [f64; 2], carries: f64) -> (f64, Option<bool>) {
        let (mut fed_m, mut feed_m_s) = (0.0, 0.0);
        for k in 0..50 {
            let seen = Acquisition {
                depth_m: Some(0.02 + fed_m),
                feed_m_s: Some(if k < 2 { 1e-3 } else { feed_m_s }),
                ..acquisition(k)
            };
            let refused;
            (feed_m_s, refused) = jog.advance(setup, &seen, Some(px));
            if refused || jog.goes() {
                return (fed_m, Some(jog.goes()));
            }
            assert!(k > 1 || feed_m_s == 0.0, "the needle has not come to rest");
            fed_m += 0.04 * feed_m_s;
            let way_px = 0.04 * feed_m_s / setup.geometry.spacing_m;
            px = [px[0] + 0.6 * carries * way_px, px[1] + 0.8 * carries * way_px];
        }
        (fed_m, None)
    }

    #[test]
    fn what_goes_with_the_needle_is_believed_and_what_stays_or_goes_elsewhere_is_not() {
        let setup = setup(View::Lateral);
        for (carries, goes) in [(1.0, true), (0.7, true), (0.3, false), (0.0, false), (-1.0, false)] {
            let mut jog = Jog::default();
            let (fed_m, found) = test(&mut jog, &setup, [300.0, 150.0], carries);
            assert_eq!(found, Some(goes), "{carries}");
            assert!(fed_m <= STAYS_M + 0.04 * SPEED_M_S, "{fed_m}");
            assert_eq!(jog.refuses(&setup, &acquisition(9), [302.0, 152.0]), !goes);
            assert!(!jog.refuses(&setup, &acquisition(9), [320.0, 150.0]), "another thing");
            let aside = Pose::translation(0.0, 4e-3, 0.0);
            let aside = Acquisition { base_from_probe: aside, ..acquisition(9) };
            assert!(!jog.refuses(&setup, &aside, [302.0, 152.0]), "another plane");
        }
    }

    #[test]
    fn all_tests_of_a_search_together_keep_their_bound() {
        let setup = setup(View::Lateral);
        let mut jog = Jog::default();
        let ways = (0..20).map(|i| test(&mut jog, &setup, [100.0 + 20.0 * f64::from(i), 100.0], 0.0));
        let ways: Vec<_> = ways.collect();
        let sum_m: f64 = ways.iter().map(|(way_m, _)| way_m).sum();
        assert!(sum_m <= setup.servo.max_jog_m + 0.04 * SPEED_M_S, "{sum_m}");
        assert_eq!(ways.last(), Some(&(0.0, None)), "nothing is believed any more");
    }

    #[test]
    fn just_before_the_target_there_is_no_test() {
        let setup = setup(View::Lateral);
        let target_px = setup.geometry.px_from_probe(&setup.target_in_base);
        let mut jog = Jog::default();
        assert_eq!(test(&mut jog, &setup, [target_px[0], target_px[1] - 4.0], 0.0), (0.0, Some(true)));
    }

    #[test]
    fn a_needle_across_the_plane_and_one_in_a_hand_are_not_tested() {
        let by_hand = Acquisition { depth_m: None, ..acquisition(0) };
        assert!(Jog::applies(&setup(View::Lateral), &acquisition(0)));
        assert!(!Jog::applies(&setup(View::Lateral), &by_hand));
        assert!(!Jog::applies(&setup(View::Transverse), &acquisition(0)));
    }
}
