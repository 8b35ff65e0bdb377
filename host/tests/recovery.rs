//! `recover` and `run --faults` as a user meets them: what is said, and the exit status.

use std::fs;
use std::path::Path;
use std::process::{Command, Output, Stdio};

fn crossfall(folder: &Path, arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_crossfall"))
        .args(arguments)
        .current_dir(folder)
        .stdin(Stdio::null())
        .output()
        .expect("the binary runs")
}

/// What it said on stdout and stderr, after checking its status.
fn ends(folder: &Path, arguments: &[&str], code: i32) -> (String, String) {
    let output = crossfall(folder, arguments);
    let (out, err) = (String::from_utf8_lossy(&output.stdout), String::from_utf8_lossy(&output.stderr));
    assert_eq!(output.status.code(), Some(code), "{arguments:?}\nstdout: {out}\nstderr: {err}");
    (out.into_owned(), err.into_owned())
}

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
    assert!(out.contains("; lost: ") && out.contains(" frames, at most 0."), "{out}");
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
