//! LAS 1.4 and LAZ: point format 6, millimetres, the coordinate system as WKT, GPS time adjusted standard.

use std::io::{self, Seek, SeekFrom, Write};
use std::path::PathBuf;
use std::sync::{Arc, Mutex, PoisonError};

use las::point::{Classification, Format};
use las::{Builder, GpsTimeType, Point, Transform, Vector, Writer};

use super::{Error, Return, Sink};
use crate::geodesy::wkt;
use crate::output::{self, Output};

pub struct File {
    writer: Writer<Unfailing>,
    outcome: Outcome,
}

/// How the writing went: the file's name, and the first error of the system's.
#[derive(Clone)]
struct Outcome {
    path: PathBuf,
    failed: Arc<Mutex<Option<io::Error>>>,
}

impl Outcome {
    /// What `las` says, unless the file has failed under it.
    fn of<T>(&self, said: las::Result<T>) -> Result<T, Error> {
        let failed = self.failed.lock().unwrap_or_else(PoisonError::into_inner).take();
        match failed {
            Some(source) => Err(output::Error { path: self.path.clone(), source }.into()),
            None => said.map_err(|source| Error::Las { path: self.path.clone(), source }),
        }
    }
}

/// What `las` writes to. Its writer closes itself once more when it is dropped, and panics when that fails: so behind the first error, which is
/// kept, everything succeeds and nothing is written.
struct Unfailing {
    output: Output,
    position: u64,
    end: u64,
    broken: bool,
    failed: Arc<Mutex<Option<io::Error>>>,
}

impl Unfailing {
    fn attempt<T>(&mut self, attempt: impl FnOnce(&mut Output) -> io::Result<T>, otherwise: T) -> T {
        if self.broken {
            return otherwise;
        }
        attempt(&mut self.output).unwrap_or_else(|error| {
            self.broken = true;
            *self.failed.lock().unwrap_or_else(PoisonError::into_inner) = Some(error);
            otherwise
        })
    }
}

impl Write for Unfailing {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let count = self.attempt(|output| output.write_all(bytes).map(|()| bytes.len()), bytes.len());
        self.position += count as u64;
        self.end = self.end.max(self.position);
        Ok(count)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.attempt(Output::flush, ());
        Ok(())
    }
}

impl Seek for Unfailing {
    fn seek(&mut self, to: SeekFrom) -> io::Result<u64> {
        let there = match to {
            SeekFrom::Start(there) => Some(there),
            SeekFrom::Current(by) => self.position.checked_add_signed(by),
            SeekFrom::End(by) => self.end.checked_add_signed(by),
        };
        let there = there.ok_or(io::ErrorKind::InvalidInput)?;
        self.position = self.attempt(|output| output.seek(SeekFrom::Start(there)), there);
        Ok(self.position)
    }
}

impl File {
    pub fn new(output: Output, origin: [f64; 3], epsg: u16, compressed: bool) -> Result<Self, Error> {
        let outcome = Outcome { path: output.path().to_path_buf(), failed: Arc::default() };
        let wrap = |source| Error::Las { path: outcome.path.clone(), source };
        let mut builder = Builder::from((1, 4));
        builder.point_format = Format::new(6).map_err(wrap)?;
        builder.point_format.is_compressed = compressed;
        builder.generating_software = concat!("crossfall ", env!("CARGO_PKG_VERSION")).to_owned();
        builder.system_identifier = "crossfall".to_owned();
        builder.gps_time_type = GpsTimeType::Standard;
        // Whole kilometres keep millimetres within 32 bits for 2,000 km around.
        let axis = |value: f64| Transform { scale: 0.001, offset: (value / 1_000.0).round() * 1_000.0 };
        builder.transforms =
            Vector { x: axis(origin[0]), y: axis(origin[1]), z: Transform { scale: 0.001, offset: 0.0 } };
        let mut header = builder.into_header().map_err(wrap)?;
        // The format wants the text to end in a zero.
        header.set_wkt_crs([wkt(epsg).as_bytes(), &[0]].concat()).map_err(wrap)?;
        let output = Unfailing { output, position: 0, end: 0, broken: false, failed: Arc::clone(&outcome.failed) };
        let writer = outcome.of(Writer::new(output, header))?;
        Ok(Self { writer, outcome })
    }
}

/// Whether a coordinate has a number of 32 bits, the next one included, to which its bounds may be rounded.
fn fits(value: f64, axis: Transform) -> bool {
    ((value - axis.offset) / axis.scale).abs() < f64::from(i32::MAX - 1)
}

impl Sink for File {
    fn point(&mut self, point: &Return) -> Result<bool, Error> {
        // The writer counts a point before it finds that it does not fit, and cannot be closed any more.
        let Vector { x, y, z } = *self.writer.header().transforms();
        if !point.place.into_iter().zip([x, y, z]).all(|(value, axis)| fits(value, axis)) {
            return Ok(false);
        }
        let wrap = |source| Error::Las { path: self.outcome.path.clone(), source };
        let record = Point {
            x: point.place[0],
            y: point.place[1],
            z: point.place[2],
            return_number: 1,
            number_of_returns: 1,
            classification: Classification::new(point.class as u8).map_err(wrap)?,
            scan_angle: point.angle_deg,
            point_source_id: point.source,
            gps_time: Some(point.gps_time),
            ..Point::default()
        };
        let written = self.writer.write_point(record);
        self.outcome.of(written)?;
        Ok(true)
    }

    fn finish(mut self: Box<Self>) -> Result<(), Error> {
        let closed = self.writer.close();
        self.outcome.of(closed)?;
        Ok(self.outcome.of(self.writer.into_inner())?.output.commit()?)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cloud::Class;

    #[test]
    fn what_has_no_number_is_left_out_and_the_rest_is_whole() {
        let folder = tempfile::tempdir().unwrap();
        for (name, compressed) in [("a.las", false), ("a.laz", true)] {
            let path = folder.path().join(name);
            let origin = [258_400.0, 4_521_900.0, 350.0];
            let mut file = File::new(Output::create(&path).unwrap(), origin, 32_618, compressed).unwrap();
            let mut write = |east: f64, north: f64, up: f64| {
                let place = [origin[0] + east, origin[1] + north, origin[2] + up];
                let point = Return { place, class: Class::Road, gps_time: 4e8, angle_deg: -12.0, source: 1 };
                file.point(&point).unwrap()
            };
            assert!(write(0.0, 0.0, 0.0) && write(2e6, -2e6, -9e3));
            // Around the last number of 32 bits: what is taken can be closed, too.
            let taken = (-20..20).filter(|tenth| write(2_147_483.647 - 400.0 + f64::from(*tenth) * 1e-4, 0.0, 0.0));
            let taken = taken.count() as u64;
            assert!(taken > 0, "the offset is whole kilometres");
            for far in [-3e6, 8.6e6, f64::NAN, f64::INFINITY] {
                assert!(!write(far, 0.0, 0.0) && !write(0.0, far, 0.0) && !write(0.0, 0.0, far), "{far}");
            }
            Box::new(file).finish().unwrap();
            let mut reader = las::Reader::from_path(&path).unwrap();
            let points: Vec<Point> = reader.read_all().unwrap().points().collect::<Result<_, _>>().unwrap();
            assert_eq!((reader.header().number_of_points(), points.len() as u64), (2 + taken, 2 + taken));
        }
    }
}
