use serde::{Deserialize, Serialize};
use sonoloop_types::{
    Acquisition, ArmStatus, Command, Estimate, Point, Pose, Reason, Setup, TrackState, Vector, View,
};

use crate::along::{self, Along, Lead};
use crate::hold::Hold;
use crate::search::{self, Offset, Search};
use crate::{feed, predict, slide};

/// A contact force below this share of the one at the start means that the probe is off the surface.
const CONTACT_SHARE: f64 = 0.2;
/// Below this the force at the start is noise (a liquid bears no probe), and contact cannot be judged by it.
const LEAST_CONTACT_N: f64 = 0.2;

/// Share of an image in the smoothed level of the tip.
const LEVEL_SHARE: f64 = 0.1;
/// Standard deviation of what a hand moves the needle in one image beyond what was foreseen; there is no depth then.
const HAND_WALK_M: f64 = 0.15e-3;

/// What the servo is doing.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub enum Mode {
    /// Following a tracked tip.
    Follow,
    /// Looking for a lost one.
    Search(Search),
    /// The tip stands at the target.
    Arrived,
}

/// What the servo tells the tracker before it looks at a picture.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Guidance {
    /// Predicted motion of the tip since the last picture, pixels.
    pub motion_px: Option<[f64; 2]>,
    /// The plane is on its way: a candidate must not be confirmed yet.
    pub hold_confirmation: bool,
    /// Direction of the needle in a lateral picture under the nominal calibration, unit length.
    pub axis_px: Option<[f64; 2]>,
}

/// The last picture's facts, for prediction.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
struct Last {
    base_from_probe: Pose,
    depth_m: Option<f64>,
    tip_px: [f64; 2],
}

/// What a transverse view measures once: where the tip was when the operator clicked on it.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
struct FirstFix {
    remaining_m: f64,
    depth_m: f64,
}

/// All that changes in a servo; small, cloneable, and part of the tracker's checkpoint.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ServoState {
    mode: Mode,
    /// Pose that the plane is held at, base frame, before dither and search; `None` before the first picture.
    held: Option<Pose>,
    /// Sum of all elevational corrections: the coordinate in which the samples of `hold` and `along` are kept.
    corrected_m: f64,
    hold: Hold,
    along: Along,
    lead: Lead,
    /// Speed along y of a tip whose depth is not measured (transverse).
    hand_m_s: f64,
    /// Way to the target and depth when the tip was first tracked (transverse).
    first_fix: Option<FirstFix>,
    last: Option<Last>,
    first_force_n: f64,
    first_side: f64,
    /// Level of a tracked tip, smoothed (transverse).
    tip_level: Option<f64>,
    /// Lateral: pace along y at which the needle leaves the plane while it is fed.
    drift_m_s: f64,
    /// Feed last asked for.
    last_feed_m_s: f64,
}

/// Turns estimates into commands.
#[derive(Debug, Clone)]
pub struct Servo {
    setup: Setup,
    state: ServoState,
}

impl Servo {
    /// A servo that has seen nothing yet.
    pub fn new(setup: Setup) -> Self {
        let state = ServoState {
            mode: Mode::Follow,
            held: None,
            corrected_m: 0.0,
            hold: Hold::default(),
            along: Along::default(),
            lead: Lead::new(&setup.servo),
            hand_m_s: 0.0,
            first_fix: None,
            last: None,
            first_force_n: 0.0,
            first_side: 1.0,
            tip_level: None,
            drift_m_s: 0.0,
            last_feed_m_s: 0.0,
        };
        Self { setup, state }
    }

    /// A servo that goes on from a checkpoint.
    pub fn restore(setup: Setup, state: ServoState) -> Self {
        Self { setup, state }
    }

    /// For the checkpoint.
    pub fn state(&self) -> &ServoState {
        &self.state
    }

    /// What it is doing.
    pub fn mode(&self) -> &Mode {
        &self.state.mode
    }

    /// What the tracker should know before it looks at the picture taken with `acquisition`.
    pub fn guidance(&self, acquisition: &Acquisition) -> Guidance {
        let motion_px = self.state.last.and_then(|last| {
            let fed_m = match (acquisition.depth_m, last.depth_m) {
                (Some(now_m), Some(before_m)) => now_m - before_m,
                _ => return None,
            };
            predict::motion_px(
                self.setup.view,
                &self.setup.geometry,
                &self.setup.needle_axis_in_base,
                last.tip_px,
                &last.base_from_probe,
                &acquisition.base_from_probe,
                fed_m,
            )
        });
        // Off the surface the picture shows the scanner's own ringing, which has tips enough.
        let hold_confirmation = matches!(&self.state.mode, Mode::Search(search) if search.holds_confirmation())
            || !self.in_contact(acquisition);
        let axis_px = match self.setup.view {
            View::Lateral => predict::axis_px(&self.setup.needle_axis_in_base, &acquisition.base_from_probe),
            View::Transverse => None,
        };
        Guidance { motion_px, hold_confirmation, axis_px }
    }

    /// The command that answers a picture.
    pub fn answer(&mut self, acquisition: &Acquisition, estimate: &Estimate) -> Command {
        let first = self.state.held.is_none();
        if first {
            self.state.first_force_n = acquisition.contact_force_n;
        }
        self.state.held.get_or_insert(acquisition.base_from_probe);
        let dt_s = self.setup.image_period_ticks as f64 / f64::from(self.setup.tick_rate_hz);
        let time_s = acquisition.acquisition_tick as f64 / f64::from(self.setup.tick_rate_hz);

        let advanced_m = self.carry(acquisition, dt_s);
        self.observe_along(acquisition, estimate);
        self.change_mode(acquisition, time_s, estimate);
        // Only now: a search that has just succeeded moves it.
        let held = self.state.held.unwrap_or(acquisition.base_from_probe);
        let lost_tip = self.lost_tip_in_probe();
        let in_contact = self.in_contact(acquisition);
        let stands = matches!(acquisition.arm_status, ArmStatus::Holding | ArmStatus::Collision);
        let shaft_below = self.least_tip_level(2.0);
        let settings = &self.setup.servo;
        let (target, feed_m_s) = match &mut self.state.mode {
            Mode::Arrived => (self.state.held, 0.0),
            Mode::Search(search) => {
                let measured = offset_from(&held, &acquisition.base_from_probe, &lost_tip);
                let candidate = estimate.state == TrackState::Recovering
                    && estimate.tip_px.is_some_and(|px| {
                        let off_m = (self.setup.geometry.probe_from_px(px) - lost_tip).norm();
                        off_m < settings.candidate_reach_m
                    })
                    // Behind the tip every plane cuts the shaft: what is dimmer is no candidate there.
                    && shaft_below
                        .is_none_or(|least| estimate.tip_level.is_some_and(|level| level >= least));
                search.advance(
                    settings,
                    &search::View {
                        time_s,
                        dt_s,
                        measured,
                        candidate,
                        level: estimate.tip_level,
                        in_contact,
                        arm_obeys: !stands,
                        pressed_hard: acquisition.contact_force_n > settings.max_search_force_n,
                    },
                );
                (Some(displaced(&held, search.commanded, &lost_tip)), 0.0)
            }
            // Behind an arm that does not obey the needle waits, and nothing adds up meanwhile.
            Mode::Follow if stands => (Some(held), 0.0),
            Mode::Follow if estimate.state == TrackState::Tracking => {
                self.follow(acquisition, estimate, held, advanced_m, time_s, dt_s)
            }
            Mode::Follow => (Some(held), 0.0),
        };
        if let Some(mut tip_px) = estimate.tip_px {
            // A candidate is not the tip yet: until it is confirmed the last believed place counts.
            if estimate.state == TrackState::Recovering
                && let Some(last) = self.state.last
            {
                tip_px = last.tip_px;
            }
            self.state.last = Some(Last {
                base_from_probe: acquisition.base_from_probe,
                depth_m: acquisition.depth_m,
                tip_px,
            });
        }
        self.state.last_feed_m_s = feed_m_s;
        Command {
            answers: acquisition.sequence,
            estimate: *estimate,
            target_base_from_probe: target,
            feed_m_s,
            compute_us: 0.0,
        }
    }

    /// Whether the probe is on the surface, as far as its force can tell.
    fn in_contact(&self, acquisition: &Acquisition) -> bool {
        self.state.first_force_n < LEAST_CONTACT_N
            || acquisition.contact_force_n > CONTACT_SHARE * self.state.first_force_n
    }

    /// The last believed tip, probe frame.
    fn lost_tip_in_probe(&self) -> Point {
        // Before there is any, nothing moves that could depend on it.
        let px = self.state.last.map(|last| last.tip_px).or(self.setup.click_px);
        self.setup.geometry.probe_from_px(px.unwrap_or_default())
    }

    /// Transverse: level of a tip so many crests below the tracked one; one crest off the plane is centred well enough, and two
    /// off it is still no shaft, which is far dimmer.
    fn least_tip_level(&self, crests: f64) -> Option<f64> {
        self.state.tip_level.map(|level| level - crests * self.setup.servo.crest_levels)
    }

    /// Transverse: carries the held plane along with the tip, whatever else is going on. Returns by how much, metres along y.
    fn carry(&mut self, acquisition: &Acquisition, dt_s: f64) -> f64 {
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

    fn change_mode(&mut self, acquisition: &Acquisition, time_s: f64, estimate: &Estimate) {
        let gone = matches!(estimate.state, TrackState::Lost | TrackState::Recovering);
        match &self.state.mode {
            Mode::Follow if gone => {
                let after_restart = estimate.reason == Reason::Restarted;
                if let (View::Transverse, Some(held)) = (self.setup.view, self.state.held) {
                    let tip = self.lost_tip_in_probe();
                    let off_m = offset_from(&held, &acquisition.base_from_probe, &tip).elevation_m;
                    let ahead = self.state.along.beyond(self.state.corrected_m + off_m) >= 0.5;
                    self.state.first_side = if ahead { 1.0 } else { -1.0 };
                }
                let first_side = self.state.first_side;
                let least_level = match self.setup.view {
                    // A tip that is seen where it was lost may lie at the slice's edge: its crest is looked for first.
                    View::Lateral => None,
                    View::Transverse => Some(self.least_tip_level(1.0).unwrap_or(f64::NEG_INFINITY)),
                };
                self.state.mode = Mode::Search(Search::new(
                    &self.setup.servo,
                    time_s,
                    first_side,
                    least_level,
                    after_restart,
                ));
                self.state.hold.reset();
                (self.state.drift_m_s, self.state.hand_m_s) = (0.0, 0.0);
            }
            Mode::Search(search) if estimate.state == TrackState::Tracking => {
                let tip = self.lost_tip_in_probe();
                self.state.held = self.state.held.map(|held| displaced(&held, search.commanded, &tip));
                if search.commanded.elevation_m != 0.0 {
                    self.state.first_side = search.commanded.elevation_m.signum();
                }
                self.state.corrected_m += search.commanded.elevation_m;
                self.state.along.found(self.state.corrected_m);
                self.state.mode = Mode::Follow;
            }
            _ => {}
        }
    }

    /// Follow law for a tracked tip: moves the held pose, adds dither, sets the feed.
    fn follow(
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
        let age_s = acquisition.publication_tick.saturating_sub(acquisition.acquisition_tick) as f64
            / f64::from(self.setup.tick_rate_hz);
        let since_m = acquisition.feed_m_s.unwrap_or(0.0) * age_s;
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
            let window_s = 2.0 * settings.dither_period_s;
            self.state.hold.push(time_s, self.state.corrected_m + measured_m, level, window_s);
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
    fn observe_along(&mut self, acquisition: &Acquisition, estimate: &Estimate) {
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
    fn slice_sigma_m(&self, depth_m: f64) -> f64 {
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

/// The held pose displaced by a search: elevation along y, yaw about the line along z through the tip.
fn displaced(held: &Pose, offset: Offset, tip_in_probe: &Point) -> Pose {
    let about_tip = Pose::translation(tip_in_probe.x, 0.0, 0.0)
        * Pose::rotation(Vector::z() * offset.yaw_rad)
        * Pose::translation(-tip_in_probe.x, 0.0, 0.0);
    held * Pose::translation(0.0, offset.elevation_m, 0.0) * about_tip
}

/// Inverse of [`displaced`] for a measured pose: its elevation at the tip (a tilted plane counts at the tip's depth)
/// and its yaw, relative to the held pose.
fn offset_from(held: &Pose, measured: &Pose, tip_in_probe: &Point) -> Offset {
    let held_from_measured = held.inverse() * measured;
    let tip = held_from_measured * tip_in_probe;
    let x_axis = held_from_measured * Vector::x();
    Offset { elevation_m: tip.y, yaw_rad: libm::atan2(x_axis.y, x_axis.x) }
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use sonoloop_types::{ImageGeometry, Limits, Profile, ServoSettings, TrackerSettings};

    pub(crate) fn settings() -> ServoSettings {
        ServoSettings {
            elevation_gain_per_s: 1.0,
            dither_period_s: 0.8,
            max_search_s: 20.0,
            ..ServoSettings::default()
        }
    }

    fn setup(view: View) -> Setup {
        Setup {
            protocol: 1,
            run_id: 1,
            tick_rate_hz: 1000,
            image_period_ticks: 40,
            view,
            geometry: ImageGeometry::default(),
            slice_thickness_m: vec![[0.01, 0.8e-3], [0.03, 1.4e-3]],
            flange_from_probe: Pose::identity(),
            entry_in_base: Point::new(-0.03, 0.0, 0.0),
            needle_axis_in_base: Vector::new(0.6, 0.0, 0.8),
            target_in_base: Point::new(0.0, 0.0, 0.04),
            click_px: Some([320.0, 200.0]),
            limits: Limits {
                max_feed_m_s: 12e-3,
                max_probe_speed_m_s: 30e-3,
                max_probe_travel_m: 80e-3,
                max_probe_turn_rad: 0.5,
                max_contact_force_n: 8.0,
            },
            tracker: TrackerSettings::profile(Profile::Robust, 20),
            servo: settings(),
        }
    }

    fn acquisition(sequence: u64) -> Acquisition {
        Acquisition {
            sequence,
            acquisition_tick: sequence * 40,
            publication_tick: sequence * 40,
            pose_tick: sequence * 40,
            base_from_probe: Pose::identity(),
            depth_m: Some(0.02),
            feed_m_s: Some(0.01),
            contact_force_n: 2.0,
            arm_status: ArmStatus::Ready,
            last_command: None,
        }
    }

    fn estimate(state: TrackState) -> Estimate {
        Estimate::bare(state, Reason::Ok, Some([319.5, 200.0]))
    }

    #[test]
    fn a_tracked_tip_is_fed_and_a_lost_one_is_not() {
        let mut servo = Servo::new(setup(View::Lateral));
        assert_eq!(servo.answer(&acquisition(0), &estimate(TrackState::Tracking)).feed_m_s, 10e-3);
        for state in [TrackState::Lost, TrackState::Recovering, TrackState::Lost] {
            assert_eq!(servo.answer(&acquisition(1), &estimate(state)).feed_m_s, 0.0);
        }
        assert!(matches!(servo.mode(), Mode::Search(_)));
        assert_eq!(servo.answer(&acquisition(2), &estimate(TrackState::Tracking)).feed_m_s, 10e-3);
        assert_eq!(*servo.mode(), Mode::Follow);
    }

    #[test]
    fn behind_an_arm_that_does_not_obey_the_needle_waits_and_nothing_adds_up() {
        let mut servo = Servo::new(setup(View::Lateral));
        // Outside the dead band: an arm that obeys would be sent after it, farther with every image.
        let aside = Estimate { tip_px: Some([460.0, 200.0]), ..estimate(TrackState::Tracking) };
        for (k, arm_status) in (0..).zip([ArmStatus::Holding, ArmStatus::Collision, ArmStatus::Holding]) {
            let command = servo.answer(&Acquisition { arm_status, ..acquisition(k) }, &aside);
            assert_eq!((command.feed_m_s, command.target_base_from_probe), (0.0, Some(Pose::identity())));
        }
        let command = servo.answer(&acquisition(3), &aside);
        assert_eq!(command.feed_m_s, 10e-3);
        assert!(command.target_base_from_probe.unwrap().translation.x < 1e-3);
    }

    #[test]
    fn before_the_first_fix_nothing_moves() {
        let mut servo = Servo::new(setup(View::Lateral));
        let command =
            servo.answer(&acquisition(0), &Estimate::bare(TrackState::Searching, Reason::NoCandidate, None));
        assert_eq!(command.feed_m_s, 0.0);
        assert_eq!(command.target_base_from_probe, Some(Pose::identity()));
    }

    #[test]
    fn at_the_target_the_needle_rests_for_good() {
        let mut servo = Servo::new(setup(View::Lateral));
        let mut at_target = estimate(TrackState::Tracking);
        at_target.tip_px = Some([319.5, 400.0]);
        assert_eq!(servo.answer(&acquisition(0), &at_target).feed_m_s, 0.0);
        assert_eq!(servo.answer(&acquisition(1), &estimate(TrackState::Tracking)).feed_m_s, 0.0);
        assert_eq!(*servo.mode(), Mode::Arrived);
    }

    #[test]
    fn truth_displacement_and_offset_are_inverse() {
        let held = Pose::new(Vector::new(0.1, -0.2, 0.3), Vector::new(0.2, 2.9, -0.1));
        let offset = Offset { elevation_m: 3e-3, yaw_rad: -0.1 };
        let tip = Point::new(4e-3, 0.0, 25e-3);
        let back = offset_from(&held, &displaced(&held, offset, &tip), &tip);
        assert!((back.elevation_m - 3e-3).abs() < 1e-12 && (back.yaw_rad + 0.1).abs() < 1e-12);
    }

    #[test]
    fn yaw_leaves_the_tip_where_it_is() {
        let held = Pose::identity();
        let turned =
            displaced(&held, Offset { elevation_m: 0.0, yaw_rad: 0.2 }, &Point::new(5e-3, 0.0, 0.02));
        let tip = turned * Point::new(5e-3, 0.0, 0.02);
        assert!((tip - Point::new(5e-3, 0.0, 0.02)).norm() < 1e-15);
    }

    #[test]
    fn after_a_recovery_the_plane_stays_where_the_tip_was_found() {
        let mut setup = setup(View::Lateral);
        setup.servo.dither_m = 0.0;
        let mut servo = Servo::new(setup);
        servo.answer(&acquisition(0), &estimate(TrackState::Tracking));
        let mut at = Pose::identity();
        for k in 1..20 {
            let seen = Acquisition { base_from_probe: at, ..acquisition(k) };
            at = servo.answer(&seen, &estimate(TrackState::Lost)).target_base_from_probe.unwrap();
        }
        assert!(at.translation.y > 1e-3, "the sweep is on its way");
        let found = Acquisition { base_from_probe: at, ..acquisition(20) };
        for _ in 0..3 {
            let command = servo.answer(&found, &estimate(TrackState::Tracking));
            let stays = command.target_base_from_probe.unwrap();
            assert!((stays.translation.vector - at.translation.vector).norm() < 1e-9);
        }
    }

    #[test]
    fn a_restored_servo_answers_like_the_one_it_was_taken_from() {
        let mut one = Servo::new(setup(View::Lateral));
        for k in 0..20 {
            one.answer(&acquisition(k), &estimate(TrackState::Tracking));
        }
        one.answer(&acquisition(20), &estimate(TrackState::Lost));
        let mut two = Servo::restore(setup(View::Lateral), one.state().clone());
        for k in 21..60 {
            let lost = estimate(TrackState::Lost);
            assert_eq!(one.answer(&acquisition(k), &lost), two.answer(&acquisition(k), &lost));
        }
    }
}
