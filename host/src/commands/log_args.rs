//! How a recording is written: the options that `record`, `serve` and `monitor` share.

use crossfall::log;

use super::size;

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
