//! Boxes of moving objects: `objects.csv`.

use std::collections::BTreeMap;
use std::path::Path;

use crossfall_core::terrain::MovingBox;
use serde::Deserialize;

use super::Error;

/// A row of `objects.csv`: a moving object, in the world.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize)]
struct ObjectRow {
    /// Frame that it was seen in.
    frame: usize,
    /// Centre, m.
    x: f64,
    /// Centre, m.
    y: f64,
    /// Centre, m.
    z: f64,
    /// m.
    length: f64,
    /// m.
    width: f64,
    /// m.
    height: f64,
    /// Radians from x towards y.
    yaw: f64,
}

/// What a detector's box may be too small by, on every side, m.
const BOX_MARGIN: f64 = 0.2;

impl ObjectRow {
    fn outline(&self) -> MovingBox {
        let micrometres = |metres: f64| (metres * 1e6) as i64;
        MovingBox {
            centre_um: [micrometres(self.x), micrometres(self.y)],
            half_m: [(self.length / 2.0 + BOX_MARGIN) as f32, (self.width / 2.0 + BOX_MARGIN) as f32],
            heading: [libm::cos(self.yaw) as f32, libm::sin(self.yaw) as f32],
        }
    }
}

/// The boxes of each frame by its number.
pub fn read_objects(path: &Path) -> Result<BTreeMap<usize, Vec<MovingBox>>, Error> {
    let wrong = |error: csv::Error| {
        let line = error.position().map_or(1, |position| position.line() as usize);
        Error::Line { path: path.into(), line, what: format!("expected frame,x,y,z,length,width,height,yaw: {error}") }
    };
    let mut reader = csv::ReaderBuilder::new().trim(csv::Trim::All).from_path(path).map_err(wrong)?;
    let names = reader.headers().map_err(wrong)?.clone();
    let mut objects: BTreeMap<usize, Vec<MovingBox>> = BTreeMap::new();
    let mut record = csv::StringRecord::new();
    while reader.read_record(&mut record).map_err(wrong)? {
        let row: ObjectRow = record.deserialize(Some(&names)).map_err(wrong)?;
        let sound = [row.x, row.y, row.z, row.length, row.width, row.height, row.yaw].iter().all(|v| v.is_finite());
        // The map draws boxes of up to 50 m of length and width together, the margins included: more than any vehicle has.
        if !sound || row.length <= 0.0 || row.width <= 0.0 || row.length + row.width > 40.0 {
            let what = format!("the box of frame {} has no sensible size", row.frame);
            let line = record.position().map_or(1, |position| position.line() as usize);
            return Err(Error::Line { path: path.into(), line, what });
        }
        objects.entry(row.frame).or_default().push(row.outline());
    }
    Ok(objects)
}
