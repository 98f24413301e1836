//! Scratch by thread: what a task writes first still lies in its core's caches from the task before.

use std::sync::{Mutex, TryLockError};

/// A value for each thread of the pool. What is in it when a task gets it depends on the threads, so it must not show in
/// what the task makes.
#[derive(Default)]
pub struct PerThread<T>(Vec<Mutex<T>>);

impl<T: Default> PerThread<T> {
    /// Sees to it that every thread of the current pool has its own.
    pub fn prepare(&mut self) {
        let threads = rayon::current_num_threads();
        if self.0.len() < threads {
            self.0.resize_with(threads, Mutex::default);
        }
    }

    /// Lends that of the thread at hand, after [`Self::prepare`] in the same pool.
    ///
    /// # Panics
    /// Outside the pool, and where the work hands work over itself: its thread might come back for another value.
    pub fn with<R>(&self, work: impl FnOnce(&mut T) -> R) -> R {
        let index = rayon::current_thread_index().expect("a thread of the pool");
        match self.0[index].try_lock() {
            Ok(mut own) => work(&mut own),
            // Work that panicked; whatever it left is overwritten.
            Err(TryLockError::Poisoned(own)) => work(&mut own.into_inner()),
            Err(TryLockError::WouldBlock) => panic!("work on a thread's scratch hands nothing over"),
        }
    }
}
