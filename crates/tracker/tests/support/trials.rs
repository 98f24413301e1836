use sonoloop_tracker::{Context, Tracker};
use sonoloop_types::{Image, TrackState, TrackerSettings};

use super::{NeedleScene, distance};

/// Within this of the truth a tip is tracked.
const TRACKED_PX: f64 = 2.0;
/// TRACKING farther off than this is a loss that nobody was told of.
const SILENT_PX: f64 = 5.0;

/// What became of one sequence. The first that applies, in this order: silent, lost, slipping, tracked.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Outcome {
    /// TRACKING within 2 px in every image.
    Tracked,
    /// At least one image was not TRACKING, and none was silently lost.
    Lost,
    /// TRACKING 2 to 5 px off at worst.
    Slipping,
    /// TRACKING more than 5 px off in at least one image.
    Silent,
}

/// A tracker on its way through a sequence.
struct Trial {
    tracker: Tracker,
    worst_px: f64,
    lost: bool,
}

impl Trial {
    fn new(settings: TrackerSettings, first: &Image, click_px: [f64; 2]) -> Self {
        let tracker = Tracker::new(settings, first, click_px).expect("a sound first image");
        Self { tracker, worst_px: 0.0, lost: false }
    }

    /// The tracker is told nothing but the image; `truth_px` is where what was clicked is now.
    fn see(&mut self, image: &Image, truth_px: [f64; 2]) {
        if self.outcome() == Outcome::Silent {
            return;
        }
        let estimate = self.tracker.track(image, &Context::default());
        if estimate.state == TrackState::Tracking {
            let off_px = distance(estimate.tip_px.expect("a tip"), truth_px);
            self.worst_px = self.worst_px.max(off_px);
        } else {
            self.lost = true;
        }
    }

    fn outcome(&self) -> Outcome {
        if self.worst_px > SILENT_PX {
            Outcome::Silent
        } else if self.lost {
            Outcome::Lost
        } else if self.worst_px > TRACKED_PX {
            Outcome::Slipping
        } else {
            Outcome::Tracked
        }
    }
}

/// Several trackers over the same images. `course` prepares the scene for an image and says where the tip is in it;
/// `click_off_px` is where the trackers are started, from the tip, and what they are then expected to stay on.
pub fn follow(
    scene: &mut NeedleScene,
    settings: &[TrackerSettings],
    images: u32,
    click_off_px: [f64; 2],
    course: impl Fn(&mut NeedleScene, u32) -> [f64; 2],
) -> Vec<Outcome> {
    let mut see = |k: u32| {
        let tip = course(scene, k);
        (scene.image(tip, 1.0), [tip[0] + click_off_px[0], tip[1] + click_off_px[1]])
    };
    let (first, click_px) = see(0);
    let mut trials: Vec<_> = settings.iter().map(|s| Trial::new(*s, &first, click_px)).collect();
    for k in 1..images {
        let (image, truth_px) = see(k);
        trials.iter_mut().for_each(|trial| trial.see(&image, truth_px));
    }
    trials.iter().map(Trial::outcome).collect()
}

/// The needle's even way along its path.
pub fn steady(scene: &mut NeedleScene, k: u32) -> [f64; 2] {
    let (start, step) = scene.path();
    [start[0] + f64::from(k) * step[0], start[1] + f64::from(k) * step[1]]
}

/// A needle that fades over some images, is gone, and is suddenly back.
#[derive(Debug, Clone, Copy)]
pub struct Fade {
    /// The first image without the needle, the first with it again, and the number of images.
    pub gone: u32,
    pub back: u32,
    pub images: u32,
    /// Images over which it fades; 1 = from one to the next.
    pub over: u32,
}

/// What a tracker made of a needle that faded.
#[derive(Debug, Clone, Copy)]
pub struct Faded {
    /// TRACKING within 2 px until it began to fade.
    pub kept: bool,
    /// Not TRACKING in the sixth image without the needle, or earlier.
    pub declared: bool,
    /// Not TRACKING in any later image without it.
    pub stayed_lost: bool,
    /// TRACKING at the end, and never TRACKING more than 2 px off since it was back.
    pub recovered: bool,
}

/// One tracker over a needle that fades. The insertion stands still while the tracker is not TRACKING.
pub fn fade(scene: &mut NeedleScene, settings: TrackerSettings, course: Fade) -> Faded {
    /// A loss is to be declared within so many images.
    const WITHIN: u32 = 5;
    let (mut tip, step) = scene.path();
    let mut tracker = Tracker::new(settings, &scene.image(tip, 1.0), tip).expect("a sound first image");
    let (mut kept, mut stayed_lost, mut near) = (true, true, true);
    let mut declared_at = None;
    for k in 1..course.images {
        if tracker.state() == TrackState::Tracking {
            tip = [tip[0] + step[0], tip[1] + step[1]];
        }
        let left = f64::from(course.gone.saturating_sub(k)) / f64::from(course.over);
        let strength = if k >= course.back { 1.0 } else { left.min(1.0) };
        let estimate = tracker.track(&scene.image(tip, strength), &Context::default());
        let tracking = estimate.state == TrackState::Tracking;
        let is_near = distance(estimate.tip_px.expect("a tip"), tip) <= TRACKED_PX;
        if k < course.gone {
            kept &= strength < 1.0 || (tracking && is_near);
        } else if k < course.back {
            if !tracking && declared_at.is_none() {
                declared_at = Some(k - course.gone);
            }
            stayed_lost &= !tracking || declared_at.is_none();
        } else {
            near &= !tracking || is_near;
        }
    }
    let declared = declared_at.is_some_and(|images| images <= WITHIN);
    let recovered = near && tracker.state() == TrackState::Tracking;
    Faded { kept, declared, stayed_lost: declared && stayed_lost, recovered }
}

/// Outcomes of many sequences.
#[derive(Debug, Clone, Copy, Default)]
pub struct Shares {
    counts: [u32; 4],
}

impl Shares {
    pub fn of(outcomes: impl IntoIterator<Item = Outcome>) -> Self {
        let mut counts = [0; 4];
        for outcome in outcomes {
            counts[outcome as usize] += 1;
        }
        Self { counts }
    }

    /// Share of sequences with an outcome, in per cent.
    pub fn percent(&self, outcome: Outcome) -> f64 {
        100.0 * f64::from(self.counts[outcome as usize]) / f64::from(self.counts.iter().sum::<u32>())
    }
}

impl std::fmt::Display for Shares {
    /// Tracked / lost and said so / slipping / silent, in per cent.
    fn fmt(&self, f: &mut std::fmt::Formatter) -> std::fmt::Result {
        let [tracked, lost, slipping, silent] =
            [Outcome::Tracked, Outcome::Lost, Outcome::Slipping, Outcome::Silent].map(|o| self.percent(o));
        write!(f, "{tracked:.0}/{lost:.0}/{slipping:.0}/{silent:.0}")
    }
}
