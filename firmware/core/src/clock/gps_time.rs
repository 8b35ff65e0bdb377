//! GPS time: a week and the time in it.

/// Microseconds of a week.
pub const WEEK_US: u64 = 604_800_000_000;

/// An instant of GPS time, to the microsecond; leap seconds are not counted. Ordered as instants are.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct GpsTime {
    /// Weeks since 6 January 1980, not folded at 1024.
    pub week: u16,
    /// Microseconds into the week, below [`WEEK_US`].
    pub us: u64,
}

impl GpsTime {
    /// A week and milliseconds into it, as in the header of a log; none at or beyond the week's end.
    #[must_use]
    pub fn from_milliseconds(week: u16, ms: u32) -> Option<Self> {
        let us = u64::from(ms) * 1_000;
        (us < WEEK_US).then_some(Self { week, us })
    }

    /// Microseconds since the epoch. Exact: 65,535 weeks are below 2^56 us, and of `us` 40 bits are taken, which hold every week.
    #[must_use]
    pub fn count_us(self) -> i64 {
        i64::from(self.week) * WEEK_US as i64 + (self.us & ((1 << 40) - 1)) as i64
    }

    /// The instant so many microseconds after the epoch; weeks are taken modulo 2^16.
    #[must_use]
    pub fn of_count(us: i64) -> Self {
        Self { week: us.div_euclid(WEEK_US as i64) as u16, us: us.rem_euclid(WEEK_US as i64) as u64 }
    }

    /// The signed distance `self - earlier` in microseconds; all weeks of 16 bits fit.
    #[must_use]
    pub fn since(self, earlier: Self) -> i64 {
        self.count_us() - earlier.count_us()
    }

    /// This instant moved by a signed number of microseconds; none outside the weeks of 16 bits.
    #[must_use]
    pub fn offset(self, us: i64) -> Option<Self> {
        let total = u64::try_from(self.count_us().checked_add(us)?).ok()?;
        Some(Self { week: u16::try_from(total / WEEK_US).ok()?, us: total % WEEK_US })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_end_of_a_week() {
        let last = GpsTime { week: 2209, us: WEEK_US - 1 };
        let after = |us| GpsTime { week: 2210, us };
        assert_eq!(GpsTime::from_milliseconds(2209, 604_800_000), None);
        assert_eq!(last.offset(1), Some(after(0)));
        assert_eq!(after(4).since(last), 5);
        assert_eq!(after(4).offset(-5), Some(last));
        assert_eq!(GpsTime::default().offset(-1), None);
        assert_eq!(GpsTime { week: u16::MAX, us: WEEK_US - 1 }.offset(1), None);
        for instant in [last, after(0), GpsTime::default()] {
            assert_eq!(GpsTime::of_count(instant.count_us()), instant);
        }
    }
}
