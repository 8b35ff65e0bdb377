//! Real sensor bytes: every telegram and frame of the recordings comes out, and nothing else does.
//!
//! The folder is named by the environment variable `CROSSFALL_RECORDINGS`; without it these tests say that they skip.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use crossfall_core::protocol::DeviceTime;
use crossfall_core::protocol::message::LineCounters;
use crossfall_core::sensors::lms2xx::range::{Measure, Reader};
use crossfall_core::sensors::lms2xx::{self, Reply};
use crossfall_core::sensors::novatel::{self, Log, Quality, id};

/// The recordings, or none with a word on stderr.
fn recordings() -> Option<PathBuf> {
    let folder = std::env::var_os("CROSSFALL_RECORDINGS").map(PathBuf::from);
    if folder.is_none() {
        eprintln!("SKIPPED: CROSSFALL_RECORDINGS does not name the folder of recordings");
    }
    folder
}

fn read(path: &Path) -> Vec<u8> {
    std::fs::read(path).unwrap_or_else(|error| panic!("{}: {error}", path.display()))
}

/// One byte every 20 us, as at 500 kbaud: the arrival of byte `i`.
fn arrival(i: usize) -> DeviceTime {
    DeviceTime(1_000_000 + 20 * i as u64)
}

fn offset(at: DeviceTime) -> usize {
    (at.0 as usize - 1_000_000) / 20
}

/// Offset and command of every telegram that the decoder finds, and its counters at the end.
fn telegrams(bytes: &[u8]) -> (Vec<(usize, u8)>, LineCounters) {
    let mut decoder = lms2xx::Decoder::new(6);
    let mut found = Vec::new();
    for (i, &byte) in bytes.iter().enumerate() {
        decoder.push(byte, arrival(i), &mut |event| match event {
            lms2xx::Event::Scan { scan, .. } => found.push((offset(scan.stx), 0xb0)),
            lms2xx::Event::Reply { stx, .. } => found.push((offset(stx), bytes[offset(stx) + 4])),
            lms2xx::Event::Ack(_) | lms2xx::Event::Nak(_) => panic!("no ACK or NAK was recorded"),
        });
    }
    (found, decoder.counters())
}

#[test]
fn every_recorded_telegram_is_where_its_index_says() {
    let Some(folder) = recordings() else { return };
    let mut files = 0;
    for entry in std::fs::read_dir(folder.join("lms")).unwrap() {
        let path = entry.unwrap().path();
        if path.extension().is_none_or(|extension| extension != "csv") {
            continue;
        }
        files += 1;
        // host_time,offset,len,cmd
        let index = String::from_utf8(read(&path)).unwrap();
        let expected: Vec<(usize, u8)> = index
            .lines()
            .skip(1)
            .map(|line| {
                let cells: Vec<&str> = line.split(',').collect();
                let command = u8::from_str_radix(cells[3].trim_start_matches("0x"), 16).unwrap();
                (cells[1].parse().unwrap(), command)
            })
            .collect();
        let bytes = read(&path.with_extension("bin"));
        let (found, counters) = telegrams(&bytes);
        assert_eq!(found, expected, "{}", path.display());
        let all = LineCounters { bytes: bytes.len() as u64, frames: expected.len() as u32, ..LineCounters::default() };
        assert_eq!(counters, all, "{}: nothing bad, nothing skipped", path.display());
    }
    assert_eq!(files, 5);
}

#[test]
fn recorded_scans_are_read_in_the_mode_that_the_scanner_reported() {
    let Some(folder) = recordings() else { return };
    let bytes = read(&folder.join("lms/lms200_2017_Aug_05_18_52_56.bin"));
    let mut decoder = lms2xx::Decoder::new(6);
    let (mut scans, mut reports, mut ranges) = (0, 0, 0);
    for (i, &byte) in bytes.iter().enumerate() {
        decoder.push(byte, arrival(i), &mut |event| match event {
            lms2xx::Event::Scan { scan, missing } => {
                assert_eq!((scan.index, missing, scan.beams()), (scans, 0, 361));
                // An LMS 200 set to millimetres, fields A and B: 14 bits.
                assert_eq!((scan.mode.span_deg, scan.mode.step_cdeg, scan.mode.measuring), (180, 50, 4));
                assert_eq!((scan.unit_um(), scan.partial(), scan.counters), (1_000, None, None));
                let reader = Reader::of(scan);
                for &value in scan.ranges() {
                    match reader.measure(value) {
                        // An indoor scene, ranges below the 8 m that this scanner is made for or so.
                        Measure::Range(um) => {
                            assert!(um < 16_374_000);
                            ranges += 1;
                        }
                        Measure::Special(_) => {}
                    }
                }
                scans += 1;
            }
            lms2xx::Event::Reply { reply: Reply::Report(report), .. } => {
                assert_eq!(report.baud(), Some(38_400));
                assert_eq!((report.motor_us, report.defect), (148, 1));
                assert_eq!((report.measuring_mode, report.unit), (4, 1));
                assert_eq!((report.span_deg, report.step_cdeg), (180, 50));
                reports += 1;
            }
            lms2xx::Event::Reply { reply: Reply::Configuration(configuration), .. }
            | lms2xx::Event::Reply { reply: Reply::Configured { configuration, .. }, .. } => {
                assert_eq!((configuration.measuring_mode(), configuration.unit()), (4, 1));
                assert!(!configuration.indices());
            }
            lms2xx::Event::Reply { reply: Reply::Type(text), .. } => assert_eq!(text, b"LMS200;S18063;V02.19 "),
            _ => {}
        });
    }
    assert_eq!((scans, reports), (165, 2));
    assert!(ranges > 50_000, "{ranges} ranges in {scans} scans");
}

#[test]
fn the_single_scan_of_an_lms_291_carries_its_field_bits() {
    let Some(folder) = recordings() else { return };
    let bytes = read(&folder.join("lms/lms291_single_scan.bin"));
    let mut decoder = lms2xx::Decoder::new(0);
    let mut scans = 0;
    for (i, &byte) in bytes.iter().enumerate() {
        decoder.push(byte, arrival(i), &mut |event| {
            let lms2xx::Event::Scan { scan, .. } = event else { panic!("{event:?}") };
            let reader = Reader::of(scan);
            // First value 08CBh, last 0518h: 2.251 and 1.304 m; 22B1h is 0.689 m inside field A.
            assert_eq!(scan.ranges().first().map(|&v| reader.measure(v)), Some(Measure::Range(2_251_000)));
            assert_eq!(scan.ranges().last().map(|&v| reader.measure(v)), Some(Measure::Range(1_304_000)));
            let inside = reader.read(0x22b1);
            assert!(scan.ranges().contains(&0x22b1));
            assert_eq!((inside.measure, inside.fields.a, inside.fields.b), (Measure::Range(689_000), true, false));
            scans += 1;
        });
    }
    assert_eq!(scans, 1);
}

/// Frames of every message number, whatever is between them, and the counters at the end.
fn frames(bytes: &[u8], mut each: impl FnMut(&novatel::Event<'_>)) -> (BTreeMap<u16, u32>, novatel::Decoder) {
    let mut decoder = novatel::Decoder::new();
    let mut found = BTreeMap::new();
    for (i, &byte) in bytes.iter().enumerate() {
        decoder.push(byte, arrival(i), &mut |event| {
            *found.entry(event.header.id).or_default() += 1;
            each(&event);
        });
    }
    (found, decoder)
}

/// Bytes of the receiver's prompts, `\r\n<OK\r\n[COM1]` and the like, which are all that stands between the frames.
fn prompts(bytes: &[u8], prompt: &[u8]) -> u64 {
    (bytes.windows(prompt.len()).filter(|window| *window == prompt).count() * prompt.len()) as u64
}

#[test]
fn every_recorded_frame_and_nothing_but_prompts_between_them() {
    let Some(folder) = recordings() else { return };
    type Counts = &'static [(u16, u32)];
    let files: [(&str, &[u8], Counts); 4] = [
        ("bestpos.gps", b"\r\n<OK\r\n[COM1]", &[(42, 5), (99, 5), (508, 10), (726, 2), (1163, 2), (1465, 2)]),
        ("ins1.gps", b"\r\n<OK\r\n[COM1]", &[(508, 243), (1945, 2), (2051, 29), (2264, 10)]),
        ("ins2.gps", b"\r\n<OK\r\n[COM1]", &[(508, 62), (1362, 766), (1465, 6), (1945, 1)]),
        (
            "propak6_inspvax_20hz.bin",
            b"\r\n<OK\r\n[ICOM1]",
            &[(42, 2288), (101, 115), (264, 115), (812, 2289), (1465, 2289)],
        ),
    ];
    for (name, prompt, expected) in files {
        let bytes = read(&folder.join("novatel").join(name));
        let (found, decoder) = frames(&bytes, |event| {
            assert!(!matches!(event.log, Log::BadField(_)), "{name}: {event:?}");
        });
        let counters = decoder.counters();
        assert_eq!(found, expected.iter().copied().collect(), "{name}");
        assert_eq!((counters.bad_frames, decoder.bad_fields(), decoder.pending()), (0, 0, 0), "{name}");
        assert_eq!(counters.bytes, bytes.len() as u64, "{name}");
        assert_eq!(counters.skipped, prompts(&bytes, prompt), "{name}: what is skipped is prompts");
    }
}

#[test]
fn the_moving_recording_has_a_plausible_pose_twenty_times_a_second() {
    let Some(folder) = recordings() else { return };
    let bytes = read(&folder.join("novatel/propak6_inspvax_20hz.bin"));
    let (mut poses, mut last, mut least, mut most) = (0, None, i64::MAX, i64::MIN);
    frames(&bytes, |event| {
        let Log::Solution(solution, detail) = &event.log else { return };
        assert_eq!(event.header.id, id::INSPVAX);
        assert!(detail.is_some() && solution.fix.is_some());
        let roll = i64::from(solution.roll.to_microdegrees());
        (least, most) = (least.min(roll), most.max(roll));
        if let Some(last) = last.replace(solution.gps_time()) {
            assert_eq!(solution.gps_time().since(last), 50_000);
        }
        assert_ne!(solution.quality(), Quality::Unusable);
        poses += 1;
    });
    assert_eq!(poses, 2289);
    // The recording's own description: roll from -2.63 to 3.06 degrees.
    assert_eq!((least / 10_000, most / 10_000), (-263, 306));
}

#[test]
fn the_manuals_examples_to_the_last_digit() {
    let Some(folder) = recordings() else { return };
    let example = |name: &str| read(&folder.join("novatel/manual_examples").join(name));
    let microdegrees = |solution: &novatel::InsSolution| {
        [solution.roll, solution.pitch, solution.azimuth].map(|angle| angle.to_microdegrees())
    };
    for name in ["INSPVAS_508.bin", "INSPVA_507.bin"] {
        let (found, _) = frames(&example(name), |event| {
            let Log::Solution(solution, None) = &event.log else { panic!("{event:?}") };
            let fix = solution.fix.unwrap();
            assert_eq!((solution.week, solution.gps_us, solution.status), (2209, 490_712_000_000, 3));
            // 51.15043713712, -114.03067872932, 1080.3580; .0014, -.0007, .0015; -.293782412, .302470613, 157.989827209
            assert_eq!(fix.latitude_ndeg, 51_150_437_137);
            assert_eq!(fix.longitude_ndeg, -114_030_678_729);
            assert_eq!(fix.height_mm, 1_080_358);
            assert_eq!(fix.velocity_mm_s, [1, -1, 2]);
            assert_eq!(microdegrees(solution), [-293_782, 302_471, 157_989_827]);
        });
        assert_eq!(found.values().sum::<u32>(), 1);
    }
    for name in ["INSATTS_319.bin", "INSATT_263.bin"] {
        let (found, _) = frames(&example(name), |event| {
            let Log::Solution(solution, None) = &event.log else { panic!("{event:?}") };
            assert_eq!((solution.week, solution.gps_us), (2209, 490_065_000_000));
            assert_eq!((solution.fix, solution.quality()), (None, Quality::Good));
            assert_eq!(microdegrees(solution), [-316_597, 329_117, 158_038_476]);
        });
        assert_eq!(found.values().sum::<u32>(), 1);
    }
    for name in ["RAWIMUS_325.bin", "RAWIMU_268.bin"] {
        let (found, _) = frames(&example(name), |event| {
            let Log::RawImu(raw) = &event.log else { panic!("{event:?}") };
            assert_eq!((raw.time.week, raw.time.us), (2209, 491_612_253_588));
            assert_eq!(raw.acceleration, [4_410_363, -2_512_321, 329_303_960]);
            assert_eq!(raw.rotation, [-1_009_773, 607_017, 309_705]);
            assert_eq!(raw.status, 16_669_418);
        });
        assert_eq!(found.values().sum::<u32>(), 1);
    }
    let (found, _) = frames(&example("TIME_101.bin"), |event| {
        let Log::Time(time) = &event.log else { panic!("{event:?}") };
        assert_eq!((time.time.week, time.time.us), (2209, 515_163_000_000));
        assert_eq!((time.year, time.month, time.day, time.hour, time.minute, time.ms), (2022, 5, 13, 23, 5, 45_000));
        assert_eq!((time.utc_offset_us, time.utc_status, time.clock_status), (-18_000_000, 1, 0));
    });
    assert_eq!(found.values().sum::<u32>(), 1);
}

#[test]
fn a_unit_that_aligns_tells_where_it_is_and_not_how_it_is_turned() {
    let Some(folder) = recordings() else { return };
    let bytes = read(&folder.join("novatel/bestpos.gps"));
    let (mut aligning, mut aligned) = (Vec::new(), Vec::new());
    frames(&bytes, |event| {
        let (Log::Solution(solution, _), id::INSPVAS) = (&event.log, event.header.id) else { return };
        match solution.quality() {
            Quality::Aligning => aligning.push(*solution),
            _ => aligned.push(*solution),
        }
    });
    assert_eq!((aligning.len(), aligned.len()), (2, 8));
    let there = aligned[0].fix.unwrap();
    // At first no angle at all, then a rough level; no azimuth before the end.
    assert_eq!([aligning[0].roll, aligning[0].pitch].map(|angle| angle.0), [0; 2]);
    for solution in aligning {
        assert_eq!(solution.azimuth.0, 0);
        let fix = solution.fix.unwrap();
        // Within a metre or two: 10,000 ndeg of latitude are 1.1 m.
        assert!((fix.latitude_ndeg - there.latitude_ndeg).abs() < 10_000, "{fix:?} {there:?}");
        assert!((fix.longitude_ndeg - there.longitude_ndeg).abs() < 20_000, "{fix:?} {there:?}");
        assert!(fix.velocity_mm_s.iter().all(|mm_s| mm_s.abs() < 100), "{fix:?}");
    }
}
