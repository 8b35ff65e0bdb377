//! A 32-bit counter that wraps, extended to 64 bits that never do.

use crossfall_protocol::DeviceTime;

/// Extends readings of a free-running 32-bit microsecond counter (it wraps every 71.6 minutes).
///
/// Readings may arrive out of order by less than half a wrap (35.8 minutes): an older stamp extends to an older time and
/// moves nothing. What it asks for in return is one reading in every half wrap.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Counter {
    latest: u64,
}

impl Counter {
    /// A counter whose first reading will be close to `start` (0 at boot; elsewhere in tests).
    #[must_use]
    pub const fn starting_at(start: DeviceTime) -> Self {
        Self { latest: start.0 }
    }

    /// The time of one reading.
    ///
    /// The difference to the latest reading is taken modulo 2^32 as a signed number, which is exact while the two are less than
    /// half a wrap apart. A reading from before boot is held at 0.
    pub fn extend(&mut self, reading: u32) -> DeviceTime {
        let ahead = reading.wrapping_sub(self.latest as u32) as i32;
        let time = self.latest.saturating_add_signed(i64::from(ahead));
        self.latest = self.latest.max(time);
        DeviceTime(time)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn crosses_the_wrap_in_both_directions() {
        let mut counter = Counter::default();
        assert_eq!(counter.extend(0x7fff_0000), DeviceTime(0x7fff_0000));
        assert_eq!(counter.extend(0xc000_0000), DeviceTime(0xc000_0000));
        assert_eq!(counter.extend(0xffff_fff0), DeviceTime(0xffff_fff0));
        assert_eq!(counter.extend(5), DeviceTime(0x1_0000_0005));
        // A stamp taken before the wrap and delivered after it.
        assert_eq!(counter.extend(0xffff_fffe), DeviceTime(0xffff_fffe));
        assert_eq!(counter.extend(6), DeviceTime(0x1_0000_0006));
    }

    proptest! {
        #[test]
        fn follows_a_64_bit_clock_through_any_number_of_wraps(
            start in 0u64..1 << 40,
            steps in prop::collection::vec((0u64..1 << 31, 0u64..1 << 20), 1..200),
        ) {
            let mut counter = Counter::starting_at(DeviceTime(start));
            let mut now = start;
            for (step, late) in steps {
                now += step;
                prop_assert_eq!(counter.extend(now as u32), DeviceTime(now));
                // The other sensor's stamp was taken a little earlier.
                let earlier = now.saturating_sub(late);
                prop_assert_eq!(counter.extend(earlier as u32), DeviceTime(earlier));
            }
        }
    }
}
