use std::fs;

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
    assert!(error.ends_with("not a log: it has no channel `wire`"), "{error}");
}

#[test]
fn a_live_log_replaces_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.mcap");
    fs::write(&path, b"last year's drive").unwrap();
    assert!(Writer::create_live(&path).is_err());
    assert_eq!(fs::read(&path).unwrap(), b"last year's drive");
}
