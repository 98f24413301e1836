//! The committed scenarios, run whole: the bounds they promise, and the trackers that must fail them.

use sonoloop::commands::{Finished, execute_in_process};
use sonoloop::controller::ControllerKind;
use sonoloop::null::Null;
use sonoloop::scenarios::prepare;
use sonoloop_types::EventKind;

mod common;

use common::for_each;

fn run(file: &std::path::Path, seed: Option<u64>, kind: ControllerKind) -> Finished {
    let (scenario, session) = prepare(file, seed, &[]).unwrap_or_else(|e| panic!("{e}"));
    execute_in_process(&scenario, session, kind).unwrap_or_else(|e| panic!("{}: {e}", file.display()))
}

#[test]
fn every_scenario_passes_with_its_own_seed() {
    for_each(&common::scenarios(), |file| {
        let finished = run(file, None, ControllerKind::Tracker);
        let collided = finished.events.iter().find(|event| event.kind == EventKind::Collision);
        assert_eq!(collided, None, "{}", file.display());
        let failed = finished.failed();
        assert!(failed.is_empty(), "{}: {}", file.display(), failed.join(", "));
    });
}

/// The bounds are written out here too, so that loosening the scenario's own `expect` does not hide a loss.
#[test]
fn lateral_recovery_holds_its_bounds_for_seeds_0_to_9() {
    let file = common::file("scenarios/lateral_recovery.yaml");
    let seeds: Vec<u64> = (0..10).collect();
    for_each(&seeds, |&seed| {
        let finished = run(&file, Some(seed), ControllerKind::Tracker);
        let metrics = serde_json::to_value(finished.summary.metrics).expect("plain data");
        let metric =
            |name: &str| metrics[name].as_f64().unwrap_or_else(|| panic!("seed {seed}: {name} has no value"));
        let failed = finished.failed();
        assert!(finished.passed(), "seed {seed}: {}", failed.join(", "));
        assert!(metric("losses") >= 1.0, "seed {seed}");
        assert!(metric("recoveries") >= 1.0, "seed {seed}");
        assert!(metric("coverage") >= 0.9, "seed {seed}: coverage {}", metric("coverage"));
        assert!(metric("false_recoveries") == 0.0, "seed {seed}");
        assert!(metric("silent_loss_s") <= 0.5, "seed {seed}: silent {}", metric("silent_loss_s"));
        assert!(metric("tip_rmse_mm") <= 0.5, "seed {seed}: rmse {}", metric("tip_rmse_mm"));
        assert!(metric("travel_after_loss_mm") <= 3.0, "seed {seed}: {}", metric("travel_after_loss_mm"));
        assert_eq!(metrics["success"], true, "seed {seed}");
    });
}

/// With these seeds the tip was once lost for good, as the tracker stayed with a candidate that the servo refused, or a bead of the bent
/// shaft was believed.
#[test]
fn wires_and_beads_of_the_shaft_are_told_from_the_tip() {
    let cases = [("lateral_05", [4, 15, 16]), ("lateral_02", [6, 22, 31])];
    let cases: Vec<_> = cases.into_iter().flat_map(|(name, seeds)| seeds.map(|seed| (name, seed))).collect();
    for_each(&cases, |&(name, seed)| {
        let finished = run_file_with(&format!("scenarios/paper/{name}.yaml"), seed, &[]);
        assert!(finished.passed(), "{name}, seed {seed}: {}", finished.failed().join(", "));
        assert_eq!(finished.summary.metrics.false_recoveries, 0, "{name}, seed {seed}");
    });
}

/// Another make, another wrist, another inverse kinematics: the arm changes and nothing else.
#[test]
fn an_arm_without_a_spherical_wrist_carries_both_lateral_scenarios() {
    let cases: Vec<_> = ["scenarios/lateral_plain.yaml", "scenarios/lateral_recovery.yaml"]
        .into_iter()
        .flat_map(|file| (0..5).map(move |seed| (file, seed)))
        .collect();
    for_each(&cases, |&(file, seed)| {
        let finished = run_file_with(file, seed, &["robot=../robots/ur5e/robot.yaml"]);
        assert!(finished.passed(), "{file}, seed {seed}: {}", finished.failed().join(", "));
    });
}

fn run_with(seed: u64, set: &[&str]) -> Finished {
    run_file_with("scenarios/lateral_plain.yaml", seed, set)
}

fn run_file_with(file: &str, seed: u64, set: &[&str]) -> Finished {
    let (file, set) = (common::file(file), set.iter().map(|&set| set.to_owned()).collect::<Vec<_>>());
    let (scenario, session) = prepare(&file, Some(seed), &set).unwrap_or_else(|e| panic!("{e}"));
    execute_in_process(&scenario, session, ControllerKind::Tracker).unwrap_or_else(|e| panic!("{set:?}: {e}"))
}

/// Without the operator's click the tip is the end of the needle that is found, which is now and then a millimetre beyond it:
/// of seeds 0 to 39, some of them over agar, 23 passed when pictures changed last (29 with the speckle before). So a set of a few seeds tells little: of
/// five three had to pass, and with this speckle two did.
#[test]
fn a_tracker_that_finds_the_first_tip_itself_reaches_the_target() {
    let passed = std::sync::atomic::AtomicU32::new(0);
    for_each(&Vec::from_iter(0..12), |&seed| {
        let finished = run_with(seed, &["tracker.init=localize"]);
        let metrics = &finished.summary.metrics;
        assert!(metrics.images > 50, "seed {seed}: it starts without a click");
        if finished.passed() {
            assert!(metrics.coverage.is_some_and(|coverage| coverage >= 0.9), "seed {seed}");
            passed.fetch_add(1, std::sync::atomic::Ordering::Relaxed);
        }
    });
    // At 23 of 40 fewer do with one set in forty.
    let passed = passed.into_inner();
    assert!(passed >= 4, "{passed} of 12");
}

/// The earlier method says TRACKING whatever it sees, is most of a millimetre off (it fails the scenario's 0.5 mm), and comes
/// to the target where nothing goes wrong. Over agar, which the scenario draws too and whose speckle is brighter, it does not
/// with two seeds of ten (2 and 8).
#[test]
fn the_earlier_method_steers_a_plain_insertion_less_exactly() {
    for_each(&[0, 1, 2, 3, 4], |&seed| {
        let [template, baseline] =
            ["template", "baseline"].map(|method| format!("tracker.method={method}")).map(|method| {
                run_with(seed, &[&method, "phantom=../phantoms/gelatin_agar.yaml"]).summary.metrics
            });
        assert!(
            baseline.coverage.is_some_and(|coverage| coverage >= 0.9),
            "seed {seed}: {:?}",
            baseline.coverage
        );
        assert!(
            baseline.final_target_distance_mm.is_some_and(|distance_mm| distance_mm <= 2.0),
            "seed {seed}"
        );
        let [template, baseline] = [template, baseline].map(|m| m.tip_rmse_mm.expect("a tip was tracked"));
        assert!(baseline > template && baseline < 1.5, "seed {seed}: {baseline} mm, templates {template} mm");
    });
}

/// Killed in mid-insertion: the needle stops by itself while nobody commands it, and goes on when the tracker is back.
#[test]
fn a_killed_tracker_stops_the_needle_until_it_is_back() {
    let folder = tempfile::tempdir().expect("temporary folder");
    let out = folder.path().to_str().expect("plain path");
    let finished = common::sonoloop(&["run", "scenarios/faults/tracker_killed.yaml", "--json", "--out", out]);
    assert_eq!(finished.code(), 0, "{}", finished.stderr);
    let events = std::fs::read_to_string(folder.path().join("events.csv")).expect("events.csv");
    let mut rest = events.as_str();
    for kind in ["tracker_killed", "watchdog", "needle_stopped", "tracker_restarted", "needle_resumed", "end"]
    {
        let (_, after) =
            rest.split_once(kind).unwrap_or_else(|| panic!("{kind} is missing or early:\n{events}"));
        rest = after;
    }
    assert!(events.contains("target_reached"), "{events}");
}

/// The needle is safe by itself while nobody answers, or nothing that makes sense, and goes on afterwards.
#[test]
fn a_tracker_that_hangs_or_sends_garbage_stops_the_needle_until_it_is_sound_again() {
    for (fault, begins) in [("tracker_hung", "hangs"), ("tracker_garbage", "garbage")] {
        let file = common::file(&format!("scenarios/faults/{fault}.yaml"));
        let finished = run(&file, Some(0), ControllerKind::Tracker);
        assert!(finished.passed(), "{fault}: {}", finished.failed().join(", "));
        let events = &finished.events;
        let at = |kind| events.iter().find(|event| event.kind == kind).map(|event| event.tick);
        let began = events.iter().find(|event| event.detail.contains(begins)).expect(begins).tick;
        let watchdog = at(EventKind::Watchdog).expect("the watchdog");
        let stopped = at(EventKind::NeedleStopped).expect("a stop");
        let resumed = at(EventKind::NeedleResumed).expect("it goes on");
        // The last sound command came up to one image before; from 10 mm/s at 100 mm/s² the needle brakes for 100 ms.
        assert!((began + 160..=began + 202).contains(&watchdog), "{fault}: {began}, {watchdog}");
        assert!(stopped <= watchdog + 101 && stopped < resumed, "{fault}: {stopped}, {resumed}");
        let refused = events.iter().filter(|event| event.kind == EventKind::CommandRefused);
        let expected = if fault == "tracker_hung" { 0..=0 } else { 10..=51 };
        assert!(expected.contains(&refused.count()), "{fault}");
    }
}

/// A scenario that a tracker passes without looking at the picture tests nothing.
#[test]
fn the_null_trackers_fail_every_scenario() {
    let cases: Vec<_> = common::scenarios()
        .into_iter()
        // Those of `scenarios/paper` end at an image of their own: tests/paper.rs.
        .filter(|file| !file.parent().is_some_and(|folder| folder.ends_with("paper")))
        .flat_map(|file| Null::ALL.into_iter().map(move |(name, null)| (file.clone(), name, null)))
        .collect();
    // A seed each, not the same everywhere: over all scenarios every tracker meets some twenty draws. Time enough for every
    // insertion and disturbance; whoever stands still after that stands for the rest.
    let cases: Vec<_> = (0..).zip(cases).collect();
    for_each(&cases, |(seed, (file, name, null))| {
        let (scenario, session) = prepare(file, Some(*seed), &["duration_s=15".to_owned()])
            .unwrap_or_else(|e| panic!("{}: {e}", file.display()));
        let finished = execute_in_process(&scenario, session, ControllerKind::Null(*null))
            .unwrap_or_else(|e| panic!("{}: {e}", file.display()));
        assert!(!finished.passed(), "{name} passes {} with seed {seed}", file.display());
    });
}
