//! Ctrl-C: whoever reads a log stops, says so, and leaves no output behind.

mod program;

use std::fs;
use std::path::Path;
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use crossfall::container::Error;
use crossfall::drive::Drive;
use crossfall::table::Format;
use crossfall::{
    board_words, calibrate, cloud, compare, dataset, export, info, interrupt, log, output, recover, section, verify,
};
use program::crossfall;

/// One test: the wish to stop is the process's own.
#[test]
fn every_reader_of_logs_stops_when_it_is_asked_to() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    assert!(crossfall(at, &["simulate", "--seconds", "4", "-o", "drive.mcap"]).status().unwrap().success());
    assert!(crossfall(at, &["run", "drive.mcap", "-o", "drive.log.mcap"]).status().unwrap().success());
    #[cfg(unix)]
    asked_by_a_signal(at);

    let path = &at.join("drive.log.mcap");
    let to = |name: &str| at.join(name);
    let mut reader = log::Reader::open(path).unwrap();
    assert!(reader.next().unwrap().is_ok());
    interrupt::request();
    assert!(matches!(reader.next(), Some(Err(Error::Interrupted))));
    assert!(reader.next().is_none());
    let stopped = |name: &str, error: Option<String>| {
        let error = error.unwrap_or_else(|| panic!("{name} went on"));
        assert!(error.contains("interrupted"), "{name}: {error}");
    };
    let text = |error: &dyn std::error::Error| error.to_string();
    stopped("verify", verify::verify(path, |_| ()).err().map(|e| text(&e)));
    stopped("calibrate", calibrate::read(path).err().map(|e| text(&e)));
    stopped("compare", compare::Drive::read(path).err().map(|e| text(&e)));
    stopped("info", info::look(path).err().map(|e| text(&e)));
    stopped("messages", board_words::read::<Error>(path, None, |_| Ok(())).err().map(|e| text(&e)));
    stopped("report", Drive::read(path, |_| ()).err().map(|e| text(&e)));
    stopped("plot", section::of_scan(path, 3).err().map(|e| text(&e)));
    stopped("view", cloud::Stretch::read(path, 0.0, 9.0).err().map(|e| text(&e)));
    stopped(
        "cloud",
        cloud::write(std::slice::from_ref(path), cloud::Format::Ply, &to("a.ply"), |_, _| ()).err().map(|e| text(&e)),
    );
    stopped("export", export::foxglove(path, &to("a.fox.mcap"), |_| ()).err().map(|e| text(&e)));
    stopped("profiles", dataset::write(path, None, Format::Csv, &to("a.csv"), |_| ()).err().map(|e| text(&e)));
    stopped("data set", dataset::Partition::of(path, None).err().map(|e| text(&e)));
    stopped("recover", recover::recover(std::slice::from_ref(path), &to("b.mcap"), |_, _| ()).err().map(|e| text(&e)));
    stopped("an output", output::write(&to("a.txt"), b"half").err().map(|e| text(&e)));
    let mut left: Vec<_> = fs::read_dir(at).unwrap().map(|entry| entry.unwrap().file_name()).collect();
    left.sort();
    assert_eq!(left, ["drive.log.mcap", "drive.mcap"]);
}

/// `verify` of so many files that it takes a while.
#[cfg(unix)]
fn asked_by_a_signal(folder: &Path) {
    let links = tempfile::tempdir_in(folder).unwrap();
    let names: Vec<String> = (0..4_000).map(|number| format!("{number}.mcap")).collect();
    for name in &names {
        fs::hard_link(folder.join("drive.log.mcap"), links.path().join(name)).unwrap();
    }
    let arguments: Vec<&str> = std::iter::once("verify").chain(names.iter().map(String::as_str)).collect();
    let began = Instant::now();
    let child = crossfall(links.path(), &arguments).stdout(Stdio::null()).spawn().unwrap();
    std::thread::sleep(Duration::from_millis(1_000));
    assert!(Command::new("kill").args(["-INT", &child.id().to_string()]).status().unwrap().success());
    let ended = child.wait_with_output().unwrap();
    let said = String::from_utf8_lossy(&ended.stderr).into_owned();
    assert_eq!((ended.status.code(), said.as_str()), (Some(1), "crossfall: interrupted\n"), "{:?}", began.elapsed());
}
