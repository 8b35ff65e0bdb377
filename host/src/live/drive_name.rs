//! The name that an operator gives a drive, as the name of a file: nothing that could leave the folder, hide or mislead.

use std::fmt::{self, Display, Formatter};
use std::path::Path;
use std::time::{SystemTime, UNIX_EPOCH};

use crate::calendar::Date;

/// Longest name of a drive, in bytes.
const LONGEST_NAME: usize = 80;

/// The name of a drive, as a file's name.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct DriveName(String);

impl DriveName {
    /// What an operator has typed; date and time where that is nothing.
    ///
    /// # Errors
    /// Why it cannot be one, in words.
    pub fn new(text: &str) -> Result<Self, String> {
        let name = text.trim();
        if name.is_empty() {
            return Ok(Self::of_now());
        }
        if name.len() > LONGEST_NAME {
            return Err(format!("a drive's name has at most {LONGEST_NAME} bytes"));
        }
        let wrong = name.chars().find(|&c| !(c.is_alphanumeric() || matches!(c, ' ' | '-' | '_' | '.' | '+')));
        if let Some(wrong) = wrong {
            return Err(format!("a drive's name has letters, digits, spaces and - _ . +, not {wrong:?}"));
        }
        if name.starts_with('.') || Path::new(name).file_name().is_none_or(|file| file != name) {
            return Err("a drive's name does not begin with a dot".into());
        }
        Ok(Self(name.to_owned()))
    }

    /// Date and time.
    #[must_use]
    pub fn of_now() -> Self {
        let since = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
        Self(format!("drive-{}", utc(since.as_secs())))
    }
}

impl Display for DriveName {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        f.write_str(&self.0)
    }
}

/// Date and time as they sort: 20260131-235959.
fn utc(seconds: u64) -> String {
    let Date { year, month, day } = Date::of_unix(seconds);
    let time = seconds % 86_400;
    format!("{year:04}{month:02}{day:02}-{:02}{:02}{:02}", time / 3_600, time / 60 % 60, time % 60)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_cannot_leave_the_folder() {
        for good in ["A1 north", "drive-7_b.2", "Überholspur 3+"] {
            assert_eq!(DriveName::new(good).unwrap().to_string(), good);
        }
        for name in [DriveName::new("").unwrap(), DriveName::new(" ").unwrap(), DriveName::of_now()] {
            assert!(name.to_string().starts_with("drive-20"), "{name}");
        }
        for bad in
            ["../x", "a/b", "a\\b", "..", ".hidden", "a\0b", "a\nb", "C:x", "~", &"x".repeat(81), "$(x)", "a%2fb"]
        {
            assert!(DriveName::new(bad).is_err(), "{bad:?}");
        }
    }

    #[test]
    fn dates_sort_as_they_follow() {
        assert_eq!(utc(0), "19700101-000000");
        assert_eq!(utc(951_782_400), "20000229-000000");
        assert_eq!(utc(1_767_225_599), "20251231-235959");
    }
}
