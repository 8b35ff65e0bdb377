//! The command line as a user meets it: exit codes, one clear line for each kind of bad input, and nothing half-written left behind.

mod program;

use std::fs;
use std::path::Path;
use std::process::{Command, Output};

use tempfile::TempDir;

/// Runs `crossfall` in a folder.
fn crossfall(folder: &Path, arguments: &[&str]) -> Output {
    program::crossfall(folder, arguments).output().expect("the binary runs")
}

/// What it said on stderr, after checking that it ended with a code.
fn ends(output: &Output, code: i32) -> String {
    program::ended(output, code).1
}

/// Checks that it failed with one line that contains a text.
fn fails(folder: &Path, arguments: &[&str], expected: &str) {
    let error = ends(&crossfall(folder, arguments), 1);
    assert_eq!(error.lines().count(), 1, "one line: {error}");
    assert!(error.starts_with("crossfall: ") && error.contains(expected), "{error}");
}

fn names(folder: &Path) -> Vec<String> {
    let mut names: Vec<_> =
        fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().file_name().into_string().unwrap()).collect();
    names.sort();
    names
}

/// A folder with a short simulated drive, `drive.mcap`.
fn drive() -> TempDir {
    let folder = tempfile::tempdir().unwrap();
    ends(&crossfall(folder.path(), &["simulate", "--seconds", "2", "-o", "drive.mcap"]), 0);
    folder
}

#[test]
fn a_drive_goes_through_every_command() {
    let folder = drive();
    let at = folder.path();
    ends(&crossfall(at, &["run", "drive.mcap", "-o", "drive.log.mcap"]), 0);
    let verified = crossfall(at, &["verify", "drive.log.mcap"]);
    ends(&verified, 0);
    assert!(String::from_utf8_lossy(&verified.stdout).contains("all 75 profiles reproduced"));
    ends(&crossfall(at, &["profiles", "drive.log.mcap", "-o", "drive.csv"]), 0);
    assert_eq!(fs::read_to_string(at.join("drive.csv")).unwrap().lines().count(), 151);
    ends(&crossfall(at, &["plot", "drive.log.mcap", "-o", "pictures"]), 0);
    assert_eq!(names(&at.join("pictures")), ["section-37.svg", "slopes.svg", "variation-37.svg", "view-37.svg"]);
    ends(&crossfall(at, &["profiles", "drive.log.mcap", "--every", "10m", "-o", "tens.geojson"]), 0);
    let summary = crossfall(at, &["profiles", "drive.log.mcap", "--summary", "--json"]);
    ends(&summary, 0);
    let summary: serde_json::Value = serde_json::from_slice(&summary.stdout).unwrap();
    assert_eq!((&summary["miles"][0]["scans"], &summary["miles"][0]["side"]), (&75.into(), &"left".into()));
    let risk = crossfall(at, &["risk", "drive.log.mcap", "-o", "map", "--csv", "--json"]);
    ends(&risk, 0);
    let risk: serde_json::Value = serde_json::from_slice(&risk.stdout).unwrap();
    let rows = fs::read_to_string(at.join("map/cells.csv")).unwrap().lines().count() as u64;
    assert_eq!((risk["cells"].as_u64(), names(&at.join("map")).len()), (Some(rows - 1), 6));
    fails(at, &["risk", "drive.log.mcap", "-o", "map", "--at", "1000"], "--at 1000: there are 1");
    ends(&crossfall(at, &["report", "drive.log.mcap", "-o", "drive.html"]), 0);
    ends(&crossfall(at, &["cloud", "drive.log.mcap", "-o", "drive.laz"]), 0);
    ends(&crossfall(at, &["export", "drive.log.mcap", "--foxglove", "drive.foxglove.mcap"]), 0);
    ends(&crossfall(at, &["profiles", "drive.log.mcap", "--road", "A1", "-o", "set/"]), 0);
    assert_eq!(names(&at.join("set")), ["road=A1"]);

    for (file, kind) in [("drive.mcap", "capture"), ("drive.log.mcap", "log")] {
        let info = crossfall(at, &["info", file, "--json"]);
        ends(&info, 0);
        let info: serde_json::Value = serde_json::from_slice(&info.stdout).unwrap();
        assert_eq!(info["kind"], kind);
        assert_eq!((&info["scans"], &info["pulses"]), (&75.into(), &3.into()));
        assert_eq!(info["counters"]["lidar.bad_frames"], 0);
    }
    let report = crossfall(at, &["verify", "drive.log.mcap", "--json"]);
    let report: serde_json::Value = serde_json::from_slice(&report.stdout).unwrap();
    assert_eq!((&report["ok"], &report["profiles_reproduced"]), (&true.into(), &75.into()));
    assert_eq!(report["problems"], serde_json::json!([]));
}

#[test]
fn the_demo_proves_itself() {
    let folder = tempfile::tempdir().unwrap();
    let output = crossfall(folder.path(), &["demo", "--seconds", "3"]);
    ends(&output, 0);
    assert!(String::from_utf8_lossy(&output.stdout).contains("all 112 profiles reproduced"));
    let made = names(&folder.path().join("crossfall-demo"));
    for name in ["drive.log.mcap", "drive.mcap", "profiles.csv", "slopes.svg", "truth.csv"] {
        assert!(made.iter().any(|made| made == name), "{made:?}");
    }
}

#[test]
fn the_emulated_demo_says_what_it_lacks() {
    let folder = tempfile::tempdir().unwrap();
    let mut demo = program::crossfall(folder.path(), &["demo", "--device", "emulated", "--seconds", "1"]);
    let output = demo.env("PATH", folder.path()).output().expect("the binary runs");
    let error = ends(&output, 1);
    assert!(error.contains("qemu-system-arm is not installed: `apt install qemu-system-arm`"), "{error}");
    assert_eq!(names(folder.path()), [""; 0]);
}

#[test]
fn the_same_seed_gives_the_same_file() {
    let folder = tempfile::tempdir().unwrap();
    for name in ["a.mcap", "b.mcap"] {
        ends(&crossfall(folder.path(), &["simulate", "--seconds", "1", "--seed", "9", "-o", name]), 0);
    }
    assert!(fs::read(folder.path().join("a.mcap")).unwrap() == fs::read(folder.path().join("b.mcap")).unwrap());
}

#[test]
fn a_foreign_file_is_named_and_leaves_nothing() {
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("photo.jpg"), b"\xff\xd8\xff\xe0 not a capture").unwrap();
    fails(
        folder.path(),
        &["run", "photo.jpg", "-o", "a.mcap"],
        "photo.jpg: not an MCAP file: it begins with FF D8 FF E0",
    );
    fails(folder.path(), &["verify", "photo.jpg"], "not an MCAP file");
    fails(folder.path(), &["info", "photo.jpg"], "not an MCAP file");
    fails(folder.path(), &["import", "--lidar", "photo.jpg", "-o", "a.mcap"], "photo.jpg: no LMS telegram in 18 bytes");
    fails(folder.path(), &["run", "nowhere.mcap", "-o", "a.mcap"], "nowhere.mcap: ");
    assert_eq!(names(folder.path()), ["photo.jpg"]);
}

#[test]
fn a_truncated_capture_is_measured_as_far_as_it_goes_and_told() {
    let folder = drive();
    let whole = fs::read(folder.path().join("drive.mcap")).unwrap();
    fs::write(folder.path().join("cut.mcap"), &whole[..whole.len() / 2]).unwrap();
    let error = ends(&crossfall(folder.path(), &["run", "cut.mcap", "-o", "cut.log.mcap"]), 3);
    assert!(error.contains(&format!("cut.mcap: cut short: the file ends at byte {}", whole.len() / 2)), "{error}");
    // What was made of it is a whole log.
    ends(&crossfall(folder.path(), &["verify", "cut.log.mcap"]), 0);
    let info = crossfall(folder.path(), &["info", "cut.mcap", "--json"]);
    ends(&info, 3);
    let info: serde_json::Value = serde_json::from_slice(&info.stdout).unwrap();
    assert!(info["scans"].as_u64().unwrap() > 20, "{info}");
}

#[test]
fn a_truncated_log_is_verified_as_far_as_it_goes_and_told() {
    let folder = drive();
    ends(&crossfall(folder.path(), &["run", "drive.mcap", "-o", "drive.log.mcap"]), 0);
    let whole = fs::read(folder.path().join("drive.log.mcap")).unwrap();
    fs::write(folder.path().join("cut.mcap"), &whole[..whole.len() / 2]).unwrap();
    let error = ends(&crossfall(folder.path(), &["verify", "cut.mcap"]), 3);
    assert!(error.contains("cut short"), "{error}");
}

#[test]
fn a_capture_without_its_scanner_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("ins-only.mcap");
    let mut mcap = mcap::Writer::new(fs::File::create(&path).unwrap()).unwrap();
    mcap.add_channel(0, "ins", "application/octet-stream", &Default::default()).unwrap();
    mcap.finish().unwrap();
    fails(
        folder.path(),
        &["run", "ins-only.mcap", "-o", "a.mcap"],
        "ins-only.mcap: the capture has no channel `lidar`, only `ins`",
    );
    assert_eq!(names(folder.path()), ["ins-only.mcap"]);
}

#[test]
fn a_log_is_no_capture_and_a_capture_no_log() {
    let folder = drive();
    ends(&crossfall(folder.path(), &["run", "drive.mcap", "-o", "drive.log.mcap"]), 0);
    fails(folder.path(), &["run", "drive.log.mcap", "-o", "a.mcap"], "not a capture: it has `wire`");
    fails(folder.path(), &["verify", "drive.mcap"], "not a log: it has no channel `wire`");
    fails(folder.path(), &["profiles", "drive.mcap", "-o", "a.csv"], "not a log");
    assert_eq!(names(folder.path()), ["drive.log.mcap", "drive.mcap"]);
}

#[test]
fn a_scene_or_a_configuration_that_cannot_be_is_refused_by_its_key() {
    let folder = drive();
    let at = folder.path();
    fs::write(at.join("s.toml"), "[drive]\nspeed_kmh = 80\n").unwrap();
    fails(at, &["simulate", "--scene", "s.toml", "-o", "a.mcap"], "s.toml:2: unknown field `speed_kmh`");
    fs::write(at.join("s.toml"), "[clock]\ndrift_ppm = 1e6\n").unwrap();
    fails(at, &["simulate", "--scene", "s.toml", "-o", "a.mcap"], "clock.drift_ppm = 1000000, expected a number from");
    fs::write(at.join("c.toml"), "[survey.seed]\nonset_mm = 60.0\n").unwrap();
    let contradiction =
        "c.toml: survey.seed.onset_mm = 60.0, expected less than survey.seed.departure_mm = 50.0 (T3 < T1)";
    fails(at, &["run", "drive.mcap", "--config", "c.toml", "-o", "a.mcap"], contradiction);
    fails(at, &["config", "c.toml"], contradiction);
    fs::write(at.join("s.toml"), "[drive]\nseconds = 0.0\n").unwrap();
    fails(at, &["simulate", "--scene", "s.toml", "-o", "a.mcap"], "drive.seconds = 0");
    assert_eq!(names(at), ["c.toml", "drive.mcap", "s.toml"]);
}

#[test]
fn an_output_that_cannot_be_written_is_named() {
    let folder = drive();
    let at = folder.path();
    fails(at, &["simulate", "-o", "no/such/folder/a.mcap"], "no/such/folder/a.mcap: cannot write: No such file");
    fails(at, &["run", "drive.mcap", "-o", "no/a.mcap"], "no/a.mcap: cannot write");
    fails(at, &["run", "drive.mcap", "-o", "drive.mcap"], "drive.mcap: is read, and cannot be written as well");
    fs::write(at.join("file"), b"").unwrap();
    fails(at, &["demo", "-o", "file/demo"], "file/demo: ");
    assert_eq!(names(at), ["drive.mcap", "file"]);
}

#[cfg(target_os = "linux")]
#[test]
fn a_full_disk_is_told() {
    let folder = drive();
    fails(folder.path(), &["run", "drive.mcap", "-o", "/dev/full"], "/dev/full: cannot write: No space left");
}

#[test]
fn usage_is_told_with_its_own_code() {
    let folder = tempfile::tempdir().unwrap();
    for wrong in [&["frobnicate"][..], &["simulate"], &["run"], &["import", "-o", "a.mcap"], &["verify", "a", "--jsn"]]
    {
        ends(&crossfall(folder.path(), wrong), 2);
    }
    let alone = crossfall(folder.path(), &[]);
    ends(&alone, 0);
    assert!(String::from_utf8_lossy(&alone.stdout).contains("Usage: crossfall"));
}

#[cfg(unix)]
#[test]
fn a_reader_that_stops_reading_is_no_error() {
    let folder = drive();
    ends(&crossfall(folder.path(), &["run", "drive.mcap", "-o", "drive.log.mcap"]), 0);
    let mut child = program::crossfall(folder.path(), &["profiles", "drive.log.mcap"]).spawn().unwrap();
    drop(child.stdout.take());
    let output = child.wait_with_output().unwrap();
    assert_eq!(ends(&output, 0), "");
}

#[cfg(unix)]
#[test]
fn a_disk_that_fills_up_on_the_way_leaves_nothing_and_no_temporary_name() {
    let folder = drive();
    let at = folder.path();
    // A limit of the size of files, in blocks of 512 or 1024 bytes, fails a write in the midst of a file as a full disk does.
    let limited = |blocks: u32, arguments: &[&str], expected: &str| {
        let script = format!("trap '' XFSZ; ulimit -f {blocks}; exec \"$0\" \"$@\"");
        let output = Command::new("sh")
            .args(["-c", &script, env!("CARGO_BIN_EXE_crossfall")])
            .args(arguments)
            .current_dir(at)
            .output()
            .unwrap();
        let error = ends(&output, 1);
        assert!(error.starts_with("crossfall: ") && error.contains(expected), "{error}");
        assert!(error.contains("File too large") && !error.contains(".part"), "{error}");
    };
    limited(40, &["simulate", "--seconds", "5", "-o", "s.mcap"], "s.mcap: ");
    limited(10, &["run", "drive.mcap", "-o", "s.log.mcap"], "s.log.mcap: ");
    limited(400, &["simulate", "--terrain", "--seconds", "0.2", "-o", "frames"], "frames/velodyne/000000.bin: ");
    assert_eq!(names(at), ["drive.mcap"]);
}

#[cfg(unix)]
#[test]
fn ctrl_c_leaves_nothing_half_written() {
    use std::io::Read;
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    for (arguments, writes_to) in [
        (&["simulate", "--seconds", "80000", "-o", "capture/long.mcap"][..], "capture"),
        (&["simulate", "--terrain", "--seconds", "2000", "-o", "frames"], "frames"),
        (&["reproduce", "terrain", "-o", "pictures"], ""),
    ] {
        fs::create_dir_all(at.join(writes_to)).unwrap();
        let mut child = program::crossfall(at, arguments).spawn().unwrap();
        // Once it has begun, and before anything like all is done.
        if writes_to.is_empty() {
            let mut heading = [0; 8];
            child.stdout.as_mut().unwrap().read_exact(&mut heading).unwrap();
        }
        while !writes_to.is_empty() && names(&at.join(writes_to)).is_empty() {
            std::thread::sleep(std::time::Duration::from_millis(5));
        }
        let killed = Command::new("kill").args(["-INT", &child.id().to_string()]).status().unwrap();
        assert!(killed.success());
        let told = ends(&child.wait_with_output().unwrap(), 1);
        assert!(told.ends_with("interrupted\n"), "{arguments:?}: {told}");
        assert_eq!(names(&at.join(writes_to)), Vec::<String>::new(), "{arguments:?}");
        if !writes_to.is_empty() {
            fs::remove_dir(at.join(writes_to)).unwrap();
        }
    }
}

#[test]
fn a_truth_of_one_side_is_enough_and_a_table_that_is_none_costs_no_picture() {
    let folder = drive();
    let at = folder.path();
    ends(&crossfall(at, &["run", "drive.mcap", "-o", "drive.log.mcap"]), 0);
    // The contract's columns, which are the left side's.
    let heading =
        "scan,start_device_s,roll_deg,road_deg,edge_y_m,adjacent_deg,adjacent_end_y_m,opposing_deg,opposing_end_y_m";
    let row = |scan| format!("\n{scan},1.5,1.0,1.0,4.0,-7.2,9.8,9.2,16.8");
    fs::write(at.join("left.csv"), heading.to_owned() + &(0..75).map(row).collect::<String>()).unwrap();
    ends(&crossfall(at, &["plot", "drive.log.mcap", "--truth", "left.csv", "-o", "pictures"]), 0);
    let picture = fs::read_to_string(at.join("pictures/errors.svg")).unwrap();
    assert!(picture.contains("left adjacent: RMS") && picture.contains("left opposing: RMS"));
    assert!(!picture.contains("right adjacent"), "what is not known is not drawn");
    fs::write(at.join("none.csv"), "scan,slope\n0,-7.2\n").unwrap();
    fails(
        at,
        &["plot", "drive.log.mcap", "--truth", "none.csv", "-o", "none"],
        "none.csv: has no column `adjacent_deg`",
    );
    assert!(!at.join("none").exists());
}

#[test]
fn a_demo_removes_no_pictures_but_those_of_a_demo_before_it() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    fs::write(at.join("section-9999.svg"), b"somebody's").unwrap();
    let demo = ["demo", "--seconds", "2", "-o", "."];
    ends(&crossfall(at, &demo), 0);
    assert_eq!(fs::read(at.join("section-9999.svg")).unwrap(), b"somebody's");
    ends(&crossfall(at, &demo), 0);
    let sections: Vec<_> = names(at).into_iter().filter(|name| name.starts_with("section-")).collect();
    assert_eq!(sections, ["section-37.svg"]);
}

/// A short drive with a vehicle that stands, run.
fn parked() -> TempDir {
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("parked.toml"), "[drive]\nspeed_m_s = 0.0\n").unwrap();
    let simulate = ["simulate", "--scene", "parked.toml", "--seconds", "3", "-o", "parked.mcap"];
    ends(&crossfall(folder.path(), &simulate), 0);
    ends(&crossfall(folder.path(), &["run", "parked.mcap", "-o", "parked.log.mcap"]), 0);
    folder
}

#[test]
fn a_vehicle_that_stood_is_drawn_scan_by_scan() {
    let folder = parked();
    let at = folder.path();
    let told = ends(&crossfall(at, &["plot", "parked.log.mcap", "-o", "pictures"]), 0);
    assert!(told.contains("parked.log.mcap: the vehicle stood: no view of the road"), "{told}");
    assert!(!names(&at.join("pictures")).iter().any(|name| name.starts_with("view")));
    let slopes = fs::read_to_string(at.join("pictures/slopes.svg")).unwrap();
    assert!(slopes.contains("Slopes, scan by scan") && slopes.contains("scans (the vehicle stood)"));
    assert!(slopes.contains("mean of each 2 scans") && !slopes.contains("found nowhere"));
    ends(&crossfall(at, &["report", "parked.log.mcap", "-o", "parked.html"]), 0);
    let report = fs::read_to_string(at.join("parked.html")).unwrap();
    assert!(report.contains("<h2>Slopes, scan by scan</h2>") && report.contains("scans (the vehicle stood)"));
    assert!(report.contains("<td>the vehicle stood</td>") && !report.contains("no speed to tell stations from"));
}

#[test]
fn a_station_is_the_tables_and_one_beyond_the_drive_is_refused() {
    let folder = drive();
    let at = folder.path();
    fs::create_dir_all(at.join("tue")).unwrap();
    for log in ["drive.log.mcap", "tue/drive.log.mcap"] {
        ends(&crossfall(at, &["run", "drive.mcap", "-o", log]), 0);
    }
    fails(
        at,
        &["plot", "drive.log.mcap", "--station", "5000", "-o", "no"],
        "drive.log.mcap: station 5000 m: the drive has ",
    );
    assert!(!at.join("no").exists());
    ends(&crossfall(at, &["profiles", "drive.log.mcap", "-o", "drive.csv"]), 0);
    let mut table = csv::Reader::from_path(at.join("drive.csv")).unwrap();
    let heading = table.headers().unwrap().clone();
    let column = |name| heading.iter().position(|one| one == name).unwrap();
    let row = table.records().nth(60).unwrap().unwrap();
    let (scan, station) = (&row[column("scan")], &row[column("station_m")]);
    let two = ["plot", "drive.log.mcap", "tue/drive.log.mcap", "--station", station, "-o", "pictures"];
    ends(&crossfall(at, &two), 0);
    assert!(names(&at.join("pictures")).contains(&format!("section-{scan}.svg")), "scan {scan} is at {station}");
    // Logs of one name are told apart by their folders.
    for picture in ["slopes", "runs"] {
        let svg = fs::read_to_string(at.join(format!("pictures/{picture}.svg"))).unwrap();
        assert!(svg.contains(">\ndrive\n<") && svg.contains("\ntue/drive"), "{picture}");
    }
}

#[test]
fn a_board_that_has_said_nothing_is_told() {
    let folder = drive();
    ends(&crossfall(folder.path(), &["run", "drive.mcap", "-o", "drive.log.mcap"]), 0);
    let output = crossfall(folder.path(), &["messages", "drive.log.mcap"]);
    assert!(ends(&output, 0).contains("drive.log.mcap: the board has said nothing") && output.stdout.is_empty());
}

/// Lines of examples are copied as they are: a terminal of 80 columns must not break one.
#[test]
fn examples_fit_a_terminal() {
    let folder = tempfile::tempdir().unwrap();
    let help = |arguments: &[&str]| {
        let output = crossfall(folder.path(), arguments);
        ends(&output, 0);
        String::from_utf8(output.stdout).unwrap()
    };
    let all = help(&["--help"]);
    let commands: Vec<&str> = all
        .lines()
        .skip_while(|line| *line != "Commands:")
        .skip(1)
        .take_while(|line| !line.is_empty())
        .filter_map(|line| line.strip_prefix("  ").filter(|line| !line.starts_with(' '))?.split(' ').next())
        .filter(|command| *command != "help")
        .collect();
    assert!(commands.len() > 20, "{all}");
    for command in commands {
        let text = help(&[command, "--help"]);
        let (_, examples) = text.split_once("Examples:\n").unwrap_or_default();
        for line in examples.lines().take_while(|line| !line.is_empty()) {
            assert!(line.chars().count() <= 80, "{command}: {line}");
            let whole = line.starts_with("  crossfall ") || line.starts_with("      ");
            assert!(whole, "{command}: broken by the help's own width: {line}");
        }
    }
}

/// Every help text, against `tests/help.txt`. With CROSSFALL_UPDATE set, the file is written instead.
#[test]
fn help_is_as_it_was() {
    let folder = tempfile::tempdir().unwrap();
    let mut all = String::new();
    let commands = [
        "",
        "demo",
        "simulate",
        "import",
        "run",
        "record",
        "recover",
        "replay",
        "verify",
        "profiles",
        "calibrate",
        "compare",
        "reproduce",
        "plot",
        "cloud",
        "report",
        "export",
        "info",
        "messages",
        "config",
        "completions",
    ];
    for command in commands {
        let arguments: Vec<_> = [command, "--help"].into_iter().filter(|argument| !argument.is_empty()).collect();
        let output = crossfall(folder.path(), &arguments);
        ends(&output, 0);
        all += &format!("$ crossfall {}\n{}\n", arguments.join(" "), String::from_utf8_lossy(&output.stdout));
    }
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/help.txt");
    if std::env::var_os("CROSSFALL_UPDATE").is_some() {
        fs::write(&path, &all).unwrap();
    }
    let expected = fs::read_to_string(&path).unwrap();
    assert!(all == expected, "help has changed; if it should, run once with CROSSFALL_UPDATE=1\n{all}");
}
