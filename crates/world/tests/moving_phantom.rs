//! Tissue that gives way, and a phantom that moves.

#[path = "../src/fixture.rs"]
mod fixture;

use fixture::scenario;
use sonoloop_scenario::{Disturbance, DisturbanceKind, PhantomMotion, Scenario};
use sonoloop_types::{Estimate, Point, Reason, TrackState, Truth, Vector};
use sonoloop_world::World;

fn moving(motion: PhantomMotion) -> Scenario {
    let mut scenario = scenario();
    scenario.disturbances = vec![Disturbance { tick: 100, kind: DisturbanceKind::PhantomMoves(motion) }];
    scenario
}

/// Truth at every tick; the needle is fed after each picture.
fn run(scenario: &Scenario, ticks: u64, feed_m_s: f64) -> (World, Vec<Truth>) {
    let mut world = World::new(scenario).unwrap();
    let mut truths = vec![world.truth()];
    for tick in 0..ticks {
        if tick % scenario.image_period_ticks == 0 {
            let image = world.acquisition(tick / scenario.image_period_ticks);
            world.note_published(&image);
            world.submit(&sonoloop_types::Command {
                answers: image.sequence,
                estimate: Estimate::bare(TrackState::Tracking, Reason::Ok, None),
                target_base_from_probe: None,
                feed_m_s,
                compute_us: 0.0,
            });
        }
        world.step();
        truths.push(world.truth());
    }
    (world, truths)
}

#[test]
fn force_control_follows_a_breath_with_the_lag_of_a_first_order_loop() {
    let period_ticks = 4000;
    let reach_m = Vector::z() * 3e-3;
    let breathing = PhantomMotion::Breathing { reach_m, period_ticks, phase_rad: 0.0 };
    let scenario = moving(breathing);
    let set_n = scenario.placement.contact_force_n;
    let (_, truths) = run(&scenario, 12_100, 0.0);
    // Amplitude of the force at the breath's frequency, over two breaths; its mean is the set force.
    let settled = &truths[4100..12_100];
    let sum = |weight: fn(f64) -> f64| -> f64 {
        let turns = settled.iter().map(|t| std::f64::consts::TAU * t.tick as f64 / period_ticks as f64);
        let weighted = turns.zip(settled).map(|(turns, t)| weight(turns) * t.contact_force_n);
        weighted.sum::<f64>() / settled.len() as f64
    };
    let is = 2.0 * sum(f64::cos).hypot(sum(f64::sin));
    assert!((sum(|_| 1.0) - set_n).abs() < 0.01 * set_n);
    // A sine of amplitude A and rate w under ẋ = (F_set − F)/(kτ) leaves k·A·wτ/√(1 + w²τ²) of force, τ = 0.15 s.
    let stiffness = {
        let press = World::new(&scenario).unwrap().slice(0).indentation.unwrap();
        // 0.91 of the press are left at the face's middle, see Contact::indentation.
        set_n / (press.depth_m * press.lengthwise(0.0) * press.crosswise(0.0)[0])
    };
    let w_tau = std::f64::consts::TAU / 4.0 * 0.15;
    let expected = stiffness * 1.5e-3 * w_tau / (1.0 + w_tau * w_tau).sqrt();
    assert!((is / expected - 1.0).abs() < 0.03, "{is} N, expected {expected} N");
    // What comes on top: where the planner finds no plan to a moving set point (see `motion`) the arm brakes for one control
    // step, which shows in the damping.
    let most = settled.iter().map(|t| (t.contact_force_n - set_n).abs()).fold(0.0, f64::max);
    assert!(most < 1.2 * expected, "{most} N");
}

#[test]
fn a_phantom_that_steps_carries_the_needle_across_and_slides_along_it() {
    let shift_m = Vector::new(1e-3, 2e-3, -1e-3);
    let (_, truths) = run(&moving(PhantomMotion::Step { shift_m, duration_ticks: 200 }), 600, 0.0);
    let (before, after) = (truths[100], truths[600]);
    let moved = after.tip_in_world - before.tip_in_world;
    // The tip moves as the tissue does, but not along the needle: up to a curvature of 0.5 /m over 1 mm.
    let axis = scenario().insertion.axis_in_world;
    let across = |v: Vector| v - axis * axis.dot(&v);
    assert!((across(moved) - across(shift_m)).norm() < 0.05e-3, "{moved}");
    assert!(axis.dot(&moved).abs() < 0.05e-3, "{moved}");
    assert_eq!(after.depth_m, before.depth_m);
    assert_eq!(after.feed_m_s, 0.0);
}

#[test]
fn the_probe_stays_on_a_phantom_that_sinks_and_the_picture_keeps_its_tissue() {
    let drift = PhantomMotion::Drift { velocity_m_s: Vector::z() * -1e-3, duration_ticks: 4000 };
    let (world, truths) = run(&moving(drift), 5000, 0.0);
    let set_n = scenario().placement.contact_force_n;
    assert!(truths[4500..].iter().all(|t| (t.contact_force_n - set_n).abs() < 0.1 * set_n));
    let (start, end) = (World::new(&scenario()).unwrap().slice(0), world.slice(1));
    let sunk = end.phantom_from_probe.translation.vector - start.phantom_from_probe.translation.vector;
    assert!(sunk.norm() < 0.1e-3, "{sunk}");
    // The needle stands in the world while the tissue sinks along it by 4 mm · sin of the angle.
    let tip = |slice: &sonoloop_types::Slice| slice.needle.as_ref().unwrap().tip_in_phantom();
    let axis = scenario().insertion.axis_in_world;
    let slid = (tip(&end) - tip(&start)).dot(&axis);
    assert!((slid - -4e-3 * -axis.z).abs() < 0.05e-3, "{slid}");
}

#[test]
fn tissue_gives_way_under_the_probe_and_the_target_with_it() {
    let mut soft = scenario();
    soft.placement.contact_force_n = 2.0;
    let world = World::new(&soft).unwrap();
    let slice = world.slice(0);
    let press = slice.indentation.expect("pressed with 2 N");
    assert!(press.is_sound());
    // The top face lies where the probe's face is.
    let face = Point::from(slice.phantom_from_probe.translation.vector);
    let top = Point::new(face.x, face.y, 0.0);
    assert!(((top + press.displacement_m(top)).z - face.z).abs() < 1e-6);
    // Lifted off, the target is where it was before the press.
    soft.insertion.start_depth_m = soft.insertion.target_depth_m - 1e-6;
    soft.disturbances = vec![Disturbance {
        tick: 1,
        kind: DisturbanceKind::LiftOff { height_m: 5e-3, duration_ticks: 2000 },
    }];
    let (world, truths) = run(&soft, 1500, 0.0);
    assert_eq!(world.slice(1).indentation, None);
    assert!(truths[0].target_distance_m < 2e-6);
    let press = World::new(&soft).unwrap().slice(0).indentation.unwrap();
    let rest = press.rest(truths[0].tip_in_world);
    let moved_m = press.displacement_m(rest).norm();
    assert!(moved_m > 0.2e-3 && (truths[1500].target_distance_m - moved_m).abs() < 2e-6, "{moved_m}");
}
