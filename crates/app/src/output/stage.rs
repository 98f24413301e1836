use std::fs;
use std::io;
use std::path::{Path, PathBuf};

use tempfile::TempDir;

use super::OutputError;

/// A run's file that is written last and removed first: who finds it finds the others whole.
const LAST: &str = "summary.json";

/// A hidden folder beside the final one, in which all files are written before they get their names.
/// Dropped without [`Stage::publish`], it vanishes and the final folder is as it was.
#[derive(Debug)]
pub struct Stage {
    folder: TempDir,
    target: PathBuf,
    last: &'static str,
}

impl Stage {
    /// Prepares to write a run's `target`, whose parent folders are created when missing.
    pub fn new(target: &Path) -> Result<Self, OutputError> {
        Self::ending_with(target, LAST)
    }

    /// As [`Stage::new`] for files of which `last` stands for all: it is published last and removed first.
    pub fn ending_with(target: &Path, last: &'static str) -> Result<Self, OutputError> {
        let absolute = std::path::absolute(target).map_err(|source| OutputError::at(target, source))?;
        let (Some(parent), Some(name)) = (absolute.parent(), absolute.file_name()) else {
            let source = io::Error::new(io::ErrorKind::InvalidInput, "not the name of a folder");
            return Err(OutputError::at(target, source));
        };
        if absolute.exists() && !absolute.is_dir() {
            let source = io::Error::new(io::ErrorKind::NotADirectory, "exists and is no folder");
            return Err(OutputError::at(target, source));
        }
        fs::create_dir_all(parent).map_err(|source| OutputError::at(parent, source))?;
        let prefix = format!(".{}.", name.to_string_lossy());
        let folder = tempfile::Builder::new()
            .prefix(&prefix)
            .tempdir_in(parent)
            .map_err(|source| OutputError::at(parent, source))?;
        Ok(Self { folder, target: absolute, last })
    }

    /// Where to write the file that will be called `name`.
    pub fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    /// Writes one file.
    pub fn write(&self, name: &str, content: impl AsRef<[u8]>) -> Result<(), OutputError> {
        fs::write(self.path(name), content).map_err(|source| OutputError::at(&self.target.join(name), source))
    }

    /// Gives all files their final names. A folder that exists already keeps foreign files; those of
    /// `replaced` that this run did not write are removed, so that no two runs are mixed.
    pub fn publish(self, replaced: &[&str]) -> Result<(), OutputError> {
        let at_target = |source| OutputError::at(&self.target, source);
        if !self.target.exists() {
            make_readable(self.folder.path()).map_err(at_target)?;
            fs::rename(self.folder.path(), &self.target).map_err(at_target)?;
            return Ok(());
        }
        for name in [self.last].iter().chain(replaced) {
            match fs::remove_file(self.target.join(name)) {
                Err(source) if source.kind() != io::ErrorKind::NotFound => {
                    return Err(OutputError::at(&self.target.join(name), source));
                }
                _ => {}
            }
        }
        let mut names: Vec<_> = fs::read_dir(self.folder.path())
            .and_then(|entries| entries.map(|entry| Ok(entry?.file_name())).collect::<io::Result<_>>())
            .map_err(at_target)?;
        names.sort_by_key(|name| (name == self.last, name.clone()));
        for name in names {
            let to = self.target.join(&name);
            fs::rename(self.folder.path().join(&name), &to).map_err(|source| OutputError::at(&to, source))?;
        }
        Ok(())
    }
}

/// A temporary folder is made for its owner alone; the result is for everyone who may read its parent.
#[cfg(unix)]
fn make_readable(folder: &Path) -> io::Result<()> {
    use std::os::unix::fs::PermissionsExt;
    fs::set_permissions(folder, fs::Permissions::from_mode(0o755))
}

#[cfg(not(unix))]
fn make_readable(_folder: &Path) -> io::Result<()> {
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn names(folder: &Path) -> Vec<String> {
        let mut names: Vec<String> = fs::read_dir(folder)
            .unwrap()
            .map(|entry| entry.unwrap().file_name().to_string_lossy().into_owned())
            .collect();
        names.sort();
        names
    }

    #[test]
    fn nothing_shows_before_it_is_published() {
        let root = tempfile::tempdir().unwrap();
        let target = root.path().join("deep/out");
        let stage = Stage::new(&target).unwrap();
        stage.write("summary.json", "{}").unwrap();
        stage.write("images.csv", "a").unwrap();
        assert!(!target.exists());
        stage.publish(&[]).unwrap();
        assert_eq!(names(&target), ["images.csv", "summary.json"]);
        assert_eq!(names(&root.path().join("deep")), ["out"], "nothing is left beside it");
    }

    #[test]
    fn a_dropped_stage_leaves_the_old_files() {
        let root = tempfile::tempdir().unwrap();
        let target = root.path().join("out");
        fs::create_dir(&target).unwrap();
        fs::write(target.join("summary.json"), "old").unwrap();
        let stage = Stage::new(&target).unwrap();
        stage.write("summary.json", "new").unwrap();
        drop(stage);
        assert_eq!(fs::read_to_string(target.join("summary.json")).unwrap(), "old");
        assert_eq!(names(root.path()), ["out"]);
    }

    #[test]
    fn a_second_run_replaces_the_first_and_keeps_foreign_files() {
        let root = tempfile::tempdir().unwrap();
        let target = root.path().join("out");
        fs::create_dir(&target).unwrap();
        for name in ["summary.json", "video.gif", "notes.txt"] {
            fs::write(target.join(name), "old").unwrap();
        }
        let stage = Stage::new(&target).unwrap();
        stage.write("summary.json", "new").unwrap();
        stage.write("video.mp4", "new").unwrap();
        stage.publish(&["video.gif", "video.mp4"]).unwrap();
        assert_eq!(names(&target), ["notes.txt", "summary.json", "video.mp4"]);
        assert_eq!(fs::read_to_string(target.join("summary.json")).unwrap(), "new");
        assert_eq!(names(root.path()), ["out"]);
    }

    #[test]
    fn a_file_in_the_way_is_named() {
        let root = tempfile::tempdir().unwrap();
        let target = root.path().join("out");
        fs::write(&target, "a file").unwrap();
        let error = Stage::new(&target).unwrap_err().to_string();
        assert!(error.contains("out") && error.contains("no folder"), "{error}");
    }
}
