//! LAS 1.4 and LAZ: point format 6, millimetres, the coordinate system as WKT, GPS time adjusted standard.

use las::point::{Classification, Format};
use las::{Builder, GpsTimeType, Point, Transform, Vector, Writer};

use super::{Error, Return, Sink};
use crate::geodesy::wkt;
use crate::output::Output;

pub struct File {
    writer: Writer<Output>,
    path: std::path::PathBuf,
}

impl File {
    pub fn new(output: Output, origin: [f64; 3], epsg: u16, compressed: bool) -> Result<Self, Error> {
        let path = output.path().to_path_buf();
        let wrap = |source| Error::Las { path: path.clone(), source };
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
        let writer = Writer::new(output, header).map_err(wrap)?;
        Ok(Self { writer, path })
    }
}

impl Sink for File {
    fn point(&mut self, point: &Return) -> Result<(), Error> {
        let wrap = |source| Error::Las { path: self.path.clone(), source };
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
        self.writer.write_point(record).map_err(wrap)
    }

    fn finish(mut self: Box<Self>) -> Result<(), Error> {
        let wrap = |source| Error::Las { path: self.path.clone(), source };
        self.writer.close().map_err(wrap)?;
        Ok(self.writer.into_inner().map_err(wrap)?.commit()?)
    }
}
