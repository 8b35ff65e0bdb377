//! Losses in words, each with what to do about it.

use std::collections::{BTreeMap, VecDeque};
use std::time::Instant;

use serde::Serialize;

use crate::counters::LOSSES;

/// Faults kept for the viewers.
const KEPT: usize = 12;

/// Something that went wrong.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Fault {
    /// What, in words.
    pub words: String,
    /// What to do about it.
    pub advice: &'static str,
    /// Seconds since.
    pub seconds_ago: u64,
}

/// What went wrong lately, and every counter that tells of a loss.
#[derive(Debug, Default)]
pub struct Faults {
    counters: BTreeMap<String, u64>,
    recent: VecDeque<(Instant, String, &'static str)>,
    /// Faults in all.
    pub count: u64,
}

impl Faults {
    /// Something went wrong.
    pub fn note(&mut self, words: String, advice: &'static str) {
        self.count += 1;
        // What repeats is told once, at its latest.
        self.recent.retain(|(_, told, _)| *told != words);
        if self.recent.len() == KEPT {
            self.recent.pop_front();
        }
        self.recent.push_back((Instant::now(), words, advice));
    }

    /// A counter's new value; what it rose by is a fault. The first value of one that a board brings along is not. Says whether it rose.
    pub fn counter(&mut self, name: &str, value: u64, since_boot: bool) -> bool {
        let before = self.counters.insert(name.to_owned(), value);
        let rise = match before {
            Some(before) if value >= before => value - before,
            Some(_) => value,
            None if since_boot => 0,
            None => value,
        };
        if rise > 0
            && let Some((words, advice)) = words_of(name, rise)
        {
            self.note(words, advice);
        }
        rise > 0
    }

    /// Every loss counter by name.
    #[must_use]
    pub fn counters(&self) -> &BTreeMap<String, u64> {
        &self.counters
    }

    /// Forgets the counters: the board has booted.
    pub fn restart(&mut self) {
        for (name, value) in &mut self.counters {
            if !name.starts_with("link.") {
                *value = 0;
            }
        }
    }

    /// The latest first.
    #[must_use]
    pub fn recent(&self) -> Vec<Fault> {
        let told = self.recent.iter().rev();
        told.map(|(when, words, advice)| Fault { words: words.clone(), advice, seconds_ago: when.elapsed().as_secs() })
            .collect()
    }
}

/// Counters of a status that an operator is told of: of lost data, and of what goes wrong without a loss.
pub fn of_the_board() -> impl Iterator<Item = &'static str> {
    LOSSES.into_iter().chain(["pulses_spurious", "commands_rejected"])
}

/// A rise of a counter in words, and what to do.
fn words_of(name: &str, rise: u64) -> Option<(String, &'static str)> {
    const SCANNER_CABLE: &str = "Check the scanner's data cable, its connector and its shield.";
    const UNIT_CABLE: &str = "Check the unit's data cable, its connector and its shield.";
    const LINK_CABLE: &str = "Check the cable between board and computer; avoid hubs and other loads on the port.";
    const REPORT: &str = "Note the time and report it: the board was too busy.";
    let (one, many, advice) = match name {
        "lidar.bad_frames" => {
            ("telegram of the scanner failed its check", "telegrams of the scanner failed their check", SCANNER_CABLE)
        }
        "lidar.overruns" => {
            ("byte or burst of the scanner was lost", "bytes or bursts of the scanner were lost", REPORT)
        }
        "ins.bad_frames" => {
            ("log of the inertial unit failed its check", "logs of the inertial unit failed their check", UNIT_CABLE)
        }
        "ins.overruns" => {
            ("byte or burst of the inertial unit was lost", "bytes or bursts of the inertial unit were lost", REPORT)
        }
        "scans_missing" => {
            ("scan is missing in the scanner's count", "scans are missing in the scanner's count", SCANNER_CABLE)
        }
        "scans_unreadable" => (
            "scan has an unknown layout",
            "scans have an unknown layout",
            "Restart the scanner from here: it is set up anew.",
        ),
        "scans_skipped" => (
            "scan was sent but not measured",
            "scans were sent but not measured",
            "Nothing is lost: the log holds them, and a replay of it measures them.",
        ),
        "poses_unreadable" => ("pose has an impossible value", "poses have impossible values", UNIT_CABLE),
        "pulses_spurious" => (
            "pulse came at a wrong time",
            "pulses came at wrong times",
            "Check the cable of the pulse per second and its shield.",
        ),
        "pulses_overrun" => (
            "pulse was overrun by the next",
            "pulses were overrun by the next",
            "Check the cable of the pulse per second: it chatters.",
        ),
        "frames_dropped" => ("frame found no room on the link", "frames found no room on the link", LINK_CABLE),
        "commands_rejected" => ("command reached the board damaged", "commands reached the board damaged", LINK_CABLE),
        "link.missing_frames" => ("frame was lost on the link", "frames were lost on the link", LINK_CABLE),
        "link.unknown_gaps" => (
            "gap on the link is too long to count its frames",
            "gaps on the link are too long to count their frames",
            LINK_CABLE,
        ),
        "link.bad_frames" => ("frame arrived damaged", "frames arrived damaged", LINK_CABLE),
        "link.bytes_lost" => (
            "byte found no room: the disk is too slow",
            "bytes found no room: the disk is too slow",
            "Record to an internal disk and close other programs.",
        ),
        _ => return None,
    };
    Some((format!("{rise} {}", if rise == 1 { one } else { many }), advice))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_loss_has_words_and_advice() {
        let link = ["link.missing_frames", "link.unknown_gaps", "link.bad_frames", "link.bytes_lost"];
        for name in of_the_board().chain(link) {
            let (words, advice) = words_of(name, 2).unwrap();
            assert!(words.starts_with("2 ") && advice.ends_with('.'), "{name}: {words} {advice}");
        }
    }

    #[test]
    fn only_what_rises_is_told() {
        let mut faults = Faults::default();
        assert!(!faults.counter("scans_missing", 7, true), "what was lost before anyone looked");
        assert!(!faults.counter("scans_missing", 7, true));
        assert!(faults.counter("scans_missing", 8, true));
        assert!(faults.counter("link.bad_frames", 2, false));
        let told = faults.recent();
        assert_eq!(told[0].words, "2 frames arrived damaged");
        assert_eq!(told[1].words, "1 scan is missing in the scanner's count");
        assert_eq!(faults.count, 2);
        faults.restart();
        assert!(!faults.counter("scans_missing", 0, true));
    }
}
