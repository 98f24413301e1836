//! Every metric against values worked out by hand.

use sonoloop_scenario::{Bound, Expectation, METRICS};
use sonoloop_types::{EndReason, TrackState};

use super::test_recording::{PERIOD, facts, image_row, recording, scripted, tick_row};
use super::*;
use crate::record::Recording;

const TRACKING: Option<TrackState> = Some(TrackState::Tracking);
const LOST: Option<TrackState> = Some(TrackState::Lost);

fn judge(visibility: &str, states: &str) -> Metrics {
    metrics(&scripted(visibility, states), &facts())
}

fn close(value: Option<f64>, expected: f64) {
    let value = value.unwrap_or_else(|| panic!("no value, expected {expected}"));
    assert!((value - expected).abs() < 1e-9, "{value} is not {expected}");
}

#[test]
fn truth_tip_error_over_visible_and_tracking_images() {
    // Errors that count: 1, 2, 3 px. Invisible, lost and unanswered images do not.
    let images = vec![
        image_row(0, true, TRACKING, 1.0),
        image_row(1, true, TRACKING, 2.0),
        image_row(2, true, TRACKING, 3.0),
        image_row(3, false, TRACKING, 50.0),
        image_row(4, true, LOST, 60.0),
        image_row(5, true, None, 0.0),
    ];
    let metrics = metrics(&recording(vec![], images), &facts());
    assert_eq!(metrics.images, 6);
    close(metrics.tip_rmse_px, (14.0f64 / 3.0).sqrt());
    close(metrics.tip_rmse_mm, (14.0f64 / 3.0).sqrt() / 10.0);
    close(metrics.tip_p95_px, 3.0);
    close(metrics.tip_max_px, 3.0);
    close(metrics.coverage, 3.0 / 5.0);
}

#[test]
fn truth_95th_percentile_is_the_nearest_rank() {
    // 20 errors 1…20: rank ⌈0.95·20⌉ = 19.
    let images = (1..=20).map(|k| image_row(k, true, TRACKING, k as f64)).collect();
    let metrics = metrics(&recording(vec![], images), &facts());
    close(metrics.tip_p95_px, 19.0);
    close(metrics.tip_max_px, 20.0);
}

#[test]
fn truth_transverse_error_is_against_the_reference_and_the_plane_distance_beside_it() {
    let mut images = vec![image_row(0, true, TRACKING, 5.0), image_row(1, true, TRACKING, 5.0)];
    images.push(image_row(2, true, LOST, 0.0));
    // Axis ∩ plane moved away from where the tip itself projects: only the reference counts.
    for (row, offset_m) in images.iter_mut().zip([3e-4, -4e-4, 9e-3]) {
        row.truth.tip_in_probe.x = 7e-3;
        row.truth.plane_to_tip_m = offset_m;
    }
    let metrics = metrics(&recording(vec![], images), &facts());
    close(metrics.tip_rmse_px, 5.0);
    close(metrics.plane_to_tip_rms_mm, (0.5 * (0.09f64 + 0.16)).sqrt());
}

#[test]
fn a_delayed_image_is_compared_with_the_truth_when_it_was_taken() {
    let mut row = image_row(3, true, TRACKING, 0.0);
    row.acquisition.publication_tick += 150;
    let metrics = metrics(&recording(vec![tick_row(270, false)], vec![row]), &facts());
    close(metrics.tip_max_px, 0.0);
    assert_eq!(metrics.silent_loss_s, Some(0.0));
}

#[test]
fn never_visible_leaves_nothing_to_measure() {
    let metrics = judge("-----", "SSSSS");
    assert_eq!(metrics.coverage, None);
    assert_eq!(metrics.tip_rmse_px, None);
    assert_eq!(metrics.losses, 0);
    assert_eq!(metrics.detection_delay_s, None);
    assert_eq!(metrics.travel_after_loss_mm, None);
    assert_eq!(metrics.recovery_time_s, None);
}

#[test]
fn nothing_recorded_is_no_success() {
    let metrics = metrics(&recording(vec![], vec![]), &facts());
    assert!(!metrics.success);
    assert_eq!(metrics.silent_loss_s, None);
    assert_eq!((metrics.max_contact_force_n, metrics.max_needle_force_n), (None, None));
    assert_eq!(metrics.min_joint_margin_deg, None);
    assert_eq!(metrics.final_target_distance_mm, None);
}

#[test]
fn no_loss_no_delay() {
    let metrics = judge("vvvvv", "TTTTT");
    assert_eq!((metrics.losses, metrics.recoveries, metrics.false_losses), (0, 0, 0));
    assert_eq!((metrics.detection_delay_s, metrics.travel_after_loss_mm), (None, None));
    close(metrics.coverage, 1.0);
    assert!(metrics.success);
}

#[test]
fn truth_loss_detection_travel_and_recovery_by_hand() {
    // Lost at image 2 (tick 80), declared at image 4 (tick 160): 80 ms at 10 mm/s is 0.8 mm.
    // Visible again from image 6, confirmed at image 8 (tick 320): 160 ms after LOST.
    let metrics = judge("vv----vvvv", "TTTTLLRRTT");
    assert_eq!((metrics.losses, metrics.recoveries), (1, 1));
    assert_eq!((metrics.false_losses, metrics.false_recoveries), (0, 0));
    close(metrics.detection_delay_s, 0.080);
    close(metrics.travel_after_loss_mm, 0.8);
    close(metrics.recovery_time_s, 0.160);
    // Two silent images are 0.08 s, within the free 0.2 s. Six visible images, four of them tracked.
    close(metrics.silent_loss_s, 0.0);
    close(metrics.coverage, 4.0 / 6.0);
}

#[test]
fn truth_loss_is_timed_by_ticks_not_by_images() {
    let mut recording = scripted("vvv---", "TTTLLL");
    for row in &mut recording.ticks {
        row.visible = row.tick < 107;
    }
    let metrics = metrics(&recording, &facts());
    close(metrics.detection_delay_s, 0.013);
    close(metrics.travel_after_loss_mm, 0.13);
}

#[test]
fn truth_image_delay_adds_to_the_detection_delay() {
    let mut recording = scripted("vvvvv-----", "TTTTTTLLLL");
    for row in &mut recording.images {
        row.acquisition.publication_tick += 100;
    }
    // LOST answers image 6 of tick 240, handed out at tick 340; the loss was at tick 200.
    close(metrics(&recording, &facts()).detection_delay_s, 0.140);
}

#[test]
fn truth_travel_waits_for_the_needle_to_stand() {
    let mut recording = scripted("vv------", "TTLLLLLL");
    // Declared at once, but the needle rolls on to tick 100: 0.2 mm.
    let mut depth_m = 0.8e-3;
    for row in recording.ticks.iter_mut().filter(|row| row.tick >= 80) {
        row.feed_m_s = if row.tick < 100 { 0.010 } else { 0.0 };
        row.depth_m = depth_m;
        depth_m += row.feed_m_s / 1000.0;
    }
    let metrics = metrics(&recording, &facts());
    close(metrics.detection_delay_s, 0.0);
    close(metrics.travel_after_loss_mm, 0.2);
}

#[test]
fn truth_lost_images_do_not_shorten_a_silent_loss() {
    let mut recording = scripted("vv----------vv", "TTTTTTTTTTTTTT");
    let whole = metrics(&recording, &facts()).silent_loss_s;
    close(whole, 0.2);
    // Every second image never came.
    let mut keep = false;
    recording.images.retain(|_| {
        keep = !keep;
        keep
    });
    assert_eq!(metrics(&recording, &facts()).silent_loss_s, whole);
}

#[test]
fn truth_the_stop_is_timed_from_the_declared_loss() {
    let mut recording = scripted("vv------", "TTTLRLLL");
    // Declared with image 3 at tick 120; the needle rolls on to tick 183.
    for row in recording.ticks.iter_mut().filter(|row| row.tick >= 120) {
        row.feed_m_s = if row.tick < 183 { 0.010 } else { 0.0 };
    }
    let late = metrics(&recording, &facts());
    close(late.stop_delay_s, 0.063);
    assert!(metrics(&scripted("vvvv", "TTTT"), &facts()).stop_delay_s.is_none());
    // Taken back after one image, before the needle stood: no stop was asked for any more.
    let mut brief = scripted("vvvvvv", "TTTLTT");
    brief.ticks.iter_mut().for_each(|row| row.feed_m_s = 0.010);
    assert_eq!(metrics(&brief, &facts()).stop_delay_s, None);
    // A needle that goes on counts to the end, and is no success.
    let mut never = scripted("vvvvvv", "TTTLLL");
    assert!(metrics(&never, &facts()).success);
    never.ticks.iter_mut().for_each(|row| row.feed_m_s = 0.010);
    let never = metrics(&never, &facts());
    close(never.stop_delay_s, 0.119);
    assert!(!never.success);
}

#[test]
fn truth_a_needle_that_never_stops_travels_to_the_end_of_the_run() {
    // Lost at tick 80, last tick 399: 3.19 mm, never declared.
    let metrics = judge("vv--------", "TTTTTTTTTT");
    assert_eq!((metrics.losses, metrics.recoveries), (1, 0));
    close(metrics.travel_after_loss_mm, 3.19);
    close(metrics.detection_delay_s, 0.319);
    assert_eq!(metrics.recovery_time_s, None);
}

#[test]
fn the_longest_of_several_losses_counts() {
    let metrics = judge("vv--vvv----vvv", "TTTLRTTTTTLRTT");
    assert_eq!((metrics.losses, metrics.recoveries), (2, 2));
    close(metrics.detection_delay_s, 0.120);
    close(metrics.travel_after_loss_mm, 1.2);
    close(metrics.recovery_time_s, 0.080);
}

#[test]
fn flicker_during_the_search_is_one_loss() {
    let metrics = judge("vv--v-v-vvv", "TTLLLLLLRTT");
    assert_eq!((metrics.losses, metrics.recoveries), (1, 1));
}

#[test]
fn a_tracker_that_is_down_claims_nothing() {
    // Gone while the tip was in view: no loss, no false loss by its restart, but less coverage.
    let metrics = judge("vvvvvvvv", "TT..LRTT");
    assert_eq!((metrics.losses, metrics.false_losses, metrics.recoveries), (0, 0, 1));
    close(metrics.coverage, 0.5);
    close(metrics.silent_loss_s, 0.0);
    // Loss while it is down: nobody claims to see the tip, and the needle stands.
    let metrics = judge("vvv---", "TT....");
    assert_eq!(metrics.losses, 1);
    close(metrics.detection_delay_s, 0.0);
    close(metrics.travel_after_loss_mm, 0.0);
}

#[test]
fn lost_while_visible_is_a_false_loss_once_per_episode() {
    let metrics = judge("vvvvvvvvv", "TTLLRLRTT");
    assert_eq!((metrics.false_losses, metrics.losses, metrics.recoveries), (1, 0, 1));
    assert_eq!(judge("vvvv", "LLLL").false_losses, 1, "always lost");
    assert_eq!(judge("vvvv", "SSTT").false_losses, 0);
}

#[test]
fn false_recovery_counts_once_per_episode() {
    // Invisible when TRACKING again, and wrong for three images on.
    let metrics = judge("vv------", "TTLRTTTL");
    assert_eq!((metrics.false_recoveries, metrics.recoveries), (1, 0));
    assert!(!metrics.success);
    // A second episode counts again.
    assert_eq!(judge("vv------", "TTLTTLTL").false_recoveries, 2);
}

#[test]
fn truth_recovery_is_false_beyond_two_millimetres() {
    let run = |error_px| {
        let mut recording = scripted("vvvvvv", "TTLLTT");
        recording.images[4] = image_row(4, true, TRACKING, error_px);
        let metrics = metrics(&recording, &facts());
        (metrics.recoveries, metrics.false_recoveries)
    };
    assert_eq!(run(19.9), (1, 0));
    assert_eq!(run(20.1), (0, 1));
}

#[test]
fn truth_recovery_time_runs_through_a_false_recovery() {
    // LOST at tick 80, wrong at 160, LOST again at 200, right at 280.
    let metrics = judge("vv---vvvv", "TTLLTLLTT");
    assert_eq!((metrics.false_recoveries, metrics.recoveries), (1, 1));
    close(metrics.recovery_time_s, 0.200);
}

#[test]
fn truth_silent_loss_beyond_a_fifth_of_a_second_of_each_stretch() {
    // 5 images are 0.2 s: free. 8 images are 0.32 s: 0.12 s count. Twice 8: 0.24 s.
    close(judge("v-----v", "TTTTTTT").silent_loss_s, 0.0);
    close(judge("v--------v", "TTTTTTTTTT").silent_loss_s, 0.12);
    close(judge("v--------v--------", "TTTTTTTTTTTTTTTTTT").silent_loss_s, 0.24);
    // LOST is never silent.
    close(judge("v--------v", "TLLLLLLLLT").silent_loss_s, 0.0);
}

#[test]
fn truth_being_off_by_more_than_two_millimetres_is_silent_loss() {
    let run = |error_px| {
        let images = (0..10).map(|k| image_row(k, true, TRACKING, error_px)).collect();
        metrics(&recording(vec![], images), &facts()).silent_loss_s
    };
    close(run(19.9), 0.0);
    close(run(20.1), 0.2);
    close(run(f64::NAN), 0.2);
}

#[test]
fn a_claim_without_a_finite_position_covers_nothing() {
    let mut images = vec![image_row(0, true, TRACKING, 0.0), image_row(1, true, TRACKING, f64::NAN)];
    images.push(image_row(2, true, TRACKING, 0.0));
    images[2].command.as_mut().unwrap().estimate.tip_px = None;
    let metrics = metrics(&recording(vec![], images), &facts());
    close(metrics.coverage, 1.0 / 3.0);
    close(metrics.tip_max_px, 0.0);
}

#[test]
fn truth_extremes_over_ticks() {
    let mut recording = scripted("vvv", "TTT");
    recording.ticks[50].contact_force_n = 7.5;
    recording.ticks[70].needle_force_n = 1.25;
    recording.ticks[60].min_joint_margin_rad = std::f64::consts::PI / 180.0;
    recording.ticks.last_mut().unwrap().target_distance_m = 0.25e-3;
    let metrics = metrics(&recording, &facts());
    close(metrics.max_contact_force_n, 7.5);
    close(metrics.max_needle_force_n, 1.25);
    close(metrics.min_joint_margin_deg, 1.0);
    close(metrics.final_target_distance_mm, 0.25);
}

#[test]
fn success_needs_every_condition() {
    let succeeds = |change: fn(&mut Recording)| {
        let mut recording = scripted("vvvvvvvvvv", "TTTTTTTTTT");
        change(&mut recording);
        metrics(&recording, &facts()).success
    };
    assert!(succeeds(|_| {}));
    assert!(succeeds(|run| run.end = EndReason::TimeOver));
    assert!(!succeeds(|run| run.ticks.last_mut().unwrap().target_distance_m = 1.1e-3), "target");
    assert!(!succeeds(|run| run.ticks[5].contact_force_n = 10.1), "force");
    assert!(!succeeds(|run| run.ticks[5].contact_force_n = f64::NAN), "force unknown");
    assert!(!succeeds(|run| run.ticks[5].collision = true), "collision");
    assert!(!succeeds(|run| run.ticks[5].min_joint_margin_rad = -1e-6), "joint");
    assert!(!succeeds(|run| run.end = EndReason::TrackerSilent), "end");
    assert!(!succeeds(|run| run.end = EndReason::Interrupted), "end");
    let mut facts = facts();
    let silent = scripted("v-------------", "TTTTTTTTTTTTTT");
    // 13 images are 0.52 s: 0.32 s count.
    assert!(metrics(&silent, &facts).success);
    facts.silent_loss_bound_s = 0.3;
    assert!(!metrics(&silent, &facts).success);
}

#[test]
fn expectations_hold_or_fail_by_their_bounds() {
    let metrics = judge("vv----vvvv", "TTTTLLRRTT");
    let range = |metric: &str, min, max| {
        let bound = Bound::Range { min, max };
        let judged = verdict(&metrics, &[Expectation { metric: metric.into(), bound }]);
        passes(&judged)
    };
    assert!(range("losses", Some(1.0), None));
    assert!(range("losses", Some(1.0), Some(1.0)));
    assert!(!range("losses", Some(2.0), None));
    assert!(range("travel_after_loss_mm", None, Some(3.0)));
    assert!(!range("travel_after_loss_mm", None, Some(0.7)));
    assert!(!range("success", Some(0.0), Some(1.0)), "a truth value has no range");
    assert!(!range("no_such_metric", None, Some(1e9)));

    let is = |expected| {
        let bound = Bound::Is(expected);
        passes(&verdict(&metrics, &[Expectation { metric: "success".into(), bound }]))
    };
    assert!(is(true) && !is(false));
}

#[test]
fn a_bound_on_a_metric_without_a_value_fails() {
    let never_visible = judge("---", "SSS");
    let bound = Bound::Range { min: None, max: None };
    let judged = verdict(&never_visible, &[Expectation { metric: "tip_rmse_px".into(), bound }]);
    assert_eq!(judged[0].value, None);
    assert!(!judged[0].pass && !passes(&judged));
}

#[test]
fn expecting_nothing_expects_success() {
    assert!(passes(&verdict(&judge("vv", "TT"), &[])));
    assert!(!passes(&verdict(&judge("vvvvv------", "TTTTTLTTTTT"), &[])));
    assert!(!passes(&[]));
}

#[test]
fn every_name_in_the_summary_is_a_metric() {
    let metrics = judge("vv----vvvv", "TTTTLLRRTT");
    let serde_json::Value::Object(summary) = serde_json::to_value(metrics).unwrap() else { panic!() };
    assert_eq!(summary.len(), METRICS.len());
    for name in METRICS {
        assert_eq!(summary[*name], serde_json::to_value(metrics.value(name)).unwrap(), "{name}");
        assert!(metrics.value(name).is_some(), "{name} has a value in this run");
    }
    assert_eq!(PERIOD, facts().image_period_ticks);
}
