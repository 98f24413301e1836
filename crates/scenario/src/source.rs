use std::path::{Component, Path, PathBuf};
use std::sync::Arc;

use crate::LoadError;

/// Largest file that is read at all; the files people write are a few kilobytes.
const MAX_BYTES: u64 = 8 << 20;

/// A text file in memory.
#[derive(Debug, Clone)]
pub(crate) struct Source {
    pub path: PathBuf,
    pub text: Arc<str>,
}

impl Source {
    /// Reads a file; refuses what is not there, not text, empty or far too long.
    pub fn read(path: &Path) -> Result<Self, LoadError> {
        let fail = |message: String| LoadError::new(path, message);
        let meta = std::fs::metadata(path).map_err(|error| fail(reason(&error)))?;
        if !meta.is_file() {
            return Err(fail("is not a file".to_owned()));
        }
        if meta.len() > MAX_BYTES {
            return Err(fail(format!("holds {} bytes, at most {MAX_BYTES} are read", meta.len())));
        }
        let bytes = std::fs::read(path).map_err(|error| fail(reason(&error)))?;
        let text = String::from_utf8(bytes).map_err(|error| {
            let at = error.utf8_error().valid_up_to();
            let byte = error.as_bytes()[at];
            fail(format!("is not a text file: byte {at} (0x{byte:02x}) is not UTF-8"))
        })?;
        Self::from_text(path, text)
    }

    /// A text that stands for the file at `path`.
    pub fn from_text(path: &Path, text: String) -> Result<Self, LoadError> {
        if let Some(at) = text.bytes().position(|byte| byte == 0) {
            return Err(LoadError::new(path, format!("is not a text file: byte {at} is 0")));
        }
        if text.trim().is_empty() {
            return Err(LoadError::new(path, "the file is empty"));
        }
        Ok(Self { path: path.to_owned(), text: text.into() })
    }

    /// The path of a file named inside this one, relative to this one's folder.
    pub fn sibling(&self, relative: &str) -> PathBuf {
        tidy(&self.path.parent().unwrap_or(Path::new("")).join(relative))
    }
}

/// Why the operating system refused, without its error number.
fn reason(error: &std::io::Error) -> String {
    match error.kind() {
        std::io::ErrorKind::NotFound => "there is no such file".to_owned(),
        std::io::ErrorKind::PermissionDenied => "may not be read (permission denied)".to_owned(),
        _ => format!("cannot be read: {error}"),
    }
}

/// Folds `folder/..` away so that messages show the short path. Kept as it is where that would change its
/// meaning: behind a link.
fn tidy(path: &Path) -> PathBuf {
    let mut short = PathBuf::new();
    for part in path.components() {
        match part {
            Component::CurDir => {}
            Component::ParentDir => match short.components().next_back() {
                Some(Component::Normal(_)) if !short.is_symlink() => {
                    short.pop();
                }
                _ => short.push(part),
            },
            _ => short.push(part),
        }
    }
    short
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn paths_are_shown_short() {
        let source = Source { path: "box/scenarios/faults/a.yaml".into(), text: "".into() };
        assert_eq!(source.sibling("../../robots/./r.yaml"), Path::new("box/robots/r.yaml"));
        let top = Source { path: "a.yaml".into(), text: "".into() };
        assert_eq!(top.sibling("../r.yaml"), Path::new("../r.yaml"));
    }
}
