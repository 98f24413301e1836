//! Work handed to the pool's threads by one that stays awake until it is done.
//!
//! A thread of rayon's that waits for another one goes to sleep after some tens of microseconds, and takes as long or longer to
//! wake: several times a picture that takes three milliseconds. Here it looks for other work, and looks again.

use core::sync::atomic::{AtomicUsize, Ordering};

use rayon::Yield;

/// Counts one down, however its work ended.
struct Done<'a>(&'a AtomicUsize);

impl Drop for Done<'_> {
    fn drop(&mut self) {
        self.0.fetch_sub(1, Ordering::Release);
    }
}

/// Does other work until nothing is left.
fn wait(left: &AtomicUsize) {
    while left.load(Ordering::Acquire) > 0 {
        if rayon::yield_now() != Some(Yield::Executed) {
            std::thread::yield_now();
        }
    }
}

/// Does the work for every item, on whichever threads of the pool are free.
pub fn for_each<T: Send>(items: impl ExactSizeIterator<Item = T>, work: impl Fn(T) + Sync) {
    let left = &AtomicUsize::new(items.len());
    let work = &work;
    rayon::in_place_scope(|scope| {
        for item in items {
            scope.spawn(move |_| {
                let _done = Done(left);
                work(item);
            });
        }
        wait(left);
    });
}

/// Does both.
pub fn join(here: impl FnOnce(), anywhere: impl FnOnce() + Send) {
    let left = &AtomicUsize::new(1);
    rayon::in_place_scope(|scope| {
        scope.spawn(move |_| {
            let _done = Done(left);
            anywhere();
        });
        here();
        wait(left);
    });
}
