//! GeoJSON (RFC 7946): every record's shapes with its cells as attributes, and lines along the drive.
//!
//! A line is written in pieces of [`PIECE`] vertices that share their ends, so that memory does not grow with the drive.

use std::collections::BTreeMap;
use std::io::Write;
use std::marker::PhantomData;

use serde_json::{Map, Value as Json, json};

use super::{Error, Kind, Record, Shape, Value, rounded};
use crate::geodesy::{Geodetic, between};

/// Vertices of a piece of a line.
const PIECE: usize = 200;

/// A line is broken where two of its vertices are further apart than this, in metres.
const GAP_M: f64 = 50.0;

pub struct Table<W: Write, R> {
    out: W,
    first: bool,
    cells: Vec<Value>,
    lines: BTreeMap<&'static str, Vec<Geodetic>>,
    record: PhantomData<fn(R)>,
}

impl<W: Write, R: Record> Table<W, R> {
    pub fn new(mut out: W) -> Result<Self, Error> {
        out.write_all(b"{\"type\":\"FeatureCollection\",\"features\":[")?;
        Ok(Self { out, first: true, cells: Vec::new(), lines: BTreeMap::new(), record: PhantomData })
    }

    pub fn row(&mut self, record: &R) -> Result<(), Error> {
        let shapes = record.shapes();
        if !shapes.is_empty() {
            self.cells.clear();
            record.cells(&mut self.cells);
            let mut properties = Map::new();
            for ((name, kind), cell) in R::COLUMNS.iter().zip(self.cells.drain(..)) {
                let value = match (cell, kind) {
                    (Value::Empty, _) => Json::Null,
                    (Value::Integer(value), _) => value.into(),
                    (Value::Real(value), Kind::Real(decimals)) => rounded(value, *decimals).into(),
                    (Value::Real(value), _) => value.into(),
                    (Value::Text(text), _) => text.into(),
                };
                properties.insert((*name).to_owned(), value);
            }
            for (what, shape) in shapes {
                properties.insert("what".to_owned(), what.into());
                let geometry = match shape {
                    Shape::Point(place) => json!({"type": "Point", "coordinates": raised(place)}),
                    Shape::Polygon(outline) => json!({"type": "Polygon", "coordinates": [ring(outline)]}),
                };
                self.feature(&geometry, &Json::Object(properties.clone()))?;
            }
        }
        if let Some((name, place)) = record.vertex() {
            let line = self.lines.entry(name).or_default();
            let apart = line.last().map(|&last| between(last, place)).map_or(0.0, |[east, north]| east.hypot(north));
            if apart > GAP_M {
                let piece = std::mem::replace(line, vec![place]);
                self.line(name, &piece)?;
            } else {
                line.push(place);
                if line.len() == PIECE {
                    let piece = std::mem::replace(line, vec![place]);
                    self.line(name, &piece)?;
                }
            }
        }
        Ok(())
    }

    fn line(&mut self, name: &str, piece: &[Geodetic]) -> Result<(), Error> {
        if piece.len() < 2 {
            return Ok(());
        }
        let places: Vec<_> = piece.iter().copied().map(place_of).collect();
        self.feature(&json!({"type": "LineString", "coordinates": places}), &json!({"what": name}))
    }

    fn feature(&mut self, geometry: &Json, properties: &Json) -> Result<(), Error> {
        self.out.write_all(if self.first { b"\n" } else { b",\n" })?;
        self.first = false;
        let feature = json!({"type": "Feature", "geometry": geometry, "properties": properties});
        serde_json::to_writer(&mut self.out, &feature).map_err(std::io::Error::from)?;
        Ok(())
    }

    pub fn finish(mut self) -> Result<W, Error> {
        for (name, piece) in std::mem::take(&mut self.lines) {
            self.line(name, &piece)?;
        }
        self.out.write_all(b"\n]}\n")?;
        self.out.flush()?;
        Ok(self.out)
    }
}

/// Longitude first, as the format has it, to a tenth of a millimetre.
fn place_of([latitude, longitude, _]: Geodetic) -> [f64; 2] {
    [rounded(longitude, 9), rounded(latitude, 9)]
}

fn raised([latitude, longitude, height]: Geodetic) -> [f64; 3] {
    [rounded(longitude, 9), rounded(latitude, 9), rounded(height, 3)]
}

/// A closed ring, counter-clockwise as section 3.1.6 asks of an outer one.
fn ring(mut outline: Vec<Geodetic>) -> Vec<[f64; 2]> {
    let next = outline.iter().cycle().skip(1);
    let area: f64 = outline.iter().zip(next).map(|(a, b)| (b[1] - a[1]) * (b[0] + a[0])).sum();
    if area > 0.0 {
        outline.reverse();
    }
    let mut ring: Vec<_> = outline.into_iter().map(place_of).collect();
    ring.extend(ring.first().copied());
    ring
}
