//! The returns of one drive or several as one cloud of points on the map: LAS or LAZ 1.4, or PLY.
//!
//! Coordinates are UTM (WGS 84) with ellipsoid heights; the zone is that of the first place and holds for all drives, so that a drive up and one down
//! the same road lie in one cloud. Every beam is placed at its own instant: the scanner's place and the vehicle's heading and pitch at the scan's
//! two ends are joined by a straight line (26 ms apart: below a millimetre at 3 m/s^2), roll and mounting offset are those of the beam itself. Scans
//! without a position or an attitude at both ends are counted and left out. Points stream to the file.

mod las_file;
mod ply;
mod stretch;

use std::path::{Path, PathBuf};

use crossfall_core::protocol::DeviceTime;
use crossfall_core::protocol::message::flags;
use crossfall_core::scan::Points;

use crate::geodesy::{self, Utm, between};
use crate::section::{Fitted, Part, Place, lines};
use crate::track::Position;
use crate::walk::{Step, Walk};
use crate::{calendar, container, interrupt, output, units};

pub use stretch::{Across, Stretch};

/// A return within this of a fitted line belongs to its surface, in metres: five standard deviations of the scanner's ranges, and some grass.
pub const SURFACE_M: f64 = 0.08;

/// Seconds by which the format's GPS time is behind GPS time ("adjusted standard").
const ADJUSTED_S: f64 = 1e9;

/// What a return is of.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub enum Class {
    /// Anything else.
    Other = 1,
    /// Above a slope: grass, shrubs.
    Vegetation = 3,
    /// The road.
    Road = 11,
    /// The adjacent slope (a code that the format leaves to users).
    Adjacent = 64,
    /// The opposing slope (a code that the format leaves to users).
    Opposing = 65,
}

impl Class {
    /// All of them.
    pub const ALL: [Self; 5] = [Self::Other, Self::Vegetation, Self::Road, Self::Adjacent, Self::Opposing];

    /// What it is called.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Other => "other",
            Self::Vegetation => "vegetation",
            Self::Road => "road",
            Self::Adjacent => "adjacent slope",
            Self::Opposing => "opposing slope",
        }
    }

    /// What a return of a section is of: of the surface whose line spans its place, or above it.
    #[must_use]
    pub fn of((y, z): Place, lines: &[Fitted]) -> Self {
        let Some(line) = lines.iter().find(|line| line.spans(y)) else { return Self::Other };
        let above = z - line.height(y);
        match line.part {
            _ if above < -SURFACE_M => Self::Other,
            Part::Road if above > SURFACE_M => Self::Other,
            _ if above > SURFACE_M => Self::Vegetation,
            Part::Road => Self::Road,
            Part::Adjacent => Self::Adjacent,
            Part::Opposing => Self::Opposing,
        }
    }
}

/// One return on the map.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Return {
    /// Easting, northing, ellipsoid height.
    pub place: [f64; 3],
    /// What it is of.
    pub class: Class,
    /// GPS seconds since 1980 less 10^9, as the format has it.
    pub gps_time: f64,
    /// Angle of its beam from the plumb line, roll and mounting taken out, in degrees, left negative: as the formats have it, counter-clockwise seen
    /// from behind is positive (LAS 1.4, table 16).
    pub angle_deg: f32,
    /// Which log it is from, the first is 1.
    pub source: u16,
}

/// A format of clouds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Format {
    /// LAS 1.4, point format 6.
    Las,
    /// The same, compressed.
    Laz,
    /// PLY, binary, little endian.
    Ply,
}

impl Format {
    /// The format that a file's name asks for.
    #[must_use]
    pub fn of(path: &Path) -> Option<Self> {
        match path.extension()?.to_ascii_lowercase().to_str()? {
            "las" => Some(Self::Las),
            "laz" => Some(Self::Laz),
            "ply" => Some(Self::Ply),
            _ => None,
        }
    }
}

/// A cloud could not be made.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// A log cannot be read.
    #[error(transparent)]
    Log(#[from] container::Error),
    /// The file cannot be written.
    #[error(transparent)]
    Output(#[from] output::Error),
    /// A place is not on the map.
    #[error(transparent)]
    Place(#[from] geodesy::Error),
    /// The LAS library refuses.
    #[error("{}: {source}", path.display())]
    Las {
        /// The file.
        path: PathBuf,
        /// Why.
        source: las::Error,
    },
    /// No log has a position.
    #[error("no log has a position: there is no place for the points")]
    Nowhere,
}

/// What was made.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Made {
    /// Points written.
    pub points: u64,
    /// How many of each class, in the order of [`Class::ALL`].
    pub classes: [u64; 5],
    /// Scans without a position or an attitude, which are not in it.
    pub unplaced: u64,
    /// Returns that the format has no numbers for, 2,000 km and more from the first place; they are not in it.
    pub too_far: u64,
    /// Damaged, broken or missing parts passed over.
    pub damage: u64,
    /// EPSG code of its coordinates.
    pub epsg: u16,
}

/// Something that takes returns.
trait Sink {
    /// Takes a return; false where the format has no numbers for its place.
    fn point(&mut self, point: &Return) -> Result<bool, Error>;
    fn finish(self: Box<Self>) -> Result<(), Error>;
}

/// Writes the returns of logs into one file. `progress` is told the number of the log and how far it has been read, in bytes.
///
/// # Errors
/// When a log cannot be read, the file not be written, or nothing has a position; then there is no file.
pub fn write(logs: &[PathBuf], format: Format, to: &Path, mut progress: impl FnMut(usize, u64)) -> Result<Made, Error> {
    let mut made = Made::default();
    let mut sink: Option<(Utm, Box<dyn Sink>)> = None;
    let mut room = Room::default();
    for (number, log) in logs.iter().enumerate() {
        let source = u16::try_from(number + 1).unwrap_or(u16::MAX);
        let mut walk = Walk::open(log)?;
        let mut steps = 0_u64;
        loop {
            let offset = walk.offset();
            let Some(step) = walk.next(|_, _| true) else { break };
            steps += 1;
            if steps.is_multiple_of(512) {
                progress(number, offset);
            }
            let Some((place, _)) = posed(&step.position) else {
                made.unplaced += 1;
                continue;
            };
            if sink.is_none() {
                let utm = Utm::around(place)?;
                let origin = utm.project(place)?;
                made.epsg = utm.epsg();
                sink = Some((utm, start(format, to, origin, made.epsg)?));
            }
            let Some((utm, sink)) = sink.as_mut() else { continue };
            if !room.place(&step, utm, source)? {
                made.unplaced += 1;
                continue;
            }
            for point in &room.returns {
                if !sink.point(point)? {
                    made.too_far += 1;
                    continue;
                }
                made.points += 1;
                let class = Class::ALL.iter().position(|class| *class == point.class).unwrap_or_default();
                made.classes[class] += 1;
            }
        }
        interrupt::check()?;
        made.damage += walk.damage() + walk.unmatched();
    }
    let (_, sink) = sink.ok_or(Error::Nowhere)?;
    sink.finish()?;
    Ok(made)
}

fn start(format: Format, to: &Path, origin: [f64; 3], epsg: u16) -> Result<Box<dyn Sink>, Error> {
    let output = output::Output::create(to)?;
    Ok(match format {
        Format::Las | Format::Laz => Box::new(las_file::File::new(output, origin, epsg, format == Format::Laz)?),
        Format::Ply => Box::new(ply::File::new(output, epsg)?),
    })
}

/// Places the returns of scans on the map, one scan after the other.
#[derive(Default)]
pub(crate) struct Placing(Room);

impl Placing {
    /// Places a scan's returns; false where its pose is not known.
    pub(crate) fn place(&mut self, step: &Step<'_>, utm: &Utm) -> Result<bool, Error> {
        self.0.place(step, utm, 0)
    }

    /// The last scan's returns: easting, northing, ellipsoid height.
    pub(crate) fn places(&self) -> impl Iterator<Item = [f64; 3]> + '_ {
        self.0.returns.iter().map(|point| point.place)
    }
}

/// Room for the returns of one scan.
#[derive(Default)]
struct Room {
    points: Points,
    places: Vec<Place>,
    returns: Vec<Return>,
}

impl Room {
    /// Places a scan's returns; false where its pose is not known.
    fn place(&mut self, step: &Step<'_>, utm: &Utm, source: u16) -> Result<bool, Error> {
        let begin = step.profile.time;
        let beams = step.scan.beams();
        let last_ns = (0..step.scan.turns().min(beams)).map(|i| step.scan.beam_ns(beams - 1 - i)).max().unwrap_or(0);
        let end = DeviceTime(begin.0 + u64::from(last_ns.unsigned_abs() / 1_000) + 1);
        let (from, to) = (step.position, step.track.at(end));
        let (Some((place, turn)), Some((next, next_turn))) = (posed(&from), posed(&to)) else { return Ok(false) };
        let Some((week, seconds)) = from.gps else { return Ok(false) };
        if step.level(&mut self.points) & flags::NO_ATTITUDE != 0 {
            return Ok(false);
        }
        let [east, north] = between(place, next);
        let up = next[2] - place[2];
        let patch = utm.around_place(place)?;
        let span_ns = (end.0 - begin.0) as f64 * 1e3;
        let gps_time = f64::from(week) * calendar::WEEK_S as f64 + seconds - ADJUSTED_S;

        self.places.clear();
        self.places.extend(self.points.iter().map(units::place));
        let lines = lines(&step.profile, &self.places);
        self.returns.clear();
        for (echo, &(y, z)) in self.points.iter().zip(&self.places) {
            let after_ns = f64::from(step.scan.beam_ns(usize::from(echo.beam)));
            let part = after_ns / span_ns;
            let mut now = turn;
            now.pitch += (next_turn.pitch - turn.pitch) * part;
            // The short way round north.
            let swing = next_turn.azimuth - turn.azimuth;
            now.azimuth += (swing - (swing / std::f64::consts::TAU).round() * std::f64::consts::TAU) * part;
            let [e, n, u] = now.of_level([0.0, y, z]);
            self.returns.push(Return {
                place: patch.place([e + east * part, n + north * part, u + up * part]),
                class: Class::of((y, z), &lines),
                gps_time: gps_time + after_ns * 1e-9,
                angle_deg: (-y).atan2(-z).to_degrees() as f32,
                source,
            });
        }
        Ok(true)
    }
}

fn posed(position: &Position) -> Option<(geodesy::Geodetic, crate::track::Turn)> {
    position.geodetic.zip(position.turn)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::side::Side;

    #[test]
    fn returns_are_of_the_surface_that_they_lie_on() {
        let line = |part, from: f64, to: f64, slope_deg: f64| {
            let rise = f64::to_radians(slope_deg).tan();
            Fitted {
                part,
                side: Side::Left,
                inner: (from, -2.0),
                outer: (to, -2.0 + rise * (to - from)),
                slope_deg,
                ci95_deg: None,
                points: 0,
            }
        };
        let lines = [line(Part::Road, 0.0, 4.0, 0.0), line(Part::Adjacent, 4.0, 8.0, -10.0)];
        for (place, class) in [
            ((2.0, -2.02), Class::Road),
            ((2.0, -1.2), Class::Other),
            ((5.0, -2.176), Class::Adjacent),
            ((5.0, -1.9), Class::Vegetation),
            ((5.0, -2.5), Class::Other),
            ((9.0, -2.0), Class::Other),
            ((-2.0, -2.0), Class::Other),
        ] {
            assert_eq!(Class::of(place, &lines), class, "{place:?}");
        }
    }

    #[test]
    fn names_tell_formats() {
        assert_eq!(Format::of(Path::new("a.LAZ")), Some(Format::Laz));
        assert_eq!(Format::of(Path::new("a.xyz")), None);
    }
}
