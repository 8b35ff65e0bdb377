//! The live page's interface: what is served and what is refused, what viewers see, and that what they ask for is in the log.

mod bench;
mod browser;
mod devtools;
#[path = "../program/mod.rs"]
mod program;
mod report;
mod server;

use std::fs;
use std::io::{BufRead, BufReader, Read, Write};
use std::net::TcpStream;
use std::path::Path;
use std::process::Command;
use std::thread;
use std::time::Duration;

use bench::{Bench, Viewer, await_that, http, marker_labels};
use crossfall::live::{Live, Phase, Source};
use crossfall::serve::Access;
use crossfall::simulate::scene::Scene;
use crossfall::{config, units, verify};
use crossfall_core::protocol::Config;
use program::crossfall;
use serde_json::{Value, json};

#[test]
fn the_page_is_served_whole_and_nothing_beside_it() {
    let bench = Bench::on_capture(1.0);
    let page = http(bench.address, "GET / HTTP/1.1", &[], "");
    assert_eq!(page.status, 200);
    assert!(page.header("content-type").unwrap().starts_with("text/html"));
    assert!(page.header("content-security-policy").unwrap().contains("default-src 'none'"));
    // Everything that the page loads is here, and nothing comes from elsewhere.
    assert!(!page.body.contains("http://") && !page.body.contains("https://"));
    for path in
        ["/live.css", "/icon.svg", "/main.js", "/wire.js", "/section.js", "/charts.js", "/panels.js", "/settings.js"]
    {
        let asset = http(bench.address, &format!("GET {path} HTTP/1.1"), &[], "");
        assert_eq!(asset.status, 200, "{path}");
        assert!(!asset.body.is_empty() && !asset.body.contains("https://"), "{path}");
    }
    for path in [
        "/../Cargo.toml",
        "/..%2f..%2fCargo.toml",
        "/%2e%2e/%2e%2e/etc/passwd",
        "/assets/../../src/main.rs",
        "//etc/passwd",
        "/main.js/..",
        "/main.js%00.css",
        "/api/",
        "/drive.log.mcap",
    ] {
        let answer = http(bench.address, &format!("GET {path} HTTP/1.1"), &[], "");
        assert!(matches!(answer.status, 400 | 404), "{path}: {}", answer.status);
        assert!(!answer.body.contains("[package]") && !answer.body.contains("root:"), "{path}");
    }
    assert_eq!(http(bench.address, "DELETE / HTTP/1.1", &[], "").status, 405);
    assert_eq!(http(bench.address, "GET /api/command HTTP/1.1", &[], "").status, 405);
    assert_eq!(http(bench.address, "nonsense", &[], "").status, 400);
}

#[test]
fn without_the_token_there_is_nothing() {
    const TOKEN: &str = "0123456789abcdef0123";
    let bench = Bench::on_capture_with(1.0, Access::Token(TOKEN.into()));
    for path in ["/", "/main.js", "/api/state", "/api/config", "/metrics", "/api/live", "/nothing", "/?token=wrong"] {
        let answer = http(bench.address, &format!("GET {path} HTTP/1.1"), &[], "");
        assert_eq!(answer.status, 401, "{path}");
        assert!(!answer.body.contains("lamps") && !answer.body.contains("script"), "{path}");
    }
    let post = http(bench.address, "POST /api/command HTTP/1.1", &[], r#"{"do":"record"}"#);
    assert_eq!(post.status, 401);
    assert!(Viewer::try_join(bench.address, &[]).is_err(), "no handshake without the token");

    let bearer = format!("Authorization: Bearer {TOKEN}");
    assert_eq!(http(bench.address, "GET /api/state HTTP/1.1", &[&bearer], "").status, 200);
    let first = http(bench.address, &format!("GET /?token={TOKEN} HTTP/1.1"), &[], "");
    assert_eq!((first.status, first.header("location")), (303, Some("/")));
    let cookie = first.header("set-cookie").unwrap();
    assert!(cookie.contains("HttpOnly") && cookie.contains("SameSite=Strict"), "{cookie}");
    let cookie = format!("Cookie: {}", cookie.split(';').next().unwrap());
    assert_eq!(http(bench.address, "GET / HTTP/1.1", &[&cookie], "").status, 200);
    let mut viewer = Viewer::try_join(bench.address, &[("Cookie", &cookie[8..])]).unwrap();
    assert_eq!(viewer.until_state(|_| true)["kind"], "state");
}

#[test]
fn another_sites_page_is_turned_away() {
    let bench = Bench::on_capture(1.0);
    let foreign = http(bench.address, "GET /api/state HTTP/1.1", &["Origin: http://evil.example"], "");
    assert_eq!(foreign.status, 403);
    assert!(Viewer::try_join(bench.address, &[("Origin", "http://evil.example")]).is_err());
    // A name that somebody else's server points at this computer.
    let mut stream = TcpStream::connect(bench.address).unwrap();
    stream.write_all(b"GET /api/state HTTP/1.1\r\nHost: evil.example\r\nConnection: close\r\n\r\n").unwrap();
    assert_eq!(bench::answer(stream).status, 403);
}

#[test]
fn viewers_see_sections_charts_track_and_state() {
    let bench = Bench::on_capture(4.0);
    let mut viewer = Viewer::join(bench.address);
    let state = viewer.until_state(|state| state["motion"]["station_m"].as_f64().is_some_and(|m| m > 150.0));
    for part in ["lidar", "ins", "pulse", "disk", "link"] {
        let lamp = &state["lamps"][part];
        assert_eq!(lamp["light"], "good", "{part}: {lamp}");
    }
    assert!(state["motion"]["points_per_mile"].as_f64().is_some_and(|n| n > 500.0), "{}", state["motion"]);
    assert!((state["motion"]["scan_hz"].as_f64().unwrap() - 37.5).abs() < 1.0);
    assert!(viewer.sections > 10 && viewer.strips > 3 && viewer.knots > 5, "{viewer:?}");
    // The section's header, and a point of 4 bytes for each return.
    let section = &viewer.last_section;
    let points = usize::from(u16::from_le_bytes([section[2], section[3]]));
    assert!(points > 100 && section.len() == 212 + 4 * points, "{} {points}", section.len());

    let config = http(bench.address, "GET /api/config HTTP/1.1", &[], "");
    assert!(config.body.contains("mounting_offset_deg"), "{}", config.body);
    let metrics = http(bench.address, "GET /metrics HTTP/1.1", &[], "").body;
    assert!(metrics.contains("crossfall_lamp{part=\"lidar\"} 1\n"), "{metrics}");
    assert!(metrics.contains("crossfall_viewers 1\n"));
    for line in metrics.lines().filter(|line| !line.starts_with('#')) {
        let (name, value) = line.rsplit_once(' ').unwrap();
        assert!(name.starts_with("crossfall_") && value.parse::<f64>().is_ok(), "{line}");
    }
}

#[test]
fn a_drive_is_recorded_with_its_markers_and_verifies() {
    let bench = Bench::on_capture(2.0);
    let mut viewer = Viewer::join(bench.address);
    viewer.until_state(|state| state["motion"]["profiles"].as_u64() > Some(20));
    let begun = viewer.ask(json!({ "do": "record", "name": "A1 north" }));
    assert_eq!(begun["ok"], true, "{begun}");
    let again = viewer.ask(json!({ "do": "record" }));
    assert_eq!((&again["ok"], &again["error"]), (&json!(false), &json!("a recording is under way")));
    viewer.until_state(|state| state["recording"]["profiles"].as_u64() > Some(30));
    assert_eq!(viewer.ask(json!({ "do": "mark", "label": "bridge" }))["ok"], true);
    assert_eq!(viewer.ask(json!({ "do": "mark" }))["ok"], true);
    let long = viewer.ask(json!({ "do": "mark", "label": "x".repeat(25) }));
    assert_eq!(long["ok"], false);
    viewer.until_state(|state| state["recording"]["markers"] == 2);
    let seek = viewer.ask(json!({ "do": "seek", "seconds": 1.0 }));
    assert_eq!(seek["ok"], false, "time must not jump in a log");
    assert_eq!(viewer.ask(json!({ "do": "stop" }))["ok"], true);
    let state = viewer.until_state(|state| state["last_recording"].is_object());
    let last = &state["last_recording"];
    assert_eq!((&last["frames_lost"], &last["error"]), (&json!(0), &json!(null)));

    let log = bench.folder.path().join("A1 north.log.mcap");
    let report = verify::verify(&log, |_| ()).unwrap();
    assert!(report.ok, "{:?}", report.problems);
    assert_eq!(report.profiles, last["profiles"].as_u64().unwrap());
    assert_eq!(report.frames, last["frames"].as_u64().unwrap());
    assert_eq!(marker_labels(&log), ["bridge", ""]);
    // The name is taken now: the next drive gets a number.
    let second = viewer.ask(json!({ "do": "record", "name": "A1 north" }));
    assert!(second["result"]["file"].as_str().unwrap().ends_with("A1 north-2.log.mcap"), "{second}");
}

#[test]
fn a_log_is_played_wound_and_measured_anew() {
    let bench = Bench::on_log(3.0);
    let mut viewer = Viewer::join(bench.address);
    viewer.until_state(|state| state["motion"]["profiles"].as_u64() > Some(20));
    assert_eq!(viewer.ask(json!({ "do": "pause", "paused": true }))["ok"], true);
    let still =
        viewer.until_state(|state| state["replay"]["paused"] == true && state["lamps"]["link"]["light"] == "off");
    assert_eq!(still["lamps"]["lidar"]["light"], "off");
    assert_eq!(viewer.ask(json!({ "do": "seek", "seconds": 8.0 }))["ok"], true);
    viewer.until_state(|state| (state["replay"]["position_s"].as_f64().unwrap() - 8.0).abs() < 0.1);
    assert_eq!(viewer.ask(json!({ "do": "speed", "times": 10.0 }))["ok"], true);
    for wrong in [json!(0), json!(-1), json!(1e9)] {
        assert_eq!(viewer.ask(json!({ "do": "speed", "times": wrong }))["ok"], false);
    }
    // The paper's own search over the same scans, recorded: the log proves it.
    let toml = "[survey]\nmethod = \"seed\"\n";
    let configured = viewer.ask(json!({ "do": "configure", "toml": toml }));
    assert!(configured["result"]["toml"].as_str().unwrap().contains("method = \"seed\""), "{configured}");
    assert_eq!(viewer.ask(json!({ "do": "speed", "times": 1.0 }))["ok"], true);
    assert_eq!(viewer.ask(json!({ "do": "record", "name": "again" }))["ok"], true);
    assert_eq!(viewer.ask(json!({ "do": "pause", "paused": false }))["ok"], true);
    viewer.until_state(|state| state["recording"]["profiles"].as_u64() > Some(30));
    assert_eq!(viewer.ask(json!({ "do": "stop" }))["ok"], true);
    viewer.until_state(|state| state["last_recording"].is_object());
    let report = verify::verify(&bench.folder.path().join("again.log.mcap"), |_| ()).unwrap();
    assert!(report.ok && report.profiles_reproduced > 30, "{:?}", report.problems);
}

#[test]
fn a_replay_that_has_ended_begins_again_unless_it_is_recorded() {
    let folder = tempfile::tempdir().unwrap();
    let live = Live::start(&Source::File(Bench::capture().into()), folder.path(), 50.0, None).unwrap();
    let replay = || live.hub().state().replay.unwrap();
    await_that("the end", || replay().ended);
    live.toggle_recording();
    await_that("a recording", || live.hub().state().recording.phase == Phase::Recording);
    live.toggle_pause();
    thread::sleep(Duration::from_millis(500));
    assert!(replay().ended, "time must not jump in a log");
    live.toggle_recording();
    await_that("its end", || live.hub().state().recording.phase == Phase::Idle);
    live.controls().unwrap().lock().speed = 1.0;
    live.toggle_pause();
    await_that("another beginning", || !replay().ended && replay().position_s < 5.0);
    live.toggle_pause();
    await_that("a pause", || replay().paused);
    live.finish();
}

/// Two recordings of a board that is not there, the second one ended by Ctrl-C.
#[cfg(unix)]
#[test]
fn recordings_without_a_frame_end_the_server_with_3() {
    let folder = tempfile::tempdir().unwrap();
    let serve = ["serve", "--device", "tcp:127.0.0.1:1", "--listen", "127.0.0.1:0"];
    let mut server = crossfall(folder.path(), &serve).spawn().unwrap();
    let mut told = BufReader::new(server.stderr.take().unwrap());
    let mut line = String::new();
    told.read_line(&mut line).unwrap();
    let address = line.split("http://").nth(1).and_then(|rest| rest.split('/').next()).unwrap().parse().unwrap();
    let ask = |body: &str| assert_eq!(http(address, "POST /api/command HTTP/1.1", &[], body).status, 200, "{body}");
    ask(r#"{"do":"record","name":"first"}"#);
    ask(r#"{"do":"stop"}"#);
    ask(r#"{"do":"record","name":"second"}"#);
    assert!(Command::new("kill").args(["-INT", &server.id().to_string()]).status().unwrap().success());
    assert_eq!(server.wait().unwrap().code(), Some(3));
    line.clear();
    told.read_to_string(&mut line).unwrap();
    assert_eq!(line.matches("no frame came").count(), 2, "{line}");
    assert!(line.contains("first.log.mcap: ") && line.contains("second.log.mcap: "), "{line}");
}

#[test]
fn a_script_winds_and_paces_a_replay_by_fractions() {
    let bench = Bench::on_log(1.0);
    for body in [r#"{"do":"pause","paused":true}"#, r#"{"do":"seek","seconds":1.5}"#, r#"{"do":"speed","times":0.5}"#] {
        let answer = http(bench.address, "POST /api/command HTTP/1.1", &[], body);
        assert_eq!(answer.status, 200, "{body}: {}", answer.body);
    }
    await_that("the replay is there", || {
        let state = http(bench.address, "GET /api/state HTTP/1.1", &[], "").body;
        let replay = serde_json::from_str::<Value>(&state).unwrap()["replay"].clone();
        (replay["position_s"].as_f64().unwrap() - 1.5).abs() < 0.1 && replay["speed"] == json!(0.5)
    });
}

#[test]
fn what_cannot_be_is_refused_in_words() {
    let bench = Bench::on_capture(1.0);
    let mut viewer = Viewer::join(bench.address);
    viewer.until_state(|state| state["config_number"].as_u64() > Some(0));
    for (request, words) in [
        (
            json!({ "do": "configure", "toml": "[scanner]\nmounting_offset_deg = 200.0" }),
            "expected a number from -90 to 90",
        ),
        (json!({ "do": "configure", "toml": "[scanner]\nno = 1" }), "unknown field"),
        (json!({ "do": "record", "name": "../outside" }), "a drive's name has letters"),
        (json!({ "do": "record", "name": "x".repeat(200) }), "at most 80"),
        (json!({ "do": "restart", "sensor": "lidar" }), "the board cannot do this"),
        (json!({ "do": "restart", "sensor": "engine" }), "unknown variant"),
        (json!({ "do": "self_destruct" }), "unknown variant"),
        (json!({ "do": "mark", "label": "a", "more": 1 }), "unknown field"),
        (json!({ "what": 1 }), "missing field `do`"),
        (json!({ "do": "stop" }), "nothing is being recorded"),
        (json!({ "do": "apply_rock_test" }), "no result"),
    ] {
        let answer = viewer.ask(request.clone());
        assert_eq!(answer["ok"], false, "{request}");
        assert!(answer["error"].as_str().unwrap().contains(words), "{request}: {answer}");
    }
    for text in ["", "{", "[1]", "null", "\"record\"", &"[".repeat(5_000)] {
        let answer = viewer.ask_text(text);
        assert_eq!(answer["ok"], false, "{text:.20}");
    }
    assert_eq!(viewer.ask_bytes(&[1, 2, 3])["ok"], false);
    // Longer than any request: the connection ends, the server does not.
    viewer.send_text(&"x".repeat(1 << 20));
    assert!(viewer.ends());
    for body in ["", "{", r#"{"do":"record","name":7}"#, &"x".repeat(40_000)] {
        let answer = http(bench.address, "POST /api/command HTTP/1.1", &[], body);
        assert!(matches!(answer.status, 400 | 413), "{body:.20}: {}", answer.status);
    }
    assert!(fs::read_dir(bench.folder.path()).unwrap().next().is_none(), "nothing was written");
    assert_eq!(http(bench.address, "GET /api/state HTTP/1.1", &[], "").status, 200);
}

#[test]
fn one_viewer_steers() {
    let bench = Bench::on_capture(1.0);
    let (mut a, mut b) = (Viewer::join(bench.address), Viewer::join(bench.address));
    a.until_state(|_| true);
    b.until_state(|_| true);
    assert_eq!(a.ask(json!({ "do": "mark" }))["ok"], true);
    assert_eq!(b.ask(json!({ "do": "mark" }))["error"], "another viewer steers");
    assert_eq!(http(bench.address, "POST /api/command HTTP/1.1", &[], r#"{"do":"mark"}"#).status, 409);
    assert_eq!(b.ask(json!({ "do": "control" }))["ok"], false);
    assert_eq!(b.ask(json!({ "do": "control", "take": true }))["ok"], true);
    assert_eq!(a.ask(json!({ "do": "mark" }))["ok"], false);
    b.until_control(|control| control["mine"] == true && control["viewers"] == 2);
    drop(b);
    a.until_control(|control| control["held"] == false && control["viewers"] == 1);
    assert_eq!(http(bench.address, "POST /api/command HTTP/1.1", &[], r#"{"do":"mark"}"#).status, 200);
}

#[test]
fn a_viewer_that_takes_nothing_costs_the_recording_nothing() {
    let bench = Bench::on_capture(10.0);
    // Joins, and never reads.
    let stuck = Viewer::join(bench.address);
    let mut viewer = Viewer::join(bench.address);
    assert_eq!(viewer.ask(json!({ "do": "pause", "paused": true }))["ok"], true);
    assert_eq!(viewer.ask(json!({ "do": "seek", "seconds": 0.0 }))["ok"], true);
    viewer.until_state(|state| state["replay"]["position_s"] == 0.0);
    assert_eq!(viewer.ask(json!({ "do": "record", "name": "fast" }))["ok"], true);
    viewer.until_state(|state| state["recording"]["phase"] == "recording");
    assert_eq!(viewer.ask(json!({ "do": "pause", "paused": false }))["ok"], true);
    viewer.until_state(|state| state["replay"]["ended"] == true && state["recording"]["profiles"].as_u64() > Some(100));
    assert_eq!(viewer.ask(json!({ "do": "stop" }))["ok"], true);
    let state = viewer.until_state(|state| state["last_recording"].is_object());
    assert_eq!((&state["last_recording"]["frames_lost"], &state["unviewed_frames"]), (&json!(0), &json!(0)));
    let report = verify::verify(&bench.folder.path().join("fast.log.mcap"), |_| ()).unwrap();
    assert!(report.ok && report.missing_frames == 0, "{:?}", report.problems);
    drop(stuck);
}

#[test]
fn an_unplugged_board_is_told_with_its_reason_and_comes_back() {
    let bench = Bench::on_board();
    let mut viewer = Viewer::join(bench.address);
    viewer.until_state(|state| state["lamps"]["lidar"]["light"] == "good");
    assert_eq!(viewer.ask(json!({ "do": "record", "name": "plug" }))["ok"], true);
    let moving = viewer.until_state(|state| state["recording"]["profiles"].as_u64() > Some(10));
    assert!(moving["motion"]["scan_hz"].as_f64() > Some(30.0) && moving["motion"]["speed_m_s"].is_f64());
    bench.board.as_ref().unwrap().unplug();
    let gone = viewer.until_state(|state| state["lamps"]["link"]["light"] == "bad");
    let motion = &gone["motion"];
    assert_eq!((&motion["scan_hz"], &motion["speed_m_s"]), (&json!(0.0), &json!(null)), "nothing comes any more");
    assert!(motion["points_per_mile"].is_null() && motion["station_m"].is_f64(), "{motion}");
    let lamp = &gone["lamps"]["link"];
    assert!(lamp["words"].as_str().unwrap().contains("no connection"), "{lamp}");
    assert!(lamp["advice"].as_str().unwrap().contains("cable"), "{lamp}");
    assert_eq!(gone["lamps"]["lidar"]["light"], "off", "nothing is known of it");
    thread::sleep(Duration::from_millis(300));
    bench.board.as_ref().unwrap().plug_in();
    viewer.until_state(|state| {
        ["link", "lidar", "ins"]
            .iter()
            .all(|part| matches!(state["lamps"][part]["light"].as_str(), Some("good" | "warn")))
    });
    viewer.until_state(|state| state["lamps"]["link"]["light"] == "good");
    assert_eq!(viewer.ask(json!({ "do": "stop" }))["ok"], true);
    let state = viewer.until_state(|state| state["last_recording"].is_object());
    assert!(state["last_recording"]["frames_lost"].as_u64() > Some(0), "what was sent meanwhile is lost, and told");
    let told = format!("{} frames lost", state["last_recording"]["frames_lost"]);
    assert_eq!(state["recording_amiss"][0].as_str(), Some(&*told));
    assert!(state["faults"].as_array().unwrap().iter().any(|fault| fault["words"].as_str().unwrap().contains("lost")));
    let report = verify::verify(&bench.folder.path().join("plug.log.mcap"), |_| ()).unwrap();
    assert!(report.missing_frames > 0 && report.profiles_reproduced > 10);
}

/// The mounting offset that the board measures with, as the page has it.
fn offset_deg(bench: &Bench) -> f64 {
    let config: Value = serde_json::from_str(&http(bench.address, "GET /api/config HTTP/1.1", &[], "").body).unwrap();
    let toml = config["toml"].as_str().unwrap();
    let line = toml.lines().find(|line| line.starts_with("mounting_offset_deg")).unwrap();
    line.split(['=', '#']).nth(1).unwrap().trim().parse().unwrap()
}

fn is_told(state: &Value, words: &str) -> bool {
    state["faults"].as_array().unwrap().iter().any(|fault| fault["words"].as_str().unwrap().contains(words))
}

#[test]
fn a_board_that_restarts_is_told_again_what_the_page_has_put_in_force() {
    let bench = Bench::on_board();
    let mut viewer = Viewer::join(bench.address);
    viewer.until_state(|state| state["lamps"]["lidar"]["light"] == "good");
    let configured = viewer.ask(json!({ "do": "configure", "toml": "[scanner]\nmounting_offset_deg = 0.8\n" }));
    assert_eq!(configured["ok"], true, "{configured}");
    assert_eq!(viewer.ask(json!({ "do": "record", "name": "watchdog" }))["ok"], true);
    viewer.until_state(|state| state["recording"]["profiles"].as_u64() > Some(10));
    bench.board.as_ref().unwrap().restart();
    let state = viewer.until_state(|state| is_told(state, "sent again and in force: mounting offset +0.8000 degrees"));
    assert!(is_told(&state, "the board has restarted"), "{}", state["faults"]);
    let profiles = state["recording"]["profiles"].as_u64().unwrap();
    let state = viewer.until_state(|state| state["recording"]["profiles"].as_u64() > Some(profiles + 20));
    assert!((offset_deg(&bench) - 0.8).abs() < 1e-6);
    assert_eq!(state["configuration"], "mounting offset +0.8000 degrees, delay +0.000 ms");
    assert_eq!(viewer.ask(json!({ "do": "stop" }))["ok"], true);
    viewer.until_state(|state| state["last_recording"].is_object());
    let report = verify::verify(&bench.folder.path().join("watchdog.log.mcap"), |_| ()).unwrap();
    assert_eq!(report.boots, 2);
    assert_eq!(report.profiles_reproduced + report.profiles_unverifiable, report.profiles, "{:?}", report.problems);
}

#[test]
fn a_board_is_given_its_configuration_when_it_is_plugged_in_and_when_it_restarts() {
    let mut config = Config::default();
    config.scanner.mounting_offset = units::angle_of(0.8);
    let bench = Bench::on_absent_board_with(Some(config));
    let mut viewer = Viewer::join(bench.address);
    viewer.until_state(|state| state["lamps"]["link"]["light"] == "bad");
    bench.board.as_ref().unwrap().plug_in();
    viewer.until_state(|state| state["configuration"] == "mounting offset +0.8000 degrees, delay +0.000 ms");
    viewer.until_state(|state| state["lamps"]["link"]["light"] == "good");
    bench.board.as_ref().unwrap().restart();
    viewer.until_state(|state| is_told(state, "sent again and in force"));
    // What is put in force later is what is kept.
    let configured = viewer.ask(json!({ "do": "configure", "toml": "[scanner]\nmounting_offset_deg = -1.5\n" }));
    assert_eq!(configured["ok"], true, "{configured}");
    bench.board.as_ref().unwrap().restart();
    viewer.until_state(|state| is_told(state, "sent again and in force: mounting offset -1.5000 degrees"));
    assert!((offset_deg(&bench) + 1.5).abs() < 1e-6);
}

#[test]
fn a_board_that_is_not_there_is_waited_for() {
    let bench = Bench::on_absent_board();
    let mut viewer = Viewer::join(bench.address);
    viewer.until_state(|state| {
        let lamp = &state["lamps"]["link"];
        lamp["light"] == "bad" && lamp["words"].as_str().unwrap().contains("no connection")
    });
    let answer = viewer.ask(json!({ "do": "mark" }));
    assert!(answer["error"].as_str().unwrap().contains("is it connected?"), "{answer}");
    bench.board.as_ref().unwrap().plug_in();
    viewer.until_state(|state| state["lamps"]["lidar"]["light"] == "good");
}

#[test]
fn a_folder_that_cannot_be_written_is_told() {
    let bench = Bench::on_capture(1.0);
    let mut viewer = Viewer::join(bench.address);
    fs::remove_dir(bench.folder.path()).unwrap();
    let answer = viewer.ask(json!({ "do": "record", "name": "x" }));
    assert_eq!(answer["ok"], false, "{answer}");
    let state = viewer.until_state(|state| state["lamps"]["disk"]["light"] == "bad");
    assert!(state["lamps"]["disk"]["advice"].as_str().unwrap().contains("folder"), "{}", state["lamps"]["disk"]);
    fs::create_dir(bench.folder.path()).unwrap();
    assert_eq!(viewer.ask(json!({ "do": "record", "name": "x" }))["ok"], true);
    await_that("the log is there", || bench.folder.path().join("x.log.mcap").exists());
}

#[test]
fn a_rock_test_finds_offset_and_delay_and_puts_them_in_force() {
    let bench = Bench::on_rock_test();
    let mut viewer = Viewer::join(bench.address);
    viewer.until_state(|state| state["motion"]["profiles"].as_u64() > Some(40));
    assert_eq!(viewer.ask(json!({ "do": "rock_test", "action": "begin" }))["ok"], true);
    let live = viewer.until_state(|state| state["rock_test"]["scans"].as_u64() > Some(600));
    assert!(live["rock_test"]["roll_rate_deg_s"].as_f64() > Some(1.0), "{}", live["rock_test"]);
    assert!(live["rock_test"]["residual_deg"].is_array());
    assert_eq!(viewer.ask(json!({ "do": "rock_test", "action": "end" }))["ok"], true);
    let done = viewer.until_state(|state| state["rock_test"]["estimate"].is_object());
    let estimate = &done["rock_test"]["estimate"];
    assert!((estimate["roll_offset_deg"].as_f64().unwrap() - bench::ROCK_OFFSET_DEG).abs() < 0.1, "{estimate}");
    assert!((estimate["lidar_delay_us"].as_f64().unwrap() - bench::ROCK_DELAY_US).abs() < 2_000.0, "{estimate}");
    let applied = viewer.ask(json!({ "do": "apply_rock_test" }));
    assert_eq!(applied["ok"], true, "{applied}");
    let toml = applied["result"]["toml"].as_str().unwrap();
    let line = toml.lines().find(|line| line.starts_with("mounting_offset_deg")).unwrap();
    let offset: f64 = line.split(['=', '#']).nth(1).unwrap().trim().parse().unwrap();
    assert!((offset - bench::ROCK_OFFSET_DEG).abs() < 0.1, "{line}");
    // A test over a jump in time is none.
    assert_eq!(viewer.ask(json!({ "do": "rock_test", "action": "begin" }))["ok"], true);
    viewer.until_state(|state| state["rock_test"]["running"] == true);
    assert_eq!(viewer.ask(json!({ "do": "seek", "seconds": 0.0 }))["ok"], true);
    assert_eq!(viewer.ask(json!({ "do": "pause", "paused": false }))["ok"], true);
    let state = viewer.until_state(|state| state["rock_test"]["refusal"].is_string());
    assert!(state["rock_test"]["refusal"].as_str().unwrap().contains("begin the test again"), "{state}");
}

/// A rock test over the first half minute of a drive, and what comes of putting its result in force.
fn rocked(viewer: &mut Viewer) -> (Value, Value) {
    assert_eq!(viewer.ask(json!({ "do": "rock_test", "action": "begin" }))["ok"], true);
    viewer.until_state(|state| state["rock_test"]["scans"].as_u64() > Some(1_000));
    assert_eq!(viewer.ask(json!({ "do": "rock_test", "action": "end" }))["ok"], true);
    let state = viewer.until_state(|state| state["rock_test"]["estimate"].is_object());
    (state["rock_test"]["estimate"].clone(), viewer.ask(json!({ "do": "apply_rock_test" })))
}

#[test]
fn what_a_rock_test_cannot_tell_is_not_put_in_force() {
    let mut scene = Scene::default();
    scene.drive.seconds = 40.0;
    scene.scanner.delay_us = bench::ROCK_DELAY_US;
    // A drive tells the delay, but no offset: the road's cross slope is not known.
    let bench = Bench::on_scene(&scene, 10.0);
    let (estimate, applied) = rocked(&mut Viewer::join(bench.address));
    assert_eq!((&estimate["offset_determined"], &estimate["delay_determined"]), (&json!(false), &json!(true)));
    assert!(estimate["roll_offset_deg"].as_f64().unwrap().abs() > 0.001, "{estimate}");
    let toml = config::parse(Path::new("echo"), applied["result"]["toml"].as_str().unwrap()).unwrap();
    assert_eq!(toml.scanner.mounting_offset, Config::default().scanner.mounting_offset, "{applied}");
    assert_eq!(f64::from(toml.scanner.delay_us), estimate["lidar_delay_us"].as_f64().unwrap().round());
    // One without roll tells neither.
    scene.vehicle.roll = Vec::new();
    scene.ins.attitude_drift_deg = 0.0;
    let bench = Bench::on_scene(&scene, 10.0);
    let (estimate, applied) = rocked(&mut Viewer::join(bench.address));
    assert_eq!((&estimate["offset_determined"], &estimate["delay_determined"]), (&json!(false), &json!(false)));
    assert_eq!(applied["ok"], false, "{applied}");
    assert!(applied["error"].as_str().unwrap().contains("neither offset nor delay"), "{applied}");
}

#[test]
fn connections_that_ask_for_nothing_are_given_up() {
    let bench = Bench::on_capture(1.0);
    let mut viewer = Viewer::join(bench.address);
    // More than are served at a time; half a request is none.
    let idle: Vec<_> = (0..140)
        .map(|number| {
            let mut stream = TcpStream::connect(bench.address).unwrap();
            if number % 2 == 0 {
                stream.write_all(b"GET /api/state HTTP/1.1\r\nHost: ").unwrap();
            }
            stream.set_read_timeout(Some(Duration::from_secs(30))).unwrap();
            stream
        })
        .collect();
    // Who looks on already does not notice; who comes now waits, and not for ever.
    assert_eq!(viewer.ask(json!({ "do": "mark" }))["ok"], true);
    assert_eq!(http(bench.address, "GET /api/state HTTP/1.1", &[], "").status, 200);
    for mut stream in idle {
        let mut said = Vec::new();
        stream.read_to_end(&mut said).expect("the server ends the connection");
    }
    // Neither is a body waited for that does not come.
    let mut stream = TcpStream::connect(bench.address).unwrap();
    let head = format!("POST /api/command HTTP/1.1\r\nHost: {}\r\nContent-Length: 9\r\n\r\n", bench.address);
    stream.write_all(head.as_bytes()).unwrap();
    assert_eq!(bench::answer(stream).status, 408);
    assert_eq!(viewer.ask(json!({ "do": "mark" }))["ok"], true);
}
