use std::fmt;
use std::path::Path;

use garde::Validate;
use serde::de::DeserializeOwned;
use serde_saphyr::{MessageFormatter, NonFiniteFloatPolicy, UserMessageFormatter};

use crate::LoadError;
use crate::source::Source;
use crate::tree::{Node, Span, Value};

/// A YAML file: its text, its tree, and for a resolved scenario the file it was resolved from.
#[derive(Debug, Clone)]
pub(crate) struct Document {
    pub source: Source,
    pub tree: Node,
    overlay: Option<Overlay>,
}

/// Where the values of a resolved scenario come from.
#[derive(Debug, Clone)]
struct Overlay {
    written: Box<Document>,
    changes: Vec<Change>,
}

/// One value that is not the file's own.
#[derive(Debug, Clone)]
pub(crate) struct Change {
    pub key: String,
    pub origin: Origin,
}

/// Who changed a value.
#[derive(Debug, Clone)]
pub(crate) enum Origin {
    /// The command line.
    Set,
    /// An entry of `randomize`, drawn from a seed.
    Drawn { entry: usize, seed: u64 },
    /// An entry of `randomize`: a value that some seed may draw.
    Drawable { entry: usize },
}

impl fmt::Display for Origin {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Set => f.write_str("from --set"),
            Self::Drawn { entry, seed } => write!(f, "drawn by randomize.{entry} from seed {seed}"),
            Self::Drawable { entry } => write!(f, "which randomize.{entry} may draw"),
        }
    }
}

pub(crate) fn options() -> serde_saphyr::Options {
    // Own diagnostics carry the snippet, under the file's real name and alike for every kind of problem.
    serde_saphyr::options! {
        with_snippet: false,
        non_finite_float_policy: NonFiniteFloatPolicy::PassThrough,
    }
}

impl Document {
    pub fn read(path: &Path) -> Result<Self, LoadError> {
        Self::parse(Source::read(path)?)
    }

    pub fn parse(source: Source) -> Result<Self, LoadError> {
        let bare = |line: &str| line.trim().is_empty() || line.trim_start().starts_with('#');
        if source.text.lines().all(bare) {
            return Err(LoadError::new(&source.path, "the file holds nothing but comments"));
        }
        let tree = serde_saphyr::from_str_with_options::<Node>(&source.text, options()).map_err(|error| {
            let (message, span) = describe(&error);
            let fault = LoadError::new(&source.path, message);
            match span {
                Some(span) => fault.with_place(&source.text, span.offset, span.len),
                None => fault,
            }
        })?;
        Self { source, tree, overlay: None }.finite()
    }

    /// The document that `changed`, a tree made from this one, is; reads like a file again.
    pub fn resolve(&self, changed: &Node, changes: Vec<Change>) -> Result<Self, LoadError> {
        let text = serde_saphyr::to_string(changed).map_err(|error| {
            LoadError::new(&self.source.path, format!("cannot be written again: {error}"))
        })?;
        let source = Source::from_text(&self.source.path, text)?;
        let tree = serde_saphyr::from_str_with_options::<Node>(&source.text, options())
            .map_err(|error| LoadError::new(&self.source.path, describe(&error).0))?;
        let overlay = Overlay { written: Box::new(self.clone()), changes };
        Self { source, tree, overlay: Some(overlay) }.finite()
    }

    /// Refuses numbers that are none, wherever they stand: no bound catches NaN.
    fn finite(self) -> Result<Self, LoadError> {
        let mut bad = None;
        self.tree.walk(String::new(), &mut |key, node, _| {
            if matches!(node.value, Value::Float(value) if !value.is_finite()) {
                bad.get_or_insert_with(|| key.to_owned());
            }
        });
        match bad {
            Some(key) => Err(self.fail(&key, "must be a finite number")),
            None => Ok(self),
        }
    }

    /// The document as a raw type, keys, types and ranges checked.
    pub fn typed<T: DeserializeOwned + Validate<Context = ()>>(&self) -> Result<T, LoadError> {
        let raw: T = serde_saphyr::from_str_with_options(&self.source.text, options())
            .map_err(|error| self.yaml_error(&error))?;
        match raw.validate() {
            Ok(()) => Ok(raw),
            Err(report) => Err(self.range_error(&report)),
        }
    }

    fn yaml_error(&self, error: &serde_saphyr::Error) -> LoadError {
        let (message, span) = describe(error);
        let Some(span) = span else { return self.fail("", message) };
        let key = self.tree.key_at(span.offset).unwrap_or_default();
        if !message.starts_with("missing ") {
            // The reader's own place: an unknown key is underlined itself, not its value.
            return match self.overlay {
                Some(_) => self.fail(&key, message),
                None => self.fail(&key, message).with_place(&self.source.text, span.offset, span.len),
            };
        }
        // The place of a missing key is the start of its block, where the block's first key stands.
        match key.rsplit_once('.') {
            Some((block, _)) => self.fail(block, message),
            None => self.fail("", message),
        }
    }

    /// The first problem of the report in the order of the file.
    fn range_error(&self, report: &garde::Report) -> LoadError {
        let place = |key: &str| self.tree.place(key).map_or(0, |span| span.offset);
        let problems = report.iter().map(|(path, error)| {
            let key = path.to_string().replace('[', ".").replace(']', "");
            let message = error.message().to_owned();
            (key.trim_start_matches('.').to_owned(), message)
        });
        let mut problems: Vec<_> = problems.collect();
        problems.sort_by_key(|(key, _)| place(key));
        let more = problems.len().saturating_sub(1);
        let Some((key, message)) = problems.into_iter().next() else {
            return self.fail("", "is out of range");
        };
        let message = match (message.strip_prefix("lower than "), message.strip_prefix("greater than ")) {
            (Some(bound), _) => format!("must be at least {bound}"),
            (_, Some(bound)) => format!("must be at most {bound}"),
            _ => message,
        };
        let error = self.fail(&key, message);
        if more > 0 { error.with_help(format!("{more} more out of range in this file")) } else { error }
    }

    /// A problem with the value at a dotted key, pointing at the place where a person wrote it.
    pub fn fail(&self, key: &str, message: impl Into<String>) -> LoadError {
        let message = message.into();
        let value = self.tree.get(key).and_then(Node::shown).filter(|_| !key.is_empty());
        let Some(overlay) = &self.overlay else {
            return self.point(LoadError::new(&self.source.path, message).with_key(key, value), key);
        };
        let under = |a: &str, b: &str| a == b || a.strip_prefix(b).is_some_and(|rest| rest.starts_with('.'));
        let related =
            |change: &&Change| under(key, &change.key) || (under(&change.key, key) && !key.is_empty());
        let Some(change) = overlay.changes.iter().rev().find(related) else {
            // The file's own value is refused beside a changed one: say which.
            let list: Vec<_> = overlay.changes.iter().map(|change| self.change_shown(change)).collect();
            let message =
                if list.is_empty() { message } else { format!("{message} (with {})", list.join("; ")) };
            return overlay
                .written
                .point(LoadError::new(&self.source.path, message).with_key(key, value), key);
        };
        let error = LoadError::new(&self.source.path, format!("{message} ({})", change.origin));
        let error = error.with_key(key, value);
        match change.origin {
            Origin::Set => error,
            Origin::Drawn { entry, .. } | Origin::Drawable { entry } => {
                overlay.written.point(error, &format!("randomize.{entry}.key"))
            }
        }
    }

    /// As [`Self::fail`], for a value that may be a default: it is told even when no file holds it.
    pub fn fail_value(&self, key: &str, value: f64, message: impl Into<String>) -> LoadError {
        self.fail(key, message).with_key(key, Some(value.to_string()))
    }

    fn change_shown(&self, change: &Change) -> String {
        let value = self.tree.get(&change.key).and_then(Node::shown).unwrap_or_else(|| "…".to_owned());
        format!("{} = {value} {}", change.key, change.origin)
    }

    fn point(&self, error: LoadError, key: &str) -> LoadError {
        match self.tree.place(key) {
            Some(span) => error.with_place(&self.source.text, span.offset, span.len),
            None => error,
        }
    }
}

/// What the YAML reader says, without the place, which is told apart.
fn describe(error: &serde_saphyr::Error) -> (String, Option<Span>) {
    let message = UserMessageFormatter.format_message(error.without_snippet());
    let message = message.escape_debug().to_string().replace("\\'", "'").replace("\\\"", "\"");
    let plain = match message.as_str() {
        "invalid floating point" => "must be a number".to_owned(),
        whole if whole.starts_with("invalid u") => "must be a whole number, 0 or more".to_owned(),
        whole if whole.starts_with("invalid i") && whole.len() < 13 => "must be a whole number".to_owned(),
        _ => message,
    };
    (plain, error.location().map(Span::from))
}
