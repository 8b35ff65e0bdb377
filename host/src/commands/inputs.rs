//! What commands read and write: the configuration, the format of a table, and which files must not be the same.

use std::path::{Path, PathBuf};

use anyhow::Context;
use crossfall::{output, table};
use crossfall_core::protocol::Config;

/// The configuration of a file, or the defaults.
pub fn configuration(file: Option<&Path>) -> anyhow::Result<Config> {
    Ok(file.map(crossfall::config::read).transpose()?.unwrap_or_default())
}

/// The format of a table by its name.
pub fn table_format(path: &Path) -> anyhow::Result<table::Format> {
    let format = table::Format::of(path);
    format.with_context(|| format!("{}: expected a name that ends in .csv, .parquet or .geojson", path.display()))
}

/// Paths, as [`distinct`] takes them.
pub fn paths<'a>(all: impl IntoIterator<Item = &'a PathBuf>) -> Vec<&'a Path> {
    all.into_iter().map(PathBuf::as_path).collect()
}

/// Refuses to write a file over one that is read, or two into one.
pub fn distinct(inputs: &[&Path], outputs: &[&Path]) -> anyhow::Result<()> {
    // A file that is not there yet is known by its folder. What is no file (`/dev/null`) takes all there is.
    let real = |path: &Path| {
        path.canonicalize().ok().or_else(|| Some(output::folder_of(path).canonicalize().ok()?.join(path.file_name()?)))
    };
    let inputs: Vec<_> = inputs.iter().filter_map(|input| real(input)).collect();
    let mut written = Vec::new();
    for output in outputs.iter().filter(|output| !output.exists() || output.is_file()) {
        let Some(place) = real(output) else { continue };
        anyhow::ensure!(!inputs.contains(&place), "{}: is read, and cannot be written as well", output.display());
        anyhow::ensure!(!written.contains(&place), "{}: cannot be two outputs at once", output.display());
        written.push(place);
    }
    Ok(())
}
