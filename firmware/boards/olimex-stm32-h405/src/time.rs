//! Device time: TIM5 as a free-running 1 MHz counter, extended to 64 bits, and SysTick as the alarm of embassy's timers.
//!
//! One counter stamps everything: interrupts read it, the pulse per second is captured by it (`pulse.rs`), timers wait
//! on it. It starts ten seconds short of its wrap, so that every run, on every bench, crosses what otherwise happens
//! once in 71.6 minutes.
//!
//! SysTick counts 24 bits of the core clock, 99.8 ms at 168 MHz. It is armed for the next timer, but never further than
//! [`LONGEST_ALARM_US`], which also makes sure that no wrap of the counter goes unseen.

use core::cell::RefCell;
use core::sync::atomic::{AtomicU32, Ordering};
use core::task::Waker;

use cortex_m::peripheral::SYST;
use cortex_m::peripheral::syst::SystClkSource;
use cortex_m_rt::exception;
use critical_section::{CriticalSection, Mutex};
use crossfall_core::clock::Counter;
use crossfall_protocol::DeviceTime;
use embassy_stm32::pac;
use embassy_time_driver::Driver;
use embassy_time_queue_utils::Queue;

use crate::clocks::Clocks;

/// The counter's value at boot.
const START: u32 = 0u32.wrapping_sub(10_000_000);

/// Longest alarm, in microseconds.
const LONGEST_ALARM_US: u64 = 90_000;

/// Shortest alarm: SysTick does not fire for a reload of 0.
const SHORTEST_ALARM_US: u64 = 2;

/// Core clock ticks in a microsecond; 0 until [`start`].
static TICKS_PER_US: AtomicU32 = AtomicU32::new(0);

struct Clock {
    counter: Mutex<RefCell<Counter>>,
    queue: Mutex<RefCell<Queue>>,
}

embassy_time_driver::time_driver_impl!(static CLOCK: Clock = Clock {
    counter: Mutex::new(RefCell::new(Counter::starting_at(DeviceTime(START as u64)))),
    queue: Mutex::new(RefCell::new(Queue::new())),
});

/// The counter, for a stamp: one load, to be the first thing an interrupt does.
#[inline(always)]
pub fn counter() -> u32 {
    pac::TIM5.cnt().read()
}

/// Device time of a counter value taken less than 35 minutes ago; 0 before [`start`].
pub fn extend(stamp: u32) -> DeviceTime {
    critical_section::with(|cs| CLOCK.extend(cs, stamp))
}

/// Starts the counter and arms the first alarm. `prescaler` is the divider of the timer's clock, less one.
pub fn start(clocks: &Clocks, systick: &mut SYST) {
    pac::RCC.apb1enr().modify(|w| w.set_tim5en(true));
    let timer = pac::TIM5;
    timer.cr1().write(|w| w.set_cen(false));
    timer.psc().write_value((clocks.timer_hz / 1_000_000 - 1) as u16);
    timer.arr().write_value(u32::MAX);
    // The prescaler is loaded by an update event, which also zeroes the counter (RM0090, 18.4.6).
    timer.egr().write(|w| w.set_ug(true));
    timer.cnt().write_value(START);
    timer.sr().write(|w| w.0 = 0);
    timer.cr1().write(|w| w.set_cen(true));

    TICKS_PER_US.store(clocks.core_hz / 1_000_000, Ordering::Relaxed);
    systick.set_clock_source(SystClkSource::Core);
    systick.enable_interrupt();
    critical_section::with(|cs| CLOCK.arm(cs));
}

impl Clock {
    fn extend(&self, cs: CriticalSection, stamp: u32) -> DeviceTime {
        if TICKS_PER_US.load(Ordering::Relaxed) == 0 {
            return DeviceTime(0);
        }
        self.counter.borrow(cs).borrow_mut().extend(stamp).offset(-i64::from(START))
    }

    /// Wakes what is due and arms SysTick for what comes next.
    fn arm(&self, cs: CriticalSection) {
        let now = self.extend(cs, counter()).0;
        let next = self.queue.borrow(cs).borrow_mut().next_expiration(now);
        let wait_us = next.saturating_sub(now).clamp(SHORTEST_ALARM_US, LONGEST_ALARM_US);
        let ticks = wait_us as u32 * TICKS_PER_US.load(Ordering::Relaxed);
        // SAFETY: SysTick is used by this driver alone; `start` was given its owner, and the critical section excludes
        // its interrupt.
        let mut systick = unsafe { cortex_m::Peripherals::steal().SYST };
        systick.disable_counter();
        systick.set_reload(ticks - 1);
        systick.clear_current();
        systick.enable_counter();
    }
}

impl Driver for Clock {
    fn now(&self) -> u64 {
        critical_section::with(|cs| self.extend(cs, counter()).0)
    }

    fn schedule_wake(&self, at: u64, waker: &Waker) {
        critical_section::with(|cs| {
            let changed = self.queue.borrow(cs).borrow_mut().schedule_wake(at, waker);
            if changed && TICKS_PER_US.load(Ordering::Relaxed) != 0 {
                self.arm(cs);
            }
        });
    }
}

#[exception]
fn SysTick() {
    critical_section::with(|cs| CLOCK.arm(cs));
}
