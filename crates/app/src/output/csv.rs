//! `images.csv` and `events.csv`: fixed columns, fixed digits, nothing that a clock told.

use std::fmt::Write;

use serde::Serialize;
use sonoloop_types::{Event, ProbeSpec, TICKS_PER_SECOND};

use crate::record::ImageRow;

pub(crate) const IMAGE_COLUMNS: &str = "sequence,tick,publication_tick,image_hash,tip_u_px,tip_v_px,visible,\
    plane_offset_mm,estimate_u_px,estimate_v_px,state,reason,ncc_previous,ncc_anchor,brightness_ratio,\
    tip_level,iterations,conditioning,depth_mm,feed_mm_s,feed_command_mm_s,force_n,needle_force_n,arm_status,\
    target_x_mm,target_y_mm,target_z_mm,target_qx,target_qy,target_qz,target_qw,command_age_ms,half_slice_mm";

/// One row per image. `tip_*` is the true reference point, `depth`, `feed` and both forces are true values, the target is
/// `target_base_from_probe`, `command_age` that of the image which the command in effect answers, `half_slice` half the slice
/// thickness at the tip's depth, within which the tip shows; a field without a value is empty. Equal runs give equal bytes.
pub fn images_csv(images: &[ImageRow], probe: &ProbeSpec) -> String {
    let lines = images.iter().map(|row| image_line(row, probe));
    std::iter::once(IMAGE_COLUMNS.to_owned()).chain(lines).map(|line| line + "\n").collect()
}

/// One row of `images.csv`, without a line break.
pub(crate) fn image_line(row: &ImageRow, probe: &ProbeSpec) -> String {
    let (acquisition, truth) = (&row.acquisition, &row.truth);
    let estimate = row.command.map(|command| command.estimate);
    let tip_px = estimate.and_then(|estimate| estimate.tip_px);
    let target = row.command.and_then(|command| command.target_base_from_probe);
    let quaternion = target.map(|pose| pose.rotation.into_inner().coords);
    let mut fields = vec![
        acquisition.sequence.to_string(),
        acquisition.acquisition_tick.to_string(),
        acquisition.publication_tick.to_string(),
        format!("{:016x}", row.hash),
        number(Some(truth.reference_px[0])),
        number(Some(truth.reference_px[1])),
        u8::from(truth.visible).to_string(),
        number(Some(truth.plane_to_tip_m * 1e3)),
        number(tip_px.map(|[u, _]| u)),
        number(tip_px.map(|[_, v]| v)),
        estimate.map_or(String::new(), |estimate| snake(&estimate.state)),
        estimate.map_or(String::new(), |estimate| snake(&estimate.reason)),
        number(estimate.and_then(|estimate| estimate.ncc_previous)),
        number(estimate.and_then(|estimate| estimate.ncc_anchor)),
        number(estimate.and_then(|estimate| estimate.brightness_ratio)),
        number(estimate.and_then(|estimate| estimate.tip_level)),
        estimate.map_or(String::new(), |estimate| estimate.iterations.to_string()),
        number(estimate.and_then(|estimate| estimate.conditioning)),
        number(Some(truth.depth_m * 1e3)),
        number(Some(truth.feed_m_s * 1e3)),
        number(row.command.map(|command| command.feed_m_s * 1e3)),
        number(Some(truth.contact_force_n)),
        number(Some(truth.needle_force_n)),
        snake(&acquisition.arm_status),
    ];
    fields.extend((0..3).map(|axis| number(target.map(|pose| pose.translation.vector[axis] * 1e3))));
    fields.extend((0..4).map(|axis| number_nine(quaternion.map(|quaternion| quaternion[axis]))));
    fields.push((row.command_age_ticks * 1000 / TICKS_PER_SECOND).to_string());
    fields.push(number(Some(probe.slice_thickness_m(truth.tip_in_probe.z) * 0.5e3)));
    fields.join(",")
}

/// One row per event: tick, time, kind, and the sentence in quotes.
pub fn events_csv(events: &[Event]) -> String {
    let mut csv = "tick,time_s,kind,detail\n".to_owned();
    for event in events {
        let seconds = event.tick as f64 / TICKS_PER_SECOND as f64;
        let detail = event.detail.replace('"', "\"\"");
        let line = writeln!(csv, "{},{seconds:.3},{},\"{detail}\"", event.tick, snake(&event.kind));
        debug_assert!(line.is_ok(), "writing to a string");
    }
    csv
}

/// Six digits behind the point (a nanometre, a microgray level); empty without a value; no minus zero.
fn number(value: Option<f64>) -> String {
    value.map_or(String::new(), |value| without_minus_zero(format!("{value:.6}")))
}

/// Nine digits, for quaternions: a nanoradian.
fn number_nine(value: Option<f64>) -> String {
    value.map_or(String::new(), |value| without_minus_zero(format!("{value:.9}")))
}

fn without_minus_zero(text: String) -> String {
    match text.strip_prefix('-') {
        Some(digits) if digits.bytes().all(|byte| matches!(byte, b'0' | b'.')) => digits.to_owned(),
        _ => text,
    }
}

/// The name under which a unit variant is written in every file, `snake_case`.
pub(crate) fn snake(variant: &impl Serialize) -> String {
    match serde_json::to_value(variant) {
        Ok(serde_json::Value::String(name)) => name,
        _ => String::new(),
    }
}

#[cfg(test)]
mod tests {
    use sonoloop_types::{EventKind, ImageGeometry, Pose, TrackState};

    use super::*;
    use crate::judge::test_recording::image_row;
    use crate::output::test_run::scenario;

    /// Its slice is 4 mm thick at the face, 1.5 mm at 20 mm depth.
    fn probe() -> ProbeSpec {
        scenario(ImageGeometry::default()).probe
    }

    #[test]
    fn every_line_has_every_column() {
        let mut rows = vec![
            image_row(0, true, Some(TrackState::Tracking), 1.0),
            image_row(1, false, Some(TrackState::Lost), 1.0),
            image_row(2, true, None, 1.0),
        ];
        rows[0].command.as_mut().unwrap().target_base_from_probe = Some(Pose::translation(0.1, -0.2, 0.3));
        let csv = images_csv(&rows, &probe());
        let columns = IMAGE_COLUMNS.split(',').count();
        for line in csv.lines() {
            assert_eq!(line.split(',').count(), columns, "{line}");
        }
        assert_eq!(csv.lines().count(), 4);
        assert!(!IMAGE_COLUMNS.contains(' '));
    }

    #[test]
    fn a_line_written_by_hand() {
        let mut row = image_row(2, true, Some(TrackState::Tracking), 5.0);
        row.hash = 0xabc;
        row.truth.plane_to_tip_m = -1e-12;
        row.truth.depth_m = 0.0123456789;
        row.truth.tip_in_probe.z = 0.02;
        let command = row.command.as_mut().unwrap();
        command.estimate.ncc_previous = Some(0.75);
        command.target_base_from_probe = Some(Pose::translation(0.1, -0.2, 0.3));
        command.feed_m_s = 0.01;
        let expected = "2,80,80,0000000000000abc,100.000000,200.000000,1,0.000000,103.000000,204.000000,\
            tracking,ok,0.750000,,,,0,,12.345679,0.000000,10.000000,5.000000,0.500000,ready,100.000000,-200.000000,\
            300.000000,0.000000,0.000000,0.000000,1.000000000,40,0.750000"
            .replace("0.000000,0.000000,0.000000,1.", "0.000000000,0.000000000,0.000000000,1.");
        assert_eq!(images_csv(&[row], &probe()).lines().nth(1), Some(expected.as_str()));
    }

    #[test]
    fn details_survive_commas_quotes_and_line_breaks() {
        let detail = "a \"slip\", 3 mm\nand more".to_owned();
        let csv = events_csv(&[Event { tick: 3040, kind: EventKind::Disturbance, detail }]);
        assert_eq!(
            csv,
            "tick,time_s,kind,detail\n3040,3.040,disturbance,\"a \"\"slip\"\", 3 mm\nand more\"\n"
        );
    }
}
