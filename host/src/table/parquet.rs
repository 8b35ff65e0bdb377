//! Apache Parquet: every column optional, compressed with zstd, in row groups of 65,536 rows.
//!
//! Numbers are rounded to their column's decimals before they are written, which the compression rewards. The columns stand in a plain schema:
//! whole numbers as INT64, others as DOUBLE, text as UTF-8 with a dictionary. Notes are the file's key-value metadata.

use std::fs::File;
use std::io::Write;
use std::marker::PhantomData;
use std::path::Path;
use std::sync::Arc;

use parquet::basic::{Compression, ConvertedType, Repetition, Type as Physical, ZstdLevel};
use parquet::data_type::{ByteArray, ByteArrayType, DoubleType, Int64Type};
use parquet::file::metadata::KeyValue;
use parquet::file::properties::WriterProperties;
use parquet::file::reader::{FileReader, SerializedFileReader};
use parquet::file::writer::SerializedFileWriter;
use parquet::schema::types::{ColumnPath, Type};

use super::{Error, Kind, Note, Record, Value, rounded};

/// Rows of a group: what is held in memory.
const GROUP: usize = 65_536;

pub struct Table<W: Write + Send, R> {
    file: SerializedFileWriter<W>,
    columns: Vec<Cells>,
    rows: usize,
    cells: Vec<Value>,
    record: PhantomData<fn(R)>,
}

/// The cells of one column that wait to be written. Levels are 1 where there is a value.
#[derive(Default)]
struct Cells {
    levels: Vec<i16>,
    integers: Vec<i64>,
    reals: Vec<f64>,
    texts: Vec<ByteArray>,
}

impl<W: Write + Send, R: Record> Table<W, R> {
    pub fn new(out: W) -> Result<Self, Error> {
        let mut fields = Vec::new();
        let mut properties = WriterProperties::builder()
            .set_compression(Compression::ZSTD(ZstdLevel::try_new(1)?))
            .set_dictionary_enabled(false)
            .set_created_by(concat!("crossfall ", env!("CARGO_PKG_VERSION")).to_owned());
        for (name, kind) in R::COLUMNS {
            let (physical, converted) = match kind {
                Kind::Integer => (Physical::INT64, ConvertedType::NONE),
                Kind::Real(_) => (Physical::DOUBLE, ConvertedType::NONE),
                Kind::Text => (Physical::BYTE_ARRAY, ConvertedType::UTF8),
            };
            let field = Type::primitive_type_builder(name, physical)
                .with_converted_type(converted)
                .with_repetition(Repetition::OPTIONAL)
                .build()?;
            fields.push(Arc::new(field));
            if *kind == Kind::Text {
                properties = properties.set_column_dictionary_enabled(ColumnPath::from(*name), true);
            }
        }
        let schema = Type::group_type_builder("crossfall").with_fields(fields).build()?;
        let file = SerializedFileWriter::new(out, Arc::new(schema), Arc::new(properties.build()))?;
        let columns = R::COLUMNS.iter().map(|_| Cells::default()).collect();
        Ok(Self { file, columns, rows: 0, cells: Vec::new(), record: PhantomData })
    }

    pub fn row(&mut self, record: &R) -> Result<(), Error> {
        self.cells.clear();
        record.cells(&mut self.cells);
        for ((cell, (_, kind)), into) in self.cells.drain(..).zip(R::COLUMNS).zip(&mut self.columns) {
            into.levels.push(i16::from(cell != Value::Empty));
            match (cell, kind) {
                (Value::Integer(value), _) => into.integers.push(value),
                (Value::Real(value), Kind::Real(decimals)) => into.reals.push(rounded(value, *decimals)),
                (Value::Real(value), _) => into.reals.push(value),
                (Value::Text(text), _) => into.texts.push(ByteArray::from(text.as_bytes().to_vec())),
                (Value::Empty, _) => {}
            }
        }
        self.rows += 1;
        if self.rows == GROUP { self.flush() } else { Ok(()) }
    }

    fn flush(&mut self) -> Result<(), Error> {
        let mut group = self.file.next_row_group()?;
        for (cells, (_, kind)) in self.columns.iter_mut().zip(R::COLUMNS) {
            let Some(mut column) = group.next_column()? else { break };
            let levels = Some(cells.levels.as_slice());
            match kind {
                Kind::Integer => column.typed::<Int64Type>().write_batch(&cells.integers, levels, None)?,
                Kind::Real(_) => column.typed::<DoubleType>().write_batch(&cells.reals, levels, None)?,
                Kind::Text => column.typed::<ByteArrayType>().write_batch(&cells.texts, levels, None)?,
            };
            column.close()?;
            cells.levels.clear();
            cells.integers.clear();
            cells.reals.clear();
            cells.texts.clear();
        }
        group.close()?;
        self.rows = 0;
        Ok(())
    }

    pub fn finish(mut self, notes: &[Note]) -> Result<W, Error> {
        if self.rows > 0 {
            self.flush()?;
        }
        for (key, value) in notes {
            self.file.append_key_value_metadata(KeyValue::new(key.to_string(), value.clone()));
        }
        Ok(self.file.into_inner()?)
    }
}

/// The notes of a file, in the order in which they were written.
///
/// # Errors
/// When there is no such file, or it is none of this format.
pub fn notes(path: &Path) -> Result<Vec<Note>, Error> {
    let reader = SerializedFileReader::new(File::open(path)?)?;
    let pairs = reader.metadata().file_metadata().key_value_metadata().map_or(&[][..], Vec::as_slice);
    Ok(pairs.iter().map(|pair| (pair.key.clone().into(), pair.value.clone().unwrap_or_default())).collect())
}
