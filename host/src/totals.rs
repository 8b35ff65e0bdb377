//! The board's counters over a whole stream.
//!
//! A board that boots again counts from zero; what it had lost before is lost all the same. So the last status of every boot is added up. What the first
//! status of all tells was lost before anybody listened: it is known apart.

use std::collections::BTreeMap;

use crossfall_core::protocol::message::Status;

use crate::info;

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
        for (name, count) in self.latest.iter().flat_map(info::counters) {
            *all.entry(name).or_default() += count;
        }
        all
    }

    /// The counters that tell of lost data and are not zero.
    #[must_use]
    pub fn losses(&self) -> BTreeMap<String, u64> {
        info::lost(self.counters())
    }

    /// Those of them that the first status told already.
    #[must_use]
    pub fn losses_before(&self) -> BTreeMap<String, u64> {
        self.first.as_ref().map(info::losses).unwrap_or_default()
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
