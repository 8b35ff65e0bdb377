//! Three status lights: running, pulse lock, fault.

use crossfall_protocol::message::Status;
use embassy_time::{Duration, Ticker};
use embedded_hal::digital::OutputPin;

use crate::acquisition::Shared;
use crate::now;

/// How often the lights change: the running light blinks at half this rate.
const STEP: Duration = Duration::from_millis(250);

/// Steps for which lock is shown after a pulse: two pulses may be missing.
const LOCK_STEPS: u8 = 12;

/// Steps for which a fault is shown after a loss.
const FAULT_STEPS: u8 = 20;

/// The lights of a board. On is high.
pub struct Lights<R, L, F> {
    /// Blinks while scans come in, is steadily on while the firmware runs without them.
    pub running: R,
    /// On while pulses come in.
    pub lock: L,
    /// On for five seconds after anything was lost.
    pub fault: F,
}

/// What the lights show, from one look at the counters to the next.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Signals {
    scans: u32,
    pulses: u32,
    losses: u64,
    lock_left: u8,
    fault_left: u8,
    blink: bool,
}

impl Signals {
    /// Running, lock, fault, after another step of time.
    pub fn step(&mut self, status: &Status) -> [bool; 3] {
        self.blink = self.scans == status.scans || !self.blink;
        let losses = losses(status);
        self.lock_left = if status.pulses == self.pulses { self.lock_left.saturating_sub(1) } else { LOCK_STEPS };
        self.fault_left = if losses == self.losses { self.fault_left.saturating_sub(1) } else { FAULT_STEPS };
        (self.scans, self.pulses, self.losses) = (status.scans, status.pulses, losses);
        [self.blink, self.lock_left > 0, self.fault_left > 0]
    }
}

/// Everything that counts as lost.
fn losses(status: &Status) -> u64 {
    [
        status.lidar.overruns,
        status.lidar.bad_frames,
        status.ins.overruns,
        status.ins.bad_frames,
        status.scans_missing,
        status.scans_unreadable,
        status.scans_skipped,
        status.poses_unreadable,
        status.pulses_overrun,
        status.frames_dropped,
        status.commands_rejected,
    ]
    .iter()
    .map(|&count| u64::from(count))
    .sum()
}

/// Drives the lights for ever.
pub async fn lights<R: OutputPin, L: OutputPin, F: OutputPin>(shared: &Shared<'_>, mut lights: Lights<R, L, F>) -> ! {
    let mut signals = Signals::default();
    let mut ticker = Ticker::every(STEP);
    loop {
        ticker.next().await;
        let status = shared.borrow_mut().status(now());
        let [running, lock, fault] = signals.step(&status);
        // A light that cannot be switched is no reason to stop measuring.
        let _dark = lights.running.set_state(running.into());
        let _dark = lights.lock.set_state(lock.into());
        let _dark = lights.fault.set_state(fault.into());
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn running_blinks_with_scans_and_stays_on_without() {
        let mut signals = Signals::default();
        let mut status = Status::default();
        let still: [bool; 3] = core::array::from_fn(|_| signals.step(&status)[0]);
        assert_eq!(still, [true; 3]);
        let blinking: [bool; 4] = core::array::from_fn(|_| {
            status.scans += 9;
            signals.step(&status)[0]
        });
        assert_eq!(blinking, [false, true, false, true]);
    }

    #[test]
    fn lock_outlives_two_missing_pulses_and_no_more() {
        let mut signals = Signals::default();
        let locked = Status { pulses: 1, ..Status::default() };
        assert!(signals.step(&locked)[1]);
        let lit = (0..40).take_while(|_| signals.step(&locked)[1]).count();
        assert_eq!(lit + 1, usize::from(LOCK_STEPS));
    }

    #[test]
    fn any_loss_lights_the_fault_for_five_seconds() {
        let mut signals = Signals::default();
        assert!(!signals.step(&Status::default())[2]);
        let lost = Status { frames_dropped: 1, ..Status::default() };
        let lit = (0..40).take_while(|_| signals.step(&lost)[2]).count();
        assert_eq!(lit, 20);
    }
}
