//! The stamp of the pulse. On silicon the timer captures it by itself; the emulator has no such input, so its interrupt stands in: how long
//! that takes to read the counter is what is measured here, in instructions, as every instruction takes one nanosecond.

use std::thread;
use std::time::Duration;

use crossfall_core::protocol::message::{Message, Pulse};
use crossfall_tests::emulator::{Emulator, Image, Options, image};

/// The board's counter at boot: ten seconds before it wraps (the board's `time.rs`).
const START: u32 = 0u32.wrapping_sub(10_000_000);

const PATIENCE: Duration = Duration::from_secs(60);

#[test]
fn pulses_are_stamped_within_a_microsecond_across_the_counters_wrap() {
    let options = Options { arguments: ["-icount", "shift=0,sleep=off"].map(str::to_owned).to_vec() };
    let mut board = Emulator::start(&image(Image::Board), &options).expect("a board");
    let status = |message: &Message<'_>| matches!(message, Message::Status(_)).then_some(());
    let (mut at, ()) = board.link.wait_for(0, PATIENCE, status).expect("a running board");
    let (mut worst_us, mut wrapped, mut before) = (0, false, 0);
    let mut count = 0;
    // Time that the board sleeps through takes none here: it comes to its wrap within a few pulses.
    while count < 40 || (!wrapped && count < 400) {
        count += 1;
        // Never at the same phase of what the board does otherwise.
        thread::sleep(Duration::from_millis(7 + 3 * (count % 7)));
        let injected = board.pulse_exactly().expect("a running board");
        wrapped |= injected < START;
        let pulse = |message: &Message<'_>| match message {
            Message::Pulse(Pulse { time, .. }) => Some(*time),
            _ => None,
        };
        let (next, time) = board.link.wait_for(at, PATIENCE, pulse).expect("every pulse in the stream");
        at = next;
        let late_us = time.0.wrapping_sub(u64::from(injected.wrapping_sub(START)));
        // No critical section holds the interrupt off (the board's `critical.rs`): at most another one that stamps is before it.
        assert!(late_us <= 1, "injected at {injected}, stamped {late_us} us later");
        assert!(time.0 > before, "device time goes back");
        (worst_us, before) = (worst_us.max(late_us), time.0);
    }
    println!("{count} pulses, stamped {worst_us} us late at worst, up to {before} us of device time");
    assert!(wrapped, "the counter has not wrapped");
}
