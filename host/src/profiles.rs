//! The table of profiles: one row per scan and side, its columns fixed for other programs to rely on.

use std::collections::VecDeque;
use std::io::Write;
use std::path::Path;

use crossfall_core::protocol::frame::Gap;
use crossfall_core::protocol::message::{self, Message, Profile, Slope, flags};
use crossfall_core::protocol::{Angle, DeviceTime};

use crate::container::Error;
use crate::geodesy::{Geodetic, shifted};
use crate::side::Side;
use crate::stream::{Item, Stream};
use crate::table::{self, Column, Format, Kind, Record, Shape, Table, Value};
use crate::track::{Position, Track};
use crate::units::{degrees, metres};

/// The columns, in order.
pub const COLUMNS: [Column; 23] = [
    ("scan", Kind::Integer),
    ("device_time_us", Kind::Integer),
    ("gps_week", Kind::Integer),
    ("gps_seconds", Kind::Real(6)),
    ("latitude_deg", Kind::Real(9)),
    ("longitude_deg", Kind::Real(9)),
    ("height_m", Kind::Real(3)),
    ("station_m", Kind::Real(3)),
    ("roll_deg", Kind::Real(5)),
    ("side", Kind::Text),
    ("road_slope_deg", Kind::Real(5)),
    ("edge_y_m", Kind::Real(4)),
    ("adjacent_slope_deg", Kind::Real(5)),
    ("adjacent_slope_ci95_deg", Kind::Real(5)),
    ("adjacent_length_m", Kind::Real(4)),
    ("adjacent_points", Kind::Integer),
    ("adjacent_end_y_m", Kind::Real(4)),
    ("opposing_slope_deg", Kind::Real(5)),
    ("opposing_slope_ci95_deg", Kind::Real(5)),
    ("opposing_length_m", Kind::Real(4)),
    ("opposing_points", Kind::Integer),
    ("opposing_end_y_m", Kind::Real(4)),
    ("flags", Kind::Text),
];

/// Flags that the host adds to those of the board, in bits that the link does not use.
pub mod host_flags {
    /// No position: poses without a fix, or none around the scan.
    pub const NO_POSITION: u16 = 1 << 14;
    /// The station rests on a speed that was held, see [`crate::track`].
    pub const STATION_ESTIMATED: u16 = 1 << 15;
}

/// Flags of a section that is not to be relied on: what is said of several sections together leaves it out and counts it.
pub const UNRELIABLE: u16 = flags::DOUBTFUL | flags::NO_ATTITUDE;

/// How many `what`, such as `section`, were left out as [`UNRELIABLE`], in words.
#[must_use]
pub fn left_out(count: u64, what: &str) -> String {
    let are = if count == 1 { " is" } else { "s are" };
    format!("{count} {what}{are} left out as unreliable (doubtful, no_attitude)")
}

/// One side of one scan, in the units of the table.
#[derive(Clone, Debug, PartialEq)]
pub struct Row {
    /// Number of the scan in its stream.
    pub scan: u32,
    /// Instant of its first beam.
    pub time: DeviceTime,
    /// Where the sensor was then.
    pub position: Position,
    /// Roll at straight down, in degrees; without the mounting offset.
    pub roll_deg: f64,
    /// Which.
    pub side: Side,
    /// Slope of the road in degrees, positive = rising outward.
    pub road_slope_deg: Option<f64>,
    /// Lateral distance of the road's edge in metres, left positive.
    pub edge_y_m: Option<f64>,
    /// The adjacent slope.
    pub adjacent: Option<SlopeRow>,
    /// The opposing slope.
    pub opposing: Option<SlopeRow>,
    /// Flags of the scan and of the side, and [`host_flags`].
    pub flags: u16,
}

/// One slope, in the units of the table.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SlopeRow {
    /// Inclination in degrees, positive = rising outward.
    pub slope_deg: f64,
    /// Half width of its 95 % interval; absent where the method gives none.
    pub ci95_deg: Option<f64>,
    /// Length along the slope in metres.
    pub length_m: f64,
    /// Points that support it.
    pub points: u16,
    /// Lateral distance of its outer end in metres, left positive.
    pub end_y_m: f64,
}

impl SlopeRow {
    fn of(slope: &Slope) -> Self {
        Self {
            slope_deg: degrees(slope.angle),
            ci95_deg: (slope.ci95 != Angle::ZERO).then(|| degrees(slope.ci95)),
            length_m: metres(slope.length_um),
            points: slope.points,
            end_y_m: metres(slope.end.y_um),
        }
    }
}

impl Row {
    fn of(profile: &Profile, side: Side, position: Position) -> Self {
        let message::Side { road, edge, adjacent, opposing, flags } = side.of(profile);
        Self {
            scan: profile.scan,
            time: profile.time,
            position,
            roll_deg: degrees(profile.roll),
            side,
            road_slope_deg: road.map(degrees),
            edge_y_m: edge.map(|edge| metres(edge.y_um)),
            adjacent: adjacent.as_ref().map(SlopeRow::of),
            opposing: opposing.as_ref().map(SlopeRow::of),
            flags: profile.flags | flags | position_flags(&position),
        }
    }

    /// The place on the map of something at a lateral distance from the sensor (left positive), at the sensor's height.
    #[must_use]
    pub fn place(&self, y_m: f64) -> Option<Geodetic> {
        let (geodetic, turn) = self.position.geodetic.zip(self.position.turn)?;
        let [east, north, _] = turn.of_level([0.0, y_m, 0.0]);
        Some(shifted(geodetic, [east, north, 0.0]))
    }

    /// Whether it does not say itself [`UNRELIABLE`].
    #[must_use]
    pub fn is_reliable(&self) -> bool {
        self.flags & UNRELIABLE == 0
    }
}

impl Record for Row {
    const COLUMNS: &'static [Column] = &COLUMNS;

    fn cells(&self, into: &mut Vec<Value>) {
        let Position { gps, geodetic, station_m, .. } = self.position;
        let geodetic = |axis: usize| Value::from(geodetic.map(|place| place[axis]));
        into.extend([
            Value::Integer(self.scan.into()),
            // A device time is below 2^63: 292,000 years.
            Value::Integer(self.time.0 as i64),
            gps.map(|(week, _)| i64::from(week)).into(),
            gps.map(|(_, seconds)| seconds).into(),
            geodetic(0),
            geodetic(1),
            geodetic(2),
            station_m.into(),
            Value::Real(self.roll_deg),
            Value::Text(self.side.name().into()),
            self.road_slope_deg.into(),
            self.edge_y_m.into(),
        ]);
        for slope in [self.adjacent, self.opposing] {
            into.extend([
                slope.map(|s| s.slope_deg).into(),
                slope.and_then(|s| s.ci95_deg).into(),
                slope.map(|s| s.length_m).into(),
                slope.map(|s| i64::from(s.points)).into(),
                slope.map(|s| s.end_y_m).into(),
            ]);
        }
        into.push(Value::Text(flag_names(self.flags).into()));
    }

    fn shapes(&self) -> Vec<(&'static str, Shape)> {
        self.position.geodetic.map(|place| ("profile", Shape::Point(place))).into_iter().collect()
    }

    fn vertex(&self) -> Option<(&'static str, Geodetic)> {
        Some((self.side.edge_name(), self.place(self.edge_y_m?)?))
    }
}

/// The two rows of a profile, left before right.
#[must_use]
pub fn sides(profile: &Profile, position: Position) -> [Row; 2] {
    Side::BOTH.map(|side| Row::of(profile, side, position))
}

fn position_flags(position: &Position) -> u16 {
    let mut flags = 0;
    if position.geodetic.is_none() {
        flags |= host_flags::NO_POSITION;
    }
    if position.station_estimated {
        flags |= host_flags::STATION_ESTIMATED;
    }
    flags
}

/// Names of the bits that are set, separated by `|`.
#[must_use]
pub fn flag_names(set: u16) -> String {
    if set == 0 {
        return String::new();
    }
    let board = flags::NAMES.iter().enumerate().map(|(bit, name)| (1 << bit, *name));
    let host = [(host_flags::NO_POSITION, "no_position"), (host_flags::STATION_ESTIMATED, "station_estimated")];
    let names = board.chain(host).filter(|(flag, _)| set & flag != 0).map(|(_, name)| name);
    names.collect::<Vec<_>>().join("|")
}

/// The rows of a log, in the order of its profiles, left side before right.
#[derive(Debug)]
pub struct Rows {
    stream: Stream,
    track: Track,
    ready: VecDeque<Row>,
}

impl Rows {
    /// Opens a log.
    ///
    /// # Errors
    /// As of [`Stream::open`].
    pub fn open(path: &Path) -> Result<Self, Error> {
        Ok(Self { stream: Stream::open(path)?, track: Track::default(), ready: VecDeque::new() })
    }

    /// Damaged parts, broken frames and gaps passed so far.
    #[must_use]
    pub fn damage(&self) -> u64 {
        self.stream.losses()
    }

    /// How far the log has been read, in bytes of all its files.
    #[must_use]
    pub fn offset(&self) -> u64 {
        self.stream.reached()
    }
}

impl Iterator for Rows {
    type Item = Row;

    fn next(&mut self) -> Option<Row> {
        while self.ready.is_empty() {
            let (_, item) = self.stream.next()?;
            let Item::Message { message, gap } = item else { continue };
            if gap == Gap::Restarted {
                self.track.restart();
            }
            match message {
                Message::Pose(pose) => self.track.push(&pose),
                Message::Clock(clock) => self.track.clock(&clock),
                Message::Config(config) => self.track.configure(&config),
                Message::Profile(profile) => {
                    self.ready.extend(sides(&profile, self.track.at(profile.time)));
                }
                _ => {}
            }
        }
        self.ready.pop_front()
    }
}

/// Writes rows as CSV and says how many there were.
///
/// # Errors
/// When `out` cannot be written.
pub fn write_csv(rows: &mut Rows, out: impl Write + Send) -> Result<u64, table::Error> {
    let mut table = Table::new(Format::Csv, out)?;
    let mut count = 0;
    for row in rows {
        table.row(&row)?;
        count += 1;
    }
    table.finish()?;
    Ok(count)
}
