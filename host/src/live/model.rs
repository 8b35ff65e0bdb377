//! From frames to what viewers see.
//!
//! Work a frame is bounded; a section is levelled and coded at most [`SECTIONS`] apart, so that a replay at fifty times the speed costs a
//! viewer no more than a drive.

use std::collections::VecDeque;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

use crossfall_core::attitude::History;
use crossfall_core::instrument::{Event, WAITING};
use crossfall_core::protocol::frame::{self, HostDecoder};
use crossfall_core::protocol::message::{Hello, Level, Marker, Message, Pose, Profile, PulseVerdict, Session, Status};
use crossfall_core::protocol::{Config, DeviceTime, schema};
use crossfall_core::scan::{Points, RawScan, level};
use crossfall_core::sensors::novatel::Quality;

use super::account::Shared;
use super::commands::Commands;
use super::faults::{Faults, of_the_board};
use super::hub::Hub;
use super::lamps::{self, Senses};
use super::player::Controls;
use super::rock_test::RockTests;
use super::session::Heard;
use super::state::{BoardState, Lamps, MarkerState, Motion, Phase, SourceState, State};
use super::view::{Section, Strip};
use crate::intervals::MILE_M;
use crate::record::{Notice, gist};
use crate::track::{self, Track};
use crate::units::{degrees, drift_ppm};

/// Sections are shown no more often: a little faster than the scanner's 37.5 a second.
const SECTIONS: Duration = Duration::from_millis(24);

/// Profiles that make one moment of the strip charts.
const PROFILES_A_STRIP: u32 = 4;

/// Losses are "just now" for so long.
const RECENT: Duration = Duration::from_secs(6);

/// How often the disk's room is looked at.
const DISK: Duration = Duration::from_secs(2);

/// Device time that goes back, or forward by more than this from one scan to the next, begins charts and track anew: in microseconds.
const JUMP_US: i64 = 10_000_000;

/// Markers that viewers are told.
const MOST_MARKERS: usize = 50;

/// Slower than this, sections a mile mean nothing: in metres a second.
const WALKING_M_S: f64 = 0.5;

/// What has not come for so long has no rate any more.
const PRESENT: Duration = Duration::from_secs(2);

/// How quickly shown rates follow: the part that the newest interval has.
const FOLLOW: f64 = 0.05;

/// See the module.
pub struct Model {
    hub: Arc<Hub>,
    commands: Arc<Commands>,
    shared: Arc<Mutex<Shared>>,
    controls: Option<Controls>,
    source: SourceState,
    unheard: Arc<AtomicU64>,
    decoder: Box<HostDecoder>,
    room: Box<RawScan>,
    points: Box<Points>,
    config: Config,
    config_number: u64,
    history: History,
    scans: VecDeque<RawScan>,
    track: Track,
    board: Option<BoardState>,
    senses: Senses,
    seen: Seen,
    losses_at: [Option<Instant>; 3],
    faults: Faults,
    status_known: bool,
    motion: Motion,
    gathered: Vec<[f32; 7]>,
    section_at: Option<Instant>,
    markers: VecDeque<MarkerState>,
    marker_count: u64,
    rock_tests: RockTests,
    disk_at: Option<Instant>,
}

/// When each kind of thing was seen last, on this computer's clock and on the board's.
#[derive(Default)]
struct Seen {
    first_frame: Option<Instant>,
    frame: Option<Instant>,
    scan: Option<(Instant, DeviceTime)>,
    pose: Option<(Instant, DeviceTime)>,
    pulse: Option<Instant>,
}

impl Model {
    pub fn new(
        hub: Arc<Hub>,
        commands: Arc<Commands>,
        shared: Arc<Mutex<Shared>>,
        controls: Option<Controls>,
        source: SourceState,
        unheard: Arc<AtomicU64>,
    ) -> Self {
        Self {
            hub,
            commands,
            shared,
            controls,
            source,
            unheard,
            decoder: Box::new(HostDecoder::new()),
            room: Box::new(RawScan::EMPTY),
            points: Box::default(),
            config: Config::default(),
            config_number: 0,
            history: History::default(),
            scans: VecDeque::new(),
            track: Track::default(),
            board: None,
            senses: Senses { surveying: true, ..Senses::default() },
            seen: Seen::default(),
            losses_at: [None; 3],
            faults: Faults::default(),
            status_known: false,
            motion: Motion::default(),
            gathered: Vec::new(),
            section_at: None,
            markers: VecDeque::new(),
            marker_count: 0,
            rock_tests: RockTests::default(),
            disk_at: None,
        }
    }

    /// Takes in what the recorder's thread or a viewer says.
    pub fn hear(&mut self, heard: Heard) {
        match heard {
            Heard::Frame(raw) => self.frame(&raw),
            Heard::Notice(notice) => self.notice(&notice),
            Heard::Rock(order) => self.rock_tests.order(order, self.config),
        }
    }

    fn frame(&mut self, raw: &[u8]) {
        let mut decoder = std::mem::replace(&mut self.decoder, Box::new(HostDecoder::new()));
        let mut bytes = raw;
        while let Some(event) = decoder.next(&mut bytes) {
            if let frame::Event::Frame(frame) = event {
                let now = Instant::now();
                self.seen.frame = Some(now);
                self.seen.first_frame.get_or_insert(now);
                self.message(&frame.body);
            }
        }
        decoder.finish();
        self.decoder = decoder;
    }

    fn message(&mut self, message: &Message<'_>) {
        match message {
            Message::Hello(hello) => self.hello(hello),
            Message::Config(config) => {
                self.config = *config;
                self.config_number += 1;
                self.hub.lock().config = Some(*config);
            }
            Message::Scan(_) => {
                let mut room = std::mem::replace(&mut self.room, Box::new(RawScan::EMPTY));
                if let Ok(Event::Scan(scan)) = Event::of(message, &mut room) {
                    self.scan(scan);
                }
                self.room = room;
            }
            Message::Pose(pose) => self.pose(pose),
            Message::Pulse(pulse) if pulse.verdict != PulseVerdict::Spurious => self.seen.pulse = Some(Instant::now()),
            Message::Clock(clock) => {
                self.senses.drift_ppm = drift_ppm(clock);
                self.track.clock(clock);
            }
            Message::Profile(profile) => self.profile(profile),
            Message::Status(status) => self.status(status),
            Message::Log(line) if matches!(line.level, Level::Error | Level::Warn) => {
                let text = String::from_utf8_lossy(line.text);
                self.faults.note(format!("board: {text}"), "");
            }
            Message::Reply(reply) => self.commands.answered(*reply),
            Message::Session(Session::Started(_)) => {
                self.senses.surveying = true;
                self.history.clear();
            }
            Message::Session(Session::Stopped(_)) => self.senses.surveying = false,
            Message::Marker(marker) => self.marker(marker),
            Message::Pulse(_) | Message::Skip(_) | Message::Log(_) => {}
        }
    }

    fn hello(&mut self, hello: &Hello<'_>) {
        let board = BoardState {
            firmware: hello.firmware.to_owned(),
            board: hello.board.to_owned(),
            schema_known: hello.schema == schema::HASH,
        };
        if !board.schema_known && self.board.as_ref() != Some(&board) {
            let advice = "Use the program and the firmware of one version; the log is good all the same.";
            self.faults.note("the board speaks other messages than this program knows".into(), advice);
        }
        self.board = Some(board);
    }

    fn scan(&mut self, scan: &RawScan) {
        if let Some((_, before)) = self.seen.scan {
            let step_us = scan.stx.since(before);
            if !(0..=JUMP_US).contains(&step_us) {
                self.begin_anew();
            } else if step_us > 0 {
                follow(&mut self.senses.scan_hz, 1e6 / step_us as f64);
            }
        }
        self.seen.scan = Some((Instant::now(), scan.stx));
        self.senses.scanner_status = scan.status;
        if self.scans.len() > 2 * WAITING {
            self.scans.pop_front();
        }
        self.scans.push_back(scan.clone());
        self.rock_tests.scan(scan);
    }

    /// Time has jumped: another drive, another place of a replay, or a board that has booted.
    fn begin_anew(&mut self) {
        self.track = Track::default();
        self.history.clear();
        self.scans.clear();
        self.gathered.clear();
        (self.seen.pose, self.motion.station_m) = (None, None);
        (self.senses.scan_hz, self.senses.pose_hz) = (0.0, 0.0);
        self.hub.lock().forget();
        self.rock_tests.break_off();
    }

    fn pose(&mut self, pose: &Pose) {
        if let Some((_, before)) = self.seen.pose {
            let step_us = pose.time.since(before);
            if step_us > 0 {
                follow(&mut self.senses.pose_hz, 1e6 / step_us as f64);
            }
        }
        self.seen.pose = Some((Instant::now(), pose.time));
        (self.senses.pose_status, self.senses.timed_by_pulse) = (pose.status, pose.timed_by_pulse);
        self.history.push(pose);
        self.track.push(pose);
        let position = self.track.at(pose.time.offset(-1));
        self.motion.gps = position.gps;
        if Quality::of(pose.status).has_attitude() {
            self.motion.heading_deg = degrees(pose.azimuth);
        }
        if let Some(fix) = track::fix(pose) {
            let [north, east, _] = fix.velocity_mm_s.map(|mm| f64::from(mm) * 1e-3);
            let speed = north.hypot(east);
            self.motion.speed_m_s = Some(speed);
            let fast = speed > WALKING_M_S;
            self.motion.points_per_mile = fast.then(|| self.senses.scan_hz * MILE_M / speed);
            if let Some(station_m) = position.station_m {
                self.motion.station_m = Some(station_m);
                self.motion.place_m = Some(self.hub.lock().sketch.push(&fix, station_m));
            }
        }
        self.rock_tests.pose(pose);
    }

    fn profile(&mut self, profile: &Profile) {
        self.motion.profiles += 1;
        let tilt = |left: Option<f64>, right: Option<f64>| match (left, right) {
            (Some(left), Some(right)) => Some((left - right) / 2.0),
            (Some(left), None) => Some(left),
            (None, right) => right.map(|right| -right),
        };
        // Of the levelled ground: what a perfect calibration makes 0 on level ground.
        let residual = tilt(profile.left.road.map(degrees), profile.right.road.map(degrees));
        if let Some(residual) = residual {
            self.rock_tests.residual(residual);
        }
        let slope = |slope: Option<crossfall_core::protocol::message::Slope>| slope.map(|slope| degrees(slope.angle));
        self.gathered.push(
            [
                Some(degrees(profile.roll)),
                slope(profile.left.adjacent),
                slope(profile.left.opposing),
                slope(profile.right.adjacent),
                slope(profile.right.opposing),
                residual,
                self.motion.speed_m_s,
            ]
            .map(|value| value.map_or(f32::NAN, |value| value as f32)),
        );
        if self.gathered.len() >= PROFILES_A_STRIP as usize {
            let values = std::array::from_fn(|k| mean(self.gathered.iter().map(|values| values[k])));
            self.gathered.clear();
            self.hub.lock().strip(Strip { time_s: profile.time.0 as f64 * 1e-6, values });
        }
        if self.section_at.is_some_and(|shown| shown.elapsed() < SECTIONS) {
            return;
        }
        let Some(scan) = self.scans.iter().rev().find(|scan| scan.index == profile.scan) else { return };
        self.section_at = Some(Instant::now());
        let roll = self.history.over_scan(scan, profile.time, &self.config.attitude);
        level(scan, &roll.track, &self.config.scanner, &mut self.points);
        self.hub.lock().show(Section::new(profile, &self.points));
    }

    fn status(&mut self, status: &Status) {
        let counters = crate::counters::of(status);
        let first = !std::mem::replace(&mut self.status_known, true);
        let now = Some(Instant::now());
        for name in of_the_board() {
            let value = counters.get(name).copied().unwrap_or(0);
            if self.faults.counter(name, value, first) {
                let line = match name {
                    _ if name.starts_with("lidar") || name.starts_with("scans_") => 0,
                    _ if name.starts_with("ins") || name.starts_with("poses") => 1,
                    _ => 2,
                };
                // Spurious pulses are no loss.
                if !name.starts_with("pulses") {
                    self.losses_at[line] = now;
                }
            }
        }
    }

    fn marker(&mut self, marker: &Marker) {
        self.marker_count += 1;
        if self.markers.len() == MOST_MARKERS {
            self.markers.pop_front();
        }
        self.markers.push_back(MarkerState {
            number: marker.number,
            label: marker.label.text().to_owned(),
            time_s: marker.time.0 as f64 * 1e-6,
            station_m: self.motion.station_m,
            place_m: self.motion.place_m,
        });
    }

    fn notice(&mut self, notice: &Notice) {
        match notice {
            Notice::Gone { why } => {
                self.senses.gone = Some(why.clone());
                self.faults
                    .note(notice.to_string(), "Check the cable between board and computer and the board's power.");
            }
            Notice::Back => {
                self.senses.gone = None;
                // What has stayed away shows once there was time for it to come.
                let Seen { scan, pose, .. } = std::mem::take(&mut self.seen);
                let now = |seen: Option<(Instant, DeviceTime)>| seen.map(|(_, time)| (Instant::now(), time));
                self.seen = Seen { scan: now(scan), pose: now(pose), ..Seen::default() };
            }
            Notice::Restarted { .. } => {
                self.faults.note(notice.to_string(), "Check the board's power supply; what was under way is lost.");
                self.faults.restart();
                self.begin_anew();
            }
            Notice::Silent => self.faults.note(notice.to_string(), "Check the board's power."),
            Notice::Overflow { .. } => {
                self.faults.note(notice.to_string(), "Record to an internal disk and close other programs.");
            }
            Notice::InForce { again: true, .. } => {
                self.faults.note(
                    notice.to_string(),
                    "Slopes are right again; the log holds each configuration where it began.",
                );
            }
            Notice::Unconfigured { .. } | Notice::Changed { .. } => {
                self.faults.note(
                    notice.to_string(),
                    "Put the right configuration in force under Setup: every slope is off by the offset.",
                );
            }
            Notice::LastFile => {
                self.faults.note(notice.to_string(), "Record to another folder, or under another name.")
            }
            Notice::NoNextFile { .. } => self
                .faults
                .note(notice.to_string(), "Look after the folder, or record to another one: nothing is lost so far."),
            Notice::Mute { .. } => self.faults.note(notice.to_string(), "Connect where commands can be sent."),
            Notice::Board { .. } | Notice::InForce { .. } | Notice::NextFile => {}
        }
    }

    /// Tells viewers the state.
    pub fn tell(&mut self) {
        let replay = self.controls.as_ref().map(|controls| *controls.lock());
        let (recording, last_recording, disk_error, summary) = {
            let shared = self.shared.lock().unwrap_or_else(PoisonError::into_inner);
            (shared.recording.clone(), shared.last.clone(), shared.disk_error.clone(), shared.summary.clone())
        };
        for (name, value) in [
            ("link.missing_frames", summary.missing_frames),
            ("link.unknown_gaps", summary.unknown_gaps),
            ("link.bad_frames", summary.bad_frames),
            ("link.bytes_lost", summary.bytes_lost),
        ] {
            if self.faults.counter(name, value, false) {
                self.losses_at[2] = Some(Instant::now());
            }
        }
        if self.disk_at.is_none_or(|looked| looked.elapsed() >= DISK) {
            self.disk_at = Some(Instant::now());
            self.senses.disk_free = free_bytes(&self.source.folder);
        }
        // Between two sessions the survey stands still as it should.
        let between = matches!(recording.phase, Phase::Starting | Phase::Ending);
        let senses = Senses {
            standing: replay.is_some_and(|replay| replay.paused || replay.ended),
            surveying: self.senses.surveying || between,
            disk_error,
            unconfigured: summary.unconfigured,
            ..self.aged()
        };
        let motion = self.moving(&senses);
        let state = State {
            kind: "state",
            source: self.source.clone(),
            board: self.board.clone(),
            lamps: Lamps {
                lidar: lamps::lidar(&senses),
                ins: lamps::ins(&senses),
                pulse: lamps::pulse(&senses),
                disk: lamps::disk(&senses),
                link: lamps::link(&senses),
            },
            recording_amiss: recording.told(last_recording.as_ref()),
            recording,
            last_recording,
            replay,
            losses: self.faults.counters().clone(),
            faults: self.faults.recent(),
            fault_count: self.faults.count,
            motion,
            markers: self.markers.iter().cloned().collect(),
            marker_count: self.marker_count,
            config_number: self.config_number,
            configuration: (self.config_number > 0).then(|| gist(&self.config)),
            rock_test: self.rock_tests.told(),
            unviewed_frames: self.unheard.load(Ordering::Relaxed),
        };
        self.hub.lock().tell(state);
    }

    /// What is sensed, with its ages as of now.
    fn aged(&self) -> Senses {
        let now = Instant::now();
        let age = |seen: Option<Instant>| seen.map(|seen| now.saturating_duration_since(seen));
        Senses {
            heard_for: age(self.seen.first_frame).unwrap_or_default(),
            frame_age: age(self.seen.frame),
            scan_age: age(self.seen.scan.map(|(at, _)| at)),
            pose_age: age(self.seen.pose.map(|(at, _)| at)),
            pulse_age: age(self.seen.pulse),
            recent: self.losses_at.map(|at| age(at).is_some_and(|age| age < RECENT)),
            ..self.senses.clone()
        }
    }

    /// How the vehicle moves now: what comes no more says nothing of it.
    fn moving(&self, senses: &Senses) -> Motion {
        let comes = |age: Option<Duration>| senses.gone.is_none() && age.is_some_and(|age| age <= PRESENT);
        let (scans, poses) = (comes(senses.scan_age), comes(senses.pose_age));
        Motion {
            scan_hz: if scans { senses.scan_hz } else { 0.0 },
            speed_m_s: self.motion.speed_m_s.filter(|_| poses),
            points_per_mile: self.motion.points_per_mile.filter(|_| scans && poses),
            ..self.motion
        }
    }
}

fn follow(rate: &mut f64, now: f64) {
    *rate = if *rate == 0.0 { now } else { *rate + FOLLOW * (now - *rate) };
}

/// The mean of those that are numbers.
fn mean(values: impl Iterator<Item = f32>) -> f32 {
    let (sum, count) = values.filter(|v| !v.is_nan()).fold((0.0, 0.0), |(sum, count), v| (sum + v, count + 1.0));
    if count > 0.0 { sum / count } else { f32::NAN }
}

/// Bytes that may still be written to a folder.
fn free_bytes(folder: &str) -> Option<u64> {
    fs4::available_space(folder).ok()
}
