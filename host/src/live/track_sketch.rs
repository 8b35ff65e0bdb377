//! The way driven, as a sketch of bounded size: when it is full, every other knot is given up and the next ones are twice as far apart.

use crossfall_core::protocol::message::Fix;

use crate::geodesy::Plane;

/// Knots kept.
const MOST: usize = 2_048;

/// Way between knots at first, in metres.
const FIRST_STEP_M: f64 = 2.0;

/// See the module.
#[derive(Clone, Debug)]
pub struct Sketch {
    plane: Option<Plane>,
    /// East, north, station in metres.
    knots: Vec<[f32; 3]>,
    step_m: f64,
    last_m: f64,
    /// Changes when knots that were told have changed.
    pub epoch: u32,
}

impl Default for Sketch {
    fn default() -> Self {
        Self { plane: None, knots: Vec::new(), step_m: FIRST_STEP_M, last_m: f64::NEG_INFINITY, epoch: 0 }
    }
}

impl Sketch {
    /// The vehicle is here. Says where that is on the sketch, in metres east and north.
    pub fn push(&mut self, fix: &Fix, station_m: f64) -> [f32; 2] {
        let degrees = |ndeg: i64| ndeg as f64 * 1e-9;
        let here = [degrees(fix.latitude_ndeg), degrees(fix.longitude_ndeg), f64::from(fix.height_mm) * 1e-3];
        let place = self.plane.get_or_insert_with(|| Plane::at(here)).metres(here).map(|metres| metres as f32);
        if station_m - self.last_m >= self.step_m {
            self.last_m = station_m;
            if self.knots.len() == MOST {
                let mut keep = false;
                self.knots.retain(|_| {
                    keep = !keep;
                    keep
                });
                self.step_m *= 2.0;
                self.epoch += 1;
            }
            self.knots.push([place[0], place[1], station_m as f32]);
        }
        place
    }

    /// Begins anew.
    pub fn clear(&mut self) {
        *self = Self { epoch: self.epoch + 1, ..Self::default() };
    }

    /// What there is.
    #[must_use]
    pub fn knots(&self) -> &[[f32; 3]] {
        &self.knots
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn any_drive_fits() {
        let mut sketch = Sketch::default();
        for metre in 0..100_000_i64 {
            let fix = Fix {
                // North along a meridian, 1 m = 8.993e-6 degrees.
                latitude_ndeg: 50_000_000_000 + metre * 8_993,
                longitude_ndeg: 0,
                height_mm: 0,
                velocity_mm_s: [1_000, 0, 0],
            };
            sketch.push(&fix, metre as f64);
            assert!(sketch.knots().len() <= MOST);
        }
        let knots = sketch.knots();
        assert!(knots.len() >= MOST / 2 - 1 && sketch.epoch > 0, "{}", knots.len());
        assert!(knots.windows(2).all(|pair| pair[1][2] > pair[0][2]));
        let last = knots[knots.len() - 1];
        assert!((f64::from(last[1]) / f64::from(last[2]) - 1.0).abs() < 1e-3, "{last:?}");
    }
}
