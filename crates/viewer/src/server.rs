use std::net::{SocketAddr, TcpListener};
use std::sync::{Arc, mpsc};

use axum::Router;
use axum::extract::{State, WebSocketUpgrade};
use axum::http::{HeaderMap, HeaderName, StatusCode, header};
use axum::response::{IntoResponse, Response};
use axum::routing::get;

use crate::ask::MAX_ASK_BYTES;
use crate::{Ask, Board, socket};

/// Most browsers at a time.
const MAX_BROWSERS: usize = 16;
/// Everything comes from the port itself. Styles: uPlot sets some on its elements.
const POLICY: &str = "default-src 'none'; script-src 'self'; style-src 'self' 'unsafe-inline'; img-src 'self' data: blob:; \
    connect-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'";

/// Why the page cannot be served.
#[derive(Debug, thiserror::Error)]
#[error("cannot serve on {address}: {source}")]
pub struct ServeError {
    address: SocketAddr,
    source: std::io::Error,
}

/// A server that answers until the program ends.
#[derive(Debug)]
pub struct Server {
    /// Where it listens.
    pub address: SocketAddr,
    /// What browsers ask for, in the order in which it came.
    pub asks: mpsc::Receiver<Ask>,
}

#[derive(Clone)]
struct Shared {
    board: Arc<Board>,
    asks: mpsc::Sender<Ask>,
    address: SocketAddr,
}

/// Listens on `address` (port 0: any that is free) and shows `board`, on a thread of its own.
///
/// # Errors
/// [`ServeError`] when the address cannot be had.
pub fn serve(address: SocketAddr, board: Arc<Board>) -> Result<Server, ServeError> {
    let failed = |source| ServeError { address, source };
    let listener = TcpListener::bind(address).map_err(failed)?;
    listener.set_nonblocking(true).map_err(failed)?;
    let bound = listener.local_addr().map_err(failed)?;
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build().map_err(failed)?;
    let (sender, asks) = mpsc::channel();
    let app = router(Shared { board, asks: sender, address: bound });
    let listener = {
        let _inside = runtime.enter();
        tokio::net::TcpListener::from_std(listener).map_err(failed)?
    };
    let run = move || {
        // Ends with the program only.
        let _ = runtime.block_on(async { axum::serve(listener, app).await });
    };
    std::thread::Builder::new().name("page".into()).spawn(run).map_err(failed)?;
    Ok(Server { address: bound, asks })
}

fn router(shared: Shared) -> Router {
    let file = |kind: &'static str, text: &'static str| {
        get(move || async move { ([(header::CONTENT_TYPE, kind)], text) })
    };
    let script = "text/javascript; charset=utf-8";
    Router::new()
        .route("/", file("text/html; charset=utf-8", include_str!("../page/index.html")))
        .route("/view.js", file(script, include_str!("../page/dist/view.js")))
        .route("/view.css", file("text/css; charset=utf-8", include_str!("../page/dist/view.css")))
        .route("/socket", get(upgrade))
        .layer(axum::middleware::map_response(guard))
        .with_state(shared)
}

/// What every answer says to the browser.
async fn guard(mut response: Response) -> Response {
    let headers: [(HeaderName, &'static str); 4] = [
        (header::CONTENT_SECURITY_POLICY, POLICY),
        (header::X_CONTENT_TYPE_OPTIONS, "nosniff"),
        (header::REFERRER_POLICY, "no-referrer"),
        (header::CACHE_CONTROL, "no-store"),
    ];
    for (name, value) in headers {
        response.headers_mut().insert(name, axum::http::HeaderValue::from_static(value));
    }
    response
}

async fn upgrade(State(shared): State<Shared>, headers: HeaderMap, upgrade: WebSocketUpgrade) -> Response {
    if !is_own_page(&headers, shared.address) {
        return (StatusCode::FORBIDDEN, "another page's script is not let in").into_response();
    }
    let Some(watcher) = shared.board.enter(MAX_BROWSERS) else {
        return (StatusCode::SERVICE_UNAVAILABLE, "too many browsers").into_response();
    };
    upgrade
        .max_message_size(MAX_ASK_BYTES)
        .max_frame_size(MAX_ASK_BYTES)
        .on_upgrade(move |socket| socket::attend(socket, watcher, shared.asks))
}

/// The page that asks was served by this port: its origin is the host that it asks. On loopback that host is one of
/// loopback's names, so that a name of somebody else's that points here (DNS rebinding) is not enough.
fn is_own_page(headers: &HeaderMap, address: SocketAddr) -> bool {
    let text = |name: HeaderName| headers.get(name).and_then(|value| value.to_str().ok());
    let (Some(origin), Some(host)) = (text(header::ORIGIN), text(header::HOST)) else { return false };
    let port = address.port();
    let is_loopback = || {
        [format!("127.0.0.1:{port}"), format!("localhost:{port}"), format!("[::1]:{port}")]
            .iter()
            .any(|own| own == host)
    };
    origin.strip_prefix("http://") == Some(host) && (!address.ip().is_loopback() || is_loopback())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn let_in(listens: &str, origin: Option<&str>, host: &str) -> bool {
        let mut headers = HeaderMap::new();
        headers.insert(header::HOST, host.parse().expect("host"));
        if let Some(origin) = origin {
            headers.insert(header::ORIGIN, origin.parse().expect("origin"));
        }
        is_own_page(&headers, listens.parse().expect("address"))
    }

    #[test]
    fn only_the_page_itself_is_let_in() {
        let own = "127.0.0.1:8400";
        assert!(let_in(own, Some("http://127.0.0.1:8400"), "127.0.0.1:8400"));
        assert!(let_in(own, Some("http://localhost:8400"), "localhost:8400"));
        for (origin, host) in [
            (None, "127.0.0.1:8400"),
            (Some("http://example.org"), "127.0.0.1:8400"),
            (Some("http://127.0.0.1:9000"), "127.0.0.1:8400"),
            (Some("https://127.0.0.1:8400"), "127.0.0.1:8400"),
            (Some("http://rebound.example:8400"), "rebound.example:8400"),
        ] {
            assert!(!let_in(own, origin, host), "{origin:?} {host}");
        }
        assert!(let_in("192.0.2.1:8400", Some("http://lab.example:8400"), "lab.example:8400"));
    }
}
