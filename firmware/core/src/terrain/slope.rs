//! The road's own gradient, tile by tile, by medians of differences over 0.4 m.
//!
//! A median passes over curbs and bumps that a least-squares plane would lean on, so that nothing leaks beside them.
//! Each tile's medians are pooled over its 3 x 3 neighbourhood, weighted by their pairs.

use super::tile::{TILE_CELLS, TILE_SIDE, Tile, TileKey};
use super::window::{Neighbours, Window};

/// Cells between the two ends of a difference.
const SPAN: usize = 4;
/// A rise of more than this over four cells is no road: 45 %, 0.18 m.
const STEEPEST: i16 = 720;
/// Marks a difference of which an end is unknown; above any real one.
const NONE: i16 = i16::MAX;
/// Pairs from which a tile's median counts as one.
const ENOUGH: u16 = 6;
/// Pairs from which a small neighbourhood's median is not looked for in a larger one. Far off, where a tile is crossed by one ring, six pairs are
/// wrong by 3 %, which between two rings a metre apart is a step of 3 cm.
const SURE: u16 = 40;

/// Known cells from which a tile's first impressions are reviewed: an eighth.
const REVIEWED: u16 = 32;
/// Height above the tile's floor from which a first impression is given up, 0.17 m: above a curb of 15 cm, below a car's flank.
const IMPRESSION: i16 = 680;

/// Works a tile's mean height and its own medians out anew. With the frame's stamp, first impressions are reviewed the first time that enough of it
/// is known.
///
/// What a tile far off shows first may be the flank of a car, taken for ground because there was none to tell it from. When more is known, cells
/// that stand high above the tile's floor and are not seen in this frame are given up, once: a low wall is seen again, the car has gone.
pub(crate) fn measure(tile: &mut Tile, review: Option<u8>) {
    survey(tile);
    if let Some(stamp) = review
        && !tile.reviewed
        && tile.known >= REVIEWED
    {
        tile.reviewed = true;
        if give_up_impressions(tile, stamp) {
            survey(tile);
        }
    }
}

fn survey(tile: &mut Tile) {
    let mut known = 0i32;
    let mut sum = 0i32;
    for (height, margin) in tile.height.iter().zip(&tile.margin) {
        let mask = -i32::from(*margin != 0);
        known -= mask;
        // 256 x 32,000 stays within 31 bits.
        sum += i32::from(*height) & mask;
    }
    tile.known = known as u16;
    tile.ground = sum.checked_div(known).unwrap_or(0) as i16;
    let masks = tile.known_masks();
    let (x, x_pairs) = median_rise(&tile.height, &masks, 1);
    let (y, y_pairs) = median_rise(&tile.height, &masks, TILE_SIDE);
    tile.own_rise = [x, y];
    tile.pairs = [x_pairs, y_pairs];
}

/// Empties cells high above the level that a tenth of the tile's cells keep below, its gradient taken out, unless they bear the stamp; whether there
/// were any.
fn give_up_impressions(tile: &mut Tile, stamp: u8) -> bool {
    let mut levels = [NONE; TILE_CELLS];
    for (index, (level, (height, margin))) in levels.iter_mut().zip(tile.height.iter().zip(&tile.margin)).enumerate() {
        if *margin != 0 {
            let (column, row) = ((index & 15) as i32 - 8, (index >> 4) as i32 - 8);
            let slope = (i32::from(tile.own_rise[0]) * column + i32::from(tile.own_rise[1]) * row) / SPAN as i32;
            *level = (i32::from(*height) - slope).clamp(-32_000, 32_000) as i16;
        }
    }
    let floor = quantile(&levels, tile.known / 10 + 1, 32_000);
    let mut any = false;
    let seen = tile.stamp;
    for (index, (level, seen)) in levels.iter().zip(seen).enumerate() {
        if *level != NONE && *level > floor.saturating_add(IMPRESSION) && seen != stamp {
            tile.clear(index as u8);
            any = true;
        }
    }
    any
}

type Rises = [i16; TILE_CELLS];

/// Median of the rises over four cells along x (`stride` 1) or y (`stride` 16), and how many there are. A sparse tile
/// uses another span where that has more pairs.
fn median_rise(heights: &Rises, known: &Rises, stride: usize) -> (i16, u8) {
    let mut best: (Rises, u16, usize) = ([NONE; TILE_CELLS], 0, SPAN);
    for span in [SPAN, 8, 3] {
        let (rises, pairs) = rises(heights, known, stride, span);
        if pairs > best.1 {
            best = (rises, pairs, span);
        }
        if best.1 >= 20 {
            break;
        }
    }
    let (rises, pairs, span) = best;
    let median = i32::from(median(&rises, pairs, limit(span)));
    let over_four = median * SPAN as i32 / span.max(1) as i32;
    (over_four as i16, pairs.min(255) as u8)
}

fn limit(span: usize) -> i16 {
    STEEPEST / SPAN as i16 * span as i16
}

fn rises(heights: &Rises, known: &Rises, stride: usize, span: usize) -> (Rises, u16) {
    let mut rises = [NONE; TILE_CELLS];
    let limit = limit(span);
    let reach = (span * stride).min(TILE_CELLS);
    let ends = heights.iter().zip(known).skip(reach);
    let starts = heights.iter().zip(known);
    let mut count = 0u16;
    for (rise, ((h0, k0), (h1, k1))) in rises.iter_mut().zip(starts.zip(ends)) {
        let difference = h1.wrapping_sub(*h0);
        let sound = k0 & k1 & -i16::from(difference >= -limit) & -i16::from(difference <= limit);
        *rise = (difference & sound) | (NONE & !sound);
    }
    if stride == 1 {
        // The last columns have no partner in their own row.
        for row in rises.chunks_exact_mut(TILE_SIDE) {
            for rise in row.iter_mut().skip(TILE_SIDE - span.min(TILE_SIDE)) {
                *rise = NONE;
            }
        }
    }
    for rise in &rises {
        count += u16::from(*rise != NONE);
    }
    (rises, count)
}

/// Smallest value with at least half of the pairs at or below it.
fn median(rises: &Rises, pairs: u16, limit: i16) -> i16 {
    if pairs == 0 { 0 } else { quantile(rises, pairs.div_ceil(2), limit) }
}

/// Smallest value from `-limit` to `limit` with at least `count` of the values at or below it, by bisection on the value: counting is
/// a branchless pass over 256 words.
fn quantile(values: &Rises, count: u16, limit: i16) -> i16 {
    let (mut low, mut high) = (-limit, limit);
    while low < high {
        let middle = ((i32::from(low) + i32::from(high)) >> 1) as i16;
        if at_most(values, middle) >= count {
            high = middle;
        } else {
            low = middle + 1;
        }
    }
    low
}

#[inline(never)]
fn at_most(rises: &Rises, bound: i16) -> u16 {
    let mut count = 0i16;
    for rise in rises {
        count += i16::from(*rise <= bound);
    }
    count as u16
}

/// Pools the medians of a tile's neighbourhood: none where nothing around is known well enough.
pub(crate) fn pool(window: &Window<'_>, around: &Neighbours<'_>, key: TileKey) -> Option<[i16; 2]> {
    let mut out = [0i16; 2];
    for (axis, out) in out.iter_mut().enumerate() {
        // The tile itself counts double.
        let near = around.iter().enumerate().map(|(place, tile)| (tile, if place == 4 { 2 } else { 1 }));
        let found = weighted_median(near, axis, SURE);
        let found = found.or_else(|| weighted_median(square(window, key, 2), axis, SURE));
        *out = found.or_else(|| weighted_median(square(window, key, 3), axis, ENOUGH))?;
    }
    Some(out)
}

/// The tiles up to `reach` away.
fn square<'w>(window: &'w Window<'_>, key: TileKey, reach: i32) -> impl Iterator<Item = (Option<&'w Tile>, u16)> {
    (-reach..=reach).flat_map(move |dy| {
        (-reach..=reach).map(move |dx| {
            let near = TileKey { x: key.x.wrapping_add(dx), y: key.y.wrapping_add(dy) };
            (window.tile(near), if dx == 0 && dy == 0 { 2 } else { 1 })
        })
    })
}

fn weighted_median<'w>(tiles: impl Iterator<Item = (Option<&'w Tile>, u16)>, axis: usize, least: u16) -> Option<i16> {
    // 7 x 7 at most.
    let mut held = [(0i16, 0u16); 49];
    let mut used = 0;
    let mut total = 0u16;
    for (tile, times) in tiles {
        let Some(tile) = tile else { continue };
        let pairs = tile.pairs.get(axis).copied().unwrap_or(0);
        if pairs == 0 {
            continue;
        }
        let weight = u16::from(pairs.min(64)) * times;
        if let Some(entry) = held.get_mut(used) {
            *entry = (tile.own_rise.get(axis).copied().unwrap_or(0), weight);
            used += 1;
            total += weight;
        }
    }
    if total < least {
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
