use nalgebra::Point3;
use serde::Serialize;
use sonoloop_types::{Pose, Reason, TICKS_PER_SECOND, TrackState};

use super::words::Teller;
use crate::record::ImageRow;
use crate::session::Shown;

/// What one image adds to the page.
#[derive(Serialize)]
struct Row<'a> {
    i: u64,
    t_s: f64,
    state: Option<TrackState>,
    reason: Option<Reason>,
    tip_px: Option<[f64; 2]>,
    ncc_previous: Option<f64>,
    ncc_anchor: Option<f64>,
    force_n: f64,
    depth_mm: Option<f64>,
    feed_mm_s: Option<f64>,
    true_tip_px: [f64; 2],
    visible: bool,
    plane_offset_mm: f64,
    /// Of images that the tracker claims to see the tip in.
    tip_error_mm: Option<f64>,
    words: &'a str,
    /// What has happened since the image before.
    events: Vec<EventLine<'a>>,
}

#[derive(Serialize)]
struct EventLine<'a> {
    t_s: f64,
    text: &'a str,
}

/// Where everything is, for the 3-D scene.
#[derive(Serialize)]
struct Scene {
    world_from_probe: PoseLine,
    phantom_mm: [f64; 3],
    arm_rad: [f64; 6],
    needle_robot: Option<[f64; 5]>,
    needle: Vec<[f64; 3]>,
}

/// x, y, z in metres, then a unit quaternion x, y, z, w.
pub(super) type PoseLine = [f64; 7];

pub(super) fn pose_line(pose: &Pose) -> PoseLine {
    let (at, turn) = (pose.translation.vector, pose.rotation.coords);
    [at.x, at.y, at.z, turn.x, turn.y, turn.z, turn.w]
}

/// Writes the rows of one run.
#[derive(Default)]
pub(super) struct RowWriter {
    teller: Teller,
    events: usize,
}

impl RowWriter {
    /// Row and scene of an image, as JSON. `spacing_m` is the side of a pixel.
    pub fn write(
        &mut self,
        row: &ImageRow,
        shown: &Shown,
        spacing_m: f64,
    ) -> serde_json::Result<(String, String)> {
        let words = self.teller.tell(row);
        let (acquisition, truth) = (&row.acquisition, &row.truth);
        let seconds = |tick: u64| tick as f64 / TICKS_PER_SECOND as f64;
        let estimate = row.command.map(|command| command.estimate);
        let tip_px = estimate.and_then(|estimate| estimate.tip_px);
        let error =
            |[u, v]: [f64; 2]| (u - truth.reference_px[0]).hypot(v - truth.reference_px[1]) * spacing_m * 1e3;
        let new = &shown.events[self.events.min(shown.events.len())..];
        self.events = shown.events.len();
        let line = Row {
            i: acquisition.sequence,
            t_s: seconds(acquisition.acquisition_tick),
            state: row.state(),
            reason: estimate.map(|estimate| estimate.reason),
            tip_px,
            ncc_previous: estimate.and_then(|estimate| estimate.ncc_previous),
            ncc_anchor: estimate.and_then(|estimate| estimate.ncc_anchor),
            force_n: acquisition.contact_force_n,
            depth_mm: acquisition.depth_m.map(|depth_m| depth_m * 1e3),
            feed_mm_s: acquisition.feed_m_s.map(|feed_m_s| feed_m_s * 1e3),
            true_tip_px: truth.reference_px,
            visible: truth.visible,
            plane_offset_mm: truth.plane_to_tip_m * 1e3,
            tip_error_mm: tip_px.filter(|_| row.is_tracking()).map(error),
            words: &words,
            events: new
                .iter()
                .map(|event| EventLine { t_s: seconds(event.tick), text: &event.detail })
                .collect(),
        };
        let posture = shown.posture;
        let at_mm = posture.world_from_phantom.translation.vector * 1e3;
        let scene = Scene {
            world_from_probe: pose_line(&truth.world_from_probe),
            phantom_mm: at_mm.into(),
            arm_rad: posture.arm_rad,
            needle_robot: posture.needle_robot,
            needle: posture.needle_in_world.iter().map(|Point3 { coords }| (*coords).into()).collect(),
        };
        Ok((serde_json::to_string(&line)?, serde_json::to_string(&scene)?))
    }
}
