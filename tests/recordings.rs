//! A run's folder, read back: `sonoloop report` and `sonoloop replay`.

use std::fs;
use std::path::{Path, PathBuf};

mod common;
use common::{Finished, program, sonoloop};

/// A run's folder that a test may spoil.
struct Run {
    folder: tempfile::TempDir,
}

impl Run {
    /// What `run` leaves of a scenario.
    fn new(scenario: &str, arguments: &[&str]) -> Self {
        let run = Self { folder: tempfile::tempdir().expect("temporary folder") };
        let out = run.text();
        let run_it = ["run", scenario, "--json", "--out", &out];
        let finished = sonoloop(&[&run_it, arguments].concat());
        assert!(finished.code() < 2, "{}", finished.stderr);
        run
    }

    /// Fifty images, two seconds.
    fn plain() -> Self {
        Self::plain_with(&["--in-process"])
    }

    fn plain_with(arguments: &[&str]) -> Self {
        Self::new("scenarios/lateral_plain.yaml", &[&["--set", "duration_s=2"], arguments].concat())
    }

    fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join("out").join(name)
    }

    fn text(&self) -> String {
        self.path("").to_str().expect("plain path").to_owned()
    }

    fn read(&self, name: &str) -> String {
        fs::read_to_string(self.path(name)).expect("text")
    }

    fn edit(&self, name: &str, from: &str, to: &str) {
        let text = self.read(name);
        assert!(text.contains(from), "{name} holds no {from:?}");
        fs::write(self.path(name), text.replacen(from, to, 1)).expect("write");
    }

    fn report(&self) -> Finished {
        sonoloop(&["report", &self.text()])
    }

    fn replay(&self) -> Finished {
        sonoloop(&["replay", &self.text()])
    }

    fn assert_replays(&self) {
        let replayed = self.replay();
        assert_eq!(replayed.code(), 0, "{}{}", replayed.stdout, replayed.stderr);
        let images = self.read("images.csv").lines().count() - 1;
        assert!(replayed.stdout.starts_with(&format!("{images} images and ")), "{}", replayed.stdout);
        assert!(replayed.stdout.ends_with(" events, all the same\n"), "{}", replayed.stdout);
    }
}

fn assert_bad_input(finished: &Finished, parts: &[&str]) {
    assert_eq!(finished.code(), 2, "{}{}", finished.stdout, finished.stderr);
    assert_eq!(finished.stdout, "");
    for part in parts {
        assert!(finished.stderr.contains(part), "no {part:?} in {}", finished.stderr);
    }
}

#[test]
fn a_report_has_every_part_and_needs_nothing_beside_it() {
    let run = Run::plain();
    let page = run.read("report.html");
    assert!(page.len() < 15_000_000, "{} bytes", page.len());
    let parts = [
        "Metrics",
        "The run in pictures",
        "Over time",
        "Events",
        "Timing",
        "What the numbers rest on",
        "Scenario as resolved",
    ];
    for part in parts {
        assert!(page.contains(&format!("<h2>{part}</h2>")), "{part}");
    }
    assert!(page.contains("Not for clinical use."));
    for outside in
        ["src=\"http", "href=\"http", "<script src", "rel=\"stylesheet\"", "url(", "@import", "fetch("]
    {
        assert!(!page.contains(outside), "{outside}");
    }
    let data = page.split("<script type=\"application/json\">").nth(1).expect("charts");
    let data = data.split("</script>").next().expect("their end");
    let data: serde_json::Value = serde_json::from_str(data).expect("JSON");
    assert_eq!(data["x"].as_array().expect("times").len(), 50);
    assert_eq!(data["pictures"]["pictures"].as_array().expect("pictures").len(), 50);
    let titles: Vec<&str> = data["panels"]
        .as_array()
        .expect("panels")
        .iter()
        .filter_map(|panel| panel["title"].as_str())
        .collect();
    for title in ["NCC", "Tip error, mm", "Plane to tip, mm", "Contact force, N", "Insertion depth, mm"] {
        assert!(titles.contains(&title), "{title} in {titles:?}");
    }
}

#[test]
fn a_report_is_made_again_from_the_files_alone_wherever_they_lie() {
    let run = Run::plain();
    let page = run.read("report.html");
    fs::remove_file(run.path("report.html")).expect("removed");
    assert_eq!(run.report().code(), 0);
    assert!(run.read("report.html") == page, "the same bytes");

    let moved = tempfile::tempdir().expect("temporary folder");
    for name in ["summary.json", "images.csv", "events.csv", "scenario.yaml", "pictures.mjpeg"] {
        fs::copy(run.path(name), moved.path().join(name)).expect("copy");
    }
    let moved_text = moved.path().to_str().expect("plain path");
    assert_eq!(sonoloop(&["report", moved_text]).code(), 0);
    let mut names: Vec<_> =
        fs::read_dir(moved.path()).expect("folder").map(|e| e.expect("entry").file_name()).collect();
    names.sort();
    assert_eq!(
        names,
        ["events.csv", "images.csv", "pictures.mjpeg", "report.html", "scenario.yaml", "summary.json"],
        "and nothing is left beside them"
    );

    fs::remove_file(moved.path().join("pictures.mjpeg")).expect("removed");
    assert_eq!(sonoloop(&["report", moved_text]).code(), 0);
    let page = fs::read_to_string(moved.path().join("report.html")).expect("page");
    assert!(page.contains("There are no pictures on this page, because there is no pictures.mjpeg"));
    assert!(!page.contains("<image ") && page.contains("\"pictures\": null"));
}

#[test]
fn a_run_replays_whoever_of_this_program_tracked_it() {
    Run::new("scenarios/lateral_recovery.yaml", &["--seed", "5"]).assert_replays();
    Run::plain_with(&["--tracker", "dead-reckoning"]).assert_replays();
    Run::plain_with(&["--tracker", "none"]).assert_replays();
    let own = format!("{} track", env!("CARGO_BIN_EXE_sonoloop"));
    Run::plain_with(&["--tracker", &own]).assert_replays();
    Run::new("scenarios/faults/tracker_killed.yaml", &[]).assert_replays();
}

#[test]
fn the_first_difference_is_named_with_both_values() {
    let run = Run::plain();
    let line = run.read("images.csv").lines().nth(31).expect("a row").to_owned();
    let hash = line.split(',').nth(3).expect("a hash").to_owned();
    run.edit("images.csv", &hash, "0123456789abcdef");
    let replayed = run.replay();
    assert_eq!(replayed.code(), 1, "{}", replayed.stderr);
    let expected =
        format!("differs: image 30, tick 1200, image_hash: recorded 0123456789abcdef, now {hash}\n");
    assert_eq!(replayed.stdout, expected);

    run.edit("images.csv", "0123456789abcdef", &hash);
    run.edit("events.csv", "tracking: ok, image 0", "tracking: ok, image 1");
    let replayed = run.replay();
    assert_eq!(replayed.code(), 1, "{}", replayed.stderr);
    assert!(replayed.stdout.starts_with("differs: event 1 "), "{}", replayed.stdout);
    assert!(replayed.stdout.contains("recorded tick 0, state_change, \"tracking: ok, image 1\"; now tick 0"));

    // Another seed in the scenario's file is another run from the first image on.
    run.edit("scenario.yaml", "seed: 0", "seed: 1");
    let replayed = run.replay();
    assert_eq!(replayed.code(), 1, "{}", replayed.stderr);
    assert!(replayed.stdout.starts_with("differs: image 0, tick 0, image_hash: "), "{}", replayed.stdout);
}

#[test]
fn what_cannot_be_compared_is_refused_with_the_reason() {
    let paced = Run::plain_with(&["--realtime"]);
    assert_bad_input(&paced.replay(), &["not comparable", "paced by the clock"]);
    assert_eq!(paced.report().code(), 0);

    let run = Run::plain();
    let summary = run.read("summary.json");
    run.edit("summary.json", "\"name\": \"sonoloop\"", "\"name\": \"my tracker\"");
    assert_bad_input(&run.replay(), &["not comparable", "another tracker (my tracker 0"]);
    fs::write(run.path("summary.json"), &summary).expect("write");
    run.edit("summary.json", "\"end\": \"time_over\"", "\"end\": \"interrupted\"");
    assert_bad_input(&run.replay(), &["not comparable", "ended early (interrupted)"]);

    // Another version is no reason to refuse, but one to say.
    let own = env!("CARGO_PKG_VERSION");
    fs::write(
        run.path("summary.json"),
        summary.replace(&format!("\"version\": \"{own}\""), "\"version\": \"0.0.1\""),
    )
    .expect("write");
    let replayed = run.replay();
    assert_eq!(replayed.code(), 0, "{}{}", replayed.stdout, replayed.stderr);
    assert!(
        replayed.stderr.contains(&format!("recorded by sonoloop 0.0.1, run again by {own}")),
        "{}",
        replayed.stderr
    );
}

#[test]
fn a_missing_or_damaged_file_is_named() {
    let run = Run::plain();
    let nowhere = run.path("nowhere");
    for command in ["report", "replay"] {
        assert_bad_input(
            &sonoloop(&[command, nowhere.to_str().expect("path")]),
            &["nowhere", "summary.json"],
        );
    }
    let page = run.read("report.html");
    let spoiled = |name: &str, spoil: &dyn Fn(&Path), commands: &[&str], parts: &[&str]| {
        let good = fs::read(run.path(name)).expect("file");
        spoil(&run.path(name));
        for command in commands {
            assert_bad_input(&sonoloop(&[command, &run.text()]), &[&[name], parts].concat());
        }
        fs::write(run.path(name), good).expect("write");
    };
    let both = ["report", "replay"];
    for name in ["summary.json", "images.csv", "events.csv", "scenario.yaml"] {
        let missing = |path: &Path| fs::remove_file(path).expect("removed");
        spoiled(name, &missing, &both, &["o such file"]);
    }
    let cut = |path: &Path| {
        let bytes = fs::read(path).expect("file");
        fs::write(path, &bytes[..bytes.len() / 2]).expect("write");
    };
    spoiled("summary.json", &cut, &both, &["line"]);
    spoiled("images.csv", &cut, &both, &[]);
    spoiled("pictures.mjpeg", &cut, &["report"], &["JPEG"]);
    let without_last_line = |path: &Path| {
        let text = fs::read_to_string(path).expect("text");
        let lines: Vec<&str> = text.lines().collect();
        fs::write(path, lines[..lines.len() - 1].join("\n") + "\n").expect("write");
    };
    spoiled("images.csv", &without_last_line, &both, &["49 images, but summary.json counts 50"]);
    let other_column = |path: &Path| {
        fs::write(path, fs::read_to_string(path).expect("text").replacen("tip_u_px", "tip_x_px", 1))
            .expect("write");
    };
    spoiled("images.csv", &other_column, &["report"], &["tip_u_px"]);
    spoiled("images.csv", &other_column, &["replay"], &["columns"]);
    let no_robot = |path: &Path| {
        fs::write(path, fs::read_to_string(path).expect("text").replacen("robot.yaml", "gone.yaml", 1))
            .expect("write");
    };
    spoiled("scenario.yaml", &no_robot, &["replay"], &["gone.yaml"]);
    assert!(run.read("report.html") == page, "a report that could not be made leaves the old one");
    run.assert_replays();
}

#[test]
fn help_has_examples() {
    for command in ["report", "replay"] {
        let mut help = program();
        let output = help.args([command, "--help"]).output().expect("help");
        let text = String::from_utf8(output.stdout).expect("text");
        assert!(
            text.contains("Examples:") && text.contains(&format!("sonoloop {command} out/recovery")),
            "{text}"
        );
    }
}
