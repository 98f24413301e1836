//! A scenario and a run made up for tests: a tip that moves, is lost and found again.

use sonoloop_scenario::{
    ArmSpec, Bound, CalibrationSpec, DelaySpec, Expectation, InsertionSpec, NeedleRobotSpec, PhantomSpec,
    PlacementSpec, Scenario,
};
use sonoloop_types::{
    Effects, ElevationSample, Event, EventKind, Image, ImageGeometry, Limits, NeedleSpec, Point, Pose,
    Precision, ProbeSpec, Profile, ServoSettings, TrackState, TrackerSettings, Vector, View,
};

use crate::judge::test_recording::{image_row, recording, tick_row};
use crate::record::{ImageStore, Recording, TickRow, Timing, image_hash};

/// Ticks between its images.
pub(crate) const PERIOD: u64 = 40;

/// A scenario with this picture layout; nothing in it can be simulated, everything can be written.
pub(crate) fn scenario(geometry: ImageGeometry) -> Scenario {
    let range = |min, max| Bound::Range { min, max };
    let expect = |metric: &str, bound| Expectation { metric: metric.into(), bound };
    Scenario {
        name: "made_up".into(),
        description: "A run <made up> to be written".into(),
        source: "made_up.yaml".into(),
        seed: 3,
        duration_ticks: 20_000,
        images: None,
        image_period_ticks: PERIOD,
        view: View::Lateral,
        arm: ArmSpec {
            name: "no arm".into(),
            urdf: serde_json::from_str("{\"name\":\"none\"}").expect("a robot without links"),
            base_link: "base".into(),
            flange_link: "base".into(),
            joint_names: Default::default(),
            world_from_base: Pose::identity(),
            flange_from_probe: Pose::identity(),
            home_rad: [0.0; 6],
            max_acceleration_rad_s2: 20.0,
            max_jerk_rad_s3: 400.0,
            opw: None,
        },
        needle_robot: NeedleRobotSpec {
            name: "feeder".into(),
            urdf: serde_json::from_str("{\"name\":\"none\"}").expect("a robot without links"),
            base_link: "base".into(),
            hub_link: "base".into(),
            joint_names: Default::default(),
            world_from_base: Pose::identity(),
            max_feed_m_s: 0.02,
            max_acceleration_m_s2: 0.5,
            max_depth_m: 0.1,
            max_force_n: 8.0,
            watchdog_ticks: 200,
        },
        probe: probe(geometry),
        needle: NeedleSpec {
            name: "22G".into(),
            outer_diameter_m: 0.718e-3,
            length_m: 0.15,
            bevel_rad: 0.5,
            curvature_per_m: 0.5,
            specular_level_db: 40.0,
            rough_level_db: 10.0,
            tip_level_db: 20.0,
        },
        phantom: PhantomSpec {
            name: "block".into(),
            size_m: [0.2, 0.1, 0.06],
            background: 0,
            materials: Vec::new(),
            inclusions: Vec::new(),
        },
        insertion: InsertionSpec {
            entry_in_world: Point::origin(),
            axis_in_world: Vector::new(0.8, 0.0, -0.6),
            bevel_roll_rad: 0.0,
            start_depth_m: 0.015,
            target_depth_m: 0.055,
            hand: None,
            target_tolerance_m: 2e-3,
        },
        placement: PlacementSpec {
            tip_lateral_m: 0.0,
            contact_force_n: 5.0,
            yaw_rad: 0.0,
            tilt_rad: 0.0,
            alignment_sigma_m: 0.0,
            alignment_sigma_rad: 0.0,
        },
        calibration: CalibrationSpec {
            needle_sigma_m: 2e-3,
            needle_sigma_rad: 0.017,
            probe_sigma_m: 1e-3,
            probe_sigma_rad: 0.01,
            robot_sigma_m: 0.0,
            robot_sigma_rad: 0.0,
            encoder_sigma_rad: 0.0,
            encoder_sigma_m: 0.0,
            click_sigma_px: 1.0,
            force_sigma_n: 0.1,
        },
        limits: Limits {
            max_feed_m_s: 0.02,
            max_probe_speed_m_s: 0.05,
            max_probe_travel_m: 0.1,
            max_probe_turn_rad: 0.5,
            max_contact_force_n: 10.0,
        },
        tracker: TrackerSettings::profile(Profile::Robust, 20),
        servo: servo(),
        delays: DelaySpec { image_ticks: 0, command_ticks: 1 },
        disturbances: Vec::new(),
        expect: vec![
            expect("success", Bound::Is(true)),
            expect("coverage", range(Some(0.7), None)),
            expect("losses", range(Some(1.0), None)),
            expect("recoveries", range(Some(1.0), None)),
            expect("false_recoveries", range(None, Some(0.0))),
            expect("travel_after_loss_mm", range(None, Some(5.0))),
        ],
        resolved_yaml: "name: made_up # <here>\nseed: 3\n".into(),
    }
}

fn probe(geometry: ImageGeometry) -> ProbeSpec {
    let sample = |depth_m, width_m| ElevationSample { depth_m, width_m };
    ProbeSpec {
        name: "linear".into(),
        elements: 192,
        pitch_m: 0.6 * f64::from(geometry.width_px) * geometry.spacing_m / 192.0,
        centre_frequency_hz: 7.5e6,
        fractional_bandwidth: 0.8,
        f_number: 2.0,
        transmit_focus_m: None,
        element_height_m: 5e-3,
        elevation_focus_m: 20e-3,
        elevation: vec![sample(0.0, 4e-3), sample(0.02, 1.5e-3), sample(0.05, 3e-3)],
        assumed_sound_speed_m_s: 1540.0,
        tgc_db_cm_mhz: 0.5,
        tgc_sliders_db: Vec::new(),
        dynamic_range_db: 60.0,
        speckle_level_db: -25.0,
        noise_level_db: -40.0,
        geometry,
        effects: Effects::default(),
        precision: Precision::default(),
    }
}

fn servo() -> ServoSettings {
    ServoSettings {
        feed_m_s: 0.01,
        approach_m: 0.005,
        lateral_deadband_m: 0.005,
        slide_speed_m_s: 0.02,
        elevation_gain_per_s: 0.0,
        dither_m: 0.0,
        dither_period_s: 1.0,
        sweep_speed_m_s: 0.005,
        sweep_reach_m: 0.006,
        yaw_reach_rad: 0.2,
        yaw_speed_rad_s: 0.1,
        max_search_travel_m: 0.1,
        max_search_s: 10.0,
        ..ServoSettings::default()
    }
}

/// A run of `images` images (at least 10) drawn by `draw(sequence, tip_px, plane offset in m)`: lost after a
/// quarter, found after half, at the target at the end.
pub(crate) fn run(
    scenario: &Scenario,
    images: u64,
    mut draw: impl FnMut(u64, [f64; 2], f64) -> Image,
) -> Recording {
    let geometry = scenario.probe.geometry;
    let (lost, declared, seen, confirmed) = (images / 4, images / 4 + 3, images / 2, images / 2 + 3);
    let moving = images - (confirmed - declared);
    let insertion = scenario.insertion;
    let way_m = insertion.target_depth_m - insertion.start_depth_m;
    let mut rows = Vec::new();
    let mut ticks = Vec::new();
    let mut pixels = ImageStore::new().expect("a temporary file");
    let mut steps = 0;
    for k in 0..images {
        let state = match k {
            _ if k < declared => TrackState::Tracking,
            _ if k < seen => TrackState::Lost,
            _ if k < confirmed => TrackState::Recovering,
            _ => TrackState::Tracking,
        };
        let wobble = (k as f64 * 0.7).sin();
        let offset_m = if (lost..seen).contains(&k) {
            // The tip comes back into the plane as the arm sweeps.
            3e-3 * (1.0 - (k - lost) as f64 / (seen - lost) as f64 * 0.8)
        } else {
            0.2e-3 * wobble
        };
        let visible = !(lost..seen).contains(&k);
        steps += u64::from(state == TrackState::Tracking);
        let depth_m = insertion.start_depth_m + way_m * steps as f64 / moving as f64;
        let tip_in_probe = Point::new(0.8 * depth_m - 0.03, offset_m, 0.6 * depth_m);
        let tip_px = geometry.px_from_probe(&tip_in_probe);
        let mut row = image_row(k, visible, Some(state), 0.0);
        row.truth.reference_px = tip_px;
        row.truth.tip_in_probe = tip_in_probe;
        row.truth.plane_to_tip_m = offset_m;
        row.truth.depth_m = depth_m;
        row.truth.feed_m_s = if state == TrackState::Tracking { 0.01 } else { 0.0 };
        row.truth.target_distance_m = insertion.target_depth_m - depth_m;
        row.truth.contact_force_n = 5.0 + 0.2 * wobble;
        row.acquisition.depth_m = Some(depth_m);
        row.acquisition.feed_m_s = Some(row.truth.feed_m_s);
        let estimate = &mut row.command.as_mut().expect("an answer").estimate;
        let seen_share = (-(offset_m * 1e3).powi(2) / 2.0).exp();
        estimate.tip_px = Some([tip_px[0] + 0.6 * wobble, tip_px[1] - 0.4]);
        estimate.ncc_previous = Some(0.3 + 0.68 * seen_share);
        estimate.ncc_anchor = Some(0.2 + 0.7 * seen_share);
        estimate.brightness_ratio = Some(1.0 - 0.7 * seen_share);
        estimate.iterations = 9;
        if state == TrackState::Lost {
            estimate.reason = sonoloop_types::Reason::NccPrevious;
        }
        let image = draw(k, tip_px, offset_m);
        row.hash = image_hash(&image);
        pixels.push(&image).expect("room in the temporary folder");
        for tick in k * PERIOD..(k + 1) * PERIOD {
            ticks.push(TickRow { tick, ..TickRow::from(&row.truth) });
        }
        assert_eq!(ticks[ticks.len() - 1].min_joint_margin_rad, tick_row(0, true).min_joint_margin_rad);
        rows.push(row);
    }
    let event = |image: u64, kind, detail: &str| Event { tick: image * PERIOD, kind, detail: detail.into() };
    let mut recording = recording(ticks, rows);
    recording.events = vec![
        event(lost, EventKind::Disturbance, "probe slips 3.0 mm out of plane"),
        event(declared, EventKind::StateChange, "tracking -> lost (ncc_previous)"),
        event(declared + 1, EventKind::NeedleStopped, "at 24.2 mm"),
        event(confirmed, EventKind::StateChange, "recovering -> tracking (ok)"),
        event(images, EventKind::End, "target reached, \"0.0\" mm off"),
    ];
    recording.timing = Timing {
        render_ms: vec![2.0; images as usize],
        wall_s: 1.0,
        simulated_s: images as f64 * 0.04,
        ..Timing::default()
    };
    recording.pixels = Some(pixels);
    recording
}
