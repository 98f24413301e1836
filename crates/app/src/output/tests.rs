//! Whole folders, written from a made-up run and read back.

use std::fs;
use std::path::Path;

use sonoloop_types::{Image, ImageGeometry};

use super::colour::COLOURS;
use super::test_run::{PERIOD, run, scenario};
use super::*;
use crate::judge::{Facts, metrics, verdict};
use embedded_graphics::prelude::RgbColor;

const SMALL: ImageGeometry = ImageGeometry { width_px: 128, height_px: 96, spacing_m: 5e-4 };

/// Grey noise with a white dot at the tip.
fn dotted(sequence: u64, tip_px: [f64; 2], _offset_m: f64) -> Image {
    let mut image = Image::black(SMALL.width_px, SMALL.height_px);
    let mut word = sequence.wrapping_mul(0x9E37_79B9_7F4A_7C15) | 1;
    for pixel in &mut image.pixels {
        word = word.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
        *pixel = (word >> 58) as u8;
    }
    let place = tip_px[1].round() as usize * SMALL.width_px as usize + tip_px[0].round() as usize;
    image.pixels[place] = 255;
    image
}

fn write(folder: &Path) -> (Option<VideoKind>, Recording) {
    let scenario = scenario(SMALL);
    let recording = run(&scenario, 24, dotted);
    let metrics = metrics(&recording, &Facts::of(&scenario));
    let judged = verdict(&metrics, &scenario.expect);
    let outcome = Outcome {
        scenario: &scenario,
        recording: &recording,
        metrics: &metrics,
        judged: &judged,
        tracker: &TrackerName::own(),
        version: "0.1.0",
    };
    let video = write_outcome_with(folder, &outcome, |stage| stage.write("sequence.mha", "ObjectType"));
    (video.unwrap(), recording)
}

fn text(folder: &Path, name: &str) -> String {
    fs::read_to_string(folder.join(name)).unwrap()
}

#[test]
fn a_run_leaves_every_file_and_nothing_beside_them() {
    let root = tempfile::tempdir().unwrap();
    let folder = root.path().join("out");
    let (video, recording) = write(&folder);
    let video = video.unwrap();
    let mut expected = vec![
        "events.csv",
        "images.csv",
        "insertion.svg",
        "pictures.mjpeg",
        "report.html",
        "scenario.yaml",
        "sequence.mha",
        "summary.json",
        "tracking.svg",
        video.file_name(),
    ];
    expected.sort_unstable();
    let mut names: Vec<String> = fs::read_dir(&folder)
        .unwrap()
        .map(|entry| entry.unwrap().file_name().to_string_lossy().into_owned())
        .collect();
    names.sort();
    assert_eq!(names, expected);
    assert_eq!(fs::read_dir(root.path()).unwrap().count(), 1);

    let summary: serde_json::Value = serde_json::from_str(&text(&folder, "summary.json")).unwrap();
    assert_eq!(summary["verdict"], "pass", "{summary}");
    assert_eq!(summary["metrics"]["losses"], 1);
    assert_eq!(text(&folder, "images.csv").lines().count(), recording.images.len() + 1);
    assert!(text(&folder, "scenario.yaml").ends_with("name: made_up\nseed: 3\n"));
    assert!(text(&folder, "scenario.yaml").starts_with("# resolved by sonoloop 0.1.0\n# made_up, seed 3,"));
}

#[test]
fn equal_runs_leave_equal_files_whatever_the_clock_said() {
    let root = tempfile::tempdir().unwrap();
    let (first, second) = (root.path().join("a"), root.path().join("b"));
    write(&first);
    write(&second);
    // Written over an older run: the same again.
    write(&second);
    for name in ["images.csv", "events.csv", "tracking.svg", "insertion.svg", "scenario.yaml"] {
        assert_eq!(text(&first, name), text(&second, name), "{name}");
    }
    let scenario = scenario(SMALL);
    let mut slower = run(&scenario, 24, dotted);
    slower.timing.wall_s = 99.0;
    assert_eq!(images_csv(&slower.images, &scenario.probe), text(&first, "images.csv"));
}

#[test]
fn the_page_stands_alone_and_escapes_what_it_shows() {
    let root = tempfile::tempdir().unwrap();
    let folder = root.path().join("out");
    write(&folder);
    let page = text(&folder, "report.html");
    assert!(page.len() < 5_000_000);
    for outside in ["src=\"http", "href=\"http", "<script src", "url(", "fetch("] {
        assert!(!page.contains(outside), "{outside}");
    }
    assert!(page.contains("Not for clinical use"));
    assert!(page.contains("A run &lt;made up&gt; to be written"));
    assert!(page.contains("<pre># resolved by sonoloop 0.1.0\n# made_up, seed 3,"));
    assert!(page.contains("target reached, &quot;0.0&quot; mm off"));
    assert_eq!(page.matches("<image href=\"data:image/jpeg;base64,").count(), 6);
    let [opened, closed] = ["<section>", "</section>"].map(|tag| page.matches(tag).count());
    assert_eq!((opened, closed), (7, 7));
}

#[test]
fn overlay_keeps_the_picture_and_uses_known_colours_only() {
    let scenario = scenario(SMALL);
    let recording = run(&scenario, 24, dotted);
    let mut display = Display::new(&scenario, &recording);
    display.show_truth = false;
    let known = |pixel: &image::Rgb<u8>| {
        let [r, g, b] = pixel.0;
        (r == g && g == b) || COLOURS.iter().any(|c| (c.r(), c.g(), c.b()) == (r, g, b))
    };
    for (index, row) in recording.images.iter().enumerate() {
        let image = recording.pixels.as_ref().unwrap().get(index).unwrap();
        let drawn = display.draw(&image, row, Scale::Full);
        assert_eq!((drawn.width() % 2, drawn.height() % 2), (0, 0));
        assert!(drawn.pixels().all(known));
        // The bottom row lies under no mark: the picture's own greys, margins cut.
        let bottom = drawn.height() - 24 - 1;
        let shown: Vec<u8> = (128..drawn.width() - 128).map(|x| drawn.get_pixel(x, bottom).0[0]).collect();
        let original = image.row(SMALL.height_px - 1);
        assert!(original.windows(shown.len()).any(|part| part == shown), "image {index}");
    }
}

#[test]
fn tracked_box_has_the_colour_of_the_state_and_truth_can_be_hidden() {
    let scenario = scenario(SMALL);
    let recording = run(&scenario, 24, dotted);
    let black = Image::black(SMALL.width_px, SMALL.height_px);
    let count = |row, show_truth, colour: embedded_graphics::pixelcolor::Rgb888| {
        let mut display = Display::new(&scenario, &recording);
        display.show_truth = show_truth;
        let drawn = display.draw(&black, row, Scale::Full);
        let width = drawn.width();
        let inside = drawn
            .enumerate_pixels()
            .filter(|(x, y, _)| (128..width - 128).contains(x) && (24..24 + SMALL.height_px).contains(y));
        inside.filter(|(_, _, pixel)| pixel.0 == [colour.r(), colour.g(), colour.b()]).count()
    };
    let (tracking, lost) = (&recording.images[0], &recording.images[10]);
    assert!(count(tracking, false, colour::TRACKING) > 20 && count(tracking, false, colour::LOST) == 0);
    assert!(count(lost, false, colour::LOST) > 20 && count(lost, false, colour::TRACKING) == 0);
    assert!(count(tracking, true, colour::TRUTH) > 10 && count(tracking, false, colour::TRUTH) == 0);
}

#[test]
fn the_animation_plays_in_real_time() {
    let scenario = scenario(SMALL);
    let recording = run(&scenario, 25, dotted);
    let display = Display::new(&scenario, &recording);
    let frames = Frames::new(&recording.images, recording.pixels.as_ref().unwrap(), &display, PERIOD);
    let root = tempfile::tempdir().unwrap();
    let path = root.path().join("video.gif");
    let thinning = write_gif(&path, &frames).unwrap();
    assert_eq!((thinning.stride, thinning.scale), (2, Scale::Full));
    let mut decoder = gif::Decoder::new(fs::File::open(&path).unwrap()).unwrap();
    let mut delays_cs = Vec::new();
    while let Some(frame) = decoder.read_next_frame().unwrap() {
        delays_cs.push(frame.delay);
    }
    assert_eq!(delays_cs.pop(), Some(200), "the end stays on the screen");
    assert_eq!(delays_cs, [8; 12]);
}
