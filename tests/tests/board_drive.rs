//! A drive through the emulated board: from power-on over the bring-up to profiles that verify bit for bit.

use std::collections::HashMap;
use std::path::Path;
use std::time::Duration;

use crossfall::capture::{self, Channel, Chunk};
use crossfall::{log, profiles, verify};
use crossfall_core::protocol::message::{Command, Message, Session, Status};
use crossfall_tests::emulator::drive::every_second;
use crossfall_tests::emulator::{Emulator, Image, Options, image};
use crossfall_tests::lms_emulator::{Mode, Scanner};
use crossfall_tests::recordings;

const TELEGRAM: &[u8] = &[0x02, 0x80, 0xd6, 0x02, 0xb0];

/// The example capture at half its rates: 18.8 scans and 50 poses a second.
fn half_rate_drive(folder: &Path) -> Vec<Chunk> {
    let all: Vec<Chunk> =
        capture::Reader::open(&folder.join("example.mcap")).expect("the capture").map(|c| c.expect("whole")).collect();
    let mut drive = every_second(&all, Channel::Lidar, TELEGRAM);
    drive.extend(every_second(&all, Channel::Ins, &[0xaa, 0x44, 0x13]));
    drive.extend(all.iter().filter(|chunk| chunk.channel == Channel::Pps).cloned());
    drive.sort_by_key(|chunk| chunk.device_time_ns);
    drive
}

fn write_log(board: &Emulator, path: &Path) {
    let mut log = log::Writer::create(path).expect("a log");
    for (n, frame) in board.link.frames().iter().enumerate() {
        log.frame(n as u64 * 1_000_000, frame).expect("room on the disk");
    }
    log.finish().expect("a whole log");
}

#[test]
fn a_drive_at_half_rate_loses_nothing_and_verifies() {
    let Some(folder) = recordings("capture") else { return };
    let mut board = Emulator::start(&image(Image::Board), &Options::default()).expect("a board");
    let mut scanner = Scanner::waiting_at(9_600);
    let up = board.converse(&mut scanner, Duration::from_secs(20), |scanner| scanner.mode == Mode::Continuous);
    assert!(up.expect("a running board"), "bring-up got as far as {:?}", scanner.understood);

    let drive = half_rate_drive(&folder);
    let sent = |channel| drive.iter().filter(|chunk| chunk.channel == channel).count();
    let (scans, poses, pulses) = (sent(Channel::Lidar), sent(Channel::Ins), sent(Channel::Pps));
    let late = board.play(drive.iter().cloned()).expect("a running board");
    println!("{scans} scans, {poses} poses, {pulses} pulses; the host was {late:?} late at most");

    board.command(&Command::Stop).expect("a running board");
    let stopped = |message: &Message<'_>| matches!(message, Message::Session(Session::Stopped(_))).then_some(());
    let (at, ()) = board.link.wait_for(0, Duration::from_secs(5), stopped).expect("the survey stops");
    // The status of the next second counts everything.
    let status = |message: &Message<'_>| if let Message::Status(status) = message { Some(*status) } else { None };
    let (_, status): (_, Status) = board.link.wait_for(at, Duration::from_secs(3), status).expect("a status");
    println!("{status:?}");
    assert_eq!(board.link.losses(), (0, 0));
    assert_eq!(board.link.counters().rejected(), 0);
    assert_eq!(status.scans as usize, scans);
    assert_eq!(
        (status.scans_missing, status.scans_skipped, status.lidar.overruns, status.lidar.bad_frames),
        (0, 0, 0, 0)
    );
    assert_eq!(status.poses as usize, poses);
    assert_eq!((status.ins.overruns, status.ins.bad_frames, status.frames_dropped), (0, 0, 0));
    assert_eq!((status.pulses as usize, status.pulses_spurious, status.pulses_overrun), (pulses, 0, 0));

    let scratch = tempfile::tempdir().expect("a scratch folder");
    let path = scratch.path().join("board.mcap");
    write_log(&board, &path);
    let report = verify::verify(&path, |_| ()).expect("a readable log");
    assert_eq!(report.problems, []);
    assert_eq!((report.profiles as usize, report.profiles_reproduced as usize), (scans, scans));
    compare(&path, &folder);

    let (used, size) = board.stack().expect("a running board");
    println!("stack: {used} of {size} bytes used at most");
}

/// Slopes against the truth: as in process, where the same capture stays below 0.07 degrees.
fn compare(log: &Path, folder: &Path) {
    let mut table = csv::Reader::from_path(folder.join("example.truth.csv")).expect("the truth beside the capture");
    let headers = table.headers().expect("a header").clone();
    let truth: Vec<HashMap<String, f64>> = table
        .records()
        .map(|record| {
            let record = record.expect("a row");
            headers.iter().zip(&record).filter_map(|(name, cell)| Some((name.to_owned(), cell.parse().ok()?))).collect()
        })
        .collect();
    let mut errors: HashMap<&str, Vec<f64>> = HashMap::new();
    let mut rows = 0;
    for row in profiles::Rows::open(log).expect("a readable log").filter(|row| row.left) {
        // Every second scan was played.
        let truth = &truth[row.scan as usize * 2];
        rows += 1;
        for (name, found) in [("adjacent_deg", row.adjacent), ("opposing_deg", row.opposing)] {
            if let Some(slope) = found {
                errors.entry(name).or_default().push(slope.slope_deg - truth[name]);
            }
        }
    }
    for (name, errors) in errors {
        let rms = (errors.iter().map(|e| e * e).sum::<f64>() / errors.len() as f64).sqrt();
        println!("{name}: {} of {rows} found, RMS {rms:.4} degrees", errors.len());
        assert!(errors.len() * 100 >= rows * 98 && rms < 0.08, "{name}: {} of {rows}, {rms}", errors.len());
    }
}
