//! The name that an operator gives a drive, as the name of a file: nothing that could leave the folder, hide or mislead.

use std::path::Path;
use std::time::{SystemTime, UNIX_EPOCH};

use crate::calendar::Date;

/// Longest name of a drive, in bytes.
const LONGEST_NAME: usize = 80;

/// The name of a drive as a file's name; date and time where there is none.
///
/// # Errors
/// Why it cannot be one, in words.
pub fn drive_name(text: &str) -> Result<String, String> {
    let name = text.trim();
    if name.is_empty() {
        let since = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
        return Ok(format!("drive-{}", utc(since.as_secs())));
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
    Ok(name.to_owned())
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
            assert_eq!(drive_name(good).unwrap(), good);
        }
        assert!(drive_name("").unwrap().starts_with("drive-20"));
        for bad in
            ["../x", "a/b", "a\\b", "..", ".hidden", "a\0b", "a\nb", "C:x", "~", &"x".repeat(81), "$(x)", "a%2fb"]
        {
            assert!(drive_name(bad).is_err(), "{bad:?}");
        }
    }

    #[test]
    fn dates_sort_as_they_follow() {
        assert_eq!(utc(0), "19700101-000000");
        assert_eq!(utc(951_782_400), "20000229-000000");
        assert_eq!(utc(1_767_225_599), "20251231-235959");
    }
}
