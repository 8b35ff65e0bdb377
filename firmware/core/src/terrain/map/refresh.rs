//! Tells gradient, relief, risk and class of tiles from their heights: in a frame those whose turn it is, at the end all.

use super::TerrainMap;
use crate::terrain::classify::{Outlook, classify};
use crate::terrain::geometry::Pose;
use crate::terrain::plane;
use crate::terrain::relief::{Patch, Relief};
use crate::terrain::risk::{RiskTable, SLOW};
use crate::terrain::slope::{Tried, measure, pool};
use crate::terrain::tile::{TALL_CERTAIN, TILE_CELLS, TILE_SIDE, Tile, TileKey};
use crate::terrain::vectors::Vectors;
use crate::terrain::window::Neighbours;

/// Beyond this, 20 m, a tile's risk is told half as often: at any speed there is time for it, and most tiles lie there.
const FAR_UM: i64 = 20_000_000;

/// The tiles whose gradients may explain a tile's heights.
const BESIDE: [(i32, i32); 4] = [(-1, 0), (1, 0), (0, -1), (0, 1)];

impl<V: Vectors> TerrainMap<'_, V> {
    /// Tells the slopes and risks of the tiles whose turn it is; how many.
    pub(super) fn refresh_in_turn(&mut self) -> u32 {
        let every = u32::from(self.config.refresh_every.max(1));
        let first = match self.frame.checked_rem(every) {
            None | Some(0) => 0,
            Some(past) => every - past,
        };
        let due = self.schedule();
        self.refresh((first, every), due)
    }

    /// Brings risk and classes up to date of the tiles that a frame with this pose will hand over as retired. Callers who
    /// keep them call it before that frame; the others save themselves the work.
    pub fn finish_leaving(&mut self, pose: &Pose) {
        let origin = self.origin_at(pose);
        if self.frame == 0 || origin == self.window.origin {
            return;
        }
        let side = u32::from(self.window.side);
        let leaves = move |key: TileKey| {
            key.x.wrapping_sub(origin.x) as u32 >= side || key.y.wrapping_sub(origin.y) as u32 >= side
        };
        self.refresh((0, 1), |_, tile| tile.is_stale() && leaves(tile.key));
        for slot in 0..self.window.tiles.len() {
            if self.window.tiles.get(slot).is_some_and(|tile| leaves(tile.key)) {
                self.classify_slot(slot);
            }
        }
    }

    /// Tells gradient, relief, risk and class of every tile anew, so that all of them stand on the same heights.
    pub fn refresh_all(&mut self) {
        for tile in self.window.tiles.iter_mut() {
            tile.dirty = tile.in_use;
        }
        self.refresh((0, 1), |_, tile| tile.dirty);
        for slot in 0..self.window.tiles.len() {
            self.classify_slot(slot);
        }
    }

    /// Which tiles are told anew in this frame: every so manyth, and of those far off every other.
    fn schedule(&self) -> impl Fn(usize, &Tile) -> bool + use<V> {
        let every = u32::from(self.config.refresh_every.max(1));
        let frame = self.frame;
        let tile_um = self.cell_um.wrapping_mul(16).max(1);
        let key = |axis: usize| {
            let position = self.sensor_um.get(axis).copied().unwrap_or(0);
            position.div_euclid(tile_um) as i32
        };
        let here = TileKey { x: key(0), y: key(1) };
        let near = FAR_UM.checked_div(tile_um).unwrap_or(0) as u32;
        move |slot, tile| {
            let far = tile.key.x.abs_diff(here.x).max(tile.key.y.abs_diff(here.y)) > near;
            let every = if far { 2 * every } else { every };
            tile.is_stale() && (slot as u32).wrapping_add(frame).checked_rem(every) == Some(0)
        }
    }

    /// Tells the tiles that are due anew, of every `step`th slot from `first` on; how many they were.
    fn refresh(&mut self, (first, step): (u32, u32), due: impl Fn(usize, &Tile) -> bool) -> u32 {
        let unit = self.unit;
        let (first, step) = (first as usize, (step as usize).max(1));
        let push_broom = self.config.push_broom;
        let review = (!push_broom).then(|| self.stamp());
        for (slot, tile) in self.window.tiles.iter_mut().enumerate().skip(first).step_by(step) {
            if due(slot, tile) {
                unit.run(|| measure(tile, review));
                if push_broom {
                    plane::fit(tile);
                }
            }
        }
        let mut refreshed = 0;
        let mut patch = Patch::EMPTY;
        let mut relief = [[0; TILE_SIDE]; TILE_SIDE];
        for slot in (first..self.window.tiles.len()).step_by(step) {
            let Some(tile) = self.window.tiles.get(slot) else { continue };
            if !due(slot, tile) {
                continue;
            }
            let around = self.window.around(tile.key);
            let rise = pool(&self.window, &around, tile.key);
            let told = match rise {
                Some(rise) if unit.run(|| patch.gather(&around)) => {
                    relief_on_slopes(&mut patch, &around, rise, push_broom, &mut relief, unit);
                    true
                }
                _ => false,
            };
            if let Some(tile) = self.window.tiles.get_mut(slot) {
                let brings_plane = tile.dirty && tile.plane.is_some();
                (tile.dirty, tile.tell_again) = (false, false);
                tile.rise = rise.unwrap_or(tile.rise);
                store(tile, told.then_some(&relief), &self.table, unit);
                refreshed += 1;
                if brings_plane {
                    let key = tile.key;
                    self.tell_again_beside(key);
                }
            }
        }
        refreshed
    }

    /// Risky tiles beside one are told again: its plane, which they may not have known, may explain them.
    fn tell_again_beside(&mut self, key: TileKey) {
        for (dx, dy) in BESIDE {
            let beside = TileKey { x: key.x.wrapping_add(dx), y: key.y.wrapping_add(dy) };
            if let Some(tile) = self.window.tile_mut(beside) {
                tile.tell_again |= tile.in_use && tile.risk.iter().any(|risk| *risk >= SLOW);
            }
        }
    }

    fn classify_slot(&mut self, slot: usize) {
        let Some(tile) = self.window.tiles.get(slot) else { return };
        if !tile.in_use || !tile.unclassified {
            return;
        }
        let tile_um = self.cell_um.wrapping_mul(16).max(1);
        let from_corner = |axis: usize, key: i32| {
            let corner = tile_um.wrapping_mul(i64::from(key));
            let position = self.sensor_um.get(axis).copied().unwrap_or(0);
            position.wrapping_sub(corner) as f32 / self.cell_um.max(1) as f32
        };
        let at = [from_corner(0, tile.key.x), from_corner(1, tile.key.y)];
        let classes = classify(&self.window, tile, Outlook { at, forward: self.forward });
        if let Some(tile) = self.window.tiles.get_mut(slot) {
            tile.class = classes;
            tile.unclassified = false;
        }
    }
}

/// Relief under the tile's gradient, or under a neighbour's where that explains the heights better: where a ramp
/// begins, half of a tile lies on one slope and half on the other, and neither is a step. In a push broom's map, where the relief reaches over half a
/// metre to the next line, also under gradients between two of these: across the hinge of a slope each of both is off on one side.
fn relief_on_slopes(
    patch: &mut Patch,
    around: &Neighbours<'_>,
    rise: [i16; 2],
    push_broom: bool,
    relief: &mut Relief,
    unit: impl Vectors,
) {
    // 3 cm: below it nothing asks to slow down.
    if unit.run(|| patch.relief(rise, relief)) < 120 {
        return;
    }
    let mut again = [[0; TILE_SIDE]; TILE_SIDE];
    let mut tried = Tried::first(rise);
    let mut try_also = |tried: &mut Tried<8>, rise, most| {
        if tried.add(rise, most) {
            unit.run(|| patch.relief(rise, &mut again));
            for (held, new) in relief.as_flattened_mut().iter_mut().zip(again.as_flattened()) {
                *held = (*held).min(*new);
            }
        }
    };
    for (dx, dy) in BESIDE {
        if let Some(other) = around.tile(dx, dy).filter(|tile| tile.known >= 12 || tile.plane.is_some()) {
            try_also(&mut tried, other.plane.unwrap_or(other.rise), if push_broom { 5 } else { 3 });
        }
    }
    for between in tried.between().into_iter().filter(|_| push_broom).flatten() {
        try_also(&mut tried, between, 8);
    }
}

fn store(tile: &mut Tile, relief: Option<&Relief>, table: &RiskTable, unit: impl Vectors) {
    match relief {
        Some(relief) => unit.run(|| table.tell(relief, &mut tile.risk)),
        None => tile.risk = [0; TILE_CELLS],
    }
    if tile.has_tall {
        for (risk, tall) in tile.risk.iter_mut().zip(&tile.tall) {
            if *tall >= TALL_CERTAIN {
                *risk = 255;
            }
        }
    }
    tile.unclassified = true;
}
