//! GPS time as the logs give it: a week and the time in it.

use super::ieee::Number;

/// Microseconds of a week.
pub const WEEK_US: u64 = 604_800_000_000;

/// An instant of GPS time, to the microsecond. Ordered as instants are.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct GpsTime {
    /// Weeks since 6 January 1980, not folded at 1024.
    pub week: u16,
    /// Microseconds into the week, below [`WEEK_US`].
    pub us: u64,
}

impl GpsTime {
    /// A week and milliseconds into it, as in a header; none at or beyond the week's end.
    #[must_use]
    pub fn from_milliseconds(week: u16, ms: u32) -> Option<Self> {
        let us = u64::from(ms) * 1_000;
        (us < WEEK_US).then_some(Self { week, us })
    }

    /// A week and seconds into it, as in a log's body, rounded to the nearest microsecond; none outside the week.
    #[must_use]
    pub fn from_seconds(week: u32, seconds: Number) -> Option<Self> {
        let week = u16::try_from(week).ok()?;
        let us = u64::try_from(seconds.scaled(1_000_000)?).ok()?;
        match us {
            ..WEEK_US => Some(Self { week, us }),
            // The last half microsecond of a week rounds into the next.
            WEEK_US => Some(Self { week: week.checked_add(1)?, us: 0 }),
            _ => None,
        }
    }

    /// The signed distance `self - earlier` in microseconds; all weeks of 16 bits fit.
    #[must_use]
    pub fn since(self, earlier: Self) -> i64 {
        (i64::from(self.week) - i64::from(earlier.week)) * WEEK_US as i64 + (self.us as i64 - earlier.us as i64)
    }

    /// This instant moved by a signed number of microseconds; none outside the weeks of 16 bits.
    #[must_use]
    pub fn offset(self, us: i64) -> Option<Self> {
        let total = (i64::from(self.week) * WEEK_US as i64 + self.us as i64).checked_add(us)?;
        let total = u64::try_from(total).ok()?;
        Some(Self { week: u16::try_from(total / WEEK_US).ok()?, us: total % WEEK_US })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn seconds(value: f64) -> Number {
        Number::from_f64_bits(value.to_bits()).unwrap()
    }

    #[test]
    fn the_end_of_a_week() {
        let last = GpsTime { week: 2209, us: WEEK_US - 1 };
        assert_eq!(GpsTime::from_seconds(2209, seconds(604_799.999_999_1)), Some(last));
        assert_eq!(GpsTime::from_seconds(2209, seconds(604_799.999_999_9)), Some(GpsTime { week: 2210, us: 0 }));
        assert_eq!(GpsTime::from_seconds(2209, seconds(604_800.1)), None);
        assert_eq!(GpsTime::from_seconds(2209, seconds(-1.0)), None);
        assert_eq!(GpsTime::from_seconds(65_536, seconds(1.0)), None);
        assert_eq!(last.offset(1), Some(GpsTime { week: 2210, us: 0 }));
        assert_eq!(GpsTime { week: 2210, us: 4 }.since(last), 5);
        assert_eq!(GpsTime { week: 2210, us: 4 }.offset(-5), Some(last));
        assert_eq!(GpsTime::default().offset(-1), None);
    }
}
