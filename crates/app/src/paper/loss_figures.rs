//! Figs 5 and 6 on the page.

use sonoloop_types::TrackState;

use super::figures::plain_charts;
use super::{Looked, Loss};
use crate::page::{Band, BandKind, Block, Colour, Level, Moment, Panel, Series, StripPicture};

/// Pictures, curves and text of one loss.
pub(super) fn blocks(looked: &Looked, loss: &Loss, pictures: &[StripPicture]) -> Vec<Block> {
    let rows = &looked.sequence.rows;
    let estimate = |value: &dyn Fn(&sonoloop_types::Estimate) -> Option<f64>| -> Vec<Option<f64>> {
        rows.iter().map(|row| row.command.as_ref().and_then(|command| value(&command.estimate))).collect()
    };
    let series =
        |label: &str, colour, dotted, values| Series { label: label.to_owned(), colour, dotted, values };
    let panel = Panel {
        title: "NCC".into(),
        series: vec![
            series(
                "with the last template",
                Colour::Blue,
                false,
                estimate(&|estimate| estimate.ncc_previous),
            ),
            series(
                "with the first template",
                Colour::Orange,
                false,
                estimate(&|estimate| estimate.ncc_anchor),
            ),
            series(
                "with the last, paper's configuration on the same pictures",
                Colour::Grey,
                true,
                loss.paper_ncc.clone(),
            ),
        ],
        levels: vec![
            Level { label: "lost below 0.8".into(), colour: Colour::Red, value: 0.8 },
            Level { label: "found again from 0.75 (paper)".into(), colour: Colour::Green, value: 0.75 },
        ],
        at_least: [0.0, 1.0],
        at_most: [-0.5, 1.0],
    };
    let mut charts = plain_charts((0..rows.len()).map(|k| k as f64).collect(), vec![panel]);
    charts.band_kinds = [("tracking", Colour::Green), ("lost", Colour::Red), ("candidate", Colour::Amber)]
        .map(|(label, colour)| BandKind { label: label.into(), colour })
        .into();
    let mut at = 0;
    for stretch in rows.chunk_by(|a, b| a.state() == b.state()) {
        let kind = match stretch[0].state() {
            Some(TrackState::Tracking) => Some(0),
            Some(TrackState::Lost) => Some(1),
            Some(TrackState::Recovering) => Some(2),
            _ => None,
        };
        let (from, to) = (at as f64, (at + stretch.len()) as f64);
        charts.bands.extend(kind.map(|kind| Band { from, to, kind }));
        at += stretch.len();
    }
    charts.moments = loss
        .marks
        .iter()
        .zip(["(a)", "(b)", "(c)", "(d)"])
        .map(|(index, label)| Moment { at: *index as f64, colour: Colour::Purple, label: label.into() })
        .collect();
    let scenario = &looked.sequence.scenario;
    let [_, b, _, d] = loss.marks;
    vec![
        Block::Text(format!(
            "{}, seed {}: {} Declared lost at image {b}, tracked again from image {d}. While it is lost NCC is that of the best \
             candidate, where there is one.",
            scenario.name, scenario.seed, scenario.description
        )),
        Block::Strip(pictures.to_vec()),
        Block::Charts(Box::new(charts)),
        Block::Text(format!(
            "The paper: NCC near 1 in the plane, lost below 0.8, found again at 0.75. The default configuration asks 0.85 of a recovery \
             and three images that confirm it, since found again at 0.75 a tip would be lost by the next image's 0.8. {}",
            paper_loss_text(loss)
        )),
    ]
}

/// What the paper's configuration says on the same pictures.
fn paper_loss_text(loss: &Loss) -> String {
    const BELOW: f64 = 0.8;
    // An image or two may lie between what both notice.
    const ABOUT_IMAGES: usize = 5;
    let [_, b, _, d] = loss.marks;
    let is_below = |ncc: &Option<f64>| ncc.is_some_and(|ncc| ncc < BELOW);
    match loss.paper_ncc.iter().position(is_below) {
        Some(first) if first + ABOUT_IMAGES < b => format!(
            "The paper's configuration falls below {BELOW} at image {first} already, with the needle still in the plane: it has left \
             the tip before the loss."
        ),
        Some(first) if first < d => {
            let end = loss
                .paper_off_mm
                .map_or_else(|| "says nothing".to_owned(), |mm| format!("is {mm:.1} mm from the true tip"));
            format!(
                "The paper's configuration falls below {BELOW} at image {first}, as told; at the end it {end}."
            )
        }
        _ => format!(
            "The paper's configuration does not fall below {BELOW} at the loss: what it holds on to is not the tip."
        ),
    }
}
