//! The road's own gradient, tile by tile, by medians of differences over 0.4 m.
//!
//! A median passes over curbs and bumps that a least-squares plane would lean on, so that nothing leaks beside them.
//! Each tile's medians are pooled over its 3 x 3 neighbourhood, weighted by their pairs.
//!
//! In a push broom's map lines of points lie as far apart as the vehicle drives between two of them, 0.6 m on a highway, and run askew to the cells:
//! hardly two known cells lie in one row 0.4 m apart. There a tile's gradient is that of a [plane](super::plane) through most of its cells.

use super::impressions;
use super::tile::{TILE_CELLS, TILE_SIDE, Tile, TileKey};
use super::window::{Neighbours, Window};

/// Cells between the two ends of a difference.
const SPAN: usize = 4;
/// A rise of more than this over four cells is no road: 45 %, 0.18 m.
pub(super) const STEEPEST: i16 = 720;
/// Marks a difference of which an end is unknown; above any real one.
pub(super) const NONE: i16 = i16::MAX;
/// Pairs from which a tile's median counts as one.
const ENOUGH: u16 = 6;
/// Pairs from which a small neighbourhood's median is not looked for in a larger one. Far off, where a tile is crossed by one ring, six pairs are
/// wrong by 3 %, which between two rings a metre apart is a step of 3 cm.
const SURE: u16 = 40;

/// Pairs beyond which a median is worth no more.
const MOST: u16 = 64;

/// Works a tile's mean height and its own medians out anew. With the frame's stamp, what its cells hold is [reviewed](super::impressions) as well.
#[inline(always)]
pub(crate) fn measure(tile: &mut Tile, review: Option<u8>) {
    survey(tile);
    if review.is_some_and(|stamp| impressions::review(tile, stamp)) {
        survey(tile);
    }
}

/// Medians that stand on many pairs are kept until an eighth of the tile's cells has been added: they hardly move.
#[inline(always)]
fn survey(tile: &mut Tile) {
    let (known, sum) = census(&tile.height, &tile.margin);
    tile.known = known as u16;
    tile.ground = sum.checked_div(known).unwrap_or(0) as i16;
    if tile.pairs.iter().all(|pairs| u16::from(*pairs) >= SURE) && tile.known.abs_diff(tile.surveyed) < tile.known >> 3
    {
        return;
    }
    tile.surveyed = tile.known;
    let padded = Padded::of(tile);
    let (x, x_pairs) = median_rise::<true>(&padded);
    let (y, y_pairs) = median_rise::<false>(&padded);
    tile.own_rise = [x, y];
    tile.pairs = [x_pairs, y_pairs];
}

/// Known cells, and the sum of their heights.
#[inline(always)]
fn census(heights: &Rises, margins: &[u8; TILE_CELLS]) -> (i32, i32) {
    let mut known = [0; TILE_CELLS];
    let count = mark_known(margins, &mut known);
    (i32::from(count), sum(heights, &known))
}

/// One for each known cell; how many they are.
#[inline(always)]
fn mark_known(margins: &[u8; TILE_CELLS], known: &mut Rises) -> i16 {
    let mut count = 0;
    for (known, margin) in known.iter_mut().zip(margins) {
        *known = i16::from(*margin != 0);
        count += *known;
    }
    count
}

/// Sum of products: one instruction for eight cells. 256 x 32,000 stays within 31 bits.
#[inline(always)]
fn sum(heights: &Rises, known: &Rises) -> i32 {
    heights.iter().zip(known).map(|(height, known)| i32::from(*height) * i32::from(*known)).sum()
}

/// Heights with the gradient taken out, `NONE` where nothing is known; the lowest and the highest (at least 0).
#[inline(always)]
pub(super) fn level(heights: &Rises, margins: &[u8; TILE_CELLS], rise: [i16; 2], out: &mut Rises) -> [i16; 2] {
    let (mut lowest, mut highest) = ([NONE; TILE_SIDE], [0; TILE_SIDE]);
    let mut along = [0i16; TILE_SIDE];
    // Rises are at most STEEPEST: both products stay within 6,000.
    for (column, along) in along.iter_mut().enumerate() {
        *along = rise[0].wrapping_mul(column as i16 - 8);
    }
    let cells = heights.as_chunks::<TILE_SIDE>().0.iter().zip(margins.as_chunks::<TILE_SIDE>().0);
    for (row, ((heights, margins), out)) in cells.zip(out.as_chunks_mut::<TILE_SIDE>().0).enumerate() {
        let up = rise[1].wrapping_mul(row as i16 - 8);
        for column in 0..TILE_SIDE {
            let slope = along[column].wrapping_add(up) / SPAN as i16;
            let level = heights[column].saturating_sub(slope).clamp(-32_000, 32_000);
            let known = -i16::from(margins[column] != 0);
            let level = (level & known) | (NONE & !known);
            out[column] = level;
            lowest[column] = lowest[column].min(level);
            highest[column] = highest[column].max(level & known);
        }
    }
    [lowest.iter().copied().fold(NONE, i16::min), highest.iter().copied().fold(0, i16::max)]
}

pub(super) type Rises = [i16; TILE_CELLS];

/// Heights of a tile as the starts of differences and as their ends: unknown ones lie so far down, and up, that whatever differs from one differs by
/// more than the limit, as heights are within `HIGHEST`. Behind the ends as many unknown ones as the longest span reaches over the tile's.
struct Padded {
    starts: Rises,
    ends: [i16; TILE_CELLS + PAST],
}

/// Eight rows.
const PAST: usize = 8 * TILE_SIDE;

impl Padded {
    #[inline(always)]
    fn of(tile: &Tile) -> Self {
        let mut out = Self { starts: [0; TILE_CELLS], ends: [i16::MAX; TILE_CELLS + PAST] };
        if let Some(ends) = out.ends.first_chunk_mut() {
            spread(&tile.height, &tile.margin, &mut out.starts, ends);
        }
        out
    }
}

#[inline(always)]
fn spread(heights: &Rises, margins: &[u8; TILE_CELLS], starts: &mut Rises, ends: &mut Rises) {
    for cell in 0..TILE_CELLS {
        let known = -i16::from(margins[cell] != 0);
        starts[cell] = (heights[cell] & known) | (i16::MIN & !known);
        ends[cell] = (heights[cell] & known) | (i16::MAX & !known);
    }
}

/// Median of the rises over four cells along x (`ALONG`) or y, and how much it is worth: the pairs behind it, at most five for
/// each line that they begin on, at most 64. A sparse tile uses another span where that has more pairs.
///
/// Every line across the rise has the same vote, however many pairs begin on it. Far off, the face of a bump is hit by every ring while the road
/// before it is crossed here and there and the road behind it lies in its shadow: pair by pair, the face would be the tile's gradient.
#[inline(always)]
fn median_rise<const ALONG: bool>(padded: &Padded) -> (i16, u8) {
    let (mut held, mut tried) = ([0; TILE_CELLS], [0; TILE_CELLS]);
    let (mut held, mut tried) = (&mut held, &mut tried);
    let mut best = Found { pairs: 0, bounds: [0; 2] };
    let mut over = SPAN;
    for span in [SPAN, 8, 3] {
        let found = find::<ALONG>(padded, span, tried);
        if found.pairs > best.pairs {
            core::mem::swap(&mut held, &mut tried);
            (best, over) = (found, span);
        }
        if best.pairs >= 20 {
            break;
        }
    }
    if best.pairs == 0 {
        return (0, 0);
    }
    let rises = &*held;
    let (votes, total, lines) = votes::<ALONG>(rises);
    let at_most = |bound| weight_at_most(rises, &votes, bound);
    let median = i32::from(quantile(best.bounds, (total + 1) >> 1, at_most));
    let over_four = median * SPAN as i32 / over.max(1) as i32;
    (over_four as i16, best.pairs.min(5 * lines).min(MOST) as u8)
}

/// The vote of each pair: a line's 240 divided by its pairs, at most 60; their sum, and the lines that have pairs.
#[inline(always)]
fn votes<const ALONG: bool>(rises: &Rises) -> (Rises, u16, u16) {
    let mut counts = [0u16; TILE_SIDE];
    for (row, rises) in rises.as_chunks::<TILE_SIDE>().0.iter().enumerate() {
        if ALONG {
            for (count, rise) in counts.iter_mut().zip(rises) {
                *count += u16::from(*rise != NONE);
            }
        } else {
            counts[row & 15] = rises.iter().map(|rise| u16::from(*rise != NONE)).sum();
        }
    }
    let each = counts.map(|count| VOTES[usize::from(count) & 31]);
    let mut votes = [0; TILE_CELLS];
    for (row, out) in votes.as_chunks_mut::<TILE_SIDE>().0.iter_mut().enumerate() {
        *out = if ALONG { each } else { [each[row & 15]; TILE_SIDE] };
    }
    // 16 lines of 240 at most.
    let total = counts.iter().zip(each).map(|(count, each)| count * each as u16).sum();
    (votes, total, counts.iter().map(|count| u16::from(*count > 0)).sum())
}

/// 240 divided by the pairs of a line, of which there are at most 16; at most 60.
const VOTES: [i16; 32] = {
    let mut votes = [60; 32];
    let mut pairs = 5;
    while pairs < votes.len() {
        votes[pairs] = 240 / pairs as i16;
        pairs += 1;
    }
    votes
};

/// Pairs, and bounds of their rises.
struct Found {
    pairs: u16,
    bounds: [i16; 2],
}

#[inline(always)]
fn find<const ALONG: bool>(padded: &Padded, span: usize, out: &mut Rises) -> Found {
    let none = Found { pairs: 0, bounds: [0; 2] };
    let stride = if ALONG { 1 } else { TILE_SIDE };
    let Some(ends) = padded.ends.get(span * stride..).and_then(|ends| ends.first_chunk()) else { return none };
    let mut partner = [-1i16; TILE_SIDE];
    if ALONG {
        // The last columns have no partner in their own row.
        for (column, partner) in partner.iter_mut().enumerate() {
            *partner = -i16::from(column + span < TILE_SIDE);
        }
    }
    differences(&padded.starts, ends, &partner, STEEPEST / SPAN as i16 * span as i16, out)
}

/// Ends less starts where both are known, in the columns that have a partner, and they differ by no more than the limit.
#[inline(always)]
fn differences(starts: &Rises, ends: &Rises, partner: &[i16; TILE_SIDE], limit: i16, out: &mut Rises) -> Found {
    let (mut least, mut most, mut count) = ([0i16; TILE_SIDE], [0i16; TILE_SIDE], [0i16; TILE_SIDE]);
    for row in 0..TILE_SIDE {
        for column in 0..TILE_SIDE {
            let cell = TILE_SIDE * row + column;
            let difference = ends[cell].saturating_sub(starts[cell]);
            let sound = -i16::from(difference.min(limit).max(-limit) == difference) & partner[column];
            out[cell] = (difference & sound) | (NONE & !sound);
            least[column] = least[column].min(difference & sound);
            most[column] = most[column].max(difference & sound);
            count[column] -= sound;
        }
    }
    let bounds = [least.iter().copied().fold(0, i16::min), most.iter().copied().fold(0, i16::max)];
    Found { pairs: count.iter().sum::<i16>() as u16, bounds }
}

/// Smallest value within the bounds at or below which lies at least `share`, by bisection on the value: summing up is a branchless pass
/// over 256 words.
#[inline(always)]
pub(super) fn quantile([mut low, mut high]: [i16; 2], share: u16, at_most: impl Fn(i16) -> u16) -> i16 {
    while low < high {
        let middle = ((i32::from(low) + i32::from(high)) >> 1) as i16;
        if at_most(middle) >= share {
            high = middle;
        } else {
            low = middle + 1;
        }
    }
    low
}

#[inline(always)]
pub(super) fn at_most(values: &Rises, bound: i16) -> u16 {
    let mut count = 0i16;
    for value in values {
        count += i16::from(*value <= bound);
    }
    count as u16
}

#[inline(always)]
fn weight_at_most(values: &Rises, weights: &Rises, bound: i16) -> u16 {
    let mut sum = 0i16;
    for cell in 0..TILE_CELLS {
        sum += weights[cell] & -i16::from(values[cell] <= bound);
    }
    sum as u16
}

/// The gradient of a tile's plane, else the pooled medians of its neighbourhood: none where nothing around is known well enough.
pub(crate) fn pool(window: &Window<'_>, around: &Neighbours<'_>, key: TileKey) -> Option<[i16; 2]> {
    if let Some(plane) = around.tile(0, 0).and_then(|tile| tile.plane) {
        return Some(plane);
    }
    let mut near = Votes::<16>::NONE;
    for (place, tile) in around.iter().enumerate() {
        if let Some(tile) = tile {
            // The tile itself counts double.
            near.take(place, tile, if place == 4 { 2 } else { 1 });
        }
    }
    match [0, 1].map(|axis| near.median(axis, SURE)) {
        [Some(x), Some(y)] => Some([x, y]),
        near => pool_wide(window, key, near),
    }
}

/// The same of what the neighbourhood leaves open, from larger ones.
#[inline(never)]
fn pool_wide(window: &Window<'_>, key: TileKey, near: [Option<i16>; 2]) -> Option<[i16; 2]> {
    let mut wide = Votes::<56>::NONE;
    let mut out = [0i16; 2];
    for (axis, (out, mut found)) in out.iter_mut().zip(near).enumerate() {
        if found.is_none() {
            wide.gather::<2>(window, key);
            found = wide.median(axis, SURE);
        }
        if found.is_none() {
            wide.gather::<3>(window, key);
            found = wide.median(axis, ENOUGH);
        }
        *out = found?;
    }
    Some(out)
}

/// Gradients under which a tile's relief was looked at.
pub(crate) struct Tried<const N: usize> {
    rises: [[i16; 2]; N],
    count: usize,
}

impl<const N: usize> Tried<N> {
    pub(crate) fn first(rise: [i16; 2]) -> Self {
        Self { rises: [rise; N], count: 1 }
    }

    /// Whether a gradient is another than those before, and there is room for it among the first `most`: it is then one of them.
    pub(crate) fn add(&mut self, rise: [i16; 2], most: usize) -> bool {
        // Gradients that differ by less than 2.5 % (40 units over 0.4 m) are the same.
        let differs = |held: &[i16; 2]| held.iter().zip(rise).any(|(a, b)| a.saturating_sub(b).unsigned_abs() > 40);
        let fresh = self.rises.iter().take(self.count).all(differs);
        let Some(entry) = self.rises.get_mut(self.count).filter(|_| fresh && self.count < most) else { return false };
        *entry = rise;
        self.count += 1;
        true
    }

    /// Halfway between each two of the first three.
    pub(crate) fn between(&self) -> [Option<[i16; 2]>; 3] {
        let held = |at: usize| self.rises.get(at).filter(|_| at < self.count);
        [(0, 1), (0, 2), (1, 2)].map(|(a, b)| {
            let ([ax, ay], [bx, by]) = (held(a)?, held(b)?);
            Some([ax.midpoint(*bx), ay.midpoint(*by)])
        })
    }
}

/// Rises of up to `N` tiles along both axes, and what each weighs: nothing where there is no tile, or none with pairs.
struct Votes<const N: usize> {
    rise: [[i16; N]; 2],
    weight: [[i16; N]; 2],
    used: usize,
    reach: i32,
}

impl<const N: usize> Votes<N> {
    const NONE: Self = Self { rise: [[NONE; N]; 2], weight: [[0; N]; 2], used: 0, reach: 0 };

    /// Those of the tiles up to `REACH` away, unless it holds them already.
    fn gather<const REACH: i32>(&mut self, window: &Window<'_>, key: TileKey) {
        if self.reach == REACH {
            return;
        }
        (self.used, self.reach) = (0, REACH);
        self.weight = [[0; N]; 2];
        // The tile itself twice: it counts double.
        window.near::<REACH>(key, |tile| self.take_if_any(tile));
        window.near::<0>(key, |tile| self.take_if_any(tile));
    }

    /// Of a tile without pairs the place is taken again by the next; without weight it does not count.
    #[inline(always)]
    fn take_if_any(&mut self, tile: &Tile) {
        let place = self.used;
        self.take(place, tile, 1);
        self.used = place + usize::from(tile.plane.is_some() || tile.pairs != [0; 2]);
    }

    #[inline(always)]
    fn take(&mut self, place: usize, tile: &Tile, times: i16) {
        let (rises, pairs) = match tile.plane {
            Some(plane) => (plane, [MOST as u8; 2]),
            None => (tile.own_rise, tile.pairs),
        };
        for axis in 0..2 {
            if let (Some(rise), Some(weight)) = (self.rise[axis].get_mut(place), self.weight[axis].get_mut(place)) {
                *rise = rises[axis];
                *weight = i16::from(pairs[axis]) * times;
            }
        }
        self.used = place + 1;
    }

    /// The smallest rise that half of the weight lies at or below, if there is as much weight at all.
    fn median(&self, axis: usize, least: u16) -> Option<i16> {
        // To whole vectors: places that are not used have no weight.
        let whole = self.used.next_multiple_of(LANES);
        let rises = self.rise.get(axis)?.get(..whole)?;
        let weights = self.weight.get(axis)?.get(..whole)?;
        // Fifty times 64 at most.
        let total = weights.iter().sum::<i16>();
        (total >= least as i16).then(|| median(rises.as_chunks().0, weights.as_chunks().0, self.used, total))
    }
}

/// Words of a vector.
const LANES: usize = 8;

/// Of each rise is counted what lies at or below, which needs no branch and no order; one without weight never comes out, as the next smaller has
/// as much below it.
#[inline(always)]
fn median(rises: &[[i16; LANES]], weights: &[[i16; LANES]], used: usize, total: i16) -> i16 {
    let mut best = NONE;
    for rise in rises.as_flattened().iter().take(used) {
        let mut below = [0; LANES];
        for (others, weights) in rises.iter().zip(weights) {
            for lane in 0..LANES {
                below[lane] += weights[lane] & -i16::from(others[lane] <= *rise);
            }
        }
        let half = -i16::from(2 * below.iter().sum::<i16>() >= total);
        best = best.min((*rise & half) | (NONE & !half));
    }
    best
}
