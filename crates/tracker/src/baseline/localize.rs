use sonoloop_types::Image;

use super::gabor::Gabor;
use super::half::Half;
use super::line;
use super::packing::{Point, pack};
use super::profile::Profile;
use super::threshold::threshold;
use super::tip::TipFinder;
use crate::tracker::is_sound;

/// Smaller pictures hold no needle: the filters alone are 34 px wide.
const LEAST_PICTURE_PX: u32 = 48;

/// From where the needle comes into the picture.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Entry {
    /// From the shallower end of its line (smaller v), so the deeper end is the tip; a level line from the left.
    /// This is how a needle goes in beside a probe.
    #[default]
    Shallower,
    /// From the left (smaller u); an upright line from above.
    Left,
    /// From the right (larger u); an upright line from above.
    Right,
}

impl Entry {
    /// The direction of insertion along a line, of unit length.
    fn axis_px(self, along: [f64; 2]) -> [f64; 2] {
        let [u, v] = along;
        let backwards = match self {
            Self::Shallower => v < 0.0 || (v == 0.0 && u < 0.0),
            Self::Left => u < 0.0 || (u == 0.0 && v < 0.0),
            Self::Right => u > 0.0 || (u == 0.0 && v < 0.0),
        };
        if backwards { [-u, -v] } else { along }
    }
}

/// What is known of the needle before the picture is looked at.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Insertion {
    /// Where it comes in.
    pub entry: Entry,
    /// Least and largest angle of its line from the u axis towards v, within −π/2 … π/2. No line is found where the
    /// interval is empty or not a number.
    pub angle_rad: [f64; 2],
}

impl Default for Insertion {
    /// Any angle, from the shallower end.
    fn default() -> Self {
        let right_angle = std::f64::consts::FRAC_PI_2;
        Self { entry: Entry::Shallower, angle_rad: [-right_angle, right_angle] }
    }
}

/// A needle found in one picture.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Localized {
    /// Its tip (u, v) in pixels from the centre of the top-left one. It lies on the picture's border when the needle
    /// goes right across, and some 2 to 3 px too deep where its echo glows under log compression.
    pub tip_px: [f64; 2],
    /// Its direction towards the tip, of unit length.
    pub axis_px: [f64; 2],
    /// 0 … 1: how much of its stretch the filter saw, times the probability that it ends within 4 px of the tip.
    pub confidence: f64,
    /// Packed points that agree on the line.
    pub inliers: usize,
    /// Their rms distance from the line, weighted by the filter's response.
    pub residual_px: f64,
}

/// Finds the needle in single pictures. Owns its scratch: buffers grow to what the largest picture needed, and
/// are kept.
#[derive(Debug, Clone)]
pub struct Localizer {
    insertion: Insertion,
    half: Half,
    gabor: Gabor,
    strongest: Vec<(f32, [usize; 2], u8)>,
    points: Vec<Point>,
    profile: Profile,
    tip: TipFinder,
}

impl Localizer {
    /// A localizer for needles that come in as `insertion` says.
    pub fn new(insertion: Insertion) -> Self {
        Self {
            insertion,
            half: Half::default(),
            gabor: Gabor::new(),
            strongest: Vec::new(),
            points: Vec::new(),
            profile: Profile::default(),
            tip: TipFinder::default(),
        }
    }

    /// The needle in `image`, or whatever looks most like one; `None` when nothing does, when the picture is under
    /// 48 px wide or high, or when its pixels do not match its size.
    pub fn localize(&mut self, image: &Image) -> Option<Localized> {
        if !is_sound(image) || image.width_px.min(image.height_px) < LEAST_PICTURE_PX {
            return None;
        }
        self.half.fill(image);
        self.gabor.run(&self.half);
        let limit = threshold(self.gabor.rows().flat_map(|(responses, _)| responses))?;
        pack(self.gabor.rows(), limit, &mut self.strongest, &mut self.points);
        let fit = line::fit(&self.points, self.insertion.angle_rad)?;
        let axis_px = self.insertion.entry.axis_px(fit.line.along);
        if !self.profile.fill(image, &fit.line, axis_px) {
            return None;
        }
        let tip = self.tip.find(&self.profile, &fit, &self.points)?;
        Some(Localized {
            tip_px: tip.tip_px,
            axis_px,
            confidence: tip.confidence,
            inliers: fit.inliers,
            residual_px: fit.residual_px,
        })
    }
}

/// The needle in a single picture; see [`Localizer`], which is for many.
pub fn localize(image: &Image, insertion: Insertion) -> Option<Localized> {
    Localizer::new(insertion).localize(image)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn truth_the_entry_decides_the_direction() {
        assert_eq!(Entry::Shallower.axis_px([0.6, -0.8]), [-0.6, 0.8]);
        assert_eq!(Entry::Left.axis_px([-0.6, 0.8]), [0.6, -0.8]);
        assert_eq!(Entry::Right.axis_px([0.6, 0.8]), [-0.6, -0.8]);
        assert_eq!(Entry::Shallower.axis_px([-1.0, 0.0]), [1.0, -0.0]);
        assert_eq!(Entry::Left.axis_px([0.0, -1.0]), [-0.0, 1.0]);
    }
}
