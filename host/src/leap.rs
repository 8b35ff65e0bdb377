//! Leap seconds: by how much GPS time is ahead of UTC at a time.
//!
//! GPS time has none and was equal to UTC when it began, on 6 January 1980. The list is that of the IERS (Bulletin C), as `leap-seconds.list` of the IETF's
//! time zone database has it; none has been added since 2017, and recordings from before are often met.

/// When each was added since 1980: the GPS week and the day of the week (0 = Sunday) that began in UTC right behind it.
const ADDED: [(u16, u8); 18] = [
    (77, 3),    // 1981-07-01
    (129, 4),   // 1982-07-01
    (181, 5),   // 1983-07-01
    (286, 1),   // 1985-07-01
    (416, 5),   // 1988-01-01
    (521, 1),   // 1990-01-01
    (573, 2),   // 1991-01-01
    (651, 3),   // 1992-07-01
    (703, 4),   // 1993-07-01
    (755, 5),   // 1994-07-01
    (834, 1),   // 1996-01-01
    (912, 2),   // 1997-07-01
    (990, 5),   // 1999-01-01
    (1_356, 0), // 2006-01-01
    (1_512, 4), // 2009-01-01
    (1_695, 0), // 2012-07-01
    (1_851, 3), // 2015-07-01
    (1_930, 0), // 2017-01-01
];

const DAY_S: u64 = 86_400;

/// Seconds by which GPS time is ahead of UTC at a second of a GPS week.
#[must_use]
pub fn seconds(week: u16, second: u64) -> u64 {
    let count = |week: u16, day: u64, second: u64| (u64::from(week) * 7 + day) * DAY_S + second;
    let now = count(week, 0, second);
    // In GPS time that day began later, by all that had been added.
    ADDED.iter().zip(1..).filter(|&(&(week, day), total)| count(week, u64::from(day), total) <= now).count() as u64
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::calendar::{Date, unix_of_gps};

    #[test]
    fn every_leap_second_came_before_the_first_of_january_or_july() {
        for (&(week, day), total) in ADDED.iter().zip(1..) {
            let midnight = u64::from(day) * DAY_S + total;
            let date = Date::of_unix(unix_of_gps(week, midnight)).to_string();
            assert!(date.ends_with("-01-01") || date.ends_with("-07-01"), "{date}");
            assert_eq!((seconds(week, midnight - 1), seconds(week, midnight)), (total - 1, total), "{date}");
        }
    }

    #[test]
    fn gps_was_ahead_by_as_much_as_was_published() {
        // The beginning; 24 November 2014; today's.
        assert_eq!([(0, 0), (1_820, 160_203), (2_400, 0)].map(|(week, second)| seconds(week, second)), [0, 16, 18]);
    }
}
