use sonoloop_types::Similarity;

use super::*;

/// A bright spot that moves over a still, wavy ground, and is gone for some images.
fn image(k: u32) -> Image {
    let shown = if (20..30).contains(&k) { 0.0 } else { 150.0 };
    let level = |u: f64, v: f64| {
        let (x, y) = (u - 60.0 - 1.7 * f64::from(k), v - 60.0 - 0.4 * f64::from(k));
        let ground = 70.0 + 30.0 * libm::sin(0.9 * u) * libm::cos(0.7 * v);
        ground + shown * libm::exp(-(x * x / 18.0 + y * y / 10.0))
    };
    let pixels = (0..140).flat_map(|v| (0..300).map(move |u| level(u.into(), v.into()) as u8));
    Image::from_pixels(300, 140, pixels.collect()).expect("as many pixels as the size says")
}

#[test]
fn every_instruction_set_gives_the_same_answers() {
    let images: Vec<Image> = (0..50).map(image).collect();
    for (profile, similarity, warp, template_px) in [
        (Profile::Robust, Similarity::Scv, Warp::Affine, 20),
        (Profile::Robust, Similarity::Ssd, Warp::Translation, 33),
        (Profile::Paper, Similarity::Ssd, Warp::Rigid, 20),
    ] {
        let settings = TrackerSettings {
            similarity,
            warp,
            pyramid_levels: 2,
            ..TrackerSettings::profile(profile, template_px)
        };
        let answers = Instructions::available().into_iter().map(|set| {
            let mut tracker = Tracker::with(set, settings, &images[0], [60.0, 60.0]).expect("a spot");
            images[1..].iter().map(|image| tracker.track(image, &Context::default())).collect::<Vec<_>>()
        });
        let answers: Vec<_> = answers.collect();
        assert!(answers.iter().all(|other| *other == answers[0]));
        assert!(answers[0].iter().any(|answer| answer.state == TrackState::Lost));
    }
}

#[test]
fn a_drift_beyond_its_tolerance_keeps_the_last_template_whatever_found_the_first_one() {
    // Spot and ground move together, so that the refinement takes part.
    let image = |k: u32| {
        let level = |u: f64, v: f64| {
            let (x, y) = (u - 60.0 - 1.3 * f64::from(k), v - 60.0 - 0.4 * f64::from(k));
            let ground = 70.0 + 30.0 * libm::sin(0.9 * x) * libm::cos(0.7 * y);
            ground + 150.0 * libm::exp(-(x * x / 18.0 + y * y / 10.0))
        };
        let pixels = (0..140).flat_map(|v| (0..200).map(move |u| level(u.into(), v.into()) as u8));
        Image::from_pixels(200, 140, pixels.collect()).expect("as many pixels as the size says")
    };
    for refine in [true, false] {
        for (drift_tolerance_px, keeps) in [(0.0, true), (3.0, false)] {
            let settings = TrackerSettings {
                refine,
                drift_tolerance_px,
                ..TrackerSettings::profile(Profile::Robust, 20)
            };
            let mut tracker = Tracker::new(settings, &image(0), [60.0, 60.0]).expect("a spot");
            for k in 1..15 {
                assert_eq!(tracker.track(&image(k), &Context::default()).state, TrackState::Tracking);
            }
            let kept = tracker.previous.padded == tracker.anchor.padded;
            assert_eq!(kept, keeps, "refine {refine}, tolerance {drift_tolerance_px}");
        }
    }
}

#[test]
fn the_level_is_that_of_the_brightest_spot() {
    let settings = TrackerSettings::profile(Profile::Robust, 20);
    let spot = |shown: f64| {
        let level = |u: f64, v: f64| {
            let (x, y) = (u - 60.0, v - 60.0);
            let ground = 70.0 + 20.0 * libm::sin(0.9 * u) * libm::cos(0.7 * v);
            ground + shown * libm::exp(-(x * x / 18.0 + y * y / 10.0))
        };
        let pixels = (0..120).flat_map(|v| (0..120).map(move |u| level(u.into(), v.into()) as u8));
        Image::from_pixels(120, 120, pixels.collect()).expect("as many pixels as the size says")
    };
    let mut tracker = Tracker::new(settings, &spot(130.0), [60.0, 60.0]).expect("a spot");
    let mut level = |shown| tracker.track(&spot(shown), &Context::default()).tip_level.expect("a level");
    let (full, dimmed) = (level(130.0), level(110.0));
    // Blurred by σ 1.5 px a spot of σ 3 and 2.2 px keeps 0.74 of its height.
    assert!((full - dimmed - 0.74 * 20.0).abs() < 1.0, "{full} {dimmed}");
}
