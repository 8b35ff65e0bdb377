//! Frames in bytes that no record structure leads to: a damaged chunk, a torn tail, whatever lies between two readable chunks.
//!
//! Frames of the link lie in an uncompressed log as they were received. Each is free of zeros but for the last byte, carries a CRC-32 and must
//! be exactly the encoding of its message, so it proves itself wherever it is found. What precedes it is its record's head of
//! [`HEAD`] bytes, whose zeros end the run of bytes before; the few that do not (parts of the times) are tried as beginnings in turn.
//!
//! Noise passes for a frame once in 2^32 tries, of which a megabyte of damage allows some 200,000.

use crossfall_core::protocol::frame::{DELIMITER, Event, HostDecoder, MAX_MESSAGE_FRAME};

use super::WIRE_ID;
use crate::container::Message;

/// Opcode, length, channel, sequence and two times in front of a frame.
pub const HEAD: usize = 31;

/// The shortest frame: code byte, sequence, variant, CRC, delimiter. None is as short; fewer bytes are no frame for sure.
const SHORTEST: usize = 8;

/// The longest run of bytes that is looked at: a frame, and what may stand before it.
pub const LONGEST: usize = MAX_MESSAGE_FRAME + HEAD;

/// A receive time that differs from the one before by more is not believed: one day.
const PLAUSIBLE_NS: u64 = 86_400_000_000_000;

/// Publish time of a message whose log time is the best guess and not what its record says.
pub const DOUBTFUL: u64 = u64::MAX;

/// Every good frame in `bytes`, which begin at `base` in the file. `near_ns` is the receive time of the frame before. A frame whose head does not
/// prove its time has [`DOUBTFUL`] beside it.
pub fn frames(bytes: &[u8], base: u64, near_ns: u64) -> Vec<Message> {
    let mut found = Vec::new();
    let mut near_ns = near_ns;
    let mut start = 0;
    while let Some(run) = bytes.get(start..).filter(|rest| !rest.is_empty()) {
        let Some(length) = run.iter().position(|&byte| byte == DELIMITER) else { break };
        let end = start + length + 1;
        let last = end.saturating_sub(SHORTEST);
        // A run that is too long for a frame may still end with one.
        let first = start.max(end.saturating_sub(LONGEST));
        let place = (first..=last.min(first + HEAD)).find(|&place| is_frame(&bytes[place..end]));
        if let Some(place) = place.filter(|_| length >= SHORTEST - 1) {
            let (time, proved) = receive_time(bytes, place, end - place, near_ns);
            near_ns = time;
            found.push(Message {
                // A frame without room for a head before it has the place where that would be, so that places rise and extents are true.
                offset: (base + place as u64).saturating_sub(HEAD as u64),
                channel: WIRE_ID,
                sequence: number(bytes, place),
                log_time: time,
                publish_time: if proved { time } else { DOUBTFUL },
                data: bytes[place..end].to_vec(),
            });
        }
        start = end;
    }
    found
}

/// The record's number in the head before a frame at `place`; worth as much as its time.
fn number(bytes: &[u8], place: usize) -> u32 {
    let head = place.checked_sub(HEAD).and_then(|from| bytes.get(from + 11..));
    head.and_then(<[u8]>::first_chunk).map_or(0, |number| u32::from_le_bytes(*number))
}

/// Where a message's record ends.
pub fn end(message: &Message) -> u64 {
    message.offset + (HEAD + message.data.len()) as u64
}

/// Whether bytes are one good frame and nothing else.
pub fn is_frame(bytes: &[u8]) -> bool {
    let mut rest = bytes;
    matches!(HostDecoder::new().next(&mut rest), Some(Event::Frame(frame)) if rest.is_empty() && frame.raw.len() == bytes.len())
}

/// Whether a message's record says its time: it says it twice. Zeros say nothing, however often, unless a frame proves the rest.
pub fn is_certain(message: &Message) -> bool {
    message.log_time == message.publish_time && (message.log_time != 0 || is_frame(&message.data))
}

/// Which of two times that should be the same is believed: what is nearer to the frame before.
pub fn choose(a: u64, b: u64, near_ns: u64) -> u64 {
    if near_ns == 0 || a.abs_diff(near_ns) <= b.abs_diff(near_ns) { a } else { b }
}

/// What records led to and what was found without them, in the order of the file. A frame that proves itself is believed before a record that overlaps
/// it. Also the bytes of found frames to which no record led.
pub fn merge(records: Vec<Message>, found: Vec<Message>) -> (Vec<Message>, u64) {
    let extent = |message: &Message| message.offset..end(message);
    let mut extra = 0;
    let mut all: Vec<Message> = Vec::with_capacity(records.len());
    let mut records = records.into_iter().peekable();
    for good in found {
        // In a compressed chunk all records have the chunk's own place; nothing is found there.
        while let Some(record) = records.next_if(|record| extent(record).end <= good.offset) {
            all.push(record);
        }
        let mut same = None;
        while let Some(record) = records.next_if(|record| extent(record).start < extent(&good).end) {
            if record.data == good.data {
                same = Some(record);
            }
        }
        extra += if same.is_some() { 0 } else { (HEAD + good.data.len()) as u64 };
        all.push(same.unwrap_or(good));
    }
    all.extend(records);
    (all, extra)
}

/// The receive time in the head before a frame at `place`, and whether the head proves it; without one, that of the frame before.
fn receive_time(bytes: &[u8], place: usize, length: usize, near_ns: u64) -> (u64, bool) {
    let Some(head) = place.checked_sub(HEAD).and_then(|from| bytes.get(from..place)) else { return (near_ns, false) };
    let long = |at: usize| head.get(at..).and_then(<[u8]>::first_chunk).map_or(0, |bytes| u64::from_le_bytes(*bytes));
    let (log, publish) = (long(15), long(23));
    let whole = head.first() == Some(&mcap::records::op::MESSAGE) && long(1) == 22 + length as u64;
    if whole && log == publish && (log != 0 || near_ns == 0) {
        return (log, true);
    }
    let best = choose(log, publish, near_ns);
    (if near_ns == 0 || best.abs_diff(near_ns) < PLAUSIBLE_NS { best } else { near_ns }, false)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crossfall_core::protocol::DeviceTime;
    use crossfall_core::protocol::message::{self, Pulse, PulseVerdict};

    const T: u64 = 1_790_000_000_000_000_000;

    fn record(sequence: u16) -> Vec<u8> {
        let mut out = [0; MAX_MESSAGE_FRAME];
        let pulse = Pulse { time: DeviceTime(1_000_000 * u64::from(sequence)), verdict: PulseVerdict::Accepted };
        let length = message::Message::Pulse(pulse).encode(sequence, &mut out).unwrap();
        let mut bytes = vec![mcap::records::op::MESSAGE];
        bytes.extend((22 + length as u64).to_le_bytes());
        bytes.extend(WIRE_ID.to_le_bytes());
        bytes.extend(u32::from(sequence).to_le_bytes());
        let time = T + 1_000_000 * u64::from(sequence);
        bytes.extend([time, time].map(u64::to_le_bytes).concat());
        bytes.extend(&out[..length]);
        bytes
    }

    #[test]
    fn every_frame_is_found_at_its_record_with_its_time() {
        let records: Vec<_> = (0..50).map(record).collect();
        let found = frames(&records.concat(), 1_000, T);
        let mut at = 1_000;
        assert_eq!(found.len(), 50);
        for (i, (message, record)) in found.iter().zip(&records).enumerate() {
            assert_eq!((message.offset, message.log_time), (at, T + 1_000_000 * i as u64));
            assert_eq!(message.data, record[HEAD..]);
            at += record.len() as u64;
        }
    }

    /// Any one byte changed to any of some values: the frame whose bytes these are may be lost, no other, and no frame is made up.
    #[test]
    fn a_changed_byte_costs_at_most_the_frame_it_is_in() {
        let records: Vec<_> = (0..8).map(record).collect();
        let whole = records.concat();
        for at in 0..whole.len() {
            for change in [0x01, 0x80, 0xff, whole[at]] {
                let mut bytes = whole.clone();
                bytes[at] ^= change;
                let found = frames(&bytes, 0, T);
                let kept =
                    records.iter().filter(|record| found.iter().any(|message| message.data == record[HEAD..])).count();
                assert!(kept + 1 >= records.len() && found.len() <= records.len(), "{change:02X} at {at}: {kept}");
                for message in &found {
                    assert!(records.iter().any(|record| message.data == record[HEAD..]), "made up at {at}");
                    assert!(message.log_time.abs_diff(T) < PLAUSIBLE_NS);
                }
            }
        }
    }
}
