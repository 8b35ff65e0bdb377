//! Poses of frames: 3x4 matrices, trajectories with times, KITTI's camera poses with their calibration.
//!
//! A file of 12 numbers a line has one row-major 3x4 matrix a frame. One of 8 numbers a line is a trajectory as SLAM programs write
//! it (the "TUM" form): seconds, position, quaternion x y z w; a frame's pose is then interpolated at its time,
//! straight between positions and along the arc between attitudes, and a frame outside the trajectory, or in a hole of more than a
//! second, has none. Lines that begin with `#` are comments. Where a `calib.txt` with a `Tr` line lies beside, matrices are KITTI's own: of the left camera (z
//! ahead, y down), in the frame of the first one. They are then carried over to the LiDAR through `Tr`, and the world is
//! the first frame's LiDAR. A trajectory is the LiDAR's always.

use std::fs;
use std::path::Path;

use super::frames::Error;
use super::lidar::SensorPose;

/// Longest hole in a trajectory across which a pose is interpolated, s.
const LONGEST_S: f64 = 1.0;

/// Poses of a sequence of frames.
#[derive(Clone, Debug)]
pub enum Poses {
    /// One a frame.
    Frames(Vec<SensorPose>),
    /// Seconds and poses, in the order of time.
    Trajectory(Vec<(f64, SensorPose)>),
}

impl Poses {
    /// Reads a file of either form.
    ///
    /// # Errors
    /// A line that is neither, with its number.
    pub fn read(path: &Path) -> Result<Self, Error> {
        let text = read_text(path)?;
        let wrong = |line: usize, what: String| Error::Line { path: path.into(), line, what };
        let first = lines(&text).next();
        if first.is_some_and(|(_, line)| line.split_whitespace().count() == 8) {
            let mut all: Vec<(f64, SensorPose)> = Vec::new();
            for (line, text) in lines(&text) {
                let values = numbers(path, line, text, 8)?;
                let norm = values[4..].iter().map(|v| v * v).sum::<f64>().sqrt();
                // NaN fails as well.
                if !(norm > 0.9 && norm < 1.1) {
                    return Err(wrong(line, format!("the quaternion's length is {norm:.3}, expected 1")));
                }
                if !values[0].is_finite() || all.last().is_some_and(|(time, _)| values[0] <= *time) {
                    return Err(wrong(line, format!("time {} does not follow the one before", values[0])));
                }
                let quaternion = [values[4], values[5], values[6], values[7]].map(|v| v / norm);
                let pose = SensorPose { rotation: matrix_of(quaternion), position: [values[1], values[2], values[3]] };
                all.push((values[0], pose));
            }
            return Ok(Self::Trajectory(all));
        }
        let mut poses = Vec::new();
        for (line, text) in lines(&text) {
            poses.push(matrix(&numbers(path, line, text, 12)?));
        }
        Ok(Self::Frames(poses))
    }

    /// The pose of a frame, if there is one.
    #[must_use]
    pub fn of(&self, index: usize, time_s: Option<f64>) -> Option<SensorPose> {
        match self {
            Self::Frames(all) => all.get(index).copied(),
            Self::Trajectory(all) => {
                let time = time_s?;
                let after = all.partition_point(|(at, _)| *at < time);
                let (next, to) = all.get(after)?;
                if *next == time {
                    return Some(*to);
                }
                let (last, from) = all.get(after.checked_sub(1)?)?;
                let span = next - last;
                (span <= LONGEST_S).then(|| between(from, to, (time - last) / span))
            }
        }
    }

    /// Carries camera poses over to the LiDAR, see `calib.txt` above. Returns whether these are such.
    ///
    /// # Errors
    /// A file without a `Tr` line, or with a malformed one.
    pub fn calibrate(&mut self, calibration: &Path) -> Result<bool, Error> {
        let Self::Frames(all) = self else { return Ok(false) };
        let tr = read_tr(calibration)?;
        all.iter_mut().for_each(|pose| *pose = through_camera(pose, &tr));
        Ok(true)
    }
}

/// Between two poses: straight for the position; for the attitude along the arc, by the blend of both matrices made
/// orthogonal again. For the few degrees of a step the blend's speed along the arc is even within a thousandth.
fn between(from: &SensorPose, to: &SensorPose, part: f64) -> SensorPose {
    let blend = |a: f64, b: f64| a + (b - a) * part;
    let mut out = *from;
    for axis in 0..3 {
        out.position[axis] = blend(from.position[axis], to.position[axis]);
        for column in 0..3 {
            out.rotation[axis][column] = blend(from.rotation[axis][column], to.rotation[axis][column]);
        }
    }
    let [x, y, _] = out.rotation;
    let dot = |a: [f64; 3], b: [f64; 3]| a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
    let unit = |a: [f64; 3]| a.map(|v| v / dot(a, a).sqrt());
    let x = unit(x);
    let along = dot(x, y);
    let y = unit([y[0] - along * x[0], y[1] - along * x[1], y[2] - along * x[2]]);
    out.rotation = [x, y, [x[1] * y[2] - x[2] * y[1], x[2] * y[0] - x[0] * y[2], x[0] * y[1] - x[1] * y[0]]];
    out
}

fn matrix_of([x, y, z, w]: [f64; 4]) -> [[f64; 3]; 3] {
    [
        [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - z * w), 2.0 * (x * z + y * w)],
        [2.0 * (x * y + z * w), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - x * w)],
        [2.0 * (x * z - y * w), 2.0 * (y * z + x * w), 1.0 - 2.0 * (x * x + y * y)],
    ]
}

/// Lines that are neither empty nor comments, counted from 1.
fn lines(text: &str) -> impl Iterator<Item = (usize, &str)> {
    let numbered = text.lines().enumerate().map(|(index, line)| (index + 1, line.trim()));
    numbered.filter(|(_, line)| !line.is_empty() && !line.starts_with('#'))
}

pub(super) fn read_text(path: &Path) -> Result<String, Error> {
    fs::read_to_string(path).map_err(|source| Error::Read { path: path.into(), source })
}

pub(super) fn numbers(path: &Path, line: usize, text: &str, count: usize) -> Result<Vec<f64>, Error> {
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
