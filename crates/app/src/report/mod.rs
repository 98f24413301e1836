//! `report.html` of a run, made from the other files in its folder and from nothing else.

mod curves;
mod files;
mod keys;
mod player;
mod sections;

pub use files::{Files, FilesError, ImageLine, parse_csv, read_summary, read_text};

use std::path::Path;

use crate::output::Verdict;
use crate::page::{Mark, Page, PageError};

/// Name of the page.
pub const REPORT: &str = "report.html";

/// The report of a run cannot be made.
#[derive(Debug, thiserror::Error)]
pub enum ReportError {
    /// A file that it is made from is missing or damaged.
    #[error(transparent)]
    Files(#[from] FilesError),
    /// The page itself.
    #[error(transparent)]
    Page(#[from] PageError),
}

/// The page of the run in `folder`.
pub fn page(folder: &Path) -> Result<String, ReportError> {
    let files = Files::read(folder)?;
    let summary = &files.summary;
    let sections = [
        sections::metrics(&files),
        sections::pictures(&files),
        sections::over_time(&files),
        sections::events(&files),
        sections::timing(&files),
        sections::assumptions(),
        sections::scenario(&files),
    ];
    let page = Page {
        title: summary.scenario.clone(),
        verdict: Some((Mark::of(summary.verdict == Verdict::Pass), sections::verdict_text(summary))),
        lead: summary.setting.description.clone(),
        facts: sections::facts(summary),
        sections: sections.into(),
    };
    Ok(page.html()?)
}
