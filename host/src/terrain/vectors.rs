//! The vector unit that this processor has.
//!
//! A program for x86-64 is built for the instructions that every such processor has, vectors of 128 bits. Nearly all have had AVX2 since 2013: whether
//! this one does is asked once, and the map's loops are there in both forms. Elsewhere they are as built: NEON, of which every 64-bit ARM has all.

use crossfall_core::terrain::{AsBuilt, Vectors};

/// The widest vectors that the map's loops are built for and this processor has.
#[derive(Clone, Copy, Debug)]
pub struct Found {
    #[cfg(target_arch = "x86_64")]
    avx2: Option<pulp::x86::V3>,
}

impl Found {
    /// Asks the processor.
    #[must_use]
    pub fn new() -> Self {
        Self {
            #[cfg(target_arch = "x86_64")]
            avx2: pulp::x86::V3::try_new(),
        }
    }
}

impl Default for Found {
    fn default() -> Self {
        Self::new()
    }
}

impl Vectors for Found {
    #[inline(always)]
    fn run<R>(self, kernel: impl FnOnce() -> R) -> R {
        #[cfg(target_arch = "x86_64")]
        if let Some(avx2) = self.avx2 {
            return pulp::Simd::vectorize(avx2, kernel);
        }
        AsBuilt.run(kernel)
    }
}

#[cfg(test)]
mod tests {
    use crossfall_core::terrain::{TerrainConfig, Tile};

    use super::*;
    use crate::terrain::drive::TerrainScene;
    use crate::terrain::mapper::Workshop;

    /// Every cell after some frames.
    fn cells(unit: impl Vectors) -> Vec<String> {
        let mut scene = TerrainScene::default();
        scene.lidar.columns = 500;
        let mut workshop = Workshop::for_range(TerrainConfig::default(), 30.0, 40_000);
        let mut mapper = workshop.open_with(unit).unwrap();
        for index in 0..6 {
            let frame = scene.frame(index).unwrap();
            mapper.integrate(&frame.points, &frame.reported, 100_000, &[]).unwrap();
        }
        let told = |tile: &Tile| (0..256).map(|index| tile.cell(index % 16, index / 16)).collect::<Vec<_>>();
        mapper.map().tiles().map(|tile| format!("{:?} {:?}", tile.key(), told(tile))).collect()
    }

    #[test]
    fn wider_vectors_give_the_same_map() {
        let (found, built) = (cells(Found::new()), cells(AsBuilt));
        assert!(built.len() > 100, "{} tiles", built.len());
        assert!(found == built);
    }
}
