//! Proves at link time that nothing in the map of elevation and risk can panic, as `proof` does for what a board runs.
#![no_std]
#![no_main]

use core::hint::black_box;
use core::panic::PanicInfo;

use cortex_m_rt::entry;
use crossfall_core::terrain::{
    self, MovingBox, Pair, Pose, RangePixels, Sample, Storage, TerrainConfig, TerrainMap, Tile, TileKey,
};
use embassy_stm32 as _;

unsafe extern "C" {
    /// Defined nowhere.
    fn the_map_can_panic() -> !;
}

#[panic_handler]
fn panic(_: &PanicInfo) -> ! {
    // SAFETY: never linked.
    unsafe { the_map_can_panic() }
}

/// Frames into a map whose storage and configuration are as unknown as they are.
#[entry]
fn main() -> ! {
    let storage = Storage {
        tiles: black_box::<&mut [Tile]>(&mut []),
        marks: black_box::<&mut [terrain::Marks]>(&mut []),
        samples: black_box::<&mut [Sample]>(&mut []),
        pairs: black_box::<&mut [Pair]>(&mut []),
        pixels: black_box::<Option<&mut RangePixels>>(None),
    };
    let Ok(mut map) = TerrainMap::new(black_box(TerrainConfig::default()), black_box(0), storage) else { loop {} };
    loop {
        let pose = black_box(Pose { rotation: [[0.0; 3]; 3], position_um: [0; 3] });
        let boxes = black_box::<&[MovingBox]>(&[]);
        map.finish_leaving(&pose);
        black_box(map.integrate(black_box::<&[[f32; 4]]>(&[]), &pose, black_box(0), boxes, |tile| told(tile)));
        map.refresh_all();
        map.tiles().for_each(told);
        if let Some(tile) = map.tile(black_box(TileKey { x: 0, y: 0 })) {
            told(tile);
        }
        let step = black_box(0.0);
        black_box((
            terrain::risk_of_step(step, step),
            terrain::risk_sigma(step, step, step),
            terrain::advised_speed_mps(step, step, step),
        ));
    }
}

/// What is read of a tile.
fn told(tile: &Tile) {
    black_box((tile.key(), tile.in_use(), tile.cell(black_box(0), black_box(0)).variance_mm2()));
}
