//! The scanner's telegrams, one kind at a time: what each byte means (TL, replies).

use crossfall_core::protocol::DeviceTime;
use crossfall_core::scan::RawScan;
use crossfall_core::sensors::lms2xx::range::{Measure, Reader, Special};
use crossfall_core::sensors::lms2xx::{Configuration, Decoder, Event, ModeChange, Reply, Severity, crc};

/// A reply as the scanner sends it.
fn telegram(address: u8, counted: &[u8], status: u8) -> Vec<u8> {
    let mut telegram = vec![0x02, address];
    telegram.extend((counted.len() as u16 + 1).to_le_bytes());
    telegram.extend(counted);
    telegram.push(status);
    telegram.extend(crc(&telegram).to_le_bytes());
    telegram
}

/// A scan's telegram of `count` values 1000, 1001, ... with these upper bits of the count word.
fn scan(count: u16, upper: u16, indices: &[u8]) -> Vec<u8> {
    let mut counted = vec![0xb0];
    counted.extend((count | upper).to_le_bytes());
    (0..count).for_each(|i| counted.extend((1_000 + i).to_le_bytes()));
    counted.extend(indices);
    telegram(0x80, &counted, 0x10)
}

const MILLIMETRES: u16 = 1 << 14;
const PARTIAL: u16 = 1 << 13;

/// What happens, with the lifetimes cut: the scans by value, the rest as text.
#[derive(Debug, PartialEq)]
enum Seen {
    Scan(Box<RawScan>, u8),
    Other(String),
}

fn feed(decoder: &mut Decoder, bytes: &[u8]) -> Vec<Seen> {
    let start = decoder.counters().bytes;
    let mut seen = Vec::new();
    for (i, &byte) in bytes.iter().enumerate() {
        decoder.push(byte, DeviceTime(start + i as u64), &mut |event| {
            seen.push(match event {
                Event::Scan { scan, missing } => Seen::Scan(Box::new(scan.clone()), missing),
                other => Seen::Other(format!("{other:?}")),
            });
        });
    }
    seen
}

fn scans(seen: &[Seen]) -> Vec<(&RawScan, u8)> {
    seen.iter()
        .filter_map(|s| if let Seen::Scan(scan, missing) = s { Some((&**scan, *missing)) } else { None })
        .collect()
}

/// Feeds one reply and looks at it.
fn reply(bytes: &[u8], look: impl Fn(&Reply<'_>, u8)) {
    let mut decoder = Decoder::new(6);
    let mut looked = 0;
    for (i, &byte) in bytes.iter().enumerate() {
        decoder.push(byte, DeviceTime(i as u64), &mut |event| {
            let Event::Reply { stx, status, reply } = event else { panic!("{event:?}") };
            assert_eq!((stx, i), (DeviceTime(0), bytes.len() - 1));
            look(&reply, status.0);
            looked += 1;
        });
    }
    assert_eq!(looked, 1);
}

#[test]
fn golden_replies() {
    // From the listing: mode changed; command unknown.
    reply(&[0x02, 0x80, 0x03, 0x00, 0xa0, 0x00, 0x10, 0x16, 0x0a], |reply, status| {
        assert_eq!((*reply, status), (Reply::Mode(ModeChange::Done), 0x10));
    });
    reply(&[0x02, 0x80, 0x02, 0x00, 0x92, 0x10, 0x7f, 0x33], |reply, _| assert_eq!(*reply, Reply::Rejected));
}

#[test]
fn replies_by_their_command_from_either_address() {
    let mut stored = [0; 34];
    (stored[2], stored[4], stored[5], stored[6]) = (0x70, 2, 6, 1);
    let configuration = Configuration(stored);
    assert!(configuration.indices());
    let expected: [(&[u8], Reply<'_>); 10] = [
        (b"\x90LMS291;S05", Reply::PowerOn(b"LMS291;S05")),
        (b"\xbaLMS200", Reply::Type(b"LMS200")),
        (&[0xa0, 1], Reply::Mode(ModeChange::WrongPassword)),
        (&[0xa0, 2], Reply::Mode(ModeChange::Fault)),
        (&[0xa0, 9], Reply::Mode(ModeChange::Undefined(9))),
        (&[0xbb, 1, 180, 0, 50, 0], Reply::Variant { changed: true, span_deg: 180, step_cdeg: 50 }),
        (&[0xbb, 0, 100, 0, 25, 0], Reply::Variant { changed: false, span_deg: 100, step_cdeg: 25 }),
        (&[0xb2, 0x84, 0x16], Reply::Other { command: 0xb2, data: &[0x84, 0x16] }),
        (&[0xf4, 1, 2], Reply::Other { command: 0xf4, data: &[1, 2] }),
        (&[0xb1, 1, 2], Reply::Other { command: 0xb1, data: &[1, 2] }),
    ];
    for address in [0x80, 0x81] {
        for (counted, wanted) in &expected {
            reply(&telegram(address, counted, 0x11), |reply, status| assert_eq!((reply, status), (wanted, 0x11)));
        }
        let written = [&[0xf7, 1][..], &stored].concat();
        reply(&telegram(address, &written, 0x10), |reply, _| {
            assert_eq!(*reply, Reply::Configured { accepted: true, configuration });
        });
    }
}

#[test]
fn a_status_byte_by_its_bits() {
    for (byte, severity) in [
        (0x10, Severity::Ok),
        (0x11, Severity::Information),
        (0x12, Severity::Warning),
        (0x13, Severity::Error),
        (0x14, Severity::Fatal),
        (0x17, Severity::Undefined),
    ] {
        let status = crossfall_core::sensors::lms2xx::Status(byte);
        assert_eq!(status.severity(), severity);
        assert!(!status.restart() && !status.implausible() && !status.polluted());
    }
    let status = crossfall_core::sensors::lms2xx::Status;
    assert!(status(0x30).restart() && status(0x50).implausible() && status(0x90).polluted());
}

#[test]
fn a_lone_acknowledgement_comes_at_once_and_one_inside_a_telegram_does_not() {
    let mut decoder = Decoder::new(6);
    let ack = |at: u64| Seen::Other(format!("{:?}", Event::Ack(DeviceTime(at))));
    let nak = |at: u64| Seen::Other(format!("{:?}", Event::Nak(DeviceTime(at))));
    assert_eq!(feed(&mut decoder, &[0x06]), [ack(0)]);
    assert_eq!(feed(&mut decoder, &[0x15]), [nak(1)]);
    // Behind a beginning that the same byte breaks, it stands alone.
    assert_eq!(feed(&mut decoder, &[0x02, 0x06]), [ack(3)]);
    // 06h and 15h as length, data and CRC are not acknowledgements.
    let inside = telegram(0x80, &[0xba, 0x06, 0x15, 0x06, 0x15], 0x10);
    assert_eq!(inside[2], 6);
    assert_eq!(feed(&mut decoder, &inside).len(), 1);
    // They carry no check: their bytes are skipped ones.
    assert_eq!((decoder.counters().skipped, decoder.pending()), (4, 0));
}

#[test]
fn every_variant_by_its_count() {
    for (count, span, step, turns) in
        [(181, 180, 100, 1), (361, 180, 50, 2), (101, 100, 100, 1), (201, 100, 50, 2), (401, 100, 25, 4)]
    {
        for (unit, unit_um) in [(0, 10_000), (MILLIMETRES, 1_000)] {
            let mut decoder = Decoder::new(4);
            let seen = feed(&mut decoder, &scan(count, unit, &[]));
            let (scan, missing) = scans(&seen)[0];
            assert_eq!((scan.mode.span_deg, scan.mode.step_cdeg, scan.mode.measuring), (span, step, 4));
            assert_eq!((scan.beams(), scan.turns(), scan.unit_um()), (usize::from(count), turns, unit_um));
            assert_eq!((scan.stx, scan.status, scan.counters, missing), (DeviceTime(0), 0x10, None, 0));
            assert!(scan.ranges().iter().copied().eq(1_000..1_000 + count));
            // From the right through straight down to the left.
            let first = if span == 100 { 4_000 } else { 0 };
            let last = scan.beam_cdeg(usize::from(count) - 1);
            assert_eq!((scan.beam_cdeg(0), last), (first, first + 100 * u32::from(span)));
        }
    }
}

#[test]
fn partial_scans_keep_their_place_in_the_whole() {
    // 180 degrees in two turns: .00 has 181 values, .50 has 180; 100 degrees in four.
    for (count, fraction, span, step) in [
        (181, 0, 180, 50),
        (180, 2, 180, 50),
        (101, 0, 100, 25),
        (100, 1, 100, 25),
        (100, 2, 100, 25),
        (100, 3, 100, 25),
    ] {
        let mut decoder = Decoder::new(6);
        let seen = feed(&mut decoder, &scan(count, MILLIMETRES | PARTIAL | fraction << 11, &[]));
        let (scan, _) = scans(&seen)[0];
        assert_eq!((scan.mode.span_deg, scan.mode.step_cdeg), (span, step));
        assert_eq!((scan.partial(), scan.turns(), scan.step_cdeg()), (Some(fraction as u8), 1, 100));
        let first = if span == 100 { 4_000 } else { 0 };
        assert_eq!(scan.beam_cdeg(0), first + 25 * u32::from(fraction));
    }
}

#[test]
fn the_scanners_own_word_on_its_mode_goes_before_the_configuration() {
    let mut report = vec![0; 153];
    report[0] = 0xb1;
    (report[1 + 101], report[1 + 106], report[1 + 108]) = (3, 100, 50);
    let mut stored = vec![0xf4; 35];
    stored[1 + 5] = 5;

    let mut decoder = Decoder::new(4);
    let mode = |seen: &[Seen]| scans(seen)[0].0.mode;
    let full = scan(361, MILLIMETRES, &[]);
    assert_eq!(mode(&feed(&mut decoder, &full)).measuring, 4);
    decoder.assume_measuring_mode(6);
    // A quarter less: of 100 degrees, second fraction: what step the whole has only the scanner can tell.
    let partial = scan(100, MILLIMETRES | PARTIAL | 2 << 11, &[]);
    assert_eq!(mode(&feed(&mut decoder, &full)).measuring, 6);
    assert_eq!(mode(&feed(&mut decoder, &partial)).step_cdeg, 25);
    feed(&mut decoder, &telegram(0x80, &report, 0x10));
    assert_eq!(mode(&feed(&mut decoder, &full)).measuring, 3);
    assert_eq!(mode(&feed(&mut decoder, &partial)).step_cdeg, 50);
    feed(&mut decoder, &telegram(0x80, &stored, 0x10));
    assert_eq!(mode(&feed(&mut decoder, &full)).measuring, 5);
    // The scanner has spoken: what is assumed no longer counts.
    decoder.assume_measuring_mode(2);
    assert_eq!((mode(&feed(&mut decoder, &full)).measuring, decoder.measuring_mode()), (5, 5));
}

#[test]
fn the_telegram_index_proves_what_is_missing() {
    let mut decoder = Decoder::new(6);
    let numbered = |telegram: u8| scan(361, MILLIMETRES, &[telegram.wrapping_mul(2), telegram]);
    for (telegram, missing) in [(7, 0), (8, 0), (11, 2), (250, 238), (2, 7), (3, 0), (3, 255)] {
        let seen = feed(&mut decoder, &numbered(telegram));
        let (scan, proven) = scans(&seen)[0];
        assert_eq!((scan.counters, proven), (Some([telegram.wrapping_mul(2), telegram]), missing), "{telegram}");
    }
    assert_eq!((decoder.scans(), decoder.scans_missing()), (7, 2 + 238 + 7 + 255));
    // Another telegram in between, a scan without indices, or a new beginning ends the chain.
    feed(&mut decoder, &telegram(0x80, &[0xa0, 0], 0x10));
    assert_eq!(scans(&feed(&mut decoder, &numbered(90)))[0].1, 0);
    feed(&mut decoder, &scan(361, MILLIMETRES, &[]));
    assert_eq!(scans(&feed(&mut decoder, &numbered(5)))[0].1, 0);
    decoder.finish(&mut |_| {});
    let seen = feed(&mut decoder, &numbered(44));
    assert_eq!((scans(&seen)[0].0.index, scans(&seen)[0].1), (10, 0));
}

#[test]
fn a_damaged_scan_is_missing_by_its_index_and_its_bytes_are_skipped() {
    let mut decoder = Decoder::new(6);
    let mut stream = Vec::new();
    for telegram in 0..10u8 {
        let mut bytes = scan(361, MILLIMETRES, &[telegram, telegram]);
        if telegram % 4 == 2 {
            bytes[100] ^= 0x10;
        }
        stream.extend(bytes);
    }
    let seen = feed(&mut decoder, &stream);
    let counters = decoder.counters();
    assert_eq!(scans(&seen).iter().map(|&(_, missing)| u32::from(missing)).sum::<u32>(), 2);
    assert_eq!((decoder.scans(), decoder.scans_missing()), (8, 2));
    assert_eq!((counters.frames, counters.bad_frames, counters.skipped), (8, 2, 2 * 734));
    // The stamps of those behind are their own.
    for (i, (scan, _)) in scans(&seen).into_iter().enumerate() {
        let telegram = [0, 1, 3, 4, 5, 7, 8, 9][i];
        assert_eq!((scan.index, scan.stx), (i as u32, DeviceTime(734 * telegram)));
    }
}

#[test]
fn a_layout_that_is_not_known_is_told_and_not_guessed() {
    let short = [&[0xb0][..], &(361 | MILLIMETRES).to_le_bytes(), &[0; 700]].concat();
    for bytes in [
        scan(360, MILLIMETRES, &[]),
        scan(0, MILLIMETRES, &[]),
        scan(361, 2 << 14, &[]),
        scan(361, PARTIAL, &[]),
        scan(361, MILLIMETRES, &[1]),
        telegram(0x80, &short, 0x10),
        telegram(0x80, &[0xb0], 0x10),
    ] {
        let mut decoder = Decoder::new(6);
        let seen = feed(&mut decoder, &bytes);
        assert!(matches!(&seen[..], [Seen::Other(text)] if text.contains("command: 176")), "{seen:?}");
        assert_eq!((decoder.scans(), decoder.scans_unreadable(), decoder.counters().frames), (0, 1, 1));
    }
}

#[test]
fn a_shorter_scan_leaves_nothing_of_a_longer_one() {
    let mut decoder = Decoder::new(6);
    feed(&mut decoder, &scan(401, MILLIMETRES, &[]));
    let seen = feed(&mut decoder, &scan(181, MILLIMETRES, &[]));
    let (short, _) = scans(&seen)[0];
    assert!(short.values[181..].iter().all(|&value| value == 0));
}

#[test]
fn ranges_and_specials_of_a_scan() {
    let mut counted = vec![0xb0];
    counted.extend((181u16 | MILLIMETRES).to_le_bytes());
    for i in 0..181u16 {
        let value: u16 = match i {
            0 => 32_767,
            1 => 32_766,
            2 => 0x8000 | 5_000,
            _ => 5_000,
        };
        counted.extend(value.to_le_bytes());
    }
    let mut decoder = Decoder::new(6);
    let seen = feed(&mut decoder, &telegram(0x81, &counted, 0x10));
    let (scan, _) = scans(&seen)[0];
    let reader = Reader::of(scan);
    let measures: Vec<Measure> = scan.ranges().iter().take(4).map(|&value| reader.measure(value)).collect();
    let range = Measure::Range(5_000_000);
    assert_eq!(measures, [Measure::Special(Special::NoStop), Measure::Special(Special::Dazzle), range, range]);
    assert!(reader.fields(scan.values[2]).a && !reader.fields(scan.values[3]).a);
    assert_eq!((reader.range_um(scan.values[0]), reader.range_um(scan.values[2])), (None, Some(5_000_000)));
}
