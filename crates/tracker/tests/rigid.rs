//! Needle and speckle that move together: accuracy, drift, convergence.

mod support;

use sonoloop_tracker::{Context, Tracker};
use sonoloop_types::{Optimisation, Profile, Similarity, TrackState, TrackerSettings};
use support::{RigidScene, distance, median};

struct Outcome {
    errors_px: Vec<f64>,
    iterations: u32,
    all_tracking: bool,
}

/// Several trackers over the same images.
fn follow(seed: u64, images: u32, gain: impl Fn(u32) -> f32, settings: &[TrackerSettings]) -> Vec<Outcome> {
    let mut scene = RigidScene::new(seed);
    scene.gain_db = gain(0);
    let (first, tip) = scene.next(true);
    let mut runs: Vec<_> = settings
        .iter()
        .map(|settings| {
            let outcome = Outcome { errors_px: Vec::new(), iterations: 0, all_tracking: true };
            (Tracker::new(*settings, &first, tip).expect("a sound first image"), outcome)
        })
        .collect();
    for k in 1..images {
        scene.gain_db = gain(k);
        let (image, tip) = scene.next(false);
        for (tracker, outcome) in &mut runs {
            let estimate = tracker.track(&image, &Context::default());
            outcome.errors_px.push(distance(estimate.tip_px.expect("a tip"), tip));
            outcome.iterations += estimate.iterations;
            outcome.all_tracking &= estimate.state == TrackState::Tracking;
        }
    }
    runs.into_iter().map(|(_, outcome)| outcome).collect()
}

fn with(profile: Profile, similarity: Similarity) -> TrackerSettings {
    TrackerSettings { similarity, ..TrackerSettings::profile(profile, 20) }
}

#[test]
fn ssd_of_second_order_follows_within_a_fifth_of_a_pixel() {
    let settings = [with(Profile::Paper, Similarity::Ssd), with(Profile::Robust, Similarity::Ssd)];
    for outcome in follow(7, 80, |_| 0.0, &settings) {
        assert!(outcome.all_tracking);
        assert!(median(&outcome.errors_px) < 0.2, "{}", median(&outcome.errors_px));
    }
}

#[test]
fn scv_follows_while_the_gain_changes() {
    // A ramp of 6 dB up, then a step down.
    let gain = |k: u32| if k < 40 { 0.15 * k as f32 } else { -2.0 };
    let settings = [with(Profile::Paper, Similarity::Scv), with(Profile::Robust, Similarity::Scv)];
    for outcome in follow(8, 80, gain, &settings) {
        assert!(outcome.all_tracking);
        assert!(median(&outcome.errors_px) < 0.3, "{}", median(&outcome.errors_px));
    }
}

#[test]
fn second_order_needs_at_most_sixty_percent_of_the_iterations() {
    let order = |optimisation| TrackerSettings {
        optimisation,
        similarity: Similarity::Ssd,
        ..TrackerSettings::profile(Profile::Paper, 61)
    };
    let settings = [order(Optimisation::FirstOrder), order(Optimisation::SecondOrder)];
    let outcomes = follow(11, 60, |_| 0.0, &settings);
    let [first, second] = [&outcomes[0], &outcomes[1]].map(|outcome| f64::from(outcome.iterations));
    assert!(second <= 0.6 * first, "first order {first}, second order {second}");
}
