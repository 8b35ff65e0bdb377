//! The board's counters by name, in a status and over a whole stream.
//!
//! A board that boots again counts from zero; what it had lost before is lost all the same. So the last status of every boot is added up. What the first
//! status of all tells was lost before anybody listened: it is known apart.

use std::collections::BTreeMap;

use crossfall_core::protocol::message::{LineCounters, Status};

/// Counters by name, over all boots.
#[derive(Clone, Debug, Default)]
pub struct Totals {
    earlier: BTreeMap<String, u64>,
    first: Option<Status>,
    latest: Option<Status>,
    restarts: u64,
}

impl Totals {
    /// The board has booted again.
    pub fn restart(&mut self) {
        self.earlier = self.counters();
        self.latest = None;
        self.restarts += 1;
    }

    /// The board's counters since it booted.
    pub fn status(&mut self, status: &Status) {
        // Time goes back where the words with which a board begins are lost.
        if self.latest.is_some_and(|latest| status.time < latest.time) {
            self.restart();
        }
        // One that is heard first behind a boot tells of nothing before it.
        if self.restarts == 0 {
            self.first.get_or_insert(*status);
        }
        self.latest = Some(*status);
    }

    /// Times that the board has booted again.
    #[must_use]
    pub fn restarts(&self) -> u64 {
        self.restarts
    }

    /// Every counter; none before the first status.
    #[must_use]
    pub fn counters(&self) -> BTreeMap<String, u64> {
        let mut all = self.earlier.clone();
        for (name, count) in self.latest.iter().flat_map(of) {
            *all.entry(name).or_default() += count;
        }
        all
    }

    /// The counters that tell of lost data and are not zero.
    #[must_use]
    pub fn losses(&self) -> BTreeMap<String, u64> {
        lost(self.counters())
    }

    /// Those of them that the first status told already.
    #[must_use]
    pub fn losses_before(&self) -> BTreeMap<String, u64> {
        self.first.as_ref().map(losses).unwrap_or_default()
    }

    /// Those of them that have come since.
    #[must_use]
    pub fn losses_since(&self) -> BTreeMap<String, u64> {
        let (mut losses, before) = (self.losses(), self.losses_before());
        for (name, count) in &mut losses {
            *count = count.saturating_sub(before.get(name).copied().unwrap_or(0));
        }
        losses.retain(|_, count| *count > 0);
        losses
    }
}

/// The counters of a sensor's line, by its name and theirs.
pub(crate) fn line(name: &str, counters: &LineCounters, into: &mut BTreeMap<String, u64>) {
    let LineCounters { bytes, frames, bad_frames, skipped, overruns } = *counters;
    for (counter, count) in [
        ("bytes", bytes),
        ("frames", u64::from(frames)),
        ("bad_frames", u64::from(bad_frames)),
        ("skipped", skipped),
        ("overruns", u64::from(overruns)),
    ] {
        into.insert(format!("{name}.{counter}"), count);
    }
}

/// Every counter of a status by name.
#[must_use]
pub fn of(status: &Status) -> BTreeMap<String, u64> {
    let mut all = BTreeMap::new();
    line("lidar", &status.lidar, &mut all);
    line("ins", &status.ins, &mut all);
    for (name, count) in [
        ("scans", status.scans),
        ("scans_missing", status.scans_missing),
        ("scans_unreadable", status.scans_unreadable),
        ("scans_skipped", status.scans_skipped),
        ("poses", status.poses),
        ("poses_unreadable", status.poses_unreadable),
        ("pulses", status.pulses),
        ("pulses_spurious", status.pulses_spurious),
        ("pulses_overrun", status.pulses_overrun),
        ("frames_dropped", status.frames_dropped),
        ("commands_rejected", status.commands_rejected),
    ] {
        all.insert(name.to_owned(), u64::from(count));
    }
    all
}

/// The counters of a status that tell of lost data and are not zero.
#[must_use]
pub fn losses(status: &Status) -> BTreeMap<String, u64> {
    lost(of(status))
}

/// Counters of a status that tell of lost data.
pub(crate) const LOSSES: [&str; 10] = [
    "lidar.bad_frames",
    "lidar.overruns",
    "ins.bad_frames",
    "ins.overruns",
    "scans_missing",
    "scans_unreadable",
    "scans_skipped",
    "poses_unreadable",
    "pulses_overrun",
    "frames_dropped",
];

/// Of counters by name those that tell of lost data and are not zero.
fn lost(mut counters: BTreeMap<String, u64>) -> BTreeMap<String, u64> {
    counters.retain(|name, count| *count > 0 && LOSSES.contains(&name.as_str()));
    counters
}

#[cfg(test)]
mod tests {
    use crossfall_core::protocol::DeviceTime;

    use super::*;

    fn status(time_us: u64, scans: u32, scans_missing: u32) -> Status {
        Status { time: DeviceTime(time_us), scans, scans_missing, ..Status::default() }
    }

    #[test]
    fn what_a_board_lost_before_it_booted_again_is_lost() {
        let mut totals = Totals::default();
        assert!(totals.counters().is_empty());
        totals.status(&status(1_000_000, 30, 2));
        totals.status(&status(2_000_000, 60, 5));
        totals.restart();
        assert_eq!(totals.losses(), BTreeMap::from([("scans_missing".to_owned(), 5)]), "before the next status");
        totals.status(&status(1_000_000, 37, 0));
        assert_eq!((totals.counters()["scans"], totals.restarts()), (97, 1));
        assert_eq!(totals.losses(), BTreeMap::from([("scans_missing".to_owned(), 5)]));
        // A boot whose hello never came.
        totals.status(&status(500_000, 18, 1));
        assert_eq!((totals.counters()["scans"], totals.losses()["scans_missing"], totals.restarts()), (115, 6, 2));
    }

    #[test]
    fn what_a_board_had_lost_before_it_was_heard_is_told_apart() {
        let counts = |losses: BTreeMap<String, u64>| losses.get("scans_missing").copied();
        let mut totals = Totals::default();
        totals.status(&status(9_000_000, 300, 4));
        assert_eq!((counts(totals.losses_before()), counts(totals.losses_since())), (Some(4), None));
        totals.status(&status(10_000_000, 337, 6));
        assert_eq!((counts(totals.losses_before()), counts(totals.losses_since())), (Some(4), Some(2)));
        totals.restart();
        totals.status(&status(1_000_000, 37, 3));
        assert_eq!((counts(totals.losses_before()), counts(totals.losses_since())), (Some(4), Some(5)));
        let mut booted = Totals::default();
        booted.restart();
        booted.status(&status(1_000_000, 37, 3));
        assert_eq!((counts(booted.losses_before()), counts(booted.losses_since())), (None, Some(3)));
    }
}
