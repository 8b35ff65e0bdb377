//! What a command leaves behind and how it ends: nothing that is read, recorded or asked for twice is destroyed, no verdict hangs on who reads along,
//! and what is wrong is told as what it is.

mod program;

use std::fs::{self, File};
use std::io::{self, Write};
use std::path::Path;
use std::process::Stdio;

use crossfall::log::{self, metadata};
use crossfall_core::protocol::frame::{MAX_MESSAGE_FRAME, Sequencer};
use crossfall_core::protocol::message::{Hello, Message, Status};
use crossfall_core::protocol::{DeviceTime, schema};
use program::{crossfall, ended, ends};
use tempfile::TempDir;

/// Checks that it failed with a text and left a file as it was.
fn spares(folder: &Path, file: &str, arguments: &[&str], expected: &str) {
    let before = fs::read(folder.join(file)).unwrap();
    let (_, error) = ends(folder, arguments, 1);
    assert!(error.contains(expected), "{arguments:?}: {error}");
    assert!(fs::read(folder.join(file)).unwrap() == before, "{arguments:?} has changed {file}");
}

fn json(text: &str) -> serde_json::Value {
    serde_json::from_str(text).unwrap_or_else(|error| panic!("{error}: {text}"))
}

/// A folder with a short simulated drive, `drive.mcap`, and its log, `drive.log.mcap`.
fn drive() -> TempDir {
    let folder = tempfile::tempdir().unwrap();
    ends(folder.path(), &["simulate", "--seconds", "3", "-o", "drive.mcap"], 0);
    ends(folder.path(), &["run", "drive.mcap", "-o", "drive.log.mcap"], 0);
    folder
}

/// The frames of logs in one recording, as a board that has booted in between sends them.
fn join(logs: &[&Path], to: &Path) {
    let mut joined = log::Writer::create(to).unwrap();
    let mut now = 0;
    for log in logs {
        for frame in log::Reader::open(log).unwrap() {
            now += 1_000_000;
            joined.frame(now, &frame.unwrap().bytes).unwrap();
        }
    }
    joined.finish().unwrap();
}

#[test]
fn what_was_lost_before_a_restart_is_told() {
    let folder = drive();
    let at = folder.path();
    ends(at, &["run", "drive.mcap", "--faults", "flip=3e-4,seed=3", "-o", "faulty.log.mcap"], 3);
    join(&[&at.join("faulty.log.mcap"), &at.join("drive.log.mcap")], &at.join("both.mcap"));
    let info = |name: &str| json(&ends(at, &["info", name, "--json"], 0).0);
    let (faulty, clean, both) = (info("faulty.log.mcap"), info("drive.log.mcap"), info("both.mcap"));
    for counter in ["scans", "scans_missing", "lidar.bad_frames", "lidar.frames", "poses"] {
        let count = |info: &serde_json::Value| info["counters"][counter].as_u64().unwrap();
        assert_eq!(count(&both), count(&faulty) + count(&clean), "{counter}");
    }
    assert!(both["counters"]["lidar.bad_frames"].as_u64().unwrap() > 5);
    assert_eq!(both["counters"]["link.restarts"], 1);
    // Scans and counters speak of the same drive, and `verify` of the same time.
    assert_eq!(both["scans"], both["counters"]["scans"]);
    for (name, info) in [("faulty.log.mcap", &faulty), ("drive.log.mcap", &clean), ("both.mcap", &both)] {
        let verified = crossfall(at, &["verify", name, "--json"]).output().unwrap();
        assert_eq!(json(&String::from_utf8_lossy(&verified.stdout))["seconds"], info["seconds"], "{name}");
    }
    let page = |log: &str| {
        ends(at, &["report", log, "-o", "page.html"], 0);
        fs::read_to_string(at.join("page.html")).unwrap()
    };
    let (whole, restarted) = (page("drive.log.mcap"), page("both.mcap"));
    assert!(whole.contains("nothing was lost on the way") && !restarted.contains("nothing was lost on the way"));
    assert!(restarted.contains("counted by the board: lidar.bad_frames"));
    assert!(restarted.contains("restarts of the board</td><td class=\"bad\">1<"));
    // A restart alone, with nothing lost that a number could tell.
    join(&[&at.join("drive.log.mcap"), &at.join("drive.log.mcap")], &at.join("twice.mcap"));
    assert!(!page("twice.mcap").contains("nothing was lost on the way"));
}

#[test]
fn neither_an_input_nor_another_output_is_written_over() {
    let folder = drive();
    let at = folder.path();
    let (config, _) = ends(at, &["config"], 0);
    fs::write(at.join("c.toml"), config).unwrap();
    fs::write(at.join("s.toml"), "[drive]\nseconds = 1.0\n").unwrap();
    fs::write(at.join("t.csv"), "kept").unwrap();
    let read = "is read, and cannot be written as well";
    spares(at, "c.toml", &["run", "drive.mcap", "--config", "c.toml", "-o", "c.toml"], read);
    spares(at, "s.toml", &["simulate", "--scene", "s.toml", "-o", "b.mcap", "--truth", "./s.toml"], read);
    spares(at, "c.toml", &["import", "--lidar", "t.csv", "--config", "c.toml", "-o", "c.toml"], read);
    spares(at, "drive.log.mcap", &["export", "drive.log.mcap", "--foxglove", "./drive.log.mcap"], read);
    let twice = "cannot be two outputs at once";
    spares(at, "t.csv", &["report", "drive.log.mcap", "-o", "t.csv", "--profiles", "./t.csv"], twice);
    let (_, error) = ends(at, &["simulate", "-o", "a.mcap", "--truth", "./a.mcap"], 1);
    assert!(error.contains(twice) && !at.join("a.mcap").exists(), "{error}");
    if cfg!(unix) {
        ends(at, &["simulate", "--seconds", "1", "-o", "/dev/null", "--truth", "/dev/null"], 0);
    }
}

#[test]
fn a_recording_is_never_replaced() {
    let folder = drive();
    let at = folder.path();
    let hello = Hello { schema: schema::HASH, firmware: "crossfall", board: "a board", boot: 1, restart: "" };
    let mut frame = [0; MAX_MESSAGE_FRAME];
    let length = Sequencer::new().message(&Message::Hello(hello), &mut frame).unwrap();
    let mut log = log::Writer::create_live(&at.join("rec.mcap")).unwrap();
    log.frame(1, &frame[..length]).unwrap();
    log.finish().unwrap();
    let recorded = "rec.mcap: cannot write: it is a recording of a board, which is never written over";
    spares(at, "rec.mcap", &["simulate", "--seconds", "1", "-o", "rec.mcap"], recorded);
    spares(at, "rec.mcap", &["run", "drive.mcap", "-o", "rec.mcap"], recorded);
    spares(at, "rec.mcap", &["recover", "drive.log.mcap", "-o", "rec.mcap"], recorded);
    spares(at, "rec.mcap", &["export", "drive.log.mcap", "--foxglove", "rec.mcap"], recorded);
    // What was recovered of it is all that there is once the torn file is gone.
    ends(at, &["recover", "rec.mcap", "-o", "whole.mcap"], 0);
    spares(at, "whole.mcap", &["run", "drive.mcap", "-o", "whole.mcap"], "whole.mcap: cannot write: it is a recording");
    // What `run` has made can be made again.
    ends(at, &["run", "drive.mcap", "-o", "drive.log.mcap"], 0);
    let log = log::Reader::open(&at.join("drive.log.mcap")).unwrap();
    assert_eq!(log.metadata()[metadata::IDENTITY]["board"], "in process");
}

/// With nobody who reads stdout.
fn unread(folder: &Path, arguments: &[&str], code: i32) -> String {
    let (reader, writer) = io::pipe().unwrap();
    drop(reader);
    let output = crossfall(folder, arguments).stdout(writer).spawn().unwrap();
    ended(&output.wait_with_output().unwrap(), code).1
}

#[cfg(unix)]
#[test]
fn the_work_and_the_verdict_do_not_hang_on_who_reads_stdout() {
    let folder = drive();
    let at = folder.path();
    let log = fs::read(at.join("drive.log.mcap")).unwrap();
    fs::write(at.join("cut.mcap"), &log[..log.len() / 2]).unwrap();
    unread(at, &["verify", "cut.mcap"], 3);
    unread(at, &["verify", "cut.mcap", "--json"], 3);
    unread(at, &["info", "cut.mcap"], 3);
    unread(at, &["recover", "cut.mcap", "-o", "out.mcap"], 3);
    fs::copy(at.join("drive.log.mcap"), at.join("twin.log.mcap")).unwrap();
    unread(at, &["compare", "drive.log.mcap", "twin.log.mcap", "-o", "pictures"], 0);
    assert!(at.join("out.mcap").exists() && at.join("pictures/repeat.svg").exists());
    let scene = "[drive]\nseconds = 20.0\nspeed_m_s = 0.0\n[vehicle]\nroll = [{ amplitude_deg = 2.0, frequency_hz = 1.0 }]\npitch = []\n\
                 [sections.random]\ncross_slope_deg = [0.0, 0.0]\nleft_edge_m = [4.0, 4.0]\nroad_width_m = [8.0, 8.0]\n";
    fs::write(at.join("rock.toml"), scene).unwrap();
    ends(at, &["simulate", "--scene", "rock.toml", "-o", "rock.mcap"], 0);
    ends(at, &["run", "rock.mcap", "-o", "rock.log.mcap"], 0);
    unread(at, &["calibrate", "rock.log.mcap", "-o", "my.toml"], 0);
    assert!(at.join("my.toml").exists());
    // Two drives that stood have positions, and no way.
    fs::copy(at.join("rock.log.mcap"), at.join("rock2.log.mcap")).unwrap();
    let (_, said) = ends(at, &["compare", "rock.log.mcap", "rock2.log.mcap"], 0);
    assert!(said.contains("the first drive stood"), "{said}");
    // What does nothing but stream has done enough.
    assert_eq!(unread(at, &["profiles", "cut.mcap"], 0), "");
    assert_eq!(unread(at, &["messages", "drive.log.mcap"], 0), "drive.log.mcap: the board has said nothing\n");
}

#[cfg(target_os = "linux")]
#[test]
fn a_cloud_on_a_full_disk_is_told() {
    let folder = drive();
    let at = folder.path();
    for name in ["c.las", "c.laz", "c.ply"] {
        std::os::unix::fs::symlink("/dev/full", at.join(name)).unwrap();
        let (_, error) = ends(at, &["cloud", "drive.log.mcap", "-o", name], 1);
        assert!(error.contains(&format!("{name}: cannot write: No space left")), "{error}");
        assert_eq!(error.lines().count(), 1, "{error}");
    }
}

#[test]
fn a_cloud_of_two_continents_is_whole_as_far_as_its_numbers_go() {
    let folder = drive();
    let at = folder.path();
    fs::write(at.join("far.toml"), "[drive]\nseconds = 1.0\nlatitude_deg = -35.0\n").unwrap();
    ends(at, &["simulate", "--scene", "far.toml", "-o", "far.mcap"], 0);
    ends(at, &["run", "far.mcap", "-o", "far.log.mcap"], 0);
    for name in ["c.las", "c.laz"] {
        let (out, error) = ends(at, &["cloud", "drive.log.mcap", "far.log.mcap", "-o", name, "--json"], 3);
        let told = json(&out);
        let far = told["points_too_far"].as_u64().unwrap();
        assert!(
            far > 5_000 && error.contains(&format!("{far} returns lie more than 2,000 km from the first")),
            "{error}"
        );
        let points: u64 = told["points"].as_u64().unwrap();
        assert_eq!(las::Reader::from_path(at.join(name)).unwrap().header().number_of_points(), points);
    }
    // Doubles have room for both.
    let (out, _) = ends(at, &["cloud", "drive.log.mcap", "far.log.mcap", "-o", "c.ply", "--json"], 0);
    assert_eq!(json(&out)["points_too_far"], 0);
}

#[cfg(target_os = "linux")]
#[test]
fn a_name_that_is_no_utf_8_is_told_to_machines_too() {
    use std::ffi::OsStr;
    use std::os::unix::ffi::OsStrExt;
    let folder = drive();
    let at = folder.path();
    let log = fs::read(at.join("drive.log.mcap")).unwrap();
    let name = OsStr::from_bytes(b"cut-\xff.mcap");
    fs::write(at.join(name), &log[..log.len() / 2]).unwrap();
    let said = |arguments: &[&str], more: &[&OsStr]| {
        let output = crossfall(at, arguments).args(more).output().unwrap();
        json(&ended(&output, 3).0)
    };
    let verified = said(&["verify", "--json"], &[name, OsStr::new("drive.log.mcap")]);
    assert_eq!(verified["problems"][0]["file"], "cut-\u{fffd}.mcap", "{verified}");
    let recovered = said(&["recover", "--json", "-o", "out.mcap"], &[name]);
    assert_eq!(recovered["losses"][0]["file"], "cut-\u{fffd}.mcap", "{recovered}");
}

#[cfg(target_os = "linux")]
#[test]
fn a_pipe_is_called_one() {
    let folder = drive();
    let at = folder.path();
    for arguments in [&["info", "/dev/stdin"][..], &["verify", "/dev/stdin"], &["run", "/dev/stdin", "-o", "a.mcap"]] {
        let mut child = crossfall(at, arguments).stdin(Stdio::piped()).spawn().unwrap();
        let log = fs::read(at.join("drive.log.mcap")).unwrap();
        // It does not read all of it.
        let _closed = child.stdin.take().unwrap().write_all(&log);
        let (_, error) = ended(&child.wait_with_output().unwrap(), 1);
        assert!(error.contains("/dev/stdin: is a pipe or a device, and must be a file"), "{error}");
        // A file is one under this name as well.
        if arguments[0] != "run" {
            let file = File::open(at.join("drive.log.mcap")).unwrap();
            ended(&crossfall(at, arguments).stdin(file).output().unwrap(), 0);
        }
    }
    assert!(!at.join("a.mcap").exists());
}

#[test]
fn a_cut_capture_is_no_empty_log() {
    let folder = drive();
    let at = folder.path();
    let capture = fs::read(at.join("drive.mcap")).unwrap();
    for part in [3, 2] {
        fs::write(at.join("cut.mcap"), &capture[..capture.len() * (part - 1) / part]).unwrap();
        for arguments in
            [&["recover", "cut.mcap", "-o", "out.mcap"][..], &["verify", "cut.mcap"], &["profiles", "cut.mcap"]]
        {
            let (_, error) = ends(at, arguments, 1);
            assert!(error.contains("not a log: it has no channel `wire`; it is a capture"), "{error}");
        }
    }
    assert!(!at.join("out.mcap").exists());
}

#[test]
fn what_is_asked_wrongly_is_a_usage_error() {
    let folder = tempfile::tempdir().unwrap();
    for (wrong, expected) in [
        ("simulate --seconds 0 -o a.mcap", "expected a number from 0.1 to 86400"),
        ("simulate --seconds NaN -o a.mcap", "expected a number"),
        ("demo --seconds inf", "expected a number"),
        ("calibrate a.mcap --cross-slope NaN -o n.toml", "expected a number from -45 to 45"),
        ("calibrate a.mcap --cross-slope inf -o n.toml", "expected a number"),
        ("calibrate a.mcap --cross-slope -1e9 -o n.toml", "expected a number"),
        ("compare a.mcap b.mcap --within 0", "expected a number from 0.001 to 10000"),
        ("compare a.mcap b.mcap --within NaN", "expected a number"),
        ("compare a.mcap b.mcap --over 0", "expected a number from 0.1 to 100000"),
        ("risk frames -o maps --range 4", "expected a number from 5 to 150"),
        ("risk frames -o maps --cell NaN", "expected a number from 0.05 to 0.5"),
        ("risk frames -o maps --wheel x", "expected a number from 0.05 to 2"),
        ("serve a.mcap --speed 0", "expected a number from 0.1 to"),
        ("reproduce --seconds 5", "expected a number from 10 to 60"),
        ("plot a.mcap --station NaN -o p", "expected a number"),
        ("plot a.mcap --station inf -o p", "expected a number"),
        ("serve a.mcap --token short", "expected at least 16 letters and digits"),
        ("profiles a b -o x.csv", "several logs need a folder"),
        ("profiles a --fuse -o x.csv", "--fuse takes two logs"),
        ("profiles a b --summary", "--summary takes one log"),
        ("profiles a b --fuse --summary", "cannot be used with"),
        ("profiles a --road X -o r.csv", "--road names the road of a data set"),
        ("profiles a --road X --summary", "cannot be used with"),
        ("run a.mcap -o l.mcap --faults pps:flip=0.5", "a pulse has no bytes: `pps` takes drop, duplicate and stall"),
        ("run a.mcap -o l.mcap --faults ins2:flip=0.5", "no line `ins2`"),
        ("serve", "<FILE|--device <DEVICE>>"),
        ("monitor", "<FILE|--device <DEVICE>>"),
        ("monitor a.mcap --device emulated", "cannot be used with"),
    ] {
        let (_, error) = ends(folder.path(), &wrong.split(' ').collect::<Vec<_>>(), 2);
        assert!(error.starts_with("error: ") && error.contains(expected), "{wrong}: {error}");
    }
    assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 0);
}

#[test]
fn what_cannot_be_is_told_as_what_it_is() {
    let folder = drive();
    let at = folder.path();
    let (_, error) = ends(at, &["monitor", "drive.log.mcap"], 1);
    assert!(error.contains("the monitor draws on a terminal, and stdout is none"), "{error}");
    for wrong in [&["plot", "drive.log.mcap", "--scan", "99999", "-o", "p"][..], &["plot", "drive.mcap", "-o", "p"]] {
        ends(at, wrong, 1);
        assert!(!at.join("p").exists(), "{wrong:?}");
    }
    let mut growing = log::Writer::create_live(&at.join("growing.mcap")).unwrap();
    for frame in log::Reader::open(&at.join("drive.log.mcap")).unwrap().take(100) {
        growing.frame(1, &frame.unwrap().bytes).unwrap();
    }
    growing.flush().unwrap();
    let (_, error) = ends(at, &["verify", "growing.mcap"], 3);
    assert!(
        error.contains("growing.mcap: is being recorded: what is verified ends with its last closed chunk"),
        "{error}"
    );
}

#[cfg(target_os = "linux")]
#[test]
fn a_stderr_that_takes_nothing_changes_no_status() {
    let folder = tempfile::tempdir().unwrap();
    let full = || File::options().write(true).open("/dev/full").unwrap();
    for (arguments, code) in [(["verify", "nofile"], 1), (["verify", "--nonsense"], 2)] {
        let status = crossfall(folder.path(), &arguments).stdout(Stdio::null()).stderr(full()).status().unwrap();
        assert_eq!(status.code(), Some(code), "{arguments:?}");
    }
}

#[test]
fn info_tells_of_a_drive_and_not_of_its_last_file_and_by_its_status_what_is_missing() {
    let folder = drive();
    let at = folder.path();
    let frames: Vec<_> =
        log::Reader::open(&at.join("drive.log.mcap")).unwrap().map(|frame| frame.unwrap().bytes).collect();
    let write = |name: &str, frames: &[Vec<u8>], options: log::Options| {
        let mut log = log::Writer::create_with(&at.join(name), options).unwrap();
        for (frame, at_ns) in frames.iter().zip((0..).step_by(10_000_000)) {
            log.frame(at_ns, frame).unwrap();
            log.settle(at_ns).unwrap();
        }
        log.finish().unwrap();
    };
    write("parts.log.mcap", &frames, log::Options { max_bytes: 40_000, ..log::Options::default() });
    assert!(at.join("parts.log.part0002.mcap").exists());
    let (told, error) = ends(at, &["info", "parts.log.mcap"], 0);
    assert!(error.contains("read as one drive") && !told.contains("part."), "{told}");
    let holed: Vec<_> = [&frames[..100], &frames[103..]].concat();
    write("holed.log.mcap", &holed, log::Options::default());
    let (told, _) = ends(at, &["info", "holed.log.mcap", "--json"], 3);
    assert_eq!(json(&told)["counters"]["link.missing_frames"], 3);
}

/// A link that was lost for minutes: so long that the frames' numbers do not count what is missing.
#[test]
fn a_gap_that_nobody_can_count_is_told_by_every_command_that_reads_the_log() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    let (mut sequencer, mut frame) = (Sequencer::new(), [0; MAX_MESSAGE_FRAME]);
    let mut log = log::Writer::create(&at.join("gap.log.mcap")).unwrap();
    for second in 0..200_u64 {
        let message = Message::Status(Status { time: DeviceTime(second * 1_000_000), ..Status::default() });
        let length = sequencer.message(&message, &mut frame).unwrap();
        if second == 0 || second == 199 {
            log.frame(second * 1_000_000_000, &frame[..length]).unwrap();
        }
        // What was sent meanwhile and never heard.
        (0..350).for_each(|_| _ = sequencer.take());
    }
    log.finish().unwrap();
    let (told, _) = ends(at, &["info", "gap.log.mcap", "--json"], 3);
    let counters = &json(&told)["counters"];
    assert_eq!((&counters["link.unknown_gaps"], &counters["link.missing_frames"]), (&1.into(), &0.into()), "{told}");
    ends(at, &["verify", "gap.log.mcap"], 3);
    let (_, error) = ends(at, &["profiles", "gap.log.mcap", "-o", "gap.csv"], 3);
    assert!(error.contains("1 damaged, broken or missing parts passed over"), "{error}");
    let (_, error) = ends(at, &["messages", "gap.log.mcap"], 3);
    assert!(error.contains("1 gaps where frames are missing") && !error.contains("has said nothing"), "{error}");
}

#[test]
fn what_pictures_pass_over_is_told() {
    let folder = drive();
    let at = folder.path();
    let frames: Vec<_> =
        log::Reader::open(&at.join("drive.log.mcap")).unwrap().map(|frame| frame.unwrap().bytes).collect();
    let mut log = log::Writer::create(&at.join("holed.log.mcap")).unwrap();
    for (frame, at_ns) in [&frames[..100], &frames[103..]].concat().iter().zip((0..).step_by(10_000_000)) {
        log.frame(at_ns, frame).unwrap();
    }
    log.finish().unwrap();
    let told = |arguments: &[&str]| {
        let (_, error) = ends(at, arguments, 3);
        let line = error.lines().find(|line| line.contains("damaged, broken or missing parts passed over"));
        line.unwrap_or_else(|| panic!("{arguments:?}: {error}")).to_owned()
    };
    let report = told(&["report", "holed.log.mcap", "-o", "page.html"]);
    assert!(report.starts_with("holed.log.mcap: "), "{report}");
    assert_eq!(told(&["plot", "holed.log.mcap", "-o", "pictures"]), report);
    assert_eq!(told(&["export", "holed.log.mcap", "--foxglove", "fox.mcap"]), report);
}

#[test]
fn what_a_capture_holds_beside_its_channels_is_told() {
    let folder = drive();
    let at = folder.path();
    let mut bytes = fs::read(at.join("drive.mcap")).unwrap();
    let (name, other) = (b"\x03\0\0\0ins", b"\x03\0\0\0imu");
    let found: Vec<_> = (0..bytes.len() - name.len()).filter(|&at| bytes[at..].starts_with(name)).collect();
    for at in found {
        bytes[at..at + other.len()].copy_from_slice(other);
    }
    fs::write(at.join("foreign.mcap"), &bytes).unwrap();
    // The chunks' sums know another name: that is told as well.
    let (told, _) = ends(at, &["info", "foreign.mcap", "--json"], 3);
    let told = json(&told);
    assert!(told["poses"] == 0 && told["counters"]["foreign.imu"].as_u64().unwrap() > 100, "{told}");
}

/// Whoever opened a pipe that nobody writes to would wait for ever.
#[cfg(unix)]
#[test]
fn a_pipe_is_refused_and_a_log_named_twice_too() {
    let folder = TempDir::new().unwrap();
    let at = folder.path();
    fs::write(at.join("a.log.mcap"), b"").unwrap();
    assert!(std::process::Command::new("mkfifo").arg(at.join("pipe")).status().unwrap().success());
    for command in ["verify", "recover"] {
        let output = ["-o", "out.mcap"];
        let output = if command == "recover" { &output[..] } else { &[] };
        let (_, err) = ends(at, &[&[command, "pipe"], output].concat(), 1);
        assert!(err.contains("is a pipe or a device"), "{err}");
        let (_, err) = ends(at, &[&[command, "a.log.mcap", "./a.log.mcap"], output].concat(), 2);
        assert!(err.contains("is named more than once"), "{err}");
    }
}
