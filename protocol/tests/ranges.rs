//! The range code: whatever the scanner sends comes back, and the scans of a road come back from few bytes.

mod samples;
mod sections;

use std::path::PathBuf;

use crossfall_protocol::DeviceTime;
use crossfall_protocol::frame::MAX_MESSAGE_FRAME;
use crossfall_protocol::message::{Message, Scan, ScanMode};
use crossfall_protocol::ranges::{MAX_CODE, MAX_VALUES, RangeError, decode, encode};
use proptest::collection::vec;
use proptest::prelude::*;
use samples::any_scan_mode;
use sections::{Cover, LAYOUT, MODE};

/// Code and decode, and check what must hold of every code.
fn round_trip(layout: u16, mode: ScanMode, values: &[u16]) -> Vec<u8> {
    let mut code = [0; MAX_CODE];
    let code = encode(layout, mode, values, &mut code);
    assert!(code.len() <= 2 * values.len(), "no longer than the values themselves");
    let mut out = [0xAAAA; MAX_VALUES];
    assert_eq!(decode(layout, mode, code, &mut out), Ok(values));
    code.to_vec()
}

/// Length of the frame that carries a scan an hour into a drive.
fn frame_len(layout: u16, mode: ScanMode, values: &[u16]) -> usize {
    let code = round_trip(layout, mode, values);
    let stx = DeviceTime(3_600_000_000);
    let scan = Scan { index: 135_135, stx, layout, mode, status: 0x10, counters: None, code: &code };
    Message::Scan(scan).encode(50_000, &mut [0; MAX_MESSAGE_FRAME]).expect("fits")
}

/// Mean length of code and frame over scans.
fn means(scans: &[Vec<u16>]) -> (f64, f64) {
    let sum = |len: &dyn Fn(&[u16]) -> usize| scans.iter().map(|scan| len(scan)).sum::<usize>() as f64;
    let count = scans.len() as f64;
    (sum(&|scan| round_trip(LAYOUT, MODE, scan).len()) / count, sum(&|scan| frame_len(LAYOUT, MODE, scan)) / count)
}

#[test]
fn sizes() {
    println!("cover   noise  code  frame   (mean bytes a scan, {} plain)", 2 * 361);
    for (cover, sigma_mm, most) in [
        (Cover::Bare, 1.0, 175.0),
        (Cover::Bare, 3.5, 235.0),
        (Cover::Bare, 10.0, 295.0),
        (Cover::Grass, 3.5, 320.0),
        (Cover::Grass, 10.0, 355.0),
    ] {
        let (code, frame) = means(&sections::scans(200, sigma_mm, cover, 88_172_645_463_325_252));
        println!("{cover:?}   {sigma_mm:4} mm  {code:5.1}  {frame:5.1}");
        assert!(frame <= most, "{cover:?} {sigma_mm}: {frame}");
    }
}

/// Values of every B0 telegram in a recording; the telegrams' checks are the core's business.
fn recorded_scans(bytes: &[u8]) -> Vec<(u16, Vec<u16>)> {
    let word = |at: usize| bytes.get(at..at + 2).map(|pair| u16::from_le_bytes([pair[0], pair[1]]));
    let mut scans = Vec::new();
    let mut at = 0;
    while at + 7 < bytes.len() {
        let (len, layout) = (word(at + 2).unwrap_or(0), word(at + 5).unwrap_or(0));
        let count = usize::from(layout & 0x3ff);
        let is_scan = bytes[at..].starts_with(&[0x02, 0x80]) && bytes[at + 4] == 0xB0;
        if is_scan && usize::from(len) == 2 * count + 4 && at + 9 + 2 * count <= bytes.len() {
            scans.push((layout, (0..count).filter_map(|i| word(at + 7 + 2 * i)).collect()));
            at += 10 + 2 * count;
        } else {
            at += 1;
        }
    }
    scans
}

#[test]
fn recordings_come_back_and_shrink() {
    let Some(folder) = std::env::var_os("CROSSFALL_RECORDINGS").map(PathBuf::from) else {
        eprintln!("skipped: CROSSFALL_RECORDINGS does not name the recordings");
        return;
    };
    for (files, measuring, scans_expected, most) in [("lms200_", 3, 286, 365.0), ("lms291_", 0, 1, 500.0)] {
        let mut scans = Vec::new();
        for entry in std::fs::read_dir(folder.join("lms")).expect("the recordings have a folder lms") {
            let path = entry.expect("readable").path();
            let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
            if name.starts_with(files) && name.ends_with(".bin") {
                scans.extend(recorded_scans(&std::fs::read(&path).expect("readable")));
            }
        }
        assert_eq!(scans.len(), scans_expected);
        let mode = ScanMode { span_deg: 180, step_cdeg: 50, measuring };
        let sum: usize = scans.iter().map(|(layout, values)| round_trip(*layout, mode, values).len()).sum();
        let mean = sum as f64 / scans.len() as f64;
        println!("{files}: {mean:.1} bytes a scan");
        assert!(mean <= most);
    }
}

#[test]
fn extremes_come_back() {
    for layout in [LAYOUT, 361, 1 << 14 | 181, 1 << 14 | 401, 1 << 13 | 181, 0, 1, 2, 1 << 14 | 101] {
        for measuring in 0..=7 {
            for step_cdeg in [25, 50, 100, 0, 255] {
                let mode = ScanMode { span_deg: 180, step_cdeg, measuring };
                let count = usize::from(layout & 0x3ff);
                for value in [0, 1, 31, 32, 8183, 8191, 16_383, 32_759, 32_767, 32_768, 65_535] {
                    round_trip(layout, mode, &vec![value; count]);
                    let alternating: Vec<u16> = (0..count).map(|i| if i % 2 == 0 { value } else { 7 }).collect();
                    round_trip(layout, mode, &alternating);
                }
            }
        }
    }
}

#[test]
fn a_count_beyond_any_scan_is_refused() {
    let mut out = [0; MAX_VALUES];
    assert_eq!(decode(402, MODE, &[0; 804], &mut out), Err(RangeError::Count));
    assert_eq!(decode(0x3ff, MODE, &[], &mut out), Err(RangeError::Count));
}

/// The code is tight: what is cut off it, put onto it or flipped in it shows, or means other values.
#[test]
fn every_bit_of_a_code_matters() {
    for scan in sections::scans(6, 3.5, Cover::Bare, 7) {
        let code = round_trip(LAYOUT, MODE, &scan);
        let mut out = [0; MAX_VALUES];
        for cut in 0..code.len() {
            assert_ne!(decode(LAYOUT, MODE, &code[..cut], &mut out), Ok(&scan[..]));
        }
        for extra in [&[0][..], &[1], &[0x80], &[0, 0, 0, 0], &[0xFF; 9]] {
            let longer = [&code[..], extra].concat();
            assert_eq!(decode(LAYOUT, MODE, &longer, &mut out), Err(RangeError::Damaged));
        }
        for bit in 0..8 * code.len() {
            let mut flipped = code.clone();
            flipped[bit / 8] ^= 1 << (bit % 8);
            assert_ne!(decode(LAYOUT, MODE, &flipped, &mut out), Ok(&scan[..]), "bit {bit}");
        }
    }
}

/// Values with flags above their width, runs of special ones, jumps: everything that leaves the beaten track.
fn rough_values(count: usize) -> impl Strategy<Value = Vec<u16>> {
    let piece = prop_oneof![
        4 => (0..32_000_u16, -300..300_i32, 1..40_usize, 0..30_i32).prop_map(|(start, slope, len, noise)| {
            (0..len as i32).map(|i| (i32::from(start) + slope * i + i * 7919 % (noise + 1)).clamp(0, 65_535) as u16).collect()
        }),
        1 => (8180..=8191_u16, 1..12_usize).prop_map(|(value, len)| vec![value; len]),
        1 => (16_375..=16_383_u16, 1..12_usize).prop_map(|(value, len)| vec![value; len]),
        1 => (32_750..=32_767_u16, 1..12_usize).prop_map(|(value, len)| vec![value; len]),
        1 => vec(any::<u16>(), 1..8),
        1 => (0..8_u16, 100..8100_u16, 1..10_usize).prop_map(|(flags, value, len)| vec![flags << 13 | value; len]),
    ];
    vec(piece, 1..80).prop_map(move |pieces: Vec<Vec<u16>>| {
        let mut values: Vec<u16> = pieces.concat();
        values.resize(count, 32_767);
        values
    })
}

/// A count word, a mode and as many values.
fn any_raw_scan() -> impl Strategy<Value = (u16, ScanMode, Vec<u16>)> {
    any_scan_mode().prop_flat_map(|(layout, mode)| {
        let count = usize::from(layout & 0x3ff).min(MAX_VALUES);
        let layout = layout & !0x3ff | count as u16;
        let values = prop_oneof![3 => rough_values(count), 1 => vec(any::<u16>(), count)];
        (Just(layout), Just(mode), values)
    })
}

proptest! {
    #[test]
    fn any_values_come_back((layout, mode, values) in any_raw_scan()) {
        round_trip(layout, mode, &values);
    }

    /// Garbage decodes to something or to an error, and what decodes has used every byte.
    #[test]
    fn garbage_is_no_danger((layout, mode) in any_scan_mode(), code in vec(any::<u8>(), 0..=MAX_CODE)) {
        let mut out = [0; MAX_VALUES];
        if let Ok(values) = decode(layout, mode, &code, &mut out) {
            let values = values.to_vec();
            prop_assert!(code.len() <= 2 * values.len());
            if code.len() < 2 * values.len() {
                let longer = [&code[..], &[0]].concat();
                let again = decode(layout, mode, &longer, &mut out).map(<[u16]>::to_vec);
                prop_assert_ne!(again, Ok(values));
            }
        }
    }
}
