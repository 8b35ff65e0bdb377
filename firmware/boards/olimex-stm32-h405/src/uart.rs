//! UARTs that stamp every byte in the first instruction of its interrupt and count every byte they lose.
//!
//! A byte and the low 24 bits of its stamp share one word of a ring from the interrupt to the reader. 24 bits are 16.8 s;
//! readers come every millisecond. A byte that arrives while the ring is full, or that the receiver itself overran
//! (RM0090, 30.6.1, ORE), is counted, never silently gone. Sending goes through a second ring, which the interrupt empties.
//! No critical section delays the interrupt (`critical.rs`).
//!
//! One byte an interrupt and no DMA: at 500 kbaud that is 50,000 interrupts a second of about 60 cycles, 2 % of the
//! core, and each byte has a stamp of its own, which a DMA block would not give. QEMU has neither DMA nor IDLE.

use core::convert::Infallible;
use core::future::poll_fn;
use core::sync::atomic::{AtomicBool, AtomicU8, AtomicU32, Ordering};
use core::task::Poll;

use crossfall_firmware::line::{SensorLine, StampedRead};
use crossfall_protocol::DeviceTime;
use embassy_futures::select::select;
use embassy_stm32::pac::usart::Usart;
use embassy_stm32::pac::usart::regs::Cr1;
use embassy_time::{Duration, Timer};
use embedded_io_async::{ErrorType, Read, Write};

use crate::critical::Bell;
use crate::ring::Ring;
use crate::time;

/// Stamps are kept modulo 2^24 microseconds.
const STAMP_MASK: u32 = 0xff_ffff;

/// Bytes that one read returns at most, and how long it lets them gather: readers have at least that chance every millisecond.
const CHUNK: usize = 64;
const GATHER: Duration = Duration::from_millis(1);

/// Whether a full ring leaves the next byte in the receiver instead of losing it. QEMU then holds back its sender, which is no
/// wire and sends as fast as it may; silicon would overrun.
static HOLD_BACK: AtomicBool = AtomicBool::new(false);

/// Says that the lines are QEMU's.
pub fn lines_are_emulated() {
    HOLD_BACK.store(true, Ordering::Relaxed);
}

/// One UART, with room for `RX` received and `TX` outgoing bytes, both powers of two.
pub struct Port<const RX: usize, const TX: usize> {
    usart: Usart,
    /// Each byte below the low 24 bits of its stamp.
    received: Ring<AtomicU32, RX>,
    lost: AtomicU32,
    arrived: Bell,
    outgoing: Ring<AtomicU8, TX>,
    room: Bell,
}

impl<const RX: usize, const TX: usize> Port<RX, TX> {
    /// A port for one peripheral; nothing happens before [`Port::open`].
    pub const fn new(usart: Usart) -> Self {
        Self {
            usart,
            received: Ring::new(),
            lost: AtomicU32::new(0),
            arrived: Bell::new(),
            outgoing: Ring::new(),
            room: Bell::new(),
        }
    }

    /// Starts the peripheral, whose clock and pins are on, at 8N1. To be called once: the [`Line`] is the only reader.
    pub fn open(&'static self, bus_hz: u32, baud: u32) -> Line<RX, TX> {
        self.set_divider(bus_hz, baud);
        self.usart.cr1().write(|w| {
            w.set_ue(true);
            w.set_re(true);
            w.set_te(true);
            w.set_rxneie(true);
        });
        let receiver = Receiver { port: self, count: 0, read_at: (0, DeviceTime(0)) };
        Line { receiver, sender: Sender { port: self }, bus_hz }
    }

    /// Starts the peripheral for sending alone, with what [`Port::try_send`] already holds.
    pub fn open_to_send(&self, bus_hz: u32, baud: u32) {
        self.set_divider(bus_hz, baud);
        self.usart.cr1().write(|w| {
            w.set_ue(true);
            w.set_te(true);
            w.set_txeie(true);
        });
    }

    /// Oversampling by 16: the divider is the bus clock over the rate, in sixteenths already (RM0090, 30.3.4).
    fn set_divider(&self, bus_hz: u32, baud: u32) {
        let divider = (bus_hz + baud / 2) / baud.max(1);
        self.usart.brr().write(|w| w.0 = divider.clamp(16, 0xffff));
    }

    /// The peripheral's interrupt. `stamp` is the counter as read by its first instruction.
    #[inline(always)]
    pub fn on_interrupt(&self, stamp: u32) {
        // The overrun flag is cleared by reading the status and then the data (30.6.1); the data register still holds
        // the byte before the one that was lost. Never write the status: QEMU would clear a fresh RXNE with it.
        let status = self.usart.sr().read();
        if status.rxne() && self.received.held() >= RX && HOLD_BACK.load(Ordering::Relaxed) {
            self.usart.cr1().modify(|w| w.set_rxneie(false));
        } else if status.rxne() || status.ore() {
            let byte = self.usart.dr().read().dr() as u8;
            if status.ore() {
                self.lose();
            }
            if status.rxne() {
                self.push(byte, stamp);
            }
        }
        if status.txe() && self.usart.cr1().read().txeie() {
            match self.outgoing.pop() {
                Some(byte) => {
                    self.usart.dr().write(|w| w.set_dr(byte.into()));
                    // A writer only waits when there is no room at all.
                    if self.outgoing.held() == TX / 2 {
                        self.room.ring();
                    }
                }
                None => self.usart.cr1().modify(|w| w.set_txeie(false)),
            }
        }
    }

    /// Wakes the tasks for which the interrupt has rung.
    pub fn answer(&self) {
        self.arrived.answer();
        self.room.answer();
    }

    /// Sends bytes without waiting: all, or none where there is no room; whether they are on their way. Nothing else may be sending.
    pub fn try_send(&self, bytes: &[u8]) -> bool {
        if self.outgoing.held() + bytes.len() > TX {
            return false;
        }
        for &byte in bytes {
            self.outgoing.push(byte);
        }
        self.start_sending();
        true
    }

    fn lose(&self) {
        self.lost.store(self.lost.load(Ordering::Relaxed).wrapping_add(1), Ordering::Relaxed);
    }

    fn push(&self, byte: u8, stamp: u32) {
        if !self.received.push(stamp << 8 | u32::from(byte)) {
            self.lose();
            return;
        }
        // The reader sleeps for the first byte and then for a chunk, see `Receiver::read`.
        let held = self.received.held();
        if held == 1 || held == CHUNK {
            self.arrived.ring();
        }
    }

    async fn wait_for(&self, count: usize) {
        poll_fn(|context| {
            self.arrived.register(context.waker());
            if self.received.held() < count { Poll::Pending } else { Poll::Ready(()) }
        })
        .await;
    }

    /// Lets go of the oldest bytes, of which there are at least so many.
    fn let_go(&self, count: usize) {
        self.received.let_go(count);
        if HOLD_BACK.load(Ordering::Relaxed) {
            self.control(|w| w.set_rxneie(true));
        }
    }

    fn start_sending(&self) {
        self.control(|w| w.set_txeie(true));
    }

    /// Changes the control register between two of its interrupts, which are held off for these few instructions.
    fn control(&self, change: impl FnOnce(&mut Cr1)) {
        cortex_m::interrupt::free(|_| self.usart.cr1().modify(change));
    }
}

/// Both ends of an open [`Port`].
pub struct Line<const RX: usize, const TX: usize> {
    receiver: Receiver<RX, TX>,
    sender: Sender<RX, TX>,
    bus_hz: u32,
}

/// The reader of an open [`Port`].
pub struct Receiver<const RX: usize, const TX: usize> {
    port: &'static Port<RX, TX>,
    /// Bytes of the latest read: they stay in the ring, with their stamps, until the next.
    count: usize,
    /// The counter after that read, and its device time.
    read_at: (u32, DeviceTime),
}

/// The writer of an open [`Port`].
pub struct Sender<const RX: usize, const TX: usize> {
    port: &'static Port<RX, TX>,
}

impl<const RX: usize, const TX: usize> Line<RX, TX> {
    /// Reader and writer for tasks of their own; the rate then stays as it is.
    pub fn split(self) -> (Receiver<RX, TX>, Sender<RX, TX>) {
        (self.receiver, self.sender)
    }
}

impl<const RX: usize, const TX: usize> ErrorType for Receiver<RX, TX> {
    type Error = Infallible;
}

impl<const RX: usize, const TX: usize> ErrorType for Sender<RX, TX> {
    type Error = Infallible;
}

impl<const RX: usize, const TX: usize> ErrorType for Line<RX, TX> {
    type Error = Infallible;
}

impl<const RX: usize, const TX: usize> Read for Receiver<RX, TX> {
    /// Waits for a byte, then until there are [`CHUNK`] or [`GATHER`] has passed, and returns what there is. Stamps are the bytes' own, so that
    /// gathering costs no accuracy; a wake-up a byte would cost a tenth of the core.
    async fn read(&mut self, into: &mut [u8]) -> Result<usize, Infallible> {
        if into.is_empty() {
            return Ok(0);
        }
        let port = self.port;
        port.let_go(core::mem::take(&mut self.count));
        port.wait_for(1).await;
        if port.received.held() < CHUNK {
            select(port.wait_for(CHUNK), Timer::after(GATHER)).await;
        }
        self.count = port.received.held().min(CHUNK).min(into.len());
        for (k, slot) in into.iter_mut().take(self.count).enumerate() {
            *slot = port.received.peek(k) as u8;
        }
        let counter = time::counter();
        self.read_at = (counter, time::extend(counter));
        Ok(self.count)
    }
}

impl<const RX: usize, const TX: usize> StampedRead for Receiver<RX, TX> {
    fn arrival(&self, k: usize) -> DeviceTime {
        let stamp = self.port.received.peek(k) >> 8;
        let (counter, time) = self.read_at;
        let age = counter.wrapping_sub(stamp) & STAMP_MASK;
        time.offset(-i64::from(age))
    }

    fn lost(&self) -> u32 {
        self.port.lost.load(Ordering::Relaxed)
    }
}

impl<const RX: usize, const TX: usize> Write for Sender<RX, TX> {
    async fn write(&mut self, bytes: &[u8]) -> Result<usize, Infallible> {
        if bytes.is_empty() {
            return Ok(0);
        }
        let port = self.port;
        let count = poll_fn(|context| {
            port.room.register(context.waker());
            match bytes.iter().take_while(|byte| port.outgoing.push(**byte)).count() {
                0 => Poll::Pending,
                count => Poll::Ready(count),
            }
        })
        .await;
        port.start_sending();
        Ok(count)
    }

    /// Waits until the last bit has left the pin.
    async fn flush(&mut self) -> Result<(), Infallible> {
        while self.port.outgoing.held() > 0 || !self.port.usart.sr().read().tc() {
            Timer::after_millis(1).await;
        }
        Ok(())
    }
}

impl<const RX: usize, const TX: usize> Read for Line<RX, TX> {
    async fn read(&mut self, into: &mut [u8]) -> Result<usize, Infallible> {
        self.receiver.read(into).await
    }
}

impl<const RX: usize, const TX: usize> StampedRead for Line<RX, TX> {
    fn arrival(&self, k: usize) -> DeviceTime {
        self.receiver.arrival(k)
    }

    fn lost(&self) -> u32 {
        self.receiver.lost()
    }
}

impl<const RX: usize, const TX: usize> Write for Line<RX, TX> {
    async fn write(&mut self, bytes: &[u8]) -> Result<usize, Infallible> {
        self.sender.write(bytes).await
    }

    async fn flush(&mut self) -> Result<(), Infallible> {
        self.sender.flush().await
    }
}

impl<const RX: usize, const TX: usize> SensorLine for Line<RX, TX> {
    async fn set_baud(&mut self, baud: u32) {
        let Ok(()) = self.flush().await;
        self.receiver.port.set_divider(self.bus_hz, baud);
    }
}
