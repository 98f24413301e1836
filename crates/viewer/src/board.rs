use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use tokio::sync::watch;

/// What every browser is shown. Posting never waits for a browser; a browser that is slow misses pictures, never rows.
#[derive(Debug)]
pub struct Board {
    state: Mutex<State>,
    changed: watch::Sender<()>,
    watchers: AtomicUsize,
}

#[derive(Debug, Default)]
struct State {
    /// Number of the run, from 1.
    run: u64,
    about: Arc<str>,
    status: Arc<str>,
    rows: Vec<Arc<str>>,
    newest: Option<Newest>,
}

#[derive(Debug, Clone)]
struct Newest {
    scene: Arc<str>,
    pixels: Arc<[u8]>,
}

/// What one browser has seen already.
#[derive(Debug, Default)]
pub(crate) struct Seen {
    run: u64,
    rows: usize,
}

impl Default for Board {
    fn default() -> Self {
        let (changed, _) = watch::channel(());
        Self { state: Mutex::default(), changed, watchers: AtomicUsize::new(0) }
    }
}

impl Board {
    /// Begins a run: `about` (JSON) is what stands for all of it, `status` (JSON) how it is now.
    pub fn begin(&self, about: String, status: String) {
        let mut state = self.state();
        let run = state.run + 1;
        *state = State { run, about: about.into(), status: status.into(), rows: Vec::new(), newest: None };
        drop(state);
        self.changed.send_replace(());
    }

    /// One image more: its row (JSON), where everything is (JSON), and the picture, one byte per pixel.
    pub fn image(&self, row: String, scene: String, pixels: &[u8]) {
        let mut state = self.state();
        state.rows.push(row.into());
        state.newest = Some(Newest { scene: scene.into(), pixels: pixels.into() });
        drop(state);
        self.changed.send_replace(());
    }

    /// How the run is now (JSON).
    pub fn status(&self, status: String) {
        self.state().status = status.into();
        self.changed.send_replace(());
    }

    /// How many browsers look.
    pub fn watchers(&self) -> usize {
        self.watchers.load(Ordering::Relaxed)
    }

    /// Counts one more browser until the guard is dropped; `None` when there are `most` already.
    pub(crate) fn enter(self: &Arc<Self>, most: usize) -> Option<Watcher> {
        let enter = |count: usize| (count < most).then_some(count + 1);
        self.watchers.fetch_update(Ordering::Relaxed, Ordering::Relaxed, enter).ok()?;
        Some(Watcher { board: Arc::clone(self), changed: self.changed.subscribe() })
    }

    fn state(&self) -> MutexGuard<'_, State> {
        // Every change is whole before the lock is let go.
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// One browser's place before the board.
#[derive(Debug)]
pub(crate) struct Watcher {
    board: Arc<Board>,
    changed: watch::Receiver<()>,
}

impl Drop for Watcher {
    fn drop(&mut self) {
        self.board.watchers.fetch_sub(1, Ordering::Relaxed);
    }
}

impl Watcher {
    /// Returns when something was posted that may not have been seen yet.
    pub(crate) async fn changed(&mut self) {
        // The sender lives as long as the board.
        let _ = self.changed.changed().await;
    }

    /// All that this browser has not seen, as one message: length of the JSON (u32, little-endian), the JSON, the pixels of
    /// the newest picture where there is a new one.
    pub(crate) fn news(&mut self, seen: &mut Seen) -> Vec<u8> {
        self.changed.mark_unchanged();
        let (about, status, rows, newest, run, from) = {
            let state = self.board.state();
            let about = (state.run != seen.run).then(|| Arc::clone(&state.about));
            if about.is_some() {
                *seen = Seen { run: state.run, rows: 0 };
            }
            let rows = state.rows[seen.rows..].to_vec();
            let newest = state.newest.clone().filter(|_| !rows.is_empty());
            let from = std::mem::replace(&mut seen.rows, state.rows.len());
            (about, Arc::clone(&state.status), rows, newest, state.run, from)
        };
        let or_null = |text: Option<&Arc<str>>| {
            text.filter(|text| !text.is_empty()).map_or("null", |text| text).to_owned()
        };
        let json = format!(
            r#"{{"run":{run},"about":{},"status":{},"from":{from},"rows":[{}],"scene":{}}}"#,
            or_null(about.as_ref()),
            or_null(Some(&status)),
            rows.join(","),
            or_null(newest.as_ref().map(|newest| &newest.scene)),
        );
        let pixels: &[u8] = newest.as_ref().map_or(&[], |newest| &newest.pixels);
        let mut message = Vec::with_capacity(4 + json.len() + pixels.len());
        message.extend((json.len() as u32).to_le_bytes());
        message.extend(json.as_bytes());
        message.extend(pixels);
        message
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The JSON of a message and its pixels.
    fn read(message: &[u8]) -> (serde_json::Value, Vec<u8>) {
        let length = u32::from_le_bytes(message[..4].try_into().expect("four bytes")) as usize;
        let (json, pixels) = message[4..].split_at(length);
        (serde_json::from_slice(json).expect("JSON"), pixels.to_vec())
    }

    #[test]
    fn a_slow_browser_gets_all_rows_and_only_the_newest_picture() {
        let board = Arc::new(Board::default());
        let mut watcher = board.enter(1).expect("room");
        let mut seen = Seen::default();
        board.begin(r#"{"name":"a"}"#.into(), r#"{"held":false}"#.into());
        for k in 0..3u8 {
            board.image(format!(r#"{{"i":{k}}}"#), format!(r#"{{"at":{k}}}"#), &[k; 4]);
        }
        let (json, pixels) = read(&watcher.news(&mut seen));
        assert_eq!(
            (json["about"]["name"].as_str(), json["rows"].as_array().map(Vec::len)),
            (Some("a"), Some(3))
        );
        assert_eq!((json["scene"]["at"].as_u64(), pixels), (Some(2), vec![2; 4]));

        board.status(r#"{"held":true}"#.into());
        let (json, pixels) = read(&watcher.news(&mut seen));
        assert_eq!(
            (&json["about"], json["from"].as_u64(), pixels.len()),
            (&serde_json::Value::Null, Some(3), 0)
        );
        assert_eq!(json["status"]["held"], true);

        // A new run begins with an empty page, and a browser that comes late sees all of it.
        board.begin(r#"{"name":"b"}"#.into(), "{}".into());
        board.image("{}".into(), "{}".into(), &[9]);
        let (json, pixels) = read(&watcher.news(&mut seen));
        assert_eq!((json["run"].as_u64(), json["from"].as_u64(), pixels), (Some(2), Some(0), vec![9]));
    }

    #[test]
    fn the_door_closes_when_the_room_is_full() {
        let board = Arc::new(Board::default());
        let first = board.enter(1).expect("room");
        assert!(board.enter(1).is_none());
        drop(first);
        assert!(board.enter(1).is_some());
    }
}
