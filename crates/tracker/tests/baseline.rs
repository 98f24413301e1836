//! The authors' earlier method: how well it finds a needle, and what it takes for one.

mod support;

use proptest::prelude::*;
use sonoloop_tracker::baseline::{BRIDGED_IMAGES, BaselineTracker, Entry, Insertion, Localizer, localize};
use sonoloop_tracker::{Context, Tracker};
use sonoloop_types::{Image, Profile, Reason, TrackState, TrackerSettings};
use support::{NeedleScene, distance, in_parallel, median};

const ANGLES_RAD: [f64; 3] = [0.2, 0.45, -0.5];

/// The scenes' needles come in from the left; at −0.5 rad they rise.
const FROM_THE_LEFT: Insertion = Insertion { entry: Entry::Left, angle_rad: [-1.5, 1.5] };

fn tip_at(scene: &NeedleScene, k: u32) -> [f64; 2] {
    let (start, step) = scene.path();
    [start[0] + f64::from(k) * step[0], start[1] + f64::from(k) * step[1]]
}

/// Errors along the needle (positive = beyond the tip) and across it, of every image; `None` where none was found.
fn errors_px(seed: u64, background: f32, angle_rad: f64) -> Vec<Option<[f64; 2]>> {
    let mut scene = NeedleScene::new(seed, background, angle_rad);
    let mut localizer = Localizer::new(FROM_THE_LEFT);
    let (sin, cos) = angle_rad.sin_cos();
    let one = |k: u32| {
        let tip = tip_at(&scene, k);
        let found = localizer.localize(&scene.image(tip, 1.0))?;
        let [du, dv] = [found.tip_px[0] - tip[0], found.tip_px[1] - tip[1]];
        Some([du * cos + dv * sin, dv * cos - du * sin])
    };
    (0..120).step_by(10).map(one).collect()
}

/// Measured on 50 images per background and angle of seeds 1000 to 1009, by which the tip's floor was chosen: 100 % within
/// 4 px at background 0.1 and 99 % at 0.3; the median lies 2.2 to 2.6 px beyond the tip (the glow of its bead under
/// log compression) and 0.1 px beside the axis. The seeds here took no part in any choice.
#[test]
fn truth_needles_are_localised_within_four_pixels() {
    for background in [0.1, 0.3] {
        for angle_rad in ANGLES_RAD {
            let seeds: Vec<u64> = (2000..2006).collect();
            let errors: Vec<_> = in_parallel(&seeds, |seed| errors_px(*seed, background, angle_rad)).concat();
            let near = |e: &&Option<[f64; 2]>| e.is_some_and(|[along, across]| along.hypot(across) < 4.0);
            let share = errors.iter().filter(near).count() as f64 / errors.len() as f64;
            let found = || errors.iter().flatten();
            let along = median(&found().map(|e| e[0]).collect::<Vec<_>>());
            let across = median(&found().map(|e| e[1].abs()).collect::<Vec<_>>());
            assert!(share >= 0.9, "background {background}, {angle_rad} rad: {share}");
            assert!(across < 0.5, "background {background}, {angle_rad} rad: {across} px across");
            assert!(
                (0.0..3.5).contains(&along),
                "background {background}, {angle_rad} rad: {along} px along"
            );
        }
    }
}

#[test]
fn the_entry_decides_which_end_is_the_tip() {
    // A band in the middle of the picture that touches no border, from (150, 100) to (350, 200).
    let mut image = Image { pixels: vec![60; 500 * 300], ..Image::black(500, 300) };
    draw_line(&mut image, [150.0, 100.0], [350.0, 200.0]);
    for (entry, tip) in
        [(Entry::Shallower, [350.0, 200.0]), (Entry::Left, [350.0, 200.0]), (Entry::Right, [150.0, 100.0])]
    {
        let found = localize(&image, Insertion { entry, ..Insertion::default() }).expect("a line");
        assert!(distance(found.tip_px, tip) < 4.0, "{entry:?}: {found:?}");
        assert!((0.0..=1.0).contains(&found.confidence));
        assert!((found.axis_px[0].hypot(found.axis_px[1]) - 1.0).abs() < 1e-12);
    }
    let steep = Insertion { angle_rad: [0.8, 1.5], ..Insertion::default() };
    assert_eq!(localize(&image, steep), None, "an angle that was excluded");
}

/// A bright line of a needle's width, as log compression draws it.
fn draw_line(image: &mut Image, from: [f64; 2], to: [f64; 2]) {
    let length = distance(from, to);
    let along = [(to[0] - from[0]) / length, (to[1] - from[1]) / length];
    let width = image.width_px as usize;
    for (index, pixel) in image.pixels.iter_mut().enumerate() {
        let [du, dv] = [(index % width) as f64 - from[0], (index / width) as f64 - from[1]];
        let across = dv * along[0] - du * along[1];
        if (0.0..=length).contains(&(du * along[0] + dv * along[1])) {
            *pixel = (*pixel).max((200.0 - 9.0 * across * across).max(0.0) as u8);
        }
    }
}

/// A needle that leaves the plane at image 40, beside a line that stays.
struct Misaligned {
    /// Images of the last 15 in which the baseline is TRACKING within 5 px of the line's deeper end.
    on_the_decoy: u32,
    /// Images of the last 25 in which `Tracker` is LOST, and in which it is TRACKING.
    lost: u32,
    tracking: u32,
}

fn misalign(seed: u64, background: f32, decoy_px: [[f64; 2]; 2]) -> Misaligned {
    const GONE: u32 = 40;
    let mut scene = NeedleScene::new(seed, background, 0.45);
    let mut frame = |k: u32| {
        let mut image = scene.image(tip_at(&scene, k), if k < GONE { 1.0 } else { 0.0 });
        draw_line(&mut image, decoy_px[0], decoy_px[1]);
        image
    };
    let settings = TrackerSettings::profile(Profile::Robust, 20);
    let mut visual = Tracker::new(settings, &frame(0), [120.0, 120.0]).expect("a sound first image");
    let mut baseline = BaselineTracker::new(Insertion::default());
    let mut result = Misaligned { on_the_decoy: 0, lost: 0, tracking: 0 };
    for k in 1..GONE + 30 {
        let image = frame(k);
        let [old, new] = [baseline.track(&image), visual.track(&image, &Context::default())];
        assert_eq!((old.ncc_previous, old.ncc_anchor), (None, None));
        if k >= GONE + 5 {
            result.lost += u32::from(new.state == TrackState::Lost);
            result.tracking += u32::from(new.state == TrackState::Tracking);
        }
        // The filter takes its time over the jump of some 200 px.
        if k >= GONE + 15 {
            let near = old.tip_px.is_some_and(|tip| distance(tip, decoy_px[1]) < 5.0);
            result.on_the_decoy +=
                u32::from(near && (old.state, old.reason) == (TrackState::Tracking, Reason::Ok));
        }
    }
    result
}

/// The decoys do not run in the needle's direction: the end of one that does, and is as wide and bright, now and then
/// passes for the tip in `Tracker`'s search of the whole image too. The baseline is told from it by neither.
#[test]
fn misaligned_it_takes_a_decoy_for_the_needle_and_the_tracker_does_not() {
    let decoys = [[[560.0, 80.0], [460.0, 180.0]], [[400.0, 80.0], [440.0, 180.0]]];
    let mut cases = Vec::new();
    for (seed, background) in [(2101, 0.1), (2102, 0.3), (2103, 0.5)] {
        cases.extend(decoys.map(|decoy_px| (seed, background, decoy_px)));
    }
    let results = in_parallel(&cases, |(seed, background, decoy_px)| misalign(*seed, *background, *decoy_px));
    for (case, result) in cases.iter().zip(&results) {
        assert!(result.on_the_decoy >= 14, "{case:?}: on the decoy in {} of 15", result.on_the_decoy);
        assert_eq!(result.tracking, 0, "{case:?}");
        assert!(result.lost >= 23, "{case:?}: lost in {} of 25", result.lost);
    }
}

#[test]
fn without_needle_and_decoy_it_searches_and_after_the_bridge_it_is_lost() {
    for (seed, background) in [(2201, 0.1), (2202, 0.3), (2203, 1.0)] {
        let mut scene = NeedleScene::new(seed, background, 0.45);
        let mut tracker = BaselineTracker::new(Insertion::default());
        for _ in 0..5 {
            let estimate = tracker.track(&scene.image([0.0; 2], 0.0));
            assert_eq!(
                (estimate.state, estimate.reason, estimate.tip_px),
                (TrackState::Searching, Reason::NoCandidate, None)
            );
        }
        for k in 0..30 {
            let tip = tip_at(&scene, k);
            assert_eq!(tracker.track(&scene.image(tip, 1.0)).state, TrackState::Tracking);
        }
        let mut last = tip_at(&scene, 29);
        for k in 30..30 + BRIDGED_IMAGES {
            let estimate = tracker.track(&scene.image([0.0; 2], 0.0));
            assert_eq!((estimate.state, estimate.reason), (TrackState::Tracking, Reason::NoCandidate));
            last = estimate.tip_px.expect("a tip");
            // The prediction goes on at the needle's speed.
            assert!(distance(last, tip_at(&scene, k)) < 8.0, "{last:?}");
        }
        for _ in 0..5 {
            let estimate = tracker.track(&scene.image([0.0; 2], 0.0));
            assert_eq!((estimate.state, estimate.reason), (TrackState::Lost, Reason::NoCandidate));
            assert_eq!(estimate.tip_px, Some(last), "frozen");
        }
        // The next needle begins anew, wherever it is.
        let elsewhere = [430.0, 310.0];
        let estimate = tracker.track(&scene.image(elsewhere, 1.0));
        assert_eq!((estimate.state, estimate.reason), (TrackState::Tracking, Reason::Ok));
        assert!(distance(estimate.tip_px.expect("a tip"), elsewhere) < 8.0);
    }
}

#[test]
fn what_it_saw_before_does_not_change_what_it_finds() {
    let mut scene = NeedleScene::new(2301, 0.3, 0.45);
    let images = [[120.0, 120.0], [300.0, 200.0]].map(|tip| scene.image(tip, 1.0));
    let mut used = Localizer::new(Insertion::default());
    used.localize(&images[0]);
    used.localize(&Image::black(50, 300));
    assert_eq!(used.localize(&images[1]), localize(&images[1], Insertion::default()));
}

#[test]
fn nothing_is_found_where_nothing_can_be() {
    let constant = |width_px: u32, height_px: u32, level: u8| Image {
        pixels: vec![level; (width_px * height_px) as usize],
        ..Image::black(width_px, height_px)
    };
    let mut tracker = BaselineTracker::new(Insertion::default());
    for image in [
        constant(1, 1, 7),
        constant(47, 640, 7),
        constant(640, 480, 0),
        constant(640, 480, 255),
        Image { width_px: u32::MAX, height_px: u32::MAX, pixels: vec![0; 4] },
        Image { width_px: 0, height_px: 0, pixels: Vec::new() },
        Image { pixels: vec![1; 7], ..Image::black(640, 480) },
    ] {
        assert_eq!(tracker.track(&image).state, TrackState::Searching);
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 200, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn whatever_comes_in_the_answer_is_finite(
        sizes in prop::collection::vec((1_u32..150, 1_u32..150), 1..4),
        seed: u32,
        sparsity in 0_u32..4,
        low in -2.0..2.0_f64,
        high in -2.0..2.0_f64,
        entry in prop::sample::select(vec![Entry::Shallower, Entry::Left, Entry::Right]),
    ) {
        let mut tracker = BaselineTracker::new(Insertion { entry, angle_rad: [low, high] });
        let mut x = seed;
        for (width_px, height_px) in sizes {
            let mut image = Image::black(width_px, height_px);
            for pixel in &mut image.pixels {
                x = x.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
                // From noise to few saturated specks.
                *pixel = match sparsity {
                    0 => (x >> 24) as u8,
                    1 => if x >> 31 == 0 { 0 } else { 255 },
                    2 => if x >> 25 == 0 { 255 } else { 0 },
                    _ => if x >> 29 == 0 { 200 } else { 60 },
                };
            }
            draw_line(&mut image, [0.0, f64::from(seed % 150)], [150.0, f64::from(seed % 149)]);
            let estimate = tracker.track(&image);
            if let Some(tip) = estimate.tip_px {
                prop_assert!(tip.iter().all(|c| c.is_finite()));
                prop_assert!(estimate.state != TrackState::Searching);
            }
        }
    }
}
