//! A data set of many drives: `road=NAME/date=YYYY-MM-DD/DRIVE.parquet`, the layout that DuckDB, Spark and pandas read as one table.
//!
//! A partition file is written whole or not at all, and notes what it was made from and how: one of the same log, made by the same program in the same
//! way, is left as it is. A run that was stopped goes on where it was.
//! The date is that of the first scan with a GPS time, in UTC.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::mpsc;
use std::time::UNIX_EPOCH;
use std::{fs, io};

use crate::calendar::{Date, unix_of_gps};
use crate::intervals::{Every, Gather};
use crate::output::{self, Output};
use crate::profiles::{Row, Rows};
use crate::table::{self, Format, Note, Table};
use crate::{container, interrupt};

/// What the Hive convention calls a partition of rows without a value.
const NONE: &str = "__HIVE_DEFAULT_PARTITION__";

/// A drive could not be taken in.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// The log cannot be read.
    #[error(transparent)]
    Log(#[from] container::Error),
    /// The partition cannot be written.
    #[error(transparent)]
    Output(#[from] output::Error),
    /// The table cannot be written.
    #[error("{}: {source}", path.display())]
    Table {
        /// The file.
        path: PathBuf,
        /// Why.
        source: table::Error,
    },
    /// Two logs would be written to one partition file.
    #[error("{} and {}: two drives of one name on one road", one.display(), other.display())]
    SameName {
        /// A log.
        one: PathBuf,
        /// Another.
        other: PathBuf,
    },
}

/// A table that was written.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Written {
    /// Where it is.
    pub path: PathBuf,
    /// Its rows; nothing for one that was there already, of the same log and made in the same way.
    pub rows: Option<u64>,
    /// Damaged, broken or missing parts of the log that were passed over.
    pub damage: u64,
    /// Rows that had no station and belong to no stretch.
    pub unplaced: u64,
    /// Rows that say themselves unreliable and have no part in their stretch.
    pub unreliable: u64,
}

/// What a table is to be like.
#[derive(Clone, Copy)]
struct Wanted {
    every: Option<Every>,
    format: Format,
}

/// What is noted with a table of rows that have said nothing of note.
fn nothing<T>(_: &T) -> Vec<Note> {
    Vec::new()
}

/// Writes one log's table, whole or not at all. `progress` is told how far the log has been read, in bytes.
///
/// Reading and writing run side by side.
///
/// # Errors
/// When the log cannot be read or the file not be written, and when the user asks to stop.
pub fn write(
    log: &Path,
    every: Option<Every>,
    format: Format,
    to: &Path,
    progress: impl FnMut(u64) + Send,
) -> Result<Written, Error> {
    write_noted(log, Wanted { every, format }, to, progress, nothing)
}

/// `notes` is told the damage passed.
fn write_noted(
    log: &Path,
    wanted: Wanted,
    to: &Path,
    progress: impl FnMut(u64) + Send,
    notes: impl FnOnce(&u64) -> Vec<Note>,
) -> Result<Written, Error> {
    let rows = Rows::open(log)?;
    let read = |sink: &mut RowSink| Ok(read(rows, progress, sink));
    let (written, damage) = write_made(wanted, to, read, notes)?;
    Ok(Written { damage, ..written })
}

/// Writes the table of rows that somebody else makes, whole or not at all; gives back what they say in the end.
///
/// # Errors
/// When the rows do not come to their end, the file cannot be written, and when the user asks to stop.
pub fn write_from<T: Send>(
    every: Option<Every>,
    format: Format,
    to: &Path,
    make: impl FnOnce(&mut RowSink) -> Result<T, container::Error> + Send,
) -> Result<(Written, T), Error> {
    write_made(Wanted { every, format }, to, make, nothing)
}

fn write_made<T: Send>(
    wanted: Wanted,
    to: &Path,
    make: impl FnOnce(&mut RowSink) -> Result<T, container::Error> + Send,
    notes: impl FnOnce(&T) -> Vec<Note>,
) -> Result<(Written, T), Error> {
    let output = Output::create(to)?;
    // Of rows that have not come to their end no table stays.
    let notes = |made: &Result<T, _>| made.as_ref().map_or_else(|_| Vec::new(), notes);
    let (output, written, made) = tabulate(wanted, output, make, notes).map_err(|error| match error {
        Stopped::Table(source) => Error::Table { path: to.to_path_buf(), source },
        Stopped::Interrupted => container::Error::Interrupted.into(),
    })?;
    let made = made?;
    output.commit()?;
    Ok((Written { path: to.to_path_buf(), ..written }, made))
}

/// Why a table ended early.
#[derive(Debug, thiserror::Error)]
pub enum Stopped {
    /// It cannot be written.
    #[error(transparent)]
    Table(#[from] table::Error),
    /// The user asked to stop.
    #[error("interrupted")]
    Interrupted,
}

/// Writes rows to any sink, see [`write`]; gives the sink back.
///
/// # Errors
/// When the sink fails or the user asks to stop.
pub fn stream<W: io::Write + Send>(
    rows: Rows,
    every: Option<Every>,
    format: Format,
    out: W,
    progress: impl FnMut(u64) + Send,
) -> Result<(W, Written), Stopped> {
    let (out, written, damage) = tabulate(Wanted { every, format }, out, |sink| read(rows, progress, sink), nothing)?;
    Ok((out, Written { damage, ..written }))
}

/// Gives all rows of a log to a table; tells the damage passed.
fn read(mut rows: Rows, mut progress: impl FnMut(u64), sink: &mut RowSink) -> u64 {
    let mut read = 0_u64;
    while let Some(row) = rows.next() {
        read += 1;
        if read.is_multiple_of(BATCH as u64) {
            progress(rows.offset());
        }
        // Nobody takes rows any more once writing has failed.
        if !sink.push(row) {
            break;
        }
    }
    rows.damage()
}

/// Rows that change hands at a time, and how many times that may wait.
const BATCH: usize = 2_048;
const WAITING: usize = 4;

/// Takes rows for a table that is written on another thread.
#[derive(Debug)]
pub struct RowSink {
    batch: Vec<Row>,
    sender: mpsc::SyncSender<Vec<Row>>,
}

impl RowSink {
    /// Takes a row; false when nobody wants any more.
    pub fn push(&mut self, row: Row) -> bool {
        self.batch.push(row);
        self.batch.len() < BATCH || self.hand_over()
    }

    fn hand_over(&mut self) -> bool {
        self.sender.send(std::mem::replace(&mut self.batch, Vec::with_capacity(BATCH))).is_ok()
    }
}

/// Writes a table of the rows that `make` pushes on a thread of its own, with notes of what that says in the end.
fn tabulate<W: io::Write + Send, T: Send>(
    Wanted { every, format }: Wanted,
    out: W,
    make: impl FnOnce(&mut RowSink) -> T + Send,
    notes: impl FnOnce(&T) -> Vec<Note>,
) -> Result<(W, Written, T), Stopped> {
    let mut count = 0;
    let (mut unplaced, mut unreliable) = (0, 0);
    let (out, made) = match every {
        None => {
            let mut table = Table::new(format, out)?;
            let made = beside(make, |row| {
                count += 1;
                table.row(row)
            })?;
            (table.finish_with(&notes(&made))?, made)
        }
        Some(every) => {
            let mut table = Table::new(format, out)?;
            let mut gather = Gather::new(every);
            let made = beside(make, |row| match gather.row(row) {
                Some(stretch) => {
                    count += 1;
                    table.row(&stretch)
                }
                None => Ok(()),
            })?;
            for stretch in gather.finish() {
                count += 1;
                table.row(&stretch)?;
            }
            (unplaced, unreliable) = (gather.unplaced(), gather.unreliable());
            (table.finish_with(&notes(&made))?, made)
        }
    };
    Ok((out, Written { rows: Some(count), unplaced, unreliable, ..Written::default() }, made))
}

/// Makes rows on a thread of their own and gives them to `take`.
fn beside<T: Send>(
    make: impl FnOnce(&mut RowSink) -> T + Send,
    mut take: impl FnMut(&Row) -> Result<(), table::Error>,
) -> Result<T, Stopped> {
    std::thread::scope(|scope| {
        let (sender, receiver) = mpsc::sync_channel::<Vec<Row>>(WAITING);
        let maker = scope.spawn(move || {
            let mut sink = RowSink { batch: Vec::with_capacity(BATCH), sender };
            let made = make(&mut sink);
            sink.hand_over();
            made
        });
        for batch in &receiver {
            if interrupt::requested() {
                return Err(Stopped::Interrupted);
            }
            for row in &batch {
                take(row)?;
            }
        }
        drop(receiver);
        if interrupt::requested() {
            return Err(Stopped::Interrupted);
        }
        // A panic of the maker is this thread's as well.
        Ok(maker.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic)))
    })
}

/// Where a log's rows belong: road and date.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Partition {
    /// Name of the road.
    pub road: String,
    /// `YYYY-MM-DD`, or nothing for a drive without GPS time.
    pub date: Option<String>,
    /// Name of the drive: its log's without extensions.
    pub drive: String,
}

impl Partition {
    /// The partition of a log. Without a name for the road it is that of the log's folder.
    ///
    /// # Errors
    /// When the log cannot be read.
    pub fn of(log: &Path, road: Option<&str>) -> Result<Self, container::Error> {
        let folder = || {
            let absolute = log.canonicalize().ok()?;
            Some(absolute.parent()?.file_name()?.to_string_lossy().into_owned())
        };
        let road = road.map(str::to_owned).or_else(folder).unwrap_or_else(|| NONE.to_owned());
        let gps = Rows::open(log)?.find_map(|row| row.position.gps);
        interrupt::check()?;
        let name = log.file_name().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default();
        let drive = name.strip_suffix(".mcap").unwrap_or(&name);
        let drive = drive.strip_suffix(".log").unwrap_or(drive).to_owned();
        let date = gps.map(|(week, seconds)| Date::of_unix(unix_of_gps(week, seconds as u64)).to_string());
        Ok(Self { road, date, drive })
    }

    /// Its file within a data set.
    #[must_use]
    pub fn file(&self, dataset: &Path) -> PathBuf {
        let date = self.date.as_deref().unwrap_or(NONE);
        let folder = dataset.join(format!("road={}", escaped(&self.road))).join(format!("date={date}"));
        folder.join(format!("{}.parquet", escaped(&self.drive)))
    }
}

/// Takes logs into a data set, as many at a time as there are processors.
///
/// `progress` is told the bytes read of each log, `done` the outcome of each, in the order in which they end. One log that fails does not
/// keep the others.
///
/// # Errors
/// [`Error::SameName`], before anything is written.
pub fn take_in(
    logs: &[PathBuf],
    road: Option<&str>,
    every: Option<Every>,
    dataset: &Path,
    progress: impl Fn(usize, u64) + Sync,
    done: impl Fn(usize, Result<Written, Error>) + Sync,
) -> Result<(), Error> {
    let mut names: BTreeMap<PathBuf, &PathBuf> = BTreeMap::new();
    let mut work = Vec::new();
    for (number, log) in logs.iter().enumerate() {
        match Partition::of(log, road) {
            Ok(partition) => {
                let file = partition.file(dataset);
                if let Some(other) = names.insert(file.clone(), log) {
                    return Err(Error::SameName { one: other.clone(), other: log.clone() });
                }
                work.push((number, log, file));
            }
            Err(container::Error::Interrupted) => return Ok(()),
            Err(error) => done(number, Err(error.into())),
        }
    }
    let next = AtomicUsize::new(0);
    let workers = std::thread::available_parallelism().map_or(1, usize::from).min(work.len());
    std::thread::scope(|scope| {
        for _ in 0..workers {
            scope.spawn(|| {
                while let Some((number, log, file)) = work.get(next.fetch_add(1, Ordering::Relaxed)) {
                    if interrupt::requested() {
                        break;
                    }
                    done(*number, partition(log, every, file, |offset| progress(*number, offset)));
                }
            });
        }
    });
    Ok(())
}

fn partition(
    log: &Path,
    every: Option<Every>,
    file: &Path,
    progress: impl FnMut(u64) + Send,
) -> Result<Written, Error> {
    let origin = origin(log, every)?;
    if let Some(damage) = table::notes(file).ok().and_then(|notes| damage_of(&notes, &origin)) {
        return Ok(Written { path: file.to_path_buf(), damage, ..Written::default() });
    }
    if let Some(folder) = file.parent() {
        fs::create_dir_all(folder).map_err(|source| output::Error { path: folder.to_path_buf(), source })?;
    }
    let notes = |damage: &u64| [&origin[..], &[(DAMAGE.into(), damage.to_string())]].concat();
    write_noted(log, Wanted { every, format: Format::Parquet }, file, progress, notes)
}

/// The note of how many damaged, broken or missing parts of the log a partition lacks.
const DAMAGE: &str = "crossfall.damage";

/// That number, if a partition is of this origin.
fn damage_of(notes: &[Note], origin: &[Note]) -> Option<u64> {
    let (of, damage) = notes.split_at_checked(origin.len())?;
    match damage {
        [(key, damage)] if of == origin && key == DAMAGE => damage.parse().ok(),
        _ => None,
    }
}

/// What a partition is made from and how, as it notes it. A log that grows or is replaced has another size or another time, also an older one.
fn origin(log: &Path, every: Option<Every>) -> Result<Vec<Note>, container::Error> {
    let (mut bytes, mut newest) = (0, UNIX_EPOCH);
    // All files of the drive that are there.
    for file in crate::log::Parts::of(log)?.files {
        let unreadable = |source| container::Error::Io { path: file.clone(), source };
        let found = match fs::metadata(&file) {
            // The reader tells it as damage of the drive.
            Err(missing) if missing.kind() == io::ErrorKind::NotFound => continue,
            found => found.map_err(unreadable)?,
        };
        bytes += found.len();
        newest = newest.max(found.modified().map_err(unreadable)?);
    }
    // A file from before 1970 has no other sign of its time.
    let modified = newest.duration_since(UNIX_EPOCH).unwrap_or_default();
    Ok(vec![
        ("crossfall.version".into(), env!("CARGO_PKG_VERSION").to_owned()),
        ("crossfall.log_bytes".into(), bytes.to_string()),
        ("crossfall.log_modified_ns".into(), modified.as_nanos().to_string()),
        ("crossfall.every_m".into(), every.map_or_else(|| "scan".to_owned(), |every| every.metres.to_string())),
    ])
}

/// A name as the Hive convention writes it into a path.
fn escaped(name: &str) -> String {
    let mut out = String::new();
    for c in name.chars() {
        if c.is_control() || "\"#%'*/:=?\\{}[]^".contains(c) {
            let mut buffer = [0; 4];
            c.encode_utf8(&mut buffer).bytes().for_each(|byte| out += &format!("%{byte:02X}"));
        } else {
            out.push(c);
        }
    }
    // A name of dots would be a folder of the system's.
    if out.chars().all(|c| c == '.') { out.replace('.', "%2E") } else { out }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn partitions_are_paths_that_hive_reads() {
        let partition =
            Partition { road: "I-80 / US=6".to_owned(), date: Some("2026-01-07".to_owned()), drive: "a b".to_owned() };
        let path = partition.file(Path::new("set"));
        assert_eq!(path, Path::new("set/road=I-80 %2F US%3D6/date=2026-01-07/a b.parquet"));
        let nameless = Partition { road: "..".to_owned(), date: None, drive: "a".to_owned() };
        assert_eq!(nameless.file(Path::new("")), Path::new("road=%2E%2E/date=__HIVE_DEFAULT_PARTITION__/a.parquet"));
    }
}
