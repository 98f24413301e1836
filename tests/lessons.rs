//! What the lesson on drift says that runs show.

use sonoloop::commands::execute_in_process;
use sonoloop::controller::ControllerKind;
use sonoloop::judge::Metrics;
use sonoloop::scenarios::prepare;

mod common;

/// Metrics of a lesson's first seeds with a setting changed.
fn runs(lesson: &str, seeds: u64, setting: &str) -> Vec<Metrics> {
    let file = common::file("lessons").join(lesson);
    let run = |seed| {
        let (scenario, session) =
            prepare(&file, Some(seed), &[setting.to_owned()]).unwrap_or_else(|e| panic!("{e}"));
        let finished = execute_in_process(&scenario, session, ControllerKind::Tracker);
        finished.unwrap_or_else(|e| panic!("{lesson}, seed {seed}: {e}")).summary.metrics
    };
    (0..seeds).map(run).collect()
}

/// `5_drift.md`: in three of six insertions a tip that is there is declared lost with a template from every image, in none with the drift
/// corrected.
#[test]
fn the_naive_update_loses_what_drift_correction_keeps() {
    let losing = |update: &str| {
        let runs = runs("5_drift.yaml", 6, &format!("tracker.update={update}"));
        runs.iter().filter(|metrics| metrics.false_losses > 0).count()
    };
    // Where pictures change and these numbers with them, the lesson's text is to say the new ones.
    assert_eq!(losing("naive"), 3);
    assert_eq!(losing("drift_corrected"), 0);
}
