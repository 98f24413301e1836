//! What a person sees while a run goes on.

use indicatif::{ProgressBar, ProgressStyle};
use sonoloop_scenario::Scenario;
use sonoloop_types::{TICKS_PER_SECOND, TrackState};

use crate::record::ImageRow;
use crate::session::{Shown, Watch};

/// A bar over the insertion: depth from the start to the target, with state and NCC. Hidden when standard error is
/// no terminal.
pub struct Progress {
    bar: ProgressBar,
    start_m: f64,
    interrupted: fn() -> bool,
}

impl Progress {
    /// A bar for one run.
    pub fn new(scenario: &Scenario) -> Self {
        let start_m = scenario.insertion.start_depth_m;
        let length_um = ((scenario.insertion.target_depth_m - start_m) * 1e6).max(1.0) as u64;
        let style = ProgressStyle::with_template("{prefix} {bar:32} {percent:>3} % {msg}")
            .unwrap_or_else(|_| ProgressStyle::default_bar());
        let bar = ProgressBar::new(length_um).with_style(style).with_prefix(scenario.name.clone());
        Self { bar, start_m, interrupted: sonoloop_wire::termination_requested }
    }

    /// Takes the bar away.
    pub fn finish(&self) {
        self.bar.finish_and_clear();
    }
}

impl Watch for Progress {
    fn image(&mut self, row: &ImageRow, _shown: &Shown) {
        self.bar.set_position(((row.truth.depth_m - self.start_m) * 1e6).max(0.0) as u64);
        let time_s = row.acquisition.acquisition_tick as f64 / TICKS_PER_SECOND as f64;
        let state = match row.state() {
            Some(TrackState::Searching) => "searching",
            Some(TrackState::Tracking) => "tracking",
            Some(TrackState::Lost) => "LOST",
            Some(TrackState::Recovering) => "recovering",
            None => "no tracker",
        };
        let ncc = row.command.and_then(|c| c.estimate.ncc_anchor);
        let ncc = ncc.map_or_else(String::new, |ncc| format!("  NCC {ncc:.2}"));
        self.bar.set_message(format!("{time_s:5.2} s  {state}{ncc}"));
    }

    fn interrupted(&mut self) -> bool {
        (self.interrupted)()
    }
}
