//! defmt's global logger: to RTT for a probe, to USART1 for who has none, and into a bounded pipe that a task sends over the link.
//!
//! A log frame that does not fit into one of them is left out there, whole: logging never waits.

use core::cell::{Cell, RefCell};
use core::sync::atomic::{AtomicBool, Ordering};

use critical_section::{Mutex, RestoreState};
use embassy_sync::blocking_mutex::raw::CriticalSectionRawMutex;
use embassy_sync::pipe::Pipe;
use rtt_target::{ChannelMode, UpChannel, rtt_init};

/// Bytes of log on their way to the link.
const CAPACITY: usize = 512;

/// Longest log frame.
const LONGEST: usize = 128;

/// What is on its way to the link.
pub static PIPE: Pipe<CriticalSectionRawMutex, CAPACITY> = Pipe::new();

struct State {
    encoder: RefCell<defmt::Encoder>,
    rtt: RefCell<Option<UpChannel>>,
    frame: RefCell<heapless::Vec<u8, LONGEST>>,
    /// Part of the frame under way did not fit.
    cut: Cell<bool>,
    restore: Cell<RestoreState>,
}

static STATE: Mutex<State> = Mutex::new(State {
    encoder: RefCell::new(defmt::Encoder::new()),
    rtt: RefCell::new(None),
    frame: RefCell::new(heapless::Vec::new()),
    cut: Cell::new(false),
    restore: Cell::new(RestoreState::invalid()),
});

static TAKEN: AtomicBool = AtomicBool::new(false);

/// Prepares RTT. To be called once, before anything logs.
pub fn start() {
    let channels = rtt_init! {
        up: { 0: { size: 512, mode: ChannelMode::NoBlockSkip, name: "defmt" } }
    };
    critical_section::with(|cs| STATE.borrow(cs).rtt.replace(Some(channels.up.0)));
}

#[defmt::global_logger]
struct Logger;

// SAFETY: `acquire` opens a critical section that `release` closes, so that nothing else logs in between; logging while
// logging, which only a formatter could do, is a panic.
unsafe impl defmt::Logger for Logger {
    fn acquire() {
        // SAFETY: released in `release`, which defmt always calls after.
        let restore = unsafe { critical_section::acquire() };
        assert!(!TAKEN.swap(true, Ordering::Relaxed), "logging within logging");
        critical_section::with(|cs| {
            let state = STATE.borrow(cs);
            state.restore.set(restore);
            state.frame.borrow_mut().clear();
            state.cut.set(false);
            state.encoder.borrow_mut().start_frame(|bytes| state.keep(bytes));
        });
    }

    unsafe fn flush() {}

    unsafe fn release() {
        let restore = critical_section::with(|cs| {
            let state = STATE.borrow(cs);
            state.encoder.borrow_mut().end_frame(|bytes| state.keep(bytes));
            state.send();
            state.restore.get()
        });
        TAKEN.store(false, Ordering::Relaxed);
        // SAFETY: pairs with `acquire`.
        unsafe { critical_section::release(restore) };
    }

    unsafe fn write(bytes: &[u8]) {
        critical_section::with(|cs| {
            let state = STATE.borrow(cs);
            state.encoder.borrow_mut().write(bytes, |encoded| state.keep(encoded));
        });
    }
}

impl State {
    fn keep(&self, bytes: &[u8]) {
        if self.frame.borrow_mut().extend_from_slice(bytes).is_err() {
            self.cut.set(true);
        }
    }

    fn send(&self) {
        let frame = self.frame.borrow();
        if self.cut.get() {
            return;
        }
        if let Some(rtt) = self.rtt.borrow_mut().as_mut() {
            rtt.write(&frame);
        }
        // Nothing else sends there: the logger's critical section holds off whoever else logs.
        crate::BENCH.try_send(&frame);
        if PIPE.free_capacity() >= frame.len() {
            let mut rest = frame.as_slice();
            while let Ok(taken) = PIPE.try_write(rest) {
                rest = &rest[taken..];
                if rest.is_empty() {
                    break;
                }
            }
        }
    }
}
