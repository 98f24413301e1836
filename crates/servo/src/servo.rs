mod follow;

use serde::{Deserialize, Serialize};
use sonoloop_types::{
    Acquisition, ArmStatus, Command, Confirmation, Disc, Estimate, Point, Pose, Reason, Setup, TrackState,
    Vector, View,
};

use crate::along::{Along, Lead};
use crate::feed;
use crate::hold::Hold;
use crate::predict;
use crate::search::{self, Candidate, Jog, Offset, Phase, Search, Seen};

/// A contact force below this share of the one at the start means that the probe is off the surface.
const CONTACT_SHARE: f64 = 0.2;
/// Below this the force at the start is noise (a liquid bears no probe), and contact cannot be judged by it.
const LEAST_CONTACT_N: f64 = 0.2;

/// How far a hand may push on after it was told to stop. [assumed] A quick one, 14 mm/s, and a slow reaction, 0.6 s, make 8.4 mm.
const HAND_GOES_ON_M: f64 = 10e-3;

/// What the servo is doing.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub enum Mode {
    /// Following a tracked tip.
    Follow,
    /// Looking for a lost one.
    Search(Box<Search>),
    /// The tip stands at the target.
    Arrived,
}

/// What the servo tells the tracker before it looks at a picture.
#[derive(Debug, Clone, PartialEq)]
pub struct Guidance {
    /// Predicted motion of the tip since the last picture, pixels.
    pub motion_px: Option<[f64; 2]>,
    /// Whether a candidate may be confirmed: not while the plane is on its way, nor before it has gone with the needle.
    pub confirmation: Confirmation,
    /// Direction of the needle in a lateral picture under the nominal calibration, unit length.
    pub axis_px: Option<[f64; 2]>,
    /// How far the tip may have gone on along it unmeasured while it was lost, pixels.
    pub unmeasured_px: f64,
    /// How far from where it is expected, or from that way, it is sought, pixels.
    pub reach_px: f64,
    /// Where it is not: candidates lay there that did not go with the needle.
    pub refused: Vec<Disc>,
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
        let motion_px = self.motion_px(acquisition);
        // Off the surface the picture shows the scanner's own ringing, which has tips enough.
        let confirmation = match &self.state.mode {
            _ if !self.in_contact(acquisition) => Confirmation::Held,
            Mode::Search(search) if search.holds_confirmation() => Confirmation::Held,
            Mode::Search(search) if Jog::applies(&self.setup) && !search.jog.goes() => Confirmation::Counts,
            _ => Confirmation::Confirms,
        };
        let axis_px = match self.setup.view {
            View::Lateral => predict::axis_px(&self.setup.needle_axis_in_base, &acquisition.base_from_probe),
            View::Transverse => None,
        };
        let refused = match &self.state.mode {
            Mode::Search(search) => search.jog.refused(&self.setup, acquisition),
            _ => Vec::new(),
        };
        let [unmeasured_px, reach_px] = [self.unmeasured_m(acquisition), self.setup.servo.candidate_reach_m]
            .map(|way_m| way_m / self.setup.geometry.spacing_m);
        Guidance { motion_px, confirmation, axis_px, unmeasured_px, reach_px, refused }
    }

    /// How the tip should have moved since the last picture, by what was measured.
    fn motion_px(&self, acquisition: &Acquisition) -> Option<[f64; 2]> {
        self.state.last.and_then(|last| {
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
        })
    }

    /// Where the last believed tip is now, as far as that is known.
    fn carried_px(&self, acquisition: &Acquisition) -> Option<[f64; 2]> {
        let lateral = self.setup.view == View::Lateral;
        let motion_px = self.motion_px(acquisition).filter(|_| lateral).unwrap_or_default();
        self.state.last.map(|last| [last.tip_px[0] + motion_px[0], last.tip_px[1] + motion_px[1]])
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
        let remaining_m = self.believed_remaining_m(acquisition, &lost_tip);
        let in_contact = self.in_contact(acquisition);
        let stands = matches!(acquisition.arm_status, ArmStatus::Holding | ArmStatus::Collision);
        let shaft_below = self.least_tip_level(2.0);
        let carried_px = self.carried_px(acquisition);
        let unmeasured_m = self.unmeasured_m(acquisition);
        let settings = &self.setup.servo;
        let (target, feed_m_s) = match &mut self.state.mode {
            Mode::Arrived => (self.state.held, 0.0),
            Mode::Search(search) => {
                let measured = offset_from(&held, &acquisition.base_from_probe, &lost_tip);
                let recovering = estimate.tip_px.filter(|_| estimate.state == TrackState::Recovering);
                // Behind the tip every plane cuts the shaft: what is dimmer is no candidate there.
                let candidate_px = recovering.filter(|_| {
                    shaft_below.is_none_or(|least| estimate.tip_level.is_some_and(|level| level >= least))
                });
                search.advance(
                    settings,
                    &search::View {
                        time_s,
                        dt_s,
                        measured,
                        candidate: candidate_px
                            .map(|px| Candidate { px, likeness: estimate.ncc_anchor.unwrap_or(-1.0) }),
                        level: estimate.tip_level,
                        in_contact,
                        arm_obeys: !stands,
                        pressed_hard: acquisition.contact_force_n > settings.max_search_force_n,
                    },
                );
                let mut feed_m_s = 0.0;
                if Jog::applies(&self.setup) {
                    let ready = !search.holds_confirmation() && in_contact && !stands;
                    // A search has lost a tip.
                    let expected_px = carried_px.unwrap_or_default();
                    let arriving = matches!(search.phase, Phase::Crest { arrived_s: None, .. });
                    let setup = &self.setup;
                    let seen =
                        Seen { setup, acquisition, time_s, arriving, expected_px, remaining_m, unmeasured_m };
                    let given_up;
                    (feed_m_s, given_up) = search.jog.advance(&seen, candidate_px.filter(|_| ready));
                    if given_up {
                        search.refuse();
                    }
                }
                (Some(displaced(&held, search.commanded, &lost_tip)), feed_m_s)
            }
            // Behind an arm that does not obey the needle waits, and nothing adds up meanwhile.
            Mode::Follow if stands => (Some(held), 0.0),
            Mode::Follow if estimate.state == TrackState::Tracking => {
                self.follow(acquisition, estimate, held, advanced_m, time_s, dt_s)
            }
            Mode::Follow => (Some(held), 0.0),
        };
        if let Some(mut tip_px) = estimate.tip_px {
            // A candidate is not the tip yet: until it is confirmed the last believed place counts, carried along by what probe and
            // needle have been measured to do.
            if estimate.state == TrackState::Recovering {
                tip_px = carried_px.unwrap_or(tip_px);
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

    /// How far a lost tip may have gone on along the needle beyond what was measured, in a lateral view.
    fn unmeasured_m(&self, acquisition: &Acquisition) -> f64 {
        let by_hand = self.setup.view == View::Lateral && acquisition.depth_m.is_none();
        match &self.state.mode {
            Mode::Search(search) if by_hand => HAND_GOES_ON_M + search.jog.asked_m(),
            _ if by_hand => HAND_GOES_ON_M,
            _ => 0.0,
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

    /// Way to the target from the last believed tip, by the depth measured since; none before there is one.
    fn believed_remaining_m(&self, acquisition: &Acquisition, lost_tip: &Point) -> f64 {
        let Some(last) = self.state.last else { return 0.0 };
        let since_m = match (acquisition.depth_m, last.depth_m) {
            (Some(now_m), Some(before_m)) => now_m - before_m,
            _ => 0.0,
        };
        feed::remaining_m(&self.setup, &(last.base_from_probe * lost_tip)) - since_m
    }

    /// Transverse: level of a tip so many crests below the tracked one; one crest off the plane is centred well enough, and two
    /// off it is still no shaft, which is far dimmer.
    fn least_tip_level(&self, crests: f64) -> Option<f64> {
        self.state.tip_level.map(|level| level - crests * self.setup.servo.crest_levels)
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
                let settings = &self.setup.servo;
                let search = Search::new(settings, time_s, first_side, least_level, after_restart);
                self.state.mode = Mode::Search(Box::new(search));
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
pub(crate) mod tests;
