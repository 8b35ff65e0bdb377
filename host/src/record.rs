//! Recording: every frame that a board sends, into a log, for as long as the drive lasts.
//!
//! Two threads. One does nothing but drain the port into a [`Buffer`](buffer) of at most [`buffer::CAPACITY`] bytes, so that a slow disk never
//! makes the operating system drop what arrives; where even that overflows, the bytes lost are counted and told. The other splits the
//! stream into frames and logs them as received, the broken ones too; a run of bytes longer than any frame is logged in pieces of the longest
//! frame. Left out are only delimiters with nothing before them, and the frame under way when the recording ends.
//!
//! What is said to the board goes through an [`Outbox`](outbox) to the first of them; what configuration it is to have, a [`Keeper`](keeper)
//! in the second sees to. A device that takes no commands is recorded as it comes.
//!
//! A lost connection is tried again for ever, and the recording goes on in the same log. What the board sent meanwhile shows as a gap in the
//! sequence numbers. The receive time is that of the read that brought a frame's last byte: the system's clock at the start plus monotonic
//! time since, so a clock that is set during the drive does not move it (a host that sleeps is not counted).

mod amiss;
mod buffer;
mod device;
mod keeper;
mod link;
mod lost;
mod notice;
mod outbox;
mod reader;
pub mod space;
mod tape;

use std::sync::Arc;
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

use crossfall_core::protocol::Config;

use crate::counters::Totals;
use crate::log::GrowsOn;
use crate::output;
pub(crate) use amiss::Amiss;
pub use buffer::CAPACITY;
use buffer::{Buffer, Event, Taken};
pub(crate) use device::connect;
pub use device::{BAUD, Device, Port};
use keeper::Keeper;
use link::Link;
pub use lost::Lost;
pub(crate) use notice::gist;
pub use notice::{Notice, Unconfigured};
pub(crate) use outbox::ANSWER;
pub use outbox::Outbox;
pub use tape::Tape;

/// How long the recording waits for an event before it looks at everything else.
const POLL: Duration = Duration::from_millis(50);

/// How long the end waits for a reader that is in the middle of a read.
const LAST_READ: Duration = Duration::from_millis(500);

/// A board says something once a second; after so much silence the user is told, and the board is asked who it is.
const SILENCE: Duration = Duration::from_secs(5);

/// Why a recording failed.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// The log cannot be written.
    #[error(transparent)]
    Log(#[from] output::Error),
    /// The thread that reads cannot be started.
    #[error("cannot start a thread: {0}")]
    Reader(std::io::Error),
}

/// What a recording has come to.
#[derive(Clone, Debug, Default)]
pub struct Summary {
    /// Seconds since it began.
    pub seconds: f64,
    /// Frames logged, good or bad.
    pub frames: u64,
    /// Bytes of these frames.
    pub bytes: u64,
    /// Profiles among them.
    pub profiles: u64,
    /// Frames that do not decode, and pieces of runs of bytes longer than any frame.
    pub bad_frames: u64,
    /// Frames that the sequence numbers prove missing.
    pub missing_frames: u64,
    /// Gaps of which it is not known how many frames they cost: they took longer than the numbers count.
    pub unknown_gaps: u64,
    /// Bytes that found no room in the buffer.
    pub bytes_lost: u64,
    /// Times that a lost connection came back.
    pub reconnects: u64,
    /// Whether there is no connection: what the board sends meanwhile is lost, and nobody knows how much it is.
    pub disconnected: bool,
    /// The board's counters, over all its boots within the recording.
    pub totals: Totals,
    /// Whether a configuration was to be in force and is not, or is not known to be.
    pub unconfigured: bool,
    /// Bytes on the disk, in all files of the log.
    pub log_bytes: u64,
    /// Files of the log.
    pub parts: u32,
}

impl Summary {
    /// Whether anything that the board sent is not in the log as it sent it, or may not be: nobody knows what was under way when a
    /// board booted again, or what is sent while nothing is connected. What the board itself has lost meanwhile counts as well.
    #[must_use]
    pub fn lost(&self) -> bool {
        let known = self.bad_frames > 0 || self.missing_frames > 0 || self.bytes_lost > 0 || self.frames == 0;
        let told = self.totals.restarts() > 0 || self.disconnected || !self.totals.losses_since().is_empty();
        known || self.unknown_gaps > 0 || told
    }
}

/// Records what comes from `port`, and from `device` again when that is lost, until `goes_on` says no; it is asked at least
/// twenty times a second as long as the disk keeps up.
///
/// # Errors
/// When the log cannot be written or the thread that reads cannot be started.
pub fn record(
    device: &Device,
    port: Box<dyn Port>,
    log: &mut impl Tape,
    notice: impl FnMut(Notice),
    goes_on: impl FnMut(&Summary) -> bool,
) -> Result<Summary, Error> {
    converse(device, port, log, &Outbox::default(), None, notice, goes_on)
}

/// [`record`] that also says to the board what is put into `outbox`, and keeps `config` in force, or what another configuration
/// from `outbox` has put in force since: a board that restarts forgets it, and is told again before anything else.
///
/// # Errors
/// As of [`record`].
pub fn converse(
    device: &Device,
    port: Box<dyn Port>,
    log: &mut impl Tape,
    outbox: &Outbox,
    config: Option<Config>,
    mut notice: impl FnMut(Notice),
    mut goes_on: impl FnMut(&Summary) -> bool,
) -> Result<Summary, Error> {
    let clock = Clock::start();
    let buffer = Arc::new(Buffer::new());
    reader::spawn(device.clone(), port, outbox.clone(), clock, Arc::clone(&buffer)).map_err(Error::Reader)?;
    // However this function is left, the reader ends with it.
    let _stop = StopOnDrop(&buffer);
    let mut link = Link::new(Keeper::new(outbox.clone(), config, Instant::now()));
    let mut summary = Summary::default();
    let mut heard = Instant::now();
    let mut told_silent = false;
    let mut overgrown = None;
    let mut stopped: Option<Instant> = None;
    loop {
        match buffer.take(POLL) {
            Taken::Event(Event::Bytes { receive_ns, bytes }) => {
                (heard, told_silent) = (Instant::now(), false);
                link.take(receive_ns, &bytes, log, &mut summary, &mut notice)?;
                // By the time of the bytes: what a slow disk has kept waiting is old, and must not be synced read by read.
                log.settle(receive_ns)?;
            }
            Taken::Event(Event::Overflow { bytes }) => {
                link.cut(log, &mut summary)?;
                summary.bytes_lost += bytes;
                notice(Notice::Overflow { bytes });
            }
            Taken::Event(Event::Gone { why }) => {
                link.cut(log, &mut summary)?;
                link.keeper.disconnected();
                summary.disconnected = true;
                notice(Notice::Gone { why });
            }
            Taken::Event(Event::Back) => {
                link.keeper.connected(Instant::now());
                summary.disconnected = false;
                summary.reconnects += 1;
                notice(Notice::Back);
            }
            Taken::Event(Event::Mute { why }) => {
                notice(Notice::Mute { why });
                link.keeper.mute(&mut notice);
            }
            Taken::Nothing if stopped.is_some_and(|stopped| stopped.elapsed() > LAST_READ) => break,
            Taken::Nothing => log.settle(clock.now_ns())?,
            Taken::End => break,
        }
        if heard.elapsed() > SILENCE && !told_silent && !summary.disconnected {
            told_silent = true;
            notice(Notice::Silent);
        }
        link.keeper.due(Instant::now(), &mut notice);
        summary.unconfigured = link.keeper.astray();
        summary.seconds = clock.started.elapsed().as_secs_f64();
        let parts = summary.parts;
        (summary.log_bytes, summary.parts) = log.extent();
        // The live page begins another recording while the connection lasts.
        let before = std::mem::replace(&mut overgrown, log.grows_on());
        match (&before, &overgrown) {
            (None | Some(GrowsOn::NoNext { .. }), Some(GrowsOn::Numbers)) => notice(Notice::LastFile),
            (None, Some(GrowsOn::NoNext { why })) => notice(Notice::NoNextFile { why: why.clone() }),
            (Some(_), None) if summary.parts > parts => notice(Notice::NextFile),
            _ => {}
        }
        if stopped.is_none() && !goes_on(&summary) {
            stopped = Some(Instant::now());
            buffer.stop();
        }
    }
    Ok(summary)
}

struct StopOnDrop<'a>(&'a Buffer);

impl Drop for StopOnDrop<'_> {
    fn drop(&mut self) {
        self.0.stop();
    }
}

/// Receive time.
#[derive(Clone, Copy)]
struct Clock {
    epoch_ns: u64,
    started: Instant,
}

impl Clock {
    fn start() -> Self {
        // A clock before 1970 counts from there; nanoseconds since fit 64 bits until 2554.
        let since = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
        Self { epoch_ns: nanoseconds(since), started: Instant::now() }
    }

    /// Nanoseconds since the Unix epoch; never less than before.
    fn now_ns(&self) -> u64 {
        self.epoch_ns.saturating_add(nanoseconds(self.started.elapsed()))
    }
}

fn nanoseconds(duration: Duration) -> u64 {
    u64::try_from(duration.as_nanos()).unwrap_or(u64::MAX)
}
