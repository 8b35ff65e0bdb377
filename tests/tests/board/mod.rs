//! What the tests of the emulated board share: the example capture at half its rates, and the board's log.
#![allow(dead_code, reason = "each test file uses its own part")]

use std::path::Path;
use std::time::Duration;

use crossfall::capture::{self, Channel, Chunk};
use crossfall::log;
use crossfall::simulate::scene::Scene;
use crossfall::simulate::{self, truth};
use crossfall_core::protocol::message::Status;
use crossfall_tests::emulator::{Emulator, Image, Options, Step, at_line_rates, every_second, half_the_scans, image};
use crossfall_tests::lms_emulator::{Mode, Scanner};

/// First bytes of a scan's telegram of 361 values without indices (TL, B0h) and of a short NovAtel header.
const TELEGRAM: &[u8] = &[0x02, 0x80, 0xd6, 0x02, 0xb0];
const SHORT_HEADER: &[u8] = &[0xaa, 0x44, 0x13];

/// The example capture with every second scan and pose: 18.8 scans and 50 poses a second.
pub fn half_rate_drive(folder: &Path) -> Vec<Chunk> {
    let all: Vec<Chunk> =
        capture::Reader::open(&folder.join("example.mcap")).expect("the capture").map(|c| c.expect("whole")).collect();
    let mut drive = every_second(&all, Channel::Lidar, TELEGRAM);
    drive.extend(every_second(&all, Channel::Ins, SHORT_HEADER));
    drive.extend(all.iter().filter(|chunk| chunk.channel == Channel::Pps).cloned());
    drive.sort_by_key(|chunk| chunk.device_time_ns);
    drive
}

/// A simulated drive as the emulator's lines carry it - 18.8 scans and 50 poses a second -, and its truth, a row for each of these scans.
pub fn simulated_drive(folder: &Path, seconds: f64) -> (Vec<Chunk>, Vec<truth::Row>) {
    let mut scene = Scene::default();
    scene.drive.seconds = seconds;
    at_line_rates(&mut scene);
    let path = folder.join("drive.mcap");
    let mut writer = capture::Writer::create(&path).expect("a capture");
    let made = simulate::simulate(&scene, &mut writer, |_| ()).expect("a drive");
    writer.finish().expect("a capture");
    let all = capture::Reader::open(&path).expect("the capture").map(|chunk| chunk.expect("whole"));
    (half_the_scans(all).collect(), made.truth.into_iter().step_by(2).collect())
}

/// Poses among the inertial unit's frames: all but the time.
pub fn poses(drive: &[Chunk]) -> usize {
    drive.iter().filter(|chunk| chunk.channel == Channel::Ins && chunk.data.starts_with(SHORT_HEADER)).count()
}

/// A board that has been switched on and has brought its scanner up; it is told so with the first scan that is played.
pub fn running_board() -> (Emulator, Scanner) {
    let mut board = Emulator::start(&image(Image::Board), &Options::default()).expect("a board");
    let mut scanner = Scanner::waiting_at(9_600);
    scanner.holds_start = true;
    let up = board.converse(&mut scanner, Duration::from_secs(60), |scanner| scanner.mode == Mode::Continuous);
    assert!(up.expect("a running board"), "the bring-up got as far as {:x?}", scanner.understood);
    (board, scanner)
}

/// Half a second without anything, in which what is under way arrives.
pub fn rest(after: &[Chunk]) -> Step<'static> {
    let end = after.last().map_or(0, |chunk| chunk.device_time_ns);
    Step::Do(end + 500_000_000, Box::new(|_, _| Ok(())))
}

/// Stops the survey; the status after that, which counts everything.
pub fn stop(board: &mut Emulator) -> Status {
    board.stop(Duration::from_secs(60)).expect("the survey stops")
}

/// Everything that the board has sent, as a log.
pub fn write_log(board: &Emulator, path: &Path) {
    let mut log = log::Writer::create(path).expect("a log");
    for (n, frame) in board.link.frames().iter().enumerate() {
        log.frame(n as u64 * 1_000_000, frame).expect("room on the disk");
    }
    log.finish().expect("a whole log");
}
