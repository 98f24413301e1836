//! How well the tip is followed while the tracker claims to see it.

use sonoloop_types::TICKS_PER_SECOND;

use super::Facts;
use crate::record::ImageRow;

/// A claimed position farther than this from the truth is wrong.
pub const WRONG_BEYOND_M: f64 = 2e-3;

/// Each silent stretch is free for this long: no test can notice at once.
const FREE_SILENCE_S: f64 = 0.2;

/// Distance in the picture of the claimed tip from the true reference, both of the image answered (so an
/// image delay is no error). `None` without an answer, without a position, or for one that is not finite.
pub fn tip_error_px(row: &ImageRow) -> Option<f64> {
    let [u, v] = row.command?.estimate.tip_px?;
    let [true_u, true_v] = row.truth.reference_px;
    let error_px = ((u - true_u).powi(2) + (v - true_v).powi(2)).sqrt();
    error_px.is_finite().then_some(error_px)
}

/// True when a claim on this image would be wrong: tip not visible, no position, or more than 2 mm off.
pub(super) fn is_wrong(row: &ImageRow, facts: &Facts) -> bool {
    !row.truth.visible || tip_error_px(row).is_none_or(|px| px * facts.geometry.spacing_m > WRONG_BEYOND_M)
}

/// Tip errors over images that are visible and TRACKING.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct TipErrors {
    pub rmse_px: f64,
    /// 95th percentile, nearest rank.
    pub p95_px: f64,
    pub max_px: f64,
}

pub(super) fn tip_errors(images: &[ImageRow]) -> Option<TipErrors> {
    let mut errors_px: Vec<f64> =
        images.iter().filter(|row| row.truth.visible && row.is_tracking()).filter_map(tip_error_px).collect();
    let rmse_px = rms(&errors_px)?;
    errors_px.sort_by(f64::total_cmp);
    let rank = (errors_px.len() * 95).div_ceil(100);
    Some(TipErrors { rmse_px, p95_px: errors_px[rank - 1], max_px: errors_px[errors_px.len() - 1] })
}

/// Share of visible images that are TRACKING with a position; `None` when no image is visible.
pub(super) fn coverage(images: &[ImageRow]) -> Option<f64> {
    let visible = images.iter().filter(|row| row.truth.visible).count();
    let covered = images
        .iter()
        .filter(|row| row.truth.visible && row.is_tracking() && tip_error_px(row).is_some())
        .count();
    (visible > 0).then(|| covered as f64 / visible as f64)
}

/// Root mean square of the distance from plane to tip over TRACKING images; `None` without any.
pub(super) fn plane_to_tip_rms_m(images: &[ImageRow]) -> Option<f64> {
    let offsets_m: Vec<f64> =
        images.iter().filter(|row| row.is_tracking()).map(|row| row.truth.plane_to_tip_m).collect();
    rms(&offsets_m)
}

/// Seconds of TRACKING while not visible or more than 2 mm off. A claim stands until the next image, the last one for an image
/// period, so that lost images shorten nothing; of each unbroken stretch the first 0.2 s are free.
pub(super) fn silent_loss_s(images: &[ImageRow], facts: &Facts) -> f64 {
    let is_silent = |row: &ImageRow| row.is_tracking() && is_wrong(row, facts);
    let mut next = 0;
    images
        .chunk_by(|a, b| is_silent(a) == is_silent(b))
        .map(|stretch| {
            next += stretch.len();
            let (first, last) = (&stretch[0].acquisition, &stretch[stretch.len() - 1].acquisition);
            let end_tick = images.get(next).map_or(last.acquisition_tick + facts.image_period_ticks, |row| {
                row.acquisition.acquisition_tick
            });
            (stretch, end_tick - first.acquisition_tick)
        })
        .filter(|(stretch, _)| is_silent(&stretch[0]))
        .map(|(_, ticks)| (ticks as f64 / TICKS_PER_SECOND as f64 - FREE_SILENCE_S).max(0.0))
        // Not `sum`: the empty sum of floats is −0.
        .fold(0.0, |total, silence_s| total + silence_s)
}

fn rms(values: &[f64]) -> Option<f64> {
    let sum: f64 = values.iter().map(|value| value * value).sum();
    (!values.is_empty()).then(|| (sum / values.len() as f64).sqrt())
}
