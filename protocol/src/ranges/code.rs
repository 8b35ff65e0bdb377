//! The code itself: the same steps on both ends, written twice side by side.
//!
//! ```text
//! shift + 1535 (12 bits, scans in half degrees only)   noise index (4 bits)   beams
//! beam, when the one before it was special: again (7/8) | something else (1/8)
//! beam, while no range is known, or after more than 4 special ones: the value (16 bits)
//! beam, else: residual symbol, with SPECIAL followed by
//!     0 | 0 the same special value as last | 1 which of nine (4 bits)
//!     1 | new flag bits, then the beam once more
//! ```

use super::arithmetic::{Padded, Reader, WHOLE_BITS, Writer};
use super::estimate::{self, Estimate, MAX_SHIFT};
use super::predictor::{Forecast, Predictor, Steps};
use super::residual::{BEYOND, MAGNITUDES, SPECIAL, Scale};
use super::shares::{SHARES, STARTS, symbol_at};
use crate::message::ScanMode;

/// Share of "the same special value again" in 4,096.
const AGAIN: u32 = 3584;

/// So many special beams in a row may be bridged by a prediction.
const BRIDGE: u32 = 4;

/// Special values are the nine highest of the measuring mode's width (SENSORS: no stop signal, dazzle, ...).
const SPECIALS: u16 = 9;

/// Elias-gamma numbers of an excess have at most so many bits: residuals are below 2^17.
const MAX_GAMMA: u32 = 17;

/// How values and steps of a scan are to be read.
#[derive(Clone, Copy, Debug)]
pub struct Geometry {
    /// Angle between beams.
    step_cdeg: u16,
    /// Whether odd beams come from a second turn of the mirror.
    interlaced: bool,
    /// Bits of a value that are the range; those above are flags.
    width: u32,
}

impl Geometry {
    /// From the count word and the mode; an unknown mode is read as the usual one.
    pub fn of(layout: u16, mode: ScanMode) -> Self {
        let partial = layout & 1 << 13 != 0;
        let step_cdeg = match mode.step_cdeg {
            _ if partial => 100,
            step @ (25 | 100) => step,
            _ => 50,
        };
        Self { step_cdeg: u16::from(step_cdeg), interlaced: step_cdeg == 50, width: mode.value_bits() }
    }

    fn mask(self) -> u16 {
        (1 << self.width) - 1
    }

    /// The lowest special value.
    fn first_special(self) -> u16 {
        self.mask() - (SPECIALS - 1)
    }
}

/// What both ends know between two beams.
struct State {
    geometry: Geometry,
    predictor: Predictor,
    /// Whether the predictor has a line.
    predicting: bool,
    /// Flag bits in force, at their place.
    flags: u16,
    /// The last special value, and how many beams in a row have had it or another.
    special: u16,
    run: u32,
}

/// What is known of the next beam.
enum Expectation {
    Literal,
    Forecast(Forecast),
}

impl State {
    fn new(geometry: Geometry, estimate: Estimate) -> Self {
        let steps = Steps::new(geometry.step_cdeg, estimate.shift);
        let predictor = Predictor::new(steps, estimate::noise(estimate.noise));
        Self { geometry, predictor, predicting: false, flags: 0, special: geometry.mask(), run: 0 }
    }

    /// The value that "again" stands for, after a special one.
    fn again(&self) -> Option<u16> {
        (self.run > 0).then_some(self.flags | self.special)
    }

    /// Out of line: a board, which writes, wants it small, and a reader comes here for few of its beams.
    #[inline(never)]
    fn expect(&mut self, i: usize) -> Expectation {
        if self.predicting && self.run <= BRIDGE {
            Expectation::Forecast(self.predictor.forecast(i))
        } else {
            Expectation::Literal
        }
    }

    /// See [`State::expect`].
    #[inline(never)]
    fn learn(&mut self, value: u16, expectation: &Expectation) {
        let range = value & self.geometry.mask();
        self.flags = value & !self.geometry.mask();
        let foreseen = matches!(expectation, Expectation::Forecast(_));
        if range >= self.geometry.first_special() {
            self.special = range;
            self.run = self.run.saturating_add(1);
            if foreseen {
                self.predictor.coast();
            }
            return;
        }
        self.run = 0;
        if foreseen {
            self.predictor.correct(range);
        } else {
            self.predicting = true;
            self.predictor.begin(range);
        }
    }
}

/// Write the code of `values` to `out`; `None` when it has no room there.
pub fn write(geometry: Geometry, values: &[u16], out: &mut [u8]) -> Option<usize> {
    let estimate = estimate::estimate(values, geometry.interlaced, |value| value < geometry.first_special());
    let mut writer = Writer::new(out);
    if geometry.interlaced {
        writer.bits((estimate.shift + MAX_SHIFT) as u32, 12);
    }
    writer.bits(estimate.noise, 4);
    let mut state = State::new(geometry, estimate);
    for (i, &value) in values.iter().enumerate() {
        if writer.is_full() {
            return None;
        }
        let expectation = state.expect(i);
        let again = state.again().map(|again| again == value);
        match again {
            Some(true) => writer.symbol(0, AGAIN),
            Some(false) => writer.symbol(AGAIN, (1 << WHOLE_BITS) - AGAIN),
            None => {}
        }
        if again != Some(true) {
            match &expectation {
                Expectation::Literal => writer.bits(u32::from(value), 16),
                Expectation::Forecast(forecast) => write_value(&mut writer, &mut state, forecast, value),
            }
        }
        state.learn(value, &expectation);
    }
    writer.finish()
}

fn write_value(writer: &mut Writer<'_>, state: &mut State, forecast: &Forecast, value: u16) {
    let geometry = state.geometry;
    let scale = Scale::of(forecast.error);
    let range = value & geometry.mask();
    if value & !geometry.mask() != state.flags {
        state.flags = value & !geometry.mask();
        write_symbol(writer, scale, SPECIAL);
        writer.bits(1, 1);
        writer.bits(u32::from(state.flags >> geometry.width), 16 - geometry.width);
    }
    if range >= geometry.first_special() {
        write_symbol(writer, scale, SPECIAL);
        writer.bits(0, 1);
        writer.bits(u32::from(range != state.special), 1);
        if range != state.special {
            writer.bits(u32::from(range - geometry.first_special()), 4);
        }
        return;
    }
    let (magnitude, below, place) = scale.split(i32::from(range) - forecast.range);
    write_symbol(writer, scale, magnitude.min(BEYOND));
    if magnitude >= MAGNITUDES {
        let excess = magnitude - MAGNITUDES + 1;
        let bits = excess.ilog2();
        for _ in 0..bits {
            writer.bits(1, 1);
        }
        writer.bits(0, 1);
        // Two halves: a number of plain bits takes 16 at most.
        writer.bits((excess >> 8) & ((1 << bits.saturating_sub(8)) - 1), bits.saturating_sub(8));
        writer.bits(excess & ((1 << bits.min(8)) - 1), bits.min(8));
    }
    let signed = u32::from(magnitude > 0);
    if scale.shift + signed > 0 {
        writer.bits(u32::from(below && signed == 1) << scale.shift | place, scale.shift + signed);
    }
}

fn write_symbol(writer: &mut Writer<'_>, scale: Scale, symbol: u32) {
    let start = STARTS.get(scale.row).and_then(|row| row.get(symbol as usize)).copied().unwrap_or(0);
    let share = SHARES.get(scale.row).and_then(|row| row.get(symbol as usize)).copied().unwrap_or(1);
    writer.symbol(u32::from(start), u32::from(share));
}

/// Read as many values as `values` has room for; `None` unless [`write`] makes `code` from them.
pub fn read(geometry: Geometry, code: &[u8], values: &mut [u16]) -> Option<()> {
    let code = Padded::new(code);
    let mut reader = Reader::new(&code);
    let shift = if geometry.interlaced { reader.bits(12) as i32 - MAX_SHIFT } else { 0 };
    if shift > MAX_SHIFT {
        return None;
    }
    let noise = reader.bits(4);
    let mut state = State::new(geometry, Estimate { shift, noise });
    for (i, value) in values.iter_mut().enumerate() {
        if state.predicting && state.run == 0 {
            // Nearly every beam: a range that follows a range, foreseen within 20 steps.
            let forecast = state.predictor.forecast(i);
            let scale = Scale::of(forecast.error);
            let (symbol, start, share) = symbol_at(scale.row, reader.peek());
            if symbol < BEYOND {
                reader.take(start, share);
                let residual = read_residual(&mut reader, scale, symbol);
                // Negative ones are the greatest.
                let range = forecast.range.wrapping_add(residual) as u32;
                if range >= u32::from(geometry.first_special()) {
                    return None;
                }
                let range = range as u16;
                *value = state.flags | range;
                state.predictor.correct(range);
                continue;
            }
            let expectation = Expectation::Forecast(forecast);
            // Handed over and back whole: what is only looked at here may stay in registers.
            (reader, state, *value) = read_rare(reader, state, &expectation)?;
        } else {
            let expectation = state.expect(i);
            (reader, state, *value) = read_rare(reader, state, &expectation)?;
        }
    }
    // Shift and noise are free for the encoder to choose; whether they are its choice is for the caller to judge.
    reader.finish().then_some(())
}

/// Reads a beam that may be anything, and learns from it.
#[cold]
#[inline(never)]
fn read_rare<'a>(
    mut reader: Reader<'a>,
    mut state: State,
    expectation: &Expectation,
) -> Option<(Reader<'a>, State, u16)> {
    let again = state.again();
    let value = match again {
        Some(again) if reader.peek() < AGAIN => {
            reader.take(0, AGAIN);
            again
        }
        _ => {
            if again.is_some() {
                reader.take_last(AGAIN);
            }
            let value = match expectation {
                Expectation::Literal => reader.bits(16) as u16,
                Expectation::Forecast(forecast) => read_value(&mut reader, &mut state, forecast)?,
            };
            // What "again" stands for has no other code.
            if again == Some(value) {
                return None;
            }
            value
        }
    };
    state.learn(value, expectation);
    Some((reader, state, value))
}

fn read_value(reader: &mut Reader<'_>, state: &mut State, forecast: &Forecast) -> Option<u16> {
    let geometry = state.geometry;
    let scale = Scale::of(forecast.error);
    let mut symbol = read_symbol(reader, scale);
    if symbol == SPECIAL && reader.bits(1) == 1 {
        let flags = (reader.bits(16 - geometry.width) as u16) << geometry.width;
        if flags == state.flags {
            return None;
        }
        state.flags = flags;
        symbol = read_symbol(reader, scale);
        if symbol == SPECIAL && reader.bits(1) == 1 {
            return None;
        }
    }
    if symbol == SPECIAL {
        let range = if reader.bits(1) == 0 {
            state.special
        } else {
            let which = reader.bits(4) as u16;
            if which >= SPECIALS || geometry.first_special() + which == state.special {
                return None;
            }
            geometry.first_special() + which
        };
        return Some(state.flags | range);
    }
    let mut magnitude = symbol;
    if symbol == BEYOND {
        let mut bits = 0;
        while reader.bits(1) == 1 {
            bits += 1;
            if bits > MAX_GAMMA {
                return None;
            }
        }
        let high = reader.bits(bits.saturating_sub(8));
        let excess = 1 << bits | high << 8 | reader.bits(bits.min(8));
        magnitude = MAGNITUDES - 1 + excess;
    }
    let residual = read_residual(reader, scale, magnitude);
    let range = u16::try_from(forecast.range.wrapping_add(residual)).ok()?;
    (range < geometry.first_special()).then_some(state.flags | range)
}

/// The residual of a magnitude: its sign, if it has one, and its place within the step follow.
#[inline(always)]
fn read_residual(reader: &mut Reader<'_>, scale: Scale, magnitude: u32) -> i32 {
    let signed = u32::from(magnitude > 0);
    let sign_and_place = reader.bits(scale.shift + signed);
    let (below, place) = (sign_and_place >> scale.shift == 1, sign_and_place & ((1 << scale.shift) - 1));
    scale.join(magnitude, below, place)
}

#[inline(always)]
fn read_symbol(reader: &mut Reader<'_>, scale: Scale) -> u32 {
    let (symbol, start, share) = symbol_at(scale.row, reader.peek());
    if symbol == SPECIAL {
        reader.take_last(start);
    } else {
        reader.take(start, share);
    }
    symbol
}
