use serde::Serialize;

/// How something came out.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Mark {
    /// It held: ✓ in green.
    Pass,
    /// It did not: ✗ in red.
    Fail,
    /// Worth a second look: ! in amber.
    Warn,
}

impl Mark {
    /// [`Mark::Pass`] for true.
    pub fn of(pass: bool) -> Self {
        if pass { Self::Pass } else { Self::Fail }
    }
}

/// Rows below a head. Every row has a cell for every column.
#[derive(Debug, Clone, Default, Serialize)]
pub struct Table {
    /// The head.
    pub columns: Vec<Column>,
    /// What is below it.
    pub rows: Vec<Row>,
}

/// Head of a column.
#[derive(Debug, Clone, Serialize)]
pub struct Column {
    /// What it holds, with the unit.
    pub title: String,
    /// Set to the right, as numbers are.
    pub number: bool,
}

impl Column {
    /// A column of words.
    pub fn text(title: &str) -> Self {
        Self { title: title.to_owned(), number: false }
    }

    /// A column of numbers.
    pub fn number(title: &str) -> Self {
        Self { title: title.to_owned(), number: true }
    }
}

/// One row.
#[derive(Debug, Clone, Default, Serialize)]
pub struct Row {
    /// The verdict in front of it.
    pub mark: Option<Mark>,
    /// A place on the axis of the page's charts; the row leads there.
    pub at: Option<f64>,
    /// One text per column.
    pub cells: Vec<String>,
}

impl Row {
    /// A row without a mark.
    pub fn new<T: Into<String>>(cells: impl IntoIterator<Item = T>) -> Self {
        Self { cells: cells.into_iter().map(Into::into).collect(), ..Self::default() }
    }

    /// With a mark in front.
    pub fn marked(self, mark: Mark) -> Self {
        Self { mark: Some(mark), ..self }
    }

    /// Leading to a place on the axis of the page's charts.
    pub fn leading_to(self, at: f64) -> Self {
        Self { at: Some(at), ..self }
    }
}
