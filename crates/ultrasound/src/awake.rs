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

#[cfg(test)]
mod tests {
    use std::panic::{AssertUnwindSafe, catch_unwind};

    use super::*;

    fn pool(threads: usize) -> rayon::ThreadPool {
        rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads")
    }

    /// Counts how often each of some items is worked on, within another piece of work.
    fn counts() -> Vec<usize> {
        let counts: Vec<AtomicUsize> = (0..100).map(|_| AtomicUsize::new(0)).collect();
        let half = |range: core::ops::Range<usize>| {
            for_each(range, |item| {
                counts[item].fetch_add(1, Ordering::Relaxed);
            });
        };
        join(|| half(0..50), || half(50..100));
        counts.into_iter().map(AtomicUsize::into_inner).collect()
    }

    #[test]
    fn every_item_has_its_work_done_once_whatever_threads_there_are() {
        for threads in 1..=3 {
            let pool = pool(threads);
            for _ in 0..50 {
                assert_eq!(pool.install(counts), vec![1; 100], "{threads} threads");
            }
        }
        assert_eq!(counts(), vec![1; 100], "from outside the pool");
    }

    #[test]
    fn work_that_panics_is_no_work_to_wait_for() {
        for threads in 1..=2 {
            let work = || pool(threads).install(|| for_each(0..20, |item| assert!(item != 7, "the seventh")));
            assert!(catch_unwind(AssertUnwindSafe(work)).is_err());
            let work = || pool(threads).install(|| join(|| {}, || panic!("there")));
            assert!(catch_unwind(AssertUnwindSafe(work)).is_err());
        }
    }
}
