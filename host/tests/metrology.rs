//! `compare`, `calibrate` and `reproduce` as a user meets them: what they print, write and refuse.

mod program;

use std::fs;
use std::path::Path;

use program::ends;
use serde_json::Value;

fn json(text: &str) -> Value {
    serde_json::from_str(text).unwrap_or_else(|error| panic!("{error}: {text}"))
}

/// A drive of a scene, run, as `<name>.mcap` and `<name>.log.mcap`.
fn drive(folder: &Path, name: &str, scene: &str, seed: &str) {
    let (toml, capture, log) = (format!("{name}.toml"), format!("{name}.mcap"), format!("{name}.log.mcap"));
    fs::write(folder.join(&toml), scene).unwrap();
    ends(folder, &["simulate", "--scene", &toml, "--seed", seed, "-o", &capture], 0);
    ends(folder, &["run", &capture, "-o", &log], 0);
}

const ROAD: &str = "[drive]\nseconds = 12.0\nspeed_m_s = 25.0\n[sections]\nseed = 3\nspacing_m = 20.0\n";

#[test]
fn repeat_drives_are_matched_by_their_place() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    drive(at, "first", ROAD, "1");
    // It begins 31 m further on: matched by its own stations it would be compared with other sections.
    drive(at, "second", &ROAD.replace("speed_m_s", "start_m = 31.0\nspeed_m_s"), "2");
    let (out, _) = ends(at, &["compare", "first.log.mcap", "second.log.mcap", "--json", "-o", "pictures"], 0);
    let repeat = &json(&out)["repeat"];
    let number = |path: &[&str]| path.iter().fold(repeat, |value, key| &value[*key]).as_f64().unwrap();
    assert!(number(&["all", "matched"]) > 1_000.0);
    for slope in ["adjacent", "opposing", "all"] {
        let variation = number(&[slope, "mean_absolute_deg"]);
        // Two scans' noise is 0.03 degrees; up to 0.33 m between them on slopes that change by up to 4 degrees in 20 m.
        assert!((0.005..0.12).contains(&variation), "{slope}: {variation}");
    }
    assert!(number(&["aligned", "shift_m"]).abs() < 0.3);
    assert!(fs::read_to_string(at.join("pictures/repeat.svg")).unwrap().contains("Slopes of repeat drives"));
    let (text, _) = ends(at, &["compare", "first.log.mcap", "second.log.mcap", "--over", "10", "--side", "left"], 0);
    assert!(text.contains("mean absolute variation") && text.contains("second.log.mcap"), "{text}");
}

#[test]
fn a_drive_is_held_against_measurements_by_hand() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    let scene = fs::read_to_string(concat!(env!("CARGO_MANIFEST_DIR"), "/scenes/stations.toml")).unwrap();
    drive(at, "drive", &scene.replace("seconds = 20.0", "seconds = 12.0"), "1");
    // The listed section at 180 m, by an instrument of 0.1 degrees without signs.
    let table = "remark,side,slope,slope_deg,station_m\na,left,adjacent,13.0,180\nb,left,opposing,11.0,180\nc,right,adjacent,10.0,9000\n";
    fs::write(at.join("hand.csv"), table).unwrap();
    let arguments = ["compare", "drive.log.mcap", "--manual", "hand.csv", "--magnitudes", "--json", "-o", "pictures"];
    let (out, err) = ends(at, &arguments, 0);
    let manual = &json(&out)["manual"][0];
    assert_eq!((&manual["all"]["matched"], &manual["unmatched"]), (&2.into(), &1.into()));
    assert!(manual["all"]["mean_absolute_deg"].as_f64().unwrap() < 0.1, "{manual}");
    assert!(err.contains("1 measurements by hand have no slope within 1 m"), "{err}");
    assert!(at.join("pictures/manual.svg").exists());
    fs::write(at.join("bad.csv"), "side,slope,slope_deg,station_m\nleft,adjacent,x,1\n").unwrap();
    let (_, err) = ends(at, &["compare", "drive.log.mcap", "--manual", "bad.csv"], 1);
    assert!(err.starts_with("crossfall: bad.csv:2: slope_deg = `x`, expected a number"), "{err}");
    let (_, err) = ends(at, &["compare", "drive.log.mcap"], 1);
    assert!(err.contains("nothing to be held against"), "{err}");
}

#[test]
fn two_units_on_one_drive_are_compared() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    let scene = "[drive]\nseconds = 15.0\n[ins2]\nroll_bias_deg = 0.22\nattitude_drift_deg = 0.0\n";
    drive(at, "two", scene, "4");
    let (out, _) = ends(at, &["compare", "two.mcap", "--json", "-o", "pictures"], 0);
    let attitude = &json(&out)["attitude"];
    let roll = |key: &str| attitude["roll"][key].as_f64().unwrap();
    assert!((roll("mean_deg") - 0.22).abs() < 0.05, "{attitude}");
    assert!(roll("rms_deg") < 0.03, "{attitude}");
    let (lag, se) = (attitude["lag_us"].as_f64().unwrap(), attitude["lag_se_us"].as_f64().unwrap());
    assert!(lag.abs() < 4.0 * se && se < 200.0, "both are timed by the same pulses: {lag} us, {se}");
    assert!(fs::read_to_string(at.join("pictures/attitude.svg")).unwrap().contains("unit on the scanner"));
    // The second unit does not change what the board makes of the first.
    let (info, _) = ends(at, &["info", "two.log.mcap", "--json"], 0);
    assert_eq!(json(&info)["counters"]["ins.bad_frames"], 0);
}

#[test]
fn a_calibration_is_drawn_and_its_configuration_is_taken() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    let scene = fs::read_to_string(concat!(env!("CARGO_MANIFEST_DIR"), "/scenes/rock-test.toml")).unwrap();
    drive(at, "rock", &scene.replace("seconds = 60.0", "seconds = 10.0"), "1");
    let (out, _) = ends(at, &["calibrate", "rock.log.mcap", "-o", "my.toml", "--plot", "pictures", "--json"], 0);
    let found = json(&out);
    assert!((found["roll_offset_deg"].as_f64().unwrap() - 0.8).abs() < 0.06, "{found}");
    assert!((found["lidar_delay_us"].as_f64().unwrap() - 1_500.0).abs() < 300.0, "{found}");
    for (name, text) in [("rock.svg", "residual with the delay found"), ("ground.svg", "as measured")] {
        assert!(fs::read_to_string(at.join("pictures").join(name)).unwrap().contains(text), "{name}");
    }
    ends(at, &["run", "rock.mcap", "--config", "my.toml", "-o", "again.log.mcap"], 0);
    let (out, _) = ends(at, &["calibrate", "again.log.mcap", "--json"], 0);
    let again = json(&out);
    let change = again["roll_offset_deg"].as_f64().unwrap() - found["roll_offset_deg"].as_f64().unwrap();
    assert!(change.abs() < 1e-3, "{change}");
    let (_, err) = ends(at, &["calibrate", "rock.log.mcap", "again.log.mcap"], 1);
    assert!(err.contains("made with another offset or delay"), "{err}");
    // One test counts once, and has one direction.
    fs::copy(at.join("rock.log.mcap"), at.join("copy.log.mcap")).unwrap();
    let (_, err) = ends(at, &["calibrate", "rock.log.mcap", "copy.log.mcap"], 1);
    assert!(err.contains("copy.log.mcap: is the same test as rock.log.mcap"), "{err}");
    let (_, err) = ends(at, &["calibrate", "rock.log.mcap", "copy.log.mcap", "--cross-slope", "1.2"], 2);
    assert!(err.contains("--cross-slope is the slope in one direction"), "{err}");
    let (twice, err) = ends(at, &["calibrate", "rock.log.mcap", "./rock.log.mcap", "--json"], 0);
    assert!(err.contains("./rock.log.mcap: is named more than once, and read once"), "{err}");
    assert_eq!(json(&twice)["scans"], found["scans"]);
    let (_, err) = ends(at, &["compare", "rock.log.mcap", "./rock.log.mcap"], 1);
    assert!(err.contains("rock.log.mcap: has nothing to be held against"), "{err}");
}

#[test]
fn an_experiment_is_reproduced() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    let (out, _) = ends(at, &["reproduce", "--only", "two-units", "--seconds", "10", "-o", "made", "--json"], 0);
    let lines = json(&out)["lines"].as_array().unwrap().clone();
    assert!(lines.iter().any(|line| line["paper"] == 0.13 && line["crossfall"].as_f64().unwrap() < 0.06), "{lines:?}");
    for name in ["validation-two-units.svg", "validation-two-units-dark.svg"] {
        assert!(at.join("made/images").join(name).exists(), "{name}");
    }
    assert!(!at.join("made/validation.md").exists(), "the page is of all experiments");
}
