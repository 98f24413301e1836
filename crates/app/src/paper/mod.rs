//! The paper's experiments: Kaya, Senel, Ahmad and Bebek, "Visual Tracking of Biopsy Needles in 2D Ultrasound Images".
//!
//! Twenty sequences are run in closed loop; its figures, its Table I and its claims are made again from their pictures, and
//! what comes out is told beside what the paper says. Nothing here judges by itself: every sentence on a result is made from
//! the numbers of this very run.

mod data;
mod drawing;
mod earlier;
mod figures;
mod loss;
mod loss_figures;
mod report;
mod sequence;
mod similarity;
mod strips;
mod studies;
mod study_sections;
mod tables;
mod timing;
mod updates;

use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::Instant;

use crate::error::{AppError, Outcome};
use crate::output::Stage;
use crate::page::StripPicture;
use crate::parallel;
use crate::scenarios::{find, prepare};
use earlier::Comparison;
use loss::Loss;
use sequence::Sequence;
use similarity::Figure;
use updates::Strategies;

/// The report's name; it stands for all files of the folder.
const REPORT: &str = "report.html";
/// Runs at a time.
const JOBS: usize = 2;

/// Whose pictures the figures are made of.
const FIGURE_1: [&str; 3] = ["lateral_14", "lateral_08", "lateral_04"];
const FIGURE_2: [&str; 2] = ["lateral_01", "lateral_14"];
const FIGURE_3: [&str; 2] = ["lateral_03", "lateral_07"];
const FIGURE_4: [&str; 2] = ["transverse_02", "transverse_03"];
const FIGURE_5: [&str; 2] = ["lateral_05", "lateral_11"];
const TABLE_I: &str = "lateral_14";

/// A sequence, and what was made of its pictures.
struct Looked {
    sequence: Sequence,
    /// Figs 3 and 4.
    strip: Vec<StripPicture>,
    /// Fig. 1.
    surfaces: Option<[Figure; 2]>,
    /// Fig. 2, and pictures by strategy.
    updates: Option<([Strategies; 2], [Vec<StripPicture>; 3])>,
    /// Figs 5 and 6.
    loss: Option<(Loss, Vec<StripPicture>)>,
    comparison: Option<Comparison>,
}

/// All that the report tells.
struct Results {
    sequences: Vec<Looked>,
    timing: Vec<timing::Cell>,
    studies: Option<studies::Studies>,
}

/// Runs everything and writes report and data into `out`; fails when a sequence does.
pub fn paper(scenarios: &Path, out: &Path, with_studies: bool) -> Result<Outcome, AppError> {
    let began = Instant::now();
    let files = find(&[scenarios.to_owned()])?;
    for file in &files {
        // Everything is checked before anything runs.
        prepare(file, None, &[])?;
    }
    let stage = Stage::ending_with(out, REPORT).map_err(AppError::fault)?;
    let sequences = sequences(&files)?;
    eprintln!("timing SSD and SCV");
    let timed = sequences.iter().find(|looked| looked.sequence.name() == TABLE_I);
    let timing = timed.map(|looked| timing::table(&looked.sequence)).transpose()?.unwrap_or_default();
    let say = |text: &str| eprintln!("{text}");
    let studies = with_studies.then(|| studies::studies(&files, JOBS, &say)).transpose()?;
    let results = Results { sequences, timing, studies };
    let mut names = Vec::new();
    for (name, text) in data::files(&results) {
        stage.write(&name, text).map_err(AppError::fault)?;
        names.push(name);
    }
    let page = report::page(&results, &names, began.elapsed().as_secs_f64());
    stage.write(REPORT, page.html().map_err(AppError::fault)?).map_err(AppError::fault)?;
    stage.publish(&[]).map_err(AppError::fault)?;
    eprintln!("{} after {:.0} s", out.join(REPORT).display(), began.elapsed().as_secs_f64());
    crate::say::say(report::verdict_text(&results));
    let all = results.sequences.iter().all(|looked| looked.sequence.passed());
    Ok(if all { Outcome::Pass } else { Outcome::Fail })
}

fn sequences(files: &[PathBuf]) -> Result<Vec<Looked>, AppError> {
    let done = AtomicUsize::new(0);
    let results = parallel::each(JOBS, files, |file| {
        let looked = Sequence::run(file).and_then(look)?;
        let done = 1 + done.fetch_add(1, Ordering::Relaxed);
        let Sequence { scenario, rows, .. } = &looked.sequence;
        let verdict = if looked.sequence.passed() { "PASS" } else { "FAIL" };
        let failures = looked.sequence.failures();
        eprintln!(
            "{done:>2}/{}  {verdict}  {:<14} {} images  {failures}",
            files.len(),
            scenario.name,
            rows.len()
        );
        Ok(looked)
    });
    results.into_iter().collect()
}

/// Makes what the report needs of a sequence's pictures, and lets those go that nobody needs.
fn look(mut sequence: Sequence) -> Result<Looked, AppError> {
    let name = sequence.name().to_owned();
    let is_shown = FIGURE_3.iter().chain(&FIGURE_4).any(|shown| *shown == name);
    let strip = if is_shown { strips::even(&sequence)? } else { Vec::new() };
    let surfaces = if FIGURE_1.contains(&name.as_str()) { figures::surfaces(&sequence)? } else { None };
    let updates = if FIGURE_2.contains(&name.as_str()) { Some(figures::updates(&sequence)?) } else { None };
    let loss = if FIGURE_5.contains(&name.as_str()) { figures::loss(&sequence)? } else { None };
    let comparison = earlier::compare(&sequence)?;
    if name != TABLE_I {
        sequence.pixels = None;
    }
    Ok(Looked { sequence, strip, surfaces, updates, loss, comparison })
}
