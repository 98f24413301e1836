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

/// Two of the sequences with all that is made of their pictures; links stand for the files that scenarios name.
#[test]
fn report_and_data_of_two_sequences() {
    let folder = tempfile::tempdir().expect("temporary folder");
    let scenarios = folder.path().join("scenarios/paper");
    std::fs::create_dir_all(&scenarios).expect("folder");
    for name in ["robots", "phantoms"] {
        std::os::unix::fs::symlink(common::file(name), folder.path().join(name)).expect("link");
    }
    for name in ["lateral_05.yaml", "lateral_14.yaml"] {
        std::fs::copy(common::file("scenarios/paper").join(name), scenarios.join(name)).expect("copy");
    }
    let out = folder.path().join("out");
    let [out_text, scenarios_text] = [&out, &scenarios].map(|path| path.to_str().expect("plain path"));
    let finished = common::sonoloop(&["paper", "--out", out_text, "--scenarios", scenarios_text]);
    assert_eq!(finished.code(), 0, "{}", finished.stderr);
    assert!(finished.stdout.contains("2 of 2 sequences pass"), "{}", finished.stdout);

    let read = |name: &str| {
        std::fs::read_to_string(out.join(name)).unwrap_or_else(|error| panic!("{name}: {error}"))
    };
    let report = read("report.html");
    for part in
        ["Results", "Fig. 1", "Fig. 2", "Figs 5 and 6", "Table I", "earlier methods", "Not for clinical use"]
    {
        assert!(report.contains(part), "{part}");
    }
    // Outside scripts, which may well speak of NaN, and pictures, whose base64 may.
    let told =
        report.split("<script").map(|part| part.split_once("</script>").map_or(part, |(_, told)| told));
    assert!(
        told.into_iter().all(|part| !part.contains(">NaN") && !part.contains(" NaN")),
        "a number without a value is told as such"
    );
    // Rows below the head: a shift each of both templates and three measures; two profiles, three strategies, 320 images;
    // one per image; two templates, two similarities, two orders; two methods.
    let rows = |name: &str| read(name).lines().count() - 1;
    assert_eq!(rows("sequences.csv"), 2);
    assert_eq!(rows("fig1_surfaces.csv"), 2 * 3 * 41 * 41);
    assert_eq!(rows("fig2_updates.csv"), 2 * 3 * 320);
    assert_eq!(rows("fig6_ncc.csv"), 300);
    assert_eq!(rows("images_lateral_05.csv"), 300);
    assert_eq!(rows("table1_timing.csv"), 8);
    assert_eq!(rows("earlier_methods.csv"), 4);
}
