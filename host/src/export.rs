//! A log as other viewers know such things: an MCAP file with Foxglove's well-known schemas, in JSON.
//!
//! | topic | schema | what |
//! |---|---|---|
//! | `/scan` | foxglove.LaserScan | the ranges as sent, angles from the vehicle's right, however the scanner is mounted |
//! | `/points` | foxglove.PointCloud | the levelled returns in the frame `level` |
//! | `/tf` | foxglove.FrameTransform | `level` (scanner, heading and pitch, without roll) in `map` (metres east, north, up from the first place) |
//! | `/location` | foxglove.LocationFix | where the scanner was |
//! | `/profile` | crossfall.Profile | both sides' slopes, as in the table |
//!
//! Times are GPS time as Unix nanoseconds (UTC, less the leap seconds of its day) where it is known, else device time. Messages stream.

use std::collections::BTreeMap;
use std::f64::consts::PI;
use std::path::{Path, PathBuf};

use crossfall_core::scan::Points;
use mcap::records::MessageHeader;
use serde_json::{Map, Value as Json, json};

use crate::calendar::unix_of_gps;
use crate::geodesy::{Geodetic, between};
use crate::output::{self, Output};
use crate::profiles::sides;
use crate::table::{Record, Value};
use crate::track::Turn;
use crate::walk::{Step, Walk};
use crate::{container, interrupt, units};

/// A log could not be exported.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// The log cannot be read.
    #[error(transparent)]
    Log(#[from] container::Error),
    /// The file cannot be written.
    #[error(transparent)]
    Output(#[from] output::Error),
    /// The MCAP library refuses.
    #[error("{}: {source}", path.display())]
    Mcap {
        /// The file.
        path: PathBuf,
        /// Why.
        source: mcap::McapError,
    },
}

/// What was made.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Made {
    /// Profiles exported.
    pub profiles: u64,
    /// Damaged, broken or missing parts passed over.
    pub damage: u64,
}

/// The topics, each with its schema's name and its fields with their JSON types.
/// A topic, its schema and the schema's fields.
type Topic = (&'static str, &'static str, &'static [(&'static str, &'static str)]);

const TOPICS: [Topic; 5] = [
    (
        "/scan",
        "foxglove.LaserScan",
        &[
            ("timestamp", "object"),
            ("frame_id", "string"),
            ("pose", "object"),
            ("start_angle", "number"),
            ("end_angle", "number"),
            ("ranges", "array"),
            ("intensities", "array"),
        ],
    ),
    (
        "/points",
        "foxglove.PointCloud",
        &[
            ("timestamp", "object"),
            ("frame_id", "string"),
            ("pose", "object"),
            ("point_stride", "integer"),
            ("fields", "array"),
            ("data", "string"),
        ],
    ),
    (
        "/tf",
        "foxglove.FrameTransform",
        &[
            ("timestamp", "object"),
            ("parent_frame_id", "string"),
            ("child_frame_id", "string"),
            ("translation", "object"),
            ("rotation", "object"),
        ],
    ),
    (
        "/location",
        "foxglove.LocationFix",
        &[
            ("timestamp", "object"),
            ("frame_id", "string"),
            ("latitude", "number"),
            ("longitude", "number"),
            ("altitude", "number"),
            ("position_covariance", "array"),
            ("position_covariance_type", "integer"),
        ],
    ),
    ("/profile", "crossfall.Profile", &[("timestamp", "object"), ("left", "object"), ("right", "object")]),
];

/// Exports a log. `progress` is told how far it has been read, in bytes.
///
/// # Errors
/// When the log cannot be read or the file not be written; then there is no file.
pub fn foxglove(log: &Path, to: &Path, mut progress: impl FnMut(u64)) -> Result<Made, Error> {
    let mut walk = Walk::open(log)?;
    let mut file = File::create(to)?;
    let mut made = Made::default();
    let mut origin: Option<Geodetic> = None;
    let mut points = Points::new();
    loop {
        let offset = walk.offset();
        let Some(step) = walk.next(|_, _| true) else { break };
        if made.profiles.is_multiple_of(512) {
            progress(offset);
        }
        made.profiles += 1;
        let time_ns = unix_ns(&step);
        let stamp = json!({ "sec": time_ns / 1_000_000_000, "nsec": time_ns % 1_000_000_000 });
        step.level(&mut points);
        file.write(0, time_ns, &scan(&step, &points, &stamp))?;
        file.write(1, time_ns, &cloud(&points, &stamp))?;
        if let Some((place, turn)) = step.position.geodetic.zip(step.position.turn) {
            let from = *origin.get_or_insert(place);
            file.write(2, time_ns, &transform(from, place, turn, &stamp))?;
            file.write(
                3,
                time_ns,
                &json!({
                    "timestamp": stamp, "frame_id": "level", "latitude": place[0], "longitude": place[1], "altitude": place[2],
                    "position_covariance": [0, 0, 0, 0, 0, 0, 0, 0, 0], "position_covariance_type": 0,
                }),
            )?;
        }
        let [left, right] = sides(&step.profile, step.position).map(|row| as_json(&row));
        file.write(4, time_ns, &json!({ "timestamp": stamp, "left": left, "right": right }))?;
    }
    interrupt::check()?;
    made.damage = walk.damage() + walk.unmatched();
    file.finish()?;
    Ok(made)
}

fn unix_ns(step: &Step<'_>) -> u64 {
    match step.position.gps {
        Some((week, seconds)) => {
            let whole = seconds as u64;
            unix_of_gps(week, whole) * 1_000_000_000 + ((seconds - whole as f64) * 1e9).round() as u64
        }
        None => step.profile.time.0.saturating_mul(1_000),
    }
}

fn identity() -> Json {
    json!({ "position": { "x": 0, "y": 0, "z": 0 }, "orientation": { "x": 0, "y": 0, "z": 0, "w": 1 } })
}

/// Ranges by their beams; 0 where there was no return.
fn scan(step: &Step<'_>, points: &Points, stamp: &Json) -> Json {
    let scan = step.scan;
    let last = scan.beams().saturating_sub(1);
    let mut ranges = vec![0.0; scan.beams()];
    for echo in points {
        if let Some(range) = ranges.get_mut(usize::from(echo.beam)) {
            let metres = f64::from(echo.point.y_um).hypot(f64::from(echo.point.z_um)) * 1e-6;
            *range = (metres * 1e4).round() / 1e4;
        }
    }
    // The beams of a mirrored scanner begin at the vehicle's left.
    let radians = |beam: usize| {
        let angle = (f64::from(scan.beam_cdeg(beam)) / 100.0).to_radians();
        if step.config().scanner.mirrored { PI - angle } else { angle }
    };
    json!({
        "timestamp": stamp, "frame_id": "scanner", "pose": identity(), "start_angle": radians(0), "end_angle": radians(last),
        "ranges": ranges, "intensities": [],
    })
}

fn cloud(points: &Points, stamp: &Json) -> Json {
    let mut data = Vec::with_capacity(points.len() * 12);
    for (y, z) in points.iter().map(units::place) {
        for value in [0.0, y, z] {
            data.extend((value as f32).to_le_bytes());
        }
    }
    let field = |name: &str, offset: u32| json!({ "name": name, "offset": offset, "type": 7 });
    json!({
        "timestamp": stamp, "frame_id": "level", "pose": identity(), "point_stride": 12,
        "fields": [field("x", 0), field("y", 4), field("z", 8)], "data": base64(&data),
    })
}

fn transform(origin: Geodetic, place: Geodetic, turn: Turn, stamp: &Json) -> Json {
    let [east, north] = between(origin, place);
    // Yaw counter-clockwise from east; a nose that is up turns about the left axis by minus the pitch.
    let (yaw, pitch) = (std::f64::consts::FRAC_PI_2 - turn.azimuth, -turn.pitch);
    let ((sy, cy), (sp, cp)) = ((yaw / 2.0).sin_cos(), (pitch / 2.0).sin_cos());
    json!({
        "timestamp": stamp, "parent_frame_id": "map", "child_frame_id": "level",
        "translation": { "x": east, "y": north, "z": place[2] - origin[2] },
        "rotation": { "x": -sy * sp, "y": cy * sp, "z": sy * cp, "w": cy * cp },
    })
}

/// A record as JSON, its columns as names.
fn as_json<R: Record>(record: &R) -> Json {
    let mut cells = Vec::new();
    record.cells(&mut cells);
    let named = R::COLUMNS.iter().zip(cells).map(|((name, _), cell)| {
        let value = match cell {
            Value::Empty => Json::Null,
            Value::Integer(value) => value.into(),
            Value::Real(value) => value.into(),
            Value::Text(text) => text.into(),
        };
        ((*name).to_owned(), value)
    });
    Json::Object(named.collect::<Map<_, _>>())
}

/// Base 64 with padding (RFC 4648), as JSON Schema's `contentEncoding` has bytes.
fn base64(bytes: &[u8]) -> String {
    const DIGITS: &[u8; 64] = b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    let mut text = String::with_capacity(bytes.len().div_ceil(3) * 4);
    for group in bytes.chunks(3) {
        let bits = group.iter().fold(0_u32, |bits, byte| bits << 8 | u32::from(*byte)) << (8 * (3 - group.len()));
        for digit in 0..4 {
            let known = digit <= group.len();
            text.push(if known { char::from(DIGITS[(bits >> (18 - 6 * digit) & 63) as usize]) } else { '=' });
        }
    }
    text
}

/// The file under way.
struct File {
    mcap: mcap::Writer<Output>,
    channels: Vec<u16>,
    counts: Vec<u32>,
    path: PathBuf,
}

impl File {
    fn create(to: &Path) -> Result<Self, Error> {
        let path = to.to_path_buf();
        let wrap = |source| Error::Mcap { path: path.clone(), source };
        let output = Output::create(to)?;
        let mut mcap = mcap::WriteOptions::new()
            .profile("")
            .library(concat!("crossfall ", env!("CARGO_PKG_VERSION")))
            .create(output)
            .map_err(wrap)?;
        let mut channels = Vec::new();
        for (topic, name, fields) in TOPICS {
            let properties: Map<String, Json> = fields
                .iter()
                .map(|(field, kind)| {
                    let mut of = json!({ "type": kind });
                    if *field == "data" {
                        of["contentEncoding"] = "base64".into();
                    }
                    ((*field).to_owned(), of)
                })
                .collect();
            let schema = json!({ "title": name, "type": "object", "properties": properties }).to_string();
            let schema = mcap.add_schema(name, "jsonschema", schema.as_bytes()).map_err(wrap)?;
            channels.push(mcap.add_channel(schema, topic, "json", &BTreeMap::new()).map_err(wrap)?);
        }
        let counts = vec![0; channels.len()];
        Ok(Self { mcap, channels, counts, path })
    }

    fn write(&mut self, topic: usize, time_ns: u64, message: &Json) -> Result<(), Error> {
        let sequence = self.counts[topic];
        self.counts[topic] += 1;
        let header =
            MessageHeader { channel_id: self.channels[topic], sequence, log_time: time_ns, publish_time: time_ns };
        let written = self.mcap.write_to_known_channel(&header, message.to_string().as_bytes());
        written.map_err(|source| Error::Mcap { path: self.path.clone(), source })
    }

    fn finish(mut self) -> Result<(), Error> {
        self.mcap.finish().map_err(|source| Error::Mcap { path: self.path, source })?;
        Ok(self.mcap.into_inner().commit()?)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn base64_is_that_of_the_rfc() {
        for (plain, coded) in [("", ""), ("f", "Zg=="), ("fo", "Zm8="), ("foo", "Zm9v"), ("foobar", "Zm9vYmFy")] {
            assert_eq!(base64(plain.as_bytes()), coded);
        }
    }

    #[test]
    fn a_vehicle_heading_north_looks_along_y() {
        let turn = Turn { roll: 0.0, pitch: 0.0, azimuth: 0.0 };
        let place = [40.0, -77.0, 1.0];
        let told = transform(place, place, turn, &Json::Null);
        let half = std::f64::consts::FRAC_1_SQRT_2;
        assert!((told["rotation"]["z"].as_f64().unwrap() - half).abs() < 1e-12);
        assert!((told["rotation"]["w"].as_f64().unwrap() - half).abs() < 1e-12);
    }
}
