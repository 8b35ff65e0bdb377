//! A kill or a power cut while one file of a recording is followed by the next, at every instant.
//!
//! The storage is a model of a folder that stops after N steps: each byte that is written is one, each file that is made, each name and each
//! file that is brought to the disk. Whatever N is about the seam of two files: who names the first file gets the frames from the first on, none missing in
//! between and none made up, all that came a second before; and is told that the drive has no end, or has lost nothing.

use std::io::{self, Write};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use crossfall::log::{Options, Parts, Recording, Storage, Writer};
use crossfall::recover::recover;
use crossfall_core::protocol::DeviceTime;
use crossfall_core::protocol::frame::{MAX_MESSAGE_FRAME, Sequencer};
use crossfall_core::protocol::message::{Message, Pulse, PulseVerdict};

/// What may be lost, in receive time.
const SECOND_NS: u64 = 1_000_000_000;

/// From frame to frame.
const EVERY_NS: u64 = 20_000_000;

/// A file is followed by another at its second chunk.
const FILE_NS: u64 = 700_000_000;

const FRAMES: u64 = 170;

type Frame = (u64, Vec<u8>);

/// One file of the folder.
#[derive(Clone, Default)]
struct Kept {
    path: PathBuf,
    bytes: Vec<u8>,
    /// How many of the bytes are safe, and whether the name is.
    synced: usize,
    is_named: bool,
}

#[derive(Default)]
struct Folder {
    files: Vec<Kept>,
    /// Steps done, and when the power goes.
    steps: usize,
    most: usize,
}

impl Folder {
    /// As many of so many steps as can still be done.
    fn step(&mut self, wanted: usize) -> io::Result<usize> {
        let done = wanted.min(self.most - self.steps);
        if done == 0 && wanted > 0 {
            return Err(io::Error::other("the power is gone"));
        }
        self.steps += done;
        Ok(done)
    }
}

#[derive(Clone, Default)]
struct Shared(Arc<Mutex<Folder>>);

impl Shared {
    fn lock(&self) -> MutexGuard<'_, Folder> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn open(&self, path: &Path) -> io::Result<Box<dyn Storage>> {
        let mut folder = self.lock();
        folder.step(1)?;
        folder.files.push(Kept { path: path.to_path_buf(), ..Kept::default() });
        folder.step(1)?;
        let file = folder.files.len() - 1;
        folder.files[file].is_named = true;
        Ok(Box::new(File { folder: self.clone(), file }))
    }
}

struct File {
    folder: Shared,
    file: usize,
}

impl Write for File {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let mut folder = self.folder.lock();
        let taken = folder.step(bytes.len())?;
        folder.files[self.file].bytes.extend(&bytes[..taken]);
        Ok(taken)
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

impl Storage for File {
    fn sync(&mut self) -> io::Result<()> {
        let mut folder = self.folder.lock();
        folder.step(1)?;
        let file = &mut folder.files[self.file];
        file.synced = file.bytes.len();
        Ok(())
    }
}

fn frames() -> Vec<Frame> {
    let mut sequencer = Sequencer::new();
    let frame = |i| {
        let pulse = Pulse { time: DeviceTime(i * EVERY_NS / 1_000), verdict: PulseVerdict::Accepted };
        let mut out = [0; MAX_MESSAGE_FRAME];
        let length = sequencer.message(&Message::Pulse(pulse), &mut out).expect("a frame");
        (1_790_000_000_000_000_000 + i * EVERY_NS, out[..length].to_vec())
    };
    (0..FRAMES).map(frame).collect()
}

/// Writes frames until the power goes after so many steps. The files; the receive time at which it went, if it did; the steps at which files were followed by
/// others, from and to.
fn write(first: &Path, frames: &[Frame], most: usize) -> (Vec<Kept>, Option<u64>, Vec<(usize, usize)>) {
    let shared = Shared::default();
    shared.lock().most = most;
    let storage = shared.clone();
    let open = move |path: &Path| storage.open(path);
    let mut seams = Vec::new();
    let mut now = frames[0].0;
    let written = (|| {
        let options = Options { max_ns: FILE_NS, ..Options::default() };
        let mut log = Writer::create_over(first, options, Box::new(open))?;
        for (time, bytes) in frames {
            now = *time;
            let (before, parts) = (shared.lock().steps, log.parts());
            log.frame(*time, bytes)?;
            if log.parts() > parts {
                seams.push((before, shared.lock().steps));
            }
        }
        log.finish()
    })();
    let files = std::mem::take(&mut shared.lock().files);
    (files, written.is_err().then_some(now), seams)
}

/// What a disk keeps of a file.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
enum Keeps {
    /// All that was written: a kill.
    All,
    /// What it was asked to.
    Synced,
    /// The length of what was written, and the bytes that it was asked to.
    Zeros,
}

/// Brings the files into a real folder.
fn lay(files: &[Kept], earlier: Keeps, last: Keeps) {
    for (i, file) in files.iter().enumerate() {
        let keeps = if i + 1 == files.len() { last } else { earlier };
        let mut bytes = file.bytes.clone();
        match keeps {
            Keeps::All => {}
            Keeps::Synced => bytes.truncate(file.synced),
            Keeps::Zeros => bytes[file.synced..].fill(0),
        }
        if file.is_named || keeps != Keeps::Synced {
            std::fs::write(&file.path, bytes).expect("room");
        }
    }
}

/// Frames of the drive, and whether anything is told.
fn read(first: &Path) -> (Vec<Frame>, bool) {
    let Ok(recording) = Recording::open(first) else { return (Vec::new(), true) };
    let (frames, errors): (Vec<_>, Vec<_>) = recording.partition(Result::is_ok);
    let frames = frames.into_iter().flatten().map(|frame| (frame.receive_ns, frame.bytes));
    (frames.collect(), !errors.is_empty())
}

fn scratch() -> tempfile::TempDir {
    let memory = Path::new("/dev/shm");
    if memory.is_dir() { tempfile::tempdir_in(memory) } else { tempfile::tempdir() }.expect("a scratch folder")
}

#[test]
fn a_drive_that_ends_between_two_files_is_told_at_every_instant() {
    let folder = scratch();
    let (first, made) = (folder.path().join("a.log.mcap"), folder.path().join("made.mcap"));
    let frames = frames();
    let (whole, went, seams) = write(&first, &frames, usize::MAX);
    assert_eq!((whole.len(), went, seams.len()), (4, None, 3));
    lay(&whole, Keeps::All, Keeps::All);
    assert!(read(&first) == (frames.clone(), false));
    let is_long = std::env::var_os("CROSSFALL_LONG").is_some();
    let mut tried = [0; 5];
    // From the first file's to the second's, and between two of which both say what was before.
    for step in seams[..2].iter().flat_map(|&(from, to)| from - 40..to + 40) {
        for file in &whole {
            let _absent = std::fs::remove_file(&file.path);
        }
        let (files, went, _) = write(&first, &frames, step);
        let went = went.expect("the power went");
        let safe = frames.iter().filter(|(time, _)| time + SECOND_NS <= went).count();
        for (earlier, last) in [
            (Keeps::All, Keeps::All),
            (Keeps::Synced, Keeps::Synced),
            (Keeps::All, Keeps::Synced),
            (Keeps::Synced, Keeps::All),
            (Keeps::All, Keeps::Zeros),
        ] {
            for file in &files {
                let _absent = std::fs::remove_file(&file.path);
            }
            lay(&files, earlier, last);
            let context = format!("{step} steps, {} files, {earlier:?}, {last:?}", files.len());
            let (found, told) = read(&first);
            assert!(told, "{context}: {} frames, and nothing is told", found.len());
            assert!(found.len() >= safe, "{context}: {} of {safe} safe frames", found.len());
            assert!(found[..] == frames[..found.len()], "{context}: other frames");
            tried[files.len()] += 1;
            if is_long || step % 61 == 0 {
                let parts = Parts::of(&first).expect("a recording").files;
                let _absent = std::fs::remove_file(&made);
                let report = recover(&parts, &made, |_, _| ()).expect("a log");
                assert!(report.lost, "{context}: {report:?}");
                assert_eq!((report.frames, report.frames_lost), (found.len() as u64, 0), "{context}: {report:?}");
            }
        }
    }
    println!("ends by the number of files there are then: {tried:?}");
    assert!(tried[1..=3].iter().all(|&count| count > 100), "{tried:?}");
}
