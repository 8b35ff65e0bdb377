//! Turns of a Velodyne out of a network capture (pcap, pcapng).
//!
//! A frame is one turn of the head, from straight behind through ahead to straight behind again (or the other way round), as the map wants
//! it; its time is that at which the head looked forward. The turn with which the capture begins or ends counts if it is
//! nine tenths complete. Packets of other sensors, broken ones and other traffic are counted and passed over. A capture
//! is read once when it is opened, to count its turns and learn their times, and a second time as they are asked for.

use std::cell::RefCell;
use std::fs::File;
use std::io::BufReader;
use std::path::{Path, PathBuf};

use etherparse::{SlicedPacket, TransportSlice};
use pcap_parser::traits::PcapReaderIterator;
use pcap_parser::{Block, Linktype, PcapBlockOwned, PcapError, create_reader};

use super::frames::{Error, MOST_POINTS};
use super::lidar::SensorPose;
use super::poses::Poses;
use super::velodyne::{self, PACKET, Refusal, Return};
use crate::geodesy::turned_deg;

/// Largest block of a capture: a packet and its header are far below.
const BUFFER: usize = 1 << 20;
/// Part of a turn that must be there, degrees.
const COMPLETE_DEG: f64 = 324.0;

/// What was passed over in a capture.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Passed {
    /// Data packets used.
    pub packets: u64,
    /// UDP payloads of a data packet's size that are none: damaged, or of another sensor.
    pub refused: u64,
    /// Any other traffic.
    pub other: u64,
    /// Turns left out because too much of them is missing.
    pub incomplete: u64,
    /// The capture ends within a packet.
    pub cut: bool,
}

/// Packets of a capture, one after the other.
struct Packets {
    path: PathBuf,
    reader: Box<dyn PcapReaderIterator + Send>,
    /// Link type, ticks a second and offset of every interface of the section.
    interfaces: Vec<(Linktype, u64, i64)>,
    read: u64,
    /// The file ends within a packet.
    cut: bool,
}

impl Packets {
    fn open(path: &Path) -> Result<Self, Error> {
        let file = File::open(path).map_err(|source| Error::Read { path: path.into(), source })?;
        let wrong = |error| Error::Format { path: path.into(), offset: 0, what: format!("no capture: {error:?}") };
        let reader = create_reader(BUFFER, BufReader::new(file)).map_err(wrong)?;
        Ok(Self { path: path.into(), reader, interfaces: Vec::new(), read: 0, cut: false })
    }

    /// Shows the next UDP payload and its time in seconds to `see`; false at the end. Anything else passes with `None`.
    fn next(&mut self, mut see: impl FnMut(Option<(f64, &[u8])>)) -> Result<bool, Error> {
        loop {
            match self.reader.next() {
                Ok((length, block)) => {
                    let mut shown = true;
                    match block {
                        PcapBlockOwned::LegacyHeader(header) => {
                            let ticks = if header.is_nanosecond_precision() { 1_000_000_000 } else { 1_000_000 };
                            self.interfaces = vec![(header.network, ticks, 0)];
                            shown = false;
                        }
                        PcapBlockOwned::Legacy(packet) => {
                            let (link, ticks, _) =
                                self.interfaces.first().copied().unwrap_or((Linktype(1), 1_000_000, 0));
                            let time = f64::from(packet.ts_sec) + f64::from(packet.ts_usec) / ticks as f64;
                            see(payload(link, packet.data).map(|payload| (time, payload)));
                        }
                        PcapBlockOwned::NG(Block::SectionHeader(_)) => {
                            self.interfaces.clear();
                            shown = false;
                        }
                        PcapBlockOwned::NG(Block::InterfaceDescription(interface)) => {
                            let ticks = interface.ts_resolution().unwrap_or(1_000_000).max(1);
                            self.interfaces.push((interface.linktype, ticks, interface.ts_offset()));
                            shown = false;
                        }
                        PcapBlockOwned::NG(Block::EnhancedPacket(packet)) => {
                            let interface = self.interfaces.get(packet.if_id as usize).copied();
                            let (link, ticks, offset) = interface.unwrap_or((Linktype(1), 1_000_000, 0));
                            let stamp = u64::from(packet.ts_high) << 32 | u64::from(packet.ts_low);
                            let time = offset as f64 + (stamp / ticks) as f64 + (stamp % ticks) as f64 / ticks as f64;
                            let data = packet.data.get(..packet.caplen as usize).unwrap_or(packet.data);
                            see(payload(link, data).map(|payload| (time, payload)));
                        }
                        PcapBlockOwned::NG(_) => shown = false,
                    }
                    self.reader.consume(length);
                    self.read += length as u64;
                    if shown {
                        return Ok(true);
                    }
                }
                Err(PcapError::Eof) => return Ok(false),
                Err(PcapError::Incomplete(_)) => {
                    if self.reader.reader_exhausted() || self.reader.refill().is_err() {
                        self.cut = true;
                        return Ok(false);
                    }
                }
                Err(PcapError::UnexpectedEof) => {
                    self.cut = true;
                    return Ok(false);
                }
                Err(error) => {
                    let what = format!("no packet of a capture: {error:?}").chars().take(160).collect();
                    return Err(Error::Format { path: self.path.clone(), offset: self.read, what });
                }
            }
        }
    }
}

fn payload(link: Linktype, data: &[u8]) -> Option<&[u8]> {
    let sliced = match link {
        Linktype::ETHERNET => SlicedPacket::from_ethernet(data).ok()?,
        Linktype::LINUX_SLL => SlicedPacket::from_linux_sll(data).ok()?,
        Linktype::RAW | Linktype::IPV4 => SlicedPacket::from_ip(data).ok()?,
        _ => return None,
    };
    match sliced.transport? {
        TransportSlice::Udp(udp) => Some(udp.payload()),
        _ => None,
    }
}

/// A complete turn: its time and points.
type Timed = (f64, Vec<[f32; 4]>);

/// A turn being put together.
#[derive(Default)]
struct Turn {
    points: Vec<[f32; 4]>,
    /// Azimuth of the last return, and degrees turned since the first.
    last: Option<f64>,
    turned: f64,
    /// When the head looked forward, or else when the turn began.
    forward_s: Option<f64>,
    begun_s: f64,
}

/// Complete turns of a capture, in order.
struct Reader {
    packets: Packets,
    turn: Turn,
    passed: Passed,
    ended: bool,
    /// Returns of a packet behind the end of a turn.
    waiting: Vec<(f64, Return)>,
}

impl Reader {
    fn open(path: &Path) -> Result<Self, Error> {
        let packets = Packets::open(path)?;
        Ok(Self { packets, turn: Turn::default(), passed: Passed::default(), ended: false, waiting: Vec::new() })
    }

    /// The next complete turn: its time and points.
    fn next(&mut self) -> Result<Option<Timed>, Error> {
        loop {
            let mut waiting = std::mem::take(&mut self.waiting).into_iter();
            while let Some((time, seen)) = waiting.next() {
                if self.turn.ends_before(&seen) {
                    let turn = std::mem::take(&mut self.turn);
                    self.turn.take(time, &seen);
                    self.waiting = waiting.collect();
                    match turn.finished() {
                        Some(turn) => return Ok(Some(turn)),
                        None => self.passed.incomplete += 1,
                    }
                    waiting = std::mem::take(&mut self.waiting).into_iter();
                } else {
                    self.turn.take(time, &seen);
                }
            }
            if self.ended {
                return Ok(None);
            }
            let (passed, returns) = (&mut self.passed, &mut self.waiting);
            let more = self.packets.next(|packet| match packet {
                Some((time, payload)) if payload.len() == PACKET => {
                    // The capture's stamp is that of the packet's sending, after its last firing.
                    let first = returns.len();
                    match velodyne::decode(payload, |seen| returns.push((time, seen))) {
                        Ok(_) => {
                            passed.packets += 1;
                            let last_us = returns.last().map_or(0.0, |(_, seen)| seen.after_us);
                            for (time, seen) in returns.iter_mut().skip(first) {
                                *time += (seen.after_us - last_us) * 1e-6;
                            }
                        }
                        Err(Refusal::Size | Refusal::Flag | Refusal::Azimuth | Refusal::Model(_)) => {
                            passed.refused += 1
                        }
                    }
                }
                _ => passed.other += 1,
            })?;
            if !more {
                self.ended = true;
                let turn = std::mem::take(&mut self.turn);
                let begun = turn.last.is_some();
                if let Some(turn) = turn.finished() {
                    return Ok(Some(turn));
                }
                self.passed.incomplete += u64::from(begun);
            }
        }
    }
}

impl Turn {
    /// Whether the head has passed straight behind since the last return.
    fn ends_before(&self, seen: &Return) -> bool {
        let Some(last) = self.last else { return false };
        // Measured from behind: a turn runs from 0 to 360, and where that falls by more than half a turn the next begins. A head that
        // turns the other way climbs by as much.
        let from_behind = |azimuth: f64| (azimuth + 180.0).rem_euclid(360.0);
        (from_behind(seen.azimuth_deg) - from_behind(last)).abs() > 180.0
    }

    fn take(&mut self, time: f64, seen: &Return) {
        match self.last {
            None => self.begun_s = time,
            Some(last) => {
                self.turned += turned_deg(last, seen.azimuth_deg);
                // Across 0 by less than half a turn.
                if (last > 270.0) != (seen.azimuth_deg > 270.0) && (last < 90.0) != (seen.azimuth_deg < 90.0) {
                    self.forward_s = self.forward_s.or(Some(time));
                }
            }
        }
        self.last = Some(seen.azimuth_deg);
        if (self.points.len() as u64) < MOST_POINTS {
            self.points.push(seen.point);
        }
    }

    fn finished(self) -> Option<(f64, Vec<[f32; 4]>)> {
        (self.turned.abs() >= COMPLETE_DEG).then(|| (self.forward_s.unwrap_or(self.begun_s), self.points))
    }
}

/// An opened capture.
pub struct Turns {
    path: PathBuf,
    times: Vec<f64>,
    largest: usize,
    passed: Passed,
    poses: Poses,
    /// The reader of the second pass, and the number of the turn that it comes to.
    reader: RefCell<(Reader, usize)>,
}

impl Turns {
    /// Opens a capture: `poses` is a file of as many matrices as there are turns, or a trajectory in the capture's own time.
    ///
    /// # Errors
    /// A file that is no capture, without a complete turn, or another number of matrices.
    pub fn open(path: &Path, poses: &Path) -> Result<Self, Error> {
        let mut reader = Reader::open(path)?;
        let (mut times, mut largest) = (Vec::new(), 0);
        while let Some((time, points)) = reader.next()? {
            times.push(time);
            largest = largest.max(points.len());
        }
        let passed = Passed { cut: reader.packets.cut, ..reader.passed };
        if times.is_empty() {
            let what = format!(
                "no complete turn of a VLP-16 or HDL-32E: {} data packets, {} refused, {} others",
                passed.packets, passed.refused, passed.other
            );
            return Err(Error::Format { path: path.into(), offset: 0, what });
        }
        let poses_file = poses;
        let poses = Poses::read(poses)?;
        if let Poses::Frames(all) = &poses
            && all.len() != times.len()
        {
            let frames = times.len();
            return Err(Error::Count { path: poses_file.into(), found: all.len(), what: "poses", frames });
        }
        let reader = RefCell::new((Reader::open(path)?, 0));
        Ok(Self { path: path.into(), times, largest, passed, poses, reader })
    }

    /// Number of complete turns, at least one.
    #[must_use]
    pub fn count(&self) -> usize {
        self.times.len()
    }

    /// What was passed over.
    #[must_use]
    pub fn passed(&self) -> Passed {
        self.passed
    }

    /// Points of the largest turn.
    #[must_use]
    pub fn largest(&self) -> usize {
        self.largest
    }

    /// The pose of a turn.
    #[must_use]
    pub fn pose(&self, index: usize) -> Option<SensorPose> {
        self.poses.of(index, self.times.get(index).copied())
    }

    /// When the head looked forward in a turn, seconds of the capture's clock.
    #[must_use]
    pub fn time_s(&self, index: usize) -> Option<f64> {
        self.times.get(index).copied()
    }

    /// Microseconds since the turn before; 0 for the first.
    #[must_use]
    pub fn step_us(&self, index: usize) -> u32 {
        let before = index.checked_sub(1).and_then(|before| self.times.get(before));
        self.times.get(index).zip(before).map_or(0, |(now, before)| ((now - before) * 1e6).clamp(0.0, 4e9) as u32)
    }

    /// A turn's points. In order they are read through once; going back starts over.
    ///
    /// # Errors
    /// A capture that cannot be read any more.
    pub fn points(&self, index: usize, out: &mut Vec<[f32; 4]>) -> Result<(), Error> {
        out.clear();
        let mut held = self.reader.borrow_mut();
        let (reader, next) = &mut *held;
        if *next > index {
            (*reader, *next) = (Reader::open(&self.path)?, 0);
        }
        while *next <= index {
            let Some((_, points)) = reader.next()? else { return Ok(()) };
            *next += 1;
            *out = points;
        }
        Ok(())
    }
}
