//! The published contract (`docs/wire.md`, `docs/wire/tracker.py`) against the code.

mod common;

use std::{
    collections::BTreeMap,
    mem::{align_of, offset_of, size_of},
    path::PathBuf,
    process::{Command as Process, Stdio},
    time::Instant,
};

use common::{Kid, PATIENCE, Watchdog, acquisition, domain, leftovers, setup};
use sonoloop_types::{EndReason, Image, TrackState};
use sonoloop_wire::{
    Answer, DOMAIN_VARIABLE, Domain, ROOT_VARIABLE, SimEndpoint, Wait,
    layout::{
        BlobHeader, CommandMessage, EndMessage, ImageHeader, LAYOUT_VERSION, ReadyMessage, TruthMessage,
    },
};

fn docs(file: &str) -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../../docs").join(file)
}

/// Size, alignment and (name, offset, size) of each field.
#[derive(Debug, PartialEq, Eq)]
struct Layout {
    size: usize,
    alignment: usize,
    fields: Vec<(String, usize, usize)>,
}

type Layouts = BTreeMap<String, Layout>;

macro_rules! layout {
    ($name:literal, $type:ident { $($field:ident),* $(,)? }) => {{
        // Taking the struct apart without `..` keeps the list of fields complete.
        #[allow(clippy::unneeded_field_pattern, reason = "the pattern is the test")]
        fn complete(value: $type) { let $type { $($field: _),* } = value; }
        let _ = complete;
        fn field_size<T, F>(_: fn(&T) -> &F) -> usize { size_of::<F>() }
        let fields = vec![
            $((stringify!($field).to_owned(), offset_of!($type, $field), field_size(|value: &$type| &value.$field))),*
        ];
        ($name.to_owned(), Layout { size: size_of::<$type>(), alignment: align_of::<$type>(), fields })
    }};
}

fn of_the_code() -> Layouts {
    BTreeMap::from([
        layout!("sonoloop::BlobHeader", BlobHeader { version, reserved, run_id }),
        layout!(
            "sonoloop::ImageHeader",
            ImageHeader {
                version,
                width_px,
                height_px,
                arm_status,
                receipt,
                answer_due,
                reserved,
                run_id,
                sequence,
                acquisition_tick,
                publication_tick,
                pose_tick,
                receipt_answers,
                spacing_m,
                base_from_probe,
                depth_m,
                feed_m_s,
                contact_force_n,
            }
        ),
        layout!(
            "sonoloop::Command",
            CommandMessage {
                version,
                state,
                reason,
                has_target,
                reserved,
                run_id,
                answers,
                iterations,
                compute_us,
                tip_px,
                ncc_previous,
                ncc_anchor,
                brightness_ratio,
                tip_level,
                conditioning,
                target_base_from_probe,
                feed_m_s,
            }
        ),
        layout!("sonoloop::Ready", ReadyMessage { version, reserved, run_id, name, tracker_version }),
        layout!("sonoloop::End", EndMessage { version, reason, reserved, run_id }),
        layout!(
            "sonoloop::Truth",
            TruthMessage {
                version,
                visible,
                collision,
                held,
                reserved,
                run_id,
                tick,
                world_from_probe,
                tip_in_world,
                tip_in_probe,
                reference_px,
                plane_to_tip_m,
                depth_m,
                feed_m_s,
                contact_force_n,
                target_distance_m,
                min_joint_margin_rad,
                needle_force_n,
            }
        ),
    ])
}

fn size_of_type(name: &str) -> usize {
    if let Some(array) = name.strip_prefix('[') {
        let (element, count) = array.trim_end_matches(']').split_once(';').expect("[type; count]");
        return size_of_type(element.trim()) * count.trim().parse::<usize>().expect("a count");
    }
    match name {
        "u8" => 1,
        "u32" | "f32" => 4,
        "u64" | "f64" => 8,
        other => panic!("no such type: {other}"),
    }
}

/// Reads the headings "### `name`, N bytes, alignment A" and the tables below them.
fn of_the_page() -> Layouts {
    let page = std::fs::read_to_string(docs("wire.md")).unwrap();
    assert!(page.contains(&format!("layout version **{LAYOUT_VERSION}**")));
    let mut layouts = Layouts::new();
    let mut current = None;
    for line in page.lines() {
        if line.starts_with('#') {
            current = line.strip_prefix("### `").map(|heading| {
                let (name, rest) = heading.split_once('`').expect("a closed name");
                let numbers: Vec<usize> =
                    rest.split_whitespace().filter_map(|word| word.parse().ok()).collect();
                let layout = Layout { size: numbers[0], alignment: numbers[1], fields: Vec::new() };
                layouts.insert(name.to_owned(), layout);
                name.to_owned()
            });
        }
        let cells: Vec<&str> = line.split('|').map(str::trim).collect();
        if let (Some(name), Some(Ok(offset))) = (&current, cells.get(1).map(|cell| cell.parse::<usize>())) {
            let field = cells[3].trim_matches('`').to_owned();
            layouts.get_mut(name).unwrap().fields.push((field, offset, size_of_type(cells[2])));
        }
    }
    layouts
}

fn python() -> String {
    std::env::var("SONOLOOP_PYTHON").unwrap_or_else(|_| "python3".into())
}

#[test]
fn truth_every_struct_lies_in_memory_as_the_page_says() {
    assert_eq!(of_the_code(), of_the_page());
    for (name, layout) in of_the_code() {
        let mut end = 0;
        for (field, offset, size) in &layout.fields {
            assert_eq!(*offset, end, "hidden padding before {field} of {name}");
            end = offset + size;
        }
        assert_eq!(end, layout.size, "hidden padding at the end of {name}");
    }
}

#[test]
fn truth_python_lays_the_messages_out_as_the_page_says() {
    let output = match Process::new(python()).arg(docs("wire/tracker.py")).arg("--layout").output() {
        Ok(output) => output,
        Err(error) => {
            println!("SKIPPED: {} does not start ({error})", python());
            return;
        }
    };
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let mut layouts = Layouts::new();
    for line in String::from_utf8(output.stdout).unwrap().lines() {
        let words: Vec<&str> = line.split_whitespace().collect();
        let number = |index: usize| words[index].parse::<usize>().unwrap();
        if words.len() == 3 {
            let layout = Layout { size: number(1), alignment: number(2), fields: Vec::new() };
            layouts.insert(words[0].to_owned(), layout);
        } else {
            layouts.get_mut(words[0]).unwrap().fields.push((words[1].to_owned(), number(2), number(3)));
        }
    }
    let mut page = of_the_page();
    // A tracker has no business with the truth.
    page.remove("sonoloop::Truth");
    assert_eq!(layouts, page);
}

/// A bright spot on a dim background.
fn spot(u: usize, v: usize) -> Image {
    let mut image = Image::black(640, 480);
    image.pixels.fill(20);
    image.pixels[v * 640 + u] = 200;
    image
}

#[test]
fn conformance_of_the_python_tracker() {
    let _watchdog = Watchdog::start();
    if !has_package() {
        return;
    }
    let domain = domain();
    let (name, root) = (domain.name().to_owned(), domain.root().to_owned());
    // A run id that only 64-bit integers hold.
    let setup = setup(u64::MAX - 1);
    let mut sim = SimEndpoint::create(&domain, &setup).unwrap();
    let [u0, v0] = setup.click_px.expect("a click").map(|c| c.round() as usize);

    let mut tracker = start(&domain);
    let Wait::Got(hello) = sim.wait_ready(PATIENCE, || alive(&mut tracker)).unwrap() else {
        panic!("no hello")
    };
    assert_eq!((hello.name.as_str(), hello.version.as_str()), ("brightest-pixel", "0.1"));
    let mut latencies = Vec::new();
    for k in 0..40 {
        let (u, v) = (u0 + 4 * k, v0 + 3 * k);
        let begin = Instant::now();
        sim.publish_image(&acquisition(k as u64), &spot(u, v), true).unwrap();
        let answer = sim.wait_answer(k as u64, PATIENCE, || alive(&mut tracker)).unwrap();
        latencies.push(begin.elapsed());
        let Wait::Got(Answer::Command(command)) = answer else { panic!("image {k}: {answer:?}") };
        assert_eq!(command.estimate.state, TrackState::Tracking);
        assert_eq!(command.estimate.tip_px, Some([u as f64, v as f64]));
        assert_eq!(command.estimate.tip_level, Some(200.0));
        assert_eq!((command.estimate.ncc_anchor, command.target_base_from_probe), (None, None));
        // A hand inserts in every third image, see `acquisition`.
        assert_eq!(command.feed_m_s, if k % 3 == 0 { 0.0 } else { setup.servo.feed_m_s });
    }
    latencies.sort();
    println!("round trip to Python: median {:?}, worst {:?}", latencies[20], latencies[39]);

    // Killed and restarted, it goes on from its checkpoint, skips what it owes no answer, and loses the spot.
    tracker.0.kill().unwrap();
    tracker.0.wait().unwrap();
    let checkpoint = sim.latest_checkpoint().unwrap().unwrap();
    assert_eq!(
        String::from_utf8_lossy(&checkpoint),
        format!("[{:?}, {:?}]", (u0 + 156) as f64, (v0 + 117) as f64)
    );
    sim.publish_checkpoint(&checkpoint).unwrap();
    let mut tracker = start(&domain);
    assert!(matches!(sim.wait_ready(PATIENCE, || alive(&mut tracker)).unwrap(), Wait::Got(_)));
    sim.publish_image(&acquisition(40), &spot(u0 + 150, v0 + 110), false).unwrap();
    sim.publish_image(&acquisition(41), &spot(u0 + 160, v0 + 120), true).unwrap();
    let answer = sim.wait_answer(41, PATIENCE, || alive(&mut tracker)).unwrap();
    let Wait::Got(Answer::Command(command)) = answer else { panic!("{answer:?}") };
    assert_eq!(command.estimate.tip_px, Some([(u0 + 160) as f64, (v0 + 120) as f64]));
    sim.publish_image(&acquisition(42), &spot(10, 10), true).unwrap();
    let answer = sim.wait_answer(42, PATIENCE, || alive(&mut tracker)).unwrap();
    let Wait::Got(Answer::Command(command)) = answer else { panic!("{answer:?}") };
    assert_eq!((command.estimate.state, command.feed_m_s), (TrackState::Lost, 0.0));
    assert!(sim.take_refusals().is_empty());

    // It ends with the run, of itself.
    sim.publish_end(EndReason::TargetReached).unwrap();
    assert!(tracker.0.wait().unwrap().success());
    drop(sim);
    drop(domain);
    assert_eq!(leftovers(&name, &root), Vec::<PathBuf>::new());
}

#[test]
fn the_python_tracker_ends_with_a_simulator_that_goes_without_a_word() {
    let _watchdog = Watchdog::start();
    if !has_package() {
        return;
    }
    let domain = domain();
    let (name, root) = (domain.name().to_owned(), domain.root().to_owned());
    let sim = SimEndpoint::create(&domain, &setup(5)).unwrap();
    let mut tracker = start(&domain);
    assert!(matches!(sim.wait_ready(PATIENCE, || alive(&mut tracker)).unwrap(), Wait::Got(_)));
    drop(sim);
    drop(domain);
    assert!(tracker.0.wait().unwrap().success());
    assert_eq!(leftovers(&name, &root), Vec::<PathBuf>::new());
}

fn has_package() -> bool {
    let has_package = Process::new(python())
        .args(["-c", "import iceoryx2"])
        .stderr(Stdio::null())
        .status()
        .is_ok_and(|status| status.success());
    if !has_package {
        println!(
            "SKIPPED: {} has no package iceoryx2; `pip install iceoryx2==0.10.*` somewhere and name that \
             interpreter in SONOLOOP_PYTHON",
            python()
        );
    }
    has_package
}

fn start(domain: &Domain) -> Kid {
    Kid(Process::new(python())
        .arg(docs("wire/tracker.py"))
        .env(DOMAIN_VARIABLE, domain.name())
        .env(ROOT_VARIABLE, domain.root())
        .spawn()
        .unwrap())
}

fn alive(kid: &mut Kid) -> bool {
    kid.0.try_wait().is_ok_and(|status| status.is_none())
}
