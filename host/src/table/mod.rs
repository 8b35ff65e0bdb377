//! Tables for other programs: the same records as CSV, Parquet or GeoJSON, told by the file's name.
//!
//! Records stream: what is held back is one row group of Parquet (65,536 rows) or one line of GeoJSON (200 vertices), whatever the length of the
//! drive. A number has the same decimals in every format, so that a value can be looked up from one file in another.

mod comma;
mod geojson;
mod parquet;

use std::borrow::Cow;
use std::io::{self, Write};
use std::path::Path;

use crate::geodesy::Geodetic;

/// A table could not be written.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// The file cannot be written.
    #[error(transparent)]
    Io(#[from] io::Error),
    /// The Parquet library refuses.
    #[error("Parquet: {0}")]
    Parquet(#[from] ::parquet::errors::ParquetError),
}

impl Error {
    /// The error of the file below, where there is one: a closed pipe must be known as one.
    #[must_use]
    pub fn into_io(self) -> io::Error {
        match self {
            Self::Io(error) => error,
            Self::Parquet(::parquet::errors::ParquetError::External(error)) => match error.downcast::<io::Error>() {
                Ok(error) => *error,
                Err(error) => io::Error::other(error),
            },
            Self::Parquet(error) => io::Error::other(error.to_string()),
        }
    }
}

/// What a column holds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// Whole numbers.
    Integer,
    /// Numbers with so many decimals.
    Real(u8),
    /// Text.
    Text,
}

/// A column: its name, the unit within, and what it holds.
pub type Column = (&'static str, Kind);

/// A cell.
#[derive(Clone, Debug, PartialEq)]
pub enum Value {
    /// Not found, or not known.
    Empty,
    /// A whole number.
    Integer(i64),
    /// A number.
    Real(f64),
    /// Text.
    Text(Cow<'static, str>),
}

impl From<Option<f64>> for Value {
    fn from(value: Option<f64>) -> Self {
        value.filter(|value| value.is_finite()).map_or(Self::Empty, Self::Real)
    }
}

impl From<Option<i64>> for Value {
    fn from(value: Option<i64>) -> Self {
        value.map_or(Self::Empty, Self::Integer)
    }
}

/// Something that a table says of itself beside its rows: a name and a value.
pub type Note = (Cow<'static, str>, String);

/// Rounds to some decimals. What every format writes, text too: text alone would round a number that lies a hair from halfway the other way
/// now and then. Zero has no sign.
#[must_use]
pub fn rounded(value: f64, decimals: u8) -> f64 {
    let scale = 10_f64.powi(i32::from(decimals));
    (value * scale).round() / scale + 0.0
}

/// Something with a place on the map.
#[derive(Clone, Debug, PartialEq)]
pub enum Shape {
    /// A point, with its height.
    Point(Geodetic),
    /// A closed outline of places; the last is joined to the first. Their heights are not written.
    Polygon(Vec<Geodetic>),
}

/// A row of a table.
pub trait Record {
    /// The columns, in order.
    const COLUMNS: &'static [Column];

    /// Appends the cells, in the order of the columns.
    fn cells(&self, into: &mut Vec<Value>);

    /// What a map shows of the record: each shape with a word for what it is.
    fn shapes(&self) -> Vec<(&'static str, Shape)>;

    /// The next vertex of the line that a map shows along the drive, one line for each name.
    fn vertex(&self) -> Option<(&'static str, Geodetic)>;
}

/// The formats.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Format {
    /// Comma-separated text (RFC 4180) with a header.
    Csv,
    /// Apache Parquet, zstd.
    Parquet,
    /// GeoJSON (RFC 7946).
    GeoJson,
}

impl Format {
    /// The format that a file's name asks for; a name without an extension says nothing else than CSV.
    #[must_use]
    pub fn of(path: &Path) -> Option<Self> {
        let Some(extension) = path.extension() else { return Some(Self::Csv) };
        match extension.to_ascii_lowercase().to_str()? {
            "csv" => Some(Self::Csv),
            "parquet" | "pq" => Some(Self::Parquet),
            "geojson" | "json" => Some(Self::GeoJson),
            _ => None,
        }
    }
}

pub use self::parquet::notes;

/// A table under way.
pub struct Table<W: Write + Send, R: Record>(Writer<W, R>);

#[expect(clippy::large_enum_variant, reason = "one a file")]
enum Writer<W: Write + Send, R: Record> {
    Csv(comma::Table<W, R>),
    Parquet(Box<parquet::Table<W, R>>),
    GeoJson(geojson::Table<W, R>),
}

impl<W: Write + Send, R: Record> Table<W, R> {
    /// Starts a table.
    ///
    /// # Errors
    /// When its beginning cannot be written.
    pub fn new(format: Format, out: W) -> Result<Self, Error> {
        Ok(Self(match format {
            Format::Csv => Writer::Csv(comma::Table::new(out)?),
            Format::Parquet => Writer::Parquet(Box::new(parquet::Table::new(out)?)),
            Format::GeoJson => Writer::GeoJson(geojson::Table::new(out)?),
        }))
    }

    /// Appends a record.
    ///
    /// # Errors
    /// When it cannot be written.
    pub fn row(&mut self, record: &R) -> Result<(), Error> {
        match &mut self.0 {
            Writer::Csv(table) => table.row(record),
            Writer::Parquet(table) => table.row(record),
            Writer::GeoJson(table) => table.row(record),
        }
    }

    /// Ends the table and gives back what it was written to.
    ///
    /// # Errors
    /// When its end cannot be written.
    pub fn finish(self) -> Result<W, Error> {
        self.finish_with(&[])
    }

    /// The same with notes, where the format has a place for them: Parquet.
    ///
    /// # Errors
    /// When its end cannot be written.
    pub fn finish_with(self, notes: &[Note]) -> Result<W, Error> {
        match self.0 {
            Writer::Csv(table) => table.finish(),
            Writer::Parquet(table) => table.finish(notes),
            Writer::GeoJson(table) => table.finish(),
        }
    }
}

#[cfg(test)]
mod tests;
