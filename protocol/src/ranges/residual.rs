//! Residuals as symbols: how far a range lies from its forecast, in steps that suit the expected error.
//!
//! A residual is divided into steps of a quarter to half the expected error, from four units of error up; the
//! magnitude in steps is a symbol whose shares come from one of 16 rows of [`SHARES`](super::shares::SHARES), four an
//! octave; sign and place within the step are plain bits. Below four units every octave has rows of its own, above it
//! the shape is the same.

/// Magnitudes with a symbol each: 0 to 20 steps.
pub const MAGNITUDES: u32 = 21;

/// Symbol of a greater magnitude; its excess follows as an Elias-gamma number.
pub const BEYOND: u32 = MAGNITUDES;

/// Symbol of a beam that is no range, or whose flags are new.
pub const SPECIAL: u32 = MAGNITUDES + 1;

/// Number of symbols.
pub const SYMBOLS: usize = SPECIAL as usize + 1;

/// Rows of shares.
pub const ROWS: usize = 16;

/// How residuals of one expected error are divided.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Scale {
    /// Row of shares.
    pub row: usize,
    /// Bits of a residual that are plain: a step is 2^shift units.
    pub shift: u32,
}

impl Scale {
    /// The scale for an expected error in 1/256 of a unit.
    pub fn of(error: u32) -> Self {
        // A floating-point look at the number: its octave and the two bits below its first.
        let error = error.max(64);
        let octave = error.ilog2();
        let quarter = (error >> (octave - 2)) & 3;
        let row = (octave.min(9) - 6) * 4 + quarter;
        Self { row: row as usize, shift: octave.saturating_sub(9).min(12) }
    }

    /// Magnitude in steps, sign (true = below the forecast) and place within the step of a residual.
    pub fn split(self, residual: i32) -> (u32, bool, u32) {
        let half = (1_i32 << self.shift) >> 1;
        let moved = residual + half;
        let steps = moved >> self.shift;
        (steps.unsigned_abs(), steps < 0, (moved as u32) & ((1 << self.shift) - 1))
    }

    /// The residual of these parts.
    pub fn join(self, magnitude: u32, below: bool, place: u32) -> i32 {
        let half = (1_i32 << self.shift) >> 1;
        let steps = if below { (magnitude as i32).wrapping_neg() } else { magnitude as i32 };
        (steps.wrapping_shl(self.shift) | place as i32).wrapping_sub(half)
    }
}
