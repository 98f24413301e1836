//! A resolved scenario as a file of another folder.

use std::path::{Component, Path, PathBuf};

use crate::document::Document;
use crate::source::Source;
use crate::tree::{Node, Value};
use crate::{LoadError, Scenario};

/// Keys that name files, relative to the scenario's folder.
const FILES: [&str; 5] = ["robot", "needle_robot", "probe", "needle", "phantom"];

impl Scenario {
    /// [`Scenario::resolved_yaml`] as it must stand in a file of `folder`, which need not exist yet: the files that it
    /// names are found from there, and it keeps its name.
    ///
    /// # Errors
    ///
    /// When a file that it names has gone meanwhile.
    pub fn resolved_yaml_for(&self, folder: &Path) -> Result<String, LoadError> {
        let document = Document::parse(Source::from_text(&self.source, self.resolved_yaml.clone())?)?;
        let mut tree = document.tree.clone();
        let mut set = |key: &str, value: String| {
            tree.set(key, Node::bare(Value::Text(value))).map_err(|why| document.fail(key, why))
        };
        set("name", self.name.clone())?;
        for key in FILES {
            let named = document.tree.get(key).map(|node| &node.value);
            let Some(Value::Text(named)) = named else { continue };
            let path = document.source.sibling(named);
            let there = path.canonicalize().map_err(|error| document.fail(key, error.to_string()))?;
            let here = canonical(folder).map_err(|error| document.fail(key, error.to_string()))?;
            let relative = relative(&here, &there);
            let Some(relative) = relative.to_str() else {
                return Err(document.fail(key, "its path is no text"));
            };
            set(key, relative.to_owned())?;
        }
        let text = document.resolve(&tree, Vec::new())?.source.text;
        Ok(format!("# {}, seed {}, with all overrides and draws applied.\n{text}", self.name, self.seed))
    }
}

/// The absolute path without links of a folder whose last parts may not exist yet.
fn canonical(folder: &Path) -> std::io::Result<PathBuf> {
    let absolute = std::path::absolute(folder)?;
    for parent in absolute.ancestors() {
        if let Ok(there) = parent.canonicalize() {
            let missing = absolute.strip_prefix(parent).unwrap_or(Path::new(""));
            return Ok(there.join(missing));
        }
    }
    Ok(absolute)
}

/// The way from one folder to a path; both absolute and without links.
fn relative(from: &Path, to: &Path) -> PathBuf {
    let shared = from.components().zip(to.components()).take_while(|(a, b)| a == b).count();
    let up = from.components().skip(shared).map(|_| Component::ParentDir);
    up.chain(to.components().skip(shared)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_way_goes_up_and_down_again() {
        let way = |from: &str, to: &str| relative(Path::new(from), Path::new(to));
        assert_eq!(way("/a/b/out", "/a/b/robots/r.yaml"), Path::new("../robots/r.yaml"));
        assert_eq!(way("/a", "/a/r.yaml"), Path::new("r.yaml"));
        assert_eq!(way("/x/y", "/a/r.yaml"), Path::new("../../a/r.yaml"));
    }
}
