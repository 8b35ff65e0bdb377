//! First-order differentiation that knows what the heights are worth.
//!
//! The relief of a cell is the largest height minus the smallest within 5 x 5 cells, the road's gradient taken out; every height
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

type Plane = [[i16; WIDTH]; ROWS];

/// Heights and margins of a tile and its surroundings, above the tile's base.
pub(crate) struct Patch {
    height: Plane,
    /// 0 where nothing is known.
    margin: Plane,
    all_known: bool,
    any_known: bool,
}

/// Relief of a tile's cells, quarter millimetres; below zero where nothing is known near.
pub(crate) type Relief = [[i16; TILE_SIDE]; TILE_SIDE];

impl Patch {
    pub(crate) fn gather(window: &Window<'_>, tile: &Tile) -> Self {
        let mut patch =
            Self { height: [[0; WIDTH]; ROWS], margin: [[0; WIDTH]; ROWS], all_known: true, any_known: false };
        for (dy, rows) in [(-1, 0..HALO), (0, HALO..HALO + TILE_SIDE), (1, HALO + TILE_SIDE..ROWS)] {
            for (dx, columns) in [(-1, 0..HALO), (0, HALO..HALO + TILE_SIDE), (1, HALO + TILE_SIDE..2 * HALO + TILE_SIDE)]
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
        for (row, ((heights, margins), (high, low))) in
            planes.zip(high.iter_mut().zip(low.iter_mut())).enumerate()
        {
            let up = (i32::from(rise[1]) * (row as i32 - 13) / 4) as i16;
            for column in 0..WIDTH {
                let level = heights[column].saturating_sub(along[column]).saturating_sub(up);
                let margin = margins[column];
                let known = margin != 0;
                high[column] = if known { level.saturating_sub(margin) } else { NO_HIGH };
                low[column] = if known { level.saturating_add(margin) } else { NO_LOW };
            }
        }
        if !self.all_known {
            for _ in 0..FLOW {
                self.flow(&mut high, NO_HIGH, |a, b| if a > b { a } else { b });
                self.flow(&mut low, NO_LOW, |a, b| if a < b { a } else { b });
            }
        }
        let top = window_of_five(&high, NO_HIGH, |a, b| if a > b { a } else { b });
        let bottom = window_of_five(&low, NO_LOW, |a, b| if a < b { a } else { b });
        let mut out = [[i16::MIN; TILE_SIDE]; TILE_SIDE];
        let inner = top.iter().zip(&bottom).zip(high.iter()).skip(HALO);
        for (out, ((top, bottom), own)) in out.iter_mut().zip(inner) {
            let cells = top.iter().zip(bottom).zip(own.iter()).skip(HALO);
            for (out, ((top, bottom), own)) in out.iter_mut().zip(cells) {
                // Only cells that are known, or that neighbours reach: elsewhere there is nothing to judge.
                *out = if *own == NO_HIGH { i16::MIN } else { top.saturating_sub(*bottom).max(0) };
            }
        }
        out
    }

    /// One step: empty cells take the extreme of their eight neighbours.
    #[inline(always)]
    fn flow(&self, plane: &mut Plane, none: i16, pick: impl Fn(i16, i16) -> i16 + Copy) {
        let mut wide: Plane = [[none; WIDTH]; ROWS];
        for (wide, row) in wide.iter_mut().zip(plane.iter()) {
            for ((wide, three), _) in wide.iter_mut().skip(1).zip(row.windows(3)).zip(0..WIDTH - 2) {
                *wide = pick(pick(three[0], three[1]), three[2]);
            }
        }
        for row in 0..ROWS {
            let above = &wide[row.saturating_sub(1)];
            let here = &wide[row];
            let below = &wide[if row + 1 == ROWS { row } else { row + 1 }];
            let (out, margins) = (&mut plane[row], &self.margin[row]);
            for column in 0..WIDTH {
                let reached = pick(pick(above[column], here[column]), below[column]);
                // A select and not a branch: the store must be unconditional to become a vector store.
                out[column] = if margins[column] == 0 { reached } else { out[column] };
            }
        }
    }
}

/// Extreme over 5 x 5 cells, valid away from the border.
#[inline(always)]
fn window_of_five(plane: &Plane, none: i16, pick: impl Fn(i16, i16) -> i16 + Copy) -> Plane {
    let mut wide: Plane = [[none; WIDTH]; ROWS];
    for (wide, row) in wide.iter_mut().zip(plane) {
        for column in 0..WIDTH - 4 {
            let near = pick(row[column + 1], row[column + 3]);
            let far = pick(row[column], row[column + 4]);
            wide[column + 2] = pick(pick(near, far), row[column + 2]);
        }
    }
    let mut out: Plane = [[none; WIDTH]; ROWS];
    for row in 0..ROWS - 4 {
        for column in 0..WIDTH {
            let near = pick(wide[row + 1][column], wide[row + 3][column]);
            let far = pick(wide[row][column], wide[row + 4][column]);
            out[row + 2][column] = pick(pick(near, far), wide[row + 2][column]);
        }
    }
    out
}
