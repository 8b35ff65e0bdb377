//! Dates of the Gregorian calendar, and the seconds of GPS and of Unix.

use std::fmt;

use crate::leap;

/// Seconds of a GPS week.
pub const WEEK_S: u64 = 604_800;

const DAY_S: u64 = 86_400;

/// From the epoch of Unix (1970-01-01) to that of GPS (1980-01-06), in seconds.
const GPS_EPOCH_S: u64 = 3_657 * DAY_S;

/// Unix time of a second of a GPS week.
#[must_use]
pub fn unix_of_gps(week: u16, seconds: u64) -> u64 {
    GPS_EPOCH_S + u64::from(week) * WEEK_S + seconds - leap::seconds(week, seconds)
}

/// A day in UTC.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Date {
    /// The year.
    pub year: u32,
    /// 1 to 12.
    pub month: u8,
    /// 1 to 31.
    pub day: u8,
}

impl Date {
    /// The day of a Unix time, by Howard Hinnant's `civil_from_days`.
    #[must_use]
    pub fn of_unix(seconds: u64) -> Self {
        let shifted = seconds / DAY_S + 719_468;
        let (era, day_of_era) = (shifted / 146_097, shifted % 146_097);
        let year_of_era = (day_of_era - day_of_era / 1_460 + day_of_era / 36_524 - day_of_era / 146_096) / 365;
        let day_of_year = day_of_era - (365 * year_of_era + year_of_era / 4 - year_of_era / 100);
        let month_from_march = (5 * day_of_year + 2) / 153;
        let day = day_of_year - (153 * month_from_march + 2) / 5 + 1;
        let month = if month_from_march < 10 { month_from_march + 3 } else { month_from_march - 9 };
        let year = year_of_era + era * 400 + u64::from(month <= 2);
        // A year beyond four billion is no date of a drive.
        Self { year: year as u32, month: month as u8, day: day as u8 }
    }
}

impl fmt::Display for Date {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{:04}-{:02}-{:02}", self.year, self.month, self.day)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn dates_are_those_of_the_calendar() {
        for (seconds, date) in [
            (0, "1970-01-01"),
            (951_782_399, "2000-02-28"),
            (951_782_400, "2000-02-29"),
            (951_868_800, "2000-03-01"),
            (1_767_225_599, "2025-12-31"),
            (4_107_542_400, "2100-03-01"),
        ] {
            assert_eq!(Date::of_unix(seconds).to_string(), date, "{seconds}");
        }
    }

    #[test]
    fn gps_weeks_are_behind_by_the_leap_seconds() {
        // The start of GPS time; a leap day, 13 leap seconds apart from midnight; the end of week 2400's Tuesday, 18 apart.
        for (week, seconds, date) in [
            (0, 0, "1980-01-06"),
            (1_051, 2 * 86_400 + 12, "2000-02-28"),
            (1_051, 2 * 86_400 + 13, "2000-02-29"),
            (2_400, 18, "2026-01-04"),
            (2_400, 259_200 + 17, "2026-01-06"),
            (2_400, 259_200 + 18, "2026-01-07"),
        ] {
            assert_eq!(Date::of_unix(unix_of_gps(week, seconds)).to_string(), date, "{week} {seconds}");
        }
    }
}
