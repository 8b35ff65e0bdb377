//! Plays a drive into the board's pins with true timing, and holds the scanner's side of the bring-up dialogue.

use std::io;
use std::time::{Duration, Instant};

use super::Emulator;
use super::scanner::Scanner;
use crate::capture::{Channel, Chunk};
use crate::interrupt;

/// How often the scanner listens.
const LISTEN: Duration = Duration::from_millis(2);

impl Emulator {
    /// Lets a scanner answer the board until `done`, for at most `limit`; whether it came to that. Bytes pass only when board and
    /// scanner agree on the rate of the line, as they would on a wire.
    ///
    /// # Errors
    /// When QEMU has gone.
    pub fn converse(
        &mut self,
        scanner: &mut Scanner,
        limit: Duration,
        mut done: impl FnMut(&Scanner) -> bool,
    ) -> io::Result<bool> {
        let deadline = Instant::now() + limit;
        while !done(scanner) {
            if Instant::now() > deadline {
                return Ok(false);
            }
            self.answer(scanner, LISTEN)?;
        }
        Ok(true)
    }

    /// Plays steps, which are in the order of their times, each at its time from now on by the board's own clock. The scanner answers
    /// the board meanwhile; its bytes reach the board only while it sends scans and both agree on the line's rate. `progress` is told the
    /// microseconds played.
    ///
    /// # Errors
    /// When QEMU has gone, when the board's clock falls behind the host's tenfold, or when the user asks to stop.
    pub fn play<'s>(
        &mut self,
        scanner: &mut Scanner,
        steps: impl IntoIterator<Item = Step<'s>>,
        mut progress: impl FnMut(u64),
    ) -> io::Result<Played> {
        let begun = Instant::now();
        let start = self.monitor.counter()?;
        let mut clock = Elapsed { counter: start, us: 0, read: Instant::now() };
        let mut first_ns = None;
        let mut played = Played::default();
        for step in steps {
            let first_ns = *first_ns.get_or_insert(step.device_time_ns());
            let due_us = step.device_time_ns().saturating_sub(first_ns) / 1_000;
            // Never early: the board itself has said that the time has come.
            while clock.us < due_us {
                if interrupt::requested() {
                    return Err(io::ErrorKind::Interrupted.into());
                }
                if begun.elapsed() > PATIENCE + 10 * Duration::from_micros(due_us) {
                    return Err(io::Error::new(io::ErrorKind::TimedOut, "the board's clock hardly moves"));
                }
                let left_us = due_us.saturating_sub(clock.now_us());
                self.answer(scanner, Duration::from_micros(left_us.clamp(50, 5_000)))?;
                if left_us <= 5_000 || clock.read.elapsed() > LOOK {
                    clock.advance(self.monitor.counter()?);
                }
            }
            played.latest = played.latest.max(Duration::from_micros(clock.now_us().saturating_sub(due_us)));
            progress(due_us);
            match step {
                Step::Do(_, act) => act(self, scanner)?,
                Step::Bytes(Chunk { channel: Channel::Lidar, .. }) if !scanner.is_sending() => played.unsent += 1,
                Step::Bytes(Chunk { channel: Channel::Lidar, data, .. }) => {
                    if let Some(answer) = scanner.begin() {
                        self.lidar.send(&answer.bytes)?;
                    }
                    played.scans += 1;
                    self.lidar.send(&data)?;
                }
                Step::Bytes(Chunk { channel: Channel::Ins, data, .. }) => self.ins.send(&data)?,
                Step::Bytes(Chunk { channel: Channel::Pps, .. }) => self.pulse_at(start.wrapping_add(due_us as u32))?,
                Step::Bytes(_) => {}
            }
        }
        Ok(played)
    }

    /// Lets the scanner answer what the board says within this time.
    fn answer(&mut self, scanner: &mut Scanner, patience: Duration) -> io::Result<()> {
        let heard = self.lidar.receive(patience)?;
        if heard.is_empty() {
            return Ok(());
        }
        let baud = self.monitor.scanner_baud()?;
        for answer in scanner.hear(&heard, baud) {
            if self.monitor.scanner_baud()? == answer.baud {
                self.lidar.send(&answer.bytes)?;
            }
        }
        Ok(())
    }
}

/// One step of a drive.
pub enum Step<'s> {
    /// Bytes or a pulse for the board's pins.
    Bytes(Chunk),
    /// Anything else, at this device time in nanoseconds.
    Do(u64, Box<Act<'s>>),
}

/// What a step may do.
pub type Act<'s> = dyn FnOnce(&mut Emulator, &mut Scanner) -> io::Result<()> + 's;

impl Step<'_> {
    /// When it is due.
    #[must_use]
    pub fn device_time_ns(&self) -> u64 {
        match self {
            Self::Bytes(chunk) => chunk.device_time_ns,
            Self::Do(device_time_ns, _) => *device_time_ns,
        }
    }
}

/// How a drive went.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Played {
    /// How late the worst step was by the board's clock: the host's scheduling, which the board cannot tell from the sensor's.
    pub latest: Duration,
    /// Chunks of the scanner that went out.
    pub scans: u32,
    /// Chunks of the scanner that did not go out because it was silent or not sending scans.
    pub unsent: u32,
}

/// Beyond ten times the drive's length, a drive may last so much longer.
const PATIENCE: Duration = Duration::from_secs(30);

/// How often the board's clock is looked at. Each look costs QEMU as much as a dozen bytes.
const LOOK: Duration = Duration::from_millis(20);

/// The board's time since some instant: readings of its counter, and the host's clock from one to the next.
struct Elapsed {
    counter: u32,
    us: u64,
    read: Instant,
}

impl Elapsed {
    fn advance(&mut self, counter: u32) {
        self.us += u64::from(counter.wrapping_sub(self.counter));
        self.counter = counter;
        self.read = Instant::now();
    }

    /// Time goes on for at most as long as there should be between readings.
    fn now_us(&self) -> u64 {
        self.us + self.read.elapsed().min(LOOK).as_micros() as u64
    }
}

/// Every second frame of a line whose frames all begin with the same mark: what a sensor at half its rate would send.
#[must_use]
pub fn every_second(chunks: &[Chunk], channel: Channel, mark: &[u8]) -> Vec<Chunk> {
    let mut bytes: Vec<(u8, u64)> = Vec::new();
    for chunk in chunks.iter().filter(|chunk| chunk.channel == channel) {
        bytes.extend(chunk.data.iter().map(|&byte| (byte, chunk.device_time_ns)));
    }
    let begins = |at: usize| mark.iter().enumerate().all(|(k, &byte)| bytes.get(at + k).is_some_and(|b| b.0 == byte));
    let starts: Vec<usize> = (0..bytes.len()).filter(|&at| begins(at)).chain([bytes.len()]).collect();
    let frames = starts.windows(2).step_by(2);
    frames
        .map(|ends| Chunk {
            channel,
            device_time_ns: bytes[ends[0]].1,
            data: bytes[ends[0]..ends[1]].iter().map(|&(byte, _)| byte).collect(),
        })
        .collect()
}
