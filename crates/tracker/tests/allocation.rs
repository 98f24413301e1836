//! After the first image of a size no image makes the tracker allocate memory.

mod support;

use core::cell::Cell;
use std::alloc::{GlobalAlloc, Layout, System};

use sonoloop_tracker::{Context, Tracker};
use sonoloop_types::{Confirmation, Image, Profile, Similarity, TrackState, TrackerSettings, Warp};
use support::NeedleScene;

/// The system's allocator, counting what each thread asks of it.
struct Counting;

thread_local! {
    static ALLOCATIONS: Cell<u64> = const { Cell::new(0) };
}

fn count_one() {
    // A thread that is ending has no counter any more; nothing is counted there.
    let _ = ALLOCATIONS.try_with(|count| count.set(count.get() + 1));
}

// SAFETY: every call goes to `System` with its own arguments, so its guarantees hold; counting allocates nothing, since the
// counter is initialised in a constant and has no destructor.
#[expect(unsafe_code, reason = "an allocator cannot be had without")]
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        count_one();
        // SAFETY: the caller's promise on `layout` is that of `System`.
        unsafe { System.alloc(layout) }
    }

    unsafe fn alloc_zeroed(&self, layout: Layout) -> *mut u8 {
        count_one();
        // SAFETY: as above.
        unsafe { System.alloc_zeroed(layout) }
    }

    unsafe fn realloc(&self, pointer: *mut u8, layout: Layout, size: usize) -> *mut u8 {
        count_one();
        // SAFETY: `pointer` came from `System` with this `layout`.
        unsafe { System.realloc(pointer, layout, size) }
    }

    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        // SAFETY: `pointer` came from `System` with this `layout`.
        unsafe { System.dealloc(pointer, layout) }
    }
}

#[global_allocator]
static ALLOCATOR: Counting = Counting;

/// What this thread allocates in `work`.
fn allocations(work: impl FnOnce()) -> u64 {
    let before = ALLOCATIONS.get();
    work();
    ALLOCATIONS.get() - before
}

#[test]
fn an_allocation_is_counted() {
    assert_eq!(allocations(|| drop(core::hint::black_box(Vec::<u8>::with_capacity(1)))), 1);
}

/// Images for every state, and what the tracker is told of each.
struct Film {
    first: Image,
    tip_px: [f64; 2],
    shots: Vec<(Image, Context<'static>)>,
}

/// A needle that advances, is gone for longer than it takes to search everywhere, is back, and is gone again.
fn film(seed: u64) -> Film {
    let mut scene = NeedleScene::new(seed, 0.2, 0.45);
    let (mut tip, step) = scene.path();
    let (first, tip_px) = (scene.image(tip, 1.0), tip);
    let advancing = Context { motion_px: Some(step), ..Context::default() };
    let along = Some([libm::cos(0.45), libm::sin(0.45)]);
    let resting = Context {
        motion_px: Some([0.0; 2]),
        axis_px: along,
        confirmation: Confirmation::Confirms,
        ..Context::default()
    };
    let mut shots = Vec::new();
    for _ in 0..4 {
        tip = [tip[0] + step[0], tip[1] + step[1]];
        shots.push((scene.image(tip, 1.0), advancing));
    }
    for _ in 0..12 {
        shots.push((scene.image(tip, 0.0), resting));
    }
    for _ in 0..6 {
        shots.push((scene.image(tip, 1.0), resting));
    }
    shots.push((scene.image(tip, 0.0), Context::default()));
    Film { first, tip_px, shots }
}

/// Runs the film and says which images allocated, and the states that were seen.
fn run(tracker: &mut Tracker, film: &Film) -> (Vec<(usize, u64)>, Vec<TrackState>) {
    let mut seen = Vec::new();
    let mut allocated = Vec::new();
    for (k, (image, context)) in film.shots.iter().enumerate() {
        let mut state = TrackState::Searching;
        let count = allocations(|| state = tracker.track(image, context).state);
        seen.push(state);
        if count > 0 {
            allocated.push((k, count));
        }
    }
    (allocated, seen)
}

fn all_settings(sides_px: &[u32]) -> Vec<TrackerSettings> {
    let mut all = Vec::new();
    for profile in [Profile::Paper, Profile::Robust] {
        for &template_px in sides_px {
            for similarity in [Similarity::Ssd, Similarity::Scv] {
                for warp in [Warp::Translation, Warp::Rigid, Warp::Affine] {
                    let basis = TrackerSettings::profile(profile, template_px);
                    all.push(TrackerSettings { similarity, warp, ..basis });
                }
            }
        }
    }
    all
}

#[test]
fn no_image_after_the_first_allocates() {
    let film = film(201);
    let mut states = Vec::new();
    for settings in all_settings(&[8, 20, 31, 61, 128]) {
        let mut tracker = Tracker::new(settings, &film.first, film.tip_px).expect("a sound first image");
        let (allocated, seen) = run(&mut tracker, &film);
        assert!(allocated.is_empty(), "{settings:?}: {allocated:?} (image, allocations)");
        states.extend(seen);
    }
    for state in [TrackState::Tracking, TrackState::Lost, TrackState::Recovering] {
        assert!(states.contains(&state), "{state:?} was never seen");
    }
}

#[test]
fn a_restored_tracker_allocates_nothing_either() {
    let film = film(202);
    for settings in all_settings(&[20, 61]) {
        let tracker = Tracker::new(settings, &film.first, film.tip_px).expect("a sound first image");
        let mut restored = Tracker::restore(settings, &tracker.checkpoint()).expect("its own checkpoint");
        let (allocated, _) = run(&mut restored, &film);
        assert!(allocated.is_empty(), "{settings:?}: {allocated:?} (image, allocations)");
    }
}

/// Whole-image searches from the first lost image on, over images that are all background.
#[test]
fn a_search_of_the_whole_image_allocates_nothing() {
    let film = film(203);
    for basis in all_settings(&[8, 31, 128]) {
        let settings = TrackerSettings { whole_image_after: 0, ..basis };
        let mut tracker = Tracker::new(settings, &film.first, film.tip_px).expect("a sound first image");
        let blank = &film.shots[10].0;
        for k in 0..3 {
            let count = allocations(|| _ = tracker.track(blank, &Context::default()));
            assert_eq!(count, 0, "image {k}, {settings:?}");
        }
    }
}

/// What is said of the first image of a size holds for the sizes after it: the first larger one may allocate, no other, even
/// where it was not searched itself.
#[test]
fn an_image_of_another_size_allocates_at_most_once() {
    let crop = |image: &Image, width: u32, height: u32| {
        let rows = (0..height).flat_map(|v| image.row(v)[..width as usize].to_vec());
        Image::from_pixels(width, height, rows.collect()).expect("as many as the size says")
    };
    let film = film(204);
    let small = crop(&film.first, 320, 240);
    let settings = TrackerSettings { whole_image_after: 0, ..TrackerSettings::profile(Profile::Robust, 20) };
    let mut tracker = Tracker::new(settings, &small, film.tip_px).expect("a sound first image");
    let larger = &film.shots[10].0;
    tracker.track(larger, &Context::default());
    for image in [larger, &small, larger, &crop(larger, 500, 100)] {
        assert_eq!(allocations(|| _ = tracker.track(image, &Context::default())), 0);
    }
}
