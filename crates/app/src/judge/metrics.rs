use serde::{Deserialize, Serialize};
use sonoloop_types::EndReason;

use super::Facts;
use super::loss::{Loss, losses};
use super::recovery::declared;
use super::stop::stop_delay_s;
use super::tracking::{coverage, plane_to_tip_rms_m, silent_loss_s, tip_errors};
use crate::record::Recording;

/// The metrics of `summary.json`, in its order and under its names. `None` where a metric has no value.
///
/// *Visible*: the tip lies within half the −6 dB slice thickness at its depth, inside the picture, and the
/// aperture above it is in contact (0.71 of it, −6 dB two-way). *Wrong*: not visible, or more than 2 mm off in the picture. An image is compared
/// with the truth at its own acquisition tick; an image without an answer is not TRACKING.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Metrics {
    /// Number of images.
    pub images: u64,
    /// Root mean square of the tip error: estimate − projected true tip, over images that are visible and
    /// TRACKING; in the transverse view against needle axis ∩ plane.
    pub tip_rmse_px: Option<f64>,
    /// 95th percentile (nearest rank) of the tip error.
    pub tip_p95_px: Option<f64>,
    /// Largest tip error.
    pub tip_max_px: Option<f64>,
    /// `tip_rmse_px` in millimetres.
    pub tip_rmse_mm: Option<f64>,
    /// Share of visible images that are TRACKING; `None` when no image is visible.
    pub coverage: Option<f64>,
    /// Number of true losses. One begins at the first tick that is not visible after having been, and ends
    /// when the tip is visible and rightly TRACKED again.
    pub losses: u64,
    /// Number of LOST → TRACKING that were right.
    pub recoveries: u64,
    /// Longest time from a true loss to its declaration, in seconds: until the tracker no longer claims
    /// TRACKING, or the end of the loss when it never declared it; `None` without a loss.
    pub detection_delay_s: Option<f64>,
    /// Longest way of the needle from a true loss to its stop, or to the end of the loss or of the run when
    /// it did not stop; `None` without a loss.
    pub travel_after_loss_mm: Option<f64>,
    /// Longest time from a declared loss to the needle's rest, in seconds; `None` without one.
    pub stop_delay_s: Option<f64>,
    /// Longest time from declaring LOST to the right recovery, in seconds; `None` without a recovery.
    pub recovery_time_s: Option<f64>,
    /// Number of LOST declared while visible.
    pub false_losses: u64,
    /// Number of LOST → TRACKING that were wrong, once per episode.
    pub false_recoveries: u64,
    /// Seconds of TRACKING while wrong, beyond the first 0.2 s of each unbroken stretch.
    pub silent_loss_s: Option<f64>,
    /// Root mean square of the distance from plane to tip over TRACKING images.
    pub plane_to_tip_rms_mm: Option<f64>,
    /// Largest true contact force.
    pub max_contact_force_n: Option<f64>,
    /// Largest true force on the needle against the insertion.
    pub max_needle_force_n: Option<f64>,
    /// Smallest distance of any joint to its limit.
    pub min_joint_margin_deg: Option<f64>,
    /// Distance of the tip from the target at the end.
    pub final_target_distance_mm: Option<f64>,
    /// The tip ends within its bound of the target; contact force within its limit, no collision, no joint
    /// beyond its limit, the needle stopped in time after each declared loss; no false recovery; silent loss within its bound; the run came to its own end.
    pub success: bool,
}

/// Value of one metric.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(untagged)]
pub enum Value {
    /// `success`.
    Truth(bool),
    /// A count; before the numbers, so that one read from a file stays one.
    Count(u64),
    /// Any other metric.
    Number(f64),
}

impl Metrics {
    /// A metric by its name in `summary.json`; `None` for an unknown name or a metric without a value.
    pub fn value(&self, name: &str) -> Option<Value> {
        let number = match name {
            "images" => return Some(Value::Count(self.images)),
            "losses" => return Some(Value::Count(self.losses)),
            "recoveries" => return Some(Value::Count(self.recoveries)),
            "false_losses" => return Some(Value::Count(self.false_losses)),
            "false_recoveries" => return Some(Value::Count(self.false_recoveries)),
            "success" => return Some(Value::Truth(self.success)),
            "tip_rmse_px" => self.tip_rmse_px,
            "tip_p95_px" => self.tip_p95_px,
            "tip_max_px" => self.tip_max_px,
            "tip_rmse_mm" => self.tip_rmse_mm,
            "coverage" => self.coverage,
            "detection_delay_s" => self.detection_delay_s,
            "travel_after_loss_mm" => self.travel_after_loss_mm,
            "stop_delay_s" => self.stop_delay_s,
            "recovery_time_s" => self.recovery_time_s,
            "silent_loss_s" => self.silent_loss_s,
            "plane_to_tip_rms_mm" => self.plane_to_tip_rms_mm,
            "max_contact_force_n" => self.max_contact_force_n,
            "max_needle_force_n" => self.max_needle_force_n,
            "min_joint_margin_deg" => self.min_joint_margin_deg,
            "final_target_distance_mm" => self.final_target_distance_mm,
            _ => None,
        };
        number.map(Value::Number)
    }
}

/// Judges a recording. Defined for every recording, also for an empty one.
pub fn metrics(recording: &Recording, facts: &Facts) -> Metrics {
    let images = &recording.images;
    let ticks = &recording.ticks;
    let errors = tip_errors(images);
    let losses = losses(recording, facts);
    let declared = declared(images, facts);
    let silent_loss_s = silent_loss_s(images, facts);
    let stop_delay_s = stop_delay_s(recording);
    let max_contact_force_n = largest(ticks.iter().map(|row| row.contact_force_n));
    let min_joint_margin_rad = largest(ticks.iter().map(|row| -row.min_joint_margin_rad)).map(|x| -x);
    let final_target_distance_m = ticks.last().map(|row| row.target_distance_m);

    let at_target = final_target_distance_m.is_some_and(|distance_m| distance_m <= facts.target_tolerance_m);
    let within_limits = max_contact_force_n.is_some_and(|force_n| force_n <= facts.max_contact_force_n)
        && min_joint_margin_rad.is_some_and(|margin_rad| margin_rad >= 0.0)
        && !ticks.iter().any(|row| row.collision)
        && stop_delay_s.is_none_or(|delay_s| delay_s <= facts.stop_bound_s);
    let own_end = matches!(recording.end, EndReason::TargetReached | EndReason::TimeOver);

    Metrics {
        images: images.len() as u64,
        tip_rmse_px: errors.map(|errors| errors.rmse_px),
        tip_p95_px: errors.map(|errors| errors.p95_px),
        tip_max_px: errors.map(|errors| errors.max_px),
        tip_rmse_mm: errors.map(|errors| errors.rmse_px * facts.geometry.spacing_m * 1e3),
        coverage: coverage(images),
        losses: losses.len() as u64,
        recoveries: declared.recoveries,
        detection_delay_s: largest(losses.iter().map(Loss::detection_delay_s)),
        travel_after_loss_mm: largest(losses.iter().map(|loss| loss.travel_m() * 1e3)),
        stop_delay_s,
        recovery_time_s: declared.recovery_time_s,
        false_losses: declared.false_losses,
        false_recoveries: declared.false_recoveries,
        silent_loss_s: (!images.is_empty()).then_some(silent_loss_s),
        plane_to_tip_rms_mm: plane_to_tip_rms_m(images).map(|rms_m| rms_m * 1e3),
        max_contact_force_n,
        max_needle_force_n: largest(ticks.iter().map(|row| row.needle_force_n)),
        min_joint_margin_deg: min_joint_margin_rad.map(f64::to_degrees),
        final_target_distance_mm: final_target_distance_m.map(|distance_m| distance_m * 1e3),
        success: at_target
            && within_limits
            && declared.false_recoveries == 0
            && silent_loss_s <= facts.silent_loss_bound_s
            && own_end,
    }
}

/// The largest value; a value that is no number makes the result none, so that no bound can hold by it.
fn largest(values: impl Iterator<Item = f64>) -> Option<f64> {
    values.reduce(|a, b| if a.is_nan() || a > b { a } else { b }).filter(|value| !value.is_nan())
}
