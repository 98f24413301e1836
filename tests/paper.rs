//! The paper's twenty sequences: what they cover, how many images they have, and that none passes unseen.

use std::collections::BTreeSet;
use std::path::PathBuf;

use sonoloop::commands::execute_in_process;
use sonoloop::controller::ControllerKind;
use sonoloop::null::Null;
use sonoloop::scenarios::prepare;
use sonoloop_scenario::{DisturbanceKind, LoadOptions, Scenario};
use sonoloop_types::View;

mod common;

fn files() -> Vec<PathBuf> {
    let folder = common::file("scenarios/paper");
    common::scenarios().into_iter().filter(|file| file.starts_with(&folder)).collect()
}

fn sequences() -> Vec<Scenario> {
    let load = |file: &PathBuf| {
        sonoloop_scenario::load(file, &LoadOptions::default()).unwrap_or_else(|e| panic!("{e}"))
    };
    files().iter().map(load).collect()
}

#[test]
fn sixteen_lateral_and_four_transverse_sequences_have_7074_images() {
    let sequences = sequences();
    let lateral = sequences.iter().filter(|s| s.view == View::Lateral).count();
    assert_eq!((lateral, sequences.len() - lateral), (16, 4));
    let images = sequences.iter().map(|s| s.images.unwrap_or_else(|| panic!("{} ends by itself", s.name)));
    assert_eq!(images.sum::<u64>(), 7074);
    assert!(sequences.iter().all(|s| s.probe.geometry.width_px == 640 && s.probe.geometry.height_px == 480));
}

#[test]
fn media_needles_insertions_and_disturbances_of_the_paper_are_all_there() {
    let sequences = sequences();
    let media: BTreeSet<_> = sequences
        .iter()
        .map(|s| s.phantom.materials[usize::from(s.phantom.background)].name.as_str())
        .collect();
    let five = ["agar", "ethanol_water", "gelatin", "gelatin_agar", "water"];
    assert_eq!(media, BTreeSet::from(five));
    let needles: BTreeSet<_> = sequences.iter().map(|s| s.needle.name.as_str()).collect();
    assert_eq!(needles, BTreeSet::from(["12G × 260 mm", "22G × 150 mm"]));
    let by_hand = sequences.iter().filter(|s| s.insertion.hand.is_some()).count();
    assert!(by_hand >= 4, "{by_hand}");
    // The robot's speed, where there is a robot.
    assert!(sequences.iter().all(|s| s.servo.feed_m_s == 10e-3));
    let with = |what: fn(&DisturbanceKind) -> bool| {
        sequences.iter().filter(|s| s.disturbances.iter().any(|d| what(&d.kind))).count()
    };
    let misaligned = |kind: &DisturbanceKind| {
        matches!(kind, DisturbanceKind::ProbeKnock { .. } | DisturbanceKind::LiftOff { .. })
    };
    let intensity = |kind: &DisturbanceKind| {
        matches!(kind, DisturbanceKind::GainChange { .. } | DisturbanceKind::NeedleBrightness { .. })
    };
    assert!(with(misaligned) >= 8 && with(intensity) >= 4);
    assert!(
        sequences.iter().filter(|s| s.phantom.inclusions.len() > 1).count() >= 4,
        "heterogeneous phantoms"
    );
}

#[test]
fn nothing_is_tuned_per_sequence() {
    let sequences = sequences();
    for view in [View::Lateral, View::Transverse] {
        let mut settings = sequences.iter().filter(|s| s.view == view).map(|s| s.tracker);
        let first = settings.next().expect("a sequence");
        assert!(settings.all(|other| other == first), "{view:?}");
    }
}

/// Sixty images, in which the needle goes up to 24 mm, are enough to tell: a tip off by more than 0.6 mm, or none.
#[test]
fn the_null_trackers_fail_every_sequence_by_what_they_say() {
    let cases: Vec<_> = files()
        .into_iter()
        .flat_map(|file| Null::ALL.map(|(name, null)| (file.clone(), name, null)))
        .collect();
    let cases: Vec<_> = (0..).zip(cases).collect();
    common::for_each(&cases, |(seed, (file, name, null))| {
        let (scenario, session) =
            prepare(file, Some(*seed), &["images=60".to_owned()]).unwrap_or_else(|e| panic!("{e}"));
        let finished = execute_in_process(&scenario, session, ControllerKind::Null(*null))
            .unwrap_or_else(|e| panic!("{}: {e}", file.display()));
        assert_eq!(finished.summary.metrics.images, 60);
        let told = ["tip_rmse_mm", "coverage", "silent_loss_s"];
        let failed = finished.summary.expectations.iter().filter(|e| !e.pass);
        let failed: Vec<_> =
            failed.map(|e| e.metric.as_str()).filter(|metric| told.contains(metric)).collect();
        assert!(!failed.is_empty(), "{name} is not told on {} with seed {seed}", file.display());
    });
}
