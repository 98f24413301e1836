//! The live page's server, used through its WebSocket as the page does.

use std::io::{BufRead, BufReader};
use std::path::Path;
use std::process::Stdio;
use std::time::Duration;

use futures_util::{SinkExt, StreamExt};
use serde_json::{Value, json};
use tokio::net::TcpStream;
use tokio::time::timeout;
use tokio_tungstenite::tungstenite::client::IntoClientRequest;
use tokio_tungstenite::tungstenite::{Error, Message};
use tokio_tungstenite::{MaybeTlsStream, WebSocketStream, connect_async};

mod common;
use common::{Guarded, program, sonoloop};

const SCENARIO: &str = "scenarios/lateral_plain.yaml";
/// Longest that anything may take that must come; a hang becomes a failure.
const PATIENCE: Duration = Duration::from_secs(90);

/// The program that serves the page, and where.
struct Served {
    program: Guarded,
    authority: String,
}

fn serve(more: &[&str]) -> Served {
    let mut view = program();
    view.args(["view", SCENARIO, "--port", "0"]).args(more).stdout(Stdio::null()).stderr(Stdio::piped());
    let mut program = Guarded(view.spawn().expect("the program starts"));
    let mut lines = BufReader::new(program.0.stderr.take().expect("piped")).lines();
    let line = lines.next().expect("a line").expect("text");
    let authority =
        line.strip_prefix("http://").and_then(|rest| rest.split('/').next()).expect(&line).to_owned();
    // Nobody waits for the pipe to be read.
    std::thread::spawn(move || lines.for_each(drop));
    Served { program, authority }
}

impl Served {
    /// Ctrl-C; returns the exit code.
    fn leave(mut self) -> Option<i32> {
        let pid = rustix::process::Pid::from_child(&self.program.0);
        rustix::process::kill_process(pid, rustix::process::Signal::INT).expect("a signal");
        self.program.wait().code()
    }
}

/// One browser: what it has been told so far.
struct Browser {
    socket: WebSocketStream<MaybeTlsStream<TcpStream>>,
    run: u64,
    about: Value,
    status: Value,
    rows: Vec<Value>,
    pixels: usize,
}

impl Browser {
    async fn open(authority: &str) -> Self {
        let origin = format!("http://{authority}");
        let socket = connect(authority, Some(&origin)).await.expect("let in");
        Self { socket, run: 0, about: Value::Null, status: Value::Null, rows: Vec::new(), pixels: 0 }
    }

    async fn ask(&mut self, ask: Value) {
        self.socket.send(Message::text(ask.to_string())).await.expect("sent");
    }

    /// Reads news until `done` says so.
    async fn until(&mut self, what: &str, done: impl Fn(&Self) -> bool) {
        let read = async {
            while !done(self) {
                let message = self.socket.next().await.expect("open").expect("sound");
                let Message::Binary(bytes) = message else { panic!("{message:?}") };
                let (length, rest) = bytes.split_first_chunk::<4>().expect("a length");
                let (text, pixels) = rest.split_at(u32::from_le_bytes(*length) as usize);
                let news: Value = serde_json::from_slice(text).expect("JSON");
                if !news["about"].is_null() {
                    (self.about, self.rows) = (news["about"].clone(), Vec::new());
                }
                self.run = news["run"].as_u64().expect("a number");
                assert_eq!(news["from"].as_u64(), Some(self.rows.len() as u64), "no row is missed");
                self.rows.extend(news["rows"].as_array().expect("rows").iter().cloned());
                self.status = news["status"].clone();
                self.pixels = pixels.len().max(self.pixels);
            }
        };
        assert!(timeout(PATIENCE, read).await.is_ok(), "never came: {what}; status {}", self.status);
    }

    fn state(&self) -> &str {
        self.rows.last().and_then(|row| row["state"].as_str()).unwrap_or_default()
    }

    fn is_held(&self) -> bool {
        self.status["held"] == true
    }

    fn is_over(&self) -> bool {
        !self.status["over"].is_null()
    }

    /// Shuts the socket with nonsense; returns the code that it is closed with.
    async fn closed_after(mut self, message: Message) -> Option<u16> {
        self.socket.send(message).await.expect("sent");
        let last = async {
            loop {
                match self.socket.next().await {
                    Some(Ok(Message::Close(frame))) => return frame.map(|frame| u16::from(frame.code)),
                    Some(Ok(_)) => {}
                    Some(Err(_)) | None => return None,
                }
            }
        };
        timeout(PATIENCE, last).await.expect("closed")
    }
}

async fn connect(
    authority: &str,
    origin: Option<&str>,
) -> Result<WebSocketStream<MaybeTlsStream<TcpStream>>, Box<Error>> {
    let mut request = format!("ws://{authority}/socket").into_client_request().expect("a request");
    if let Some(origin) = origin {
        request.headers_mut().insert("Origin", origin.parse().expect("a header"));
    }
    connect_async(request).await.map(|(socket, _)| socket).map_err(Box::new)
}

fn wait(test: impl Future<Output = ()>) {
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build().expect("runtime");
    runtime.block_on(test);
}

fn read(folder: &Path, name: &str) -> String {
    std::fs::read_to_string(folder.join(name)).expect(name)
}

#[test]
fn a_run_is_stepped_knocked_and_found_again_from_the_page_and_can_be_replayed() {
    let folder = tempfile::tempdir().expect("temporary folder");
    let served = serve(&["--speed", "max", "--out", folder.path().to_str().expect("plain path")]);
    wait(async {
        let mut browser = Browser::open(&served.authority).await;
        browser.until("the start", |page| page.rows.len() > 1 && !page.is_held()).await;
        browser.ask(json!({"control": "pause"})).await;
        browser.until("held by hand", Browser::is_held).await;
        let held = browser.rows.len();
        let setting = &browser.about["setting"];
        let columns = setting["columns_px"].as_array().map(|ends| ends[1].as_u64().zip(ends[0].as_u64()));
        let (right, left) = columns.flatten().expect("columns");
        assert_eq!(browser.pixels as u64, (right - left) * 480, "the columns that the aperture reaches");
        for k in 1..=3 {
            browser.ask(json!({"control": {"step": 1}})).await;
            browser.until("a step", |page| page.rows.len() >= held + k && page.is_held()).await;
            assert_eq!(browser.rows.len(), held + k, "a step is one image");
        }

        // Somebody who comes late sees all of it, and what one asks for the other sees.
        let mut other = Browser::open(&served.authority).await;
        other.until("the history", |page| page.rows.len() == held + 3 && page.is_held()).await;
        assert_eq!(other.rows, browser.rows);

        browser.ask(json!({"control": {"disturb": {"probe_knock": {"elevation_mm": 3}}}})).await;
        other.ask(json!({"control": "resume"})).await;
        for state in ["lost", "tracking"] {
            browser.until(state, |page| page.state() == state || page.is_over()).await;
            assert_eq!(browser.state(), state, "after a knock");
        }
        let lost = browser.rows.iter().find(|row| row["state"] == "lost").expect("a loss");
        assert!(lost["words"].as_str().is_some_and(|words| words.starts_with("lost at ")), "{lost}");
        other.until("the end", Browser::is_over).await;
        browser.until("the end", Browser::is_over).await;
        assert_eq!(other.rows, browser.rows, "both have seen the same");
    });
    let run = folder.path().join("1");
    assert!(served.leave().is_some_and(|code| code < 2), "the files are written before it ends");
    let replayed = sonoloop(&["replay", run.to_str().expect("plain path")]);
    assert_eq!(replayed.code(), 0, "{}{}", replayed.stdout, replayed.stderr);
    assert!(read(&run, "events.csv").contains("control"));
    assert!(read(&run, "scenario.yaml").contains("probe_knock"));
}

#[test]
fn looking_changes_nothing() {
    let folder = tempfile::tempdir().expect("temporary folder");
    let (watched, alone) = (folder.path().join("watched"), folder.path().join("alone"));
    let served = serve(&["--speed", "max", "--out", watched.to_str().expect("plain path")]);
    wait(async {
        let mut browser = Browser::open(&served.authority).await;
        let mut other = Browser::open(&served.authority).await;
        browser.until("the end", Browser::is_over).await;
        other.until("the end", Browser::is_over).await;
        assert_eq!(browser.status["over"]["pass"], true);
    });
    assert_eq!(served.leave(), Some(0));
    let run = sonoloop(&["run", SCENARIO, "--json", "--out", alone.to_str().expect("plain path")]);
    assert_eq!(run.code(), 0, "{}", run.stderr);
    assert!(read(&watched.join("1"), "images.csv") == read(&alone, "images.csv"), "a watched run differs");
}

#[test]
fn nonsense_closes_its_own_socket_and_nothing_else() {
    let served = serve(&[]);
    wait(async {
        let authority = served.authority.as_str();
        let mut browser = Browser::open(authority).await;
        browser.until("the start", |page| page.rows.len() > 1 && !page.is_held()).await;
        browser.ask(json!({"control": "pause"})).await;
        browser.until("held by hand", Browser::is_held).await;

        for nonsense in [r#"{"halt": 1}"#, "{", r#"{"control": {"speed": 0}}"#] {
            let code = Browser::open(authority).await.closed_after(Message::text(nonsense)).await;
            assert_eq!(code, Some(1008), "{nonsense}");
        }
        Browser::open(authority).await.closed_after(Message::binary(vec![0u8; 8])).await;
        // Too long to be taken at all.
        Browser::open(authority).await.closed_after(Message::text("x".repeat(100_000))).await;

        for origin in [None, Some("http://example.org"), Some("null")] {
            let refused = connect(authority, origin).await.expect_err("another page's script");
            assert!(matches!(*refused, Error::Http(ref answer) if answer.status() == 403), "{refused}");
        }

        let mut crowd = Vec::new();
        let full = loop {
            match connect(authority, Some(&format!("http://{authority}"))).await {
                Ok(socket) => crowd.push(socket),
                Err(refused) => break refused,
            }
            assert!(crowd.len() <= 16, "there is a limit");
        };
        assert!(matches!(*full, Error::Http(ref answer) if answer.status() == 503), "{full}");
        drop(crowd);

        // The first browser and the run are as they were.
        let held = browser.rows.len();
        browser.ask(json!({"control": {"step": 1}})).await;
        browser.until("a step", |page| page.rows.len() > held && page.is_held()).await;
        assert_eq!(browser.rows.len(), held + 1);

        // A change that the scenario does not allow is told, and the run stays.
        browser.ask(json!({"restart": {"set": ["tracker.template_px=9999"]}})).await;
        browser.until("a complaint", |page| page.status["complaint"].is_string()).await;
        assert!(browser.status["complaint"].as_str().is_some_and(|text| text.contains("9999")));
        assert_eq!(browser.run, 1);
        browser.ask(json!({"restart": {"seed": 7, "set": ["tracker.template_px=24"]}})).await;
        browser.until("another run", |page| page.run == 2 && !page.rows.is_empty()).await;
        assert_eq!(
            (&browser.about["seed"], &browser.about["setting"]["template_px"]),
            (&json!(7), &json!(24))
        );
        browser.ask(json!({"restart": {"lesson": "1_views"}})).await;
        browser.until("a lesson", |page| page.run == 3 && !page.rows.is_empty()).await;
        assert_eq!(browser.about["setting"]["view"], "transverse");
    });
    assert_eq!(served.leave(), Some(0), "no run came to its end");
}
