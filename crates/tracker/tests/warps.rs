//! Turned and sheared patterns whose warp is known in closed form.

mod support;

use sonoloop_tracker::{Context, Tracker};
use sonoloop_types::{
    Image, Optimisation, Profile, Similarity, TrackState, TrackerSettings, UpdateStrategy, Warp,
};
use support::distance;

const CENTRE_PX: [f64; 2] = [80.0, 60.0];

/// Blobs over a slow wave, under the inverse of an affine map about the centre: x there = A·x here + shift.
fn pattern(linear: [[f64; 2]; 2], shift_px: [f64; 2]) -> Image {
    let [[a, b], [c, d]] = linear;
    let area = a * d - b * c;
    let level = |u: u32, v: u32| {
        let (du, dv) = (f64::from(u) - CENTRE_PX[0] - shift_px[0], f64::from(v) - CENTRE_PX[1] - shift_px[1]);
        let (x, y) = ((d * du - b * dv) / area, (a * dv - c * du) / area);
        let blob =
            |x0: f64, y0: f64, s: f64| libm::exp(-((x - x0).powi(2) + (y - y0).powi(2)) / (2.0 * s * s));
        let wave = libm::cos(0.11 * x) * libm::cos(0.13 * y + 0.4);
        let blobs = 90.0 * blob(0.0, 0.0, 4.0) + 70.0 * blob(7.0, -4.0, 3.0) - 40.0 * blob(-6.0, 6.0, 3.5);
        libm::round(80.0 + blobs + 25.0 * wave) as u8
    };
    let pixels = (0..120).flat_map(|v| (0..160).map(move |u| level(u, v))).collect();
    Image::from_pixels(160, 120, pixels).expect("as many pixels as the size says")
}

fn turned(deg: f64) -> [[f64; 2]; 2] {
    let (sin, cos) = libm::sincos(deg.to_radians());
    [[cos, -sin], [sin, cos]]
}

fn settings(
    profile: Profile,
    similarity: Similarity,
    optimisation: Optimisation,
    warp: Warp,
) -> TrackerSettings {
    let basis = TrackerSettings::profile(profile, 31);
    // The whole window counts: a narrow weight leaves a turn to a handful of pixels.
    TrackerSettings {
        similarity,
        optimisation,
        warp,
        weight_sigma_px: 0.0,
        update: UpdateStrategy::None,
        ..basis
    }
}

/// The tip after a few images over which the warp grows; and whether it was tracked throughout.
fn follow(settings: TrackerSettings, warp_at: impl Fn(f64) -> ([[f64; 2]; 2], [f64; 2])) -> (f64, bool) {
    let first = pattern([[1.0, 0.0], [0.0, 1.0]], [0.0; 2]);
    let mut tracker = Tracker::new(settings, &first, CENTRE_PX).expect("a sound image");
    let (mut worst_px, mut tracking) = (0.0_f64, true);
    for k in 1..=8 {
        let (linear, shift) = warp_at(f64::from(k) / 8.0);
        let estimate = tracker.track(&pattern(linear, shift), &Context::default());
        let truth = [CENTRE_PX[0] + shift[0], CENTRE_PX[1] + shift[1]];
        worst_px = worst_px.max(distance(estimate.tip_px.expect("a tip"), truth));
        tracking &= estimate.state == TrackState::Tracking;
    }
    (worst_px, tracking)
}

#[test]
fn truth_a_turn_of_forty_degrees_is_followed_by_rigid_and_affine_warps() {
    for profile in [Profile::Paper, Profile::Robust] {
        for (similarity, bound_px) in [(Similarity::Ssd, 0.05), (Similarity::Scv, 0.15)] {
            for optimisation in [Optimisation::FirstOrder, Optimisation::SecondOrder] {
                for warp in [Warp::Rigid, Warp::Affine] {
                    let settings = settings(profile, similarity, optimisation, warp);
                    let (worst_px, tracking) =
                        follow(settings, |share| (turned(40.0 * share), [6.0 * share, -4.0 * share]));
                    assert!(tracking && worst_px < bound_px, "{worst_px} px, {tracking}: {settings:?}");
                }
            }
        }
    }
}

#[test]
fn truth_shear_and_scale_are_followed_by_the_affine_warp_only() {
    let sheared = |share: f64| {
        let linear = [[1.0 + 0.2 * share, 0.25 * share], [-0.1 * share, 1.0 - 0.1 * share]];
        (linear, [3.0 * share, 2.0 * share])
    };
    for similarity in [Similarity::Ssd, Similarity::Scv] {
        let run =
            |warp| follow(settings(Profile::Paper, similarity, Optimisation::SecondOrder, warp), sheared);
        let [moved, rigid, affine] = [Warp::Translation, Warp::Rigid, Warp::Affine].map(run);
        assert!(affine.1 && affine.0 < 0.15, "affine {affine:?}");
        assert!(
            affine.0 < 0.5 * rigid.0.min(moved.0),
            "affine {affine:?}, rigid {rigid:?}, translation {moved:?}"
        );
    }
}

#[test]
fn without_a_turn_all_warps_agree() {
    for warp in [Warp::Rigid, Warp::Affine] {
        let settings = settings(Profile::Robust, Similarity::Ssd, Optimisation::SecondOrder, warp);
        let (worst_px, tracking) =
            follow(settings, |share| ([[1.0, 0.0], [0.0, 1.0]], [9.0 * share, 5.0 * share]));
        assert!(tracking && worst_px < 0.05, "{worst_px} px, {tracking}: {warp:?}");
    }
}
