use sonoloop_types::{Estimate, Image, Reason, TrackState, TrackerSettings};

/// Registrations that one image may take: the candidate again, where the tip should be, and the four best peaks of two searches.
/// Following takes two.
const MOST_REGISTRATIONS: u32 = 10;

/// Panics unless every value of an answer to `image` is finite and in the range that its documentation names.
pub fn check_answer(settings: &TrackerSettings, image: &Image, estimate: &Estimate) {
    let fits = |range: core::ops::RangeInclusive<f64>, value: Option<f64>| {
        assert!(value.is_none_or(|value| range.contains(&value)), "{estimate:?}");
    };
    let [u, v] = estimate.tip_px.expect("a tracker has a tip from the start");
    assert!(u.is_finite() && v.is_finite(), "{estimate:?}");
    fits(-1.0..=1.0, estimate.ncc_previous);
    fits(-1.0..=1.0, estimate.ncc_anchor);
    fits(0.0..=f64::MAX, estimate.brightness_ratio);
    fits(0.0..=255.0, estimate.tip_level);
    fits(0.0..=1.0, estimate.conditioning);
    assert!(estimate.iterations <= MOST_REGISTRATIONS * settings.max_iterations, "{estimate:?}");
    match estimate.state {
        TrackState::Tracking | TrackState::Recovering => {
            let wanted = if estimate.state == TrackState::Tracking { Reason::Ok } else { Reason::Candidate };
            assert!(estimate.reason == wanted, "{estimate:?}");
            // Half of the template at least is inside.
            let half = f64::from(settings.template_px) / 2.0;
            let inside = |c: f64, size: u32| (-half..=f64::from(size) - 1.0 + half).contains(&c);
            assert!(inside(u, image.width_px) && inside(v, image.height_px), "{estimate:?}");
        }
        TrackState::Lost => {
            assert!(!matches!(estimate.reason, Reason::Ok | Reason::Candidate), "{estimate:?}");
        }
        TrackState::Searching => panic!("a tracker is made with a tip: {estimate:?}"),
    }
}
