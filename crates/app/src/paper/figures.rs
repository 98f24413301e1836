//! Sections of the report that show the paper's figures again.

use sonoloop_types::Profile;

use super::sequence::Sequence;
use super::similarity::{self, Figure, Surface};
use super::updates::{STRATEGIES, Strategies, strategies};
use super::{
    FIGURE_1, FIGURE_2, FIGURE_3, FIGURE_4, FIGURE_5, Looked, Loss, Results, drawing, loss_figures, strips,
};
use crate::error::AppError;
use crate::page::{Block, Charts, Colour, Column, Panel, Row, Section, Series, StripPicture, Table};

/// Root mean square within which a strategy counts as holding the tip: the sequences' own bound of 0.6 mm.
const HELD_PX: f64 = 6.0;

/// Colours of the strategies.
const COLOURS: [Colour; 3] = [Colour::Orange, Colour::Red, Colour::Green];

/// Fig. 1 of the first picture, from half of the sequence on, in which the template and its shifts fit.
pub(super) fn surfaces(sequence: &Sequence) -> Result<Option<[Figure; 2]>, AppError> {
    for index in sequence.rows.len() / 2..sequence.rows.len() {
        let truth = &sequence.rows[index].truth;
        if !truth.visible {
            continue;
        }
        if let Some(figures) = similarity::figures(&sequence.image(index)?, truth.reference_px) {
            return Ok(Some(figures));
        }
    }
    Ok(None)
}

/// Fig. 2: all strategies, and by strategy pictures of the paper's configuration.
pub(super) fn updates(sequence: &Sequence) -> Result<([Strategies; 2], [Vec<StripPicture>; 3]), AppError> {
    const PICTURES: usize = 5;
    let both = strategies(sequence)?;
    let mut pictures = [const { Vec::new() }; 3];
    // Until the needle is at rest.
    let last = sequence.rows.iter().rposition(|row| row.truth.feed_m_s > 0.0).unwrap_or(0);
    for (k, (_, name)) in STRATEGIES.iter().enumerate() {
        for step in 1..=PICTURES {
            let index = step * last / PICTURES;
            let tip_px = both[0].tips_px[k][index];
            let error =
                both[0].errors_px[k][index].map_or_else(String::new, |px| format!(", off by {px:.1} px"));
            let caption = format!("{name}, image {index}{error}");
            pictures[k].push(strips::picture(sequence, index, Some((COLOURS[k], tip_px)), caption)?);
        }
    }
    Ok((both, pictures))
}

/// Figs 5 and 6: the loss, and its four pictures.
pub(super) fn loss(sequence: &Sequence) -> Result<Option<(Loss, Vec<StripPicture>)>, AppError> {
    let Some(loss) = super::loss::loss(sequence)? else { return Ok(None) };
    let labels = ["(a) ", "(b) ", "(c) ", "(d) "];
    let pictures = loss.marks.iter().zip(labels).map(|(index, label)| strips::one(sequence, *index, label));
    let pictures = pictures.collect::<Result<Vec<_>, _>>()?;
    Ok(Some((loss, pictures)))
}

/// All sections of figures, those whose sequence was not there left out.
pub(super) fn sections(results: &Results) -> Vec<Section> {
    let mut sections = Vec::new();
    let surfaces: Vec<_> = FIGURE_1
        .iter()
        .filter_map(|name| Some((results.of(name)?, results.of(name)?.surfaces.as_ref()?)))
        .collect();
    if !surfaces.is_empty() {
        sections.push(figure_1(&surfaces));
    }
    let updates = FIGURE_2.iter().filter_map(|name| {
        let looked = results.of(name)?;
        let (both, pictures) = looked.updates.as_ref()?;
        Some(figure_2(looked, both, pictures))
    });
    let blocks: Vec<_> = updates.flatten().collect();
    if !blocks.is_empty() {
        sections.push(Section::new("Fig. 2: three strategies of updating the template", blocks));
    }
    for (title, names) in [("Fig. 3: lateral tracking", FIGURE_3), ("Fig. 4: transverse tracking", FIGURE_4)]
    {
        let mut blocks = Vec::new();
        for looked in names.iter().filter_map(|name| results.of(name)) {
            let scenario = &looked.sequence.scenario;
            blocks.push(Block::Text(format!("{}: {}", scenario.name, scenario.description)));
            blocks.push(Block::Strip(looked.strip.clone()));
        }
        blocks.push(Block::Note("Box: the template where the tracker says the tip is. Cross: the true tip, where it is in the slice; in a transverse view where the needle's axis meets the plane.".into()));
        sections.push(Section::new(title, blocks));
    }
    let losses = FIGURE_5.iter().filter_map(|name| {
        let looked = results.of(name)?;
        let (loss, pictures) = looked.loss.as_ref()?;
        Some(loss_figures::blocks(looked, loss, pictures))
    });
    let blocks: Vec<_> = losses.flatten().collect();
    if !blocks.is_empty() {
        sections.push(Section::new("Figs 5 and 6: loss and recovery", blocks));
    }
    sections
}

fn figure_1(surfaces: &[(&Looked, &[Figure; 2])]) -> Section {
    let mut blocks = vec![Block::Text(
        "A template of 61 × 61 px about the tip is shifted by up to 20 px in each direction over the picture that it was cut \
         from: once as it is, once with the needle's pixels (more than three spreads over the background's median) at a tenth of their contrast over the \
         background. Bright is alike; the cross marks where each measure says most alike."
            .into(),
    )];
    let mut rows = Vec::new();
    for (looked, [whole, dimmed]) in surfaces {
        let medium = &looked.sequence.scenario.phantom.name;
        blocks.push(Block::Figure {
            svg: drawing::surfaces(&[("template", whole), ("needle dimmed", dimmed)]),
            caption: format!("{medium} ({})", looked.sequence.name()),
        });
        for (name, figure) in [("as it is", whole), ("needle dimmed", dimmed)] {
            let [ssd, scv, ncc] = figure.surfaces.each_ref().map(shift_text);
            rows.push(Row::new([medium.clone(), name.to_owned(), ssd, scv, ncc]));
        }
    }
    let columns = ["medium", "template"].map(Column::text).into_iter();
    let columns =
        columns.chain(["SSD, shift in px", "SCV, shift in px", "NCC, shift in px"].map(Column::number));
    blocks.push(Block::Table(Table { columns: columns.collect(), rows }));
    blocks.push(Block::Text(figure_1_text(surfaces)));
    Section::new("Fig. 1: measures of likeness when the needle's intensity changes", blocks)
}

fn shift_text(surface: &Surface) -> String {
    let ([u, v], distance_px) = surface.extremum_px();
    format!("({u}, {v}) = {distance_px:.1}")
}

fn figure_1_text(surfaces: &[(&Looked, &[Figure; 2])]) -> String {
    let mut text = "The paper: SSD and SCV have their minimum, NCC its maximum, in the middle; SSD is called very sensitive to \
                    changes of intensity, SCV and NCC robust. Measured with the needle dimmed:"
        .to_owned();
    for (looked, [_, dimmed]) in surfaces {
        let told =
            dimmed.surfaces.iter().map(|surface| match (surface.measure.name(), surface.extremum_px().1) {
                (name, 0.0) => format!("{name} stays"),
                (name, distance_px) => format!("{name} moves by {distance_px:.0} px"),
            });
        let told = told.collect::<Vec<_>>().join(", ");
        text += &format!(" in {} {told};", looked.sequence.scenario.phantom.name);
    }
    text.pop();
    text += ". Where speckle fills the template, it alone can hold an extremum in place, since the template meets the very \
             speckle that it was cut from; in a clear liquid the needle is all there is.";
    text
}

fn figure_2(looked: &Looked, both: &[Strategies; 2], pictures: &[Vec<StripPicture>; 3]) -> Vec<Block> {
    let x: Vec<f64> = (0..looked.sequence.rows.len()).map(|k| k as f64).collect();
    let panel = |strategies: &Strategies| Panel {
        title: format!("{}: tip error, px", profile_text(strategies.profile)),
        series: STRATEGIES
            .iter()
            .zip(COLOURS)
            .zip(&strategies.errors_px)
            .map(|(((_, name), colour), errors)| Series {
                label: (*name).to_owned(),
                colour,
                dotted: false,
                values: errors.clone(),
            })
            .collect(),
        levels: Vec::new(),
        at_least: [0.0, 10.0],
        at_most: [0.0, 60.0],
    };
    let charts = plain_charts(x, both.iter().map(panel).collect());
    let mut rows = Vec::new();
    for strategies in both {
        for ((_, name), (rms_px, last_px)) in STRATEGIES.iter().zip(strategies.rms_and_last_px()) {
            let cells = [
                profile_text(strategies.profile).to_owned(),
                (*name).to_owned(),
                format!("{rms_px:.1}"),
                format!("{last_px:.1}"),
            ];
            rows.push(Row::new(cells));
        }
    }
    let columns = vec![
        Column::text("configuration"),
        Column::text("strategy"),
        Column::number("error, RMS px"),
        Column::number("error at the end, px"),
    ];
    let scenario = &looked.sequence.scenario;
    let mut blocks = vec![
        Block::Text(format!(
            "The pictures of {} ({}), tracked again by each strategy from the same first tip; the tests for a loss are off, so that \
             each goes its own way.",
            scenario.name, scenario.phantom.name
        )),
        Block::Charts(Box::new(charts)),
        Block::Table(Table { columns, rows }),
        Block::Text(figure_2_text(both)),
    ];
    blocks.extend(pictures.iter().cloned().map(Block::Strip));
    blocks.push(Block::Note(
        "Pictures: the paper's configuration. Box: what the strategy says. Cross: the true tip, where it is in the slice.".into(),
    ));
    blocks
}

/// What the strategies come to, against the paper's order.
fn figure_2_text(both: &[Strategies; 2]) -> String {
    let mut text = "The paper: without an update tracking fails since the needle changes; the naive update drifts; the corrected \
                    one tracks."
        .to_owned();
    for strategies in both {
        let names = STRATEGIES.iter().zip(strategies.rms_and_last_px());
        let named = |holds: bool| {
            let those = names.clone().filter(|(_, (rms_px, _))| (*rms_px <= HELD_PX) == holds);
            let those: Vec<_> = those.map(|((_, name), _)| *name).collect();
            if those.is_empty() { "none".to_owned() } else { those.join(", ") }
        };
        text += &format!(
            " Measured, {}: within {HELD_PX} px RMS stay ({}), beyond go ({}).",
            profile_text(strategies.profile),
            named(true),
            named(false)
        );
    }
    let [[none, naive, corrected], [.., default_corrected]] =
        both.each_ref().map(|strategies| strategies.rms_and_last_px().map(|(rms_px, _)| rms_px <= HELD_PX));
    if none {
        text += " Without an update nothing fails here: the simulated tip looks alike all the way.";
    }
    if corrected && !naive {
        text += " That the naive update drifts and the correction holds is as told.";
    }
    if !corrected && default_corrected {
        text += " In the paper's configuration not even the corrected strategy holds the tip here; what differs in the default one, \
                 above all a narrow weight about the tip, does. All of the square counts alike without it, and most of the \
                 square is tissue that stands still.";
    }
    text
}

/// Panels over the number of the image.
pub(super) fn plain_charts(x: Vec<f64>, panels: Vec<Panel>) -> Charts {
    Charts {
        x_label: "image".into(),
        x,
        panels,
        band_kinds: Vec::new(),
        bands: Vec::new(),
        moments: Vec::new(),
        pictures: None,
    }
}

/// A profile in words.
pub(super) fn profile_text(profile: Profile) -> &'static str {
    match profile {
        Profile::Paper => "paper's configuration",
        Profile::Robust => "default configuration",
    }
}
