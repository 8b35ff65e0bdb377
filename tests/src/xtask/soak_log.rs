//! `cargo xtask soak --hours N`: days of driving in simulated time through the core and a rotating log, in one process.
//!
//! A minute of a simulated drive is repeated with everything that counts carried on - GPS week and second, scan and telegram index, device time - so that
//! the core sees one unbroken drive, over the turn of a GPS week. Every frame goes into a live log that begins another file every hour; then all
//! files are verified as the one stream that they are. Memory is read from the system as it goes. Syncs are left out: time is simulated, and half a
//! second of it passes in a millisecond.

use std::fs::{self, File};
use std::io::{self, Write};
use std::path::{Path, PathBuf};
use std::time::Instant;

use crossfall::capture::{self, Channel, Chunk};
use crossfall::log::{Options, Storage, Writer};
use crossfall::simulate::{self, scene::Scene};
use crossfall::{run, verify};
use crossfall_core::protocol::Config;
use crossfall_core::sensors::{lms2xx, novatel};

use crate::shell::{self, Tally};

/// Seconds of the drive that is repeated: a whole number, so that pulses go on.
const PERIOD_S: u64 = 60;

/// Receive time of one file: an hour.
const FILE_NS: u64 = 3_600_000_000_000;

const WEEK_S: u64 = 604_800;

/// Runs the soak. Fails when anything is lost, does not verify, or memory grows.
pub fn run(hours: u64) -> Result<(), String> {
    if cfg!(debug_assertions) {
        // Days of driving want an optimising compiler.
        let line = format!("cargo run --release --quiet --package crossfall-tests --bin xtask -- soak --hours {hours}");
        return shell::run(&line, "", &mut Tally::default());
    }
    let scratch = std::env::temp_dir().join(format!("crossfall-soak-{}", std::process::id()));
    fs::create_dir_all(&scratch).map_err(|error| format!("{}: {error}", scratch.display()))?;
    let outcome = soak(hours, &scratch);
    // Whatever came of it, nothing is left behind.
    let removed = fs::remove_dir_all(&scratch).map_err(|error| format!("{}: {error}", scratch.display()));
    outcome.and(removed)
}

fn soak(hours: u64, scratch: &Path) -> Result<(), String> {
    let began = Instant::now();
    let minute = Minute::simulate(scratch)?;
    let path = scratch.join("soak.log.mcap");
    let options = Options { max_ns: FILE_NS, ..Options::default() };
    let periods = hours * 3_600 / PERIOD_S;
    let chunks = (0..periods).flat_map(|period| minute.chunks(period));
    let error = |error: &dyn std::fmt::Display| error.to_string();
    let mut log = Writer::create_over(&path, options, Box::new(unsynced)).map_err(|e| error(&e))?;
    let config = Config::default();
    let mut told = 0;
    let (mut early, mut latest) = (None, 0);
    let summary = run::run_over(chunks.map(Ok), minute.start_ns, &config, &mut log, |now_ns| {
        let hour = (now_ns - minute.start_ns) / FILE_NS;
        if hour > told {
            told = hour;
            latest = resident_kib();
            // The first hours fill every buffer that there is.
            early = early.or((hour >= 2).then_some(latest));
            eprintln!("  {hour} h driven in {:.0} s, {} MiB resident", began.elapsed().as_secs_f64(), latest / 1024);
        }
    })
    .map_err(|e| error(&e))?;
    let parts = log.parts();
    log.finish().map_err(|e| error(&e))?;
    let others: Vec<PathBuf> = (2..=parts).map(|part| scratch.join(format!("soak.log.part{part:04}.mcap"))).collect();
    let driven = began.elapsed();
    let verifying = Instant::now();
    let mut file = 0;
    let report = verify::verify_all(&path, &others, |now, _| {
        if now > file {
            file = now;
            latest = latest.max(resident_kib());
        }
    })
    .map_err(|e| error(&e))?;
    let bytes: u64 = std::iter::once(&path).chain(&others).map(|part| fs::metadata(part).map_or(0, |m| m.len())).sum();
    println!(
        "{hours} h: {} scans, {} profiles, {} frames in {} files of {:.2} GB together; driven in {:.0} s, verified in {:.0} s ({:.0} times real time)",
        summary.status.scans,
        report.profiles_reproduced,
        report.frames,
        parts,
        bytes as f64 / 1e9,
        driven.as_secs_f64(),
        verifying.elapsed().as_secs_f64(),
        report.seconds / verifying.elapsed().as_secs_f64()
    );
    let early = early.unwrap_or(latest);
    println!("memory: {} MiB after two hours, {} MiB at most later", early / 1024, latest / 1024);
    let losses = crossfall::counters::losses(&summary.status);
    if !report.ok || !losses.is_empty() || !summary.damage.is_empty() {
        return Err(format!("lost: {losses:?}; {:?}", &report.problems[..report.problems.len().min(10)]));
    }
    if report.scans != u64::from(summary.status.scans) {
        return Err(format!("{} scans in the log, {} decoded", report.scans, summary.status.scans));
    }
    // An index entry for each chunk of the file under way is all that may come and go.
    if latest > early + 16 * 1024 {
        return Err(format!("memory grew from {early} KiB to {latest} KiB"));
    }
    Ok(())
}

/// A file whose syncs do nothing.
struct Unsynced(File);

impl Write for Unsynced {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.0.write(bytes)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.0.flush()
    }
}

impl Storage for Unsynced {
    fn sync(&mut self) -> io::Result<()> {
        Ok(())
    }
}

fn unsynced(path: &Path) -> io::Result<Box<dyn Storage>> {
    Ok(Box::new(Unsynced(File::create_new(path)?)))
}

/// A minute of a drive, to be repeated.
struct Minute {
    chunks: Vec<Chunk>,
    start_ns: u64,
    /// Device time of the period: a minute by the drifting clock of the board.
    period_ns: u64,
    scans: u64,
}

impl Minute {
    fn simulate(scratch: &Path) -> Result<Self, String> {
        let path = scratch.join("minute.mcap");
        let mut scene = Scene::default();
        scene.drive.seconds = PERIOD_S as f64 + 3.0;
        // Half a day before the turn of the week.
        scene.drive.gps_seconds = (WEEK_S - 43_200) as u32;
        let mut writer = capture::Writer::create(&path).map_err(|error| error.to_string())?;
        simulate::simulate(&scene, &mut writer, |_| ()).map_err(|error| error.to_string())?;
        writer.finish().map_err(|error| error.to_string())?;
        let all: Result<Vec<_>, _> = capture::Reader::open(&path).map_err(|error| error.to_string())?.collect();
        let all = all.map_err(|error| error.to_string())?;
        let pulses: Vec<u64> =
            all.iter().filter(|chunk| chunk.channel == Channel::Pps).map(|chunk| chunk.device_time_ns).collect();
        let (Some(&first), Some(&last)) = (pulses.get(1), pulses.get(1 + PERIOD_S as usize)) else {
            return Err("the simulated minute has too few pulses".to_owned());
        };
        // From one pulse to the one a minute later, that one left out.
        let chunks: Vec<_> = all.into_iter().filter(|chunk| (first..last).contains(&chunk.device_time_ns)).collect();
        let scans = chunks.iter().filter(|chunk| chunk.channel == Channel::Lidar).count() as u64;
        Ok(Self { chunks, start_ns: first, period_ns: last - first, scans })
    }

    /// The chunks of a repetition, with everything that counts carried on.
    fn chunks(&self, period: u64) -> impl Iterator<Item = Chunk> + '_ {
        let mut scan = period * self.scans;
        self.chunks.iter().map(move |chunk| {
            let mut chunk = chunk.clone();
            chunk.device_time_ns += period * self.period_ns;
            match chunk.channel {
                Channel::Lidar => {
                    number(&mut chunk.data, scan);
                    scan += 1;
                }
                Channel::Ins => advance(&mut chunk.data, period * PERIOD_S),
                _ => {}
            }
            chunk
        })
    }
}

/// Length of a telegram of 361 values with both indices.
const NUMBERED: usize = 734;

/// Gives a telegram its scan and telegram index, before its status byte, and its check.
fn number(telegram: &mut Vec<u8>, scan: u64) {
    let end = telegram.len() - 2;
    if telegram.len() == NUMBERED {
        telegram[end - 3..end - 1].copy_from_slice(&[(2 * scan) as u8, scan as u8]);
    }
    telegram.truncate(end);
    telegram.extend(lms2xx::crc(telegram).to_le_bytes());
}

/// Moves a log of the inertial unit by so many seconds of GPS time: in the header and, in a solution, in its body.
fn advance(frame: &mut Vec<u8>, seconds: u64) {
    let short = frame[2] == 0x13;
    let (week_at, milliseconds_at, body) = if short { (6, 8, 12) } else { (14, 16, 28) };
    let week = u64::from(u16::from_le_bytes([frame[week_at], frame[week_at + 1]]));
    let milliseconds = u32::from_le_bytes([0, 1, 2, 3].map(|i| frame[milliseconds_at + i]));
    let whole = u64::from(milliseconds) / 1_000 + seconds;
    let week = week + whole / WEEK_S;
    let turned = whole / WEEK_S * WEEK_S;
    let put = |frame: &mut Vec<u8>, at: usize, bytes: &[u8]| frame[at..at + bytes.len()].copy_from_slice(bytes);
    put(frame, week_at, &(week as u16).to_le_bytes());
    let milliseconds = u64::from(milliseconds) + seconds * 1_000 - turned * 1_000;
    put(frame, milliseconds_at, &(milliseconds as u32).to_le_bytes());
    if short {
        let second = f64::from_le_bytes([0, 1, 2, 3, 4, 5, 6, 7].map(|i| frame[body + 4 + i]));
        put(frame, body, &(week as u32).to_le_bytes());
        put(frame, body + 4, &(second + seconds as f64 - turned as f64).to_le_bytes());
    }
    frame.truncate(frame.len() - 4);
    let check = novatel::crc32(frame);
    frame.extend(check.to_le_bytes());
}

/// Resident memory of this process, 0 where the system does not say.
fn resident_kib() -> u64 {
    let status = fs::read_to_string("/proc/self/status").unwrap_or_default();
    let line = status.lines().find_map(|line| line.strip_prefix("VmRSS:"));
    line.and_then(|line| line.split_whitespace().next()?.parse().ok()).unwrap_or(0)
}
