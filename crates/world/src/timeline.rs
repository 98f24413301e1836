//! The disturbances of a scenario as functions of the tick.

use nalgebra::UnitQuaternion;
use sonoloop_scenario::{Disturbance, DisturbanceKind, PhantomMotion};
use sonoloop_types::{Event, EventKind, Pose, Vector};

use crate::phantom_motion::{Motions, smooth};

/// What the disturbances have changed by now.
#[derive(Debug, Clone)]
pub(crate) struct Timeline {
    next: usize,
    /// Asked for from outside, to begin with the next tick.
    unscripted: Vec<DisturbanceKind>,
    /// Receiver gain on top of the probe's own.
    pub gain_db: f64,
    /// Needle echo on top of the needle's own.
    pub needle_gain_db: f64,
    /// Ticks from a picture to its publication.
    pub image_delay_ticks: u64,
    slips: Vec<Slip>,
    /// Height and last tick of being lifted.
    lift: Option<(f64, u64)>,
    /// First tick at which the tracker is back.
    tracker_back: Option<u64>,
    phantom: Motions,
}

#[derive(Debug, Clone, Copy)]
struct Slip {
    start_tick: u64,
    duration_ticks: u64,
    probe_from_slipped: Pose,
}

impl Timeline {
    pub(crate) fn new(image_delay_ticks: u64) -> Self {
        Self {
            next: 0,
            unscripted: Vec::new(),
            gain_db: 0.0,
            needle_gain_db: 0.0,
            image_delay_ticks,
            slips: Vec::new(),
            lift: None,
            tracker_back: None,
            phantom: Motions::default(),
        }
    }

    /// Begins and ends what is due at `tick`; `disturbances` ascend by tick.
    pub(crate) fn step(&mut self, disturbances: &[Disturbance], tick: u64, events: &mut Vec<Event>) {
        if self.tracker_back.is_some_and(|back| back <= tick) {
            self.tracker_back = None;
            let detail = "the scenario starts the tracker again".into();
            events.push(Event { tick, kind: EventKind::TrackerRestarted, detail });
        }
        if self.lift.is_some_and(|(_, last)| last <= tick) {
            self.lift = None;
        }
        while let Some(disturbance) = disturbances.get(self.next).filter(|d| d.tick <= tick) {
            self.next += 1;
            events.push(self.begin(&disturbance.kind, tick));
        }
        for kind in std::mem::take(&mut self.unscripted) {
            events.push(self.begin(&kind, tick));
        }
    }

    /// Lets something begin with the next tick, after what the scenario has for it.
    pub(crate) fn add(&mut self, kind: DisturbanceKind) {
        self.unscripted.push(kind);
    }

    fn begin(&mut self, kind: &DisturbanceKind, tick: u64) -> Event {
        let mut event_kind = EventKind::Disturbance;
        let detail = match *kind {
            DisturbanceKind::ProbeKnock { probe_from_slipped, duration_ticks } => {
                let duration_ticks = duration_ticks.max(1);
                self.slips.push(Slip { start_tick: tick, duration_ticks, probe_from_slipped });
                let [x, y, z]: [f64; 3] = probe_from_slipped.translation.vector.into();
                let turn_deg = probe_from_slipped.rotation.angle().to_degrees();
                format!(
                    "probe slips by ({:.2}, {:.2}, {:.2}) mm and {turn_deg:.2}°",
                    x * 1e3,
                    y * 1e3,
                    z * 1e3
                )
            }
            DisturbanceKind::LiftOff { height_m, duration_ticks } => {
                self.lift = Some((height_m, tick + duration_ticks.max(1)));
                format!("probe is lifted by {:.1} mm for {duration_ticks} ms", height_m * 1e3)
            }
            DisturbanceKind::GainChange { gain_db } => {
                self.gain_db = gain_db;
                format!("receiver gain steps to {gain_db:+.1} dB")
            }
            DisturbanceKind::NeedleBrightness { gain_db } => {
                self.needle_gain_db = gain_db;
                format!("needle echo steps to {gain_db:+.1} dB")
            }
            DisturbanceKind::TrackerKilled { down_ticks } => {
                self.tracker_back = Some(tick + down_ticks.max(1));
                event_kind = EventKind::TrackerKilled;
                format!("the scenario kills the tracker for {down_ticks} ms")
            }
            DisturbanceKind::ImageDelay { image_ticks } => {
                self.image_delay_ticks = image_ticks;
                format!("image delay steps to {image_ticks} ms")
            }
            DisturbanceKind::PhantomMoves(motion) => {
                self.phantom.add(tick, motion);
                let ([x, y, z], what): ([f64; 3], _) = match motion {
                    PhantomMotion::Breathing { reach_m, .. } => ((reach_m * 1e3).into(), "mm to and fro"),
                    PhantomMotion::Drift { velocity_m_s, .. } => ((velocity_m_s * 1e3).into(), "mm/s"),
                    PhantomMotion::Step { shift_m, .. } => ((shift_m * 1e3).into(), "mm"),
                };
                format!("phantom moves by ({x:.2}, {y:.2}, {z:.2}) {what}")
            }
        };
        Event { tick, kind: event_kind, detail }
    }

    /// True from the kill until the tick of the restart.
    pub(crate) fn tracker_down(&self) -> bool {
        self.tracker_back.is_some()
    }

    /// Height to which the probe is being lifted.
    pub(crate) fn lift_m(&self) -> Option<f64> {
        self.lift.map(|(height_m, _)| height_m)
    }

    /// Where the phantom is, minus where it began, world frame.
    pub(crate) fn phantom_shift_m(&self, tick: u64) -> Vector {
        self.phantom.shift_m(tick)
    }

    /// All slips so far, in the order in which they began: probe as mounted from probe as it is.
    pub(crate) fn mounted_from_slipped(&self, tick: u64) -> Pose {
        self.slips.iter().fold(Pose::identity(), |pose, slip| pose * slip.at(tick))
    }

    /// True while a slip is under way, or was one tick ago.
    pub(crate) fn slipping(&self, tick: u64) -> bool {
        self.slips.iter().any(|slip| tick <= slip.start_tick + slip.duration_ticks)
    }
}

impl Slip {
    /// Part of the slip that is done: smooth, nothing at its first tick, all of it after its duration.
    fn at(&self, tick: u64) -> Pose {
        let share = smooth(tick.saturating_sub(self.start_tick), self.duration_ticks);
        if share == 1.0 {
            return self.probe_from_slipped;
        }
        Pose::from_parts(
            (self.probe_from_slipped.translation.vector * share).into(),
            UnitQuaternion::from_scaled_axis(self.probe_from_slipped.rotation.scaled_axis() * share),
        )
    }
}
