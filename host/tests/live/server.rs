//! A server on a thread of its own, at a loopback port that the system chooses, until it is dropped.

use std::net::SocketAddr;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, mpsc};
use std::thread::{self, JoinHandle};
use std::time::Duration;

use crossfall::live::Live;
use crossfall::serve::{Access, serve};

pub struct Server {
    pub address: SocketAddr,
    stop: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
}

impl Server {
    pub fn start(live: Live, access: Access) -> Self {
        let live = Arc::new(live);
        let stop = Arc::new(AtomicBool::new(false));
        let (tell, told) = mpsc::channel();
        let stopped = Arc::clone(&stop);
        let thread = thread::spawn(move || {
            let ready = |address| tell.send(address).expect("somebody waits");
            let loopback = SocketAddr::from(([127, 0, 0, 1], 0));
            serve(Arc::clone(&live), loopback, access, ready, || !stopped.load(Ordering::Relaxed)).expect("a port");
            live.finish();
        });
        let address = told.recv_timeout(Duration::from_secs(60)).expect("a server");
        Self { address, stop, thread: Some(thread) }
    }
}

impl Drop for Server {
    fn drop(&mut self) {
        self.stop.store(true, Ordering::Relaxed);
        let ended = self.thread.take().map(JoinHandle::join);
        assert!(matches!(ended, Some(Ok(()))) || thread::panicking(), "an orderly end");
    }
}
