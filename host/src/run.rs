//! A capture through the firmware's core, in process: what a board on these pins would have streamed, as a log.
//!
//! Bytes enter the core in the order in which they arrived on the wires, not in the order of the capture's chunks: a line delivers one byte
//! after the other at its baud rate, whatever the chunks. So the log is the same however the capture is cut, and its receive
//! times are device times: one capture and one configuration make one log, byte for byte, on every machine.

use std::collections::VecDeque;

use crossfall_core::instrument::{Event, FIRMWARE, Identity, Instrument};
use crossfall_core::protocol::frame::{MAX_MESSAGE_FRAME, Sequencer};
use crossfall_core::protocol::message::{Hello, Message, Status};
use crossfall_core::protocol::ranges::MAX_CODE;
use crossfall_core::protocol::{Config, DeviceTime, schema};
use crossfall_core::sensors::{Scanner, cola};

use crate::capture::{self, Channel, Chunk};
use crate::log::metadata;
use crate::scanner::{self, Family};
use crate::sensor_line::Wire;
use crate::{container, log, output};

/// Bytes that may wait for their turn: capture chunks that claim to overlap by more are taken as they come.
const MAX_WAITING: usize = 1 << 20;

/// Why a run failed.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// The capture cannot be read.
    #[error(transparent)]
    Capture(#[from] container::Error),
    /// The log cannot be written.
    #[error(transparent)]
    Log(#[from] output::Error),
}

/// What a run did.
#[derive(Debug, Default)]
pub struct Summary {
    /// Frames logged.
    pub frames: u64,
    /// Bytes of these frames.
    pub bytes: u64,
    /// Profiles among them.
    pub profiles: u64,
    /// The last status: every counter.
    pub status: Status,
    /// Device time from the first chunk to the last byte, in seconds.
    pub seconds: f64,
    /// Damage of the capture, in words: at most one for each of its MCAP records.
    pub damage: Vec<String>,
    /// Whether it was asked to stop early.
    pub interrupted: bool,
    /// The scanners whose language was heard.
    pub family: Family,
}

/// Who the core says it is when it runs in process.
#[must_use]
pub fn identity() -> Identity {
    Identity { firmware: FIRMWARE, board: "in process", ..Identity::default() }
}

/// Runs the whole capture. `progress` is told the device time reached, in nanoseconds.
///
/// # Errors
/// When the capture cannot be read at all or the log cannot be written. Damage within the capture is listed in the summary.
pub fn run(
    capture: &mut capture::Reader,
    config: &Config,
    log: &mut log::Writer,
    progress: impl FnMut(u64),
) -> Result<Summary, Error> {
    let first_ns = capture.span_ns().map_or(0, |(first, _)| first);
    run_over(capture.by_ref(), first_ns, config, log, progress)
}

/// [`run`] over chunks from anywhere, in the order of time. The instrument boots at `first_ns`.
///
/// # Errors
/// When the log cannot be written. Chunks that are errors are listed in the summary.
pub fn run_over(
    chunks: impl Iterator<Item = Result<Chunk, container::Error>>,
    first_ns: u64,
    config: &Config,
    log: &mut log::Writer,
    progress: impl FnMut(u64),
) -> Result<Summary, Error> {
    let (family, chunks) = scanner::of_chunks(chunks);
    let wires = Wires::new(config, family);
    let mut summary = match family {
        Family::Lms2xx => {
            run_through(Instrument::new(*config, identity()), wires, chunks, first_ns, config, log, progress)?
        }
        Family::Cola => {
            let instrument = Instrument::with_scanner(cola::Decoder::default(), *config, identity());
            run_through(instrument, wires, chunks, first_ns, config, log, progress)?
        }
    };
    summary.family = family;
    Ok(summary)
}

fn run_through<S: Scanner>(
    mut instrument: Instrument<S>,
    mut wires: Wires,
    chunks: impl Iterator<Item = Result<Chunk, container::Error>>,
    first_ns: u64,
    config: &Config,
    log: &mut log::Writer,
    mut progress: impl FnMut(u64),
) -> Result<Summary, Error> {
    let mut link = Link { log, sequencer: Sequencer::new(), summary: Summary::default(), now_ns: 0, failed: None };
    link.describe(config)?;
    link.now_ns = first_ns;
    let mut now_ns = first_ns;
    instrument.start(DeviceTime(first_ns / 1_000), &mut |event| link.send(&event));

    for chunk in chunks {
        match chunk {
            Ok(chunk) => {
                let until = Some(chunk.device_time_ns);
                wires.deliver(until, &mut instrument, &mut now_ns, &mut |now, event| link.send_at(now, &event));
                progress(chunk.device_time_ns);
                wires.push(chunk);
            }
            Err(error) => link.summary.damage.push(error.to_string()),
        }
        if let Some(error) = link.failed.take() {
            return Err(error.into());
        }
        if crate::interrupt::requested() {
            link.summary.interrupted = true;
            break;
        }
    }
    wires.deliver(None, &mut instrument, &mut now_ns, &mut |now, event| link.send_at(now, &event));
    link.now_ns = now_ns;
    let end = DeviceTime(now_ns / 1_000);
    instrument.finish(end, &mut |event| link.send(&event));
    if let Some(error) = link.failed.take() {
        return Err(error.into());
    }
    let mut summary = link.summary;
    summary.seconds = link.now_ns.saturating_sub(first_ns) as f64 * 1e-9;
    Ok(summary)
}

/// The end of the link: frames go to the log under the device time at which they were made.
struct Link<'a> {
    log: &'a mut log::Writer,
    sequencer: Sequencer,
    summary: Summary,
    now_ns: u64,
    failed: Option<output::Error>,
}

impl Link<'_> {
    /// Metadata for readers that know no frames: who made the log and with which configuration.
    fn describe(&mut self, config: &Config) -> Result<(), output::Error> {
        let Identity { firmware, board, .. } = identity();
        let hello = Hello { schema: schema::HASH, firmware, board, boot: 0, restart: "" };
        for (name, entries) in [Message::Hello(hello), Message::Config(*config)].iter().filter_map(metadata::of) {
            self.log.metadata(name, entries)?;
        }
        Ok(())
    }

    fn send_at(&mut self, now_ns: u64, event: &Event<'_>) {
        self.now_ns = now_ns;
        self.send(event);
    }

    fn send(&mut self, event: &Event<'_>) {
        let (mut code, mut frame) = ([0; MAX_CODE], [0; MAX_MESSAGE_FRAME]);
        let message = event.message(&mut code);
        match message {
            Message::Profile(_) => self.summary.profiles += 1,
            Message::Status(status) => self.summary.status = status,
            _ => {}
        }
        // Room for the longest frame: encoding cannot fail.
        let Ok(length) = self.sequencer.message(&message, &mut frame) else { return };
        self.summary.frames += 1;
        self.summary.bytes += length as u64;
        if let Err(error) = self.log.frame(self.now_ns, &frame[..length]) {
            self.failed.get_or_insert(error);
        }
    }
}

/// The board's pins: what waits on each line, and when its next byte arrives.
pub(crate) struct Wires {
    pulses: VecDeque<u64>,
    lidar: Wire,
    ins: Wire,
}

impl Wires {
    /// Nothing waits.
    pub(crate) fn new(config: &Config, family: Family) -> Self {
        let lidar = match family {
            Family::Lms2xx => config.scanner.baud,
            Family::Cola => scanner::ETHERNET_BAUD,
        };
        Self { pulses: VecDeque::new(), lidar: Wire::new(lidar), ins: Wire::new(config.ins.baud) }
    }

    /// What comes next on one of them.
    pub(crate) fn push(&mut self, chunk: Chunk) {
        match chunk.channel {
            Channel::Pps => self.pulses.push_back(chunk.device_time_ns),
            Channel::Lidar => self.lidar.push(chunk),
            Channel::Ins => self.ins.push(chunk),
            // The second unit is compared by `compare`; the board has no third line.
            Channel::Ins2 => {}
        }
    }

    /// Lets everything happen that happens before `until_ns`, in the order of time; of simultaneous things the pulse comes first.
    /// `now_ns` follows; `send` gets it with every event.
    pub(crate) fn deliver<S: Scanner>(
        &mut self,
        until_ns: Option<u64>,
        instrument: &mut Instrument<S>,
        now_ns: &mut u64,
        send: &mut impl FnMut(u64, Event<'_>),
    ) {
        loop {
            let pulse = self.pulses.front().copied().unwrap_or(u64::MAX);
            let lidar = self.lidar.next_arrival();
            let ins = self.ins.next_arrival();
            let next = pulse.min(lidar).min(ins);
            let crowded = self.lidar.waiting() + self.ins.waiting() > MAX_WAITING;
            if next == u64::MAX || (!crowded && until_ns.is_some_and(|until| next >= until)) {
                return;
            }
            if pulse == next {
                self.pulses.pop_front();
                *now_ns = pulse.max(*now_ns);
                let now = *now_ns;
                instrument.pps(DeviceTime(pulse / 1_000), &mut |event| send(now, event));
            } else if lidar == next {
                let (byte, at_ns) = self.lidar.take();
                *now_ns = at_ns.max(*now_ns);
                let now = *now_ns;
                instrument.lidar_byte(byte, DeviceTime(at_ns / 1_000), &mut |event| send(now, event));
            } else {
                let (byte, at_ns) = self.ins.take();
                *now_ns = at_ns.max(*now_ns);
                let now = *now_ns;
                instrument.ins_byte(byte, DeviceTime(at_ns / 1_000), &mut |event| send(now, event));
            }
        }
    }
}
