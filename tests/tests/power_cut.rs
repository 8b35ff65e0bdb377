//! A power cut under the log's writer, modelled: storage that stops after N bytes, and of which only what was synced need be there afterwards.
//!
//! Whatever N is: every frame received a second or more before the cut is recovered, bit for bit; the frames recovered are the first of those
//! written, none missing in between and none made up; and recovery says that the end is open, unless nothing but the mark is missing that ends every MCAP file: the record
//! before it has the sum over everything, and proves the log whole.

use std::io::{self, Write};
use std::path::Path;
use std::sync::{Arc, Mutex, PoisonError};

use crossfall::log::{Options, Reader, Storage, Writer};
use crossfall::recover::recover;
use crossfall::simulate::scene::Scene;
use crossfall::{capture, run};
use crossfall_core::protocol::Config;
use crossfall_tests::drives;
use crossfall_tests::fuzzing::mutate::Draw;

/// The mark at the end of an MCAP file, in bytes.
const MARK: usize = 8;

/// What may be lost, in receive time.
const SECOND_NS: u64 = 1_000_000_000;

type Frame = (u64, Vec<u8>);

/// The disk: what was written, how much of it is safe, and how much can still be.
#[derive(Default)]
struct Disk {
    bytes: Vec<u8>,
    synced: usize,
}

struct Fuel {
    disk: Arc<Mutex<Disk>>,
    left: usize,
}

fn cut() -> io::Error {
    io::Error::other("the power is gone")
}

impl Write for Fuel {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let taken = bytes.len().min(self.left);
        if taken == 0 && !bytes.is_empty() {
            return Err(cut());
        }
        self.left -= taken;
        self.disk.lock().unwrap_or_else(PoisonError::into_inner).bytes.extend(&bytes[..taken]);
        Ok(taken)
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

impl Storage for Fuel {
    fn sync(&mut self) -> io::Result<()> {
        if self.left == 0 {
            return Err(cut());
        }
        let mut disk = self.disk.lock().unwrap_or_else(PoisonError::into_inner);
        disk.synced = disk.bytes.len();
        Ok(())
    }
}

/// Writes frames until the power goes. The disk, and the receive time of the frame at which it went (none when everything was written).
fn write(frames: &[Frame], fuel: usize) -> (Disk, Option<u64>) {
    let disk = Arc::new(Mutex::new(Disk::default()));
    let storage = Arc::clone(&disk);
    let open = move |_: &Path| -> io::Result<Box<dyn Storage>> {
        Ok(Box::new(Fuel { disk: Arc::clone(&storage), left: fuel }))
    };
    let went = (|| {
        let first = frames.first().map(|(time, _)| *time);
        let mut log =
            Writer::create_over(Path::new("model.mcap"), Options::default(), Box::new(open)).map_err(|_| first)?;
        for (time, bytes) in frames {
            log.frame(*time, bytes).map_err(|_| Some(*time))?;
        }
        log.finish().map_err(|_| frames.last().map(|(time, _)| *time))
    })()
    .err()
    .flatten();
    let disk = std::mem::take(&mut *disk.lock().unwrap_or_else(PoisonError::into_inner));
    (disk, went)
}

/// Frames of a simulated drive under their device times.
fn drive(seconds: f64, folder: &Path) -> Vec<Frame> {
    let (capture_path, log_path) = (folder.join("drive.mcap"), folder.join("drive.log.mcap"));
    let mut scene = Scene::default();
    scene.drive.seconds = seconds;
    drives::capture(&scene, &capture_path);
    let mut log = Writer::create(&log_path).expect("a log");
    let mut reader = capture::Reader::open(&capture_path).expect("the capture");
    run::run(&mut reader, &Config::default(), &mut log, |_| ()).expect("a run");
    log.finish().expect("a whole log");
    read(&log_path)
}

fn read(path: &Path) -> Vec<Frame> {
    let frames = Reader::open(path).expect("a log").map(|frame| frame.expect("a frame"));
    frames.map(|frame| (frame.receive_ns, frame.bytes)).collect()
}

fn scratch() -> tempfile::TempDir {
    let memory = Path::new("/dev/shm");
    if memory.is_dir() { tempfile::tempdir_in(memory) } else { tempfile::tempdir() }.expect("a scratch folder")
}

/// Recovers what a disk holds of a log of `whole` bytes, and holds it against what was written before the power went at `went`.
fn check(bytes: &[u8], whole: usize, frames: &[Frame], went: Option<u64>, folder: &Path) -> usize {
    let safe = frames.iter().filter(|(time, _)| went.is_none_or(|went| time + SECOND_NS <= went)).count();
    let (torn, made) = (folder.join("torn.mcap"), folder.join("made.mcap"));
    std::fs::write(&torn, bytes).expect("room");
    let report = match recover(&[torn], &made, |_, _| ()) {
        Ok(report) => report,
        Err(error) => {
            // Before the file's own first bytes are there nothing can have been lost.
            assert!(bytes.len() < 200 && safe == 0, "{} bytes: {error}", bytes.len());
            return 0;
        }
    };
    let found = read(&made);
    assert!(found.len() >= safe, "{} bytes: {} of {safe} safe frames", bytes.len(), found.len());
    assert!(found[..] == frames[..found.len()], "{} bytes: other frames", bytes.len());
    let complete = bytes.len() + MARK >= whole;
    assert_eq!((report.lost, report.open_ends), (!complete, u64::from(!complete)), "{} bytes: {report:?}", bytes.len());
    assert_eq!((report.frames, report.frames_lost, report.bad_frames), (found.len() as u64, 0, 0));
    found.len()
}

/// Where a log differs from another one of the same frames: the number of the recording, and the CRC over everything.
fn own(log: &[u8]) -> [std::ops::Range<usize>; 2] {
    const DATA_END: [u8; 9] = [15, 4, 0, 0, 0, 0, 0, 0, 0];
    // Its key, and the length of what follows.
    const ID: &[u8] = b"id\x20\0\0\0";
    let id = log.windows(ID.len()).position(|window| window == ID).expect("the number") + ID.len();
    let crc = log.windows(9).rposition(|window| window == DATA_END).expect("an end") + 9;
    [id..id + 32, crc..crc + 4]
}

fn is_long() -> bool {
    std::env::var_os("CROSSFALL_LONG").is_some()
}

/// `cargo xtask test --long`: at every byte. Otherwise at every 211th, all about the borders of the first chunks, and the last.
#[test]
fn a_short_drive_is_cut_at_every_byte() {
    let folder = scratch();
    let frames = drive(1.3, folder.path());
    let (whole, went) = write(&frames, usize::MAX);
    assert_eq!(went, None);
    check(&whole.bytes, whole.bytes.len(), &frames, None, folder.path());
    let mut most = 0;
    let end = whole.bytes.len() - 4 * MARK;
    let marks = own(&whole.bytes);
    let cuts = (0..whole.bytes.len()).filter(|at| is_long() || at % 211 == 0 || *at < 160 || *at >= end);
    let mut cut = 0;
    for fuel in cuts {
        cut += 1;
        let (disk, went) = write(&frames, fuel);
        let (mut found, mut expected) = (disk.bytes.clone(), whole.bytes[..fuel].to_vec());
        for mark in marks.iter().map(|mark| mark.start.min(fuel)..mark.end.min(fuel)) {
            found[mark.clone()].fill(0);
            expected[mark].fill(0);
        }
        assert!(found == expected, "a log is only ever appended to");
        let went = went.or(frames.last().map(|(time, _)| *time));
        most = most.max(frames.len() - check(&disk.bytes, whole.bytes.len(), &frames, went, folder.path()));
        // The worst that the disk may do: what was not synced is gone.
        check(&disk.bytes[..disk.synced], whole.bytes.len(), &frames, went, folder.path());
    }
    println!("cut at {cut} of {} bytes, at most {most} of {} frames lost", whole.bytes.len(), frames.len());
    assert!(most > 0);
}

#[test]
fn a_long_drive_is_cut_anywhere() {
    let folder = scratch();
    let frames = drive(if is_long() { 30.0 } else { 8.0 }, folder.path());
    let (whole, _) = write(&frames, usize::MAX);
    let mut draw = Draw::new(5);
    for _ in 0..if is_long() { 1_000 } else { 12 } {
        let (disk, went) = write(&frames, draw.below(whole.bytes.len()));
        let went = went.or(frames.last().map(|(time, _)| *time));
        check(&disk.bytes, whole.bytes.len(), &frames, went, folder.path());
        check(&disk.bytes[..disk.synced], whole.bytes.len(), &frames, went, folder.path());
    }
}

/// A file system that had given the file its length but not its bytes: zeros at the end.
#[test]
fn zeros_behind_what_was_synced_change_nothing() {
    let folder = scratch();
    let frames = drive(1.3, folder.path());
    let (whole, _) = write(&frames, usize::MAX);
    let (disk, _) = write(&frames, whole.bytes.len() * 3 / 4);
    let mut bytes = disk.bytes[..disk.synced].to_vec();
    bytes.extend([0; 40_000]);
    let (torn, out) = (folder.path().join("torn.mcap"), folder.path().join("whole.mcap"));
    std::fs::write(&torn, bytes).expect("room");
    let report = recover(&[torn], &out, |_, _| ()).expect("a log");
    let found = read(&out);
    assert!(found.len() > frames.len() / 3 && found[..] == frames[..found.len()]);
    assert!(report.lost && report.bytes_lost == 40_000, "{report:?}");
}
