//! Critical sections that do not delay a stamp, and what that asks of the interrupts that stamp.
//!
//! A critical section raises BASEPRI to the priority below that of the stamping interrupts, instead of masking all of them: a log line, a queue or a
//! timer may take some microseconds with the world shut out, and no byte and no pulse is stamped later for it. In return those interrupts share
//! nothing with anybody but atomics (`ring.rs`) and wake no task themselves: they ring a [`Bell`], and the interrupt that answers it, which
//! critical sections do hold off, wakes the task.

use core::sync::atomic::{AtomicBool, Ordering, compiler_fence};
use core::task::Waker;

use cortex_m::peripheral::NVIC;
use cortex_m::register::{basepri, basepri_max};
use embassy_stm32::interrupt::{Interrupt, Priority};
use embassy_sync::waitqueue::AtomicWaker;

/// Priority of the interrupts that stamp: above every critical section.
pub const STAMPS: Priority = Priority::P1;

/// The highest priority that a critical section holds off.
pub const CEILING: Priority = Priority::P2;

/// The interrupt that answers bells, at [`CEILING`]: one that the hardware does not use here.
pub const ANSWER: Interrupt = Interrupt::CAN1_RX0;

struct Sections;
critical_section::set_impl!(Sections);

// SAFETY: between `acquire` and `release` nothing runs but interrupts of a priority above the ceiling, which share nothing that a critical
// section guards.
unsafe impl critical_section::Impl for Sections {
    unsafe fn acquire() -> u8 {
        let before = basepri::read();
        // Raises the ceiling, never lowers it: a nested section changes nothing.
        basepri_max::write(CEILING as u8);
        cortex_m::asm::isb();
        compiler_fence(Ordering::SeqCst);
        before
    }

    unsafe fn release(before: u8) {
        compiler_fence(Ordering::SeqCst);
        // SAFETY: what `acquire` found.
        unsafe { basepri::write(before) };
    }
}

/// Wakes a task on behalf of an interrupt that may not do so itself.
pub struct Bell {
    rung: AtomicBool,
    waker: AtomicWaker,
}

impl Bell {
    pub const fn new() -> Self {
        Self { rung: AtomicBool::new(false), waker: AtomicWaker::new() }
    }

    /// Who is to be woken from now on.
    pub fn register(&self, waker: &Waker) {
        self.waker.register(waker);
    }

    /// Rings, at any priority.
    pub fn ring(&self) {
        self.rung.store(true, Ordering::Release);
        NVIC::pend(ANSWER);
    }

    /// Wakes who is registered, if it has rung. For [`ANSWER`] only.
    pub fn answer(&self) {
        if self.rung.swap(false, Ordering::AcqRel) {
            self.waker.wake();
        }
    }
}
