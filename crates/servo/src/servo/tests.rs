use super::*;
use crate::search::Phase;
use sonoloop_types::{ImageGeometry, Limits, Profile, ServoSettings, TrackerSettings};

pub(crate) fn settings() -> ServoSettings {
    ServoSettings {
        elevation_gain_per_s: 1.0,
        dither_period_s: 0.8,
        max_search_s: 20.0,
        ..ServoSettings::default()
    }
}

pub(crate) fn setup(view: View) -> Setup {
    Setup {
        protocol: 1,
        run_id: 1,
        tick_rate_hz: 1000,
        image_period_ticks: 40,
        view,
        geometry: ImageGeometry::default(),
        slice_thickness_m: vec![[0.01, 0.8e-3], [0.03, 1.4e-3]],
        flange_from_probe: Pose::identity(),
        entry_in_base: Point::new(-0.03, 0.0, 0.0),
        needle_axis_in_base: Vector::new(0.6, 0.0, 0.8),
        target_in_base: Point::new(0.0, 0.0, 0.04),
        click_px: Some([320.0, 200.0]),
        limits: Limits {
            max_feed_m_s: 12e-3,
            max_probe_speed_m_s: 30e-3,
            max_probe_travel_m: 80e-3,
            max_probe_turn_rad: 0.5,
            max_contact_force_n: 8.0,
        },
        tracker: TrackerSettings::profile(Profile::Robust, 20),
        servo: settings(),
    }
}

pub(crate) fn acquisition(sequence: u64) -> Acquisition {
    Acquisition {
        sequence,
        acquisition_tick: sequence * 40,
        publication_tick: sequence * 40,
        pose_tick: sequence * 40,
        base_from_probe: Pose::identity(),
        depth_m: Some(0.02),
        feed_m_s: Some(0.01),
        contact_force_n: 2.0,
        arm_status: ArmStatus::Ready,
        last_command: None,
    }
}

fn estimate(state: TrackState) -> Estimate {
    Estimate::bare(state, Reason::Ok, Some([319.5, 200.0]))
}

#[test]
fn a_tracked_tip_is_fed_and_a_lost_one_is_not() {
    let mut servo = Servo::new(setup(View::Lateral));
    assert_eq!(servo.answer(&acquisition(0), &estimate(TrackState::Tracking)).feed_m_s, 10e-3);
    for state in [TrackState::Lost, TrackState::Recovering, TrackState::Lost] {
        assert_eq!(servo.answer(&acquisition(1), &estimate(state)).feed_m_s, 0.0);
    }
    assert!(matches!(servo.mode(), Mode::Search(_)));
    assert_eq!(servo.answer(&acquisition(2), &estimate(TrackState::Tracking)).feed_m_s, 10e-3);
    assert_eq!(*servo.mode(), Mode::Follow);
}

#[test]
fn behind_an_arm_that_does_not_obey_the_needle_waits_and_nothing_adds_up() {
    let mut servo = Servo::new(setup(View::Lateral));
    // Outside the dead band: an arm that obeys would be sent after it, farther with every image.
    let aside = Estimate { tip_px: Some([460.0, 200.0]), ..estimate(TrackState::Tracking) };
    for (k, arm_status) in (0..).zip([ArmStatus::Holding, ArmStatus::Collision, ArmStatus::Holding]) {
        let command = servo.answer(&Acquisition { arm_status, ..acquisition(k) }, &aside);
        assert_eq!((command.feed_m_s, command.target_base_from_probe), (0.0, Some(Pose::identity())));
    }
    let command = servo.answer(&acquisition(3), &aside);
    assert_eq!(command.feed_m_s, 10e-3);
    assert!(command.target_base_from_probe.unwrap().translation.x < 1e-3);
}

#[test]
fn before_the_first_fix_nothing_moves() {
    let mut servo = Servo::new(setup(View::Lateral));
    let command =
        servo.answer(&acquisition(0), &Estimate::bare(TrackState::Searching, Reason::NoCandidate, None));
    assert_eq!(command.feed_m_s, 0.0);
    assert_eq!(command.target_base_from_probe, Some(Pose::identity()));
}

#[test]
fn at_the_target_the_needle_rests_for_good() {
    let mut servo = Servo::new(setup(View::Lateral));
    let mut at_target = estimate(TrackState::Tracking);
    at_target.tip_px = Some([319.5, 400.0]);
    assert_eq!(servo.answer(&acquisition(0), &at_target).feed_m_s, 0.0);
    assert_eq!(servo.answer(&acquisition(1), &estimate(TrackState::Tracking)).feed_m_s, 0.0);
    assert_eq!(*servo.mode(), Mode::Arrived);
}

#[test]
fn truth_displacement_and_offset_are_inverse() {
    let held = Pose::new(Vector::new(0.1, -0.2, 0.3), Vector::new(0.2, 2.9, -0.1));
    let offset = Offset { elevation_m: 3e-3, yaw_rad: -0.1 };
    let tip = Point::new(4e-3, 0.0, 25e-3);
    let back = offset_from(&held, &displaced(&held, offset, &tip), &tip);
    assert!((back.elevation_m - 3e-3).abs() < 1e-12 && (back.yaw_rad + 0.1).abs() < 1e-12);
}

#[test]
fn yaw_leaves_the_tip_where_it_is() {
    let held = Pose::identity();
    let turned = displaced(&held, Offset { elevation_m: 0.0, yaw_rad: 0.2 }, &Point::new(5e-3, 0.0, 0.02));
    let tip = turned * Point::new(5e-3, 0.0, 0.02);
    assert!((tip - Point::new(5e-3, 0.0, 0.02)).norm() < 1e-15);
}

#[test]
fn after_a_recovery_the_plane_stays_where_the_tip_was_found() {
    let mut setup = setup(View::Lateral);
    setup.servo.dither_m = 0.0;
    let mut servo = Servo::new(setup);
    servo.answer(&acquisition(0), &estimate(TrackState::Tracking));
    let mut at = Pose::identity();
    for k in 1..20 {
        let seen = Acquisition { base_from_probe: at, ..acquisition(k) };
        at = servo.answer(&seen, &estimate(TrackState::Lost)).target_base_from_probe.unwrap();
    }
    assert!(at.translation.y > 1e-3, "the sweep is on its way");
    let found = Acquisition { base_from_probe: at, ..acquisition(20) };
    for _ in 0..3 {
        let command = servo.answer(&found, &estimate(TrackState::Tracking));
        let stays = command.target_base_from_probe.unwrap();
        assert!((stays.translation.vector - at.translation.vector).norm() < 1e-9);
    }
}

#[test]
fn a_restored_servo_answers_like_the_one_it_was_taken_from() {
    let mut one = Servo::new(setup(View::Lateral));
    for k in 0..20 {
        one.answer(&acquisition(k), &estimate(TrackState::Tracking));
    }
    one.answer(&acquisition(20), &estimate(TrackState::Lost));
    let mut two = Servo::restore(setup(View::Lateral), one.state().clone());
    for k in 21..60 {
        let lost = estimate(TrackState::Lost);
        assert_eq!(one.answer(&acquisition(k), &lost), two.answer(&acquisition(k), &lost));
    }
}

/// Looks for a lost tip with a candidate in sight within half a millimetre of a plane 1 mm aside; the arm and the needle obey, and
/// `carries` is the share of the needle's way that the candidate goes along. Whether it may be confirmed, and the needle's way.
fn search_past_a_candidate(by_hand: bool, carries: f64) -> (bool, f64) {
    let mut servo = Servo::new(setup(View::Lateral));
    servo.answer(&acquisition(0), &estimate(TrackState::Tracking));
    let (mut at, mut fed_m, mut feed_m_s) = (Pose::identity(), 0.0, 0.0);
    for k in 1..1000 {
        let seen = Acquisition {
            base_from_probe: at,
            depth_m: Some(0.02 + fed_m).filter(|_| !by_hand),
            feed_m_s: Some(feed_m_s).filter(|_| !by_hand),
            ..acquisition(k)
        };
        let aside_m = at.translation.y - 1e-3;
        let visible = aside_m.abs() < 0.5e-3;
        if visible && servo.guidance(&seen).confirmation == Confirmation::Confirms {
            return (true, fed_m);
        }
        if matches!(servo.mode(), Mode::Search(search) if search.phase == Phase::NotFound) {
            break;
        }
        let way_px = carries * fed_m / servo.setup.geometry.spacing_m;
        let px = [319.5 + 0.6 * way_px, 200.0 + 0.8 * way_px];
        let visible = visible && !servo.guidance(&seen).refused.iter().any(|disc| disc.contains(px));
        let said = Estimate {
            tip_px: Some(px),
            tip_level: Some(200.0 - 1e8 * aside_m * aside_m),
            ..estimate(if visible { TrackState::Recovering } else { TrackState::Lost })
        };
        let command = servo.answer(&seen, &said);
        assert!(command.feed_m_s == 0.0 || visible || by_hand, "the needle is fed without a candidate");
        let pushed_m = if by_hand { HAND_GOES_ON_M + fed_m } else { 0.0 };
        let unmeasured_px = servo.guidance(&seen).unmeasured_px;
        assert!((unmeasured_px * servo.setup.geometry.spacing_m - pushed_m).abs() < 1e-9, "{unmeasured_px}");
        feed_m_s = command.feed_m_s;
        fed_m += 0.04 * feed_m_s;
        at = command.target_base_from_probe.unwrap();
    }
    (false, fed_m)
}

#[test]
fn a_candidate_is_confirmed_only_once_it_went_with_the_needle() {
    let (confirmed, fed_m) = search_past_a_candidate(false, 1.0);
    assert!(confirmed && (0.3e-3..0.7e-3).contains(&fed_m), "{fed_m}");
    let (confirmed, fed_m) = search_past_a_candidate(false, 0.0);
    assert!(!confirmed && (0.5e-3..1.2e-3).contains(&fed_m), "tested once: {fed_m}");
    let (confirmed, fed_m) = search_past_a_candidate(true, 1.0);
    assert!(confirmed && (0.3e-3..0.9e-3).contains(&fed_m), "by hand: {fed_m}");
    let (confirmed, fed_m) = search_past_a_candidate(true, 0.0);
    assert!(!confirmed && (2.0e-3..4.1e-3).contains(&fed_m), "by hand: {fed_m}");
}

#[test]
fn a_lost_tip_is_sought_about_its_last_place_and_by_hand_where_it_may_have_been_pushed_on_to() {
    let mut servo = Servo::new(setup(View::Lateral));
    servo.answer(&acquisition(0), &estimate(TrackState::Tracking));
    let measured = servo.guidance(&acquisition(1));
    let by_hand = servo.guidance(&Acquisition { depth_m: None, feed_m_s: None, ..acquisition(1) });
    let px_per_m = 1.0 / servo.setup.geometry.spacing_m;
    let near_px = servo.setup.servo.candidate_reach_m * px_per_m;
    assert_eq!([measured.reach_px, measured.unmeasured_px], [near_px, 0.0]);
    assert_eq!([by_hand.reach_px, by_hand.unmeasured_px], [near_px, HAND_GOES_ON_M * px_per_m]);
}
