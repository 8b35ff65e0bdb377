//! `recover` and `run --faults` as a user meets them: what is said, and the exit status.

mod program;

use std::fs;
use std::path::Path;

use crossfall::log;
use program::ends;

fn drive(folder: &Path) {
    ends(folder, &["simulate", "--seconds", "4", "-o", "drive.mcap"], 0);
    ends(folder, &["run", "drive.mcap", "-o", "drive.log.mcap"], 0);
}

#[test]
fn a_torn_log_is_recovered_and_what_is_lost_is_told() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    drive(folder);
    let (out, err) = ends(folder, &["recover", "drive.log.mcap", "-o", "same.mcap"], 0);
    assert!(out.contains("proved by reading it again; nothing is lost"), "{out}");
    assert_eq!(err, "");

    let whole = fs::read(folder.join("drive.log.mcap")).unwrap();
    let mut torn = whole[..whole.len() * 2 / 3].to_vec();
    let middle = torn.len() / 2;
    torn[middle..middle + 600].fill(0xff);
    fs::write(folder.join("torn.mcap"), &torn).unwrap();
    ends(folder, &["verify", "torn.mcap"], 3);
    let (out, err) = ends(folder, &["recover", "torn.mcap", "-o", "out.mcap"], 3);
    assert!(
        out.contains("; lost: ") && out.contains(" frames in 0.") && out.contains("and more that nobody can count"),
        "{out}"
    );
    assert!(err.contains("torn.mcap at byte ") && err.contains("files that were not closed: 1"), "{err}");
    let (out, _) = ends(folder, &["recover", "torn.mcap", "-o", "out.mcap", "--json"], 3);
    let account: serde_json::Value = serde_json::from_str(&out).unwrap();
    assert_eq!((account["lost"].as_bool(), account["open_ends"].as_u64()), (Some(true), Some(1)));
    // What is left of a frame that the hole begins or ends in is kept, as a broken frame.
    assert!(account["frames_lost"].as_u64().unwrap() >= 1 && account["bytes_lost"].as_u64().unwrap() >= 300);

    // The new log is a whole file: what is told of it is the hole, and the frames that it hit.
    let (out, _) = ends(folder, &["verify", "out.mcap", "--json"], 3);
    let verdict: serde_json::Value = serde_json::from_str(&out).unwrap();
    assert_eq!(verdict["missing_frames"], account["frames_lost"]);
    assert_eq!(verdict["frames"], account["frames"]);
    let problems = verdict["problems"].as_array().unwrap();
    let of_the_hole = |what: &str| ["missing before", "broken frame"].iter().any(|known| what.contains(known));
    assert!(problems.iter().all(|problem| of_the_hole(problem["what"].as_str().unwrap())), "{problems:?}");
}

#[test]
fn what_cannot_be_recovered_is_an_error_and_leaves_no_file() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    fs::write(folder.join("empty.mcap"), b"").unwrap();
    fs::write(folder.join("text.mcap"), b"Dear diary,").unwrap();
    for (file, said) in
        [("empty.mcap", "it is empty"), ("text.mcap", "not an MCAP file"), ("none.mcap", "No such file")]
    {
        let (_, err) = ends(folder, &["recover", file, "-o", "out.mcap"], 1);
        assert!(err.contains(said) && err.lines().count() == 1, "{err}");
    }
    let (_, err) = ends(folder, &["recover", "text.mcap", "-o", "text.mcap"], 1);
    assert!(err.contains("is read, and cannot be written as well"), "{err}");
    assert_eq!(fs::read_dir(folder).unwrap().count(), 2);
}

/// Faults of the sensor lines cost frames of the sensors, which is told; what is logged is still whole and right.
#[test]
fn a_run_over_faulty_lines_tells_what_they_cost_and_makes_a_right_log() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    drive(folder);
    let spec = "flip=3e-5,drop=1e-5,burst=1e-5:200,truncate=0.01,duplicate=0.01,stall=0.002:300;pps:drop=0.3,seed=11";
    let (_, err) = ends(folder, &["run", "drive.mcap", "--faults", spec, "-o", "a.mcap"], 3);
    assert!(err.contains("faults on lidar: of ") && err.contains("lost: lidar.bad_frames"), "{err}");
    let (out, _) = ends(folder, &["verify", "a.mcap"], 0);
    assert!(out.contains(" profiles reproduced"), "{out}");
    ends(folder, &["run", "drive.mcap", "--faults", spec, "-o", "b.mcap"], 3);
    assert!(fs::read(folder.join("a.mcap")).unwrap() == fs::read(folder.join("b.mcap")).unwrap(), "by the seed");
    let (_, err) = ends(folder, &["run", "drive.mcap", "--faults", "fire=1", "-o", "c.mcap"], 2);
    assert!(err.contains("no such fault"), "{err}");
}

/// The drive's log again, as a recording in files of 100 kB: their number.
fn rotated(folder: &Path) -> usize {
    let options = log::Options { max_bytes: 100_000, ..log::Options::default() };
    let mut writer = log::Writer::create_with(&folder.join("rot.log.mcap"), options).unwrap();
    for frame in log::Reader::open(&folder.join("drive.log.mcap")).unwrap().map(Result::unwrap) {
        writer.frame(frame.receive_ns, &frame.bytes).unwrap();
    }
    let parts = writer.parts() as usize;
    writer.finish().unwrap();
    parts
}

/// Who names the first file of a recording means the drive, whatever is done with it.
#[test]
fn the_first_file_of_a_recording_is_the_drive_in_every_command() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    ends(folder, &["simulate", "--seconds", "12", "-o", "drive.mcap"], 0);
    ends(folder, &["run", "drive.mcap", "-o", "drive.log.mcap"], 0);
    let parts = rotated(folder);
    assert!(parts >= 3, "{parts}");
    let whole = ends(folder, &["profiles", "drive.log.mcap"], 0).0;
    let (table, err) = ends(folder, &["profiles", "rot.log.mcap"], 0);
    assert!(table == whole && err.contains(&format!("rot.log.mcap: {parts} files, read as one drive")), "{err}");
    let (out, _) = ends(folder, &["verify", "rot.log.mcap"], 0);
    let said = ends(folder, &["verify", "drive.log.mcap"], 0).0;
    assert_eq!(out, format!("{parts} files, {said}"));
    let (out, _) = ends(folder, &["verify", "rot.log.mcap", "--json"], 0);
    let verdict: serde_json::Value = serde_json::from_str(&out).unwrap();
    assert_eq!(verdict["files"].as_array().unwrap().len(), parts);
    for command in [
        &["report", "rot.log.mcap", "-o", "rot.html"] as &[&str],
        &["cloud", "rot.log.mcap", "-o", "rot.laz"],
        &["export", "rot.log.mcap", "--foxglove", "rot.fox.mcap"],
        &["recover", "rot.log.mcap", "-o", "one.log.mcap"],
    ] {
        let (_, err) = ends(folder, command, 0);
        assert!(err.contains(" files, read as one drive"), "{err}");
    }
    assert!(ends(folder, &["verify", "one.log.mcap"], 0).0 == said);
    let numbers = |file: &str| {
        let info: serde_json::Value = serde_json::from_str(&ends(folder, &["info", file, "--json"], 0).0).unwrap();
        (info["scans"].clone(), info["seconds"].clone())
    };
    assert_eq!(numbers("rot.log.mcap"), numbers("drive.log.mcap"));
    // All files named: still one drive, in a data set and elsewhere.
    let all: Vec<String> =
        fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().file_name().into_string().unwrap()).collect();
    let mut all: Vec<&str> = all.iter().map(String::as_str).filter(|name| name.starts_with("rot.log.")).collect();
    all.sort_unstable();
    assert_eq!(all.len(), parts);
    let (_, err) = ends(folder, &[&["profiles"], &all[..], &["--road", "A", "-o", "set/"]].concat(), 0);
    assert_eq!(err.matches(" rows").count(), 1, "{err}");
    // A file of the middle is itself and no more.
    let (_, err) = ends(folder, &["profiles", "rot.log.part0002.mcap", "--summary"], 0);
    assert!(err.contains("is file 2 of a recording and read alone; it follows rot.log.mcap"), "{err}");
    // One that is gone is told, and lost.
    fs::remove_file(folder.join("rot.log.part0002.mcap")).unwrap();
    for command in [
        &["profiles", "rot.log.mcap", "-o", "rot.csv"] as &[&str],
        &["verify", "rot.log.mcap"],
        &["info", "rot.log.mcap"],
        &["recover", "rot.log.mcap", "-o", "two.log.mcap"],
    ] {
        let (_, err) = ends(folder, command, 3);
        assert!(err.contains("rot.log.part0002.mcap: is missing; "), "{err}");
    }
}

/// Of ten files one was copied; or the computer died when the second had a name and nothing else.
#[test]
fn a_drive_that_goes_on_in_a_file_that_is_not_there_is_told_by_every_command() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    ends(folder, &["simulate", "--seconds", "12", "-o", "drive.mcap"], 0);
    ends(folder, &["run", "drive.mcap", "-o", "drive.log.mcap"], 0);
    assert!(rotated(folder) >= 3);
    let alone = folder.join("alone");
    fs::create_dir(&alone).unwrap();
    fs::copy(folder.join("rot.log.mcap"), alone.join("rot.log.mcap")).unwrap();
    for (case, said) in
        ["goes on in rot.log.part0002.mcap, which is not there", "rot.log.part0002.mcap"].into_iter().enumerate()
    {
        for (command, says) in [
            (&["verify", "rot.log.mcap"] as &[&str], said),
            (&["info", "rot.log.mcap"], said),
            (&["profiles", "rot.log.mcap", "-o", "rot.csv"], "1 damaged, broken or missing parts passed over"),
            (&["report", "rot.log.mcap", "-o", "rot.html"], "1 damaged, broken or missing parts passed over"),
            (&["recover", "rot.log.mcap", "-o", "one.log.mcap"], said),
        ] {
            let (_, err) = ends(&alone, command, 3);
            assert!(err.contains(says), "{command:?}: {err}");
        }
        fs::remove_file(alone.join("one.log.mcap")).unwrap();
        if case == 0 {
            fs::write(alone.join("rot.log.part0002.mcap"), b"").unwrap();
        }
    }
}

/// What was recovered is given the name of what it was recovered from, whose other files nobody has cleared away.
#[test]
fn a_recovered_drive_under_its_old_name_is_counted_once() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    ends(folder, &["simulate", "--seconds", "12", "-o", "drive.mcap"], 0);
    ends(folder, &["run", "drive.mcap", "-o", "drive.log.mcap"], 0);
    rotated(folder);
    ends(folder, &["recover", "rot.log.mcap", "-o", "whole.mcap"], 0);
    fs::rename(folder.join("whole.mcap"), folder.join("rot.log.mcap")).unwrap();
    let (table, err) = ends(folder, &["profiles", "rot.log.mcap"], 0);
    assert!(table == ends(folder, &["profiles", "drive.log.mcap"], 0).0, "{err}");
    assert!(err.contains("rot.log.part0002.mcap: is not read with rot.log.mcap: its frames are in "), "{err}");
    // Named with all that lies beside it, it is one drive as well.
    let named = ["profiles", "rot.log.mcap", "rot.log.part0002.mcap", "--road", "A", "-o", "set/"];
    assert_eq!(ends(folder, &named, 0).1.matches(" rows").count(), 1);
}

/// What a file says of its board is text to be read, not to be obeyed by a terminal.
#[test]
fn control_characters_of_a_log_do_not_reach_the_terminal() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let mut writer = log::Writer::create(&folder.join("a.mcap")).unwrap();
    let board = ("board".to_owned(), "\x1b]0;other\x07 board\u{9b}2J".to_owned());
    writer.metadata(log::metadata::IDENTITY, [board.clone()].into()).unwrap();
    writer.frame(1, b"\x01\x00").unwrap();
    writer.finish().unwrap();
    // Its only frame is none.
    let (out, err) = ends(folder, &["info", "a.mcap"], 3);
    assert!(out.contains(r"\u{1b}]0;other\u{7} board\u{9b}2J"), "{out}");
    assert!(!(out + &err).contains(|c: char| c.is_control() && c != '\n'));
    let (out, _) = ends(folder, &["info", "a.mcap", "--json"], 3);
    let info: serde_json::Value = serde_json::from_str(&out).unwrap();
    assert_eq!(info["about"]["identity.board"].as_str(), Some(&*board.1));
}
