//! How often each magnitude of a residual occurs, by expected error: the one table of the range code.
//!
//! Counted over simulated sections (sensor at 2-3 m, slopes of 6-10 degrees on both sides, roll of 1.5 degrees at 0.8 Hz;
//! noise of 1, 3.5 and 10 mm, with and without grass) and recordings of an indoor LMS 200, then smoothed so that
//! every symbol has a share. Part of the wire: a change is a new version in [`WIRE`](crate::schema::WIRE).

use super::arithmetic::WHOLE_BITS;
use super::residual::{ROWS, SYMBOLS};

/// Shares of the symbols in parts of 4,096: magnitudes 0 to 20, beyond, special.
#[rustfmt::skip]
pub const SHARES: [[u16; SYMBOLS]; ROWS] = [
    [1331, 2010, 642, 50, 3, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 34, 10],
    [1296, 1944, 783, 39, 4, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 4, 10],
    [1454, 1899, 601, 88, 13, 2, 2, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 13, 10],
    [1374, 1961, 609, 92, 9, 6, 6, 2, 2, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 13, 10],
    [1390, 1898, 629, 96, 12, 4, 3, 3, 3, 3, 3, 3, 2, 2, 2, 2, 2, 2, 2, 2, 2, 21, 10],
    [1383, 1896, 629, 100, 12, 4, 3, 3, 2, 2, 2, 2, 2, 2, 2, 2, 2, 2, 2, 2, 2, 30, 10],
    [1345, 1906, 635, 108, 16, 3, 3, 3, 3, 3, 3, 2, 2, 2, 2, 2, 2, 2, 2, 2, 2, 38, 10],
    [1349, 1866, 646, 121, 18, 4, 3, 3, 3, 3, 3, 3, 3, 3, 3, 3, 2, 2, 2, 2, 2, 42, 10],
    [1246, 1831, 677, 166, 33, 10, 5, 5, 4, 4, 3, 3, 3, 3, 3, 3, 3, 2, 2, 2, 2, 76, 10],
    [1010, 1641, 789, 277, 97, 54, 22, 22, 8, 7, 5, 5, 4, 4, 4, 4, 3, 3, 3, 3, 3, 118, 10],
    [680, 1215, 809, 496, 284, 206, 122, 66, 54, 26, 16, 6, 6, 4, 4, 1, 1, 1, 1, 1, 1, 86, 10],
    [533, 939, 756, 593, 423, 299, 192, 111, 74, 47, 25, 17, 5, 4, 2, 2, 2, 2, 2, 2, 2, 54, 10],
    [652, 1061, 807, 550, 349, 212, 122, 73, 46, 29, 21, 14, 11, 10, 9, 8, 7, 6, 5, 4, 4, 86, 10],
    [552, 900, 738, 562, 401, 270, 176, 116, 77, 50, 33, 23, 17, 14, 11, 10, 8, 7, 6, 5, 5, 105, 10],
    [460, 790, 660, 529, 420, 311, 222, 162, 114, 76, 58, 40, 30, 22, 17, 13, 11, 9, 8, 6, 6, 122, 10],
    [417, 708, 601, 501, 423, 326, 253, 187, 142, 100, 76, 57, 39, 31, 21, 15, 13, 10, 9, 8, 7, 142, 10],
];

/// Where the share of each symbol starts.
pub const STARTS: [[u16; SYMBOLS]; ROWS] = {
    let mut starts = [[0; SYMBOLS]; ROWS];
    let mut row = 0;
    while row < ROWS {
        let (mut sum, mut symbol) = (0, 0);
        while symbol < SYMBOLS {
            assert!(SHARES[row][symbol] > 0, "every symbol has a share");
            starts[row][symbol] = sum;
            sum += SHARES[row][symbol];
            symbol += 1;
        }
        assert!(sum == 1 << WHOLE_BITS, "the shares are of one whole");
        row += 1;
    }
    starts
};

/// The symbol at the first of every 16 places of a row: hardly ever another begins among the other 15. Only a reader refers to it: a board,
/// which writes, does not have it.
static SYMBOL_FROM: [[u8; STEPS]; ROWS] = {
    let mut symbols = [[0; STEPS]; ROWS];
    let mut row = 0;
    while row < ROWS {
        let (mut symbol, mut step) = (0, 0);
        while step < STEPS {
            while symbol + 1 < SYMBOLS && STARTS[row][symbol + 1] as usize <= step * STEP {
                symbol += 1;
            }
            symbols[row][step] = symbol as u8;
            step += 1;
        }
        row += 1;
    }
    symbols
};

/// Places in a step, and steps in a row.
const STEP: usize = 16;
const STEPS: usize = (1 << WHOLE_BITS) / STEP;

/// Start and share of each symbol; a power of two of them, so that five bits are an index.
static PARTS: [[(u16, u16); SYMBOLS.next_power_of_two()]; ROWS] = {
    let mut parts = [[(0, 1); SYMBOLS.next_power_of_two()]; ROWS];
    let mut row = 0;
    while row < ROWS {
        let mut symbol = 0;
        while symbol < SYMBOLS {
            parts[row][symbol] = (STARTS[row][symbol], SHARES[row][symbol]);
            symbol += 1;
        }
        row += 1;
    }
    parts
};

/// The symbol at a place of 0..4,096 in a row of 0..16, its start and its share.
#[inline(always)]
pub fn symbol_at(row: usize, place: u32) -> (u32, u32, u32) {
    // What is below a power of two already: said so, no check is left.
    let row = row % ROWS;
    let part = |symbol: u32| PARTS[row][symbol as usize % SYMBOLS.next_power_of_two()];
    let mut symbol = u32::from(SYMBOL_FROM[row][place as usize / STEP % STEPS]);
    let (mut start, mut share) = part(symbol);
    while place >= u32::from(start) + u32::from(share) && symbol + 1 < SYMBOLS as u32 {
        symbol += 1;
        (start, share) = part(symbol);
    }
    (symbol, u32::from(start), u32::from(share))
}
