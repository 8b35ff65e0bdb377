//! The whole instrument under any sequence of bytes, telegrams, poses, pulses, commands and pauses.
//!
//! What must hold: each kind of time never goes back; every byte of each line is accounted for; every message fits its frame and comes
//! back from it; and a second survey over the messages gives every profile again, bit for bit.

use arbitrary::{Arbitrary, Unstructured};
use crossfall_core::instrument::{Event, Identity, Instrument, Survey};
use crossfall_core::protocol::frame::{self, HostDecoder, MAX_MESSAGE_FRAME, Sequencer};
use crossfall_core::protocol::message::{Command, Message, Profile, Session};
use crossfall_core::protocol::ranges::MAX_CODE;
use crossfall_core::protocol::units::Angle;
use crossfall_core::protocol::{Config, DeviceTime};
use crossfall_core::scan::RawScan;
use crossfall_core::sensors::{lms2xx, novatel};

/// Steps of one input at most.
const STEPS: usize = 200;

/// Time of a byte on each line, in microseconds.
const BYTE_US: [u64; 2] = [20, 43];

#[derive(Arbitrary, Debug)]
enum Step {
    Lidar(Vec<u8>),
    Ins(Vec<u8>),
    /// A whole telegram: a hinge at some height, and values that are anything.
    Scan {
        height_mm: u16,
        slope: i8,
        index: Option<u8>,
        wild: Vec<u16>,
        count: u16,
        layout: u8,
    },
    /// A whole pose, so many milliseconds after the second that the pulses count.
    Pose {
        seconds: u32,
        milliseconds: u16,
        roll: i16,
        status: u8,
    },
    /// A pulse after so many microseconds more or less than a second.
    Second(i8),
    Pulse,
    Wait(u32),
    Identify,
    Ping(u32),
    Start,
    Stop,
    Configure {
        mounting_offset: i32,
        delay_us: i16,
        latency_us: u32,
        mode: u8,
        seed_method: bool,
        wild: bool,
    },
    Tick,
}

struct Bench {
    instrument: Instrument,
    now: u64,
    fed: [u64; 2],
    link: Link,
}

/// The host's end: what it decodes, and its own survey.
struct Link {
    sequencer: Sequencer,
    decoder: HostDecoder,
    survey: Survey,
    room: RawScan,
    expected: Vec<Profile>,
    latest: [DeviceTime; 4],
}

pub fn instrument(input: &[u8]) {
    let mut random = Unstructured::new(input);
    let mut bench = Bench {
        instrument: Instrument::new(Config::default(), Identity::default()),
        now: 1_000_000,
        fed: [0; 2],
        link: Link {
            sequencer: Sequencer::new(),
            decoder: HostDecoder::new(),
            survey: Survey::new(),
            room: RawScan::EMPTY,
            expected: Vec::new(),
            latest: [DeviceTime(0); 4],
        },
    };
    let link = &mut bench.link;
    bench.instrument.start(DeviceTime(bench.now), &mut |event| link.take(&event));
    for _ in 0..STEPS {
        let Ok(step) = Step::arbitrary(&mut random) else { break };
        bench.step(step);
        if random.is_empty() {
            break;
        }
    }
    let link = &mut bench.link;
    bench.instrument.finish(DeviceTime(bench.now), &mut |event| link.take(&event));
    assert!(link.expected.is_empty(), "{} profiles were not sent", link.expected.len());
    let status = bench.instrument.decode().status(DeviceTime(bench.now));
    for (counters, fed) in [status.lidar, status.ins].into_iter().zip(bench.fed) {
        assert_eq!(counters.bytes, fed);
        assert!(counters.skipped <= fed && (counters.frames > 0 || counters.skipped == fed));
    }
}

impl Bench {
    fn step(&mut self, step: Step) {
        let Self { instrument, now, link, .. } = self;
        let at = DeviceTime(*now);
        let mut out = |event: Event<'_>| link.take(&event);
        match step {
            Step::Lidar(bytes) => self.line(0, &bytes),
            Step::Ins(bytes) => self.line(1, &bytes),
            Step::Scan { height_mm, slope, index, wild, count, layout } => {
                let bytes = telegram(height_mm, slope, index, &wild, count, layout);
                self.line(0, &bytes);
            }
            Step::Pose { seconds, milliseconds, roll, status } => {
                let bytes = pose(seconds, milliseconds, roll, status);
                self.line(1, &bytes);
            }
            Step::Second(error) => {
                *now += (1_000_000 + i64::from(error)) as u64;
                instrument.pps(DeviceTime(*now), &mut out);
            }
            Step::Pulse => instrument.pps(at, &mut out),
            Step::Wait(microseconds) => *now += u64::from(microseconds),
            Step::Identify => instrument.command(0, &Command::Identify, at, &mut out),
            Step::Ping(number) => instrument.command(1, &Command::Ping(number), at, &mut out),
            Step::Start => instrument.command(2, &Command::Start, at, &mut out),
            Step::Stop => instrument.command(3, &Command::Stop, at, &mut out),
            Step::Configure { mounting_offset, delay_us, latency_us, mode, seed_method, wild } => {
                let mut config = Config::default();
                config.scanner.mounting_offset = Angle(mounting_offset);
                config.scanner.delay_us = i32::from(delay_us);
                config.scanner.measuring_mode = mode;
                config.ins.latency_us = latency_us;
                if seed_method {
                    config.survey.method = crossfall_core::protocol::config::Method::Seed;
                }
                if wild {
                    config.survey.limits.max_length_um = mounting_offset;
                    config.survey.seed.spacing_um = i32::from(delay_us);
                }
                instrument.command(4, &Command::Configure(config), at, &mut out);
            }
            Step::Tick => instrument.tick(at, &mut out),
        }
    }

    fn line(&mut self, line: usize, bytes: &[u8]) {
        let link = &mut self.link;
        for &byte in bytes {
            self.now += BYTE_US[line];
            let at = DeviceTime(self.now);
            match line {
                0 => self.instrument.lidar_byte(byte, at, &mut |event| link.take(&event)),
                _ => self.instrument.ins_byte(byte, at, &mut |event| link.take(&event)),
            }
        }
        self.fed[line] += bytes.len() as u64;
    }
}

impl Link {
    fn take(&mut self, event: &Event<'_>) {
        let (mut code, mut bytes) = ([0; MAX_CODE], [0; MAX_MESSAGE_FRAME]);
        let sent = event.message(&mut code);
        let length = self.sequencer.message(&sent, &mut bytes).expect("room for any message");
        let mut input = &bytes[..length];
        let Some(frame::Event::Frame(frame)) = self.decoder.next(&mut input) else { panic!("{sent:?} is not decoded") };
        assert_eq!(frame.body, sent);
        let time = match frame.body {
            Message::Scan(scan) => Some((0, scan.stx)),
            Message::Pulse(pulse) => Some((1, pulse.time)),
            Message::Status(status) => Some((2, status.time)),
            Message::Session(Session::Started(time) | Session::Stopped(time)) => Some((3, time)),
            _ => None,
        };
        if let Some((kind, time)) = time {
            assert!(time >= self.latest[kind], "time goes back: {:?} to {time:?}", self.latest[kind]);
            self.latest[kind] = time;
        }
        if let Message::Profile(profile) = frame.body {
            assert!(!self.expected.is_empty(), "a profile that nothing gives: {profile:?}");
            assert_eq!(self.expected.remove(0), profile);
        }
        let expected = &mut self.expected;
        let event = Event::of(&frame.body, &mut self.room).expect("the board's own code");
        self.survey.take(&event, &mut |profile| expected.push(profile));
    }
}

/// A telegram whose check is right: a road under the sensor and a slope beside it, values anything where `wild` says so.
fn telegram(height_mm: u16, slope: i8, index: Option<u8>, wild: &[u16], count: u16, layout: u8) -> Vec<u8> {
    let count = if layout & 1 == 0 { 361 } else { count % 402 };
    let height = f64::from(height_mm % 4_000) + 500.0;
    let tangent = libm::tan(f64::from(slope % 40).to_radians());
    let values = (0..count).map(|i| {
        if let Some(&value) = wild.get(usize::from(i)) {
            return value;
        }
        let (s, c) = libm::sincos((f64::from(i) * 0.5).to_radians());
        // The road to 3 m, then a plane of this slope: r from z = -h + t (|y| - 3000).
        let flat = height / s.max(1e-3);
        let out = flat * c.abs();
        let range =
            if out <= 3_000.0 { flat } else { (height + 3_000.0 * tangent) / (s + tangent * c.abs()).max(1e-3) };
        range.clamp(0.0, 8_183.0) as u16
    });
    let word = count | u16::from(layout & 0xfe) << 8;
    let mut bytes = vec![0x02, 0x80];
    let length = 3 + 2 * count + if index.is_some() { 2 } else { 0 } + 1;
    bytes.extend(length.to_le_bytes());
    bytes.push(0xb0);
    bytes.extend(word.to_le_bytes());
    bytes.extend(values.flat_map(u16::to_le_bytes));
    if let Some(index) = index {
        bytes.extend([index.wrapping_mul(2), index]);
    }
    bytes.push(0x10);
    bytes.extend(lms2xx::crc(&bytes).to_le_bytes());
    bytes
}

/// An INSPVAS log whose check is right.
fn pose(seconds: u32, milliseconds: u16, roll: i16, status: u8) -> Vec<u8> {
    let second = f64::from(seconds % 604_800) + f64::from(milliseconds) * 1e-3;
    let mut bytes = vec![0xaa, 0x44, 0x13, 88];
    bytes.extend(508_u16.to_le_bytes());
    bytes.extend(2_400_u16.to_le_bytes());
    bytes.extend(((second * 1e3) as u32).to_le_bytes());
    bytes.extend(2_400_u32.to_le_bytes());
    for number in [second, 48.1, 11.6, 500.0, 10.0, 5.0, 0.1, f64::from(roll) * 1e-3, 0.5, 90.0] {
        bytes.extend(number.to_le_bytes());
    }
    bytes.extend(u32::from(status % 8).to_le_bytes());
    bytes.extend(novatel::crc32(&bytes).to_le_bytes());
    bytes
}
