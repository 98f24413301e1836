//! The tracker on one image of 640×480: `cargo bench -p sonoloop-benches --bench track`.

#[path = "../crates/tracker/tests/support/mod.rs"]
mod support;

use divan::{Bencher, black_box};
use sonoloop_tracker::baseline::{Insertion, localize};
use sonoloop_tracker::{Context, Tracker};
use sonoloop_types::{Image, Profile, Similarity, TrackState, TrackerSettings, Warp};
use support::{NeedleScene, RigidScene};

fn main() {
    divan::main();
}

const WARPS: [Warp; 3] = [Warp::Translation, Warp::Rigid, Warp::Affine];

/// Follows needle and speckle that move together, over and over; one image is one step.
fn follow(bencher: Bencher, profile: Profile, similarity: Similarity, warp: Warp, template_px: u32) {
    let mut scene = RigidScene::by(7, 3.0);
    // There and back, so that every image follows a neighbour.
    let mut images: Vec<Image> = (0..60).map(|k| scene.next(k == 0).0).collect();
    let back: Vec<Image> = images[1..59].iter().rev().cloned().collect();
    images.extend(back);
    let settings = TrackerSettings { similarity, warp, ..TrackerSettings::profile(profile, template_px) };
    let mut tracker = Tracker::new(settings, &images[0], [320.0, 240.0]).expect("a sound first image");
    let mut next = 0;
    bencher.bench_local(|| {
        next = (next + 1) % images.len();
        tracker.track(black_box(&images[next]), &Context::default()).state
    });
}

/// Profile `robust`.
#[divan::bench(args = WARPS, consts = [20, 61], sample_count = 500, sample_size = 2)]
fn ssd<const PX: u32>(bencher: Bencher, warp: Warp) {
    follow(bencher, Profile::Robust, Similarity::Ssd, warp, PX);
}

/// Profile `robust`.
#[divan::bench(args = WARPS, consts = [20, 61], sample_count = 500, sample_size = 2)]
fn scv<const PX: u32>(bencher: Bencher, warp: Warp) {
    follow(bencher, Profile::Robust, Similarity::Scv, warp, PX);
}

/// Profile `paper`.
#[divan::bench(args = [Similarity::Ssd, Similarity::Scv], sample_count = 500, sample_size = 2)]
fn paper(bencher: Bencher, similarity: Similarity) {
    follow(bencher, Profile::Paper, similarity, Warp::Translation, 20);
}

/// An image without the tip: searched as a whole, the best places scored.
#[divan::bench(args = [20, 61], sample_count = 100)]
fn lost(bencher: Bencher, template_px: u32) {
    let mut scene = NeedleScene::new(3, 0.3, 0.45);
    let (tip_px, _) = scene.path();
    let first = scene.image(tip_px, 1.0);
    let images: Vec<Image> = (0..10).map(|_| scene.image(tip_px, 0.0)).collect();
    let settings =
        TrackerSettings { whole_image_after: 0, ..TrackerSettings::profile(Profile::Robust, template_px) };
    let mut tracker = Tracker::new(settings, &first, tip_px).expect("a sound first image");
    let mut next = 0;
    bencher.bench_local(|| {
        next = (next + 1) % images.len();
        let state = tracker.track(black_box(&images[next]), &Context::default()).state;
        assert_ne!(state, TrackState::Tracking);
    });
}

/// The authors' earlier method.
#[divan::bench(sample_count = 50)]
fn baseline(bencher: Bencher) {
    let mut scene = NeedleScene::new(3, 0.3, 0.45);
    let (tip_px, _) = scene.path();
    let image = scene.image(tip_px, 1.0);
    bencher.bench_local(|| localize(black_box(&image), Insertion::default()).is_some());
}
