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

/// A file, however it is named. One that is not there yet is known by its folder, and by its name alone where that is not there either.
pub fn real(path: &Path) -> PathBuf {
    let by_folder = || Some(output::folder_of(path).canonicalize().ok()?.join(path.file_name()?));
    path.canonicalize().ok().or_else(by_folder).unwrap_or_else(|| path.to_path_buf())
}

/// Refuses to write a file over one that is read, or two into one.
pub fn distinct(inputs: &[&Path], outputs: &[&Path]) -> anyhow::Result<()> {
    // What is no file (`/dev/null`) takes all there is.
    let inputs: Vec<_> = inputs.iter().map(|input| real(input)).collect();
    let mut written = Vec::new();
    for output in outputs.iter().filter(|output| !output.exists() || output.is_file()) {
        let place = real(output);
        anyhow::ensure!(!inputs.contains(&place), "{}: is read, and cannot be written as well", output.display());
        anyhow::ensure!(!written.contains(&place), "{}: cannot be two outputs at once", output.display());
        written.push(place);
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_file_is_one_however_it_is_named_and_whether_it_is_there_or_not() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        std::fs::create_dir(at("sub")).unwrap();
        std::fs::write(at("there"), "").unwrap();
        for (one, other) in [("there", "sub/../there"), ("not", "sub/../not"), ("gone/a", "gone/a")] {
            assert_eq!(real(&at(one)), real(&at(other)), "{one}");
            assert!(distinct(&[], &[&at(one), &at(other)]).is_err(), "{one} twice");
            assert!(distinct(&[&at(one)], &[&at(other)]).is_err(), "{one} read and written");
        }
        assert!(distinct(&[&at("there")], &[&at("not"), &at("gone/a"), &at("gone/b")]).is_ok());
    }
}
