//! Folders of 3-D frames.
//!
//! The KITTI odometry layout: `velodyne/NNNNNN.bin` holds x, y, z and intensity as little-endian f32. Beside it, or in the folder itself or its
//! `frames`: a sequence of PCD, LAS or LAZ files, one a frame, in the order of the numbers (or else the names) they bear.
//! `poses.txt` has the poses ([`Poses`]), sensor to world, or another file that the user names, or what the KITTI data set has for
//! `sequences/NN`: `../../poses/NN.txt`. `times.txt`, where there is one, has seconds a line; `objects.csv`, where there is one, boxes
//! of moving objects in the world frame. As many poses or times as frames are theirs, one after the other. Of more, as where only a part of a drive
//! was copied, each frame has the one that its file's number names, counted from 0, and so with objects; what no number can settle is refused.
//!
//! Points are in the sensor's axes, unless the user says that they are in the world's: they are then taken back by the
//! frame's pose, in `f64`.
//!
//! Everything that is small is read and checked when the folder is opened; frames are read one by one.

mod listing;
mod objects;

use std::collections::BTreeMap;
use std::fs;
use std::io;
use std::path::{Path, PathBuf};

use crossfall_core::terrain::MovingBox;

use listing::{Format, list_frames};
use objects::read_objects;

use super::lidar::SensorPose;
use super::poses::{Poses, numbers, read_text};
use super::{las_frames, pcd};

/// Most points of a frame that is read.
pub(super) const MOST_POINTS: u64 = 4 << 20;

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
    #[error("{}: no frames: expected velodyne/NNNNNN.bin, or numbered .pcd, .las or .laz files", .0.display())]
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
    /// Too few lines for the frames, or more of which nothing tells whose they are.
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
    #[error("{}: {bytes} bytes are more than any frame has ({MOST_POINTS} points)", path.display())]
    Large {
        /// The file.
        path: PathBuf,
        /// Its size.
        bytes: u64,
    },
    /// A frame of a format that says what is wrong.
    #[error("{}, byte {offset}: {what}", path.display())]
    Format {
        /// The file.
        path: PathBuf,
        /// Where.
        offset: u64,
        /// What was expected.
        what: String,
    },
    /// A frame without a pose.
    #[error("frame {0} has no pose: it lies outside the trajectory, or in a hole of it")]
    NoPose(usize),
    /// The LAS library refuses.
    #[error("{}: {source}", path.display())]
    Las {
        /// The file.
        path: PathBuf,
        /// Why.
        source: las::Error,
    },
    /// A log cannot be read.
    #[error(transparent)]
    Log(#[from] crate::container::Error),
    /// Returns that cannot be placed.
    #[error(transparent)]
    Cloud(#[from] crate::cloud::Error),
    /// A place that is not on the map.
    #[error(transparent)]
    Place(#[from] crate::geodesy::Error),
}

/// What the user says of frames beyond what the folder tells.
#[derive(Clone, Debug, Default)]
pub struct Choices {
    /// A file of poses instead of the folder's own.
    pub poses: Option<PathBuf>,
    /// Points are in the world's axes.
    pub world_points: bool,
}

/// An opened folder.
#[derive(Debug)]
pub struct FrameFolder {
    files: Vec<PathBuf>,
    format: Format,
    poses: Poses,
    times: Option<Vec<f64>>,
    objects: BTreeMap<usize, Vec<MovingBox>>,
    /// Which pose, time and number of objects the first frame has; the others follow.
    first: First,
    world_points: bool,
    remarks: Vec<String>,
}

/// See [`FrameFolder`].
#[derive(Clone, Copy, Debug, Default)]
struct First {
    pose: usize,
    time: usize,
    object: usize,
}

/// Time between frames where no `times.txt` tells: ten turns a second.
const DEFAULT_STEP_US: u32 = 100_000;

impl FrameFolder {
    /// Opens a folder and reads all but its points.
    ///
    /// # Errors
    /// Missing or malformed files: with file, line and what was expected.
    pub fn open(folder: &Path, choices: &Choices) -> Result<Self, Error> {
        let (listed, format) = list_frames(folder)?;
        let mut remarks = Vec::new();
        let mut first = First::default();
        let poses_path = choices.poses.clone().unwrap_or_else(|| own_poses(folder));
        let mut poses = Poses::read(&poses_path)?;
        let times_path = folder.join("times.txt");
        let times = if times_path.exists() {
            let times = read_times(&times_path)?;
            first.time = listed.first_of(&times_path, "times", times.len(), &mut remarks)?;
            Some(times)
        } else {
            None
        };
        match &poses {
            Poses::Frames(all) => first.pose = listed.first_of(&poses_path, "poses", all.len(), &mut remarks)?,
            Poses::Trajectory(_) if times.is_none() => {
                let what = "a trajectory needs times.txt beside the frames".into();
                return Err(Error::Line { path: poses_path, line: 1, what });
            }
            Poses::Trajectory(_) => {}
        }
        let calibration = folder.join("calib.txt");
        if calibration.exists() && poses.calibrate(&calibration)? {
            let (poses, calibration) = (poses_path.display(), calibration.display());
            remarks.push(format!("{poses}: poses of the camera, taken to the LiDAR through {calibration}"));
        }
        let objects_path = folder.join("objects.csv");
        let objects = if objects_path.exists() { read_objects(&objects_path)? } else { BTreeMap::new() };
        first.object = first.pose.max(first.time);
        let (files, world_points) = (listed.files, choices.world_points);
        Ok(Self { files, format, poses, times, objects, first, world_points, remarks })
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

    /// How poses and times were understood where there is more than one way, in words.
    #[must_use]
    pub fn remarks(&self) -> &[String] {
        &self.remarks
    }

    /// The sensor's pose in a frame.
    #[must_use]
    pub fn pose(&self, index: usize) -> Option<SensorPose> {
        let time_s = self.times.as_ref().and_then(|times| times.get(self.first.time + index).copied());
        self.poses.of(self.first.pose + index, time_s)
    }

    /// Boxes to reject in a frame.
    #[must_use]
    pub fn boxes(&self, index: usize) -> &[MovingBox] {
        self.objects.get(&(self.first.object + index)).map_or(&[], Vec::as_slice)
    }

    /// Microseconds since the frame before; 0 for the first.
    #[must_use]
    pub fn step_us(&self, index: usize) -> u32 {
        let Some(before) = index.checked_sub(1) else { return 0 };
        match &self.times {
            Some(times) => {
                let time_s = |index| times[self.first.time + index];
                ((time_s(index) - time_s(before)) * 1e6).clamp(0.0, 4e9) as u32
            }
            None => DEFAULT_STEP_US,
        }
    }

    /// Reads a frame's points, in the sensor's axes.
    ///
    /// # Errors
    /// A file that cannot be read or is no frame, or points in the world's axes of a frame without a pose.
    pub fn points(&self, index: usize, out: &mut Vec<[f32; 4]>) -> Result<(), Error> {
        out.clear();
        let Some(path) = self.files.get(index) else { return Ok(()) };
        let from = if self.world_points { Some(self.pose(index).ok_or(Error::NoPose(index))?) } else { None };
        let mut put = |[x, y, z]: [f64; 3], intensity: f32| {
            let [x, y, z] = from.as_ref().map_or([x, y, z], |pose| pose.back([x, y, z]));
            out.push([x as f32, y as f32, z as f32, intensity]);
        };
        match self.format {
            Format::Las => las_frames::read(path, &mut put),
            Format::Pcd => pcd::read(path, &load(path)?, &mut put),
            Format::Kitti => {
                let data = load(path)?;
                if data.len() % 16 != 0 {
                    return Err(Error::Size { path: path.clone(), bytes: data.len() as u64 });
                }
                for point in data.as_chunks::<16>().0 {
                    let value =
                        |at: usize| f32::from_le_bytes([point[at], point[at + 1], point[at + 2], point[at + 3]]);
                    put([value(0), value(4), value(8)].map(f64::from), value(12));
                }
                Ok(())
            }
        }
    }

    /// The largest frame's number of points, or a bound of it.
    ///
    /// # Errors
    /// A file whose size cannot be told.
    pub fn largest(&self) -> Result<usize, Error> {
        let mut most = 0;
        for path in &self.files {
            let points = match self.format {
                Format::Las => las_frames::count(path)?,
                Format::Pcd => pcd::count(path)?,
                Format::Kitti => size(path)? / 16,
            };
            most = most.max(points.min(MOST_POINTS));
        }
        Ok(most as usize)
    }
}

fn size(path: &Path) -> Result<u64, Error> {
    fs::metadata(path).map(|found| found.len()).map_err(|source| Error::Read { path: path.into(), source })
}

/// A whole file, if it is not larger than any frame.
fn load(path: &Path) -> Result<Vec<u8>, Error> {
    let bytes = size(path)?;
    // Text takes up to 64 bytes a point.
    if bytes > MOST_POINTS * 64 {
        return Err(Error::Large { path: path.into(), bytes });
    }
    fs::read(path).map_err(|source| Error::Read { path: path.into(), source })
}

/// `poses.txt` beside the frames, or where the KITTI data set keeps those of `sequences/NN`.
fn own_poses(folder: &Path) -> PathBuf {
    let own = folder.join("poses.txt");
    let full = fs::canonicalize(folder).unwrap_or_else(|_| folder.into());
    let kitti = full.file_name().zip(full.parent().and_then(Path::parent)).map(|(name, root)| {
        let mut name = name.to_owned();
        name.push(".txt");
        root.join("poses").join(name)
    });
    match kitti.filter(|kitti| !own.exists() && kitti.exists()) {
        Some(kitti) => kitti,
        None => own,
    }
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
