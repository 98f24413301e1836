//! Removal of what crashed runs left behind; only of domains whose lock is free.

use std::{
    fs::{self, OpenOptions, TryLockError},
    io,
    path::{Path, PathBuf},
};

use crate::domain::{default_base, is_name, lock_path, name_of, same_file};

/// Where Linux keeps named shared memory.
const SHARED_MEMORY: &str = "/dev/shm";

/// What a clean-up found.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct CleanReport {
    /// Names of the dead domains that were removed.
    pub removed: Vec<String>,
    /// Number of living domains, which were left alone.
    pub live: usize,
    /// What should have gone but could not, and why.
    pub failed: Vec<(PathBuf, String)>,
}

/// What became of one domain.
pub(crate) enum Reaped {
    /// Its simulator lives.
    Live,
    /// It was dead and is removed; with what could not be removed.
    Removed(Vec<(PathBuf, String)>),
    /// There is no lock file (any more).
    Gone,
    /// The lock could not be examined.
    Failed(PathBuf, String),
}

/// Removes the left-overs of this user's dead runs below [`default_base`]. Never touches a living one.
pub fn clean() -> CleanReport {
    clean_in(&default_base())
}

/// As [`clean`], below another folder.
pub fn clean_in(base: &Path) -> CleanReport {
    let mut report = CleanReport::default();
    let entries = match fs::read_dir(base) {
        Ok(entries) => entries,
        Err(error) if error.kind() == io::ErrorKind::NotFound => return report,
        Err(error) => {
            report.failed.push((base.into(), error.to_string()));
            return report;
        }
    };
    // A folder is made after its lock file and removed before it, so a folder *listed now* that has no lock
    // file afterwards is a left-over too; `reap` below makes that later look.
    let mut shorts: Vec<String> = entries
        .flatten()
        .filter_map(|entry| entry.file_name().into_string().ok())
        .map(|file| file.strip_suffix(".lock").map(str::to_owned).unwrap_or(file))
        .filter(|short| is_name(&name_of(short)))
        .collect();
    shorts.sort();
    shorts.dedup();
    for short in shorts {
        let (name, root) = (name_of(&short), base.join(&short));
        match reap(&name, &root) {
            Reaped::Live => report.live += 1,
            Reaped::Removed(failed) => {
                report.failed.extend(failed);
                report.removed.push(name);
            }
            Reaped::Gone => {
                let failed = remove_domain(&name, &root);
                report.failed.extend(failed);
            }
            Reaped::Failed(path, reason) => report.failed.push((path, reason)),
        }
    }
    report
}

/// Removes a domain if its lock is free, holding the lock meanwhile.
pub(crate) fn reap(name: &str, root: &Path) -> Reaped {
    let path = lock_path(root);
    let file = match OpenOptions::new().read(true).open(&path) {
        Ok(file) => file,
        Err(error) if error.kind() == io::ErrorKind::NotFound => return Reaped::Gone,
        Err(error) => return Reaped::Failed(path, error.to_string()),
    };
    match file.try_lock() {
        Ok(()) => {}
        Err(TryLockError::WouldBlock) => return Reaped::Live,
        Err(TryLockError::Error(error)) => return Reaped::Failed(path, error.to_string()),
    }
    // Between opening and locking another cleaner may have removed the file.
    if !same_file(&file, &path) {
        return Reaped::Gone;
    }
    let mut failed = remove_domain(name, root);
    if let Err(error) = fs::remove_file(&path) {
        failed.push((path, error.to_string()));
    }
    Reaped::Removed(failed)
}

/// Removes a domain's shared memory and root folder; returns what could not be removed.
pub(crate) fn remove_domain(name: &str, root: &Path) -> Vec<(PathBuf, String)> {
    let mut failed = Vec::new();
    let mut note = |path: &Path, result: io::Result<()>| match result {
        Err(error) if error.kind() != io::ErrorKind::NotFound => {
            failed.push((path.into(), error.to_string()))
        }
        _ => {}
    };
    if let Ok(entries) = fs::read_dir(SHARED_MEMORY) {
        for entry in entries.flatten() {
            if entry.file_name().to_string_lossy().starts_with(name) {
                note(&entry.path(), fs::remove_file(entry.path()));
            }
        }
    }
    note(root, fs::remove_dir_all(root));
    failed
}
