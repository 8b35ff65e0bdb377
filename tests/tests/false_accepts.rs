//! Frames that decode but were never sent: how many corrupted bytes let through, beside what arithmetic on the checks expects.
//!
//! A check of n bits passes a candidate of random content once in 2^n: the inertial unit's and the link's have 32, the scanner's 16.
//!
//! The scanner's is weaker than that. Its register takes two bytes at a time but moves on by one *bit* a byte, so a flip of bit b in byte i counts as
//! x^(n-i+b) (1 + x^7): flips in neighbouring bytes whose bits are as far apart as the bytes (i, b and i + d, b + d, d up to 7) cancel, and the telegram passes. No
//! decoder can see these. Two random flips in a telegram of 734 bytes pass once in 840 times, not once in 65,536.

use std::collections::HashSet;
use std::path::Path;

use crossfall::capture::{self, Channel};
use crossfall::faults::{Injector, Piece, Spec};
use crossfall::log;
use crossfall::simulate::scene::Scene;
use crossfall_core::protocol::DeviceTime;
use crossfall_core::protocol::frame::{Event, HostDecoder};
use crossfall_core::sensors::{lms2xx, novatel};
use crossfall_tests::drives;

/// Corrupted bytes over all three decoders under `cargo xtask test --long`, and otherwise.
const BYTES: [u64; 2] = [105_000_000, 3_000_000];

/// Damage so dense that hardly any frame stays whole.
const EVERYTHING: &str = "flip=0.004,drop=0.002,burst=0.0005:60,truncate=0.1,duplicate=0.05,reorder=0.1";

/// The same without single flips.
const NO_FLIPS: &str = "drop=0.002,burst=0.001:60,truncate=0.1,duplicate=0.05,reorder=0.1";

/// Flips of bytes and nothing else.
const FLIP: f64 = 0.002;

/// What each decoder was given and gave.
#[derive(Debug, Default)]
struct Count {
    bytes: u64,
    good: u64,
    /// Candidates whose check did not match.
    rejected: u64,
    never_sent: u64,
}

fn corrupted(pieces: &[Vec<u8>], spec: &str, bytes: u64, line: u64, mut take: impl FnMut(&[u8])) -> u64 {
    let spec: Spec = spec.parse().expect("a specification");
    let mut injector = Injector::new(spec.rates(Channel::Lidar).expect("rates"), 20_260_101, line);
    let mut given = 0;
    for piece in pieces.iter().cycle() {
        injector.pass(Piece { at_ns: 0, bytes: piece.clone() }, &mut |piece| {
            given += piece.bytes.len() as u64;
            take(&piece.bytes);
        });
        if given >= bytes {
            return given;
        }
    }
    given
}

fn scanner(pieces: &[Vec<u8>], spec: &str, bytes: u64) -> Count {
    let mut decoder = lms2xx::Decoder::new(6);
    let mut sent = HashSet::new();
    for &byte in pieces.iter().flatten() {
        decoder.push(byte, DeviceTime(0), &mut |event| {
            sent.insert(said_by_scanner(&event));
        });
    }
    let before = decoder.counters();
    let (mut good, mut never_sent) = (0, 0);
    let bytes = corrupted(pieces, spec, bytes, 0, |bytes| {
        for &byte in bytes {
            decoder.push(byte, DeviceTime(0), &mut |event| {
                // A lone ACK or NAK carries no check and is believed by nobody who did not ask.
                if !matches!(event, lms2xx::Event::Ack(_) | lms2xx::Event::Nak(_)) {
                    good += 1;
                    never_sent += u64::from(!sent.contains(&said_by_scanner(&event)));
                }
            });
        }
    });
    let after = decoder.counters();
    Count { bytes, good, never_sent, rejected: u64::from(after.bad_frames - before.bad_frames) }
}

/// What a telegram says, without its number and time.
fn said_by_scanner(event: &lms2xx::Event<'_>) -> Vec<u8> {
    match event {
        lms2xx::Event::Scan { scan, .. } => {
            let ranges = scan.ranges().iter().flat_map(|value| value.to_le_bytes());
            ranges
                .chain(scan.layout.to_le_bytes())
                .chain([scan.status])
                .chain(scan.counters.unwrap_or_default())
                .collect()
        }
        other => format!("{other:?}").into_bytes(),
    }
}

fn inertial_unit(pieces: &[Vec<u8>], bytes: u64) -> Count {
    let said = |event: &novatel::Event<'_>| match &event.log {
        novatel::Log::Solution(solution, _) => {
            let solution = novatel::InsSolution { arrival: DeviceTime(0), ..*solution };
            format!("{solution:?}")
        }
        _ => "another log".to_owned(),
    };
    let mut decoder = novatel::Decoder::new();
    let mut sent = HashSet::new();
    for &byte in pieces.iter().flatten() {
        decoder.push(byte, DeviceTime(0), &mut |event| {
            sent.insert(said(&event));
        });
    }
    let before = decoder.counters();
    let (mut good, mut never_sent) = (0, 0);
    let bytes = corrupted(pieces, EVERYTHING, bytes, 1, |bytes| {
        for &byte in bytes {
            decoder.push(byte, DeviceTime(0), &mut |event| {
                good += 1;
                never_sent += u64::from(!sent.contains(&said(&event)));
            });
        }
    });
    let after = decoder.counters();
    Count { bytes, good, never_sent, rejected: u64::from(after.bad_frames - before.bad_frames) }
}

fn link(frames: &[Vec<u8>], bytes: u64) -> Count {
    let sent: HashSet<&[u8]> = frames.iter().map(Vec::as_slice).collect();
    let mut decoder = HostDecoder::new();
    let (mut good, mut never_sent) = (0, 0);
    let bytes = corrupted(frames, EVERYTHING, bytes, 2, |bytes| {
        let mut rest = bytes;
        while let Some(event) = decoder.next(&mut rest) {
            if let Event::Frame(frame) = event {
                good += 1;
                never_sent += u64::from(!sent.contains(frame.raw));
            }
        }
    });
    let counters = decoder.counters();
    Count { bytes, good, never_sent, rejected: counters.bad_crc + counters.not_understood }
}

/// Telegrams or frames, one after the other.
type Pieces = Vec<Vec<u8>>;

fn drive(folder: &Path) -> (Pieces, Pieces, Pieces) {
    let (capture_path, log_path) = (folder.join("drive.mcap"), folder.join("drive.log.mcap"));
    let mut scene = Scene::default();
    scene.drive.seconds = 10.0;
    drives::capture(&scene, &capture_path);
    drives::log(&capture_path, &log_path);
    let line = |wanted| {
        let reader = capture::Reader::open(&capture_path).expect("the capture");
        let chunks = reader.map(|chunk| chunk.expect("a chunk")).filter(move |chunk| chunk.channel == wanted);
        chunks.map(|chunk| chunk.data).collect()
    };
    let frames = log::Reader::open(&log_path).expect("the log").map(|frame| frame.expect("a frame").bytes).collect();
    (line(Channel::Lidar), line(Channel::Ins), frames)
}

#[test]
fn corrupted_bytes_pass_for_frames_no_more_often_than_the_checks_allow() {
    let folder = tempfile::tempdir().expect("a scratch folder");
    let (lidar, ins, frames) = drive(folder.path());
    let bytes = BYTES[usize::from(std::env::var_os("CROSSFALL_LONG").is_none())] / 4;
    let counts = [
        ("scanner, all but flips", 16, scanner(&lidar, NO_FLIPS, bytes)),
        ("inertial unit, everything", 32, inertial_unit(&ins, bytes)),
        ("link, everything", 32, link(&frames, bytes)),
    ];
    for (name, bits, count) in counts {
        let expected = count.rejected as f64 / libm::exp2(f64::from(bits));
        tell(name, &count, expected);
        assert!(count.rejected > count.bytes / 10_000, "{name} was corrupted");
        // Poisson: five deviations above the expectation, and one more where that is almost none.
        let bound = expected + 5.0 * expected.sqrt() + if bits == 16 { 1.0 } else { 0.0 };
        assert!((count.never_sent as f64) <= bound, "{name}: {count:?}, expected at most {expected:.6}");
    }
    let flips = scanner(&lidar, &format!("flip={FLIP}"), bytes);
    let length = lidar[0].len() as f64;
    // Pairs of places whose flips cancel, of all 64 pairs of bits in two bytes, for each distance of the bytes.
    let pairs: f64 = (1..8).map(f64::from).map(|apart| (length - apart) * (8.0 - apart) / 64.0).sum();
    let two = pairs * FLIP * FLIP * libm::pow(1.0 - FLIP, length - 2.0);
    let expected = flips.bytes as f64 / length * two + flips.rejected as f64 / 65_536.0;
    tell("scanner, flips alone", &flips, expected);
    let (found, spread) = (flips.never_sent as f64, 5.0 * expected.sqrt() + 1.0);
    assert!((found - expected).abs() <= spread, "{flips:?}, expected {expected:.3}");
}

fn tell(name: &str, count: &Count, expected: f64) {
    let Count { bytes, good, rejected, never_sent } = count;
    println!(
        "{name}: {bytes} bytes, {good} good frames, {rejected} candidates rejected; never sent: {never_sent}, expected {expected:.6}"
    );
}
