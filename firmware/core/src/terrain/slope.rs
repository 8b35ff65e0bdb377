//! The road's own gradient, tile by tile, by medians of differences over 0.4 m.
//!
//! A median passes over curbs and bumps that a least-squares plane would lean on, so that nothing leaks beside them.
//! Each tile's medians are pooled over its 3 x 3 neighbourhood, weighted by their pairs.

use super::tile::{TILE_CELLS, TILE_SIDE, Tile, TileKey};
use super::window::Window;

/// Cells between the two ends of a difference.
const SPAN: usize = 4;
/// A rise of more than this over four cells is no road: 45 %, 0.18 m.
const STEEPEST: i16 = 720;
/// Marks a difference of which an end is unknown; above any real one.
const NONE: i16 = i16::MAX;
/// Pairs from which a tile's median counts as one.
const ENOUGH: u8 = 6;

/// Works a tile's mean height and its own medians out anew.
pub(crate) fn measure(tile: &mut Tile) {
    let mut known = 0i32;
    let mut sum = 0i32;
    for (height, margin) in tile.height.iter().zip(&tile.margin) {
        if *margin != 0 {
            known += 1;
            // 256 x 32,000 stays within 31 bits.
            sum += i32::from(*height);
        }
    }
    tile.known = known as u16;
    tile.ground = sum.checked_div(known).unwrap_or(0) as i16;
    let (x, x_pairs) = median_rise(tile, 1);
    let (y, y_pairs) = median_rise(tile, TILE_SIDE);
    tile.own_rise = [x, y];
    tile.pairs = [x_pairs, y_pairs];
}

/// Median of the rises along x (`stride` 1) or y (`stride` 16).
fn median_rise(tile: &Tile, stride: usize) -> (i16, u8) {
    let (median, pairs) = median_over(tile, stride, SPAN);
    if pairs >= 24 {
        return (median, pairs);
    }
    // Sparse tile: other spans, brought to four cells.
    let mut best = (median, pairs);
    for span in [3usize, 6, 8, 12] {
        let (other, pairs) = median_over(tile, stride, span);
        if pairs > best.1 {
            best = ((i32::from(other) * SPAN as i32 / span as i32) as i16, pairs);
        }
    }
    best
}

fn median_over(tile: &Tile, stride: usize, span: usize) -> (i16, u8) {
    let mut rises = [NONE; TILE_CELLS];
    let reach = span * stride;
    let ends = tile.height.iter().zip(&tile.margin).skip(reach);
    let starts = tile.height.iter().zip(&tile.margin);
    for (index, (rise, ((h0, m0), (h1, m1)))) in rises.iter_mut().zip(starts.zip(ends)).enumerate() {
        // Along x the last columns have no partner in their own row.
        let inside = stride != 1 || (index & 15) + span < TILE_SIDE;
        let difference = h1.wrapping_sub(*h0);
        *rise = if inside && *m0 != 0 && *m1 != 0 { difference } else { NONE };
    }
    let limit = STEEPEST * (span as i16) / (SPAN as i16);
    let mut count = 0u16;
    for rise in &mut rises {
        let sound = *rise >= -limit && *rise <= limit;
        count += u16::from(sound);
        *rise = if sound { *rise } else { NONE };
    }
    if count == 0 {
        return (0, 0);
    }
    // Smallest value with at least half of the pairs at or below it, by bisection on the value: counting is a
    // branchless pass over 256 words.
    let half = count.div_ceil(2);
    let (mut low, mut high) = (-limit, limit);
    while low < high {
        let middle = (low + high) >> 1;
        let below: u16 = rises.iter().map(|rise| u16::from(*rise <= middle)).sum();
        if below >= half {
            high = middle;
        } else {
            low = middle + 1;
        }
    }
    (low, count.min(255) as u8)
}

/// Pools the medians of a tile's neighbourhood: none where nothing around is known well enough.
pub(crate) fn pool(window: &Window<'_>, key: TileKey) -> Option<[i16; 2]> {
    let mut out = [0i16; 2];
    for (axis, out) in out.iter_mut().enumerate() {
        let mut reach = 1i32;
        *out = loop {
            match weighted_median(window, key, axis, reach) {
                Some(median) => break median,
                None if reach < 3 => reach += 1,
                None => return None,
            }
        };
    }
    Some(out)
}

fn weighted_median(window: &Window<'_>, key: TileKey, axis: usize, reach: i32) -> Option<i16> {
    // 7 x 7 at most.
    let mut held = [(0i16, 0u16); 49];
    let mut used = 0;
    let mut total = 0u16;
    for dy in -reach..=reach {
        for dx in -reach..=reach {
            let Some(tile) = window.tile(TileKey { x: key.x.wrapping_add(dx), y: key.y.wrapping_add(dy) }) else {
                continue;
            };
            let pairs = tile.pairs.get(axis).copied().unwrap_or(0);
            if pairs == 0 {
                continue;
            }
            // The tile itself counts double.
            let weight = u16::from(pairs.min(64)) * if dx == 0 && dy == 0 { 2 } else { 1 };
            if let Some(entry) = held.get_mut(used) {
                *entry = (tile.own_rise.get(axis).copied().unwrap_or(0), weight);
                used += 1;
                total += weight;
            }
        }
    }
    if total < u16::from(ENOUGH) {
        return None;
    }
    let held = held.get_mut(..used)?;
    held.sort_unstable_by_key(|entry| entry.0);
    let mut below = 0;
    for (rise, weight) in held.iter() {
        below += weight;
        if 2 * below >= total {
            return Some(*rise);
        }
    }
    None
}
