//! The world that advances tick by tick.

use std::sync::Arc;

use sonoloop_scenario::{DisturbanceKind, Scenario};
use sonoloop_types::{
    Acquisition, ArmStatus, Command, CommandReceipt, Drag, Event, EventKind, Indentation, Point, Pose,
    Refusal, Setup, Slice, Tissue, Truth, Vector,
};

use crate::WorldError;
use crate::arm::{Arm, CONTROL_TICKS};
use crate::contact::{Touch, element_x_m};
use crate::hand::Attention;
use crate::hidden::{GarbageWords, force_noise_n, garbage_words, uniform_for_drop};
use crate::inbox::{Bounds, Inbox};
use crate::model::Model;
use crate::needle_feed::Feed;
use crate::needle_force::Passage;
use crate::press::{Press, PressInput};
use crate::scene::{MARGIN_M, Scene};
use crate::timeline::Timeline;
use crate::truth;

/// A body counts as coming nearer when its distance falls by more than this below where the arm last stopped for it.
/// An arm that sets out from rest sways: the planner takes a run-up of 0.1 mm (seen with the UR5e) to pass a near set
/// point at speed.
const APPROACH_M: f64 = 3e-4;

/// Phantom, needle, arm and all that happens to them.
///
/// [`World::step`] advances simulated time by one tick; [`World::slice`] and [`World::acquisition`] say what
/// a picture taken now would show and what the rig measures beside it; [`World::submit`] takes the answers.
pub struct World {
    model: Arc<Model>,
    state: State,
    scene: Scene,
}

/// Everything that changes; small, cloneable.
#[derive(Debug, Clone)]
struct State {
    tick: u64,
    arm: Arm,
    feed: Feed,
    /// Feed last asked for; 0 when nobody asked for too long.
    asked_m_s: f64,
    attention: Attention,
    passage: Passage,
    touch: Touch,
    press: Press,
    timeline: Timeline,
    inbox: Inbox,
    /// True mount now: flange from probe.
    flange_from_probe: Pose,
    /// True pose of the probe now.
    world_from_probe: Pose,
    /// Where the phantom is now; it coincides with the world at tick 0, and shifts without turning.
    world_from_phantom: Pose,
    /// Tick at which the last valid command took effect.
    last_command_tick: u64,
    /// When the image that it answers was taken.
    obeyed_image_tick: u64,
    /// Distance of the nearest pair within the margin at the last look.
    nearest_m: Option<f64>,
    /// Least distance at which the arm stopped, since the last look with nobody near.
    stopped_at_m: Option<f64>,
    /// Something is too near to the needle robot: no feed.
    needle_blocked: bool,
    /// The needle met a force above its robot's limit: no feed any more.
    needle_overloaded: bool,
    needle_has_moved: bool,
    refused_commands: u64,
    events: Vec<Event>,
}

impl World {
    /// Draws the hidden errors from the scenario's seed, places the probe as the operator would, and checks
    /// that the arm can follow the needle to its target. Errors name the key of the scenario to blame.
    pub fn new(scenario: &Scenario) -> Result<Self, WorldError> {
        let (model, arm, scene) = Model::new(scenario)?;
        let flange_from_probe = model.flange_from_mounted_probe;
        let world_from_probe = scenario.arm.world_from_base * arm.base_from_flange() * flange_from_probe;
        let press = Press::new(
            scenario.placement.contact_force_n,
            scenario.limits.max_contact_force_n,
            scenario.limits.max_probe_speed_m_s,
            arm.press_m(),
        );
        let start_m = scenario.insertion.start_depth_m.clamp(0.0, model.feed_limits.max_depth_m);
        let mut state = State {
            tick: 0,
            arm,
            feed: Feed::at_rest(start_m),
            asked_m_s: 0.0,
            attention: Attention::default(),
            passage: Passage::at_rest(&model.resistance, start_m),
            touch: Touch::resting(&model.contact, &world_from_probe),
            press,
            timeline: Timeline::new(&scenario.delays),
            inbox: Inbox::new(),
            flange_from_probe,
            world_from_probe,
            world_from_phantom: Pose::identity(),
            last_command_tick: 0,
            obeyed_image_tick: 0,
            nearest_m: None,
            stopped_at_m: None,
            needle_blocked: false,
            needle_overloaded: false,
            needle_has_moved: false,
            refused_commands: 0,
            events: Vec::new(),
        };
        state.timeline.step(&scenario.disturbances, 0, &mut state.events);
        Ok(Self { model: Arc::new(model), state, scene })
    }

    /// The undeformed phantom, for the renderer.
    pub fn tissue(&self) -> Tissue {
        self.model.tissue.clone()
    }

    /// What the tracker is told before the first image: nominal calibrations, marks, limits, settings.
    pub fn setup(&self, run_id: u64) -> Setup {
        self.model.setup(run_id)
    }

    /// Simulated time.
    pub fn tick(&self) -> u64 {
        self.state.tick
    }

    /// Delay of pictures taken now, from acquisition to publication.
    pub fn image_delay_ticks(&self) -> u64 {
        self.state.timeline.image_delay_ticks
    }

    /// True from the tick at which the scenario kills the tracker until the tick of its restart: no answer
    /// is due meanwhile.
    pub fn tracker_down(&self) -> bool {
        self.state.timeline.tracker_down()
    }

    /// True while the scenario lets the tracker hang: it gets images, and no answer is due.
    pub fn tracker_hung(&self) -> bool {
        self.state.timeline.tracker_hung()
    }

    /// Random words for an answer to image `sequence` that arrives now, when the scenario makes garbage of it.
    pub fn garbage(&self, sequence: u64) -> Option<GarbageWords> {
        self.state.timeline.tracker_garbage().then(|| garbage_words(self.model.scenario.seed, sequence))
    }

    /// True while the scanner hands out its last picture again.
    pub fn images_frozen(&self) -> bool {
        self.state.timeline.images_frozen()
    }

    /// True when the picture `sequence`, taken now, is lost before it is published. Never the first one, which the operator
    /// clicks on.
    pub fn drops_image(&self, sequence: u64) -> bool {
        let share = self.state.timeline.dropped_share();
        sequence > 0 && share > 0.0 && uniform_for_drop(self.model.scenario.seed, sequence) < share
    }

    /// How long ago the image was taken that the command in effect answers; before the first one, since the start.
    pub fn command_age_ticks(&self) -> u64 {
        self.state.tick - self.state.obeyed_image_tick
    }

    /// Commands refused so far.
    pub fn refused_commands(&self) -> u64 {
        self.state.refused_commands
    }

    /// Takes the events since the last call, in the order in which they happened.
    pub fn drain_events(&mut self) -> Vec<Event> {
        std::mem::take(&mut self.state.events)
    }

    /// Tells the world that an image was handed out, so that answers to it are known.
    pub fn note_published(&mut self, image: &Acquisition) {
        self.state.inbox.note_published(image);
    }

    /// Takes a command that arrives now. A valid one acts at the publication tick of the image it answers
    /// plus the command delay, at the next tick at the earliest. A refused one is counted and reported.
    pub fn submit(&mut self, command: &Command) -> CommandReceipt {
        let scenario = &self.model.scenario;
        let bounds = Bounds {
            limits: &scenario.limits,
            base_from_probe_at_start: &self.model.base_from_probe_at_start,
            command_delay_ticks: self.state.timeline.command_delay_ticks,
        };
        let receipt = self.state.inbox.submit(command, self.state.tick, &bounds);
        self.state.report(&receipt);
        receipt
    }

    /// Counts and reports a command that the wire has already refused.
    pub fn refuse(&mut self, answers: u64, refusal: Refusal) -> CommandReceipt {
        let receipt = self.state.inbox.refuse(answers, refusal);
        self.state.report(&receipt);
        receipt
    }

    /// Lets something go wrong that no scenario foresaw. It begins with the next tick, exactly as if the scenario
    /// had it there, after the scenario's own.
    pub fn disturb(&mut self, kind: DisturbanceKind) {
        self.state.timeline.add(kind);
    }

    /// One tick (1 ms) onwards.
    pub fn step(&mut self) {
        self.state.step(&self.model);
        if self.state.tick.is_multiple_of(self.model.scenario.image_period_ticks) {
            self.state.look_around(&self.model, &mut self.scene);
        }
    }

    /// All that a picture taken now depends on.
    pub fn slice(&self, sequence: u64) -> Slice {
        let (state, model) = (&self.state, &*self.model);
        let phantom_from_probe = state.phantom_from_probe();
        Slice {
            sequence,
            phantom_from_probe,
            needle: (state.passage.tip_m > 0.0).then(|| {
                let rest = model.path.seen_at(state.passage.tip_m);
                match model.sway(state.tick, state.passage.tip_m) {
                    Some(sway) => sway.needle(rest),
                    None => rest,
                }
            }),
            needle_gain_db: state.timeline.needle_gain_db,
            element_gap_m: self.element_gaps_m(&phantom_from_probe),
            element_loss_db: self.element_losses_db(),
            indentation: model.contact.indentation(&phantom_from_probe),
            drag: self.drag(&phantom_from_probe),
            gain_db: state.timeline.gain_db,
            noise_gain_db: state.timeline.noise_gain_db,
        }
    }

    /// Gap under each element: the surface's, or where gel is lost.
    fn element_gaps_m(&self, phantom_from_probe: &Pose) -> Vec<f32> {
        let (state, probe) = (&self.state, &self.model.scenario.probe);
        let mut gaps_m = self.model.contact.element_gaps_m(phantom_from_probe, probe);
        for (element, gap_m) in (0..probe.elements).zip(&mut gaps_m) {
            *gap_m = gap_m.max(state.timeline.gap_m(element_x_m(probe, element)) as f32);
        }
        gaps_m
    }

    /// What shadows take from each element; nothing at all without one.
    fn element_losses_db(&self) -> Vec<f32> {
        let (timeline, probe) = (&self.state.timeline, &self.model.scenario.probe);
        let elements = if timeline.any_shadow() { probe.elements } else { 0 };
        (0..elements).map(|element| timeline.loss_db(element_x_m(probe, element)) as f32).collect()
    }

    /// The tissue that the tip carries along, about the point of the resting phantom that the tip holds, however it is pressed
    /// and the needle sways; `None` beyond what tissue can follow.
    fn drag(&self, phantom_from_probe: &Pose) -> Option<Drag> {
        let (state, model) = (&self.state, &*self.model);
        let mut drag = state.passage.drag(&model.path)?;
        if let Some(sway) = model.sway(state.tick, state.passage.tip_m) {
            drag.centre_in_phantom = sway.at(drag.centre_in_phantom) * drag.centre_in_phantom;
        }
        if let Some(press) = model.contact.indentation(phantom_from_probe) {
            drag.centre_in_phantom = press.rest(drag.centre_in_phantom);
        }
        Some(drag).filter(Drag::is_sound)
    }

    /// What the rig measures with a picture taken now: noisy joint encoders and the *nominal* mount, noisy depth and
    /// force, and the feed. A slip of the probe in its holder shows in none of them.
    pub fn acquisition(&self, sequence: u64) -> Acquisition {
        let (state, scenario) = (&self.state, &self.model.scenario);
        let (base_from_probe, depth_m) =
            self.model.measure(state.arm.angles_rad(), state.feed.depth_m, sequence);
        Acquisition {
            sequence,
            acquisition_tick: state.tick,
            publication_tick: state.tick + state.timeline.image_delay_ticks,
            pose_tick: state.tick,
            base_from_probe,
            depth_m: self.model.hand.is_none().then_some(depth_m),
            feed_m_s: self.model.hand.is_none().then_some(state.feed.speed_m_s),
            contact_force_n: state.touch.force_n
                + force_noise_n(scenario.seed, sequence, scenario.calibration.force_sigma_n),
            arm_status: state.arm.status(),
            last_command: state.inbox.last_receipt(),
        }
    }

    /// What really is the case now.
    pub fn truth(&self) -> Truth {
        let (state, model) = (&self.state, &*self.model);
        let phantom_from_probe = state.phantom_from_probe();
        let sway = model.sway(state.tick, state.passage.tip_m);
        let sway = sway.map_or_else(Pose::identity, |sway| sway.at(model.path.point_at(state.passage.tip_m)));
        let probe_from_path = phantom_from_probe.inverse() * sway;
        let sight = truth::sight(&model.scenario, &model.path, &probe_from_path, state.passage.tip_m);
        let tip_in_phantom = sway * sight.tip_on_path;
        let dragged_m = self.drag(&phantom_from_probe).map(|drag| drag.displacement_m(model.target_at_rest));
        let target_in_phantom = pressed(model.contact.indentation(&phantom_from_probe), model.target_at_rest)
            + dragged_m.unwrap_or_default();
        Truth {
            tick: state.tick,
            world_from_probe: state.world_from_probe,
            tip_in_world: state.world_from_phantom * tip_in_phantom,
            tip_in_probe: sight.tip_in_probe,
            reference_px: sight.reference_px,
            plane_to_tip_m: sight.plane_to_tip_m,
            visible: truth::visible(
                &model.scenario.probe,
                &model.contact,
                &state.timeline,
                &phantom_from_probe,
                &sight.tip_in_probe,
            ),
            depth_m: state.feed.depth_m,
            feed_m_s: state.feed.speed_m_s,
            contact_force_n: state.touch.force_n,
            needle_force_n: model.resistance.force_n(&state.passage),
            target_distance_m: (tip_in_phantom - target_in_phantom).norm(),
            min_joint_margin_rad: model.arm.chain.margin_rad(state.arm.angles_rad()),
            collision: state.nearest_m.is_some_and(|distance_m| distance_m <= 0.0),
        }
    }

    /// Joint angles, for pictures of the arm and for tests of its limits.
    pub fn joint_angles_rad(&self) -> [f64; 6] {
        *self.state.arm.angles_rad()
    }

    /// Joints of the needle robot, metres for the three slides and radians for the two turns, for pictures of it; `None`
    /// where a hand inserts.
    pub fn needle_robot_joints(&self) -> Option<[f64; 5]> {
        let robot = self.model.scenario.insertion.hand.is_none();
        robot.then(|| self.model.needle_robot.joints_at(self.state.feed.depth_m))
    }
}

/// Where a point of the resting phantom is now.
fn pressed(indentation: Option<Indentation>, rest: Point) -> Point {
    rest + indentation.map_or_else(Vector::zeros, |press| press.displacement_m(rest))
}

impl State {
    fn phantom_from_probe(&self) -> Pose {
        self.world_from_phantom.inverse() * self.world_from_probe
    }

    /// How far along its path in the phantom the tip would be if nothing stopped it: the robot holds the needle, and a
    /// phantom that moves slides along it.
    fn free_tip_m(&self, model: &Model) -> f64 {
        self.feed.depth_m - model.path.axis_at_entry().dot(&self.world_from_phantom.translation.vector)
    }

    fn event(&mut self, kind: EventKind, detail: impl Into<String>) {
        self.events.push(Event { tick: self.tick, kind, detail: detail.into() });
    }

    fn report(&mut self, receipt: &CommandReceipt) {
        let Some(refusal) = receipt.refused else { return };
        self.refused_commands += 1;
        let why = match refusal {
            Refusal::NotFinite => "a value is not finite",
            Refusal::OutOfLimits => "out of limits",
            Refusal::OtherRun => "belongs to another run",
            Refusal::Stale => "too old",
            Refusal::UnknownImage => "answers an image that was never sent",
            Refusal::Malformed => "its bytes do not make a command",
        };
        self.event(EventKind::CommandRefused, format!("answer to image {}: {why}", receipt.answers));
    }

    fn step(&mut self, model: &Model) {
        let scenario = &model.scenario;
        self.tick += 1;
        self.timeline.step(&scenario.disturbances, self.tick, &mut self.events);
        self.world_from_phantom.translation.vector = self.timeline.phantom_shift_m(self.tick);
        while let Some(due) = self.inbox.pop_due(self.tick) {
            self.obeyed_image_tick = due.image_tick;
            self.obey(model, &due.command);
        }
        self.watch_for_silence(scenario.needle_robot.watchdog_ticks);
        self.feed_needle(model);
        self.arm.stall(&model.arm, self.timeline.arm_stalled());
        if self.tick.is_multiple_of(CONTROL_TICKS) && !self.timeline.arm_stalled() {
            self.control_arm(model);
        }
        self.arm.step(&model.arm);
        if self.timeline.slipping(self.tick) {
            self.flange_from_probe =
                model.flange_from_mounted_probe * self.timeline.mounted_from_slipped(self.tick);
        }
        self.world_from_probe =
            scenario.arm.world_from_base * self.arm.base_from_flange() * self.flange_from_probe;
        self.pass_through(model);
        self.touch.step(&model.contact, &self.phantom_from_probe());
        if self.press.watch(self.touch.force_n) {
            let detail = format!(
                "contact force {:.1} N is above {:.1} N; the probe retreats",
                self.touch.force_n, scenario.limits.max_contact_force_n
            );
            self.event(EventKind::ForceLimit, detail);
        }
    }

    fn obey(&mut self, model: &Model, command: &Command) {
        self.last_command_tick = self.tick;
        self.asked_m_s = command.feed_m_s;
        let Some(target) = &command.target_base_from_probe else {
            self.arm.keep_target();
            return;
        };
        if self.timeline.arm_stalled() {
            return;
        }
        let was_unreachable = self.arm.status() == ArmStatus::Unreachable;
        if let Err(why) = self.arm.set_target(&model.arm, target)
            && !was_unreachable
        {
            self.event(EventKind::Unreachable, format!("the arm holds: {why}"));
        }
    }

    /// The needle robot is safe by itself, whatever became of the tracker.
    fn watch_for_silence(&mut self, watchdog_ticks: u64) {
        if self.tick - self.last_command_tick < watchdog_ticks {
            return;
        }
        if self.asked_m_s > 0.0 {
            self.asked_m_s = 0.0;
            let detail = format!("no valid command for {watchdog_ticks} ms; the needle stops, the arm holds");
            self.event(EventKind::Watchdog, detail);
        }
        self.arm.hold();
    }

    fn feed_needle(&mut self, model: &Model) {
        let moved_before = self.feed.speed_m_s > 0.0;
        if self.needle_blocked {
            self.asked_m_s = 0.0;
        }
        let wanted_m_s = match &model.hand {
            Some(hand) => self.attention.speed_m_s(hand, self.tick, self.asked_m_s),
            None => self.asked_m_s,
        };
        self.feed.wanted_m_s = if self.needle_overloaded { 0.0 } else { wanted_m_s };
        self.feed.step(&model.feed_limits);
        let depth_mm = self.feed.depth_m * 1e3;
        match (moved_before, self.feed.speed_m_s > 0.0) {
            (true, false) => {
                self.event(EventKind::NeedleStopped, format!("needle at rest at {depth_mm:.2} mm"));
            }
            (false, true) => {
                if self.needle_has_moved {
                    self.event(EventKind::NeedleResumed, format!("needle moves on from {depth_mm:.2} mm"));
                }
                self.needle_has_moved = true;
            }
            _ => {}
        }
    }

    /// What the tip meets: a face that it pierces, or more force than the needle robot takes.
    fn pass_through(&mut self, model: &Model) {
        let free_tip_m = self.free_tip_m(model);
        if self.passage.step(&model.resistance, free_tip_m) {
            let depth_mm = self.passage.tip_m * 1e3;
            self.event(EventKind::Puncture, format!("the tip pierces a face at {depth_mm:.2} mm"));
        }
        let force_n = model.resistance.force_n(&self.passage);
        let max_force_n = model.max_needle_force_n();
        if force_n > max_force_n && !self.needle_overloaded {
            self.needle_overloaded = true;
            let detail = format!(
                "{force_n:.1} N on the needle at {:.2} mm, {max_force_n:.1} N are allowed; it stops for good",
                self.passage.tip_m * 1e3
            );
            self.event(EventKind::NeedleBlocked, detail);
        }
    }

    fn control_arm(&mut self, model: &Model) {
        let input = PressInput {
            force_n: self.touch.force_n,
            centre_indentation_m: model.contact.centre_indentation_m(&self.phantom_from_probe()),
            press_m: self.arm.press_m(),
            lift_m: self.timeline.lift_m(),
        };
        let rate_m_s = self.press.rate_m_s(&model.contact, &input);
        if let Err(why) = self.arm.control(&model.arm, rate_m_s) {
            self.event(EventKind::Unreachable, format!("the arm holds: {why}"));
        }
    }

    /// Once per image: who is too near, and may a stopped arm set out again?
    fn look_around(&mut self, model: &Model, scene: &mut Scene) {
        let needle_links = model.needle_links(self.feed.depth_m);
        let nearest = scene.nearest(self.arm.link_poses(), &needle_links);
        self.needle_blocked = nearest.as_ref().is_some_and(|n| n.with_needle_robot);
        let distance_m = nearest.as_ref().map(|n| n.distance_m);
        let approaching =
            distance_m.is_some_and(|now| self.stopped_at_m.is_none_or(|at| now < at - APPROACH_M));
        if let Some(nearest) = nearest.filter(|_| approaching && self.arm.status() != ArmStatus::Collision) {
            let detail = format!(
                "{} are {:.1} mm apart, {:.1} mm must stay; {}",
                nearest.between,
                nearest.distance_m * 1e3,
                MARGIN_M * 1e3,
                if nearest.with_needle_robot { "arm and needle stop" } else { "the arm stops" }
            );
            self.event(EventKind::Collision, detail);
            self.arm.stop_for_collision();
        } else if self.arm.status() == ArmStatus::Collision
            && let Some(angles) = self.arm.target_angles(&model.arm)
            && scene.nearest(&model.arm.chain.link_poses(&angles), &needle_links).is_none()
        {
            self.arm.release(&model.arm);
        }
        self.nearest_m = distance_m;
        self.stopped_at_m = match distance_m {
            // Coming to rest takes a little farther.
            Some(now) if self.arm.status() == ArmStatus::Collision => {
                Some(self.stopped_at_m.map_or(now, |at| at.min(now)))
            }
            Some(_) => self.stopped_at_m,
            None => None,
        };
    }
}
