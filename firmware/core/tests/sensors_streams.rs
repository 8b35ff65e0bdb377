//! Damaged streams: the decoders against an exhaustive oracle, and every byte accounted for.
//!
//! The oracle reads the whole stream at leisure: the leftmost bytes that have a plausible header and a right check are
//! a frame, the next one is looked for behind it. That is the guarantee, and it is exact: a decoder finds
//! the oracle's frames and no others, whatever lies between them, each with the arrival of its first byte.

use crossfall_core::protocol::DeviceTime;
use crossfall_core::protocol::message::LineCounters;
use crossfall_core::sensors::{Scanner, cola, lms2xx, novatel};
use proptest::collection::vec;
use proptest::prelude::*;

/// Offset and length of a frame.
type Place = (usize, usize);

/// A sensor's format: what its decoder makes of a stream, and what the format alone says about it.
trait Format {
    const LONGEST: usize;
    /// Bytes that headers are made of, to make garbage treacherous.
    const HEADER_BYTES: &'static [u8];
    /// Arrivals of the frames that came out, for bytes with these arrivals, and the counters after each byte.
    fn decode(bytes: &[u8], arrivals: &[DeviceTime]) -> (Vec<DeviceTime>, Course);
    /// Length of the frame that begins here, by the format's definition.
    fn frame_at(bytes: &[u8]) -> Option<usize>;
    /// A good frame around these bytes.
    fn frame(kind: u8, body: &[u8]) -> Vec<u8>;
}

/// Telegrams of the scanner.
struct Lms;
/// Frames of the receiver.
struct Span;
/// Telegrams of the other family of scanners.
struct Cola;

/// Frames out, counters and pending bytes after each byte, and once more after the end.
type Course = Vec<(usize, LineCounters, usize)>;

impl Format for Lms {
    const LONGEST: usize = lms2xx::LONGEST;
    const HEADER_BYTES: &'static [u8] = &[0x02, 0x80, 0x81, 0x00, 0x01, 0x02, 0x03, 0xb0, 0xa0, 0x06, 0x15];

    fn decode(bytes: &[u8], arrivals: &[DeviceTime]) -> (Vec<DeviceTime>, Course) {
        let mut decoder = lms2xx::Decoder::new(6);
        let (mut found, mut counters) = (Vec::new(), Vec::new());
        let take = |event: lms2xx::Event<'_>, found: &mut Vec<DeviceTime>| match event {
            lms2xx::Event::Scan { scan, .. } => found.push(scan.stx),
            lms2xx::Event::Reply { stx, .. } => found.push(stx),
            lms2xx::Event::Ack(_) | lms2xx::Event::Nak(_) => {}
        };
        for (&byte, &at) in bytes.iter().zip(arrivals) {
            decoder.push(byte, at, &mut |event| take(event, &mut found));
            counters.push((found.len(), decoder.counters(), decoder.pending()));
        }
        decoder.finish(&mut |event| take(event, &mut found));
        counters.push((found.len(), decoder.counters(), decoder.pending()));
        (found, counters)
    }

    fn frame_at(bytes: &[u8]) -> Option<usize> {
        let &[0x02, 0x80 | 0x81, low, high, 0x80..=0xff, ..] = bytes else { return None };
        let counted = usize::from(low) + 256 * usize::from(high);
        let crc = bytes.get(4 + counted..6 + counted).filter(|_| (2..=808).contains(&counted))?;
        (crc == lms2xx::crc(&bytes[..4 + counted]).to_le_bytes()).then_some(6 + counted)
    }

    fn frame(kind: u8, body: &[u8]) -> Vec<u8> {
        let body = &body[..body.len().min(806)];
        let mut frame = vec![0x02, 0x80 | kind & 1];
        frame.extend((body.len() as u16 + 2).to_le_bytes());
        frame.push(kind | 0x80);
        frame.extend(body);
        frame.push(0x10);
        frame.extend(lms2xx::crc(&frame).to_le_bytes());
        frame
    }
}

impl Format for Span {
    const LONGEST: usize = novatel::LONGEST;
    const HEADER_BYTES: &'static [u8] = &[0xaa, 0x44, 0x12, 0x13, 0x1c, 0x00, 0x01, 0x58];

    fn decode(bytes: &[u8], arrivals: &[DeviceTime]) -> (Vec<DeviceTime>, Course) {
        let mut decoder = novatel::Decoder::new();
        let (mut found, mut counters) = (Vec::new(), Vec::new());
        for (&byte, &at) in bytes.iter().zip(arrivals) {
            decoder.push(byte, at, &mut |event| found.push(event.header.arrival));
            counters.push((found.len(), decoder.counters(), decoder.pending()));
        }
        decoder.finish(&mut |event| found.push(event.header.arrival));
        counters.push((found.len(), decoder.counters(), decoder.pending()));
        (found, counters)
    }

    fn frame_at(bytes: &[u8]) -> Option<usize> {
        if bytes.len() < 16 || bytes[..2] != [0xaa, 0x44] {
            return None;
        }
        let covered = match bytes[2] {
            0x12 if (28..=32).contains(&bytes[3]) && bytes[6] & 0x60 == 0 => {
                let body = usize::from(bytes[8]) + 256 * usize::from(bytes[9]);
                (body <= 256).then_some(usize::from(bytes[3]) + body)?
            }
            0x13 if u32::from_le_bytes([bytes[8], bytes[9], bytes[10], bytes[11]]) < 604_800_000 => {
                12 + usize::from(bytes[3])
            }
            _ => return None,
        };
        let crc = bytes.get(covered..covered + 4)?;
        (crc == novatel::crc32(&bytes[..covered]).to_le_bytes()).then_some(covered + 4)
    }

    fn frame(kind: u8, body: &[u8]) -> Vec<u8> {
        let mut frame = if kind & 1 == 0 {
            let body = body.len().min(256) as u16;
            let mut header = vec![0xaa, 0x44, 0x12, 28 + (kind >> 1) % 5];
            header.resize(usize::from(header[3]), 0);
            header[4] = kind;
            header[8..10].copy_from_slice(&body.to_le_bytes());
            header
        } else {
            vec![0xaa, 0x44, 0x13, body.len().min(255) as u8, kind, 0, 0xa1, 8, 0x10, 0x27, 0, 0]
        };
        frame.extend(&body[..body.len().min(if kind & 1 == 0 { 256 } else { 255 })]);
        frame.extend(novatel::crc32(&frame).to_le_bytes());
        frame
    }
}

impl Format for Cola {
    const LONGEST: usize = cola::LONGEST;
    const HEADER_BYTES: &'static [u8] = &[0x02, 0x02, 0x02, 0x02, 0x00, 0x00, 0x01, b's', b'S', b'N'];

    fn decode(bytes: &[u8], arrivals: &[DeviceTime]) -> (Vec<DeviceTime>, Course) {
        let mut decoder = cola::Decoder::default();
        let (mut found, mut counters) = (Vec::new(), Vec::new());
        let arrival = |event: cola::Event<'_>| match event {
            cola::Event::Scan { arrival, .. } | cola::Event::Other(arrival) => arrival,
        };
        for (&byte, &at) in bytes.iter().zip(arrivals) {
            decoder.push(byte, at, &mut |event| found.push(arrival(event)));
            counters.push((found.len(), decoder.counters(), decoder.pending()));
        }
        decoder.finish(&mut |event| found.push(arrival(event)));
        counters.push((found.len(), decoder.counters(), decoder.pending()));
        (found, counters)
    }

    fn frame_at(bytes: &[u8]) -> Option<usize> {
        let &[2, 2, 2, 2, 0, 0, high, low, b's', b'A'..=b'Z', b'A'..=b'Z', ..] = bytes else { return None };
        let length = 256 * usize::from(high) + usize::from(low);
        let payload = bytes.get(8..8 + length).filter(|_| (3..=2_591).contains(&length))?;
        (bytes.get(8 + length) == Some(&cola::checksum(payload))).then_some(9 + length)
    }

    fn frame(kind: u8, body: &[u8]) -> Vec<u8> {
        let mut payload = if kind & 1 == 0 { b"sSN".to_vec() } else { b"sRA".to_vec() };
        payload.extend(&body[..body.len().min(2_588)]);
        let mut frame = vec![2, 2, 2, 2];
        frame.extend((payload.len() as u32).to_be_bytes());
        frame.extend(&payload);
        frame.push(cola::checksum(&payload));
        frame
    }
}

/// Every frame of a stream by the definition.
fn oracle<F: Format>(bytes: &[u8]) -> Vec<Place> {
    let (mut spans, mut at) = (Vec::new(), 0);
    while at < bytes.len() {
        if let Some(length) = F::frame_at(&bytes[at..]) {
            spans.push((at, length));
            at += length;
        } else {
            at += 1;
        }
    }
    spans
}

/// Decodes a stream and holds it against the oracle, byte for byte.
fn check<F: Format>(bytes: &[u8], gaps: &[u16]) -> Result<(), TestCaseError> {
    // Every arrival is different, so that it names its byte.
    let mut now = 0;
    let arrivals: Vec<DeviceTime> = bytes
        .iter()
        .enumerate()
        .map(|(i, _)| {
            now += 1 + u64::from(gaps.get(i % gaps.len().max(1)).copied().unwrap_or(19));
            DeviceTime(now)
        })
        .collect();
    let (found, counters) = F::decode(bytes, &arrivals);
    let expected = oracle::<F>(bytes);
    let stamps: Vec<DeviceTime> = expected.iter().map(|&(at, _)| arrivals[at]).collect();
    prop_assert_eq!(found, stamps);

    let mut last_skipped = 0;
    for (i, &(frames, counters, pending)) in counters.iter().enumerate() {
        let framed: usize = expected[..frames].iter().map(|&(_, length)| length).sum();
        prop_assert_eq!(counters.bytes, (i + 1).min(bytes.len()) as u64);
        prop_assert_eq!(counters.frames, frames as u32);
        prop_assert_eq!(counters.bytes, framed as u64 + counters.skipped + pending as u64);
        prop_assert!(counters.skipped >= last_skipped && pending < F::LONGEST);
        last_skipped = counters.skipped;
    }
    prop_assert_eq!(counters.last().map(|&(.., pending)| pending), Some(0));
    Ok(())
}

/// Streams made of whole, cut, damaged and nested frames, and of garbage that looks like headers.
fn stream<F: Format>() -> impl Strategy<Value = Vec<u8>> {
    let header_bytes = || vec(prop::sample::select(F::HEADER_BYTES), 0..60);
    let body = prop_oneof![vec(any::<u8>(), 0..900), header_bytes().prop_map(|bytes| bytes.repeat(5))];
    let good = (any::<u8>(), body).prop_map(|(kind, body)| F::frame(kind, &body));
    let piece = prop_oneof![
        3 => good.clone(),
        2 => (good.clone(), any::<prop::sample::Index>()).prop_map(|(mut frame, cut)| {
            frame.truncate(cut.index(frame.len()));
            frame
        }),
        2 => (good.clone(), any::<prop::sample::Index>(), 0..8u8).prop_map(|(mut frame, place, bit)| {
            let place = place.index(frame.len());
            frame[place] ^= 1 << bit;
            frame
        }),
        // The length field, where it hurts most.
        1 => (good.clone(), 2..4usize, any::<u8>()).prop_map(|(mut frame, place, value)| {
            frame[place] = value;
            frame
        }),
        1 => (any::<u8>(), good).prop_map(|(kind, inner)| F::frame(kind, &inner)),
        1 => vec(any::<u8>(), 0..200),
        1 => header_bytes(),
    ];
    vec(piece, 0..12).prop_map(|pieces| pieces.concat())
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 2_000, ..ProptestConfig::default() })]

    #[test]
    fn telegrams_are_the_oracles(bytes in stream::<Lms>(), gaps in vec(any::<u16>(), 1..20)) {
        check::<Lms>(&bytes, &gaps)?;
    }

    #[test]
    fn frames_are_the_oracles(bytes in stream::<Span>(), gaps in vec(any::<u16>(), 1..20)) {
        check::<Span>(&bytes, &gaps)?;
    }

    #[test]
    fn telegrams_of_the_other_family_are_the_oracles(bytes in stream::<Cola>(), gaps in vec(any::<u16>(), 1..20)) {
        check::<Cola>(&bytes, &gaps)?;
    }
}

/// A small generator for long deterministic streams (Steele and others, SplitMix64).
struct Random(u64);

impl Random {
    fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ z >> 30).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ z >> 27).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ z >> 31
    }
}

/// As many plausible headers as the format allows, each claiming the longest frame: the most candidates at once.
#[test]
fn the_densest_headers_neither_overflow_nor_hide_a_frame() {
    let dense: Vec<u8> = [0x02, 0x80, 0xff].into_iter().cycle().take(3 * 900).collect();
    let good = Lms::frame(0x20, &[0x00]);
    for cut in 0..6 {
        let mut bytes = dense[cut..].to_vec();
        bytes.extend(&good);
        bytes.extend(&dense);
        check::<Lms>(&bytes, &[]).unwrap();
        assert!(oracle::<Lms>(&bytes).contains(&(dense.len() - cut, good.len())));
    }
    let dense: Vec<u8> = [0xaa, 0x44, 0x13].into_iter().cycle().take(3 * 400).collect();
    let good = Span::frame(1, b"INS");
    let bytes = [&dense[..], &good, &dense].concat();
    check::<Span>(&bytes, &[]).unwrap();
    assert!(oracle::<Span>(&bytes).contains(&(dense.len(), good.len())));
}

#[test]
fn a_megabyte_of_noise_with_frames_in_it() {
    let mut random = Random(7);
    let (mut lms, mut span) = (Vec::new(), Vec::new());
    while lms.len() < 1 << 20 {
        let noise: Vec<u8> = (0..random.next() % 3_000).map(|_| random.next() as u8).collect();
        lms.extend(&noise);
        span.extend(&noise);
        let body: Vec<u8> = (0..random.next() % 256).map(|_| random.next() as u8).collect();
        lms.extend(Lms::frame(random.next() as u8, &body));
        span.extend(Span::frame(random.next() as u8, &body));
    }
    assert!(oracle::<Lms>(&lms).len() > 500 && oracle::<Span>(&span).len() > 500);
    check::<Lms>(&lms, &[]).unwrap();
    check::<Span>(&span, &[]).unwrap();
}

/// One random bit flipped every 500 bytes: only the frames hit are lost, and the counters say how many bytes and
/// how many frames. A frame whose header is hit is no frame any more and counts in the skipped bytes alone.
fn flips<F: Format>(clean: &[u8], header: usize, seed: u64) {
    let mut random = Random(seed);
    let mut damaged = clean.to_vec();
    let mut hits = Vec::new();
    for block in (0..clean.len()).step_by(500) {
        let place = block + (random.next() % 500) as usize;
        if let Some(byte) = damaged.get_mut(place) {
            *byte ^= 1 << (random.next() % 8);
            hits.push(place);
        }
    }
    let frames = oracle::<F>(clean);
    let hit_in =
        |(at, length): Place, reach: usize| hits.iter().any(|&hit| (at..at + length.min(reach)).contains(&hit));
    let (lost, kept): (Vec<Place>, Vec<Place>) = frames.iter().partition(|&&frame| hit_in(frame, usize::MAX));
    let beheaded = lost.iter().filter(|&&frame| hit_in(frame, header)).count();

    let arrivals: Vec<DeviceTime> = (0..damaged.len()).map(|i| DeviceTime(20 * i as u64)).collect();
    let (found, counters) = F::decode(&damaged, &arrivals);
    assert_eq!(found, kept.iter().map(|&(at, _)| arrivals[at]).collect::<Vec<_>>());
    let (_, counters, _) = counters.last().copied().unwrap();
    let framed: usize = frames.iter().map(|&(_, length)| length).sum();
    let lost_bytes: usize = lost.iter().map(|&(_, length)| length).sum();
    assert_eq!(counters.frames as usize, kept.len());
    assert_eq!(counters.skipped as usize, lost_bytes + clean.len() - framed);
    let bad = counters.bad_frames as usize;
    assert!(bad <= lost.len() && bad + beheaded >= lost.len(), "{bad} bad, {} lost, {beheaded} headless", lost.len());
    assert!(!lost.is_empty() && !kept.is_empty());
}

#[test]
fn a_flipped_bit_costs_the_frame_it_hits_and_no_other() {
    for seed in 0..20 {
        let mut random = Random(1_000 + seed);
        let (mut lms, mut span) = (Vec::new(), Vec::new());
        for _ in 0..200 {
            let mut scan = vec![0x69, 0x41];
            (0..361).for_each(|_| scan.extend((1_000 + random.next() as u16 % 9_000).to_le_bytes()));
            lms.extend(Lms::frame(0xb0, &scan));
            lms.extend(Lms::frame(0xa0, &[0]));
            let body: Vec<u8> = (0..88).map(|_| random.next() as u8).collect();
            span.extend(Span::frame(1, &body));
        }
        flips::<Lms>(&lms, 5, seed);
        flips::<Span>(&span, 12, seed);
    }
}

#[test]
fn a_flipped_bit_in_a_recording_costs_the_frame_it_hits_and_no_other() {
    let Some(folder) = std::env::var_os("CROSSFALL_RECORDINGS").map(std::path::PathBuf::from) else {
        eprintln!("SKIPPED: CROSSFALL_RECORDINGS does not name the folder of recordings");
        return;
    };
    let read = |name: &str| std::fs::read(folder.join(name)).unwrap_or_else(|error| panic!("{name}: {error}"));
    let (lms, span) = (read("lms/lms200_2017_Aug_05_18_52_56.bin"), read("novatel/propak6_inspvax_20hz.bin"));
    for seed in 0..10 {
        flips::<Lms>(&lms, 5, seed);
        flips::<Span>(&span, 12, seed);
    }
}

/// Whole frames that stand behind a false beginning come out when the stream ends.
#[test]
fn the_end_of_a_stream_releases_what_a_false_header_held_back() {
    let good = Lms::frame(0x31, &[1, 2, 3]);
    // A header that claims 800 bytes, and not so many follow.
    let bytes = [&[0x02, 0x80, 0x20, 0x03, 0xb0][..], &good, &[0x02, 0x80]].concat();
    let arrivals: Vec<DeviceTime> = (0..bytes.len()).map(|i| DeviceTime(i as u64)).collect();
    let (found, counters) = Lms::decode(&bytes, &arrivals);
    assert_eq!(found, [DeviceTime(5)]);
    let (before, counters) = (counters[bytes.len() - 1], counters[bytes.len()]);
    assert_eq!((before.0, before.2), (0, bytes.len()));
    assert_eq!((counters.1.frames, counters.1.skipped, counters.2), (1, 7, 0));
}
