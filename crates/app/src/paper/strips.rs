//! Strips of pictures with what was said of them.

use sonoloop_types::TrackState;

use super::sequence::Sequence;
use crate::error::AppError;
use crate::output::{Setting, jpeg};
use crate::page::{Colour, Picture, Shape, StripPicture};

/// Pictures of a strip that shows a whole sequence.
const EVEN: usize = 6;

/// Pictures evenly over the sequence, with the template's box and the true tip.
pub(super) fn even(sequence: &Sequence) -> Result<Vec<StripPicture>, AppError> {
    let last = sequence.rows.len().saturating_sub(1);
    (0..EVEN).map(|k| one(sequence, k * last / (EVEN - 1), "")).collect()
}

/// Picture `index` with what the sequence's own tracker said; `label` begins its caption.
pub(super) fn one(sequence: &Sequence, index: usize, label: &str) -> Result<StripPicture, AppError> {
    let row = &sequence.rows[index];
    let estimate = row.command.map(|command| command.estimate);
    let (colour, state) = match row.state() {
        Some(TrackState::Tracking) => (Colour::Green, "tracking"),
        Some(TrackState::Lost) => (Colour::Red, "lost"),
        Some(TrackState::Recovering) => (Colour::Amber, "candidate"),
        Some(TrackState::Searching) => (Colour::Blue, "searching"),
        None => (Colour::Grey, "no answer"),
    };
    let ncc = estimate.and_then(|estimate| estimate.ncc_previous);
    let ncc = ncc.map_or_else(String::new, |ncc| format!(", NCC {ncc:.2}"));
    let box_at = estimate.and_then(|estimate| estimate.tip_px).map(|at| (colour, at));
    picture(sequence, index, box_at, format!("{label}image {index}, {state}{ncc}"))
}

/// Picture `index` with a box of the template's size.
pub(super) fn picture(
    sequence: &Sequence,
    index: usize,
    box_at: Option<(Colour, [f64; 2])>,
    caption: String,
) -> Result<StripPicture, AppError> {
    let image = sequence.image(index)?;
    let truth = &sequence.rows[index].truth;
    let [left, right] = Setting::of(&sequence.scenario).columns_px.map(f64::from);
    let template = Shape::Box { side_px: f64::from(sequence.scenario.tracker.template_px) };
    let mut marks: Vec<_> = box_at.map(|(colour, at)| (template, colour, at)).into_iter().collect();
    if truth.visible {
        marks.push((Shape::Cross, Colour::Turquoise, truth.reference_px));
    }
    Ok(StripPicture {
        picture: Picture::from_jpeg(&jpeg(&image).map_err(AppError::fault)?),
        size_px: [image.width_px, image.height_px],
        shown_px: [left, 0.0, right - left, f64::from(image.height_px)],
        marks,
        caption,
    })
}
