//! The report: everything on one page.

use super::{Looked, Results, figures, study_sections, tables};
use crate::page::{Block, Mark, Page, Section};

impl Results {
    /// A sequence by its name.
    pub(super) fn of(&self, name: &str) -> Option<&Looked> {
        self.sequences.iter().find(|looked| looked.sequence.name() == name)
    }
}

/// How many passed.
pub(super) fn verdict_text(results: &Results) -> String {
    let passed = results.sequences.iter().filter(|looked| looked.sequence.passed()).count();
    format!("{passed} of {} sequences pass", results.sequences.len())
}

/// The page; `files` are the names of the data beside it.
pub(super) fn page(results: &Results, files: &[String], took_s: f64) -> Page {
    let images: usize = results.sequences.iter().map(|looked| looked.sequence.rows.len()).sum();
    let all = results.sequences.iter().all(|looked| looked.sequence.passed());
    let mut sections = vec![tables::results(results)];
    sections.extend(figures::sections(results));
    sections.push(tables::table_1(&results.timing));
    sections.push(tables::earlier(results));
    sections.extend(results.studies.iter().flat_map(study_sections::sections));
    sections.push(differences());
    let names = files.join(", ");
    sections.push(Section::new("Data", vec![Block::Text(format!("Beside this page: {names}."))]));
    Page {
        title: "The paper's experiments in closed loop".into(),
        verdict: Some((Mark::of(all), verdict_text(results))),
        lead: "Kaya, Senel, Ahmad and Bebek, “Visual Tracking of Biopsy Needles in 2D Ultrasound Images”: its twenty sequences, \
               figures, table and claims, made again by simulation, with what the paper says beside what was measured."
            .into(),
        facts: vec![
            format!("sonoloop {}", env!("CARGO_PKG_VERSION")),
            format!("{images} images"),
            format!("{took_s:.0} s"),
        ],
        sections,
    }
}

/// What is not as in the paper whatever comes out.
fn differences() -> Section {
    let terms = [
        (
            "Pictures",
            "Simulated: speckle, slice thickness, attenuation and needle echoes as documented, several of them with assumed constants. \
             The paper's were taken with a GE LOGIQ P5 and an 11L probe, for which an L12-3v stands here.",
        ),
        (
            "Tracker",
            "The sequences are steered by the default configuration (weights, tests on brightness and on the first template, \
             confirmed recovery); the paper's own is what the curves named so show, with the slips of its equations corrected.",
        ),
        (
            "Sound speed",
            "The scanner is set to 1483 m/s for it, which 1540 m/s would draw 4 % too deep, and to 1510 m/s for gelatin; else it assumes \
             1540 m/s.",
        ),
        (
            "By hand",
            "Lateral sequences alone. In a transverse view the plane follows the tip by the measured depth, which a hand does not give: \
             tried with ten seeds in gelatin-agar, no run came to its target.",
        ),
    ];
    let terms = terms.map(|(term, text)| (term.to_owned(), text.to_owned())).into();
    Section::new("What differs from the paper", vec![Block::Terms(terms)])
}
