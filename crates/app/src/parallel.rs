//! Several cases at a time.

use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};

/// Does the same for every case, `jobs` at a time; results in the order of the cases.
pub(crate) fn each<C: Sync, R: Send>(jobs: usize, cases: &[C], work: impl Fn(&C) -> R + Sync) -> Vec<R> {
    let next = AtomicUsize::new(0);
    let results: Mutex<Vec<Option<R>>> =
        Mutex::new(std::iter::repeat_with(|| None).take(cases.len()).collect());
    std::thread::scope(|scope| {
        for _ in 0..jobs.min(cases.len()) {
            scope.spawn(|| {
                while let Some((k, case)) = {
                    let k = next.fetch_add(1, Ordering::Relaxed);
                    cases.get(k).map(|case| (k, case))
                } {
                    let result = work(case);
                    results.lock().expect("no holder panics")[k] = Some(result);
                }
            });
        }
    });
    results.into_inner().expect("no holder panics").into_iter().flatten().collect()
}
