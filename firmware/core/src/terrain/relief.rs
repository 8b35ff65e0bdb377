//! First-order differentiation that knows what the heights are worth.
//!
//! The relief of a cell is the largest height minus the smallest within 5 x 5 cells (3 x 3 where that holds less than three eighths of it, so
//! that an edge is not smeared over half a metre), the road's gradient taken out; every height
//! is drawn towards the other end by 0.7 sigma first, so a step must survive both intervals and noise alone gives none.
//! Where cells are empty the extremes of their neighbours flow in, at most three cells, through empty cells only: two
//! rings a metre apart meet, and a curb between known cells is not widened.
//!
//! Everything is i16 in rows of 32, which compilers turn into vector minima and maxima.

use super::tile::{TILE_SIDE, Tile, TileKey};
use super::window::Window;

/// Cells taken from the neighbours on each side: two of the window and three of the flow.
const HALO: usize = 5;
/// Rows of the work area.
const ROWS: usize = TILE_SIDE + 2 * HALO;
/// Columns of the work area, padded from 26 to whole vectors.
const WIDTH: usize = 32;
const FLOW: usize = 3;
const NO_HIGH: i16 = i16::MIN;
const NO_LOW: i16 = i16::MAX;

type Row = [i16; WIDTH];
type Plane = [Row; ROWS];

/// Heights and margins of a tile and its surroundings, above the tile's base.
pub(crate) struct Patch {
    height: Plane,
    margin: Plane,
    /// All ones where the cell is known, 0 where it is empty.
    known: Plane,
    all_known: bool,
    any_known: bool,
}

/// Relief of a tile's cells, quarter millimetres; below zero where nothing is known near.
pub(crate) type Relief = [[i16; TILE_SIDE]; TILE_SIDE];

impl Patch {
    pub(crate) fn gather(window: &Window<'_>, tile: &Tile) -> Self {
        let mut patch = Self {
            height: [[0; WIDTH]; ROWS],
            margin: [[0; WIDTH]; ROWS],
            known: [[0; WIDTH]; ROWS],
            all_known: true,
            any_known: false,
        };
        for (dy, rows) in [(-1, 0..HALO), (0, HALO..HALO + TILE_SIDE), (1, HALO + TILE_SIDE..ROWS)] {
            for (dx, columns) in
                [(-1, 0..HALO), (0, HALO..HALO + TILE_SIDE), (1, HALO + TILE_SIDE..2 * HALO + TILE_SIDE)]
            {
                let key = TileKey { x: tile.key.x.wrapping_add(dx), y: tile.key.y.wrapping_add(dy) };
                let Some(source) = window.tile(key).filter(|source| source.in_use) else {
                    patch.all_known = false;
                    continue;
                };
                let shift = source.base.saturating_sub(tile.base);
                if shift.abs() > 24_000 {
                    patch.all_known = false;
                    continue;
                }
                patch.copy(source, shift as i16, dx, dy, rows.clone(), columns);
            }
        }
        for (known, margins) in patch.known.iter_mut().zip(&patch.margin) {
            for (known, margin) in known.iter_mut().zip(margins) {
                *known = -i16::from(*margin != 0);
            }
        }
        patch
    }

    fn copy(
        &mut self,
        source: &Tile,
        shift: i16,
        dx: i32,
        dy: i32,
        rows: core::ops::Range<usize>,
        columns: core::ops::Range<usize>,
    ) {
        let first_row = if dy < 0 { TILE_SIDE - HALO } else { 0 };
        let first_column = if dx < 0 { TILE_SIDE - HALO } else { 0 };
        let heights = source.height.chunks_exact(TILE_SIDE).zip(source.margin.chunks_exact(TILE_SIDE));
        let targets = self.height.iter_mut().zip(self.margin.iter_mut()).skip(rows.start);
        let mut seen = (true, false);
        for ((heights, margins), (high, low)) in heights.skip(first_row).zip(targets).take(rows.len()) {
            let cells = heights.iter().zip(margins).skip(first_column);
            let out = high.iter_mut().zip(low.iter_mut()).skip(columns.start);
            for ((height, margin), (h, m)) in cells.zip(out).take(columns.len()) {
                *h = height.saturating_add(shift);
                *m = i16::from(*margin);
                seen = (seen.0 & (*margin != 0), seen.1 | (*margin != 0));
            }
        }
        self.all_known &= seen.0;
        self.any_known |= seen.1;
    }

    pub(crate) fn is_empty(&self) -> bool {
        !self.any_known
    }

    /// The relief when `rise` (over four cells, towards x and y) is taken out.
    pub(crate) fn relief(&self, rise: [i16; 2]) -> Relief {
        let mut high: Plane = [[NO_HIGH; WIDTH]; ROWS];
        let mut low: Plane = [[NO_LOW; WIDTH]; ROWS];
        let mut along = [0i16; WIDTH];
        for (column, value) in along.iter_mut().enumerate() {
            *value = (i32::from(rise[0]) * (column as i32 - 13) / 4) as i16;
        }
        let planes = self.height.iter().zip(&self.margin);
        for (row, ((heights, margins), (high, low))) in planes.zip(high.iter_mut().zip(low.iter_mut())).enumerate() {
            let up = (i32::from(rise[1]) * (row as i32 - 13) / 4) as i16;
            intervals(heights, margins, &along, up, high, low);
        }
        if !self.all_known {
            for _ in 0..FLOW {
                self.flow(&mut high, &mut low);
            }
        }
        let mut five: [(Row, Row); ROWS] = [([NO_HIGH; WIDTH], [NO_LOW; WIDTH]); ROWS];
        let mut three = five;
        for ((high, low), (five, three)) in high.iter().zip(&low).zip(five.iter_mut().zip(three.iter_mut())) {
            widen_five(high, low, &mut five.0, &mut five.1);
            widen_three(high, low, &mut three.0, &mut three.1);
        }
        let mut out = [[i16::MIN; TILE_SIDE]; TILE_SIDE];
        for (row, out) in out.iter_mut().enumerate() {
            // Rows row + 3 to row + 7 of the work area surround row + 5.
            let at = row + HALO;
            let five = [&five[at - 2], &five[at - 1], &five[at], &five[at + 1], &five[at + 2]];
            let three = [&three[at - 1], &three[at], &three[at + 1]];
            span(five, three, &high[at], out);
        }
        out
    }

    /// One step: empty cells take the extremes of their eight neighbours.
    fn flow(&self, high: &mut Plane, low: &mut Plane) {
        let mut wide: [(Row, Row); ROWS] = [([NO_HIGH; WIDTH], [NO_LOW; WIDTH]); ROWS];
        for ((high, low), wide) in high.iter().zip(low.iter()).zip(&mut wide) {
            widen_three(high, low, &mut wide.0, &mut wide.1);
        }
        for row in 0..ROWS {
            let around = [&wide[row.saturating_sub(1)], &wide[row], &wide[if row + 1 == ROWS { row } else { row + 1 }]];
            fill_empty(around, &self.known[row], &mut high[row], &mut low[row]);
        }
    }
}

// One row each, by reference and never inlined: as loops of their own over 32 words they become vector instructions
// (four of eight words even without AVX); inlined into the nest above, LLVM leaves them scalar, 30 times slower.

/// Heights less the gradient, drawn in by their margins.
#[inline(never)]
fn intervals(heights: &Row, margins: &Row, along: &Row, up: i16, high: &mut Row, low: &mut Row) {
    for column in 0..WIDTH {
        let level = heights[column].saturating_sub(along[column]).saturating_sub(up);
        let margin = margins[column];
        high[column] = if margin != 0 { level.saturating_sub(margin) } else { NO_HIGH };
        low[column] = if margin != 0 { level.saturating_add(margin) } else { NO_LOW };
    }
}

/// A row with two columns of nothing on each side, so that windows over it are whole vectors.
#[inline(always)]
fn padded(row: &Row, nothing: i16) -> [i16; WIDTH + 4] {
    let mut out = [nothing; WIDTH + 4];
    for (out, value) in out.iter_mut().skip(2).zip(row) {
        *out = *value;
    }
    out
}

#[inline(never)]
fn widen_three(high: &Row, low: &Row, top: &mut Row, bottom: &mut Row) {
    let (high, low) = (padded(high, NO_HIGH), padded(low, NO_LOW));
    for column in 0..WIDTH {
        top[column] = high[column + 1].max(high[column + 2]).max(high[column + 3]);
    }
    for column in 0..WIDTH {
        bottom[column] = low[column + 1].min(low[column + 2]).min(low[column + 3]);
    }
}

#[inline(never)]
fn widen_five(high: &Row, low: &Row, top: &mut Row, bottom: &mut Row) {
    let (high, low) = (padded(high, NO_HIGH), padded(low, NO_LOW));
    for column in 0..WIDTH {
        let (near, far) = (high[column + 1].max(high[column + 3]), high[column].max(high[column + 4]));
        top[column] = near.max(far).max(high[column + 2]);
    }
    for column in 0..WIDTH {
        let (near, far) = (low[column + 1].min(low[column + 3]), low[column].min(low[column + 4]));
        bottom[column] = near.min(far).min(low[column + 2]);
    }
}

#[inline(never)]
fn fill_empty(around: [&(Row, Row); 3], known: &Row, high: &mut Row, low: &mut Row) {
    let [above, here, below] = around;
    for column in 0..WIDTH {
        let top = above.0[column].max(here.0[column]).max(below.0[column]);
        let bottom = above.1[column].min(here.1[column]).min(below.1[column]);
        // Masked and not selected: LLVM turns a select of a stored value into a branch around the store.
        high[column] = (top & !known[column]) | (high[column] & known[column]);
        low[column] = (bottom & !known[column]) | (low[column] & known[column]);
    }
}

/// Largest minus smallest over 5 x 5 cells, or over 3 x 3 where that is less than three eighths of it: the edge is then further off
/// than a cell. `i16::MIN` where nothing is known and no neighbour reaches: nothing to judge.
#[inline(never)]
fn span(five: [&(Row, Row); 5], three: [&(Row, Row); 3], own: &Row, out: &mut [i16; TILE_SIDE]) {
    for (column, out) in out.iter_mut().enumerate() {
        let at = column + HALO;
        let [a, b, c, d, e] = five;
        let top = a.0[at].max(b.0[at]).max(c.0[at]).max(d.0[at]).max(e.0[at]);
        let bottom = a.1[at].min(b.1[at]).min(c.1[at]).min(d.1[at]).min(e.1[at]);
        let wide = top.saturating_sub(bottom).max(0);
        let [a, b, c] = three;
        let top = a.0[at].max(b.0[at]).max(c.0[at]);
        let bottom = a.1[at].min(b.1[at]).min(c.1[at]);
        let near = top.saturating_sub(bottom).max(0);
        let relief = if near >= (wide >> 1) - (wide >> 3) { wide } else { near };
        *out = if own[at] == NO_HIGH { i16::MIN } else { relief };
    }
}
