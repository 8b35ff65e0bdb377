//! Comma-separated text.

use std::io::{self, Write};
use std::marker::PhantomData;

use super::{Error, Kind, Record, Value, rounded};

pub struct Table<W: Write, R> {
    csv: csv::Writer<W>,
    cells: Vec<Value>,
    text: String,
    record: PhantomData<fn(R)>,
}

impl<W: Write, R: Record> Table<W, R> {
    pub fn new(out: W) -> Result<Self, Error> {
        let mut csv = csv::Writer::from_writer(out);
        csv.write_record(R::COLUMNS.iter().map(|(name, _)| name)).map_err(plain)?;
        Ok(Self { csv, cells: Vec::new(), text: String::new(), record: PhantomData })
    }

    pub fn row(&mut self, record: &R) -> Result<(), Error> {
        use std::fmt::Write;
        self.cells.clear();
        record.cells(&mut self.cells);
        for (cell, (_, kind)) in self.cells.iter().zip(R::COLUMNS) {
            self.text.clear();
            // Writing to a string does not fail.
            let _ = match (cell, kind) {
                (Value::Empty, _) => Ok(()),
                (Value::Integer(value), _) => write!(self.text, "{value}"),
                (Value::Real(value), Kind::Real(decimals)) => {
                    write!(self.text, "{:.*}", usize::from(*decimals), rounded(*value, *decimals))
                }
                (Value::Real(value), _) => write!(self.text, "{value}"),
                (Value::Text(text), _) => write!(self.text, "{text}"),
            };
            self.csv.write_field(&self.text).map_err(plain)?;
        }
        self.csv.write_record(None::<&[u8]>).map_err(plain)?;
        Ok(())
    }

    pub fn finish(mut self) -> Result<W, Error> {
        self.csv.flush()?;
        self.csv.into_inner().map_err(|error| Error::Io(error.into_error()))
    }
}

fn plain(error: csv::Error) -> Error {
    Error::Io(match error.into_kind() {
        csv::ErrorKind::Io(error) => error,
        other => io::Error::other(format!("{other:?}")),
    })
}
