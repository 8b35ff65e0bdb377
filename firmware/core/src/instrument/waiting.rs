//! The scans that wait for their attitude, oldest first, written and read where they lie.
//!
//! A scan is 824 bytes: a queue that hands scans over by value keeps one or two on the stack at every step of the way.

use super::survey::WAITING;
use crate::scan::RawScan;

/// See the module.
#[derive(Debug)]
pub(super) struct Waiting {
    places: [RawScan; WAITING],
    oldest: usize,
    len: usize,
}

impl Waiting {
    /// Nothing waits.
    pub const fn new() -> Self {
        Self { places: [RawScan::EMPTY; WAITING], oldest: 0, len: 0 }
    }

    pub const fn len(&self) -> usize {
        self.len
    }

    pub const fn is_empty(&self) -> bool {
        self.len == 0
    }

    pub const fn is_full(&self) -> bool {
        self.len >= WAITING
    }

    pub fn clear(&mut self) {
        self.len = 0;
    }

    /// Adds a scan; one for which there is no room is left out.
    pub fn push(&mut self, scan: &RawScan) {
        if self.is_full() {
            return;
        }
        if let Some(place) = self.places.get_mut((self.oldest + self.len) % WAITING) {
            place.clone_from(scan);
            self.len += 1;
        }
    }

    pub fn oldest(&self) -> Option<&RawScan> {
        if self.is_empty() { None } else { self.places.get(self.oldest) }
    }

    pub fn drop_oldest(&mut self) {
        if !self.is_empty() {
            self.oldest = (self.oldest + 1) % WAITING;
            self.len -= 1;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn scans_leave_in_their_order_over_many_turns_of_the_ring() {
        let mut waiting = Waiting::new();
        let mut scan = Waiting::new().places[0].clone();
        let (mut next_in, mut next_out) = (0, 0);
        for round in 0..50 {
            for _ in 0..=round % (WAITING + 2) {
                (scan.index, scan.values[7]) = (next_in, next_in as u16);
                next_in += u32::from(!waiting.is_full());
                waiting.push(&scan);
            }
            while waiting.len() > round % 3 {
                let oldest = waiting.oldest().expect("not empty");
                assert_eq!((oldest.index, oldest.values[7]), (next_out, next_out as u16));
                next_out += 1;
                waiting.drop_oldest();
            }
        }
        assert!(next_out > 100);
        waiting.clear();
        assert!(waiting.oldest().is_none());
    }
}
