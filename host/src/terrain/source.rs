//! What the map is made from: a folder of frames, a Velodyne's network capture, or a drive of the board's own scanner.

use std::path::{Path, PathBuf};

use crossfall_core::terrain::{MovingBox, TerrainConfig};

use super::frames::{Choices, Error, FrameFolder};
use super::lidar::SensorPose;
use super::mapper::Workshop;
use super::pushbroom::Drive;
use super::turns::Turns;

/// An opened source, read from its first frame to its last.
pub struct Source {
    kind: Kind,
    next: usize,
}

enum Kind {
    Folder(FrameFolder),
    Turns(Box<Turns>),
    Drive(Box<Drive>),
}

/// A frame but for its points.
#[derive(Clone, Debug)]
pub struct Frame {
    /// Counted from 0.
    pub index: usize,
    /// Pose of the sensor.
    pub pose: SensorPose,
    /// Microseconds since the frame before.
    pub step_us: u32,
    /// Boxes of moving objects.
    pub boxes: Vec<MovingBox>,
}

impl Source {
    /// Opens a folder, a `.pcap` or `.pcapng`, or a log.
    ///
    /// # Errors
    /// As of the kind that it is.
    pub fn open(path: &Path, choices: &Choices) -> Result<Self, Error> {
        let ending = path.extension().and_then(|ending| ending.to_str()).map(str::to_ascii_lowercase);
        let kind = if path.is_dir() {
            Kind::Folder(FrameFolder::open(path, choices)?)
        } else if matches!(ending.as_deref(), Some("pcap" | "pcapng" | "cap")) {
            let beside = || path.with_file_name("poses.txt");
            let poses: PathBuf = choices.poses.clone().unwrap_or_else(beside);
            Kind::Turns(Box::new(Turns::open(path, &poses)?))
        } else {
            Kind::Drive(Box::new(Drive::open(path)?))
        };
        Ok(Self { kind, next: 0 })
    }

    /// Number of frames, where it is known beforehand.
    #[must_use]
    pub fn frames(&self) -> Option<usize> {
        match &self.kind {
            Kind::Folder(folder) => Some(folder.len()),
            Kind::Turns(turns) => Some(turns.count()),
            Kind::Drive(_) => None,
        }
    }

    /// Most points of a frame.
    ///
    /// # Errors
    /// A file that cannot be looked at.
    pub fn largest(&self) -> Result<usize, Error> {
        match &self.kind {
            Kind::Folder(folder) => folder.largest(),
            Kind::Turns(turns) => Ok(turns.largest()),
            Kind::Drive(_) => Ok(Drive::LARGEST),
        }
    }

    /// The map's configuration for such a source, and its memory.
    #[must_use]
    pub fn workshop(&self, config: TerrainConfig, range_m: f32, points: usize) -> Workshop {
        if !matches!(self.kind, Kind::Drive(_)) {
            // The window's far corners lie further away than the range.
            let config = TerrainConfig { farthest_m: 1.5 * range_m + 8.0, ..config };
            return Workshop::for_range(config, range_m, points);
        }
        // All around, no further than the scanner's points lie close enough.
        let reach = range_m.min(40.0);
        let config = TerrainConfig {
            nearest_m: 0.5,
            farthest_m: reach,
            ahead_m: 0.0,
            half_turn: 0.5,
            range_sigma_mm: 10.0,
            push_broom: true,
            ..config
        };
        let tiles = (2.0 * reach / (config.cell_m * 16.0)).ceil() as u16 + 1;
        Workshop::new(config, tiles.clamp(3, 255), points)
    }

    /// The next frame, and its number; its points are put into `points`. None at the end.
    pub fn next(&mut self, points: &mut Vec<[f32; 4]>) -> Option<(usize, Result<Frame, Error>)> {
        let index = self.next;
        let frame = match &mut self.kind {
            Kind::Folder(folder) if index < folder.len() => folder.points(index, points).and_then(|()| {
                let pose = folder.pose(index).ok_or(Error::NoPose(index))?;
                let boxes = folder.boxes(index).to_vec();
                Ok(Frame { index, pose, step_us: folder.step_us(index), boxes })
            }),
            Kind::Turns(turns) if index < turns.count() => turns.points(index, points).and_then(|()| {
                let pose = turns.pose(index).ok_or(Error::NoPose(index))?;
                Ok(Frame { index, pose, step_us: turns.step_us(index), boxes: Vec::new() })
            }),
            Kind::Drive(drive) => match drive.next(points) {
                Ok(None) => return None,
                Ok(Some(strip)) => Ok(Frame { index, pose: strip.pose, step_us: strip.step_us, boxes: Vec::new() }),
                Err(error) => Err(error),
            },
            Kind::Folder(_) | Kind::Turns(_) => return None,
        };
        self.next += 1;
        Some((index, frame))
    }

    /// Time between a frame and the one before, where it is known without reading it.
    #[must_use]
    pub fn step_us(&self, index: usize) -> u32 {
        match &self.kind {
            Kind::Folder(folder) => folder.step_us(index),
            Kind::Turns(turns) => turns.step_us(index),
            Kind::Drive(_) => 0,
        }
    }

    /// Where the map's zero lies (easting, northing), and the EPSG code of its coordinates: for a drive.
    #[must_use]
    pub fn georeference(&self) -> Option<([f64; 2], u16)> {
        match &self.kind {
            Kind::Drive(drive) => Some((drive.origin(), drive.epsg()?)),
            _ => None,
        }
    }

    /// How the source was understood where there is more than one way, in words.
    #[must_use]
    pub fn remarks(&self) -> &[String] {
        match &self.kind {
            Kind::Folder(folder) => folder.remarks(),
            Kind::Turns(_) | Kind::Drive(_) => &[],
        }
    }

    /// What was lost on the way, in words; nothing if nothing was.
    #[must_use]
    pub fn losses(&self) -> Vec<String> {
        let mut said = Vec::new();
        let mut say = |count: u64, what: &str| {
            if count > 0 {
                said.push(format!("{count} {what}"));
            }
        };
        match &self.kind {
            Kind::Folder(_) => {}
            Kind::Turns(turns) => {
                let passed = turns.passed();
                say(passed.refused, "packets of a data packet's size are damaged or of another sensor");
                say(passed.incomplete, "turns left out: too much of them is missing");
                if passed.cut {
                    said.push("the capture ends within a packet".into());
                }
            }
            Kind::Drive(drive) => {
                say(drive.unplaced(), "scans without a position or an attitude are not in the map");
                say(drive.damage(), "damaged, broken or missing parts passed over; see `crossfall verify`");
            }
        }
        said
    }
}
