use std::sync::mpsc;
use std::time::Duration;

use axum::extract::ws::{CloseFrame, Message, WebSocket, close_code};
use tokio::time::timeout;

use crate::Ask;
use crate::board::{Seen, Watcher};

/// A browser that takes nothing for this long is gone.
const PATIENCE: Duration = Duration::from_secs(30);

/// Serves one browser until it leaves, stops reading or says something that is no [`Ask`].
pub(crate) async fn attend(mut socket: WebSocket, mut watcher: Watcher, asks: mpsc::Sender<Ask>) {
    let mut seen = Seen::default();
    loop {
        // While this waits for a slow browser the board goes on; what follows is then the newest again.
        let news = Message::Binary(watcher.news(&mut seen).into());
        if !matches!(timeout(PATIENCE, socket.send(news)).await, Ok(Ok(()))) {
            return;
        }
        loop {
            let message = tokio::select! {
                () = watcher.changed() => break,
                message = socket.recv() => message,
            };
            let Some(Ok(message)) = message else { return };
            let complaint = match message {
                Message::Text(text) => match Ask::read(&text) {
                    Ok(ask) => match asks.send(ask) {
                        Ok(()) => continue,
                        Err(_) => return,
                    },
                    Err(complaint) => complaint,
                },
                Message::Binary(_) => "a text is expected".to_owned(),
                Message::Ping(_) | Message::Pong(_) => continue,
                Message::Close(_) => return,
            };
            // A close frame holds 125 bytes, two of them the code.
            let reason = complaint.chars().filter(char::is_ascii).take(120).collect::<String>().into();
            let close = CloseFrame { code: close_code::POLICY, reason };
            let _ = timeout(PATIENCE, socket.send(Message::Close(Some(close)))).await;
            return;
        }
    }
}
