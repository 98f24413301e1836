use std::path::{Path, PathBuf};
use std::sync::Arc;

use miette::{Diagnostic, GraphicalReportHandler, GraphicalTheme, LabeledSpan, NamedSource, SourceCode};

/// What is wrong with a file that a person wrote: one problem, told once.
///
/// `Display` gives one line, `file:line:column: key = value: what must hold`. As a [`miette::Diagnostic`]
/// it also carries the text of the file and the span to underline; [`LoadError::render`] prints both.
#[derive(Debug, thiserror::Error)]
#[error("{}", .0.headline())]
pub struct LoadError(Box<Problem>);

#[derive(Debug)]
struct Problem {
    path: PathBuf,
    key: String,
    value: Option<String>,
    message: String,
    help: Option<String>,
    place: Option<Place>,
}

/// A stretch of a file, and what the reader sees of it.
#[derive(Debug)]
struct Place {
    line: usize,
    column: usize,
    offset: usize,
    len: usize,
    source: NamedSource<Arc<str>>,
}

impl Problem {
    fn headline(&self) -> String {
        let mut text = self.path.display().to_string();
        if let Some(place) = &self.place {
            text += &format!(":{}:{}", place.line, place.column);
        }
        if !self.key.is_empty() {
            text += &format!(": {}", self.key);
            if let Some(value) = &self.value {
                text += &format!(" = {value}");
            }
        }
        text + ": " + &self.message
    }
}

impl LoadError {
    /// A problem with the file as a whole, or one whose place in it is not known (yet).
    pub(crate) fn new(path: &Path, message: impl Into<String>) -> Self {
        Self(Box::new(Problem {
            path: path.to_owned(),
            key: String::new(),
            value: None,
            message: message.into(),
            help: None,
            place: None,
        }))
    }

    /// Names the key and, where it is short, its value.
    pub(crate) fn with_key(mut self, key: &str, value: Option<String>) -> Self {
        self.0.key = key.to_owned();
        self.0.value = value;
        self
    }

    /// Points at `len` bytes from `offset` of the file's text.
    pub(crate) fn with_place(mut self, text: &Arc<str>, offset: usize, len: usize) -> Self {
        let mut offset = offset.min(text.len());
        while !text.is_char_boundary(offset) {
            offset -= 1;
        }
        // One line is underlined at most: the start of a long block says enough.
        let rest = text[offset..].lines().next().unwrap_or("").trim_end();
        let line_start = text[..offset].rfind('\n').map_or(0, |newline| newline + 1);
        self.0.place = Some(Place {
            line: text[..offset].matches('\n').count() + 1,
            column: text[line_start..offset].chars().count() + 1,
            offset,
            len: len.min(rest.len()).max(usize::from(!rest.is_empty())),
            source: NamedSource::new(self.0.path.display().to_string(), Arc::clone(text)),
        });
        self
    }

    /// Adds a hint.
    pub(crate) fn with_help(mut self, help: impl Into<String>) -> Self {
        self.0.help = Some(help.into());
        self
    }

    /// The file that is wrong.
    pub fn path(&self) -> &Path {
        &self.0.path
    }

    /// The key that is wrong, dotted, lists by index (`disturbances.0.at_s`); empty when the problem is
    /// the file as a whole.
    pub fn key(&self) -> &str {
        &self.0.key
    }

    /// Line of the problem, counted from 1, when it lies in the file's text.
    pub fn line(&self) -> Option<usize> {
        self.0.place.as_ref().map(|place| place.line)
    }

    /// Message, offending line and underline as plain text for a terminal without colours.
    pub fn render(&self) -> String {
        let mut out = String::new();
        let handler = GraphicalReportHandler::new_themed(GraphicalTheme::unicode_nocolor())
            .with_width(110)
            .with_context_lines(1);
        match handler.render_report(&mut out, self) {
            Ok(()) => out,
            Err(_) => self.to_string(),
        }
    }
}

impl Diagnostic for LoadError {
    fn help<'a>(&'a self) -> Option<Box<dyn std::fmt::Display + 'a>> {
        self.0.help.as_ref().map(|help| Box::new(help) as _)
    }

    fn source_code(&self) -> Option<&dyn SourceCode> {
        self.0.place.as_ref().map(|place| &place.source as _)
    }

    fn labels(&self) -> Option<Box<dyn Iterator<Item = LabeledSpan> + '_>> {
        let place = self.0.place.as_ref()?;
        let label = LabeledSpan::new(Some("here".to_owned()), place.offset, place.len);
        Some(Box::new(std::iter::once(label)))
    }
}
