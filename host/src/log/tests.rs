use std::collections::BTreeMap;
use std::fs;
use std::path::Path;

use crossfall_core::protocol::DeviceTime;
use crossfall_core::protocol::frame::{MAX_MESSAGE_FRAME, Sequencer};
use crossfall_core::protocol::message::{Message, Pulse, PulseVerdict};

use super::*;

/// A log of `count` frames 27 ms apart, with metadata.
fn sample(path: &Path, count: u64) -> Vec<(u64, Vec<u8>)> {
    let mut writer = Writer::create_live(path).unwrap();
    writer
        .metadata(metadata::IDENTITY, BTreeMap::from([("firmware".to_owned(), "crossfall 0.1.0".to_owned())]))
        .unwrap();
    let frames: Vec<_> = (0..count).map(|i| (5_000_000_000 + i * 27_000_000, vec![i as u8 + 1; 12])).collect();
    for (time, bytes) in &frames {
        writer.frame(*time, bytes).unwrap();
    }
    writer.finish().unwrap();
    frames
}

fn read(path: &Path) -> (Vec<(u64, Vec<u8>)>, Vec<Error>) {
    let (mut frames, mut errors) = (Vec::new(), Vec::new());
    match Reader::open(path) {
        Ok(reader) => reader.for_each(|item| match item {
            Ok(frame) => frames.push((frame.receive_ns, frame.bytes)),
            Err(error) => errors.push(error),
        }),
        Err(error) => errors.push(error),
    }
    (frames, errors)
}

#[test]
fn frames_and_metadata_come_back_with_their_places() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.mcap");
    let written = sample(&path, 60);
    let bytes = fs::read(&path).unwrap();
    let reader = Reader::open(&path).unwrap();
    assert_eq!(reader.metadata()[metadata::IDENTITY]["firmware"], "crossfall 0.1.0");
    let frames: Vec<_> = reader.map(Result::unwrap).collect();
    assert_eq!(frames.len(), written.len());
    for (frame, (time, data)) in frames.iter().zip(&written) {
        assert_eq!((frame.receive_ns, &frame.bytes), (*time, data));
        // Opcode, length, channel, sequence, two times: 31 bytes before the frame itself.
        assert_eq!(&bytes[frame.offset as usize + 31..][..12], data);
    }
}

#[test]
fn a_log_cut_at_any_byte_lacks_at_most_one_second() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.mcap");
    let written = sample(&path, 60);
    let whole = fs::read(&path).unwrap();
    let reader = Reader::open(&path).unwrap();
    let places: Vec<_> = reader.map(|frame| frame.unwrap().offset).collect();
    let cut = folder.path().join("cut.mcap");
    for length in (0..whole.len()).filter(|length| *length < 400 || length % 7 == 0) {
        fs::write(&cut, &whole[..length]).unwrap();
        let (frames, errors) = read(&cut);
        assert_eq!(frames, written[..frames.len()], "cut at {length}");
        // Whatever lay whole before the cut is read.
        let before = places.iter().filter(|&&place| place + 43 <= length as u64).count();
        assert!(frames.len() >= before, "cut at {length}: {} of {before}", frames.len());
        assert!(errors.len() == 1 || length + 37 >= whole.len(), "cut at {length}: {errors:?}");
    }
}

#[test]
fn any_flipped_bit_costs_at_most_one_chunk() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.mcap");
    let written = sample(&path, 80);
    let whole = fs::read(&path).unwrap();
    let hit = folder.path().join("hit.mcap");
    // Up to the summary: 80 frames of 27 ms are five chunks of at most 19 frames.
    let end = whole.windows(12).rposition(|window| window == [80; 12]).unwrap() + 12;
    for at in (mcap::MAGIC.len()..end).filter(|at| *at < 400 || at % 7 == 0) {
        let mut bytes = whole.clone();
        bytes[at] ^= 1 << (at % 8);
        fs::write(&hit, &bytes).unwrap();
        let (frames, _) = read(&hit);
        let intact = frames.iter().filter(|frame| written.contains(frame)).count();
        assert!(intact + 19 >= written.len(), "a bit at {at}: {intact} of {}", written.len());
    }
}

#[test]
fn a_log_that_has_another_file_in_the_middle_goes_on_behind_it() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.mcap");
    let written = sample(&path, 80);
    let mut bytes = fs::read(&path).unwrap();
    let at = bytes.windows(12).position(|window| window == [30; 12]).unwrap();
    bytes[at - 31..][..2000].fill(0xa5);
    fs::write(&path, &bytes).unwrap();
    let (frames, errors) = read(&path);
    assert!(!errors.is_empty());
    assert!(errors[0].offset().unwrap().abs_diff(at as u64) < 1_000, "{errors:?}");
    assert_eq!(frames.last(), written.last());
    assert!(frames.len() > 20);
}

#[test]
fn a_capture_is_not_a_log() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.mcap");
    crate::capture::Writer::create(&path).unwrap().finish().unwrap();
    let error = Reader::open(&path).unwrap_err().to_string();
    assert!(error.contains("not a log: it has no channel `wire`; it is a capture"), "{error}");
}

#[test]
fn a_live_log_replaces_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.mcap");
    fs::write(&path, b"last year's drive").unwrap();
    assert!(Writer::create_live(&path).is_err());
    assert_eq!(fs::read(&path).unwrap(), b"last year's drive");
}

/// Good frames 27 ms apart, as a closed log.
fn good(path: &Path, count: u64, options: Options) -> Vec<(u64, Vec<u8>)> {
    let mut sequencer = Sequencer::new();
    let mut writer = Writer::create_with(path, options).unwrap();
    let identity = BTreeMap::from([("firmware".to_owned(), "crossfall 0.1.0".to_owned())]);
    writer.metadata(metadata::IDENTITY, identity).unwrap();
    let frames: Vec<_> = (0..count)
        .map(|i| {
            let mut out = [0; MAX_MESSAGE_FRAME];
            let pulse = Pulse { time: DeviceTime(i * 1_000_003), verdict: PulseVerdict::Accepted };
            let length = sequencer.message(&Message::Pulse(pulse), &mut out).unwrap();
            (1_790_000_000_000_000_000 + i * 27_000_000, out[..length].to_vec())
        })
        .collect();
    for (time, bytes) in &frames {
        writer.frame(*time, bytes).unwrap();
    }
    writer.finish().unwrap();
    frames
}

/// Where in a log the record of the first of its frames begins and that of the last ends.
fn records(whole: &[u8], written: &[(u64, Vec<u8>)]) -> (usize, usize) {
    let (first, last) = (&written[0].1, &written.last().unwrap().1);
    let begin = whole.windows(first.len()).position(|window| window == first).unwrap() - 31;
    (begin, whole.windows(last.len()).rposition(|window| window == last).unwrap() + last.len())
}

/// The strongest promise: any bit, anywhere before the summary. All frames but the one that was hit are read, with their times but for at most one, and it is told.
#[test]
fn any_flipped_bit_of_a_closed_log_costs_at_most_one_frame_and_is_told() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.mcap");
    let written = good(&path, 40, Options::default());
    let whole = fs::read(&path).unwrap();
    let (clean, errors) = read(&path);
    assert!(errors.is_empty() && clean == written, "{errors:?}");
    let (_, end) = records(&whole, &written);
    let hit = folder.path().join("hit.mcap");
    for at in mcap::MAGIC.len()..end {
        // Every bit up to the first frames, one bit of each byte behind.
        let bits = if at < 320 { 0..8 } else { at % 8..at % 8 + 1 };
        for bit in bits {
            let mut bytes = whole.clone();
            bytes[at] ^= 1 << bit;
            fs::write(&hit, &bytes).unwrap();
            let (frames, errors) = read(&hit);
            assert!(!errors.is_empty(), "bit {bit} of byte {at} is not told");
            let whole_ones = frames.iter().filter(|frame| written.contains(frame)).count();
            let bytes_right =
                written.iter().filter(|(_, bytes)| frames.iter().any(|(_, found)| found == bytes)).count();
            assert!(bytes_right + 1 >= written.len(), "bit {bit} of byte {at}: {bytes_right} frames, {errors:?}");
            assert!(whole_ones + 1 >= written.len(), "bit {bit} of byte {at}: {whole_ones} with their times");
            assert!(frames.len() <= written.len(), "bit {bit} of byte {at}: {} frames", frames.len());
        }
    }
}

#[test]
fn a_packed_log_reads_the_same_and_is_smaller() {
    let folder = tempfile::tempdir().unwrap();
    let (plain, packed) = (folder.path().join("a.mcap"), folder.path().join("b.mcap"));
    let written = good(&plain, 400, Options::default());
    good(&packed, 400, Options { compress: true, ..Options::default() });
    assert_eq!(read(&packed).0, written);
    let size = |path: &Path| fs::metadata(path).unwrap().len();
    assert!(size(&packed) < size(&plain));
}

#[test]
fn a_full_file_is_followed_by_another_that_says_who_sends() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("drive.log.mcap");
    let taken = folder.path().join("drive.log.part0003.mcap");
    fs::write(&taken, b"somebody's").unwrap();
    let options = Options { max_bytes: 3_000, ..Options::default() };
    let written = good(&path, 300, options);
    assert_eq!(fs::read(&taken).unwrap(), b"somebody's");
    let names =
        ["drive.log.mcap", "drive.log.part0002.mcap", "drive.log.part0004.mcap"].map(|name| folder.path().join(name));
    let mut all = Vec::new();
    for (i, name) in names.iter().enumerate() {
        let reader = Reader::open(name).unwrap();
        assert_eq!(reader.metadata()[metadata::IDENTITY]["firmware"], "crossfall 0.1.0");
        if i == 1 {
            assert_eq!(reader.metadata()[metadata::PART]["before"], "drive.log.mcap");
        }
        all.extend(reader.map(Result::unwrap).map(|frame| (frame.receive_ns, frame.bytes)));
    }
    assert!(all.len() < written.len() && all[..] == written[..all.len()], "more files follow");
}

/// All numbers but the last are taken: the recording has two files, whatever their size, and a reader finds both.
#[test]
fn behind_the_last_number_the_file_grows_on() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("drive.log.mcap");
    let last = folder.path().join(format!("drive.log.part{PARTS}.mcap"));
    let ours = [path.clone(), last.clone()];
    let open = move |path: &Path| -> std::io::Result<Box<dyn Storage>> {
        if !ours.iter().any(|one| one == path) {
            return Err(std::io::ErrorKind::AlreadyExists.into());
        }
        Ok(Box::new(fs::File::create_new(path)?))
    };
    let options = Options { max_ns: 1_000_000_000, ..Options::default() };
    let mut writer = Writer::create_over(&path, options, Box::new(open)).unwrap();
    let frames: Vec<_> = (0..300_u64).map(|i| (i * 20_000_000, vec![i as u8 | 1; 12])).collect();
    let mut full = None;
    for (time, bytes) in &frames {
        writer.frame(*time, bytes).unwrap();
        full = full.or(writer.is_last().then_some(*time));
    }
    assert_eq!((writer.parts(), writer.path(), full), (2, &*last, Some(2_000_000_000)));
    writer.finish().unwrap();
    assert_eq!(Parts::of(&path).unwrap().files, [path.clone(), last]);
    let read: Vec<_> = Recording::open(&path).unwrap().map(Result::unwrap).collect();
    assert!(read.iter().map(|frame| (frame.receive_ns, frame.bytes.clone())).eq(frames));
}

#[test]
fn two_writers_never_have_one_file() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.mcap");
    let made = std::thread::scope(|scope| {
        let writers: Vec<_> = (0..8).map(|_| scope.spawn(|| Writer::create_live(&path).is_ok())).collect();
        writers.into_iter().filter(|_| true).map(|writer| writer.join().unwrap()).filter(|made| *made).count()
    });
    assert_eq!(made, 1);
}

/// What replaces files must not take the name of one that grows.
#[cfg(unix)]
#[test]
fn a_recording_is_not_replaced_while_it_grows_nor_when_it_is_done() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.mcap");
    let mut live = Writer::create_live(&path).unwrap();
    assert!(is_being_written(&path));
    let error = Writer::create(&path).err().expect("refused").to_string();
    assert!(error.ends_with("a recording is being written to it"), "{error}");
    live.frame(1, &[1, 0]).unwrap();
    live.finish().unwrap();
    assert!(!is_being_written(&path));
    let error = Writer::create(&path).err().expect("refused").to_string();
    assert!(error.contains("it is a recording of a board"), "{error}");
}

/// The head of a chunk without compression whose record has a body of so many bytes.
fn chunk_head(length: u64) -> Vec<u8> {
    let mut head = vec![mcap::records::op::CHUNK];
    head.extend(length.to_le_bytes());
    head.extend([0_u64, 0, 0].map(u64::to_le_bytes).concat());
    head.extend([1_u32, 0].map(u32::to_le_bytes).concat());
    head.extend((length - 40).to_le_bytes());
    head
}

/// Chunks within chunks, each of which agrees with its header: what they hold is read once, with the outermost.
#[test]
fn chunks_within_each_other_are_read_once() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.mcap");
    let written = good(&path, 19, Options::default());
    let whole = fs::read(&path).unwrap();
    let (first, end) = records(&whole, &written);
    for depth in [5, 100_000] {
        let mut bytes = mcap::MAGIC.to_vec();
        let all = mcap::MAGIC.len() + depth * 49 + end - first;
        while bytes.len() < mcap::MAGIC.len() + depth * 49 {
            bytes.extend(chunk_head((all - bytes.len() - 9) as u64));
        }
        bytes.extend(&whole[first..end]);
        bytes.extend([0x70; 64]);
        fs::write(&path, &bytes).unwrap();
        let (frames, errors) = read(&path);
        assert!(frames == written, "{depth}: {} frames", frames.len());
        assert!(errors.len() <= 3, "{depth}: {} places told as damaged", errors.len());
    }
}

/// Records within records that are not what they say, and a chunk in each: the search does not begin anew in each of them for ever.
#[test]
fn records_within_each_other_are_not_searched_again_and_again() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.mcap");
    let written = good(&path, 19, Options::default());
    let whole = fs::read(&path).unwrap();
    let (first, end) = records(&whole, &written);
    let (count, step) = (10_000, 9 + 49);
    let mut bytes = mcap::MAGIC.to_vec();
    let all = mcap::MAGIC.len() + count * step + end - first;
    for _ in 0..count {
        let metadata = (all - bytes.len() - 9) as u64;
        bytes.push(mcap::records::op::METADATA);
        bytes.extend(metadata.to_le_bytes());
        bytes.extend(chunk_head(40));
    }
    bytes.extend(&whole[first..end]);
    bytes.extend([0x70; 64]);
    fs::write(&path, &bytes).unwrap();
    let (frames, errors) = read(&path);
    assert!(frames == written, "{} frames", frames.len());
    assert!(errors.len() < 100, "{} places told as damaged", errors.len());
}
