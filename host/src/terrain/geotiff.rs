//! GeoTIFFs written tile by tile, deflated, in any order.
//!
//! All tiles that nothing was written to are one and the same in the file, so that ground nobody has seen takes a dozen bytes for 512 x 512 cells and every
//! reader sees "no data" there without knowing of sparse files. A file that may pass 4 GiB is a BigTIFF from the start; the others are
//! what any reader of TIFF 6.0 reads.
//!
//! Source: TIFF 6.0, sections 2 and 15; the BigTIFF design of AWare Systems; OGC 19-008r4 (GeoTIFF 1.1). The encoder of the `tiff` crate writes strips of a
//! whole raster alone.

use std::collections::BTreeMap;
use std::io::{self, Seek, SeekFrom, Write};
use std::path::Path;

use flate2::Compression;
use flate2::write::ZlibEncoder;

use crate::output::{self, Output};

/// What a pixel is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Pixel {
    /// A little-endian float.
    Float,
    /// A byte.
    Byte,
}

impl Pixel {
    fn bits(self) -> u16 {
        match self {
            Self::Float => 32,
            Self::Byte => 8,
        }
    }

    /// TIFF's number for unsigned integers and for floats.
    fn format(self) -> u16 {
        match self {
            Self::Float => 3,
            Self::Byte => 1,
        }
    }
}

/// A raster to be written.
#[derive(Clone, Debug)]
pub struct Layout {
    /// Pixels a row.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// Pixels along a tile's side, a multiple of 16.
    pub tile: u32,
    /// What a pixel is.
    pub pixel: Pixel,
    /// The bytes of a pixel without a value, and the same in words.
    pub no_data: (Vec<u8>, &'static str),
    /// Position of the north-western corner, m.
    pub north_west: [f64; 2],
    /// Side of a pixel, m.
    pub pixel_m: f64,
    /// EPSG code of the coordinates; 32767 (user-defined) where none is known.
    pub epsg: u16,
}

impl Layout {
    /// Tiles a row, and rows of them.
    fn tiles(&self) -> [u64; 2] {
        [self.width, self.height].map(|pixels| u64::from(pixels.div_ceil(self.tile)))
    }
}

/// A file under way.
pub struct GeoTiff {
    out: Output,
    layout: Layout,
    /// Offsets of 8 bytes.
    big: bool,
    at: u64,
    nothing: Place,
    tiles: BTreeMap<u64, Place>,
    packed: Vec<u8>,
}

/// Offset and bytes of a packed tile.
#[derive(Clone, Copy)]
struct Place(u64, u32);

/// TIFF's numbers for types of fields.
type Type = u16;
const ASCII: Type = 2;
const SHORT: Type = 3;
const LONG: Type = 4;
const DOUBLE: Type = 12;
const LONG8: Type = 16;

/// The values of a field, or the offset of those that have been written already.
enum Values {
    Here(Vec<u8>),
    At(u64),
}
use Values::{At, Here};

/// A field of the directory: tag, type, number of values.
type Field = (u16, Type, u64, Values);

impl GeoTiff {
    /// Begins a file of which at most so many tiles will be written.
    ///
    /// # Errors
    /// A file that cannot be written.
    pub fn create(path: &Path, layout: Layout, most: u64) -> Result<Self, output::Error> {
        let bytes = u64::from(layout.tile).pow(2) * u64::from(layout.pixel.bits() / 8);
        let [across, down] = layout.tiles();
        // Deflate makes nothing larger by more than a thousandth; the lists take eight bytes a tile.
        let largest = most.saturating_mul(bytes + bytes / 1000 + 64).saturating_add(across * down * 8 + (1 << 20));
        let out = Output::create(path)?;
        let big = largest > u64::from(u32::MAX);
        let mut file =
            Self { out, layout, big, at: 0, nothing: Place(0, 0), tiles: BTreeMap::new(), packed: Vec::new() };
        file.begin().map_err(|source| output::Error { path: path.to_path_buf(), source })?;
        Ok(file)
    }

    fn begin(&mut self) -> io::Result<()> {
        // The directory's offset is entered at the end.
        let header: &[u8] = if self.big { b"II\x2b\0\x08\0\0\0\0\0\0\0\0\0\0\0" } else { b"II\x2a\0\0\0\0\0" };
        self.append(header)?;
        let pixels = (self.layout.tile as usize).pow(2);
        let nothing = self.layout.no_data.0.repeat(pixels);
        self.nothing = self.pack(&nothing)?;
        Ok(())
    }

    /// Writes the tile of a column from the west and a row from the north: its pixels row by row from the north.
    ///
    /// # Errors
    /// A file that cannot be written, or pixels that are none or too many.
    pub fn put(&mut self, [right, down]: [u32; 2], pixels: &[u8]) -> Result<(), output::Error> {
        let number = u64::from(down) * self.layout.tiles()[0] + u64::from(right);
        let place = self.pack(pixels).map_err(|source| self.wrap(source))?;
        self.tiles.insert(number, place);
        Ok(())
    }

    /// Writes the directory, and gives the file its name.
    ///
    /// # Errors
    /// A file that cannot be written.
    pub fn finish(mut self) -> Result<(), output::Error> {
        self.close().map_err(|source| self.wrap(source))?;
        self.out.commit()
    }

    fn wrap(&self, source: io::Error) -> output::Error {
        output::Error { path: self.out.path().to_path_buf(), source }
    }

    fn append(&mut self, bytes: &[u8]) -> io::Result<()> {
        self.out.write_all(bytes)?;
        self.at += bytes.len() as u64;
        Ok(())
    }

    /// Offsets are even.
    fn align(&mut self) -> io::Result<u64> {
        if self.at % 2 == 1 {
            self.append(&[0])?;
        }
        Ok(self.at)
    }

    fn pack(&mut self, pixels: &[u8]) -> io::Result<Place> {
        let mut packed = std::mem::take(&mut self.packed);
        packed.clear();
        // The fastest level: floats of measured ground pack hardly better with the others, which take five times as long.
        let mut encoder = ZlibEncoder::new(packed, Compression::fast());
        encoder.write_all(pixels)?;
        let packed = encoder.finish()?;
        let at = self.align()?;
        self.append(&packed)?;
        let bytes = packed.len() as u32;
        self.packed = packed;
        Ok(Place(at, bytes))
    }

    fn close(&mut self) -> io::Result<()> {
        let Layout { width, height, tile, pixel, pixel_m, epsg, .. } = self.layout;
        let [west, north] = self.layout.north_west;
        let [across, down] = self.layout.tiles();
        let count = across * down;
        let short = |tag, value: u16| (tag, SHORT, 1, Here(value.to_le_bytes().to_vec()));
        let long = |tag, value: u32| (tag, LONG, 1, Here(value.to_le_bytes().to_vec()));
        let doubles = |tag, values: &[f64]| {
            let bytes = values.iter().flat_map(|value| value.to_le_bytes()).collect();
            (tag, DOUBLE, values.len() as u64, Here(bytes))
        };
        let (offset, bytes) = if self.big { (LONG8, 8) } else { (LONG, 4) };
        let offsets = self.list(count, bytes, |place| place.0)?;
        let sizes = self.list(count, 4, |place| u64::from(place.1))?;
        // GeoTIFF 1.1: scale, one tie point (raster 0,0 to the upper left corner), and the key directory: a projected
        // model, pixels are areas, the system's EPSG code or a user-defined one (32767), metres.
        let keys: [u16; 20] = [1, 1, 1, 4, 1024, 0, 1, 1, 1025, 0, 1, 1, 3072, 0, 1, epsg, 3076, 0, 1, 9001];
        let words = format!("{}\0", self.layout.no_data.1).into_bytes();
        let fields: [Field; 16] = [
            long(256, width),
            long(257, height),
            short(258, pixel.bits()),
            // Deflate in zlib's frame.
            short(259, 8),
            // Black is zero.
            short(262, 1),
            short(277, 1),
            short(284, 1),
            long(322, tile),
            long(323, tile),
            (324, offset, count, offsets),
            (325, LONG, count, sizes),
            short(339, pixel.format()),
            doubles(33_550, &[pixel_m, pixel_m, 0.0]),
            doubles(33_922, &[0.0, 0.0, 0.0, west, north, 0.0]),
            (34_735, SHORT, keys.len() as u64, Here(keys.iter().flat_map(|key| key.to_le_bytes()).collect())),
            // GDAL's tag of the value that stands for none.
            (42_113, ASCII, words.len() as u64, Here(words)),
        ];
        let word = if self.big { 8 } else { 4 };
        let mut directory = Vec::new();
        let number = |value: u64, bytes: usize| value.to_le_bytes().into_iter().take(bytes);
        directory.extend(number(fields.len() as u64, if self.big { 8 } else { 2 }));
        for (tag, kind, count, values) in fields {
            let mut value = match values {
                Here(values) if values.len() > word => {
                    let at = self.align()?;
                    self.append(&values)?;
                    number(at, word).collect()
                }
                Here(values) => values,
                At(at) => number(at, word).collect(),
            };
            value.resize(word, 0);
            directory.extend(number(u64::from(tag), 2).chain(number(u64::from(kind), 2)));
            directory.extend(number(count, word));
            directory.extend(value);
        }
        // No other directory follows.
        directory.extend(number(0, word));
        let at = self.align()?;
        self.append(&directory)?;
        self.out.seek(SeekFrom::Start(word as u64))?;
        self.out.write_all(&number(at, word).collect::<Vec<u8>>())
    }

    /// Writes one number of every tile, each of so many bytes; their offset, or the number itself where there is but one tile.
    fn list(&mut self, count: u64, bytes: usize, of: impl Fn(&Place) -> u64) -> io::Result<Values> {
        let number = |value: u64| value.to_le_bytes().into_iter().take(bytes).collect::<Vec<u8>>();
        let tiles = std::mem::take(&mut self.tiles);
        let at = self.align()?;
        if count > 1 {
            for tile in 0..count {
                self.append(&number(of(tiles.get(&tile).unwrap_or(&self.nothing))))?;
            }
        }
        let only = number(of(tiles.get(&0).unwrap_or(&self.nothing)));
        self.tiles = tiles;
        Ok(if count > 1 { At(at) } else { Here(only) })
    }
}
