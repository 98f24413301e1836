//! Needle and tissue as the rest of the program sees them: faces, bone, and a hand that inserts.

#[path = "../src/fixture.rs"]
mod fixture;

use sonoloop_scenario::{Inclusion, PassageSpec, Scenario, Shape};
use sonoloop_types::{Command, Estimate, Event, EventKind, Pose, Reason, TrackState, Vector};
use sonoloop_world::World;

/// Answers every image at once with a feed.
fn fed(world: &mut World, ticks: u64, feed_m_s: f64) -> Vec<Event> {
    for _ in 0..ticks {
        let tick = world.tick();
        if tick.is_multiple_of(40) {
            let image = world.acquisition(tick / 40);
            world.note_published(&image);
            world.submit(&Command {
                answers: image.sequence,
                estimate: Estimate::bare(TrackState::Tracking, Reason::Ok, None),
                target_base_from_probe: None,
                feed_m_s,
                compute_us: 0.0,
            });
        }
        world.step();
    }
    world.drain_events()
}

/// A straight needle without hidden errors, and a slab across its way from 16 mm below the face on, 10 mm thick.
fn over_a_slab(needle: Option<PassageSpec>) -> Scenario {
    let mut scenario = fixture::scenario();
    scenario.needle.curvature_per_m = 0.0;
    scenario.calibration.needle_sigma_m = 0.0;
    scenario.calibration.needle_sigma_rad = 0.0;
    let mut slab = scenario.phantom.materials[0].clone();
    slab.needle = needle;
    scenario.phantom.materials.push(slab);
    scenario.phantom.inclusions.push(Inclusion {
        name: "slab".into(),
        shape: Shape::Cuboid { size_m: [0.2, 0.1, 0.01] },
        phantom_from_inclusion: Pose::translation(0.0, 0.0, -0.021),
        material: 1,
    });
    scenario
}

/// Depth along the needle at which it meets the slab.
fn slab_m(scenario: &Scenario) -> f64 {
    0.016 / -scenario.insertion.axis_in_world.z
}

#[test]
fn truth_a_face_goes_with_the_tip_and_takes_the_target_along() {
    let hard = PassageSpec { puncture_n: 1.0, cutting_n: 0.4, stiffness_n_m: 300.0, ..fixture::passage() };
    let mut scenario = over_a_slab(Some(hard));
    scenario.insertion.target_depth_m = slab_m(&scenario);
    let mut world = World::new(&scenario).unwrap();
    let mut pushed_m = 0.0f64;
    let mut pierced = None;
    while pierced.is_none() && world.tick() < 4000 {
        let events = fed(&mut world, 1, 0.01);
        pierced = events.into_iter().find(|event| event.kind == EventKind::Puncture);
        let (truth, slice) = (world.truth(), world.slice(0));
        let past_m = truth.depth_m - slab_m(&scenario);
        if let Some(drag) = slice.drag.filter(|_| pierced.is_none()) {
            pushed_m = pushed_m.max(past_m);
            assert!((drag.displacement_in_phantom - scenario.insertion.axis_in_world * past_m).norm() < 1e-6);
            // The target lies on the face: it stays at the tip but for what the probe presses it down.
            let pressed_m = slice
                .indentation
                .map_or(Vector::zeros(), |press| press.displacement_m(drag.centre_in_phantom));
            assert!(truth.target_distance_m <= pressed_m.norm() + 1e-3, "{}", truth.target_distance_m);
        }
    }
    // 0.15 + 300x + 6·10⁴x² = 1: x = (−300 + √(300² + 2.4·10⁵·0.85))/(1.2·10⁵).
    let dent_m = (-300.0 + (9e4 + 2.4e5 * 0.85f64).sqrt()) / 1.2e5;
    assert!(pierced.is_some() && (pushed_m - dent_m).abs() < 2e-5, "{pushed_m} {dent_m}");
    fed(&mut world, 60, 0.01);
    let left_m = world.slice(0).drag.map_or(0.0, |drag| drag.displacement_in_phantom.norm());
    assert!(left_m < 0.01 * dent_m, "slipped back within 60 ms: {left_m}");
}

#[test]
fn on_bone_the_needle_stops_for_good_below_its_robots_limit_and_one_deceleration() {
    let mut scenario = over_a_slab(None);
    scenario.insertion.target_depth_m = 0.045;
    let robot = scenario.needle_robot.clone();
    let mut world = World::new(&scenario).unwrap();
    let events = fed(&mut world, 3000, 0.01);
    let at = |kind| events.iter().find(|event| event.kind == kind).map(|event| event.tick);
    let (blocked, stopped) = (at(EventKind::NeedleBlocked).unwrap(), at(EventKind::NeedleStopped).unwrap());
    let deceleration_ticks = (0.01 / robot.max_acceleration_m_s2 * 1e3).round() as u64;
    assert!(stopped > blocked && stopped - blocked <= deceleration_ticks + 1, "{blocked} {stopped}");
    // v²/2a further at 3 N/mm.
    let truth = world.truth();
    let most_n = robot.max_force_n + 3e3 * (0.01 * 0.01 / (2.0 * robot.max_acceleration_m_s2) + 1e-5);
    assert!(truth.needle_force_n > robot.max_force_n && truth.needle_force_n <= most_n + 0.05, "{truth:?}");
    // The tip stands on the slab, whatever the hub did and whatever is asked of it.
    let below_m = |world: &World| -world.truth().tip_in_world.z;
    assert!((below_m(&world) - 0.016).abs() < 1e-6, "{}", below_m(&world));
    let hub_m = truth.depth_m;
    assert!(fed(&mut world, 1000, 0.01).iter().all(|event| event.kind != EventKind::NeedleResumed));
    assert_eq!(world.truth().depth_m, hub_m);
}

fn by_hand(seed: u64) -> Scenario {
    let mut scenario = fixture::scenario();
    scenario.seed = seed;
    scenario.insertion.hand = Some(fixture::hand());
    scenario
}

#[test]
fn a_hand_tells_neither_depth_nor_feed_and_obeys_within_its_reaction_time() {
    for seed in 0..20 {
        let scenario = by_hand(seed);
        let mut world = World::new(&scenario).unwrap();
        assert_eq!(world.acquisition(0).depth_m, None);
        assert_eq!(world.acquisition(0).feed_m_s, None);
        fed(&mut world, 1200, 0.01);
        let asked = world.tick();
        let before_m = world.truth().depth_m;
        fed(&mut world, 1000, 0.0);
        let events_after = fed(&mut world, 1000, 0.0);
        assert!(events_after.is_empty(), "seed {seed}: {events_after:?}");
        // 300 to 600 ms, 14 mm/s at most, and v²/2a at 100 mm/s².
        let travel_m = world.truth().depth_m - before_m;
        let late_s = 0.6 + 1e-3 * (scenario.delays.command_ticks + 40) as f64;
        assert!(travel_m <= 0.014 * late_s + 0.014 * 0.014 / 0.2, "seed {seed}: {travel_m} from {asked}");
        assert_eq!(world.truth().feed_m_s, 0.0);
    }
}

#[test]
fn a_swaying_needle_is_where_the_truth_and_the_picture_both_say() {
    let mut scenario = by_hand(4);
    scenario.insertion.hand.as_mut().unwrap().swing_m = 4e-3;
    let mut world = World::new(&scenario).unwrap();
    let mut straight = World::new(&Scenario {
        insertion: sonoloop_scenario::InsertionSpec { hand: None, ..scenario.insertion },
        ..scenario.clone()
    })
    .unwrap();
    let mut most_m = 0.0f64;
    for _ in 0..200 {
        fed(&mut world, 10, 0.0);
        fed(&mut straight, 10, 0.0);
        let tip = world.slice(0).needle.unwrap().tip_in_phantom();
        assert!((tip - world.truth().tip_in_world).norm() < 1e-12);
        let aside_m = (tip - straight.truth().tip_in_world).norm();
        // 20 mm inside, 130 mm outside: the tip sways by less than a sixth of the hub.
        assert!(aside_m <= 1.42 * (4e-3 + 2e-4) * 20.0 / 130.0, "{aside_m}");
        most_m = most_m.max(aside_m);
    }
    assert!(most_m > 1e-4, "{most_m}");
}
