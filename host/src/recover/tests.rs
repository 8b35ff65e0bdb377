mod blocks;

use std::fs;

use super::*;
use crate::container::Container;
use crate::container::disk::tests::Failing;
use crossfall_core::protocol::DeviceTime;
use crossfall_core::protocol::frame::{MAX_MESSAGE_FRAME, Sequencer};
use crossfall_core::protocol::message::{Message, Pulse, PulseVerdict};

const T: u64 = 1_790_000_000_000_000_000;
const EVERY_NS: u64 = 20_000_000;

/// Frames 20 ms apart: pulses, numbered from 0.
fn frames(count: u64) -> Vec<Vec<u8>> {
    let mut sequencer = Sequencer::new();
    let pulses = (0..count).map(|i| Pulse { time: DeviceTime(i * 20_000), verdict: PulseVerdict::Accepted });
    pulses
        .map(|pulse| {
            let mut out = [0; MAX_MESSAGE_FRAME];
            let length = sequencer.message(&Message::Pulse(pulse), &mut out).unwrap();
            out[..length].to_vec()
        })
        .collect()
}

fn write(path: &Path, frames: &[Vec<u8>]) {
    let mut log = log::Writer::create_live(path).unwrap();
    for (i, frame) in frames.iter().enumerate() {
        log.frame(T + i as u64 * EVERY_NS, frame).unwrap();
    }
    log.finish().unwrap();
}

fn read(path: &Path) -> Vec<Vec<u8>> {
    log::Reader::open(path).unwrap().map(|frame| frame.unwrap().bytes).collect()
}

struct Folder(tempfile::TempDir);

impl Folder {
    fn new() -> Self {
        Self(tempfile::tempdir().unwrap())
    }

    fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    fn recover(&self, name: &str) -> Report {
        // What was recovered is never written over: the user's to delete.
        let _absent = fs::remove_file(self.path("out.mcap"));
        recover(&[self.path(name)], &self.path("out.mcap"), |_, _| ()).unwrap()
    }
}

#[test]
fn a_whole_log_loses_nothing() {
    let folder = Folder::new();
    let sent = frames(200);
    write(&folder.path("a.mcap"), &sent);
    let report = folder.recover("a.mcap");
    assert!(!report.lost && report.losses.is_empty(), "{report:?}");
    assert_eq!((report.frames, report.damages, report.bytes_lost), (200, 0, 0));
    assert_eq!(read(&folder.path("out.mcap")), sent);
}

#[test]
fn a_hit_frame_is_one_frame_lost_and_told_with_its_seconds_and_bytes() {
    let folder = Folder::new();
    let sent = frames(200);
    let path = folder.path("a.mcap");
    write(&path, &sent);
    let mut bytes = fs::read(&path).unwrap();
    let at = place(&bytes, &sent[77]);
    bytes[at + 3] ^= 0x20;
    fs::write(&path, &bytes).unwrap();
    let report = folder.recover("a.mcap");
    assert!(report.lost);
    assert_eq!((report.frames_lost, report.frames_lost_in_file, report.damages, report.restarts), (1, 1, 1, 0));
    // The broken frame is kept as it is: it may be read by eye.
    assert_eq!((report.frames, report.bad_frames), (200, 1));
    // From the broken frame, whose time is known, to the next.
    assert!((report.seconds_lost - 0.02).abs() < 1e-6, "{report:?}");
    let out = read(&folder.path("out.mcap"));
    assert_eq!((&out[..77], &out[78..]), (&sent[..77], &sent[78..]));
}

/// The index serves who seeks: it is made again, and what was wrong with it is told with its place.
#[test]
fn a_hit_index_costs_no_frame_and_is_told_with_its_place() {
    let folder = Folder::new();
    let sent = frames(200);
    let path = folder.path("a.mcap");
    write(&path, &sent);
    let whole = fs::read(&path).unwrap();
    let sound = verify(&path, |_| ()).unwrap().problem_count;
    let index = whole.windows(9).rposition(|window| window == [15, 4, 0, 0, 0, 0, 0, 0, 0]).unwrap() + 13;
    for at in [index + 20, whole.len() - 60, whole.len() - 10] {
        let mut bytes = whole.clone();
        bytes[at] ^= 0x20;
        fs::write(&path, &bytes).unwrap();
        let report = folder.recover("a.mcap");
        assert_eq!((report.lost, report.frames_lost, report.open_ends, report.frames), (true, 0, 0, 200), "{report:?}");
        let [loss] = &report.losses[..] else { panic!("{:?}", report.losses) };
        assert_eq!((loss.offset, loss.frames, loss.bytes), (index as u64, Some(0), (whole.len() - index) as u64));
        assert!(loss.what.ends_with("no frame is lost, the index is not needed"), "{}", loss.what);
        assert_eq!(read(&folder.path("out.mcap")), sent);
        let verified = verify(&path, |_| ()).unwrap();
        assert_eq!((verified.problem_count - sound, verified.missing_frames), (1, 0));
    }
}

#[test]
fn frames_that_never_reached_the_log_are_told_apart() {
    let folder = Folder::new();
    let mut sent = frames(100);
    sent.drain(40..43);
    write(&folder.path("a.mcap"), &sent);
    let report = folder.recover("a.mcap");
    assert_eq!((report.lost, report.frames_lost, report.frames_lost_in_file, report.damages), (true, 3, 0, 0));
    assert_eq!(report.losses.len(), 1);
    assert_eq!((report.losses[0].frames, report.losses[0].bytes), (Some(3), 0));
}

#[test]
fn a_hole_in_the_file_is_told_by_its_bytes_frames_and_seconds() {
    let folder = Folder::new();
    let sent = frames(400);
    let path = folder.path("a.mcap");
    write(&path, &sent);
    let mut bytes = fs::read(&path).unwrap();
    let (from, to) = (place(&bytes, &sent[100]), place(&bytes, &sent[160]));
    bytes[from..to].fill(0);
    fs::write(&path, &bytes).unwrap();
    let report = folder.recover("a.mcap");
    assert_eq!(report.frames_lost, 60, "{report:?}");
    assert_eq!((report.frames_lost_in_file, report.open_ends), (60, 0));
    assert!(report.bytes_lost > (to - from) as u64 / 2 && report.bytes_lost <= (to - from + 400) as u64, "{report:?}");
    // At most: the frame behind the hole has lost its time, the next one has it.
    assert!(report.seconds_lost >= 59.0 * 0.02 && report.seconds_lost < 62.0 * 0.02, "{report:?}");
    let out = read(&folder.path("out.mcap"));
    let kept: Vec<_> = out.into_iter().filter(|frame| log_frame(frame)).collect();
    assert_eq!(kept, [&sent[..100], &sent[160..]].concat());
}

/// Whatever bits of a record's times are hit, the frame's time lies between its neighbours': `verify` would call anything else damage.
#[test]
fn a_frame_whose_time_is_hit_is_not_later_than_the_next() {
    let folder = Folder::new();
    let sent = frames(60);
    let path = folder.path("a.mcap");
    write(&path, &sent);
    let whole = fs::read(&path).unwrap();
    let at = place(&whole, &sent[30]);
    // The two times are the 16 bytes in front of a frame; one or both of them are hit.
    for hit in (1..=16).flat_map(|back| (0..8).map(move |bit| (back, 1_u8 << bit, None))).chain([
        (16, 0xff, Some(8)),
        (13, 0x11, Some(6)),
        (14, 0x04, Some(5)),
    ]) {
        let (back, bits, also) = hit;
        let mut bytes = whole.clone();
        for place in [Some(back), also].into_iter().flatten() {
            bytes[at - place] ^= bits;
        }
        fs::write(&path, &bytes).unwrap();
        let frames = log::Reader::open(&path).unwrap().flatten();
        let times: Vec<u64> = frames.map(|frame| frame.receive_ns).collect();
        assert_eq!(times.len(), 60, "{hit:?}");
        assert!(times.is_sorted(), "{hit:?}: {:?}", &times[28..33]);
    }
}

/// Where a file has a frame.
fn place(file: &[u8], frame: &[u8]) -> usize {
    file.windows(frame.len()).position(|window| window == frame).unwrap()
}

fn log_frame(frame: &[u8]) -> bool {
    matches!(HostDecoder::new().next(&mut &frame[..]), Some(Event::Frame(_)))
}

#[test]
fn files_of_one_recording_become_one_log() {
    let folder = Folder::new();
    let sent = frames(300);
    let files = record(&folder, &sent);
    let report = recover(&files, &folder.path("out.mcap"), |_, _| ()).unwrap();
    assert!(!report.lost, "{report:?}");
    assert_eq!(read(&folder.path("out.mcap")), sent);
    // One is missing: exactly its frames are.
    let report = recover(&[files[0].clone(), files[2].clone()], &folder.path("torn.mcap"), |_, _| ()).unwrap();
    assert_eq!((report.lost, report.frames_lost, report.frames_lost_in_file), (true, 100, 0));
}

/// A recording of 100 frames a file.
fn record(folder: &Folder, sent: &[Vec<u8>]) -> Vec<PathBuf> {
    let first = folder.path("a.mcap");
    let options = log::Options { max_ns: 2_000_000_000, ..log::Options::default() };
    let mut log = log::Writer::create_with(&first, options).unwrap();
    for (i, frame) in sent.iter().enumerate() {
        log.frame(T + i as u64 * EVERY_NS, frame).unwrap();
    }
    log.finish().unwrap();
    log::Parts::of(&first).unwrap().files
}

/// What a drive holds when its first file is named, the errors in between, and what is said.
fn drive(first: &Path) -> (Vec<Vec<u8>>, usize, Vec<String>) {
    let (frames, errors): (Vec<_>, Vec<_>) = log::Recording::open(first).unwrap().partition(Result::is_ok);
    let frames = frames.into_iter().map(|frame| frame.unwrap().bytes).collect();
    (frames, errors.len(), log::Parts::of(first).unwrap().remarks)
}

/// However often it is recovered: what the new log is made from is not read with it.
#[test]
fn a_recovered_drive_takes_the_place_of_its_first_file() {
    let folder = Folder::new();
    let sent = frames(500);
    let files = record(&folder, &sent);
    assert_eq!(files.len(), 5);
    for again in [false, true] {
        let from = if again { &files[..1] } else { &files[..] };
        let report = recover(from, &folder.path("new.mcap"), |_, _| ()).unwrap();
        assert!(!report.lost, "{report:?}");
        fs::remove_file(&files[0]).unwrap();
        fs::rename(folder.path("new.mcap"), &files[0]).unwrap();
        let (found, errors, remarks) = drive(&files[0]);
        assert!((found == sent, errors, remarks.len()) == (true, 0, 4), "{} frames: {remarks:?}", found.len());
        assert!(remarks.iter().all(|remark| remark.contains("its frames are in ")), "{remarks:?}");
    }
    // Made under another name's place, what lies there belongs to nobody.
    fs::rename(&files[0], folder.path("b.mcap")).unwrap();
    fs::copy(&files[1], folder.path("b.part0002.mcap")).unwrap();
    let (found, errors, remarks) = drive(&folder.path("b.mcap"));
    assert!(found == sent && errors == 0 && remarks[0].ends_with("from files of another name"), "{remarks:?}");
}

#[test]
fn recovered_files_of_a_recording_take_their_places_in_it() {
    let folder = Folder::new();
    let sent = frames(500);
    let files = record(&folder, &sent);
    let replace = |parts: &[usize]| {
        let from: Vec<_> = parts.iter().map(|&part| files[part].clone()).collect();
        let report = recover(&from, &folder.path("new.mcap"), |_, _| ()).unwrap();
        assert!(!report.lost, "{report:?}");
        for file in &from {
            fs::remove_file(file).unwrap();
        }
        fs::rename(folder.path("new.mcap"), &from[0]).unwrap();
        let (found, errors, remarks) = drive(&files[0]);
        assert!(found == sent && errors == 0 && remarks.is_empty(), "{parts:?}: {errors} errors, {remarks:?}");
    };
    // One of the middle, the last, two as one, the first.
    replace(&[3]);
    replace(&[4]);
    replace(&[1, 2]);
    replace(&[0]);
    // What was known of the end still is.
    fs::remove_file(&files[4]).unwrap();
    assert_eq!(drive(&files[0]).1, 1);
}

#[test]
fn files_that_are_gone_or_unreadable_are_lost_and_told() {
    let folder = Folder::new();
    let files = record(&folder, &frames(300));
    let lost = |files: &[PathBuf]| {
        let _absent = fs::remove_file(folder.path("new.mcap"));
        recover(files, &folder.path("new.mcap"), |_, _| ()).unwrap()
    };
    fs::write(&files[2], [0; 4096]).unwrap();
    let report = lost(&files);
    assert_eq!((report.lost, report.frames, report.bytes_lost), (true, 200, 4096), "{report:?}");
    fs::remove_file(&files[2]).unwrap();
    let report = lost(&files[..2]);
    assert_eq!((report.lost, report.files_missing, report.frames_lost), (true, 1, 0), "{report:?}");
    assert_eq!(report.losses[0].what, "goes on in a.part0003.mcap, which is not there");
    // The new log says so as well.
    let (found, errors, _) = drive(&folder.path("new.mcap"));
    assert_eq!((found.len(), errors), (200, 1));
    // What was asked for is there: a later file alone, and files with others beside them.
    assert!(!lost(&files[1..2]).lost && !lost(&files[..1]).lost);
}

#[test]
fn a_file_that_was_not_closed_has_an_open_end() {
    let folder = Folder::new();
    let sent = frames(100);
    let path = folder.path("a.mcap");
    write(&path, &sent);
    let bytes = fs::read(&path).unwrap();
    let at = place(&bytes, &sent[90]);
    fs::write(&path, &bytes[..at + 2]).unwrap();
    let report = folder.recover("a.mcap");
    assert_eq!((report.lost, report.open_ends, report.frames), (true, 1, 90));
    assert_eq!((report.frames_lost, report.losses[0].frames), (0, None), "{report:?}");
}

/// Where chunk number `number` of a file begins, and the length of its record's body.
fn chunk(file: &[u8], number: usize) -> (usize, usize) {
    let mut at = mcap::MAGIC.len();
    let mut chunks = std::iter::from_fn(|| {
        loop {
            let here = at;
            let length = u64::from_le_bytes(file[here + 1..][..8].try_into().unwrap()) as usize;
            at += 9 + length;
            if file[here] == mcap::records::op::CHUNK {
                return Some((here, length));
            }
        }
    });
    chunks.nth(number).unwrap()
}

/// A bit of a chunk's length and one of what it holds: the wrong length must neither hide the chunks behind it nor have them read twice. So must a length
/// that is wrong together with the one within the chunk's header.
#[test]
fn a_wrong_length_and_a_wrong_payload_cost_the_frame_that_is_hit() {
    let folder = Folder::new();
    let sent = frames(200);
    let path = folder.path("a.mcap");
    write(&path, &sent);
    let whole = fs::read(&path).unwrap();
    let (at, length) = chunk(&whole, 3);
    let inside = |frame: &&Vec<u8>| (at..at + length).contains(&place(&whole, frame));
    let held: Vec<_> = sent.iter().filter(inside).collect();
    assert!((20..30).contains(&held.len()));
    for (bit, hit, both) in
        (0..64).flat_map(|bit| [(bit, held[7], false), (bit, held[20], false), (bit, held[7], true)])
    {
        let mut bytes = whole.clone();
        bytes[at + 1 + bit / 8] ^= 1 << (bit % 8);
        if both {
            bytes[at + 9 + 32 + bit / 8] ^= 1 << (bit % 8);
        }
        bytes[place(&whole, hit) + 4] ^= 0x04;
        fs::write(&path, &bytes).unwrap();
        let report = folder.recover("a.mcap");
        let out = read(&folder.path("out.mcap"));
        let good: Vec<_> = out.iter().filter(|frame| log_frame(frame)).collect();
        // With both lengths too short the chunk ends within a frame, which nothing puts together again.
        let torn = u64::from(both);
        assert!(good.len() as u64 + 1 + torn >= 200, "bit {bit}, both {both}: {} frames", good.len());
        let mut rest = sent.iter();
        assert!(
            good.iter().all(|frame| rest.any(|one| one == *frame)),
            "bit {bit}, both {both}: twice, or out of order"
        );
        let Report { frames_lost, restarts, .. } = report;
        let missing = 200 - good.len() as u64;
        assert_eq!((report.lost, frames_lost, restarts), (true, missing, 0), "bit {bit}, both {both}: {report:?}");
    }
}

/// A sector of the disk that cannot be read is damage like any other.
#[test]
fn a_bad_sector_costs_the_frames_in_it() {
    let folder = Folder::new();
    let sent = frames(400);
    let path = folder.path("a.mcap");
    write(&path, &sent);
    let bytes = fs::read(&path).unwrap();
    let at = place(&bytes, &sent[200]) as u64 / 4_096 * 4_096;
    let inside = sent.iter().filter(|frame| {
        let begin = place(&bytes, frame) as u64;
        begin < at + 4_096 && begin + frame.len() as u64 > at
    });
    let inside = inside.count();
    let open = |path: &Path| {
        let disk = Failing::at(&fs::read(path).unwrap(), at + 100..at + 101);
        let size = disk.bytes.len() as u64;
        log::Reader::over(Container::over(path, Box::new(disk), size, true)?)
    };
    let report = recover_with(&[path], &folder.path("out.mcap"), open, |_, _| ()).unwrap();
    assert_eq!((report.lost, report.frames_lost, report.files_missing), (true, inside as u64, 0), "{report:?}");
    assert_eq!(report.frames_lost_in_file, report.frames_lost);
    assert!(report.losses.iter().any(|loss| loss.what == "4096 bytes cannot be read: Input/output error"));
    let out = read(&folder.path("out.mcap"));
    assert_eq!(out.iter().filter(|frame| log_frame(frame)).count(), 400 - inside);
}

/// A disk that gives out in the middle: what was read before is not lost with it.
#[test]
fn a_disk_that_gives_out_costs_what_is_behind() {
    let folder = Folder::new();
    let sent = frames(400);
    let path = folder.path("a.mcap");
    write(&path, &sent);
    let large = [fs::read(&path).unwrap(), vec![0; 80 << 20]].concat();
    let open = |path: &Path| {
        let disk = Failing::at(&large, 16_384..u64::MAX);
        log::Reader::over(Container::over(path, Box::new(disk), large.len() as u64, true)?)
    };
    let report = recover_with(&[path], &folder.path("out.mcap"), open, |_, _| ()).unwrap();
    assert!(report.lost && report.files_missing == 1 && report.frames > 100, "{report:?}");
    assert!(report.bytes_lost > large.len() as u64 - 16_384 - 2_000, "{report:?}");
}

#[test]
fn a_file_that_cannot_be_opened_costs_its_own_frames() {
    let folder = Folder::new();
    let sent = frames(300);
    let path = folder.path("a.mcap");
    let options = log::Options { max_ns: 2_000_000_000, ..log::Options::default() };
    let mut log = log::Writer::create_with(&path, options).unwrap();
    for (i, frame) in sent.iter().enumerate() {
        log.frame(T + i as u64 * EVERY_NS, frame).unwrap();
    }
    log.finish().unwrap();
    let files = [path, folder.path("a.part0002.mcap"), folder.path("a.part0003.mcap")];
    let whole = files.each_ref().map(|file| fs::read(file).unwrap());
    // A bit of its mark costs nothing.
    fs::write(&files[1], [&[0x88], &whole[1][1..]].concat()).unwrap();
    let report = recover(&files, &folder.path("bit.mcap"), |_, _| ()).unwrap();
    assert_eq!((report.frames, report.frames_lost, report.damages, report.bytes_lost), (300, 0, 1, 8), "{report:?}");
    // All of it costs what it held.
    fs::write(&files[1], vec![7; whole[1].len()]).unwrap();
    let report = recover(&files, &folder.path("file.mcap"), |_, _| ()).unwrap();
    assert_eq!((report.frames, report.frames_lost, report.frames_lost_in_file), (200, 100, 100), "{report:?}");
    assert_eq!((report.files_missing, report.bytes_lost), (1, whole[1].len() as u64), "{report:?}");
    assert_eq!((&report.losses[0].file, report.losses[0].frames), (&files[1], Some(100)));
    // Of the last one no number says what it held.
    let report = recover(&files[..2], &folder.path("last.mcap"), |_, _| ()).unwrap();
    assert_eq!((report.lost, report.frames, report.frames_lost), (true, 100, 0), "{report:?}");
    assert_eq!(report.losses[0].frames, None);
    assert!(recover(&files[1..], &folder.path("first.mcap"), |_, _| ()).is_err());
}

/// A link that is lost for longer than the numbers count: that is told, and no restart is.
#[test]
fn a_loss_of_turns_of_the_numbers_is_not_known_and_no_restart() {
    for lost in [40_000, 70_000] {
        let folder = Folder::new();
        let mut sent = frames(200 + lost + 100);
        sent.drain(200..200 + lost as usize);
        let path = folder.path("a.mcap");
        write(&path, &sent);
        let report = folder.recover("a.mcap");
        assert_eq!((report.lost, report.frames_lost, report.unknown_gaps), (true, 0, 1), "{report:?}");
        assert_eq!((report.restarts, report.losses.len(), report.losses[0].frames), (0, 1, None), "{report:?}");
        let verdict = verify(&path, |_| ()).unwrap();
        assert_eq!((verdict.ok, verdict.missing_frames, verdict.unknown_gaps), (false, 0, 1), "{verdict:?}");
        let said = "frames missing before this one, too many for their numbers to count";
        assert!(verdict.problems.iter().any(|problem| problem.what == said && problem.frame == 200), "{verdict:?}");
        let info = crate::info::look(&path).unwrap();
        assert_eq!((info.counters["link.restarts"], info.counters["link.unknown_gaps"]), (0, 1));
    }
}
