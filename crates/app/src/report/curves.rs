//! Curves of a run over time, behind them the tracker's state.

use sonoloop_types::{Event, EventKind, TICKS_PER_SECOND, TrackState};

use super::{Files, ImageLine};
use crate::judge::WRONG_BEYOND_M;
use crate::page::{Band, BandKind, Charts, Colour, Level, Moment, Panel, Series};

/// States in the order of the legend; `None` while the tracker is down.
const STATES: [(Option<TrackState>, &str, Colour); 5] = [
    (Some(TrackState::Tracking), "tracking", Colour::Green),
    (Some(TrackState::Lost), "lost", Colour::Red),
    (Some(TrackState::Recovering), "recovering", Colour::Amber),
    (Some(TrackState::Searching), "searching", Colour::Blue),
    (None, "no answer", Colour::Grey),
];

/// Simulated time of a tick.
pub(super) fn seconds(tick: u64) -> f64 {
    tick as f64 / TICKS_PER_SECOND as f64
}

/// A state in words.
pub(super) fn state_text(state: Option<TrackState>) -> &'static str {
    STATES[kind(state)].1
}

/// The colour of a state.
pub(super) fn state_colour(state: Option<TrackState>) -> Colour {
    STATES[kind(state)].2
}

fn kind(state: Option<TrackState>) -> usize {
    STATES.iter().position(|(known, ..)| *known == state).unwrap_or(STATES.len() - 1)
}

/// All panels, without pictures.
pub(super) fn charts(files: &Files) -> Charts {
    let (images, setting) = (&files.images, &files.summary.setting);
    let series = |label: &str, colour, value: &dyn Fn(&ImageLine) -> Option<f64>| Series {
        label: label.to_owned(),
        colour,
        dotted: false,
        values: images.iter().map(|row| value(row).filter(|value| value.is_finite())).collect(),
    };
    let level = |label: &str, colour, value| Level { label: label.to_owned(), colour, value };
    let panel = |title: &str, series, levels, at_least, at_most| Panel {
        title: title.to_owned(),
        series,
        levels,
        at_least,
        at_most,
    };
    let spacing_mm = setting.spacing_mm;
    let tip_error_mm = |row: &ImageLine| {
        let is_judged = row.visible == 1 && row.is_tracking();
        row.tip_error_px().filter(|_| is_judged).map(|px| px * spacing_mm)
    };
    let half_slice = |sign: f64| Series {
        dotted: true,
        ..series(if sign > 0.0 { "half the slice" } else { "" }, Colour::Green, &|row| {
            Some(sign * row.half_slice_mm)
        })
    };
    let panels = vec![
        panel(
            "NCC",
            vec![
                series("with the previous template", Colour::Blue, &|row| row.ncc_previous),
                series("with the first", Colour::Orange, &|row| row.ncc_anchor),
            ],
            vec![
                level("lost below", Colour::Blue, setting.loss_ncc_previous),
                level("lost below", Colour::Orange, setting.loss_ncc_anchor),
            ],
            [0.0, 1.0],
            [-1.0, 1.0],
        ),
        panel(
            "Change of brightness at the tip",
            vec![series("0 = none", Colour::Purple, &|row| row.brightness_ratio)],
            setting
                .loss_brightness_ratio
                .map(|at| level("lost from", Colour::Purple, at))
                .into_iter()
                .collect(),
            [0.0, 1.0],
            [0.0, 2.0],
        ),
        panel(
            "Tip error, mm",
            vec![series("visible and tracking", Colour::Blue, &tip_error_mm)],
            vec![level("wrong beyond", Colour::Red, WRONG_BEYOND_M * 1e3)],
            [0.0, 0.5],
            [0.0, 4.0],
        ),
        panel(
            "Plane to tip, mm",
            vec![
                series("offset", Colour::Blue, &|row| Some(row.plane_offset_mm)),
                half_slice(1.0),
                half_slice(-1.0),
            ],
            vec![],
            [-1.5, 1.5],
            [-20.0, 20.0],
        ),
        panel(
            "Contact force, N",
            vec![series("true", Colour::Orange, &|row| Some(row.force_n))],
            vec![level("limit", Colour::Red, setting.max_contact_force_n)],
            [0.0, 1.0],
            [0.0, 3.0 * setting.max_contact_force_n],
        ),
        panel(
            "Insertion depth, mm",
            vec![series("true", Colour::Blue, &|row| Some(row.depth_mm))],
            vec![level("target", Colour::Green, setting.target_depth_mm)],
            [images.first().map_or(0.0, |row| row.depth_mm), setting.target_depth_mm],
            [0.0, f64::MAX],
        ),
    ];
    let (band_kinds, bands) = bands(files);
    Charts {
        x_label: "time, s".to_owned(),
        x: images.iter().map(|row| seconds(row.tick)).collect(),
        panels,
        band_kinds,
        bands,
        moments: files.events.iter().filter_map(moment).collect(),
        pictures: None,
    }
}

/// One band per stretch of equal state, by when the images were taken; the legend knows the states that occur.
fn bands(files: &Files) -> (Vec<BandKind>, Vec<Band>) {
    let images = &files.images;
    let occurs = |state: &Option<TrackState>| images.iter().any(|row| row.state == *state);
    let known: Vec<_> = STATES.iter().filter(|(state, ..)| occurs(state)).collect();
    let mut bands = Vec::new();
    let mut end = 0;
    for stretch in images.chunk_by(|a, b| a.state == b.state) {
        end += stretch.len();
        let next = images.get(end).map(|row| row.tick);
        let last_ms = files.summary.setting.image_period_ms;
        bands.push(Band {
            from: seconds(stretch[0].tick),
            to: next.map_or_else(|| seconds(stretch[stretch.len() - 1].tick) + last_ms * 1e-3, seconds),
            kind: known.iter().position(|(state, ..)| *state == stretch[0].state).unwrap_or(0),
        });
    }
    let kinds =
        known.iter().map(|(_, label, colour)| BandKind { label: (*label).to_owned(), colour: *colour });
    (kinds.collect(), bands)
}

/// What befell the run from outside, and what stopped it; the rest is in the table of events.
fn moment(event: &Event) -> Option<Moment> {
    let colour = match event.kind {
        EventKind::Disturbance | EventKind::TrackerKilled => Colour::Orange,
        EventKind::TrackerRestarted => Colour::Green,
        EventKind::Watchdog
        | EventKind::NeedleBlocked
        | EventKind::Collision
        | EventKind::ForceLimit
        | EventKind::Unreachable => Colour::Red,
        EventKind::StateChange
        | EventKind::CommandRefused
        | EventKind::NeedleStopped
        | EventKind::NeedleResumed
        | EventKind::Puncture
        | EventKind::Control
        | EventKind::End => return None,
    };
    Some(Moment { at: seconds(event.tick), colour, label: event.detail.clone() })
}
