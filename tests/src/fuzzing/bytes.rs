//! The decoders of byte streams. What they must keep whatever comes: every byte accounted for, and what they accept is what would be sent.

use crossfall_core::protocol::DeviceTime;
use crossfall_core::protocol::frame::{BoardDecoder, Event, HostDecoder, MAX_COMMAND_FRAME, MAX_MESSAGE_FRAME};
use crossfall_core::protocol::message::{LineCounters, ScanMode};
use crossfall_core::protocol::ranges::{MAX_CODE, MAX_VALUES, decode, encode};
use crossfall_core::sensors::{lms2xx, novatel};

/// The shortest LMS telegram (STX, address, length, command, status, CRC) and the shortest NovAtel frame (short header, CRC).
const SHORTEST: [usize; 2] = [8, 16];

/// Every byte is part of a good frame, skipped or pending.
fn accounted(counters: &LineCounters, pushed: usize, pending: usize, shortest: usize, longest: usize) {
    assert_eq!(counters.bytes, pushed as u64);
    let good = counters.bytes.checked_sub(counters.skipped + pending as u64).expect("no byte is counted twice");
    let frames = u64::from(counters.frames);
    assert!(good >= frames * shortest as u64 && good <= frames * longest as u64, "{good} bytes in {frames} frames");
}

pub fn lms(input: &[u8]) {
    let mut decoder = lms2xx::Decoder::new(6);
    let mut scans = 0;
    let mut latest = DeviceTime(0);
    for (i, &byte) in input.iter().enumerate() {
        decoder.push(byte, DeviceTime(20 * i as u64), &mut |event| {
            if let lms2xx::Event::Scan { scan, .. } = event {
                scans += 1;
                assert!(scan.stx >= latest && scan.stx.0 <= 20 * i as u64);
                latest = scan.stx;
            }
        });
        accounted(&decoder.counters(), i + 1, decoder.pending(), SHORTEST[0], lms2xx::LONGEST);
    }
    decoder.finish(&mut |event| scans += u32::from(matches!(event, lms2xx::Event::Scan { .. })));
    assert_eq!(decoder.pending(), 0);
    assert_eq!(scans, decoder.scans());
    accounted(&decoder.counters(), input.len(), 0, SHORTEST[0], lms2xx::LONGEST);
}

pub fn novatel(input: &[u8]) {
    let mut decoder = novatel::Decoder::new();
    let mut events = 0;
    for (i, &byte) in input.iter().enumerate() {
        decoder.push(byte, DeviceTime(43 * i as u64), &mut |_| events += 1);
        accounted(&decoder.counters(), i + 1, decoder.pending(), SHORTEST[1], novatel::LONGEST);
    }
    decoder.finish(&mut |_| events += 1);
    assert_eq!(decoder.pending(), 0);
    assert!(events >= decoder.solutions());
    accounted(&decoder.counters(), input.len(), 0, SHORTEST[1], novatel::LONGEST);
}

/// A good frame is one that the board's encoder makes of its message; the two forms of a last full COBS block apart.
pub fn link(input: &[u8]) {
    let mut decoder = HostDecoder::new();
    let mut rest = input;
    let (mut good, mut rejected) = (0, 0);
    while let Some(event) = decoder.next(&mut rest) {
        match event {
            Event::Frame(frame) => {
                let mut out = [0; MAX_MESSAGE_FRAME];
                let length = frame.body.encode(frame.sequence, &mut out).expect("what was decoded fits");
                assert!(same_frame(&out[..length], frame.raw), "{:02X?}", frame.raw);
                good += 1;
            }
            Event::Rejected(bytes) => {
                assert!(bytes.len >= bytes.raw.len() as u64);
                rejected += 1;
            }
        }
    }
    rejected += u64::from(decoder.finish().is_some());
    let counters = decoder.counters();
    assert_eq!(counters.bytes, input.len() as u64);
    assert_eq!(counters.bytes, counters.good + counters.skipped + counters.idle);
    assert_eq!((counters.frames, counters.rejected()), (good, rejected));
}

pub fn commands(input: &[u8]) {
    let mut decoder = BoardDecoder::new();
    let mut rest = input;
    while let Some(event) = decoder.next(&mut rest) {
        if let Event::Frame(frame) = event {
            let mut out = [0; MAX_COMMAND_FRAME];
            let length = frame.body.encode(frame.sequence, &mut out).expect("what was decoded fits");
            assert!(same_frame(&out[..length], frame.raw), "{:02X?}", frame.raw);
        }
    }
    decoder.finish();
    let counters = decoder.counters();
    assert_eq!(
        (counters.bytes, counters.bytes),
        (input.len() as u64, counters.good + counters.skipped + counters.idle)
    );
}

/// Whether two frames are the same, an empty COBS block at the very end left out.
fn same_frame(ours: &[u8], theirs: &[u8]) -> bool {
    ours == theirs || theirs.strip_suffix(&[1, 0]).is_some_and(|front| ours.strip_suffix(&[0]) == Some(front))
}

/// Layout, mode and a code of its own: what decodes must come back from the values, and any values must come back from their code.
pub fn ranges(input: &[u8]) {
    let Some((&[low, high, span, step, measuring], code)) = input.split_first_chunk() else { return };
    let layout = u16::from_le_bytes([low, high]);
    let mode = ScanMode { span_deg: span, step_cdeg: step, measuring };
    let mut values = [0; MAX_VALUES];
    if let Ok(decoded) = decode(layout, mode, code, &mut values) {
        assert_eq!(decoded.len(), usize::from(layout & 0x3ff));
        round_trip(layout, mode, decoded);
    }
    let raw: Vec<u16> = code.chunks_exact(2).map(|pair| u16::from_le_bytes([pair[0], pair[1]])).collect();
    let count = raw.len().min(MAX_VALUES);
    round_trip(layout & !0x3ff | count as u16, mode, &raw[..count]);
}

fn round_trip(layout: u16, mode: ScanMode, values: &[u16]) {
    let mut room = [0; MAX_CODE];
    let code = encode(layout, mode, values, &mut room);
    assert!(code.len() <= 2 * values.len());
    let mut back = [0; MAX_VALUES];
    assert_eq!(decode(layout, mode, code, &mut back).expect("an encoder's own code"), values);
}
