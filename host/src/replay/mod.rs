//! Replay: a capture into the pins of a board, each byte at its time.
//!
//! Bytes leave in pieces of at most [`PIECE_NS`] of line time, each when its first byte is due: a burst begins on time, and no byte is
//! earlier than a piece. Where a capture stamps a chunk only, the bytes after its first follow at the line's baud rate, as in `run`.
//! Time is the host's monotonic clock; what its scheduling makes late, and what a board that does not read makes late, is
//! measured and told ([`Played::worst_late`]), never caught up by sending faster than asked.
//!
//! A board looks for its scanner and sets it up before it believes it. So the replay holds the scanner's side of that
//! dialogue ([`Scanner`]), before the drive and during it. A line that asks for nothing for [`QUIET`] is no such board: it gets
//! the bytes and no answers. What boards say to their inertial unit is read and passed over.
//!
//! Memory: the chunks that overlap in time, at most [`MAX_WAITING`] bytes and one chunk.

mod line;
mod schedule;

use std::io;
use std::time::{Duration, Instant};

use crossfall_core::protocol::Config;

use crate::capture::{Channel, Chunk};
use crate::emulated::scanner::{Mode, Scanner};
use crate::record::Device;
use crate::{container, interrupt};

pub use line::Line;
use schedule::{Due, Schedule};

/// Line time of the bytes that are sent together.
pub const PIECE_NS: u64 = 500_000;

/// Bytes that may wait for their turn: chunks that claim to overlap by more are late.
pub const MAX_WAITING: usize = 1 << 20;

/// A board that looks for its scanner asks at least once a second; a line that is silent for so long has nobody on it who asks.
pub const QUIET: Duration = Duration::from_millis(2_500);

/// How long a board may take to set its scanner up: looking for it at every rate, storing a configuration.
pub const SET_UP: Duration = Duration::from_secs(30);

/// How long a board may leave bytes unread.
pub const STALLED: Duration = Duration::from_secs(10);

/// A board waits for its scanner's start for 3 s: so long after, a capture whose scans begin late says that it has started.
const START_HELD: Duration = Duration::from_secs(2);

/// How often what the board says is read while nothing is due.
const LISTEN: Duration = Duration::from_millis(2);

/// Stands for a pulse on its line (the emulated board's UART5).
const PULSE: &[u8] = b"p";

/// Why a replay failed.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// A line cannot be opened.
    #[error("{device}: cannot connect")]
    Connect {
        /// Where.
        device: String,
        /// Why.
        source: io::Error,
    },
    /// A line broke.
    #[error("{device}: the connection is lost after {seconds:.1} s of the drive")]
    Lost {
        /// Where.
        device: String,
        /// How far the drive had come, in seconds of device time.
        seconds: f64,
        /// Why.
        source: io::Error,
    },
    /// A board asks its scanner for something and is not satisfied with the answers.
    #[error("{device}: the board asks for its scanner but does not start it within {} s; it got as far as {reached}", SET_UP.as_secs())]
    NotStarted {
        /// Where.
        device: String,
        /// What it had asked for.
        reached: String,
    },
    /// The capture cannot be read at all.
    #[error(transparent)]
    Capture(#[from] container::Error),
    /// The user asked to stop.
    #[error("interrupted after {seconds:.1} s of the drive")]
    Interrupted {
        /// How far the drive had come, in seconds of device time.
        seconds: f64,
    },
}

/// Where the lines are.
#[derive(Clone, Debug)]
pub struct Lines {
    /// The scanner's line.
    pub lidar: Device,
    /// The inertial unit's line.
    pub ins: Device,
    /// The pulse, if it is to be played: a byte stands for an edge.
    pub pps: Option<Device>,
}

/// How to play.
#[derive(Clone, Debug)]
pub struct Options {
    /// Seconds of the drive in a second; above 0.
    pub speed: f64,
    /// Answer the board as a scanner does. Otherwise the bytes are played at once.
    pub answer: bool,
    /// The lines' rates.
    pub config: Config,
}

impl Default for Options {
    fn default() -> Self {
        Self { speed: 1.0, answer: true, config: Config::default() }
    }
}

/// What has been played.
#[derive(Clone, Debug, Default, serde::Serialize)]
pub struct Played {
    /// Device time from the first byte to the last, in seconds.
    pub seconds: f64,
    /// Bytes of the scanner.
    pub lidar_bytes: u64,
    /// Bytes of the inertial unit.
    pub ins_bytes: u64,
    /// Pulses.
    pub pulses: u64,
    /// Bytes of the scanner that were not sent because the board had stopped it.
    pub lidar_bytes_unsent: u64,
    /// Chunks of lines that are not played: the second inertial unit's, and the pulse without a line.
    pub chunks_unplayed: u64,
    /// Whether a board set the scanner up.
    pub answered: bool,
    /// How late the latest piece was sent, in microseconds of the host's clock.
    pub worst_late_us: u64,
    /// The mean of that over all pieces.
    pub mean_late_us: f64,
    /// Damage of the capture, in words.
    pub damage: Vec<String>,
}

/// Open lines, and how far the replay has come.
pub struct Replay {
    lidar: Line,
    ins: Line,
    pps: Option<Line>,
    /// The scanner whose bytes are played; none on a line where nobody asks.
    scanner: Option<Scanner>,
    options: Options,
    played: Played,
    pieces: u64,
    late_us: u64,
}

impl Replay {
    /// Opens the lines.
    ///
    /// # Errors
    /// When one of them does not open.
    pub fn open(lines: &Lines, options: Options) -> Result<Self, Error> {
        Ok(Self {
            lidar: Line::open(&lines.lidar)?,
            ins: Line::open(&lines.ins)?,
            pps: lines.pps.as_ref().map(Line::open).transpose()?,
            scanner: None,
            options,
            played: Played::default(),
            pieces: 0,
            late_us: 0,
        })
    }

    /// Answers the board until it has started the scanner; false when nobody asks. Without the dialogue ([`Options::answer`]), does nothing.
    ///
    /// # Errors
    /// When a line breaks, when the board asks and yet does not start the scanner in [`SET_UP`], or when the user asks to stop.
    pub fn set_up(&mut self) -> Result<bool, Error> {
        if !self.options.answer {
            return Ok(false);
        }
        let begun = Instant::now();
        let mut scanner = Scanner::waiting_at(self.options.config.scanner.baud);
        scanner.holds_start = true;
        self.scanner = Some(scanner);
        let mut heard = false;
        while self.scanner.as_ref().is_some_and(|scanner| !scanner.is_sending()) {
            heard |= self.listen(0.0)?;
            if !heard && begun.elapsed() > QUIET {
                self.scanner = None;
            }
            if begun.elapsed() > SET_UP {
                let asked = self.scanner.as_ref().and_then(|scanner| scanner.understood.last());
                let reached = asked.map_or("nothing that was understood".to_owned(), |last| format!("{last:02x?}"));
                return Err(Error::NotStarted { device: self.lidar.name().to_owned(), reached });
            }
            if interrupt::requested() {
                return Err(Error::Interrupted { seconds: 0.0 });
            }
            std::thread::sleep(LISTEN);
        }
        self.played.answered = self.scanner.is_some();
        Ok(self.played.answered)
    }

    /// Plays chunks, which are in the order of their times. `progress` is told the device time reached, in nanoseconds since the first chunk.
    ///
    /// # Errors
    /// When a line breaks or the user asks to stop. Damage of the capture is listed in the answer.
    pub fn play(
        mut self,
        chunks: impl IntoIterator<Item = Result<Chunk, container::Error>>,
        mut progress: impl FnMut(u64),
    ) -> Result<Played, Error> {
        let mut schedule = Schedule::new(chunks.into_iter(), &self.options.config);
        let mut origin: Option<(u64, Instant)> = None;
        let mut reached_ns = 0;
        let mut piece = Vec::new();
        while let Some((due, at_ns)) = schedule.next(&mut piece) {
            let (first_ns, start) = *origin.get_or_insert_with(|| (at_ns, Instant::now()));
            reached_ns = at_ns.saturating_sub(first_ns);
            let seconds = reached_ns as f64 * 1e-9;
            let at = start + Duration::from_secs_f64(seconds / self.options.speed);
            self.wait_until(at, seconds)?;
            if due == Due::Lidar || start.elapsed() > START_HELD {
                self.begin(seconds)?;
            }
            self.count_late(at);
            self.send(due, &piece, seconds)?;
            progress(reached_ns);
        }
        self.played.damage = schedule.damage();
        if interrupt::requested() {
            return Err(Error::Interrupted { seconds: reached_ns as f64 * 1e-9 });
        }
        self.played.seconds = reached_ns as f64 * 1e-9;
        self.played.mean_late_us = self.late_us as f64 / self.pieces.max(1) as f64;
        for line in [Some(self.lidar), Some(self.ins), self.pps].into_iter().flatten() {
            line.close();
        }
        Ok(self.played)
    }

    /// Tells the board that its scanner has started, unless it knows.
    fn begin(&mut self, seconds: f64) -> Result<(), Error> {
        match self.scanner.as_mut().and_then(Scanner::begin) {
            Some(answer) => self.lidar.send(&answer.bytes, seconds),
            None => Ok(()),
        }
    }

    fn wait_until(&mut self, at: Instant, seconds: f64) -> Result<(), Error> {
        loop {
            if interrupt::requested() {
                return Err(Error::Interrupted { seconds });
            }
            self.listen(seconds)?;
            match at.checked_duration_since(Instant::now()) {
                None | Some(Duration::ZERO) => return Ok(()),
                Some(left) => std::thread::sleep(left.min(LISTEN)),
            }
        }
    }

    fn count_late(&mut self, due: Instant) {
        let late_us = Instant::now().saturating_duration_since(due).as_micros() as u64;
        self.pieces += 1;
        self.late_us += late_us;
        self.played.worst_late_us = self.played.worst_late_us.max(late_us);
    }

    fn send(&mut self, due: Due, piece: &[u8], seconds: f64) -> Result<(), Error> {
        match due {
            // A scanner that the board has told to stop measures on and says nothing.
            Due::Lidar if self.scanner.as_ref().is_some_and(|scanner| scanner.mode != Mode::Continuous) => {
                self.played.lidar_bytes_unsent += piece.len() as u64;
            }
            Due::Lidar => {
                self.lidar.send(piece, seconds)?;
                self.played.lidar_bytes += piece.len() as u64;
            }
            Due::Ins => {
                self.ins.send(piece, seconds)?;
                self.played.ins_bytes += piece.len() as u64;
            }
            Due::Pulse => match &mut self.pps {
                Some(line) => {
                    line.send(PULSE, seconds)?;
                    self.played.pulses += 1;
                }
                None => self.played.chunks_unplayed += 1,
            },
            Due::Unplayed => self.played.chunks_unplayed += 1,
        }
        Ok(())
    }

    /// Reads what the board says and lets the scanner answer; whether anything was said to the scanner.
    fn listen(&mut self, seconds: f64) -> Result<bool, Error> {
        let mut said = [0; 256];
        while self.ins.hear(&mut said, seconds)? > 0 {}
        if let Some(line) = &mut self.pps {
            while line.hear(&mut said, seconds)? > 0 {}
        }
        let count = self.lidar.hear(&mut said, seconds)?;
        if let Some(scanner) = &mut self.scanner {
            // Bytes of a connection have no rate of their own: the scanner takes them at its own.
            let baud = scanner.baud;
            for answer in scanner.hear(&said[..count], baud) {
                self.lidar.send(&answer.bytes, seconds)?;
            }
        }
        Ok(count > 0)
    }
}

/// The line of a channel, if it is played.
fn due(channel: Channel) -> Due {
    match channel {
        Channel::Lidar => Due::Lidar,
        Channel::Ins => Due::Ins,
        Channel::Pps => Due::Pulse,
        Channel::Ins2 => Due::Unplayed,
    }
}
