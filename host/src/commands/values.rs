//! Parsers of options' values, which say what they expect.

use std::fmt::Display;
use std::str::FromStr;

/// A parser of numbers within bounds, both included.
pub fn number<T>(low: T, high: T) -> impl Fn(&str) -> Result<T, String> + Clone
where
    T: Clone + Display + FromStr + PartialOrd,
{
    move |text| match text.parse() {
        Ok(value) if low <= value && value <= high => Ok(value),
        _ => Err(format!("expected a number from {low} to {high}")),
    }
}

/// `500MB`, `2GiB`, `1000000`.
pub fn size(text: &str) -> Result<u64, String> {
    const EXPECTED: &str = "expected a whole number with B, kB, MB, GB, KiB, MiB or GiB";
    let digits = text.find(|c: char| !c.is_ascii_digit()).unwrap_or(text.len());
    let (number, unit) = text.split_at(digits);
    let unit: u64 = match unit {
        "" | "B" => 1,
        "kB" => 1_000,
        "MB" => 1_000_000,
        "GB" => 1_000_000_000,
        "KiB" => 1 << 10,
        "MiB" => 1 << 20,
        "GiB" => 1 << 30,
        _ => return Err(EXPECTED.to_owned()),
    };
    let size = number.parse::<u64>().ok().and_then(|number| number.checked_mul(unit));
    size.ok_or_else(|| EXPECTED.to_owned())
}
