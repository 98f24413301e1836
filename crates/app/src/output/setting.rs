use serde::{Deserialize, Serialize};
use sonoloop_scenario::Scenario;
use sonoloop_types::{TICKS_PER_SECOND, View};

use super::overlay::aperture_columns_px;

/// What a run was set to, as far as its tables and pictures are read against it; a part of `summary.json`, so that a
/// report needs no file outside the run's folder.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Setting {
    /// What the scenario says of itself.
    pub description: String,
    /// How the needle lies to the plane.
    pub view: View,
    /// Simulated time between images.
    pub image_period_ms: f64,
    /// Width and height of an image.
    pub image_px: [u32; 2],
    /// Side of a pixel.
    pub spacing_mm: f64,
    /// First column that the aperture reaches, and the first beyond it.
    pub columns_px: [u32; 2],
    /// Side of the tracker's template.
    pub template_px: u32,
    /// NCC with the previous template below which the tip counts as lost.
    pub loss_ncc_previous: f64,
    /// NCC with the first template below which the tip counts as lost.
    pub loss_ncc_anchor: f64,
    /// Brightness ratio from which on the tip counts as lost; none where it does not count.
    pub loss_brightness_ratio: Option<f64>,
    /// Limit of the contact force.
    pub max_contact_force_n: f64,
    /// Depth of the target along the needle.
    pub target_depth_mm: f64,
}

impl Setting {
    /// That of a scenario.
    pub fn of(scenario: &Scenario) -> Self {
        let (geometry, tracker) = (scenario.probe.geometry, &scenario.tracker);
        Self {
            description: scenario.description.clone(),
            view: scenario.view,
            image_period_ms: scenario.image_period_ticks as f64 * 1e3 / TICKS_PER_SECOND as f64,
            image_px: [geometry.width_px, geometry.height_px],
            spacing_mm: geometry.spacing_m * 1e3,
            columns_px: aperture_columns_px(&scenario.probe),
            template_px: tracker.template_px,
            loss_ncc_previous: tracker.loss_ncc_previous,
            loss_ncc_anchor: tracker.loss_ncc_anchor,
            loss_brightness_ratio: tracker.loss_brightness_ratio,
            max_contact_force_n: scenario.limits.max_contact_force_n,
            target_depth_mm: scenario.insertion.target_depth_m * 1e3,
        }
    }
}
