//! Recording from a board that is a thread here: what it sends is what is logged, and what is lost on the way is told exactly.

mod program;

use std::fs;
use std::io::{Read, Write};
use std::net::{TcpListener, TcpStream};
use std::path::Path;
use std::process::Command;
use std::sync::OnceLock;
use std::thread;
use std::time::{Duration, Instant};

use crossfall::record::{Device, Notice, Port, Summary, record};
use crossfall::{log, verify};
use crossfall_core::protocol::frame::{BoardDecoder, Event};
use crossfall_core::protocol::message;
use program::crossfall;

/// No test takes as long unless it fails.
const PATIENCE: Duration = Duration::from_secs(60);

fn frames(path: &Path) -> Vec<Vec<u8>> {
    log::Reader::open(path).unwrap().map(|frame| frame.unwrap().bytes).collect()
}

/// What a board streams in three seconds of a drive.
fn drive() -> &'static [Vec<u8>] {
    static DRIVE: OnceLock<Vec<Vec<u8>>> = OnceLock::new();
    DRIVE.get_or_init(|| {
        let folder = tempfile::tempdir().unwrap();
        for arguments in
            [&["simulate", "--seconds", "3", "-o", "drive.mcap"][..], &["run", "drive.mcap", "-o", "drive.log.mcap"]]
        {
            assert!(crossfall(folder.path(), arguments).output().unwrap().status.success());
        }
        frames(&folder.path().join("drive.log.mcap"))
    })
}

/// The board's end: waits for the host's question, which is all that the host may send.
fn await_identify(port: &mut impl Read) {
    let (mut decoder, mut byte) = (BoardDecoder::new(), [0]);
    loop {
        port.read_exact(&mut byte).unwrap();
        match decoder.next(&mut byte.as_slice()) {
            None => {}
            Some(Event::Frame(frame)) => return assert_eq!(frame.body, message::Command::Identify),
            Some(other) => panic!("{other:?}"),
        }
    }
}

fn accept(listener: &TcpListener) -> TcpStream {
    let (mut port, _) = listener.accept().unwrap();
    await_identify(&mut port);
    port
}

fn listener() -> (TcpListener, Device) {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let device = format!("tcp:{}", listener.local_addr().unwrap()).parse().unwrap();
    (listener, device)
}

/// Records until there are so many frames.
fn record_frames(device: &Device, path: &Path, count: usize) -> (Summary, Vec<Notice>) {
    record_from(device, device.connect().unwrap(), path, count)
}

fn record_from(device: &Device, port: Box<dyn Port>, path: &Path, count: usize) -> (Summary, Vec<Notice>) {
    let mut log = log::Writer::create_live(path).unwrap();
    let mut notices = Vec::new();
    let began = Instant::now();
    let summary = record(
        device,
        port,
        &mut log,
        |notice| notices.push(notice),
        |summary| {
            assert!(began.elapsed() < PATIENCE, "{summary:?}");
            summary.frames < count as u64
        },
    )
    .unwrap();
    log.finish().unwrap();
    (summary, notices)
}

/// Waits until so many frames are in the file, which is being written.
fn await_on_disk(path: &Path, count: usize) {
    let began = Instant::now();
    while log::Reader::open(path).map_or(0, |reader| reader.flatten().count()) < count {
        assert!(began.elapsed() < PATIENCE);
        thread::sleep(Duration::from_millis(20));
    }
}

#[test]
fn a_clean_stream_is_logged_as_it_was_sent() {
    let sent = drive();
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.mcap");
    let (listener, device) = listener();
    let board = thread::spawn(move || {
        let mut port = accept(&listener);
        port.write_all(&sent.concat()).unwrap();
        port
    });
    let (summary, notices) = record_frames(&device, &path, sent.len());
    drop(board.join().unwrap());
    assert!(!summary.lost(), "{summary:?}");
    assert_eq!((summary.profiles, summary.totals.restarts(), summary.reconnects), (112, 0, 0));
    assert!(matches!(&notices[..], [Notice::Board { board, .. }] if board == "in process"), "{notices:?}");
    assert!(frames(&path) == sent);

    let report = verify::verify(&path, |_| ()).unwrap();
    assert!(report.ok, "{:?}", report.problems);
    assert_eq!(report.profiles_reproduced, 112);
    let mut reader = log::Reader::open(&path).unwrap();
    // The configuration's record comes where its frame came: behind the hello.
    assert!(reader.by_ref().all(|frame| frame.is_ok()));
    assert_eq!(reader.metadata()[log::metadata::IDENTITY]["board"], "in process");
    assert!(reader.metadata()[log::metadata::CONFIG]["toml"].contains("[survey"));
}

#[test]
fn a_broken_connection_costs_what_was_lost_with_it_and_no_more() {
    const CUT: usize = 200;
    const BACK: usize = 230;
    let sent = drive();
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.mcap");
    let (listener, device) = listener();
    let half = sent[CUT].len() / 2;
    let board = thread::spawn(move || {
        let mut port = accept(&listener);
        port.write_all(&sent[..CUT].concat()).unwrap();
        port.write_all(&sent[CUT][..half]).unwrap();
        drop(port);
        let mut port = accept(&listener);
        port.write_all(&sent[BACK..].concat()).unwrap();
        port
    });
    let (summary, notices) = record_frames(&device, &path, CUT + 1 + sent.len() - BACK);
    drop(board.join().unwrap());
    let missing = (BACK - CUT) as u64;
    assert!(summary.lost());
    assert_eq!((summary.bad_frames, summary.missing_frames, summary.reconnects), (1, missing, 1));
    assert!(matches!(&notices[..], [Notice::Board { .. }, Notice::Gone { .. }, Notice::Back]), "{notices:?}");
    let expected = [&sent[..CUT], &[sent[CUT][..half].to_vec()], &sent[BACK..]].concat();
    assert!(frames(&path) == expected);

    let report = verify::verify(&path, |_| ()).unwrap();
    assert_eq!((report.bad_frames, report.missing_frames, report.boots), (1, missing, 1));
    let problems: Vec<_> = report.problems.iter().map(|problem| problem.what.as_str()).collect();
    assert_eq!(
        problems,
        [
            format!("broken frame of {half} bytes: the stream ends within a frame"),
            format!("{missing} frames missing before this one")
        ]
    );
    assert_eq!(report.profiles_reproduced + report.profiles_unverifiable, report.profiles);
}

#[test]
fn noise_longer_than_any_frame_is_logged_to_the_last_byte() {
    let sent = drive();
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.mcap");
    let (listener, device) = listener();
    let noise = [vec![0x55; 10_000], vec![0]].concat();
    let stream = [sent[..50].concat(), noise.clone(), sent[50..].concat()].concat();
    let pieces = noise.len().div_ceil(crossfall_core::protocol::frame::MAX_MESSAGE_FRAME);
    let board = thread::spawn({
        let stream = stream.clone();
        move || {
            let mut port = accept(&listener);
            // In writes that end anywhere.
            for part in stream.chunks(997) {
                port.write_all(part).unwrap();
            }
            port
        }
    });
    let (summary, _) = record_frames(&device, &path, sent.len() + pieces);
    drop(board.join().unwrap());
    assert_eq!((summary.bad_frames, summary.missing_frames), (pieces as u64, 0));
    assert!(frames(&path).concat() == stream);
    let report = verify::verify(&path, |_| ()).unwrap();
    assert_eq!((report.bad_frames, report.problem_count), (pieces as u64, pieces as u64), "{:?}", report.problems);
}

#[test]
fn a_board_that_boots_again_is_told_and_goes_on_in_the_same_log() {
    let sent = drive();
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.mcap");
    let (listener, device) = listener();
    let board = thread::spawn(move || {
        let mut port = accept(&listener);
        port.write_all(&sent[..300].concat()).unwrap();
        port.write_all(&sent.concat()).unwrap();
        port
    });
    let (summary, notices) = record_frames(&device, &path, 300 + sent.len());
    drop(board.join().unwrap());
    assert_eq!((summary.lost(), summary.totals.restarts()), (true, 1));
    assert!(matches!(&notices[..], [Notice::Board { .. }, Notice::Restarted { .. }]), "{notices:?}");
    let report = verify::verify(&path, |_| ()).unwrap();
    assert_eq!((report.boots, report.bad_frames, report.missing_frames), (2, 0, 0));
    let mut reader = log::Reader::open(&path).unwrap();
    assert!(reader.by_ref().all(|frame| frame.is_ok()));
    assert_eq!(reader.metadata()[log::metadata::SEGMENT]["number"], "2");
}

#[test]
fn what_cannot_be_recorded_is_told_in_one_line_and_leaves_no_file() {
    let folder = tempfile::tempdir().unwrap();
    let (listener, device) = listener();
    let device = device.to_string();
    drop(listener);
    let fails = |device: &str, expected: &str| {
        let output = crossfall(folder.path(), &["record", "--device", device, "-o", "a.mcap"]).output().unwrap();
        let error = String::from_utf8_lossy(&output.stderr);
        assert_eq!((output.status.code(), error.lines().count()), (Some(1), 1), "{error}");
        assert!(error.starts_with("crossfall: ") && error.contains(expected), "{error}");
    };
    fails(&device, &format!("{device}: cannot connect: "));
    fails("serial:/dev/no-such-port", "serial:/dev/no-such-port@1000000: cannot connect: ");
    assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 0);
    fs::write(folder.path().join("a.mcap"), b"precious").unwrap();
    fails(&device, "a.mcap: exists, and a recording is never written over");
    assert_eq!(fs::read(folder.path().join("a.mcap")).unwrap(), b"precious");
    let usage = crossfall(folder.path(), &["record", "--device", "usb:1", "-o", "b.mcap"]).output().unwrap();
    assert_eq!(usage.status.code(), Some(2));
}

#[cfg(unix)]
#[test]
fn a_signal_ends_the_recording_with_a_whole_log() {
    let sent = drive();
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.mcap");
    let (listener, device) = listener();
    let recorder =
        crossfall(folder.path(), &["record", "--device", &device.to_string(), "-o", "a.mcap"]).spawn().unwrap();
    let mut port = accept(&listener);
    port.write_all(&sent.concat()).unwrap();
    // Although no frame follows.
    await_on_disk(&path, sent.len());
    let killed = Command::new("kill").args(["-TERM", &recorder.id().to_string()]).status().unwrap();
    assert!(killed.success());
    let output = recorder.wait_with_output().unwrap();
    let error = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(0), "{error}");
    assert!(error.contains(&format!("{} frames, 112 profiles, 0 bad, 0 missing, 0 reconnects", sent.len())), "{error}");
    let report = verify::verify(&path, |_| ()).unwrap();
    assert!(report.ok && frames(&path) == sent, "{:?}", report.problems);
}

#[test]
fn a_limit_ends_a_recording_of_nothing_and_says_so() {
    let folder = tempfile::tempdir().unwrap();
    let (listener, device) = listener();
    let recorder =
        crossfall(folder.path(), &["record", "--device", &device.to_string(), "-o", "a.mcap", "--seconds", "1"])
            .spawn()
            .unwrap();
    let port = accept(&listener);
    let output = recorder.wait_with_output().unwrap();
    drop(port);
    let error = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(3), "{error}");
    assert!(error.contains("no frame came"), "{error}");
}

/// A serial port, unplugged and plugged in again: a pseudo terminal behind a name that is moved to another one.
#[cfg(target_os = "linux")]
#[test]
fn a_serial_port_may_be_unplugged() {
    use serialport::{SerialPort, TTYPort};

    /// A new terminal under the name; the board's end of it, once the host has asked.
    fn plug(name: &Path) -> TTYPort {
        let (mut board, host) = TTYPort::pair().unwrap();
        board.set_timeout(PATIENCE).unwrap();
        let _ = fs::remove_file(name);
        std::os::unix::fs::symlink(host.name().unwrap(), name).unwrap();
        // Kept open until the recorder has it: a terminal that nobody has open is hung up.
        await_identify(&mut board);
        drop(host);
        board
    }

    let sent = drive();
    let folder = tempfile::tempdir().unwrap();
    let (path, name) = (folder.path().join("a.mcap"), folder.path().join("ttyBoard"));
    let device: Device = format!("serial:{}@115200", name.display()).parse().unwrap();
    let board = thread::spawn({
        let (path, name) = (path.clone(), name.clone());
        move || {
            let mut port = plug(&name);
            port.write_all(&sent[..100].concat()).unwrap();
            // What a terminal still holds dies with it.
            await_on_disk(&path, 100);
            drop(port);
            let mut port = plug(&name);
            port.write_all(&sent[110..].concat()).unwrap();
            port
        }
    });
    let began = Instant::now();
    let port = loop {
        match device.connect() {
            Ok(port) => break port,
            Err(error) => assert!(began.elapsed() < PATIENCE, "{error}"),
        }
        thread::sleep(Duration::from_millis(5));
    };
    let (summary, notices) = record_from(&device, port, &path, sent.len() - 10);
    drop(board.join().unwrap());
    assert_eq!((summary.bad_frames, summary.missing_frames, summary.reconnects), (0, 10, 1), "{notices:?}");
    assert!(frames(&path) == [&sent[..100], &sent[110..]].concat());
}

/// The same drive through a noisy cable to the scanner: no frame of the link is missing, and scans are.
#[cfg(unix)]
#[test]
fn what_the_board_loses_while_it_is_recorded_is_a_loss() {
    let folder = tempfile::tempdir().unwrap();
    let spec = "lidar:flip=3e-4,seed=3";
    for arguments in [
        &["simulate", "--seconds", "6", "-o", "drive.mcap"][..],
        &["run", "drive.mcap", "--faults", spec, "-o", "faulty.mcap"],
    ] {
        assert!(crossfall(folder.path(), arguments).output().unwrap().status.code().is_some());
    }
    let sent = frames(&folder.path().join("faulty.mcap"));
    let (listener, device) = listener();
    let recorder =
        crossfall(folder.path(), &["record", "--device", &device.to_string(), "-o", "a.mcap"]).spawn().unwrap();
    let mut port = accept(&listener);
    port.write_all(&sent.concat()).unwrap();
    await_on_disk(&folder.path().join("a.mcap"), sent.len());
    assert!(Command::new("kill").args(["-TERM", &recorder.id().to_string()]).status().unwrap().success());
    let output = recorder.wait_with_output().unwrap();
    let error = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(3), "{error}");
    assert!(error.contains("0 bad, 0 missing") && error.contains("lost on the board: lidar.bad_frames = "), "{error}");
}
