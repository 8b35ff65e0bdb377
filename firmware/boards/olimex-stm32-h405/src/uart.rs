//! UARTs that stamp every byte in the first instruction of its interrupt and count every byte they lose.
//!
//! A byte and the low 24 bits of its stamp share one word of a ring: single producer (the interrupt), single consumer
//! (the reader), no lock. 24 bits are 16.8 s; readers come every millisecond. A byte that arrives while the ring is
//! full, or that the receiver itself overran (RM0090, 30.6.1, ORE), is counted, never silently gone. Sending goes
//! through a bounded pipe that the transmit interrupt drains.
//!
//! One byte an interrupt and no DMA: at 500 kbaud that is 50,000 interrupts a second of about 60 cycles, 2 % of the
//! core, and each byte has a stamp of its own, which a DMA block would not give. QEMU has neither DMA nor IDLE.

use core::convert::Infallible;
use core::future::poll_fn;
use core::sync::atomic::{AtomicBool, AtomicU32, Ordering};
use core::task::Poll;

use crossfall_firmware::line::{SensorLine, StampedRead};
use crossfall_protocol::DeviceTime;
use embassy_futures::select::select;
use embassy_stm32::pac::usart::Usart;
use embassy_sync::blocking_mutex::raw::CriticalSectionRawMutex;
use embassy_sync::pipe::Pipe;
use embassy_sync::waitqueue::AtomicWaker;
use embassy_time::{Duration, Timer};
use embedded_io_async::{ErrorType, Read, Write};

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

/// One UART: `RX` bytes of ring (a power of two), `TX` bytes of pipe.
pub struct Port<const RX: usize, const TX: usize> {
    usart: Usart,
    ring: [AtomicU32; RX],
    /// Bytes ever put into the ring and ever taken out; their difference is what it holds.
    put: AtomicU32,
    taken: AtomicU32,
    lost: AtomicU32,
    arrived: AtomicWaker,
    outgoing: Pipe<CriticalSectionRawMutex, TX>,
}

impl<const RX: usize, const TX: usize> Port<RX, TX> {
    /// A port for one peripheral; nothing happens before [`Port::open`].
    pub const fn new(usart: Usart) -> Self {
        const { assert!(RX.is_power_of_two()) };
        Self {
            usart,
            ring: [const { AtomicU32::new(0) }; RX],
            put: AtomicU32::new(0),
            taken: AtomicU32::new(0),
            lost: AtomicU32::new(0),
            arrived: AtomicWaker::new(),
            outgoing: Pipe::new(),
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
        if status.rxne() && self.held() >= RX && HOLD_BACK.load(Ordering::Relaxed) {
            self.usart.cr1().modify(|w| w.set_rxneie(false));
        } else if status.rxne() || status.ore() {
            let byte = self.usart.dr().read().dr() as u8;
            if status.ore() {
                self.lost.store(self.lost.load(Ordering::Relaxed).wrapping_add(1), Ordering::Relaxed);
            }
            if status.rxne() {
                self.push(byte, stamp);
            }
        }
        if status.txe() && self.usart.cr1().read().txeie() {
            let mut byte = [0];
            if self.outgoing.try_read(&mut byte).is_ok() {
                self.usart.dr().write(|w| w.set_dr(byte[0].into()));
            } else {
                self.usart.cr1().modify(|w| w.set_txeie(false));
            }
        }
    }

    /// Bytes in the ring.
    fn held(&self) -> usize {
        self.put.load(Ordering::Acquire).wrapping_sub(self.taken.load(Ordering::Acquire)) as usize
    }

    fn push(&self, byte: u8, stamp: u32) {
        let put = self.put.load(Ordering::Relaxed);
        let held = put.wrapping_sub(self.taken.load(Ordering::Acquire)) as usize;
        if held >= RX {
            self.lost.store(self.lost.load(Ordering::Relaxed).wrapping_add(1), Ordering::Relaxed);
            return;
        }
        self.ring[put as usize % RX].store(stamp << 8 | u32::from(byte), Ordering::Relaxed);
        self.put.store(put.wrapping_add(1), Ordering::Release);
        // The reader sleeps for the first byte and then for a chunk, see `Receiver::read`.
        if held == 0 || held + 1 == CHUNK {
            self.arrived.wake();
        }
    }

    async fn wait_for(&self, count: usize) {
        poll_fn(|context| {
            self.arrived.register(context.waker());
            if self.held() < count { Poll::Pending } else { Poll::Ready(()) }
        })
        .await;
    }

    /// Byte `k` of the ring and the low 24 bits of its stamp. What it holds stays there until it is let go.
    fn entry(&self, k: usize) -> (u8, u32) {
        let at = (self.taken.load(Ordering::Relaxed) as usize).wrapping_add(k);
        let entry = self.ring[at % RX].load(Ordering::Relaxed);
        (entry as u8, entry >> 8)
    }

    /// Lets go of the oldest bytes, of which there are at least so many.
    fn let_go(&self, count: usize) {
        let taken = self.taken.load(Ordering::Relaxed);
        self.taken.store(taken.wrapping_add(count as u32), Ordering::Release);
        if HOLD_BACK.load(Ordering::Relaxed) {
            critical_section::with(|_| self.usart.cr1().modify(|w| w.set_rxneie(true)));
        }
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
        if port.held() < CHUNK {
            select(port.wait_for(CHUNK), Timer::after(GATHER)).await;
        }
        self.count = port.held().min(CHUNK).min(into.len());
        for (k, slot) in into.iter_mut().take(self.count).enumerate() {
            *slot = port.entry(k).0;
        }
        let counter = time::counter();
        self.read_at = (counter, time::extend(counter));
        Ok(self.count)
    }
}

impl<const RX: usize, const TX: usize> StampedRead for Receiver<RX, TX> {
    fn arrival(&self, k: usize) -> DeviceTime {
        let (_, stamp) = self.port.entry(k);
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
        let count = self.port.outgoing.write(bytes).await;
        critical_section::with(|_| self.port.usart.cr1().modify(|w| w.set_txeie(true)));
        Ok(count)
    }

    /// Waits until the last bit has left the pin.
    async fn flush(&mut self) -> Result<(), Infallible> {
        while !self.port.outgoing.is_empty() || !self.port.usart.sr().read().tc() {
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
