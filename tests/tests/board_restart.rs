//! A board that fails says so when it is back: a panic, a fault and a stack that has no room left each restart it, and the next hello
//! names the reason. The reason lies in RAM that the start-up code leaves alone.

use std::time::{Duration, Instant};

use crossfall::{board_words, log};
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
        // The whole of it: file, line and message.
        assert!(!matches!(failure, Failure::Panic) || reason.ends_with(": provoked by the bench"), "{reason:?}");
        assert_eq!(boot as usize, k + 2);
        at = next;
    }
    // The failure is told once: one boot later, only the command to identify brings a hello, with the same reason.
    assert_eq!(board.link.losses().1, 4, "restarts that the sequence numbers show");
}

#[test]
fn bench_messages_are_read_against_the_image() {
    let path = image(Image::Board);
    let mut board = Emulator::start(&path, &Options::default()).expect("a board");
    let status = |message: &Message<'_>| matches!(message, Message::Status(_)).then_some(());
    board.link.wait_for(0, PATIENCE, status).expect("a running board");
    let scratch = tempfile::tempdir().expect("a scratch folder");
    let log_path = scratch.path().join("board.mcap");
    let mut writer = log::Writer::create(&log_path).expect("a log");
    for (receive_ns, frame) in board.link.stamped_frames() {
        writer.frame(receive_ns, &frame).expect("room on the disk");
    }
    writer.finish().expect("a whole log");

    let read = |table: Option<&board_words::Table>| {
        let mut lines = Vec::new();
        let untold = board_words::read(&log_path, table, |line| -> Result<(), crossfall::container::Error> {
            lines.push(line);
            Ok(())
        });
        (lines, untold.expect("a readable log"))
    };
    let table = board_words::table(&path).expect("an image");
    let (lines, untold) = read(Some(&table));
    println!("{lines:#?}");
    assert_eq!(untold, board_words::Untold::default());
    let bench: Vec<_> = lines.iter().filter(|line| line.defmt).map(|line| (line.level, line.text.as_str())).collect();
    assert_eq!(bench, [("info", "crossfall 0.1.0 survey 2 on olimex-stm32-h405, boot 1, Emulated")]);
    let (lines, untold) = read(None);
    assert!(lines.iter().all(|line| !line.defmt) && untold.defmt_bytes > 40, "{untold:?}");
    assert!(board_words::table(&log_path).is_err());

    // The same message has come over the bench wire.
    let mut decoder = table.new_stream_decoder();
    let deadline = Instant::now() + PATIENCE;
    let text = loop {
        decoder.received(&board.bench_bytes().expect("a running board"));
        match decoder.decode() {
            Ok(frame) => break frame.display_message().to_string(),
            Err(_) => assert!(Instant::now() < deadline, "nothing on the bench wire"),
        }
        std::thread::sleep(Duration::from_millis(10));
    };
    assert_eq!(text, bench[0].1);
}
