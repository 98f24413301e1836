//! Any bytes as settings, pictures, contexts and a spoilt checkpoint: every answer is finite and in its range, and none takes
//! for ever. See CONTRIBUTING.md for the command.

#![no_main]

#[path = "../../tests/support/answer.rs"]
mod answer;

use answer::check_answer;
use arbitrary::{Arbitrary, Unstructured};
use libfuzzer_sys::fuzz_target;
use sonoloop_tracker::{Checkpoint, Context, Tracker};
use sonoloop_types::{
    Confirmation, Disc, Guess, Image, Optimisation, Profile, Similarity, TrackState, TrackerSettings,
    UpdateStrategy, Warp,
};

/// Settings in whole steps over a little more than their ranges; `None` keeps the profile's value.
#[derive(Debug, Arbitrary)]
struct Settings {
    kinds: [u8; 8],
    template_px: u8,
    scv_bins: Option<u16>,
    blur_eighths: Option<u8>,
    weight_eighths: Option<u8>,
    velocity_percent: Option<u8>,
    drift_tenths: Option<u8>,
    max_iterations: Option<u8>,
    epsilon_px: Option<f64>,
    ncc_percent: [Option<i8>; 3],
    brightness_ratio: Option<Option<f32>>,
    confirmation_images: Option<u8>,
    whole_image_after: Option<u8>,
}

impl Settings {
    fn settings(&self) -> TrackerSettings {
        let pick = |k: usize, count: usize| usize::from(self.kinds[k]) % count;
        let profile = [Profile::Robust, Profile::Paper][pick(0, 2)];
        // Mostly small: pictures are.
        let template_px = 7 + u32::from(self.template_px) % 36;
        let basis = TrackerSettings::profile(profile, template_px);
        let ncc = |k: usize, usual: f64| self.ncc_percent[k].map_or(usual, |p| f64::from(p) / 100.0);
        TrackerSettings {
            similarity: [Similarity::Scv, Similarity::Ssd][pick(1, 2)],
            optimisation: [Optimisation::SecondOrder, Optimisation::FirstOrder][pick(2, 2)],
            warp: [Warp::Translation, Warp::Rigid, Warp::Affine][pick(3, 3)],
            update: [UpdateStrategy::DriftCorrected, UpdateStrategy::Naive, UpdateStrategy::None][pick(4, 3)],
            scv_bins: self.scv_bins.map_or(basis.scv_bins, |bins| u32::from(bins) % 260),
            blur_sigma_px: self.blur_eighths.map_or(basis.blur_sigma_px, |e| f64::from(e) / 8.0),
            weight_sigma_px: self.weight_eighths.map_or(basis.weight_sigma_px, |e| f64::from(e) / 8.0),
            velocity_memory: self.velocity_percent.map_or(basis.velocity_memory, |p| f64::from(p) / 100.0),
            drift_tolerance_px: self.drift_tenths.map_or(basis.drift_tolerance_px, |t| f64::from(t) / 10.0),
            max_iterations: self.max_iterations.map_or(basis.max_iterations, u32::from),
            epsilon_px: self.epsilon_px.unwrap_or(basis.epsilon_px),
            loss_ncc_previous: ncc(0, basis.loss_ncc_previous),
            loss_ncc_anchor: ncc(1, basis.loss_ncc_anchor),
            recovery_ncc: ncc(2, basis.recovery_ncc),
            loss_brightness_ratio: self
                .brightness_ratio
                .map_or(basis.loss_brightness_ratio, |r| r.map(f64::from)),
            confirmation_images: self.confirmation_images.map_or(basis.confirmation_images, u32::from),
            whole_image_after: self.whole_image_after.map_or(basis.whole_image_after, u32::from),
            guess: [Guess::Insertion, Guess::None, Guess::ConstantVelocity, Guess::Kalman][pick(5, 4)],
            pyramid_levels: 1 + pick(6, 4) as u32,
            refine: pick(7, 2) == 0,
            ..basis
        }
    }
}

/// A picture of few bytes: noise from a seed, with a patch of it moved, dimmed or cut off.
#[derive(Debug, Arbitrary)]
struct Picture {
    size: Option<[u8; 2]>,
    seed: u8,
    shift: [i8; 2],
    /// Levels are multiplied by this over 64 and moved by the next.
    gain: u8,
    offset: i8,
    /// Neighbouring pixels alike in squares of this side.
    grain: u8,
    /// Pixels more or fewer than the size says.
    surplus: Option<i8>,
}

impl Picture {
    fn image(&self, usual: [u8; 2]) -> Image {
        let [width_px, height_px] = self.size.unwrap_or(usual).map(u32::from);
        let grain = i64::from(self.grain % 8) + 1;
        let level = |u: u32, v: u32| {
            let [x, y] = [(u, 0), (v, 1)]
                .map(|(c, axis)| (i64::from(c) - i64::from(self.shift[axis])).div_euclid(grain));
            let mut hash = (x as u64).wrapping_mul(0x9E37_79B9_7F4A_7C15)
                ^ (y as u64).wrapping_mul(0xC2B2_AE3D_27D4_EB4F);
            hash = (hash ^ (hash >> 29) ^ u64::from(self.seed)).wrapping_mul(0x1656_67B1_9E37_79F9);
            let level = i32::from((hash >> 40) as u8) * i32::from(self.gain) / 64 + i32::from(self.offset);
            level.clamp(0, 255) as u8
        };
        let mut pixels: Vec<u8> =
            (0..height_px).flat_map(|v| (0..width_px).map(move |u| level(u, v))).collect();
        if let Some(surplus) = self.surplus {
            pixels.resize(pixels.len().saturating_add_signed(surplus.into()), 7);
        }
        Image { width_px, height_px, pixels }
    }
}

#[derive(Debug, Arbitrary)]
struct Told {
    motion_px: Option<[f32; 2]>,
    held: bool,
    axis_px: Option<[f32; 2]>,
    unmeasured_px: f32,
    reach_px: Option<f32>,
    refused: [f32; 3],
}

impl Told {
    fn refused(&self) -> Disc {
        let [u, v, radius] = self.refused.map(f64::from);
        Disc { centre_px: [u, v], radius_px: radius }
    }

    fn context<'a>(&self, refused: &'a [Disc]) -> Context<'a> {
        let wide = |pair: [f32; 2]| pair.map(f64::from);
        Context {
            motion_px: self.motion_px.map(wide),
            confirmation: if self.held { Confirmation::Held } else { Confirmation::Confirms },
            axis_px: self.axis_px.map(wide),
            unmeasured_px: self.unmeasured_px.into(),
            reach_px: self.reach_px.map(f64::from),
            refused,
        }
    }
}

#[derive(Debug, Arbitrary)]
enum Event {
    See(Picture, Told),
    /// The first picture again.
    SeeFirst(Told),
    /// A restart from the tracker's checkpoint, spoilt: which value, where, and what it becomes.
    Restart(Option<(u8, u16, f32)>),
}

fn spoil(saved: &mut Checkpoint, (which, at, value): (u8, u16, f32)) {
    let grey = usize::from(at) % saved.anchor.padded.len();
    match which % 8 {
        0 => saved.tip_px[usize::from(at) % 2] = value.into(),
        1 => saved.picture_px[usize::from(at) % 2] = at.into(),
        2 => saved.lost_images = at.into(),
        3 => saved.anchor.padded[grey] = value,
        4 => saved.previous.padded[grey] = value,
        5 => saved.anchor.median = Some(value.into()),
        6 => saved.previous.median = None,
        _ => _ = saved.previous.padded.pop(),
    }
}

fuzz_target!(|data: &[u8]| {
    let mut bytes = Unstructured::new(data);
    let Ok((settings, size, first, tip)) = bytes.arbitrary::<(Settings, [u8; 2], Picture, [f32; 2])>() else {
        return;
    };
    let settings = settings.settings();
    let first = first.image(size);
    // A tip of whole bytes lies inside; any other float may lie anywhere.
    let Ok(mut tracker) = Tracker::new(settings, &first, tip.map(f64::from)).or_else(|_| {
        let middle = [first.width_px, first.height_px].map(|n| f64::from(n) / 2.0);
        Tracker::new(settings, &first, middle)
    }) else {
        return;
    };
    check_answer(&settings, &first, &tracker.last_estimate());
    for _ in 0..24 {
        let Ok(event) = bytes.arbitrary::<Event>() else { return };
        let (image, told) = match &event {
            Event::See(picture, told) => (&picture.image(size), told),
            Event::SeeFirst(told) => (&first, told),
            Event::Restart(spoilt) => {
                let mut saved = tracker.checkpoint();
                if let Some(spoilt) = spoilt {
                    spoil(&mut saved, *spoilt);
                }
                if let Ok(restored) = Tracker::restore(settings, &saved) {
                    assert!(restored.state() == TrackState::Lost);
                    tracker = restored;
                }
                continue;
            }
        };
        let estimate = tracker.track(image, &told.context(&[told.refused()]));
        check_answer(&settings, image, &estimate);
        if bytes.is_empty() {
            return;
        }
    }
});
