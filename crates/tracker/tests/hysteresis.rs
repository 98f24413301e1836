//! States over images in which the needle comes and goes at random.

mod support;

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use sonoloop_tracker::{Context, Tracker};
use sonoloop_types::{Profile, TrackState, TrackerSettings, UpdateStrategy};
use support::{NeedleScene, in_parallel};

/// Whatever fades, comes back and fades again: a tip that was lost is tracked again only after it was confirmed, and what
/// the correlations say never flips the state TRACKING, LOST, TRACKING, LOST in four images in a row. The paper's profile
/// confirms with one image, so there only the held test of T_n is in the way.
#[test]
fn a_needle_that_flickers_does_not_make_the_state_flap() {
    let mut cases = Vec::new();
    for profile in [Profile::Paper, Profile::Robust] {
        for update in [UpdateStrategy::None, UpdateStrategy::DriftCorrected] {
            cases.extend((601..609).map(|seed| (profile, update, seed)));
        }
    }
    let flips = in_parallel(&cases, |&(profile, update, seed)| {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let mut scene = NeedleScene::new(seed, 0.3, 0.45);
        let (tip, _) = scene.path();
        let settings = TrackerSettings { update, ..TrackerSettings::profile(profile, 20) };
        let mut tracker = Tracker::new(settings, &scene.image(tip, 1.0), tip).expect("a sound first image");
        let still = Context { motion_px: Some([0.0; 2]), ..Context::default() };
        let mut seen = vec![TrackState::Tracking];
        for k in 0..60 {
            // Every other image dark, then at random, many of them about the thresholds.
            let strength = if k < 20 { f64::from(k % 2) } else { rng.random_range(0.0..0.6) };
            seen.push(tracker.track(&scene.image(tip, strength), &still).state);
        }
        for four in seen.windows(4) {
            use TrackState::{Lost, Tracking};
            let flaps = four == [Tracking, Lost, Tracking, Lost];
            assert!(!flaps, "{profile:?} {update:?} seed {seed}: {four:?}");
        }
        let mut recovering = 0;
        for pair in seen.windows(2) {
            recovering = if pair[0] == TrackState::Recovering { recovering + 1 } else { 0 };
            let again = pair[0] != TrackState::Tracking && pair[1] == TrackState::Tracking;
            assert!(!again || recovering + 1 >= settings.confirmation_images, "{profile:?}, seed {seed}");
        }
        seen.windows(2).filter(|pair| pair[0] != pair[1]).count()
    });
    assert!(
        flips.iter().all(|flips| *flips >= 2),
        "a sequence without a loss and a return shows nothing: {flips:?}"
    );
}
