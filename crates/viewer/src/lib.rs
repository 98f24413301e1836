//! The page in the browser: what a run shows goes out, what people ask comes in.
//!
//! | module | does |
//! |---|---|
//! | `board` | what every browser is shown: the run, its rows so far, its newest picture |
//! | `ask` | what a browser may ask for; everything else closes its socket |
//! | `socket` | one browser: sends what it has not seen yet, and of the pictures only the newest |
//! | `server` | one port: the page, its script, the WebSocket; who may come in |
//!
//! The crate knows nothing of what a row means. Whoever runs the loop posts texts (JSON) and pictures on the [`Board`], which
//! never waits for a browser, and takes [`Ask`]s from a channel.
//!
//! The page itself is in `page/`; its script is bundled by esbuild and committed, so that building needs Rust alone.

mod ask;
mod board;
mod server;
mod socket;

pub use ask::{Ask, Restart};
pub use board::Board;
pub use server::{ServeError, Server, serve};
