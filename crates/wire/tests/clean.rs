//! What a killed process leaves behind goes, what lives stays.

mod common;

use std::io::{Read, Write};

use common::{Kid, PATIENCE, Watchdog, acquisition, command, image, leftovers, setup};
use sonoloop_types::{EndReason, Image};
use sonoloop_wire::{Answer, Domain, Next, SimEndpoint, TrackerEndpoint, Wait, clean_in};

const BASE: &str = "SONOLOOP_TEST_BASE";

/// A short folder of the test's own: sockets have short names.
fn base() -> tempfile::TempDir {
    tempfile::Builder::new().prefix("sl").rand_bytes(5).tempdir_in("/tmp").unwrap()
}

/// Where a helper lives, read from its output.
fn place(kid: &mut Kid) -> (String, std::path::PathBuf) {
    (kid.read("domain "), kid.read("root ").into())
}

#[test]
#[ignore = "a helper process of the tests below"]
fn helper_simulator() {
    let base = std::env::var_os(BASE).expect("only run by other tests");
    let domain = Domain::create_in(base.as_ref()).unwrap();
    let mut sim = SimEndpoint::create(&domain, &setup(1)).unwrap();
    println!("\ndomain {}\nroot {}", domain.name(), domain.root().display());
    if std::env::var_os("SONOLOOP_TEST_ONE_ROUND").is_some() {
        assert!(matches!(sim.wait_ready(PATIENCE, || true).unwrap(), Wait::Got(_)));
        sim.publish_image(&acquisition(0), &image(0), true).unwrap();
        assert!(matches!(sim.wait_answer(0, PATIENCE, || true).unwrap(), Wait::Got(Answer::Command(_))));
        println!("answered");
    }
    // Until the test closes our input, or kills us.
    let _ = std::io::stdin().read(&mut [0]);
    sim.publish_end(EndReason::TimeOver).unwrap();
}

#[test]
#[ignore = "a helper process of the tests below"]
fn helper_tracker() {
    let domain = Domain::from_environment().unwrap();
    let tracker = TrackerEndpoint::open(&domain, PATIENCE).unwrap();
    tracker.announce("helper", "0").unwrap();
    let mut picture = Image::black(1, 1);
    loop {
        match tracker.next_image(&mut picture, PATIENCE).unwrap() {
            Next::Image(received) => tracker.answer(&command(received.sequence)).unwrap(),
            end => {
                println!("\nended {end:?}");
                return;
            }
        }
    }
}

#[test]
#[ignore = "a helper process of the tests below"]
fn helper_waiter() {
    let base = std::env::var_os(BASE).expect("only run by other tests");
    let domain = Domain::create_in(base.as_ref()).unwrap();
    let sim = SimEndpoint::create(&domain, &setup(1)).unwrap();
    println!("\ndomain {}\nroot {}", domain.name(), domain.root().display());
    println!("waited {:?}", sim.wait_ready(PATIENCE, || true).unwrap());
}

#[test]
fn a_killed_simulator_is_cleaned_up_after_and_a_living_one_is_not_touched() {
    let _watchdog = Watchdog::start();
    let base = base();
    let folder = base.path().to_str().unwrap();
    let mut dead = Kid::helper("helper_simulator", &[(BASE, folder)]);
    let mut live = Kid::helper("helper_simulator", &[(BASE, folder), ("SONOLOOP_TEST_ONE_ROUND", "1")]);
    let (dead_name, dead_root) = place(&mut dead);
    let (live_name, live_root) = place(&mut live);
    dead.0.kill().unwrap();
    dead.0.wait().unwrap();
    assert!(leftovers(&dead_name, &dead_root).len() > 3, "a killed simulator leaves something to clean");

    let report = clean_in(base.path());
    assert_eq!((&report.removed, report.live), (&vec![dead_name.clone()], 1));
    assert!(report.failed.is_empty(), "{report:?}");
    assert!(leftovers(&dead_name, &dead_root).is_empty());

    // The living one still works, with a tracker that comes only now.
    let variables = [
        (sonoloop_wire::DOMAIN_VARIABLE, live_name.as_str()),
        (sonoloop_wire::ROOT_VARIABLE, live_root.to_str().unwrap()),
    ];
    let mut tracker = Kid::helper("helper_tracker", &variables);
    live.read("answered");
    // Killed trackers leave their ports; the orderly end of the simulator removes those too.
    tracker.0.kill().unwrap();
    tracker.0.wait().unwrap();
    live.0.stdin.take().unwrap().write_all(b"\n").unwrap();
    assert!(live.0.wait().unwrap().success());
    assert!(leftovers(&live_name, &live_root).is_empty());
    assert_eq!(clean_in(base.path()), sonoloop_wire::CleanReport::default());
}

#[test]
fn a_tracker_outlives_a_killed_simulator_only_to_tidy_up() {
    let _watchdog = Watchdog::start();
    let base = base();
    let folder = base.path().to_str().unwrap();
    let mut sim = Kid::helper("helper_simulator", &[(BASE, folder), ("SONOLOOP_TEST_ONE_ROUND", "1")]);
    let (name, root) = place(&mut sim);
    let variables = [
        (sonoloop_wire::DOMAIN_VARIABLE, name.as_str()),
        (sonoloop_wire::ROOT_VARIABLE, root.to_str().unwrap()),
    ];
    let mut tracker = Kid::helper("helper_tracker", &variables);
    sim.read("answered");
    sim.0.kill().unwrap();
    sim.0.wait().unwrap();
    assert_eq!(tracker.read("ended "), "SimulatorGone");
    assert!(tracker.0.wait().unwrap().success());
    assert!(leftovers(&name, &root).is_empty());
}

#[test]
fn a_signal_ends_a_wait_and_the_process_tidies_up() {
    let _watchdog = Watchdog::start();
    for signal in ["TERM", "INT"] {
        let base = base();
        let mut sim = Kid::helper("helper_waiter", &[(BASE, base.path().to_str().unwrap())]);
        let (name, root) = place(&mut sim);
        let process = sim.0.id().to_string();
        let sent = std::process::Command::new("kill").args(["-s", signal, &process]).status().unwrap();
        assert!(sent.success());
        assert_eq!(sim.read("waited "), "Interrupted");
        assert!(sim.0.wait().unwrap().success());
        assert!(leftovers(&name, &root).is_empty());
    }
}

#[test]
fn eight_domains_made_at_once_while_others_clean_do_not_collide() {
    let _watchdog = Watchdog::start();
    let base = base();
    let folder = base.path();
    let domains: Vec<Domain> = std::thread::scope(|scope| {
        let cleaners: Vec<_> = (0..2)
            .map(|_| {
                scope.spawn(|| {
                    for _ in 0..200 {
                        assert!(clean_in(folder).failed.is_empty());
                    }
                })
            })
            .collect();
        let makers: Vec<_> = (0..8).map(|_| scope.spawn(|| Domain::create_in(folder).unwrap())).collect();
        let domains = makers.into_iter().map(|maker| maker.join().unwrap()).collect();
        for cleaner in cleaners {
            cleaner.join().unwrap();
        }
        domains
    });
    let mut names: Vec<_> = domains.iter().map(Domain::name).collect();
    names.sort_unstable();
    names.dedup();
    assert_eq!(names.len(), 8);
    assert!(domains.iter().all(|domain| domain.is_alive() && domain.root().is_dir()));
    let report = clean_in(folder);
    assert_eq!((report.live, report.removed.len()), (8, 0));
    drop(domains);
    assert_eq!(std::fs::read_dir(folder).unwrap().count(), 0);
}
