//! The five lamps: what state each part is in, why, and what to do about it.
//!
//! Judged by what has come and when, not by what the board says of itself alone: a part that says nothing is not well.

use std::time::Duration;

use crossfall_core::sensors::lms2xx::{Severity, Status};
use crossfall_core::sensors::novatel::{Quality, state_name};
use serde::Serialize;

/// Without a scan, a pose or a frame for so long, its source counts as silent.
const SILENT: Duration = Duration::from_millis(1_500);

/// Without a pulse for so long, there is no lock.
const NO_PULSE: Duration = Duration::from_millis(3_500);

/// Below this a recording may not last the drive: half a gigabyte is five hours of a board's stream.
const LITTLE_ROOM: u64 = 512 << 20;

/// Below this it will end soon: a quarter of an hour.
const NO_ROOM: u64 = 24 << 20;

/// The colour of a lamp.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Light {
    /// Nothing is known or wanted of it.
    #[default]
    Off,
    /// As it should be.
    Good,
    /// Works, with a reservation.
    Warn,
    /// Does not work.
    Bad,
}

/// A lamp.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize)]
pub struct Lamp {
    /// Its colour.
    pub light: Light,
    /// Why, in a few words.
    pub words: String,
    /// What to do about it; empty when there is nothing to do.
    pub advice: &'static str,
}

impl Lamp {
    fn new(light: Light, words: impl Into<String>, advice: &'static str) -> Self {
        Self { light, words: words.into(), advice }
    }

    fn good(words: impl Into<String>) -> Self {
        Self::new(Light::Good, words, "")
    }
}

/// What the lamps are judged by. Ages are those of the latest of each kind.
#[derive(Clone, Debug, Default)]
pub struct Senses {
    /// Whether a film stands still: then nothing is to be expected.
    pub standing: bool,
    /// Why there is no connection.
    pub gone: Option<String>,
    /// How long frames have come since the connection was made.
    pub heard_for: Duration,
    /// Of a frame.
    pub frame_age: Option<Duration>,
    /// Of a scan.
    pub scan_age: Option<Duration>,
    /// Of a pose.
    pub pose_age: Option<Duration>,
    /// Of an accepted pulse.
    pub pulse_age: Option<Duration>,
    /// Scans a second of the board's time.
    pub scan_hz: f64,
    /// Poses a second of the board's time.
    pub pose_hz: f64,
    /// Whether the survey runs: without it no scan is sent.
    pub surveying: bool,
    /// The unit's own state.
    pub pose_status: u8,
    /// Whether poses are timed by pulses.
    pub timed_by_pulse: bool,
    /// How fast the board's clock runs, in parts per million.
    pub drift_ppm: f64,
    /// The scanner's status byte.
    pub scanner_status: u8,
    /// Whether there were losses on the scanner's line, the unit's line, the link in the last seconds.
    pub recent: [bool; 3],
    /// Whether a configuration was to be in force and is not, or is not known to be.
    pub unconfigured: bool,
    /// Bytes that may still be written; unknown on some systems.
    pub disk_free: Option<u64>,
    /// Why a log could not be written.
    pub disk_error: Option<String>,
}

/// Whether the board can be heard at all.
#[must_use]
pub fn link(senses: &Senses) -> Lamp {
    if senses.standing {
        return Lamp::new(Light::Off, "replay stands still", "");
    }
    if let Some(why) = &senses.gone {
        let advice = "Check the cable and the board's power; the connection is tried again all the time.";
        return Lamp::new(Light::Bad, format!("no connection: {why}"), advice);
    }
    match senses.frame_age {
        None => Lamp::new(Light::Bad, "nothing has come yet", "Check the board's power, the port and its baud rate."),
        Some(age) if age > 2 * SILENT => {
            let words = format!("silent for {} s", age.as_secs());
            Lamp::new(Light::Bad, words, "Check the board's power and the cable between board and computer.")
        }
        Some(_) if senses.recent[2] => {
            let advice = "Check the cable between board and computer; avoid hubs and other loads on the port.";
            Lamp::new(Light::Warn, "frames lost just now", advice)
        }
        Some(_) if senses.unconfigured => {
            let advice = "Slopes are off by the offset: put the right configuration in force under Setup.";
            Lamp::new(Light::Warn, "the configuration is not in force", advice)
        }
        Some(_) => Lamp::good("frames come whole"),
    }
}

/// Without a link nothing is known of the others.
fn blind(senses: &Senses) -> Option<Lamp> {
    if senses.standing {
        return Some(Lamp::new(Light::Off, "replay stands still", ""));
    }
    let heard = senses.gone.is_none() && senses.frame_age.is_some_and(|age| age <= 2 * SILENT);
    (!heard).then(|| Lamp::new(Light::Off, "unknown without the link", ""))
}

/// Just connected: nothing is wrong yet.
fn waiting(what: &str) -> Lamp {
    Lamp::new(Light::Off, format!("waiting for the first {what}"), "")
}

/// The scanner.
#[must_use]
pub fn lidar(senses: &Senses) -> Lamp {
    if let Some(lamp) = blind(senses) {
        return lamp;
    }
    let status = Status(senses.scanner_status);
    match senses.scan_age {
        _ if !senses.surveying => Lamp::new(Light::Off, "survey stopped", "Start it."),
        None if senses.heard_for < SILENT => waiting("scan"),
        None => Lamp::new(Light::Bad, "no scan yet", "Check the scanner's 24 V supply and its data cable."),
        Some(age) if age > SILENT => {
            let words = format!("no scan for {} s", age.as_secs());
            Lamp::new(Light::Bad, words, "Check the scanner's 24 V supply and its data cable; then restart it here.")
        }
        Some(_) if status.severity() >= Severity::Error => {
            Lamp::new(Light::Bad, "the scanner reports an error", "Restart the scanner; if it stays, it needs service.")
        }
        Some(_) if status.polluted() => {
            Lamp::new(Light::Warn, "the window is dirty", "Wipe the scanner's window with a soft, dry cloth.")
        }
        Some(_) if status.implausible() => {
            let advice = "Look for glare, rain or a dirty window; restart it if it stays.";
            Lamp::new(Light::Warn, "the scanner doubts its ranges", advice)
        }
        Some(_) if status.is_of_concern() => {
            Lamp::new(Light::Warn, "the scanner warns", "Look at its window and its temperature.")
        }
        Some(_) if senses.recent[0] => {
            Lamp::new(Light::Warn, "losses on its line", "Check the scanner's data cable and its shield.")
        }
        Some(_) => Lamp::good(format!("{:.1} scans/s", senses.scan_hz)),
    }
}

/// The inertial unit.
#[must_use]
pub fn ins(senses: &Senses) -> Lamp {
    if let Some(lamp) = blind(senses) {
        return lamp;
    }
    match senses.pose_age {
        None if senses.heard_for < SILENT => waiting("pose"),
        None => Lamp::new(Light::Bad, "no pose yet", "Check the unit's power and its data cable."),
        Some(age) if age > SILENT => {
            let words = format!("no pose for {} s", age.as_secs());
            Lamp::new(Light::Bad, words, "Check the unit's power and its data cable; then restart it here.")
        }
        Some(_) => match Quality::of(senses.pose_status) {
            Quality::Good if senses.recent[1] => {
                Lamp::new(Light::Warn, "losses on its line", "Check the unit's data cable and its shield.")
            }
            Quality::Good => Lamp::good(format!("{:.0} poses/s", senses.pose_hz)),
            Quality::Degraded => {
                let advice = "Slopes lose accuracy: drive on under open sky and round some bends.";
                Lamp::new(Light::Warn, state_name(senses.pose_status), advice)
            }
            // Without a usable attitude sections are not levelled.
            Quality::Aligning | Quality::Unusable => {
                let advice = "Drive straight on and round some bends under open sky until it has aligned.";
                Lamp::new(Light::Bad, state_name(senses.pose_status), advice)
            }
        },
    }
}

/// The pulse per second.
#[must_use]
pub fn pulse(senses: &Senses) -> Lamp {
    if let Some(lamp) = blind(senses) {
        return lamp;
    }
    match senses.pulse_age {
        None if senses.heard_for < NO_PULSE => waiting("pulse"),
        None => Lamp::new(Light::Bad, "no pulse yet", "Check the cable of the pulse per second."),
        Some(age) if age > NO_PULSE => {
            let words = format!("no pulse for {} s", age.as_secs());
            Lamp::new(
                Light::Bad,
                words,
                "Check the cable of the pulse per second; poses are timed by arrival meanwhile.",
            )
        }
        Some(_) if !senses.timed_by_pulse => {
            Lamp::new(Light::Warn, "pulses come, seconds not named yet", "Wait for a few poses.")
        }
        Some(_) => Lamp::good(format!("locked, clock {:+.1} ppm", senses.drift_ppm)),
    }
}

/// The disk that logs are written to.
#[must_use]
pub fn disk(senses: &Senses) -> Lamp {
    if let Some(error) = &senses.disk_error {
        let advice = "Free some space or choose another folder, then record again; what was written is kept.";
        return Lamp::new(Light::Bad, error.clone(), advice);
    }
    match senses.disk_free {
        None => Lamp::good("writable"),
        Some(free) if free < NO_ROOM => Lamp::new(Light::Bad, room(free), "Free some space now."),
        Some(free) if free < LITTLE_ROOM => Lamp::new(Light::Warn, room(free), "Free some space before a long drive."),
        Some(free) => Lamp::good(room(free)),
    }
}

fn room(bytes: u64) -> String {
    if bytes >= 1 << 30 { format!("{} GB free", bytes >> 30) } else { format!("{} MB free", bytes >> 20) }
}

#[cfg(test)]
mod tests {
    use super::*;

    use crossfall_core::profile::{Workspace, measure};
    use crossfall_core::protocol::message::flags;
    use crossfall_core::protocol::{Angle, Config};
    use crossfall_core::scan::{RawScan, RollTrack};

    fn well() -> Senses {
        let now = Some(Duration::from_millis(10));
        Senses {
            heard_for: Duration::from_secs(60),
            frame_age: now,
            scan_age: now,
            pose_age: now,
            pulse_age: now,
            scan_hz: 37.5,
            pose_hz: 100.0,
            surveying: true,
            pose_status: 3,
            timed_by_pulse: true,
            disk_free: Some(50 << 30),
            ..Senses::default()
        }
    }

    #[test]
    fn all_is_green_when_all_is_well() {
        let senses = well();
        for lamp in [link(&senses), lidar(&senses), ins(&senses), pulse(&senses), disk(&senses)] {
            assert_eq!((lamp.light, lamp.advice), (Light::Good, ""), "{lamp:?}");
        }
        assert_eq!(lidar(&senses).words, "37.5 scans/s");
    }

    #[test]
    fn what_is_wrong_is_told_with_what_to_do() {
        let long = Some(Duration::from_secs(4));
        type Judge = fn(&Senses) -> Lamp;
        let cases: [(Senses, Judge, Light, &str); 13] = [
            (Senses { gone: Some("closed by the other end".into()), ..well() }, link, Light::Bad, "closed"),
            (Senses { frame_age: long, ..well() }, link, Light::Bad, "silent for 4 s"),
            (Senses { recent: [false, false, true], ..well() }, link, Light::Warn, "frames lost"),
            (Senses { scan_age: long, ..well() }, lidar, Light::Bad, "no scan for 4 s"),
            (Senses { scanner_status: 0x80, ..well() }, lidar, Light::Warn, "dirty"),
            (Senses { scanner_status: 0x40, ..well() }, lidar, Light::Warn, "doubts its ranges"),
            (Senses { scanner_status: 3, ..well() }, lidar, Light::Bad, "an error"),
            (Senses { pose_age: None, ..well() }, ins, Light::Bad, "no pose yet"),
            (Senses { pose_status: 6, ..well() }, ins, Light::Warn, "free inertial"),
            (Senses { pose_status: 1, ..well() }, ins, Light::Bad, "aligning"),
            (Senses { pulse_age: long, ..well() }, pulse, Light::Bad, "no pulse for 4 s"),
            (Senses { timed_by_pulse: false, ..well() }, pulse, Light::Warn, "not named"),
            (Senses { disk_free: Some(1 << 20), ..well() }, disk, Light::Bad, "1 MB free"),
        ];
        for (senses, judge, light, words) in cases {
            let lamp = judge(&senses);
            assert_eq!(lamp.light, light, "{lamp:?}");
            assert!(lamp.words.contains(words) && !lamp.advice.is_empty(), "{lamp:?}");
        }
    }

    /// The light and the flags of the sections below it must not contradict each other.
    #[test]
    fn the_scanner_s_lamp_is_green_exactly_when_its_status_flags_no_section() {
        for status in 0..=u8::MAX {
            let scan = RawScan { status, ..RawScan::EMPTY };
            let level = RollTrack::constant(Angle::ZERO);
            let (.., flagged) = measure(&scan, &level, &Config::default(), &mut Workspace::new());
            let light = lidar(&Senses { scanner_status: status, ..well() }).light;
            assert_eq!(light == Light::Good, flagged & flags::SCANNER_STATUS == 0, "{status:#04x}: {light:?}");
        }
    }

    #[test]
    fn the_unit_s_lamp_is_as_good_as_its_attitude() {
        for status in 0..=u8::MAX {
            let expected = match Quality::of(status) {
                Quality::Good => Light::Good,
                Quality::Degraded => Light::Warn,
                Quality::Aligning | Quality::Unusable => Light::Bad,
            };
            assert_eq!(ins(&Senses { pose_status: status, ..well() }).light, expected, "{status}");
        }
    }

    #[test]
    fn without_a_link_the_others_are_dark_and_not_red() {
        let senses = Senses { gone: Some("gone".into()), ..well() };
        for lamp in [lidar(&senses), ins(&senses), pulse(&senses)] {
            assert_eq!(lamp.light, Light::Off);
        }
        assert_eq!(disk(&senses).light, Light::Good);
    }
}
