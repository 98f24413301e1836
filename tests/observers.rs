//! Somebody who watches a run is told the truth, and may hold, step and disturb it; all of it is on record, and the
//! recorded scenario gives the same run again.

use std::io::{BufRead, BufReader};
use std::path::Path;
use std::process::Stdio;
use std::time::Duration;

use sonoloop_types::Truth;
use sonoloop_wire::{Control, Domain, Observer, Wait};

mod common;
use common::{Guarded, program, sonoloop};

const SCENARIO: &str = "scenarios/lateral_plain.yaml";
const IMAGE_TICKS: u64 = 40;
/// Longest that anything may take that must come; a hang becomes a failure.
const PATIENCE: Duration = Duration::from_secs(60);

/// The next truth, and whether the run is held there.
fn next(observer: &mut Observer) -> (Truth, bool) {
    match observer.next(PATIENCE).expect("sound truth") {
        Wait::Got(told) => told,
        other => panic!("no truth: {other:?}"),
    }
}

/// Follows the run until it says that it is held.
fn until_held(observer: &mut Observer, mut last_tick: u64) -> Truth {
    loop {
        let (truth, held) = next(observer);
        if held {
            assert_eq!(truth.tick, last_tick, "held at an image that was announced");
            return truth;
        }
        assert_eq!(truth.tick, last_tick + IMAGE_TICKS, "images come one by one");
        last_tick = truth.tick;
    }
}

fn read(folder: &Path, name: &str) -> String {
    std::fs::read_to_string(folder.join(name)).expect(name)
}

#[test]
fn a_run_is_held_stepped_and_disturbed_by_hand_and_can_be_run_again() {
    let folder = tempfile::tempdir().expect("temporary folder");
    let mut sim = program();
    sim.args(["sim", SCENARIO, "--json", "--out"])
        .arg(folder.path())
        .stdout(Stdio::null())
        .stderr(Stdio::piped());
    let mut sim = Guarded(sim.spawn().expect("the simulator starts"));
    let mut lines =
        BufReader::new(sim.0.stderr.take().expect("piped")).lines().map(|line| line.expect("text"));
    let join: Vec<String> = lines.by_ref().take(4).collect();
    let track: Vec<&str> = join[1].split_whitespace().skip(1).collect();
    let [_, name, _, root] = join[3].split_whitespace().collect::<Vec<_>>()[..] else { panic!("{join:?}") };
    // Whoever is told the one name is not told the other.
    assert!(!join[1].contains(name));
    let domain = Domain::open(name, Path::new(root)).expect("the observers' domain");
    let mut observer = Observer::open(&domain, PATIENCE).expect("the observers' services");
    let mut tracker = program();
    let _tracker = Guarded(tracker.args(&track).spawn().expect("the tracker starts"));
    // Nobody waits for the pipe to be read.
    let rest = std::thread::spawn(move || lines.collect::<Vec<_>>());

    let (first, held) = next(&mut observer);
    assert_eq!((first.tick, held), (0, false));
    observer.ask(&Control::Pause).expect("asked");
    let held_tick = until_held(&mut observer, 0).tick;

    observer.ask(&Control::Step(1)).expect("asked");
    let before = until_held(&mut observer, held_tick);
    assert_eq!(before.tick, held_tick + IMAGE_TICKS, "a step is one image");

    let knock = r#"{"probe_knock": {"elevation_mm": 2, "duration_s": 0.05}}"#;
    observer.ask(&Control::Disturb(serde_json::from_str(knock).expect("JSON"))).expect("asked");
    for refused in [r#"{"probe_knock": {"elevation_mm": 2000}}"#, r#"{"tracker_killed": {"down_s": 0.5}}"#] {
        observer.ask(&Control::Disturb(serde_json::from_str(refused).expect("JSON"))).expect("asked");
    }
    observer.ask(&Control::Step(2)).expect("asked");
    let after = until_held(&mut observer, before.tick);
    assert_eq!(after.tick, before.tick + 2 * IMAGE_TICKS);
    // Beside the knock, the servo may move the probe by its fastest dither for 80 ms.
    let moved_mm = (after.plane_to_tip_m - before.plane_to_tip_m).abs() * 1e3;
    assert!((moved_mm - 2.0).abs() < 0.3, "the plane moved by {moved_mm} mm");

    observer.ask(&Control::Speed(Some(1000.0))).expect("asked");
    observer.ask(&Control::Resume).expect("asked");
    while let Wait::Got(_) = observer.next(PATIENCE).expect("sound truth") {}
    let status = sim.wait();
    let said = rest.join().expect("reader");
    assert!(status.code().is_some_and(|code| code < 2), "{said:?}");

    let events = read(folder.path(), "events.csv");
    let control_at = |text: &str| {
        let line = events.lines().find(|line| line.contains("control") && line.contains(text));
        let line = line.unwrap_or_else(|| panic!("no {text} in\n{events}"));
        line.split(',').next().and_then(|tick| tick.parse::<u64>().ok()).expect("tick")
    };
    assert_eq!(control_at("pause"), held_tick);
    assert_eq!(control_at("step"), held_tick);
    assert_eq!(control_at("resume"), held_tick + 3 * IMAGE_TICKS);
    let disturbed_tick = control_at("\"\"elevation_mm\"\":2}");
    assert_eq!(disturbed_tick, held_tick + IMAGE_TICKS);
    assert!(events.contains(&format!("{},disturbance,\"probe slips", disturbed_tick + 1)), "{events}");
    assert_eq!(control_at("refused"), held_tick + IMAGE_TICKS);
    assert!(events.contains("refused: the tracker was started elsewhere"), "{events}");
    assert!(events.contains("must be at most 20"), "{events}");

    // The knock is in the scenario now, so it is run again without anybody who asks.
    let replayed = sonoloop(&["replay", folder.path().to_str().expect("plain path")]);
    assert_eq!(replayed.code(), 0, "{}{}", replayed.stdout, replayed.stderr);

    // The scenario as written holds the knock; run again from where it lies, without an observer, it gives the same
    // bytes.
    let again = folder.path().join("again");
    let (file, again_text) = (folder.path().join("scenario.yaml"), again.to_str().expect("plain path"));
    let file = file.to_str().expect("plain path");
    let finished = sonoloop(&["run", file, "--in-process", "--json", "--out", again_text]);
    assert!(finished.code() < 2, "{}", finished.stderr);
    assert!(read(folder.path(), "scenario.yaml").contains("elevation_mm: 2"));
    assert!(read(&again, "images.csv") == read(folder.path(), "images.csv"), "the run as recorded differs");
}
