//! The world as the rest of the program sees it, driven by hand-made commands.

#[path = "../src/fixture.rs"]
mod fixture;

use fixture::{scenario, slip, transverse};
use sonoloop_scenario::{Disturbance, DisturbanceKind, Scenario};
use sonoloop_types::{
    Acquisition, ArmStatus, Command, Estimate, EventKind, Init, Point, Pose, Reason, Refusal, TrackState,
    Vector, View,
};
use sonoloop_world::{Unreachable, World, WorldError};

fn command(answers: u64, target: Option<Pose>, feed_m_s: f64) -> Command {
    Command {
        answers,
        estimate: Estimate::bare(TrackState::Tracking, Reason::Ok, None),
        target_base_from_probe: target,
        feed_m_s,
        compute_us: 0.0,
    }
}

/// Lockstep: publishes each image after its delay and hands it to `answer`.
struct Loop {
    world: World,
    sequence: u64,
    in_flight: Vec<Acquisition>,
}

impl Loop {
    fn new(scenario: &Scenario) -> Self {
        Self { world: World::new(scenario).unwrap(), sequence: 0, in_flight: Vec::new() }
    }

    fn run(&mut self, ticks: u64, mut answer: impl FnMut(&World, &Acquisition) -> Option<Command>) {
        for _ in 0..ticks {
            if self.world.tick().is_multiple_of(40) {
                self.in_flight.push(self.world.acquisition(self.sequence));
                self.sequence += 1;
            }
            let now = self.world.tick();
            let (due, later): (Vec<_>, Vec<_>) =
                self.in_flight.drain(..).partition(|image| image.publication_tick <= now);
            self.in_flight = later;
            for image in due {
                self.world.note_published(&image);
                if let Some(command) = answer(&self.world, &image) {
                    self.world.submit(&command);
                }
            }
            self.world.step();
        }
    }
}

fn feeding(feed_m_s: f64) -> impl FnMut(&World, &Acquisition) -> Option<Command> {
    move |_, image| Some(command(image.sequence, None, feed_m_s))
}

fn no_hidden_errors(mut scenario: Scenario) -> Scenario {
    let calibration = &mut scenario.calibration;
    calibration.needle_sigma_m = 0.0;
    calibration.needle_sigma_rad = 0.0;
    calibration.probe_sigma_m = 0.0;
    calibration.probe_sigma_rad = 0.0;
    calibration.click_sigma_px = 0.0;
    calibration.force_sigma_n = 0.0;
    scenario.placement.alignment_sigma_m = 0.0;
    scenario.placement.alignment_sigma_rad = 0.0;
    scenario
}

#[test]
fn the_operator_places_the_true_plane_on_the_true_needle() {
    for seed in 0..20 {
        let mut scenario = scenario();
        scenario.seed = seed;
        scenario.placement.alignment_sigma_m = 0.0;
        scenario.placement.alignment_sigma_rad = 0.0;
        let world = World::new(&scenario).unwrap();
        let truth = world.truth();
        assert!(truth.tip_in_probe.y.abs() < 1e-9, "seed {seed}: {}", truth.tip_in_probe.y);
        assert!((truth.tip_in_probe.x - scenario.placement.tip_lateral_m).abs() < 1e-9);
        assert!(truth.visible);
        assert!((truth.contact_force_n - scenario.placement.contact_force_n).abs() < 1e-6);
        assert!(truth.min_joint_margin_rad > 0.0 && !truth.collision);
        // The shaft behind the tip lies in the plane as well (bevel roll 0 bends within it).
        let slice = world.slice(0);
        let needle = slice.needle.unwrap();
        for point in &needle.centreline_in_phantom {
            assert!((slice.phantom_from_probe.inverse() * point).y.abs() < 1e-7);
        }
        assert_eq!(slice.element_gap_m.len(), 192);
        assert!(slice.element_gap_m.iter().all(|gap| *gap == 0.0));
    }
}

#[test]
fn a_transverse_plane_cuts_the_needle_at_the_tip() {
    let mut scenario = no_hidden_errors(transverse());
    scenario.placement.alignment_sigma_m = 0.0;
    let mut rig = Loop::new(&scenario);
    let start = rig.world.truth();
    assert!(start.plane_to_tip_m.abs() < 1e-9 && start.visible);
    rig.run(1500, feeding(0.01));
    let later = rig.world.truth();
    let advanced = later.depth_m - start.depth_m;
    // The plane stood still: the needle is through by what it advanced, and the cut stayed where it was up
    // to what the probe's hold moves.
    assert!((later.plane_to_tip_m - advanced).abs() < 1e-4, "{} {advanced}", later.plane_to_tip_m);
    assert!((later.reference_px[0] - start.reference_px[0]).abs() < 0.1);
    assert!((later.reference_px[1] - start.reference_px[1]).abs() < 1.0);
    assert!(!later.visible);
}

#[test]
fn the_setup_holds_measured_values_not_true_ones() {
    for seed in 0..30 {
        let mut scenario = scenario();
        scenario.seed = seed;
        let world = World::new(&scenario).unwrap();
        let (setup, truth) = (world.setup(7), world.truth());
        let world_from_base = scenario.arm.world_from_base;
        assert_eq!(setup.run_id, 7);
        assert_eq!(setup.flange_from_probe, scenario.arm.flange_from_probe);
        let entry = world_from_base * setup.entry_in_base;
        assert!((entry - scenario.insertion.entry_in_world).norm() < 1e-12);
        // Dead reckoning from the nominal needle is wrong by at least about the entry's sigma.
        let axis = world_from_base * setup.needle_axis_in_base;
        let reckoned = entry + axis * truth.depth_m;
        assert!((reckoned - truth.tip_in_world).norm() > 1e-3, "seed {seed}");
        let measured = world_from_base * world.acquisition(0).base_from_probe;
        let apart = measured.inverse() * truth.world_from_probe;
        assert!(apart.translation.vector.norm() > 1e-5 && apart.rotation.angle() > 1e-5);
        // The operator's click is about a pixel off, his target mark lies in the picture's plane.
        let click_px = setup.click_px.expect("a click");
        let off = [0, 1].map(|i| click_px[i] - truth.reference_px[i]);
        assert!(off.iter().all(|d| d.abs() <= 2.0) && off != [0.0, 0.0]);
        let mark = world.acquisition(0).base_from_probe.inverse() * setup.target_in_base;
        assert!(mark.y.abs() < 1e-12);
    }
}

#[test]
fn where_the_tracker_finds_the_tip_itself_no_click_is_told() {
    let mut scenario = scenario();
    scenario.tracker.init = Init::Localize;
    assert_eq!(World::new(&scenario).unwrap().setup(7).click_px, None);
}

#[test]
fn the_needle_reaches_the_target_and_stays_within_its_speed() {
    let scenario = scenario();
    let mut rig = Loop::new(&scenario);
    let target = scenario.insertion.target_depth_m;
    rig.run(6000, |_, image| {
        let left = target - image.depth_m.unwrap();
        Some(command(image.sequence, None, (left * 2.0).clamp(0.0, 0.01)))
    });
    let truth = rig.world.truth();
    assert!(truth.target_distance_m < 1e-3, "{}", truth.target_distance_m);
    assert!((truth.depth_m - target).abs() < 1e-3);
}

#[test]
fn truth_a_stop_takes_effect_within_delay_and_deceleration() {
    let scenario = scenario();
    let mut rig = Loop::new(&scenario);
    rig.run(1000, feeding(0.01));
    assert!((rig.world.truth().feed_m_s - 0.01).abs() < 1e-12);
    let asked_at = rig.world.tick();
    let before_m = rig.world.truth().depth_m;
    rig.world.drain_events();
    rig.run(400, feeding(0.0));
    let stopped = rig.world.drain_events();
    let stop = stopped.iter().find(|e| e.kind == EventKind::NeedleStopped).unwrap();
    let deceleration_ticks = (0.01 / scenario.needle_robot.max_acceleration_m_s2 * 1e3) as u64;
    let bound = scenario.delays.command_ticks + 40 + deceleration_ticks;
    assert!(stop.tick - asked_at <= bound, "{} > {bound}", stop.tick - asked_at);
    // No farther than full speed until the stop acts, and v²/2a after it.
    let travel_m = rig.world.truth().depth_m - before_m;
    let free_s = (scenario.delays.command_ticks + 40) as f64 * 1e-3;
    assert!(travel_m <= 0.01 * free_s + 0.01 * 0.01 / (2.0 * 0.1) + 1e-9, "{travel_m}");
}

#[test]
fn silence_stops_the_needle_and_holds_the_arm() {
    let scenario = scenario();
    let mut rig = Loop::new(&scenario);
    rig.run(1000, feeding(0.01));
    let last_valid = rig.world.tick();
    rig.run(1000, |_, _| None);
    let events = rig.world.drain_events();
    let watchdog = events.iter().find(|e| e.kind == EventKind::Watchdog).unwrap();
    // The last command took effect at most the command delay after `last_valid`.
    let latest = last_valid + scenario.delays.command_ticks + scenario.needle_robot.watchdog_ticks;
    assert!(watchdog.tick <= latest, "{} {latest}", watchdog.tick);
    let stop = events.iter().find(|e| e.kind == EventKind::NeedleStopped).unwrap();
    assert!(stop.tick <= watchdog.tick + 101, "decelerates from 10 mm/s at 100 mm/s² in 100 ms");
    assert_eq!(rig.world.acquisition(999).arm_status, ArmStatus::Holding);
    let depth = rig.world.truth().depth_m;
    rig.run(500, |_, _| None);
    assert_eq!(rig.world.truth().depth_m, depth);
    // A valid command wakes both.
    rig.run(200, feeding(0.005));
    assert_eq!(rig.world.acquisition(999).arm_status, ArmStatus::Ready);
    assert!(rig.world.truth().feed_m_s > 0.0);
    assert!(rig.world.drain_events().iter().any(|e| e.kind == EventKind::NeedleResumed));
}

#[test]
fn truth_a_slip_moves_the_true_plane_and_no_measured_value() {
    let mut with = scenario();
    with.disturbances = vec![Disturbance {
        tick: 500,
        kind: DisturbanceKind::ProbeKnock { probe_from_slipped: slip(3e-3), duration_ticks: 50 },
    }];
    let (mut knocked, mut calm) = (Loop::new(&with), Loop::new(&scenario()));
    for ticks in [510, 90, 400] {
        knocked.run(ticks, feeding(0.005));
        calm.run(ticks, feeding(0.005));
        // Measured: to the bit the same. (Force is left out: the array is level and feels nothing.)
        let (a, b) = (knocked.world.acquisition(1), calm.world.acquisition(1));
        let apart = a.base_from_probe.inverse() * b.base_from_probe;
        assert!(apart.translation.vector.norm() < 1e-7 && apart.rotation.angle() < 1e-7);
        assert_eq!((a.depth_m, a.feed_m_s, a.arm_status), (b.depth_m, b.feed_m_s, b.arm_status));
    }
    let (a, b) = (knocked.world.truth().world_from_probe, calm.world.truth().world_from_probe);
    let moved = (b.inverse() * a).translation.vector;
    assert!((moved - Vector::new(0.0, 3e-3, 0.0)).norm() < 1e-6, "{moved}");
    assert!((knocked.world.truth().tip_in_probe.y - (calm.world.truth().tip_in_probe.y - 3e-3)).abs() < 1e-6);
    assert!(calm.world.truth().visible && !knocked.world.truth().visible);
    assert!(knocked.world.drain_events().iter().any(|e| e.kind == EventKind::Disturbance && e.tick == 500));
}

#[test]
fn bad_commands_are_refused_counted_and_reported() {
    let scenario = scenario();
    let mut rig = Loop::new(&scenario);
    rig.run(201, |_, image| Some(command(image.sequence, None, 0.0)));
    let here = rig.world.acquisition(5).base_from_probe;
    let newest = rig.sequence - 2;
    let good = command(newest, Some(here), 0.01);
    let mut nan = good;
    nan.feed_m_s = f64::NAN;
    let mut nan_pose = good;
    nan_pose.target_base_from_probe = Some(Pose::translation(f64::INFINITY, 0.0, 0.0));
    let mut nan_estimate = good;
    nan_estimate.estimate.tip_px = Some([f64::NAN, 0.0]);
    let far = Pose::translation(0.0, 0.0, scenario.limits.max_probe_travel_m + 1e-3) * here;
    let turned = here
        * Pose::from_parts(
            nalgebra::Translation3::identity(),
            nalgebra::UnitQuaternion::from_axis_angle(
                &Vector::z_axis(),
                scenario.limits.max_probe_turn_rad + 0.01,
            ),
        );
    let mut stretched = good;
    stretched.target_base_from_probe = Some(Pose::from_parts(
        here.translation,
        nalgebra::UnitQuaternion::new_unchecked(here.rotation.into_inner() * 1.1),
    ));
    let cases = [
        (nan, Refusal::NotFinite),
        (nan_pose, Refusal::NotFinite),
        (nan_estimate, Refusal::NotFinite),
        (command(newest, None, -1e-3), Refusal::OutOfLimits),
        (command(newest, None, scenario.limits.max_feed_m_s + 1e-4), Refusal::OutOfLimits),
        (command(newest, Some(far), 0.0), Refusal::OutOfLimits),
        (command(newest, Some(turned), 0.0), Refusal::OutOfLimits),
        (stretched, Refusal::OutOfLimits),
        (command(4000, None, 0.0), Refusal::UnknownImage),
        (command(0, None, 0.0), Refusal::Stale),
    ];
    rig.world.drain_events();
    for (i, (bad, why)) in cases.iter().enumerate() {
        assert_eq!(rig.world.submit(bad).refused, Some(*why), "case {i}");
        assert_eq!(rig.world.acquisition(9).last_command.unwrap().refused, Some(*why));
    }
    rig.world.refuse(3, Refusal::OtherRun);
    assert_eq!(rig.world.refused_commands(), cases.len() as u64 + 1);
    let reported = rig.world.drain_events();
    assert!(reported.iter().all(|e| e.kind == EventKind::CommandRefused));
    assert_eq!(reported.len(), cases.len() + 1);
    assert_eq!(rig.world.submit(&good).refused, None);
    assert_eq!(rig.world.refused_commands(), cases.len() as u64 + 1);
}

#[test]
fn an_answer_older_than_the_delays_and_200_ms_is_stale() {
    let scenario = scenario();
    let mut world = World::new(&scenario).unwrap();
    let image = world.acquisition(0);
    world.note_published(&image);
    let oldest = scenario.delays.image_ticks + scenario.delays.command_ticks + 200;
    // It would act one tick after it arrives.
    for _ in 0..oldest - 1 {
        world.step();
    }
    assert_eq!(world.submit(&command(0, None, 0.001)).refused, None);
    world.step();
    assert_eq!(world.submit(&command(0, None, 0.001)).refused, Some(Refusal::Stale));
}

#[test]
fn a_command_acts_at_the_publication_plus_the_delay() {
    let scenario = scenario();
    let mut world = World::new(&scenario).unwrap();
    let image = world.acquisition(0);
    while world.tick() < image.publication_tick {
        world.step();
    }
    world.note_published(&image);
    world.submit(&command(0, None, 0.01));
    let due = image.publication_tick + scenario.delays.command_ticks;
    while world.tick() < due - 1 {
        world.step();
    }
    assert_eq!(world.truth().feed_m_s, 0.0);
    world.step();
    assert!(world.truth().feed_m_s > 0.0);
}

#[test]
fn the_arm_goes_where_it_is_told_and_no_faster_than_allowed() {
    let scenario = scenario();
    let mut rig = Loop::new(&scenario);
    let start = rig.world.acquisition(0).base_from_probe;
    // 10 mm along the array, 3 mm in elevation, a little yaw.
    let target = start
        * Pose::from_parts(
            Vector::new(0.010, 0.003, 0.0).into(),
            nalgebra::UnitQuaternion::from_axis_angle(&Vector::z_axis(), 0.1),
        );
    let mut last = rig.world.truth().world_from_probe;
    let mut fastest_m_s = 0.0f64;
    for _ in 0..1500 {
        rig.run(1, |_, image| Some(command(image.sequence, Some(target), 0.0)));
        let now = rig.world.truth().world_from_probe;
        fastest_m_s = fastest_m_s.max((now.translation.vector - last.translation.vector).norm() * 1e3);
        last = now;
    }
    let reached = rig.world.acquisition(0).base_from_probe;
    let error = target.inverse() * reached;
    assert!(error.translation.vector.xy().norm() < 1e-5, "{}", error.translation.vector);
    assert!(error.rotation.angle() < 1e-5);
    // The set point keeps the limit; a jerk-limited arm that caught up may briefly run ahead of it.
    assert!(fastest_m_s < 1.25 * scenario.limits.max_probe_speed_m_s, "{fastest_m_s}");
    assert!((rig.world.truth().contact_force_n - 3.0).abs() < 0.05, "{}", rig.world.truth().contact_force_n);
}

#[test]
fn lifting_breaks_contact_and_putting_back_restores_it() {
    let mut scenario = scenario();
    scenario.disturbances = vec![Disturbance {
        tick: 400,
        kind: DisturbanceKind::LiftOff { height_m: 8e-3, duration_ticks: 1500 },
    }];
    let mut rig = Loop::new(&scenario);
    rig.run(400, feeding(0.0));
    let before = rig.world.truth();
    let measured_before = rig.world.acquisition(0).base_from_probe;
    rig.run(1400, feeding(0.0));
    let up = rig.world.truth();
    let measured_up = rig.world.acquisition(0).base_from_probe;
    assert!(before.visible && !up.visible && up.contact_force_n == 0.0);
    assert!((up.world_from_probe.translation.vector.z - 8e-3).abs() < 1e-4);
    let gaps = rig.world.slice(0).element_gap_m;
    assert!(gaps.iter().all(|gap| (f64::from(*gap) - 8e-3).abs() < 1e-3), "{gaps:?}");
    // The encoders see it: the arm lifts.
    let risen = measured_up.translation.vector.z - measured_before.translation.vector.z;
    assert!(risen > 8e-3, "{risen}");
    rig.run(3000, feeding(0.0));
    let down = rig.world.truth();
    assert!((down.contact_force_n - 3.0).abs() < 0.05 && down.visible, "{}", down.contact_force_n);
    assert!(
        (down.world_from_probe.translation.vector - before.world_from_probe.translation.vector).norm() < 2e-4
    );
}

#[test]
fn too_much_force_is_reported_and_the_probe_retreats() {
    let mut scenario = scenario();
    scenario.limits.max_contact_force_n = 5.0;
    // The probe slips downwards in its holder, into the gel.
    scenario.disturbances = vec![Disturbance {
        tick: 400,
        kind: DisturbanceKind::ProbeKnock {
            probe_from_slipped: Pose::translation(0.0, 0.0, 4e-3),
            duration_ticks: 100,
        },
    }];
    let mut rig = Loop::new(&scenario);
    rig.run(3000, feeding(0.0));
    let limits: Vec<_> =
        rig.world.drain_events().into_iter().filter(|e| e.kind == EventKind::ForceLimit).collect();
    assert_eq!(limits.len(), 1, "once per episode");
    assert!((rig.world.truth().contact_force_n - 3.0).abs() < 0.05);
}

#[test]
fn a_liquid_bears_no_force_and_the_height_is_held() {
    let mut scenario = scenario();
    scenario.phantom.materials[0].youngs_modulus_pa = None;
    let mut rig = Loop::new(&scenario);
    rig.run(2000, feeding(0.005));
    let truth = rig.world.truth();
    assert_eq!(truth.contact_force_n, 0.0);
    assert!((truth.world_from_probe.translation.vector.z + 2e-3).abs() < 1e-6);
    assert!(rig.world.slice(0).element_gap_m.iter().all(|gap| *gap == 0.0));
}

#[test]
fn gain_brightness_delay_and_the_trackers_death_follow_the_timeline() {
    let mut scenario = scenario();
    scenario.disturbances = vec![
        Disturbance { tick: 0, kind: DisturbanceKind::GainChange { gain_db: 3.0 } },
        Disturbance { tick: 100, kind: DisturbanceKind::NeedleBrightness { gain_db: -6.0 } },
        Disturbance { tick: 200, kind: DisturbanceKind::ImageDelay { image_ticks: 120 } },
        Disturbance { tick: 300, kind: DisturbanceKind::TrackerKilled { down_ticks: 500 } },
    ];
    let mut world = World::new(&scenario).unwrap();
    assert_eq!(world.slice(0).gain_db, 3.0);
    while world.tick() < 299 {
        world.step();
    }
    assert_eq!((world.slice(0).needle_gain_db, world.image_delay_ticks()), (-6.0, 120));
    assert!(!world.tracker_down());
    world.step();
    assert!(world.tracker_down());
    while world.tick() < 799 {
        world.step();
    }
    assert!(world.tracker_down());
    world.step();
    assert!(!world.tracker_down());
    let events = world.drain_events();
    let of = |kind| events.iter().filter(|e| e.kind == kind).map(|e| e.tick).collect::<Vec<_>>();
    assert_eq!(of(EventKind::Disturbance), [0, 100, 200]);
    assert_eq!(of(EventKind::TrackerKilled), [300]);
    assert_eq!(of(EventKind::TrackerRestarted), [800]);
}

/// A world that was stepped to `tick` with one disturbance at tick 100.
fn disturbed(kind: DisturbanceKind, tick: u64) -> World {
    let mut scenario = no_hidden_errors(scenario());
    scenario.disturbances = vec![Disturbance { tick: 100, kind }];
    let mut world = World::new(&scenario).unwrap();
    while world.tick() < tick {
        world.step();
    }
    world
}

#[test]
fn lost_gel_is_a_gap_where_it_is_lost_and_hides_a_tip_below_it() {
    let tip_m = World::new(&no_hidden_errors(scenario())).unwrap().truth().tip_in_probe.x;
    let lost = |from_m: f64, to_m: f64, tick| {
        let kind = DisturbanceKind::GelLost { from_m, to_m, gap_m: 3e-4, duration_ticks: 500 };
        disturbed(kind, tick)
    };
    let world = lost(tip_m - 8e-3, tip_m + 8e-3, 101);
    let gaps = world.slice(0).element_gap_m;
    for (element, gap_m) in (0..).zip(&gaps) {
        let x_m = (f64::from(element) - 95.5) * 0.2e-3;
        assert_eq!(*gap_m, if (x_m - tip_m).abs() <= 8e-3 { 3e-4 } else { 0.0 }, "{x_m}");
    }
    assert!(gaps.iter().any(|gap| *gap > 0.0) && !world.truth().visible);
    assert!(lost(tip_m + 9e-3, tip_m + 12e-3, 101).truth().visible, "beside the tip");
    for tick in [99, 600] {
        let world = lost(tip_m - 8e-3, tip_m + 8e-3, tick);
        assert!(world.truth().visible && world.slice(0).element_gap_m.iter().all(|gap| *gap == 0.0));
    }
}

#[test]
fn a_shadow_weakens_its_elements_and_hides_a_tip_from_six_decibels_on() {
    let tip_m = World::new(&no_hidden_errors(scenario())).unwrap().truth().tip_in_probe.x;
    let shadow = |loss_db: f64, tick| {
        let kind = DisturbanceKind::Shadow { x_m: tip_m, width_m: 16e-3, loss_db, duration_ticks: 500 };
        disturbed(kind, tick)
    };
    let world = shadow(20.0, 101);
    let losses = world.slice(0).element_loss_db;
    let shadowed = losses.iter().filter(|loss| **loss == 20.0).count();
    assert!(losses.len() == 192 && (79..=81).contains(&shadowed), "{shadowed} of 80 elements");
    // 10^(−6.02/20) is a half.
    assert!(!world.truth().visible && !shadow(6.1, 101).truth().visible && shadow(5.9, 101).truth().visible);
    let after = shadow(20.0, 600);
    assert!(after.truth().visible && after.slice(0).element_loss_db.is_empty());
}

#[test]
fn noise_delays_and_faults_of_scanner_and_tracker_follow_the_timeline() {
    assert_eq!(disturbed(DisturbanceKind::Noise { gain_db: 9.0 }, 101).slice(0).noise_gain_db, 9.0);
    let duration_ticks = 50;
    for (tick, expected) in [(99, false), (100, true), (149, true), (150, false)] {
        let world = |kind| disturbed(kind, tick);
        let frozen = world(DisturbanceKind::FrozenImages { duration_ticks });
        assert_eq!((frozen.images_frozen(), frozen.truth().visible), (expected, !expected), "{tick}");
        assert_eq!(world(DisturbanceKind::TrackerHung { duration_ticks }).tracker_hung(), expected, "{tick}");
        let garbage = world(DisturbanceKind::TrackerGarbage { duration_ticks });
        assert_eq!(garbage.garbage(3).is_some(), expected, "{tick}");
        assert_eq!(garbage.garbage(3), garbage.garbage(3));
        let dropped = world(DisturbanceKind::DroppedImages { share: 1.0, duration_ticks });
        assert_eq!(dropped.drops_image(2), expected, "{tick}");
    }
    let garbage = disturbed(DisturbanceKind::TrackerGarbage { duration_ticks }, 120);
    assert_ne!(garbage.garbage(3), garbage.garbage(4));
    // Of ten thousand images a share of 0.3 is known to 0.0046; this is four times as much.
    let dropped = disturbed(DisturbanceKind::DroppedImages { share: 0.3, duration_ticks }, 120);
    let lost = (0..10_000).filter(|image| dropped.drops_image(*image)).count() as f64 / 1e4;
    assert!((lost - 0.3).abs() < 0.0184, "{lost}");
}

#[test]
fn commands_act_so_much_later_once_their_delay_has_stepped() {
    let began = |delay: Option<u64>| {
        let mut scenario = scenario();
        let kinds = delay.map(|command_ticks| DisturbanceKind::CommandDelay { command_ticks });
        scenario.disturbances = kinds.map(|kind| Disturbance { tick: 50, kind }).into_iter().collect();
        let mut rig = Loop::new(&scenario);
        // The first command that feeds answers the image of tick 80.
        let answer = |_: &World, image: &Acquisition| {
            Some(command(image.sequence, None, if image.sequence < 2 { 0.0 } else { 0.005 }))
        };
        let mut answer = answer;
        (0..400).find(|_| {
            rig.run(1, &mut answer);
            rig.world.truth().feed_m_s > 0.0
        })
    };
    let (usual, late) = (began(None).unwrap(), began(Some(90)).unwrap());
    assert_eq!(late - usual, 90 - scenario().delays.command_ticks);
}

#[test]
fn a_stalled_arm_stands_whatever_it_is_told_and_then_goes_where_it_was_told() {
    let mut scenario = scenario();
    scenario.disturbances =
        vec![Disturbance { tick: 150, kind: DisturbanceKind::ArmStall { duration_ticks: 1500 } }];
    let mut rig = Loop::new(&scenario);
    let start = rig.world.acquisition(0).base_from_probe;
    let target = start * Pose::translation(0.0, 8e-3, 0.0);
    let send = |_: &World, image: &Acquisition| Some(command(image.sequence, Some(target), 0.0));
    // Under way when it stalls; then it brakes within its limits.
    rig.run(600, send);
    assert_eq!(rig.world.acquisition(0).arm_status, ArmStatus::Holding);
    let stalled = rig.world.truth().world_from_probe;
    let gone_m = (start.inverse() * rig.world.acquisition(0).base_from_probe).translation.vector.norm();
    assert!((1e-3..7.9e-3).contains(&gone_m), "{gone_m}");
    let farther = target * Pose::translation(0.0, 2e-3, 0.0);
    rig.run(790, |_, image| Some(command(image.sequence, Some(farther), 0.0)));
    assert_eq!(rig.world.acquisition(0).arm_status, ArmStatus::Holding);
    let moved = stalled.inverse() * rig.world.truth().world_from_probe;
    assert!(moved.translation.vector.norm() < 1e-9, "{moved}");
    rig.run(2000, send);
    let acquisition = rig.world.acquisition(0);
    assert_eq!(acquisition.arm_status, ArmStatus::Ready);
    let left = (target.inverse() * acquisition.base_from_probe).translation.vector.xy().norm();
    assert!(left < 1e-5, "{left}");
    assert!((rig.world.truth().contact_force_n - 3.0).abs() < 0.05);
}

#[test]
fn truth_visible_ends_at_half_the_slice_thickness() {
    // The probe is slid out of plane in small steps; visibility must end where the table says.
    for side in [-1.0, 1.0] {
        let mut scenario = no_hidden_errors(scenario());
        scenario.placement.alignment_sigma_m = 0.0;
        let depth_m = World::new(&scenario).unwrap().truth().tip_in_probe.z;
        let half_m = scenario.probe.slice_thickness_m(depth_m) / 2.0;
        for (offset_m, expected) in [(half_m - 2e-5, true), (half_m + 2e-5, false)] {
            scenario.disturbances = vec![Disturbance {
                tick: 1,
                kind: DisturbanceKind::ProbeKnock {
                    probe_from_slipped: slip(side * offset_m),
                    duration_ticks: 1,
                },
            }];
            let mut world = World::new(&scenario).unwrap();
            world.step();
            world.step();
            assert_eq!(world.truth().visible, expected, "{offset_m}");
        }
    }
}

#[test]
fn a_tip_beside_the_array_or_under_a_gap_is_not_visible() {
    let mut scenario = no_hidden_errors(scenario());
    scenario.placement.tip_lateral_m = -0.0193;
    assert!(!World::new(&scenario).unwrap().truth().visible);
    scenario.placement.tip_lateral_m = -0.0190;
    assert!(World::new(&scenario).unwrap().truth().visible);
    // A slip about the probe's y-axis leans the array. Turning by a positive angle lifts its +x end and
    // presses the end over the tip.
    scenario.placement.contact_force_n = 0.2;
    for (angle, expected) in [(0.05, true), (-0.05, false)] {
        scenario.disturbances = vec![Disturbance {
            tick: 1,
            kind: DisturbanceKind::ProbeKnock {
                probe_from_slipped: Pose::from_parts(
                    nalgebra::Translation3::identity(),
                    nalgebra::UnitQuaternion::from_axis_angle(&Vector::y_axis(), angle),
                ),
                duration_ticks: 1,
            },
        }];
        scenario.placement.tip_lateral_m = -0.015;
        let mut world = World::new(&scenario).unwrap();
        world.step();
        world.step();
        assert_eq!(world.truth().visible, expected, "{angle}");
        let gaps = world.slice(0).element_gap_m;
        assert!(gaps.iter().any(|gap| *gap > 0.0) && gaps.contains(&0.0));
    }
}

#[test]
fn an_unreachable_target_is_reported_and_the_arm_holds() {
    let mut scenario = scenario();
    // A base so far away that a little more is too much; the limits of commands allow it.
    scenario.arm.world_from_base = Pose::translation(-0.70, 0.0, -0.06);
    scenario.limits.max_probe_travel_m = 1.0;
    let mut rig = Loop::new(&scenario);
    rig.run(200, feeding(0.0));
    let start = rig.world.acquisition(0).base_from_probe;
    let target = Pose::translation(0.9, 0.0, 0.0) * start;
    rig.run(400, |_, image| Some(command(image.sequence, Some(target), 0.0)));
    let events = rig.world.drain_events();
    assert_eq!(events.iter().filter(|e| e.kind == EventKind::Unreachable).count(), 1, "{events:?}");
    let here = rig.world.acquisition(0);
    assert_eq!(here.arm_status, ArmStatus::Unreachable);
    assert!((here.base_from_probe.translation.vector - start.translation.vector).norm() < 1e-4);
    rig.run(200, |_, image| Some(command(image.sequence, Some(start), 0.0)));
    assert_eq!(rig.world.acquisition(0).arm_status, ArmStatus::Ready);
}

#[test]
fn a_table_in_the_way_stops_the_arm() {
    let mut scenario = scenario();
    scenario.limits.max_probe_travel_m = 0.5;
    // A thin phantom: beside it the face, kept at the height of the surface, is 8 mm over the table.
    scenario.phantom.size_m = [0.2, 0.1, 0.045];
    scenario.arm.world_from_base = Pose::translation(-0.55, 0.0, -0.06);
    let mut rig = Loop::new(&scenario);
    rig.run(200, feeding(0.0));
    // Leaning by 30° lowers a corner of the housing onto the phantom's neighbour, the table: slide off the
    // edge and lean.
    let start = rig.world.acquisition(0).base_from_probe;
    let off_edge = Pose::translation(0.0, 0.13, 0.0) * start;
    rig.run(6000, |_, image| Some(command(image.sequence, Some(off_edge), 0.0)));
    // Off the edge nothing bears the probe: force control goes down until the table is near.
    let events = rig.world.drain_events();
    let collision = events.iter().find(|e| e.kind == EventKind::Collision).expect("stops over the table");
    assert!(
        collision.detail.contains("table") || collision.detail.contains("phantom"),
        "{}",
        collision.detail
    );
    assert_eq!(rig.world.acquisition(0).arm_status, ArmStatus::Collision);
    let held = rig.world.truth();
    assert!(!held.collision, "stopped before it touched");
    rig.run(400, |_, image| Some(command(image.sequence, None, 0.0)));
    assert_eq!(rig.world.truth().world_from_probe, held.world_from_probe);
}

#[test]
fn what_the_arm_cannot_reach_is_said_before_the_start() {
    let mut far = scenario();
    far.arm.world_from_base = Pose::translation(-2.0, 0.0, -0.06);
    let error = World::new(&far).err().unwrap();
    assert!(matches!(&error, WorldError::StartUnreachable(Unreachable::OutOfReach { .. })), "{error}");
    assert!(error.to_string().contains("out of reach"), "{error}");

    // Reachable at the start, not at the end of the path.
    let mut end = no_hidden_errors(scenario());
    end.phantom.size_m = [1.2, 0.3, 0.2];
    end.needle_robot.max_depth_m = 1.0;
    end.needle.length_m = 1.0;
    end.needle.curvature_per_m = 0.0;
    end.insertion.axis_in_world = Vector::new(0.99, 0.0, -(1.0f64 - 0.99 * 0.99).sqrt());
    end.insertion.target_depth_m = 0.5;
    let error = World::new(&end).err().unwrap();
    assert!(matches!(error, WorldError::TargetUnreachable { .. }), "{error}");
    assert!(error.to_string().starts_with("insertion.target_depth_mm"), "{error}");

    let mut deep = scenario();
    deep.insertion.target_depth_m = 0.2;
    assert!(matches!(World::new(&deep).err(), Some(WorldError::TargetTooDeep { .. })));
    let mut through = scenario();
    through.insertion.axis_in_world = -Vector::z();
    through.insertion.target_depth_m = 0.08;
    assert!(matches!(World::new(&through).err(), Some(WorldError::TargetOutsidePhantom { .. })));
    let mut opw = scenario();
    opw.arm.opw.as_mut().unwrap().lengths_m[3] = 0.5;
    assert!(matches!(World::new(&opw).err(), Some(WorldError::OpwMismatch { .. })));
}

#[test]
fn two_runs_give_the_same_bits() {
    let mut scenario = scenario();
    scenario.disturbances = vec![
        Disturbance {
            tick: 700,
            kind: DisturbanceKind::ProbeKnock { probe_from_slipped: slip(2e-3), duration_ticks: 30 },
        },
        Disturbance { tick: 1200, kind: DisturbanceKind::LiftOff { height_m: 5e-3, duration_ticks: 300 } },
    ];
    let run = || {
        let mut rig = Loop::new(&scenario);
        let start = rig.world.acquisition(0).base_from_probe;
        let mut rows = Vec::new();
        for _ in 0..60 {
            rig.run(40, |_, image| {
                let aside = 2e-3 * (image.sequence as f64 * 0.3).sin();
                let target = start * Pose::translation(aside, -aside, 0.0);
                Some(command(image.sequence, Some(target), 0.008))
            });
            let truth = rig.world.truth();
            let force = rig.world.acquisition(rig.sequence).contact_force_n;
            let mut bits: Vec<u64> = rig.world.joint_angles_rad().map(f64::to_bits).to_vec();
            bits.extend(truth.tip_in_probe.coords.iter().map(|v| v.to_bits()));
            bits.extend([truth.depth_m.to_bits(), truth.contact_force_n.to_bits(), force.to_bits()]);
            rows.push(bits);
        }
        (rows, rig.world.drain_events())
    };
    assert_eq!(run(), run());
}

#[test]
fn a_seed_changes_what_is_hidden_and_nothing_that_is_told() {
    let mut other = scenario();
    other.seed = 2;
    let (a, b) = (World::new(&scenario()).unwrap(), World::new(&other).unwrap());
    assert!((a.truth().tip_in_world - b.truth().tip_in_world).norm() > 1e-4);
    let (a, b) = (a.setup(1), b.setup(1));
    assert_eq!(a.entry_in_base, b.entry_in_base);
    assert_eq!(a.needle_axis_in_base, b.needle_axis_in_base);
    assert_eq!(a.flange_from_probe, b.flange_from_probe);
    assert_ne!(a.click_px, b.click_px);
}

#[test]
fn an_arm_without_analytic_parameters_does_the_same() {
    let with = scenario();
    let mut without = scenario();
    without.arm.opw = None;
    let (mut a, mut b) = (Loop::new(&with), Loop::new(&without));
    let start = a.world.acquisition(0).base_from_probe;
    let target = start * Pose::translation(4e-3, 2e-3, 0.0);
    for rig in [&mut a, &mut b] {
        rig.run(1000, |_, image| Some(command(image.sequence, Some(target), 0.0)));
    }
    for (p, q) in a.world.joint_angles_rad().iter().zip(b.world.joint_angles_rad()) {
        assert!((p - q).abs() < 1e-7, "{p} {q}");
    }
}

#[test]
fn the_view_decides_what_the_reference_is() {
    let lateral = World::new(&no_hidden_errors(scenario())).unwrap().truth();
    assert!((lateral.reference_px[0] - (319.5 - 50.0)).abs() < 1e-6);
    let slice = World::new(&no_hidden_errors(scenario())).unwrap().slice(0);
    assert_eq!(slice.sequence, 0);
    let scenario = no_hidden_errors(transverse());
    assert_eq!(scenario.view, View::Transverse);
    let crossing = World::new(&scenario).unwrap().truth();
    assert!((crossing.reference_px[0] - 319.5).abs() < 1e-6);
    let origin = Point::origin();
    assert!((crossing.tip_in_world - origin).norm() > 0.0);
}
