use sonoloop_types::TrackerSettings;

use crate::TrackerError;

/// Refuses settings that the tracker could not work with, by name, value and bound. Nothing downstream checks again.
pub fn check_settings(settings: &TrackerSettings) -> Result<(), TrackerError> {
    let within = |name, value: f64, low: f64, high: f64, bound| {
        if value >= low && value <= high { Ok(()) } else { Err(TrackerError::Setting { name, value, bound }) }
    };
    within("template_px", settings.template_px.into(), 8.0, 128.0, "in [8, 128]")?;
    within("scv_bins", settings.scv_bins.into(), 2.0, 256.0, "in [2, 256]")?;
    within("blur_sigma_px", settings.blur_sigma_px, 0.0, 8.0, "in [0, 8]")?;
    within("weight_sigma_px", settings.weight_sigma_px, 0.0, 64.0, "in [0, 64]")?;
    if settings.weight_sigma_px > 0.0 {
        // Narrower than this a Gaussian leaves the sums to a handful of pixels.
        within("weight_sigma_px", settings.weight_sigma_px, 1.0, 64.0, "0, or at least 1")?;
    }
    within("velocity_memory", settings.velocity_memory, 0.0, 1.0, "in [0, 1]")?;
    within("pyramid_levels", settings.pyramid_levels.into(), 1.0, 3.0, "in [1, 3]")?;
    within("drift_tolerance_px", settings.drift_tolerance_px, 0.0, 50.0, "in [0, 50]")?;
    within("max_iterations", settings.max_iterations.into(), 1.0, 500.0, "in [1, 500]")?;
    within("epsilon_px", settings.epsilon_px, 1e-6, 1.0, "in [1e-6, 1]")?;
    within("loss_ncc_previous", settings.loss_ncc_previous, -1.0, 1.0, "in [-1, 1]")?;
    within("loss_ncc_anchor", settings.loss_ncc_anchor, -1.0, 1.0, "in [-1, 1]")?;
    if let Some(ratio) = settings.loss_brightness_ratio {
        within("loss_brightness_ratio", ratio, 0.01, 10.0, "in [0.01, 10]")?;
    }
    within("recovery_ncc", settings.recovery_ncc, -1.0, 1.0, "in [-1, 1]")?;
    within("confirmation_images", settings.confirmation_images.into(), 1.0, 100.0, "in [1, 100]")?;
    within("whole_image_after", settings.whole_image_after.into(), 0.0, 10_000.0, "in [0, 10000]")
}
