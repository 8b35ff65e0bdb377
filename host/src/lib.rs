//! The crossfall host: logs, verification, profiles, maps.
//!
//! The command `crossfall` is a thin cover of this library. What it does can be done from a program of one's own:
//!
//! # Reading a log
//!
//! Every message of the board, in order, damage told where it is:
//!
//! ```no_run
//! use crossfall::stream::{Item, Stream};
//! use crossfall_core::protocol::message::Message;
//!
//! let mut stream = Stream::open("drive.log.mcap".as_ref())?;
//! while let Some((place, item)) = stream.next() {
//!     match item {
//!         Item::Message { message: Message::Pose(pose), .. } => println!("{} us: azimuth {:?}", pose.time.0, pose.azimuth),
//!         Item::Message { .. } => {}
//!         Item::Rejected { fault, bytes } => eprintln!("frame {}: {bytes} bytes lost: {fault}", place.frame),
//!         Item::Damage(error) => eprintln!("{error}"),
//!     }
//! }
//! # Ok::<(), crossfall::container::Error>(())
//! ```
//!
//! # Iterating profiles
//!
//! Rows of the table, each with its place:
//!
//! ```no_run
//! use crossfall::profiles::Rows;
//!
//! let steep = Rows::open("drive.log.mcap".as_ref())?
//!     .filter(|row| row.adjacent.is_some_and(|slope| slope.slope_deg < -14.04))
//!     .filter_map(|row| row.position.station_m);
//! for station_m in steep {
//!     println!("steeper than 1:4 at {station_m:.1} m");
//! }
//! # Ok::<(), crossfall::container::Error>(())
//! ```
//!
//! # Running the core on scans of one's own
//!
//! The measuring core needs neither a board nor a log. Here it levels and measures one scan of a flat road with a ditch:
//!
//! ```
//! use crossfall_core::protocol::{Angle, Config, DeviceTime, message::ScanMode};
//! use crossfall_core::scan::{MAX_BEAMS, Points, RawScan, RollTrack, level};
//!
//! let mut scan = RawScan {
//!     index: 0,
//!     stx: DeviceTime(1_000_000),
//!     layout: 361 | 1 << 14, // 361 values, in millimetres
//!     mode: ScanMode { span_deg: 180, step_cdeg: 50, measuring: 6 },
//!     status: 0,
//!     counters: None,
//!     values: [0; MAX_BEAMS],
//! };
//! for (beam, range) in scan.values.iter_mut().take(361).enumerate() {
//!     // The ground lies 2.5 m below the scanner; beams near the horizon see nothing.
//!     let down = (beam as f64 * 0.5).to_radians().sin();
//!     *range = if down > 0.1 { (2_500.0 / down) as u16 } else { 0 };
//! }
//! let mut points = Points::new();
//! level(&scan, &RollTrack::constant(Angle::ZERO), &Config::default().scanner, &mut points);
//! assert!(points.iter().all(|echo| (echo.point.z_um + 2_500_000).abs() < 2_000));
//! ```
//!
//! # Tables of one's own
//!
//! Anything that implements [`table::Record`] can be written as CSV, Parquet or GeoJSON; see [`intervals::Gather`] for slopes by the stretch and
//! [`walk::Walk`] for each profile with the scan and the pose that it was made from.
#![forbid(unsafe_code)]

// Files: what is read and written, whole or damaged.
pub mod capture;
pub mod container;
pub mod log;
pub mod output;
mod recorded;
pub mod recover;
pub mod stream;
pub mod toml_file;

// From a board and to it.
pub mod board_words;
pub mod config;
pub mod emulated;
pub mod import;
pub mod live;
pub mod monitor;
pub mod record;
pub mod replay;
pub mod run;
pub mod scanner;
mod sensor_line;
pub mod serve;

// Proof, and what is lost.
pub mod counters;
pub mod faults;
pub mod info;
pub mod interrupt;
pub mod unwinding;
pub mod verify;

// Where and when.
pub mod calendar;
pub mod geodesy;
pub mod leap;
mod span;
pub mod track;
pub mod way;

// One scan, one profile, and what all of it reckons with.
pub mod section;
pub mod side;
pub mod statistics;
pub mod units;
pub mod walk;

// Results: tables, reports, pictures, clouds.
pub mod cloud;
pub mod dataset;
pub mod drive;
pub mod export;
pub mod fuse;
pub mod intervals;
pub mod plot;
pub mod profiles;
pub mod report;
pub mod table;

// Experiments.
pub mod accuracy;
pub mod calibrate;
pub mod compare;
pub mod reproduce;
pub mod simulate;
pub mod terrain;
