//! Readers of files: logs and captures with any bytes in them, scenes and configurations that a user wrote.

use std::cell::RefCell;
use std::fs::File;
use std::io::{Seek, Write};
use std::path::Path;

use crossfall::{capture, config, info, log, simulate, verify};
use tempfile::NamedTempFile;

thread_local! {
    /// One file for all inputs, in memory where the system has such a folder.
    static FILE: RefCell<NamedTempFile> = RefCell::new({
        let memory = Path::new("/dev/shm");
        let made = if memory.is_dir() { NamedTempFile::new_in(memory) } else { NamedTempFile::new() };
        made.expect("a temporary file")
    });
}

fn with_file(input: &[u8], read: impl FnOnce(&Path)) {
    FILE.with_borrow_mut(|file| {
        let handle: &mut File = file.as_file_mut();
        handle.set_len(0).expect("an empty file");
        handle.rewind().expect("its beginning");
        handle.write_all(input).expect("room in memory");
        read(file.path());
    });
}

/// Whatever the file holds: reading it ends, offsets lie within it, and in plain chunks no frame comes twice: each has a place of its own, but for those read
/// out of blocks that have changed places, which have the place of the frame that they stand before.
pub fn log_reader(input: &[u8]) {
    with_file(input, |path| {
        let mut items = 0;
        let packed = input.windows(4).any(|name| name == b"zstd") || input.windows(3).any(|name| name == b"lz4");
        let (mut last, mut here) = (0, Vec::new());
        if let Ok(reader) = log::Reader::open(path) {
            for item in reader {
                items += 1;
                match item {
                    Ok(frame) => {
                        assert!(frame.offset <= input.len() as u64);
                        // What is no frame may be empty, and a frame in the very first bytes has no room for a record's head before it.
                        if !packed && !frame.bytes.is_empty() && frame.offset > 0 {
                            assert!(frame.offset >= last, "a frame at {} behind one at {last}", frame.offset);
                            if frame.offset > last {
                                here.clear();
                            }
                            last = frame.offset;
                            assert!(!here.contains(&frame.bytes), "a frame at {last} comes twice");
                            here.push(frame.bytes);
                        }
                    }
                    Err(error) => {
                        assert!(error.offset().is_none_or(|offset| offset <= input.len() as u64), "{error}");
                    }
                }
                // A message record takes 31 bytes; compressed ones far less, but chunks bound them.
                assert!(items <= 64 + 1_000 * input.len(), "{items} items out of {} bytes", input.len());
            }
        }
        if let Ok(report) = verify::verify(path, |_| ()) {
            assert!(!report.ok || report.problem_count == 0);
            assert!(report.profiles_reproduced + report.profiles_unverifiable <= report.profiles);
        }
        if let Ok(reader) = capture::Reader::open(path) {
            assert!(reader.count() <= 64 + 1_000 * input.len());
        }
        let _ = info::look(path);
    });
}

/// What is accepted is printed and read back as the same configuration, and is one that the board accepts.
pub fn config_toml(input: &[u8]) {
    let text = String::from_utf8_lossy(input);
    match config::parse(Path::new("f.toml"), &text) {
        Ok(config) => {
            let again = config::parse(Path::new("f.toml"), &config::to_toml(&config)).expect("its own words");
            assert_eq!(again, config);
            assert!(config.check().is_ok(), "{text}");
        }
        Err(error) => assert!(!error.to_string().contains('\n'), "{error:?}"),
    }
}

pub fn scene_toml(input: &[u8]) {
    with_file(input, |path| {
        if let Err(error) = simulate::scene::Scene::read(path) {
            assert!(!error.to_string().contains('\n'), "{error:?}");
        }
    });
}
