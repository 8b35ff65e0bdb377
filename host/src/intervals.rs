//! Slopes per stretch of road: what all scans of a stretch say together, see [`Samples`] for how. What the slope itself varies along the stretch is told
//! apart from what its value may be off by, as `sd`. Sections that say themselves [unreliable](crate::profiles::UNRELIABLE) have no part in it and are
//! counted: one that was measured without attitude is off by all of the vehicle's roll, in one direction for as long as the poses fail.

mod samples;

use std::str::FromStr;

use crate::geodesy::{Geodetic, between};
use crate::profiles::{Row, SlopeRow, flag_names};
use crate::side::Side;
use crate::table::{Column, Kind, Record, Shape, Value};

pub use samples::{Estimate, HELD, ROLL_SD_DEG, Sample, Samples};

/// Metres in a statute mile.
pub const MILE_M: f64 = 1_609.344;

/// The length of a stretch.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Every {
    /// In metres.
    pub metres: f64,
}

impl FromStr for Every {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let text = text.trim();
        let digits = text.len() - text.trim_start_matches(|c: char| c.is_ascii_digit() || c == '.').len();
        let (number, unit) = text.split_at(digits);
        let scale = match unit.trim() {
            "m" => 1.0,
            "km" => 1_000.0,
            "ft" => 0.3048,
            "mi" => MILE_M,
            _ => return Err("expected a length with its unit: 10m, 0.5km, 100ft or 0.1mi".to_owned()),
        };
        let metres = number.parse::<f64>().map_err(|_| "expected a number before the unit".to_owned())? * scale;
        if (0.1..=1e6).contains(&metres) { Ok(Self { metres }) } else { Err("expected 0.1 m to 1000 km".to_owned()) }
    }
}

/// A slope over a stretch.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SlopeOver {
    /// Its inclination in degrees, positive = rising outward.
    pub slope_deg: Estimate,
    /// Median of its length in metres.
    pub length_m: f64,
    /// Median of the lateral distance of its outer end in metres, left positive.
    pub end_y_m: f64,
}

/// One side of a stretch.
#[derive(Clone, Debug, PartialEq)]
pub struct Interval {
    /// Where it begins, in metres along the track: a whole number of stretches.
    pub from_m: f64,
    /// Where it ends.
    pub to_m: f64,
    /// Of which side.
    pub side: Side,
    /// Scans in it.
    pub scans: u64,
    /// How many of them say themselves unreliable and have no part in what follows.
    pub unreliable: u64,
    /// Slope of the road in degrees.
    pub road_slope_deg: Option<f64>,
    /// Median of the road edge's lateral distance in metres.
    pub edge_y_m: Option<f64>,
    /// The adjacent slope.
    pub adjacent: Option<SlopeOver>,
    /// The opposing slope.
    pub opposing: Option<SlopeOver>,
    /// Flags that at least a tenth of the scans have, those left out among them.
    pub flags: u16,
    /// The rows at its borders and nearest to its middle.
    first: Row,
    last: Row,
    middle: Row,
}

impl Interval {
    /// The scanner's place nearest to the middle of the stretch.
    #[must_use]
    pub fn place(&self) -> Option<Geodetic> {
        self.middle.position.geodetic
    }

    /// The band between two lateral distances, as an outline on the map.
    fn band(&self, inner_m: f64, outer_m: f64) -> Option<Shape> {
        let (a, b) = (self.first.position.geodetic?, self.last.position.geodetic?);
        let [east, north] = between(a, b);
        // A stretch without extent has no outline.
        if east.hypot(north) < 0.05 || (outer_m - inner_m).abs() < 0.01 {
            return None;
        }
        let corner = |row: &Row, y_m: f64| row.place(y_m);
        let outline = [
            corner(&self.first, inner_m)?,
            corner(&self.last, inner_m)?,
            corner(&self.last, outer_m)?,
            corner(&self.first, outer_m)?,
        ];
        Some(Shape::Polygon(outline.to_vec()))
    }
}

impl Record for Interval {
    const COLUMNS: &'static [Column] = &[
        ("station_from_m", Kind::Real(3)),
        ("station_to_m", Kind::Real(3)),
        ("side", Kind::Text),
        ("gps_week", Kind::Integer),
        ("gps_seconds", Kind::Real(6)),
        ("latitude_deg", Kind::Real(9)),
        ("longitude_deg", Kind::Real(9)),
        ("height_m", Kind::Real(3)),
        ("scans", Kind::Integer),
        ("unreliable_scans", Kind::Integer),
        ("road_slope_deg", Kind::Real(5)),
        ("edge_y_m", Kind::Real(4)),
        ("adjacent_slope_deg", Kind::Real(5)),
        ("adjacent_slope_ci95_deg", Kind::Real(5)),
        ("adjacent_slope_sd_deg", Kind::Real(5)),
        ("adjacent_scans", Kind::Integer),
        ("adjacent_length_m", Kind::Real(4)),
        ("adjacent_end_y_m", Kind::Real(4)),
        ("opposing_slope_deg", Kind::Real(5)),
        ("opposing_slope_ci95_deg", Kind::Real(5)),
        ("opposing_slope_sd_deg", Kind::Real(5)),
        ("opposing_scans", Kind::Integer),
        ("opposing_length_m", Kind::Real(4)),
        ("opposing_end_y_m", Kind::Real(4)),
        ("flags", Kind::Text),
    ];

    fn cells(&self, into: &mut Vec<Value>) {
        let middle = &self.middle.position;
        let geodetic = |axis: usize| Value::from(middle.geodetic.map(|place| place[axis]));
        into.extend([
            Value::Real(self.from_m),
            Value::Real(self.to_m),
            Value::Text(self.side.name().into()),
            middle.gps.map(|(week, _)| i64::from(week)).into(),
            middle.gps.map(|(_, seconds)| seconds).into(),
            geodetic(0),
            geodetic(1),
            geodetic(2),
            Value::Integer(self.scans as i64),
            Value::Integer(self.unreliable as i64),
            self.road_slope_deg.into(),
            self.edge_y_m.into(),
        ]);
        for slope in [self.adjacent, self.opposing] {
            into.extend([
                slope.map(|s| s.slope_deg.value).into(),
                slope.map(|s| s.slope_deg.ci95).into(),
                slope.map(|s| s.slope_deg.sd).into(),
                Value::Integer(slope.map_or(0, |s| s.slope_deg.count as i64)),
                slope.map(|s| s.length_m).into(),
                slope.map(|s| s.end_y_m).into(),
            ]);
        }
        into.push(Value::Text(flag_names(self.flags).into()));
    }

    fn shapes(&self) -> Vec<(&'static str, Shape)> {
        let mut shapes = Vec::new();
        shapes.extend(self.place().map(|place| ("stretch", Shape::Point(place))));
        if let Some((edge, adjacent)) = self.edge_y_m.zip(self.adjacent) {
            shapes.extend(self.band(edge, adjacent.end_y_m).map(|band| ("adjacent slope", band)));
            if let Some(opposing) = self.opposing {
                shapes.extend(self.band(adjacent.end_y_m, opposing.end_y_m).map(|band| ("opposing slope", band)));
            }
        }
        shapes
    }

    fn vertex(&self) -> Option<(&'static str, Geodetic)> {
        Some((self.side.edge_name(), self.middle.place(self.edge_y_m?)?))
    }
}

/// Gathers rows into stretches.
#[derive(Debug)]
pub struct Gather {
    every: Every,
    open: [Option<Stretch>; 2],
    unplaced: u64,
    unreliable: u64,
}

impl Gather {
    /// Stretches of a length.
    #[must_use]
    pub fn new(every: Every) -> Self {
        Self { every, open: [None, None], unplaced: 0, unreliable: 0 }
    }

    /// Rows without a station, which belong to no stretch.
    #[must_use]
    pub fn unplaced(&self) -> u64 {
        self.unplaced
    }

    /// Rows that were left out because they say themselves unreliable.
    #[must_use]
    pub fn unreliable(&self) -> u64 {
        self.unreliable
    }

    /// Takes in a row; gives the stretch of its side that ended before it, if one did.
    pub fn row(&mut self, row: &Row) -> Option<Interval> {
        let Some(station_m) = row.position.station_m else {
            self.unplaced += 1;
            return None;
        };
        self.unreliable += u64::from(!row.is_reliable());
        let number = (station_m / self.every.metres).floor() as i64;
        let open = &mut self.open[row.side.index()];
        if let Some(stretch) = open.as_mut().filter(|stretch| stretch.number == number) {
            stretch.add(row, station_m);
            return None;
        }
        let done = open.take();
        // Neighbouring stretches share a border on the map.
        let joined = done.as_ref().filter(|before| before.number + 1 == number).map(|before| before.last.clone());
        let first = joined.unwrap_or_else(|| row.clone());
        let mut stretch = Stretch::new(number, self.every, first, row);
        stretch.add(row, station_m);
        *open = Some(stretch);
        done.map(Stretch::close)
    }

    /// The stretches under way, left before right.
    pub fn finish(&mut self) -> impl Iterator<Item = Interval> + use<> {
        std::mem::take(&mut self.open).into_iter().flatten().map(Stretch::close)
    }
}

/// A stretch under way.
#[derive(Debug)]
struct Stretch {
    number: i64,
    every: Every,
    first: Row,
    last: Row,
    middle: Row,
    from_middle_m: f64,
    scans: u64,
    unreliable: u64,
    flags: [u64; 16],
    road: Samples,
    edge: Samples,
    slopes: [SlopeSamples; 2],
}

#[derive(Debug, Default)]
struct SlopeSamples {
    slope: Samples,
    length: Samples,
    end: Samples,
}

impl Stretch {
    fn new(number: i64, every: Every, first: Row, row: &Row) -> Self {
        Self {
            number,
            every,
            first,
            last: row.clone(),
            middle: row.clone(),
            from_middle_m: f64::INFINITY,
            scans: 0,
            unreliable: 0,
            flags: [0; 16],
            road: Samples::default(),
            edge: Samples::default(),
            slopes: Default::default(),
        }
    }

    fn add(&mut self, row: &Row, station_m: f64) {
        self.scans += 1;
        let from_middle_m = (station_m - (self.number as f64 + 0.5) * self.every.metres).abs();
        if from_middle_m < self.from_middle_m {
            self.from_middle_m = from_middle_m;
            self.middle = row.clone();
        }
        self.last = row.clone();
        for (bit, count) in self.flags.iter_mut().enumerate() {
            *count += u64::from(row.flags >> bit & 1);
        }
        if !row.is_reliable() {
            self.unreliable += 1;
            return;
        }
        let bare = |value: f64| Sample::new(value, f64::NAN, station_m);
        row.road_slope_deg.into_iter().for_each(|slope| self.road.push(bare(slope)));
        row.edge_y_m.into_iter().for_each(|edge| self.edge.push(bare(edge)));
        for (samples, slope) in self.slopes.iter_mut().zip([row.adjacent, row.opposing]) {
            let Some(SlopeRow { slope_deg, ci95_deg, length_m, end_y_m, .. }) = slope else { continue };
            samples.slope.push(Sample::new(slope_deg, ci95_deg.unwrap_or(f64::NAN), station_m));
            samples.length.push(bare(length_m));
            samples.end.push(bare(end_y_m));
        }
    }

    fn close(self) -> Interval {
        let [adjacent, opposing] = self.slopes.map(|samples| {
            Some(SlopeOver {
                slope_deg: samples.slope.estimate()?,
                length_m: samples.length.median()?,
                end_y_m: samples.end.median()?,
            })
        });
        let flags = self.flags.iter().enumerate().filter(|(_, count)| 10 * **count >= self.scans);
        let flags = flags.fold(0, |set, (bit, _)| set | 1 << bit);
        Interval {
            from_m: self.number as f64 * self.every.metres,
            to_m: (self.number + 1) as f64 * self.every.metres,
            side: self.middle.side,
            scans: self.scans,
            unreliable: self.unreliable,
            road_slope_deg: self.road.estimate().map(|road| road.value),
            edge_y_m: self.edge.median(),
            adjacent,
            opposing,
            flags,
            first: self.first,
            last: self.last,
            middle: self.middle,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::track::Position;
    use crossfall_core::protocol::DeviceTime;
    use crossfall_core::protocol::message::flags;

    fn row(station_m: f64, slope_deg: f64) -> Row {
        let slope = SlopeRow { slope_deg, ci95_deg: Some(0.1), length_m: 4.0, points: 20, end_y_m: 7.5 };
        Row {
            scan: 0,
            time: DeviceTime(0),
            position: Position { station_m: Some(station_m), ..Position::default() },
            roll_deg: 0.0,
            side: Side::Left,
            road_slope_deg: Some(1.0),
            edge_y_m: Some(3.5),
            adjacent: Some(slope),
            opposing: None,
            flags: 0,
        }
    }

    #[test]
    fn lengths_have_units() {
        assert_eq!("10m".parse::<Every>().unwrap().metres, 10.0);
        assert_eq!("0.1mi".parse::<Every>().unwrap().metres, 160.9344);
        assert_eq!("100 ft".parse::<Every>().unwrap().metres, 30.48);
        for bad in ["10", "m", "-5m", "0m", "1e9m", "5 furlongs", ""] {
            assert!(bad.parse::<Every>().is_err(), "{bad}");
        }
    }

    #[test]
    fn stretches_begin_at_whole_multiples_and_hold_every_scan_once() {
        let mut gather = Gather::new(Every { metres: 10.0 });
        let mut done: Vec<_> = (0..40).filter_map(|i| gather.row(&row(3.0 + f64::from(i), -8.0))).collect();
        done.extend(gather.finish());
        let borders: Vec<_> = done.iter().map(|one| (one.from_m, one.to_m, one.scans)).collect();
        assert_eq!(borders, [(0.0, 10.0, 7), (10.0, 20.0, 10), (20.0, 30.0, 10), (30.0, 40.0, 10), (40.0, 50.0, 3)]);
        assert!(done.iter().all(|one| (one.adjacent.unwrap().slope_deg.value + 8.0).abs() < 1e-9));
    }

    #[test]
    fn what_says_itself_unreliable_has_no_part_in_a_stretch_and_is_counted() {
        let mut gather = Gather::new(Every { metres: 50.0 });
        for i in 0..100 {
            // The poses fail for nine scans of a hundred; five others are doubtful.
            let (slope_deg, flags) = match i {
                20..29 => (-5.5, flags::NO_ATTITUDE),
                60..65 => (-30.0, flags::DOUBTFUL | flags::VEGETATION),
                _ => (-8.0, 0),
            };
            assert!(gather.row(&Row { flags, ..row(f64::from(i) * 0.4, slope_deg) }).is_none());
        }
        assert_eq!(gather.unreliable(), 14);
        let stretch = gather.finish().next().unwrap();
        let slope = stretch.adjacent.unwrap().slope_deg;
        assert!((slope.value + 8.0).abs() < 1e-9 && slope.sd < 1e-9, "{slope:?}");
        assert_eq!((stretch.scans, stretch.unreliable, slope.count), (100, 14, 86));
        assert_eq!(stretch.flags, 0, "less than a tenth");
        // Of a stretch that has nothing else, nothing is said.
        for i in 0..10 {
            gather.row(&Row { flags: flags::NO_ATTITUDE, ..row(50.0 + f64::from(i), -5.5) });
        }
        let stretch = gather.finish().next().unwrap();
        assert_eq!((stretch.adjacent, stretch.road_slope_deg, stretch.edge_y_m), (None, None, None));
        assert_eq!(stretch.flags, flags::NO_ATTITUDE);
    }

    #[test]
    fn a_flag_of_a_tenth_of_the_scans_is_that_of_the_stretch() {
        let mut gather = Gather::new(Every { metres: 50.0 });
        for i in 0..40 {
            gather.row(&Row { flags: if i < 4 { flags::OBSTRUCTED } else { 0 }, ..row(f64::from(i), -8.0) });
        }
        assert_eq!(gather.finish().next().unwrap().flags, flags::OBSTRUCTED);
    }

    #[test]
    fn rows_without_a_station_are_counted() {
        let mut gather = Gather::new(Every { metres: 1.0 });
        let mut lost = row(0.0, 0.0);
        lost.position = Position::default();
        assert!(gather.row(&lost).is_none());
        assert_eq!((gather.unplaced(), gather.finish().count()), (1, 0));
    }
}
