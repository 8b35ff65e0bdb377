//! The table of profiles: one row per scan and side, its columns fixed for other programs to rely on.

use std::collections::VecDeque;
use std::io::Write;
use std::path::Path;

use crossfall_core::protocol::frame::Gap;
use crossfall_core::protocol::message::{Message, Profile, Side, Slope, flags};
use crossfall_core::protocol::{Angle, DeviceTime};

use crate::container::Error;
use crate::stream::{Item, Stream};
use crate::track::{Position, Track};

/// Column names, in order.
pub const COLUMNS: [&str; 23] = [
    "scan",
    "device_time_us",
    "gps_week",
    "gps_seconds",
    "latitude_deg",
    "longitude_deg",
    "height_m",
    "station_m",
    "roll_deg",
    "side",
    "road_slope_deg",
    "edge_y_m",
    "adjacent_slope_deg",
    "adjacent_slope_ci95_deg",
    "adjacent_length_m",
    "adjacent_points",
    "adjacent_end_y_m",
    "opposing_slope_deg",
    "opposing_slope_ci95_deg",
    "opposing_length_m",
    "opposing_points",
    "opposing_end_y_m",
    "flags",
];

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
    /// True for the left side.
    pub left: bool,
    /// Slope of the road in degrees, positive = rising outward.
    pub road_slope_deg: Option<f64>,
    /// Lateral distance of the road's edge in metres, left positive.
    pub edge_y_m: Option<f64>,
    /// The adjacent slope.
    pub adjacent: Option<SlopeRow>,
    /// The opposing slope.
    pub opposing: Option<SlopeRow>,
    /// Flags of the scan and of the side.
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

/// Degrees of a binary angle.
#[must_use]
pub fn degrees(angle: Angle) -> f64 {
    f64::from(angle.0) * (360.0 / 4_294_967_296.0)
}

fn metres(micrometres: i32) -> f64 {
    f64::from(micrometres) * 1e-6
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
    fn of(profile: &Profile, side: &Side, left: bool, position: Position) -> Self {
        Self {
            scan: profile.scan,
            time: profile.time,
            position,
            roll_deg: degrees(profile.roll),
            left,
            road_slope_deg: side.road.map(degrees),
            edge_y_m: side.edge.map(|edge| metres(edge.y_um)),
            adjacent: side.adjacent.as_ref().map(SlopeRow::of),
            opposing: side.opposing.as_ref().map(SlopeRow::of),
            flags: profile.flags | side.flags,
        }
    }

    /// The cells, in the order of [`COLUMNS`]; empty = not found or not known.
    #[must_use]
    pub fn cells(&self) -> [String; 23] {
        let fixed = |value: Option<f64>, digits: usize| value.map_or_else(String::new, |v| format!("{v:.digits$}"));
        let slope = |slope: Option<SlopeRow>| {
            [
                fixed(slope.map(|s| s.slope_deg), 5),
                fixed(slope.and_then(|s| s.ci95_deg), 5),
                fixed(slope.map(|s| s.length_m), 4),
                slope.map_or_else(String::new, |s| s.points.to_string()),
                fixed(slope.map(|s| s.end_y_m), 4),
            ]
        };
        let Position { gps, geodetic, station_m } = self.position;
        let [a, b, c, d, e] = slope(self.adjacent);
        let [f, g, h, i, j] = slope(self.opposing);
        [
            self.scan.to_string(),
            self.time.0.to_string(),
            gps.map_or_else(String::new, |(week, _)| week.to_string()),
            fixed(gps.map(|(_, seconds)| seconds), 6),
            fixed(geodetic.map(|g| g[0]), 9),
            fixed(geodetic.map(|g| g[1]), 9),
            fixed(geodetic.map(|g| g[2]), 3),
            fixed(station_m, 3),
            format!("{:.5}", self.roll_deg),
            if self.left { "left" } else { "right" }.to_owned(),
            fixed(self.road_slope_deg, 5),
            fixed(self.edge_y_m, 4),
            a,
            b,
            c,
            d,
            e,
            f,
            g,
            h,
            i,
            j,
            flag_names(self.flags),
        ]
    }
}

/// Names of the bits that are set, separated by `|`.
#[must_use]
pub fn flag_names(set: u16) -> String {
    let names = flags::NAMES.iter().enumerate().filter(|(bit, _)| set & 1 << bit != 0).map(|(_, name)| *name);
    names.collect::<Vec<_>>().join("|")
}

/// The rows of a log, in the order of its profiles, left side before right.
#[derive(Debug)]
pub struct Rows {
    stream: Stream,
    track: Track,
    ready: VecDeque<Row>,
    damage: u64,
}

impl Rows {
    /// Opens a log.
    ///
    /// # Errors
    /// As of [`Stream::open`].
    pub fn open(path: &Path) -> Result<Self, Error> {
        Ok(Self { stream: Stream::open(path)?, track: Track::default(), ready: VecDeque::new(), damage: 0 })
    }

    /// Damaged parts, broken frames and gaps passed so far.
    #[must_use]
    pub fn damage(&self) -> u64 {
        self.damage
    }
}

impl Iterator for Rows {
    type Item = Row;

    fn next(&mut self) -> Option<Row> {
        while self.ready.is_empty() {
            let (_, item) = self.stream.next()?;
            let Item::Message { message, gap } = item else {
                self.damage += 1;
                continue;
            };
            match gap {
                Gap::None => {}
                Gap::Missing(_) => self.damage += 1,
                Gap::Restarted => self.track.restart(),
            }
            match message {
                Message::Pose(pose) => self.track.push(&pose),
                Message::Clock(clock) => self.track.clock(&clock),
                Message::Profile(profile) => {
                    let position = self.track.at(profile.time);
                    self.ready.push_back(Row::of(&profile, &profile.left, true, position));
                    self.ready.push_back(Row::of(&profile, &profile.right, false, position));
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
pub fn write_csv(rows: &mut Rows, out: impl Write, mut progress: impl FnMut(u64)) -> csv::Result<u64> {
    let mut table = csv::Writer::from_writer(out);
    table.write_record(COLUMNS)?;
    let mut count = 0;
    for row in rows {
        table.write_record(row.cells())?;
        count += 1;
        progress(count);
    }
    table.flush()?;
    Ok(count)
}
