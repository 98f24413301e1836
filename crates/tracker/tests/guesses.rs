//! What the choice of the initial guess changes, and what it does not.

mod support;

use sonoloop_tracker::{Context, Tracker};
use sonoloop_types::{Guess, Profile, Similarity, TrackState, TrackerSettings};
use support::{NeedleScene, distance, in_parallel, median};

/// Tips of 80 images of a needle at 2.2 px per image, and the iterations they took.
fn follow(seed: u64, guess: Guess, measured: bool) -> (Vec<[f64; 2]>, u32) {
    let mut scene = NeedleScene::new(seed, 0.1, 0.45);
    let (start, step) = scene.path();
    let profile = TrackerSettings::profile(Profile::Robust, 20);
    let settings = TrackerSettings { guess, similarity: Similarity::Ssd, ..profile };
    let mut tracker = Tracker::new(settings, &scene.image(start, 1.0), start).expect("a sound first image");
    let context = Context { motion_px: measured.then_some(step), ..Context::default() };
    let mut iterations = 0;
    let tips = (1..80).map(|k| {
        let tip = [start[0] + f64::from(k) * step[0], start[1] + f64::from(k) * step[1]];
        let estimate = tracker.track(&scene.image(tip, 1.0), &context);
        assert_eq!(estimate.state, TrackState::Tracking, "{guess:?}, seed {seed}, image {k}");
        iterations += estimate.iterations;
        let found = estimate.tip_px.expect("a tip");
        assert!(distance(found, tip) < 2.0, "{guess:?}, seed {seed}, image {k}: {found:?}");
        found
    });
    (tips.collect(), iterations)
}

/// Where the optimiser starts decides how long it takes, not what it finds, to the 0.01 px by which it ends.
#[test]
fn a_guess_saves_iterations_and_leaves_the_tip_where_it_is() {
    let cases = [
        (Guess::None, false),
        (Guess::None, true),
        (Guess::ConstantVelocity, true),
        (Guess::Kalman, true),
        (Guess::Insertion, false),
        (Guess::Insertion, true),
    ];
    for seed in [301, 302] {
        let runs = in_parallel(&cases, |(guess, measured)| follow(seed, *guess, *measured));
        let (none, without) = &runs[0];
        assert_eq!(runs[1], runs[0], "seed {seed}: with no guess a measured motion changes nothing");
        assert_eq!(runs[4], follow(seed, Guess::ConstantVelocity, false), "seed {seed}: the fallback");
        for ((guess, measured), (tips, iterations)) in cases.iter().zip(&runs).skip(2) {
            assert!(
                iterations < without,
                "{guess:?}, {measured}: {iterations} iterations, {without} without"
            );
            let apart: Vec<f64> = tips.iter().zip(none).map(|(a, b)| distance(*a, *b)).collect();
            println!("seed {seed} {guess:?} {measured}: {iterations} of {without}, {:.4} px", median(&apart));
            assert!(median(&apart) < 0.01, "{guess:?}, {measured}: {} px apart", median(&apart));
        }
    }
}
