//! A drive through the emulated board: from power-on over the bring-up to profiles that verify bit for bit and are as accurate as in process.

mod board;

use std::collections::HashMap;
use std::path::Path;

use crossfall::capture::Channel;
use crossfall::profiles::{Row, Rows};
use crossfall::side::Side;
use crossfall::{capture, verify};
use crossfall_core::protocol::message::Message;
use crossfall_tests::drives;
use crossfall_tests::emulator::{Image, Step, image, ram_used, told};

/// Seconds of the drive; a minute with `cargo xtask test --long`.
const SECONDS: (f64, f64) = (15.0, 60.0);

/// The vehicle rolls no faster (default scene: two oscillations, 1.2 degrees at 0.8 Hz and 0.25 at 1.9 Hz).
const ROLL_RATE_DEG_S: f64 = 1.2 * 0.8 * 6.284 + 0.25 * 1.9 * 6.284;

/// What static RAM and the stack may come to together (docs/hardware.md).
const RAM_AND_STACK: u32 = 64 * 1024;

#[test]
fn a_drive_at_half_rate_loses_nothing_verifies_and_is_as_accurate_as_in_process() {
    let seconds = if std::env::var_os("CROSSFALL_LONG").is_some() { SECONDS.1 } else { SECONDS.0 };
    let scratch = tempfile::tempdir().expect("a scratch folder");
    let (drive, _truth) = board::simulated_drive(scratch.path(), seconds);
    let sent = |channel| drive.iter().filter(|chunk| chunk.channel == channel).count();
    let (scans, poses, pulses) = (sent(Channel::Lidar), board::poses(&drive), sent(Channel::Pps));

    let (mut board, mut scanner) = board::running_board();
    let counter = board.monitor.counter().expect("a running board");
    let rest = board::rest(&drive);
    let steps = drive.iter().cloned().map(Step::Bytes).chain([rest]);
    let played = board.play(&mut scanner, steps, |_| ()).expect("a running board");
    println!("{scans} scans, {poses} poses, {pulses} pulses; the host was {:?} late at most", played.latest);
    let after = board.monitor.counter().expect("a running board");
    assert!(counter > after, "the counter has not wrapped: {counter} at the start, {after} at the end");

    let status = board::stop(&mut board);
    println!("{status:?}");
    for (time, text) in told(&board) {
        println!("{:>10} {text}", time.0);
    }
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

    let path = scratch.path().join("board.mcap");
    board::write_log(&board, &path);
    let report = verify::verify(&path, |_| ()).expect("a readable log");
    assert_eq!(report.problems, []);
    assert_eq!((report.profiles as usize, report.profiles_reproduced as usize), (scans, scans));

    // Device time of the board less that of the capture: what the pulses say, which have no software in them.
    let offsets: Vec<i64> = board
        .link
        .collect(|message| if let Message::Pulse(pulse) = message { Some(pulse.time) } else { None })
        .iter()
        .zip(drive.iter().filter(|chunk| chunk.channel == Channel::Pps))
        .map(|(time, chunk)| time.0 as i64 - (chunk.device_time_ns / 1_000) as i64)
        .collect();
    let offset = offsets[0];
    // The capture's edges are cut to microseconds twice, before and after the drive's start is taken off.
    assert!(offsets.iter().all(|other| (other - offset).abs() <= 1), "pulses wander: {offsets:?}");
    compare(&path, &in_process(scratch.path(), &drive), offset);

    let (used, size) = board.stack().expect("a running board");
    let ram = ram_used(&image(Image::Board));
    println!("stack: {used} of {size} bytes used at most; static RAM: {ram} bytes; together {}", used + ram);
    assert!(used + ram <= RAM_AND_STACK, "{used} bytes of stack and {ram} of RAM");
}

/// The same bytes through the core alone.
fn in_process(folder: &Path, drive: &[capture::Chunk]) -> std::path::PathBuf {
    let (capture_path, log_path) = (folder.join("half.mcap"), folder.join("half.log.mcap"));
    let mut writer = capture::Writer::create(&capture_path).expect("a capture");
    for chunk in drive {
        writer.write(chunk.channel, chunk.device_time_ns, &chunk.data).expect("room on the disk");
    }
    writer.finish().expect("a capture");
    drives::log(&capture_path, &log_path);
    log_path
}

/// Every slope against the same scan's in process. They differ by what the vehicle rolled while the host was late with the telegram, which the
/// board's stamps tell exactly, and by no more: however busy the host is, the board's part of the accuracy is judged alone.
fn compare(board: &Path, in_process: &Path, offset_us: i64) {
    let rows = |path: &Path| -> HashMap<(u64, Side), Row> {
        Rows::open(path).expect("a readable log").map(|row| ((u64::from(row.scan), row.side), row)).collect()
    };
    let (board, in_process) = (rows(board), rows(in_process));
    assert_eq!(board.len(), in_process.len());
    let (mut compared, mut punctual, mut regrouped, mut squares, mut latest_us) = (0, 0, 0, 0.0_f64, 0);
    for (key, ours) in &in_process {
        let theirs = &board[key];
        let late_us = theirs.time.0 as i64 - offset_us - ours.time.0 as i64;
        assert!(late_us >= -50, "scan {}: {late_us} us too early", key.0);
        latest_us = latest_us.max(late_us);
        let rolled_deg = ROLL_RATE_DEG_S * late_us.unsigned_abs() as f64 * 1e-6;
        for (ours, theirs) in [(ours.adjacent, theirs.adjacent), (ours.opposing, theirs.opposing)] {
            let (Some(ours), Some(theirs)) = (ours, theirs) else { continue };
            let difference = theirs.slope_deg - ours.slope_deg;
            compared += 1;
            // Another roll may put another return on a slope or off it, of fifteen on a short one: rare, and two estimates of one slope still agree
            // as their intervals say, by the root of the sum of their squares.
            let intervals = ours.ci95_deg.unwrap_or(0.0).hypot(theirs.ci95_deg.unwrap_or(0.0));
            assert!(
                difference.abs() <= intervals + rolled_deg,
                "scan {}: {difference:.4} degrees from the same scan's in process, {late_us} us late",
                key.0
            );
            if difference.abs() > 0.005 + rolled_deg {
                regrouped += 1;
            } else if late_us.abs() < 500 {
                punctual += 1;
                squares += difference * difference;
            }
        }
    }
    let rms = (squares / f64::from(punctual.max(1))).sqrt();
    println!(
        "{compared} slopes; {punctual} of telegrams on time, {rms:.5} degrees RMS from those in process; {regrouped} on other returns; {latest_us} us late at worst"
    );
    assert!(regrouped * 50 <= compared, "{regrouped} of {compared} slopes differ by more than the roll");
    assert!(punctual < 50 || rms < 0.005, "{rms} degrees RMS of telegrams on time");
    assert!(compared as usize * 100 >= in_process.len() * 2 * 98, "{compared} of {} slopes", in_process.len() * 2);
}
