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

pub mod accuracy;
pub mod calendar;
pub mod calibrate;
pub mod capture;
pub mod cloud;
pub mod compare;
pub mod config;
pub mod contained;
pub mod container;
pub mod counters;
pub mod dataset;
pub mod drive;
pub mod emulated;
pub mod export;
pub mod faults;
pub mod fuse;
pub mod geodesy;
pub mod import;
pub mod info;
pub mod interrupt;
pub mod intervals;
pub mod leap;
pub mod live;
pub mod log;
pub mod monitor;
pub mod output;
pub mod plot;
pub mod profiles;
pub mod record;
mod recorded;
pub mod recover;
pub mod replay;
pub mod report;
pub mod reproduce;
pub mod run;
pub mod scanner;
pub mod section;
pub mod serve;
pub mod side;
pub mod simulate;
mod span;
pub mod statistics;
pub mod stream;
pub mod table;
pub mod terrain;
pub mod toml_file;
pub mod track;
pub mod units;
pub mod verify;
pub mod walk;
pub mod way;
mod wire;
pub mod words;
