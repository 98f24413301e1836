//! Find a lost tip by moving the plane: look, then go along a pattern in elevation and yaw about the last tip.
//!
//! The needle stands still on the way. A sweep does not stop at the first candidate, which is the edge of the
//! slice: it goes on until the candidate fades, fits the tip's level over the path, returns to its crest and only
//! there lets the tracker confirm, in a lateral view once the candidate has gone along with a short feed ([`Jog`]). Travel,
//! force and time are bounded; not found is an honest end.

mod crest;
mod hand;
mod jog;
mod pattern;

use serde::{Deserialize, Serialize};
use sonoloop_types::ServoSettings;

use crest::{Sample, brightest, crest_at};
pub use jog::{Jog, Seen};
use pattern::{Axis, waypoint};

/// The time of looking after a restart of the tracker: the needle went on unseen, and all within reach is searched.
const LOOK_AFTER_RESTART_S: f64 = 1.0;
/// Pictures beyond a crest's brightest without its candidate that end it.
const GAP_IMAGES: u32 = 2;
/// What lies farther than this from a crest's candidate in the picture is another one.
const SAME_PX: f64 = 10.0;

/// What the search is doing.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub enum Phase {
    /// Standing still.
    Look,
    /// Moving the plane towards the next waypoint.
    Sweep,
    /// Going to the crest, then waiting there for the confirmation.
    Crest {
        /// Where the crest was found, in the axis' unit.
        at: f64,
        /// When the plane arrived there.
        arrived_s: Option<f64>,
    },
    /// Nothing found within the bounds.
    NotFound,
}

/// Offset of the plane from where the tip was lost.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct Offset {
    /// Along the probe's y, metres.
    pub elevation_m: f64,
    /// About the probe's z through the last tip, radians.
    pub yaw_rad: f64,
}

impl Offset {
    fn along(&self, axis: Axis) -> f64 {
        match axis {
            Axis::Elevation => self.elevation_m,
            Axis::Yaw => self.yaw_rad,
        }
    }

    fn along_mut(&mut self, axis: Axis) -> &mut f64 {
        match axis {
            Axis::Elevation => &mut self.elevation_m,
            Axis::Yaw => &mut self.yaw_rad,
        }
    }
}

/// One search, from the loss to the confirmation or the end of its bounds.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Search {
    /// What it is doing.
    pub phase: Phase,
    /// Where the plane is sent.
    pub commanded: Offset,
    /// Along which a candidate is followed.
    axis: Axis,
    /// Number of the next waypoint.
    leg: usize,
    first_side: f64,
    /// Level from which a candidate may be confirmed where the tip was lost; `None` when none may.
    least_level: Option<f64>,
    /// The last candidate was that bright.
    bright: bool,
    /// Side to which the plane was moved last, along the axis.
    heading: f64,
    look_until_s: f64,
    began_s: f64,
    travel_m: f64,
    crest: Vec<Sample>,
    /// The candidate that the crest is of: where it was seen last, and as it was likest to the tip.
    crest_of: Candidate,
    /// Levels beside a candidate's own count; no more once a crest was not confirmed.
    levels_count: bool,
    /// The candidate was brightest where it came into sight, and is followed the other way.
    crest_reversed: bool,
    gap_images: u32,
    last: Option<Offset>,
    /// Tests of its candidates.
    pub jog: Jog,
}

/// What may be the tip.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct Candidate {
    /// Where in the picture.
    pub px: [f64; 2],
    /// NCC with the first template.
    pub likeness: f64,
}

/// What the search is told with each picture.
#[derive(Debug, Clone, Copy)]
pub struct View {
    /// Time of the picture.
    pub time_s: f64,
    /// Time since the last picture.
    pub dt_s: f64,
    /// Measured offset of the plane from where the tip was lost.
    pub measured: Offset,
    /// The candidate for the tip that was seen.
    pub candidate: Option<Candidate>,
    /// Its grey level, or that of what was likest to the tip.
    pub level: Option<f64>,
    /// False while the contact force says that the probe is off the surface.
    pub in_contact: bool,
    /// False while the arm holds, or stands before a collision.
    pub arm_obeys: bool,
    /// The contact force is above what a search may press with.
    pub pressed_hard: bool,
}

impl Search {
    /// Begins at `time_s`; `first_side` (±1) is the side swept first, from the memory of the last motion.
    ///
    /// A candidate dimmer than `least_level` is not confirmed where the plane happens to stand, and none is without such a
    /// level: it may be the edge of the slice, and its crest is looked for. A tip that went with the contact is the exception.
    pub fn new(
        settings: &ServoSettings,
        time_s: f64,
        first_side: f64,
        least_level: Option<f64>,
        after_restart: bool,
    ) -> Self {
        Self {
            phase: Phase::Look,
            commanded: Offset::default(),
            axis: Axis::Elevation,
            leg: 0,
            first_side,
            least_level,
            bright: false,
            heading: first_side,
            look_until_s: time_s + if after_restart { LOOK_AFTER_RESTART_S } else { settings.look_s },
            began_s: time_s,
            travel_m: 0.0,
            crest: Vec::new(),
            crest_of: Candidate::default(),
            levels_count: true,
            crest_reversed: false,
            gap_images: 0,
            last: None,
            jog: Jog::default(),
        }
    }

    /// What is seen here is not the tip: goes on looking elsewhere.
    pub fn refuse(&mut self) {
        self.bright = false;
        self.least_level = None;
        self.levels_count = false;
        if self.phase != Phase::NotFound {
            self.phase = Phase::Sweep;
        }
    }

    /// True while the tracker must not confirm a candidate because the plane is on its way.
    pub fn holds_confirmation(&self) -> bool {
        match self.phase {
            Phase::Sweep | Phase::Crest { arrived_s: None, .. } => true,
            Phase::Look => !self.bright,
            Phase::Crest { .. } | Phase::NotFound => false,
        }
    }

    /// Takes one picture's answer and sets [`Self::commanded`].
    pub fn advance(&mut self, settings: &ServoSettings, view: &View) {
        if let Some(last) = self.last {
            self.travel_m += (view.measured.elevation_m - last.elevation_m).abs();
        }
        self.last = Some(view.measured);
        if !(view.in_contact && view.arm_obeys) {
            // Nothing can be seen without contact, nothing searched by an arm that stands: wait, and do not count the time.
            self.began_s += view.dt_s;
            self.look_until_s = self.look_until_s.max(view.time_s + settings.look_s);
            if self.phase == Phase::Sweep {
                self.phase = Phase::Look;
            }
            if !view.in_contact && self.commanded == Offset::default() {
                // What went is the contact: back on the surface the plane stands where it stood, and any candidate may be the tip.
                self.least_level = Some(f64::NEG_INFINITY);
            }
            return;
        }
        let spent = view.time_s - self.began_s > settings.max_search_s
            || self.travel_m > settings.max_search_travel_m;
        let candidate = view.candidate.is_some();
        self.bright =
            candidate && self.least_level.is_some_and(|least| view.level.is_some_and(|level| level >= least));
        match self.phase {
            Phase::NotFound => {}
            Phase::Look => {
                if view.time_s >= self.look_until_s && !self.bright {
                    self.phase = Phase::Sweep;
                }
            }
            _ if spent => self.phase = Phase::NotFound,
            // The force controller takes the press back; until then the plane stands still, and the time counts.
            _ if view.pressed_hard => {}
            Phase::Sweep => self.sweep(settings, view),
            Phase::Crest { at, arrived_s } => self.wait_at_crest(settings, view, candidate, at, arrived_s),
        }
    }

    /// Whether the candidate in sight belongs to the crest. One that lies elsewhere does not, and begins a crest of its own if it is
    /// likelier the tip.
    fn takes(&mut self, candidate: Candidate) -> bool {
        let [u, v] = [0, 1].map(|axis| candidate.px[axis] - self.crest_of.px[axis]);
        let same = u.hypot(v) <= SAME_PX;
        if self.crest.is_empty() || (!same && candidate.likeness > self.crest_of.likeness) {
            self.crest.clear();
            self.crest_reversed = false;
            self.crest_of = candidate;
        } else if same {
            let likeness = candidate.likeness.max(self.crest_of.likeness);
            self.crest_of = Candidate { likeness, ..candidate };
        } else {
            return false;
        }
        true
    }

    fn sweep(&mut self, settings: &ServoSettings, view: &View) {
        let at = view.measured.along(self.axis);
        let candidate = view.candidate.is_some_and(|candidate| self.takes(candidate));
        // What grows brighter than the candidate that began a crest belongs to it, though the tracker refuses it for its looks.
        let brighter = self.levels_count
            && view.candidate.is_none()
            && brightest(&self.crest).is_some_and(|best| view.level.is_some_and(|l| l > best.level));
        if candidate || brighter {
            self.gap_images = 0;
            self.crest.push(Sample { at, level: view.level.unwrap_or(0.0) });
        } else if !self.crest.is_empty() {
            self.gap_images += 1;
        }
        if let Some(best) = brightest(&self.crest) {
            // A candidate is followed until it fades, beyond a turning point too, and to its other side when it was
            // brightest where it came into sight: turned back from, it would be taken for a crest at its edge.
            let along = if self.crest_reversed { -self.heading } else { self.heading };
            let beyond = (at - best.at) * along > 0.0;
            if !beyond {
                self.gap_images = 0;
            }
            let dim = self.crest.last().is_some_and(|s| s.level < best.level - settings.crest_levels);
            let passed = beyond && (dim || self.gap_images >= GAP_IMAGES);
            let end = along * self.reach(settings);
            if passed || self.step_towards(settings, end, view.dt_s) {
                if self.crest[0].at == best.at && !self.crest_reversed {
                    self.crest_reversed = true;
                    self.gap_images = 0;
                } else {
                    self.go_to_crest();
                }
            }
            return;
        }
        let Some(goal) = waypoint(settings, self.first_side, self.leg) else {
            self.phase = Phase::NotFound;
            return;
        };
        self.face(goal);
        if self.step_both(settings, goal, view.dt_s) {
            self.leg += 1;
        }
    }

    /// Remembers along which coordinate, and to which side, the plane is moved.
    fn face(&mut self, goal: Offset) {
        let elevation_m = goal.elevation_m - self.commanded.elevation_m;
        let yaw_rad = goal.yaw_rad - self.commanded.yaw_rad;
        (self.axis, self.heading) = if elevation_m != 0.0 {
            (Axis::Elevation, elevation_m.signum())
        } else if yaw_rad != 0.0 {
            (Axis::Yaw, yaw_rad.signum())
        } else {
            (self.axis, self.heading)
        };
    }

    fn go_to_crest(&mut self) {
        let at = crest_at(&self.crest);
        self.crest.clear();
        self.crest_reversed = false;
        self.gap_images = 0;
        self.phase = Phase::Crest { at, arrived_s: None };
    }

    fn wait_at_crest(
        &mut self,
        settings: &ServoSettings,
        view: &View,
        candidate: bool,
        at: f64,
        arrived_s: Option<f64>,
    ) {
        match arrived_s {
            None => {
                let there = self.step_towards(settings, at, view.dt_s);
                let near = match self.axis {
                    Axis::Elevation => 0.1e-3,
                    Axis::Yaw => 0.1_f64.to_radians(),
                };
                if there && (view.measured.along(self.axis) - at).abs() < near {
                    self.phase = Phase::Crest { at, arrived_s: Some(view.time_s) };
                }
            }
            // No confirmation: a decoy, or the crest was misjudged. Go on where the sweep was.
            Some(since_s)
                if !self.jog.testing()
                    && view.time_s - since_s > settings.confirm_s * if candidate { 2.0 } else { 1.0 } =>
            {
                self.refuse();
            }
            Some(_) => {}
        }
    }

    fn reach(&self, settings: &ServoSettings) -> f64 {
        match self.axis {
            Axis::Elevation => settings.sweep_reach_m,
            Axis::Yaw => settings.yaw_reach_rad,
        }
    }

    /// Moves the command along the axis towards `goal` by one picture's worth; true when it is there.
    fn step_towards(&mut self, settings: &ServoSettings, goal: f64, dt_s: f64) -> bool {
        let mut there = self.commanded;
        *there.along_mut(self.axis) = goal;
        self.step_both(settings, there, dt_s)
    }

    /// Moves the command straight towards `goal` by one picture's worth; true when it is there.
    fn step_both(&mut self, settings: &ServoSettings, goal: Offset, dt_s: f64) -> bool {
        let elevation_m = goal.elevation_m - self.commanded.elevation_m;
        let yaw_rad = goal.yaw_rad - self.commanded.yaw_rad;
        let needed_s =
            (elevation_m.abs() / settings.sweep_speed_m_s).max(yaw_rad.abs() / settings.yaw_speed_rad_s);
        if needed_s <= dt_s {
            self.commanded = goal;
            return true;
        }
        self.commanded.elevation_m += elevation_m * dt_s / needed_s;
        self.commanded.yaw_rad += yaw_rad * dt_s / needed_s;
        false
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::servo::tests::settings;

    const TIP: Candidate = Candidate { px: [300.0, 150.0], likeness: 0.95 };

    /// A picture at `time_s` without a candidate, with the plane where it was sent and nothing amiss.
    fn empty(search: &Search, time_s: f64) -> View {
        View {
            time_s,
            dt_s: 0.04,
            measured: search.commanded,
            candidate: None,
            level: None,
            in_contact: true,
            arm_obeys: true,
            pressed_hard: false,
        }
    }

    /// Runs a search over a tip that is seen within `half_width_m` of `tip_m`; the plane follows its command.
    fn run(tip_m: f64, half_width_m: f64, first_side: f64) -> (Search, f64, f64) {
        let settings = settings();
        let mut search = Search::new(&settings, 0.0, first_side, None, false);
        let mut time_s = 0.0;
        let mut farthest_m = 0.0_f64;
        for _ in 0..2000 {
            time_s += 0.04;
            let e = search.commanded.elevation_m - tip_m;
            farthest_m = farthest_m.max(search.commanded.elevation_m.abs());
            let seen = e.abs() < half_width_m && search.commanded.yaw_rad.abs() < 1e-3;
            let level = Some(200.0 - 40.0 * (e / half_width_m).powi(2));
            let view = View { candidate: seen.then_some(TIP), level, ..empty(&search, time_s) };
            search.advance(&settings, &view);
            if matches!(search.phase, Phase::Crest { arrived_s: Some(_), .. } | Phase::NotFound) {
                break;
            }
        }
        (search, time_s, farthest_m)
    }

    #[test]
    fn a_tip_on_either_side_is_centred_within_a_tenth_of_a_millimetre() {
        // Every tenth of a millimetre out of sight: at the turning points of the sweep too.
        for tip_m in (-60..=60).map(|k| f64::from(k) * 1e-4).filter(|tip_m| tip_m.abs() >= 0.5e-3) {
            for side in [-1.0, 1.0] {
                let (search, _, _) = run(tip_m, 0.5e-3, side);
                let at = search.commanded.elevation_m;
                assert!((at - tip_m).abs() < 0.1e-3 + 1e-9, "tip {tip_m} found at {at}");
                assert!(!search.holds_confirmation());
            }
        }
    }

    /// Sweeps with what `look` sees (candidate, level) where the plane stands, until it waits at a crest; where that is.
    fn crest_m(mut look: impl FnMut(f64) -> (Option<Candidate>, f64)) -> f64 {
        let settings = settings();
        let mut search = Search::new(&settings, 0.0, 1.0, None, false);
        for k in 1..500 {
            let (candidate, level) = look(search.commanded.elevation_m);
            let view = View { candidate, level: Some(level), ..empty(&search, 0.04 * f64::from(k)) };
            search.advance(&settings, &view);
            if matches!(search.phase, Phase::Crest { arrived_s: Some(_), .. } | Phase::NotFound) {
                break;
            }
        }
        search.commanded.elevation_m
    }

    #[test]
    fn a_tip_that_is_refused_at_its_crest_is_centred_all_the_same() {
        for refused_within_m in [0.3e-3, 0.4e-3] {
            let (tip_m, half_width_m) = (2e-3, 0.5e-3);
            let at = crest_m(|at| {
                let e = at - tip_m;
                let candidate = e.abs() < half_width_m && e.abs() > refused_within_m;
                (candidate.then_some(TIP), 120.0 - 40.0 * (e / half_width_m).powi(2))
            });
            assert!((at - tip_m).abs() < 0.15e-3, "found at {at}");
        }
    }

    #[test]
    fn a_decoy_beside_the_tip_does_not_draw_the_crest_to_itself() {
        let (tip_m, half_width_m) = (2e-3, 0.5e-3);
        let other = Candidate { px: [320.0, 190.0], likeness: 0.9 };
        // Seen before the tip, instead of it, or beyond it, and brighter; unlike the tip it does not go with the template so well.
        for decoy_m in [[1.0e-3, 1.6e-3], [1.7e-3, 1.8e-3], [2.3e-3, 3.0e-3]] {
            let at = crest_m(|at| {
                let e = at - tip_m;
                if (decoy_m[0]..decoy_m[1]).contains(&at) {
                    (Some(other), 200.0)
                } else if e.abs() < half_width_m {
                    (Some(TIP), 180.0 - 40.0 * (e / half_width_m).powi(2))
                } else {
                    (None, 90.0)
                }
            });
            assert!((at - tip_m).abs() < 0.2e-3, "decoy {decoy_m:?}: found at {at}");
        }
    }

    #[test]
    fn a_tip_that_comes_into_sight_as_it_fades_is_centred_from_its_other_side() {
        // The contact was lost until the plane had passed it. On the way back there is nothing to be seen for a while, and it is missed
        // once: neither is a sign of its end.
        let (tip_m, half_width_m) = (1e-3, 0.7e-3);
        let (mut covered, mut last) = (true, f64::NEG_INFINITY);
        let at = crest_m(|at| {
            let e = at - tip_m;
            covered &= e < 0.45e-3;
            let missed = e < last && e > 0.3e-3;
            last = e;
            let seen = e.abs() < half_width_m && !covered && !missed;
            (seen.then_some(TIP), if seen { 180.0 - 40.0 * (e / half_width_m).powi(2) } else { 90.0 })
        });
        assert!((at - tip_m).abs() < 0.15e-3, "found at {at}");
    }

    #[test]
    fn what_is_not_there_is_not_found_within_travel_and_time() {
        let (search, time_s, farthest_m) = run(20e-3, 0.5e-3, 1.0);
        assert_eq!(search.phase, Phase::NotFound);
        assert!(time_s <= settings().max_search_s + 0.1, "{time_s}");
        assert!(farthest_m <= settings().sweep_reach_m + 1e-9);
    }

    #[test]
    fn the_remembered_side_is_swept_first() {
        let (_, right_s, _) = run(1.5e-3, 0.5e-3, 1.0);
        let (_, wrong_s, _) = run(1.5e-3, 0.5e-3, -1.0);
        assert!(right_s < wrong_s);
    }

    #[test]
    fn a_candidate_below_its_level_is_not_confirmed_where_it_stands_and_none_is_without_one() {
        let settings = settings();
        let cases = [(Some(120.0), 110.0, true), (Some(120.0), 125.0, false), (None, 255.0, true)];
        for (least_level, level, waits) in cases {
            let mut search = Search::new(&settings, 0.0, 1.0, least_level, false);
            for k in 1..=10 {
                let candidate = empty(&search, 0.04 * f64::from(k));
                let view = View { candidate: Some(TIP), level: Some(level), ..candidate };
                search.advance(&settings, &view);
                assert_eq!(search.holds_confirmation(), waits);
            }
            assert_eq!(search.phase == Phase::Sweep, waits);
        }
    }

    #[test]
    fn behind_an_arm_that_stands_the_search_waits_and_goes_on_where_it_was() {
        let settings = settings();
        let mut search = Search::new(&settings, 0.0, 1.0, None, false);
        let mut time_s = 0.0;
        let mut go = |search: &mut Search, arm_obeys: bool, images: u32| {
            for _ in 0..images {
                time_s += 0.04;
                let view = View { arm_obeys, ..empty(search, time_s) };
                search.advance(&settings, &view);
            }
        };
        go(&mut search, true, 20);
        let before = search.commanded;
        assert!(before.elevation_m != 0.0);
        go(&mut search, false, 1000);
        assert_eq!(search.commanded, before);
        go(&mut search, true, 20);
        assert!(search.commanded != before && search.phase != Phase::NotFound);
    }

    #[test]
    fn while_the_force_is_above_its_bound_the_plane_stands_and_the_time_counts() {
        let settings = settings();
        let mut search = Search::new(&settings, 0.0, 1.0, None, false);
        let mut farthest_m = 0.0_f64;
        for k in 1..=600 {
            let view = View { pressed_hard: true, ..empty(&search, 0.04 * f64::from(k)) };
            search.advance(&settings, &view);
            farthest_m = farthest_m.max(search.commanded.elevation_m.abs());
        }
        assert_eq!((search.phase, farthest_m), (Phase::NotFound, 0.0));
    }

    #[test]
    fn a_tip_that_went_with_the_contact_is_confirmed_where_it_was() {
        let settings = settings();
        // Lifted at once, or after the plane has been on its way.
        for (searched_images, waits) in [(0, false), (30, true)] {
            let mut search = Search::new(&settings, 0.0, 1.0, None, false);
            for k in 1..=60 {
                let in_contact = k <= searched_images || k > 50;
                let candidate = k > 50;
                let level = candidate.then_some(100.0);
                let candidate = candidate.then_some(TIP);
                let view = View { in_contact, candidate, level, ..empty(&search, 0.04 * f64::from(k)) };
                search.advance(&settings, &view);
            }
            assert_eq!(search.holds_confirmation(), waits);
        }
    }

    #[test]
    fn without_contact_the_plane_stands_still() {
        let settings = settings();
        let mut search = Search::new(&settings, 0.0, 1.0, None, false);
        for k in 1..200 {
            let view = View { in_contact: false, ..empty(&search, 0.04 * f64::from(k)) };
            search.advance(&settings, &view);
        }
        assert_eq!(search.commanded, Offset::default());
        assert_eq!(search.phase, Phase::Look);
    }
}
