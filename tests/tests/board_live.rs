//! The live page's server on the emulated board, as on any other: lamps, recording, markers, a new configuration, a sensor that is restarted.

#[path = "../../host/tests/live/server.rs"]
mod server;

use std::io::{Read, Write};
use std::net::{SocketAddr, TcpStream};
use std::thread;
use std::time::{Duration, Instant};

use crossfall::live::{Live, Source};
use crossfall::serve::Access;
use crossfall::stream::{Item, Stream};
use crossfall::{board_words, config, verify};
use crossfall_core::protocol::Config;
use crossfall_core::protocol::message::Message;
use crossfall_tests::emulator::{Image, image};
use serde_json::{Value, json};
use server::Server;

/// A board comes up in two seconds, on a host with nothing else to do.
const PATIENCE: Duration = Duration::from_secs(120);

struct Page(SocketAddr);

impl Page {
    fn http(&self, line: &str, body: &str) -> Value {
        let Self(address) = self;
        let mut stream = TcpStream::connect(address).expect("a server");
        stream.set_read_timeout(Some(PATIENCE)).expect("a socket");
        let length = body.len();
        write!(stream, "{line} HTTP/1.1\r\nHost: {address}\r\nConnection: close\r\nContent-Length: {length}\r\n")
            .and_then(|()| write!(stream, "Content-Type: application/json\r\n\r\n{body}"))
            .expect("a server that listens");
        let mut answer = String::new();
        stream.read_to_string(&mut answer).expect("an answer");
        let (head, body) = answer.split_once("\r\n\r\n").expect("a head and a body");
        assert!(head.starts_with("HTTP/1.1 200"), "{line}: {answer}");
        serde_json::from_str(body).unwrap_or(Value::Null)
    }

    fn ask(&self, what: &Value) -> Value {
        self.http("POST /api/command", &what.to_string())
    }

    fn until(&self, what: &str, is: impl Fn(&Value) -> bool) -> Value {
        let began = Instant::now();
        loop {
            let state = self.http("GET /api/state", "");
            if is(&state) {
                return state;
            }
            assert!(began.elapsed() < PATIENCE, "{what}: {state:#}");
            thread::sleep(Duration::from_millis(50));
        }
    }
}

#[test]
fn a_drive_on_the_emulated_board_is_steered_from_the_page_and_verifies() {
    let folder = tempfile::tempdir().expect("a scratch folder");
    let device = format!("emulated:{}", image(Image::Board).display()).parse().expect("a device");
    let live = Live::start(&Source::Device(device), folder.path(), 1.0, None).expect("a board");
    let server = Server::start(live, Access::ThisComputer);
    let page = Page(server.address);

    let good = |state: &Value, lamp: &str| state["lamps"][lamp]["light"] == "good";
    let all = ["lidar", "ins", "pulse", "disk", "link"];
    let state = page.until("five good lamps", |state| all.iter().all(|lamp| good(state, lamp)));
    assert_eq!(state["board"]["board"], "olimex-stm32-h405");
    page.ask(&json!({ "do": "record", "name": "bench" }));
    page.until("profiles", |state| state["recording"]["profiles"].as_u64() > Some(20));
    page.ask(&json!({ "do": "mark", "label": "bridge" }));

    let mut wanted = Config::default();
    wanted.survey.limits.obstruction_um = 200_000;
    let echo = page.ask(&json!({ "do": "configure", "toml": config::to_toml(&wanted) }));
    assert_eq!(echo["toml"].as_str(), Some(config::to_toml(&wanted).as_str()), "{echo}");

    page.ask(&json!({ "do": "restart", "sensor": "lidar" }));
    let profiles = page.until("a state", |_| true)["recording"]["profiles"].as_u64().expect("a recording");
    page.until("more profiles", |state| state["recording"]["profiles"].as_u64() > Some(profiles + 60));
    page.ask(&json!({ "do": "stop" }));
    let state = page.until("an end", |state| state["last_recording"].is_object());
    drop(server);

    let last = &state["last_recording"];
    assert_eq!((&last["frames_lost"], &last["bytes_lost"], &last["error"]), (&json!(0), &json!(0), &json!(null)));
    let path = folder.path().join("bench.log.mcap");
    let report = verify::verify(&path, |_| ()).expect("a readable log");
    assert_eq!(report.problems, []);
    assert_eq!(report.profiles, report.profiles_reproduced);
    let (mut stream, mut markers, mut configured) = (Stream::open(&path).expect("a log"), 0, false);
    while let Some((_, item)) = stream.next() {
        match item {
            Item::Message { message: Message::Marker(marker), .. } => {
                assert_eq!(marker.label.text(), "bridge");
                markers += 1;
            }
            Item::Message { message: Message::Config(config), .. } => configured |= config == wanted,
            _ => {}
        }
    }
    assert!(markers == 1 && configured, "{markers} markers, configured: {configured}");
    let mut said = Vec::new();
    board_words::read(&path, None, |line| -> Result<(), crossfall::container::Error> {
        said.push(line.text);
        Ok(())
    })
    .expect("a readable log");
    assert!(said.iter().any(|line| line == "scanner: sends scans"), "the scanner was not set up again: {said:#?}");
}
