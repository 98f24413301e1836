use serde::{Deserialize, Serialize};
use sonoloop_simd::Instructions;
use sonoloop_types::TrackerSettings;

use crate::TrackerError;
use crate::gaussian::Weights;
use crate::likeness::Moments;
use crate::refine::Refinement;
use crate::template::Template;

/// Larger pictures are taken for garbage, before memory is set aside for a search of them: a side, and all pixels.
const MAX_PICTURE_PX: u32 = 16_384;
const MAX_PIXELS: u64 = 1 << 24;

/// A template as plain data.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct SavedTemplate {
    /// (S + 2)² grey levels, row by row: the window and one more pixel all around.
    pub padded: Vec<f32>,
    /// Median grey level of the lit part of the image it was taken from; `None` when that was dark.
    pub median: Option<f64>,
}

/// All that a restarted tracker needs. It is untrusted: [`Tracker::restore`](crate::Tracker::restore) checks it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Checkpoint {
    /// Side S of the templates.
    pub template_px: u32,
    /// Columns and rows of the images.
    pub picture_px: [u32; 2],
    /// T_1.
    pub anchor: SavedTemplate,
    /// The last T_n that might have been taken for the lost tip.
    pub previous: SavedTemplate,
    /// T_1 unblurred, where the settings refine.
    pub sharp: Option<SavedTemplate>,
    /// The last believed tip (u, v).
    pub tip_px: [f64; 2],
    /// Images in a row without TRACKING; widens the search.
    pub lost_images: u32,
}

impl Checkpoint {
    /// Checks everything against `settings` and gives T_1, T_n and the unblurred T_1.
    pub(crate) fn templates(&self, settings: &TrackerSettings) -> Result<[Template; 3], TrackerError> {
        let bad = |what| Err(TrackerError::Checkpoint(what));
        if self.template_px != settings.template_px {
            return bad("its templates are of another size than the settings'");
        }
        let pixels = self.picture_px.iter().map(|n| u64::from(*n)).product::<u64>();
        if self.picture_px.iter().any(|n| !(1..=MAX_PICTURE_PX).contains(n)) || pixels > MAX_PIXELS {
            return bad("impossible size of the images");
        }
        if !self.tip_px.iter().all(|c| c.abs() <= f64::from(MAX_PICTURE_PX)) {
            return bad("impossible tip");
        }
        let side = self.template_px as usize;
        if self.sharp.is_some() != Refinement::is_wanted(settings) {
            return bad("an unblurred template is there without need, or missing");
        }
        for saved in [&self.anchor, &self.previous].into_iter().chain(&self.sharp) {
            if saved.padded.len() != (side + 2) * (side + 2) {
                return bad("a template has the wrong number of pixels");
            }
            // Blurring may round a hair beyond the range of eight bits.
            if !saved.padded.iter().all(|grey| (-0.5..=255.5).contains(grey)) {
                return bad("a template has an impossible grey level");
            }
            if saved.median.is_some_and(|median| !(0.0..=255.5).contains(&median)) {
                return bad("impossible median of an image");
            }
        }
        let template = |saved: &SavedTemplate| Template::from_pixels(side, &saved.padded, saved.median);
        let [anchor, previous] = [template(&self.anchor), template(&self.previous)];
        if is_flat(&anchor, settings) {
            return bad("the first template has no texture");
        }
        let sharp = self.sharp.as_ref().map_or_else(|| Template::blank(side), template);
        Ok([anchor, previous, sharp])
    }
}

impl From<&Template> for SavedTemplate {
    fn from(template: &Template) -> Self {
        Self { padded: template.window.pixels(&template.padded).collect(), median: template.median }
    }
}

/// Whether there is nothing in the template to look for.
pub(crate) fn is_flat(template: &Template, settings: &TrackerSettings) -> bool {
    let weights = Weights::new(template.window.side, settings.weight_sigma_px);
    let (padded, part) = (&template.padded, weights.part);
    Moments::of(Instructions::PLAIN, weights.window, part, weights.values(), padded, padded)
        .is_none_or(|m| m.b_is_flat())
}
