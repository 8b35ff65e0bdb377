//! A recording of several files: one after the other, and the last one on and on where there can be no other.

use super::*;

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
        full = full.or((writer.grows_on() == Some(GrowsOn::Numbers)).then_some(*time));
    }
    assert_eq!((writer.parts(), writer.path(), full), (2, &*last, Some(2_000_000_000)));
    writer.finish().unwrap();
    assert_eq!(Parts::of(&path).unwrap().files, [path.clone(), last]);
    let read: Vec<_> = Recording::open(&path).unwrap().map(Result::unwrap).collect();
    assert!(read.iter().map(|frame| (frame.receive_ns, frame.bytes.clone())).eq(frames));
}

/// A folder that takes no new file for two minutes: the first file grows on, says why, and is followed a minute after the folder takes files again. What had
/// been made and could not be written is gone.
#[test]
fn a_recording_goes_on_where_the_next_file_cannot_be_made() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("drive.log.mcap");
    let tries = std::sync::Arc::new(std::sync::atomic::AtomicU32::new(0));
    let (first, counted) = (path.clone(), std::sync::Arc::clone(&tries));
    let open = move |path: &Path| -> std::io::Result<Box<dyn Storage>> {
        if path == first {
            return Ok(Box::new(fs::File::create_new(path)?));
        }
        match counted.fetch_add(1, std::sync::atomic::Ordering::Relaxed) {
            0 => Err(std::io::ErrorKind::PermissionDenied.into()),
            // The name is made, and no byte has room.
            1 => Ok(Box::new(Full(fs::File::create_new(path)?))),
            _ => Ok(Box::new(fs::File::create_new(path)?)),
        }
    };
    let options = Options { max_ns: 10_000_000_000, ..Options::default() };
    let mut writer = Writer::create_over(&path, options, Box::new(open)).unwrap();
    let frames: Vec<_> = (0..700_u64).map(|i| (i * 200_000_000, vec![i as u8 | 1; 12])).collect();
    let mut told = Vec::new();
    for (time, bytes) in &frames {
        writer.frame(*time, bytes).unwrap();
        let now = (writer.parts(), writer.grows_on());
        if told.last().map(|(_, before)| before) != Some(&now) {
            told.push((*time / 1_000_000_000, now));
        }
    }
    writer.finish().unwrap();
    let why = |what: &str| {
        let next = folder.path().join("drive.log.part0002.mcap");
        Some(GrowsOn::NoNext { why: format!("{}: cannot write: {what}", next.display()) })
    };
    assert_eq!(told.iter().map(|(at, _)| *at).collect::<Vec<_>>(), [0, 10, 70, 130]);
    assert_eq!(told[1].1, (1, why("permission denied")));
    assert_eq!((told[2].1.0, &told[3].1), (1, &(2, None)));
    assert_eq!(tries.load(std::sync::atomic::Ordering::Relaxed), 3);
    assert_eq!(Parts::of(&path).unwrap().files, [path.clone(), folder.path().join("drive.log.part0002.mcap")]);
    let read: Vec<_> = Recording::open(&path).unwrap().map(Result::unwrap).collect();
    assert!(read.iter().map(|frame| (frame.receive_ns, frame.bytes.clone())).eq(frames));
}

/// A file on a disk without room.
struct Full(#[expect(dead_code, reason = "it is open")] fs::File);

impl std::io::Write for Full {
    fn write(&mut self, _: &[u8]) -> std::io::Result<usize> {
        Err(std::io::ErrorKind::StorageFull.into())
    }

    fn flush(&mut self) -> std::io::Result<()> {
        Ok(())
    }
}

impl Storage for Full {
    fn sync(&mut self) -> std::io::Result<()> {
        Ok(())
    }
}

/// Nine bytes are added to the name of a file that follows.
#[cfg(unix)]
#[test]
fn a_name_without_room_for_a_number_is_refused_at_the_start() {
    let folder = tempfile::tempdir().unwrap();
    let named = |bytes: usize| folder.path().join(format!("{}.mcap", "n".repeat(bytes - 5)));
    let error = Writer::create_live(&named(247)).err().expect("refused").to_string();
    let expected = "the name has 247 bytes, and at most 246 are allowed here: the files that may follow are called NAME.part0002 and so on";
    assert!(error.ends_with(expected), "{error}");
    assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 0);
    let written = good(&named(246), 200, Options { max_ns: 2_000_000_000, ..Options::default() });
    let parts = Parts::of(&named(246)).unwrap();
    assert_eq!(parts.files.len(), 3);
    let read: Vec<_> = Recording::open(&named(246)).unwrap().map(Result::unwrap).collect();
    assert!(read.into_iter().map(|frame| (frame.receive_ns, frame.bytes)).eq(written));
}
