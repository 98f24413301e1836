//! Simulator and tracker across shared memory, each with its own node.

mod common;

use std::time::{Duration, Instant};

use common::{PATIENCE, Watchdog, acquisition, command, domain, image, joined, leftovers, setup};
use sonoloop_types::{CommandReceipt, EndReason, Image, Point, Refusal, Truth};
use sonoloop_wire::{
    Answer, Control, Domain, Next, Observer, ObserverHost, SimEndpoint, TrackerEndpoint, TrackerHello, Wait,
    WireError, layout::CommandMessage,
};

const RUN: u64 = 0xfeed_0123_4567_89ab;

/// Announces a tracker in a thread of its own and answers until the end; returns how it ended and what it saw.
fn answering_tracker(domain: Domain) -> (Next, u64) {
    let tracker = TrackerEndpoint::open(&domain, PATIENCE).unwrap();
    assert_eq!(*tracker.setup(), setup(RUN));
    assert_eq!(tracker.restore(), None);
    tracker.announce("round trip", "1.2.3").unwrap();
    let mut picture = Image::black(1, 1);
    let mut seen = 0;
    loop {
        match tracker.next_image(&mut picture, PATIENCE).unwrap() {
            Next::Image(received) => {
                assert_eq!(received, acquisition(received.sequence));
                assert_eq!(picture, image(received.sequence));
                tracker.publish_checkpoint(&received.sequence.to_le_bytes()).unwrap();
                tracker.answer(&command(received.sequence)).unwrap();
                seen += 1;
            }
            end => return (end, seen),
        }
    }
}

#[test]
fn a_hundred_images_and_answers_go_round_unchanged_and_nothing_is_left() {
    let _watchdog = Watchdog::start();
    let domain = domain();
    let (name, root) = (domain.name().to_owned(), domain.root().to_owned());
    let mut sim = SimEndpoint::create(&domain, &setup(RUN)).unwrap();
    let for_tracker = joined(&domain);
    let thread = std::thread::spawn(move || answering_tracker(for_tracker));
    let hello = sim.wait_ready(PATIENCE, || true).unwrap();
    assert_eq!(hello, Wait::Got(TrackerHello { name: "round trip".into(), version: "1.2.3".into() }));

    let mut latencies = Vec::new();
    for sequence in 0..100 {
        let (acquisition, image) = (acquisition(sequence), image(sequence));
        let start = Instant::now();
        sim.publish_image(&acquisition, &image, true).unwrap();
        let answer = sim.wait_answer(sequence, PATIENCE, || true).unwrap();
        latencies.push(start.elapsed());
        assert_eq!(answer, Wait::Got(Answer::Command(command(sequence))));
        assert_eq!(sim.latest_checkpoint().unwrap(), Some(sequence.to_le_bytes().to_vec()));
    }
    latencies.sort();
    println!("round trip of an image and its answer: median {:?}, 99th {:?}", latencies[50], latencies[98]);
    assert!(sim.take_refusals().is_empty());

    sim.publish_end(EndReason::TargetReached).unwrap();
    // The simulator does not wait for anyone; the tracker learns of the end all the same.
    drop(sim);
    drop(domain);
    assert_eq!(thread.join().unwrap(), (Next::End(EndReason::TargetReached), 100));
    assert_eq!(leftovers(&name, &root), Vec::<std::path::PathBuf>::new());
}

#[test]
fn garbage_is_refused_with_its_reason() {
    let _watchdog = Watchdog::start();
    let domain = domain();
    let mut sim = SimEndpoint::create(&domain, &setup(RUN)).unwrap();
    let for_tracker = joined(&domain);
    let sound = |sequence| CommandMessage::encode(RUN, &command(sequence));
    let thread = std::thread::spawn(move || {
        let tracker = TrackerEndpoint::open(&for_tracker, PATIENCE).unwrap();
        tracker.announce("garbage", "0").unwrap();
        let mut picture = Image::black(1, 1);
        while let Next::Image(received) = tracker.next_image(&mut picture, PATIENCE).unwrap() {
            let sound = sound(received.sequence);
            let messages: &[CommandMessage] = match received.sequence {
                // Answers to this image that hold nonsense: each ends the wait.
                0 => &[CommandMessage { feed_m_s: f64::NAN, ..sound }],
                1 => &[CommandMessage { target_base_from_probe: [f64::INFINITY; 7], ..sound }],
                2 => &[CommandMessage { has_target: 1, target_base_from_probe: [0.6; 7], ..sound }],
                3 => &[CommandMessage { state: 77, ..sound }],
                4 => &[CommandMessage { tip_px: [f64::NAN, 3.0], ..sound }],
                5 => &[CommandMessage { has_target: 2, ..sound }],
                6 => &[CommandMessage { ncc_anchor: f64::NEG_INFINITY, ..sound }],
                // Messages that are no answer to this image: recorded, and the wait goes on.
                _ => &[
                    CommandMessage { run_id: RUN + 1, ..sound },
                    CommandMessage { version: 0xdead_beef, ..sound },
                    CommandMessage { answers: 3, ..sound },
                    CommandMessage { answers: 1 << 60, ..sound },
                    CommandMessage { answers: 2, feed_m_s: f64::NAN, ..sound },
                    sound,
                ],
            };
            for &message in messages {
                tracker.send_message(message).unwrap();
            }
        }
    });
    assert!(matches!(sim.wait_ready(PATIENCE, || true).unwrap(), Wait::Got(_)));
    let refusals = [
        Refusal::NotFinite,
        Refusal::NotFinite,
        Refusal::Malformed,
        Refusal::Malformed,
        Refusal::NotFinite,
        Refusal::Malformed,
        Refusal::NotFinite,
    ];
    for (sequence, refusal) in (0..).zip(refusals) {
        sim.publish_image(&acquisition(sequence), &image(sequence), true).unwrap();
        let answer = sim.wait_answer(sequence, PATIENCE, || true).unwrap();
        let receipt = CommandReceipt { answers: sequence, refused: Some(refusal) };
        assert_eq!(answer, Wait::Got(Answer::Refused(receipt)));
    }
    assert!(sim.take_refusals().is_empty());
    sim.publish_image(&acquisition(7), &image(7), true).unwrap();
    let answer = sim.wait_answer(7, PATIENCE, || true).unwrap();
    assert_eq!(answer, Wait::Got(Answer::Command(command(7))));
    let recorded: Vec<_> =
        sim.take_refusals().iter().map(|receipt| (receipt.answers, receipt.refused)).collect();
    assert_eq!(
        recorded,
        [
            (u64::MAX, Some(Refusal::OtherRun)),
            (u64::MAX, Some(Refusal::Malformed)),
            (3, Some(Refusal::Stale)),
            (1 << 60, Some(Refusal::UnknownImage)),
            (2, Some(Refusal::NotFinite)),
        ]
    );
    sim.publish_end(EndReason::TimeOver).unwrap();
    thread.join().unwrap();
}

#[test]
fn a_restarted_tracker_gets_setup_and_checkpoint_and_only_images_it_owes_an_answer() {
    let _watchdog = Watchdog::start();
    let domain = domain();
    let mut sim = SimEndpoint::create(&domain, &setup(RUN)).unwrap();
    assert_eq!(sim.latest_checkpoint().unwrap(), None);
    let start_tracker = |answers: u64, expected: Option<Vec<u8>>| {
        let domain = joined(&domain);
        std::thread::spawn(move || {
            let tracker = TrackerEndpoint::open(&domain, PATIENCE).unwrap();
            assert_eq!(tracker.setup().run_id, RUN);
            assert!(tracker.restore() == expected.as_deref());
            tracker.announce("restarted", "0").unwrap();
            let mut picture = Image::black(1, 1);
            let mut seen = Vec::new();
            for _ in 0..answers {
                let Next::Image(received) = tracker.next_image(&mut picture, PATIENCE).unwrap() else {
                    break;
                };
                seen.push(received.sequence);
                // Larger than the memory checkpoints begin with.
                tracker.publish_checkpoint(&vec![received.sequence as u8; 100_000]).unwrap();
                tracker.answer(&command(received.sequence)).unwrap();
            }
            seen
        })
    };
    let first = start_tracker(2, None);
    assert!(matches!(sim.wait_ready(PATIENCE, || true).unwrap(), Wait::Got(_)));
    for sequence in 0..2 {
        sim.publish_image(&acquisition(sequence), &image(sequence), true).unwrap();
        assert!(matches!(
            sim.wait_answer(sequence, PATIENCE, || true).unwrap(),
            Wait::Got(Answer::Command(_))
        ));
    }
    assert_eq!(first.join().unwrap(), [0, 1]);

    // Nobody is there; the simulator goes on by itself.
    sim.publish_image(&acquisition(2), &image(2), false).unwrap();
    assert_eq!(sim.wait_answer(2, Duration::from_millis(120), || true).unwrap(), Wait::TimedOut);
    assert_eq!(sim.wait_answer(2, PATIENCE, || false).unwrap(), Wait::Gone);
    let checkpoint = sim.latest_checkpoint().unwrap();
    // Not assert_eq: it would print a hundred thousand numbers.
    assert!(checkpoint == Some(vec![1; 100_000]));
    sim.publish_checkpoint(checkpoint.as_deref().unwrap()).unwrap();

    let second = start_tracker(1, checkpoint);
    assert!(matches!(sim.wait_ready(PATIENCE, || true).unwrap(), Wait::Got(_)));
    sim.publish_image(&acquisition(3), &image(3), false).unwrap();
    sim.publish_image(&acquisition(4), &image(4), true).unwrap();
    assert!(matches!(sim.wait_answer(4, PATIENCE, || true).unwrap(), Wait::Got(Answer::Command(_))));
    assert_eq!(second.join().unwrap(), [4]);
    assert!(sim.latest_checkpoint().unwrap() == Some(vec![4; 100_000]));
}

#[test]
fn two_domains_do_not_see_each_other() {
    let _watchdog = Watchdog::start();
    let domains = [domain(), domain()];
    assert_ne!(domains[0].name(), domains[1].name());
    let mut sims: Vec<SimEndpoint> =
        (0..2).map(|run| SimEndpoint::create(&domains[run], &setup(run as u64)).unwrap()).collect();
    let reach_only = joined(&domains[1]);
    let thread = std::thread::spawn(move || {
        let tracker = TrackerEndpoint::open(&reach_only, PATIENCE).unwrap();
        assert_eq!(tracker.setup().run_id, 1);
        tracker.announce("one of two", "0").unwrap();
        let mut picture = Image::black(1, 1);
        let next = tracker.next_image(&mut picture, PATIENCE).unwrap();
        tracker.answer(&command(6)).unwrap();
        (next, tracker.next_image(&mut picture, PATIENCE).unwrap())
    });
    assert!(matches!(sims[1].wait_ready(PATIENCE, || true).unwrap(), Wait::Got(_)));
    assert_eq!(sims[0].wait_ready(Duration::from_millis(100), || true).unwrap(), Wait::TimedOut);
    sims[0].publish_image(&acquisition(5), &image(5), true).unwrap();
    sims[0].publish_end(EndReason::Fault).unwrap();
    sims[1].publish_image(&acquisition(6), &image(6), true).unwrap();
    // Only after its answer: a tracker that finds image and end together takes the end.
    assert!(matches!(sims[1].wait_answer(6, PATIENCE, || true).unwrap(), Wait::Got(Answer::Command(_))));
    sims[1].publish_end(EndReason::TimeOver).unwrap();
    let (first, second) = thread.join().unwrap();
    assert!(
        matches!(first, Next::Image(received) if received.sequence == 6)
            && second == Next::End(EndReason::TimeOver),
        "{first:?} {second:?}"
    );
}

#[test]
fn the_truth_travels_on_a_domain_of_its_own() {
    let _watchdog = Watchdog::start();
    let (public, private) = (domain(), domain());
    let _sim = SimEndpoint::create(&public, &setup(RUN)).unwrap();
    let host = ObserverHost::create(&private, RUN).unwrap();
    let mut observer = Observer::open(&joined(&private), PATIENCE).unwrap();
    // Whoever has not seen the run cannot ask it for anything.
    assert!(matches!(observer.ask(&Control::Pause), Err(WireError::Control { .. })));
    let truth = Truth {
        tick: 41,
        world_from_probe: common::pose(0.3),
        tip_in_world: Point::new(0.1, 0.2, 0.3),
        tip_in_probe: Point::new(-0.1, 0.002, 0.03),
        reference_px: [200.5, 300.25],
        plane_to_tip_m: 0.002,
        visible: false,
        depth_m: 0.031,
        feed_m_s: 0.01,
        contact_force_n: 3.0,
        needle_force_n: 0.7,
        target_distance_m: 0.02,
        min_joint_margin_rad: 0.4,
        collision: true,
    };
    host.publish(&truth, true).unwrap();
    assert_eq!(observer.next(PATIENCE).unwrap(), Wait::Got((truth, true)));
    // In the tracker's domain there is no such service.
    let refused = Observer::open(&joined(&public), Duration::ZERO);
    assert!(matches!(refused, Err(WireError::Transport { .. })));

    let knock = serde_json::from_str(r#"{"probe_knock": {"elevation_mm": 3}}"#).unwrap();
    for control in [Control::Pause, Control::Step(2), Control::Disturb(knock), Control::Resume] {
        observer.ask(&control).unwrap();
        assert_eq!(host.next_control(PATIENCE).unwrap(), Wait::Got(Ok(control)));
    }
    assert_eq!(host.next_control(Duration::ZERO).unwrap(), Wait::TimedOut);
    assert!(matches!(observer.ask(&Control::Step(0)), Err(WireError::Control { .. })));

    // One who comes while the run is paused is given the newest truth.
    let mut late = Observer::open(&joined(&private), PATIENCE).unwrap();
    assert_eq!(host.next_control(Duration::from_millis(100)).unwrap(), Wait::TimedOut);
    assert_eq!(late.next(PATIENCE).unwrap(), Wait::Got((truth, true)));
}

#[test]
fn a_setup_that_json_cannot_carry_and_a_picture_of_another_size_are_refused() {
    let _watchdog = Watchdog::start();
    let domain = domain();
    let mut bad = setup(RUN);
    bad.servo.feed_m_s = f64::NAN;
    assert!(matches!(SimEndpoint::create(&domain, &bad), Err(WireError::Setup { .. })));
    let mut huge = setup(RUN);
    huge.geometry.width_px = 1 << 20;
    assert!(matches!(SimEndpoint::create(&domain, &huge), Err(WireError::Picture { .. })));
    let mut sim = SimEndpoint::create(&domain, &setup(RUN)).unwrap();
    let small = Image::black(64, 48);
    assert!(matches!(sim.publish_image(&acquisition(0), &small, true), Err(WireError::Picture { .. })));
    assert!(matches!(
        sim.publish_checkpoint(&vec![0; sonoloop_wire::MAX_CHECKPOINT_BYTES + 1]),
        Err(WireError::CheckpointTooLarge { .. })
    ));
    // Only the owner of the lock may create services.
    assert!(matches!(SimEndpoint::create(&joined(&domain), &setup(RUN)), Err(WireError::NotRunning { .. })));
}

#[test]
fn a_tracker_notices_that_its_simulator_is_gone() {
    let _watchdog = Watchdog::start();
    let domain = domain();
    let (name, root) = (domain.name().to_owned(), domain.root().to_owned());
    let sim = SimEndpoint::create(&domain, &setup(RUN)).unwrap();
    let opener = joined(&domain);
    let (ready, is_ready) = std::sync::mpsc::channel();
    let thread = std::thread::spawn(move || {
        let tracker = TrackerEndpoint::open(&opener, PATIENCE).unwrap();
        ready.send(()).unwrap();
        tracker.next_image(&mut Image::black(1, 1), PATIENCE).unwrap()
    });
    // Serves the set-up; nobody announces.
    while is_ready.try_recv().is_err() {
        assert_eq!(sim.wait_ready(Duration::from_millis(20), || true).unwrap(), Wait::TimedOut);
    }
    drop(sim);
    drop(domain);
    assert_eq!(thread.join().unwrap(), Next::SimulatorGone);
    assert_eq!(leftovers(&name, &root), Vec::<std::path::PathBuf>::new());
    assert!(matches!(Domain::open(&name, &root), Err(WireError::NotRunning { .. })));
}
