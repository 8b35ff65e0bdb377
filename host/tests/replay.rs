//! Replays into boards that are threads here: every byte arrives, none too early, and a board that sets its scanner up is answered.

mod program;

use std::fs;
use std::io::{Read, Write};
use std::net::{TcpListener, TcpStream};
use std::process::{Child, Command};
use std::thread::{self, JoinHandle};
use std::time::{Duration, Instant};

use crossfall::capture::{Channel, Chunk, Reader};
use crossfall::replay::PIECE_NS;
use crossfall_core::protocol::DeviceTime;
use crossfall_core::sensors::lms2xx::bring_up::{Action, BringUp, Settings};
use crossfall_core::sensors::lms2xx::{Decoder, Event};
use program::crossfall;
use tempfile::TempDir;

/// No test takes as long unless it fails.
const PATIENCE: Duration = Duration::from_secs(60);

/// What came on a line: each read and when it ended.
type Heard = Vec<(Instant, Vec<u8>)>;

fn ends(mut command: Command, code: i32) -> (String, String) {
    ended(command.spawn().unwrap(), code)
}

fn ended(child: Child, code: i32) -> (String, String) {
    program::ended(&child.wait_with_output().unwrap(), code)
}

/// A folder with a simulated drive of two seconds.
fn drive() -> (TempDir, Vec<Chunk>) {
    let folder = tempfile::tempdir().unwrap();
    ends(crossfall(folder.path(), &["simulate", "--seconds", "2", "-o", "drive.mcap"]), 0);
    let chunks = Reader::open(&folder.path().join("drive.mcap")).unwrap().map(Result::unwrap).collect();
    (folder, chunks)
}

fn bytes(chunks: &[Chunk], channel: Channel) -> Vec<u8> {
    chunks.iter().filter(|chunk| chunk.channel == channel).flat_map(|chunk| chunk.data.clone()).collect()
}

fn listener() -> (TcpListener, String) {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let address = format!("tcp:{}", listener.local_addr().unwrap());
    (listener, address)
}

/// Takes everything until the other end closes.
fn sink(listener: TcpListener) -> JoinHandle<Heard> {
    thread::spawn(move || {
        let (mut stream, _) = listener.accept().unwrap();
        stream.set_read_timeout(Some(PATIENCE)).unwrap();
        let (mut heard, mut chunk) = (Heard::new(), [0; 4096]);
        loop {
            match stream.read(&mut chunk).unwrap() {
                0 => return heard,
                count => heard.push((Instant::now(), chunk[..count].to_vec())),
            }
        }
    })
}

fn joined(heard: &Heard) -> Vec<u8> {
    heard.iter().flat_map(|(_, bytes)| bytes.clone()).collect()
}

#[test]
fn every_byte_arrives_and_none_too_early() {
    let (folder, chunks) = drive();
    let lines = [(); 3].map(|()| listener());
    let [lidar, ins, pps] = [0, 1, 2].map(|k: usize| lines[k].1.clone());
    let sinks = lines.map(|(listener, _)| sink(listener));
    let arguments = ["replay", "drive.mcap", "--lidar", &lidar, "--ins", &ins, "--pps", &pps, "--mute", "--json"];
    let begun = Instant::now();
    let (out, err) = ends(crossfall(folder.path(), &arguments), 0);
    let [lidar, ins, pps] = sinks.map(|sink| sink.join().unwrap());
    assert!(joined(&lidar) == bytes(&chunks, Channel::Lidar), "the scanner's bytes");
    assert!(joined(&ins) == bytes(&chunks, Channel::Ins), "the unit's bytes");
    let pulses: Vec<_> = chunks.iter().filter(|chunk| chunk.channel == Channel::Pps).collect();
    assert_eq!(joined(&pps).len(), pulses.len());

    let played: serde_json::Value = serde_json::from_str(&out).unwrap();
    assert_eq!(played["pulses"], pulses.len());
    assert_eq!(played["lidar_bytes"], joined(&lidar).len());
    assert!(err.contains("s played: "), "{err}");

    // The drive began after the process did: against that, no read can end before the bytes in it were due, but for a piece.
    let first_ns = chunks[0].device_time_ns;
    for (heard, channel) in [(&lidar, Channel::Lidar), (&ins, Channel::Ins), (&pps, Channel::Pps)] {
        let due: Vec<u64> = chunks
            .iter()
            .filter(|chunk| chunk.channel == channel)
            .flat_map(|chunk| vec![chunk.device_time_ns - first_ns; chunk.data.len().max(1)])
            .collect();
        let mut count = 0;
        for (at, bytes) in heard {
            count += bytes.len();
            let early = due[count - 1].saturating_sub((*at - begun).as_nanos() as u64);
            assert!(early <= PIECE_NS, "{channel:?}: byte {count} came {early} ns too early");
        }
    }
}

#[test]
fn a_drive_can_be_played_faster() {
    let (folder, chunks) = drive();
    let lines = [(); 2].map(|()| listener());
    let (lidar, ins) = (lines[0].1.clone(), lines[1].1.clone());
    let sinks = lines.map(|(listener, _)| sink(listener));
    let arguments = ["replay", "drive.mcap", "--lidar", &lidar, "--ins", &ins, "--mute", "--speed", "4", "--json"];
    let (out, err) = ends(crossfall(folder.path(), &arguments), 0);
    let [lidar, _] = sinks.map(|sink| sink.join().unwrap());
    assert!(joined(&lidar) == bytes(&chunks, Channel::Lidar));
    assert!(err.contains("at 4 times its speed"), "{err}");
    let played: serde_json::Value = serde_json::from_str(&out).unwrap();
    // Without a line for them the pulses are not played, and that is told.
    assert_eq!((&played["pulses"], &played["chunks_unplayed"]), (&0.into(), &3.into()));
}

/// A board's side of the dialogue: sets its scanner up, then decodes what comes; the scans that it has seen.
fn board(listener: TcpListener) -> JoinHandle<u64> {
    thread::spawn(move || {
        let (mut stream, _) = listener.accept().unwrap();
        stream.set_read_timeout(Some(Duration::from_millis(5))).unwrap();
        let begun = Instant::now();
        let now = || DeviceTime(begun.elapsed().as_micros() as u64);
        let (mut bring_up, mut decoder) = (BringUp::new(Settings::default()), Decoder::new(6));
        let (mut scans, mut chunk) = (0, [0; 1024]);
        while begun.elapsed() < PATIENCE {
            let count = match stream.read(&mut chunk) {
                Ok(0) => return scans,
                Ok(count) => count,
                Err(_) => 0,
            };
            let mut actions = Vec::new();
            for &byte in &chunk[..count] {
                decoder.push(byte, now(), &mut |event: Event<'_>| {
                    // What comes before the scanner has been started is none of the drive.
                    scans += u64::from(matches!(event, Event::Scan { .. }));
                    bring_up.event(&event, now(), &mut |action| actions.push(action));
                });
            }
            bring_up.tick(now(), &mut |action| actions.push(action));
            for action in actions {
                if let Action::Send(telegram) = action {
                    decoder.finish(&mut |_| ());
                    stream.write_all(&telegram).unwrap();
                }
            }
        }
        panic!("no end in sight");
    })
}

#[test]
fn a_board_that_sets_its_scanner_up_gets_every_scan() {
    let (folder, _) = drive();
    let ((lidar, lidar_at), (ins, ins_at)) = (listener(), listener());
    let (board, _ins) = (board(lidar), sink(ins));
    let arguments = ["replay", "drive.mcap", "--lidar", &lidar_at, "--ins", &ins_at, "--json"];
    let (out, _) = ends(crossfall(folder.path(), &arguments), 0);
    let played: serde_json::Value = serde_json::from_str(&out).unwrap();
    assert_eq!((&played["answered"], &played["lidar_bytes_unsent"]), (&true.into(), &0.into()));
    assert_eq!(board.join().unwrap(), 75);
}

#[test]
fn a_line_that_nobody_serves_is_named() {
    let (folder, _) = drive();
    let ((gone, nobody), (_ins, ins)) = (listener(), listener());
    drop(gone);
    let (_, err) = ends(crossfall(folder.path(), &["replay", "drive.mcap", "--lidar", &nobody, "--ins", &ins]), 1);
    assert_eq!(err.lines().count(), 1, "{err}");
    assert!(err.starts_with(&format!("crossfall: {nobody}: cannot connect: ")), "{err}");
    for (line, what) in [("serial:/dev/tty9", "needs its rate"), ("udp:a:1", "expected serial:PATH")] {
        let (_, err) = ends(crossfall(folder.path(), &["replay", "drive.mcap", "--lidar", line, "--ins", &ins]), 2);
        assert!(err.contains(what), "{err}");
    }
    let (_, err) =
        ends(crossfall(folder.path(), &["replay", "drive.mcap", "--lidar", &ins, "--ins", &ins, "--speed", "0"]), 2);
    assert!(err.contains("from 0.01 to 100"), "{err}");
    fs::write(folder.path().join("photo.jpg"), b"\xff\xd8").unwrap();
    let (_, err) = ends(crossfall(folder.path(), &["replay", "photo.jpg", "--lidar", &ins, "--ins", &ins]), 1);
    assert!(err.contains("photo.jpg"), "{err}");
}

#[test]
fn a_line_that_closes_ends_the_replay_with_its_name() {
    let (folder, _) = drive();
    let ((lidar, lidar_at), (ins, ins_at)) = (listener(), listener());
    let _lidar = sink(lidar);
    let closing = thread::spawn(move || {
        let (mut stream, _): (TcpStream, _) = ins.accept().unwrap();
        let mut some = [0; 64];
        let _count = stream.read(&mut some).unwrap();
    });
    let arguments = ["replay", "drive.mcap", "--lidar", &lidar_at, "--ins", &ins_at, "--mute"];
    let (_, err) = ends(crossfall(folder.path(), &arguments), 1);
    closing.join().unwrap();
    assert!(err.starts_with(&format!("crossfall: {ins_at}: the connection is lost after ")), "{err}");
}

#[cfg(unix)]
#[test]
fn an_interrupt_ends_the_replay_at_once() {
    let (folder, _) = drive();
    let ((lidar, lidar_at), (ins, ins_at)) = (listener(), listener());
    let (lidar, _ins) = (sink(lidar), sink(ins));
    // At a hundredth of its speed the drive would last for minutes.
    let arguments = ["replay", "drive.mcap", "--lidar", &lidar_at, "--ins", &ins_at, "--mute", "--speed", "0.01"];
    let child = crossfall(folder.path(), &arguments).spawn().unwrap();
    thread::sleep(Duration::from_millis(600));
    let begun = Instant::now();
    assert!(Command::new("kill").args(["-INT", &child.id().to_string()]).status().unwrap().success());
    let (_, err) = ended(child, 1);
    assert!(err.starts_with("crossfall: interrupted after "), "{err}");
    assert!(begun.elapsed() < PATIENCE / 2);
    lidar.join().unwrap();
}
