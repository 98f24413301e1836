use sonoloop_simd::Instructions;
use sonoloop_types::{
    Confirmation, Disc, Estimate, Image, Profile, Reason, TrackState, TrackerSettings, UpdateStrategy, Warp,
};

use crate::checkpoint::is_flat;
use crate::gaussian::blur_taps;
use crate::grey::lit_median;
use crate::guess::Guesser;
use crate::hysteresis::{Hysteresis, View};
use crate::likeness::Moments;
use crate::pyramid::Pyramid;
use crate::refine::Refinement;
use crate::region::Region;
use crate::register::{Failure, Registrar, Registration};
use crate::search::Search;
use crate::template::Template;
use crate::warp::{Placement, UPRIGHT};
use crate::{Checkpoint, SavedTemplate, TrackerError, check_settings};

/// A measured motion beyond this is not one of an ultrasound picture.
const MAX_MOTION_PX: f64 = 1e4;
/// What a registration that another one follows may leave, in pixels.
const ROUGH_PX: f64 = 0.1;
/// Least room about an end for what follows: a refinement that moves by 2 px, and rounding.
const AROUND_PX: usize = 3;
/// Half a diagonal, and some stretch, over half a side.
const MAX_STRETCH: f64 = 1.5;
/// How far a registration may wander at first, in pixels.
const SHORT_JUMP_PX: usize = 6;

/// What is known about an image beside its pixels.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Context<'a> {
    /// Motion (u, v) of the tip in the picture since the last image, predicted from the measured insertion and arm
    /// motion; a value that is not finite counts as `None`. It moves the initial guess where the settings say so
    /// ([`Guess::Insertion`](sonoloop_types::Guess::Insertion)), and the place of the search after a loss, never the
    /// measurement.
    pub motion_px: Option<[f64; 2]>,
    /// What an image that shows a good candidate for a lost tip is worth.
    pub confirmation: Confirmation,
    /// Direction (u, v) in which the needle points in the picture, unit length, some degrees off at most: a candidate
    /// beyond which the shaft goes on is not the tip. `None` when the needle does not lie in the picture.
    pub axis_px: Option<[f64; 2]>,
    /// How far the tip may have gone on along `axis_px` while it was lost, beyond the measured motion, pixels: a hand pushes on.
    pub unmeasured_px: f64,
    /// How far from where it is expected, or from that way, a lost tip is sought, pixels; `None`, or not finite:
    /// everywhere.
    pub reach_px: Option<f64>,
    /// Where a lost tip is not, whatever it looks like there.
    pub refused: &'a [Disc],
}

/// Follows one needle tip from image to image.
///
/// Owns its templates and scratch; after the first image no image of the same size allocates memory.
#[derive(Debug, Clone)]
pub struct Tracker {
    pub(crate) settings: TrackerSettings,
    /// T_1; never changes.
    pub(crate) anchor: Template,
    /// T_n.
    pub(crate) previous: Template,
    /// The last T_n that might have been taken for the lost tip itself. A tip that leaves the plane looks less and less like it
    /// did within it: as it looked last of all, nothing may look again.
    recalled: Template,
    pub(crate) belief: Belief,
    guesser: Guesser,
    pub(crate) pyramid: Pyramid,
    pub(crate) registrar: Registrar,
    pub(crate) search: Search,
    pub(crate) region: Region,
    /// The same surroundings unblurred, where the settings refine.
    sharp: Region,
    refinement: Option<Refinement>,
    pub(crate) taps: Vec<f32>,
    picture_px: [u32; 2],
    last: Estimate,
}

/// What changes from image to image, beside the templates.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Belief {
    pub state: Hysteresis,
    /// The last believed tip, carried along by measured motion while lost.
    pub tip_px: [f64; 2],
    /// Linear part of the template's warp, against T_1.
    pub linear: [[f64; 2]; 2],
    /// The place being confirmed, while RECOVERING.
    pub candidate_px: Option<[f64; 2]>,
    /// No image has been seen since the restart.
    pub restarted: bool,
}

impl Belief {
    fn at(state: Hysteresis, tip_px: [f64; 2]) -> Self {
        Self { state, tip_px, linear: UPRIGHT, candidate_px: None, restarted: false }
    }
}

impl Tracker {
    /// A tracker whose both templates are the (blurred) patch of `image` about `tip_px`; its state is TRACKING.
    ///
    /// `tip_px` is (u, v) in pixels from the centre of the top-left one. Refuses settings outside their bounds, a
    /// tip with under half of its template inside the image, and a tip without texture.
    pub fn new(settings: TrackerSettings, image: &Image, tip_px: [f64; 2]) -> Result<Self, TrackerError> {
        Self::with(Instructions::widest(), settings, image, tip_px)
    }

    /// The same with the instructions named.
    fn with(
        instructions: Instructions,
        settings: TrackerSettings,
        image: &Image,
        tip_px: [f64; 2],
    ) -> Result<Self, TrackerError> {
        check_settings(&settings)?;
        let (width_px, height_px) = (image.width_px, image.height_px);
        if !is_sound(image) {
            return Err(TrackerError::Image { width_px, height_px, pixels: image.pixels.len() });
        }
        let template_px = settings.template_px;
        if template_px > width_px || template_px > height_px {
            return Err(TrackerError::TemplateTooLarge { template_px, width_px, height_px });
        }
        let side = template_px as usize;
        let picture_px = [width_px, height_px];
        let mut tracker = Self::assemble(
            instructions,
            settings,
            [(); 2].map(|()| Template::blank(side)),
            picture_px,
            tip_px,
            TrackState::Tracking,
        );

        let within = |c: f64, size: u32| c >= -0.5 && c <= f64::from(size) - 0.5;
        if !(within(tip_px[0], width_px) && within(tip_px[1], height_px)) {
            return Err(TrackerError::TipOutside { tip_px });
        }
        let reach = tracker.tracking_reach();
        tracker.look(image, tip_px, reach);
        if tracker.registrar.sample(&tracker.region, &Placement::at(tip_px)).is_err() {
            return Err(TrackerError::TipOutside { tip_px });
        }
        let median = lit_median(tracker.registrar.instructions, image, None);
        tracker.anchor.refresh(&tracker.registrar.patch, median);
        tracker.previous.refresh(&tracker.registrar.patch, median);
        tracker.recalled.refresh(&tracker.registrar.patch, median);
        if is_flat(&tracker.anchor, &settings) {
            return Err(TrackerError::NoTexture { tip_px });
        }
        if let Some(refinement) = &mut tracker.refinement {
            refinement.begin(&tracker.sharp, tip_px, median);
        }
        tracker.search.look_for(&tracker.anchor);
        tracker.pyramid.remember(image, median, tip_px);
        let view = tracker.view_at(&Placement::at(tip_px), median).ok();
        tracker.last = Estimate { conditioning: None, ..tracker.estimate(Reason::Ok, tip_px, view, 0) };
        Ok(tracker)
    }

    /// Goes on from a checkpoint: LOST with [`Reason::Restarted`], searching about the last tip, and TRACKING only
    /// after a fresh confirmation. Refuses a checkpoint that does not fit `settings` or holds impossible values.
    pub fn restore(settings: TrackerSettings, checkpoint: &Checkpoint) -> Result<Self, TrackerError> {
        check_settings(&settings)?;
        let [anchor, previous, sharp] = checkpoint.templates(&settings)?;
        let templates = [anchor, previous];
        let (picture_px, tip_px) = (checkpoint.picture_px, checkpoint.tip_px);
        let instructions = Instructions::widest();
        let mut tracker =
            Self::assemble(instructions, settings, templates, picture_px, tip_px, TrackState::Lost);
        tracker.belief.state = Hysteresis::lost_for(checkpoint.lost_images);
        tracker.belief.restarted = true;
        if let Some(refinement) = &mut tracker.refinement {
            refinement.anchor = sharp;
        }
        Ok(tracker)
    }

    fn assemble(
        instructions: Instructions,
        settings: TrackerSettings,
        [anchor, previous]: [Template; 2],
        picture_px: [u32; 2],
        tip_px: [f64; 2],
        state: TrackState,
    ) -> Self {
        // A tip is found by where it is; how it has turned is left to the refinement, which sees more of it.
        let refines = Refinement::is_wanted(&settings);
        let warp = if refines { Warp::Translation } else { settings.warp };
        let (blur_sigma_px, weight_sigma_px) = (settings.blur_sigma_px, settings.weight_sigma_px);
        let mut tracker = Self {
            registrar: Registrar::new(instructions, &settings, warp, weight_sigma_px),
            search: Search::new(instructions, &anchor, blur_sigma_px, weight_sigma_px, picture_px),
            region: Region::default(),
            sharp: Region::default(),
            refinement: refines.then(|| Refinement::new(instructions, &settings)),
            taps: blur_taps(settings.blur_sigma_px),
            belief: Belief::at(Hysteresis::new(state), tip_px),
            guesser: Guesser::new(&settings, tip_px),
            pyramid: Pyramid::new(instructions, &settings, anchor.window.side / 2 + 3 + jump(&settings)),
            last: Estimate::bare(state, Reason::Restarted, Some(tip_px)),
            settings,
            anchor,
            recalled: previous.clone(),
            previous,
            picture_px,
        };
        // The largest region there will be, so that its buffers never grow again.
        let reach = tracker.tracking_reach();
        tracker.region.fill_about(instructions, &Image::black(1, 1), &tracker.taps, [0.0; 2], reach);
        tracker.look(&Image::black(1, 1), [0.0; 2], reach);
        tracker
    }

    /// Looks for the tip in the next image.
    ///
    /// An image whose pixels do not match its size, or that is smaller than the template, is a loss like any other.
    pub fn track(&mut self, image: &Image, context: &Context) -> Estimate {
        let sane = |motion: &[f64; 2]| motion.iter().all(|c| c.abs() <= MAX_MOTION_PX);
        let motion_px = context.motion_px.filter(sane);
        let context = &Context {
            axis_px: context.axis_px.filter(|a| a.iter().all(|c| c.abs() <= 1.0)),
            reach_px: context.reach_px.filter(|reach| reach.is_finite()),
            ..*context
        };
        let estimate = if !is_sound(image) || image.width_px.min(image.height_px) < self.settings.template_px
        {
            self.declare_lost(Reason::OutOfImage, motion_px, None, 0)
        } else {
            self.search.reserve([image.width_px, image.height_px]);
            let median = lit_median(self.registrar.instructions, image, self.previous.median);
            match self.belief.state.state() {
                TrackState::Tracking => self.follow(image, median, motion_px),
                _ => self.seek(image, median, motion_px, context),
            }
        };
        self.belief.restarted = false;
        self.last = estimate;
        estimate
    }

    /// TRACKING: register, correct the drift, test.
    fn follow(&mut self, image: &Image, median: Option<f64>, motion_px: Option<[f64; 2]>) -> Estimate {
        let expected_px = self.guesser.place_px(self.belief.tip_px, motion_px);
        let guess_px = self.pyramid.approach(image, median, expected_px);
        let changes = [&self.anchor, &self.previous].map(|template| self.change(template, median));
        let mut found = match self.find(image, guess_px, changes) {
            Ok(found) => found,
            Err(failure) => return self.declare_lost(failure.reason, motion_px, None, failure.iterations),
        };
        let update = match self.settings.update {
            UpdateStrategy::None => {
                self.sharpen(median, &mut found);
                false
            }
            UpdateStrategy::Naive => true,
            UpdateStrategy::DriftCorrected => self.correct_drift(median, changes, &mut found),
        };

        let (at, iterations) = (found.place.centre_px, found.iterations);
        let view = match self.view_at(&found.place, median) {
            Ok(view) => view,
            Err(reason) => return self.declare_lost(reason, motion_px, None, iterations),
        };
        if let Some(reason) = self.belief.state.loss(&self.settings, &view) {
            let estimate = self.declare_lost(reason, motion_px, Some(view), iterations);
            return Estimate { conditioning: Some(found.conditioning), ..estimate };
        }
        self.guesser.moved(self.belief.tip_px, at);
        self.belief.tip_px = at;
        self.belief.linear = found.place.linear;
        self.belief.state.tracked();
        if update {
            self.previous.refresh(&self.registrar.patch, median);
            if Hysteresis::accepts(&self.settings, &view) {
                self.recalled.refresh(&self.registrar.patch, median);
            }
        }
        self.pyramid.remember(image, median, at);
        let estimate = self.estimate(Reason::Ok, at, Some(view), iterations);
        Estimate { conditioning: Some(found.conditioning), ..estimate }
    }

    /// Registers the template of the last image, or the first one where templates are not updated.
    ///
    /// Most motions are short, and a small region is soon read; only who leaves it needs the large one.
    fn find(
        &mut self,
        image: &Image,
        guess_px: [f64; 2],
        changes: [f32; 2],
    ) -> Result<Registration, Failure> {
        if self.refinement.is_some() && self.settings.update == UpdateStrategy::DriftCorrected {
            self.registrar.epsilon_px = self.settings.epsilon_px.max(ROUGH_PX);
        }
        let far = jump(&self.settings);
        let mut search = |jump: usize| {
            self.look(image, guess_px, self.reach(jump));
            if self.settings.update == UpdateStrategy::None {
                let guess = Placement { centre_px: guess_px, linear: self.belief.linear };
                self.registrar.run(&self.region, &self.anchor, changes[0], guess)
            } else {
                let guess = Placement { centre_px: guess_px, linear: self.previous_linear() };
                self.registrar.run(&self.region, &self.previous, changes[1], guess)
            }
        };
        let found = search(SHORT_JUMP_PX).or_else(|_| search(far));
        self.registrar.epsilon_px = self.settings.epsilon_px;
        let mut found = found?;
        // What comes next looks around, as far as the drift that it may correct.
        let around = (libm::ceil(self.settings.drift_tolerance_px) as usize).clamp(AROUND_PX, far);
        if distance(found.place.centre_px, guess_px) > SHORT_JUMP_PX.saturating_sub(around) as f64 {
            self.look(image, found.place.centre_px, self.reach(around));
        }
        if self.refinement.is_some() {
            // The warp of T_1 is the refinement's last.
            found.place.linear = self.belief.linear;
        }
        Ok(found)
    }

    /// Puts the refinement's result in the place of what was found, where it has one.
    fn sharpen(&mut self, median: Option<f64>, found: &mut Registration) -> bool {
        let Some(refinement) = &mut self.refinement else { return false };
        let (refined, iterations) = refinement.refine(&self.sharp, median, &found.place);
        let iterations = found.iterations + iterations;
        if let Some(refined) = refined {
            *found = refined;
        }
        found.iterations = iterations;
        refined.is_some()
    }

    /// Registers T_1 from where T_n was found, and tells whether the new patch becomes T_n: only if T_1 agrees about where it is
    /// (Matthews, Ishikawa and Baker, 2004). A refinement is such a registration.
    fn correct_drift(&mut self, median: Option<f64>, changes: [f32; 2], found: &mut Registration) -> bool {
        let previous = *found;
        let corrected = self.sharpen(median, found)
            || match self.registrar.run(&self.region, &self.anchor, changes[0], previous.place) {
                Ok(corrected) => {
                    *found =
                        Registration { iterations: found.iterations + corrected.iterations, ..corrected };
                    true
                }
                Err(failure) => {
                    found.iterations += failure.iterations;
                    false
                }
            };
        // Where a refinement knows the warp of T_1, that of T_n is a translation.
        let drift_px = if self.refinement.is_some() {
            distance(previous.place.centre_px, found.place.centre_px)
        } else {
            previous.place.corner_distance(&found.place, self.anchor.window.half_px())
        };
        if corrected && drift_px <= self.settings.drift_tolerance_px {
            return true;
        }
        *found = Registration { iterations: found.iterations, ..previous };
        if self.refinement.is_some() {
            // T_n's place is the measurement then, and so far it is a rough one.
            let start = Placement { linear: self.previous_linear(), ..found.place };
            if let Ok(finer) = self.registrar.run(&self.region, &self.previous, changes[1], start) {
                found.iterations += finer.iterations;
                found.place.centre_px = finer.place.centre_px;
            }
        }
        false
    }

    /// Reads the surroundings of a point.
    fn look(&mut self, image: &Image, centre_px: [f64; 2], reach: usize) {
        let (instructions, taps) = (self.registrar.instructions, &self.taps);
        if self.refinement.is_some() {
            let sharp_reach = Region::sharp_reach(reach, taps).max(Refinement::reach(&self.settings));
            self.sharp.fill_about(instructions, image, &[1.0], centre_px, sharp_reach);
            self.region.blur(instructions, &self.sharp, taps, centre_px, reach);
        } else {
            self.region.fill_about(instructions, image, taps, centre_px, reach);
        }
    }

    /// Linear part of T_n's warp: between two images nothing turns far, and where a refinement knows how T_1 has turned, T_n
    /// is taken upright.
    fn previous_linear(&self) -> [[f64; 2]; 2] {
        if self.refinement.is_some() { UPRIGHT } else { self.belief.linear }
    }

    /// Freezes templates and tip; the tip only follows what was measured to have moved.
    pub(crate) fn declare_lost(
        &mut self,
        reason: Reason,
        motion_px: Option<[f64; 2]>,
        view: Option<View>,
        iterations: u32,
    ) -> Estimate {
        self.belief.tip_px = add(self.belief.tip_px, motion_px.unwrap_or_default());
        if self.belief.state.state() == TrackState::Tracking {
            self.previous.refresh(&self.recalled.padded, self.recalled.median);
        }
        self.belief.state.lost();
        self.belief.candidate_px = None;
        self.belief.linear = UPRIGHT;
        if let Some(refinement) = &mut self.refinement {
            refinement.pause();
        }
        let reason = if self.belief.restarted { Reason::Restarted } else { reason };
        self.estimate(reason, self.belief.tip_px, view, iterations)
    }

    /// Believes a confirmed candidate; the registrar's patch is the one about it.
    pub(crate) fn resume(&mut self, tip_px: [f64; 2], median: Option<f64>) {
        self.belief = Belief::at(Hysteresis::recovered(), tip_px);
        self.guesser.rest(tip_px);
        if self.settings.update != UpdateStrategy::None {
            self.previous.refresh(&self.registrar.patch, median);
            self.recalled.refresh(&self.registrar.patch, median);
        }
    }

    pub(crate) fn estimate(
        &self,
        reason: Reason,
        tip_px: [f64; 2],
        view: Option<View>,
        iterations: u32,
    ) -> Estimate {
        Estimate {
            ncc_previous: view.and_then(|view| view.ncc_previous),
            ncc_anchor: view.and_then(|view| view.ncc_anchor),
            brightness_ratio: view.and_then(|view| view.brightness_ratio),
            tip_level: view.map(|view| view.level.clamp(0.0, 255.0)),
            iterations,
            ..Estimate::bare(self.belief.state.state(), reason, Some(tip_px))
        }
    }

    /// Compares the image at a placement with T_1, and at the same place with T_n, whose patch the registrar then holds.
    pub(crate) fn view_at(&mut self, place: &Placement, median: Option<f64>) -> Result<View, Reason> {
        self.registrar.sample(&self.region, place)?;
        let level = self.registrar.peak_level();
        let anchor = self.moments(&self.anchor.padded);
        let linear = self.previous_linear();
        if linear != place.linear {
            self.registrar.sample(&self.region, &Placement { linear, ..*place })?;
        }
        let previous = self.moments(&self.previous.padded);
        let change = f64::from(self.anchor.change_to(median));
        let ground = |m: &Moments| self.anchor.median.unwrap_or(m.mean_b);
        Ok(View {
            ncc_previous: previous.and_then(|m| m.ncc()),
            ncc_anchor: anchor.and_then(|m| m.ncc()),
            brightness_ratio: anchor.and_then(|m| m.brightness_ratio(change, ground(&m))),
            presence: anchor.and_then(|m| m.presence()),
            level,
        })
    }

    /// The registrar's patch beside a template.
    pub(crate) fn moments(&self, template: &[f32]) -> Option<Moments> {
        let Registrar { instructions, window, weights, patch, .. } = &self.registrar;
        Moments::of(*instructions, *window, weights.part, weights.values(), patch, template)
    }

    /// Δ for the optimiser. The paper's SSD knows no such offset.
    pub(crate) fn change(&self, template: &Template, median: Option<f64>) -> f32 {
        match self.settings.profile {
            Profile::Paper => 0.0,
            Profile::Robust => template.change_to(median),
        }
    }

    /// Half-side of a region in which a registration may wander by `jump`, with the template turned and stretched as it is.
    fn reach(&self, jump: usize) -> usize {
        let farther = self.belief.linear.iter().map(|[x, y]| x.abs() + y.abs()).fold(1.0, f64::max);
        let part = self.registrar.weights.part.reach() as f64;
        libm::ceil(part * farther.min(MAX_STRETCH)) as usize + jump
    }

    /// That of the largest region there will be.
    fn tracking_reach(&self) -> usize {
        let farther = if self.settings.warp == Warp::Translation { 1.0 } else { MAX_STRETCH };
        libm::ceil(self.registrar.weights.part.reach() as f64 * farther) as usize + jump(&self.settings)
    }

    /// What a restarted tracker needs to go on.
    pub fn checkpoint(&self) -> Checkpoint {
        Checkpoint {
            template_px: self.settings.template_px,
            picture_px: self.picture_px,
            anchor: SavedTemplate::from(&self.anchor),
            previous: SavedTemplate::from(&self.recalled),
            sharp: self.refinement.as_ref().map(|refinement| SavedTemplate::from(&refinement.anchor)),
            tip_px: self.belief.tip_px,
            lost_images: self.belief.state.lost_images(),
        }
    }

    /// State after the last image.
    pub fn state(&self) -> TrackState {
        self.belief.state.state()
    }

    /// Tip (u, v) in pixels: the estimate, or the last believed one while LOST or RECOVERING.
    pub fn tip_px(&self) -> [f64; 2] {
        self.belief.tip_px
    }

    /// The linear part of the template's warp, row by row: the template's (x, y), centred on the tip, lies at the tip plus
    /// (uu·x + uv·y, vu·x + vv·y) in the picture. Against T_1; the identity for a translation, and while LOST.
    pub fn linear(&self) -> [[f64; 2]; 2] {
        self.belief.linear
    }

    /// Side S of the square template in pixels.
    pub fn template_px(&self) -> u32 {
        self.settings.template_px
    }

    /// The settings the tracker runs with.
    pub fn settings(&self) -> &TrackerSettings {
        &self.settings
    }

    /// The last answer; for a new tracker that of the image it was made from.
    pub fn last_estimate(&self) -> Estimate {
        self.last
    }
}

/// How far a registration may wander from the guess, in pixels.
fn jump(settings: &TrackerSettings) -> usize {
    (settings.template_px as usize / 2).max(16)
}

/// Whether the pixels match the size, and there are any.
pub(crate) fn is_sound(image: &Image) -> bool {
    let expected = (image.width_px as usize).checked_mul(image.height_px as usize);
    expected == Some(image.pixels.len()) && !image.pixels.is_empty()
}

pub(crate) fn add(a: [f64; 2], b: [f64; 2]) -> [f64; 2] {
    [a[0] + b[0], a[1] + b[1]]
}

pub(crate) fn distance(a: [f64; 2], b: [f64; 2]) -> f64 {
    let d = [a[0] - b[0], a[1] - b[1]];
    (d[0] * d[0] + d[1] * d[1]).sqrt()
}

#[cfg(test)]
mod tests;
