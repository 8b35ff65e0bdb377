//! Measurements by hand: a table of slopes at places of a road, and what a drive has there (the median-slope paper's figure 7a).
//!
//! Columns by name, in any order, others are passed over: `side` (left, right), `slope` (adjacent, opposing), `slope_deg`, and the place as
//! `station_m` on the first drive or as `latitude_deg` and `longitude_deg`. Slopes are signed as everywhere (positive = rising away from
//! the vehicle) unless magnitudes are compared. The drive's slope at a place is the median of the scans around it.

use std::path::{Path, PathBuf};

use serde::Serialize;

use super::matching::place;
use super::{Agreement, Drive, Kind, Options};
use crate::side::Side;
use crate::statistics::upper_median;
use crate::way::Way;

/// One measurement by hand.
#[derive(Clone, Debug, PartialEq)]
pub struct Measurement {
    /// Where.
    pub place: Place,
    /// On which side.
    pub side: Side,
    /// Which slope.
    pub kind: Kind,
    /// The slope, in degrees.
    pub slope_deg: f64,
}

/// Where a measurement was taken.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Place {
    /// Along the first drive, in metres.
    Station(f64),
    /// Latitude and longitude, in degrees.
    Geodetic(f64, f64),
}

/// A table that cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// It cannot be read.
    #[error("{}: {source}", path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// Why.
        source: csv::Error,
    },
    /// A column or a cell is not what it must be.
    #[error("{}:{line}: {what}", path.display())]
    Content {
        /// The file.
        path: PathBuf,
        /// 1-based line.
        line: u64,
        /// What was found and what was expected.
        what: String,
    },
}

/// A measurement and what the drive has there.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct Held {
    /// Place along the first drive.
    pub station_m: f64,
    /// On the left.
    pub left: bool,
    /// Which slope.
    pub slope: Kind,
    /// By hand, in degrees.
    pub manual_deg: f64,
    /// By the drive: the median of the scans around.
    pub measured_deg: f64,
    /// Scans it is the median of.
    pub scans: usize,
}

/// A drive held against measurements by hand.
#[derive(Clone, Debug, Serialize)]
pub struct Manual {
    /// The drive.
    pub drive: String,
    /// Adjacent slopes.
    pub adjacent: Agreement,
    /// Opposing slopes.
    pub opposing: Agreement,
    /// Both.
    pub all: Agreement,
    /// Every measurement that has its counterpart.
    pub held: Vec<Held>,
    /// Measurements with no slope of the drive around.
    pub unmatched: usize,
    /// Rows of the drive that were left out because they say themselves unreliable.
    pub unreliable: usize,
    /// The drive goes the other way than the first, where left is right and what is adjacent there is opposing here: nothing of it is held.
    pub other_way: bool,
}

/// Reads a table of measurements.
///
/// # Errors
/// When it cannot be read, lacks a column, or a cell is not what it must be; names the line.
pub fn read(path: &Path) -> Result<Vec<Measurement>, Error> {
    let unreadable = |source| Error::Read { path: path.to_path_buf(), source };
    let mut table = csv::ReaderBuilder::new().trim(csv::Trim::All).from_path(path).map_err(unreadable)?;
    let headers = table.headers().map_err(unreadable)?.clone();
    let column = |name: &str| headers.iter().position(|header| header == name);
    let wrong = |line: u64, what: String| Error::Content { path: path.to_path_buf(), line, what };
    let needed = |name: &str| {
        column(name)
            .ok_or_else(|| wrong(1, format!("no column `{name}`; there must be side, slope, slope_deg and station_m")))
    };
    let (side, kind, slope) = (needed("side")?, needed("slope")?, needed("slope_deg")?);
    let (station, geodetic) = (column("station_m"), column("latitude_deg").zip(column("longitude_deg")));
    if station.is_none() && geodetic.is_none() {
        return Err(wrong(1, "no column `station_m`, nor `latitude_deg` and `longitude_deg`".to_owned()));
    }
    let mut measurements = Vec::new();
    for record in table.records() {
        let record = record.map_err(unreadable)?;
        let line = record.position().map_or(0, csv::Position::line);
        let cell = |at: usize| record.get(at).unwrap_or_default();
        let number = |at: usize| -> Result<f64, Error> {
            let text = cell(at);
            let parsed = text.parse().ok().filter(|number: &f64| number.is_finite());
            parsed
                .ok_or_else(|| wrong(line, format!("{} = `{text}`, expected a number", headers.get(at).unwrap_or(""))))
        };
        let side = match cell(side) {
            "left" => Side::Left,
            "right" => Side::Right,
            other => return Err(wrong(line, format!("side = `{other}`, expected left or right"))),
        };
        let kind = match cell(kind) {
            "adjacent" => Kind::Adjacent,
            "opposing" => Kind::Opposing,
            other => return Err(wrong(line, format!("slope = `{other}`, expected adjacent or opposing"))),
        };
        let place = match (station.filter(|at| !cell(*at).is_empty()), geodetic) {
            (Some(at), _) => Place::Station(number(at)?),
            (None, Some((latitude, longitude))) => Place::Geodetic(number(latitude)?, number(longitude)?),
            (None, None) => return Err(wrong(line, "station_m is empty".to_owned())),
        };
        measurements.push(Measurement { place, side, kind, slope_deg: number(slope)? });
    }
    Ok(measurements)
}

/// Holds a drive against measurements. Stations are those of `way`, which is the first drive's; without one they are the drive's own. With `magnitudes` both
/// lose their sign first.
#[must_use]
pub fn hold(
    drive: &Drive,
    way: Option<&Way>,
    measurements: &[Measurement],
    options: &Options,
    magnitudes: bool,
) -> Manual {
    let single = Options { over_m: None, ..*options };
    let placed = place(&drive.rows, way, &single);
    let sized = |slope: f64| if magnitudes { slope.abs() } else { slope };
    let mut held = Vec::new();
    let mut unmatched = 0;
    for measurement in measurements {
        let station_m = match measurement.place {
            Place::Station(station_m) => Some(station_m),
            Place::Geodetic(latitude, longitude) => way.and_then(|way| way.station_m([latitude, longitude, 0.0])),
        };
        let courses = if placed.forward { &placed.courses[..] } else { &[] };
        let course = courses.iter().find(|c| c.side == measurement.side && c.kind == measurement.kind);
        let mut around: Vec<f64> = course
            .zip(station_m)
            .map(|(course, at)| {
                let near = course.samples.iter().filter(|s| (s.station_m - at).abs() <= options.within_m);
                near.map(|sample| sized(sample.slope_deg)).collect()
            })
            .unwrap_or_default();
        let (Some(station_m), Some(measured_deg)) = (station_m, upper_median(&mut around)) else {
            unmatched += 1;
            continue;
        };
        held.push(Held {
            station_m,
            left: measurement.side == Side::Left,
            slope: measurement.kind,
            manual_deg: sized(measurement.slope_deg),
            scans: around.len(),
            measured_deg,
        });
    }
    let of = |wanted: &dyn Fn(Kind) -> bool| {
        let list: Vec<_> =
            held.iter().filter(|h| wanted(h.slope)).map(|h| (h.measured_deg - h.manual_deg, None)).collect();
        Agreement::of(&list)
    };
    Manual {
        drive: drive.name.clone(),
        adjacent: of(&|kind| kind == Kind::Adjacent),
        opposing: of(&|kind| kind == Kind::Opposing),
        all: of(&|_| true),
        unmatched,
        unreliable: placed.unreliable,
        other_way: !placed.forward,
        held,
    }
}
