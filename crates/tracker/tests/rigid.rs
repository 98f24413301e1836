//! Needle and speckle that move together: accuracy, drift, convergence.

mod support;

use sonoloop_tracker::{Context, Tracker};
use sonoloop_types::{Guess, Image, Optimisation, Profile, Similarity, TrackState, TrackerSettings, Warp};
use support::{RigidScene, distance, in_parallel, median};

struct Outcome {
    errors_px: Vec<f64>,
    iterations: u32,
    all_tracking: bool,
}

/// Several trackers over the same images.
fn follow(
    mut scene: RigidScene,
    images: u32,
    gain: impl Fn(u32) -> f32,
    settings: &[TrackerSettings],
) -> Vec<Outcome> {
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
    for outcome in follow(RigidScene::by(7, 3.0), 80, |_| 0.0, &settings) {
        assert!(outcome.all_tracking);
        assert!(median(&outcome.errors_px) < 0.2, "{}", median(&outcome.errors_px));
    }
}

#[test]
fn scv_follows_while_the_gain_changes() {
    // A ramp of 6 dB up, then a step down.
    let gain = |k: u32| if k < 40 { 0.15 * k as f32 } else { -2.0 };
    let settings = [with(Profile::Paper, Similarity::Scv), with(Profile::Robust, Similarity::Scv)];
    for outcome in follow(RigidScene::by(8, 3.0), 80, gain, &settings) {
        assert!(outcome.all_tracking);
        assert!(median(&outcome.errors_px) < 0.3, "{}", median(&outcome.errors_px));
    }
}

/// A profile, similarity, warp and side of the template.
type Case = (Profile, Similarity, Warp, u32);

/// Iterations of second order over those of first order, of each case: four seeds, 60 images each, motion up to `step_px`
/// on either axis.
fn shares_of_iterations(step_px: f64, cases: &[Case]) -> Vec<f64> {
    let with_order = |&(profile, similarity, warp, template_px): &Case| {
        [Optimisation::FirstOrder, Optimisation::SecondOrder].map(|optimisation| TrackerSettings {
            optimisation,
            similarity,
            warp,
            ..TrackerSettings::profile(profile, template_px)
        })
    };
    let settings: Vec<_> = cases.iter().flat_map(with_order).collect();
    let runs =
        in_parallel(&[11, 12, 13, 14], |seed| follow(RigidScene::by(*seed, step_px), 60, |_| 0.0, &settings));
    let total = |which: usize| runs.iter().map(|outcomes| f64::from(outcomes[which].iterations)).sum::<f64>();
    (0..cases.len()).map(|case| total(2 * case + 1) / total(2 * case)).collect()
}

/// The paper's Table I has more than 40 % less time for second order, as a rule. Here it is so where an image moves by more
/// than the width of what the sums rest on, and not otherwise. Both orders are Gauss-Newton near the solution, and end there
/// alike; every image has two registrations (T_n, then T_1), and the second begins where the first ended. Share of the
/// iterations that are left, measured with these seeds, up to so many pixels per axis and image:
///
/// | profile | template | warp | SSD at 3 px | 4 | 6 | SCV at 3 px | 4 | 6 |
/// |---|---|---|---|---|---|---|---|---|
/// | paper | 20×20 | translation | 1.00 | 0.96 | 0.76 | 0.67 | 0.57 | 0.50 |
/// | paper | 20×20 | affine | 1.01 | 0.98 | 0.82 | 0.75 | 0.58 | 0.68 |
/// | paper | 61×61 | translation | 0.36 | 0.39 | 0.39 | 0.50 | 0.46 | 0.24 |
/// | paper | 61×61 | affine | 0.29 | 0.31 | 0.34 | 0.57 | 0.67 | 0.48 |
/// | robust | 20×20 | translation | 0.96 | 0.93 | 0.68 | 1.00 | 0.99 | 0.70 |
/// | robust | 20×20 | affine | 0.94 | 0.92 | 0.67 | 1.01 | 1.01 | 0.80 |
/// | robust | 61×61 | translation | 0.22 | 0.23 | 0.23 | 0.84 | 0.83 | 0.60 |
/// | robust | 61×61 | affine | 0.22 | 0.22 | 0.22 | 0.77 | 0.80 | 0.64 |
///
/// A 20×20 template is all tip, some 5 px wide; a 61×61 one is mostly speckle, 1 px to 2 px wide. The robust profile looks at
/// that in its refinement, which rests on all pixels.
#[test]
fn second_order_needs_at_most_sixty_percent_of_the_iterations_over_fine_speckle() {
    let cases = [
        (Profile::Paper, Similarity::Ssd, Warp::Translation, 61),
        (Profile::Paper, Similarity::Scv, Warp::Translation, 61),
        (Profile::Paper, Similarity::Ssd, Warp::Affine, 61),
        (Profile::Robust, Similarity::Ssd, Warp::Translation, 61),
        (Profile::Robust, Similarity::Ssd, Warp::Affine, 61),
        // Where there is no gain nobody should expect one: a bright tip that moves by less than its width.
        (Profile::Paper, Similarity::Ssd, Warp::Translation, 20),
        (Profile::Paper, Similarity::Ssd, Warp::Affine, 20),
        (Profile::Robust, Similarity::Ssd, Warp::Translation, 20),
    ];
    let shares = shares_of_iterations(3.0, &cases);
    assert!(shares[..5].iter().all(|share| *share <= 0.6), "{shares:?}");
    assert!(shares[5..].iter().all(|share| (0.8..1.2).contains(share)), "{shares:?}");
}

/// Between a short motion, which a small region around the guess holds, and a long one there must be no gap. (From 7.5 px on
/// the narrow weight sees nothing of this blob.)
#[test]
fn a_jump_of_any_length_up_to_the_optimisers_reach_is_followed() {
    let cases: Vec<f64> = (0..=26).map(|k| 4.0 + 0.125 * f64::from(k)).collect();
    let lost = in_parallel(&cases, |jump_px| {
        let at = |u: f64| [150.0 + u, 100.0];
        // A broad blob on a slow wave, so that the pull-in is wide.
        let image = |u0: f64| {
            let level = |u: f64, v: f64| {
                let (x, y) = (u - at(u0)[0], v - at(u0)[1]);
                60.0 + 20.0 * libm::cos(0.05 * x) * libm::cos(0.07 * y)
                    + 150.0 * libm::exp(-(x * x + y * y) / 60.0)
            };
            let pixels = (0..200).flat_map(|v| (0..300).map(move |u| level(u.into(), v.into()) as u8));
            Image::from_pixels(300, 200, pixels.collect()).expect("as many pixels as the size says")
        };
        let mut lost = 0;
        for (refine, warp) in [(true, Warp::Translation), (false, Warp::Translation), (true, Warp::Affine)] {
            let settings = TrackerSettings {
                guess: Guess::None,
                similarity: Similarity::Ssd,
                refine,
                warp,
                ..TrackerSettings::profile(Profile::Robust, 20)
            };
            let mut tracker = Tracker::new(settings, &image(0.0), at(0.0)).expect("a blob");
            for k in 1..8 {
                tracker.track(&image(0.3 * f64::from(k)), &Context::default());
            }
            let estimate = tracker.track(&image(2.1 + jump_px), &Context::default());
            let off_px = distance(estimate.tip_px.expect("a tip"), at(2.1 + jump_px));
            lost += u32::from(estimate.state != TrackState::Tracking || off_px > 0.5);
        }
        lost
    });
    assert!(lost.iter().all(|lost| *lost == 0), "{lost:?}");
}
