//! A candidate for the lost tip must go with the needle: what only looks like a tip stands still while the needle is fed.
//!
//! How far a robot feeds it is measured, and a candidate is held against that. Of a needle in a hand see [`super::hand`].

use serde::{Deserialize, Serialize};
use sonoloop_types::{Acquisition, Disc, Point, Pose, Setup, View};

use super::hand::{self, Hand};
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
pub(super) enum Verdict {
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
    hand: Hand,
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
    /// The plane is on its way to a candidate.
    pub arriving: bool,
    /// Where the last believed tip is now, by what probe and needle have been measured to do.
    pub expected_px: [f64; 2],
    /// Way to the target from there.
    pub remaining_m: f64,
    /// How far the tip may have gone on beyond that place unmeasured.
    pub unmeasured_m: f64,
}

impl Seen<'_> {
    /// Motion in the picture of what was at a place when the probe was at `before`, and went `fed_m` along the needle since.
    pub(super) fn motion_px(&self, from_px: [f64; 2], before: &Pose, fed_m: f64) -> Option<[f64; 2]> {
        let Seen { setup, acquisition, .. } = *self;
        let (axis, now) = (&setup.needle_axis_in_base, &acquisition.base_from_probe);
        predict::motion_px(View::Lateral, &setup.geometry, axis, from_px, before, now, fed_m)
    }

    fn by_hand(&self) -> bool {
        self.acquisition.depth_m.is_none()
    }

    /// The same for a tip that is where the candidate is, of a needle in a hand that was asked to go on by `asked_m` since the loss: it
    /// went on, never back.
    fn counted_from(self, px: [f64; 2], asked_m: f64) -> Self {
        let Seen { setup, acquisition, .. } = self;
        if !self.by_hand() {
            return self;
        }
        let place = acquisition.base_from_probe * setup.geometry.probe_from_px(px);
        Self { remaining_m: feed::remaining_m(setup, &place).min(self.remaining_m - asked_m), ..self }
    }

    /// Whether a place is where the tip should be.
    fn is_near(&self, px: [f64; 2]) -> bool {
        let Seen { setup, acquisition, expected_px, unmeasured_m, .. } = *self;
        let off = [0, 1].map(|axis| (px[axis] - expected_px[axis]) * setup.geometry.spacing_m);
        if !self.by_hand() {
            return off[0].hypot(off[1]) < NEAR_M;
        }
        let axis = predict::axis_px(&setup.needle_axis_in_base, &acquisition.base_from_probe);
        axis.is_some_and(|[u, v]| {
            let ahead_m = (off[0] * u + off[1] * v).clamp(0.0, unmeasured_m);
            (off[0] - ahead_m * u).hypot(off[1] - ahead_m * v) < hand::NEAR_M
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
        self.hand.asked_m()
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
        if seen.by_hand() {
            self.hand.ask(seen.time_s, feed_m_s);
        }
        (feed_m_s, given_up)
    }

    fn test(&mut self, seen: &Seen, px: Option<[f64; 2]>) -> (f64, bool) {
        let Seen { setup, acquisition, time_s, .. } = *seen;
        self.hand.pass(time_s);
        let depth_m = acquisition.depth_m.unwrap_or(self.hand.asked_m());
        if let Some(last_m) = &mut self.last_depth_m {
            self.spent_m += (depth_m - *last_m).max(0.0);
            *last_m = depth_m;
        }
        let Some(px) = px else {
            self.stop();
            // A hand takes its time until it obeys. Where the target may be near it waits until a candidate tells how near.
            let far = seen.remaining_m > seen.unmeasured_m + setup.servo.max_jog_m;
            if seen.arriving && seen.by_hand() && far {
                self.last_depth_m.get_or_insert(depth_m);
                return (self.feed_m_s(seen), false);
            }
            return (0.0, false);
        };
        let seen = &seen.counted_from(px, self.hand.asked_m());
        let Some(start) = self.start else {
            if !has_room(seen) {
                self.goes = seen.is_near(px);
                return (0.0, false);
            }
            self.goes = false;
            // A needle that has not come to rest after the loss yet is let do so; of a hand's see [`hand::JUMP_PX`].
            let rests = acquisition.feed_m_s.is_none_or(|feed_m_s| feed_m_s.abs() < REST_M_S);
            if !rests || self.spent(seen) {
                return (0.0, false);
            }
            self.start = Some(Start { px, base_from_probe: acquisition.base_from_probe, depth_m, time_s });
            self.last_depth_m.get_or_insert(depth_m);
            return (self.feed_m_s(seen), false);
        };
        let fed_m = depth_m - start.depth_m;
        let verdict = if seen.by_hand() {
            self.hand.verdict(seen, [start.px, px], &start.base_from_probe, fed_m)
        } else {
            verdict(seen, &start, fed_m, px)
        };
        match verdict {
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
                    if fed_m >= GOES_M && !seen.by_hand() {
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
        self.hand.forget();
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
    let most_m_s = if seen.by_hand() { hand::SPEED_M_S } else { SPEED_M_S };
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
    let way_m = if seen.by_hand() { hand::STAYS_M } else { STAYS_M };
    PATIENCE * (way_m / speed_m_s + feed::age_s(seen.setup, seen.acquisition)) + PATIENCE_S
}

/// Compares how a candidate moved with what the needle's way and the probe's would have made of it.
fn verdict(seen: &Seen, start: &Start, fed_m: f64, px: [f64; 2]) -> Verdict {
    let motion_px = |fed_m: f64| seen.motion_px(start.px, &start.base_from_probe, fed_m);
    let (Some(with), Some(without)) = (motion_px(fed_m), motion_px(0.0)) else { return Verdict::Unknown };
    let off_px = |motion: [f64; 2]| (px[0] - start.px[0] - motion[0]).hypot(px[1] - start.px[1] - motion[1]);
    let way_px = (with[0] - without[0]).hypot(with[1] - without[1]);
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
                arriving: false,
                unmeasured_m: 0.0,
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
                arriving: false,
                unmeasured_m: 0.0,
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
