//! The files of `--out DIR`, and what a run prints.

mod animation;
mod canvas;
mod charts;
mod colour;
mod csv;
mod error;
mod junit;
mod overlay;
mod pictures;
mod plot;
mod png;
mod rates;
mod sequence;
mod setting;
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
pub(crate) use csv::{IMAGE_COLUMNS, image_line, snake};
pub use csv::{events_csv, images_csv};
pub use error::OutputError;
pub(crate) use junit::escape_xml;
pub use junit::{Case, CaseResult, junit_xml};
pub use overlay::{Display, Scale};
pub(crate) use pictures::{PICTURES, jpeg, split};
pub(crate) use png::rgb_png;
pub use png::write_png;
pub use rates::{GroupRates, Rate, Rates, Run, ScenarioRates, Spread};
pub use sequence::write_sequence;
pub use setting::Setting;
pub use stage::Stage;
pub(crate) use strip::strip;
pub(crate) use summary::median;
pub use summary::{Summary, TimingSummary, Verdict};
pub use table::{bound_text, failure_text, metrics_table, value_text, verdict_text};
pub(crate) use tracked::Tracked;
pub use video::VideoKind;
pub(crate) use video::{GIF, MP4};
pub use wilson::wilson;

use std::path::Path;

use sonoloop_scenario::Scenario;

use crate::judge::{Judged, Metrics};
use crate::peer::TrackerName;
use crate::record::Recording;
use crate::report::{self, REPORT};
use pictures::write_pictures;
use sequence::SEQUENCE;
use video::{Frames, write_video};

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
    /// Who answered the images.
    pub tracker: &'a TrackerName,
    /// Version of the program.
    pub version: &'a str,
}

/// Every name that [`write_outcome`] may use; an older run's files of these names do not survive it.
/// `sequence.mha` is the caller's: see [`write_outcome_with`] and [`write_sequence`].
const NAMES: [&str; 10] = [
    PICTURES,
    "images.csv",
    "events.csv",
    "scenario.yaml",
    "tracking.svg",
    "insertion.svg",
    REPORT,
    SEQUENCE,
    MP4,
    GIF,
];

impl Outcome<'_> {
    /// `summary.json`'s content.
    pub fn summary(&self) -> Summary {
        Summary::new(self.scenario, self.tracker, self.version, self.metrics, self.judged, self.recording)
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
    stage.write("images.csv", images_csv(&recording.images, &scenario.probe))?;
    stage.write("events.csv", events_csv(&recording.events))?;
    stage.write("scenario.yaml", resolved_yaml(scenario, folder, version))?;
    stage.write("tracking.svg", charts::tracking_svg(scenario, recording))?;
    stage.write("insertion.svg", charts::insertion_svg(scenario, recording))?;

    let display = Display::new(scenario, recording);
    let period_ticks = scenario.image_period_ticks;
    let frames = recording
        .pixels
        .as_ref()
        .map(|pixels| Frames::new(&recording.images, pixels, &display, period_ticks));
    // Side by side: the video takes long.
    let (video, pictures) = std::thread::scope(|scope| {
        let pictures = recording.pixels.as_ref().map(|pixels| {
            let (path, count) = (stage.path(PICTURES), recording.images.len().min(pixels.len()));
            scope.spawn(move || write_pictures(&path, pixels, count))
        });
        let video = frames.as_ref().map_or(Ok(None), |frames| write_video(&stage, frames));
        (video, pictures.map_or(Ok(()), |pictures| pictures.join().expect("it does not panic")))
    });
    let video = video?;
    pictures?;
    more(&stage)?;
    stage.write("summary.json", outcome.summary().to_json())?;
    // From the files alone, so that it can be made again from them.
    let page = report::page(&stage.path("")).map_err(OutputError::Report)?;
    stage.write(REPORT, page)?;
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
