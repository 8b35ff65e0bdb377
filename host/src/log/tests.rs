mod rotation;

use std::collections::BTreeMap;
use std::fs;
use std::path::Path;

use crossfall_core::protocol::DeviceTime;
use crossfall_core::protocol::frame::{MAX_MESSAGE_FRAME, Sequencer};
use crossfall_core::protocol::message::{Message, Pulse, PulseVerdict};

use super::*;
use crate::container::Container;
use crate::container::disk::MOST;
use crate::container::disk::tests::Failing;

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
    for at in (0..end).filter(|at| *at < 400 || at % 7 == 0) {
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

/// The strongest promise: any bit, anywhere in the file. All frames but the one that was hit are read, with their times but for at most one, and it is told.
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
    for at in 0..whole.len() {
        // Every bit up to the first frames and behind the last, one bit of each byte between.
        let bits = if at < 320 || at >= end { 0..8 } else { at % 8..at % 8 + 1 };
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
            if at >= end {
                assert!(whole_ones == written.len(), "bit {bit} of byte {at}: a frame is lost behind all of them");
                let cut = errors.iter().any(|error| matches!(error, Error::Cut { .. }));
                assert!(!cut, "bit {bit} of byte {at}: {errors:?}");
            }
        }
    }
}

/// Writers of other programs may leave the index's CRC out, and the index.
#[test]
fn an_index_without_a_crc_is_nothing_wrong() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.mcap");
    let written = good(&path, 40, Options::default());
    let mut bytes = fs::read(&path).unwrap();
    let crc = bytes.len() - mcap::MAGIC.len() - 4;
    bytes[crc..crc + 4].fill(0);
    fs::write(&path, &bytes).unwrap();
    let (frames, errors) = read(&path);
    assert!(errors.is_empty() && frames == written, "{errors:?}");
    // Nothing between the end of the data and the footer, with both CRCs and with none.
    let end = bytes.iter().rposition(|&byte| byte == mcap::records::op::DATA_END);
    let end = (0..=end.unwrap()).rev().find(|&at| bytes[at..].starts_with(&[15, 4, 0, 0, 0, 0, 0, 0, 0])).unwrap() + 13;
    let mut footer = vec![mcap::records::op::FOOTER];
    footer.extend([20_u64, 0, 0].map(u64::to_le_bytes).concat());
    for crc in [crc32fast::hash(&footer), 0] {
        let closing = [&footer[..], &crc.to_le_bytes(), mcap::MAGIC].concat();
        fs::write(&path, [&bytes[..end], &closing].concat()).unwrap();
        let (frames, errors) = read(&path);
        assert!(errors.is_empty() && frames == written, "{errors:?}");
    }
}

/// Zeros where a sector was: from any byte of a record's head on. A time that is 0 twice is said by nobody.
#[test]
fn zeros_over_records_make_up_no_frame_and_no_time() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.mcap");
    let written = good(&path, 200, Options::default());
    let whole = fs::read(&path).unwrap();
    let frame = &written[100].1;
    let head = whole.windows(frame.len()).position(|window| window == frame).unwrap() - salvage::HEAD;
    for from in head..head + salvage::HEAD {
        let mut bytes = whole.clone();
        bytes[from..from + 600].fill(0);
        fs::write(&path, &bytes).unwrap();
        let (frames, errors) = read(&path);
        assert!(!errors.is_empty(), "zeros from byte {} of the head", from - head);
        assert!(frames.len() >= 180, "{} frames", frames.len());
        assert!(frames.iter().all(|frame| written.iter().any(|(_, bytes)| frame.1 == *bytes)), "made up");
        assert!(frames.is_sorted_by_key(|(time, _)| *time) && frames[0].0 == written[0].0, "a time went back");
    }
}

/// A block that stands a second time further on, and whose records have lost their heads where they belong.
#[test]
fn a_frame_without_a_head_is_not_read_again_from_a_copy_that_has_one() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.mcap");
    let written = good(&path, 200, Options::default());
    let whole = fs::read(&path).unwrap();
    let at = |number: usize| {
        let frame = &written[number].1;
        whole.windows(frame.len()).position(|window| window == frame).unwrap() - salvage::HEAD
    };
    for damaged in 1..8 {
        let mut bytes = whole.clone();
        let copied = at(100)..at(100 + damaged);
        bytes.copy_within(copied.clone(), at(150));
        for number in 100..100 + damaged {
            bytes[at(number)..][..salvage::HEAD].fill(0xa5);
        }
        fs::write(&path, &bytes).unwrap();
        let mut places = Vec::new();
        let mut read = vec![0; written.len()];
        for frame in Reader::open(&path).unwrap().flatten() {
            places.push(frame.offset);
            if let Some(number) = written.iter().position(|(_, bytes)| *bytes == frame.bytes) {
                read[number] += 1;
            }
        }
        assert!(read.iter().all(|&times| times <= 1), "{damaged}: {read:?}");
        assert_eq!(read[..150], [1; 150], "{damaged} heads damaged");
        assert!(places.is_sorted(), "{damaged}: {places:?}");
    }
}

/// Joined files, which is no way to join logs, and what a disk or a tool leaves at the end of one.
#[test]
fn what_lies_behind_the_end_is_told_and_searched() {
    let folder = tempfile::tempdir().unwrap();
    let (one, other) = (folder.path().join("a.mcap"), folder.path().join("b.mcap"));
    let written = [good(&one, 60, Options::default()), sample(&other, 40)].concat();
    let (first, second) = (fs::read(&one).unwrap(), fs::read(&other).unwrap());
    fs::write(&one, [&first[..], &second].concat()).unwrap();
    let (frames, errors) = read(&one);
    assert_eq!(frames, written);
    assert!(errors.len() == 1 && errors[0].to_string().contains("bytes behind the closing records"), "{errors:?}");
    // The same once more: each of its frames is read once.
    fs::write(&one, [&first[..], &first].concat()).unwrap();
    let (frames, errors) = read(&one);
    assert_eq!(frames, written[..60]);
    assert!(errors.len() == 2 && errors[1].to_string().contains("60 frames stand here a second time"), "{errors:?}");
    for behind in [vec![0; 5_000], b"somebody's notes".to_vec(), vec![0x89]] {
        fs::write(&one, [&first[..], &behind].concat()).unwrap();
        let (frames, errors) = read(&one);
        assert_eq!(frames, written[..60]);
        assert_eq!(errors.len(), 1, "{} bytes: {errors:?}", behind.len());
    }
    // The mark that ends the file says nothing more: a cut within it costs nothing.
    for left in 1..8 {
        fs::write(&one, &first[..first.len() - left]).unwrap();
        assert!(read(&one).1.is_empty(), "{left} bytes cut");
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

/// What is gone from the beginning of a log costs the frames that were there and no others, whatever else it held.
#[test]
fn a_log_whose_beginning_is_gone_is_read_from_its_first_whole_frame_on() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.mcap");
    let written = good(&path, 200, Options::default());
    let whole = fs::read(&path).unwrap();
    let at = |frame: &(u64, Vec<u8>)| whole.windows(frame.1.len()).position(|window| window == frame.1).unwrap();
    for (gone, with) in [(1, 0), (8, 0), (9, 0xff), (512, 0), (512, 0xa5), (2_000, 0), (4_096, 0)] {
        let mut bytes = whole.clone();
        bytes[..gone].fill(with);
        fs::write(&path, &bytes).unwrap();
        let expected: Vec<_> = written.iter().filter(|frame| at(frame) >= gone).cloned().collect();
        let mut reader = Reader::open(&path).unwrap();
        assert_eq!(reader.next().unwrap().unwrap_err().offset(), Some(0), "{gone}");
        let bytes_found: Vec<_> = reader.by_ref().flatten().map(|frame| frame.bytes).collect();
        let expected: Vec<_> = expected.into_iter().map(|(_, bytes)| bytes).collect();
        // Where the head of a frame is something else than zeros, nothing says where the frame begins.
        let without = usize::from(with != 0 && bytes_found.first() != expected.first());
        assert!(
            bytes_found == expected[without..],
            "{gone} of {with:02x}: {} of {}",
            bytes_found.len(),
            expected.len()
        );
        assert!(reader.unread() > 0, "{gone}");
        // Without the mark at its end as well.
        fs::write(&path, &bytes[..bytes.len() - 600]).unwrap();
        assert!(read(&path).0.len() > 100, "{gone}");
    }
}

#[test]
fn what_is_no_log_is_refused_before_it_is_read() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.mcap");
    let refused = |path: &Path| {
        let error = Reader::open(path).unwrap_err();
        assert!(matches!(error, Error::Foreign { .. }), "{error}");
        error.to_string()
    };
    let mut random = 1_u64;
    let noise: Vec<u8> = (0..3_000_000)
        .map(|_| {
            random = random.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (random >> 33) as u8
        })
        .collect();
    for bytes in [&b""[..], b"no log", &noise] {
        fs::write(&path, bytes).unwrap();
        refused(&path);
    }
    assert!(refused(&path).contains(": not an MCAP file: it begins with "));
    // A capture whose first byte is damaged is a log no more than a whole one.
    fs::remove_file(&path).unwrap();
    let mut capture = crate::capture::Writer::create(&path).unwrap();
    capture.write(crate::capture::Channel::Ins, 1, &[1, 2, 3, 0]).unwrap();
    capture.finish().unwrap();
    let mut bytes = fs::read(&path).unwrap();
    bytes[0] ^= 1;
    fs::write(&path, &bytes).unwrap();
    refused(&path);
    // 64 GiB of nothing.
    fs::File::create(&path).unwrap().set_len(64 << 30).unwrap();
    refused(&path);
}

/// Reads a log from a disk that cannot read some places.
fn read_failing(bytes: &[u8], place: std::ops::Range<u64>) -> Result<Reader, Error> {
    let disk = Box::new(Failing::at(bytes, place));
    Reader::over(Container::over(Path::new("a.mcap"), disk, bytes.len() as u64, true)?)
}

/// Whichever sector of the disk is bad, only the frames in it are lost.
#[test]
fn a_sector_that_cannot_be_read_costs_the_frames_in_it_and_is_told() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.mcap");
    let written = good(&path, 400, Options::default());
    let whole = fs::read(&path).unwrap();
    assert!(whole.len() > 5 * 4_096);
    for bad in 0..whole.len().div_ceil(4_096) as u64 {
        let (from, to) = (bad * 4_096, ((bad + 1) * 4_096).min(whole.len() as u64));
        let mut reader = read_failing(&whole, from..from + 1).unwrap();
        let (mut frames, mut told) = (Vec::new(), Vec::new());
        for item in reader.by_ref() {
            match item {
                Ok(frame) => frames.push(frame.bytes),
                Err(error) => told.push(error),
            }
        }
        let what = format!("{} bytes cannot be read: Input/output error", to - from);
        let said = |error: &Error| error.offset() == Some(from) && error.what() == what;
        assert_eq!(told.iter().filter(|error| said(error)).count(), 1, "{bad}: {told:?}");
        let outside = written.iter().filter(|(_, frame)| {
            let at = whole.windows(frame.len()).position(|window| window == frame).unwrap() as u64;
            at + frame.len() as u64 <= from || at >= to
        });
        for (number, (_, frame)) in outside.enumerate() {
            assert!(frames.contains(frame), "{bad}: {number}");
        }
        // What was partly within is not made up.
        assert!(frames.len() <= written.len(), "{bad}");
    }
}

#[test]
fn a_disk_that_fails_everywhere_is_an_error_that_says_so() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.mcap");
    good(&path, 400, Options::default());
    let whole = fs::read(&path).unwrap();
    let error = read_failing(&whole, 0..u64::MAX).unwrap_err();
    assert!(matches!(error, Error::Io { .. }), "{error}");
    assert_eq!(error.to_string(), "a.mcap: Input/output error");
    let large = vec![0; (MOST + 1_000) * 4_096];
    let reader = read_failing(&[&whole[..], &large].concat(), 8_192..u64::MAX).unwrap();
    let (frames, errors): (Vec<_>, Vec<_>) = reader.partition(Result::is_ok);
    assert!(frames.len() > 20 && errors.len() < 20, "{} frames, {} errors", frames.len(), errors.len());
    let last = errors.last().unwrap().as_ref().unwrap_err();
    assert!(matches!(last, Error::Io { .. }) && last.to_string().ends_with("it is given up"), "{last}");
}
