//! A domain keeps one run apart from all others: its own prefix in shared memory, its own root folder, and
//! a lock file beside that folder which the simulator holds while it lives.
//!
//! The kernel frees the lock with the process, however that ends, so "the lock is free" means "the simulator
//! is dead" without looking at process numbers, and whoever holds the lock may remove the domain.

use std::{
    fs::{self, DirBuilder, File, OpenOptions, TryLockError},
    hash::{BuildHasher, Hasher, RandomState},
    io,
    os::unix::fs::{DirBuilderExt, MetadataExt, OpenOptionsExt},
    path::{Path, PathBuf},
    sync::Arc,
};

use crate::{
    WireError,
    clean::{self, Reaped},
};

/// Bytes that a socket's name needs below the root beside the prefix: a slash, a 128-bit number and `.event`.
const SOCKET_NAME_BYTES: usize = 1 + 39 + 6;
/// `sun_path` of a Unix socket holds 108 bytes with the closing zero.
const SOCKET_PATH_BYTES: usize = 107;
/// Longest name that is accepted.
const MAX_NAME_BYTES: usize = 48;

/// One run's place in shared memory. Clones share it; the last one dropped tidies up. An endpoint keeps one behind
/// its ports, services and node, so that these are gone before their folder is.
#[derive(Debug, Clone)]
pub struct Domain {
    inner: Arc<Inner>,
}

#[derive(Debug)]
struct Inner {
    name: String,
    root: PathBuf,
    /// Held by the simulator's side only.
    lock: Option<File>,
}

impl Domain {
    /// Makes a new domain below [`default_base`] and takes its lock; the simulator's side.
    ///
    /// Left-overs of dead runs are removed first. Everything is removed again when the last clone is dropped.
    ///
    /// # Errors
    /// [`WireError::ForeignBase`], [`WireError::RootTooLong`] or [`WireError::Io`].
    pub fn create() -> Result<Self, WireError> {
        let base = default_base();
        ensure_base(&base)?;
        // What cannot be removed is not this run's concern; `sonoloop clean` reports it.
        let _ = clean::clean_in(&base);
        Self::create_in(&base)
    }

    /// As [`Domain::create`], below a folder of the caller's choice, which is made if need be.
    ///
    /// # Errors
    /// [`WireError::ForeignBase`], [`WireError::RootTooLong`] or [`WireError::Io`].
    pub fn create_in(base: &Path) -> Result<Self, WireError> {
        let base = std::path::absolute(base).map_err(io_error("cannot find", base))?;
        loop {
            ensure_base(&base)?;
            let short = format!("{}_{:06x}", std::process::id(), entropy() & 0xff_ffff);
            let root = base.join(&short);
            let name = name_of(&short);
            check_length(&root, &name)?;
            let lock_path = lock_path(&root);
            let file = match OpenOptions::new().write(true).create_new(true).mode(0o600).open(&lock_path) {
                Ok(file) => file,
                // The same name by chance, or the base was removed under us: try again.
                Err(error)
                    if matches!(error.kind(), io::ErrorKind::AlreadyExists | io::ErrorKind::NotFound) =>
                {
                    continue;
                }
                Err(error) => return Err(io_error("cannot make", &lock_path)(error)),
            };
            match file.try_lock() {
                Ok(()) => {}
                // A cleaner took the new file for a left-over; it will remove it.
                Err(TryLockError::WouldBlock) => continue,
                Err(TryLockError::Error(error)) => return Err(io_error("cannot lock", &lock_path)(error)),
            }
            if !same_file(&file, &lock_path) {
                continue;
            }
            let inner = Inner { name, root, lock: Some(file) };
            DirBuilder::new()
                .mode(0o700)
                .create(&inner.root)
                .map_err(io_error("cannot make", &inner.root))?;
            return Ok(Self { inner: Arc::new(inner) });
        }
    }

    /// Joins the domain of a living simulator; the tracker's and the viewer's side.
    ///
    /// # Errors
    /// [`WireError::BadName`], or [`WireError::NotRunning`] when nobody holds the domain's lock.
    pub fn open(name: &str, root: &Path) -> Result<Self, WireError> {
        if !is_name(name) {
            return Err(WireError::BadName { name: name.into() });
        }
        let root = std::path::absolute(root).map_err(io_error("cannot find", root))?;
        check_length(&root, name)?;
        if !lock_is_held(&lock_path(&root)) {
            return Err(WireError::NotRunning { name: name.into(), root });
        }
        Ok(Self { inner: Arc::new(Inner { name: name.into(), root, lock: None }) })
    }

    /// Joins the domain that a tracker is given through its environment.
    ///
    /// # Errors
    /// As [`Domain::open`]; a missing variable is a [`WireError::BadName`].
    pub fn from_environment() -> Result<Self, WireError> {
        let name = std::env::var(crate::DOMAIN_VARIABLE).unwrap_or_default();
        let root = std::env::var_os(crate::ROOT_VARIABLE).unwrap_or_default();
        if root.is_empty() {
            return Err(WireError::BadName { name });
        }
        Self::open(&name, Path::new(&root))
    }

    /// Name of the domain, which is the prefix of all its shared memory.
    pub fn name(&self) -> &str {
        &self.inner.name
    }

    /// Folder of the domain's sockets and service files.
    pub fn root(&self) -> &Path {
        &self.inner.root
    }

    /// True while the simulator lives, that is, while the domain's lock is held.
    pub fn is_alive(&self) -> bool {
        self.is_owner() || lock_is_held(&lock_path(self.root()))
    }

    pub(crate) fn is_owner(&self) -> bool {
        self.inner.lock.is_some()
    }

    pub(crate) fn not_running(&self) -> WireError {
        WireError::NotRunning { name: self.name().into(), root: self.root().into() }
    }
}

impl Drop for Inner {
    fn drop(&mut self) {
        if self.lock.is_some() {
            clean::remove_domain(&self.name, &self.root);
            // The name of the lock goes last, while it is still locked: nobody can step in between.
            let _ = fs::remove_file(lock_path(&self.root));
        } else if let Reaped::Gone = clean::reap(&self.name, &self.root) {
            // Someone cleaned up after the dead simulator while we were still attached.
            clean::remove_domain(&self.name, &self.root);
        }
    }
}

/// The folder that holds this user's domains: `/tmp/sonoloop-<uid>`.
///
/// `/tmp` rather than `TMPDIR`, so that a later run finds the left-overs of an earlier one whatever its
/// environment, and because the names of sockets must stay short.
pub fn default_base() -> PathBuf {
    let temporary = Path::new("/tmp");
    let temporary = if temporary.is_dir() { temporary.to_path_buf() } else { std::env::temp_dir() };
    temporary.join(format!("sonoloop-{}", user_id()))
}

fn user_id() -> u32 {
    rustix::process::geteuid().as_raw()
}

fn ensure_base(base: &Path) -> Result<(), WireError> {
    match DirBuilder::new().mode(0o700).create(base) {
        Ok(()) => return Ok(()),
        Err(error) if error.kind() == io::ErrorKind::AlreadyExists => {}
        Err(error) => return Err(io_error("cannot make", base)(error)),
    }
    // Not through a link: in a shared folder the link may be someone else's.
    let metadata = fs::symlink_metadata(base).map_err(io_error("cannot read", base))?;
    if !metadata.is_dir() || metadata.uid() != user_id() {
        return Err(WireError::ForeignBase { path: base.into(), owner: metadata.uid(), user: user_id() });
    }
    Ok(())
}

/// Name of the domain whose root folder is called `short`.
pub(crate) fn name_of(short: &str) -> String {
    // The closing underscore keeps one name from being the beginning of another.
    format!("sl_{short}_")
}

pub(crate) fn is_name(name: &str) -> bool {
    name.len() <= MAX_NAME_BYTES
        && name.len() > "sl__".len()
        && name.starts_with("sl_")
        && name.ends_with('_')
        && name.bytes().all(|byte| byte.is_ascii_alphanumeric() || byte == b'_')
}

pub(crate) fn lock_path(root: &Path) -> PathBuf {
    let mut path = root.as_os_str().to_owned();
    path.push(".lock");
    path.into()
}

/// True when `file` is still what `path` names.
pub(crate) fn same_file(file: &File, path: &Path) -> bool {
    match (file.metadata(), fs::symlink_metadata(path)) {
        (Ok(open), Ok(named)) => open.ino() == named.ino() && open.dev() == named.dev(),
        _ => false,
    }
}

fn lock_is_held(path: &Path) -> bool {
    // A shared lock: two observers must not take each other for a simulator.
    OpenOptions::new()
        .read(true)
        .open(path)
        .is_ok_and(|file| matches!(file.try_lock_shared(), Err(TryLockError::WouldBlock)))
}

fn check_length(root: &Path, name: &str) -> Result<(), WireError> {
    let bytes = root.as_os_str().len() + SOCKET_NAME_BYTES + name.len();
    match bytes.checked_sub(SOCKET_PATH_BYTES) {
        None | Some(0) => Ok(()),
        Some(excess) => Err(WireError::RootTooLong { path: root.into(), excess }),
    }
}

fn entropy() -> u64 {
    // Randomly keyed by the standard library; a name needs no better.
    RandomState::new().build_hasher().finish()
}

fn io_error(what: &'static str, path: &Path) -> impl FnOnce(io::Error) -> WireError {
    let path = path.to_path_buf();
    move |source| WireError::Io { what, path, source }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_checked() {
        for good in ["sl_1_a_", "sl_4194304_00ff00_"] {
            assert!(is_name(good), "{good}");
        }
        for bad in
            ["", "sl_", "sl__", "sl_1", "xx_1_a_", "sl_../a_", "sl_1 _", &format!("sl_{}_", "a".repeat(60))]
        {
            assert!(!is_name(bad), "{bad}");
        }
    }

    #[test]
    fn a_root_that_leaves_no_room_for_sockets_is_refused() {
        let root = PathBuf::from(format!("/tmp/{}", "a".repeat(60)));
        assert!(matches!(check_length(&root, "sl_1_a_"), Err(WireError::RootTooLong { excess: 11, .. })));
        assert!(
            check_length(Path::new("/tmp/sonoloop-4294967294/4194304_ffffff"), "sl_4194304_ffffff_").is_ok()
        );
    }

    #[test]
    fn a_base_that_is_no_folder_is_refused() {
        let folder = tempfile::tempdir().unwrap();
        let base = folder.path().join("base");
        fs::write(&base, b"").unwrap();
        assert!(matches!(Domain::create_in(&base), Err(WireError::ForeignBase { .. })));
    }
}
