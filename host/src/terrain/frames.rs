//! Folders of 3-D frames in the KITTI odometry layout.
//!
//! `velodyne/NNNNNN.bin` holds x, y, z and intensity as little-endian f32; `poses.txt` one 3x4 row-major matrix a line;
//! `times.txt`, where there is one, seconds a line; `objects.csv`, where there is one, boxes of moving objects in the world frame.
//! Poses are sensor to world. Where a `calib.txt` with a `Tr` line lies beside them, poses are KITTI's own: of the left
//! camera (z ahead, y down), in the frame of the first one. They are then carried over to the LiDAR through `Tr`, and
//! the world is the first frame's LiDAR.
//!
//! Everything that is small is read and checked when the folder is opened; frames are read one by one.

use std::collections::BTreeMap;
use std::fs;
use std::io;
use std::path::{Path, PathBuf};

use crossfall_core::terrain::MovingBox;
use serde::Deserialize;

use super::lidar::SensorPose;

/// Largest frame that is read: 4 million points.
const LARGEST: u64 = 64 << 20;

/// What is wrong with a folder or a frame.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// A file that cannot be read.
    #[error("{}: {source}", path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// Why.
        source: io::Error,
    },
    /// No frames.
    #[error("{}: no frames: expected velodyne/NNNNNN.bin", .0.display())]
    NoFrames(PathBuf),
    /// A frame number is missing.
    #[error("{}: frame {missing} is missing although {last} exists", folder.display())]
    Gap {
        /// The folder of the frames.
        folder: PathBuf,
        /// First number without a file.
        missing: usize,
        /// Last number with one.
        last: usize,
    },
    /// A line that does not say what it should.
    #[error("{}, line {line}: {what}", path.display())]
    Line {
        /// The file.
        path: PathBuf,
        /// Counted from 1.
        line: usize,
        /// What was expected.
        what: String,
    },
    /// Too few lines for the frames.
    #[error("{}: {found} {what} for {frames} frames", path.display())]
    Count {
        /// The file.
        path: PathBuf,
        /// Lines found.
        found: usize,
        /// What they are.
        what: &'static str,
        /// Frames found.
        frames: usize,
    },
    /// A frame that is no list of points.
    #[error("{}: {bytes} bytes are no whole number of 16-byte points: {} at the end", path.display(), bytes % 16)]
    Size {
        /// The file.
        path: PathBuf,
        /// Its size.
        bytes: u64,
    },
    /// A frame too large to be one.
    #[error("{}: {bytes} bytes are more than any frame has ({LARGEST})", path.display())]
    Large {
        /// The file.
        path: PathBuf,
        /// Its size.
        bytes: u64,
    },
}

/// A row of `objects.csv`: a moving object, in the world.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize)]
pub struct ObjectRow {
    /// Frame that it was seen in.
    pub frame: usize,
    /// Centre, m.
    pub x: f64,
    /// Centre, m.
    pub y: f64,
    /// Centre, m.
    pub z: f64,
    /// m.
    pub length: f64,
    /// m.
    pub width: f64,
    /// m.
    pub height: f64,
    /// Radians from x towards y.
    pub yaw: f64,
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

/// An opened folder.
#[derive(Debug)]
pub struct FrameFolder {
    files: Vec<PathBuf>,
    poses: Vec<SensorPose>,
    times: Option<Vec<f64>>,
    objects: BTreeMap<usize, Vec<MovingBox>>,
}

/// Time between frames where no `times.txt` tells: ten turns a second.
const DEFAULT_STEP_US: u32 = 100_000;

impl FrameFolder {
    /// Opens a folder and reads all but its points.
    ///
    /// # Errors
    /// Missing or malformed files: with file, line and what was expected.
    pub fn open(folder: &Path) -> Result<Self, Error> {
        let files = list_frames(folder)?;
        let poses_path = folder.join("poses.txt");
        let mut poses = read_poses(&poses_path)?;
        if poses.len() < files.len() {
            return Err(Error::Count { path: poses_path, found: poses.len(), what: "poses", frames: files.len() });
        }
        let calibration = folder.join("calib.txt");
        if calibration.exists() {
            let tr = read_tr(&calibration)?;
            for pose in &mut poses {
                *pose = through_camera(pose, &tr);
            }
        }
        let times_path = folder.join("times.txt");
        let times = if times_path.exists() {
            let times = read_times(&times_path)?;
            if times.len() < files.len() {
                return Err(Error::Count { path: times_path, found: times.len(), what: "times", frames: files.len() });
            }
            Some(times)
        } else {
            None
        };
        let objects_path = folder.join("objects.csv");
        let objects = if objects_path.exists() { read_objects(&objects_path)? } else { BTreeMap::new() };
        Ok(Self { files, poses, times, objects })
    }

    /// Number of frames.
    #[must_use]
    pub fn len(&self) -> usize {
        self.files.len()
    }

    /// Whether there are none. An opened folder always has some.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.files.is_empty()
    }

    /// The file of a frame.
    #[must_use]
    pub fn file(&self, index: usize) -> Option<&Path> {
        self.files.get(index).map(PathBuf::as_path)
    }

    /// The sensor's pose in a frame.
    #[must_use]
    pub fn pose(&self, index: usize) -> Option<&SensorPose> {
        self.poses.get(index)
    }

    /// Boxes to reject in a frame.
    #[must_use]
    pub fn boxes(&self, index: usize) -> &[MovingBox] {
        self.objects.get(&index).map_or(&[], Vec::as_slice)
    }

    /// Microseconds since the frame before; 0 for the first.
    #[must_use]
    pub fn step_us(&self, index: usize) -> u32 {
        let Some(before) = index.checked_sub(1) else { return 0 };
        match &self.times {
            Some(times) => ((times[index] - times[before]) * 1e6).clamp(0.0, 4e9) as u32,
            None => DEFAULT_STEP_US,
        }
    }

    /// Reads a frame's points.
    ///
    /// # Errors
    /// A file that cannot be read or is not a whole number of points.
    pub fn points(&self, index: usize, out: &mut Vec<[f32; 4]>) -> Result<(), Error> {
        out.clear();
        let Some(path) = self.files.get(index) else { return Ok(()) };
        let read = |source| Error::Read { path: path.clone(), source };
        let bytes = fs::metadata(path).map_err(read)?.len();
        if bytes > LARGEST {
            return Err(Error::Large { path: path.clone(), bytes });
        }
        let data = fs::read(path).map_err(read)?;
        if data.len() % 16 != 0 {
            return Err(Error::Size { path: path.clone(), bytes: data.len() as u64 });
        }
        out.extend(data.chunks_exact(16).map(|point| {
            let value = |at: usize| f32::from_le_bytes([point[at], point[at + 1], point[at + 2], point[at + 3]]);
            [value(0), value(4), value(8), value(12)]
        }));
        Ok(())
    }

    /// The largest frame's number of points.
    ///
    /// # Errors
    /// A file whose size cannot be told.
    pub fn largest(&self) -> Result<usize, Error> {
        let mut most = 0;
        for path in &self.files {
            let bytes = fs::metadata(path).map_err(|source| Error::Read { path: path.clone(), source })?.len();
            most = most.max(bytes.min(LARGEST));
        }
        Ok((most / 16) as usize)
    }
}

fn list_frames(folder: &Path) -> Result<Vec<PathBuf>, Error> {
    let velodyne = folder.join("velodyne");
    let read = |source| Error::Read { path: velodyne.clone(), source };
    let mut numbered = BTreeMap::new();
    for entry in fs::read_dir(&velodyne).map_err(read)? {
        let path = entry.map_err(read)?.path();
        let number = path
            .extension()
            .filter(|extension| *extension == "bin")
            .and(path.file_stem())
            .and_then(|stem| stem.to_str())
            .and_then(|stem| stem.parse::<usize>().ok());
        if let Some(number) = number {
            numbered.insert(number, path);
        }
    }
    let Some(last) = numbered.keys().next_back().copied() else { return Err(Error::NoFrames(folder.into())) };
    if let Some(missing) =
        numbered.keys().copied().zip(0..).find_map(|(number, wanted)| (number != wanted).then_some(wanted))
    {
        return Err(Error::Gap { folder: velodyne, missing, last });
    }
    Ok(numbered.into_values().collect())
}

fn read_text(path: &Path) -> Result<String, Error> {
    fs::read_to_string(path).map_err(|source| Error::Read { path: path.into(), source })
}

fn numbers(path: &Path, line: usize, text: &str, count: usize) -> Result<Vec<f64>, Error> {
    let wrong = |what: String| Error::Line { path: path.into(), line, what };
    let mut values = Vec::with_capacity(count);
    for word in text.split_whitespace() {
        values.push(word.parse::<f64>().map_err(|_| wrong(format!("'{word}' is no number")))?);
    }
    if values.len() != count {
        return Err(wrong(format!("{} numbers, expected {count}", values.len())));
    }
    Ok(values)
}

fn matrix(values: &[f64]) -> SensorPose {
    let mut pose = SensorPose { rotation: [[0.0; 3]; 3], position: [0.0; 3] };
    for (axis, row) in values.chunks_exact(4).take(3).enumerate() {
        pose.rotation[axis].copy_from_slice(&row[..3]);
        pose.position[axis] = row[3];
    }
    pose
}

/// Reads poses. A pose that is not a number stays one that the map refuses, frame by frame.
fn read_poses(path: &Path) -> Result<Vec<SensorPose>, Error> {
    let mut poses = Vec::new();
    for (index, line) in read_text(path)?.lines().enumerate().filter(|(_, line)| !line.trim().is_empty()) {
        poses.push(matrix(&numbers(path, index + 1, line, 12)?));
    }
    Ok(poses)
}

fn read_times(path: &Path) -> Result<Vec<f64>, Error> {
    let mut times: Vec<f64> = Vec::new();
    for (index, line) in read_text(path)?.lines().enumerate().filter(|(_, line)| !line.trim().is_empty()) {
        let time = numbers(path, index + 1, line, 1)?[0];
        if times.last().is_some_and(|last| time < *last) || !time.is_finite() {
            let what = format!("time {time} does not follow the one before");
            return Err(Error::Line { path: path.into(), line: index + 1, what });
        }
        times.push(time);
    }
    Ok(times)
}

fn read_tr(path: &Path) -> Result<SensorPose, Error> {
    for (index, line) in read_text(path)?.lines().enumerate() {
        for name in ["Tr:", "Tr_velo_to_cam:"] {
            if let Some(rest) = line.trim().strip_prefix(name) {
                return Ok(matrix(&numbers(path, index + 1, rest, 12)?));
            }
        }
    }
    Err(Error::Line { path: path.into(), line: 1, what: "no line 'Tr:' (LiDAR to camera) in the file".into() })
}

/// A camera's pose to the LiDAR's, in the frame of the first LiDAR: inverse(Tr) x pose x Tr.
fn through_camera(pose: &SensorPose, tr: &SensorPose) -> SensorPose {
    let product = |a: &SensorPose, b: &SensorPose| {
        let mut out = SensorPose { rotation: [[0.0; 3]; 3], position: a.position };
        for row in 0..3 {
            for column in 0..3 {
                out.rotation[row][column] = (0..3).map(|k| a.rotation[row][k] * b.rotation[k][column]).sum();
            }
            out.position[row] += (0..3).map(|k| a.rotation[row][k] * b.position[k]).sum::<f64>();
        }
        out
    };
    let mut inverse = SensorPose { rotation: [[0.0; 3]; 3], position: [0.0; 3] };
    for row in 0..3 {
        for column in 0..3 {
            inverse.rotation[row][column] = tr.rotation[column][row];
        }
        inverse.position[row] = -(0..3).map(|k| tr.rotation[k][row] * tr.position[k]).sum::<f64>();
    }
    product(&inverse, &product(pose, tr))
}

fn read_objects(path: &Path) -> Result<BTreeMap<usize, Vec<MovingBox>>, Error> {
    let wrong = |error: csv::Error| {
        let line = error.position().map_or(1, |position| position.line() as usize);
        Error::Line { path: path.into(), line, what: format!("expected frame,x,y,z,length,width,height,yaw: {error}") }
    };
    let mut reader = csv::ReaderBuilder::new().trim(csv::Trim::All).from_path(path).map_err(wrong)?;
    let mut objects: BTreeMap<usize, Vec<MovingBox>> = BTreeMap::new();
    for row in reader.deserialize::<ObjectRow>() {
        let row = row.map_err(wrong)?;
        let sound = [row.x, row.y, row.z, row.length, row.width, row.height, row.yaw].iter().all(|v| v.is_finite());
        // The map draws outlines of up to 25 m: longer than any vehicle.
        if !sound || row.length <= 0.0 || row.width <= 0.0 || row.length + row.width > 40.0 {
            let what = format!("the box of frame {} has no sensible size", row.frame);
            return Err(Error::Line { path: path.into(), line: objects.len() + 2, what });
        }
        objects.entry(row.frame).or_default().push(row.outline());
    }
    Ok(objects)
}
