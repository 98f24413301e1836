//! Coarse to fine: the motion is registered at a quarter, then at half of the resolution, before the template itself is
//! registered at the full one.
//!
//! A level is the surroundings of the tip in the last tracked image, S×S pixels of 2×2 or 4×4 block means, registered as a
//! translation. It only moves the initial guess, so it has its own settings, the same for both profiles: squared
//! differences (conditional means pull in from less far), a weight of σ 3 coarse pixels (with a uniform one, still speckle
//! about a moving needle holds the guess back), and a blur of σ 2 coarse pixels (less pulls in from less far). What
//! that makes of large motions stands in `tests/pyramid.rs`. At 20×20 an image takes some 50 µs more with two levels and
//! 120 with three. A level that finds nothing leaves the guess as it is.
//!
//! Middles of coarse pixels: pixel k of scale s covers s·k … s·k + s − 1, so u lies at (u − (s − 1)/2)/s.

use sonoloop_simd::Instructions;
use sonoloop_types::{Image, Similarity, TrackerSettings, Warp};

use crate::gaussian::blur_taps;
use crate::region::Region;
use crate::register::Registrar;
use crate::template::Template;
use crate::warp::Placement;

/// σ of the blur in coarse pixels.
const BLUR_SIGMA: f64 = 2.0;
/// σ of the weight about the tip in coarse pixels.
const WEIGHT_SIGMA: f64 = 3.0;

/// The coarse levels of a tracker; none when it registers at full resolution only.
#[derive(Debug, Clone)]
pub(crate) struct Pyramid {
    /// The coarsest first.
    levels: Vec<Level>,
}

#[derive(Debug, Clone)]
struct Level {
    /// Picture pixels per coarse pixel.
    scale: usize,
    template: Template,
    /// False before the first image, and where too little of the surroundings lay inside the last one.
    known: bool,
    registrar: Registrar,
    region: Region,
    taps: Vec<f32>,
    /// Half-side of the region.
    reach: usize,
}

impl Pyramid {
    /// Levels that have seen nothing yet. `reach` is the half-side of their regions, in pixels of their own.
    pub fn new(instructions: Instructions, settings: &TrackerSettings, reach: usize) -> Self {
        let level = |halvings: u32| Level::new(instructions, settings, 1 << halvings, reach);
        Self { levels: (1..settings.pyramid_levels).rev().map(level).collect() }
    }

    /// A better guess of where the tip remembered last is in `image`.
    pub fn approach(&mut self, image: &Image, median: Option<f64>, guess_px: [f64; 2]) -> [f64; 2] {
        let finer = |guess_px, level: &mut Level| level.approach(image, median, guess_px).unwrap_or(guess_px);
        self.levels.iter_mut().fold(guess_px, finer)
    }

    /// Takes the surroundings of a tracked tip.
    pub fn remember(&mut self, image: &Image, median: Option<f64>, tip_px: [f64; 2]) {
        self.levels.iter_mut().for_each(|level| level.remember(image, median, tip_px));
    }
}

impl Level {
    fn new(instructions: Instructions, settings: &TrackerSettings, scale: usize, reach: usize) -> Self {
        let side = settings.template_px as usize;
        let settings = TrackerSettings { similarity: Similarity::Ssd, ..*settings };
        let mut level = Self {
            scale,
            template: Template::blank(side),
            known: false,
            registrar: Registrar::new(instructions, &settings, Warp::Translation, WEIGHT_SIGMA),
            region: Region::default(),
            taps: blur_taps(BLUR_SIGMA),
            reach,
        };
        // Its buffers never grow again.
        level.fill(&Image::black(scale as u32, scale as u32), [0.0; 2]);
        level
    }

    fn approach(&mut self, image: &Image, median: Option<f64>, guess_px: [f64; 2]) -> Option<[f64; 2]> {
        if !self.known {
            return None;
        }
        let start = self.coarse(guess_px);
        self.fill(image, start);
        let change = self.template.change_to(median);
        let found = self.registrar.run(&self.region, &self.template, change, Placement::at(start)).ok()?;
        let scale = self.scale as f64;
        Some(found.place.centre_px.map(|c| scale * c + (scale - 1.0) / 2.0))
    }

    fn remember(&mut self, image: &Image, median: Option<f64>, tip_px: [f64; 2]) {
        let at = self.coarse(tip_px);
        self.fill(image, at);
        self.known = self.registrar.sample(&self.region, &Placement::at(at)).is_ok();
        if self.known {
            self.template.refresh(&self.registrar.patch, median);
        }
    }

    fn fill(&mut self, image: &Image, centre: [f64; 2]) {
        let origin = centre.map(|c| libm::round(c).clamp(-1e9, 1e9) as i64 - self.reach as i64);
        self.region.fill(
            self.registrar.instructions,
            image,
            &self.taps,
            self.scale,
            origin,
            [2 * self.reach + 1; 2],
        );
    }

    fn coarse(&self, at_px: [f64; 2]) -> [f64; 2] {
        let scale = self.scale as f64;
        at_px.map(|c| (c - (scale - 1.0) / 2.0) / scale)
    }
}

#[cfg(test)]
mod tests {
    use sonoloop_types::Profile;

    use super::*;

    /// A blob of σ 6 px on a slow wave, both moved.
    fn blob([u0, v0]: [f64; 2]) -> Image {
        let level = |u: u32, v: u32| {
            let (x, y) = (f64::from(u) - u0, f64::from(v) - v0);
            let wave = libm::cos(0.05 * x) * libm::cos(0.07 * y + 0.4);
            (60.0 + 20.0 * wave + 150.0 * libm::exp(-(x * x + y * y) / 72.0)) as u8
        };
        Image::from_pixels(320, 240, (0..240).flat_map(|v| (0..320).map(move |u| level(u, v))).collect())
            .expect("as many pixels as the size says")
    }

    fn pyramid(pyramid_levels: u32) -> Pyramid {
        let settings = TrackerSettings { pyramid_levels, ..TrackerSettings::profile(Profile::Robust, 20) };
        Pyramid::new(Instructions::widest(), &settings, 29)
    }

    #[test]
    fn truth_every_level_finds_a_motion_in_pixels_of_the_picture() {
        for (levels, motion) in [(2, [6.0, -4.0]), (3, [13.0, -9.0])] {
            let mut pyramid = pyramid(levels);
            pyramid.remember(&blob([150.3, 120.8]), None, [150.3, 120.8]);
            let found = pyramid.approach(&blob([150.3 + motion[0], 120.8 + motion[1]]), None, [150.3, 120.8]);
            let off = [found[0] - 150.3 - motion[0], found[1] - 120.8 - motion[1]];
            // A twentieth of a pixel of the finest level registered here, which is half the resolution.
            assert!(off.iter().all(|c| c.abs() < 0.1), "{levels} levels: {off:?}");
        }
    }

    #[test]
    fn one_level_an_unknown_tip_and_a_flat_picture_leave_the_guess() {
        let image = blob([150.0, 120.0]);
        let guess = [141.5, 117.25];
        let mut one = pyramid(1);
        one.remember(&image, None, [150.0, 120.0]);
        assert_eq!(one.approach(&image, None, guess), guess);
        let mut unknown = pyramid(3);
        assert_eq!(unknown.approach(&image, None, guess), guess);
        unknown.remember(&Image::black(320, 240), None, guess);
        assert_eq!(unknown.approach(&Image::black(320, 240), None, guess), guess);
        // Under half of the surroundings inside the picture.
        unknown.remember(&image, None, [0.0, 0.0]);
        assert_eq!(unknown.approach(&image, None, guess), guess);
    }

    #[test]
    fn no_buffer_is_made_anew_whatever_the_picture_and_the_place() {
        let mut pyramid = pyramid(3);
        let buffers = |pyramid: &Pyramid| -> Vec<_> {
            pyramid.levels.iter().map(|level| (level.region.grey.as_ptr(), level.region.grey.len())).collect()
        };
        let before = buffers(&pyramid);
        for at in [[150.0, 120.0], [0.0, 239.0], [-500.0, 1e9], [f64::NAN, 7.0]] {
            for image in [blob([150.0, 120.0]), Image::black(8, 9), Image::black(1000, 20)] {
                pyramid.remember(&image, None, at);
                let guess = pyramid.approach(&image, None, at);
                assert!(guess.iter().all(|c| c.is_finite()) || at[0].is_nan());
                assert_eq!(buffers(&pyramid), before);
            }
        }
    }
}
