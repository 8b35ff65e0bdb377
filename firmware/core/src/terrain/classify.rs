//! What a risky cell is: a curb, a bump, a drop, or nothing that can be told.
//!
//! Through each risky cell four profiles are laid, along x, y and both diagonals. The ground level on either flank is the mean of
//! the known cells 0.7 to 1 m away, the road's gradient taken out. A difference between the flanks is a step: a curb where
//! the road's side is the lower, a drop where it is the higher. Equal flanks with the middle above are a
//! bump, with the middle below a hole, which is a drop too. The profile that shows most decides; confidence grows with what it shows
//! over what it doubts.

use super::risk::SLOW;
use super::tile::{Class, TALL_CERTAIN, TILE_CELLS, TILE_SIDE, Tile, TileKey};
use super::window::Window;

/// Least difference that makes a shape: 1.5 cm in quarter millimetres.
const LEAST: i32 = 60;
/// Cells to the level beside: past the far side of a bump 0.9 m long from either of its ends.
const FLANK: core::ops::RangeInclusive<i32> = 7..=10;

/// Where the vehicle is and where it heads, to tell the road's side of a step.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Outlook {
    /// The sensor's place in cells from the tile's corner.
    pub(crate) at: [f32; 2],
    pub(crate) forward: [f32; 2],
}

/// Classes of a tile's cells, confidence in the high five bits.
pub(crate) fn classify(window: &Window<'_>, tile: &Tile, outlook: Outlook) -> [u8; TILE_CELLS] {
    let mut classes = [0; TILE_CELLS];
    if tile.risk.iter().all(|risk| *risk < SLOW) {
        return classes;
    }
    let ground = Surroundings::gather(window, tile);
    let mut uphill = [0.0f32; 2];
    for (index, (class, risk)) in classes.iter_mut().zip(&tile.risk).enumerate() {
        if tile.tall[index & 255] >= TALL_CERTAIN {
            *class = Class::Tall as u8 | 31 << 3;
        } else if *risk >= SLOW {
            let (kind, confidence, slope) = judge(&ground, [(index & 15) as i32, (index >> 4) as i32]);
            *class = kind as u8 | confidence << 3;
            if kind == Class::Curb {
                // A step's sign along its own direction is certain, its direction is not: the tile's mean decides.
                let sign = if slope[0] * uphill[0] + slope[1] * uphill[1] < 0.0 { -1.0 } else { 1.0 };
                uphill = [uphill[0] + sign * slope[0], uphill[1] + sign * slope[1]];
            }
        }
    }
    // Steps that point against the tile's mean have the other side up.
    for (index, class) in classes.iter_mut().enumerate() {
        if Class::from_bits(*class) == Class::Curb {
            let at = [(index & 15) as i32, (index >> 4) as i32];
            let (_, _, slope) = judge(&ground, at);
            let sign = if slope[0] * uphill[0] + slope[1] * uphill[1] < 0.0 { -1.0 } else { 1.0 };
            if !rises_away([sign * uphill[0], sign * uphill[1]], at, outlook) {
                *class = (*class & !7) | Class::Drop as u8;
            }
        }
    }
    classes
}

/// Whether the uphill side of a step lies away from the vehicle's path.
///
/// The path is taken to be the arc that starts along the heading and runs parallel to the step: an arc's chord makes half
/// the angle of its end tangent, so a cell lies left of the path where its bearing exceeds half of the step's own.
fn rises_away(uphill: [f32; 2], at: [i32; 2], outlook: Outlook) -> bool {
    let cell = [at[0] as f32 + 0.5 - outlook.at[0], at[1] as f32 + 0.5 - outlook.at[1]];
    // In the vehicle's axes: ahead, left.
    let [fx, fy] = outlook.forward;
    let turn = |v: [f32; 2]| [v[0] * fx + v[1] * fy, v[1] * fx - v[0] * fy];
    let (cell, up) = (turn(cell), turn(uphill));
    // Along the step, pointing ahead: uphill turned by a quarter.
    let along = if up[1] >= 0.0 { [up[1], -up[0]] } else { [-up[1], up[0]] };
    let length = libm::sqrtf(along[0] * along[0] + along[1] * along[1]).max(1e-6);
    // The direction halfway between the heading and the step.
    let chord = [along[0] / length + 1.0, along[1] / length];
    if cell[0] <= 0.0 || chord[0] < 0.4 {
        // Beside, behind, or a step across the path: what counts is which side faces the vehicle.
        return cell[0] * up[0] + cell[1] * up[1] > 0.0;
    }
    let left_of_path = cell[1] * chord[0] - cell[0] * chord[1] > 0.0;
    left_of_path == (up[1] >= 0.0)
}

/// Shape, confidence and uphill direction (for steps) of a cell. Steps come out as curbs; the caller tells drops from them.
fn judge(ground: &Surroundings, at: [i32; 2]) -> (Class, u8, [f32; 2]) {
    let (mut step, mut hump) = (0i32, 0i32);
    let mut uphill = [0.0f32; 2];
    for direction in [[1, 0], [0, 1], [1, 1], [1, -1]] {
        let level = |sign: i32| flank(ground, at, direction, sign);
        let (Some(before), Some(after)) = (level(-1), level(1)) else { continue };
        let rise = after - before;
        for (sum, part) in uphill.iter_mut().zip(direction) {
            *sum += (rise * part) as f32;
        }
        if rise.abs() > step.abs() {
            step = rise;
        }
        if let Some((low, high)) = middle(ground, at, direction) {
            let (top, bottom) = (high - before.max(after), low - before.min(after));
            let bulge = if top >= -bottom { top } else { bottom };
            // A middle that stands out of one flank only is the step itself.
            if bulge.abs() > hump.abs() && bulge.abs() > rise.abs() {
                hump = bulge;
            }
        }
    }
    if step.abs().max(hump.abs()) < LEAST {
        (Class::Unknown, 0, uphill)
    } else if step.abs() >= hump.abs() {
        (Class::Curb, confidence(step, hump), uphill)
    } else if hump > 0 {
        (Class::Bump, confidence(hump, step), uphill)
    } else {
        (Class::Drop, confidence(hump, step), uphill)
    }
}

/// 31 when nothing speaks for the other shape, 0 when both say the same.
fn confidence(shown: i32, doubt: i32) -> u8 {
    let (shown, doubt) = (shown.abs().max(1), doubt.abs());
    let share = (shown - doubt).max(0).saturating_mul(31).checked_div(shown).unwrap_or(0);
    share.clamp(0, 31) as u8
}

/// Heights of a tile and of twelve cells around it, above the tile's base, its gradient taken out.
struct Surroundings([[i16; ACROSS]; ACROSS]);

const HALO: i32 = 12;
const ACROSS: usize = TILE_SIDE + 2 * HALO as usize;
/// Nothing is known here; no height reaches it.
const UNKNOWN: i16 = i16::MIN;

impl Surroundings {
    fn gather(window: &Window<'_>, tile: &Tile) -> Self {
        let mut out = Self([[UNKNOWN; ACROSS]; ACROSS]);
        for dy in -1..=1 {
            for dx in -1..=1 {
                let key = TileKey { x: tile.key.x.wrapping_add(dx), y: tile.key.y.wrapping_add(dy) };
                let Some(source) = window.tile(key) else { continue };
                let shift = source.base.saturating_sub(tile.base);
                for (index, (height, margin)) in source.height.iter().zip(&source.margin).enumerate() {
                    let (x, y) = ((index & 15) as i32 + 16 * dx, (index >> 4) as i32 + 16 * dy);
                    let slot = usize::try_from(y + HALO).ok().and_then(|row| out.0.get_mut(row));
                    let slot = slot.zip(usize::try_from(x + HALO).ok()).and_then(|(row, column)| row.get_mut(column));
                    if let Some(slot) = slot.filter(|_| *margin != 0) {
                        let slope = (i32::from(tile.rise[0]) * (x - 8) + i32::from(tile.rise[1]) * (y - 8)) / 4;
                        let level = i32::from(*height).saturating_add(shift).saturating_sub(slope);
                        *slot = level.clamp(-32_000, 32_000) as i16;
                    }
                }
            }
        }
        out
    }

    #[inline]
    fn height(&self, x: i32, y: i32) -> Option<i32> {
        let row = self.0.get((y + HALO) as usize)?;
        row.get((x + HALO) as usize).copied().filter(|level| *level != UNKNOWN).map(i32::from)
    }
}

/// Mean level beside a cell: the known cells along the profile and one to each side of it.
fn flank(ground: &Surroundings, at: [i32; 2], direction: [i32; 2], sign: i32) -> Option<i32> {
    let (mut sum, mut count) = (0i32, 0i32);
    for distance in FLANK {
        for side in -1..=1 {
            let x = at[0] + sign * direction[0] * distance - direction[1] * side;
            let y = at[1] + sign * direction[1] * distance + direction[0] * side;
            if let Some(level) = ground.height(x, y) {
                sum = sum.saturating_add(level);
                count += 1;
            }
        }
    }
    sum.checked_div(count)
}

/// Lowest and highest known cell within two of the cell along the profile.
fn middle(ground: &Surroundings, at: [i32; 2], direction: [i32; 2]) -> Option<(i32, i32)> {
    let mut extremes: Option<(i32, i32)> = None;
    for distance in -2..=2 {
        for side in -1..=1 {
            let x = at[0] + direction[0] * distance - direction[1] * side;
            let y = at[1] + direction[1] * distance + direction[0] * side;
            if let Some(level) = ground.height(x, y) {
                extremes = Some(extremes.map_or((level, level), |(low, high)| (low.min(level), high.max(level))));
            }
        }
    }
    extremes
}
