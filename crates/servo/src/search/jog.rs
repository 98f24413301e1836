//! A candidate for the lost tip must go with the needle: what only looks like a tip stands still while the needle is fed.
//!
//! How far a robot feeds it is measured, and a candidate is held against that. A hand is asked to go on slowly, and nobody measures
//! what comes of it: there what counts is that the candidate goes on along the needle at all.

use serde::{Deserialize, Serialize};
use sonoloop_types::{Acquisition, Disc, Point, Pose, Setup, View};

use crate::servo::HAND_GOES_ON_M;
use crate::{feed, predict};

/// Fastest feed of a test.
const SPEED_M_S: f64 = 5e-3;
/// What a hand is asked for in a test.
const HAND_SPEED_M_S: f64 = 1e-3;
/// A candidate that went on by so much along the needle goes with the hand …
const HAND_GOES_M: f64 = 0.35e-3;
/// … and one that did not while the hand was asked for so much is none: 2 s, of which a slow reaction and a pause leave 0.6. [assumed]
const HAND_STAYS_M: f64 = 2e-3;
/// A needle slower than this stands.
const REST_M_S: f64 = 0.05e-3;
/// What went along with the needle over this way is the tip …
const GOES_M: f64 = 0.3e-3;
/// … and what did not over this way is none.
const STAYS_M: f64 = 0.8e-3;
/// Share of the needle's way by which a candidate may miss where the needle would have carried it.
const MISS: f64 = 0.5;
/// A candidate this far both from where it was and from where the needle would have carried it is another one.
const JUMP_PX: f64 = 10.0;
/// What lies this near to a refused place, in the picture and across it, is the same thing.
const SAME_M: [f64; 2] = [1.5e-3, 2.5e-3];
/// A test may take this many times what its way takes, and this long besides.
const PATIENCE: f64 = 2.0;
const PATIENCE_S: f64 = 0.5;
/// A needle that was fed as long as that and went less far is blocked: nothing can be told by it.
const BLOCKED_M: f64 = 0.1e-3;
/// Where the target leaves less room than this for a test, or so near lets the needle be fed at less than this share of a test's speed …
const LEAST_ROOM_M: f64 = 0.4e-3;
const LEAST_SPEED: f64 = 0.2;
/// … a candidate must be this near to where probe and needle have been measured to bring the tip.
const NEAR_M: f64 = 0.5e-3;
/// A hand sways meanwhile, and nobody knows how far it went on: it must be this near to the needle's way.
const HAND_NEAR_M: f64 = 1e-3;

/// The candidate under test, when the test began.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
struct Start {
    px: [f64; 2],
    base_from_probe: Pose,
    depth_m: f64,
    time_s: f64,
}

/// What one picture says of a candidate.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Verdict {
    Unknown,
    Goes,
    Stays,
    /// It is another one.
    Jumped,
}

/// The tests of one search.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct Jog {
    start: Option<Start>,
    goes: bool,
    /// Way of the needle since the first test, and its depth in the last picture.
    spent_m: f64,
    last_depth_m: Option<f64>,
    /// What stands for the depth of a needle in a hand: the way that tests have asked of it.
    asked_m: f64,
    asked_m_s: f64,
    /// Places, base frame, of what did not go along.
    refused: Vec<Point>,
}

/// A picture, and what is known beside it.
#[derive(Debug, Clone, Copy)]
pub struct Seen<'a> {
    /// What the tracker was told at the start.
    pub setup: &'a Setup,
    /// What the rig measured.
    pub acquisition: &'a Acquisition,
    /// Time of the picture.
    pub time_s: f64,
    /// Time since the last one.
    pub dt_s: f64,
    /// Where the last believed tip is now, by what probe and needle have been measured to do.
    pub expected_px: [f64; 2],
    /// Way to the target from there.
    pub remaining_m: f64,
}

impl Seen<'_> {
    fn by_hand(&self) -> bool {
        self.acquisition.depth_m.is_none()
    }

    /// Way to the target, from a candidate in a hand, whose needle has gone on unmeasured.
    fn from(self, px: [f64; 2]) -> Self {
        if !self.by_hand() {
            return self;
        }
        let Seen { setup, acquisition, .. } = self;
        let place = acquisition.base_from_probe * setup.geometry.probe_from_px(px);
        Self { remaining_m: feed::remaining_m(setup, &place), ..self }
    }

    /// Whether a place is where the tip should be.
    fn is_near(&self, px: [f64; 2]) -> bool {
        let Seen { setup, acquisition, expected_px, .. } = *self;
        let off = [0, 1].map(|axis| (px[axis] - expected_px[axis]) * setup.geometry.spacing_m);
        if !self.by_hand() {
            return off[0].hypot(off[1]) < NEAR_M;
        }
        let axis = predict::axis_px(&setup.needle_axis_in_base, &acquisition.base_from_probe);
        axis.is_some_and(|[u, v]| {
            let ahead_m = (off[0] * u + off[1] * v).clamp(0.0, HAND_GOES_ON_M + self.setup.servo.max_jog_m);
            (off[0] - ahead_m * u).hypot(off[1] - ahead_m * v) < HAND_NEAR_M
        })
    }
}

impl Jog {
    /// Whether candidates can be tested: the needle moves within the picture.
    pub fn applies(setup: &Setup) -> bool {
        setup.view == View::Lateral && setup.servo.max_jog_m > 0.0
    }

    /// The way that was asked of a hand.
    pub fn asked_m(&self) -> f64 {
        self.asked_m
    }

    /// True once the candidate has gone with the needle.
    pub fn goes(&self) -> bool {
        self.goes
    }

    /// True while a candidate is under test.
    pub fn testing(&self) -> bool {
        self.start.is_some()
    }

    /// Where in a picture those lie that were refused before.
    pub fn refused(&self, setup: &Setup, acquisition: &Acquisition) -> Vec<Disc> {
        let probe_from_base = acquisition.base_from_probe.inverse();
        let seen = self.refused.iter().map(|place| probe_from_base * place);
        let radius_px = SAME_M[0] / setup.geometry.spacing_m;
        seen.filter(|place| place.y.abs() < SAME_M[1])
            .map(|place| Disc { centre_px: setup.geometry.px_from_probe(&place), radius_px })
            .collect()
    }

    /// Takes every picture of the search; `px` is the candidate where one may be tested, the plane standing still. Returns the
    /// feed, and whether the candidate was given up just now.
    pub fn advance(&mut self, seen: &Seen, px: Option<[f64; 2]>) -> (f64, bool) {
        let (feed_m_s, given_up) = self.test(seen, px);
        self.asked_m_s = feed_m_s;
        (feed_m_s, given_up)
    }

    fn test(&mut self, seen: &Seen, px: Option<[f64; 2]>) -> (f64, bool) {
        let Seen { setup, acquisition, time_s, .. } = *seen;
        if seen.by_hand() {
            self.asked_m += self.asked_m_s * seen.dt_s;
        }
        let depth_m = acquisition.depth_m.unwrap_or(self.asked_m);
        if let Some(last_m) = &mut self.last_depth_m {
            self.spent_m += (depth_m - *last_m).max(0.0);
            *last_m = depth_m;
        }
        let Some(px) = px else {
            self.stop();
            return (0.0, false);
        };
        let seen = &seen.from(px);
        let Some(start) = self.start else {
            if !has_room(seen) {
                self.goes = seen.is_near(px);
                return (0.0, false);
            }
            self.goes = false;
            // A needle that has not come to rest after the loss yet is let do so. What a hand does meanwhile tells as much as a test.
            let rests = acquisition.feed_m_s.is_none_or(|feed_m_s| feed_m_s.abs() < REST_M_S);
            if !rests || self.spent(seen) {
                return (0.0, false);
            }
            self.start = Some(Start { px, base_from_probe: acquisition.base_from_probe, depth_m, time_s });
            self.last_depth_m.get_or_insert(depth_m);
            return (self.feed_m_s(seen), false);
        };
        let fed_m = depth_m - start.depth_m;
        match verdict(setup, acquisition, &start, fed_m, px) {
            Verdict::Jumped => {
                self.stop();
                return (0.0, false);
            }
            _ if self.goes => {}
            Verdict::Goes => self.goes = true,
            Verdict::Stays => {
                self.remember(setup, &start);
                self.stop();
                return (0.0, true);
            }
            Verdict::Unknown if time_s - start.time_s > patience_s(seen) => {
                // Before a needle that is blocked every candidate stands still.
                self.goes = fed_m < BLOCKED_M && !self.spent(seen) && !seen.by_hand();
                if !self.goes {
                    // There was no room, or no time, for a whole test.
                    if fed_m >= GOES_M {
                        self.remember(setup, &start);
                    }
                    self.stop();
                    return (0.0, true);
                }
            }
            Verdict::Unknown => {}
        }
        let feed_m_s = if fed_m < BLOCKED_M && self.goes { 0.0 } else { self.feed_m_s(seen) };
        (feed_m_s, false)
    }

    /// Remembers what did not go along.
    fn remember(&mut self, setup: &Setup, start: &Start) {
        self.refused.push(start.base_from_probe * setup.geometry.probe_from_px(start.px));
    }

    /// Ends a test without a verdict.
    fn stop(&mut self) {
        self.start = None;
        self.goes = false;
    }

    /// Whether all that tests may feed is spent, or on its way.
    fn spent(&self, seen: &Seen) -> bool {
        self.spent_m + feed::travelled_since_m(seen.setup, seen.acquisition) >= seen.setup.servo.max_jog_m
    }

    fn feed_m_s(&self, seen: &Seen) -> f64 {
        if self.spent(seen) {
            return 0.0;
        }
        let Seen { setup, acquisition, remaining_m, .. } = *seen;
        let since_m = feed::travelled_since_m(setup, acquisition);
        feed::feed_m_s(setup, remaining_m, since_m, acquisition.depth_m).min(test_speed_m_s(seen))
    }
}

fn test_speed_m_s(seen: &Seen) -> f64 {
    let most_m_s = if seen.by_hand() { HAND_SPEED_M_S } else { SPEED_M_S };
    most_m_s.min(seen.setup.servo.feed_m_s).min(seen.setup.limits.max_feed_m_s)
}

/// Whether the needle can still be fed as far as a test needs, and as fast.
fn has_room(seen: &Seen) -> bool {
    let Seen { setup, acquisition, remaining_m, .. } = *seen;
    let feed_m_s = feed::feed_m_s(setup, remaining_m, 0.0, acquisition.depth_m);
    remaining_m - setup.servo.arrived_m >= LEAST_ROOM_M && feed_m_s >= LEAST_SPEED * test_speed_m_s(seen)
}

/// The longest that a test may take.
fn patience_s(seen: &Seen) -> f64 {
    let speed_m_s = test_speed_m_s(seen);
    let way_m = if seen.by_hand() { HAND_STAYS_M } else { STAYS_M };
    PATIENCE * (way_m / speed_m_s + feed::age_s(seen.setup, seen.acquisition)) + PATIENCE_S
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
    let off_px = |motion: [f64; 2]| (px[0] - start.px[0] - motion[0]).hypot(px[1] - start.px[1] - motion[1]);
    let way_px = (with[0] - without[0]).hypot(with[1] - without[1]);
    if acquisition.depth_m.is_none() {
        return verdict_by_hand(setup, start, fed_m, [with, without], px);
    }
    if off_px(with).min(off_px(without)) > JUMP_PX {
        Verdict::Jumped
    } else if fed_m >= GOES_M && off_px(with) <= MISS * way_px {
        Verdict::Goes
    } else if fed_m >= STAYS_M {
        Verdict::Stays
    } else {
        Verdict::Unknown
    }
}

/// The same with the needle in a hand, which was asked for `asked_m` and may have gone farther, less far, or not yet.
fn verdict_by_hand(
    setup: &Setup,
    start: &Start,
    asked_m: f64,
    [with, without]: [[f64; 2]; 2],
    px: [f64; 2],
) -> Verdict {
    let way = [with[0] - without[0], with[1] - without[1]];
    let way_px = way[0].hypot(way[1]);
    if way_px == 0.0 {
        return Verdict::Unknown;
    }
    let off = [0, 1].map(|axis| px[axis] - start.px[axis] - without[axis]);
    let along_px = (off[0] * way[0] + off[1] * way[1]) / way_px;
    let across_px = (off[0] * way[1] - off[1] * way[0]) / way_px;
    let along_m = along_px * setup.geometry.spacing_m;
    if across_px.abs() > JUMP_PX || along_px < -JUMP_PX || along_m > HAND_GOES_ON_M {
        Verdict::Jumped
    } else if along_m >= HAND_GOES_M {
        Verdict::Goes
    } else if asked_m >= HAND_STAYS_M {
        Verdict::Stays
    } else {
        Verdict::Unknown
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::servo::tests::{acquisition, setup};

    const PERIOD_S: f64 = 0.04;

    /// What a candidate does, and the rig.
    #[derive(Clone, Copy)]
    struct Case {
        px: [f64; 2],
        /// Share of the needle's way that the candidate goes along.
        carries: f64,
        /// Images that a command is on its way, and a picture.
        delays: [usize; 2],
        /// Nothing moves the needle.
        blocked: bool,
        remaining_m: f64,
        expected_px: [f64; 2],
    }

    const CASE: Case = Case {
        px: [300.0, 150.0],
        carries: 1.0,
        delays: [0, 0],
        blocked: false,
        remaining_m: 20e-3,
        expected_px: [300.0, 150.0],
    };

    /// Tests a candidate until there is a verdict and the needle stands: the needle's way, and whether the candidate went along
    /// (`None` without a test that ended).
    fn test(jog: &mut Jog, setup: &Setup, case: Case) -> (f64, Option<bool>) {
        let Case { px, carries, delays: [command, image], blocked, remaining_m, expected_px } = case;
        let mut commanded = vec![0.0; command];
        let mut ways_m = vec![0.0];
        let mut found = None;
        for k in 0..200 {
            let way_m = ways_m[ways_m.len().saturating_sub(1 + image)];
            let before_m = ways_m[ways_m.len().saturating_sub(2 + image)];
            // The needle is still coasting from before the loss in the first two pictures.
            let feed_m_s = if k < 2 { 1e-3 } else { (way_m - before_m) / PERIOD_S };
            let shown = acquisition(k);
            let shown = Acquisition {
                depth_m: Some(0.02 + way_m),
                feed_m_s: Some(feed_m_s),
                publication_tick: shown.acquisition_tick + 40 * image as u64,
                ..shown
            };
            let shift_px = carries * way_m / setup.geometry.spacing_m;
            let px = [px[0] + 0.6 * shift_px, px[1] + 0.8 * shift_px];
            let seen = Seen {
                setup,
                acquisition: &shown,
                time_s: PERIOD_S * k as f64,
                dt_s: PERIOD_S,
                expected_px,
                remaining_m: remaining_m - way_m,
            };
            let (fed, given_up) = jog.advance(&seen, Some(px).filter(|_| found.is_none()));
            assert!(k > 1 || fed == 0.0, "the needle has not come to rest");
            if given_up || jog.goes() {
                found = Some(jog.goes());
                jog.stop();
            }
            commanded.push(if found.is_some() { 0.0 } else { fed });
            let moves_m = if blocked { 0.0 } else { PERIOD_S * commanded[commanded.len() - 1 - command] };
            ways_m.push(ways_m[ways_m.len() - 1] + moves_m);
        }
        (ways_m[ways_m.len() - 1], found)
    }

    #[test]
    fn what_goes_with_the_needle_is_believed_and_what_stays_or_goes_elsewhere_is_not() {
        let setup = setup(View::Lateral);
        for (carries, goes) in [(1.0, true), (0.7, true), (0.3, false), (0.0, false), (-0.5, false)] {
            for delays in [[0, 0], [1, 4], [5, 5]] {
                let mut jog = Jog::default();
                let (way_m, found) = test(&mut jog, &setup, Case { carries, delays, ..CASE });
                assert_eq!(found, Some(goes), "{carries}, {delays:?}");
                let late_m = PERIOD_S * SPEED_M_S * (delays[0] + delays[1]) as f64;
                assert!(way_m <= STAYS_M + late_m + PERIOD_S * SPEED_M_S + 1e-9, "{way_m}");
                let refuses = |shown: &Acquisition, px: [f64; 2]| {
                    jog.refused(&setup, shown).iter().any(|disc| disc.contains(px))
                };
                assert_eq!(refuses(&acquisition(9), [302.0, 152.0]), !goes);
                assert!(!refuses(&acquisition(9), [320.0, 150.0]), "another thing");
                let aside = Pose::translation(0.0, 4e-3, 0.0);
                let aside = Acquisition { base_from_probe: aside, ..acquisition(9) };
                assert!(!refuses(&aside, [302.0, 152.0]), "another plane");
            }
        }
    }

    /// The same with the needle in a hand that obeys `late` images after it was asked, at `share` of the speed, and sways across its
    /// way by `sways_px`. Returns the way that was asked for instead of the one that came of it.
    fn test_by_hand(
        jog: &mut Jog,
        carries: f64,
        late: usize,
        share: f64,
        sways_px: f64,
        px: [f64; 2],
    ) -> (f64, Option<bool>) {
        let setup = setup(View::Lateral);
        let mut asked = vec![0.0; late];
        let mut way_m = 0.0;
        for k in 0..100 {
            let shown = Acquisition { depth_m: None, feed_m_s: None, ..acquisition(k) };
            let along_px = carries * way_m / setup.geometry.spacing_m;
            let across_px = sways_px * libm::sin(0.1 * k as f64);
            let px = [px[0] + 0.6 * along_px - 0.8 * across_px, px[1] + 0.8 * along_px + 0.6 * across_px];
            let seen = Seen {
                setup: &setup,
                acquisition: &shown,
                time_s: PERIOD_S * k as f64,
                dt_s: PERIOD_S,
                expected_px: CASE.expected_px,
                remaining_m: 20e-3,
            };
            let (feed_m_s, given_up) = jog.advance(&seen, Some(px));
            if given_up || jog.goes() {
                let found = jog.goes();
                jog.stop();
                return (jog.asked_m(), Some(found));
            }
            asked.push(feed_m_s);
            way_m += PERIOD_S * share * asked[asked.len() - 1 - late];
        }
        (jog.asked_m(), None)
    }

    /// Seen in the paper's lateral 16: an operator's needle stood 12 mm behind a fibre that was taken for it, and was pushed on to the hub.
    #[test]
    fn what_does_not_go_on_while_a_hand_is_asked_to_is_no_tip() {
        // A quick hand, and a slow one that pauses besides.
        for (late, share) in [(8, 1.4), (35, 0.6)] {
            for (carries, goes) in [(1.0, true), (0.0, false), (-0.2, false)] {
                for sways_px in [0.0, 5.0] {
                    let mut jog = Jog::default();
                    let (asked_m, found) = test_by_hand(&mut jog, carries, late, share, sways_px, CASE.px);
                    assert_eq!(found, Some(goes), "{late}, {carries}, {sways_px}");
                    assert!(asked_m <= HAND_STAYS_M + 1e-9, "{asked_m}");
                    assert_eq!(jog.refused.len(), usize::from(!goes));
                }
            }
        }
        // A hand that did nothing cannot be told from a candidate that stands still, and is not believed.
        assert_eq!(test_by_hand(&mut Jog::default(), 1.0, 8, 0.0, 0.0, CASE.px).1, Some(false));
    }

    #[test]
    fn a_hand_is_asked_for_no_more_than_a_search_may_feed() {
        let mut jog = Jog::default();
        let last = (0..6)
            .map(|i| test_by_hand(&mut jog, 0.0, 8, 1.0, 0.0, [100.0 + 40.0 * f64::from(i), 100.0]))
            .last();
        let most_m = setup(View::Lateral).servo.max_jog_m;
        assert!(
            last.is_some_and(
                |(asked_m, found)| found.is_none() && asked_m <= most_m + PERIOD_S * HAND_SPEED_M_S
            )
        );
    }

    #[test]
    fn before_the_target_a_hands_candidate_must_lie_on_the_needles_way() {
        let mut setup = setup(View::Lateral);
        let shown = Acquisition { depth_m: None, feed_m_s: None, ..acquisition(0) };
        let px_at = |along_px: f64, across_px: f64| {
            let [u, v] = CASE.expected_px;
            [u + 0.6 * along_px - 0.8 * across_px, v + 0.8 * along_px + 0.6 * across_px]
        };
        for (along_px, across_px, near) in [
            (0.0, 0.0, true),
            (80.0, 5.0, true),
            (80.0, 15.0, false),
            (-15.0, 0.0, false),
            (180.0, 0.0, false),
        ] {
            let px = px_at(along_px, across_px);
            // The candidate stands at the target.
            setup.target_in_base = shown.base_from_probe * setup.geometry.probe_from_px(px);
            let seen = Seen {
                setup: &setup,
                acquisition: &shown,
                time_s: 0.0,
                dt_s: PERIOD_S,
                expected_px: CASE.expected_px,
                remaining_m: 20e-3,
            };
            let mut jog = Jog::default();
            assert_eq!(jog.advance(&seen, Some(px)), (0.0, false));
            assert_eq!(jog.goes(), near, "{along_px}, {across_px}");
        }
    }

    #[test]
    fn all_tests_of_a_search_together_keep_their_bound() {
        let setup = setup(View::Lateral);
        for delays in [[0, 0], [0, 5]] {
            let mut jog = Jog::default();
            let decoys = (0..20).map(|i| Case { px: [100.0 + 20.0 * f64::from(i), 100.0], ..CASE });
            let ways: Vec<_> =
                decoys.map(|case| test(&mut jog, &setup, Case { carries: 0.0, delays, ..case })).collect();
            let sum_m: f64 = ways.iter().map(|(way_m, _)| way_m).sum();
            let late_m = PERIOD_S * SPEED_M_S * (1 + delays[1]) as f64;
            assert!(sum_m <= setup.servo.max_jog_m + late_m, "{sum_m}");
            assert_eq!(ways.last(), Some(&(0.0, None)), "nothing is believed any more");
        }
    }

    #[test]
    fn the_needle_is_not_fed_past_its_target() {
        let setup = setup(View::Lateral);
        for delays in [[0, 0], [0, 4]] {
            let case = Case { carries: 0.0, remaining_m: 1.0e-3, delays, ..CASE };
            let (way_m, found) = test(&mut Jog::default(), &setup, case);
            assert!(found != Some(true) && way_m <= 1.0e-3, "{way_m}");
        }
    }

    #[test]
    fn just_before_the_target_the_place_decides() {
        let setup = setup(View::Lateral);
        let before = Case { remaining_m: 0.5e-3, ..CASE };
        assert_eq!(test(&mut Jog::default(), &setup, before), (0.0, Some(true)));
        // Along the needle, and beside it.
        for off_px in [[3.6, 4.8], [-4.8, 3.6]] {
            let px = [CASE.px[0] + off_px[0], CASE.px[1] + off_px[1]];
            assert_eq!(test(&mut Jog::default(), &setup, Case { px, ..before }), (0.0, None), "{off_px:?}");
        }
        // Elsewhere, while the needle is well before its target: tested as any other.
        let beyond = Case { px: [340.0, 150.0], carries: 0.0, ..CASE };
        assert_eq!(test(&mut Jog::default(), &setup, beyond).1, Some(false));
    }

    #[test]
    fn an_approach_that_is_too_slow_for_a_test_leaves_it_to_the_place() {
        let mut setup = setup(View::Lateral);
        setup.servo.approach_m = 40e-3;
        let slow = Case { remaining_m: 1.0e-3, ..CASE };
        assert_eq!(test(&mut Jog::default(), &setup, slow), (0.0, Some(true)));
        let px = [CASE.px[0] + 8.0, CASE.px[1]];
        assert_eq!(test(&mut Jog::default(), &setup, Case { px, ..slow }), (0.0, None));
    }

    #[test]
    fn what_room_there_is_before_the_target_is_used() {
        let setup = setup(View::Lateral);
        for (carries, goes) in [(1.0, true), (0.0, false)] {
            let mut jog = Jog::default();
            let (way_m, found) = test(&mut jog, &setup, Case { carries, remaining_m: 0.7e-3, ..CASE });
            assert!(
                found == Some(goes) && (GOES_M..=0.6e-3).contains(&way_m),
                "{carries}: {found:?}, {way_m}"
            );
            assert_eq!(jog.refused.len(), usize::from(!goes));
        }
    }

    #[test]
    fn before_a_needle_that_is_blocked_nothing_is_told() {
        let setup = setup(View::Lateral);
        let case = Case { blocked: true, ..CASE };
        assert_eq!(test(&mut Jog::default(), &setup, case), (0.0, Some(true)));
    }

    #[test]
    fn another_candidate_begins_another_test() {
        let setup = setup(View::Lateral);
        let mut jog = Jog::default();
        let mut look = |k: u64, depth_m: f64, px: [f64; 2]| {
            let shown = Acquisition { depth_m: Some(depth_m), feed_m_s: Some(0.0), ..acquisition(k) };
            let seen = Seen {
                setup: &setup,
                acquisition: &shown,
                time_s: PERIOD_S * k as f64,
                dt_s: PERIOD_S,
                expected_px: px,
                remaining_m: 20e-3,
            };
            let (feed_m_s, given_up) = jog.advance(&seen, Some(px));
            assert!(!given_up);
            (feed_m_s > 0.0, jog.goes())
        };
        assert_eq!(look(0, 20.0e-3, [300.0, 150.0]), (true, false));
        assert_eq!(look(1, 20.4e-3, [302.4, 153.2]), (true, true));
        // Neither where it was nor where it should be.
        assert_eq!(look(2, 20.6e-3, [340.0, 150.0]), (false, false));
        assert_eq!(look(3, 20.6e-3, [340.0, 150.0]), (true, false));
        assert_eq!(look(4, 21.0e-3, [342.4, 153.2]), (true, true));
    }

    #[test]
    fn a_needle_across_the_plane_is_not_tested() {
        assert!(Jog::applies(&setup(View::Lateral)));
        assert!(!Jog::applies(&setup(View::Transverse)));
    }
}
