//! The parts of a run's page, in words and tables.

use sonoloop_scenario::METRICS;
use sonoloop_types::{EndReason, Event, EventKind, View};

use super::Files;
use super::curves::{charts, seconds};
use super::player::{player, stride, strip};
use crate::output::{self, GIF, MP4, PICTURES, Summary, bound_text, snake, value_text};
use crate::page::{Block, Column, Mark, Row, Section, Table};

/// Lists of events beyond this length are cut on the page; `events.csv` has them all.
const MOST_EVENTS: usize = 200;

/// Which numbers rest on what; a page that is passed on must say so itself.
const ASSUMPTIONS: [(&str, &str); 6] = [
    (
        "Everything",
        "Synthetic images of a synthetic phantom. A pass here says that a method holds in this model, not \
         that it holds in tissue.",
    ),
    (
        "coverage, losses, detection delay",
        "depend on the slice thickness of the probe, on the needle's echo levels and on the noise level. \
         They are assumed values in the probe and needle files, not measurements of one scanner.",
    ),
    (
        "tip error, NCC",
        "depend on speckle, attenuation and sound speed of the phantom's materials: published ranges for \
         gelatin and agar, the value within a range assumed.",
    ),
    (
        "plane to tip, target distance",
        "depend on the needle's curvature and on the standard deviations of the calibration errors: assumed.",
    ),
    (
        "contact force",
        "comes from a closed formula for a flat punch on a soft block with a published modulus; friction and \
         viscosity are simplified.",
    ),
    (
        "travel, recovery time",
        "depend on accelerations and jerks of arm and needle robot, which their makers do not publish: assumed.",
    ),
];

/// The verdict as it stands beside the title.
pub(super) fn verdict_text(summary: &Summary) -> String {
    output::verdict_text(&summary.expectations)
}

/// What was run, in a line.
pub(super) fn facts(summary: &Summary) -> Vec<String> {
    let view = match summary.setting.view {
        View::Lateral => "lateral view",
        View::Transverse => "transverse view",
    };
    let tracker = match summary.tracker.name.as_str() {
        "none" => "no tracker".to_owned(),
        name => format!("tracker {name} {}", summary.tracker.version),
    };
    vec![
        format!("seed {}", summary.seed),
        format!("sonoloop {}", summary.version),
        tracker,
        view.to_owned(),
        format!("{} images", summary.metrics.images),
        format!("{:.2} s simulated", summary.timing.simulated_s),
        format!("ended: {}", snake(&summary.end).replace('_', " ")),
    ]
}

/// Expectations first, in the scenario's order, then the other metrics.
pub(super) fn metrics(files: &Files) -> Section {
    let Summary { expectations, metrics, .. } = &files.summary;
    let expected = expectations.iter().map(|judged| {
        let cells = [judged.metric.clone(), value_text(judged.value), bound_text(judged.bound)];
        Row::new(cells).marked(Mark::of(judged.pass))
    });
    let others = METRICS.iter().filter(|name| expectations.iter().all(|judged| judged.metric != **name));
    let others = others.map(|name| Row::new([(*name).to_owned(), value_text(metrics.value(name))]));
    let expected = Table {
        columns: vec![Column::text("expectation"), Column::number("value"), Column::text("bound")],
        rows: expected.collect(),
    };
    let others = Table {
        columns: vec![Column::text("other metric"), Column::number("value")],
        rows: others.collect(),
    };
    let mut blocks = vec![Block::Tables(vec![expected, others])];
    match files.summary.end {
        EndReason::TargetReached | EndReason::TimeOver => {}
        end => blocks.push(Block::Note(format!(
            "The run ended early ({}): it is not comparable with others.",
            snake(&end).replace('_', " ")
        ))),
    }
    Section::new("Metrics", blocks)
}

/// The images that tell the run.
pub(super) fn pictures(files: &Files) -> Section {
    let mut blocks = Vec::new();
    match &files.pictures {
        Some(pictures) if !pictures.is_empty() => {
            blocks.push(Block::Strip(strip(files, pictures)));
            let note = "The box is the tracker's, in the colour of its state. The turquoise cross is the truth, which no tracker sees.";
            blocks.push(Block::Note(note.to_owned()));
        }
        Some(_) => blocks.push(Block::Text("The run ended before its first image.".to_owned())),
        None => blocks.push(Block::Text(format!(
            "There are no pictures on this page, because there is no {PICTURES} in the run's folder. Curves, events and \
             metrics are complete without it."
        ))),
    }
    if let Some(video) = [MP4, GIF].into_iter().find(|name| files.folder.join(name).is_file()) {
        blocks.push(Block::Note(format!("The run moves in {video}, in the folder of this page.")));
    }
    Section::new("The run in pictures", blocks)
}

/// Curves and, where there are pictures, their player.
pub(super) fn over_time(files: &Files) -> Section {
    let mut charts = charts(files);
    let mut blocks = Vec::new();
    if let Some(pictures) = files.pictures.as_ref().filter(|pictures| !pictures.is_empty()) {
        charts.pictures = Some(player(files, pictures));
        let stride = stride(pictures);
        if stride > 1 {
            let note = format!(
                "To keep this page small it has one of every {stride} pictures; curves have every image."
            );
            blocks.push(Block::Note(note));
        }
    }
    blocks.insert(0, Block::Charts(Box::new(charts)));
    Section::new("Over time", blocks)
}

/// What happened, in order.
pub(super) fn events(files: &Files) -> Section {
    let row = |event: &Event| {
        let time_s = seconds(event.tick);
        let kind = snake(&event.kind).replace('_', " ");
        let names_variants = matches!(event.kind, EventKind::StateChange | EventKind::End);
        let detail = if names_variants { event.detail.replace('_', " ") } else { event.detail.clone() };
        Row::new([format!("{time_s:.3}"), kind, detail]).leading_to(time_s)
    };
    let table = Table {
        columns: vec![Column::number("time, s"), Column::text("event"), Column::text("what")],
        rows: files.events.iter().take(MOST_EVENTS).map(row).collect(),
    };
    let mut blocks = vec![Block::Table(table)];
    if files.events.len() > MOST_EVENTS {
        blocks.push(Block::Note(format!("{} more in events.csv.", files.events.len() - MOST_EVENTS)));
    }
    Section::new("Events", blocks)
}

/// What the run cost.
pub(super) fn timing(files: &Files) -> Section {
    let timing = &files.summary.timing;
    let number = |value: Option<f64>| value.map_or("–".to_owned(), |value| format!("{value:.2}"));
    let rows = [
        ("simulated time", number(Some(timing.simulated_s)), "s"),
        ("wall-clock time", number(Some(timing.wall_s)), "s"),
        ("simulated over wall-clock time", number(timing.realtime_factor), ""),
        ("rendering, median per image", number(timing.render_ms_p50), "ms"),
        ("world, median per image", number(timing.physics_ms_p50), "ms"),
        ("tracking, median per image", number(timing.track_us_p50), "µs"),
        ("transport, median per image", number(timing.wire_us_p50), "µs"),
        ("age of the command in effect, median over images", number(timing.staleness_ms_p50), "ms"),
        ("the same, largest", number(timing.staleness_ms_max), "ms"),
        ("images without an answer", timing.images_without_answer.to_string(), ""),
        ("farthest behind the clock", number(timing.behind_ms_max), "ms"),
    ];
    let table = Table {
        columns: vec![Column::text("what"), Column::number("value"), Column::text("unit")],
        rows: rows.into_iter().map(|(what, value, unit)| Row::new([what, &value, unit])).collect(),
    };
    let mut blocks = vec![Block::Table(table)];
    if files.summary.realtime {
        let text = "Paced by the clock: the same seed gives another run next time.";
        blocks.insert(0, Block::Text(text.to_owned()));
    }
    Section::new("Timing", blocks)
}

/// Which numbers rest on assumed constants.
pub(super) fn assumptions() -> Section {
    let terms = ASSUMPTIONS.map(|(what, why)| (what.to_owned(), why.to_owned()));
    Section::new("What the numbers rest on", vec![Block::Terms(terms.into())])
}

/// The scenario with its draws.
pub(super) fn scenario(files: &Files) -> Section {
    Section::folded("Scenario as resolved", vec![Block::Code(files.scenario_yaml.clone())])
}
