//! `crossfall risk FRAMES -o DIR`: elevation and driving risk maps from 3-D LiDAR frames, or of the road that a drive has passed.
//!
//! Reads a folder of frames, a Velodyne's network capture or a log and writes `elevation.tif`, `sigma.tif`, `risk.tif`, `class.tif` (GeoTIFF),
//! `risk.png` (shade is degree) and, on request, `cells.csv` and one picture a frame. What the window leaves behind waits in the
//! output's folder, so that memory does not grow with the map. `--at` stops after a frame, so that what was known then can be judged. A frame that cannot be trusted is left out, told on stderr and counted; the map
//! is never touched by it, and the command ends with 3.

use std::fs;
use std::path::{Path, PathBuf};
use std::time::Instant;

use anyhow::{Context, Result, anyhow, bail};
use crossfall::interrupt;
use crossfall::terrain::frames::{self, Choices};
use crossfall::terrain::lidar::SensorPose;
use crossfall::terrain::map_files::{self, Cells};
use crossfall::terrain::mapper::{Kept, Mapper};
use crossfall::terrain::picture::{Picture, View};
use crossfall::terrain::raster::Grid;
use crossfall::terrain::source::{Frame, Source};
use crossfall_core::terrain::{FrameReport, Refusal, TerrainConfig};

use super::progress::Progress;
use super::{Outcome, drives, number, say, say_json, tell};

/// Elevation and driving risk maps (GeoTIFF, PNG, CSV of cells) from 3-D LiDAR frames
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  crossfall simulate --terrain -o frames
  crossfall risk frames -o maps --csv
  crossfall risk frames -o maps --at 20 --series 5 --live
  crossfall risk dataset/sequences/00 -o maps        (KITTI's folders and poses)
  crossfall risk scans -o maps --poses slam.txt      (PCD, LAS or LAZ files)
  crossfall risk puck.pcap -o maps --poses slam.txt  (VLP-16, HDL-32E)
  crossfall risk drive.log.mcap -o maps              (the road just passed)")]
pub struct Args {
    /// Folder with velodyne/NNNNNN.bin, or one .pcd, .las or .laz file a frame, and poses.txt; times.txt, calib.txt and
    /// objects.csv are used where there are any. Or a Velodyne's .pcap or .pcapng. Or the log of a drive
    frames: PathBuf,
    /// Folder for the maps; made if there is none
    #[arg(short, long, value_name = "DIR")]
    output: PathBuf,
    /// Poses: 12 numbers a frame (3x4, row-major), or a trajectory of 8 a line (seconds, position, quaternion x y z w)
    /// instead of the folder's own
    #[arg(long, value_name = "FILE")]
    poses: Option<PathBuf>,
    /// The points of a folder's frames are in the world's axes, not in the sensor's
    #[arg(long)]
    world_points: bool,
    /// Also write cells.csv: x_m,y_m,elevation_m,sigma_m,risk,class
    #[arg(long)]
    csv: bool,
    /// Stop after this frame (0-based): what was known then
    #[arg(long, value_name = "FRAME")]
    at: Option<usize>,
    /// How far ahead the map is kept, m
    #[arg(long, value_name = "M", default_value_t = 60.0, value_parser = number(5.0_f32, 150.0))]
    range: f32,
    /// Side of a cell, m
    #[arg(long, value_name = "M", default_value_t = 0.1, value_parser = number(0.05_f32, 0.5))]
    cell: f32,
    /// Radius of the wheel that takes the steps, m
    #[arg(long, value_name = "M", default_value_t = 0.32, value_parser = number(0.05_f32, 2.0))]
    wheel: f32,
    /// A picture of the surroundings every so many frames, in DIR/series
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..))]
    series: Option<u32>,
    /// Only the map around the vehicle: forget what the window leaves behind
    #[arg(long)]
    window: bool,
    /// Tell milliseconds, points and cells of every frame on stderr
    #[arg(long)]
    live: bool,
    /// Print the summary as JSON
    #[arg(long)]
    json: bool,
}

/// What happened to the frames of a run.
#[derive(Debug, Default, serde::Serialize)]
struct Summary {
    frames: usize,
    mapped: usize,
    refused: usize,
    restarts: usize,
    points: u64,
    points_not_finite: u64,
    points_over_capacity: u64,
    boxes_refused: u64,
    cells: u64,
    cells_slow: u64,
    cells_stop: u64,
    ms_per_frame_median: f64,
    ms_per_frame_worst: f64,
    /// Lent to the map.
    map_bytes: usize,
    /// What it left behind: tiles, and what they took in memory and, while the command ran, on the disk.
    tiles_behind: usize,
    behind_bytes: u64,
    behind_disk_bytes: u64,
}

pub fn run(args: &Args) -> Result<Outcome> {
    let choices = Choices { poses: args.poses.clone(), world_points: args.world_points };
    drives::of(std::slice::from_ref(&args.frames));
    let mut source = Source::open(&args.frames, &choices)?;
    if let (Some(last), Some(count)) = (args.at, source.frames())
        && last >= count
    {
        bail!("--at {last}: there are frames 0 to {}", count - 1);
    }
    for remark in source.remarks() {
        tell!("{remark}");
    }
    let last = args.at.or(source.frames().map(|count| count - 1)).unwrap_or(usize::MAX);
    fs::create_dir_all(&args.output).with_context(|| format!("creating {}", args.output.display()))?;
    let series = args.output.join("series");
    if args.series.is_some() {
        fs::create_dir_all(&series).with_context(|| format!("creating {}", series.display()))?;
    }
    let config = TerrainConfig { cell_m: args.cell, wheel_radius_mm: args.wheel * 1000.0, ..TerrainConfig::default() };
    // Frames above a million points are thinned by nobody here: the core counts what does not fit.
    let capacity = source.largest()?.clamp(1, 1 << 20);
    let mut workshop = source.workshop(config, args.range, capacity);
    let summary = Summary { map_bytes: workshop.bytes(), ..Summary::default() };
    let mut mapper = workshop.open().map_err(|what| anyhow!("the map cannot be set up: {what:?}"))?;
    if args.window {
        mapper.forget_behind();
    } else {
        mapper.keep_in(&args.output).with_context(|| format!("keeping the map in {}", args.output.display()))?;
    }

    let progress = Progress::new("risk", source.frames().map_or(0, |count| count.min(last + 1)) as u64);
    let mut points = Vec::new();
    let mut run = Run { args, mapper, summary, times: Vec::new(), vehicle: None, step_us: 0, cut: false };
    let mut seen = 0;
    while let Some((index, frame)) = source.next(&mut points) {
        if interrupt::requested() {
            bail!("interrupted");
        }
        seen = index + 1;
        progress.at(index as u64);
        match frame {
            Ok(frame) => run.take(&frame, &points)?,
            Err(error) => run.leave_out(index, source.step_us(index), &error),
        }
        if run.cut || index >= last {
            break;
        }
    }
    drop(progress);
    if let Some(wanted) = args.at.filter(|wanted| *wanted >= seen && !run.cut) {
        bail!("--at {wanted}: there are {seen} frames, counted from 0");
    }
    run.finish(&source)
}

/// A map in the making.
struct Run<'a> {
    args: &'a Args,
    mapper: Mapper<'a>,
    summary: Summary,
    /// Milliseconds of each frame that is in the map.
    times: Vec<f64>,
    /// The pose of the last of them.
    vehicle: Option<SensorPose>,
    /// Since the last frame that reached the map: frames that could not be read count as well.
    step_us: u32,
    /// The map has become too large to be written: it ends.
    cut: bool,
}

impl Run<'_> {
    /// Counts a frame that could not be read.
    fn leave_out(&mut self, index: usize, step_us: u32, error: &frames::Error) {
        tell!("frame {index}: left out: {error}");
        self.step_us = self.step_us.saturating_add(step_us);
        self.summary.frames += 1;
        self.summary.refused += 1;
    }

    /// Takes a frame into the map.
    fn take(&mut self, frame: &Frame, points: &[[f32; 4]]) -> Result<()> {
        let (args, index) = (self.args, frame.index);
        let step_us = std::mem::take(&mut self.step_us).saturating_add(frame.step_us);
        let started = Instant::now();
        let report = self
            .mapper
            .integrate(points, &frame.pose, step_us, &frame.boxes)
            .with_context(|| format!("keeping the map in {}", args.output.display()))?;
        let ms = started.elapsed().as_secs_f64() * 1e3;
        self.summary.account(&report);
        tell_frame(index, &report);
        if report.refused.is_none() {
            self.times.push(ms);
            self.vehicle = Some(frame.pose);
        }
        if args.live {
            tell_live(index, ms, &report);
        }
        if let Some(every) = args.series
            && index % every as usize == 0
            && let Some(pose) = &self.vehicle
        {
            self.mapper.refresh();
            let path = args.output.join("series").join(format!("{index:06}.png"));
            draw_window(&self.mapper, args.range, pose, &path)?;
        }
        if let Err(large) = Grid::check(&self.mapper) {
            tell!("frame {index}: the map ends here: {large}");
            self.cut = true;
        }
        Ok(())
    }

    /// Writes the maps and says what became of the frames.
    fn finish(self, source: &Source) -> Result<Outcome> {
        let Self { args, mut mapper, mut summary, mut times, vehicle, cut, .. } = self;
        let Some(vehicle) = vehicle else { bail!("none of the {} frames could be used", summary.frames) };
        mapper.refresh();
        let losses = source.losses();
        for loss in &losses {
            tell!("{loss}");
        }
        if summary.boxes_refused > 0 {
            tell!("{} boxes of moving objects are larger than any vehicle and were not used", summary.boxes_refused);
        }
        write_maps(args, &mapper, source.georeference(), &vehicle, &mut summary)?;
        times.sort_by(f64::total_cmp);
        summary.ms_per_frame_median = times[times.len() / 2];
        summary.ms_per_frame_worst = times[times.len() - 1];
        summary.print(args.json)?;
        let lost = summary.refused > 0 || summary.points_over_capacity > 0 || summary.boxes_refused > 0;
        Ok(Outcome::lost_if(lost || cut || !losses.is_empty()))
    }
}

/// The surroundings of a vehicle, most of them ahead.
fn around(pose: &SensorPose, range: f32, cell_m: f64, zoom: usize) -> View {
    let range = f64::from(range);
    let ahead = |axis: usize| pose.position[axis] + pose.rotation[axis][0] * 0.42 * range;
    View::around([ahead(0), ahead(1)], 0.6 * range, cell_m, zoom)
}

/// Draws what the map's window knows; nothing if that is nothing.
fn draw_window(mapper: &Mapper<'_>, range: f32, vehicle: &SensorPose, path: &Path) -> Result<()> {
    let Some(grid) = Grid::of_window(mapper) else { return Ok(()) };
    let mut picture = Picture::new(around(vehicle, range, grid.cell_m, 1), grid.cell_m);
    for block in grid.blocks(mapper) {
        picture.draw(&block?);
    }
    picture.write(vehicle, path)
}

fn write_maps(
    args: &Args,
    mapper: &Mapper<'_>,
    georeference: Option<([f64; 2], u16)>,
    vehicle: &SensorPose,
    summary: &mut Summary,
) -> Result<()> {
    let grid = Grid::of(mapper).ok_or_else(|| anyhow!("the frames hold no ground"))?;
    let near = args.at.is_some() || args.window;
    let view = if near { around(vehicle, args.range, grid.cell_m, 2) } else { View::whole(&grid) };
    let choices = map_files::Choices { georeference, table: args.csv, view, vehicle: *vehicle };
    let progress = Progress::new("writing", grid.known_blocks() as u64);
    let Cells { known, slow, stop } = map_files::write(mapper, &grid, &args.output, &choices, |written| {
        progress.at(written);
        if interrupt::requested() {
            bail!("interrupted");
        }
        Ok(())
    })?;
    (summary.cells, summary.cells_slow, summary.cells_stop) = (known, slow, stop);
    let Kept { tiles, memory, disk } = mapper.kept();
    (summary.tiles_behind, summary.behind_bytes, summary.behind_disk_bytes) = (tiles, memory, disk);
    Ok(())
}

/// Says on stderr what a frame took and gave.
fn tell_live(index: usize, ms: f64, report: &FrameReport) {
    let (counts, [tilt_x, tilt_y]) = (&report.points, report.alignment.tilt_mm_per_m);
    tell!(
        "frame {index}: {ms:.2} ms, {} points, {} fused, {} standing, {} tiles refreshed, lift {:+.1} mm, tilt {tilt_x:+.2} {tilt_y:+.2} mm/m",
        counts.given,
        counts.fused,
        counts.standing,
        report.refreshed,
        report.alignment.lift_mm
    );
}

/// Says on stderr what was wrong with a frame.
fn tell_frame(index: usize, report: &FrameReport) {
    let why = match report.refused {
        None if report.restarted => "the map begins anew: the vehicle went on from elsewhere",
        None => return,
        Some(Refusal::Pose) => "left out: its pose is no rotation and position",
        Some(Refusal::Jump) => "left out: its pose does not continue the motion",
        Some(Refusal::NoPoints) => "left out: no usable point",
        Some(Refusal::Misfit) => "left out: it does not lie on the map",
    };
    tell!("frame {index}: {why}");
}

impl Summary {
    fn account(&mut self, report: &FrameReport) {
        self.frames += 1;
        self.mapped += usize::from(report.refused.is_none());
        self.refused += usize::from(report.refused.is_some());
        self.restarts += usize::from(report.restarted);
        self.boxes_refused += u64::from(report.boxes_refused);
        self.points += u64::from(report.points.given);
        self.points_not_finite += u64::from(report.points.not_finite);
        self.points_over_capacity += u64::from(report.points.over_capacity);
    }

    fn print(&self, json: bool) -> Result<()> {
        if json {
            return say_json(self);
        }
        let lines = [
            format!("frames       {} of {} mapped, {} left out", self.mapped, self.frames, self.refused),
            format!(
                "points       {}, {} not finite, {} over capacity",
                self.points, self.points_not_finite, self.points_over_capacity
            ),
            format!("cells        {}: {} slow down, {} stop", self.cells, self.cells_slow, self.cells_stop),
            format!(
                "time         {:.2} ms a frame (median), {:.2} worst",
                self.ms_per_frame_median, self.ms_per_frame_worst
            ),
            format!(
                "memory       {:.1} MB of map, {:.1} MB for {} tiles behind it ({:.1} MB on the disk meanwhile)",
                self.map_bytes as f64 * 1e-6,
                self.behind_bytes as f64 * 1e-6,
                self.tiles_behind,
                self.behind_disk_bytes as f64 * 1e-6
            ),
        ];
        Ok(say(&lines.join("\n"))?)
    }
}
