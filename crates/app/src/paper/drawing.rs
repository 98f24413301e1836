//! Drawings of the report as SVG.

use std::fmt::Write;

use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use image::{Rgb, RgbImage};

use super::similarity::{Figure, Measure, REACH_PX, SHIFTS, SIDE_PX, Surface};
use crate::output::rgb_png;

/// Dark to light, even steps in lightness (stops of viridis, Smith and van der Walt 2015).
const STOPS: [[f64; 3]; 5] =
    [[68.0, 1.0, 84.0], [59.0, 82.0, 139.0], [33.0, 145.0, 140.0], [94.0, 201.0, 98.0], [253.0, 231.0, 37.0]];

/// Colour of a share, 0 to 1.
fn colour(share: f64) -> [u8; 3] {
    let at = share.clamp(0.0, 1.0) * (STOPS.len() - 1) as f64;
    let below = (at as usize).min(STOPS.len() - 2);
    let rest = at - below as f64;
    std::array::from_fn(|k| (STOPS[below][k] + rest * (STOPS[below + 1][k] - STOPS[below][k])) as u8)
}

fn png_uri(side: usize, pixel: impl Fn(usize) -> [u8; 3]) -> String {
    let side_px = side as u32;
    let picture = RgbImage::from_fn(side_px, side_px, |u, v| Rgb(pixel((v * side_px + u) as usize)));
    let bytes = rgb_png(&picture).unwrap_or_default();
    format!("data:image/png;base64,{}", STANDARD.encode(bytes))
}

/// A row of drawings: the template, and the three surfaces with a cross where each is most alike.
pub(super) fn surfaces(figures: &[(&str, &Figure)]) -> String {
    const SIDE: f64 = 220.0;
    const PITCH: f64 = 250.0;
    let height = 275.0 * figures.len() as f64;
    let mut svg = format!(
        "<svg viewBox=\"0 0 1000 {height}\" xmlns=\"http://www.w3.org/2000/svg\" font-family=\"system-ui, sans-serif\" \
         font-size=\"14\" fill=\"#1c2228\">"
    );
    let mut picture = |x: f64, y: f64, title: &str, uri: &str| {
        let _ = write!(
            svg,
            "<text x=\"{x}\" y=\"{}\">{title}</text><image x=\"{x}\" y=\"{}\" width=\"{SIDE}\" height=\"{SIDE}\" \
             style=\"image-rendering:pixelated\" href=\"{uri}\"/>",
            y + 18.0,
            y + 26.0
        );
    };
    let mut crosses = Vec::new();
    for (row, (name, figure)) in figures.iter().enumerate() {
        let y = 275.0 * row as f64;
        let grey = |index: usize| [figure.template[index].clamp(0.0, 255.0) as u8; 3];
        picture(0.0, y, name, &png_uri(SIDE_PX, grey));
        for (column, surface) in figure.surfaces.iter().enumerate() {
            let x = PITCH * (column + 1) as f64;
            let [du, dv] = surface.extremum_px().0;
            let title = format!("{}: most alike at ({du}, {dv}) px", surface.measure.name());
            picture(x, y, &title, &png_uri(SHIFTS, |index| colour(likeness(surface, index))));
            let at = |d: i32| (f64::from(d + REACH_PX) + 0.5) / SHIFTS as f64 * SIDE;
            crosses.push([x + at(du), y + 26.0 + at(dv)]);
        }
    }
    for [x, y] in crosses {
        let _ = write!(
            svg,
            "<path d=\"M{x} {y}m-9 0h6m6 0h6m-9 -9v6m0 6v6\" stroke=\"#c0281f\" stroke-width=\"2.5\" fill=\"none\"/>"
        );
    }
    svg + "</svg>"
}

/// 0 where least alike on the surface, 1 where most.
fn likeness(surface: &Surface, index: usize) -> f64 {
    let low = surface.values.iter().copied().fold(f64::MAX, f64::min);
    let high = surface.values.iter().copied().fold(f64::MIN, f64::max);
    let share = (surface.values[index] - low) / (high - low).max(f64::MIN_POSITIVE);
    if surface.measure == Measure::Ncc { share } else { 1.0 - share }
}

/// A share per cell, 0 to 1, with names of rows and columns.
pub(super) struct Map<'a> {
    pub title: &'a str,
    pub across: &'a str,
    pub down: &'a str,
    pub columns: Vec<String>,
    pub rows: Vec<String>,
    /// By row, then column.
    pub shares: Vec<f64>,
}

/// Maps side by side.
pub(super) fn maps(maps: &[Map<'_>]) -> String {
    const PITCH: f64 = 500.0;
    const LEFT: f64 = 84.0;
    const TOP: f64 = 58.0;
    const WIDTH: f64 = 72.0;
    const HEIGHT: f64 = 40.0;
    let rows = maps.iter().map(|map| map.rows.len()).max().unwrap_or(0);
    let height = TOP + HEIGHT * rows as f64 + 8.0;
    let mut svg = format!(
        "<svg viewBox=\"0 0 {} {height}\" xmlns=\"http://www.w3.org/2000/svg\" font-family=\"system-ui, sans-serif\" \
         font-size=\"14\" fill=\"#1c2228\">",
        PITCH * maps.len() as f64
    );
    for (k, map) in maps.iter().enumerate() {
        let x0 = PITCH * k as f64;
        let _ = write!(
            svg,
            "<text x=\"{x0}\" y=\"16\" font-weight=\"600\">{}</text><text x=\"{}\" y=\"36\" font-size=\"12\">{}</text>\
             <text x=\"{x0}\" y=\"52\" font-size=\"12\">{}</text>",
            map.title,
            x0 + LEFT,
            map.across,
            map.down
        );
        for (column, name) in map.columns.iter().enumerate() {
            let x = x0 + LEFT + WIDTH * (column as f64 + 0.5);
            let _ =
                write!(svg, "<text x=\"{x}\" y=\"52\" font-size=\"12\" text-anchor=\"middle\">{name}</text>");
        }
        for (row, name) in map.rows.iter().enumerate() {
            let y = TOP + HEIGHT * row as f64;
            let middle = y + HEIGHT / 2.0 + 5.0;
            let right = x0 + LEFT - 8.0;
            let _ = write!(
                svg,
                "<text x=\"{right}\" y=\"{middle}\" font-size=\"12\" text-anchor=\"end\">{name}</text>"
            );
            for column in 0..map.columns.len() {
                let share = map.shares[row * map.columns.len() + column];
                let [r, g, b] = colour(share);
                let x = x0 + LEFT + WIDTH * column as f64;
                let ink = if share > 0.6 { "#000" } else { "#fff" };
                let _ = write!(
                    svg,
                    "<rect x=\"{x}\" y=\"{y}\" width=\"{}\" height=\"{}\" fill=\"rgb({r},{g},{b})\"/><text x=\"{}\" \
                     y=\"{middle}\" text-anchor=\"middle\" fill=\"{ink}\">{:.0} %</text>",
                    WIDTH - 2.0,
                    HEIGHT - 2.0,
                    x + WIDTH / 2.0,
                    100.0 * share
                );
            }
        }
    }
    svg + "</svg>"
}
