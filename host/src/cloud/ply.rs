//! PLY, binary: x, y, z and GPS time as doubles, class and source as bytes. The count of points is put into the header at the end.

use std::io::{Seek, SeekFrom, Write};

use super::{Error, Return, Sink};
use crate::output::{self, Output};

pub struct File {
    output: Output,
    count: u64,
    count_at: u64,
}

impl File {
    pub fn new(mut output: Output, epsg: u16) -> Result<Self, Error> {
        let before = format!(
            "ply\nformat binary_little_endian 1.0\ncomment crossfall {}\ncomment x y z in metres, EPSG:{epsg}, ellipsoid height\n\
             comment gps_time in seconds since 1980-01-06 less 1e9\nelement vertex ",
            env!("CARGO_PKG_VERSION")
        );
        let behind = "\nproperty double x\nproperty double y\nproperty double z\nproperty double gps_time\n\
                      property uchar class\nproperty uchar source\nend_header\n";
        let count_at = before.len() as u64;
        let written = write!(output, "{before}{:010}{behind}", 0);
        wrap(&output, written)?;
        Ok(Self { output, count: 0, count_at })
    }
}

fn wrap<T>(output: &Output, result: std::io::Result<T>) -> Result<T, Error> {
    result.map_err(|source| output::Error { path: output.path().to_path_buf(), source }.into())
}

impl Sink for File {
    fn point(&mut self, point: &Return) -> Result<bool, Error> {
        let mut record = [0; 34];
        for (bytes, value) in record.chunks_exact_mut(8).zip(point.place.into_iter().chain([point.gps_time])) {
            bytes.copy_from_slice(&value.to_le_bytes());
        }
        record[32] = point.class as u8;
        record[33] = u8::try_from(point.source).unwrap_or(u8::MAX);
        self.count += 1;
        let written = self.output.write_all(&record);
        wrap(&self.output, written)?;
        Ok(true)
    }

    fn finish(mut self: Box<Self>) -> Result<(), Error> {
        let output = &mut self.output;
        let written = output.seek(SeekFrom::Start(self.count_at)).and_then(|_| write!(output, "{:010}", self.count));
        wrap(&self.output, written)?;
        Ok(self.output.commit()?)
    }
}
