//! What the scanner answers, besides scans (TL sections 6 to 10).

/// The status byte at the end of every reply. A scan of another family of scanners carries its state in the same bits.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Status(pub u8);

/// How grave a status is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Severity {
    /// No error.
    Ok,
    /// Information.
    Information,
    /// Warning.
    Warning,
    /// Error.
    Error,
    /// Fatal error.
    Fatal,
    /// A code that the listing does not define.
    Undefined,
}

impl Status {
    /// Bits 0-2.
    #[must_use]
    pub fn severity(self) -> Severity {
        match self.0 & 0b111 {
            0 => Severity::Ok,
            1 => Severity::Information,
            2 => Severity::Warning,
            3 => Severity::Error,
            4 => Severity::Fatal,
            _ => Severity::Undefined,
        }
    }

    /// Bit 5: the scanner waits for, or has just had, a restart.
    #[must_use]
    pub fn restart(self) -> bool {
        self.0 & 1 << 5 != 0
    }

    /// Bit 6: implausible measured values.
    #[must_use]
    pub fn implausible(self) -> bool {
        self.0 & 1 << 6 != 0
    }

    /// Bit 7: the front window is polluted.
    #[must_use]
    pub fn polluted(self) -> bool {
        self.0 & 1 << 7 != 0
    }

    /// Whether what the scanner measures is in doubt: profiles are flagged, and whoever watches is to be told.
    #[must_use]
    pub fn is_of_concern(self) -> bool {
        self.severity() > Severity::Information || self.implausible() || self.polluted()
    }
}

/// A reply by its command byte.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Reply<'a> {
    /// 90h: the scanner has been switched on or has restarted; its type text.
    PowerOn(&'a [u8]),
    /// 92h: the command is unknown or not allowed in this mode.
    Rejected,
    /// A0h: the answer to a change of the operating mode or the line speed.
    Mode(ModeChange),
    /// B1h: the scanner's state.
    Report(Report),
    /// BAh: the scanner's type text.
    Type(&'a [u8]),
    /// BBh: the answer to a change of the variant.
    Variant {
        /// Whether the variant was changed.
        changed: bool,
        /// Angle in force, in degrees.
        span_deg: u8,
        /// Step in force, in hundredths of a degree.
        step_cdeg: u8,
    },
    /// F4h: the stored configuration.
    Configuration(Configuration),
    /// F7h: the answer to writing the configuration.
    Configured {
        /// Whether it was accepted.
        accepted: bool,
        /// The configuration in force.
        configuration: Configuration,
    },
    /// Another reply, or one of these in a form that is not known.
    Other {
        /// Its command byte.
        command: u8,
        /// What stands between command and status.
        data: &'a [u8],
    },
}

/// The outcome of a mode change (A0h).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ModeChange {
    /// 0: done.
    Done,
    /// 1: refused, the password is wrong.
    WrongPassword,
    /// 2: refused, the scanner has a fault.
    Fault,
    /// A code that the listing does not define.
    Undefined(u8),
}

/// The scanner's state (B1h), as far as it matters here.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Report {
    /// Operating mode: 24h sends all scans, 25h sends on request, 00h is installation.
    pub operating_mode: u8,
    /// 0 when the scanner is sound.
    pub defect: u8,
    /// Microseconds of one ninetieth of a mirror turn, 148 nominal.
    pub motor_us: u16,
    /// Measuring mode, 00h to 06h.
    pub measuring_mode: u8,
    /// Angle in degrees, 180 or 100.
    pub span_deg: u8,
    /// Step in hundredths of a degree.
    pub step_cdeg: u8,
    /// The speed's divider as sent: 8001h is 500 kbaud, 8019h is 38400 baud.
    pub baud_code: u16,
    /// Whether the speed is kept over power-off.
    pub baud_permanent: bool,
    /// The scanner's address.
    pub address: u8,
    /// 0 cm, 1 mm.
    pub unit: u8,
}

impl Report {
    /// Reads the 152 bytes after B1h; none when they are too few or name an angle or step beyond a byte.
    fn read(data: &[u8]) -> Option<Self> {
        let byte = |i: usize| data.get(i).copied();
        let word = |i: usize| Some(u16::from_le_bytes([byte(i)?, byte(i + 1)?]));
        Some(Self {
            operating_mode: byte(7)?,
            defect: byte(8)?,
            motor_us: word(66)?,
            measuring_mode: byte(101)?,
            span_deg: u8::try_from(word(106)?).ok()?,
            step_cdeg: u8::try_from(word(108)?).ok()?,
            baud_code: word(115)?,
            baud_permanent: byte(118)? != 0,
            address: byte(119)?,
            unit: byte(121)?,
        })
    }

    /// The line's speed in baud. The code is bit 15 and the divider of 1 MHz less one (an inference from 8001h and 8019h).
    #[must_use]
    pub fn baud(&self) -> Option<u32> {
        match self.baud_code {
            0x8001 => Some(500_000),
            0x8019 => Some(38_400),
            0x8033 => Some(19_200),
            0x8067 => Some(9_600),
            _ => None,
        }
    }
}

/// The stored configuration as F4h and F7h carry it and 77h writes it: 34 bytes, of which three matter here.
///
/// The layout is blanking u16, two thresholds, availability, measuring mode, unit, and evaluation settings that are
/// written back as they were read. Checked on recorded F4h and F7h telegrams against the mode and unit of B1h and B0h.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Configuration(pub [u8; 34]);

impl Configuration {
    const AVAILABILITY: usize = 4;
    const MEASURING_MODE: usize = 5;
    const UNIT: usize = 6;
    /// Bit of the availability byte that adds scan and telegram index to every scan.
    const INDICES: u8 = 0x02;

    /// Measuring mode, 00h to 06h.
    #[must_use]
    pub fn measuring_mode(&self) -> u8 {
        self.0[Self::MEASURING_MODE]
    }

    /// 0 cm, 1 mm.
    #[must_use]
    pub fn unit(&self) -> u8 {
        self.0[Self::UNIT]
    }

    /// Whether scans carry their indices.
    #[must_use]
    pub fn indices(&self) -> bool {
        self.0[Self::AVAILABILITY] & Self::INDICES != 0
    }

    /// The same with this measuring mode, millimetres, and indices.
    #[must_use]
    pub fn for_survey(mut self, measuring_mode: u8, indices: bool) -> Self {
        self.0[Self::MEASURING_MODE] = measuring_mode;
        self.0[Self::UNIT] = 1;
        if indices {
            self.0[Self::AVAILABILITY] |= Self::INDICES;
        }
        self
    }
}

impl<'a> Reply<'a> {
    /// Reads what stands between a reply's command and its status.
    pub(super) fn read(command: u8, data: &'a [u8]) -> Self {
        let other = Self::Other { command, data };
        match (command, data) {
            (0x90, text) => Self::PowerOn(text),
            (0x92, []) => Self::Rejected,
            (0xa0, &[code]) => Self::Mode(match code {
                0 => ModeChange::Done,
                1 => ModeChange::WrongPassword,
                2 => ModeChange::Fault,
                code => ModeChange::Undefined(code),
            }),
            (0xb1, data) => Report::read(data).map_or(other, Self::Report),
            (0xba, text) => Self::Type(text),
            (0xbb, &[code, span_deg, 0, step_cdeg, 0]) => Self::Variant { changed: code == 1, span_deg, step_cdeg },
            (0xf4, data) => data.try_into().map_or(other, |bytes| Self::Configuration(Configuration(bytes))),
            (0xf7, &[code, ref data @ ..]) => data
                .try_into()
                .map_or(other, |bytes| Self::Configured { accepted: code == 1, configuration: Configuration(bytes) }),
            _ => other,
        }
    }
}
