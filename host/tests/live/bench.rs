//! A server on a loopback port, what it shows, and viewers of it.

use std::fs;
use std::io::{ErrorKind, Read, Write};
use std::net::{SocketAddr, TcpListener, TcpStream};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, OnceLock};
use std::thread;
use std::time::{Duration, Instant};

use crossfall::live::film::Film;
use crossfall::live::player::Player;
use crossfall::live::{Live, Source};
use crossfall::record::Device;
use crossfall::serve::Access;
use crossfall::simulate::scene::Scene;
use crossfall::stream::{Item, Stream};
use crossfall::{capture, log, run, simulate};
use crossfall_core::protocol::Config;
use crossfall_core::protocol::message::Message;
use serde_json::{Value, json};
use tempfile::TempDir;
use tungstenite::client::IntoClientRequest;
use tungstenite::http::{HeaderName, HeaderValue};
use tungstenite::{Message as Frame, WebSocket, client};

use crate::server::Server;

/// No step of a test takes as long unless it fails.
const PATIENCE: Duration = Duration::from_secs(60);

pub const ROCK_OFFSET_DEG: f64 = 0.8;
pub const ROCK_DELAY_US: f64 = 1_500.0;

/// Simulated drives, made once for all tests of this binary.
struct Drives {
    _folder: TempDir,
    capture: PathBuf,
    log: PathBuf,
    rock_test: PathBuf,
}

fn drives() -> &'static Drives {
    static DRIVES: OnceLock<Drives> = OnceLock::new();
    DRIVES.get_or_init(|| {
        let folder = tempfile::tempdir().unwrap();
        let [capture, log_path, rock_test] =
            ["drive.mcap", "drive.log.mcap", "rock.mcap"].map(|f| folder.path().join(f));
        let mut scene = Scene::default();
        scene.drive.seconds = 15.0;
        write(&scene, &capture);
        let mut log = log::Writer::create(&log_path).unwrap();
        run::run(&mut capture::Reader::open(&capture).unwrap(), &Config::default(), &mut log, |_| ()).unwrap();
        log.finish().unwrap();

        let mut scene = Scene::rock_test(ROCK_OFFSET_DEG, ROCK_DELAY_US);
        scene.drive.seconds = 22.0;
        write(&scene, &rock_test);
        Drives { _folder: folder, capture, log: log_path, rock_test }
    })
}

fn write(scene: &Scene, path: &Path) {
    let mut writer = capture::Writer::create(path).unwrap();
    simulate::simulate(scene, &mut writer, |_| ()).unwrap();
    writer.finish().unwrap();
}

/// A server and its folder of logs.
pub struct Bench {
    pub address: SocketAddr,
    // Ends before its folder goes.
    _server: Server,
    pub folder: TempDir,
    pub board: Option<Board>,
}

impl Bench {
    /// The capture of [`Bench::on_capture`].
    pub fn capture() -> &'static Path {
        &drives().capture
    }

    pub fn on_capture(speed: f64) -> Self {
        Self::on_capture_with(speed, Access::ThisComputer)
    }

    pub fn on_capture_with(speed: f64, access: Access) -> Self {
        Self::start(&Source::File(drives().capture.clone()), speed, access, None, None)
    }

    pub fn on_log(speed: f64) -> Self {
        Self::start(&Source::File(drives().log.clone()), speed, Access::ThisComputer, None, None)
    }

    pub fn on_rock_test() -> Self {
        Self::start(&Source::File(drives().rock_test.clone()), 5.0, Access::ThisComputer, None, None)
    }

    /// On a drive of so many seconds, made for it.
    pub fn on_long_drive(seconds: f64, speed: f64) -> Self {
        let mut scene = Scene::default();
        scene.drive.seconds = seconds;
        Self::on_scene(&scene, speed)
    }

    /// On a drive made for it.
    pub fn on_scene(scene: &Scene, speed: f64) -> Self {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("long.mcap");
        write(scene, &path);
        let bench = Self::start(&Source::File(path), speed, Access::ThisComputer, None, None);
        // The film holds the file open.
        drop(folder);
        bench
    }

    /// On a board behind a TCP port.
    pub fn on_board() -> Self {
        let bench = Self::on_absent_board();
        bench.board.as_ref().unwrap().plug_in();
        bench
    }

    /// On a board that is yet to be plugged in.
    pub fn on_absent_board() -> Self {
        Self::on_absent_board_with(None)
    }

    /// The same, with a configuration that it is to have.
    pub fn on_absent_board_with(config: Option<Config>) -> Self {
        let board = Board::new(&drives().capture);
        let device: Device = format!("tcp:{}", board.address).parse().unwrap();
        Self::start(&Source::Device(device), 1.0, Access::ThisComputer, Some(board), config)
    }

    fn start(source: &Source, speed: f64, access: Access, board: Option<Board>, config: Option<Config>) -> Self {
        let folder = tempfile::tempdir().unwrap();
        let live = Live::start(source, folder.path(), speed, config).unwrap();
        let server = Server::start(live, access);
        Self { address: server.address, _server: server, folder, board }
    }
}

/// A board behind a TCP port that can be unplugged: it drives on meanwhile, as boards do. Restarted, it begins its drive again.
pub struct Board {
    address: SocketAddr,
    plugged: Arc<AtomicBool>,
    restarts: Arc<AtomicBool>,
}

impl Board {
    fn new(capture: &Path) -> Self {
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        listener.set_nonblocking(true).unwrap();
        let address = listener.local_addr().unwrap();
        let plugged = Arc::new(AtomicBool::new(false));
        let film = Film::open(capture, None).unwrap();
        let is_plugged = Arc::clone(&plugged);
        let restarts = Arc::new(AtomicBool::new(false));
        let does_restart = Arc::clone(&restarts);
        let path = capture.to_path_buf();
        // Ends with the process: a board has no other end.
        thread::spawn(move || {
            let (mut player, mut controls) = Player::new(film, 1.0);
            let mut host: Option<TcpStream> = None;
            let mut bytes = [0; 4096];
            loop {
                if !is_plugged.load(Ordering::Relaxed) {
                    host = None;
                    // Who knocks at a board without power hears nothing and is put off.
                    drop(listener.accept());
                } else if let Ok((stream, _)) = listener.accept() {
                    stream.set_nonblocking(true).unwrap();
                    host = Some(stream);
                }
                if does_restart.swap(false, Ordering::Relaxed) {
                    (player, controls) = Player::new(Film::open(&path, None).unwrap(), 1.0);
                }
                if controls.lock().ended {
                    controls.lock().wind_to_s = Some(0.0);
                }
                let count = player.read(&mut bytes).unwrap_or(0);
                let Some(stream) = &mut host else { continue };
                let mut rest = &bytes[..count];
                while !rest.is_empty() {
                    match stream.write(rest) {
                        Ok(written) => rest = &rest[written..],
                        Err(error) if error.kind() == ErrorKind::WouldBlock => thread::sleep(Duration::from_millis(1)),
                        Err(_) => break,
                    }
                }
                let mut asked = [0; 512];
                if let Ok(count) = stream.read(&mut asked)
                    && count > 0
                {
                    player.write_all(&asked[..count]).unwrap();
                }
            }
        });
        Self { address, plugged, restarts }
    }

    pub fn plug_in(&self) {
        self.plugged.store(true, Ordering::Relaxed);
    }

    /// A watchdog, or a dip of the supply.
    pub fn restart(&self) {
        self.restarts.store(true, Ordering::Relaxed);
    }

    pub fn unplug(&self) {
        self.plugged.store(false, Ordering::Relaxed);
    }
}

/// A viewer, and what it has been shown.
#[derive(Debug)]
pub struct Viewer {
    socket: WebSocket<TcpStream>,
    next: u64,
    pub sections: usize,
    pub strips: usize,
    pub knots: usize,
    pub last_section: Vec<u8>,
}

impl Viewer {
    pub fn join(address: SocketAddr) -> Self {
        Self::try_join(address, &[]).unwrap()
    }

    pub fn try_join(address: SocketAddr, headers: &[(&'static str, &str)]) -> Result<Self, String> {
        let stream = TcpStream::connect(address).unwrap();
        stream.set_read_timeout(Some(PATIENCE)).unwrap();
        let mut request = format!("ws://{address}/api/live").into_client_request().unwrap();
        for (name, value) in headers {
            request.headers_mut().insert(HeaderName::from_static(lower(name)), HeaderValue::from_str(value).unwrap());
        }
        let (socket, _) = client(request, stream).map_err(|error| error.to_string())?;
        Ok(Self { socket, next: 1, sections: 0, strips: 0, knots: 0, last_section: Vec::new() })
    }

    /// Reads until a text message satisfies.
    fn until(&mut self, what: &str, mut satisfies: impl FnMut(&Value) -> bool) -> Value {
        let began = Instant::now();
        let mut latest = Value::Null;
        loop {
            assert!(began.elapsed() < PATIENCE, "waited in vain for a {what}; the latest text: {latest}");
            match self.socket.read().unwrap() {
                Frame::Text(text) => {
                    let value: Value = serde_json::from_str(&text).unwrap();
                    if satisfies(&value) {
                        return value;
                    }
                    latest = value;
                }
                Frame::Binary(bytes) => {
                    let count = usize::from(u16::from_le_bytes([bytes[2], bytes[3]]));
                    match bytes[0] {
                        1 => {
                            self.sections += 1;
                            self.last_section = bytes.to_vec();
                        }
                        2 => {
                            self.strips += count;
                            assert_eq!(bytes.len(), 8 + 36 * count);
                        }
                        3 => {
                            self.knots += count;
                            assert_eq!(bytes.len(), 8 + 12 * count);
                        }
                        other => panic!("a message of kind {other}"),
                    }
                }
                _ => {}
            }
        }
    }

    pub fn until_state(&mut self, satisfies: impl Fn(&Value) -> bool) -> Value {
        self.until("state", |value| value["kind"] == "state" && satisfies(value))
    }

    pub fn until_control(&mut self, satisfies: impl Fn(&Value) -> bool) -> Value {
        self.until("control", |value| value["kind"] == "control" && satisfies(value))
    }

    pub fn ask(&mut self, mut request: Value) -> Value {
        let id = self.next;
        self.next += 1;
        request["id"] = json!(id);
        self.send_text(&request.to_string());
        self.until("reply", |value| value["kind"] == "reply" && value["id"] == id)
    }

    pub fn ask_text(&mut self, text: &str) -> Value {
        self.send_text(text);
        self.until("reply", |value| value["kind"] == "reply")
    }

    pub fn ask_bytes(&mut self, bytes: &[u8]) -> Value {
        self.socket.send(Frame::Binary(bytes.to_vec().into())).unwrap();
        self.until("reply", |value| value["kind"] == "reply")
    }

    pub fn send_text(&mut self, text: &str) {
        // A server that ends the connection while it is being written to is seen by who reads.
        let _seen = self.socket.send(Frame::Text(text.into()));
    }

    /// Whether the server ends the connection.
    pub fn ends(&mut self) -> bool {
        let began = Instant::now();
        while began.elapsed() < PATIENCE {
            if self.socket.read().is_err() {
                return true;
            }
        }
        false
    }
}

fn lower(name: &'static str) -> &'static str {
    match name {
        "Cookie" => "cookie",
        "Origin" => "origin",
        other => other,
    }
}

/// An answer over HTTP.
#[derive(Debug)]
pub struct Answer {
    pub status: u16,
    headers: Vec<(String, String)>,
    pub body: String,
}

impl Answer {
    pub fn header(&self, name: &str) -> Option<&str> {
        self.headers.iter().find(|(key, _)| key.eq_ignore_ascii_case(name)).map(|(_, value)| value.as_str())
    }
}

/// Asks as written: nothing tidies the path up.
pub fn http(address: SocketAddr, line: &str, headers: &[&str], body: &str) -> Answer {
    let mut stream = TcpStream::connect(address).unwrap();
    let mut request = format!("{line}\r\nHost: {address}\r\nConnection: close\r\nContent-Length: {}\r\n", body.len());
    for header in headers {
        request += &format!("{header}\r\n");
    }
    request += "\r\n";
    request += body;
    // A server may refuse before it has read everything.
    let _refused = stream.write_all(request.as_bytes());
    answer(stream)
}

pub fn answer(mut stream: TcpStream) -> Answer {
    stream.set_read_timeout(Some(PATIENCE)).unwrap();
    let mut bytes = Vec::new();
    let mut piece = [0; 4096];
    while let Ok(count) = stream.read(&mut piece)
        && count > 0
    {
        bytes.extend_from_slice(&piece[..count]);
    }
    let text = String::from_utf8(bytes).unwrap();
    let (head, body) = text.split_once("\r\n\r\n").unwrap_or((&text, ""));
    let mut lines = head.lines();
    let status = lines.next().and_then(|line| line.split(' ').nth(1)).and_then(|word| word.parse().ok()).unwrap_or(0);
    let pair = |line: &str| line.split_once(": ").map(|(key, value)| (key.to_owned(), value.to_owned()));
    Answer { status, headers: lines.filter_map(pair).collect(), body: body.to_owned() }
}

pub fn await_that(what: &str, is: impl Fn() -> bool) {
    let began = Instant::now();
    while !is() {
        assert!(began.elapsed() < PATIENCE, "{what}");
        thread::sleep(Duration::from_millis(10));
    }
}

/// The markers in a log.
pub fn marker_labels(path: &Path) -> Vec<String> {
    assert!(fs::metadata(path).unwrap().len() > 0);
    let mut stream = Stream::open(path).unwrap();
    let mut labels = Vec::new();
    while let Some((_, item)) = stream.next() {
        if let Item::Message { message: Message::Marker(marker), .. } = item {
            labels.push(marker.label.text().to_owned());
        }
    }
    labels
}
