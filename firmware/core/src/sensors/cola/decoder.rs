//! From bytes to scans.
//!
//! **What is taken of a scan.** The values of `DIST1` from 0 to 180 degrees, at half a degree or a degree: 361 or 181, what [`RawScan`] holds. A scanner that
//! sees more sends more; what lies beyond looks at the sky and is passed over, and of a scan in quarter degrees every second value is taken. Any
//! other step, rate or scale, and a window that does not reach from 0 to 180 degrees, is no layout that this instrument knows: the telegram is counted as
//! unreadable. Signal strengths (`RSSI1`) and what follows the channels are not read.
//!
//! **When it was measured.** The telegram tells the instant at which the mirror passed its index before the scan and that at which the telegram was handed
//! to the line. Their difference is taken off the arrival of its first byte, so that neither the scanner's computing nor its waiting enters. Where the index
//! lies is not said; it is taken to be [`INDEX_CDEG`] before the beam that looks to the right, opposite to the middle of what is seen. An error of it
//! is a constant delay, which `scanner.delay_us` takes and a calibration finds.
//!
//! **Loss.** The telegram counter advances by one a telegram, modulo 65,536.

use crossfall_protocol::DeviceTime;
use crossfall_protocol::message::{LineCounters, ScanMode};

use super::telegram::{FRONT, LONGEST, TRAILER, Telegrams};
use crate::scan::{ONE_TURN, PERIODS_US, RawScan};
use crate::sensors::Scanner;
use crate::sensors::framing::{Frame, Framer, Protocol, most_open, room};

/// How far the mirror turns from its index to the beam at 0 degrees, in hundredths of a degree. An inference, see the module.
pub const INDEX_CDEG: i32 = 9_000;

/// `REAL` 1.0 and 2.0: a value counts millimetres, or two of them.
const ONE: u32 = 0x3f80_0000;
const TWO: u32 = 0x4000_0000;

/// Most channels of either width, and encoders, that a telegram may have.
const MOST_CHANNELS: u16 = 8;

/// What the scanner sent.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Event<'a> {
    /// A scan.
    Scan {
        /// The scan.
        scan: &'a RawScan,
        /// Arrival of the telegram's first byte.
        arrival: DeviceTime,
        /// When the scanner sent it, in microseconds of its own clock, modulo 2^32.
        sent_us: u32,
        /// Telegrams that the counter proves missing just before it.
        missing: u16,
    },
    /// Any other telegram.
    Other(DeviceTime),
}

/// Decodes a scanner's stream, one byte at a time. Every byte received is part of a good telegram, skipped, or pending.
pub struct Decoder {
    framer: Framer<Telegrams, { room(LONGEST) }, { most_open(LONGEST, Telegrams::SPACING) }>,
    scans: Scans,
}

struct Scans {
    scan: RawScan,
    telegram: Option<u16>,
    decoded: u32,
    missing: u32,
    unreadable: u32,
}

impl Default for Decoder {
    fn default() -> Self {
        let scans = Scans { scan: RawScan::EMPTY, telegram: None, decoded: 0, missing: 0, unreadable: 0 };
        Self { framer: Framer::new(), scans }
    }
}

impl Decoder {
    /// Bytes of a telegram that may be under way.
    #[must_use]
    pub fn pending(&self) -> usize {
        self.framer.pending()
    }
}

impl Scanner for Decoder {
    type Event<'a> = Event<'a>;

    #[inline]
    fn push(&mut self, byte: u8, at: DeviceTime, out: &mut impl FnMut(Event<'_>)) {
        let scans = &mut self.scans;
        self.framer.push(byte, at, &mut |frame| scans.decode(frame, out));
    }

    fn finish(&mut self, out: &mut impl FnMut(Event<'_>)) {
        let scans = &mut self.scans;
        self.framer.finish(&mut |frame| scans.decode(frame, out));
        self.scans.telegram = None;
    }

    fn scan<'e>(event: &'e Event<'_>) -> Option<&'e RawScan> {
        match event {
            Event::Scan { scan, .. } => Some(scan),
            Event::Other(_) => None,
        }
    }

    /// These scanners have no measuring modes.
    fn assume_measuring_mode(&mut self, _mode: u8) {}

    fn counters(&self) -> LineCounters {
        self.framer.counters()
    }

    fn scans(&self) -> u32 {
        self.scans.decoded
    }

    fn scans_missing(&self) -> u32 {
        self.scans.missing
    }

    fn scans_unreadable(&self) -> u32 {
        self.scans.unreadable
    }
}

impl Scans {
    fn decode(&mut self, frame: Frame<'_>, out: &mut impl FnMut(Event<'_>)) {
        // The framer gives whole telegrams only: front, payload, check.
        let Some((_, payload)) = frame.bytes.split_at_checked(FRONT) else { return };
        let Some((payload, _)) = payload.split_last_chunk::<TRAILER>() else { return };
        let data = payload.strip_prefix(b"sSN LMDscandata ").or_else(|| payload.strip_prefix(b"sRA LMDscandata "));
        let Some(data) = data else { return out(Event::Other(frame.at)) };
        let Some(Head { telegram, sent_us }) = self.read_scan(frame.at, data) else {
            self.unreadable = self.unreadable.wrapping_add(1);
            return out(Event::Other(frame.at));
        };
        let before = self.telegram.replace(telegram);
        let missing = before.map_or(0, |before| telegram.wrapping_sub(before).wrapping_sub(1));
        self.missing = self.missing.wrapping_add(u32::from(missing));
        out(Event::Scan { scan: &self.scan, arrival: frame.at, sent_us, missing });
        self.scan.index = self.scan.index.wrapping_add(1);
        self.decoded = self.decoded.wrapping_add(1);
    }

    /// Reads the data of a telegram into `self.scan`; nothing when it is not laid out as known.
    fn read_scan(&mut self, arrival: DeviceTime, data: &[u8]) -> Option<Head> {
        let mut fields = Fields(data);
        // Version, device number, serial number.
        fields.take::<8>()?;
        let [_, device] = fields.take()?;
        let (telegram, counter) = (fields.short()?, fields.short()?);
        let (index_us, sent_us) = (fields.long()?, fields.long()?);
        // Inputs, outputs, layer.
        fields.take::<6>()?;
        let measuring = measuring(fields.long()?)?;
        // Rate of single measurements, encoders.
        fields.long()?;
        for _ in 0..fields.count()? {
            fields.take::<6>()?;
        }
        let mut ranges = None;
        for _ in 0..fields.count()? {
            let channel = Channel::read(&mut fields, 2)?;
            if channel.content == *b"DIST1" {
                ranges = Some(channel);
            }
        }
        for _ in 0..fields.count()? {
            Channel::read(&mut fields, 1)?;
        }
        let ranges = ranges?;
        let (first, stride, step_cdeg) = ranges.half_circle()?;
        let unit = match (ranges.scale, ranges.offset) {
            (ONE, 0) => 1,
            (TWO, 0) => 2,
            _ => return None,
        };
        let count: u16 = if step_cdeg == 50 { 361 } else { 181 };
        let (pairs, _) = ranges.data.as_chunks();
        // What an earlier, longer scan left behind does not belong to this one.
        self.scan.values = RawScan::EMPTY.values;
        for (i, place) in self.scan.values.iter_mut().take(usize::from(count)).enumerate() {
            // At most 859,000 values before 0 degrees, by the field's width.
            *place = u16::from_be_bytes(*pairs.get(first + i * stride)?);
        }
        self.scan.layout = count | unit << 14;
        self.scan.mode = ScanMode { span_deg: 180, step_cdeg, measuring };
        // As the LMS 2xx says it: 0 is good, 4 is an error; bit 7 is pollution.
        self.scan.status = match device {
            0 => 0,
            2 => 0x80,
            _ => 4,
        };
        self.scan.counters = Some([counter as u8, telegram as u8]);
        // The instant at which a telegram would have come that takes one turn and is sent at once: what `RawScan::start` counts from. The
        // mirror passes the index a quarter of a turn before the first beam.
        let period_us = i64::from(*PERIODS_US.get(usize::from(measuring - ONE_TURN))?);
        let late_us = i64::from(sent_us.wrapping_sub(index_us));
        let lead_us = period_us * i64::from(INDEX_CDEG) / 36_000;
        self.scan.stx = arrival.offset(period_us + lead_us - late_us);
        Some(Head { telegram, sent_us })
    }
}

/// What a scan's telegram says of itself.
struct Head {
    telegram: u16,
    sent_us: u32,
}

/// The measuring mode that stands for a rate in hundredths of a hertz.
fn measuring(frequency: u32) -> Option<u8> {
    let number = match frequency {
        2_500 => 0,
        3_500 => 1,
        5_000 => 2,
        7_500 => 3,
        10_000 => 4,
        _ => return None,
    };
    Some(ONE_TURN + number)
}

/// Fields of a telegram, from the front.
struct Fields<'a>(&'a [u8]);

impl<'a> Fields<'a> {
    fn take<const N: usize>(&mut self) -> Option<[u8; N]> {
        let (taken, rest) = self.0.split_first_chunk()?;
        self.0 = rest;
        Some(*taken)
    }

    fn short(&mut self) -> Option<u16> {
        Some(u16::from_be_bytes(self.take()?))
    }

    fn long(&mut self) -> Option<u32> {
        Some(u32::from_be_bytes(self.take()?))
    }

    /// A number of things that follow.
    fn count(&mut self) -> Option<u16> {
        self.short().filter(|&count| count <= MOST_CHANNELS)
    }

    fn bytes(&mut self, count: usize) -> Option<&'a [u8]> {
        let (taken, rest) = self.0.split_at_checked(count)?;
        self.0 = rest;
        Some(taken)
    }
}

/// A channel of values.
struct Channel<'a> {
    content: [u8; 5],
    /// Bits of two `REAL`s.
    scale: u32,
    offset: u32,
    /// Both in 1/10,000 degree.
    start: i32,
    step: u16,
    data: &'a [u8],
}

impl<'a> Channel<'a> {
    /// `width` is the number of bytes of a value.
    fn read(fields: &mut Fields<'a>, width: usize) -> Option<Self> {
        let content = fields.take()?;
        let (scale, offset) = (fields.long()?, fields.long()?);
        let start = fields.long()? as i32;
        let (step, count) = (fields.short()?, fields.short()?);
        let data = fields.bytes(usize::from(count) * width)?;
        Some(Self { content, scale, offset, start, step, data })
    }

    /// Where the value at 0 degrees is, how far the next one that is taken is from it, and the angle between both in hundredths of a degree.
    fn half_circle(&self) -> Option<(usize, usize, u8)> {
        let (stride, step_cdeg) = match self.step {
            2_500 => (2, 50),
            5_000 => (1, 50),
            10_000 => (1, 100),
            _ => return None,
        };
        let before = u32::try_from(0_i32.checked_sub(self.start)?).ok()?;
        let first = match self.step {
            2_500 => (before.is_multiple_of(2_500)).then_some(before / 2_500),
            5_000 => (before.is_multiple_of(5_000)).then_some(before / 5_000),
            _ => (before.is_multiple_of(10_000)).then_some(before / 10_000),
        };
        Some((usize::try_from(first?).ok()?, stride, step_cdeg))
    }
}
