//! Whatever comes in, an answer or an error comes out.

mod support;

use proptest::prelude::*;
use sonoloop_tracker::{Checkpoint, Context, Tracker, TrackerError};
use sonoloop_types::{Image, Profile, Reason, Similarity, TrackState, TrackerSettings, UpdateStrategy};
use support::NeedleScene;

fn speckled(width_px: u32, height_px: u32, seed: u32) -> Image {
    let mut x = seed;
    let pixels = (0..width_px * height_px).map(|_| {
        x = x.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        (x >> 24) as u8
    });
    Image { width_px, height_px, pixels: pixels.collect() }
}

fn constant(width_px: u32, height_px: u32, level: u8) -> Image {
    Image { width_px, height_px, pixels: vec![level; (width_px * height_px) as usize] }
}

#[test]
fn bad_first_images_and_clicks_are_refused() {
    let settings = TrackerSettings::profile(Profile::Robust, 20);
    let image = speckled(100, 80, 1);
    let new = |image: &Image, tip_px| Tracker::new(settings, image, tip_px).map(|_| ()).unwrap_err();
    for tip_px in [[-1.0, 40.0], [50.0, 80.0], [f64::NAN, 40.0], [50.0, f64::INFINITY], [1e300, 40.0]] {
        assert!(matches!(new(&image, tip_px), TrackerError::TipOutside { .. }), "{tip_px:?}");
    }
    // In a corner three quarters of the template are outside.
    assert!(matches!(new(&image, [0.0, 0.0]), TrackerError::TipOutside { .. }));
    assert!(matches!(new(&speckled(19, 80, 1), [9.0, 40.0]), TrackerError::TemplateTooLarge { .. }));
    assert!(matches!(new(&constant(1, 1, 9), [0.0, 0.0]), TrackerError::TemplateTooLarge { .. }));
    assert!(matches!(new(&constant(100, 80, 0), [50.0, 40.0]), TrackerError::NoTexture { .. }));
    assert!(matches!(new(&constant(100, 80, 255), [50.0, 40.0]), TrackerError::NoTexture { .. }));
    let short = Image { pixels: vec![1; 7], ..image.clone() };
    assert!(matches!(new(&short, [50.0, 40.0]), TrackerError::Image { .. }));
    let empty = Image { width_px: 0, height_px: 0, pixels: Vec::new() };
    assert!(matches!(new(&empty, [50.0, 40.0]), TrackerError::Image { .. }));

    let wrong = TrackerSettings { epsilon_px: f64::NAN, ..settings };
    let error = Tracker::new(wrong, &image, [50.0, 40.0]).map(|_| ()).unwrap_err();
    assert!(error.to_string().contains("epsilon_px = NaN must be in"), "{error}");
}

#[test]
fn unusable_images_are_losses_and_the_tip_stays() {
    let settings = TrackerSettings::profile(Profile::Robust, 20);
    let image = speckled(100, 80, 1);
    let tip_px = [50.0, 40.0];
    let broken = [
        constant(100, 80, 0),
        constant(100, 80, 255),
        constant(1, 1, 3),
        Image { pixels: Vec::new(), ..image.clone() },
        Image { width_px: u32::MAX, height_px: u32::MAX, pixels: vec![0; 4] },
        speckled(100, 80, 2),
    ];
    for bad in broken {
        let mut tracker = Tracker::new(settings, &image, tip_px).unwrap();
        assert_eq!(tracker.last_estimate().state, TrackState::Tracking);
        for _ in 0..15 {
            let estimate =
                tracker.track(&bad, &Context { motion_px: Some([f64::NAN, 0.0]), ..Context::default() });
            assert_ne!(estimate.state, TrackState::Tracking, "{estimate:?}");
        }
        assert_eq!(tracker.tip_px(), tip_px);
        // The picture is back: three images confirm it.
        let states = [0, 1, 2].map(|_| tracker.track(&image, &Context::default()).state);
        assert_eq!(states, [TrackState::Recovering, TrackState::Recovering, TrackState::Tracking]);
    }
}

#[test]
fn a_restart_begins_lost_and_needs_a_fresh_confirmation() {
    let mut scene = NeedleScene::new(91, 0.3, 0.45);
    let (mut tip, step) = scene.path();
    let settings = TrackerSettings::profile(Profile::Robust, 20);
    let mut tracker = Tracker::new(settings, &scene.image(tip, 1.0), tip).unwrap();
    for _ in 0..20 {
        tip = [tip[0] + step[0], tip[1] + step[1]];
        assert_eq!(tracker.track(&scene.image(tip, 1.0), &Context::default()).state, TrackState::Tracking);
    }
    let saved = tracker.checkpoint();
    let mut restarted = Tracker::restore(settings, &saved).unwrap();
    assert_eq!(restarted.state(), TrackState::Lost);
    assert_eq!(restarted.last_estimate().reason, Reason::Restarted);
    assert_eq!(restarted.tip_px(), tracker.tip_px());
    assert_eq!(restarted.checkpoint(), saved);

    let absent = restarted.track(&scene.image(tip, 0.0), &Context::default());
    assert_eq!((absent.state, absent.reason), (TrackState::Lost, Reason::Restarted));
    let states = [0, 1, 2].map(|_| restarted.track(&scene.image(tip, 1.0), &Context::default()).state);
    assert_eq!(states, [TrackState::Recovering, TrackState::Recovering, TrackState::Tracking]);
    assert!(support::distance(restarted.tip_px(), tip) < 1.5);
}

#[test]
fn impossible_checkpoints_are_refused() {
    let settings = TrackerSettings::profile(Profile::Robust, 20);
    let good = Tracker::new(settings, &speckled(100, 80, 1), [50.0, 40.0]).unwrap().checkpoint();
    let refuse = |spoil: fn(&mut Checkpoint)| {
        let mut bad = good.clone();
        spoil(&mut bad);
        assert!(matches!(Tracker::restore(settings, &bad), Err(TrackerError::Checkpoint(_))), "{bad:?}");
    };
    refuse(|c| c.template_px = 21);
    refuse(|c| c.picture_px = [0, 80]);
    refuse(|c| c.picture_px = [100, u32::MAX]);
    refuse(|c| c.tip_px[1] = f64::NAN);
    refuse(|c| c.tip_px[0] = 1e9);
    refuse(|c| c.anchor.padded.truncate(400));
    refuse(|c| c.previous.padded[7] = f32::NAN);
    refuse(|c| c.previous.padded[7] = 1e6);
    refuse(|c| c.anchor.padded.fill(12.0));
    refuse(|c| c.anchor.median = Some(f64::INFINITY));
    assert!(Tracker::restore(settings, &good).is_ok());
}

#[test]
fn the_same_images_give_the_same_answers() {
    let run = || {
        let mut scene = NeedleScene::new(92, 0.8, 0.2);
        let (start, step) = scene.path();
        let settings = TrackerSettings::profile(Profile::Robust, 20);
        let mut tracker = Tracker::new(settings, &scene.image(start, 1.0), start).unwrap();
        (1..30)
            .map(|k| {
                let tip = [start[0] + f64::from(k) * step[0], start[1] + f64::from(k) * step[1]];
                tracker.track(
                    &scene.image(tip, if (10..=15).contains(&k) { 0.0 } else { 1.0 }),
                    &Context::default(),
                )
            })
            .collect::<Vec<_>>()
    };
    assert_eq!(run(), run());
}

fn number() -> impl Strategy<Value = f64> {
    prop_oneof![-20.0..140.0_f64, Just(f64::NAN), Just(f64::INFINITY), Just(-1e300), Just(0.0)]
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 64, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn nothing_panics(
        side in 8_u32..40,
        size in [1_u32..90, 1_u32..90],
        tip in [number(), number()],
        motion in proptest::option::of([number(), number()]),
        seeds in [any::<u32>(), any::<u32>(), any::<u32>()],
        other in [1_u32..90, 1_u32..90],
        level in any::<u8>(),
        hold in any::<bool>(),
        profile in prop_oneof![Just(Profile::Paper), Just(Profile::Robust)],
        similarity in prop_oneof![Just(Similarity::Ssd), Just(Similarity::Scv)],
        update in prop_oneof![
            Just(UpdateStrategy::None), Just(UpdateStrategy::Naive), Just(UpdateStrategy::DriftCorrected)
        ],
    ) {
        let settings = TrackerSettings { similarity, update, ..TrackerSettings::profile(profile, side) };
        let first = speckled(size[0], size[1], seeds[0]);
        if let Ok(mut tracker) = Tracker::new(settings, &first, tip) {
            let context = Context { motion_px: motion, hold_confirmation: hold, axis_px: None };
            let images = [
                first.clone(),
                speckled(size[0], size[1], seeds[1]),
                constant(size[0], size[1], level),
                speckled(other[0], other[1], seeds[2]),
                Image { width_px: other[0], height_px: other[1], pixels: vec![level; 3] },
                first,
            ];
            for image in images.iter().cycle().take(14) {
                let estimate = tracker.track(image, &context);
                let [u, v] = estimate.tip_px.unwrap();
                prop_assert!(u.is_finite() && v.is_finite());
                for ncc in [estimate.ncc_anchor, estimate.ncc_previous].into_iter().flatten() {
                    prop_assert!((-1.0..=1.0).contains(&ncc));
                }
                prop_assert!(estimate.tip_level.is_none_or(|level| (0.0..=255.0).contains(&level)));
                prop_assert!(estimate.brightness_ratio.is_none_or(|ratio| ratio.is_finite() && ratio >= 0.0));
            }
            let restored = Tracker::restore(settings, &tracker.checkpoint());
            prop_assert!(restored.is_ok() || tracker.tip_px().iter().any(|c| c.abs() > 16_384.0));
        }
    }
}
