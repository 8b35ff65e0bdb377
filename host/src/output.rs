//! Output files that appear whole or not at all.
//!
//! A file is written under a temporary name in its own folder and renamed by [`Output::commit`]. Dropped before that
//! (an error, Ctrl-C) it is removed. A recording of a board is never replaced. What is not a regular file (`/dev/null`, a pipe) is written in place, since
//! renaming would replace it. Once the user has asked to stop nothing is given its name: it may be half of what it should be.

use std::fs::{self, File, OpenOptions};
use std::io::{self, BufWriter, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

use tempfile::TempPath;

use crate::log::{is_being_written, is_recording, sync_folder};

/// A file that could not be written.
#[derive(Debug, thiserror::Error)]
#[error("{}: cannot write: {source}", path.display())]
pub struct Error {
    /// The file as the user named it.
    pub path: PathBuf,
    /// Why.
    pub source: io::Error,
}

/// A file under way.
#[derive(Debug)]
pub struct Output {
    path: PathBuf,
    target: Target,
}

#[derive(Debug)]
enum Target {
    /// The file and its temporary name are held apart: together, they would put that name into every error.
    Renamed {
        file: BufWriter<File>,
        part: TempPath,
        to: PathBuf,
    },
    InPlace(BufWriter<File>),
}

impl Output {
    /// Starts a file that will stand at `path`, replacing a regular file that is there.
    ///
    /// # Errors
    /// When the folder does not exist or cannot be written.
    pub fn create(path: &Path) -> Result<Self, Error> {
        let wrap = |source| Error { path: path.to_path_buf(), source };
        let special = fs::metadata(path).is_ok_and(|found| !found.is_file());
        let target = if special {
            Target::InPlace(BufWriter::new(OpenOptions::new().write(true).open(path).map_err(wrap)?))
        } else {
            // A link is followed, so that the file it names is replaced and not the link.
            let to = followed(path).map_err(wrap)?;
            free(&to).map_err(wrap)?;
            if to.file_name().is_none() {
                return Err(wrap(io::Error::other("the path names no file")));
            }
            let folder = folder_of(&to);
            // Before the work, and not when it is done: whether the file system takes the name.
            if let Some(error) = fs::symlink_metadata(&to).err().filter(|e| e.kind() == io::ErrorKind::InvalidFilename)
            {
                return Err(wrap(error));
            }
            let mut builder = tempfile::Builder::new();
            // Short, whatever the file's own name: any that the file system takes works.
            builder.prefix(".crossfall").suffix(".part");
            #[cfg(unix)]
            {
                use std::os::unix::fs::PermissionsExt;
                // As for any new file: the umask takes its bits away. A temporary file alone would be private.
                builder.permissions(fs::Permissions::from_mode(0o666));
            }
            let (file, part) = builder.tempfile_in(folder).map_err(|e| wrap(bare(&e, folder)))?.into_parts();
            Target::Renamed { file: BufWriter::new(file), part, to }
        };
        Ok(Self { path: path.to_path_buf(), target })
    }

    /// The file as the user named it.
    #[must_use]
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Brings the bytes to the disk and gives the file its name.
    ///
    /// # Errors
    /// When the last bytes cannot be written, the file not be renamed, or the user has asked to stop; it is removed then.
    pub fn commit(self) -> Result<(), Error> {
        let Self { path, target } = self;
        if crate::interrupt::requested() {
            return Err(Error { path, source: io::Error::other("interrupted") });
        }
        let finish = || -> io::Result<()> {
            match target {
                Target::Renamed { file, part, to } => {
                    let file = file.into_inner().map_err(|e| e.into_error())?;
                    file.sync_data()?;
                    free(&to)?;
                    part.persist(&to).map_err(|e| e.error)?;
                    sync_folder(&to)?;
                }
                Target::InPlace(mut file) => file.flush()?,
            }
            Ok(())
        };
        finish().map_err(|source| Error { path, source })
    }
}

/// Links that lead from one to the next at most, as on Linux.
const LINKS: usize = 40;

/// The folder of a file: that in which the program runs, if the path names none.
#[must_use]
pub fn folder_of(path: &Path) -> &Path {
    path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."))
}

/// The file that a path names, also through links to one that is not there yet.
fn followed(path: &Path) -> io::Result<PathBuf> {
    if let Ok(real) = fs::canonicalize(path) {
        return Ok(real);
    }
    let mut to = path.to_path_buf();
    for _ in 0..LINKS {
        let Ok(target) = fs::read_link(&to) else { return Ok(to) };
        // What a link names is seen from its own folder.
        to = to.parent().unwrap_or(Path::new("")).join(target);
    }
    Err(io::Error::other("too many links that lead to each other"))
}

/// Refuses to take the name of a recording: one that is being written would go on in a file that has none, and one that is done nobody can make again.
fn free(path: &Path) -> io::Result<()> {
    if is_being_written(path) {
        return Err(io::Error::new(io::ErrorKind::ResourceBusy, "a recording is being written to it"));
    }
    if is_recording(path) {
        let what = "it is a recording of a board, which is never written over: give another name, or delete it first";
        return Err(io::Error::new(io::ErrorKind::AlreadyExists, what));
    }
    Ok(())
}

/// The error without the temporary name that `tempfile` adds: the user knows the file by its own.
fn bare(error: &io::Error, folder: &Path) -> io::Error {
    // A folder that is not there is the usual reason; the system's own words for it are the clearest.
    fs::read_dir(folder).err().unwrap_or_else(|| io::Error::from(error.kind()))
}

/// Writes a whole file at once, with [`Output`]'s promise.
///
/// # Errors
/// When any step of it fails.
pub fn write(path: &Path, contents: &[u8]) -> Result<(), Error> {
    let mut output = Output::create(path)?;
    output.write_all(contents).map_err(|source| Error { path: path.to_path_buf(), source })?;
    output.commit()
}

impl Write for Output {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        match &mut self.target {
            Target::Renamed { file, .. } => file.write(bytes),
            Target::InPlace(file) => file.write(bytes),
        }
    }

    fn flush(&mut self) -> io::Result<()> {
        match &mut self.target {
            Target::Renamed { file, .. } => file.flush(),
            Target::InPlace(file) => file.flush(),
        }
    }
}

impl Seek for Output {
    fn seek(&mut self, to: SeekFrom) -> io::Result<u64> {
        match &mut self.target {
            Target::Renamed { file, .. } => file.seek(to),
            Target::InPlace(file) => file.seek(to),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_appears_only_when_committed() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.csv");
        let mut output = Output::create(&path).unwrap();
        output.write_all(b"half").unwrap();
        assert!(!path.exists());
        drop(output);
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 0, "nothing is left behind");

        write(&path, b"whole").unwrap();
        assert_eq!(fs::read(&path).unwrap(), b"whole");
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1);
    }

    #[test]
    fn an_abandoned_replacement_leaves_the_old_file() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.csv");
        fs::write(&path, b"old").unwrap();
        let mut output = Output::create(&path).unwrap();
        output.write_all(b"new").unwrap();
        drop(output);
        assert_eq!(fs::read(&path).unwrap(), b"old");
    }

    #[cfg(unix)]
    #[test]
    fn any_name_that_the_file_system_takes_works_and_no_longer_one_is_begun() {
        let folder = tempfile::tempdir().unwrap();
        for bytes in [245, 250, 255] {
            let path = folder.path().join("n".repeat(bytes));
            write(&path, b"whole").unwrap();
            assert_eq!(fs::read(&path).unwrap(), b"whole");
        }
        let error = Output::create(&folder.path().join("n".repeat(256))).unwrap_err();
        assert_eq!(error.source.kind(), io::ErrorKind::InvalidFilename, "{error}");
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 3);
    }

    #[test]
    fn a_missing_folder_is_named() {
        let error = Output::create(Path::new("/no/such/folder/a.mcap")).unwrap_err();
        assert!(error.to_string().starts_with("/no/such/folder/a.mcap: cannot write: "), "{error}");
        assert!(!error.to_string().contains(".part"), "{error}");
    }

    #[cfg(unix)]
    #[test]
    fn a_link_stays_one_whether_its_file_is_there_or_not() {
        use std::os::unix::fs::symlink;
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        fs::create_dir(at("far")).unwrap();
        symlink("far/b", at("a")).unwrap();
        symlink("c", at("far/b")).unwrap();
        for contents in [b"new".as_slice(), b"newer"] {
            write(&at("a"), contents).unwrap();
            assert!(fs::symlink_metadata(at("a")).unwrap().is_symlink());
            assert!(fs::symlink_metadata(at("far/b")).unwrap().is_symlink());
            assert_eq!(fs::read(at("far/c")).unwrap(), contents);
        }
        symlink("round", at("round")).unwrap();
        assert!(write(&at("round"), b"").unwrap_err().to_string().contains("links"));
        assert!(fs::symlink_metadata(at("round")).unwrap().is_symlink());
    }

    #[cfg(unix)]
    #[test]
    fn a_device_is_written_and_not_replaced() {
        let null = Path::new("/dev/null");
        write(null, b"gone").unwrap();
        assert!(!fs::metadata(null).unwrap().is_file());
    }
}
