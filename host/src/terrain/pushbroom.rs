//! The board's own drives as frames of the map: the road just passed.
//!
//! The scanner looks across the road, so every place is seen once, by a line that the drive pushes on. The returns are placed by
//! `cloud`, beam by beam at its own instant, on the map (UTM); a frame is a few scans (a tenth of a second), in the axes that the vehicle
//! had at the first of them. Scans without a position or an attitude are counted and left out.

use std::path::Path;

use super::frames::Error;
use super::lidar::SensorPose;
use crate::cloud::Placing;
use crate::geodesy::Utm;
use crate::walk::Walk;

/// Scans of a frame: 0.1 s of a half-degree scanner.
const SCANS: usize = 4;

/// A frame of a drive.
#[derive(Debug)]
pub struct Strip {
    /// Pose of the scanner at the first scan, relative to [`Drive::origin`].
    pub pose: SensorPose,
    /// Microseconds since the frame before; 0 for the first.
    pub step_us: u32,
}

/// A drive, read on as its frames are asked for.
pub struct Drive {
    walk: Walk,
    placing: Placing,
    utm: Option<Utm>,
    origin: [f64; 2],
    last_us: Option<u64>,
    unplaced: u64,
}

impl Drive {
    /// Most points of a frame.
    pub const LARGEST: usize = SCANS * crossfall_core::scan::MAX_BEAMS;

    /// Opens a log.
    ///
    /// # Errors
    /// What is no log.
    pub fn open(log: &Path) -> Result<Self, Error> {
        let walk = Walk::open(log)?;
        let placing = Placing::default();
        Ok(Self { walk, placing, utm: None, origin: [0.0; 2], last_us: None, unplaced: 0 })
    }

    /// Easting and northing of the place to which poses are relative, whole hundreds of metres.
    #[must_use]
    pub fn origin(&self) -> [f64; 2] {
        self.origin
    }

    /// EPSG code of the map's coordinates, once a position was found.
    #[must_use]
    pub fn epsg(&self) -> Option<u16> {
        self.utm.as_ref().map(Utm::epsg)
    }

    /// Scans without a position or an attitude so far.
    #[must_use]
    pub fn unplaced(&self) -> u64 {
        self.unplaced
    }

    /// Damaged, broken or missing parts of the log passed so far.
    #[must_use]
    pub fn damage(&self) -> u64 {
        self.walk.damage() + self.walk.unmatched()
    }

    /// The next frame: its points are put into `out`, in the scanner's axes.
    ///
    /// # Errors
    /// A position outside the map's zone.
    pub fn next(&mut self, out: &mut Vec<[f32; 4]>) -> Result<Option<Strip>, Error> {
        out.clear();
        let mut strip = None;
        for _ in 0..SCANS {
            let Some((pose, time_us)) = self.scan()? else { break };
            let strip = strip.get_or_insert_with(|| {
                let before = self.last_us.replace(time_us);
                let step = before.map_or(0, |before| time_us.saturating_sub(before));
                Strip { pose, step_us: u32::try_from(step).unwrap_or(u32::MAX) }
            });
            for place in self.placing.places() {
                let place = [place[0] - self.origin[0], place[1] - self.origin[1], place[2]];
                let [x, y, z] = strip.pose.back(place);
                out.push([x as f32, y as f32, z as f32, 0.0]);
            }
        }
        Ok(strip)
    }

    /// Places the next scan that has a position and an attitude.
    fn scan(&mut self) -> Result<Option<(SensorPose, u64)>, Error> {
        loop {
            let Some(step) = self.walk.next(|_, _| true) else {
                crate::interrupt::check()?;
                return Ok(None);
            };
            let (Some(place), Some(turn)) = (step.position.geodetic, step.position.turn) else {
                self.unplaced += 1;
                continue;
            };
            if self.utm.is_none() {
                let utm = Utm::around(place)?;
                let [east, north, _] = utm.project(place)?;
                self.origin = [east, north].map(|metres| (metres / 100.0).floor() * 100.0);
                self.utm = Some(utm);
            }
            let Some(utm) = &self.utm else { continue };
            if !self.placing.place(&step, utm)? {
                self.unplaced += 1;
                continue;
            }
            // The map's axes are turned against north by the zone's convergence.
            let patch = utm.around_place(place)?;
            let at = patch.place([0.0; 3]);
            let axis = |of: [f64; 3]| {
                let to = patch.place(turn.of_vehicle(of));
                [to[0] - at[0], to[1] - at[1], to[2] - at[2]]
            };
            let pose = SensorPose {
                rotation: columns([axis([1.0, 0.0, 0.0]), axis([0.0, 1.0, 0.0]), axis([0.0, 0.0, 1.0])]),
                position: [at[0] - self.origin[0], at[1] - self.origin[1], at[2]],
            };
            return Ok(Some((pose, step.profile.time.0)));
        }
    }
}

fn columns(axes: [[f64; 3]; 3]) -> [[f64; 3]; 3] {
    [0, 1, 2].map(|row| [axes[0][row], axes[1][row], axes[2][row]])
}
