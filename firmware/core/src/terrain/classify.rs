//! What a risky cell is: a curb, a bump, a drop, or nothing that can be told.
//!
//! Through each risky cell four profiles are laid, along x, y and both diagonals. The ground level on either flank is the mean of the known
//! cells 0.5 to 0.9 m away, the road's gradient taken out. A difference between the flanks is a step: a curb where
//! the vehicle's side is the lower, a drop where it is the higher. Equal flanks with the middle above are a
//! bump, with the middle below a hole, which is a drop too. The profile that shows most decides; confidence grows with what it shows
//! over what it doubts.

use super::risk::SLOW;
use super::tile::{Class, TALL_CERTAIN, TILE_CELLS, Tile, TileKey};
use super::window::Window;

/// Least difference that makes a shape: 1.5 cm in quarter millimetres.
const LEAST: i32 = 60;
const FLANK: core::ops::RangeInclusive<i32> = 5..=9;

/// Classes of a tile's cells, confidence in the high five bits. `vehicle` is the sensor's place in cells from the tile's corner.
pub(crate) fn classify(window: &Window<'_>, tile: &Tile, vehicle: [i32; 2]) -> [u8; TILE_CELLS] {
    let mut classes = [0; TILE_CELLS];
    for (index, (class, risk)) in classes.iter_mut().zip(&tile.risk).enumerate() {
        if tile.tall[index & 255] >= TALL_CERTAIN {
            *class = Class::Tall as u8 | 31 << 3;
        } else if *risk >= SLOW {
            let at = [(index & 15) as i32, (index >> 4) as i32];
            let (kind, confidence) = judge(window, tile, at, vehicle);
            *class = kind as u8 | confidence << 3;
        }
    }
    classes
}

fn judge(window: &Window<'_>, tile: &Tile, at: [i32; 2], vehicle: [i32; 2]) -> (Class, u8) {
    let (mut step, mut hump) = (Shape::default(), Shape::default());
    for direction in [[1, 0], [0, 1], [1, 1], [1, -1]] {
        let level = |sign: i32| flank(window, tile, at, direction, sign);
        let (Some(before), Some(after)) = (level(-1), level(1)) else { continue };
        let rise = after - before;
        if rise.abs() > step.size.abs() {
            step = Shape { size: rise, direction };
        }
        if let Some((low, high)) = middle(window, tile, at, direction) {
            let (top, bottom) = (high - before.max(after), low - before.min(after));
            let bulge = if top >= -bottom { top } else { bottom };
            // A middle that stands out of one flank only is the step itself.
            if bulge.abs() > hump.size.abs() && bulge.abs() > rise.abs() {
                hump = Shape { size: bulge, direction };
            }
        }
    }
    if step.size.abs().max(hump.size.abs()) < LEAST {
        return (Class::Unknown, 0);
    }
    if step.size.abs() >= hump.size.abs() {
        // The vehicle's side along the profile: which flank is nearer to it.
        let towards = (vehicle[0] - at[0]) * step.direction[0] + (vehicle[1] - at[1]) * step.direction[1];
        let rises_away = (step.size > 0) == (towards < 0);
        let class = if rises_away { Class::Curb } else { Class::Drop };
        (class, confidence(step.size, hump.size))
    } else {
        let class = if hump.size > 0 { Class::Bump } else { Class::Drop };
        (class, confidence(hump.size, step.size))
    }
}

#[derive(Clone, Copy, Default)]
struct Shape {
    size: i32,
    direction: [i32; 2],
}

/// 31 when nothing speaks for the other shape, 0 when both say the same.
fn confidence(shown: i32, doubt: i32) -> u8 {
    let (shown, doubt) = (shown.abs().max(1), doubt.abs());
    let share = (shown - doubt).max(0).saturating_mul(31).checked_div(shown).unwrap_or(0);
    share.clamp(0, 31) as u8
}

/// Height of a cell given relative to the tile's corner, above the tile's base, the tile's gradient taken out.
fn height(window: &Window<'_>, tile: &Tile, x: i32, y: i32) -> Option<i32> {
    let key = TileKey { x: tile.key.x.wrapping_add(x >> 4), y: tile.key.y.wrapping_add(y >> 4) };
    let source = window.tile(key)?;
    let index = ((y & 15) << 4 | (x & 15)) as usize & 255;
    if source.margin[index] == 0 {
        return None;
    }
    let slope = (i32::from(tile.rise[0]) * (x - 8) + i32::from(tile.rise[1]) * (y - 8)) / 4;
    Some(i32::from(source.height[index]) + source.base.saturating_sub(tile.base) - slope)
}

/// Mean level beside a cell: the known cells along the profile and one to each side of it.
fn flank(window: &Window<'_>, tile: &Tile, at: [i32; 2], direction: [i32; 2], sign: i32) -> Option<i32> {
    let (mut sum, mut count) = (0i32, 0i32);
    for distance in FLANK {
        for side in -1..=1 {
            let x = at[0] + sign * direction[0] * distance - direction[1] * side;
            let y = at[1] + sign * direction[1] * distance + direction[0] * side;
            if let Some(level) = height(window, tile, x, y) {
                sum = sum.saturating_add(level);
                count += 1;
            }
        }
    }
    sum.checked_div(count)
}

/// Lowest and highest known cell within two of the cell along the profile.
fn middle(window: &Window<'_>, tile: &Tile, at: [i32; 2], direction: [i32; 2]) -> Option<(i32, i32)> {
    let mut extremes: Option<(i32, i32)> = None;
    for distance in -2..=2 {
        for side in -1..=1 {
            let x = at[0] + direction[0] * distance - direction[1] * side;
            let y = at[1] + direction[1] * distance + direction[0] * side;
            if let Some(level) = height(window, tile, x, y) {
                extremes = Some(extremes.map_or((level, level), |(low, high)| (low.min(level), high.max(level))));
            }
        }
    }
    extremes
}
