//! Synthetic B-mode sequences with known tips: speckle, a bright needle, log compression.
//!
//! *Needle* scenes: the needle moves over speckle that stands still, the case in which trackers slide onto the
//! background. *Rigid* scenes: needle and speckle move together by a random walk. Amplitudes are in units of the
//! speckle's rms; fresh multiplicative speckle of 8 % goes over every image.
#![allow(dead_code, unused_imports, reason = "every test binary uses its own part")]

mod answer;
mod needle;
mod rigid;
mod speckle;
mod trials;

pub use answer::check_answer;
pub use needle::{NeedleScene, Shadow, Tissue};
pub use rigid::RigidScene;
pub use trials::{Fade, Faded, Outcome, Shares, fade, follow, steady};

pub const WIDTH: usize = 640;
pub const HEIGHT: usize = 480;

pub fn distance(a: [f64; 2], b: [f64; 2]) -> f64 {
    ((a[0] - b[0]).powi(2) + (a[1] - b[1]).powi(2)).sqrt()
}

pub fn median(values: &[f64]) -> f64 {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    sorted[sorted.len() / 2]
}

/// `work` for every item, on as many threads as there are cores, results in the items' order.
pub fn in_parallel<T: Sync, R: Send>(items: &[T], work: impl Fn(&T) -> R + Sync) -> Vec<R> {
    let threads = std::thread::available_parallelism().map_or(1, |n| n.get());
    let chunk = items.len().div_ceil(threads).max(1);
    std::thread::scope(|scope| {
        let jobs: Vec<_> = items
            .chunks(chunk)
            .map(|part| scope.spawn(|| part.iter().map(&work).collect::<Vec<_>>()))
            .collect();
        jobs.into_iter().flat_map(|job| job.join().expect("a worker panicked")).collect()
    })
}
