//! One scan as it left the decoder, and the geometry and timing of its beams.
//!
//! Two families of scanners are told apart by the measuring mode. Modes 00h to 06h are an LMS 2xx's (SICK telegram listing, command B0h): a scan in
//! half degrees is two turns of the mirror. From [`ONE_TURN`] on, one for each of [`PERIODS_US`], they are those of scanners that measure every
//! beam of a scan in a single turn (`sensors::cola`), whose values are ranges up to the highest bit.

use crossfall_protocol::message::ScanMode;
use crossfall_protocol::{Angle, DeviceTime};

/// Values in the largest scan: 100 degrees in steps of a quarter.
pub const MAX_BEAMS: usize = 401;

/// One turn of the mirror: 90 motor steps of 148 microseconds.
pub const TURN_US: i32 = 13_320;

/// The measuring mode of a scan in one turn that takes the first of [`PERIODS_US`]; the others follow.
pub const ONE_TURN: u8 = 0x10;

/// Microseconds of a turn at 25, 35, 50, 75 and 100 turns a second.
pub const PERIODS_US: [i32; 5] = [40_000, 28_571, 20_000, 13_333, 10_000];

/// One scan: the sensor's own values and what is needed to read them.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct RawScan {
    /// 0-based number of the scan in its stream.
    pub index: u32,
    /// Arrival of the telegram's first byte.
    pub stx: DeviceTime,
    /// The telegram's count word: number of values (bits 0-9), partial scan (11-13), unit (14-15).
    pub layout: u16,
    /// Angular range, step and measuring mode.
    pub mode: ScanMode,
    /// The telegram's status byte.
    pub status: u8,
    /// Scan index and telegram index, when the scanner sends them.
    pub counters: Option<[u8; 2]>,
    /// The values as sent; those from [`RawScan::beams`] on are meaningless.
    pub values: [u16; MAX_BEAMS],
}

impl RawScan {
    /// Room for a scan: no values, and nothing but zeros in memory.
    pub const EMPTY: Self = Self {
        index: 0,
        stx: DeviceTime(0),
        layout: 0,
        mode: ScanMode { span_deg: 0, step_cdeg: 0, measuring: 0 },
        status: 0,
        counters: None,
        values: [0; MAX_BEAMS],
    };

    /// Number of values, never more than [`MAX_BEAMS`].
    #[must_use]
    pub fn beams(&self) -> usize {
        usize::from(self.layout & 0x3ff).min(MAX_BEAMS)
    }

    /// The values.
    #[must_use]
    pub fn ranges(&self) -> &[u16] {
        &self.values[..self.beams()]
    }

    /// The period of a scan that was measured in one turn of its mirror, in microseconds; nothing for an LMS 2xx.
    #[must_use]
    pub fn one_turn_us(&self) -> Option<i32> {
        PERIODS_US.get(usize::from(self.mode.measuring.checked_sub(ONE_TURN)?)).copied()
    }

    /// Micrometres in one unit of a value: 10,000 or 1,000, and 2,000 or 1,000 for a scan in one turn.
    #[must_use]
    pub fn unit_um(&self) -> i32 {
        match (self.layout >> 14, self.one_turn_us()) {
            (2, Some(_)) => 2_000,
            (1, _) | (_, Some(_)) => 1_000,
            _ => 10_000,
        }
    }

    /// Whether this is one partial scan (a single turn of an interlaced scan) and, if so, which: 0 for .00 to 3 for .75.
    #[must_use]
    pub fn partial(&self) -> Option<u8> {
        (self.layout & 1 << 13 != 0).then_some((self.layout >> 11 & 3) as u8)
    }

    /// Angle between neighbouring values of the telegram, in hundredths of a degree: a partial scan's are a degree apart.
    #[must_use]
    pub fn step_cdeg(&self) -> u32 {
        if self.partial().is_some() { 100 } else { u32::from(self.mode.step_cdeg) }
    }

    /// Mirror turns in this telegram: 1, 2 or 4.
    #[must_use]
    pub fn turns(&self) -> usize {
        match self.step_cdeg() {
            _ if self.one_turn_us().is_some() => 1,
            25 => 4,
            50 => 2,
            _ => 1,
        }
    }

    /// Beams of one turn to a degree: 1, and up to 4 for a scan in one turn.
    #[must_use]
    pub fn beams_a_degree(&self) -> usize {
        match self.step_cdeg() {
            _ if self.one_turn_us().is_none() => 1,
            25 => 4,
            50 => 2,
            _ => 1,
        }
    }

    /// Angle of value `i` from the vehicle's right through straight down, in hundredths of a degree.
    ///
    /// A 100-degree scan is centred on straight down: 40 to 140 degrees.
    #[must_use]
    pub fn beam_cdeg(&self, i: usize) -> u32 {
        let first = if self.mode.span_deg == 100 { 4_000 } else { 0 };
        first + 25 * u32::from(self.partial().unwrap_or(0)) + i as u32 * self.step_cdeg()
    }

    /// Angle of value `i` before roll and mounting: theta of the convention.
    #[must_use]
    pub fn beam_angle(&self, i: usize) -> Angle {
        Angle::from_microdegrees(self.beam_cdeg(i) as i32 * 10_000)
    }

    /// The instant of the angle 0 of the first turn: STX less the turns of the scan, less the configured delay.
    #[must_use]
    pub fn start(&self, delay_us: i32) -> DeviceTime {
        let whole_us = self.one_turn_us().unwrap_or(self.turns() as i32 * TURN_US);
        self.stx.offset(-i64::from(whole_us) - i64::from(delay_us))
    }

    /// How long the mirror takes to turn by an angle of at most a turn, in nanoseconds: 37 us a degree, or by the period.
    #[must_use]
    pub fn sweep_ns(&self, cdeg: u32) -> i32 {
        match self.one_turn_us() {
            None => cdeg as i32 * 370,
            // 36,000 hundredths of a degree in a period of so many thousand nanoseconds: at most 36,000 * 40,000 before the division.
            Some(period_us) => cdeg as i32 * period_us / 36,
        }
    }

    /// When value `i` was measured, in nanoseconds after [`RawScan::start`]: as the mirror sweeps, one turn later for each
    /// step within a degree (interlace: the turns of a scan are a step apart, the output is sorted by angle).
    #[must_use]
    pub fn beam_ns(&self, i: usize) -> i32 {
        let turn = if self.turns() == 1 { 0 } else { (i % self.turns()) as i32 };
        turn * TURN_US * 1_000 + self.sweep_ns(self.beam_cdeg(i))
    }
}
