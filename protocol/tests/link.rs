//! The link as a whole: everything sent comes back, nothing is longer than declared, and of a damaged stream nothing is
//! lost but what the damage hit.

mod samples;

use crossfall_protocol::frame::{
    BoardDecoder, Event, Fault, HostDecoder, MAX_COMMAND_FRAME, MAX_MESSAGE_FRAME, MAX_TEXT, NoRoom,
};
use crossfall_protocol::message::{Level, LogLine, Message};
use crossfall_protocol::{Command, DeviceTime};
use proptest::collection::vec;
use proptest::prelude::*;
use samples::{any_command, any_message, message_examples, worst_config, worst_messages};

/// A stream of messages numbered from 0, and where each frame begins.
fn stream(messages: &[Message<'_>]) -> (Vec<u8>, Vec<usize>) {
    let (mut bytes, mut starts) = (Vec::new(), Vec::new());
    let mut buffer = [0; MAX_MESSAGE_FRAME];
    for (message, sequence) in messages.iter().zip(0..) {
        let len = message.encode(sequence, &mut buffer).expect("fits");
        starts.push(bytes.len());
        bytes.extend_from_slice(&buffer[..len]);
    }
    (bytes, starts)
}

/// What a decoder tells of a stream fed in the given pieces.
#[derive(Debug, Default, PartialEq)]
struct Told {
    /// Sequence number and offset of every good frame.
    frames: Vec<(u16, u64)>,
    /// Fault, offset and length of everything else.
    rejected: Vec<(Fault, u64, u64)>,
    /// Every byte of every event, in order.
    raw: Vec<u8>,
}

/// Decode `bytes` in pieces of the given lengths (again and again), checking the accounting at every step.
fn decode(bytes: &[u8], pieces: &[usize]) -> Told {
    let mut decoder = HostDecoder::new();
    let mut told = Told::default();
    let mut rest = bytes;
    for &piece in pieces.iter().cycle() {
        if rest.is_empty() {
            break;
        }
        let (mut head, tail) = rest.split_at(piece.clamp(1, rest.len()));
        rest = tail;
        while let Some(event) = decoder.next(&mut head) {
            match event {
                Event::Frame(frame) => {
                    told.frames.push((frame.sequence, frame.offset));
                    told.raw.extend_from_slice(frame.raw);
                }
                Event::Rejected(rejected) => {
                    told.rejected.push((rejected.fault, rejected.offset, rejected.len));
                    told.raw.extend_from_slice(rejected.raw);
                }
            }
        }
        assert!(head.is_empty(), "a decoder that asks for more has taken all");
        let c = decoder.counters();
        assert_eq!(c.bytes, (bytes.len() - rest.len()) as u64);
        assert_eq!(c.bytes, c.good + c.skipped + c.idle + decoder.pending());
    }
    if let Some(rejected) = decoder.finish() {
        told.rejected.push((rejected.fault, rejected.offset, rejected.len));
        told.raw.extend_from_slice(rejected.raw);
    }
    let c = decoder.counters();
    assert_eq!(c.bytes, c.good + c.skipped + c.idle);
    assert_eq!(c.frames, told.frames.len() as u64);
    assert_eq!(c.rejected(), told.rejected.len() as u64);
    told
}

#[test]
fn the_worst_of_every_message_is_as_long_as_declared() {
    let mut buffer = [0; MAX_MESSAGE_FRAME];
    let mut longest = 0;
    for (message, payload) in worst_messages() {
        let len = message.encode(u16::MAX, &mut buffer).expect("fits");
        // Check, code bytes (one in 254) and delimiter. The worst payloads above hold next to no zeros.
        let frame = payload + 4 + (payload + 4).div_ceil(254) + 1;
        assert_eq!(len, frame, "{message:?}");
        longest = longest.max(len);
    }
    assert_eq!(longest, MAX_MESSAGE_FRAME);
    let len = Command::Configure(worst_config()).encode(u16::MAX, &mut buffer).expect("fits");
    assert_eq!(len, MAX_COMMAND_FRAME);
}

#[test]
fn a_text_beyond_the_greatest_frame_is_refused_whatever_the_buffer() {
    let text = vec![b'x'; MAX_MESSAGE_FRAME];
    let message = Message::Log(LogLine { time: DeviceTime(0), level: Level::Info, text: &text });
    assert_eq!(message.encode(0, &mut [0; 4096]), Err(NoRoom));
    let message = Message::Log(LogLine { time: DeviceTime(0), level: Level::Info, text: &text[..MAX_TEXT] });
    assert!(message.encode(0, &mut [0; 4096]).is_ok());
}

#[test]
fn a_buffer_too_short_by_any_length_is_refused() {
    for (name, message) in message_examples(&[0; 300]) {
        let mut whole = [0; MAX_MESSAGE_FRAME];
        let len = message.encode(0, &mut whole).expect("fits");
        for room in 0..len {
            assert_eq!(message.encode(0, &mut whole[..room]), Err(NoRoom), "{name} in {room} bytes");
        }
        assert_eq!(message.encode(0, &mut whole[..len]), Ok(len), "{name}");
    }
}

proptest! {
    #[test]
    fn every_message_comes_back(message in any_message(), sequence: u16) {
        let mut buffer = [0; MAX_MESSAGE_FRAME];
        let len = message.encode(sequence, &mut buffer).expect("fits");
        prop_assert_eq!(buffer[..len].iter().position(|&byte| byte == 0), Some(len - 1));
        let mut decoder = HostDecoder::new();
        let mut input = &buffer[..len];
        let Some(Event::Frame(frame)) = decoder.next(&mut input) else { panic!("no frame") };
        prop_assert_eq!(frame.sequence, sequence);
        prop_assert_eq!(frame.body, message);
        prop_assert_eq!(frame.raw, &buffer[..len]);
    }

    #[test]
    fn every_command_comes_back(command in any_command(), sequence: u16) {
        let mut buffer = [0; MAX_COMMAND_FRAME];
        let len = command.encode(sequence, &mut buffer).expect("fits");
        let mut decoder = BoardDecoder::new();
        let Some(Event::Frame(frame)) = decoder.next(&mut &buffer[..len]) else { panic!("no frame") };
        prop_assert_eq!((frame.sequence, frame.body), (sequence, command));
    }

    #[test]
    fn how_the_stream_is_cut_makes_no_difference(
        messages in vec(any_message(), 1..8),
        pieces in vec(1..600_usize, 1..20),
    ) {
        let (bytes, starts) = stream(&messages);
        let told = decode(&bytes, &pieces);
        let expected: Vec<_> = starts.iter().zip(0..).map(|(&start, sequence)| (sequence, start as u64)).collect();
        prop_assert_eq!(&told.frames, &expected);
        prop_assert_eq!(&told.raw, &bytes);
        prop_assert_eq!(told, decode(&bytes, &[1]));
    }

    #[test]
    fn a_flipped_byte_costs_its_own_frame_and_at_most_the_next(
        messages in vec(any_message(), 2..8),
        place: prop::sample::Index,
        flip in 1..=255_u8,
    ) {
        let (mut bytes, starts) = stream(&messages);
        let place = place.index(bytes.len());
        let hit = starts.partition_point(|&start| start <= place) - 1;
        let delimiter = bytes[place] == 0;
        bytes[place] ^= flip;
        let told = decode(&bytes, &[usize::MAX]);
        let lost: Vec<usize> = (0..messages.len())
            .filter(|&i| !told.frames.iter().any(|&(sequence, _)| usize::from(sequence) == i))
            .collect();
        // A damaged delimiter joins its frame to the next; at the end of the stream there is none.
        let joined = delimiter && hit + 1 < messages.len();
        prop_assert_eq!(lost, if joined { vec![hit, hit + 1] } else { vec![hit] });
        prop_assert!(!told.rejected.is_empty());
    }

    #[test]
    fn garbage_between_frames_costs_no_frame(
        messages in vec(any_message(), 1..6),
        garbage in vec(vec(any::<u8>(), 0..1200), 6),
        pieces in vec(1..600_usize, 1..20),
    ) {
        let (clean, starts) = stream(&messages);
        let mut bytes = Vec::new();
        let mut expected = Vec::new();
        for (i, &start) in starts.iter().enumerate() {
            bytes.extend_from_slice(&garbage[i]);
            bytes.push(0);
            expected.push((i as u16, bytes.len() as u64));
            bytes.extend_from_slice(&clean[start..starts.get(i + 1).copied().unwrap_or(clean.len())]);
        }
        let told = decode(&bytes, &pieces);
        prop_assert_eq!(&told.frames, &expected);
        prop_assert_eq!(told.rejected, decode(&bytes, &[1]).rejected);
    }

    #[test]
    fn garbage_alone_is_never_a_frame(bytes in vec(any::<u8>(), 0..6000), pieces in vec(1..600_usize, 1..20)) {
        let told = decode(&bytes, &pieces);
        prop_assert!(told.frames.is_empty());
    }

    #[test]
    fn a_cut_stream_yields_every_frame_before_the_cut(messages in vec(any_message(), 1..6), cut: prop::sample::Index) {
        let (bytes, starts) = stream(&messages);
        let cut = cut.index(bytes.len());
        let told = decode(&bytes[..cut], &[usize::MAX]);
        let whole = starts.partition_point(|&start| start <= cut) - 1;
        prop_assert_eq!(told.frames.len(), whole);
        let partial = (cut - starts[whole]) as u64;
        let expected = if partial > 0 { vec![(Fault::Truncated, starts[whole] as u64, partial)] } else { vec![] };
        prop_assert_eq!(told.rejected, expected);
    }
}
