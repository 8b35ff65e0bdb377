//! What `crossfall demo --device emulated` rests on: a drive from power-on to a whole log in one call, and an emulator that is never left behind.

mod board;

use std::fs;
use std::io::{BufRead, BufReader};
use std::path::Path;
use std::process::{Command, Stdio};
use std::thread;
use std::time::{Duration, Instant};

use crossfall::{counters, emulated, log, verify};
use crossfall_core::protocol::Config;
use crossfall_core::protocol::config::Method;
use crossfall_tests::emulator::{Emulator, Image, Options, image};

/// Names the image that the test's second self is to boot.
const CHILD: &str = "CROSSFALL_TEST_IMAGE";

#[test]
fn a_drive_goes_from_power_on_to_a_log_that_verifies() {
    let scratch = tempfile::tempdir().expect("a scratch folder");
    let (drive, truth) = board::simulated_drive(scratch.path(), 4.0);
    let path = scratch.path().join("board.mcap");
    let mut config = Config::default();
    config.survey.method = Method::Seed;
    let mut writer = log::Writer::create(&path).expect("a log");
    let mut reached = 0;
    let surveyed = emulated::survey(&image(Image::Board), drive, &config, &mut writer, |us| reached = us);
    let surveyed = surveyed.expect("a drive");
    writer.finish().expect("a whole log");
    assert_eq!((surveyed.missing_frames, surveyed.rejected), (0, 0));
    assert!(counters::losses(&surveyed.status).is_empty(), "{:?}", surveyed.status);
    assert_eq!(surveyed.status.scans as usize, truth.len());
    assert!(reached > 4_000_000, "{reached} us");
    let report = verify::verify(&path, |_| ()).expect("a readable log");
    assert_eq!(report.problems, []);
    assert_eq!((report.profiles, report.profiles_reproduced), (truth.len() as u64, truth.len() as u64));
}

#[test]
fn what_is_missing_is_named() {
    let nowhere = emulated::find_image(Some(Path::new("nowhere.elf"))).expect_err("no such file");
    assert!(nowhere.to_string().starts_with("nowhere.elf: no such file"), "{nowhere}");
    emulated::require_qemu().expect("QEMU, which `cargo xtask setup` installs");
}

/// Whether any process was started with this path.
#[cfg(target_os = "linux")]
fn runs(path: &Path) -> bool {
    let path = path.to_str().expect("text").as_bytes();
    let names = |entry: &fs::DirEntry| {
        let line = fs::read(entry.path().join("cmdline")).unwrap_or_default();
        line.split(|&byte| byte == 0).any(|word| word == path)
    };
    fs::read_dir("/proc").expect("processes").flatten().any(|entry| names(&entry))
}

#[cfg(target_os = "linux")]
#[test]
fn an_emulator_does_not_outlive_a_killed_parent() {
    if let Some(path) = std::env::var_os(CHILD) {
        let _board = Emulator::start(Path::new(&path), &Options::default()).expect("a board");
        println!("\nstarted");
        thread::sleep(Duration::from_secs(120));
        return;
    }
    let scratch = tempfile::tempdir().expect("a scratch folder");
    let path = scratch.path().join("board.elf");
    fs::copy(image(Image::Board), &path).expect("a copy of the image");
    let mut child = Command::new(std::env::current_exe().expect("this test"))
        .args(["--exact", "an_emulator_does_not_outlive_a_killed_parent", "--nocapture"])
        .env(CHILD, &path)
        .stdout(Stdio::piped())
        .spawn()
        .expect("this test once more");
    let output = BufReader::new(child.stdout.take().expect("piped"));
    assert!(output.lines().map_while(Result::ok).any(|line| line == "started"), "the board did not start");
    assert!(runs(&path));
    child.kill().expect("a running child");
    child.wait().expect("a child");
    let deadline = Instant::now() + Duration::from_secs(30);
    while runs(&path) {
        assert!(Instant::now() < deadline, "QEMU is still there");
        thread::sleep(Duration::from_millis(20));
    }
}
