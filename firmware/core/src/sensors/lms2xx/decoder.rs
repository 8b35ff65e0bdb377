//! From bytes to scans and replies.
//!
//! **How a scan is to be read.** A full scan's number of values names its variant: 181 and 361 are 180 degrees in steps
//! of 1 and 0.5, 101, 201 and 401 are 100 degrees in steps of 1, 0.5 and 0.25. A partial scan (one mirror turn) has
//! 180 or 181, or 100 or 101, values a degree apart: its span follows from the count; the step of the scan that it is part
//! of is a quarter if its own fraction is .25 or .75, else what the last status report (B1h) says for that span, else the
//! finest (0.5 at 180, 0.25 at 100). Any other count or unit is no layout that this instrument knows: the telegram is
//! given as a reply and counted as unreadable. The measuring mode is the last that the scanner itself reported (B1h,
//! F4h, F7h), before that the configured one.
//!
//! **Loss.** With indices enabled the telegram index advances by one a telegram, modulo 256: the scans missing before
//! this one are known unless 256 or more were lost in a row. Any other telegram in between ends the chain, because
//! the listing does not say which telegrams the index counts.

use crossfall_protocol::DeviceTime;
use crossfall_protocol::message::{LineCounters, ScanMode};

use super::reply::{Reply, Status};
use super::telegram::{FRONT, LONGEST, TRAILER, Telegrams};
use crate::scan::{MAX_BEAMS, RawScan};
use crate::sensors::Scanner;
use crate::sensors::framing::{Frame, Framer, Protocol, most_open, room};

/// The scanner accepts a command.
const ACK: u8 = 0x06;
/// The scanner refuses a command.
const NAK: u8 = 0x15;
/// Command of a scan's telegram.
const SCAN: u8 = 0xb0;

/// What the scanner sent.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Event<'a> {
    /// A scan.
    Scan {
        /// The scan.
        scan: &'a RawScan,
        /// Scans that the telegram index proves missing just before it.
        missing: u8,
    },
    /// Any other telegram.
    Reply {
        /// Arrival of its first byte.
        stx: DeviceTime,
        /// Its status byte.
        status: Status,
        /// What it says.
        reply: Reply<'a>,
    },
    /// A lone ACK: the command was understood. It carries no check, noise can look like it.
    Ack(DeviceTime),
    /// A lone NAK: the command was not understood.
    Nak(DeviceTime),
}

/// Decodes a scanner's stream, one byte at a time.
///
/// Accounting: every byte received is part of a good telegram, skipped, or pending. A lone ACK or NAK carries no check
/// and counts as skipped.
pub struct Decoder {
    framer: Framer<Telegrams, { room(LONGEST) }, { most_open(LONGEST, Telegrams::SPACING) }>,
    scans: Scans,
}

/// What turns telegrams into events.
struct Scans {
    scan: RawScan,
    measuring: u8,
    /// The scanner itself has told it.
    reported: bool,
    /// Span in degrees and step in hundredths that the scanner reported last.
    variant: Option<(u8, u8)>,
    telegram_index: Option<u8>,
    decoded: u32,
    missing: u32,
    unreadable: u32,
}

impl Decoder {
    /// A decoder at the start of a stream. `measuring_mode` holds until the scanner reports its own.
    #[must_use]
    pub fn new(measuring_mode: u8) -> Self {
        let mode = ScanMode { span_deg: 180, step_cdeg: 50, measuring: measuring_mode };
        Self {
            framer: Framer::new(),
            scans: Scans {
                scan: RawScan {
                    index: 0,
                    stx: DeviceTime(0),
                    layout: 0,
                    mode,
                    status: 0,
                    counters: None,
                    values: [0; MAX_BEAMS],
                },
                measuring: measuring_mode,
                reported: false,
                variant: None,
                telegram_index: None,
                decoded: 0,
                missing: 0,
                unreadable: 0,
            },
        }
    }

    /// Takes the next byte, which arrived at `at`, and tells what it completes: nothing, or one or several events.
    #[inline]
    pub fn push(&mut self, byte: u8, at: DeviceTime, out: &mut impl FnMut(Event<'_>)) {
        let alone = matches!(byte, ACK | NAK) && !self.framer.is_inside();
        let scans = &mut self.scans;
        self.framer.push(byte, at, &mut |frame| scans.decode(frame, out));
        if alone && self.framer.pending() == 0 {
            out(if byte == ACK { Event::Ack(at) } else { Event::Nak(at) });
        }
    }

    /// Declares that nothing that is under way can be completed: at the end of a stream, when the line's speed changes
    /// and before a command is sent. Its bytes count as skipped, unless whole telegrams stand behind a false beginning.
    pub fn finish(&mut self, out: &mut impl FnMut(Event<'_>)) {
        let scans = &mut self.scans;
        self.framer.finish(&mut |frame| scans.decode(frame, out));
        self.scans.telegram_index = None;
    }

    /// Counters of the line, without overruns.
    #[must_use]
    pub fn counters(&self) -> LineCounters {
        self.framer.counters()
    }

    /// Bytes of a telegram that may be under way.
    #[must_use]
    pub fn pending(&self) -> usize {
        self.framer.pending()
    }

    /// Scans decoded.
    #[must_use]
    pub fn scans(&self) -> u32 {
        self.scans.decoded
    }

    /// Scans that the telegram index proves missing.
    #[must_use]
    pub fn scans_missing(&self) -> u32 {
        self.scans.missing
    }

    /// Whole scan telegrams of a layout that is not known.
    #[must_use]
    pub fn scans_unreadable(&self) -> u32 {
        self.scans.unreadable
    }

    /// The measuring mode in force.
    #[must_use]
    pub fn measuring_mode(&self) -> u8 {
        self.scans.measuring
    }

    /// Assumes this measuring mode from now on, until the scanner reports its own. One that it has reported stands: values read by
    /// another are wrong.
    pub fn assume_measuring_mode(&mut self, mode: u8) {
        if !self.scans.reported {
            self.scans.measuring = mode;
        }
    }
}

impl Scanner for Decoder {
    type Event<'a> = Event<'a>;

    #[inline]
    fn push(&mut self, byte: u8, at: DeviceTime, out: &mut impl FnMut(Event<'_>)) {
        self.push(byte, at, out);
    }

    fn finish(&mut self, out: &mut impl FnMut(Event<'_>)) {
        self.finish(out);
    }

    fn scan<'e>(event: &'e Event<'_>) -> Option<&'e RawScan> {
        match event {
            Event::Scan { scan, .. } => Some(scan),
            _ => None,
        }
    }

    fn assume_measuring_mode(&mut self, mode: u8) {
        self.assume_measuring_mode(mode);
    }

    fn counters(&self) -> LineCounters {
        self.counters()
    }

    fn scans(&self) -> u32 {
        self.scans()
    }

    fn scans_missing(&self) -> u32 {
        self.scans_missing()
    }

    fn scans_unreadable(&self) -> u32 {
        self.scans_unreadable()
    }
}

impl Scans {
    fn decode(&mut self, frame: Frame<'_>, out: &mut impl FnMut(Event<'_>)) {
        // The framer gives whole telegrams only: front, command, data, status, CRC.
        let Some((_, counted)) = frame.bytes.split_at_checked(FRONT) else { return };
        let Some((counted, _)) = counted.split_last_chunk::<TRAILER>() else { return };
        let Some((&status, counted)) = counted.split_last() else { return };
        let Some((&command, data)) = counted.split_first() else { return };

        if command == SCAN {
            if self.read_scan(frame.at, status, data) {
                let missing = self.missing_before();
                self.missing = self.missing.wrapping_add(u32::from(missing));
                out(Event::Scan { scan: &self.scan, missing });
                self.scan.index = self.scan.index.wrapping_add(1);
                self.decoded = self.decoded.wrapping_add(1);
                return;
            }
            self.unreadable = self.unreadable.wrapping_add(1);
        }
        self.telegram_index = None;
        let reply = Reply::read(command, data);
        match &reply {
            Reply::Report(report) => {
                (self.measuring, self.reported) = (report.measuring_mode, true);
                self.variant = Some((report.span_deg, report.step_cdeg));
            }
            Reply::Configuration(configuration) | Reply::Configured { configuration, .. } => {
                (self.measuring, self.reported) = (configuration.measuring_mode(), true);
            }
            _ => {}
        }
        out(Event::Reply { stx: frame.at, status: Status(status), reply });
    }

    /// Reads the data of a B0h telegram into `self.scan`; false when its layout is not known.
    fn read_scan(&mut self, stx: DeviceTime, status: u8, data: &[u8]) -> bool {
        let Some((&layout, data)) = data.split_first_chunk() else { return false };
        let layout = u16::from_le_bytes(layout);
        let count = usize::from(layout & 0x3ff);
        let Some((values, indices)) = data.split_at_checked(2 * count) else { return false };
        let counters = match *indices {
            [] => None,
            [scan, telegram] => Some([scan, telegram]),
            _ => return false,
        };
        let Some((span_deg, step_cdeg)) = self.variant_of(layout) else { return false };
        if layout >> 14 > 1 {
            return false;
        }
        let mode = ScanMode { span_deg, step_cdeg, measuring: self.measuring };
        self.scan.stx = stx;
        self.scan.layout = layout;
        self.scan.mode = mode;
        self.scan.status = status;
        self.scan.counters = counters;
        let (pairs, _) = values.as_chunks();
        for (place, &pair) in self.scan.values.iter_mut().zip(pairs) {
            *place = u16::from_le_bytes(pair);
        }
        // What an earlier, longer scan left behind does not belong to this one.
        for place in self.scan.values.iter_mut().skip(count) {
            *place = 0;
        }
        true
    }

    /// Span and step of the scan that a telegram of this layout is, or is part of.
    fn variant_of(&self, layout: u16) -> Option<(u8, u8)> {
        let count = layout & 0x3ff;
        if layout & 1 << 13 == 0 {
            return match count {
                181 => Some((180, 100)),
                361 => Some((180, 50)),
                101 => Some((100, 100)),
                201 => Some((100, 50)),
                401 => Some((100, 25)),
                _ => None,
            };
        }
        let (span, finest) = match count {
            180 | 181 => (180, 50),
            100 | 101 => (100, 25),
            _ => return None,
        };
        let quarters = layout >> 11 & 1 == 1;
        match self.variant {
            _ if quarters => Some((span, 25)),
            Some((reported, step)) if reported == span => Some((span, step)),
            _ => Some((span, finest)),
        }
    }

    /// Scans that the telegram index proves missing before `self.scan`.
    fn missing_before(&mut self) -> u8 {
        let index = self.scan.counters.map(|[_, telegram]| telegram);
        let before = core::mem::replace(&mut self.telegram_index, index);
        match (before, index) {
            (Some(before), Some(index)) => index.wrapping_sub(before).wrapping_sub(1),
            _ => 0,
        }
    }
}
