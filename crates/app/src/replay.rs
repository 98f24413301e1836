//! A recorded run, run again and held against its files image by image.

use std::path::Path;

use sonoloop_scenario::Scenario;
use sonoloop_types::{EndReason, Event, EventKind, ProbeSpec};

use crate::controller::ControllerKind;
use crate::output::{IMAGE_COLUMNS, Summary, image_line, snake};
use crate::peer::{InProcess, NoTracker, Peer, TrackerName};
use crate::record::ImageRow;
use crate::report::{FilesError, parse_csv, read_summary, read_text};
use crate::session::{Session, Shown, Watch, kills_tracker};

/// A recording cannot be compared.
#[derive(Debug, thiserror::Error)]
pub enum ReplayError {
    /// A file is missing or damaged.
    #[error(transparent)]
    Files(#[from] FilesError),
    /// The run cannot be had again, whatever the program does.
    #[error("{folder}: not comparable: {why}")]
    NotComparable {
        /// The run's folder.
        folder: String,
        /// Why.
        why: String,
    },
    /// It was interrupted, or the simulator failed.
    #[error("the run ended early: {0}")]
    EndedEarly(String),
}

/// What a run left, as far as it can be had again.
#[derive(Debug)]
pub struct Recorded {
    /// Its summary.
    pub summary: Summary,
    images: Vec<String>,
    events: Vec<Event>,
    tracker: Option<ControllerKind>,
}

/// What came of it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Compared {
    /// Everything is the same.
    Same {
        /// Images that were compared.
        images: usize,
        /// Events that were compared.
        events: usize,
    },
    /// Something is not; the first that differs, in a sentence.
    Differs(String),
}

impl Recorded {
    /// Reads what is compared from a run's folder.
    ///
    /// # Errors
    ///
    /// Missing or damaged files, and runs that nobody can have again: paced by the clock, with a tracker that is no part of this
    /// program, or ended early.
    pub fn read(folder: &Path) -> Result<Self, ReplayError> {
        let summary = read_summary(folder)?;
        let not_comparable = |why: String| {
            let folder = folder.display().to_string();
            Err(ReplayError::NotComparable { folder, why })
        };
        if summary.realtime {
            return not_comparable("it was paced by the clock (--realtime)".into());
        }
        if !matches!(summary.end, EndReason::TargetReached | EndReason::TimeOver) {
            let why = snake(&summary.end).replace('_', " ");
            return not_comparable(format!("it ended early ({why})"));
        }
        let TrackerName { name, version } = &summary.tracker;
        let tracker = match ControllerKind::from_name(name) {
            Some(kind) if *version == summary.version => Some(kind),
            None if name == TrackerName::NONE => None,
            _ => return not_comparable(format!("it ran with another tracker ({name} {version})")),
        };
        let (images, events) = (read_images(folder, &summary)?, read_events(folder)?);
        Ok(Self { summary, images, events, tracker })
    }

    /// Runs the scenario again and compares; stops at the first image that differs. `watch` sees every image.
    ///
    /// # Errors
    ///
    /// When `watch` was interrupted, or the simulator failed.
    pub fn compare(
        &self,
        scenario: &Scenario,
        session: Session,
        run_id: u64,
        watch: &mut dyn Watch,
    ) -> Result<Compared, ReplayError> {
        let mut peer: Box<dyn Peer> = match self.tracker {
            Some(kind) => Box::new(InProcess::new(kind, kills_tracker(scenario))),
            None => Box::new(NoTracker),
        };
        let mut images =
            Images { recorded: &self.images, probe: &scenario.probe, next: 0, difference: None, watch };
        let (recording, error) = session.run(run_id, peer.as_mut(), &mut images, None);
        if let Some(difference) = images.difference {
            return Ok(Compared::Differs(difference));
        }
        if let Some(error) = error {
            return Err(ReplayError::EndedEarly(error.to_string()));
        }
        let [was, is] = [self.images.len(), recording.images.len()];
        if was != is {
            return Ok(Compared::Differs(format!("number of images: recorded {was}, now {is}")));
        }
        // What observers asked for is in the scenario now; nobody asks again.
        let is_of_the_run = |event: &&Event| event.kind != EventKind::Control;
        let was: Vec<&Event> = self.events.iter().filter(is_of_the_run).collect();
        let is: Vec<&Event> = recording.events.iter().filter(is_of_the_run).collect();
        Ok(event_difference(&was, &is)
            .map_or(Compared::Same { images: self.images.len(), events: is.len() }, Compared::Differs))
    }
}

fn read_images(folder: &Path, summary: &Summary) -> Result<Vec<String>, ReplayError> {
    let text = read_text(folder, "images.csv")?;
    let damaged = |why: String| Err(FilesError::Damaged { path: folder.join("images.csv"), why }.into());
    let mut lines = text.lines().map(str::to_owned);
    if lines.next().as_deref() != Some(IMAGE_COLUMNS) {
        return damaged(format!("its columns are not those of version {}", env!("CARGO_PKG_VERSION")));
    }
    let images: Vec<String> = lines.collect();
    let columns = IMAGE_COLUMNS.split(',').count();
    if let Some(index) = images.iter().position(|line| line.split(',').count() != columns) {
        return damaged(format!("line {} has not {columns} columns", index + 2));
    }
    if images.len() as u64 != summary.metrics.images {
        return damaged(format!(
            "{} images, but summary.json counts {}",
            images.len(),
            summary.metrics.images
        ));
    }
    Ok(images)
}

fn read_events(folder: &Path) -> Result<Vec<Event>, FilesError> {
    parse_csv(&read_text(folder, "events.csv")?)
        .map_err(|error| FilesError::Damaged { path: folder.join("events.csv"), why: error.to_string() })
}

/// Holds every image against its line, and asks for the end when one differs.
struct Images<'a> {
    recorded: &'a [String],
    probe: &'a ProbeSpec,
    next: usize,
    difference: Option<String>,
    watch: &'a mut dyn Watch,
}

impl Watch for Images<'_> {
    fn image(&mut self, row: &ImageRow, shown: &Shown) {
        self.watch.image(row, shown);
        let Some(was) = self.recorded.get(self.next) else { return };
        self.next += 1;
        if self.difference.is_none() {
            self.difference = image_difference(was, &image_line(row, self.probe));
        }
    }

    fn interrupted(&mut self) -> bool {
        self.difference.is_some() || self.watch.interrupted()
    }
}

/// The first column in which two rows of `images.csv` differ, in a sentence.
fn image_difference(was: &str, is: &str) -> Option<String> {
    let columns = IMAGE_COLUMNS.split(',').zip(was.split(',').zip(is.split(',')));
    let (column, (was_value, is_value)) = columns.into_iter().find(|(_, (was, is))| was != is)?;
    let mut place = was.split(',');
    let (image, tick) = (place.next().unwrap_or_default(), place.next().unwrap_or_default());
    let or_nothing = |value: &str| if value.is_empty() { "nothing".to_owned() } else { value.to_owned() };
    Some(format!(
        "image {image}, tick {tick}, {column}: recorded {}, now {}",
        or_nothing(was_value),
        or_nothing(is_value)
    ))
}

/// The first event that differs, in a sentence.
fn event_difference(was: &[&Event], is: &[&Event]) -> Option<String> {
    let text = |event: Option<&&Event>| {
        event.map_or("nothing".to_owned(), |event| {
            format!("tick {}, {}, \"{}\"", event.tick, snake(&event.kind), event.detail)
        })
    };
    let index = (0..was.len().max(is.len())).find(|&index| was.get(index) != is.get(index))?;
    let (was, is) = (text(was.get(index)), text(is.get(index)));
    Some(format!("event {} (without those of observers): recorded {was}; now {is}", index + 1))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_first_column_that_differs_is_named() {
        let was = "7,280,280,00ff,1.0,,1";
        assert_eq!(image_difference(was, was), None);
        let difference = image_difference(was, "7,280,280,00fe,1.0,,0").unwrap();
        assert_eq!(difference, "image 7, tick 280, image_hash: recorded 00ff, now 00fe");
        let difference = image_difference(was, "7,280,280,00ff,1.0,2.0,1").unwrap();
        assert_eq!(difference, "image 7, tick 280, tip_v_px: recorded nothing, now 2.0");
    }

    #[test]
    fn an_event_that_is_missing_differs_from_nothing() {
        let event = |tick| Event { tick, kind: EventKind::Puncture, detail: "a face".into() };
        let (first, second) = (event(3), event(9));
        assert_eq!(event_difference(&[&first, &second], &[&first, &second]), None);
        let difference = event_difference(&[&first, &second], &[&first]).unwrap();
        assert!(difference.ends_with("recorded tick 9, puncture, \"a face\"; now nothing"), "{difference}");
    }
}
