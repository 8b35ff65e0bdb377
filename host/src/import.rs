//! Raw serial dumps to captures.
//!
//! A dump is the bytes alone; their times are made up from what the sensors say of themselves. A scan comes a period of its own kind after the one
//! before (26.64 ms at half a degree), further if the telegram index tells of lost ones; an LMS 1xx or 5xx says when it sent each. A frame of the inertial unit comes as
//! much later as its header's GPS time says. Both dumps are taken to begin together. What lies between frames goes with the frame before
//! it: every byte is kept, in its order. Both dumps are in memory at once.

use crossfall_core::clock::GpsTime;
use crossfall_core::protocol::DeviceTime;
use crossfall_core::protocol::message::LineCounters;
use crossfall_core::scan::TURN_US;
use crossfall_core::sensors::{Scanner, cola, lms2xx, novatel};

use crate::capture::{Channel, Writer};
use crate::output;
use crate::scanner::{ETHERNET_BAUD, Family};

/// Device time of the first scan and of the first GPS time, in microseconds.
const BEGIN_US: u64 = 1_000_000;

/// How much later than its GPS time a frame is taken to arrive: what the configuration assumes when there are no pulses.
const LATENCY_US: u64 = 20_000;

/// Longest step of GPS time from one frame to the next that is believed; a jump beyond it is taken for a restart of the receiver.
const LONGEST_STEP_US: i64 = 60_000_000;

/// Baud rates that bytes without any time are spaced by.
const LIDAR_BAUD: u64 = 500_000;
const INS_BAUD: u64 = 115_200;

/// What was found in a scanner's dump.
#[derive(Clone, Debug, Default)]
pub struct Lidar {
    /// The scanners whose language it is.
    pub family: Family,
    /// Counters of the decoder.
    pub line: LineCounters,
    /// Scans (B0).
    pub scans: u32,
    /// Other telegrams.
    pub replies: u32,
    /// Scans that the telegram index proves missing.
    pub missing: u32,
    /// From the first scan to the last, in seconds, as assumed.
    pub seconds: f64,
}

/// What was found in an inertial unit's dump.
#[derive(Clone, Debug, Default)]
pub struct Ins {
    /// Counters of the decoder.
    pub line: LineCounters,
    /// Poses of any kind.
    pub poses: u32,
    /// Frames whose GPS time was not known or not believed: placed right behind the one before.
    pub untimed: u32,
    /// From the first GPS time to the last, in seconds.
    pub seconds: f64,
}

/// A stretch of a dump and when it arrives.
struct Stretch {
    at_us: u64,
    from: usize,
    to: usize,
}

/// Writes dumps as a capture.
///
/// # Errors
/// When the capture cannot be written.
pub fn import(
    lidar: Option<&[u8]>,
    ins: Option<&[u8]>,
    measuring_mode: u8,
    capture: &mut Writer,
) -> Result<(Option<Lidar>, Option<Ins>), output::Error> {
    let place = |bytes: &[u8]| match Family::of(bytes) {
        Family::Lms2xx => place_lidar(bytes, measuring_mode),
        Family::Cola => place_cola(bytes),
    };
    let (lidar_stretches, found_lidar) = lidar.map(place).unzip();
    let (ins_stretches, found_ins) = ins.map(place_ins).unzip();
    let mut lidar_stretches = lidar_stretches.unwrap_or_default().into_iter().peekable();
    let mut ins_stretches = ins_stretches.unwrap_or_default().into_iter().peekable();
    loop {
        let scanner_first = match (lidar_stretches.peek(), ins_stretches.peek()) {
            (Some(a), Some(b)) => a.at_us <= b.at_us,
            (Some(_), None) => true,
            (None, Some(_)) => false,
            (None, None) => break,
        };
        let (channel, stretch, bytes) = if scanner_first {
            (Channel::Lidar, lidar_stretches.next(), lidar)
        } else {
            (Channel::Ins, ins_stretches.next(), ins)
        };
        if let (Some(Stretch { at_us, from, to }), Some(bytes)) = (stretch, bytes) {
            capture.write(channel, at_us * 1_000, &bytes[from..to])?;
        }
    }
    Ok((found_lidar, found_ins))
}

/// Cuts a dump at the given places and keeps what lies before the first.
fn cut(length: usize, starts: &[(usize, u64)], baud: u64) -> Vec<Stretch> {
    let first = starts.first().map_or(length, |&(at, _)| at);
    let mut stretches = Vec::with_capacity(starts.len() + 1);
    if first > 0 {
        let lead_us = first as u64 * 10_000_000 / baud + 1;
        let at_us = starts.first().map_or(BEGIN_US, |&(_, at_us)| at_us).saturating_sub(lead_us);
        stretches.push(Stretch { at_us, from: 0, to: first });
    }
    for (i, &(from, at_us)) in starts.iter().enumerate() {
        let to = starts.get(i + 1).map_or(length, |&(next, _)| next);
        stretches.push(Stretch { at_us, from, to });
    }
    stretches
}

/// Beginnings of scans: where in the dump, and when.
type Starts = Vec<(usize, u64)>;

/// Takes a scanner's dump through its decoder; `place` adds the scan that an event is to those before it, and counts other events. The decoder's
/// clock is the place in the dump.
fn place_scans<S: Scanner>(
    bytes: &[u8],
    mut decoder: S,
    (family, baud): (Family, u64),
    mut place: impl FnMut(S::Event<'_>, &mut Starts, &mut Lidar),
) -> (Vec<Stretch>, Lidar) {
    let mut found = Lidar { family, ..Lidar::default() };
    let mut starts = Starts::new();
    let mut out = |event: S::Event<'_>| place(event, &mut starts, &mut found);
    for (at, &byte) in bytes.iter().enumerate() {
        decoder.push(byte, DeviceTime(at as u64), &mut out);
    }
    decoder.finish(&mut out);
    found.line = decoder.counters();
    (found.scans, found.missing) = (decoder.scans(), decoder.scans_missing());
    if let (Some(first), Some(last)) = (starts.first(), starts.last()) {
        found.seconds = (last.1 - first.1) as f64 * 1e-6;
    }
    (cut(bytes.len(), &starts, baud), found)
}

fn place_lidar(bytes: &[u8], measuring_mode: u8) -> (Vec<Stretch>, Lidar) {
    let decoder = lms2xx::Decoder::new(measuring_mode);
    place_scans(bytes, decoder, (Family::Lms2xx, LIDAR_BAUD), |event, starts, found| match event {
        lms2xx::Event::Scan { scan, missing } => {
            let period_us = scan.turns() as u64 * TURN_US as u64;
            let at_us = match starts.last() {
                Some(&(_, last_us)) => last_us + period_us * (1 + u64::from(missing)),
                // The first scan arrives when it has been measured.
                None => BEGIN_US + period_us,
            };
            starts.push((scan.stx.0 as usize, at_us));
        }
        lms2xx::Event::Reply { .. } => found.replies += 1,
        lms2xx::Event::Ack(_) | lms2xx::Event::Nak(_) => {}
    })
}

/// Telegrams that say when they were sent.
fn place_cola(bytes: &[u8]) -> (Vec<Stretch>, Lidar) {
    let mut sent: Option<u32> = None;
    let line = (Family::Cola, u64::from(ETHERNET_BAUD));
    place_scans(bytes, cola::Decoder::default(), line, |event, starts, found| match event {
        cola::Event::Scan { arrival, sent_us, .. } => {
            let since_us = sent.replace(sent_us).map_or(0, |before| u64::from(sent_us.wrapping_sub(before)));
            let last_us = starts.last().map_or(BEGIN_US, |&(_, at_us)| at_us);
            // A clock that jumps is a scanner that was started anew: it goes on where the line is.
            let step_us = if since_us <= LONGEST_STEP_US as u64 { since_us } else { 0 };
            starts.push((arrival.0 as usize, last_us + step_us));
        }
        cola::Event::Other(_) => found.replies += 1,
    })
}

fn place_ins(bytes: &[u8]) -> (Vec<Stretch>, Ins) {
    let mut decoder = novatel::Decoder::new();
    let mut found = Ins::default();
    let mut frames: Vec<(usize, Option<GpsTime>)> = Vec::new();
    let mut note = |event: novatel::Event<'_>| {
        // Time status 20 = unknown; a short header is only used by logs of a known time.
        let known = event.header.time_status.is_none_or(|status| status > 20);
        frames.push((event.header.arrival.0 as usize, event.header.gps_time().filter(|_| known)));
    };
    for (at, &byte) in bytes.iter().enumerate() {
        decoder.push(byte, DeviceTime(at as u64), &mut note);
    }
    decoder.finish(&mut note);
    found.line = decoder.counters();
    found.poses = decoder.solutions();

    let mut starts: Vec<(usize, u64)> = Vec::new();
    // The last GPS time that was believed, and the device time that it stands for.
    let mut anchor: Option<(GpsTime, u64)> = None;
    for (from, gps) in frames {
        // No frame begins before the one before it has passed the line.
        let free_us =
            starts.last().map_or(BEGIN_US, |&(before, at_us)| at_us + (from - before) as u64 * 10_000_000 / INS_BAUD);
        let step_us = gps.zip(anchor).map(|(now, (last, _))| now.since(last));
        let valid_us = match (anchor, step_us) {
            (Some((_, valid_us)), Some(step)) if (-1_000_000..=LONGEST_STEP_US).contains(&step) => {
                valid_us.checked_add_signed(step)
            }
            // The first known time, or one after a jump: it begins where the line is.
            _ => gps.map(|_| free_us.max(BEGIN_US)),
        };
        match (gps, valid_us) {
            (Some(gps), Some(valid_us)) => {
                if let (Some(step), Some((_, before_us))) = (step_us, anchor) {
                    found.seconds += valid_us.saturating_sub(before_us) as f64 * 1e-6 * f64::from(u8::from(step > 0));
                }
                anchor = Some((gps, valid_us));
                starts.push((from, free_us.max(valid_us + LATENCY_US)));
            }
            _ => {
                found.untimed += 1;
                starts.push((from, free_us));
            }
        }
    }
    (cut(bytes.len(), &starts, INS_BAUD), found)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::capture::Reader;

    /// Imports and gives back the bytes of a channel in the order of time.
    fn round(lidar: Option<&[u8]>, ins: Option<&[u8]>) -> (Vec<u8>, Vec<u8>, Option<Lidar>, Option<Ins>) {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.mcap");
        let mut writer = Writer::create(&path).unwrap();
        let (found_lidar, found_ins) = import(lidar, ins, 6, &mut writer).unwrap();
        writer.finish().unwrap();
        let (mut a, mut b) = (Vec::new(), Vec::new());
        for chunk in Reader::open(&path).unwrap().map(Result::unwrap) {
            match chunk.channel {
                Channel::Lidar => a.extend(chunk.data),
                _ => b.extend(chunk.data),
            }
        }
        (a, b, found_lidar, found_ins)
    }

    #[test]
    fn every_byte_is_kept_even_of_what_is_no_dump() {
        let noise: Vec<u8> = (0..5_000_u32).map(|i| (i.wrapping_mul(2_654_435_761) >> 13) as u8).collect();
        let (lidar, ins, found_lidar, found_ins) = round(Some(&noise), Some(&noise[..700]));
        assert_eq!((lidar, ins), (noise.clone(), noise[..700].to_vec()));
        assert_eq!((found_lidar.unwrap().scans, found_ins.unwrap().poses), (0, 0));
        let (lidar, ins, ..) = round(Some(&[]), None);
        assert_eq!((lidar.len(), ins.len()), (0, 0));
    }

    #[test]
    fn recordings_are_imported_whole() {
        let Some(folder) = std::env::var_os("CROSSFALL_RECORDINGS") else {
            eprintln!("skipped: CROSSFALL_RECORDINGS does not name the folder of recordings");
            return;
        };
        let folder = std::path::Path::new(&folder);
        for entry in std::fs::read_dir(folder.join("lms")).unwrap() {
            let path = entry.unwrap().path();
            if path.extension().is_none_or(|extension| extension != "bin") {
                continue;
            }
            let bytes = std::fs::read(&path).unwrap();
            let (kept, _, found, _) = round(Some(&bytes), None);
            assert!(kept == bytes, "{}", path.display());
            let found = found.unwrap();
            assert_eq!(found.line.bad_frames, 0, "{}", path.display());
            if let Ok(table) = std::fs::read_to_string(path.with_extension("csv")) {
                let listed = table.lines().filter(|line| line.ends_with(",0xb0")).count();
                assert_eq!(found.scans as usize, listed, "{}", path.display());
            }
        }
        let bytes = std::fs::read(folder.join("novatel/propak6_inspvax_20hz.bin")).unwrap();
        let (_, kept, _, found) = round(None, Some(&bytes));
        assert!(kept == bytes);
        let found = found.unwrap();
        assert_eq!((found.poses, found.line.bad_frames, found.untimed), (2_289, 0, 0));
        assert!((found.seconds - 114.4).abs() < 1.0, "{}", found.seconds);
    }
}
