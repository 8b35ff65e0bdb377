//! A film as a port: what it shows comes out of reads at its own pace, commands go in through writes. To the recording it is a board.

use std::io::{self, ErrorKind, Read, Write};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread;
use std::time::{Duration, Instant};

use crossfall_core::protocol::frame::{BoardDecoder, Event, MAX_MESSAGE_FRAME, Sequencer};
use crossfall_core::protocol::message::{Message, Outcome, Reply};
use crossfall_core::protocol::ranges::MAX_CODE;
use serde::Serialize;

use super::film::{Film, Shown};

/// How long a read waits for something to show.
const READ: Duration = Duration::from_millis(100);

/// How often it looks.
const LOOK: Duration = Duration::from_millis(4);

/// The fastest that is played.
pub const MAX_SPEED: f64 = 50.0;

/// The most of a film that is played in one go, so that a command or a new speed never waits long: in nanoseconds of the film.
const STRIDE_NS: u64 = 250_000_000;

/// Where the film is and how it goes on.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct Transport {
    /// Seconds since its start.
    pub position_s: f64,
    /// Its length in seconds.
    pub length_s: f64,
    /// Times real time.
    pub speed: f64,
    /// Whether it stands still.
    pub paused: bool,
    /// Whether it has come to its end.
    pub ended: bool,
    /// Where to wind to, once.
    #[serde(skip)]
    pub wind_to_s: Option<f64>,
}

/// The transport as viewers and player share it.
#[derive(Clone, Debug)]
pub struct Controls(Arc<Mutex<Transport>>);

impl Controls {
    /// The transport, to look at or to change.
    pub fn lock(&self) -> MutexGuard<'_, Transport> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// See the module.
pub struct Player {
    film: Film,
    controls: Controls,
    sequencer: Sequencer,
    commands: BoardDecoder,
    /// Frames that have not been read yet.
    ready: Vec<u8>,
    read: usize,
    /// Instant of the film that has been reached.
    at_ns: u64,
    looked: Instant,
    begun: bool,
}

impl Player {
    /// One at the film's start.
    #[must_use]
    pub fn new(film: Film, speed: f64) -> (Self, Controls) {
        let (first, last) = film.span_ns();
        let controls = Controls(Arc::new(Mutex::new(Transport {
            position_s: 0.0,
            length_s: last.saturating_sub(first) as f64 * 1e-9,
            speed: speed.clamp(0.1, MAX_SPEED),
            paused: false,
            ended: false,
            wind_to_s: None,
        })));
        let player = Self {
            film,
            controls: controls.clone(),
            sequencer: Sequencer::new(),
            commands: BoardDecoder::new(),
            ready: Vec::new(),
            read: 0,
            at_ns: first,
            looked: Instant::now(),
            begun: false,
        };
        (player, controls)
    }

    /// Plays what is due.
    fn advance(&mut self) -> io::Result<()> {
        let elapsed = self.looked.elapsed();
        self.looked = Instant::now();
        if !self.begun {
            self.begun = true;
            return Ok(());
        }
        let (first, last) = self.film.span_ns();
        let transport = *self.controls.lock();
        let Self { film, sequencer, ready, .. } = self;
        if let Some(seconds) = transport.wind_to_s {
            let to_ns = first.saturating_add((seconds.clamp(0.0, transport.length_s) * 1e9) as u64);
            film.wind(to_ns, &mut |shown| send(&shown, sequencer, ready)).map_err(io::Error::other)?;
            self.at_ns = to_ns;
            self.looked = Instant::now();
            let mut controls = self.controls.lock();
            (controls.wind_to_s, controls.ended) = (None, false);
            controls.position_s = to_ns.saturating_sub(first) as f64 * 1e-9;
            return Ok(());
        }
        if transport.paused || transport.ended {
            return Ok(());
        }
        let step_ns = (elapsed.as_secs_f64() * transport.speed * 1e9) as u64;
        self.at_ns = self.at_ns.saturating_add(step_ns.min(STRIDE_NS)).min(last.saturating_add(1));
        let goes_on = film.play(self.at_ns, &mut |shown| send(&shown, sequencer, ready));
        let mut controls = self.controls.lock();
        controls.position_s = self.at_ns.saturating_sub(first).min(last.saturating_sub(first)) as f64 * 1e-9;
        controls.ended = !goes_on;
        Ok(())
    }
}

/// Frames what is shown.
fn send(shown: &Shown<'_>, sequencer: &mut Sequencer, ready: &mut Vec<u8>) {
    let Shown::Event(event) = shown else {
        *sequencer = Sequencer::new();
        return;
    };
    let (mut code, mut frame) = ([0; MAX_CODE], [0; MAX_MESSAGE_FRAME]);
    // Room for the longest frame: encoding fails for nothing that a board or the core makes.
    if let Ok(length) = sequencer.message(&event.message(&mut code), &mut frame) {
        ready.extend_from_slice(frame.get(..length).unwrap_or_default());
    }
}

impl Read for Player {
    fn read(&mut self, out: &mut [u8]) -> io::Result<usize> {
        let began = Instant::now();
        while self.read == self.ready.len() {
            self.ready.clear();
            self.read = 0;
            self.advance()?;
            if self.ready.is_empty() {
                if began.elapsed() > READ {
                    return Err(ErrorKind::TimedOut.into());
                }
                thread::sleep(LOOK);
            }
        }
        let rest = self.ready.get(self.read..).unwrap_or_default();
        let count = rest.len().min(out.len());
        out[..count].copy_from_slice(&rest[..count]);
        self.read += count;
        Ok(count)
    }
}

impl Write for Player {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let Self { film, commands, sequencer, ready, .. } = self;
        let mut rest = bytes;
        while let Some(event) = commands.next(&mut rest) {
            match event {
                Event::Frame(frame) => {
                    film.command(frame.sequence, &frame.body, &mut |shown| send(&shown, sequencer, ready));
                }
                Event::Rejected(rejected) => {
                    if let Some(to) = rejected.sequence {
                        let reply = Message::Reply(Reply { to, outcome: Outcome::Unknown });
                        let event = crossfall_core::instrument::Event::Message(reply);
                        send(&Shown::Event(event), sequencer, ready);
                    }
                }
            }
        }
        Ok(bytes.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}
