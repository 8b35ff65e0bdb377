//! The bytes of an LMS 111: 270 degrees in steps of half a degree, 50 scans a second, telegram `LMDscandata` in CoLa B (SICK telegram listing 8014631).
//!
//! Values count millimetres; 0 stands for no echo and 2 for an implausible one. What looks above the horizon sees nothing. The scanner's clock starts with
//! the drive. The mirror passes its index a quarter of a turn before the beam at 0 degrees, where the instrument takes it to be.

use super::lms::{BEAMS, NO_ECHO, WEAK_ECHO};
use crossfall_core::sensors::cola::{INDEX_CDEG, checksum};

/// One turn of the mirror.
pub const TURN_S: f64 = 0.02;

/// The first value's angle, in half degrees before 0.
const BEFORE: usize = 90;

/// Values of a telegram.
const VALUES: usize = 541;

/// Microseconds of the scanner's clock before the drive begins: scans are measured before they are sent.
const CLOCK_LEAD_US: f64 = 1_000_000.0;

/// One telegram with the half circle's values, as an LMS 2xx would give them.
pub(super) fn telegram(number: usize, start_s: f64, sent_s: f64, turn_s: f64, values: &[u16; BEAMS]) -> Vec<u8> {
    // 2^32 us are 71 minutes: the clock wraps.
    let clock = |s: f64| libm::round(s * 1e6 + CLOCK_LEAD_US) as u64 as u32;
    let index_s = start_s - f64::from(INDEX_CDEG) / 36_000.0 * turn_s;
    let mut payload = b"sSN LMDscandata ".to_vec();
    let mut put = |bytes: &[u8]| payload.extend_from_slice(bytes);
    put(&[0, 1, 0, 1]);
    put(&12_345_678_u32.to_be_bytes());
    // Device status, telegram counter, scan counter.
    put(&[0, 0]);
    put(&(number as u16).to_be_bytes());
    put(&(number as u16).to_be_bytes());
    put(&clock(index_s).to_be_bytes());
    put(&clock(sent_s).to_be_bytes());
    // Inputs, outputs, layer; 50 Hz; 27 kHz; no encoder; one channel of 16 bits.
    put(&[0, 0, 0x3f, 0, 0, 0]);
    put(&5_000_u32.to_be_bytes());
    put(&270_u32.to_be_bytes());
    put(&[0, 0, 0, 1]);
    put(b"DIST1");
    put(&1.0_f32.to_be_bytes());
    put(&0.0_f32.to_be_bytes());
    put(&(-450_000_i32).to_be_bytes());
    put(&5_000_u16.to_be_bytes());
    put(&(VALUES as u16).to_be_bytes());
    for i in 0..VALUES {
        let value = match i.checked_sub(BEFORE).and_then(|beam| values.get(beam)) {
            None | Some(&NO_ECHO) => 0,
            Some(&WEAK_ECHO) => 2,
            // Nearer than it sees, which no ground is: noise must not make a special value of it.
            Some(&range) => range.max(16),
        };
        put(&value.to_be_bytes());
    }
    // No channel of 8 bits; no position, name, comment, time or event.
    put(&[0; 12]);
    let mut telegram = vec![2, 2, 2, 2];
    telegram.extend((payload.len() as u32).to_be_bytes());
    telegram.extend(&payload);
    telegram.push(checksum(&payload));
    telegram
}
