//! How a recording is written: the options that `record`, `serve` and `monitor` share.

use crossfall::log;

/// How a recording is written.
#[derive(clap::Args)]
pub struct LogArgs {
    /// Begin another file when one has this size (500MB, 2GiB)
    #[arg(long, value_name = "SIZE", default_value = "2GiB", value_parser = size)]
    rotate_size: u64,
    /// Begin another file after so many minutes
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(1..=1_000_000))]
    rotate_minutes: Option<u64>,
    /// End the recording when less than this is free on the disk
    #[arg(long, value_name = "SIZE", default_value = "64MiB", value_parser = size)]
    pub min_free: u64,
    /// Pack the log with zstd: a third smaller, but a damaged chunk is lost as a whole
    #[arg(long)]
    compress: bool,
}

impl LogArgs {
    /// How files follow each other, and whether they are packed.
    pub fn options(&self) -> log::Options {
        let max_ns = self.rotate_minutes.map_or(u64::MAX, |minutes| minutes * 60_000_000_000);
        log::Options { max_bytes: self.rotate_size, max_ns, compress: self.compress }
    }
}

/// `500MB`, `2GiB`, `1000000`.
fn size(text: &str) -> Result<u64, String> {
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
        _ => return Err("expected a whole number with B, kB, MB, GB, KiB, MiB or GiB".to_owned()),
    };
    let size = number.parse::<u64>().ok().and_then(|number| number.checked_mul(unit));
    size.ok_or_else(|| "expected a whole number with B, kB, MB, GB, KiB, MiB or GiB".to_owned())
}
