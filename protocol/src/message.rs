//! The messages of the link: [`Message`] from the board, [`Command`] to it.

use postcard_schema::Schema;
use serde::{Deserialize, Serialize};

use crate::config::{Config, Method};
use crate::ranges::{self, MAX_VALUES, RangeError};
use crate::scan_wire::as_bytes;
use crate::units::{Angle, DeviceTime};

/// What the board sends. The order of the variants is their number on the wire: append, never insert.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, Schema)]
pub enum Message<'a> {
    /// First frame after boot and the answer to [`Command::Identify`].
    #[serde(borrow)]
    Hello(Hello<'a>),
    /// The configuration in force for all that follows.
    Config(Config),
    /// One scan, ranges coded without loss.
    #[serde(borrow)]
    Scan(Scan<'a>),
    /// One pose of the inertial unit.
    Pose(Pose),
    /// One edge of the pulse per second.
    Pulse(Pulse),
    /// The device/GPS mapping, whenever a pulse has updated it.
    Clock(ClockState),
    /// The result of one scan.
    Profile(Profile),
    /// Counters and states, once a second.
    Status(Status),
    /// A line of text, or a piece of a defmt stream, from the firmware.
    #[serde(borrow)]
    Log(LogLine<'a>),
    /// The answer to a command.
    Reply(Reply),
    /// The survey starts or stops.
    Session(Session),
    /// What the next frame carries did not enter the survey.
    Skip(Skip),
    /// Something that the operator wants to find again.
    Marker(Marker),
}

/// Who the board is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, Schema)]
pub struct Hello<'a> {
    /// Hash of the message schema, see [`HASH`](crate::schema::HASH).
    pub schema: u64,
    /// Name and version of the firmware, for example `crossfall 0.1.0`; at most [`MAX_NAME`](crate::frame::MAX_NAME) bytes.
    pub firmware: &'a str,
    /// Name of the board, for example `olimex-stm32-h405`; at most [`MAX_NAME`](crate::frame::MAX_NAME) bytes.
    pub board: &'a str,
    /// Number of this boot, 0 when the board cannot count them.
    pub boot: u32,
    /// Why the board restarted: empty after power-on, else a reset cause or the text of a panic; at most
    /// [`MAX_TEXT`](crate::frame::MAX_TEXT) bytes.
    pub restart: &'a str,
}

/// One scan as the sensor sent it. It is the largest of the frequent messages: `scan_wire` packs it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Scan<'a> {
    /// 0-based number of the scan in its stream.
    pub index: u32,
    /// Arrival of the telegram's first byte.
    pub stx: DeviceTime,
    /// The telegram's count word: number of values, partial scan, unit (TL, command B0h).
    pub layout: u16,
    /// Angular range and resolution and measuring mode in force.
    pub mode: ScanMode,
    /// The telegram's status byte.
    pub status: u8,
    /// Scan index and telegram index, when the scanner sends them.
    pub counters: Option<[u8; 2]>,
    /// The values, coded by [`ranges::encode`](crate::ranges::encode); [`Scan::values`] has them back.
    pub code: &'a [u8],
}

impl Scan<'_> {
    /// The values as the scanner sent them, as many as the count word says, decoded into `out`.
    ///
    /// # Errors
    /// [`RangeError`] when the code is not one that [`ranges::encode`](crate::ranges::encode) makes for this scan.
    pub fn values<'b>(&self, out: &'b mut [u16; MAX_VALUES]) -> Result<&'b [u16], RangeError> {
        ranges::decode(self.layout, self.mode, self.code, out)
    }
}

/// How a scan is to be read.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, Schema)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct ScanMode {
    /// Angle of the whole scan in degrees: 180 or 100.
    pub span_deg: u8,
    /// Angle between beams in hundredths of a degree: 100, 50 or 25.
    pub step_cdeg: u8,
    /// LMS measuring mode, 00h to 06h.
    pub measuring: u8,
}

impl ScanMode {
    /// Bits of a value that are the range, by the measuring mode of an LMS 2xx (telegram listing, command B0h); those above are flags. An unknown mode
    /// is read as the usual one, 06h.
    #[must_use]
    pub const fn value_bits(self) -> u32 {
        match self.measuring {
            0..=2 => 13,
            3 | 4 => 14,
            _ => 15,
        }
    }
}

/// One pose. Angles by SPAN's signs: roll positive = right side down, pitch positive = nose up, azimuth clockwise from north.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, Schema)]
pub struct Pose {
    /// The instant at which the pose is valid.
    pub time: DeviceTime,
    /// How much later its first byte arrived, in microseconds.
    pub latency_us: i32,
    /// True when `time` comes from pulses, false when it is arrival minus the configured latency.
    pub timed_by_pulse: bool,
    /// GPS week.
    pub gps_week: u16,
    /// Microseconds into that week.
    pub gps_us: u64,
    /// Roll.
    pub roll: Angle,
    /// Pitch.
    pub pitch: Angle,
    /// Azimuth.
    pub azimuth: Angle,
    /// Position and velocity, absent from attitude-only logs.
    pub fix: Option<Fix>,
    /// INS status as the unit sent it (3 = good).
    pub status: u8,
}

/// Position (WGS 84) and velocity of a pose.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, Schema)]
pub struct Fix {
    /// Latitude in 1e-9 degrees.
    pub latitude_ndeg: i64,
    /// Longitude in 1e-9 degrees.
    pub longitude_ndeg: i64,
    /// Ellipsoid height in millimetres.
    pub height_mm: i32,
    /// Velocity north, east and up in millimetres a second.
    pub velocity_mm_s: [i32; 3],
}

/// One edge of the pulse per second.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, Schema)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Pulse {
    /// The edge.
    pub time: DeviceTime,
    /// What the clock made of it.
    pub verdict: PulseVerdict,
}

/// What the clock made of a pulse.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, Schema)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum PulseVerdict {
    /// It continues the second count.
    Accepted,
    /// It fits no whole second of the mapping and is not used.
    Spurious,
    /// The mapping was started (again) from it.
    Restarted,
}

/// The mapping between device time and GPS time: `gps = gps_us + (device - anchor) * (1 - drift)`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, Schema)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct ClockState {
    /// Device time of the anchor.
    pub anchor: DeviceTime,
    /// GPS week and microseconds into it at the anchor; absent until a pose has named the second.
    pub gps: Option<(u16, u64)>,
    /// How fast the device clock runs against GPS, in parts per 2^32 (positive = fast); 0 until two pulses are known.
    pub drift: i32,
    /// Number of pulses that the mapping rests on.
    pub pulses: u8,
}

/// The result of one scan.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, Schema)]
pub struct Profile {
    /// Number of the scan.
    pub scan: u32,
    /// Instant of its first beam.
    pub time: DeviceTime,
    /// The algorithm that made it.
    pub method: Method,
    /// Union of [`flags`] that concern the whole scan.
    pub flags: u16,
    /// Roll (without the mounting offset) at the beam that looks straight down.
    pub roll: Angle,
    /// Sections to the left and to the right of the vehicle.
    pub left: Side,
    /// See `left`.
    pub right: Side,
}

/// One side of a section.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, Schema)]
pub struct Side {
    /// Slope of the road, positive = rising outward; absent when no road line was found.
    pub road: Option<Angle>,
    /// The road's edge, where the adjacent slope begins.
    pub edge: Option<Hinge>,
    /// Adjacent slope (foreslope).
    pub adjacent: Option<Slope>,
    /// Opposing slope (backslope).
    pub opposing: Option<Slope>,
    /// Union of [`flags`] that concern this side.
    pub flags: u16,
}

/// A place where one line gives way to the next, as a signed lateral distance from the sensor (left positive).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, Schema)]
pub struct Hinge {
    /// Best estimate: the intersection of the fitted lines where there is one, else the point of significant departure.
    pub y_um: i32,
    /// Half width of its 95 % interval; 0 when unknown.
    pub ci95_um: u32,
    /// The point of significant departure.
    pub departure_um: i32,
}

/// One slope.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, Schema)]
pub struct Slope {
    /// Inclination, positive = rising outward.
    pub angle: Angle,
    /// Half width of its 95 % interval, as an angle.
    pub ci95: Angle,
    /// Length along the slope.
    pub length_um: i32,
    /// Number of points that support it.
    pub points: u16,
    /// Its inner end: the road edge, or the foot of the opposing slope.
    pub start: Hinge,
    /// Its outer end.
    pub end: Hinge,
}

/// Bits of `flags`.
pub mod flags {
    /// No attitude: roll 0 was used.
    pub const NO_ATTITUDE: u16 = 1 << 0;
    /// Roll was held past the newest pose.
    pub const ATTITUDE_HELD: u16 = 1 << 1;
    /// The pose was in a degraded state (high variance or free inertial).
    pub const ATTITUDE_DEGRADED: u16 = 1 << 2;
    /// Pose times come from arrivals, not from pulses.
    pub const TIME_BY_ARRIVAL: u16 = 1 << 3;
    /// The scanner reported a warning or an error in its status byte.
    pub const SCANNER_STATUS: u16 = 1 << 4;
    /// No road line was found under the sensor.
    pub const NO_ROAD: u16 = 1 << 5;
    /// Departure and intersection disagree: a rounded hinge or something in between.
    pub const HINGE_ROUNDED: u16 = 1 << 6;
    /// Many returns lie above the line: vegetation.
    pub const VEGETATION: u16 = 1 << 7;
    /// Something stands between the edge and the slope, or hides part of it.
    pub const OBSTRUCTED: u16 = 1 << 8;
    /// The section ends before the slope does: its outer end is not seen.
    pub const END_UNSEEN: u16 = 1 << 9;
    /// The measurement is less certain than its interval says.
    pub const DOUBTFUL: u16 = 1 << 10;
    /// The scan is not one whole half circle (another resolution, or part of it).
    pub const PARTIAL_SCAN: u16 = 1 << 11;
    /// Name of each bit, in order, as written to the `flags` column.
    pub const NAMES: [&str; 12] = [
        "no_attitude",
        "attitude_held",
        "attitude_degraded",
        "time_by_arrival",
        "scanner_status",
        "no_road",
        "hinge_rounded",
        "vegetation",
        "obstructed",
        "end_unseen",
        "doubtful",
        "partial_scan",
    ];
}

/// Counters since boot and states, once a second. Every loss has a counter.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, Schema)]
pub struct Status {
    /// When it was taken.
    pub time: DeviceTime,
    /// The scanner's line.
    pub lidar: LineCounters,
    /// The inertial unit's line.
    pub ins: LineCounters,
    /// Scans decoded.
    pub scans: u32,
    /// Scans that the telegram index proves missing.
    pub scans_missing: u32,
    /// Whole scan telegrams of an unknown layout.
    pub scans_unreadable: u32,
    /// Scans without a profile because the survey could not keep up.
    pub scans_skipped: u32,
    /// Poses decoded.
    pub poses: u32,
    /// Whole logs of the inertial unit with a field that is no number or out of range.
    pub poses_unreadable: u32,
    /// Pulses accepted.
    pub pulses: u32,
    /// Pulses found spurious.
    pub pulses_spurious: u32,
    /// Pulses whose capture was overrun by the next edge.
    pub pulses_overrun: u32,
    /// Frames that found no room on the link.
    pub frames_dropped: u32,
    /// Commands that were not understood.
    pub commands_rejected: u32,
}

/// Counters of one sensor line. `bytes` = bytes of good frames + `skipped` + those of a frame under way.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, Schema)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct LineCounters {
    /// Bytes received.
    pub bytes: u64,
    /// Frames that passed their check.
    pub frames: u32,
    /// Frames whose check failed.
    pub bad_frames: u32,
    /// Bytes that belonged to no good frame.
    pub skipped: u64,
    /// Receiver overruns and bytes without room: bytes lost before they were seen.
    pub overruns: u32,
}

/// A line of text, or raw defmt bytes, from the firmware.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, Schema)]
pub struct LogLine<'a> {
    /// When.
    pub time: DeviceTime,
    /// How grave; [`Level::Defmt`] marks a piece of a defmt stream.
    pub level: Level,
    /// UTF-8 text or defmt bytes, at most [`MAX_TEXT`](crate::frame::MAX_TEXT).
    #[serde(borrow, serialize_with = "as_bytes")]
    pub text: &'a [u8],
}

/// Gravity of a log line.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, Schema)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Level {
    /// Something failed.
    Error,
    /// Something is not as it should be.
    Warn,
    /// Something worth knowing.
    Info,
    /// Bytes of a defmt stream.
    Defmt,
}

/// The answer to a command.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, Schema)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Reply {
    /// The sequence number of the command's frame.
    pub to: u16,
    /// What came of it.
    pub outcome: Outcome,
}

/// What came of a command.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, Schema)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Outcome {
    /// Done.
    Done,
    /// The configuration contradicts itself or is out of range; the old one stays in force.
    BadConfig,
    /// The frame was whole but not understood.
    Unknown,
    /// The answer to [`Command::Ping`], its number returned.
    Pong(u32),
}

/// Sent just before a scan or pose that the board streams but had no time to survey, so that a host that repeats the survey leaves it out too.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, Schema)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Skip {
    /// The scan with this index.
    Scan(u32),
    /// The pose with this time.
    Pose(DeviceTime),
}

/// A border of the survey.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, Schema)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Session {
    /// The survey begins with empty histories.
    Started(DeviceTime),
    /// No more scans enter. Those that wait are measured with the attitude there is; their profiles follow.
    Stopped(DeviceTime),
}

/// A place in the stream that the operator wants to find again. It is no input of the survey.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, Schema)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Marker {
    /// When the board was told.
    pub time: DeviceTime,
    /// 0-based number of the marker since boot.
    pub number: u32,
    /// What the operator called it.
    pub label: Label,
}

/// A marker's name: up to [`Label::MAX`] bytes of UTF-8, filled up with zeros.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, Schema)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[serde(transparent)]
pub struct Label(pub [u8; Self::MAX]);

impl Label {
    /// Longest name in bytes.
    pub const MAX: usize = 24;

    /// The label of a text, without what is longer than [`Label::MAX`]; cut between characters.
    #[must_use]
    pub fn new(text: &str) -> Self {
        let mut label = Self::default();
        let mut left = label.0.iter_mut();
        for character in text.chars().filter(|&character| character != '\0') {
            if left.len() < character.len_utf8() {
                break;
            }
            let mut bytes = [0; 4];
            let coded = character.encode_utf8(&mut bytes).bytes();
            for (into, byte) in left.by_ref().take(character.len_utf8()).zip(coded) {
                *into = byte;
            }
        }
        label
    }

    /// Its text as far as it is UTF-8, without the zeros at its end.
    #[must_use]
    pub fn text(&self) -> &str {
        let bytes = self.0.split(|&byte| byte == 0).next().unwrap_or_default();
        match core::str::from_utf8(bytes) {
            Ok(text) => text,
            Err(error) => core::str::from_utf8(bytes.get(..error.valid_up_to()).unwrap_or_default()).unwrap_or(""),
        }
    }
}

/// What the host sends. The order of the variants is their number on the wire: append, never insert.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, Schema)]
pub enum Command {
    /// Say hello, configuration and clock again.
    Identify,
    /// Return this number.
    Ping(u32),
    /// Put this configuration in force.
    Configure(Config),
    /// Start the survey afresh.
    Start,
    /// Work off what is waiting and stop.
    Stop,
    /// Put a marker into the stream.
    Mark(Label),
    /// Bring a sensor up again from the start, as after power-on.
    Restart(Sensor),
}

/// One of the sensors.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, Schema)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Sensor {
    /// The laser scanner.
    Lidar,
    /// The inertial unit.
    Ins,
}
