//! PCD frames: version 0.7 and those before it, data as `ascii`, `binary` or `binary_compressed`.
//!
//! A header of text lines names the fields and their sizes; x, y and z must be among them, and intensity is used if it is.
//! Other fields are passed over. Binary data lies point by point, compressed data field by field behind one LZF block. Points
//! that are not a number, as organised clouds have, are passed on: the map counts them. The viewpoint is not used: poses come from their
//! own file, as for every other format.
//!
//! No library reads all three forms and is kept; the format is a page long.

use std::fs::File;
use std::io::Read;
use std::path::Path;

use super::frames::{Error, MOST_POINTS};

/// Where and how a field lies in a point.
#[derive(Clone, Copy, Debug)]
struct Field {
    offset: usize,
    size: usize,
    kind: u8,
    count: usize,
    /// Words of text before it.
    words: usize,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Data {
    Ascii,
    Binary,
    Compressed,
}

struct Header {
    /// x, y, z.
    place: [Field; 3],
    intensity: Option<Field>,
    /// Bytes and words of a point.
    bytes: usize,
    words: usize,
    points: usize,
    data: Data,
    /// Bytes of the header.
    length: usize,
}

/// Longest header that is looked for.
const LONGEST_HEADER: usize = 64 << 10;

/// Reads a frame.
///
/// # Errors
/// A header that says something else than PCD's, or data that is shorter than it says.
pub(super) fn read(path: &Path, data: &[u8], put: &mut impl FnMut([f64; 3], f32)) -> Result<(), Error> {
    let header = header(path, data)?;
    let rest = data.get(header.length..).unwrap_or_default();
    let wrong = |offset: usize, what: String| Error::Format { path: path.into(), offset: offset as u64, what };
    let total = header.points * header.bytes;
    match header.data {
        Data::Ascii => ascii(path, &header, rest, put),
        Data::Binary if rest.len() < total => {
            Err(wrong(data.len(), format!("the file ends after {} of {total} bytes of points", rest.len())))
        }
        Data::Binary => {
            for index in 0..header.points {
                let at = |field: &Field| number(rest, index * header.bytes + field.offset, field);
                put(header.place.each_ref().map(at), header.intensity.as_ref().map_or(0.0, |field| at(field) as f32));
            }
            Ok(())
        }
        Data::Compressed => {
            let size = |at: usize| {
                let bytes = rest.get(at..at + 4)?;
                Some(u32::from_le_bytes([bytes[0], bytes[1], bytes[2], bytes[3]]) as usize)
            };
            let (Some(packed), Some(unpacked)) = (size(0), size(4)) else {
                return Err(wrong(data.len(), "the file ends before the sizes of the compressed data".into()));
            };
            if unpacked != total {
                return Err(wrong(header.length + 4, format!("{unpacked} bytes unpacked, the header tells {total}")));
            }
            // Three bytes give 264 at most.
            if unpacked as u64 > (packed as u64 * 88).min(MOST_POINTS * 64) {
                let what = format!("{packed} compressed bytes cannot be {unpacked}, or no frame has as many");
                return Err(wrong(header.length, what));
            }
            let Some(block) = rest.get(8..8 + packed) else {
                let found = rest.len().saturating_sub(8);
                return Err(wrong(data.len(), format!("the file ends after {found} of {packed} compressed bytes")));
            };
            let planes = unpack(block, unpacked)
                .map_err(|at| wrong(header.length + 8 + at, "the compressed data is damaged".into()))?;
            for index in 0..header.points {
                // A field's values of all points lie together.
                let at = |field: &Field| {
                    number(&planes, field.offset * header.points + index * field.size * field.count, field)
                };
                put(header.place.each_ref().map(at), header.intensity.as_ref().map_or(0.0, |field| at(field) as f32));
            }
            Ok(())
        }
    }
}

/// Number of points that a file's header tells.
pub(super) fn count(path: &Path) -> Result<u64, Error> {
    let mut start = Vec::new();
    let file = File::open(path).and_then(|file| file.take(LONGEST_HEADER as u64).read_to_end(&mut start));
    file.map_err(|source| Error::Read { path: path.into(), source })?;
    // What is wrong is told when the frame is read.
    Ok(header(path, &start).map_or(0, |header| header.points as u64))
}

fn header(path: &Path, data: &[u8]) -> Result<Header, Error> {
    let wrong = |offset: usize, what: String| Error::Format { path: path.into(), offset: offset as u64, what };
    let (mut names, mut sizes, mut kinds, mut counts) = (Vec::new(), Vec::new(), Vec::new(), Vec::new());
    let (mut width, mut height, mut points) = (None, None, None);
    let mut at = 0;
    let form = loop {
        let rest = data.get(at..data.len().min(LONGEST_HEADER)).unwrap_or_default();
        let Some(end) = rest.iter().position(|byte| *byte == b'\n') else {
            return Err(wrong(at, "no line DATA: expected a PCD header".into()));
        };
        let here = at;
        at += end + 1;
        let Ok(line) = std::str::from_utf8(&rest[..end]) else {
            return Err(wrong(here, "a line that is no text: expected a PCD header".into()));
        };
        let mut words = line.split_whitespace();
        let Some(key) = words.next().filter(|key| !key.starts_with('#')) else { continue };
        let whole =
            |word: &str| word.parse::<usize>().map_err(|_| wrong(here, format!("{key}: '{word}' is no whole number")));
        match key {
            "VERSION" | "VIEWPOINT" => {}
            "FIELDS" | "COLUMNS" => names = words.map(str::to_owned).collect(),
            "SIZE" => sizes = words.map(whole).collect::<Result<_, _>>()?,
            "TYPE" => kinds = words.map(|word| word.as_bytes()[0]).collect(),
            "COUNT" => counts = words.map(whole).collect::<Result<_, _>>()?,
            "WIDTH" | "HEIGHT" | "POINTS" => {
                let value = whole(words.next().unwrap_or(""))?;
                *(if key == "WIDTH" {
                    &mut width
                } else if key == "HEIGHT" {
                    &mut height
                } else {
                    &mut points
                }) = Some(value);
            }
            "DATA" => match words.next() {
                Some("ascii") => break Data::Ascii,
                Some("binary") => break Data::Binary,
                Some("binary_compressed") => break Data::Compressed,
                other => {
                    let what = other.unwrap_or("");
                    return Err(wrong(here, format!("DATA '{what}': expected ascii, binary or binary_compressed")));
                }
            },
            _ => return Err(wrong(here, format!("'{key}' is no key of a PCD header"))),
        }
    };
    if counts.is_empty() {
        counts = vec![1; names.len()];
    }
    if sizes.len() != names.len() || kinds.len() != names.len() || counts.len() != names.len() {
        return Err(wrong(0, "FIELDS, SIZE, TYPE and COUNT do not have equally many entries".into()));
    }
    let (mut place, mut intensity) = ([None; 3], None);
    let (mut bytes, mut words) = (0usize, 0usize);
    for ((name, (size, kind)), count) in names.iter().zip(sizes.into_iter().zip(kinds)).zip(counts) {
        let known = matches!((kind, size), (b'F', 4 | 8) | (b'I' | b'U', 1 | 2 | 4 | 8));
        if !known || !(1..=4096).contains(&count) {
            return Err(wrong(0, format!("field {name}: {count} values of {size} bytes of type {}", char::from(kind))));
        }
        let field = Field { offset: bytes, size, kind, count, words };
        match name.as_str() {
            "x" => place[0] = Some(field),
            "y" => place[1] = Some(field),
            "z" => place[2] = Some(field),
            "intensity" | "i" => intensity = Some(field),
            _ => {}
        }
        bytes += size * count;
        words += count;
    }
    let [Some(x), Some(y), Some(z)] = place else {
        return Err(wrong(0, "the fields x, y and z are not all there".into()));
    };
    let points = points.or_else(|| width?.checked_mul(height.unwrap_or(1)));
    let Some(points) = points.filter(|points| *points as u64 <= MOST_POINTS) else {
        return Err(wrong(0, format!("POINTS must be there, at most {MOST_POINTS}")));
    };
    Ok(Header { place: [x, y, z], intensity, bytes, words, points, data: form, length: at })
}

/// A field's first value; the caller has checked that the data is long enough.
fn number(data: &[u8], at: usize, field: &Field) -> f64 {
    let mut raw = [0u8; 8];
    let Some(bytes) = data.get(at..at + field.size) else { return f64::NAN };
    raw[..field.size].copy_from_slice(bytes);
    let bits = u64::from_le_bytes(raw);
    // Sign extension for integers of fewer than eight bytes.
    let unused = 64 - 8 * field.size as u32;
    match field.kind {
        b'F' if field.size == 4 => f64::from(f32::from_bits(bits as u32)),
        b'F' => f64::from_bits(bits),
        b'I' => ((bits << unused) as i64 >> unused) as f64,
        _ => bits as f64,
    }
}

fn ascii(path: &Path, header: &Header, rest: &[u8], put: &mut impl FnMut([f64; 3], f32)) -> Result<(), Error> {
    let mut at = 0;
    let mut found = 0;
    for line in rest.split(|byte| *byte == b'\n') {
        let wrong = |what: String| Error::Format { path: path.into(), offset: (header.length + at) as u64, what };
        let text = std::str::from_utf8(line).map_err(|_| wrong("a line that is no text".into()))?;
        if !text.trim().is_empty() && found < header.points {
            let words: Vec<&str> = text.split_whitespace().collect();
            if words.len() != header.words {
                return Err(wrong(format!("{} numbers, expected {}", words.len(), header.words)));
            }
            let value = |field: &Field| {
                let word = words[field.words];
                word.parse::<f64>().map_err(|_| wrong(format!("'{word}' is no number")))
            };
            let [x, y, z] = &header.place;
            let intensity = header.intensity.as_ref().map_or(Ok(0.0), value)?;
            put([value(x)?, value(y)?, value(z)?], intensity as f32);
            found += 1;
        }
        at += line.len() + 1;
    }
    if found < header.points {
        let offset = (header.length + rest.len()) as u64;
        let what = format!("the file ends after {found} of {} points", header.points);
        return Err(Error::Format { path: path.into(), offset, what });
    }
    Ok(())
}

/// LZF: a control byte below 32 announces one more literals than it says; any other copies what lies behind, its high three bits the
/// length less two (7: a further byte adds to it), the rest and the next byte the distance less one.
fn unpack(packed: &[u8], size: usize) -> Result<Vec<u8>, usize> {
    let mut out = Vec::with_capacity(size);
    let mut at = 0;
    while let Some(&control) = packed.get(at) {
        let begin = at;
        at += 1;
        if control < 32 {
            let count = usize::from(control) + 1;
            out.extend_from_slice(packed.get(at..at + count).ok_or(begin)?);
            at += count;
        } else {
            let mut next = || {
                let byte = packed.get(at).copied().ok_or(begin);
                at += 1;
                byte
            };
            let mut count = usize::from(control >> 5) + 2;
            if count == 9 {
                count += usize::from(next()?);
            }
            let distance = (usize::from(control & 31) << 8 | usize::from(next()?)) + 1;
            let from = out.len().checked_sub(distance).ok_or(begin)?;
            // What is copied may be what the copy itself has just written.
            for index in 0..count {
                out.push(out[from + index]);
            }
        }
        if out.len() > size {
            return Err(begin);
        }
    }
    if out.len() == size { Ok(out) } else { Err(packed.len()) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lzf_unpacks_literals_and_copies_that_overlap() {
        assert_eq!(unpack(&[2, 1, 2, 3], 3), Ok(vec![1, 2, 3]));
        // "ab", then 9 + 3 bytes from two back.
        assert_eq!(unpack(&[1, b'a', b'b', 0xE0, 3, 1], 14), Ok(b"ababababababab".to_vec()));
        assert_eq!(unpack(&[1, b'a', b'b', 0x20, 9], 5), Err(3));
        assert_eq!(unpack(&[31, 0], 32), Err(0));
        assert_eq!(unpack(&[0, 7], 2), Err(2));
        assert_eq!(unpack(&[0, 7, 0xE0, 255, 0], 8), Err(2));
    }
}
