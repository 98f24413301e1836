//! One of the sequences: run, judged, its pictures at hand.

use std::path::Path;

use sonoloop_scenario::{DisturbanceKind, Scenario};
use sonoloop_types::{Image, TrackState, View};

use crate::commands::run_id;
use crate::controller::ControllerKind;
use crate::error::AppError;
use crate::judge::{Facts, Judged, Metrics, metrics, passes, verdict};
use crate::output::failure_text;
use crate::peer::InProcess;
use crate::record::{ImageRow, ImageStore};
use crate::scenarios::prepare;
use crate::session::{Nobody, kills_tracker};

/// A sequence that was run.
pub(super) struct Sequence {
    pub scenario: Scenario,
    pub metrics: Metrics,
    pub judged: Vec<Judged>,
    pub rows: Vec<ImageRow>,
    /// In the order of the rows; `None` when nobody needs them any more.
    pub pixels: Option<ImageStore>,
}

impl Sequence {
    /// Runs a scenario in this process and keeps its pictures.
    pub fn run(file: &Path) -> Result<Self, AppError> {
        let (scenario, session) = prepare(file, None, &[])?;
        let pixels = ImageStore::new().map_err(AppError::fault)?;
        let mut peer = InProcess::new(ControllerKind::Tracker, kills_tracker(&scenario));
        let (mut recording, error) = session.run(run_id(), &mut peer, &mut Nobody, Some(pixels));
        if let Some(error) = error {
            return Err(AppError::fault(error));
        }
        let metrics = metrics(&recording, &Facts::of(&scenario));
        let judged = verdict(&metrics, &scenario.expect);
        let pixels = recording.pixels.take();
        Ok(Self { scenario, metrics, judged, rows: recording.images, pixels })
    }

    /// The picture of a row.
    pub fn image(&self, index: usize) -> Result<Image, AppError> {
        let gone = || AppError::fault("the pictures of this sequence are gone");
        self.pixels.as_ref().ok_or_else(gone)?.get(index).map_err(AppError::fault)
    }

    pub fn name(&self) -> &str {
        &self.scenario.name
    }

    pub fn passed(&self) -> bool {
        passes(&self.judged)
    }

    /// What failed, in words; empty where nothing did.
    pub fn failures(&self) -> String {
        let failed = self.judged.iter().filter(|judged| !judged.pass);
        failed.map(failure_text).collect::<Vec<_>>().join(", ")
    }

    pub fn view_text(&self) -> &'static str {
        match self.scenario.view {
            View::Lateral => "lateral",
            View::Transverse => "transverse",
        }
    }

    pub fn insertion_text(&self) -> &'static str {
        if self.scenario.insertion.hand.is_some() { "hand" } else { "robot" }
    }

    /// Stretches of LOST and RECOVERING, as first image and the first one after; the last may end with the recording.
    pub fn lost_stretches(&self) -> Vec<(usize, usize)> {
        let is_lost = |row: &ImageRow| matches!(row.state(), Some(TrackState::Lost | TrackState::Recovering));
        let mut at = 0;
        let chunks = self.rows.chunk_by(|a, b| is_lost(a) == is_lost(b)).map(|chunk| {
            let first = at;
            at += chunk.len();
            (is_lost(&chunk[0]), first, at)
        });
        chunks.filter(|(lost, ..)| *lost).map(|(_, first, end)| (first, end)).collect()
    }

    /// True when the tip is tracked at the end.
    pub fn ends_tracking(&self) -> bool {
        self.rows.last().is_some_and(ImageRow::is_tracking)
    }

    /// What goes wrong, in a few words.
    pub fn disturbances_text(&self) -> String {
        let mut words: Vec<(&str, usize)> = Vec::new();
        for disturbance in &self.scenario.disturbances {
            let word = match disturbance.kind {
                DisturbanceKind::ProbeKnock { .. } => "probe slips",
                DisturbanceKind::LiftOff { .. } => "probe lifted off",
                DisturbanceKind::GainChange { .. } => "gain steps",
                DisturbanceKind::NeedleBrightness { .. } => "needle's echo steps",
                _ => "other",
            };
            match words.iter_mut().find(|(known, _)| *known == word) {
                Some((_, count)) => *count += 1,
                None => words.push((word, 1)),
            }
        }
        let times = |(word, count): &(&str, usize)| {
            if *count == 1 { (*word).to_owned() } else { format!("{word} {count}×") }
        };
        let text = words.iter().map(times).collect::<Vec<_>>().join(", ");
        if text.is_empty() { "–".to_owned() } else { text }
    }
}
