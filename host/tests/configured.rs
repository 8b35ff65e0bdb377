//! The configuration that a drive is measured with: put in force when a board says hello, again when it has restarted, and told in words
//! where that fails. The boards are threads here; one of them is the instrument itself.

mod program;

use std::cell::Cell;
use std::fs;
use std::io::{self, ErrorKind, Read, Write};
use std::net::{TcpListener, TcpStream};
use std::path::Path;
use std::process::Child;
use std::thread;
use std::time::{Duration, Instant};

use crossfall::config::to_toml;
use crossfall::live::film::Film;
use crossfall::live::player::Player;
use crossfall::record::{Device, Notice, Outbox, Port, Summary, Unconfigured, converse};
use crossfall::simulate::{self, scene::Scene};
use crossfall::stream::{Item, Stream};
use crossfall::units::angle_of;
use crossfall::{capture, log, verify};
use crossfall_core::protocol::frame::{BoardDecoder, Event, MAX_MESSAGE_FRAME, Sequencer};
use crossfall_core::protocol::message::{self, Hello, Message, Outcome, Reply, Status};
use crossfall_core::protocol::{Config, schema};
use program::{crossfall, ended};

/// No test takes as long unless it fails.
const PATIENCE: Duration = Duration::from_secs(60);

fn tilted() -> Config {
    let mut config = Config::default();
    config.scanner.mounting_offset = angle_of(0.8079);
    config.scanner.delay_us = 1_465;
    config
}

fn listener() -> (TcpListener, Device) {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let device = format!("tcp:{}", listener.local_addr().unwrap()).parse().unwrap();
    (listener, device)
}

/// A board that says what it is told to say.
struct Script {
    port: TcpStream,
    sequencer: Sequencer,
    decoder: BoardDecoder,
    heard: Vec<u8>,
}

impl Script {
    /// Once the host has asked who it is.
    fn accept(listener: &TcpListener) -> Self {
        let (port, _) = listener.accept().unwrap();
        port.set_read_timeout(Some(Duration::from_millis(20))).unwrap();
        let mut board = Self { port, sequencer: Sequencer::new(), decoder: BoardDecoder::new(), heard: Vec::new() };
        assert_eq!(board.command(), Some((0, message::Command::Identify)));
        board
    }

    fn say(&mut self, message: &Message<'_>) {
        let mut frame = [0; MAX_MESSAGE_FRAME];
        let length = self.sequencer.message(message, &mut frame).unwrap();
        // The host may have ended.
        let _ended = self.port.write_all(&frame[..length]);
    }

    fn hello(&mut self, config: Config) {
        let hello = Hello { schema: schema::HASH, firmware: "crossfall 0", board: "scripted", boot: 1, restart: "" };
        self.say(&Message::Hello(hello));
        self.say(&Message::Config(config));
    }

    /// Starts again: its numbers too.
    fn boot(&mut self) {
        self.sequencer = Sequencer::new();
    }

    /// The next command, meanwhile sending what a board always sends. None when the host has ended.
    fn command(&mut self) -> Option<(u16, message::Command)> {
        let began = Instant::now();
        loop {
            assert!(began.elapsed() < PATIENCE, "no command");
            let mut rest = self.heard.as_slice();
            let event = self.decoder.next(&mut rest);
            let command = match event {
                None => None,
                Some(Event::Frame(frame)) => Some((frame.sequence, frame.body)),
                Some(other) => panic!("{other:?}"),
            };
            let read = self.heard.len() - rest.len();
            self.heard.drain(..read);
            if command.is_some() {
                return command;
            }
            let mut bytes = [0; 256];
            match self.port.read(&mut bytes) {
                Ok(0) => return None,
                Ok(count) => self.heard.extend_from_slice(&bytes[..count]),
                Err(error) if matches!(error.kind(), ErrorKind::WouldBlock | ErrorKind::TimedOut) => {
                    if self.sequencer != Sequencer::new() {
                        self.say(&Message::Status(Status::default()));
                    }
                }
                Err(_) => return None,
            }
        }
    }

    fn configure(&mut self) -> (u16, Config) {
        match self.command() {
            Some((number, message::Command::Configure(config))) => (number, config),
            other => panic!("{other:?}"),
        }
    }
}

/// Records until what was told satisfies.
fn record_until(
    device: &Device,
    port: Box<dyn Port>,
    path: &Path,
    config: Option<Config>,
    mut enough: impl FnMut(&Summary, &[Notice]) -> bool,
) -> (Summary, Vec<Notice>) {
    let mut log = log::Writer::create_live(path).unwrap();
    let notices = std::cell::RefCell::new(Vec::new());
    let began = Instant::now();
    let summary = converse(
        device,
        port,
        &mut log,
        &Outbox::default(),
        config,
        |notice| notices.borrow_mut().push(notice),
        |summary| {
            assert!(began.elapsed() < PATIENCE, "{summary:?} {notices:?}");
            !enough(summary, &notices.borrow())
        },
    )
    .unwrap();
    log.finish().unwrap();
    (summary, notices.into_inner())
}

/// The configurations that hold in a log, in their order.
fn configurations(path: &Path) -> Vec<Config> {
    let mut stream = Stream::open(path).unwrap();
    let mut found = Vec::new();
    while let Some((_, item)) = stream.next() {
        if let Item::Message { message: Message::Config(config), .. } = item {
            found.push(config);
        }
    }
    // Each introduction has it too.
    found.dedup();
    found
}

/// A capture of so many seconds.
fn write_capture(path: &Path, seconds: f64) {
    let mut scene = Scene::default();
    scene.drive.seconds = seconds;
    let mut writer = capture::Writer::create(path).unwrap();
    simulate::simulate(&scene, &mut writer, |_| ()).unwrap();
    writer.finish().unwrap();
}

/// The instrument, driven through a capture, on a port. It loses its power in the middle of the drive when it has the configuration and so
/// many frames are out, and comes up as it does then: with the defaults, and surveying.
fn drive_and_restart(listener: &TcpListener, path: &Path, frames: usize) {
    let (mut port, _) = listener.accept().unwrap();
    port.set_nonblocking(true).unwrap();
    for life in 0..2 {
        let (mut player, controls) = Player::new(Film::open(path, None).unwrap(), 10.0);
        let (mut sent, mut configured) = (0, false);
        let (mut rest, mut decoder) = (Vec::new(), BoardDecoder::new());
        loop {
            let mut asked = [0; 512];
            match port.read(&mut asked) {
                Ok(0) => return,
                Ok(count) => {
                    player.write_all(&asked[..count]).unwrap();
                    let mut asked = &asked[..count];
                    while let Some(event) = decoder.next(&mut asked) {
                        configured |=
                            matches!(event, Event::Frame(frame) if frame.body == message::Command::Configure(tilted()));
                    }
                }
                Err(error) if error.kind() == ErrorKind::WouldBlock => {}
                Err(_) => return,
            }
            let mut bytes = [0; 4096];
            let count = player.read(&mut bytes).unwrap_or(0);
            rest.extend_from_slice(&bytes[..count]);
            // Whole frames: what a board has under way when its power goes is another test's.
            let whole = rest.iter().rposition(|&byte| byte == 0).map_or(0, |last| last + 1);
            sent += rest[..whole].iter().filter(|&&byte| byte == 0).count();
            let out: Vec<u8> = rest.drain(..whole).collect();
            let mut out = out.as_slice();
            while !out.is_empty() {
                match port.write(out) {
                    Ok(written) => out = &out[written..],
                    Err(error) if error.kind() == ErrorKind::WouldBlock => thread::sleep(Duration::from_millis(1)),
                    Err(_) => return,
                }
            }
            if life == 0 && configured && sent > frames {
                break;
            }
            if controls.lock().ended {
                thread::sleep(Duration::from_millis(5));
            }
        }
    }
}

#[test]
fn a_board_that_restarts_in_the_middle_of_a_drive_gets_its_configuration_again() {
    let folder = tempfile::tempdir().unwrap();
    let (path, drive) = (folder.path().join("a.mcap"), folder.path().join("drive.mcap"));
    write_capture(&drive, 12.0);
    let (listener, device) = listener();
    let board = thread::spawn(move || drive_and_restart(&listener, &drive, 400));
    let since = Cell::new(u64::MAX);
    let (summary, notices) =
        record_until(&device, device.connect().unwrap(), &path, Some(tilted()), |summary, told| {
            let again = told.iter().any(|notice| matches!(notice, Notice::InForce { again: true, .. }));
            if again && since.get() == u64::MAX {
                since.set(summary.profiles);
            }
            again && summary.profiles > since.get() + 50
        });
    board.join().unwrap();
    let in_force: Vec<_> = notices
        .iter()
        .filter_map(|notice| match notice {
            Notice::InForce { config, again, .. } => Some((*config, *again)),
            _ => None,
        })
        .collect();
    assert_eq!(in_force, [(tilted(), false), (tilted(), true)], "{notices:?}");
    assert_eq!((summary.totals.restarts(), summary.unconfigured, summary.missing_frames), (1, false, 0), "{notices:?}");
    let told = notices.last().unwrap().to_string();
    assert!(told.contains("sent again and in force: mounting offset +0.8079 degrees, delay +1.465 ms"), "{told}");

    // The log says from where on each configuration holds, and every profile of either is reproduced.
    assert_eq!(configurations(&path), [Config::default(), tilted(), Config::default(), tilted()]);
    let report = verify::verify(&path, |_| ()).unwrap();
    assert_eq!((report.boots, report.problem_count), (2, 0), "{:?}", report.problems);
    assert_eq!(report.profiles_reproduced + report.profiles_unverifiable, report.profiles);
    assert!(report.profiles_reproduced > 100, "{report:?}");
}

#[test]
fn a_board_that_has_it_already_is_left_alone() {
    let folder = tempfile::tempdir().unwrap();
    let (listener, device) = listener();
    let board = thread::spawn(move || {
        let mut board = Script::accept(&listener);
        board.hello(tilted());
        assert_eq!(board.command(), None, "nothing is said");
    });
    let path = folder.path().join("a.mcap");
    let (summary, notices) =
        record_until(&device, device.connect().unwrap(), &path, Some(tilted()), |summary, _| summary.frames > 20);
    board.join().unwrap();
    assert!(!summary.lost() && !summary.unconfigured);
    let expected = Notice::InForce { config: tilted(), again: false, profiles: 0 };
    assert!(matches!(&notices[..], [Notice::Board { .. }, told] if *told == expected), "{notices:?}");
}

fn recorder(folder: &Path, device: &Device, more: &[&str]) -> Child {
    let device = device.to_string();
    crossfall(folder, &["record", "--device", &device, "-o", "a.mcap"]).args(more).spawn().unwrap()
}

#[test]
fn a_refusal_is_told_with_what_is_in_force_instead() {
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("my.toml"), to_toml(&tilted())).unwrap();
    let (listener, device) = listener();
    let recorder = recorder(folder.path(), &device, &["--config", "my.toml", "--seconds", "2"]);
    let mut board = Script::accept(&listener);
    board.hello(Config::default());
    let (to, config) = board.configure();
    assert_eq!(config, tilted());
    board.say(&Message::Reply(Reply { to, outcome: Outcome::BadConfig }));
    assert_eq!(board.command(), None, "a refusal is not argued with");
    let (_, error) = ended(&recorder.wait_with_output().unwrap(), 3);
    let told = "the configuration is not in force: the board refuses it as out of range or at odds with itself; \
                its last word was that it measures with the defaults (mounting offset 0 degrees, delay 0 ms)\n";
    assert!(error.contains(&format!("{device}: {told}")), "{error}");
    assert!(error.contains("the configuration is not in force at the end"), "{error}");
    assert!(!log::Reader::open(&folder.path().join("a.mcap")).unwrap().flatten().collect::<Vec<_>>().is_empty());
}

#[test]
fn a_board_that_never_answers_is_asked_three_times_and_recorded_all_the_same() {
    let folder = tempfile::tempdir().unwrap();
    let (listener, device) = listener();
    let board = thread::spawn(move || {
        let mut board = Script::accept(&listener);
        board.hello(Config::default());
        let mut numbers: Vec<_> = (0..3).map(|_| board.configure().0).collect();
        numbers.dedup();
        assert_eq!(numbers.len(), 3, "each has a number of its own");
        assert_eq!(board.command(), None);
    });
    let path = folder.path().join("a.mcap");
    let (summary, notices) =
        record_until(&device, device.connect().unwrap(), &path, Some(tilted()), |_, told| told.len() > 1);
    board.join().unwrap();
    let why = Unconfigured::NoAnswer { tries: 3 };
    let expected = Notice::Unconfigured { why, echoed: Some(Config::default()) };
    assert!(matches!(&notices[..], [Notice::Board { .. }, told] if *told == expected), "{notices:?}");
    assert!(summary.unconfigured && !summary.lost() && summary.frames > 100, "{summary:?}");
}

#[test]
fn without_a_configuration_one_that_is_lost_is_told() {
    let folder = tempfile::tempdir().unwrap();
    let (listener, device) = listener();
    let recorder = recorder(folder.path(), &device, &["--seconds", "2"]);
    let mut board = Script::accept(&listener);
    board.hello(tilted());
    board.boot();
    board.hello(Config::default());
    assert_eq!(board.command(), None, "nothing is known that could be sent");
    let (_, error) = ended(&recorder.wait_with_output().unwrap(), 3);
    let told = "the board now measures with the default configuration: \
                mounting offset was +0.8079 degrees, now +0.0000 degrees; delay was +1.465 ms, now +0.000 ms\n";
    assert!(error.contains(&format!("{device}: {told}")), "{error}");
}

/// Frames that come from nowhere, and nobody to talk to.
struct ReadOnly {
    frames: Vec<u8>,
}

impl Read for ReadOnly {
    fn read(&mut self, out: &mut [u8]) -> io::Result<usize> {
        if self.frames.is_empty() {
            thread::sleep(Duration::from_millis(5));
            return Err(ErrorKind::TimedOut.into());
        }
        let count = self.frames.len().min(out.len());
        out[..count].copy_from_slice(&self.frames[..count]);
        self.frames.drain(..count);
        Ok(count)
    }
}

impl Write for ReadOnly {
    fn write(&mut self, _: &[u8]) -> io::Result<usize> {
        Err(ErrorKind::PermissionDenied.into())
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

#[test]
fn a_device_that_takes_no_commands_is_recorded_with_a_warning() {
    let folder = tempfile::tempdir().unwrap();
    let mut sequencer = Sequencer::new();
    let mut frames = Vec::new();
    let hello = Hello { schema: schema::HASH, firmware: "crossfall 0", board: "scripted", boot: 1, restart: "" };
    let messages = [Message::Hello(hello), Message::Config(Config::default())];
    for message in messages.iter().chain(&[Message::Status(Status::default()); 30]) {
        let mut frame = [0; MAX_MESSAGE_FRAME];
        let length = sequencer.message(message, &mut frame).unwrap();
        frames.extend_from_slice(&frame[..length]);
    }
    let nowhere = "tcp:127.0.0.1:9".parse().unwrap();
    let path = folder.path().join("a.mcap");
    let (summary, notices) =
        record_until(&nowhere, Box::new(ReadOnly { frames }), &path, Some(tilted()), |_, told| told.len() > 2);
    let expected = Notice::Unconfigured { why: Unconfigured::Mute, echoed: Some(Config::default()) };
    assert!(
        matches!(&notices[..], [Notice::Board { .. }, Notice::Mute { .. }, told] if *told == expected),
        "{notices:?}"
    );
    assert_eq!((summary.frames, summary.disconnected, summary.unconfigured), (32, false, true), "{summary:?}");
}

#[test]
fn a_configuration_that_cannot_be_is_told_before_anything_is_opened() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    fs::write(at.join("bad.toml"), "[scanner]\nmounting_offset_deg = 200.0\n").unwrap();
    let (listener, device) = listener();
    listener.set_nonblocking(true).unwrap();
    for (file, words) in [("bad.toml", "expected a number from -90 to 90"), ("none.toml", "none.toml: ")] {
        let device = device.to_string();
        for command in [&["record", "-o", "a.mcap"][..], &["serve"], &["monitor"]] {
            let output = crossfall(at, command).args(["--device", &device, "--config", file]).output().unwrap();
            let (_, error) = ended(&output, 1);
            assert!(error.lines().count() == 1 && error.contains(words), "{error}");
        }
    }
    assert!(listener.accept().is_err(), "nobody has knocked");
    assert!(!at.join("a.mcap").exists());
}
