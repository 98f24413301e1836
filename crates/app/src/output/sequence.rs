//! `sequence.mha`: every picture of a run with the poses and labels that belong to it.

use sonoloop_types::TICKS_PER_SECOND;

use super::{Outcome, OutputError, Stage};
use crate::sequence::SequenceWriter;

/// Name of the file.
pub(super) const SEQUENCE: &str = "sequence.mha";

/// Writes the pictures of a run as `sequence.mha`, one per image of `images.csv` and in its order; nothing when the run
/// has none or kept none.
///
/// | field | holds |
/// |---|---|
/// | `Timestamp` | when the image was taken, simulated seconds |
/// | `ProbeToBaseTransform` | the measured pose of the probe, as the tracker is told, mm |
/// | `TrueProbeToWorldTransform` | the true pose of the probe, mm |
/// | `TrueTipPx` | true u and v of what a tracker should point at, pixels |
/// | `TrueTipVisible` | 1 when it is visible, else 0 |
/// | `ImageToProbeTransform` (of the file) | from pixels (u, v, against elevation) to mm in the probe frame |
pub fn write_sequence(stage: &Stage, outcome: &Outcome<'_>) -> Result<(), OutputError> {
    let Outcome { scenario, recording, version, .. } = *outcome;
    let Some(pixels) = recording.pixels.as_ref().filter(|pixels| !pixels.is_empty()) else { return Ok(()) };
    let geometry = scenario.probe.geometry;
    let spacing_mm = geometry.spacing_m * 1e3;
    let mut writer =
        SequenceWriter::create(&stage.path(SEQUENCE), [geometry.width_px, geometry.height_px], spacing_mm)?;
    writer.set("Scenario", &scenario.name)?;
    writer.set("Seed", &scenario.seed.to_string())?;
    writer.set("Version", version)?;
    let left_mm = geometry.probe_from_px([0.0, 0.0]).x * 1e3;
    writer.set(
        "ImageToProbeTransform",
        &format!("{spacing_mm} 0 0 {left_mm} 0 0 -{spacing_mm} 0 0 {spacing_mm} 0 0 0 0 0 1"),
    )?;
    for (index, row) in recording.images.iter().enumerate().take(pixels.len()) {
        let image = pixels.get(index).map_err(OutputError::Pictures)?;
        let truth = &row.truth;
        let time_s = row.acquisition.acquisition_tick as f64 / TICKS_PER_SECOND as f64;
        let transforms =
            [("ProbeToBase", row.acquisition.base_from_probe), ("TrueProbeToWorld", truth.world_from_probe)];
        let [u, v] = truth.reference_px;
        let tip = format!("{u:.6} {v:.6}");
        let visible = if truth.visible { "1" } else { "0" };
        writer.push(&image, time_s, &transforms, &[("TrueTipPx", &tip), ("TrueTipVisible", visible)])?;
    }
    Ok(writer.finish()?)
}
