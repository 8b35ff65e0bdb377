//! `SPEC.md` is the golden file of the wire: its frames are the bytes that the code makes, and they decode to the
//! messages that it names. After a deliberate change of the wire, `CROSSFALL_BLESS=1 cargo test -p crossfall-protocol`
//! writes the new bytes into it.

mod samples;

use std::fmt::Write;

use crossfall_protocol::config::Method;
use crossfall_protocol::frame::{BoardDecoder, Event, HostDecoder, MAX_COMMAND_FRAME, MAX_MESSAGE_FRAME};
use crossfall_protocol::message::*;
use crossfall_protocol::ranges::{self, MAX_CODE};
use crossfall_protocol::{Command, Config, DeviceTime, schema};
use samples::{command_examples, message_examples};

const SPEC: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/SPEC.md");

/// The scan of the example: a plane 2 m below, in whole degrees; no echo beyond 30 m.
fn plane() -> Vec<u16> {
    (0..181)
        .map(|degree| 2000.0 / f64::from(degree).to_radians().sin())
        .map(|range| if range < 30_000.0 { range.round() as u16 } else { 32_767 })
        .collect()
}

/// Bytes in hexadecimal, 32 a line.
fn hex(bytes: &[u8]) -> String {
    let mut text = String::new();
    for line in bytes.chunks(32) {
        let words: Vec<String> = line.iter().map(|byte| format!("{byte:02X}")).collect();
        writeln!(text, "{}", words.join(" ")).expect("a string takes all");
    }
    text
}

/// Name and frame of every example, numbered 300, 301, ... to show a sequence number of two bytes.
fn frames() -> Vec<(String, Vec<u8>)> {
    let mut code = [0; MAX_CODE];
    let mode = ScanMode { span_deg: 180, step_cdeg: 100, measuring: 6 };
    let code = ranges::encode(1 << 14 | 181, mode, &plane(), &mut code);
    let mut frame = [0; MAX_MESSAGE_FRAME];
    let mut all = Vec::new();
    for ((name, message), sequence) in message_examples(code).into_iter().zip(300..) {
        let len = message.encode(sequence, &mut frame).expect("fits");
        let mut decoder = HostDecoder::new();
        let Some(Event::Frame(back)) = decoder.next(&mut &frame[..len]) else { panic!("{name} decodes") };
        assert_eq!((back.sequence, back.body), (sequence, message), "{name}");
        all.push((format!("Message::{name}"), frame[..len].to_vec()));
    }
    for ((name, command), sequence) in command_examples().into_iter().zip(300..) {
        let len = command.encode(sequence, &mut frame).expect("fits");
        let mut decoder = BoardDecoder::new();
        let Some(Event::Frame(back)) = decoder.next(&mut &frame[..len]) else { panic!("{name} decodes") };
        assert_eq!((back.sequence, back.body), (sequence, command), "{name}");
        all.push((format!("Command::{name}"), frame[..len].to_vec()));
    }
    all
}

#[test]
fn the_frames_of_the_specification_are_those_of_the_code() {
    let mut spec = std::fs::read_to_string(SPEC).expect("SPEC.md is beside the code");
    let bless = std::env::var_os("CROSSFALL_BLESS").is_some();
    for (name, frame) in frames() {
        let head = format!("```text {name}\n");
        let start = spec.find(&head).unwrap_or_else(|| panic!("SPEC.md has no frame of {name}")) + head.len();
        let end = start + spec[start..].find("```").expect("a block ends");
        if bless {
            spec.replace_range(start..end, &hex(&frame));
        }
        let end = start + spec[start..].find("```").expect("a block ends");
        assert_eq!(&spec[start..end], hex(&frame), "{name}");
    }
    let line = format!("Schema hash: `{:#018X}`", schema::HASH);
    if bless {
        let start = spec.find("Schema hash: `").expect("SPEC.md names the hash");
        spec.replace_range(start..start + line.len(), &line);
        std::fs::write(SPEC, &spec).expect("SPEC.md is writable");
    }
    assert!(spec.contains(&line), "SPEC.md should have: {line}");
}

#[test]
fn the_example_scan_decodes_to_the_plane() {
    let mut code = [0; MAX_CODE];
    let mode = ScanMode { span_deg: 180, step_cdeg: 100, measuring: 6 };
    let code = ranges::encode(1 << 14 | 181, mode, &plane(), &mut code).to_vec();
    for (_, message) in message_examples(&code) {
        if let Message::Scan(scan) = message {
            assert_eq!(scan.values(&mut [0; ranges::MAX_VALUES]), Ok(&plane()[..]));
        }
    }
}

#[test]
fn the_declared_lengths_are_those_of_the_specification() {
    let spec = std::fs::read_to_string(SPEC).expect("SPEC.md is beside the code");
    assert!(spec.contains(&format!("{MAX_MESSAGE_FRAME} bytes from the board")));
    assert!(spec.contains(&format!("{MAX_COMMAND_FRAME} bytes to it")));
}

/// The payload of a message after the sequence number, by way of a frame shorter than a COBS block.
fn payload(frame_of: impl FnOnce(&mut [u8]) -> usize) -> Vec<u8> {
    let mut frame = [0; MAX_MESSAGE_FRAME];
    let len = frame_of(&mut frame);
    let mut plain = vec![0; len];
    let report = cobs::decode(&frame[..len], &mut plain).expect("COBS");
    plain.truncate(report.frame_size() - 4);
    plain.remove(0);
    plain
}

/// Every variant's number on the wire. A failure here is a break of the wire, not of the test.
#[test]
fn every_discriminant_is_pinned() {
    let message = |message: Message<'_>| payload(|out| message.encode(0, out).expect("fits"));
    let numbers: Vec<u8> = message_examples(&[]).iter().map(|&(_, example)| message(example)[0]).collect();
    assert_eq!(numbers, [0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12]);
    let numbers: Vec<u8> =
        command_examples().iter().map(|(_, command)| payload(|out| command.encode(0, out).expect("fits"))[0]).collect();
    assert_eq!(numbers, [0, 1, 2, 3, 4, 5, 6]);

    let time = DeviceTime(0);
    for (verdict, number) in [(PulseVerdict::Accepted, 0), (PulseVerdict::Spurious, 1), (PulseVerdict::Restarted, 2)] {
        assert_eq!(message(Message::Pulse(Pulse { time, verdict })), [4, 0, number]);
    }
    for (level, number) in [(Level::Error, 0), (Level::Warn, 1), (Level::Info, 2), (Level::Defmt, 3)] {
        assert_eq!(message(Message::Log(LogLine { time, level, text: &[] })), [8, 0, number, 0]);
    }
    for (outcome, bytes) in [
        (Outcome::Done, vec![9, 0, 0]),
        (Outcome::BadConfig, vec![9, 0, 1]),
        (Outcome::Unknown, vec![9, 0, 2]),
        (Outcome::Pong(7), vec![9, 0, 3, 7]),
    ] {
        assert_eq!(message(Message::Reply(Reply { to: 0, outcome })), bytes);
    }
    assert_eq!(message(Message::Session(Session::Started(time))), [10, 0, 0]);
    assert_eq!(message(Message::Session(Session::Stopped(time))), [10, 1, 0]);
    assert_eq!(message(Message::Skip(Skip::Scan(7))), [11, 0, 7]);
    assert_eq!(message(Message::Skip(Skip::Pose(time))), [11, 1, 0]);
    for (sensor, number) in [(Sensor::Lidar, 0), (Sensor::Ins, 1)] {
        assert_eq!(payload(|out| Command::Restart(sensor).encode(0, out).expect("fits")), [6, number]);
    }
    for (method, number) in [(Method::Measuring, 0), (Method::Seed, 1)] {
        let mut config = Config::default();
        config.survey.method = method;
        let bytes = payload(|out| Command::Configure(config).encode(0, out).expect("fits"));
        let of_default = payload(|out| Command::Configure(Config::default()).encode(0, out).expect("fits"));
        let differing = bytes.iter().zip(&of_default).filter(|(a, b)| a != b).count();
        assert_eq!(differing, number);
    }
}

#[test]
fn a_payload_with_a_needlessly_long_varint_or_more_bytes_is_not_understood() {
    let crc = crc::Crc::<u32>::new(&crc::CRC_32_ISO_HDLC);
    let judge = |payload: &[u8]| {
        let whole = [payload, &crc.checksum(payload).to_le_bytes()].concat();
        let mut frame = vec![0; whole.len() + 3];
        let len = cobs::encode(&whole, &mut frame);
        frame[len] = 0;
        let mut decoder = BoardDecoder::new();
        let mut input = &frame[..=len];
        match decoder.next(&mut input) {
            Some(Event::Frame(frame)) => Ok((frame.sequence, frame.body)),
            Some(Event::Rejected(rejected)) => Err((rejected.fault, rejected.sequence)),
            None => panic!("a delimiter ends a frame"),
        }
    };
    use crossfall_protocol::frame::Fault::NotUnderstood;
    assert_eq!(judge(&[5, 1, 7]), Ok((5, Command::Ping(7))));
    assert_eq!(judge(&[5, 1, 0x87, 0]), Err((NotUnderstood, Some(5))));
    assert_eq!(judge(&[0x85, 0, 1, 7]), Err((NotUnderstood, Some(5))));
    assert_eq!(judge(&[5, 1, 7, 0]), Err((NotUnderstood, Some(5))));
    assert_eq!(judge(&[5, 99]), Err((NotUnderstood, Some(5))));
    assert_eq!(judge(&[5]), Err((NotUnderstood, Some(5))));
    assert_eq!(judge(&[]), Err((NotUnderstood, None)));
}

#[test]
fn a_label_is_cut_between_characters_and_comes_back() {
    assert_eq!(Label::new("bridge 14").text(), "bridge 14");
    assert_eq!(Label::new("").text(), "");
    // Twelve characters of two bytes fill it; a thirteenth, or half of one, finds no room.
    assert_eq!(Label::new(&"\u{e4}".repeat(13)).text(), "\u{e4}".repeat(12));
    assert_eq!(Label::new(&format!("x{}", "\u{e4}".repeat(12))).text(), format!("x{}", "\u{e4}".repeat(11)));
    assert_eq!(Label::new("a\0b").text(), "ab");
    assert_eq!(Label([0xff; Label::MAX]).text(), "");
}
