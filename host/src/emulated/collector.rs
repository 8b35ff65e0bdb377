//! Reads the board's link on a thread of its own: whole frames, in order, with what was damaged or missing.

use std::io::Read;
use std::net::TcpStream;
use std::sync::{Arc, Condvar, Mutex, MutexGuard};
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

use crossfall_core::protocol::frame::{Counters, Event, HostDecoder, Sequence};
use crossfall_core::protocol::message::Message;

/// What the board has sent so far.
#[derive(Debug)]
pub struct Collector {
    shared: Arc<Shared>,
}

#[derive(Debug)]
struct Shared {
    state: Mutex<State>,
    arrived: Condvar,
}

#[derive(Debug, Default)]
struct State {
    /// Each good frame as received, delimiter included, and when, in nanoseconds since the Unix epoch.
    frames: Vec<(u64, Vec<u8>)>,
    sequence: Sequence,
    counters: Counters,
    closed: bool,
    paused_until: Option<Instant>,
}

impl Collector {
    /// One to which nothing is sent.
    pub(super) fn deaf() -> Self {
        let state = State { closed: true, ..State::default() };
        Self { shared: Arc::new(Shared { state: Mutex::new(state), arrived: Condvar::new() }) }
    }

    pub(super) fn start(mut stream: TcpStream) -> Self {
        let shared = Arc::new(Shared { state: Mutex::default(), arrived: Condvar::new() });
        let reader = Arc::clone(&shared);
        std::thread::spawn(move || {
            let mut decoder = HostDecoder::new();
            let mut chunk = [0; 4096];
            loop {
                let paused = reader.state().paused_until.take();
                if let Some(left) = paused.and_then(|until| until.checked_duration_since(Instant::now())) {
                    std::thread::sleep(left);
                }
                let count = stream.read(&mut chunk).unwrap_or(0);
                let since = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
                let receive_ns = u64::try_from(since.as_nanos()).unwrap_or(u64::MAX);
                let mut state = reader.state();
                let mut rest = &chunk[..count];
                while let Some(event) = decoder.next(&mut rest) {
                    if let Event::Frame(frame) = event {
                        state.sequence.observe_message(frame.sequence, &frame.body);
                        state.frames.push((receive_ns, frame.raw.to_vec()));
                    }
                }
                state.counters = decoder.counters();
                state.closed = count == 0;
                reader.arrived.notify_all();
                if state.closed {
                    return;
                }
            }
        });
        Self { shared }
    }

    /// Reads nothing for a while: a host that is busy elsewhere. It ends by itself, because QEMU, unlike a UART, waits for its reader, and
    /// whoever would end it may be waiting for QEMU.
    pub fn pause(&self, pause: Duration) {
        self.shared.state().paused_until = Some(Instant::now() + pause);
    }

    /// Number of whole frames so far.
    #[must_use]
    pub fn len(&self) -> usize {
        self.shared.state().frames.len()
    }

    /// Whether nothing has arrived.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Every whole frame so far, as received.
    #[must_use]
    pub fn frames(&self) -> Vec<Vec<u8>> {
        self.shared.state().frames.iter().map(|(_, frame)| frame.clone()).collect()
    }

    /// The same, each with the time of its receipt in nanoseconds since the Unix epoch.
    #[must_use]
    pub fn stamped_frames(&self) -> Vec<(u64, Vec<u8>)> {
        self.shared.state().frames.clone()
    }

    /// Counters of the link's bytes.
    #[must_use]
    pub fn counters(&self) -> Counters {
        self.shared.state().counters
    }

    /// Frames that the sequence numbers prove missing, and how often the board began again.
    #[must_use]
    pub fn losses(&self) -> (u64, u64) {
        let state = self.shared.state();
        (state.sequence.missing(), state.sequence.restarts())
    }

    /// The first message from frame `from` on for which `choose` has an answer, and the number of the frame after it. Waits
    /// for it at most `limit`.
    pub fn wait_for<T>(
        &self,
        from: usize,
        limit: Duration,
        mut choose: impl FnMut(&Message<'_>) -> Option<T>,
    ) -> Option<(usize, T)> {
        let deadline = Instant::now() + limit;
        let mut at = from;
        let mut state = self.shared.state();
        loop {
            while let Some((_, raw)) = state.frames.get(at) {
                at += 1;
                if let Some(answer) = with_message(raw, &mut choose) {
                    return Some((at, answer));
                }
            }
            let left = deadline.checked_duration_since(Instant::now())?;
            if state.closed {
                return None;
            }
            state = self.shared.arrived.wait_timeout(state, left).unwrap_or_else(|poisoned| poisoned.into_inner()).0;
        }
    }

    /// What `choose` makes of every message so far.
    pub fn collect<T>(&self, mut choose: impl FnMut(&Message<'_>) -> Option<T>) -> Vec<T> {
        self.frames().iter().filter_map(|raw| with_message(raw, &mut choose)).collect()
    }
}

impl Shared {
    fn state(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(|poisoned| poisoned.into_inner())
    }
}

fn with_message<T>(raw: &[u8], choose: &mut impl FnMut(&Message<'_>) -> Option<T>) -> Option<T> {
    let mut decoder = HostDecoder::new();
    match decoder.next(&mut &raw[..]) {
        Some(Event::Frame(frame)) => choose(&frame.body),
        _ => None,
    }
}
