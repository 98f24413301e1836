//! Processes that are killed, hang or never answer: runs end in order, and nothing is left in shared memory.
//!
//! Every test looks only at the domains of its own runs: other runs may come and go on the same machine.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::process::{Child, Command};
use std::time::Duration;

mod common;
use common::{Finished, Guarded, finish, program, sonoloop, start, wait_for};

const SCENARIO: &str = "scenarios/lateral_plain.yaml";
/// A tracker that has slept this often is far beyond its start: every picture is one sleep at least.
const MID_RUN_SLEEPS: u64 = 40;

/// State letter and parent of a process, from `/proc`; the name in between may hold anything but the last bracket.
fn stat(process: u32) -> Option<(char, u32)> {
    let text = std::fs::read_to_string(format!("/proc/{process}/stat")).ok()?;
    let mut fields = text.rsplit_once(')')?.1.split_whitespace();
    Some((fields.next()?.chars().next()?, fields.next()?.parse().ok()?))
}

/// A dead process that nobody has waited for counts as ended.
fn has_ended(process: u32) -> bool {
    stat(process).is_none_or(|(state, _)| matches!(state, 'Z' | 'X'))
}

fn children(parent: u32) -> Vec<u32> {
    std::fs::read_dir("/proc")
        .expect("/proc")
        .filter_map(|entry| entry.ok()?.file_name().to_str()?.parse().ok())
        .filter(|&process| stat(process).is_some_and(|(state, of)| of == parent && state != 'Z'))
        .collect()
}

/// How often a process went to sleep of its own accord.
fn sleeps(process: u32) -> u64 {
    let text = std::fs::read_to_string(format!("/proc/{process}/status")).unwrap_or_default();
    let line = text.lines().find_map(|line| line.strip_prefix("voluntary_ctxt_switches:"));
    line.and_then(|number| number.trim().parse().ok()).unwrap_or(0)
}

fn signal(name: &str, process: u32) {
    let sent = Command::new("kill").args(["-s", name, &process.to_string()]).status().expect("kill");
    assert!(sent.success(), "SIG{name} to {process}");
}

/// A tracker as seen from outside: its process, and the domain it was given.
#[derive(Debug, Clone)]
struct Tracker {
    process: u32,
    domain: String,
    root: PathBuf,
}

impl Tracker {
    /// The one child of a run, once it is a tracker (not a copy of its parent that is about to become one).
    fn of(run: &Child) -> Self {
        wait_for("the tracker's process", || {
            let process = *children(run.id()).first()?;
            let environment = std::fs::read(format!("/proc/{process}/environ")).ok()?;
            let value = |name: &str| {
                environment.split(|byte| *byte == 0).find_map(|pair| {
                    let (key, value) = std::str::from_utf8(pair).ok()?.split_once('=')?;
                    (key == name).then(|| value.to_owned())
                })
            };
            let domain = value(sonoloop_wire::DOMAIN_VARIABLE)?;
            Some(Self { process, domain, root: value(sonoloop_wire::ROOT_VARIABLE)?.into() })
        })
    }

    /// The tracker of a run that has exchanged a good number of pictures.
    fn in_mid_run(run: &Child) -> Self {
        let tracker = Self::of(run);
        wait_for("pictures", || {
            assert!(!has_ended(run.id()), "the run ended before it could be disturbed");
            (sleeps(tracker.process) >= MID_RUN_SLEEPS).then_some(())
        });
        tracker
    }

    /// What is left of its domain: shared memory, folder, lock.
    fn leftovers(&self) -> Vec<PathBuf> {
        let shared = std::fs::read_dir("/dev/shm").expect("/dev/shm").flatten().map(|entry| entry.path());
        let is_ours = |path: &PathBuf| {
            path.file_name().is_some_and(|name| name.to_string_lossy().starts_with(&self.domain))
        };
        let lock = PathBuf::from(format!("{}.lock", self.root.display()));
        shared.filter(is_ours).chain([self.root.clone(), lock].into_iter().filter(|p| p.exists())).collect()
    }

    fn assert_gone(&self, what: &str) {
        assert!(self.root.starts_with(sonoloop_wire::default_base()), "{}", self.root.display());
        assert_eq!(self.leftovers(), Vec::<PathBuf>::new(), "{what}");
    }
}

/// A run that goes on until somebody ends it: ten minutes of simulated time, a needle that hardly moves.
fn endless(more: &[&str]) -> Guarded {
    let mut command = program();
    command
        .args(["run", SCENARIO, "--json", "--set", "duration_s=600", "--set", "servo.feed_mm_s=0.1"])
        .args(more);
    start(command)
}

fn run_to(out: &Path) -> Command {
    let mut command = program();
    command.args(["run", SCENARIO, "--json", "--out"]).arg(out);
    command
}

fn images_csv(out: &Path) -> String {
    let text = std::fs::read_to_string(out.join("images.csv")).expect("images.csv");
    assert!(text.lines().count() > 100, "a run has more than a hundred images");
    text
}

fn assert_fault(finished: &Finished, message: &str) {
    assert_eq!(finished.code(), 3, "{}", finished.stderr);
    assert!(finished.stderr.contains(message), "no {message:?} in:\n{}", finished.stderr);
    assert_eq!(finished.stdout, "", "an error goes to stderr");
    assert!(!finished.stderr.contains("panicked"), "{}", finished.stderr);
}

/// Either of the two ways by which left-overs go.
fn tidy_up(by_a_run: bool) {
    let arguments: &[&str] =
        if by_a_run { &["run", SCENARIO, "--json", "--set", "duration_s=0.5"] } else { &["clean"] };
    let finished = sonoloop(arguments);
    assert!(finished.code() < 2, "{}", finished.stderr);
}

fn kill_and_wait(run: &mut Guarded) {
    run.0.kill().expect("kill");
    run.0.wait().expect("wait");
}

#[test]
fn a_tracker_whose_simulator_was_killed_ends_by_itself_and_nothing_is_left() {
    for by_a_run in [false, true] {
        let mut run = endless(&[]);
        let tracker = Tracker::in_mid_run(&run.0);
        kill_and_wait(&mut run);
        wait_for("the end of the orphaned tracker", || has_ended(tracker.process).then_some(()));
        tidy_up(by_a_run);
        tracker.assert_gone("simulator killed");
    }
}

#[test]
fn a_run_whose_tracker_was_killed_from_outside_is_a_fault() {
    let run = endless(&[]);
    let tracker = Tracker::in_mid_run(&run.0);
    signal("KILL", tracker.process);
    let finished = finish(run);
    assert_fault(&finished, "the tracker ended although nobody asked it to (signal: 9");
    assert!(finished.stderr.contains("not comparable"), "{}", finished.stderr);
    tracker.assert_gone("tracker killed");
}

#[test]
fn both_killed_leave_nothing_and_a_living_run_is_not_touched() {
    let folder = tempfile::tempdir().expect("temporary folder");
    let alone = folder.path().join("alone");
    let finished = finish(start(run_to(&alone)));
    assert_eq!(finished.code(), 0, "{}", finished.stderr);

    // Stopped in the middle: it certainly lives, and holds its shared memory, while others are cleaned up after.
    let disturbed = folder.path().join("disturbed");
    let living = start(run_to(&disturbed));
    let its_tracker = Tracker::in_mid_run(&living.0);
    signal("STOP", living.0.id());
    let before: BTreeSet<PathBuf> = its_tracker.leftovers().into_iter().collect();
    assert!(before.len() > 3, "a living run holds shared memory");

    for (by_a_run, simulator_first) in [(false, true), (false, false), (true, true), (true, false)] {
        let mut run = endless(&[]);
        let tracker = Tracker::in_mid_run(&run.0);
        // One of the two is stopped first, or it would see the other's end and tidy up.
        if simulator_first {
            signal("STOP", tracker.process);
            kill_and_wait(&mut run);
            signal("KILL", tracker.process);
        } else {
            signal("STOP", run.0.id());
            signal("KILL", tracker.process);
            kill_and_wait(&mut run);
        }
        wait_for("the end of the killed tracker", || has_ended(tracker.process).then_some(()));
        tidy_up(by_a_run);
        tracker.assert_gone("both killed");
    }

    let after: BTreeSet<PathBuf> = its_tracker.leftovers().into_iter().collect();
    assert!(before.is_subset(&after), "a living run was touched: {:?}", before.difference(&after));
    signal("CONT", living.0.id());
    let finished = finish(living);
    assert_eq!(finished.code(), 0, "{}", finished.stderr);
    assert_eq!(images_csv(&alone), images_csv(&disturbed));
    its_tracker.assert_gone("orderly end");
}

#[test]
fn killed_during_the_start_nothing_is_left_either() {
    for pause_ms in [0, 2, 5, 10, 20, 40] {
        let mut run = endless(&[]);
        let tracker = Tracker::of(&run.0);
        std::thread::sleep(Duration::from_millis(pause_ms));
        kill_and_wait(&mut run);
        wait_for("the end of the orphaned tracker", || has_ended(tracker.process).then_some(()));
        tidy_up(false);
        tracker.assert_gone("killed during the start");
    }
}

#[test]
fn eight_runs_at_once_give_the_same_bytes() {
    let folder = tempfile::tempdir().expect("temporary folder");
    let out = |k: usize| folder.path().join(k.to_string());
    let runs: Vec<Guarded> = (0..8).map(|k| start(run_to(&out(k)))).collect();
    for run in runs {
        let finished = finish(run);
        assert!(finished.code() < 2, "{}", finished.stderr);
    }
    let first = images_csv(&out(0));
    for k in 1..8 {
        assert!(images_csv(&out(k)) == first, "run {k} differs from run 0");
    }
}

#[test]
fn a_tracker_that_exits_at_once_is_a_fault() {
    for (command, message) in
        [("true", "exit status: 0"), ("false", "exit status: 1"), ("sonoloop-has-no-such-tracker", "127")]
    {
        let finished = sonoloop(&["run", SCENARIO, "--json", "--tracker", command]);
        assert_fault(&finished, "the tracker ended although nobody asked it to");
        assert!(finished.stderr.contains(message), "no {message:?} in:\n{}", finished.stderr);
    }
}

#[test]
fn a_tracker_that_never_answers_is_a_fault_and_does_not_stay() {
    let mut command = program();
    command.args(["run", SCENARIO, "--json", "--tracker", "sleep 60"]);
    let never_ready = start(command);
    let hung_later = endless(&[]);
    let hung_by_the_clock = endless(&["--realtime"]);
    let sleeper = Tracker::of(&never_ready.0);
    let [hung, hung_too] = [&hung_later, &hung_by_the_clock].map(|run| Tracker::in_mid_run(&run.0));
    signal("STOP", hung.process);
    signal("STOP", hung_too.process);
    for (run, tracker) in [(never_ready, sleeper), (hung_later, hung), (hung_by_the_clock, hung_too)] {
        assert_fault(&finish(run), "the tracker gave no answer for 10 s");
        assert!(has_ended(tracker.process), "the tracker's process is still there");
        tracker.assert_gone("silent tracker");
    }
}

#[test]
fn two_terminals_give_the_same_bytes_as_one() {
    let folder = tempfile::tempdir().expect("temporary folder");
    let out = |name: &str| folder.path().join(name);
    let finished = finish(start(run_to(&out("run"))));
    assert!(finished.code() < 2, "{}", finished.stderr);

    let log = out("sim.log");
    let mut sim = program();
    sim.args(["sim", SCENARIO, "--json", "--out"]).arg(out("sim"));
    sim.stdout(std::process::Stdio::null()).stderr(std::fs::File::create(&log).expect("log"));
    let mut sim = Guarded(sim.spawn().expect("the simulator starts"));
    let (domain, root) = wait_for("the simulator's invitation", || {
        let text = std::fs::read_to_string(&log).ok()?;
        let (line, _) = text.split_once("--domain ")?.1.split_once('\n')?;
        let (domain, root) = line.split_once(" --root ")?;
        Some((domain.to_owned(), root.to_owned()))
    });
    let track = sonoloop(&["track", "--domain", &domain, "--root", &root]);
    assert_eq!(track.code(), 0, "{}", track.stderr);
    let status = sim.wait();
    let said = std::fs::read_to_string(&log).expect("log");
    assert!(status.code().is_some_and(|code| code < 2), "{said}");
    assert!(images_csv(&out("run")) == images_csv(&out("sim")), "the two ways differ");
    Tracker { process: 0, domain, root: root.into() }.assert_gone("orderly end");
}

#[test]
fn a_signal_ends_a_run_in_order() {
    for name in ["TERM", "INT"] {
        let run = endless(&[]);
        let tracker = Tracker::in_mid_run(&run.0);
        signal(name, run.0.id());
        assert_fault(&finish(run), "interrupted");
        assert!(has_ended(tracker.process), "the tracker's process is still there");
        tracker.assert_gone(name);
    }
}
