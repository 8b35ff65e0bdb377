//! A specification of faults as a user writes it.
//!
//! `FAULT=RATE` separated by commas, for one line after `LINE:`, lines separated by semicolons; without a line for both sensors:
//! `flip=1e-5,drop=1e-6,seed=7`, or `lidar:burst=1e-6:200;pps:drop=0.1`. `burst` takes the bytes of a burst behind a colon (64 unless told), `stall` the
//! milliseconds of a stall (200 unless told). Rates are probabilities: of each byte for flip, drop and burst, of each piece for the others; of each pulse on `pps`,
//! which has no bytes and takes drop, duplicate and stall. Lines are the board's: it has none for a second unit (`ins2`).

use std::fmt;
use std::str::FromStr;

use crate::capture::Channel;

/// Probabilities of one line's faults.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Rates {
    /// A byte has one bit flipped.
    pub flip: f64,
    /// A byte, or a pulse, is lost.
    pub drop: f64,
    /// A burst of noise begins at a byte.
    pub burst: f64,
    /// Bytes that it replaces.
    pub burst_bytes: u64,
    /// A piece comes twice; a pulse bounces.
    pub duplicate: f64,
    /// A piece changes places with the next.
    pub reorder: f64,
    /// A piece loses its end, from a byte anywhere in it.
    pub truncate: f64,
    /// A piece, and all after it, comes late.
    pub stall: f64,
    /// By how many milliseconds.
    pub stall_ms: u64,
}

impl Default for Rates {
    /// No faults.
    fn default() -> Self {
        Self {
            flip: 0.0,
            drop: 0.0,
            burst: 0.0,
            burst_bytes: 64,
            duplicate: 0.0,
            reorder: 0.0,
            truncate: 0.0,
            stall: 0.0,
            stall_ms: 200,
        }
    }
}

/// Faults of every line.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Spec {
    /// Of everything random.
    pub seed: u64,
    /// What is said of one line, or of both sensors.
    lines: Vec<(Option<Channel>, Rates)>,
}

/// What a specification that is none is answered with.
const EXPECTED: &str = "expected FAULT=RATE,... or LINE:FAULT=RATE,...;LINE:... with LINE lidar, ins or pps, FAULT flip, drop, \
                        burst, duplicate, reorder, truncate or stall and a RATE from 0 to 1 (burst=RATE:BYTES, stall=RATE:MILLISECONDS), and seed=NUMBER";

impl Spec {
    /// The rates of a line; none when nothing is said of it.
    #[must_use]
    pub fn rates(&self, line: Channel) -> Option<Rates> {
        let own = self.lines.iter().find(|(named, _)| *named == Some(line));
        let sensor = matches!(line, Channel::Lidar | Channel::Ins);
        let both = self.lines.iter().find(|(named, _)| named.is_none() && sensor);
        own.or(both).map(|(_, rates)| *rates)
    }
}

impl FromStr for Spec {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        let mut spec = Self::default();
        for part in text.split(';') {
            let (line, faults) = match part.split_once(':') {
                // The colon may belong to a rate.
                Some((line, faults)) if !line.contains('=') => {
                    let line = line.trim();
                    let known = Channel::from_topic(line).filter(|line| *line != Channel::Ins2);
                    (Some(known.ok_or_else(|| format!("no line `{line}`; {EXPECTED}"))?), faults)
                }
                _ => (None, part),
            };
            if spec.lines.iter().any(|(known, _)| *known == line) {
                let line = line.map_or("both sensors", Channel::topic);
                return Err(format!("{line} named twice; {EXPECTED}"));
            }
            let mut rates = Rates::default();
            for fault in faults.split(',') {
                set(&mut rates, &mut spec.seed, fault.trim())?;
            }
            let of_bytes = [rates.flip, rates.burst, rates.reorder, rates.truncate].iter().any(|rate| *rate > 0.0);
            if line == Some(Channel::Pps) && of_bytes {
                return Err(format!("a pulse has no bytes: `pps` takes drop, duplicate and stall; {EXPECTED}"));
            }
            spec.lines.push((line, rates));
        }
        Ok(spec)
    }
}

fn set(rates: &mut Rates, seed: &mut u64, fault: &str) -> Result<(), String> {
    let wrong = |what: &str| format!("{what} in `{fault}`; {EXPECTED}");
    let (name, value) = fault.split_once('=').ok_or_else(|| wrong("no `=`"))?;
    if name == "seed" {
        *seed = value.parse().map_err(|_| wrong("no whole number"))?;
        return Ok(());
    }
    let (rate, extent) = match value.split_once(':') {
        None => (value, None),
        Some((rate, extent)) => {
            let extent = extent.parse::<u64>().ok().filter(|extent| (1..=1_000_000).contains(extent));
            (rate, Some(extent.ok_or_else(|| wrong("no number from 1 to 1000000"))?))
        }
    };
    let rate = rate.parse::<f64>().ok().filter(|rate| (0.0..=1.0).contains(rate)).ok_or_else(|| wrong("no rate"))?;
    if extent.is_some() && !matches!(name, "burst" | "stall") {
        return Err(wrong("a number that means nothing"));
    }
    *match name {
        "flip" => &mut rates.flip,
        "drop" => &mut rates.drop,
        "burst" => {
            rates.burst_bytes = extent.unwrap_or(rates.burst_bytes);
            &mut rates.burst
        }
        "duplicate" => &mut rates.duplicate,
        "reorder" => &mut rates.reorder,
        "truncate" => &mut rates.truncate,
        "stall" => {
            rates.stall_ms = extent.unwrap_or(rates.stall_ms);
            &mut rates.stall
        }
        _ => return Err(wrong("no such fault")),
    } = rate;
    Ok(())
}

impl fmt::Display for Spec {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mut seed = Some(self.seed);
        for (i, (line, rates)) in self.lines.iter().enumerate() {
            let Rates { flip, drop, burst, burst_bytes, duplicate, reorder, truncate, stall, stall_ms } = *rates;
            let line = line.map_or(String::new(), |line| format!("{}:", line.topic()));
            write!(f, "{}{line}", if i > 0 { ";" } else { "" })?;
            for (name, rate) in
                [("flip", flip), ("drop", drop), ("duplicate", duplicate), ("reorder", reorder), ("truncate", truncate)]
            {
                if rate > 0.0 {
                    write!(f, "{name}={rate},")?;
                }
            }
            if burst > 0.0 {
                write!(f, "burst={burst}:{burst_bytes},")?;
            }
            if stall > 0.0 {
                write!(f, "stall={stall}:{stall_ms},")?;
            }
            match seed.take() {
                Some(seed) => write!(f, "seed={seed}")?,
                // Something must stand behind the last comma.
                None => write!(f, "flip={flip}")?,
            }
        }
        Ok(())
    }
}
