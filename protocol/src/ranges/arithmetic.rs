//! A range coder (Martin, 1979) over 32 bits: carries run back into the bytes already written.
//!
//! A symbol is the part [start, start + size) of 4,096. A code is the shortest byte string whose number lies in the
//! last interval, zeros at its end left off; the reader supplies them. So every sequence of symbols has one code, and
//! the reader can tell in the end whether what it has read is that one.

use super::MAX_CODE;

/// Parts that a symbol's share is counted in.
pub const WHOLE_BITS: u32 = 12;

/// Below this the interval is widened by a byte.
const NARROW: u32 = 1 << 24;

/// Writes a code.
pub struct Writer<'a> {
    low: u32,
    range: u32,
    out: &'a mut [u8],
    /// Bytes written; beyond the end of `out` they are only counted.
    len: usize,
}

impl<'a> Writer<'a> {
    pub fn new(out: &'a mut [u8]) -> Self {
        Self { low: 0, range: u32::MAX, out, len: 0 }
    }

    pub fn symbol(&mut self, start: u32, size: u32) {
        let part = self.range >> WHOLE_BITS;
        self.add(part.wrapping_mul(start));
        self.range = part.wrapping_mul(size);
        self.widen();
    }

    /// `count` bits, at most 16, all values alike.
    pub fn bits(&mut self, value: u32, count: u32) {
        self.range >>= count;
        self.add(self.range.wrapping_mul(value));
        self.widen();
    }

    fn add(&mut self, amount: u32) {
        let (low, carry) = self.low.overflowing_add(amount);
        self.low = low;
        if carry {
            self.carry();
        }
    }

    #[cold]
    fn carry(&mut self) {
        // There is always a byte to take it: the whole code is below 1.
        for byte in self.out.iter_mut().take(self.len).rev() {
            *byte = byte.wrapping_add(1);
            if *byte != 0 {
                break;
            }
        }
    }

    fn widen(&mut self) {
        while self.range < NARROW {
            self.push();
            self.range <<= 8;
        }
    }

    fn push(&mut self) {
        if let Some(place) = self.out.get_mut(self.len) {
            *place = (self.low >> 24) as u8;
        }
        self.len += 1;
        self.low <<= 8;
    }

    /// Whether more has been written than there is room for.
    pub fn is_full(&self) -> bool {
        self.len > self.out.len()
    }

    /// The length of the code; `None` when it had no room.
    pub fn finish(mut self) -> Option<usize> {
        // The interval is at least NARROW wide: it holds a number whose low three bytes are 0.
        self.add(NARROW - 1);
        self.push();
        let code = self.out.get(..self.len)?;
        Some(code.iter().rposition(|&byte| byte != 0).map_or(0, |last| last + 1))
    }
}

/// A code as a reader wants it, with zeros after its end: four bytes can be taken anywhere without a second look.
pub struct Padded {
    bytes: [u8; PLACES + 4],
    len: usize,
    ends_in_zero: bool,
}

/// Places of a padded code that may be read; a power of two beyond the longest code and what is supplied after it.
const PLACES: usize = (MAX_CODE + 8).next_power_of_two();

impl Padded {
    /// Of a code of at most [`MAX_CODE`] bytes; what is beyond is left off.
    pub fn new(code: &[u8]) -> Self {
        let mut bytes = [0; PLACES + 4];
        for (place, &byte) in bytes.iter_mut().zip(code.iter().take(MAX_CODE)) {
            *place = byte;
        }
        Self { bytes, len: code.len(), ends_in_zero: code.last() == Some(&0) }
    }

    /// Four bytes, the first on top. Places count round: who has come so far reads what no writer has made.
    #[inline(always)]
    fn at(&self, place: usize) -> u32 {
        let place = place % PLACES;
        self.bytes.get(place..place + 4).and_then(|four| four.first_chunk()).map_or(0, |four| u32::from_be_bytes(*four))
    }
}

/// Reads a code.
///
/// What the next byte or symbol is cannot be foreseen, and a processor that guesses wrong loses more time than a symbol takes: so the steps here
/// compute where they could branch.
pub struct Reader<'a> {
    /// The code's number less the interval's low end.
    ahead: u32,
    range: u32,
    code: &'a Padded,
    /// Bytes taken in, those supplied past the code's end included.
    pulled: usize,
    /// The four bytes after those, the first on top: fetched before it is known how many are wanted.
    next: u32,
    sound: bool,
}

impl<'a> Reader<'a> {
    pub fn new(code: &'a Padded) -> Self {
        Self { ahead: code.at(0), range: u32::MAX, code, pulled: 4, next: code.at(4), sound: true }
    }

    /// Where in 0..4,096 the next symbol lies. To be followed by [`Reader::take`] or [`Reader::take_last`].
    #[inline(always)]
    pub fn peek(&self) -> u32 {
        let part = (self.range >> WHOLE_BITS).max(1);
        (self.ahead / part).min((1 << WHOLE_BITS) - 1)
    }

    /// Takes the symbol in which the place lies, when it is not the last of all.
    #[inline(always)]
    pub fn take(&mut self, start: u32, size: u32) {
        let part = self.range >> WHOLE_BITS;
        self.consume(part.wrapping_mul(start), part.wrapping_mul(size));
    }

    /// Takes the last symbol of all. Above it is a sliver of the interval that is no symbol's: a number there no writer makes, and what is read from
    /// there on means nothing.
    pub fn take_last(&mut self, start: u32) {
        self.sound &= self.ahead < self.range >> WHOLE_BITS << WHOLE_BITS;
        self.take(start, (1 << WHOLE_BITS) - start);
    }

    #[inline(always)]
    pub fn bits(&mut self, count: u32) -> u32 {
        let part = self.range >> count;
        let (value, most) = (self.ahead / part.max(1), (1 << count) - 1);
        // The sliver again.
        self.sound &= value <= most;
        let value = value.min(most);
        self.consume(part.wrapping_mul(value), part);
        value
    }

    #[inline(always)]
    fn consume(&mut self, below: u32, range: u32) {
        self.ahead = self.ahead.wrapping_sub(below);
        // As many bytes as bring the range to NARROW or above. It is not 0: a share is one of at least 2^12 parts, `bits` leaves 2^8.
        let bytes = (range | 1).leading_zeros() >> 3;
        self.pull(bytes);
        self.range = range << (8 * bytes);
    }

    /// Takes in 0 to 3 bytes.
    #[inline(always)]
    fn pull(&mut self, bytes: u32) {
        let bits = 8 * bytes;
        self.ahead = self.ahead << bits | (u64::from(self.next) << bits >> 32) as u32;
        self.pulled += bytes as usize;
        self.next = self.code.at(self.pulled);
    }

    /// Whether the code is the one that writing the same symbols makes.
    pub fn finish(self) -> bool {
        // A writer pushes one byte more than it has widened by; a reader is four ahead of that count.
        let all_read = self.pulled >= self.code.len + 3 && self.pulled < PLACES;
        // The interval's low end is what the last four bytes say less what the number lies ahead of it.
        let low = self.code.at(self.pulled.wrapping_sub(4)).wrapping_sub(self.ahead);
        self.sound && all_read && !self.code.ends_in_zero && self.ahead == low.wrapping_neg() & (NARROW - 1)
    }
}
