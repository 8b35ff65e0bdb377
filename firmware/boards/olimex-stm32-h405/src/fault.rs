//! Panics and faults: their reason survives the reset that they cause and is told in the next hello.
//!
//! The record lies in RAM that the start-up code does not touch. After power-on that RAM holds anything; a mark and a
//! checksum over the text tell a record from that.

use core::cell::UnsafeCell;
use core::fmt::{self, Write};
use core::mem::MaybeUninit;
use core::panic::PanicInfo;
use core::ptr;

use cortex_m::peripheral::SCB;
use cortex_m_rt::exception;
use crossfall_core::instrument::RESTART_TEXT;
use embassy_stm32::pac;

/// Longest text kept: what the hello has room for.
const CAPACITY: usize = RESTART_TEXT;

const MARK: u32 = 0x0c50_55fa;

/// What lies in RAM across a reset.
#[repr(C)]
#[derive(Clone, Copy)]
struct Record {
    mark: u32,
    boots: u32,
    length: u32,
    checksum: u32,
    text: [u8; CAPACITY],
}

struct Cell(UnsafeCell<MaybeUninit<Record>>);

// SAFETY: read once at boot before interrupts are on, written last before a reset with interrupts off.
unsafe impl Sync for Cell {}

#[unsafe(link_section = ".uninit.restart")]
static RECORD: Cell = Cell(UnsafeCell::new(MaybeUninit::uninit()));

/// What is known of the start.
pub struct Restart {
    /// Number of this boot since power-on, from 1.
    pub boot: u32,
    reason: Record,
}

impl Restart {
    /// Why the board restarted; empty after power-on.
    pub fn reason(&self) -> &str {
        self.reason
            .text
            .get(..self.reason.length as usize)
            .and_then(|text| str::from_utf8(text).ok())
            .unwrap_or_default()
    }
}

impl Record {
    const EMPTY: Self = Self { mark: MARK, boots: 0, length: 0, checksum: 0, text: [0; CAPACITY] };

    /// FNV-1a over everything but the checksum.
    #[inline(never)]
    fn sum(&self) -> u32 {
        let head = [self.mark, self.boots, self.length];
        let bytes = head.iter().flat_map(|word| word.to_le_bytes()).chain(self.text);
        bytes.fold(0x811c_9dc5, |hash, byte| (hash ^ u32::from(byte)).wrapping_mul(0x0100_0193))
    }

    fn valid(&self) -> bool {
        self.mark == MARK && self.length as usize <= CAPACITY && self.checksum == self.sum()
    }

    fn load() -> Self {
        // SAFETY: any bits are a `Record`; volatile, as the compiler must not reason about memory it holds uninitialised.
        let record = unsafe { ptr::read_volatile(RECORD.0.get().cast::<Record>()) };
        if record.valid() { record } else { Self::EMPTY }
    }

    fn store(mut self) {
        self.checksum = self.sum();
        // SAFETY: the cell is only touched at boot and on the way into a reset, never by two at once.
        unsafe { ptr::write_volatile(RECORD.0.get().cast::<Record>(), self) };
    }
}

impl Write for Record {
    /// Keeps what fits.
    fn write_str(&mut self, text: &str) -> fmt::Result {
        let free = self.text.get_mut(self.length as usize..).unwrap_or_default();
        let mut end = text.len().min(free.len());
        while !text.is_char_boundary(end) {
            end -= 1;
        }
        for (slot, byte) in free.iter_mut().zip(text.bytes().take(end)) {
            *slot = byte;
        }
        self.length += end as u32;
        Ok(())
    }
}

/// Reads and clears the record and the reset flags. To be called once, first thing.
pub fn take() -> Restart {
    let mut reason = Record::load();
    let boot = reason.boots.wrapping_add(1);
    let flags = pac::RCC.csr().read();
    if reason.length == 0 {
        let cause = if flags.wdgrstf() {
            "watchdog"
        } else if flags.sftrstf() {
            "software reset"
        } else if flags.padrstf() && !flags.porrstf() {
            "reset pin"
        } else {
            ""
        };
        let _ = reason.write_str(cause);
    }
    pac::RCC.csr().modify(|w| w.set_rmvf(true));
    Record { boots: boot, ..Record::EMPTY }.store();
    Restart { boot, reason }
}

fn reset_with(reason: fmt::Arguments) -> ! {
    cortex_m::interrupt::disable();
    let mut record = Record { boots: Record::load().boots, ..Record::EMPTY };
    let _ = record.write_fmt(reason);
    record.store();
    SCB::sys_reset()
}

#[panic_handler]
fn panic(info: &PanicInfo) -> ! {
    let message = info.message();
    match info.location() {
        Some(place) => reset_with(format_args!("panicked at {}:{}: {message}", source(place.file()), place.line())),
        None => reset_with(format_args!("panicked: {message}")),
    }
}

/// The end of a source file's path: where somebody's registry lies says nothing, and would leave no room for the message.
fn source(path: &str) -> &str {
    let slashes = path.bytes().enumerate().filter(|&(_, byte)| byte == b'/').map(|(at, _)| at);
    let third_last = slashes.clone().count().checked_sub(3).and_then(|k| slashes.clone().nth(k));
    third_last.and_then(|at| path.get(at + 1..)).unwrap_or(path)
}

// A fault may come from a stack that has no room left, so the stack starts afresh before anything is called: nothing of
// it is needed again. The program counter of the culprit is on the old stack, if that still was memory.
core::arch::global_asm!(
    ".section .text.HardFault",
    ".thumb_func",
    ".global HardFault",
    "HardFault:",
    "mrs r0, msp",
    "ldr r1, =_stack_start",
    "msr msp, r1",
    "b {report}",
    report = sym report_fault,
);

unsafe extern "C" {
    static _stack_end: u32;
}

unsafe extern "C" fn report_fault(frame: *const u32) -> ! {
    // SAFETY: fixed registers of the core (ARMv7-M, B3.2.15), reads without effect.
    let (hard, configurable) = unsafe { ((*SCB::PTR).hfsr.read(), (*SCB::PTR).cfsr.read()) };
    if (frame as usize) < (&raw const _stack_end) as usize + 32 {
        reset_with(format_args!("stack overflow, cfsr {configurable:#010x}"));
    }
    // SAFETY: the frame lies on the stack, which `_stack_end` and the check above bound; the program counter is its
    // seventh word (B1.5.6).
    let counter = unsafe { frame.wrapping_add(6).read_volatile() };
    reset_with(format_args!("hard fault at {counter:#010x}, hfsr {hard:#010x}, cfsr {configurable:#010x}"))
}

#[exception]
unsafe fn DefaultHandler(number: i16) {
    reset_with(format_args!("unexpected interrupt {number}"))
}
