//! The decode layer: sensor bytes, pulses and commands in; scans, poses and all other messages out, in the order of the stream.
//!
//! It runs at acquisition priority on a board, so it never waits and does a bounded amount of work a byte. Everything that it loses or
//! turns away is counted in [`Status`].

use crossfall_protocol::message::{
    ClockState, Command, Hello, LineCounters, Marker, Message, Outcome, Pose, Pulse, PulseVerdict, Reply, Sensor,
    Session, Status,
};
use crossfall_protocol::{Config, DeviceTime, schema};

use super::Event;
use crate::clock::{GpsClock, GpsTime, SECOND_US};
use crate::sensors::novatel::InsSolution;
use crate::sensors::{Scanner, lms2xx, novatel};

/// Longest text in [`Identity::restart`].
pub const RESTART_TEXT: usize = 160;

/// What the board says of itself in its hello.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Identity {
    /// Name and version of the firmware.
    pub firmware: &'static str,
    /// Name of the board.
    pub board: &'static str,
    /// Number of this boot, 0 when the board cannot count them.
    pub boot: u32,
    /// Why it restarted; empty after power-on.
    pub restart: heapless::String<RESTART_TEXT>,
}

/// What was lost before the decode layer could see it, or after it. The caller counts these; the status frame carries them.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Losses {
    /// Bytes or bursts lost at the scanner's receiver.
    pub lidar_overruns: u32,
    /// The same at the inertial unit's receiver.
    pub ins_overruns: u32,
    /// Pulses whose capture was overrun by the next edge.
    pub pulses_overrun: u32,
    /// Scans that found no room in the survey's queue.
    pub scans_skipped: u32,
    /// Frames that found no room on the link.
    pub frames_dropped: u32,
    /// Command frames that were damaged or not understood.
    pub commands_rejected: u32,
}

/// The decode layer of one instrument, with an LMS 2xx unless told otherwise. Its size is constant.
pub struct Decode<S = lms2xx::Decoder> {
    identity: Identity,
    config: Config,
    lidar: S,
    ins: novatel::Decoder,
    state: State,
    next_status: Option<DeviceTime>,
    losses: Losses,
    markers: u32,
    restarts: Restarts,
}

/// Sensors that are to be brought up again, until whoever does that has taken note.
#[derive(Clone, Copy, Debug, Default)]
struct Restarts {
    lidar: bool,
    ins: bool,
}

/// What decoded frames change. Apart from the decoders, so that these can lend out a frame while it is acted on.
struct State {
    clock: GpsClock,
    latency_us: u32,
    running: bool,
    poses: u32,
    pulses: u32,
    pulses_spurious: u32,
}

impl Decode {
    /// A decode layer at boot: nothing is sent before [`Decode::start`].
    #[must_use]
    pub fn new(config: Config, identity: Identity) -> Self {
        Self::with_scanner(lms2xx::Decoder::new(config.scanner.measuring_mode), config, identity)
    }
}

impl<S: Scanner> Decode<S> {
    /// The same with a scanner of another kind.
    #[must_use]
    pub fn with_scanner(lidar: S, config: Config, identity: Identity) -> Self {
        Self {
            identity,
            config,
            lidar,
            ins: novatel::Decoder::new(),
            state: State {
                clock: GpsClock::default(),
                latency_us: config.ins.latency_us,
                running: false,
                poses: 0,
                pulses: 0,
                pulses_spurious: 0,
            },
            next_status: None,
            losses: Losses::default(),
            markers: 0,
            restarts: Restarts::default(),
        }
    }

    /// The configuration in force.
    #[must_use]
    pub fn config(&self) -> &Config {
        &self.config
    }

    /// Says hello and starts the survey.
    pub fn start(&mut self, now: DeviceTime, out: &mut impl FnMut(Event<'_>)) {
        self.introduce(out);
        self.begin(now, out);
    }

    /// One byte from the scanner and its own arrival.
    pub fn lidar_byte(&mut self, byte: u8, at: DeviceTime, out: &mut impl FnMut(Event<'_>)) {
        self.hear_lidar(byte, at, &mut |_| {}, out);
    }

    /// The same for one who brings the scanner up: everything that the scanner says also goes to `heard`.
    pub fn hear_lidar(
        &mut self,
        byte: u8,
        at: DeviceTime,
        heard: &mut impl FnMut(&S::Event<'_>),
        out: &mut impl FnMut(Event<'_>),
    ) {
        let running = self.state.running;
        let mut happened = false;
        self.lidar.push(byte, at, &mut |event| {
            happened = true;
            heard(&event);
            scan_only::<S>(&event, running, out);
        });
        if happened {
            self.tick(at, out);
        }
    }

    /// Gives up what the scanner was saying: before its line's rate changes and before a command goes out to it.
    pub fn cut_lidar(&mut self, out: &mut impl FnMut(Event<'_>)) {
        let running = self.state.running;
        self.lidar.finish(&mut |event| scan_only::<S>(&event, running, out));
    }

    /// One byte from the inertial unit and its own arrival.
    pub fn ins_byte(&mut self, byte: u8, at: DeviceTime, out: &mut impl FnMut(Event<'_>)) {
        self.hear_ins(byte, at, &mut |_| {}, out);
    }

    /// The same for one who brings the unit up.
    pub fn hear_ins(
        &mut self,
        byte: u8,
        at: DeviceTime,
        heard: &mut impl FnMut(&novatel::Event),
        out: &mut impl FnMut(Event<'_>),
    ) {
        let state = &mut self.state;
        let mut happened = false;
        self.ins.push(byte, at, &mut |event| {
            happened = true;
            heard(&event);
            state.log(&event.log, out);
        });
        if happened {
            self.tick(at, out);
        }
    }

    /// One edge of the pulse per second.
    pub fn pulse(&mut self, at: DeviceTime, out: &mut impl FnMut(Event<'_>)) {
        self.state.pulse(at, out);
        self.tick(at, out);
    }

    /// One command; `sequence` is that of its frame.
    pub fn command(&mut self, sequence: u16, command: &Command, now: DeviceTime, out: &mut impl FnMut(Event<'_>)) {
        let outcome = match command {
            Command::Identify => {
                self.introduce(out);
                Outcome::Done
            }
            Command::Ping(number) => Outcome::Pong(*number),
            Command::Configure(config) => match config.check() {
                Ok(()) => {
                    self.configure(config);
                    out(Event::Message(Message::Config(self.config)));
                    Outcome::Done
                }
                Err(_) => Outcome::BadConfig,
            },
            Command::Start => {
                self.begin(now, out);
                Outcome::Done
            }
            Command::Stop => {
                self.stop(now, out);
                Outcome::Done
            }
            Command::Mark(label) => {
                out(Event::Message(Message::Marker(Marker { time: now, number: self.markers, label: *label })));
                self.markers = self.markers.wrapping_add(1);
                Outcome::Done
            }
            Command::Restart(sensor) => {
                *self.restart_of(*sensor) = true;
                Outcome::Done
            }
        };
        out(Event::Message(Message::Reply(Reply { to: sequence, outcome })));
    }

    /// Stops the survey.
    pub fn stop(&mut self, now: DeviceTime, out: &mut impl FnMut(Event<'_>)) {
        self.state.running = false;
        out(Event::Message(Message::Session(Session::Stopped(now))));
    }

    /// Declares that no more bytes come: gives up what is under way, stops the survey and reports all counters.
    pub fn finish(&mut self, now: DeviceTime, out: &mut impl FnMut(Event<'_>)) {
        let running = self.state.running;
        let state = &mut self.state;
        self.lidar.finish(&mut |event| scan_only::<S>(&event, running, out));
        self.ins.finish(&mut |event| state.log(&event.log, out));
        self.stop(now, out);
        out(Event::Message(Message::Status(self.status(now))));
    }

    /// Sends the status when its second has come. A board calls it as time goes by, so that silent sensors do not silence it.
    pub fn tick(&mut self, now: DeviceTime, out: &mut impl FnMut(Event<'_>)) {
        if self.next_status.is_some_and(|next| now < next) {
            return;
        }
        let second = SECOND_US as u64;
        self.next_status = Some(DeviceTime((now.0 / second).saturating_add(1).saturating_mul(second)));
        out(Event::Message(Message::Status(self.status(now))));
    }

    /// Whether a command has asked for this sensor to be brought up again, or changed what it is brought up with; asked once, told once. A board's
    /// sensor tasks look here.
    pub fn take_restart(&mut self, sensor: Sensor) -> bool {
        core::mem::take(self.restart_of(sensor))
    }

    /// What was lost outside of this layer, for the caller to count in.
    pub fn losses(&mut self) -> &mut Losses {
        &mut self.losses
    }

    /// All counters.
    #[must_use]
    pub fn status(&self, now: DeviceTime) -> Status {
        Status {
            time: now,
            lidar: LineCounters { overruns: self.losses.lidar_overruns, ..self.lidar.counters() },
            ins: LineCounters { overruns: self.losses.ins_overruns, ..self.ins.counters() },
            scans: self.lidar.scans(),
            scans_missing: self.lidar.scans_missing(),
            scans_unreadable: self.lidar.scans_unreadable(),
            scans_skipped: self.losses.scans_skipped,
            poses: self.state.poses,
            poses_unreadable: self.ins.bad_fields(),
            pulses: self.state.pulses,
            pulses_spurious: self.state.pulses_spurious,
            pulses_overrun: self.losses.pulses_overrun,
            frames_dropped: self.losses.frames_dropped,
            commands_rejected: self.losses.commands_rejected,
        }
    }

    fn restart_of(&mut self, sensor: Sensor) -> &mut bool {
        match sensor {
            Sensor::Lidar => &mut self.restarts.lidar,
            Sensor::Ins => &mut self.restarts.ins,
        }
    }

    fn introduce(&self, out: &mut impl FnMut(Event<'_>)) {
        let Identity { firmware, board, boot, ref restart } = self.identity;
        out(Event::Message(Message::Hello(Hello { schema: schema::HASH, firmware, board, boot, restart })));
        out(Event::Message(Message::Config(self.config)));
        if let Some(clock) = self.state.clock.state() {
            out(Event::Message(Message::Clock(clock)));
        }
    }

    /// A survey that runs is stopped first: the scans that wait in it are measured, not lost.
    fn begin(&mut self, now: DeviceTime, out: &mut impl FnMut(Event<'_>)) {
        if self.state.running {
            self.stop(now, out);
        }
        self.state.running = true;
        out(Event::Message(Message::Session(Session::Started(now))));
    }

    fn configure(&mut self, config: &Config) {
        let (old, new) = (self.config.scanner, config.scanner);
        self.lidar.assume_measuring_mode(new.measuring_mode);
        // What only a sensor can change it is brought up for again.
        self.restarts.lidar |= (new.baud, new.measuring_mode) != (old.baud, old.measuring_mode);
        self.restarts.ins |= config.ins.baud != self.config.ins.baud;
        self.state.latency_us = config.ins.latency_us;
        self.config = *config;
    }
}

fn scan_only<S: Scanner>(event: &S::Event<'_>, running: bool, out: &mut impl FnMut(Event<'_>)) {
    if let Some(scan) = S::scan(event)
        && running
    {
        out(Event::Scan(scan));
    }
}

impl State {
    fn log(&mut self, log: &novatel::Log<'_>, out: &mut impl FnMut(Event<'_>)) {
        if let novatel::Log::Solution(solution, _) = log {
            self.solution(solution, out);
        }
    }

    fn solution(&mut self, solution: &InsSolution, out: &mut impl FnMut(Event<'_>)) {
        let gps = solution.gps_time();
        let renamed = self.clock.name(gps, solution.arrival);
        let mapped = self.clock.device_time(gps);
        let time = mapped.unwrap_or_else(|| solution.arrival.offset(-i64::from(self.latency_us)));
        let latency = solution.arrival.since(time).clamp(i64::from(i32::MIN), i64::from(i32::MAX));
        self.poses = self.poses.wrapping_add(1);
        out(Event::Message(Message::Pose(Pose {
            time,
            latency_us: latency as i32,
            timed_by_pulse: mapped.is_some(),
            gps_week: solution.week,
            gps_us: solution.gps_us,
            roll: solution.roll,
            pitch: solution.pitch,
            azimuth: solution.azimuth,
            fix: solution.fix,
            status: solution.status,
        })));
        if renamed && let Some(clock) = self.clock.state() {
            out(Event::Message(Message::Clock(clock)));
        }
    }

    fn pulse(&mut self, at: DeviceTime, out: &mut impl FnMut(Event<'_>)) {
        let verdict = self.clock.pulse(at);
        out(Event::Message(Message::Pulse(Pulse { time: at, verdict })));
        if verdict == PulseVerdict::Spurious {
            self.pulses_spurious = self.pulses_spurious.wrapping_add(1);
            return;
        }
        self.pulses = self.pulses.wrapping_add(1);
        if let Some(clock) = self.clock.state() {
            out(Event::Message(Message::Clock(clock)));
        }
    }
}

/// What the clock of a log is checked against: the pulses and poses of the stream give the same mapping again.
#[derive(Clone, Debug, Default)]
pub struct ClockReplay {
    clock: GpsClock,
}

impl ClockReplay {
    /// The verdict on a streamed pulse.
    pub fn pulse(&mut self, pulse: &Pulse) -> PulseVerdict {
        self.clock.pulse(pulse.time)
    }

    /// The device time of a streamed pose, where pulses give one.
    pub fn pose(&mut self, pose: &Pose) -> Option<DeviceTime> {
        let gps = GpsTime { week: pose.gps_week, us: pose.gps_us };
        self.clock.name(gps, pose.time.offset(i64::from(pose.latency_us)));
        self.clock.device_time(gps)
    }

    /// The mapping, as streamed after every accepted pulse.
    #[must_use]
    pub fn state(&self) -> Option<ClockState> {
        self.clock.state()
    }
}
