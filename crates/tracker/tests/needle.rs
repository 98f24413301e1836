//! A needle that moves over speckle that stands still.

mod support;

use sonoloop_tracker::{Context, Tracker};
use sonoloop_types::{
    Confirmation, Disc, Estimate, Profile, Similarity, TrackState, TrackerSettings, UpdateStrategy,
};
use support::{NeedleScene, distance, in_parallel};

const IMAGES: u32 = 120;

fn robust(similarity: Similarity) -> TrackerSettings {
    TrackerSettings { similarity, ..TrackerSettings::profile(Profile::Robust, 20) }
}

/// Whether both similarities (SSD, SCV) stay TRACKING within 2 px to the end.
fn follows(seed: u64, background: f32, angle_rad: f64, gain: impl Fn(u32) -> f32) -> [bool; 2] {
    let mut scene = NeedleScene::new(seed, background, angle_rad);
    let (start, step) = scene.path();
    scene.gain_db = gain(0);
    let first = scene.image(start, 1.0);
    let mut trackers = [Similarity::Ssd, Similarity::Scv]
        .map(|similarity| Tracker::new(robust(similarity), &first, start).expect("a sound first image"));
    let mut good = [true; 2];
    for k in 1..IMAGES {
        let tip = [start[0] + f64::from(k) * step[0], start[1] + f64::from(k) * step[1]];
        scene.gain_db = gain(k);
        let image = scene.image(tip, 1.0);
        for (good, tracker) in good.iter_mut().zip(&mut trackers) {
            let estimate = tracker.track(&image, &Context::default());
            let off = distance(estimate.tip_px.expect("a tip"), tip);
            *good &= estimate.state == TrackState::Tracking && off < 2.0;
        }
    }
    good
}

#[test]
fn a_gain_step_in_one_image_does_not_lose_the_needle() {
    let cases: Vec<_> = [31, 32].into_iter().flat_map(|s| [-6.0, 4.0].map(|db| (s, db))).collect();
    let results =
        in_parallel(&cases, |(seed, db)| follows(*seed, 0.3, 0.45, |k| if k < 40 { 0.0 } else { *db }));
    assert!(results.iter().all(|good| *good == [true; 2]), "{results:?}");
}

#[test]
fn one_image_without_the_needle_is_a_loss_and_three_with_it_confirm() {
    let mut scene = NeedleScene::new(51, 0.3, 0.45);
    let (tip, _) = scene.path();
    let still =
        Context { motion_px: Some([0.0; 2]), confirmation: Confirmation::Confirms, ..Context::default() };
    let held = Context { confirmation: Confirmation::Held, ..still };
    let mut tracker =
        Tracker::new(robust(Similarity::Scv), &scene.image(tip, 1.0), tip).expect("a sound image");
    let mut see =
        |strength: f64, context: &Context| tracker.track(&scene.image(tip, strength), context).state;

    assert_eq!(see(1.0, &still), TrackState::Tracking);
    assert_eq!(see(0.0, &still), TrackState::Lost);
    assert_eq!(see(1.0, &still), TrackState::Recovering);
    assert_eq!(see(1.0, &still), TrackState::Recovering);
    // A relapse starts the count again.
    assert_eq!(see(0.0, &still), TrackState::Lost);
    for _ in 0..6 {
        assert_eq!(see(1.0, &held), TrackState::Recovering);
    }
    assert_eq!(see(1.0, &still), TrackState::Recovering);
    assert_eq!(see(1.0, &still), TrackState::Recovering);
    assert_eq!(see(1.0, &still), TrackState::Tracking);
    for _ in 0..5 {
        assert_eq!(see(1.0, &still), TrackState::Tracking);
    }
    // What counts without confirming is there once something else has been settled.
    let counts = Context { confirmation: Confirmation::Counts, ..still };
    assert_eq!(see(0.0, &still), TrackState::Lost);
    for _ in 0..6 {
        assert_eq!(see(1.0, &counts), TrackState::Recovering);
    }
    assert_eq!(see(1.0, &still), TrackState::Tracking);
}

#[test]
fn while_lost_the_correlation_near_the_last_tip_rises_towards_the_plane() {
    let mut scene = NeedleScene::new(61, 0.3, 0.45);
    let (tip, _) = scene.path();
    let still = Context { motion_px: Some([0.0; 2]), confirmation: Confirmation::Held, ..Context::default() };
    let mut tracker =
        Tracker::new(robust(Similarity::Scv), &scene.image(tip, 1.0), tip).expect("a sound image");
    let mut mean = |strength: f64| {
        tracker.track(&scene.image(tip, 0.0), &still);
        let estimates: Vec<_> = (0..4).map(|_| tracker.track(&scene.image(tip, strength), &still)).collect();
        let of = |value: fn(&Estimate) -> Option<f64>| {
            estimates.iter().map(|e| value(e).expect("a value while lost")).sum::<f64>() / 4.0
        };
        [of(|e| e.ncc_anchor), of(|e| e.tip_level)]
    };
    let [gone, faint, full] = [0.0, 0.15, 1.0].map(&mut mean);
    assert!(gone[0] < faint[0] && faint[0] < full[0], "{gone:?} {faint:?} {full:?}");
    assert!(faint[1] < full[1], "{faint:?} {full:?}");
}

#[test]
fn far_from_the_last_tip_the_whole_image_is_searched_after_a_while() {
    for similarity in [Similarity::Ssd, Similarity::Scv] {
        let mut scene = NeedleScene::new(71, 0.3, 0.45);
        let (tip, _) = scene.path();
        let mut tracker =
            Tracker::new(robust(similarity), &scene.image(tip, 1.0), tip).expect("a sound image");
        tracker.track(&scene.image(tip, 0.0), &Context::default());
        let elsewhere = [430.0, 310.0];
        let mut found_at = None;
        for k in 0..20 {
            let estimate = tracker.track(&scene.image(elsewhere, 1.0), &Context::default());
            if estimate.state == TrackState::Tracking {
                assert!(distance(estimate.tip_px.expect("a tip"), elsewhere) < 2.0);
                found_at = Some(k);
                break;
            }
        }
        assert!(found_at.is_some_and(|k| k >= 10), "{similarity:?}: {found_at:?}");
    }
}

#[test]
fn a_lost_tip_is_not_sought_beyond_its_reach_nor_where_it_was_refused() {
    let mut scene = NeedleScene::new(71, 0.3, 0.45);
    let (tip, _) = scene.path();
    let elsewhere = [tip[0] + 30.0, tip[1] + 40.0];
    let first = scene.image(tip, 1.0);
    let disc = |centre_px, radius_px| Disc { centre_px, radius_px };
    let beside = [elsewhere[0] + 12.0, elsewhere[1]];
    let mut finds = |context: &Context| {
        let mut tracker = Tracker::new(robust(Similarity::Scv), &first, tip).expect("a sound image");
        tracker.track(&scene.image(tip, 0.0), context);
        let mut seen = (0..20).map(|_| tracker.track(&scene.image(elsewhere, 1.0), context));
        seen.any(|estimate| {
            let found = estimate.state == TrackState::Tracking;
            assert!(!found || distance(estimate.tip_px.expect("a tip"), elsewhere) < 2.0);
            found
        })
    };
    let still = Context { motion_px: Some([0.0; 2]), ..Context::default() };
    assert!(finds(&still));
    assert!(finds(&Context { reach_px: Some(55.0), ..still }), "50 px are within reach");
    assert!(!finds(&Context { reach_px: Some(45.0), ..still }));
    // On the way there it may have gone on.
    let pushed = |unmeasured_px| Context { axis_px: Some([0.6, 0.8]), unmeasured_px, ..still };
    assert!(finds(&Context { reach_px: Some(45.0), ..pushed(20.0) }));
    let refused = [disc(tip, 15.0), disc(elsewhere, 15.0)];
    assert!(!finds(&Context { refused: &refused, ..still }));
    assert!(finds(&Context { refused: &[disc(beside, 8.0)], ..still }), "another place");
}

#[test]
fn a_tip_that_was_pushed_on_is_sought_all_along_its_way() {
    let mut scene = NeedleScene::new(73, 0.3, 0.9);
    let (tip, _) = scene.path();
    let along = [0.6, 0.8];
    let context = Context {
        motion_px: Some([0.0; 2]),
        axis_px: Some(along),
        unmeasured_px: 100.0,
        reach_px: Some(60.0),
        ..Context::default()
    };
    for (ahead_px, within) in [(120.0, true), (150.0, true), (170.0, false), (-50.0, true), (-70.0, false)] {
        let elsewhere = [tip[0] + along[0] * ahead_px, tip[1] + along[1] * ahead_px];
        let mut tracker =
            Tracker::new(robust(Similarity::Scv), &scene.image(tip, 1.0), tip).expect("a sound image");
        tracker.track(&scene.image(tip, 0.0), &context);
        let mut seen = (0..20).map(|_| tracker.track(&scene.image(elsewhere, 1.0), &context).state);
        assert_eq!(seen.any(|state| state == TrackState::Tracking), within, "{ahead_px} px ahead");
    }
}

#[test]
fn a_candidate_that_is_refused_gives_way_to_the_tip() {
    let mut scene = NeedleScene::new(72, 0.3, 0.45);
    let (tip, _) = scene.path();
    let (decoy, still) =
        ([tip[0] + 25.0, tip[1] - 20.0], Context { motion_px: Some([0.0; 2]), ..Context::default() });
    let held = Context { confirmation: Confirmation::Held, ..still };
    let mut tracker =
        Tracker::new(robust(Similarity::Scv), &scene.image(tip, 1.0), tip).expect("a sound image");
    tracker.track(&scene.image(tip, 0.0), &held);
    let mut seen = (0..20).map(|_| tracker.track(&scene.image(decoy, 1.0), &held).state);
    assert!(seen.any(|state| state == TrackState::Recovering));
    let mut both = scene.image(decoy, 1.0);
    let there = scene.image(tip, 1.0);
    let brightest = both.pixels.iter().zip(&there.pixels).map(|(a, b)| *a.max(b)).collect();
    both.pixels = brightest;
    let at = |estimate: Estimate| estimate.tip_px.expect("a candidate");
    assert!(distance(at(tracker.track(&both, &held)), decoy) < 2.0, "the candidate is kept");
    let refused = [Disc { centre_px: decoy, radius_px: 10.0 }];
    assert!(distance(at(tracker.track(&both, &Context { refused: &refused, ..held })), tip) < 2.0);
}

/// Seen with a shadow that cut the shaft and went while the candidate at its edge was tested: the bead of the shaft that lay there
/// went along with the needle, and was believed.
#[test]
fn a_candidate_beyond_which_the_shaft_goes_on_by_now_is_not_believed() {
    let mut scene = NeedleScene::new(73, 0.3, 0.45);
    let (tip, [u, v]) = scene.path();
    let length = u.hypot(v);
    let axis_px = [u / length, v / length];
    let ahead = [tip[0] + 40.0 * axis_px[0], tip[1] + 40.0 * axis_px[1]];
    for (asked, believed) in [(None, TrackState::Tracking), (Some(axis_px), TrackState::Lost)] {
        let counts = Context {
            motion_px: Some([0.0; 2]),
            confirmation: Confirmation::Counts,
            axis_px: asked,
            ..Context::default()
        };
        let mut tracker =
            Tracker::new(robust(Similarity::Scv), &scene.image(tip, 1.0), tip).expect("a sound image");
        assert_eq!(tracker.track(&scene.image(tip, 0.0), &counts).state, TrackState::Lost);
        for _ in 0..4 {
            assert_eq!(tracker.track(&scene.image(tip, 1.0), &counts).state, TrackState::Recovering);
        }
        let mut longer = scene.image(ahead, 1.0);
        let brightest =
            longer.pixels.iter().zip(&scene.image(tip, 1.0).pixels).map(|(a, b)| *a.max(b)).collect();
        longer.pixels = brightest;
        // As the needle moves, what lies ahead is another thing in every image: while the candidate is tested it is not asked.
        assert_eq!(tracker.track(&longer, &counts).state, TrackState::Recovering);
        assert!(distance(tracker.last_estimate().tip_px.expect("a candidate"), tip) < 2.0);
        let confirms = Context { confirmation: Confirmation::Confirms, ..counts };
        let estimate = tracker.track(&longer, &confirms);
        assert_eq!(estimate.state, believed, "{asked:?}");
        let mut seen = (0..20).map(|_| tracker.track(&longer, &confirms));
        let end = seen.find(|estimate| estimate.state == TrackState::Tracking).expect("a tip");
        let at = if believed == TrackState::Tracking { tip } else { ahead };
        assert!(distance(end.tip_px.expect("a tip"), at) < 2.0, "{asked:?}: {:?}", end.tip_px);
    }
}

#[test]
fn a_tip_where_it_should_be_is_found_among_many_that_are_likelier() {
    let mut scene = NeedleScene::new(74, 0.3, 0.45);
    let (tip, _) = scene.path();
    let first = scene.image(tip, 1.0);
    let mut tracker = Tracker::new(robust(Similarity::Scv), &first, tip).expect("a sound image");
    let still = Context { motion_px: Some([0.0; 2]), ..Context::default() };
    for _ in 0..10 {
        tracker.track(&scene.image(tip, 0.0), &still);
    }
    assert_eq!(tracker.state(), TrackState::Lost);
    // Copies of the first tip to all sides of a fainter view of it.
    let mut image = scene.image(tip, 0.6);
    let middle = tip.map(|c| c.round() as i32);
    let steps: Vec<[i32; 2]> = (-1..=1).flat_map(|i| (-1..=1).map(move |j| [36 * i, 36 * j])).collect();
    let copies = steps.into_iter().filter(|step| *step != [0, 0]);
    let refused: Vec<_> = copies
        .map(|[du, dv]| {
            for v in middle[1] - 20..=middle[1] + 20 {
                for u in middle[0] - 20..=middle[0] + 20 {
                    let [to, from] = [[u + du, v + dv], [u, v]]
                        .map(|[u, v]| v as usize * image.width_px as usize + u as usize);
                    image.pixels[to] = first.pixels[from];
                }
            }
            Disc { centre_px: [tip[0] + f64::from(du), tip[1] + f64::from(dv)], radius_px: 15.0 }
        })
        .collect();
    let context = Context { refused: &refused, ..still };
    for _ in 0..3 {
        let found = tracker.track(&image, &context);
        assert!(found.state != TrackState::Lost && distance(found.tip_px.expect("a tip"), tip) < 2.0);
    }
}

#[test]
fn the_naive_update_drifts_more_than_the_corrected_one() {
    let mut late_px = [0.0; 2];
    for seed in [101, 102, 103] {
        let mut scene = NeedleScene::new(seed, 0.3, 0.45);
        let (start, step) = scene.path();
        let first = scene.image(start, 1.0);
        let mut trackers = [UpdateStrategy::Naive, UpdateStrategy::DriftCorrected].map(|update| {
            let settings = TrackerSettings { update, ..robust(Similarity::Ssd) };
            Tracker::new(settings, &first, start).expect("a sound first image")
        });
        for k in 1..IMAGES {
            let tip = [start[0] + f64::from(k) * step[0], start[1] + f64::from(k) * step[1]];
            let image = scene.image(tip, 1.0);
            for (late_px, tracker) in late_px.iter_mut().zip(&mut trackers) {
                let estimate = tracker.track(&image, &Context::default());
                if k >= IMAGES - 20 {
                    *late_px += distance(estimate.tip_px.expect("a tip"), tip) / 60.0;
                }
            }
        }
    }
    assert!(late_px[0] > 2.0 * late_px[1], "naive {} px, corrected {} px", late_px[0], late_px[1]);
}

#[test]
fn the_paper_profile_recovers_below_its_loss_threshold_without_flapping() {
    let settings = TrackerSettings::profile(Profile::Paper, 20);
    assert!(settings.recovery_ncc < settings.loss_ncc_previous);
    let mut scene = NeedleScene::new(81, 0.1, 0.45);
    let (tip, _) = scene.path();
    let still =
        Context { motion_px: Some([0.0; 2]), confirmation: Confirmation::Confirms, ..Context::default() };
    let mut tracker = Tracker::new(settings, &scene.image(tip, 1.0), tip).expect("a sound image");
    for _ in 0..4 {
        tracker.track(&scene.image(tip, 0.0), &still);
    }
    assert_eq!(tracker.state(), TrackState::Lost);
    // A dimmer needle than T_1's: recovered once, then kept.
    let states: Vec<_> = (0..12).map(|_| tracker.track(&scene.image(tip, 0.5), &still).state).collect();
    assert!(states.iter().all(|state| *state == TrackState::Tracking), "{states:?}");
}
