//! Same scenario and seed, same bytes: run against run, one process against two, any number of threads.

use std::path::Path;

mod common;
use common::{finish, program, sonoloop, start};

fn images_csv(out: &Path) -> String {
    let text = std::fs::read_to_string(out.join("images.csv")).expect("images.csv");
    assert!(text.lines().count() > 100, "a run has more than a hundred images");
    text
}

/// Names the first line that differs, which is what one needs to find the cause.
fn assert_same(a: &str, b: &str, what: &str) {
    for (k, (left, right)) in a.lines().zip(b.lines()).enumerate() {
        assert_eq!(left, right, "{what}: first difference in line {}", k + 1);
    }
    assert_eq!(a.lines().count(), b.lines().count(), "{what}: different length");
}

fn compare(scenario: &str) {
    let folder = tempfile::tempdir().expect("temporary folder");
    let out = |name: &str| folder.path().join(name);
    let run = |name: &str, extra: &[&str], threads: Option<&str>| {
        let mut command = program();
        command.args(["run", scenario, "--json", "--out"]).arg(out(name)).args(extra);
        if let Some(threads) = threads {
            command.env("RAYON_NUM_THREADS", threads);
        }
        let finished = finish(start(command));
        assert!(finished.code() < 2, "{}", finished.stderr);
        images_csv(&out(name))
    };
    let first = run("first", &[], None);
    assert_same(&first, &run("second", &[], Some("1")), "second run, one thread");
    assert_same(&first, &run("third", &["--in-process"], Some("3")), "in process, three threads");
    let resolved = out("first").join("scenario.yaml");
    let resolved = resolved.to_str().expect("plain path");
    let again = out("again");
    let finished =
        sonoloop(&["run", resolved, "--in-process", "--json", "--out", again.to_str().expect("path")]);
    assert!(finished.code() < 2, "{}", finished.stderr);
    assert_same(&first, &images_csv(&again), "the scenario that the run has written");
}

#[test]
fn lateral_recovery_gives_the_same_bytes_however_it_is_run() {
    compare("scenarios/lateral_recovery.yaml");
}

#[test]
fn a_killed_tracker_gives_the_same_bytes_however_it_is_run() {
    compare("scenarios/faults/tracker_killed.yaml");
}

/// Where nothing but who answers can differ: two processes against one.
#[test]
fn faults_give_the_same_bytes_with_and_without_a_wire() {
    for fault in ["tracker_hung", "tracker_garbage", "frozen_images", "dropped_images"] {
        let folder = tempfile::tempdir().expect("temporary folder");
        let scenario = format!("scenarios/faults/{fault}.yaml");
        let [two, one] = [&[][..], &["--in-process"]].map(|extra: &[&str]| {
            let out = folder.path().join(format!("{}", extra.len()));
            let mut command = program();
            command.args(["run", &scenario, "--json", "--seed", "1", "--out"]).arg(&out).args(extra);
            let finished = finish(start(command));
            assert!(finished.code() < 2, "{fault}: {}", finished.stderr);
            let read = |name: &str| std::fs::read_to_string(out.join(name)).expect(name);
            let (images, events) = (read("images.csv"), read("events.csv"));
            assert!(
                images.lines().count() > 60,
                "{fault}: with half of them lost there are still so many images"
            );
            (images, events)
        });
        assert_same(&two.0, &one.0, fault);
        assert_same(&two.1, &one.1, fault);
    }
}

#[test]
fn another_seed_gives_other_bytes() {
    let folder = tempfile::tempdir().expect("temporary folder");
    let run = |seed: &str| {
        let out = folder.path().join(seed);
        let out_text = out.to_str().expect("path");
        let finished = sonoloop(&[
            "run",
            "scenarios/lateral_plain.yaml",
            "--in-process",
            "--json",
            "--seed",
            seed,
            "--out",
            out_text,
        ]);
        assert!(finished.code() < 2, "{}", finished.stderr);
        images_csv(&out)
    };
    assert_ne!(run("1"), run("2"));
}
