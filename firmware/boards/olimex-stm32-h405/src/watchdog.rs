//! The independent watchdog: resets the board when the acquisition executor or the survey stands still.
//!
//! It runs from its own oscillator and cannot be stopped once started (RM0090, 21.3). It is fed by the acquisition
//! executor, and only while the survey has given a sign of life since: a survey that loops for ever starves it too.

use embassy_stm32::Peri;
use embassy_stm32::peripherals::IWDG;
use embassy_stm32::wdg::IndependentWatchdog;
use embassy_time::Timer;

/// Without food for this long the board restarts: four times what a scan takes by the paper's search at its closest spacing.
const TIMEOUT_US: u32 = 2_000_000;

/// Feeding interval.
const INTERVAL_MS: u64 = 250;

/// Starts the watchdog and feeds it for ever, once for each change of `alive`, a count that the survey keeps advancing.
pub async fn feed(watchdog: Peri<'static, IWDG>, alive: impl Fn() -> u32) -> ! {
    let mut watchdog = IndependentWatchdog::new(watchdog, TIMEOUT_US);
    watchdog.unleash();
    let mut seen = alive();
    loop {
        Timer::after_millis(INTERVAL_MS).await;
        let now = alive();
        if now != seen {
            watchdog.pet();
            seen = now;
        }
    }
}
