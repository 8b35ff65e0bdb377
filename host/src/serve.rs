//! The operator's live page and the interface behind it (docs/live.md): HTTP and WebSockets over one [`Live`].
//!
//! Everything that is served is embedded in the program or made from the hub; no path of a request ever names a file. Who may
//! ask is decided in [`access`] before anything else looks at a request; who may steer, in [`steering`].
//!
//! Connections share a limit of the system's with the logs that are recorded (files open at a time, 256 on some), so their number is bounded, and one that asks
//! for nothing is given up, whoever has opened it: who may look is known only once a request is there.

mod access;
mod assets;
mod metrics;
mod routes;
mod socket;
mod steering;

use std::io;
use std::net::SocketAddr;
use std::sync::Arc;
use std::time::Duration;

use axum::Router;
use axum::serve::Listener;
use hyper::server::conn::http1;
use hyper_util::rt::{TokioIo, TokioTimer};
use hyper_util::service::TowerToHyperService;
use tokio::net::TcpListener;
use tokio::sync::Semaphore;

use crate::live::Live;
pub use access::{Access, is_token, random_token};
use steering::Steering;

/// How often the end is looked for.
const POLL: Duration = Duration::from_millis(50);

/// Connections that are served at a time, viewers' WebSockets apart (there are few). More wait until one ends.
const MOST_CONNECTIONS: usize = 128;

/// A connection has so much time for its next request, and an answer so much to be made.
const REQUEST: Duration = Duration::from_secs(10);

/// What every request can see.
pub struct Served {
    live: Arc<Live>,
    access: Access,
    steering: Steering,
    metrics: metrics::Counts,
}

/// Serves until `goes_on` says no. `ready` is told the address, whose port is the system's choice when 0 was asked for.
///
/// # Errors
/// When the address cannot be listened on.
pub fn serve(
    live: Arc<Live>,
    address: SocketAddr,
    access: Access,
    ready: impl FnOnce(SocketAddr),
    goes_on: impl Fn() -> bool,
) -> io::Result<()> {
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build()?;
    let served = Arc::new(Served { live, access, steering: Steering::default(), metrics: metrics::Counts::default() });
    let result = runtime.block_on(async {
        let listener = TcpListener::bind(address).await?;
        ready(listener.local_addr()?);
        tokio::select! {
            () = connections(listener, routes::router(served)) => {}
            () = ended(&goes_on) => {}
        }
        Ok(())
    });
    // Viewers that are being written to are not waited for.
    runtime.shutdown_timeout(POLL);
    result
}

/// Takes on connections, for ever.
async fn connections(mut listener: TcpListener, router: Router) {
    let room = Arc::new(Semaphore::new(MOST_CONNECTIONS));
    let mut http = http1::Builder::new();
    http.timer(TokioTimer::new()).header_read_timeout(REQUEST);
    // Nobody closes the semaphore.
    while let Ok(place) = Arc::clone(&room).acquire_owned().await {
        // Axum's: one that fails is tried again.
        let (stream, _) = Listener::accept(&mut listener).await;
        let service = TowerToHyperService::new(router.clone());
        let connection = http.serve_connection(TokioIo::new(stream), service).with_upgrades();
        tokio::spawn(async move {
            // How it ended is the viewer's business.
            let _ended = connection.await;
            drop(place);
        });
    }
}

async fn ended(goes_on: &impl Fn() -> bool) {
    while goes_on() {
        tokio::time::sleep(POLL).await;
    }
}
