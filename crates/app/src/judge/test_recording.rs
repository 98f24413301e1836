//! Recordings written by hand, for tests.

use sonoloop_types::{
    Acquisition, ArmStatus, Command, EndReason, Estimate, ImageGeometry, Point, Pose, Reason, TrackState,
    Truth,
};

use super::Facts;
use crate::record::{ImageRow, Recording, TickRow, Timing};

/// Ticks between the images of these recordings.
pub(crate) const PERIOD: u64 = 40;

/// 0.1 mm per pixel, 25 images per second, 1 mm tolerance, 10 N, 0.5 s of silence, 0.1 s to stop.
pub(crate) fn facts() -> Facts {
    Facts {
        geometry: ImageGeometry::default(),
        image_period_ticks: PERIOD,
        target_tolerance_m: 1e-3,
        max_contact_force_n: 10.0,
        silent_loss_bound_s: 0.5,
        stop_bound_s: 0.1,
    }
}

pub(crate) fn tick_row(tick: u64, visible: bool) -> TickRow {
    TickRow {
        tick,
        visible,
        plane_to_tip_m: 0.0,
        depth_m: 0.0,
        feed_m_s: 0.0,
        contact_force_n: 5.0,
        needle_force_n: 0.5,
        min_joint_margin_rad: 0.5,
        target_distance_m: 0.0,
        collision: false,
    }
}

/// An image at its regular tick, published at once; the true tip at (100, 200) and the answer beside it by
/// `error_px` = (3, 4)·x, so that its length is 5·x.
pub(crate) fn image_row(sequence: u64, visible: bool, state: Option<TrackState>, error_px: f64) -> ImageRow {
    let tick = sequence * PERIOD;
    let (du, dv) = (0.6 * error_px, 0.8 * error_px);
    ImageRow {
        acquisition: Acquisition {
            sequence,
            acquisition_tick: tick,
            publication_tick: tick,
            pose_tick: tick,
            base_from_probe: Pose::identity(),
            depth_m: Some(0.0),
            feed_m_s: Some(0.0),
            contact_force_n: 5.0,
            arm_status: ArmStatus::Ready,
            last_command: None,
        },
        hash: 0,
        truth: Truth {
            tick,
            world_from_probe: Pose::identity(),
            tip_in_world: Point::origin(),
            tip_in_probe: Point::origin(),
            reference_px: [100.0, 200.0],
            plane_to_tip_m: 0.0,
            visible,
            depth_m: 0.0,
            feed_m_s: 0.0,
            contact_force_n: 5.0,
            needle_force_n: 0.5,
            target_distance_m: 0.0,
            min_joint_margin_rad: 0.5,
            collision: false,
        },
        command: state.map(|state| Command {
            answers: sequence,
            estimate: Estimate::bare(state, Reason::Ok, Some([100.0 + du, 200.0 + dv])),
            target_base_from_probe: None,
            compute_us: 0.0,
            feed_m_s: 0.0,
        }),
        command_age_ticks: PERIOD,
    }
}

pub(crate) fn recording(ticks: Vec<TickRow>, images: Vec<ImageRow>) -> Recording {
    Recording {
        ticks,
        images,
        events: Vec::new(),
        end: EndReason::TargetReached,
        timing: Timing::default(),
        pixels: None,
        disturbed: None,
    }
}

/// A recording from a script, one letter per image: tracker `T`racking, `L`ost, `R`ecovering, `S`earching
/// or `.` down; upper line the tip's visibility, `v` or `-`, which holds until the next image. The needle
/// goes 10 mm/s, 0.01 mm per tick, whenever the last answer was TRACKING, and stands otherwise.
pub(crate) fn scripted(visibility: &str, states: &str) -> Recording {
    assert_eq!(visibility.len(), states.len());
    let mut ticks = Vec::new();
    let mut images = Vec::new();
    let mut depth_m = 0.0;
    for (sequence, (seen, state)) in visibility.bytes().zip(states.bytes()).enumerate() {
        let state = match state {
            b'T' => Some(TrackState::Tracking),
            b'L' => Some(TrackState::Lost),
            b'R' => Some(TrackState::Recovering),
            b'S' => Some(TrackState::Searching),
            b'.' => None,
            other => panic!("no state is called {other}"),
        };
        let sequence = sequence as u64;
        images.push(image_row(sequence, seen == b'v', state, 0.0));
        let feed_m_s = if state == Some(TrackState::Tracking) { 0.010 } else { 0.0 };
        for tick in sequence * PERIOD..(sequence + 1) * PERIOD {
            ticks.push(TickRow { depth_m, feed_m_s, ..tick_row(tick, seen == b'v') });
            depth_m += feed_m_s / 1000.0;
        }
    }
    recording(ticks, images)
}
