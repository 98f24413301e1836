//! What every HTML report shares: one page that needs nothing beside it and asks nothing of the network.
//!
//! A [`Page`] is built from plain values and turned into text by [`Page::html`]. It reads well in light, in dark and on paper,
//! and works from a file. What it may hold:
//!
//! | block | is |
//! |---|---|
//! | [`Block::Text`], [`Block::Note`] | a paragraph; a quiet one |
//! | [`Block::Table`], [`Block::Tables`] | rows with an optional verdict mark; a row may point at a moment of the charts |
//! | [`Block::Terms`] | what a word means, or what a number rests on |
//! | [`Block::Figure`] | a drawing as SVG with its caption |
//! | [`Block::Strip`] | pictures side by side, marks drawn over them |
//! | [`Block::Charts`] | curves over one axis under one cursor, with a player of pictures where there are some |
//! | [`Block::Code`] | a text as it is |
//!
//! ```
//! use sonoloop::page::{Block, Column, Mark, Page, Row, Section, Table};
//!
//! let table = Table {
//!     columns: vec![Column::text("sequence"), Column::number("tip error, mm")],
//!     rows: vec![Row::new(["agar", "0.21"]).marked(Mark::Pass)],
//! };
//! let page = Page {
//!     title: "Twenty sequences".into(),
//!     verdict: Some((Mark::Pass, "20 of 20".into())),
//!     sections: vec![Section::new("Results", vec![Block::Table(table)])],
//!     ..Page::default()
//! };
//! assert!(page.html().unwrap().contains("<td class=\"number\">0.21</td>"));
//! ```
//!
//! The template is `page.html`; charts are drawn by uPlot (`vendor/`, MIT licence) and `page.js`.

mod charts;
mod picture;
mod table;

pub use charts::{Band, BandKind, Charts, Level, Moment, Panel, Pictures, Reading, Series, Spot};
pub use picture::{Picture, Shape, StripPicture};
pub use table::{Column, Mark, Row, Table};

use minijinja::syntax::SyntaxConfig;
use minijinja::value::{Serde, Value};
use minijinja::{Environment, context};
use serde::Serialize;

/// A page that cannot be made: the template and the values do not fit.
#[derive(Debug, thiserror::Error)]
#[error("cannot make the page: {0:#}")]
pub struct PageError(#[from] minijinja::Error);

/// A report.
#[derive(Debug, Clone, Default, Serialize)]
pub struct Page {
    /// What it is about; the browser's title too.
    pub title: String,
    /// The outcome in a few words, beside the title.
    pub verdict: Option<(Mark, String)>,
    /// A sentence or two below the title.
    pub lead: String,
    /// Short facts in one line: seed, version and the like.
    pub facts: Vec<String>,
    /// What follows, in order.
    pub sections: Vec<Section>,
}

/// A part of a page.
#[derive(Debug, Clone, Serialize)]
pub struct Section {
    /// Its heading.
    pub title: String,
    /// Closed until somebody opens it; open on paper.
    pub folded: bool,
    /// What it holds, in order.
    pub blocks: Vec<Block>,
}

impl Section {
    /// An open section.
    pub fn new(title: &str, blocks: Vec<Block>) -> Self {
        Self { title: title.to_owned(), folded: false, blocks }
    }

    /// A section that is closed until somebody opens it.
    pub fn folded(title: &str, blocks: Vec<Block>) -> Self {
        Self { folded: true, ..Self::new(title, blocks) }
    }
}

/// One thing on the page.
#[derive(Debug, Clone, Serialize)]
#[serde(tag = "kind", content = "of", rename_all = "snake_case")]
pub enum Block {
    /// A paragraph.
    Text(String),
    /// A paragraph in small, quiet print.
    Note(String),
    /// A table.
    Table(Table),
    /// Tables side by side, where there is room.
    Tables(Vec<Table>),
    /// Words and what they mean.
    Terms(Vec<(String, String)>),
    /// A drawing: an `<svg>` element, trusted as it is, and its caption.
    Figure {
        /// The element.
        svg: String,
        /// What it shows.
        caption: String,
    },
    /// Pictures side by side.
    Strip(Vec<StripPicture>),
    /// Curves under one cursor.
    Charts(Box<Charts>),
    /// A text as it is, in a type of equal widths.
    Code(String),
}

/// Colours with a role; each has a light and a dark shade.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
#[expect(missing_docs, reason = "the names say it")]
pub enum Colour {
    Blue,
    Orange,
    Green,
    Red,
    Amber,
    Turquoise,
    Purple,
    Grey,
}

impl Page {
    /// The page's text.
    pub fn html(&self) -> Result<String, PageError> {
        let mut environment = Environment::new();
        environment.set_syntax(SyntaxConfig::builder().trim_blocks(true).lstrip_blocks(true).build()?);
        environment.add_filter("data_uri", picture::data_uri);
        environment.add_template("page.html", include_str!("page.html"))?;
        let has_charts = |block: &Block| matches!(block, Block::Charts(_));
        let trusted = |text: &str| Value::from_safe_string(text.to_owned());
        Ok(environment.get_template("page.html")?.render(context! {
            page => Value::from(Serde(self)),
            has_charts => self.sections.iter().any(|section| section.blocks.iter().any(has_charts)),
            style => trusted(include_str!("page.css")),
            script => trusted(include_str!("page.js")),
            uplot_style => trusted(include_str!("vendor/uPlot.min.css")),
            uplot_script => trusted(include_str!("vendor/uPlot.iife.min.js")),
            uplot_licence => trusted(include_str!("vendor/uPlot.LICENSE")),
        })?)
    }
}

#[cfg(test)]
mod tests;
