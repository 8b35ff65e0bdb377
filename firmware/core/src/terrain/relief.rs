//! First-order differentiation that knows what the heights are worth.
//!
//! The relief of a cell is the largest height minus the smallest within 5 x 5 cells (3 x 3 where that holds less than three eighths of it, so
//! that an edge is not smeared over half a metre), the road's gradient taken out; every height
//! is drawn towards the other end by 0.7 sigma first, so a step must survive both intervals and noise alone gives none.
//! Where cells are empty the extremes of their neighbours flow in, once, at most three cells far, through empty cells only:
//! two rings a metre apart meet, and a curb between known cells is not widened.
//!
//! Everything is i16 in rows: the heights, and behind them the heights negated. A minimum is then a maximum like the
//! other, a relief the sum of two, and a row seven vectors of the smallest vector unit there is.

use super::tile::{TILE_SIDE, Tile};
use super::window::Neighbours;

/// Rows taken from the neighbours on each side: two of the window and three of the flow.
const HALO: usize = 5;
/// Rows of the work area.
const ROWS: usize = TILE_SIDE + 2 * HALO;
/// Columns of the work area.
const COLUMNS: usize = TILE_SIDE + 2 * HALO;
/// Columns taken on each side: a whole vector, of which five count.
const WING: usize = 8;
/// Columns taken, and a vector more to read on from the fourth.
const WIDTH: usize = 2 * WING + TILE_SIDE + WING;
/// Less than any height, and than any height negated.
const NOTHING: i16 = i16::MIN;

/// Heights or margins of a row, its wings included. On the bounds of vectors, so that these are operands as they lie in memory.
#[derive(Clone, Copy)]
#[repr(align(32))]
struct Half([i16; WIDTH]);

/// What is read of a row in whole vectors: two halves.
const USED: usize = (2 * COLUMNS).next_multiple_of(16);
/// Whole vectors that hold a half.
const WHOLE: usize = COLUMNS.next_multiple_of(8);
/// Heights less the gradient, from a column on the same negated; both drawn in by their margins. Where one half ends a window reaches into the other:
/// a column a step of the flow and two for the last, which is what each step needs less of.
#[derive(Clone, Copy)]
#[repr(align(32))]
struct Row([i16; USED + 8]);

impl Row {
    const EMPTY: Self = Self([NOTHING; USED + 8]);
}

/// Columns of the heights in which a step of the flow has something to fill, by steps.
type Mask = [i16; WHOLE];
const INSIDE: [Mask; 4] = [inside(0), inside(1), inside(2), inside(3)];

const fn inside(edge: usize) -> Mask {
    let mut inside = [0; WHOLE];
    let mut column = edge;
    while column < COLUMNS - edge {
        inside[column] = -1;
        column += 1;
    }
    inside
}

/// Where a tile's relief is worked out: heights and margins of the tile and its surroundings, above the tile's base, and what becomes of them.
pub(crate) struct Patch {
    height: [Half; ROWS],
    /// 0 where nothing is known.
    margin: [Half; ROWS],
    /// Whether a row has empty cells.
    gaps: [bool; ROWS],
    rows: [Row; ROWS],
    tallest: [Tallest; ROWS],
    /// The same of the tile's rows, over five.
    five: [Tallest; TILE_SIDE],
}

/// Relief of a tile's cells, quarter millimetres; below zero where nothing is known near.
pub(crate) type Relief = [[i16; TILE_SIDE]; TILE_SIDE];

impl Patch {
    pub(crate) const EMPTY: Self = Self {
        height: [Half([0; WIDTH]); ROWS],
        margin: [Half([0; WIDTH]); ROWS],
        gaps: [false; ROWS],
        rows: [Row::EMPTY; ROWS],
        tallest: [Tallest::EMPTY; ROWS],
        five: [Tallest::EMPTY; TILE_SIDE],
    };

    /// Takes a tile and its surroundings in; whether anything is known of them.
    #[inline(always)]
    pub(crate) fn gather(&mut self, around: &Neighbours<'_>) -> bool {
        // Heights without a margin do not count.
        self.margin = [Half([0; WIDTH]); ROWS];
        let Some(tile) = around.tile(0, 0) else { return false };
        let base = tile.base;
        for (dy, rows) in [(-1, 0..HALO), (0, HALO..HALO + TILE_SIDE), (1, HALO + TILE_SIDE..ROWS)] {
            let first = if dy < 0 { TILE_SIDE - HALO } else { 0 };
            let height = self.height.get_mut(rows.clone()).unwrap_or_default();
            let margin = self.margin.get_mut(rows).unwrap_or_default();
            copy::<WING, 0, { TILE_SIDE - WING }>(around.tile(-1, dy), base, first, height, margin);
            copy::<TILE_SIDE, WING, 0>(around.tile(0, dy), base, first, height, margin);
            copy::<WING, { WING + TILE_SIDE }, 0>(around.tile(1, dy), base, first, height, margin);
        }
        let mut any_known = false;
        for (gaps, margin) in self.gaps.iter_mut().zip(&self.margin) {
            let (gap, known) = census(margin);
            *gaps = gap;
            any_known |= known;
        }
        any_known
    }

    /// The relief when `rise` (over four cells, towards x and y) is taken out, and the largest of it.
    #[inline(always)]
    pub(crate) fn relief(&mut self, rise: [i16; 2], out: &mut Relief) -> i16 {
        let mut along = [0i16; WHOLE];
        for (column, value) in along.iter_mut().enumerate() {
            *value = (i32::from(rise[0]) * (column as i32 - 13) / 4) as i16;
        }
        for (row, ((heights, margins), out)) in self.height.iter().zip(&self.margin).zip(&mut self.rows).enumerate() {
            let up = (i32::from(rise[1]) * (row as i32 - 13) / 4) as i16;
            intervals(heights, margins, &along, up, out);
        }
        // Each step a row less far out than the one before: what lies further cannot reach the tile any more.
        let mut gaps = self.gaps;
        self.flow::<1>(&mut gaps);
        self.flow::<2>(&mut gaps);
        self.flow::<3>(&mut gaps);
        let tallest = self.tallest.iter_mut().skip(HALO).zip(&mut self.five);
        for (window, (three, five)) in self.rows.windows(5).skip(HALO - 2).zip(tallest) {
            if let [a, b, c, d, e] = window {
                over_three(b, c, d, three);
                over_five(a, three, e, five);
            }
        }
        let mut largest = [NOTHING; TILE_SIDE];
        let rows = self.rows.iter().zip(&self.tallest).skip(HALO).zip(&self.five);
        for (((row, three), five), out) in rows.zip(out) {
            span(row, three, five, out, &mut largest);
        }
        largest.iter().copied().fold(NOTHING, i16::max)
    }

    /// One step: cells that are still empty take the extremes of their eight neighbours, in all but the `EDGE` outermost rows. Maxima over three rows
    /// first, of all rows as they are, then those over three columns: read back at once from between two writes they would be waited for.
    #[inline(always)]
    fn flow<const EDGE: usize>(&mut self, gaps: &mut [bool; ROWS]) {
        if gaps.iter().all(|gap| !*gap) {
            return;
        }
        let tallest = self.tallest.iter_mut().skip(EDGE).take(ROWS - 2 * EDGE);
        for (near, tallest) in self.rows.windows(3).skip(EDGE - 1).zip(tallest) {
            if let [above, here, below] = near {
                over_three(above, here, below, tallest);
            }
        }
        for row in EDGE..ROWS - EDGE {
            let (gap, tallest, row) = (gaps.get_mut(row), self.tallest.get(row), self.rows.get_mut(row));
            if let (Some(gap @ true), Some(tallest), Some(row)) = (gap, tallest, row) {
                *gap = fill_empty(tallest, row, &INSIDE[EDGE]);
            }
        }
    }
}

/// `COUNT` columns of a tile from column `FROM` on to the work area's from `TO` on, row by row from `first` on.
#[inline(always)]
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

// One row each, by reference. All of it is one function for each kind of vectors (`Vectors::run`).

/// Whether a row has empty cells that a first step fills, and known ones.
#[inline(always)]
fn census(Half(margin): &Half) -> (bool, bool) {
    let (mut gap, mut known) = (0, 0);
    for column in 0..WHOLE {
        let margin = margin[WING - HALO + column];
        gap |= -i16::from(margin == 0) & INSIDE[1][column];
        known |= margin & INSIDE[0][column];
    }
    (gap != 0, known != 0)
}

#[inline(always)]
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
#[inline(always)]
fn intervals(Half(heights): &Half, Half(margins): &Half, along: &Mask, up: i16, Row(out): &mut Row) {
    let mut low = [NOTHING; WHOLE];
    for column in 0..WHOLE {
        let at = WING - HALO + column;
        let level = heights[at].saturating_sub(along[column]).saturating_sub(up);
        let margin = margins[at];
        let known = -i16::from(margin != 0);
        out[column] = (level.saturating_sub(margin) & known) | (NOTHING & !known);
        low[column] = (0i16.saturating_sub(level).saturating_sub(margin) & known) | (NOTHING & !known);
    }
    // Over what was too much of the first half.
    if let Some(half) = out.get_mut(COLUMNS..).and_then(|rest| rest.first_chunk_mut()) {
        *half = low;
    }
}

/// Maxima over three rows, with a vector of nothing more on each side.
#[derive(Clone, Copy)]
#[repr(align(32))]
struct Tallest([i16; 8 + USED + 8]);

impl Tallest {
    const EMPTY: Self = Self([NOTHING; 8 + USED + 8]);
}

#[inline(always)]
fn over_three(Row(above): &Row, Row(here): &Row, Row(below): &Row, Tallest(tallest): &mut Tallest) {
    for column in 0..USED {
        tallest[8 + column] = here[column].max(above[column]).max(below[column]);
    }
}

#[inline(always)]
fn over_five(Row(first): &Row, Tallest(three): &Tallest, Row(last): &Row, Tallest(tallest): &mut Tallest) {
    for column in 0..USED {
        tallest[8 + column] = three[8 + column].max(first[column]).max(last[column]);
    }
}

/// Fills a row; whether it has empty cells that the next step fills.
#[inline(always)]
fn fill_empty(Tallest(tallest): &Tallest, Row(row): &mut Row, inside: &Mask) -> bool {
    for column in 0..USED {
        let empty = -i16::from(row[column] == NOTHING);
        let most = tallest[8 + column].max(tallest[7 + column]).max(tallest[9 + column]);
        // Masked and not selected: LLVM turns a select of a stored value into a branch around the store.
        row[column] = (most & empty) | (row[column] & !empty);
    }
    let mut left = 0;
    for column in 0..WHOLE {
        left |= -i16::from(row[column] == NOTHING) & inside[column];
    }
    left != 0
}

/// Largest minus smallest over 5 x 5 cells, or over 3 x 3 where that is less than three eighths of it: the edge is then further off
/// than a cell. `i16::MIN` where nothing is known and no neighbour reaches: nothing to judge.
#[inline(always)]
fn span(
    Row(row): &Row,
    Tallest(three): &Tallest,
    Tallest(five): &Tallest,
    out: &mut [i16; TILE_SIDE],
    largest: &mut [i16; TILE_SIDE],
) {
    // In arrays of its own, which nothing else can be.
    let (mut risen, mut most) = ([NOTHING; TILE_SIDE], *largest);
    for column in 0..TILE_SIDE {
        let at = 8 + HALO + column;
        let over_five = |at: usize| {
            let (near, far) = (five[at - 1].max(five[at + 1]), five[at - 2].max(five[at + 2]));
            near.max(far).max(five[at])
        };
        let over_three = |at: usize| three[at - 1].max(three[at]).max(three[at + 1]);
        let wide = over_five(at).saturating_add(over_five(COLUMNS + at)).max(0);
        let near = over_three(at).saturating_add(over_three(COLUMNS + at)).max(0);
        let far_edge = -i16::from(near < (wide >> 1) - (wide >> 3));
        let relief = (near & far_edge) | (wide & !far_edge);
        let nothing = -i16::from(row[HALO + column] == NOTHING);
        risen[column] = (NOTHING & nothing) | (relief & !nothing);
        most[column] = most[column].max(risen[column]);
    }
    (*out, *largest) = (risen, most);
}
