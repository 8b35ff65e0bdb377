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
const NEAREST: i32 = 7;
const FARTHEST: i32 = 10;

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
    let mut slopes = [[0.0f32; 2]; TILE_CELLS];
    let mut uphill = [0.0f32; 2];
    for (index, ((class, risk), slope)) in classes.iter_mut().zip(&tile.risk).zip(&mut slopes).enumerate() {
        if tile.tall[index & 255] >= TALL_CERTAIN {
            *class = Class::Tall as u8 | 31 << 3;
        } else if *risk >= SLOW {
            let (kind, confidence, rise) = judge(&ground, centre(index));
            *class = kind as u8 | confidence << 3;
            *slope = rise;
            if kind == Class::Curb {
                // A step's sign along its own direction is certain, its direction is not: the tile's mean decides.
                let sign = if rise[0] * uphill[0] + rise[1] * uphill[1] < 0.0 { -1.0 } else { 1.0 };
                uphill = [uphill[0] + sign * rise[0], uphill[1] + sign * rise[1]];
            }
        }
    }
    // Steps that point against the tile's mean have the other side up.
    for (index, (class, slope)) in classes.iter_mut().zip(slopes).enumerate() {
        if Class::from_bits(*class) == Class::Curb {
            let at = [(index & 15) as i32, (index >> 4) as i32];
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
fn judge(ground: &Surroundings, centre: i16) -> (Class, u8, [f32; 2]) {
    let (mut step, mut hump) = (0i32, 0i32);
    let mut uphill = [0.0f32; 2];
    for profile in &PROFILES {
        let level = |cells| flank(ground, centre, cells);
        let (Some(before), Some(after)) = (level(&profile.before), level(&profile.after)) else { continue };
        let rise = after - before;
        for (sum, part) in uphill.iter_mut().zip(profile.direction) {
            *sum += (rise * part) as f32;
        }
        if rise.abs() > step.abs() {
            step = rise;
        }
        if let Some((low, high)) = middle(ground, centre, &profile.middle) {
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

/// Cells of a profile, as places in the surroundings relative to its centre.
struct Profile {
    direction: [i32; 2],
    /// The flanks: along the profile and one to each side of it.
    before: [i16; FLANK],
    after: [i16; FLANK],
    /// Those within two of the cell along the profile.
    middle: [i16; 15],
}

const FLANK: usize = 3 * (FARTHEST - NEAREST + 1) as usize;
const PROFILES: [Profile; 4] = [profile([1, 0]), profile([0, 1]), profile([1, 1]), profile([1, -1])];

const fn profile(direction: [i32; 2]) -> Profile {
    Profile {
        direction,
        before: strip(direction, -1, NEAREST),
        after: strip(direction, 1, NEAREST),
        middle: strip(direction, 1, -2),
    }
}

/// `N` cells, three abreast, from a distance on.
const fn strip<const N: usize>(direction: [i32; 2], sign: i32, from: i32) -> [i16; N] {
    let mut cells = [0; N];
    let mut index = 0;
    while index < N {
        let (distance, side) = (from + index as i32 / 3, index as i32 % 3 - 1);
        let x = sign * direction[0] * distance - direction[1] * side;
        let y = sign * direction[1] * distance + direction[0] * side;
        cells[index] = (y * ACROSS as i32 + x) as i16;
        index += 1;
    }
    cells
}

/// Place of a tile's cell in the surroundings.
fn centre(index: usize) -> i16 {
    (((index >> 4) + HALO) * ACROSS + (index & 15) + HALO) as i16
}

/// Heights of a tile and of twelve cells around it, above the tile's base, its gradient taken out: rows one behind the other, and up to
/// a power of two nothing known.
struct Surroundings([i16; PLACES]);

const HALO: usize = 12;
const ACROSS: usize = TILE_SIDE + 2 * HALO;
const PLACES: usize = (ACROSS * ACROSS).next_power_of_two();
/// Nothing is known here; no height reaches it.
const UNKNOWN: i16 = i16::MIN;

impl Surroundings {
    fn gather(window: &Window<'_>, tile: &Tile) -> Self {
        let mut out = Self([UNKNOWN; PLACES]);
        for (band, rows) in out.0.chunks_mut(ACROSS).take(ACROSS).enumerate() {
            // The band's row in the tile, or in the one above or below it.
            let y = band as i32 - HALO as i32;
            let row = (y & 15) as usize;
            for (dx, to, from) in [(-1, 0, TILE_SIDE - HALO), (0, HALO, 0), (1, HALO + TILE_SIDE, 0)] {
                let key = TileKey { x: tile.key.x.wrapping_add(dx), y: tile.key.y.wrapping_add(y >> 4) };
                let Some(source) = window.tile(key) else { continue };
                let heights = source.height.as_chunks::<TILE_SIDE>().0.get(row);
                let margins = source.margin.as_chunks::<TILE_SIDE>().0.get(row);
                let (Some(heights), Some(margins)) = (heights, margins) else { continue };
                let mut levels = [UNKNOWN; TILE_SIDE];
                level(
                    heights,
                    margins,
                    source.base.saturating_sub(tile.base),
                    tile.rise,
                    [16 * dx - 8, y - 8],
                    &mut levels,
                );
                for (out, level) in rows.iter_mut().skip(to).zip(levels.iter().skip(from)) {
                    *out = *level;
                }
            }
        }
        out
    }

    #[inline(always)]
    fn at(&self, place: i16) -> i16 {
        self.0[place as u16 as usize & (PLACES - 1)]
    }
}

/// A row's heights raised by a shift, the gradient taken out, counted from `x`, `y` cells off the tile's middle on.
#[inline(never)]
fn level(
    heights: &[i16; TILE_SIDE],
    margins: &[u8; TILE_SIDE],
    shift: i32,
    rise: [i16; 2],
    [x, y]: [i32; 2],
    out: &mut [i16; TILE_SIDE],
) {
    // What lies further off than heights and gradients together reach comes out at the ends all the same.
    let shift = shift.clamp(-200_000, 200_000);
    let (mut slope, step) = (i32::from(rise[0]) * x + i32::from(rise[1]) * y, i32::from(rise[0]));
    for ((out, height), margin) in out.iter_mut().zip(heights).zip(margins) {
        let level = (i32::from(*height) + shift - slope / 4).clamp(-32_000, 32_000) as i16;
        *out = if *margin == 0 { UNKNOWN } else { level };
        slope += step;
    }
}

// What is unknown is masked and not passed over: whether a cell is known cannot be foretold.

/// Mean level of the known cells among these.
fn flank(ground: &Surroundings, centre: i16, cells: &[i16; FLANK]) -> Option<i32> {
    let (mut sum, mut count) = (0i32, 0i32);
    for cell in cells {
        let level = ground.at(centre.wrapping_add(*cell));
        let known = -i32::from(level != UNKNOWN);
        sum += i32::from(level) & known;
        count -= known;
    }
    sum.checked_div(count)
}

/// Lowest and highest known cell among these.
fn middle(ground: &Surroundings, centre: i16, cells: &[i16; 15]) -> Option<(i32, i32)> {
    let (mut low, mut high) = (i16::MAX, UNKNOWN);
    for cell in cells {
        let level = ground.at(centre.wrapping_add(*cell));
        let unknown = -i16::from(level == UNKNOWN);
        high = high.max(level);
        low = low.min((level & !unknown) | (i16::MAX & unknown));
    }
    (high != UNKNOWN).then_some((i32::from(low), i32::from(high)))
}
