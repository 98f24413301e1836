//! The files of `--out DIR`, and what a run prints.

mod animation;
mod canvas;
mod charts;
mod colour;
mod csv;
mod error;
mod junit;
mod keys;
mod overlay;
mod plot;
mod png;
mod rates;
mod report;
mod sequence;
mod stage;
mod strip;
mod summary;
mod table;
#[cfg(test)]
pub(crate) mod test_run;
#[cfg(test)]
mod tests;
mod tracked;
mod video;
mod wilson;

pub(crate) use animation::write_gif;
pub(crate) use csv::snake;
pub use csv::{events_csv, images_csv};
pub use error::OutputError;
pub(crate) use junit::escape_xml;
pub use junit::{Case, CaseResult, junit_xml};
pub use overlay::{Display, Scale};
pub(crate) use png::rgb_png;
pub use png::write_png;
pub use rates::{GroupRates, Rate, Rates, Run, ScenarioRates, Spread};
pub use sequence::write_sequence;
pub use stage::Stage;
pub(crate) use strip::strip;
pub use summary::{Summary, TimingSummary};
pub use table::{bound_text, failure_text, metrics_table, value_text, verdict_text};
pub(crate) use tracked::Tracked;
pub use video::VideoKind;
pub use wilson::wilson;

use std::path::Path;

use sonoloop_scenario::Scenario;

use crate::judge::{Judged, Metrics};
use crate::record::Recording;
use report::report_html;
use sequence::SEQUENCE;
use video::{Frames, GIF, MP4, write_video};

/// A run and its verdict, ready to be written.
#[derive(Debug, Clone, Copy)]
pub struct Outcome<'a> {
    /// What was run.
    pub scenario: &'a Scenario,
    /// What it left.
    pub recording: &'a Recording,
    /// What that was worth.
    pub metrics: &'a Metrics,
    /// Against what was expected.
    pub judged: &'a [Judged],
    /// Version of the program.
    pub version: &'a str,
}

/// Every name that [`write_outcome`] may use; an older run's files of these names do not survive it.
/// `sequence.mha` is the caller's: see [`write_outcome_with`] and [`write_sequence`].
const NAMES: [&str; 9] = [
    "images.csv",
    "events.csv",
    "scenario.yaml",
    "tracking.svg",
    "insertion.svg",
    "report.html",
    SEQUENCE,
    MP4,
    GIF,
];

impl Outcome<'_> {
    /// `summary.json`'s content.
    pub fn summary(&self) -> Summary {
        let Scenario { name, seed, .. } = self.scenario;
        Summary::new(name, *seed, self.version, self.metrics, self.judged, self.recording)
    }
}

/// Writes all files of a run into `folder`, each complete before it gets its name. Says which kind of video
/// was written; `None` when the recording holds no pictures.
pub fn write_outcome(folder: &Path, outcome: &Outcome<'_>) -> Result<Option<VideoKind>, OutputError> {
    write_outcome_with(folder, outcome, |_| Ok(()))
}

/// As [`write_outcome`]; `more` may add files (`sequence.mha`) before any gets its name.
pub fn write_outcome_with(
    folder: &Path,
    outcome: &Outcome<'_>,
    more: impl FnOnce(&Stage) -> Result<(), OutputError>,
) -> Result<Option<VideoKind>, OutputError> {
    let Outcome { scenario, recording, version, .. } = *outcome;
    let stage = Stage::new(folder)?;
    stage.write("images.csv", images_csv(&recording.images))?;
    stage.write("events.csv", events_csv(&recording.events))?;
    stage.write("scenario.yaml", resolved_yaml(scenario, folder, version))?;
    let tracking_svg = charts::tracking_svg(scenario, recording);
    let insertion_svg = charts::insertion_svg(scenario, recording);
    stage.write("tracking.svg", &tracking_svg)?;
    stage.write("insertion.svg", &insertion_svg)?;

    let display = Display::new(scenario, recording);
    let period_ticks = scenario.image_period_ticks;
    let frames = recording
        .pixels
        .as_ref()
        .map(|pixels| Frames::new(&recording.images, pixels, &display, period_ticks));
    let video = frames.as_ref().map_or(Ok(None), |frames| write_video(&stage, frames))?;
    let plots = [tracking_svg.as_str(), insertion_svg.as_str()];
    stage.write("report.html", report_html(outcome, frames.as_ref(), &plots, video.as_ref())?)?;
    more(&stage)?;
    stage.write("summary.json", outcome.summary().to_json())?;
    stage.publish(&NAMES)?;
    Ok(video)
}

/// The resolved file, headed by what made it. It can be run from `folder`, unless a file that it names has gone while
/// the run went on; then it says so and is as it was loaded.
fn resolved_yaml(scenario: &Scenario, folder: &Path, version: &str) -> String {
    let text = scenario.resolved_yaml_for(folder);
    let text =
        text.unwrap_or_else(|why| format!("# cannot be run from here: {why}\n{}", scenario.resolved_yaml));
    format!("# resolved by sonoloop {version}\n{text}")
}
