//! Whatever comes in, an answer or an error comes out.

mod support;

use proptest::prelude::*;
use proptest::test_runner::RngSeed;
use sonoloop_tracker::{Checkpoint, Context, Tracker, TrackerError, check_settings};
use sonoloop_types::{
    Confirmation, Disc, Guess, Image, Optimisation, Profile, Reason, Similarity, TrackState, TrackerSettings,
    UpdateStrategy, Warp,
};
use support::{NeedleScene, check_answer};

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
    refuse(|c| c.sharp = None);
    refuse(|c| {
        c.sharp = c.sharp.take().map(|mut t| {
            t.padded.pop();
            t
        })
    });
    refuse(|c| c.picture_px = [0, 80]);
    refuse(|c| c.picture_px = [100, u32::MAX]);
    refuse(|c| c.picture_px = [16_000, 16_000]);
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

/// What a picture may look like; sizes and buffers that do not match among them.
#[derive(Debug, Clone, Copy)]
enum Look {
    Noise(u32),
    Constant(u8),
    /// Black and white squares of so many pixels: saturated, and alike everywhere.
    Squares(u32),
    Ramp,
    /// One bright pixel on black.
    Dot,
    /// A buffer of so many pixels, whatever the size says.
    Broken(usize),
    /// A size that no memory holds.
    Huge,
}

fn picture([width_px, height_px]: [u32; 2], look: Look) -> Image {
    let of = |level: fn(u32, u32, u32) -> u8, by: u32| {
        let pixels = (0..height_px).flat_map(|v| (0..width_px).map(move |u| level(u, v, by))).collect();
        Image { width_px, height_px, pixels }
    };
    match look {
        Look::Noise(seed) => speckled(width_px, height_px, seed),
        Look::Constant(level) => constant(width_px, height_px, level),
        Look::Squares(side) => of(|u, v, side| if (u / side + v / side) % 2 == 0 { 255 } else { 0 }, side),
        Look::Ramp => of(|u, v, _| (3 * u + 2 * v) as u8, 0),
        Look::Dot => of(|u, v, by| if u == by / 2 && v == by / 3 { 255 } else { 0 }, width_px),
        Look::Broken(pixels) => Image { width_px, height_px, pixels: vec![9; pixels] },
        Look::Huge => Image { width_px: u32::MAX, height_px: u32::MAX, pixels: vec![9; 4] },
    }
}

fn look() -> impl Strategy<Value = Look> {
    prop_oneof![
        4 => any::<u32>().prop_map(Look::Noise),
        2 => any::<u8>().prop_map(Look::Constant),
        2 => (1_u32..9).prop_map(Look::Squares),
        1 => Just(Look::Ramp),
        1 => Just(Look::Dot),
        1 => (0_usize..99).prop_map(Look::Broken),
        1 => Just(Look::Huge),
    ]
}

/// From one pixel to a picture in which every template finds room.
fn size() -> impl Strategy<Value = [u32; 2]> {
    prop_oneof![4 => [20_u32..150, 20_u32..150], 2 => [1_u32..60, 1_u32..60], 1 => Just([1, 1])]
}

fn number() -> impl Strategy<Value = f64> {
    prop_oneof![
        4 => -20.0..170.0_f64,
        1 => -3.0..3.0_f64,
        1 => prop_oneof![
            Just(f64::NAN), Just(f64::INFINITY), Just(f64::NEG_INFINITY), Just(-1e300), Just(1e9), Just(9999.5),
            Just(f64::MIN_POSITIVE), Just(-0.0), Just(0.0)
        ],
    ]
}

fn confirmation() -> impl Strategy<Value = Confirmation> {
    prop_oneof![Just(Confirmation::Confirms), Just(Confirmation::Counts), Just(Confirmation::Held)]
}

fn context() -> impl Strategy<Value = Context<'static>> {
    let pair = || proptest::option::of([number(), number()]);
    let disc = (number(), number(), number()).prop_map(|(u, v, r)| Disc { centre_px: [u, v], radius_px: r });
    let told = (pair(), confirmation(), pair(), number(), proptest::option::of(number()), disc);
    told.prop_map(|(motion_px, confirmation, axis_px, unmeasured_px, reach_px, disc)| {
        // Lives as long as the test's process.
        let refused = Box::leak(Box::new([disc]));
        Context { motion_px, confirmation, axis_px, unmeasured_px, reach_px, refused }
    })
}

/// Anything that is accepted, the ends of every range included.
fn settings() -> impl Strategy<Value = TrackerSettings> {
    let kinds = (
        prop_oneof![Just(Profile::Paper), Just(Profile::Robust)],
        prop_oneof![Just(Similarity::Ssd), Just(Similarity::Scv)],
        prop_oneof![Just(Optimisation::FirstOrder), Just(Optimisation::SecondOrder)],
        prop_oneof![Just(Warp::Translation), Just(Warp::Rigid), Just(Warp::Affine)],
        prop_oneof![
            Just(UpdateStrategy::None),
            Just(UpdateStrategy::Naive),
            Just(UpdateStrategy::DriftCorrected)
        ],
        prop_oneof![6 => 8_u32..40, 1 => Just(8), 1 => Just(128)],
        prop_oneof![
            Just(Guess::None),
            Just(Guess::ConstantVelocity),
            Just(Guess::Kalman),
            Just(Guess::Insertion)
        ],
        1_u32..=3,
        any::<bool>(),
    );
    let plain = kinds.prop_map(
        |(profile, similarity, optimisation, warp, update, template_px, guess, pyramid_levels, refine)| {
            let basis = TrackerSettings::profile(profile, template_px);
            TrackerSettings { similarity, optimisation, warp, update, guess, pyramid_levels, refine, ..basis }
        },
    );
    let optimiser = (
        prop_oneof![2_u32..=256, Just(2), Just(256)],
        prop_oneof![Just(0.0), Just(8.0), 0.0..=8.0],
        prop_oneof![Just(0.0), Just(1.0), Just(64.0), 1.0..=20.0],
        prop_oneof![Just(0.0), Just(1.0), 0.0..=1.0],
        prop_oneof![Just(0.0), Just(50.0), 0.0..=5.0],
        prop_oneof![Just(1_u32), Just(500), 1_u32..=60],
        prop_oneof![Just(1e-6), Just(1.0), 1e-4..=0.1],
    );
    let ncc = || prop_oneof![Just(-1.0), Just(1.0), -1.0..=1.0];
    let tests = (
        ncc(),
        ncc(),
        prop_oneof![Just(None), Just(Some(0.01)), Just(Some(10.0)), (0.1..2.0).prop_map(Some)],
        ncc(),
        prop_oneof![Just(1_u32), Just(100), 1_u32..5],
        prop_oneof![Just(0_u32), Just(10_000), 0_u32..5],
    );
    // Half of the cases have a profile's own values, which track for longer.
    prop_oneof![
        plain.clone(),
        (plain, optimiser, tests).prop_map(|(plain, optimiser, tests)| TrackerSettings {
            scv_bins: optimiser.0,
            blur_sigma_px: optimiser.1,
            weight_sigma_px: optimiser.2,
            velocity_memory: optimiser.3,
            drift_tolerance_px: optimiser.4,
            max_iterations: optimiser.5,
            epsilon_px: optimiser.6,
            loss_ncc_previous: tests.0,
            loss_ncc_anchor: tests.1,
            loss_brightness_ratio: tests.2,
            recovery_ncc: tests.3,
            confirmation_images: tests.4,
            whole_image_after: tests.5,
            ..plain
        }),
    ]
}

proptest! {
    // The same cases every time; the fuzz target looks farther.
    #![proptest_config(ProptestConfig {
        cases: 400,
        rng_seed: RngSeed::Fixed(1),
        failure_persistence: None,
        ..ProptestConfig::default()
    })]

    #[test]
    fn whatever_comes_in_the_answer_is_finite_and_in_range(
        settings in settings(),
        first in (size(), look()),
        // Mostly inside.
        tip in prop_oneof![3 => [0.2..0.8_f64, 0.2..0.8_f64], 1 => [number(), number()]],
        next in proptest::collection::vec((proptest::option::of(size()), look(), context()), 1..9),
        repeats in 1_usize..4,
    ) {
        prop_assert_eq!(check_settings(&settings), Ok(()));
        let (size, look) = first;
        let first = picture(size, look);
        let is_share = tip.iter().all(|t| (0.2..0.8).contains(t));
        let tip = if is_share { [tip[0] * f64::from(size[0]), tip[1] * f64::from(size[1])] } else { tip };
        let Ok(mut tracker) = Tracker::new(settings, &first, tip) else { return Ok(()) };
        check_answer(&settings, &first, &tracker.last_estimate());
        for (other, look, context) in &next {
            // The same picture again now and then, so that there is something to find.
            let image = picture(other.unwrap_or(size), *look);
            for image in core::iter::repeat_n(&image, repeats).chain([&first]) {
                let estimate = tracker.track(image, context);
                check_answer(&settings, image, &estimate);
                prop_assert_eq!(estimate.state, tracker.state());
                prop_assert_eq!(estimate, tracker.last_estimate());
            }
        }
        // It goes on from its own checkpoint, unless motion that was never measured has carried the tip away.
        let restored = Tracker::restore(settings, &tracker.checkpoint());
        prop_assert!(restored.is_ok() || tracker.tip_px().iter().any(|c| c.abs() > 16_384.0));
    }

    #[test]
    fn a_spoilt_checkpoint_is_refused_or_harmless(
        settings in settings(),
        seeds in [any::<u32>(), any::<u32>()],
        spoils in proptest::collection::vec((0_usize..9, number(), any::<u32>()), 0..4),
        context in context(),
        size in size(),
    ) {
        let first = speckled(150, 140, seeds[0]);
        // The widest blur under the narrowest weight may leave no texture.
        let Ok(tracker) = Tracker::new(settings, &first, [75.0, 70.0]) else { return Ok(()) };
        let mut saved = tracker.checkpoint();
        for (which, number, whole) in spoils {
            let at = whole as usize % saved.anchor.padded.len().max(1);
            match which {
                0 => saved.tip_px[0] = number,
                1 => saved.tip_px[1] = number,
                2 => saved.picture_px[0] = whole % 20_000,
                3 => saved.picture_px[1] = whole % 400,
                4 => saved.lost_images = whole,
                5 => saved.anchor.padded[at] = number as f32,
                6 => saved.previous.padded.fill(number as f32),
                7 => saved.anchor.median = Some(number),
                _ => saved.previous.median = (whole % 2 == 0).then_some(number),
            }
        }
        let Ok(mut restored) = Tracker::restore(settings, &saved) else { return Ok(()) };
        prop_assert_eq!(restored.state(), TrackState::Lost);
        for image in [&first, &speckled(size[0], size[1], seeds[1]), &first, &first, &first, &first] {
            let estimate = restored.track(image, &context);
            check_answer(&settings, image, &estimate);
        }
    }

    #[test]
    fn settings_beyond_their_bounds_are_refused(
        profile in prop_oneof![Just(Profile::Paper), Just(Profile::Robust)],
        which in 0_usize..17,
        beyond in prop_oneof![Just(f64::NAN), Just(f64::INFINITY), Just(f64::NEG_INFINITY), Just(-1.5), Just(1e7)],
    ) {
        let mut settings = TrackerSettings::profile(profile, 20);
        match which {
            0 => settings.template_px = 7,
            1 => settings.template_px = 129,
            2 => settings.scv_bins = 257,
            3 => settings.blur_sigma_px = beyond,
            4 => settings.weight_sigma_px = beyond,
            5 => settings.velocity_memory = beyond,
            6 => settings.drift_tolerance_px = beyond,
            7 => settings.epsilon_px = beyond,
            8 => settings.loss_ncc_previous = beyond,
            9 => settings.loss_ncc_anchor = beyond,
            10 => settings.loss_brightness_ratio = Some(beyond),
            11 => settings.pyramid_levels = 4,
            12 => settings.max_iterations = 501,
            13 => settings.confirmation_images = 0,
            14 => settings.confirmation_images = 101,
            15 => settings.whole_image_after = 10_001,
            _ => settings.recovery_ncc = beyond,
        }
        let image = speckled(150, 140, 1);
        let usual = TrackerSettings::profile(Profile::Robust, 20);
        let good = Tracker::new(usual, &image, [75.0, 70.0]).expect("noise has texture").checkpoint();
        let refusals = [
            Tracker::new(settings, &image, [75.0, 70.0]).map(|_| ()),
            Tracker::restore(settings, &good).map(|_| ()),
        ];
        for refusal in refusals {
            prop_assert!(matches!(refusal, Err(TrackerError::Setting { .. })), "{:?}: {:?}", settings, refusal);
        }
    }
}
