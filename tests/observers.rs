//! Somebody who watches a run is told the truth, and may hold, step and disturb it; all of it is on record, and the
//! recorded scenario gives the same run again.

use std::io::{BufRead, BufReader};
use std::path::Path;
use std::process::Stdio;
use std::time::Duration;

use sonoloop::controller::ControllerKind;
use sonoloop::peer::InProcess;
use sonoloop::session::{Nobody, Session};
use sonoloop_scenario::{LoadOptions, load_text};
use sonoloop_types::Truth;
use sonoloop_wire::{Control, Domain, Observer, Wait};

mod common;
use common::{Guarded, file, program};

const SCENARIO: &str = "scenarios/lateral_plain.yaml";
const IMAGE_TICKS: u64 = 40;
/// Longest that a truth which must come may take.
const PATIENCE: Duration = Duration::from_secs(60);
/// How long a held run is watched for an image that must not come. A run that is not held takes some 10 ms for one;
/// a slow machine can make this check miss a fault, never find one that is not there.
const HELD: Duration = Duration::from_millis(500);

fn next(observer: &mut Observer) -> Truth {
    match observer.next(PATIENCE).expect("sound truth") {
        Wait::Got(truth) => truth,
        other => panic!("no truth: {other:?}"),
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

    let mut truth = next(&mut observer);
    assert_eq!(truth.tick, 0);
    observer.ask(&Control::Pause).expect("asked");
    // Up to the image at which the request was seen.
    while let Wait::Got(newer) = observer.next(HELD).expect("sound truth") {
        assert_eq!(newer.tick, truth.tick + IMAGE_TICKS);
        truth = newer;
    }
    let held_tick = truth.tick;

    observer.ask(&Control::Step(1)).expect("asked");
    truth = next(&mut observer);
    assert_eq!(truth.tick, held_tick + IMAGE_TICKS, "a step is one image");
    assert_eq!(observer.next(HELD).expect("sound truth"), Wait::TimedOut, "one step, one image");

    let before_m = truth.plane_to_tip_m;
    let knock = r#"{"probe_knock": {"elevation_mm": 2, "duration_s": 0.05}}"#;
    observer.ask(&Control::Disturb(serde_json::from_str(knock).expect("JSON"))).expect("asked");
    let senseless = r#"{"probe_knock": {"elevation_mm": 2000}}"#;
    observer.ask(&Control::Disturb(serde_json::from_str(senseless).expect("JSON"))).expect("asked");
    observer.ask(&Control::Step(2)).expect("asked");
    truth = next(&mut observer);
    truth = Truth { plane_to_tip_m: next(&mut observer).plane_to_tip_m, ..truth };
    let moved_mm = (truth.plane_to_tip_m - before_m).abs() * 1e3;
    assert!((moved_mm - 2.0).abs() < 0.3, "the plane moved by {moved_mm} mm");

    observer.ask(&Control::Speed(Some(1000.0))).expect("asked");
    observer.ask(&Control::Resume).expect("asked");
    while let Wait::Got(_) = observer.next(PATIENCE).expect("sound truth") {}
    let status = sim.0.wait().expect("the simulator ends");
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
    assert!(events.contains("must be at most 20"), "{events}");

    // The scenario as written holds the knock; played again, without an observer, it gives the same bytes.
    let text = read(folder.path(), "scenario.yaml");
    let scenario =
        load_text(&file(SCENARIO), &text, &LoadOptions::default()).expect("the scenario as written");
    assert_eq!(scenario.disturbances.len(), 1);
    let session = Session::new(&scenario).expect("a session");
    let mut peer = InProcess::new(ControllerKind::Tracker, false);
    let (recording, error) = session.run(1, &mut peer, &mut Nobody, None);
    assert!(error.is_none(), "{error:?}");
    let again = sonoloop::output::images_csv(&recording.images);
    assert!(again == read(folder.path(), "images.csv"), "the run as recorded differs from the run");
}
