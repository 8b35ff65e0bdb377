//! Cells of the elevation map, in tiles of 16 x 16.
//!
//! A cell takes eight bytes: height, weight, margin, scatter, stamp and tall counter, each in a plane of its own so
//! that the differentiation reads whole rows of one quantity. Heights are quarter millimetres above the tile's own
//! datum, +/-7.75 m, which a 1.6 m tile cannot exceed; weights are 4096 / variance in mm^2, so that a weight of 16 is a
//! sigma of 16 mm and the cap of 4096 a sigma of 1 mm: capped, so that the map follows a road that changes.
//! Two more bytes hold what is derived from the cell: risk and class.

/// Cells along a tile's side.
pub const TILE_SIDE: usize = 16;
/// Cells in a tile.
pub const TILE_CELLS: usize = TILE_SIDE * TILE_SIDE;
/// Quarter millimetres in a metre: the unit of heights.
pub const UNITS_PER_M: f32 = 4000.0;
/// Weight of one square millimetre of variance.
pub(crate) const WEIGHT_ONE: f32 = 4096.0;
/// Largest weight of a cell: sigma 1 mm.
pub(crate) const WEIGHT_CAP: u16 = 4096;
/// Largest weight of a point, that of half a millimetre: the least that a configuration may ask for.
pub(crate) const HEAVIEST: f32 = 16_384.0;
/// Furthest from the tile's base, quarter millimetres: further from the ends of 16 bits than any rise that `slope` believes.
const HIGHEST: u32 = 31_000;
/// Base of a tile that is not in use: further from any height than `HIGHEST`.
const NO_BASE: i32 = i32::MIN;
/// A point this far from its cell is not the same surface, 0.25 m. One below it restarts the cell: what it held has gone.
const ANOTHER: u32 = 1000;
/// Scatter, in mm, from which a contradicted cell starts again.
const SCATTER_RESTART: u8 = 150;

/// Position of a tile in the world: its lowest corner divided by its side.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct TileKey {
    /// Towards east (world x).
    pub x: i32,
    /// Towards north (world y).
    pub y: i32,
}

/// What a risky place is.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
#[repr(u8)]
pub enum Class {
    /// Nothing a wheel would notice.
    #[default]
    Free = 0,
    /// A step up, seen from the vehicle.
    Curb = 1,
    /// Higher than the ground on both of its sides.
    Bump = 2,
    /// A step down, or a hole.
    Drop = 3,
    /// Risky, of no shape that can be told.
    Unknown = 4,
    /// Something that stands up from the ground by more than a wheel could be asked to climb.
    Tall = 5,
}

impl Class {
    /// The name in tables.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Free => "free",
            Self::Curb => "curb",
            Self::Bump => "bump",
            Self::Drop => "drop",
            Self::Unknown => "unknown",
            Self::Tall => "tall",
        }
    }

    /// The class stored in the low three bits of a byte.
    #[must_use]
    pub const fn from_bits(bits: u8) -> Self {
        match bits & 7 {
            0 => Self::Free,
            1 => Self::Curb,
            2 => Self::Bump,
            3 => Self::Drop,
            5 => Self::Tall,
            _ => Self::Unknown,
        }
    }
}

/// What only the update of a cell needs: side by side, so that a point touches three cache lines and not five.
#[derive(Clone, Copy)]
pub(crate) struct Held {
    /// 4096 / variance in mm^2.
    pub(crate) weight: u16,
    /// Running mean of |point - cell|, mm.
    pub(crate) scatter: u8,
    /// Low byte of the number of the frame that last touched the cell, or of one later that is long ago as well (`standing::forget_ages`).
    pub(crate) stamp: u8,
}

impl Held {
    const NOTHING: Self = Self { weight: 0, scatter: 0, stamp: 0 };
}

/// A tile of the map. 2.6 KB.
#[derive(Clone)]
pub struct Tile {
    pub(crate) key: TileKey,
    /// Height of the cells' zero, quarter millimetres above the map's datum.
    pub(crate) base: i32,
    /// Mean height of the known cells above the base, and how many there are (as of the last refresh).
    pub(crate) ground: i16,
    pub(crate) known: u16,
    /// Known cells when the medians were worked out.
    pub(crate) surveyed: u16,
    /// Median rise over four cells towards x and y within this tile, and the pairs behind each.
    pub(crate) own_rise: [i16; 2],
    pub(crate) pairs: [u8; 2],
    /// Rises over four cells of the plane that most of the tile's known cells lie on, if there is one. Only in a push broom's map.
    pub(crate) plane: Option<[i16; 2]>,
    /// The plane's, or the medians pooled over the neighbourhood: what the differentiation takes out.
    pub(crate) rise: [i16; 2],
    pub(crate) in_use: bool,
    pub(crate) dirty: bool,
    /// Risky, and a tile beside it has found its plane since. Only in a push broom's map.
    pub(crate) tell_again: bool,
    pub(crate) has_tall: bool,
    /// How often first impressions have been reviewed.
    pub(crate) reviewed: u8,
    /// Some cell's risk changed since the classes were told.
    pub(crate) unclassified: bool,
    pub(crate) height: [i16; TILE_CELLS],
    /// Seven tenths of the cell's sigma in quarter millimetres; 0 says that nothing is known.
    pub(crate) margin: [u8; TILE_CELLS],
    pub(crate) held: [Held; TILE_CELLS],
    pub(crate) tall: [u8; TILE_CELLS],
    pub(crate) risk: [u8; TILE_CELLS],
    /// Class in the low three bits, confidence 0-31 above.
    pub(crate) class: [u8; TILE_CELLS],
}

impl Tile {
    /// A tile that holds nothing.
    pub const EMPTY: Self = Self {
        key: TileKey { x: 0, y: 0 },
        base: NO_BASE,
        ground: 0,
        known: 0,
        surveyed: 0,
        own_rise: [0; 2],
        pairs: [0; 2],
        plane: None,
        rise: [0; 2],
        in_use: false,
        dirty: false,
        tell_again: false,
        has_tall: false,
        reviewed: 0,
        unclassified: false,
        height: [0; TILE_CELLS],
        margin: [0; TILE_CELLS],
        held: [Held::NOTHING; TILE_CELLS],
        tall: [0; TILE_CELLS],
        risk: [0; TILE_CELLS],
        class: [0; TILE_CELLS],
    };

    /// Whether risk is to be told anew.
    #[inline(always)]
    pub(crate) fn is_stale(&self) -> bool {
        self.dirty | self.tell_again
    }

    /// Forgets everything and takes a place.
    pub(crate) fn restart(&mut self, key: TileKey) {
        *self = Self::EMPTY;
        self.key = key;
    }

    /// Where the tile lies.
    #[must_use]
    pub fn key(&self) -> TileKey {
        self.key
    }

    /// Whether anything was ever written to it.
    #[must_use]
    pub fn in_use(&self) -> bool {
        self.in_use
    }

    /// A cell of the tile: `column` towards x, `row` towards y, both taken modulo 16.
    #[must_use]
    pub fn cell(&self, column: usize, row: usize) -> Cell {
        let index = (row & 15) << 4 | (column & 15);
        Cell {
            height: (self.margin[index] != 0).then(|| self.base.saturating_add(i32::from(self.height[index]))),
            weight: self.held[index].weight,
            scatter_mm: self.held[index].scatter,
            tall: self.tall[index] >= TALL_CERTAIN,
            risk: self.risk[index],
            class: Class::from_bits(self.class[index]),
            confidence: self.class[index] >> 3,
        }
    }

    /// Takes the tile into use for something that stands on ground that is not known.
    pub(crate) fn begin(&mut self) {
        if !self.in_use {
            (self.in_use, self.base) = (true, 0);
        }
    }

    /// Minimum-variance update of a cell with one point. `z` is above the map's datum, the weight 1 to `HEAVIEST`.
    #[inline(always)]
    pub(crate) fn fuse(&mut self, cell: u8, z: i32, weight: u32, by: &Update<'_>) {
        let index = usize::from(cell);
        let relative = z.wrapping_sub(self.base);
        // Both bounds at once: beyond either it is larger than twice the highest.
        if relative.wrapping_add(HIGHEST as i32) as u32 > 2 * HIGHEST {
            self.fuse_far(cell, z, weight, by);
            return;
        }
        self.dirty = true;
        let height = i32::from(self.height[index]);
        let difference = relative.wrapping_sub(height);
        let off = difference.unsigned_abs();
        let Held { weight: old, scatter, .. } = self.held[index];
        if old == 0 || off > ANOTHER {
            self.contradict(cell, relative, weight, by);
            return;
        }
        let sum = u32::from(old) + weight;
        // Half away from zero. off <= 1000 and weights of 15 bits: 26 bits; and it ends between the two heights.
        let step = (2 * off * weight + sum).checked_div(2 * sum).unwrap_or(0) as i32;
        // Between the two again: an eighth of the way.
        let spread = (i32::from(scatter) + (((off >> 2) as i32 - i32::from(scatter) + 4) >> 3)) as u8;
        let weight = sum.min(u32::from(WEIGHT_CAP)) as u16;
        self.held[index] = Held { weight, scatter: spread, stamp: by.stamp };
        self.height[index] = (if difference < 0 { height - step } else { height + step }) as i16;
        self.margin[index] = margin(weight, spread, by.margins);
    }

    /// A point far off the tile's base: it sets the base of a tile that has none. Else it is more than 7.75 m from the tile's first point, no ground
    /// of the same 1.6 m.
    #[inline(never)]
    fn fuse_far(&mut self, cell: u8, z: i32, weight: u32, by: &Update<'_>) {
        if !self.in_use {
            (self.in_use, self.base, self.dirty) = (true, z, true);
            self.contradict(cell, 0, weight, by);
        }
    }

    /// A point of a cell that is not known, or that is known to lie elsewhere.
    #[inline(never)]
    fn contradict(&mut self, cell: u8, height: i32, weight: u32, by: &Update<'_>) {
        let index = usize::from(cell);
        let held = &mut self.held[index];
        held.stamp = by.stamp;
        if held.weight != 0 && height > i32::from(self.height[index]) {
            // A cell made by a stray low point must not hold out against the ground above it for ever.
            held.scatter = held.scatter.saturating_add(60);
            if held.scatter <= SCATTER_RESTART {
                return;
            }
        }
        let weight = weight.min(u32::from(WEIGHT_CAP)) as u16;
        *held = Held { weight, scatter: 0, stamp: by.stamp };
        self.height[index] = height as i16;
        self.margin[index] = margin(weight, 0, by.margins);
    }

    /// Empties a cell.
    pub(crate) fn clear(&mut self, cell: u8) {
        let index = usize::from(cell);
        let held = &mut self.held[index];
        (held.weight, held.scatter) = (0, 0);
        self.margin[index] = 0;
        self.dirty = true;
    }
}

/// What the updates of a frame have in common.
pub(crate) struct Update<'a> {
    pub(crate) margins: &'a Margins,
    pub(crate) stamp: u8,
}

/// Tall hits from which a cell counts as tall: one may be dust.
pub(crate) const TALL_CERTAIN: u8 = 2;

/// 0.7 sigma in quarter millimetres by weight / 16.
pub(crate) type Margins = [u8; 512];

#[inline(always)]
fn margin(weight: u16, scatter: u8, margins: &Margins) -> u8 {
    margins[usize::from(weight >> 4) & 511].saturating_add(scatter)
}

/// Never 0, which means unknown. Below a weight of 16 it stays at 16 mm, above 4080 at 0.7 mm.
pub(crate) fn margin_table() -> Margins {
    let mut table = [45; 512];
    for (index, entry) in table.iter_mut().enumerate().skip(1) {
        let sigma_mm = libm::sqrtf(WEIGHT_ONE / (index.min(255) as f32 * 16.0 + 8.0));
        *entry = (0.7 * 4.0 * sigma_mm + 0.5).clamp(1.0, 255.0) as u8;
    }
    table
}

/// What the map knows of one place.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Cell {
    /// Quarter millimetres above the map's datum; none where no ground was seen.
    pub height: Option<i32>,
    /// 4096 / variance in mm^2.
    pub weight: u16,
    /// Running mean of the points' distance from the cell's height, mm.
    pub scatter_mm: u8,
    /// Something stands here.
    pub tall: bool,
    /// 0 to 255: driving risk 0 to 1.
    pub risk: u8,
    /// What it is.
    pub class: Class,
    /// How sure the class is, 0 to 31.
    pub confidence: u8,
}

impl Cell {
    /// Variance of the height, mm^2; none where no ground was seen.
    #[must_use]
    pub fn variance_mm2(&self) -> Option<f32> {
        self.height.is_some().then(|| WEIGHT_ONE / f32::from(self.weight.max(1)))
    }
}
