//! `report.html`: one page that needs nothing beside it.

use std::fmt::Write;

use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use image::codecs::jpeg::JpegEncoder;
use sonoloop_scenario::METRICS;
use sonoloop_types::TICKS_PER_SECOND;

use super::animation::Pictures as _;
use super::csv::snake;
use super::junit::escape_xml as escape;
use super::keys::key_images;
use super::overlay::Scale;
use super::table::{bound_text, value_text, verdict_text};
use super::video::{Frames, VideoKind};
use super::{Outcome, OutputError};
use crate::judge::passes;

const STYLE: &str = include_str!("report.css");

/// Lists of events beyond this length are cut on the page; `events.csv` has them all.
const MOST_EVENTS: usize = 200;

/// JPEG quality of the pictures; about 90 kB each.
const QUALITY: u8 = 82;

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

/// The page.
pub(super) fn report_html(
    outcome: &Outcome<'_>,
    frames: Option<&Frames<'_>>,
    plots: &[&str],
    video: Option<&VideoKind>,
) -> Result<String, OutputError> {
    let scenario = outcome.scenario;
    let name = escape(&scenario.name);
    let badge = if passes(outcome.judged) { "pass" } else { "fail" };
    let end = snake(&outcome.recording.end).replace('_', " ");
    let mut page = format!(
        "<!DOCTYPE html>\n<html lang=\"en\"><head><meta charset=\"utf-8\">\n\
         <meta name=\"viewport\" content=\"width=device-width\">\n<title>{name}: {badge}</title>\n\
         <style>\n{STYLE}</style></head>\n<body>\n<header><h1>{name} <b class=\"{badge}\">{}</b></h1>\n\
         <p>{}</p>\n<p class=\"facts\">seed {} · sonoloop {} · {} images · ended: {end}</p>\n\
         <p class=\"warning\">Simulation. Not for clinical use.</p></header>\n",
        escape(&verdict_text(outcome.judged)),
        escape(&scenario.description),
        scenario.seed,
        escape(outcome.version),
        outcome.recording.images.len(),
    );
    if let Some(frames) = frames {
        pictures(&mut page, outcome, frames, video)?;
    }
    metrics(&mut page, outcome);
    page.push_str("<section><h2>Over time</h2>\n<p class=\"legend\"><i class=\"tracking\"></i>tracking \
        <i class=\"lost\"></i>lost <i class=\"recovering\"></i>recovering <i class=\"searching\"></i>searching \
        <i class=\"down\"></i>no tracker</p>\n");
    for plot in plots {
        let _ = writeln!(page, "<figure>{plot}</figure>");
    }
    page.push_str("</section>\n");
    events(&mut page, outcome);
    timing(&mut page, outcome);
    page.push_str("<section><h2>What the numbers rest on</h2>\n<dl>\n");
    for (what, why) in ASSUMPTIONS {
        let _ = writeln!(page, "<dt>{}</dt><dd>{}</dd>", escape(what), escape(why));
    }
    let yaml = escape(&scenario.resolved_yaml);
    let _ = write!(
        page,
        "</dl></section>\n<section><details><summary>Scenario as resolved</summary><pre>{yaml}</pre>\
         </details></section>\n</body></html>\n"
    );
    Ok(page)
}

fn pictures(
    page: &mut String,
    outcome: &Outcome<'_>,
    frames: &Frames<'_>,
    video: Option<&VideoKind>,
) -> Result<(), OutputError> {
    page.push_str("<section><h2>The run in pictures</h2>\n<div class=\"strip\">\n");
    for key in key_images(&outcome.recording.images[..frames.len()]) {
        let picture = frames.draw(key.index, Scale::Full)?;
        let mut jpeg = Vec::new();
        JpegEncoder::new_with_quality(&mut jpeg, QUALITY).encode_image(&picture)?;
        let acquisition = &outcome.recording.images[key.index].acquisition;
        let seconds = acquisition.acquisition_tick as f64 / TICKS_PER_SECOND as f64;
        let caption = format!("{}, {seconds:.2} s", key.label);
        let _ = writeln!(
            page,
            "<figure><img alt=\"{caption}\" width=\"{}\" height=\"{}\" src=\"data:image/jpeg;base64,{}\">\
             <figcaption>{caption}</figcaption></figure>",
            picture.width(),
            picture.height(),
            STANDARD.encode(&jpeg)
        );
    }
    page.push_str(
        "</div>\n<p class=\"note\">The box is the tracker's; everything in turquoise is the truth, \
        which no tracker sees.",
    );
    if let Some(video) = video {
        let file = video.file_name();
        let _ = write!(page, " The whole run moves in <a href=\"{file}\">{file}</a> beside this page.");
    }
    page.push_str("</p></section>\n");
    Ok(())
}

fn metrics(page: &mut String, outcome: &Outcome<'_>) {
    page.push_str(
        "<section><h2>Metrics</h2>\n<table class=\"metrics\"><tr><th></th><th>metric</th>\
        <th>value</th><th>expected</th></tr>\n",
    );
    for judged in outcome.judged {
        let (mark, class) = if judged.pass { ("✓", "pass") } else { ("✗", "fail") };
        let _ = writeln!(
            page,
            "<tr class=\"{class}\"><td>{mark}</td><td>{}</td><td>{}</td><td>{}</td></tr>",
            escape(&judged.metric),
            value_text(judged.value),
            bound_text(judged.bound)
        );
    }
    for name in METRICS.iter().filter(|name| outcome.judged.iter().all(|j| j.metric != **name)) {
        let value = value_text(outcome.metrics.value(name));
        let _ = writeln!(page, "<tr><td></td><td>{name}</td><td>{value}</td><td></td></tr>");
    }
    page.push_str("</table></section>\n");
}

fn events(page: &mut String, outcome: &Outcome<'_>) {
    let all = &outcome.recording.events;
    page.push_str("<section><h2>Events</h2>\n<table><tr><th>time, s</th><th>event</th><th></th></tr>\n");
    for event in all.iter().take(MOST_EVENTS) {
        let seconds = event.tick as f64 / TICKS_PER_SECOND as f64;
        let kind = snake(&event.kind).replace('_', " ");
        let detail = escape(&event.detail);
        let _ = writeln!(page, "<tr><td>{seconds:.3}</td><td>{kind}</td><td>{detail}</td></tr>");
    }
    page.push_str("</table>\n");
    if all.len() > MOST_EVENTS {
        let _ = writeln!(page, "<p>{} more in events.csv.</p>", all.len() - MOST_EVENTS);
    }
    page.push_str("</section>\n");
}

fn timing(page: &mut String, outcome: &Outcome<'_>) {
    let timing = outcome.summary().timing;
    let number = |value: Option<f64>| value.map_or("-".to_owned(), |value| format!("{value:.2}"));
    let rows = [
        ("simulated time", "s", number(Some(timing.simulated_s))),
        ("wall-clock time", "s", number(Some(timing.wall_s))),
        ("times faster than real time", "", number(timing.realtime_factor)),
        ("rendering, median per image", "ms", number(timing.render_ms_p50)),
        ("world, median per image", "ms", number(timing.physics_ms_p50)),
        ("tracking, median per image", "µs", number(timing.track_us_p50)),
        ("transport, median per image", "µs", number(timing.wire_us_p50)),
        ("age of the command in effect, median over images", "ms", number(timing.staleness_ms_p50)),
        ("the same, largest", "ms", number(timing.staleness_ms_max)),
        ("images without an answer", "", timing.images_without_answer.to_string()),
        ("farthest behind the clock", "ms", number(timing.behind_ms_max)),
    ];
    page.push_str("<section><h2>Timing</h2>\n");
    if timing.behind_ms_max.is_some() {
        page.push_str("<p>Paced by the clock: the same seed gives another run next time.</p>\n");
    }
    page.push_str("<table>\n");
    for (what, unit, value) in rows {
        let _ = writeln!(page, "<tr><td>{what}</td><td>{value}</td><td>{unit}</td></tr>");
    }
    page.push_str("</table></section>\n");
}
