//! Which curves of a run are plotted.

use sonoloop_scenario::Scenario;
use sonoloop_types::{EventKind, TICKS_PER_SECOND, TrackState};

use super::plot::{Band, Curve, Level, Moment, Panel, svg};
use crate::judge::{WRONG_BEYOND_M, tip_error_px};
use crate::record::{ImageRow, Recording, TickRow};

const BLUE: &str = "#1f5fbf";
const ORANGE: &str = "#c2570c";
const RED: &str = "#c22f2a";
const GREEN: &str = "#2c7a3d";

/// Tip error, distance to the plane and NCCs over time, behind them the tracker's state.
pub(super) fn tracking_svg(scenario: &Scenario, recording: &Recording) -> String {
    let images = &recording.images;
    let spacing_mm = scenario.probe.geometry.spacing_m * 1e3;
    let error = |row: &ImageRow| {
        let is_judged = row.truth.visible && row.is_tracking();
        tip_error_px(row).filter(|_| is_judged).map(|px| px * spacing_mm)
    };
    let half_slice_mm =
        |row: &ImageRow| Some(scenario.probe.slice_thickness_m(row.truth.tip_in_probe.z) * 0.5e3);
    let level = |label: &str, colour, value| Level { label: label.to_owned(), colour, value };
    let error_panel = Panel {
        title: "tip error, mm",
        curves: vec![Curve { label: "tip error", colour: BLUE, points: by_image(images, error) }],
        levels: vec![level("wrong beyond", RED, WRONG_BEYOND_M * 1e3)],
        at_least: [0.0, 0.5],
        at_most: [0.0, 4.0],
    };
    let plane = |row: &ImageRow| Some(row.truth.plane_to_tip_m * 1e3);
    let plane_panel = Panel {
        title: "plane to tip, mm",
        curves: vec![
            Curve { label: "plane to tip", colour: BLUE, points: by_image(images, plane) },
            Curve { label: "half the slice", colour: GREEN, points: by_image(images, half_slice_mm) },
            Curve {
                label: "",
                colour: GREEN,
                points: by_image(images, |row| half_slice_mm(row).map(|half| -half)),
            },
        ],
        levels: vec![],
        at_least: [-1.5, 1.5],
        at_most: [-10.0, 10.0],
    };
    let estimate = |row: &ImageRow| row.command.map(|command| command.estimate);
    let ncc_panel = Panel {
        title: "NCC",
        curves: vec![
            Curve {
                label: "previous",
                colour: BLUE,
                points: by_image(images, |row| estimate(row)?.ncc_previous),
            },
            Curve {
                label: "anchor",
                colour: ORANGE,
                points: by_image(images, |row| estimate(row)?.ncc_anchor),
            },
        ],
        levels: vec![
            level("loss, previous", BLUE, scenario.tracker.loss_ncc_previous),
            level("loss, anchor", ORANGE, scenario.tracker.loss_ncc_anchor),
        ],
        at_least: [0.0, 1.0],
        at_most: [-1.0, 1.0],
    };
    let panels = [error_panel, plane_panel, ncc_panel];
    svg(&panels, &bands(recording), &moments(recording), end_s(recording))
}

/// Depth and contact force over time.
pub(super) fn insertion_svg(scenario: &Scenario, recording: &Recording) -> String {
    let target_mm = scenario.insertion.target_depth_m * 1e3;
    let depth_panel = Panel {
        title: "depth, mm",
        curves: vec![Curve {
            label: "depth",
            colour: BLUE,
            points: by_tick(&recording.ticks, |row| row.depth_m * 1e3),
        }],
        levels: vec![Level { label: "target".to_owned(), colour: GREEN, value: target_mm }],
        at_least: [0.0, target_mm],
        at_most: [0.0, f64::MAX],
    };
    let feed_panel = Panel {
        title: "feed, mm/s",
        curves: vec![Curve {
            label: "feed",
            colour: BLUE,
            points: by_tick(&recording.ticks, |row| row.feed_m_s * 1e3),
        }],
        levels: vec![],
        at_least: [0.0, 1.0],
        at_most: [-100.0, 100.0],
    };
    let limit_n = scenario.limits.max_contact_force_n;
    let force_panel = Panel {
        title: "contact force, N",
        curves: vec![Curve {
            label: "contact force",
            colour: ORANGE,
            points: by_tick(&recording.ticks, |row| row.contact_force_n),
        }],
        levels: vec![Level { label: "limit".to_owned(), colour: RED, value: limit_n }],
        at_least: [0.0, limit_n],
        at_most: [-1.0, 3.0 * limit_n],
    };
    let panels = [depth_panel, feed_panel, force_panel];
    svg(&panels, &bands(recording), &moments(recording), end_s(recording))
}

fn seconds(tick: u64) -> f64 {
    tick as f64 / TICKS_PER_SECOND as f64
}

fn end_s(recording: &Recording) -> f64 {
    let last_image = recording.images.last().map(|row| row.acquisition.publication_tick);
    seconds(recording.ticks.last().map(|row| row.tick).max(last_image).unwrap_or(0))
}

fn by_image(images: &[ImageRow], value: impl Fn(&ImageRow) -> Option<f64>) -> Vec<(f64, Option<f64>)> {
    images.iter().map(|row| (seconds(row.acquisition.acquisition_tick), value(row))).collect()
}

/// Every tenth tick: finer than the drawing shows.
fn by_tick(ticks: &[TickRow], value: impl Fn(&TickRow) -> f64) -> Vec<(f64, Option<f64>)> {
    ticks.iter().step_by(10).map(|row| (seconds(row.tick), Some(value(row)))).collect()
}

/// One band per stretch of equal state.
fn bands(recording: &Recording) -> Vec<Band> {
    let images = &recording.images;
    let mut bands = Vec::new();
    let mut start = 0;
    for stretch in images.chunk_by(|a, b| a.state() == b.state()) {
        let from_s = seconds(stretch[0].acquisition.publication_tick);
        start += stretch.len();
        let until = images.get(start).map(|row| seconds(row.acquisition.publication_tick));
        let colour = match stretch[0].state() {
            Some(TrackState::Tracking) => "#e6f5e9",
            Some(TrackState::Lost) => "#fbdedb",
            Some(TrackState::Recovering) => "#fff0cc",
            Some(TrackState::Searching) => "#e0ebfb",
            None => "#dddddd",
        };
        bands.push(Band { from_s, to_s: until.unwrap_or_else(|| end_s(recording)), colour });
    }
    bands
}

/// Scripted disturbances, named by the first words of their event.
fn moments(recording: &Recording) -> Vec<Moment> {
    let is_shown = |kind| matches!(kind, EventKind::Disturbance | EventKind::TrackerKilled);
    let events = recording.events.iter().filter(|event| is_shown(event.kind));
    events
        .map(|event| {
            let label = match event.detail.char_indices().nth(28) {
                Some((end, _)) => format!("{}…", &event.detail[..end]),
                None => event.detail.clone(),
            };
            Moment { at_s: seconds(event.tick), label }
        })
        .collect()
}
