//! A board that fails says so when it is back: a panic, a fault and a stack that has no room left each restart it, and the next hello
//! names the reason. The reason lies in RAM that the start-up code leaves alone.

use std::time::Duration;

use crossfall_core::protocol::message::Message;
use crossfall_tests::emulator::{Emulator, Failure, Image, Options, image};

/// A restart takes a tenth of a second, on a host with nothing else to do.
const PATIENCE: Duration = Duration::from_secs(60);

#[test]
fn every_failure_is_named_in_the_next_hello() {
    let mut board = Emulator::start(&image(Image::Board), &Options::default()).expect("a board");
    let hello = |message: &Message<'_>| match message {
        Message::Hello(hello) => Some((hello.boot, hello.restart.to_owned())),
        _ => None,
    };
    let (mut at, (boot, reason)) = board.link.wait_for(0, PATIENCE, hello).expect("a hello");
    // QEMU's memory is zero at power-on, and so are its reset flags.
    assert_eq!((boot, reason.as_str()), (1, ""));
    let failures = [
        (Failure::Panic, "panicked at src/emulation.rs"),
        (Failure::HardFault, "hard fault at 0x080"),
        (Failure::StackOverflow, "stack overflow"),
        (Failure::Panic, "panicked at src/emulation.rs"),
    ];
    for (k, (failure, expected)) in failures.into_iter().enumerate() {
        board.provoke(failure).expect("a running board");
        let (next, (boot, reason)) = board.link.wait_for(at, PATIENCE, hello).expect("another hello");
        println!("boot {boot}: {reason:?}");
        assert!(reason.starts_with(expected), "{failure:?}: {reason:?}");
        assert_eq!(boot as usize, k + 2);
        at = next;
    }
    // The failure is told once: one boot later, only the command to identify brings a hello, with the same reason.
    assert_eq!(board.link.losses().1, 4, "restarts that the sequence numbers show");
}
