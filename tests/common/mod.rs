//! What the end-to-end tests share: the program under test, with a watchdog.
#![allow(dead_code, reason = "each test binary uses a part")]

use std::io::Read;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, ExitStatus, Stdio};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::{Duration, Instant};

/// Longest any wait may take; a hang becomes a failure instead of a stuck gate. Nothing is measured against it.
const WATCHDOG: Duration = Duration::from_secs(240);

/// Top folder of the repository.
pub fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../..").canonicalize().expect("the repository is there")
}

/// Path of a file of the repository.
pub fn file(relative: &str) -> PathBuf {
    root().join(relative)
}

/// The program, started in the repository's top folder.
pub fn program() -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_sonoloop"));
    command.current_dir(root()).stdin(Stdio::null());
    command
}

/// What a finished program left behind.
pub struct Finished {
    pub status: ExitStatus,
    pub stdout: String,
    pub stderr: String,
}

impl Finished {
    pub fn code(&self) -> i32 {
        self.status.code().unwrap_or(-1)
    }

    pub fn json(&self) -> serde_json::Value {
        serde_json::from_str(&self.stdout)
            .unwrap_or_else(|e| panic!("stdout is no JSON ({e}):\n{}\n{}", self.stdout, self.stderr))
    }
}

/// Waits for something that must come.
pub fn wait_for<T>(what: &str, mut look: impl FnMut() -> Option<T>) -> T {
    let began = Instant::now();
    loop {
        if let Some(found) = look() {
            return found;
        }
        assert!(began.elapsed() < WATCHDOG, "{what}: waited in vain");
        std::thread::sleep(Duration::from_millis(3));
    }
}

/// A child that does not outlive its test.
pub struct Guarded(pub Child);

impl Guarded {
    /// Waits for its end, with the watchdog.
    pub fn wait(&mut self) -> ExitStatus {
        wait_for("the program's end", || self.0.try_wait().expect("the child can be waited for"))
    }
}

impl Drop for Guarded {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

/// Starts a program with piped output.
pub fn start(mut command: Command) -> Guarded {
    Guarded(command.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().expect("the program starts"))
}

/// Waits for a started program, with the watchdog.
pub fn finish(mut child: Guarded) -> Finished {
    let mut out = child.0.stdout.take().expect("piped");
    let mut err = child.0.stderr.take().expect("piped");
    let stdout = std::thread::spawn(move || {
        let mut text = String::new();
        let _ = out.read_to_string(&mut text);
        text
    });
    let stderr = std::thread::spawn(move || {
        let mut text = String::new();
        let _ = err.read_to_string(&mut text);
        text
    });
    let status = child.wait();
    Finished { status, stdout: stdout.join().expect("reader"), stderr: stderr.join().expect("reader") }
}

/// Runs the program to its end.
pub fn sonoloop(arguments: &[&str]) -> Finished {
    let mut command = program();
    command.args(arguments);
    finish(start(command))
}

/// Every scenario of the repository, sorted.
pub fn scenarios() -> Vec<PathBuf> {
    fn walk(folder: &Path, files: &mut Vec<PathBuf>) {
        for entry in std::fs::read_dir(folder).expect("readable folder") {
            let path = entry.expect("entry").path();
            if path.is_dir() {
                walk(&path, files);
            } else if path.extension().is_some_and(|e| e == "yaml") {
                files.push(path);
            }
        }
    }
    let mut files = Vec::new();
    walk(&file("scenarios"), &mut files);
    files.sort();
    assert!(files.len() >= 4, "at least four scenarios are committed");
    files
}

/// Does the same for every case, two at a time.
pub fn for_each<T: Sync>(cases: &[T], check: impl Fn(&T) + Sync) {
    let next = AtomicUsize::new(0);
    std::thread::scope(|scope| {
        for _ in 0..2 {
            scope.spawn(|| {
                while let Some(case) = cases.get(next.fetch_add(1, Ordering::Relaxed)) {
                    check(case);
                }
            });
        }
    });
}
