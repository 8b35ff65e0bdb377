//! A serial line as physics has it: bytes follow each other no faster than the baud rate allows.
//!
//! A chunk of bytes carries the arrival of its first byte only. The others follow one byte time apart, and the first byte of the next chunk
//! cannot come sooner than a byte time after the last of this one. So the arrival of every byte is the same however a
//! stream is cut into chunks, even when the pieces of a chunk all carry the stamp of the whole.

/// Start bit, eight data bits, stop bit.
const BITS_A_BYTE: u64 = 10;

/// One line, at one baud rate.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Line {
    byte_ns: u64,
    free_ns: u64,
}

impl Line {
    /// A line of so many baud (0 is taken as 1).
    #[must_use]
    pub const fn new(baud: u32) -> Self {
        let baud = if baud == 0 { 1 } else { baud };
        Self { byte_ns: BITS_A_BYTE * 1_000_000_000 / baud as u64, free_ns: 0 }
    }

    /// When the next byte of a chunk that is stamped `chunk_ns` arrives, in nanoseconds of device time.
    #[must_use]
    pub fn next_arrival(&self, chunk_ns: u64) -> u64 {
        chunk_ns.max(self.free_ns)
    }

    /// Lets that byte arrive.
    pub fn take(&mut self, chunk_ns: u64) -> u64 {
        let arrival = self.next_arrival(chunk_ns);
        self.free_ns = arrival.saturating_add(self.byte_ns);
        arrival
    }
}

#[cfg(test)]
mod tests {
    use super::Line;
    use proptest::prelude::*;

    #[test]
    fn bytes_of_a_chunk_follow_at_the_baud_rate() {
        let mut line = Line::new(500_000);
        assert_eq!([line.take(1_000), line.take(1_000), line.take(1_000)], [1_000, 21_000, 41_000]);
        assert_eq!(line.take(1_000_000), 1_000_000);
    }

    proptest! {
        /// Cut anywhere, with stamps of the pieces exact or all those of the whole: the same arrivals.
        #[test]
        fn arrivals_do_not_depend_on_the_cuts(
            lengths in prop::collection::vec(1usize..900, 1..6),
            gaps in prop::collection::vec(0u64..40_000_000, 6),
            cuts in prop::collection::vec(any::<bool>(), 6_000),
            exact in any::<bool>(),
        ) {
            let (mut whole, mut cut) = (Line::new(500_000), Line::new(500_000));
            let mut start = 0;
            for (length, gap) in lengths.into_iter().zip(gaps) {
                let mut piece = start;
                for (i, &here) in cuts.iter().enumerate().take(length) {
                    if exact && here {
                        piece = start + i as u64 * 20_000;
                    }
                    prop_assert_eq!(whole.take(start), cut.take(piece));
                }
                start += length as u64 * 20_000 + gap;
            }
        }
    }
}
