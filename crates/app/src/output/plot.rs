//! Curves over time as SVG: panels under one another on one time axis, the tracker's state behind them.

use std::fmt::Write;

use super::junit::escape_xml;

const WIDTH: f64 = 960.0;
const LEFT: f64 = 62.0;
const RIGHT: f64 = 150.0;
const TOP: f64 = 26.0;
const PANEL_HEIGHT: f64 = 150.0;
const PANEL_GAP: f64 = 22.0;
const BOTTOM: f64 = 40.0;

/// One curve; a value without a number breaks it.
#[derive(Debug, Clone)]
pub(super) struct Curve {
    pub label: &'static str,
    pub colour: &'static str,
    /// (time in seconds, value), by ascending time.
    pub points: Vec<(f64, Option<f64>)>,
}

/// A level that matters, drawn dashed across the panel.
#[derive(Debug, Clone)]
pub(super) struct Level {
    pub label: String,
    pub colour: &'static str,
    pub value: f64,
}

/// One pair of axes.
#[derive(Debug, Clone)]
pub(super) struct Panel {
    pub title: &'static str,
    pub curves: Vec<Curve>,
    pub levels: Vec<Level>,
    /// The value axis shows at least this much.
    pub at_least: [f64; 2],
    /// The value axis shows at most this much; what lies beyond is cut.
    pub at_most: [f64; 2],
}

/// A stretch of time with a coloured background.
#[derive(Debug, Clone)]
pub(super) struct Band {
    pub from_s: f64,
    pub to_s: f64,
    pub colour: &'static str,
}

/// A moment with a mark at the top.
#[derive(Debug, Clone)]
pub(super) struct Moment {
    pub at_s: f64,
    pub label: String,
}

/// Draws panels that share the time from 0 to `end_s`.
pub(super) fn svg(panels: &[Panel], bands: &[Band], moments: &[Moment], end_s: f64) -> String {
    let end_s = if end_s > 0.0 { end_s } else { 1.0 };
    let height = TOP + panels.len() as f64 * (PANEL_HEIGHT + PANEL_GAP) - PANEL_GAP + BOTTOM;
    let x = |time_s: f64| LEFT + (WIDTH - LEFT - RIGHT) * (time_s / end_s).clamp(0.0, 1.0);
    let mut svg = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {WIDTH} {height}\" \
         font-family=\"system-ui,sans-serif\" font-size=\"12\" fill=\"#333\">\n\
         <rect width=\"{WIDTH}\" height=\"{height}\" fill=\"#fff\"/>\n"
    );
    for (index, panel) in panels.iter().enumerate() {
        let top = TOP + index as f64 * (PANEL_HEIGHT + PANEL_GAP);
        for band in bands {
            let (from, to) = (x(band.from_s), x(band.to_s));
            let _ = writeln!(
                svg,
                "<rect x=\"{from:.2}\" y=\"{top}\" width=\"{:.2}\" height=\"{PANEL_HEIGHT}\" fill=\"{}\"/>",
                to - from,
                band.colour
            );
        }
        for moment in moments {
            let at = x(moment.at_s);
            let _ = writeln!(
                svg,
                "<path d=\"M{at:.2} {top}v{PANEL_HEIGHT}\" stroke=\"#777\" stroke-dasharray=\"2 3\"/>"
            );
        }
        draw_panel(&mut svg, panel, top, &x);
    }
    for moment in moments {
        let (at, label) = (x(moment.at_s), escape_xml(&moment.label));
        let _ = writeln!(
            svg,
            "<text x=\"{at:.2}\" y=\"{}\" text-anchor=\"middle\" fill=\"#555\">{label}</text>",
            TOP - 8.0
        );
    }
    let base = height - BOTTOM;
    for tick in ticks(0.0, end_s, 10) {
        let at = x(tick);
        let _ = writeln!(
            svg,
            "<path d=\"M{at:.2} {base}v5\" stroke=\"#333\"/>\
             <text x=\"{at:.2}\" y=\"{}\" text-anchor=\"middle\">{}</text>",
            base + 18.0,
            short(tick)
        );
    }
    let middle = (LEFT + WIDTH - RIGHT) / 2.0;
    let _ = writeln!(svg, "<text x=\"{middle}\" y=\"{}\" text-anchor=\"middle\">time, s</text>", base + 34.0);
    svg.push_str("</svg>\n");
    svg
}

fn draw_panel(svg: &mut String, panel: &Panel, top: f64, x: &impl Fn(f64) -> f64) {
    let (low, high) = range(panel);
    let y = |value: f64| top + PANEL_HEIGHT * (1.0 - (value.clamp(low, high) - low) / (high - low));
    let right = WIDTH - RIGHT;
    for tick in ticks(low, high, 5) {
        let at = y(tick);
        let _ = writeln!(
            svg,
            "<path d=\"M{LEFT} {at:.2}H{right}\" stroke=\"#000\" stroke-opacity=\".1\"/>\
             <text x=\"{}\" y=\"{:.2}\" text-anchor=\"end\">{}</text>",
            LEFT - 6.0,
            at + 4.0,
            short(tick)
        );
    }
    let (caption_x, caption_y) = (14.0, top + PANEL_HEIGHT / 2.0);
    let _ = writeln!(
        svg,
        "<text transform=\"translate({caption_x} {caption_y}) rotate(-90)\" text-anchor=\"middle\">{}</text>",
        escape_xml(panel.title)
    );
    let mut labels: Vec<(f64, String, &str)> = Vec::new();
    for level in panel.levels.iter().filter(|level| (low..=high).contains(&level.value)) {
        let at = y(level.value);
        let _ = writeln!(
            svg,
            "<path d=\"M{LEFT} {at:.2}H{right}\" stroke=\"{}\" stroke-dasharray=\"6 4\"/>",
            level.colour
        );
        labels.push((at, level.label.clone(), level.colour));
    }
    for curve in &panel.curves {
        let _ = writeln!(
            svg,
            "<path d=\"{}\" fill=\"none\" stroke=\"{}\" stroke-width=\"1.6\" stroke-linejoin=\"round\" \
             stroke-linecap=\"round\"/>",
            path(&curve.points, x, &y),
            curve.colour
        );
        let last = curve.points.iter().rev().find_map(|&(_, value)| value);
        labels.push((last.map_or(top, &y), curve.label.to_owned(), curve.colour));
    }
    // Labels stand where their lines end, pushed apart so that each can be read.
    labels.sort_by(|a, b| a.0.total_cmp(&b.0));
    let mut lowest = top - 8.0;
    for (at, label, colour) in labels {
        let at = at.max(lowest + 14.0);
        lowest = at;
        let _ = writeln!(
            svg,
            "<text x=\"{}\" y=\"{:.2}\" fill=\"{colour}\">{}</text>",
            right + 8.0,
            at + 4.0,
            escape_xml(&label)
        );
    }
    let _ = writeln!(
        svg,
        "<rect x=\"{LEFT}\" y=\"{top}\" width=\"{}\" height=\"{PANEL_HEIGHT}\" fill=\"none\" stroke=\"#333\"/>",
        right - LEFT
    );
}

/// SVG path data; a lone point between gaps becomes a dot.
fn path(points: &[(f64, Option<f64>)], x: &impl Fn(f64) -> f64, y: &impl Fn(f64) -> f64) -> String {
    let mut data = String::new();
    let mut pen_down = false;
    for &(time_s, value) in points {
        let value = value.filter(|value| value.is_finite());
        let Some(value) = value else {
            pen_down = false;
            continue;
        };
        let (px, py) = (x(time_s), y(value));
        let _ = match pen_down {
            true => write!(data, "L{px:.2} {py:.2}"),
            false => write!(data, "M{px:.2} {py:.2}h0"),
        };
        pen_down = true;
    }
    data
}

/// What the value axis shows: all values, widened to `at_least`, cut to `at_most`, never empty.
fn range(panel: &Panel) -> (f64, f64) {
    let values = panel.curves.iter().flat_map(|curve| &curve.points).filter_map(|&(_, value)| value);
    let values = values.filter(|value| value.is_finite());
    let [mut low, mut high] = panel.at_least;
    for value in values {
        low = low.min(value);
        high = high.max(value);
    }
    low = low.max(panel.at_most[0]);
    high = high.min(panel.at_most[1]);
    let margin = (high - low) * 0.04;
    if high > low {
        (low - if low == 0.0 { 0.0 } else { margin }, high + margin)
    } else {
        (low - 1.0, low + 1.0)
    }
}

/// Round values within [low, high], at most about `count` of them, at 1, 2 or 5 times a power of ten.
fn ticks(low: f64, high: f64, count: u32) -> Vec<f64> {
    let raw = (high - low) / f64::from(count);
    let power = 10f64.powi(raw.log10().floor() as i32);
    let step = [1.0, 2.0, 5.0, 10.0].into_iter().map(|s| s * power).find(|&s| s >= raw * 0.999);
    let step = step.unwrap_or(10.0 * power);
    let first = (low / step).ceil() as i64;
    let last = (high / step + 1e-9).floor() as i64;
    (first..=last).map(|k| k as f64 * step).collect()
}

fn short(value: f64) -> String {
    let text = format!("{value:.3}");
    let text = text.trim_end_matches('0').trim_end_matches('.');
    if text == "-0" { "0".to_owned() } else { text.to_owned() }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ticks_are_round_and_inside() {
        assert_eq!(ticks(0.0, 12.0, 10), [0.0, 2.0, 4.0, 6.0, 8.0, 10.0, 12.0]);
        assert_eq!(ticks(-1.0, 1.0, 5).len(), 5);
        assert_eq!(short(0.1 + 0.2), "0.3");
        assert_eq!(short(-0.0), "0");
        assert_eq!(short(20.0), "20");
    }

    #[test]
    fn a_gap_lifts_the_pen() {
        let points =
            [(0.0, Some(1.0)), (1.0, Some(2.0)), (2.0, None), (3.0, Some(f64::NAN)), (4.0, Some(0.0))];
        let data = path(&points, &|t| t, &|v| v);
        assert_eq!(data, "M0.00 1.00h0L1.00 2.00M4.00 0.00h0");
    }

    #[test]
    fn values_beyond_the_axis_are_cut_to_it() {
        let curve = Curve { label: "a", colour: "#000", points: vec![(0.0, Some(-5.0)), (1.0, Some(50.0))] };
        let panel = Panel {
            title: "t",
            curves: vec![curve],
            levels: vec![],
            at_least: [0.0, 1.0],
            at_most: [0.0, 4.0],
        };
        assert_eq!(range(&panel), (0.0, 4.16));
        let drawing = svg(&[panel], &[], &[], 1.0);
        assert!(drawing.starts_with("<svg") && drawing.ends_with("</svg>\n") && !drawing.contains("NaN"));
    }
}
