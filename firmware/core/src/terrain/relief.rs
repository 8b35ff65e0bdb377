//! First-order differentiation that knows what the heights are worth.
//!
//! The relief of a cell is the largest height minus the smallest within 5 x 5 cells (3 x 3 where that holds less than three eighths of it, so
//! that an edge is not smeared over half a metre), the road's gradient taken out; every height
//! is drawn towards the other end by 0.7 sigma first, so a step must survive both intervals and noise alone gives none.
//! Where cells are empty the extremes of their neighbours flow in, once, at most three cells far, through empty cells only:
//! two rings a metre apart meet, and a curb between known cells is not widened.
//!
//! Everything is i16 in rows of 64: the heights, and beside them the heights negated. A minimum is then a maximum like the
//! other, a relief the sum of two, and a row eight vectors of the smallest vector unit there is.

use super::tile::{TILE_SIDE, Tile};
use super::window::Neighbours;

/// Rows taken from the neighbours on each side: two of the window and three of the flow.
const HALO: usize = 5;
/// Rows of the work area.
const ROWS: usize = TILE_SIDE + 2 * HALO;
/// Columns taken on each side: a whole vector, of which five count.
const WING: usize = 8;
/// Columns of the work area.
const WIDTH: usize = TILE_SIDE + 2 * WING;
/// Less than any height, and than any height negated.
const NOTHING: i16 = i16::MIN;

/// On the bounds of vectors, so that these are operands as they lie in memory.
#[derive(Clone, Copy)]
#[repr(align(16))]
struct Half([i16; WIDTH]);
/// The columns that count.
const INSIDE: [i16; WIDTH] = {
    let mut inside = [-1; WIDTH];
    let mut column = 0;
    while column < WING - HALO {
        inside[column] = 0;
        inside[WIDTH - 1 - column] = 0;
        column += 1;
    }
    inside
};
/// Heights, then the same negated. Where one half ends, a window reaches into the other: a column a step of the flow and
/// two for the last, which the wings' three outermost columns on each side take up.
#[derive(Clone, Copy)]
#[repr(align(16))]
struct Row([i16; 2 * WIDTH]);

impl Row {
    const EMPTY: Self = Self([NOTHING; 2 * WIDTH]);
}

/// Where reliefs are worked out: rows, and two as they were before a step.
pub(crate) struct Bench {
    rows: [Row; ROWS],
    before: [Row; 2],
}

impl Bench {
    pub(crate) const EMPTY: Self = Self { rows: [Row::EMPTY; ROWS], before: [Row::EMPTY; 2] };
}

/// Heights and margins of a tile and its surroundings, above the tile's base.
pub(crate) struct Patch {
    height: [Half; ROWS],
    /// 0 where nothing is known.
    margin: [Half; ROWS],
    rows: [Census; ROWS],
    any_known: bool,
}

/// What a row holds.
#[derive(Clone, Copy)]
struct Census {
    /// A cell of it is empty.
    gap: bool,
    /// A cell of it is not.
    known: bool,
}

/// Relief of a tile's cells, quarter millimetres; below zero where nothing is known near.
pub(crate) type Relief = [[i16; TILE_SIDE]; TILE_SIDE];

impl Patch {
    pub(crate) fn gather(around: &Neighbours<'_>) -> Self {
        let mut patch = Self {
            height: [Half([0; WIDTH]); ROWS],
            margin: [Half([0; WIDTH]); ROWS],
            rows: [Census { gap: true, known: false }; ROWS],
            any_known: false,
        };
        let Some(tile) = around.tile(0, 0) else { return patch };
        let base = tile.base;
        for (dy, rows) in [(-1, 0..HALO), (0, HALO..HALO + TILE_SIDE), (1, HALO + TILE_SIDE..ROWS)] {
            let first = if dy < 0 { TILE_SIDE - HALO } else { 0 };
            let height = patch.height.get_mut(rows.clone()).unwrap_or_default();
            let margin = patch.margin.get_mut(rows).unwrap_or_default();
            copy::<WING, 0, { TILE_SIDE - WING }>(around.tile(-1, dy), base, first, height, margin);
            copy::<TILE_SIDE, WING, 0>(around.tile(0, dy), base, first, height, margin);
            copy::<WING, { WING + TILE_SIDE }, 0>(around.tile(1, dy), base, first, height, margin);
        }
        for (row, margin) in patch.rows.iter_mut().zip(&patch.margin) {
            *row = census(margin);
            patch.any_known |= row.known;
        }
        patch
    }

    pub(crate) fn is_empty(&self) -> bool {
        !self.any_known
    }

    /// The relief when `rise` (over four cells, towards x and y) is taken out, and the largest of it.
    pub(crate) fn relief(&self, rise: [i16; 2], bench: &mut Bench) -> (Relief, i16) {
        let mut along = Half([0; WIDTH]);
        for (column, value) in along.0.iter_mut().enumerate() {
            *value = (i32::from(rise[0]) * (column as i32 - 16) / 4) as i16;
        }
        for (row, ((heights, margins), out)) in self.height.iter().zip(&self.margin).zip(&mut bench.rows).enumerate() {
            let up = (i32::from(rise[1]) * (row as i32 - 13) / 4) as i16;
            intervals(heights, margins, &along, up, out);
        }
        // Each step a row less far out than the one before: what lies further cannot reach the tile any more.
        let mut rows = self.rows;
        for edge in 1..=3 {
            flow(bench, &mut rows, edge);
        }
        let mut out = [[NOTHING; TILE_SIDE]; TILE_SIDE];
        let mut largest = [NOTHING; TILE_SIDE];
        for (window, out) in bench.rows.windows(5).skip(HALO - 2).zip(&mut out) {
            if let [a, b, c, d, e] = window {
                span([a, b, c, d, e], out, &mut largest);
            }
        }
        (out, largest.iter().copied().fold(NOTHING, i16::max))
    }
}

/// One step: cells that are still empty take the extremes of their eight neighbours, in all but the `edge` outermost rows. A row that changes
/// leaves behind what it was for the one below.
fn flow(bench: &mut Bench, rows: &mut [Census; ROWS], edge: usize) {
    let [mut before, mut now] = bench.before.each_mut();
    let mut changed = false;
    let known_before = rows.map(|row| row.known);
    for row in edge..ROWS - edge {
        let near = bench.rows.get_mut(row - 1..).and_then(|rows| rows.first_chunk_mut());
        let known = known_before.get(row - 1..).and_then(|known| known.first_chunk());
        let (Some([above, here, below]), Some(known), Some(row)) = (near, known, rows.get_mut(row)) else { return };
        // Where nothing is near nothing flows in.
        let fills = row.gap && *known != [false; 3];
        if fills {
            *row = fill_empty(if changed { before } else { above }, here, below, now);
            core::mem::swap(&mut before, &mut now);
        }
        changed = fills;
    }
}

/// `COUNT` columns of a tile from column `FROM` on to the work area's from `TO` on, row by row from `first` on.
fn copy<const COUNT: usize, const TO: usize, const FROM: usize>(
    source: Option<&Tile>,
    base: i32,
    first: usize,
    height: &mut [Half],
    margin: &mut [Half],
) {
    let Some(source) = source.filter(|source| source.in_use) else { return };
    let shift = source.base.saturating_sub(base);
    // 6 m from tile to tile is no ground.
    if shift.abs() > 24_000 {
        return;
    }
    let sources = source.height.as_chunks::<TILE_SIDE>().0.iter().zip(source.margin.as_chunks::<TILE_SIDE>().0);
    for ((heights, margins), (height, margin)) in sources.skip(first).zip(height.iter_mut().zip(margin)) {
        lift::<COUNT, TO, FROM>(heights, margins, shift as i16, height, margin);
    }
}

// One row each, by reference and never inlined: as loops of their own over whole rows they become vector instructions
// (four of eight words even without AVX); inlined into the nest above, LLVM leaves them scalar, 30 times slower.

#[inline(never)]
fn census(Half(margin): &Half) -> Census {
    let (mut gap, mut known) = (0, 0);
    for column in 0..WIDTH {
        gap |= -i16::from(margin[column] == 0) & INSIDE[column];
        known |= margin[column] & INSIDE[column];
    }
    Census { gap: gap != 0, known: known != 0 }
}

#[inline(never)]
fn lift<const COUNT: usize, const TO: usize, const FROM: usize>(
    heights: &[i16; TILE_SIDE],
    margins: &[u8; TILE_SIDE],
    shift: i16,
    Half(height): &mut Half,
    Half(margin): &mut Half,
) {
    for column in 0..COUNT {
        height[TO + column] = heights[FROM + column].saturating_add(shift);
        margin[TO + column] = i16::from(margins[FROM + column]);
    }
}

/// Heights less the gradient, and the same negated, both drawn in by their margins.
#[inline(never)]
fn intervals(Half(heights): &Half, Half(margins): &Half, Half(along): &Half, up: i16, Row(out): &mut Row) {
    for column in 0..WIDTH {
        let level = heights[column].saturating_sub(along[column]).saturating_sub(up);
        let margin = margins[column];
        let known = -i16::from(margin != 0);
        out[column] = (level.saturating_sub(margin) & known) | (NOTHING & !known);
        out[WIDTH + column] = (0i16.saturating_sub(level).saturating_sub(margin) & known) | (NOTHING & !known);
    }
}

/// A row's maxima over three, with a vector of nothing more on each side.
#[repr(align(16))]
struct Tallest([i16; WING + 2 * WIDTH + WING]);

/// Fills a row, and keeps it as it was.
#[inline(never)]
fn fill_empty(Row(above): &Row, Row(here): &mut Row, Row(below): &Row, Row(before): &mut Row) -> Census {
    let mut tallest = Tallest([NOTHING; WING + 2 * WIDTH + WING]);
    let Tallest(tallest) = &mut tallest;
    for column in 0..2 * WIDTH {
        before[column] = here[column];
        tallest[WING + column] = here[column].max(above[column]).max(below[column]);
    }
    let (mut left, mut known) = (0, 0);
    for column in 0..WIDTH {
        let empty = -i16::from(before[column] == NOTHING);
        let three = |at: usize| tallest[at].max(tallest[at - 1]).max(tallest[at + 1]);
        let (high, low) = (three(WING + column), three(WING + WIDTH + column));
        // Masked and not selected: LLVM turns a select of a stored value into a branch around the store.
        let filled = (high & empty) | (before[column] & !empty);
        here[column] = filled;
        here[WIDTH + column] = (low & empty) | (before[WIDTH + column] & !empty);
        let nothing = -i16::from(filled == NOTHING);
        left |= nothing & INSIDE[column];
        known |= !nothing & INSIDE[column];
    }
    Census { gap: left != 0, known: known != 0 }
}

/// Largest minus smallest over 5 x 5 cells, or over 3 x 3 where that is less than three eighths of it: the edge is then further off
/// than a cell. `i16::MIN` where nothing is known and no neighbour reaches: nothing to judge.
#[inline(never)]
fn span(
    [Row(a), Row(b), Row(c), Row(d), Row(e)]: [&Row; 5],
    out: &mut [i16; TILE_SIDE],
    largest: &mut [i16; TILE_SIDE],
) {
    let (mut three, mut five) = (Row::EMPTY, Row::EMPTY);
    let (Row(three), Row(five)) = (&mut three, &mut five);
    for column in 0..2 * WIDTH {
        three[column] = b[column].max(c[column]).max(d[column]);
        five[column] = three[column].max(a[column]).max(e[column]);
    }
    for (column, (risen, largest)) in out.iter_mut().zip(largest).enumerate() {
        let at = WING + column;
        let over_five = |at: usize| {
            let (near, far) = (five[at - 1].max(five[at + 1]), five[at - 2].max(five[at + 2]));
            near.max(far).max(five[at])
        };
        let over_three = |at: usize| three[at - 1].max(three[at]).max(three[at + 1]);
        let wide = over_five(at).saturating_add(over_five(WIDTH + at)).max(0);
        let near = over_three(at).saturating_add(over_three(WIDTH + at)).max(0);
        let far_edge = -i16::from(near < (wide >> 1) - (wide >> 3));
        let relief = (near & far_edge) | (wide & !far_edge);
        let nothing = -i16::from(c[at] == NOTHING);
        *risen = (NOTHING & nothing) | (relief & !nothing);
        *largest = (*largest).max(*risen);
    }
}
