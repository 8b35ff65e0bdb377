//! The pulse per second: captured by TIM5 itself, so that its stamp has no software in it.
//!
//! Channel 2 (PA1) captures the counter at a falling edge, NovAtel's default for the leading one, after a filter of
//! eight timer clocks (95 ns). The interrupt only carries the captured value away; when a second edge has overwritten
//! one not yet read, the over-capture flag says so (RM0090, 18.4.5, CC2OF) and it is counted. embassy-stm32 0.6 reads
//! 32-bit captures through a 16-bit view, hence the registers.
//!
//! QEMU has no pin for it. There, a byte on UART5 is the pulse, stamped like any byte; or, where the host's scheduling is not to
//! show in the stamps, [`CAPTURED`] and four bytes (low first): the counter's value as a timer would have captured it. A byte that
//! [`emulation::provoke`] knows makes the board fail on purpose.

use core::future::poll_fn;
use core::sync::atomic::{AtomicU32, Ordering};
use core::task::Poll;

use crossfall_firmware::line::PulseInput;
use crossfall_protocol::DeviceTime;
use embassy_stm32::interrupt;
use embassy_stm32::pac;
use embassy_stm32::pac::timer::vals::{CcmrInputCcs, FilterValue};

use crate::critical::Bell;
use crate::ring::Ring;
use crate::{emulation, time};

/// Edges not yet read: one a second comes, and what a bouncing contact makes of it. Only one of the two interrupts below is ever on.
static EDGES: Ring<AtomicU32, 8> = Ring::new();
static CAME: Bell = Bell::new();

/// Edges lost: captures overwritten before they were read, and edges without room.
static OVERRUNS: AtomicU32 = AtomicU32::new(0);

/// Channel 2 of TIM5, counting channels from 0.
const CHANNEL: usize = 1;

/// First byte of an emulated capture.
const CAPTURED: u8 = 0xa5;

/// The pulse, captured or emulated.
pub struct Pulses(());

impl Pulses {
    /// Starts capturing on TIM5, whose pin is on and whose counter runs.
    pub fn capture() -> Self {
        let timer = pac::TIM5;
        timer.ccmr_input(CHANNEL / 2).modify(|w| {
            w.set_ccs(CHANNEL % 2, CcmrInputCcs::TI4);
            w.set_icf(CHANNEL % 2, FilterValue::FCK_INT_N8);
        });
        timer.ccer().modify(|w| {
            w.set_ccp(CHANNEL, true);
            w.set_cce(CHANNEL, true);
        });
        timer.dier().modify(|w| w.set_ccie(CHANNEL, true));
        Self(())
    }

    /// Takes each byte on UART5, whose clock is on, for an edge.
    pub fn from_bytes() -> Self {
        pac::UART5.cr1().write(|w| {
            w.set_ue(true);
            w.set_re(true);
            w.set_rxneie(true);
        });
        Self(())
    }
}

impl PulseInput for Pulses {
    async fn edge(&mut self) -> DeviceTime {
        let stamp = poll_fn(|context| {
            CAME.register(context.waker());
            EDGES.pop().map_or(Poll::Pending, Poll::Ready)
        });
        time::extend(stamp.await)
    }

    fn overruns(&self) -> u32 {
        OVERRUNS.load(Ordering::Relaxed)
    }
}

/// Wakes the reader if an edge has come.
pub fn answer() {
    CAME.answer();
}

/// Puts an edge where the reader finds it.
fn came(stamp: u32) {
    if EDGES.push(stamp) {
        CAME.ring();
    } else {
        overrun();
    }
}

fn overrun() {
    OVERRUNS.store(OVERRUNS.load(Ordering::Relaxed).wrapping_add(1), Ordering::Relaxed);
}

#[interrupt]
fn TIM5() {
    let timer = pac::TIM5;
    let status = timer.sr().read();
    if status.ccif(CHANNEL) {
        // Reading the captured value clears its flag (18.4.5).
        came(timer.ccr(CHANNEL).read());
    }
    if status.ccof(CHANNEL) {
        // Flags are cleared by writing 0 to them and 1 to the others.
        timer.sr().write(|w| {
            w.0 = u32::MAX;
            w.set_ccof(CHANNEL, false);
        });
        overrun();
    }
}

#[interrupt]
fn UART5() {
    let stamp = time::counter();
    let status = pac::UART5.sr().read();
    if status.rxne() || status.ore() {
        let byte = pac::UART5.dr().read().dr() as u8;
        // A captured value under way: its bytes, each shifted in from above, and how many are still to come.
        static PARTIAL: AtomicU32 = AtomicU32::new(0);
        static MISSING: AtomicU32 = AtomicU32::new(0);
        let edge = match MISSING.load(Ordering::Relaxed) {
            0 if byte == CAPTURED => {
                MISSING.store(4, Ordering::Relaxed);
                None
            }
            0 => {
                emulation::provoke(byte);
                Some(stamp)
            }
            missing => {
                let value = PARTIAL.load(Ordering::Relaxed) >> 8 | u32::from(byte) << 24;
                PARTIAL.store(value, Ordering::Relaxed);
                MISSING.store(missing - 1, Ordering::Relaxed);
                (missing == 1).then_some(value)
            }
        };
        if let Some(edge) = edge {
            came(edge);
        }
        if status.ore() {
            overrun();
        }
    }
}
