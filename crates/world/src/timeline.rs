//! The disturbances of a scenario as functions of the tick.

use nalgebra::UnitQuaternion;
use sonoloop_scenario::{DelaySpec, Disturbance, DisturbanceKind, PhantomMotion};
use sonoloop_types::{Event, EventKind, Pose, Vector};

use crate::phantom_motion::{Motions, smooth};

/// What the disturbances have changed by now.
#[derive(Debug, Clone)]
pub(crate) struct Timeline {
    /// Tick of the last step.
    tick: u64,
    next: usize,
    /// Asked for from outside, to begin with the next tick.
    unscripted: Vec<DisturbanceKind>,
    /// Receiver gain on top of the probe's own.
    pub gain_db: f64,
    /// Needle echo on top of the needle's own.
    pub needle_gain_db: f64,
    /// Ticks from a picture to its publication.
    pub image_delay_ticks: u64,
    /// Ticks from an answer to its effect.
    pub command_delay_ticks: u64,
    /// Electronic noise on top of the probe's own.
    pub noise_gain_db: f64,
    slips: Vec<Slip>,
    /// Height and last tick of being lifted.
    lift: Option<(f64, u64)>,
    /// First tick at which the tracker is back.
    tracker_back: Option<u64>,
    phantom: Motions,
    covers: Vec<Cover>,
    /// Share of the pictures that are dropped.
    dropped_share: f64,
    // First ticks at which these are over.
    dropped_until: u64,
    frozen_until: u64,
    stalled_until: u64,
    hung_until: u64,
    garbage_until: u64,
}

/// A part of the array that is not as it should be, in its own coordinate.
#[derive(Debug, Clone, Copy)]
struct Cover {
    from_m: f64,
    to_m: f64,
    gap_m: f64,
    loss_db: f64,
    end_tick: u64,
}

#[derive(Debug, Clone, Copy)]
struct Slip {
    start_tick: u64,
    duration_ticks: u64,
    probe_from_slipped: Pose,
}

impl Timeline {
    pub(crate) fn new(delays: &DelaySpec) -> Self {
        Self {
            tick: 0,
            next: 0,
            unscripted: Vec::new(),
            gain_db: 0.0,
            needle_gain_db: 0.0,
            image_delay_ticks: delays.image_ticks,
            command_delay_ticks: delays.command_ticks,
            noise_gain_db: 0.0,
            slips: Vec::new(),
            lift: None,
            tracker_back: None,
            covers: Vec::new(),
            dropped_share: 0.0,
            dropped_until: 0,
            frozen_until: 0,
            stalled_until: 0,
            hung_until: 0,
            garbage_until: 0,
            phantom: Motions::default(),
        }
    }

    /// Begins and ends what is due at `tick`; `disturbances` ascend by tick.
    pub(crate) fn step(&mut self, disturbances: &[Disturbance], tick: u64, events: &mut Vec<Event>) {
        self.tick = tick;
        self.covers.retain(|cover| tick < cover.end_tick);
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
            DisturbanceKind::CommandDelay { command_ticks } => {
                self.command_delay_ticks = command_ticks.max(1);
                format!("command delay steps to {command_ticks} ms")
            }
            DisturbanceKind::GelLost { from_m, to_m, gap_m, duration_ticks } => {
                let end_tick = tick + duration_ticks.max(1);
                self.covers.push(Cover { from_m, to_m, gap_m, loss_db: 0.0, end_tick });
                format!(
                    "gel is lost from {:.1} to {:.1} mm of the array for {duration_ticks} ms",
                    from_m * 1e3,
                    to_m * 1e3
                )
            }
            DisturbanceKind::Noise { gain_db } => {
                self.noise_gain_db = gain_db;
                format!("electronic noise steps to {gain_db:+.1} dB")
            }
            DisturbanceKind::Shadow { x_m, width_m, loss_db, duration_ticks } => {
                let (from_m, to_m) = (x_m - width_m / 2.0, x_m + width_m / 2.0);
                let end_tick = tick + duration_ticks.max(1);
                self.covers.push(Cover { from_m, to_m, gap_m: 0.0, loss_db, end_tick });
                format!(
                    "something takes {loss_db:.1} dB from {:.1} to {:.1} mm of the array for {duration_ticks} ms",
                    from_m * 1e3,
                    to_m * 1e3
                )
            }
            DisturbanceKind::FrozenImages { duration_ticks } => {
                self.frozen_until = tick + duration_ticks.max(1);
                format!("images freeze for {duration_ticks} ms")
            }
            DisturbanceKind::DroppedImages { share, duration_ticks } => {
                self.dropped_share = share;
                self.dropped_until = tick + duration_ticks.max(1);
                format!("{:.0} % of the images are lost for {duration_ticks} ms", share * 100.0)
            }
            DisturbanceKind::ArmStall { duration_ticks } => {
                self.stalled_until = tick + duration_ticks.max(1);
                format!("the arm stalls for {duration_ticks} ms")
            }
            DisturbanceKind::TrackerHung { duration_ticks } => {
                self.hung_until = tick + duration_ticks.max(1);
                format!("the tracker hangs for {duration_ticks} ms")
            }
            DisturbanceKind::TrackerGarbage { duration_ticks } => {
                self.garbage_until = tick + duration_ticks.max(1);
                format!("the tracker sends garbage for {duration_ticks} ms")
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

    /// True while the tracker gets images and does not answer.
    pub(crate) fn tracker_hung(&self) -> bool {
        self.tick < self.hung_until
    }

    /// True while what the tracker sends is garbage.
    pub(crate) fn tracker_garbage(&self) -> bool {
        self.tick < self.garbage_until
    }

    /// True while the scanner hands out its last picture again.
    pub(crate) fn images_frozen(&self) -> bool {
        self.tick < self.frozen_until
    }

    /// Share of the pictures taken now that are lost.
    pub(crate) fn dropped_share(&self) -> f64 {
        if self.tick < self.dropped_until { self.dropped_share } else { 0.0 }
    }

    /// True while the arm stands and obeys nothing.
    pub(crate) fn arm_stalled(&self) -> bool {
        self.tick < self.stalled_until
    }

    /// True while some part of the array is shadowed.
    pub(crate) fn any_shadow(&self) -> bool {
        self.covers.iter().any(|cover| cover.loss_db > 0.0)
    }

    /// Air where gel is lost, at a place along the array.
    pub(crate) fn gap_m(&self, x_m: f64) -> f64 {
        self.covering(x_m).fold(0.0, |gap_m, cover| cover.gap_m.max(gap_m))
    }

    /// What shadows take there and back at a place along the array.
    pub(crate) fn loss_db(&self, x_m: f64) -> f64 {
        self.covering(x_m).fold(0.0, |loss_db, cover| loss_db + cover.loss_db)
    }

    /// Amplitude that lost gel and shadows let through one way at a place along the array, 0…1.
    pub(crate) fn through(&self, x_m: f64) -> f64 {
        // Half of the loss each way.
        if self.gap_m(x_m) > 0.0 { 0.0 } else { libm::pow(10.0, -self.loss_db(x_m) / 40.0) }
    }

    fn covering(&self, x_m: f64) -> impl Iterator<Item = &Cover> {
        self.covers.iter().filter(move |cover| (cover.from_m..=cover.to_m).contains(&x_m))
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
