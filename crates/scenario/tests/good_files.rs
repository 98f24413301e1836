//! The files in the box: all load, carry their schema, and resolve reproducibly.

mod common;

use std::collections::BTreeSet;

use sonoloop_scenario::{
    Bound, DisturbanceKind, FileKind, LoadOptions, METRICS, Scenario, load, load_text, schema,
};
use sonoloop_types::{Guess, Init, Method, SearchPattern, ServoSettings};

fn with_seed(seed: u64) -> LoadOptions {
    LoadOptions { seed: Some(seed), ..LoadOptions::default() }
}

fn with_set(set: &str) -> LoadOptions {
    LoadOptions { set: vec![set.to_owned()], ..LoadOptions::default() }
}

fn recovery(options: &LoadOptions) -> Scenario {
    load(&common::root().join("scenarios/lateral_recovery.yaml"), options)
        .unwrap_or_else(|e| panic!("{}", e.render()))
}

/// Everything of a scenario but where it came from.
fn content(scenario: &Scenario) -> String {
    let mut scenario = scenario.clone();
    scenario.source.clear();
    scenario.resolved_yaml.clear();
    format!("{scenario:?}")
}

#[test]
fn every_scenario_loads_for_many_seeds_and_expects_something() {
    for path in common::files("scenarios", ".yaml") {
        for seed in 0..20 {
            let scenario = load(&path, &with_seed(seed)).unwrap_or_else(|error| panic!("{}", error.render()));
            assert_eq!(scenario.seed, seed);
            assert_eq!(scenario.name, path.file_stem().unwrap().to_string_lossy());
            // Failing is the honest end of some; each says which it expects.
            let bounds = scenario.expect.iter().filter(|e| e.metric == "success").map(|e| &e.bound);
            assert!(bounds.into_iter().all(|bound| matches!(bound, Bound::Is(_))));
            assert!(scenario.expect.iter().any(|e| e.metric == "success"), "{}", path.display());
            assert!(scenario.expect.iter().all(|e| METRICS.contains(&e.metric.as_str())));
        }
    }
}

#[test]
fn every_file_names_its_schema() {
    for folder in ["scenarios", "robots", "phantoms"] {
        for path in common::files(folder, ".yaml") {
            let text = std::fs::read_to_string(&path).unwrap();
            let first = text.lines().next().unwrap();
            let named = first.strip_prefix("# yaml-language-server: $schema=");
            let named = named.unwrap_or_else(|| panic!("{}: first line is {first}", path.display()));
            let target = path.parent().unwrap().join(named);
            assert!(target.is_file(), "{}: no {}", path.display(), target.display());
            // The schema is the one whose keys the file has: no key of it is unknown there.
            let schema: serde_json::Value =
                serde_json::from_str(&std::fs::read_to_string(target).unwrap()).unwrap();
            let known: BTreeSet<_> = schema["properties"].as_object().unwrap().keys().cloned().collect();
            let keys = text.lines().filter(|line| line.starts_with(|c: char| c.is_ascii_lowercase()));
            for key in keys.map(|line| line.split(':').next().unwrap().to_owned()) {
                assert!(known.contains(&key), "{}: {key} is not in {named}", path.display());
            }
        }
    }
}

/// `SONOLOOP_REGENERATE=1 cargo test -p sonoloop-scenario` writes them anew.
#[test]
fn committed_schemas_are_current() {
    let regenerate = std::env::var_os("SONOLOOP_REGENERATE").is_some();
    for kind in FileKind::ALL {
        let path = common::root().join(format!("docs/schema/{}.schema.json", kind.name()));
        let text = serde_json::to_string_pretty(&schema(kind)).unwrap() + "\n";
        if regenerate {
            std::fs::write(&path, &text).unwrap();
        }
        let committed = std::fs::read_to_string(&path).unwrap_or_default();
        assert!(committed == text, "{} is out of date: run with SONOLOOP_REGENERATE=1", path.display());
    }
}

#[test]
fn schema_carries_bounds_and_closes_objects() {
    let scenario = schema(FileKind::Scenario);
    assert_eq!(scenario["additionalProperties"], false);
    let insertion = &scenario["$defs"]["RawInsertion"];
    assert_eq!(insertion["properties"]["angle_deg"]["maximum"], 85.0);
    assert_eq!(insertion["additionalProperties"], false);
}

#[test]
fn truth_units_are_converted_once() {
    let plain = LoadOptions { resolve_randomize: false, ..LoadOptions::default() };
    let scenario = recovery(&plain);
    assert_eq!(scenario.duration_ticks, 40_000);
    assert_eq!(scenario.image_period_ticks, 40);
    assert_eq!(scenario.insertion.start_depth_m, 0.014);
    assert_eq!(scenario.insertion.target_depth_m, 0.062);
    let axis = scenario.insertion.axis_in_world;
    // cos 40° and sin 40° from a table.
    assert!((axis.x - 0.766_044_443_118_978).abs() < 1e-15 && axis.y == 0.0);
    assert!((axis.z + 0.642_787_609_686_539_4).abs() < 1e-15);
    assert_eq!(scenario.probe.centre_frequency_hz, 7.54e6);
    assert!((scenario.probe.aperture_m() - 0.0384).abs() < 1e-12);
    assert_eq!(scenario.needle_robot.watchdog_ticks, 200);
    assert_eq!(scenario.calibration.needle_sigma_rad, 1.0_f64.to_radians());
    assert_eq!(scenario.phantom.materials[0].youngs_modulus_pa, Some(12_500.0));
    assert_eq!(scenario.disturbances.len(), 1);
    assert_eq!(scenario.disturbances[0].tick, 3000);
    match scenario.disturbances[0].kind {
        DisturbanceKind::ProbeKnock { probe_from_slipped, duration_ticks } => {
            assert_eq!(probe_from_slipped.translation.vector.y, 0.003);
            assert_eq!(duration_ticks, 100);
        }
        other => panic!("{other:?}"),
    }
}

#[test]
fn a_profile_gives_way_to_single_settings() {
    let base = recovery(&LoadOptions::default()).tracker;
    let paper = recovery(&with_set("tracker.profile=paper")).tracker;
    assert_eq!(paper.loss_brightness_ratio, None);
    assert_eq!(base.loss_brightness_ratio, Some(0.8));
    assert_eq!(recovery(&with_set("tracker.loss_brightness_ratio=null")).tracker.loss_brightness_ratio, None);
    let set = LoadOptions {
        set: vec!["tracker.profile=paper".into(), "tracker.recovery_ncc=0.9".into()],
        ..LoadOptions::default()
    };
    assert_eq!(recovery(&set).tracker.recovery_ncc, 0.9);
    assert_eq!((base.guess, paper.guess), (Guess::Insertion, Guess::None));
    assert_eq!((base.method, base.init, base.pyramid_levels), (Method::Template, Init::Click, 1));
    assert_eq!(recovery(&with_set("tracker.guess=constant_velocity")).tracker.guess, Guess::ConstantVelocity);
    assert_eq!(recovery(&with_set("tracker.pyramid_levels=3")).tracker.pyramid_levels, 3);
    assert_eq!(recovery(&with_set("tracker.method=baseline")).tracker.method, Method::Baseline);
    assert_eq!(recovery(&with_set("tracker.init=localize")).tracker.init, Init::Localize);
    assert_eq!(recovery(&with_set("servo.elevation_gain=0.8")).servo.elevation_gain_per_s, 0.8);
}

fn plain(options: &LoadOptions) -> Scenario {
    load(&common::root().join("scenarios/lateral_plain.yaml"), options)
        .unwrap_or_else(|e| panic!("{}", e.render()))
}

#[test]
fn a_scenario_that_says_nothing_of_its_servo_has_the_defaults() {
    assert_eq!(plain(&LoadOptions::default()).servo, ServoSettings::default());
    let spiral = plain(&with_set("servo.search=spiral")).servo;
    assert_eq!(spiral, ServoSettings { search: SearchPattern::Spiral, ..ServoSettings::default() });
}

#[test]
fn draws_depend_on_the_seed_alone() {
    let knock = |scenario: &Scenario| match scenario.disturbances[0].kind {
        DisturbanceKind::ProbeKnock { probe_from_slipped, .. } => probe_from_slipped.translation.vector.y,
        other => panic!("{other:?}"),
    };
    assert_eq!(content(&recovery(&with_seed(3))), content(&recovery(&with_seed(3))));
    let all: Vec<Scenario> = (0..20).map(|seed| recovery(&with_seed(seed))).collect();
    let ticks: BTreeSet<_> = all.iter().map(|scenario| scenario.disturbances[0].tick).collect();
    assert!(ticks.len() > 15 && ticks.iter().all(|tick| (2600..=3200).contains(tick)), "{ticks:?}");
    let up = all.iter().filter(|scenario| knock(scenario) == 0.003).count();
    assert!((4..=16).contains(&up), "{up} of 20 knocks go up");
    assert!(all.iter().all(|scenario| knock(scenario).abs() == 0.003));
}

#[test]
fn an_entry_more_shifts_no_other_draw() {
    let text = std::fs::read_to_string(common::root().join("scenarios/lateral_recovery.yaml")).unwrap();
    let path = common::root().join("scenarios/lateral_recovery.yaml");
    let more = text.replace(
        "randomize:\n",
        "randomize:\n  - {key: insertion.bevel_roll_deg, normal: {mean: 0, sigma: 10}}\n",
    );
    let before = load_text(&path, &text, &with_seed(5)).unwrap();
    let after = load_text(&path, &more, &with_seed(5)).unwrap();
    assert_ne!(after.insertion.bevel_roll_rad, 0.0);
    assert_eq!(before.insertion.axis_in_world, after.insertion.axis_in_world);
    assert_eq!(before.disturbances, after.disturbances);
}

/// Whatever a user's own description holds beside its chain: meshes that are nowhere, a wrist without end.
#[test]
fn an_arm_of_ones_own_loads_with_meshes_that_are_not_there() {
    let dir = common::sandbox();
    let own = dir.path().join("elsewhere");
    std::fs::create_dir_all(own.join("description")).unwrap();
    let read = |name: &str| std::fs::read_to_string(dir.path().join("robots/ur5e").join(name)).unwrap();
    let urdf = read("robot.urdf")
        .replace(
            "<cylinder radius=\"0.055\" length=\"0.425\"/>",
            "<mesh filename=\"package://nowhere/arm.stl\"/>",
        )
        .replace("name=\"wrist_3_joint\" type=\"revolute\"", "name=\"wrist_3_joint\" type=\"continuous\"");
    assert!(urdf.contains("nowhere") && urdf.contains("continuous"));
    std::fs::write(own.join("description/own.urdf"), urdf).unwrap();
    let yaml = read("robot.yaml").replace("urdf: robot.urdf", "urdf: description/own.urdf");
    std::fs::write(own.join("own.yaml"), yaml).unwrap();
    let scenario =
        load(&dir.path().join("scenarios/lateral_plain.yaml"), &with_set("robot=../elsewhere/own.yaml"));
    let arm = scenario.unwrap_or_else(|error| panic!("{}", error.render())).arm;
    assert_eq!(arm.joint_names[5], "wrist_3_joint");
    let wrist = arm.urdf.joints.iter().find(|joint| joint.name == "wrist_3_joint").unwrap();
    assert_eq!(wrist.limit.upper, std::f64::consts::TAU, "one turn either way");
}

#[test]
fn what_is_set_is_not_drawn() {
    let scenario = recovery(&with_set("disturbances.0.at_s=1.25"));
    assert_eq!(scenario.disturbances[0].tick, 1250);
    let file = recovery(&LoadOptions::default());
    assert_eq!(scenario.insertion.axis_in_world, file.insertion.axis_in_world);
    let none = recovery(&with_set("randomize=[]"));
    assert_eq!(none.disturbances[0].tick, 3000);
}

#[test]
fn the_file_gives_the_seed_unless_it_is_given() {
    assert_eq!(recovery(&LoadOptions::default()).seed, 0);
    assert_eq!(recovery(&with_set("seed=9")).seed, 9);
    let both = LoadOptions { seed: Some(u64::MAX), set: vec!["seed=9".into()], ..LoadOptions::default() };
    assert_eq!(recovery(&both).seed, u64::MAX);
}

#[test]
fn a_resolved_scenario_loads_as_itself() {
    for path in common::files("scenarios", ".yaml") {
        let options = LoadOptions {
            seed: Some(7),
            set: vec!["servo.elevation_gain=0.8".into()],
            ..LoadOptions::default()
        };
        let first = load(&path, &options).unwrap();
        assert!(!first.resolved_yaml.contains("randomize"), "{}", first.resolved_yaml);
        assert!(first.resolved_yaml.contains("seed: 7"), "{}", first.resolved_yaml);
        let again = load_text(&path, &first.resolved_yaml, &LoadOptions::default()).unwrap();
        assert_eq!(content(&first), content(&again));
        assert_eq!(first.resolved_yaml, again.resolved_yaml);
    }
}
