//! A drive through the emulated board, from power-on to a whole log: what `demo --device emulated` does.

use std::io::{self, ErrorKind};
use std::path::Path;
use std::time::Duration;

use crossfall_core::protocol::Config;
use crossfall_core::protocol::message::{Command, LineCounters, Message, Outcome, Session, Skip, Status};
use crossfall_core::protocol::schema;

use super::scanner::{Mode, Scanner};
use super::{Emulator, Options, Played, Step};
use crate::capture::{Channel, Chunk};
use crate::simulate::scene::Scene;
use crate::{interrupt, log, output};

/// How long the board may take to boot and say hello, and to answer a command.
const ANSWER: Duration = Duration::from_secs(30);

/// How long it may take to find its scanner and set it up: two seconds, on a host with nothing else to do.
const SET_UP: Duration = Duration::from_secs(120);

/// How long it may take to work off what is waiting at the end.
const LAST: Duration = Duration::from_secs(60);

/// Time after the drive in which what is under way arrives.
const REST_NS: u64 = 500_000_000;

/// Why a drive through the emulated board failed.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// QEMU does not start, or has gone.
    #[error("the emulated board: {0}")]
    Machine(io::Error),
    /// The board does not do as it should.
    #[error("the emulated board {0}")]
    Board(String),
    /// The log cannot be written.
    #[error(transparent)]
    Log(#[from] output::Error),
    /// The user asked to stop.
    #[error("interrupted")]
    Interrupted,
}

impl From<io::Error> for Error {
    fn from(error: io::Error) -> Self {
        if interrupt::requested() || error.kind() == ErrorKind::Interrupted {
            Self::Interrupted
        } else {
            Self::Machine(error)
        }
    }
}

/// What a drive has come to.
#[derive(Clone, Debug)]
pub struct Surveyed {
    /// How it was played.
    pub played: Played,
    /// The board's counters after the last scan.
    pub status: Status,
    /// Frames in the log.
    pub frames: u64,
    /// Their bytes.
    pub bytes: u64,
    /// Frames that the sequence numbers prove missing.
    pub missing_frames: u64,
    /// Bytes and frames of the link that were no good.
    pub rejected: u64,
    /// Stack of the board used at most, and how much there is, in bytes.
    pub stack: (u32, u32),
}

/// Boots an image, sets a scanner up, plays a drive into the board's lines by the board's own clock and logs everything that
/// the board streams. `progress` is told the microseconds of the drive that have been played.
///
/// # Errors
/// As in [`Error`].
pub fn survey(
    image: &Path,
    drive: impl IntoIterator<Item = Chunk>,
    config: &Config,
    log: &mut log::Writer,
    progress: impl FnMut(u64),
) -> Result<Surveyed, Error> {
    let mut board = Emulator::start(image, &Options::default())?;
    greet(&board)?;
    if *config != Config::default() {
        let number = board.command(&Command::Configure(*config))?;
        let reply = |message: &Message<'_>| match message {
            Message::Reply(reply) if reply.to == number => Some(reply.outcome),
            _ => None,
        };
        match board.link.wait_for(0, ANSWER, reply) {
            Some((_, Outcome::Done)) => {}
            answer => return Err(Error::Board(format!("does not take the configuration: {answer:?}"))),
        }
    }
    let mut scanner = Scanner::waiting_at(9_600);
    scanner.holds_start = true;
    if !board.converse(&mut scanner, SET_UP, |scanner| scanner.mode == Mode::Continuous)? {
        return Err(Error::Board(format!("did not set its scanner up in {} s", SET_UP.as_secs())));
    }
    let mut end_ns = 0;
    let mut drive = drive.into_iter();
    let steps = std::iter::from_fn(|| match drive.next() {
        Some(chunk) => {
            end_ns = chunk.device_time_ns + REST_NS;
            Some(Step::Bytes(chunk))
        }
        None if end_ns > 0 => Some(Step::Do(std::mem::take(&mut end_ns), Box::new(|_, _| Ok(())))),
        None => None,
    });
    let played = board.play(&mut scanner, steps, progress)?;
    let status = board.stop(LAST)?;
    let (mut frames, mut bytes) = (0, 0);
    for (receive_ns, frame) in board.link.stamped_frames() {
        log.frame(receive_ns, &frame)?;
        frames += 1;
        bytes += frame.len() as u64;
    }
    Ok(Surveyed {
        played,
        status,
        frames,
        bytes,
        missing_frames: board.link.losses().0,
        rejected: board.link.counters().rejected(),
        stack: board.stack()?,
    })
}

/// The board's hello: it lives, and speaks as this program does.
fn greet(board: &Emulator) -> Result<(), Error> {
    let hello = |message: &Message<'_>| if let Message::Hello(hello) = message { Some(hello.schema) } else { None };
    match board.link.wait_for(0, ANSWER, hello) {
        Some((_, schema::HASH)) => Ok(()),
        Some((_, schema)) => Err(Error::Board(format!(
            "speaks message schema {schema:016x}, this program {:016x}: build its image again",
            schema::HASH
        ))),
        None => Err(Error::Board(format!("said nothing for {} s: is the image one of crossfall?", ANSWER.as_secs()))),
    }
}

impl Emulator {
    /// Waits until the board has taken every byte that was sent to it; whether it has. QEMU reads its connections when it comes to it, which on a busy
    /// host is behind the board's own clock.
    pub fn arrived(&self, limit: Duration) -> bool {
        let (lidar, ins) = (self.lidar.sent(), self.ins.sent());
        let all = |message: &Message<'_>| match message {
            Message::Status(status) => {
                let taken = |line: &LineCounters| line.bytes + u64::from(line.overruns);
                (taken(&status.lidar) >= lidar && taken(&status.ins) >= ins).then_some(())
            }
            _ => None,
        };
        self.link.wait_for(0, limit, all).is_some()
    }

    /// Stops the survey and waits until every scan has its profile or was announced as skipped; the status after that, which counts
    /// everything.
    ///
    /// # Errors
    /// When QEMU has gone, or when one of the three things does not happen within `limit`.
    pub fn stop(&mut self, limit: Duration) -> io::Result<Status> {
        self.arrived(limit);
        let late = |what: &str| io::Error::new(ErrorKind::TimedOut, format!("no {what} within {} s", limit.as_secs()));
        let from = self.link.len();
        self.command(&Command::Stop)?;
        let stopped = |message: &Message<'_>| matches!(message, Message::Session(Session::Stopped(_))).then_some(());
        let (stopped, ()) = self.link.wait_for(from, limit, stopped).ok_or_else(|| late("end of the survey"))?;
        let scans = self.link.collect(|message| matches!(message, Message::Scan(_)).then_some(())).len();
        let mut profiles = 0;
        let last = |message: &Message<'_>| {
            profiles += usize::from(matches!(message, Message::Profile(_) | Message::Skip(Skip::Scan(_))));
            (profiles >= scans).then_some(())
        };
        let (at, ()) = self.link.wait_for(0, limit, last).ok_or_else(|| late("profile of the last scan"))?;
        let status = |message: &Message<'_>| if let Message::Status(status) = message { Some(*status) } else { None };
        self.link.wait_for(at.max(stopped), limit, status).map(|(_, status)| status).ok_or_else(|| late("status"))
    }
}

/// Makes a scene's drive one for the emulated lines, of which [`half_the_scans`] are played: without the indices, which would say that every second
/// scan is missing, and with 50 poses a second at most.
pub fn at_line_rates(scene: &mut Scene) {
    (scene.scanner.index_bytes, scene.ins.rate_hz) = (false, scene.ins.rate_hz.min(50));
}

/// Every second chunk of the scanner: half its rate, where every telegram is a chunk of its own, as [`simulate`](crate::simulate) writes them.
/// One line of the emulated board carries 30 kB/s; a scanner at its full rate sends 27.5.
pub fn half_the_scans(drive: impl IntoIterator<Item = Chunk>) -> impl Iterator<Item = Chunk> {
    let mut odd = true;
    drive.into_iter().filter(move |chunk| {
        let scan = chunk.channel == Channel::Lidar;
        odd ^= scan;
        !scan || !odd
    })
}
