//! The operator's live page and the interface behind it (docs/live.md): HTTP and WebSockets over one [`Live`].
//!
//! Everything that is served is embedded in the program or made from the hub; no path of a request ever names a file. Who may
//! ask is decided in [`access`] before anything else looks at a request; who may steer, in [`steering`].

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

use tokio::net::TcpListener;

use crate::live::Live;
pub use access::{Access, is_token, random_token};
use steering::Steering;

/// How often the end is looked for.
const POLL: Duration = Duration::from_millis(50);

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
        let server = axum::serve(listener, routes::router(served).into_make_service());
        tokio::select! {
            ended = server => ended,
            () = ended(&goes_on) => Ok(()),
        }
    });
    // Viewers that are being written to are not waited for.
    runtime.shutdown_timeout(POLL);
    result
}

async fn ended(goes_on: &impl Fn() -> bool) {
    while goes_on() {
        tokio::time::sleep(POLL).await;
    }
}
