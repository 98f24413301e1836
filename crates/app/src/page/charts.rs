use serde::Serialize;

use super::{Colour, Picture, Shape};

/// Panels under one another that share an axis and a cursor.
#[derive(Debug, Clone, Serialize)]
pub struct Charts {
    /// Name and unit of the axis.
    pub x_label: String,
    /// Places on the axis, ascending; every series has one value for each.
    pub x: Vec<f64>,
    /// Top to bottom.
    pub panels: Vec<Panel>,
    /// Kinds of bands, for the legend.
    pub band_kinds: Vec<BandKind>,
    /// Coloured stretches, without overlap; shown as a band on top and faintly behind every panel.
    pub bands: Vec<Band>,
    /// Moments that are marked in every panel.
    pub moments: Vec<Moment>,
    /// What was seen at the places of the axis.
    pub pictures: Option<Pictures>,
}

/// A pair of axes.
#[derive(Debug, Clone, Serialize)]
pub struct Panel {
    /// What it shows, with the unit.
    pub title: String,
    /// Its curves.
    pub series: Vec<Series>,
    /// Levels that matter, dashed.
    pub levels: Vec<Level>,
    /// The value axis shows at least this much.
    pub at_least: [f64; 2],
    /// The value axis shows at most this much; what lies beyond is cut.
    pub at_most: [f64; 2],
}

/// A curve; it breaks where a value is missing.
#[derive(Debug, Clone, Serialize)]
pub struct Series {
    /// What it is.
    pub label: String,
    /// Its colour.
    pub colour: Colour,
    /// Dotted, for what bounds another curve.
    pub dotted: bool,
    /// One for each place on the axis.
    pub values: Vec<Option<f64>>,
}

/// A level across a panel.
#[derive(Debug, Clone, Serialize)]
pub struct Level {
    /// What it is.
    pub label: String,
    /// Its colour.
    pub colour: Colour,
    /// Where it is.
    pub value: f64,
}

/// A kind of band.
#[derive(Debug, Clone, Serialize)]
pub struct BandKind {
    /// What it means.
    pub label: String,
    /// Its colour.
    pub colour: Colour,
}

/// A coloured stretch of the axis.
#[derive(Debug, Clone, Serialize)]
pub struct Band {
    /// Where it begins.
    pub from: f64,
    /// Where it ends.
    pub to: f64,
    /// Which of the kinds.
    pub kind: usize,
}

/// A mark at one place of the axis.
#[derive(Debug, Clone, Serialize)]
pub struct Moment {
    /// Where.
    pub at: f64,
    /// Its colour.
    pub colour: Colour,
    /// What happened; the beginning is written where there is room.
    pub label: String,
}

/// Pictures along the axis, and what is drawn and written beside each.
#[derive(Debug, Clone, Serialize)]
pub struct Pictures {
    /// Width and height that the spots count in; the files may have fewer pixels.
    pub size_px: [u32; 2],
    /// What of them is shown: left, top, width, height.
    pub shown_px: [f64; 4],
    /// Millimetres per unit of `size_px`, for a scale of depth along the left edge; none for no scale.
    pub spacing_mm: Option<f64>,
    /// Which place of the axis each of `pictures` belongs to, ascending.
    pub places: Vec<usize>,
    /// The pictures.
    pub pictures: Vec<Picture>,
    /// What is drawn over them.
    pub spots: Vec<Spot>,
    /// What is written beside them.
    pub readings: Vec<Reading>,
    /// Seconds per unit of the axis when played; none where it is no time.
    pub plays_s: Option<f64>,
}

/// A mark that moves from picture to picture.
#[derive(Debug, Clone, Serialize)]
pub struct Spot {
    /// What it is; the label of its switch.
    pub label: String,
    /// Its shape.
    #[serde(flatten)]
    pub shape: Shape,
    /// Its colour; without one that of the band it is in.
    pub colour: Option<Colour>,
    /// Hidden until its switch is turned.
    pub hidden: bool,
    /// Its centre at each place of the axis.
    pub at_px: Vec<Option<[f64; 2]>>,
}

/// A value that is written beside the picture.
#[derive(Debug, Clone, Serialize)]
pub struct Reading {
    /// What it is.
    pub label: String,
    /// Only with the spots that are hidden at first.
    pub hidden: bool,
    /// One for each place of the axis.
    pub values: Vec<String>,
}
