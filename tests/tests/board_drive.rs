//! A drive through the emulated board: from power-on over the bring-up to profiles that verify bit for bit.

mod board;

use std::collections::HashMap;
use std::path::Path;
use std::time::Duration;

use crossfall::capture::Channel;
use crossfall::{profiles, verify};
use crossfall_tests::emulator::Step;
use crossfall_tests::recordings;

#[test]
fn a_drive_at_half_rate_loses_nothing_and_verifies() {
    let Some(folder) = recordings("capture") else { return };
    let (mut board, mut scanner) = board::running_board();
    let drive = board::half_rate_drive(&folder);
    let sent = |channel| drive.iter().filter(|chunk| chunk.channel == channel).count();
    let (scans, poses, pulses) = (sent(Channel::Lidar), sent(Channel::Ins), sent(Channel::Pps));
    let rest = board::rest(&drive);
    let played =
        board.play(&mut scanner, drive.into_iter().map(Step::Bytes).chain([rest]), |_| ()).expect("a running board");
    println!("{scans} scans, {poses} poses, {pulses} pulses; the host was {:?} late at most", played.latest);

    let status = board::stop(&mut board);
    println!("{status:?}");
    for (time, text) in board::told(&board) {
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

    let scratch = tempfile::tempdir().expect("a scratch folder");
    let path = scratch.path().join("board.mcap");
    board::write_log(&board, &path);
    let report = verify::verify(&path, |_| ()).expect("a readable log");
    assert_eq!(report.problems, []);
    assert_eq!((report.profiles as usize, report.profiles_reproduced as usize), (scans, scans));
    compare(&path, &folder, played.latest);

    let (used, size) = board.stack().expect("a running board");
    println!("stack: {used} of {size} bytes used at most");
}

/// Slopes against the truth: as in process, where the same capture's median error is 0.03 degrees.
fn compare(log: &Path, folder: &Path, latest: Duration) {
    // A telegram that the host's scheduling delays is levelled with the roll of a later instant: the drive rolls at up to 7.5 degrees a second.
    let limit_deg = 0.04 + 7.5 * latest.as_secs_f64();
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
    for (name, mut errors) in errors {
        errors.sort_by(|a, b| a.abs().total_cmp(&b.abs()));
        let rms = (errors.iter().map(|e| e * e).sum::<f64>() / errors.len() as f64).sqrt();
        let median = errors[errors.len() / 2].abs();
        println!("{name}: {} of {rows} found, median {median:.4}, RMS {rms:.4} degrees", errors.len());
        assert!(errors.len() * 100 >= rows * 98 && median < limit_deg, "{name}: {} of {rows}, {median}", errors.len());
    }
}
