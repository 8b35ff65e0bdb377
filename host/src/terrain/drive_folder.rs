//! A simulated drive with a spinning LiDAR as a folder.
//!
//! The folder follows the KITTI odometry layout (`velodyne/NNNNNN.bin`, `poses.txt`, `times.txt`) and carries its
//! truth: `truth.csv` (the ground around the road on the map's own cells), `truth_poses.txt` (poses without noise)
//! and `scene.toml` (the scene as it was simulated). The same scene and seed give the same bytes.
//!
//! The drive appears whole: all of it is made under temporary names in the folder and takes its own once nothing is missing. What fails or is interrupted before
//! leaves the folder as it was. An earlier simulated drive is replaced, all of its frames included; other frames are somebody's recording, and refused.

use std::fs;
use std::io::{self, Write};
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, ensure};

use super::drive::TerrainScene;
use super::lidar::SensorPose;
use crate::interrupt;
use crate::output::{self, Output};
use crate::table::rounded;

/// Files by which a simulated drive is known: recordings have neither.
const OWN: [&str; 2] = ["scene.toml", "truth_poses.txt"];

impl TerrainScene {
    /// Writes the whole drive into a folder; `progress` is told the number of frames written.
    ///
    /// # Errors
    /// A scene out of range, a folder with frames that were not simulated, a file that cannot be written, or the user's wish to stop.
    pub fn write(&self, folder: &Path, progress: impl FnMut(u32)) -> Result<()> {
        self.check()?;
        let velodyne = folder.join("velodyne");
        let earlier = frames(&velodyne)?;
        ensure!(
            earlier.is_empty() || OWN.iter().all(|name| folder.join(name).is_file()),
            "{}: holds frames that were not simulated; name another folder",
            velodyne.display()
        );
        let made = !folder.exists();
        fs::create_dir_all(folder).with_context(|| format!("creating {}", folder.display()))?;
        let written = self.write_over(folder, &velodyne, &earlier, progress);
        if made && written.is_err() {
            // One that somebody has put something into meanwhile stays.
            let _ = fs::remove_dir(folder);
        }
        written
    }

    fn write_over(
        &self,
        folder: &Path,
        velodyne: &Path,
        earlier: &[Frame],
        mut progress: impl FnMut(u32),
    ) -> Result<()> {
        // The error would name the temporary folder, which nobody knows.
        let part = tempfile::Builder::new().prefix(".velodyne").suffix(".part").tempdir_in(folder);
        let part = part.map_err(|error| wrong(velodyne, error.kind().into()))?;
        let create = |name: &str| Output::create(&folder.join(name));
        let (mut poses, mut truth_poses) = (create("poses.txt")?, create("truth_poses.txt")?);
        let (mut times, mut scene, mut truth) = (create("times.txt")?, create("scene.toml")?, create("truth.csv")?);
        for index in 0..self.frames {
            ensure!(!interrupt::requested(), "interrupted");
            let frame = self.frame(index)?;
            let bytes: Vec<u8> = frame.points.iter().flatten().flat_map(|value| value.to_le_bytes()).collect();
            let name = file_name(index);
            output::write(&part.path().join(&name), &bytes)
                .map_err(|error| output::Error { path: velodyne.join(&name), ..error })?;
            line(&mut poses, &pose_line(&frame.reported))?;
            line(&mut truth_poses, &pose_line(&frame.truth))?;
            line(&mut times, &format!("{:.6}", frame.time_s))?;
            progress(index + 1);
        }
        line(&mut scene, toml::to_string_pretty(self)?.trim_end())?;
        self.write_truth(&mut truth)?;
        let mut files = [poses, truth_poses, times, scene, truth];
        for file in &mut files {
            // A disk that is full says so here and not between frames and poses.
            file.flush().map_err(|source| wrong(file.path(), source))?;
        }

        fs::create_dir_all(velodyne).map_err(|source| wrong(velodyne, source))?;
        for name in (0..self.frames).map(file_name) {
            let to = velodyne.join(&name);
            fs::rename(part.path().join(&name), &to).map_err(|source| wrong(&to, source))?;
        }
        for old in earlier.iter().filter(|old| old.number >= self.frames) {
            fs::remove_file(&old.path).map_err(|source| wrong(&old.path, source))?;
        }
        files.into_iter().try_for_each(Output::commit)?;
        Ok(())
    }

    /// The ground around the road, on 0.1 m cells of the world frame: 15 m behind the start to 70 m past the end,
    /// up to 3 m outside the curbs.
    fn write_truth(&self, out: &mut Output) -> Result<()> {
        line(out, "x_m,y_m,elevation_m,surface")?;
        let end = self.station(f64::from(self.frames) / self.lidar.rate_hz) + 70.0;
        let reach = 3.0 + self.road.left_curb_m.max(-self.road.right_curb_m);
        let corners: Vec<(f64, f64)> = (-15..=end as i32)
            .flat_map(|s| [-reach, reach].map(|lateral| self.road.place(f64::from(s), lateral)))
            .map(|(x, y, _)| (x + self.origin_m[0], y + self.origin_m[1]))
            .collect();
        let bound = |pick: fn(&(f64, f64)) -> f64| {
            let low = corners.iter().map(pick).fold(f64::INFINITY, f64::min);
            let high = corners.iter().map(pick).fold(f64::NEG_INFINITY, f64::max);
            ((low * 10.0).floor() as i64, (high * 10.0).ceil() as i64)
        };
        let (x_low, x_high) = bound(|corner| corner.0);
        let (y_low, y_high) = bound(|corner| corner.1);
        for iy in y_low..y_high {
            ensure!(!interrupt::requested(), "interrupted");
            for ix in x_low..x_high {
                let (wx, wy) = (ix as f64 * 0.1 + 0.05, iy as f64 * 0.1 + 0.05);
                let (x, y) = (wx - self.origin_m[0], wy - self.origin_m[1]);
                let (station, lateral) = self.road.locate(x, y);
                if station < -15.0 || station > end || self.road.outside(lateral) > 3.0 {
                    continue;
                }
                let z = rounded(self.road.height(x, y) + self.origin_m[2], 4);
                line(out, &format!("{wx:.2},{wy:.2},{z:.4},{}", self.road.surface(station, lateral).name()))?;
            }
        }
        Ok(())
    }
}

/// A frame of an earlier drive.
struct Frame {
    number: u32,
    path: PathBuf,
}

/// Frames by their numbers; none where there is no folder.
fn frames(velodyne: &Path) -> Result<Vec<Frame>> {
    let entries = match fs::read_dir(velodyne) {
        Ok(entries) => entries,
        Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(Vec::new()),
        Err(error) => return Err(error).with_context(|| velodyne.display().to_string()),
    };
    let mut frames = Vec::new();
    for entry in entries {
        let path = entry.with_context(|| velodyne.display().to_string())?.path();
        let name = path.file_name().and_then(|name| name.to_str());
        if let Some(number) = name.and_then(|name| name.strip_suffix(".bin")).and_then(|number| number.parse().ok()) {
            frames.push(Frame { number, path });
        }
    }
    Ok(frames)
}

fn file_name(index: u32) -> String {
    format!("{index:06}.bin")
}

fn line(out: &mut Output, line: &str) -> Result<(), output::Error> {
    let written = writeln!(out, "{line}");
    written.map_err(|source| wrong(out.path(), source))
}

fn wrong(path: &Path, source: io::Error) -> output::Error {
    output::Error { path: path.to_path_buf(), source }
}

/// A pose as a line of `poses.txt`: 3x4 row-major, sensor to world.
fn pose_line(pose: &SensorPose) -> String {
    let mut line = String::new();
    for (row, position) in pose.rotation.iter().zip(pose.position) {
        for value in row.iter().chain([&position]) {
            if !line.is_empty() {
                line.push(' ');
            }
            line.push_str(&format!("{value:.9e}"));
        }
    }
    line
}
