//! What the reader has and the recording has not taken yet: bounded, and honest about what found no room.

use std::collections::VecDeque;
use std::sync::{Condvar, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

/// Bytes that may wait, [`OVERHEAD`] for each read included: more than a minute of a link of 1 Mbaud that is read a millisecond at a time.
pub const CAPACITY: usize = 16 << 20;

/// What a read costs beside its bytes.
const OVERHEAD: usize = 64;

/// What happened on the port, in its order.
#[derive(Debug, PartialEq, Eq)]
pub enum Event {
    /// Bytes of one read.
    Bytes {
        /// When the read ended, in nanoseconds since the Unix epoch.
        receive_ns: u64,
        /// They.
        bytes: Vec<u8>,
    },
    /// Here bytes found no room.
    Overflow {
        /// How many.
        bytes: u64,
    },
    /// The connection is lost.
    Gone {
        /// Why.
        why: String,
    },
    /// It is there again, and bytes follow.
    Back,
    /// It takes no commands.
    Mute {
        /// Why.
        why: String,
    },
}

/// What the recording gets.
#[derive(Debug, PartialEq, Eq)]
pub enum Taken {
    /// The next event.
    Event(Event),
    /// None in the time given.
    Nothing,
    /// The reader has ended, and everything has been taken.
    End,
}

/// A queue between the reader and the recording.
pub struct Buffer {
    state: Mutex<State>,
    changed: Condvar,
    capacity: usize,
}

#[derive(Default)]
struct State {
    events: VecDeque<Event>,
    held: usize,
    stop: bool,
    ended: bool,
}

impl Buffer {
    /// An empty one of [`CAPACITY`].
    pub fn new() -> Self {
        Self::of(CAPACITY)
    }

    fn of(capacity: usize) -> Self {
        Self { state: Mutex::default(), changed: Condvar::new(), capacity }
    }

    /// Never waits: bytes without room are counted.
    pub fn put(&self, event: Event) {
        let mut state = self.lock();
        let cost = cost(&event);
        match &event {
            Event::Bytes { bytes, .. } if state.held + cost > self.capacity => {
                let lost = bytes.len() as u64;
                match state.events.back_mut() {
                    Some(Event::Overflow { bytes }) => *bytes += lost,
                    _ => state.events.push_back(Event::Overflow { bytes: lost }),
                }
            }
            _ => {
                state.held += cost;
                state.events.push_back(event);
            }
        }
        self.changed.notify_all();
    }

    /// The next event, waiting for it at most so long.
    pub fn take(&self, wait: Duration) -> Taken {
        let (mut state, _) = self
            .changed
            .wait_timeout_while(self.lock(), wait, |state| state.events.is_empty() && !state.ended)
            .unwrap_or_else(PoisonError::into_inner);
        match state.events.pop_front() {
            Some(event) => {
                state.held -= cost(&event);
                Taken::Event(event)
            }
            None if state.ended => Taken::End,
            None => Taken::Nothing,
        }
    }

    /// Asks the reader to end.
    pub fn stop(&self) {
        self.lock().stop = true;
        self.changed.notify_all();
    }

    /// Waits at most so long, or until the reader is asked to end; says whether it is.
    pub fn stopped_within(&self, wait: Duration) -> bool {
        let waited = self.changed.wait_timeout_while(self.lock(), wait, |state| !state.stop);
        waited.unwrap_or_else(PoisonError::into_inner).0.stop
    }

    /// The reader's last word.
    pub fn end(&self) {
        self.lock().ended = true;
        self.changed.notify_all();
    }

    fn lock(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

fn cost(event: &Event) -> usize {
    match event {
        Event::Bytes { bytes, .. } => bytes.len() + OVERHEAD,
        // At most one of these for each read, or for each connection: they need no bound of their own.
        Event::Overflow { .. } | Event::Gone { .. } | Event::Back | Event::Mute { .. } => 0,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn bytes(length: usize) -> Event {
        Event::Bytes { receive_ns: 1, bytes: vec![7; length] }
    }

    #[test]
    fn what_finds_no_room_is_counted_where_it_was_lost() {
        let buffer = Buffer::of(2 * (100 + OVERHEAD));
        for length in [100, 100, 30, 12] {
            buffer.put(bytes(length));
        }
        let now = Duration::ZERO;
        assert_eq!(buffer.take(now), Taken::Event(bytes(100)));
        // There is room again, but what was lost stays lost before what comes now.
        buffer.put(bytes(5));
        assert_eq!(buffer.take(now), Taken::Event(bytes(100)));
        assert_eq!(buffer.take(now), Taken::Event(Event::Overflow { bytes: 42 }));
        assert_eq!(buffer.take(now), Taken::Event(bytes(5)));
        assert_eq!(buffer.take(now), Taken::Nothing);
        assert_eq!(buffer.lock().held, 0);
        buffer.put(bytes(1));
        buffer.end();
        assert_eq!(buffer.take(now), Taken::Event(bytes(1)));
        assert_eq!(buffer.take(now), Taken::End);
    }
}
