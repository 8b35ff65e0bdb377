//! What the host says to the scanner (TL sections 6 to 10). Address 00h: the scanner at the other end of the line.
//!
//! The host's bytes may follow each other by 55 us to 6 ms, so that a telegram goes out in one piece.

use heapless::Vec;

use super::reply::Configuration;
use super::telegram::{STX, crc};

/// Longest command built here: 77h with a configuration.
pub const LONGEST_COMMAND: usize = 41;

/// A command's telegram, CRC included.
pub type Telegram = Vec<u8, LONGEST_COMMAND>;

/// The scanner's line speeds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Baud {
    /// 9600, after power-on unless another was stored.
    B9600,
    /// 19200.
    B19200,
    /// 38400.
    B38400,
    /// 500,000, the only one that carries every scan.
    B500000,
}

impl Baud {
    /// All, in the order in which a silent scanner is looked for: most likely first.
    pub const ALL: [Self; 4] = [Self::B9600, Self::B500000, Self::B38400, Self::B19200];

    /// Bits a second.
    #[must_use]
    pub const fn rate(self) -> u32 {
        match self {
            Self::B9600 => 9_600,
            Self::B19200 => 19_200,
            Self::B38400 => 38_400,
            Self::B500000 => 500_000,
        }
    }

    /// The speed of so many bits a second.
    #[must_use]
    pub fn of(rate: u32) -> Option<Self> {
        Self::ALL.into_iter().find(|baud| baud.rate() == rate)
    }

    const fn mode(self) -> u8 {
        match self {
            Self::B500000 => 0x48,
            Self::B38400 => 0x40,
            Self::B19200 => 0x41,
            Self::B9600 => 0x42,
        }
    }
}

/// Angle and step of a scan.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Variant {
    /// 180 degrees in steps of 1.
    Span180Step100,
    /// 180 degrees in steps of 0.5.
    Span180Step50,
    /// 100 degrees in steps of 1.
    Span100Step100,
    /// 100 degrees in steps of 0.5.
    Span100Step50,
    /// 100 degrees in steps of 0.25.
    Span100Step25,
}

impl Variant {
    /// Degrees and hundredths of a degree.
    #[must_use]
    pub const fn span_and_step(self) -> (u8, u8) {
        match self {
            Self::Span180Step100 => (180, 100),
            Self::Span180Step50 => (180, 50),
            Self::Span100Step100 => (100, 100),
            Self::Span100Step50 => (100, 50),
            Self::Span100Step25 => (100, 25),
        }
    }
}

/// The factory password of the installation mode.
pub const PASSWORD: [u8; 8] = *b"SICK_LMS";

/// A telegram from command and data; data beyond [`LONGEST_COMMAND`] does not occur in the commands below.
fn telegram(counted: &[&[u8]]) -> Telegram {
    let length = counted.iter().map(|part| part.len()).sum::<usize>() as u16;
    let mut telegram = Telegram::new();
    let mut append = |bytes: &[u8]| {
        let _fits = telegram.extend_from_slice(bytes);
    };
    append(&[STX, 0x00]);
    append(&length.to_le_bytes());
    counted.iter().for_each(|part| append(part));
    let check = crc(&telegram);
    let _fits = telegram.extend_from_slice(&check.to_le_bytes());
    telegram
}

/// 31h: report the state (answer B1h).
#[must_use]
pub fn status() -> Telegram {
    telegram(&[&[0x31]])
}

/// 3Ah: report the type (answer BAh).
#[must_use]
pub fn scanner_type() -> Telegram {
    telegram(&[&[0x3a]])
}

/// 74h: report the stored configuration (answer F4h).
#[must_use]
pub fn configuration() -> Telegram {
    telegram(&[&[0x74]])
}

/// 77h: store a configuration (answer F7h); needs the installation mode.
#[must_use]
pub fn write_configuration(configuration: &Configuration) -> Telegram {
    telegram(&[&[0x77], &configuration.0])
}

/// 20h: change the line speed (answer A0h at the old speed).
#[must_use]
pub fn set_baud(baud: Baud) -> Telegram {
    telegram(&[&[0x20, baud.mode()]])
}

/// 20h 00h: enter the installation mode (answer A0h).
#[must_use]
pub fn installation_mode(password: [u8; 8]) -> Telegram {
    telegram(&[&[0x20, 0x00], &password])
}

/// 20h 24h: send all scans (answer A0h).
#[must_use]
pub fn start_continuous() -> Telegram {
    telegram(&[&[0x20, 0x24]])
}

/// 20h 25h: send scans on request only (answer A0h).
#[must_use]
pub fn stop_continuous() -> Telegram {
    telegram(&[&[0x20, 0x25]])
}

/// 30h 01h: send one scan.
#[must_use]
pub fn one_scan() -> Telegram {
    telegram(&[&[0x30, 0x01]])
}

/// 3Bh: choose angle and step until power-off (answer BBh).
#[must_use]
pub fn set_variant(variant: Variant) -> Telegram {
    let (span_deg, step_cdeg) = variant.span_and_step();
    telegram(&[&[0x3b, span_deg, 0, step_cdeg, 0]])
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The listing's own bytes.
    #[test]
    fn commands_as_in_the_listing() {
        let listing: [(Telegram, &[u8]); 14] = [
            (status(), &[0x02, 0, 0x01, 0, 0x31, 0x15, 0x12]),
            (scanner_type(), &[0x02, 0, 0x01, 0, 0x3a, 0x1e, 0x12]),
            (configuration(), &[0x02, 0, 0x01, 0, 0x74, 0x50, 0x12]),
            (set_baud(Baud::B500000), &[0x02, 0, 0x02, 0, 0x20, 0x48, 0x58, 0x08]),
            (set_baud(Baud::B38400), &[0x02, 0, 0x02, 0, 0x20, 0x40, 0x50, 0x08]),
            (set_baud(Baud::B19200), &[0x02, 0, 0x02, 0, 0x20, 0x41, 0x51, 0x08]),
            (set_baud(Baud::B9600), &[0x02, 0, 0x02, 0, 0x20, 0x42, 0x52, 0x08]),
            (set_variant(Variant::Span180Step50), &[0x02, 0, 0x05, 0, 0x3b, 0xb4, 0, 0x32, 0, 0x3b, 0x1f]),
            (set_variant(Variant::Span180Step100), &[0x02, 0, 0x05, 0, 0x3b, 0xb4, 0, 0x64, 0, 0x97, 0x49]),
            (set_variant(Variant::Span100Step25), &[0x02, 0, 0x05, 0, 0x3b, 0x64, 0, 0x19, 0, 0xe7, 0x72]),
            (
                installation_mode(PASSWORD),
                &[0x02, 0, 0x0a, 0, 0x20, 0, 0x53, 0x49, 0x43, 0x4b, 0x5f, 0x4c, 0x4d, 0x53, 0xbe, 0xc5],
            ),
            (start_continuous(), &[0x02, 0, 0x02, 0, 0x20, 0x24, 0x34, 0x08]),
            (stop_continuous(), &[0x02, 0, 0x02, 0, 0x20, 0x25, 0x35, 0x08]),
            (one_scan(), &[0x02, 0, 0x02, 0, 0x30, 0x01, 0x31, 0x18]),
        ];
        for (built, bytes) in listing {
            assert_eq!(built, bytes);
        }
    }

    #[test]
    fn the_longest_command_fits() {
        let built = write_configuration(&Configuration([0xff; 34]));
        assert_eq!(built.len(), LONGEST_COMMAND);
        assert_eq!(built[2..5], [35, 0, 0x77]);
    }
}
