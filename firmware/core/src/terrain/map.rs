//! The map: frames in, elevation and driving risk out.
//!
//! One frame goes through these steps, each in its own module:
//! gate on the pose, move the window, align to the map, project, find what stands, close the map around it, fuse, look through what stood,
//! refresh gradient, relief and risk of touched tiles. All storage is the caller's and constant; the work is bounded by
//! the points given and the tiles there are. A frame that cannot be trusted changes nothing and says why.

mod refresh;

use super::align::{Alignment, Pair, align};
use super::boxes::{MovingBox, mark_boxes};
use super::config::TerrainConfig;
use super::geometry::{Pose, Step, Track};
use super::marks::{Board, Lies, Marks, Tall};
use super::project::{PointCounts, Projection, Sample, Targets, project};
use super::risk::RiskTable;
use super::sight::{RangeImage, RangePixels};
use super::standing::{forget_ages, look_through, raise};
use super::tile::{Margins, TALL_CERTAIN, Tile, TileKey, UNITS_PER_M, Update, margin_table};
use super::vectors::{AsBuilt, Vectors};
use super::window::Window;

/// Storage that the caller lends.
pub struct Storage<'a> {
    /// side x side tiles.
    pub tiles: &'a mut [Tile],
    /// As many marks as tiles.
    pub marks: &'a mut [Marks],
    /// One for each point of the largest frame.
    pub samples: &'a mut [Sample],
    /// At least 256; 6,000 are enough for any frame. A push broom's map uses none of them.
    pub pairs: &'a mut [Pair],
    /// The range image, through which what stood and has gone is seen to be gone. A push broom's map does without: nothing is looked through
    /// there.
    pub pixels: Option<&'a mut RangePixels>,
}

/// Why a map could not be set up.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SetUpError {
    /// A number of the configuration is out of its range.
    Configuration,
    /// The side is 0 or above 255 tiles.
    Side,
    /// Tiles and marks are not side x side.
    TileStorage,
    /// Fewer than 256 pairs, or no samples.
    Scratch,
    /// No range image, though what stood is to be looked through.
    RangeImage,
}

/// Why a frame was not taken into the map.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Refusal {
    /// The rotation is not one, or the position lies beyond 4,000 km.
    Pose,
    /// The pose does not continue the motion.
    Jump,
    /// No usable point.
    NoPoints,
    /// The frame does not lie on the map: fewer than a third of the compared points fit.
    Misfit,
}

/// What happened to a frame.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct FrameReport {
    /// None: the frame is in the map.
    pub refused: Option<Refusal>,
    /// The map was emptied because the vehicle went on from somewhere else.
    pub restarted: bool,
    /// The correction found.
    pub alignment: Alignment,
    /// What became of the points.
    pub points: PointCounts,
    /// Tiles whose risk was told anew.
    pub refreshed: u32,
    /// Cells that lost what had stood there.
    pub cleared: u32,
    /// Boxes of moving objects that were not used: longer than any vehicle, or without a sensible size.
    pub boxes_refused: u32,
}

/// The elevation and risk map around a moving sensor.
pub struct TerrainMap<'a, V = AsBuilt> {
    unit: V,
    config: TerrainConfig,
    cell_um: i64,
    window: Window<'a>,
    marks: Board<'a>,
    samples: &'a mut [Sample],
    pairs: &'a mut [Pair],
    image: RangeImage<'a>,
    margins: Margins,
    table: RiskTable,
    datum_um: i64,
    track: Track,
    /// The track that a jump may have begun.
    elsewhere: Option<Track>,
    frame: u32,
    /// Some tile may hold something that stands.
    any_tall: bool,
    misfits: u8,
    pending_us: u32,
    sensor_um: [i64; 3],
    forward: [f32; 2],
}

impl<'a> TerrainMap<'a> {
    /// An empty map of `side` x `side` tiles.
    ///
    /// # Errors
    /// Storage or configuration that do not fit.
    pub fn new(config: TerrainConfig, side: u16, storage: Storage<'a>) -> Result<Self, SetUpError> {
        Self::with_vectors(AsBuilt, config, side, storage)
    }
}

impl<'a, V: Vectors> TerrainMap<'a, V> {
    /// The same, by the vector instructions of a unit.
    ///
    /// # Errors
    /// Storage or configuration that do not fit.
    pub fn with_vectors(unit: V, config: TerrainConfig, side: u16, storage: Storage<'a>) -> Result<Self, SetUpError> {
        if !config.is_sound() {
            return Err(SetUpError::Configuration);
        }
        if side == 0 || side > 255 {
            return Err(SetUpError::Side);
        }
        let count = usize::from(side) * usize::from(side);
        if storage.tiles.len() != count || storage.marks.len() != count {
            return Err(SetUpError::TileStorage);
        }
        if storage.samples.is_empty() || storage.pairs.len() < 256 {
            return Err(SetUpError::Scratch);
        }
        if storage.pixels.is_none() && !config.push_broom {
            return Err(SetUpError::RangeImage);
        }
        Ok(Self {
            unit,
            config,
            cell_um: (config.cell_m * 1e6 + 0.5) as i64,
            window: Window::new(storage.tiles, side),
            marks: Board::new(storage.marks),
            samples: storage.samples,
            pairs: storage.pairs,
            image: RangeImage::new(storage.pixels),
            margins: margin_table(),
            table: RiskTable::new(config.wheel_radius_mm),
            datum_um: 0,
            track: Track::default(),
            elsewhere: None,
            frame: 0,
            any_tall: false,
            misfits: 0,
            pending_us: 0,
            sensor_um: [0; 3],
            forward: [1.0, 0.0],
        })
    }

    /// Height of the map's datum, micrometres in the world.
    #[must_use]
    pub fn datum_um(&self) -> i64 {
        self.datum_um
    }

    /// Side of a cell, micrometres.
    #[must_use]
    pub fn cell_um(&self) -> i64 {
        self.cell_um
    }

    /// The tiles in use, in no particular order.
    pub fn tiles(&self) -> impl Iterator<Item = &Tile> {
        self.window.tiles.iter().filter(|tile| tile.in_use)
    }

    /// The tile at a place.
    #[must_use]
    pub fn tile(&self, key: TileKey) -> Option<&Tile> {
        self.window.tile(key).filter(|tile| tile.in_use)
    }

    /// Takes one frame in. `dt_us` is the time since the last call; `retired` gets every tile that falls out of the window.
    pub fn integrate(
        &mut self,
        points: &[[f32; 4]],
        pose: &Pose,
        dt_us: u32,
        boxes: &[MovingBox],
        mut retired: impl FnMut(&Tile),
    ) -> FrameReport {
        let mut report = FrameReport::default();
        report.points.given = points.len().min(u32::MAX as usize) as u32;
        self.pending_us = self.pending_us.saturating_add(dt_us);
        report.refused = refusal(points, pose);
        if report.refused == Some(Refusal::NoPoints) {
            report.points.not_finite = report.points.given;
        }
        if report.refused.is_some() || !self.pass_gate(pose, dt_us, &mut report, &mut retired) {
            return report;
        }
        self.move_to(pose, &mut retired);
        let mut projection = Projection::new(pose, self.cell_um, &self.window, self.datum_um);
        if !self.fit(points, &mut projection, &mut report, &mut retired) {
            return report;
        }
        let units = |metres: f32| (metres * UNITS_PER_M) as i32;
        let tall = Tall { stands: units(self.config.tall_above_m), hangs: units(self.config.overhang_m) };
        // What is hit for the first time is not looked through in the same frame.
        let see = !self.config.push_broom && self.any_tall;
        self.marks.clear(tall);
        self.image.clear(see);
        report.boxes_refused = mark_boxes(boxes, &projection, self.cell_um, pose, &self.window, &mut self.marks);
        self.take_in(points, &projection, (tall, see), &mut report.points);
        self.judge_standing(pose, &projection, see, &mut report);
        report.refreshed = self.refresh_in_turn();
        report
    }

    /// Brings the window to where the sensor is.
    fn move_to(&mut self, pose: &Pose, retired: &mut impl FnMut(&Tile)) {
        if self.frame == 0 {
            self.datum_um = pose.position_um[2].div_euclid(250) * 250;
        }
        self.sensor_um = pose.position_um;
        self.forward = [pose.rotation[0][0], pose.rotation[1][0]];
        let origin = self.origin_at(pose);
        self.window.place(origin, retired);
    }

    /// Lays the frame on the map; whether it fits, or the map has to begin again.
    fn fit(
        &mut self,
        points: &[[f32; 4]],
        projection: &mut Projection,
        report: &mut FrameReport,
        retired: &mut impl FnMut(&Tile),
    ) -> bool {
        let reach = (self.config.nearest_m, self.config.farthest_m);
        let (alignment, correction) = if self.config.push_broom {
            Default::default()
        } else {
            align(points, projection, &self.window, self.pairs, reach, self.config.cell_m)
        };
        report.alignment = alignment;
        if alignment.compared >= 300 && alignment.within.saturating_mul(3) < alignment.compared {
            self.misfits = self.misfits.saturating_add(1);
            if self.misfits < 3 {
                report.refused = Some(Refusal::Misfit);
                return false;
            }
            // Three in a row: the ground is where the frames say, and the map is wrong.
            self.window.clear(retired);
            report.restarted = true;
        } else {
            projection.correct(&correction);
        }
        self.misfits = 0;
        true
    }

    /// Puts the points into their cells; with this the frame counts.
    fn take_in(
        &mut self,
        points: &[[f32; 4]],
        projection: &Projection,
        (tall, see): (Tall, bool),
        counts: &mut PointCounts,
    ) {
        let [settled, others] = project(
            points,
            projection,
            &self.config,
            &self.window,
            Targets { samples: self.samples, marks: &mut self.marks, image: &mut self.image, see, counts },
            self.unit,
        );
        self.frame = self.frame.wrapping_add(1);
        self.settle(others, tall, counts);
        self.fuse([settled, others], (projection.sensor_height(), tall), counts);
    }

    /// Raises what stands, and takes down what the sensor has looked through if it can `see` that.
    fn judge_standing(&mut self, pose: &Pose, projection: &Projection, see: bool, report: &mut FrameReport) {
        let stamp = self.stamp();
        if !self.config.push_broom {
            forget_ages(&mut self.window, self.frame);
        }
        // In a line's only look at a place its first hit is all there will be.
        if report.points.standing > 0 {
            raise(&mut self.window, &self.marks, if self.config.push_broom { TALL_CERTAIN } else { 1 }, stamp);
            self.any_tall = true;
        }
        if see {
            (report.cleared, self.any_tall) =
                look_through(&mut self.window, &self.marks, &self.image, projection, pose, &self.config, stamp);
        }
    }

    fn stamp(&self) -> u8 {
        (self.frame & 255) as u8
    }

    /// Whether the pose continues the track, or a new one that has proved itself.
    fn pass_gate(
        &mut self,
        pose: &Pose,
        dt_us: u32,
        report: &mut FrameReport,
        retired: &mut impl FnMut(&Tile),
    ) -> bool {
        if self.track.advance(pose, self.pending_us) == Step::Continues {
            self.pending_us = 0;
            self.elsewhere = None;
            return true;
        }
        // A jump. If this pose continues what the last jump began, the vehicle really is there.
        let proved = match &mut self.elsewhere {
            Some(track) => track.advance(pose, dt_us) == Step::Continues,
            None => false,
        };
        if !proved {
            let mut track = Track::default();
            track.advance(pose, dt_us);
            self.elsewhere = Some(track);
            report.refused = Some(Refusal::Jump);
            return false;
        }
        self.track = self.elsewhere.take().unwrap_or_default();
        self.pending_us = 0;
        self.window.clear(retired);
        report.restarted = true;
        true
    }

    /// Where the window's lowest corner goes with a pose.
    fn origin_at(&self, pose: &Pose) -> TileKey {
        let tile_um = self.cell_um.wrapping_mul(16).max(1);
        let [forward_x, forward_y] = [pose.rotation[0][0], pose.rotation[1][0]];
        let ahead_um = self.config.ahead_m * 1e6;
        let half = i32::from(self.window.side / 2);
        let corner = |position: i64, forward: f32| {
            let centre = position.saturating_add((forward * ahead_um) as i64);
            // Within 4,000 km and tiles of at least 0.8 m: 23 bits.
            (centre.div_euclid(tile_um) as i32).wrapping_sub(half)
        };
        let origin = TileKey { x: corner(pose.position_um[0], forward_x), y: corner(pose.position_um[1], forward_y) };
        // Wait for two tiles of motion, so that the border does not churn with every wobble of the heading.
        let held = self.window.origin;
        let near = |a: i32, b: i32| a.wrapping_sub(b).unsigned_abs() <= 1;
        if self.frame != 0 && near(origin.x, held.x) && near(origin.y, held.y) { held } else { origin }
    }

    /// Settles the ground of tiles that the map does not know, and judges their points: `count` samples at the storage's end.
    fn settle(&mut self, count: usize, tall: Tall, counts: &mut PointCounts) {
        if count == 0 {
            return;
        }
        // Before the first frame nothing is known.
        self.marks.settle(&self.window, self.frame != 1);
        let from = self.samples.len().saturating_sub(count);
        for sample in self.samples.get_mut(from..).unwrap_or_default() {
            let (slot, cell) = sample.at();
            let Some(mark) = self.marks.get_mut(slot) else { continue };
            if mark.is_plain_ground(sample.z) {
                continue;
            }
            let lies = mark.stands(cell, sample.z, tall);
            if lies == Lies::Standing {
                self.image.stand(sample.seen_at());
            }
            if lies != Lies::Ground {
                sample.leave_out();
            }
            counts.leave_out(lies);
        }
    }

    /// Fuses the samples from either end of the storage, in the order of the points, but for those that are closed to this frame.
    fn fuse(&mut self, [front, back]: [usize; 2], (sensor, tall): (i32, Tall), counts: &mut PointCounts) {
        let from = self.samples.len().saturating_sub(back);
        if counts.standing > 0 && self.marks.close_around_hits(&self.window) {
            self.image.widen();
            let (marks, image) = (&self.marks, &self.image);
            let is_closed = |sample: &Sample| {
                let (slot, cell) = sample.at();
                let below = sensor.saturating_sub(sample.z);
                marks
                    .any(slot)
                    .is_some_and(|mark| mark.is_closed(cell) || image.is_beneath(sample.seen_at(), below, tall.stands))
            };
            counts.beside_standing = leave_out(self.samples.get_mut(..front).unwrap_or_default(), is_closed)
                + leave_out(self.samples.get_mut(from..).unwrap_or_default(), is_closed);
        }
        let front = self.samples.get(..front).unwrap_or_default();
        let back = self.samples.get(from..).unwrap_or_default();
        let by = Update { margins: &self.margins, stamp: self.stamp() };
        let tiles = &mut *self.window.tiles;
        counts.fused = fuse(tiles, front.iter(), &by) + fuse(tiles, back.iter().rev(), &by);
    }
}

/// What makes a frame useless before it is looked at.
fn refusal(points: &[[f32; 4]], pose: &Pose) -> Option<Refusal> {
    if !pose.is_rigid() || pose.position_um.iter().any(|um| um.unsigned_abs() > 4_000_000_000_000) {
        return Some(Refusal::Pose);
    }
    let any = points.iter().any(|p| p.iter().take(3).all(|value| value.is_finite()));
    (!any).then_some(Refusal::NoPoints)
}

/// Leaves samples out; how many they were.
#[inline(never)]
fn leave_out(samples: &mut [Sample], is_closed: impl Fn(&Sample) -> bool) -> u32 {
    let mut left_out = 0;
    for sample in samples {
        if is_closed(sample) {
            sample.leave_out();
            left_out += 1;
        }
    }
    left_out
}

/// Fuses samples; how many they were. A loop of its own, so that all of it stays in registers.
#[inline(never)]
fn fuse<'s>(tiles: &mut [Tile], samples: impl Iterator<Item = &'s Sample>, by: &Update<'_>) -> u32 {
    let mut taken = 0;
    for sample in samples {
        let (slot, cell) = sample.at();
        let Some(tile) = tiles.get_mut(slot) else { continue };
        tile.fuse(cell, sample.z, sample.weight(), by);
        taken += 1;
    }
    taken
}
