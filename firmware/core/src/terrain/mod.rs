//! Points of a spinning LiDAR to an elevation map, and that to a driving risk map.
//!
//! Source: the seed paper on driving risk maps (an elevation map accumulated over frames shows curbs and bumps further ahead than any single frame).
//! What it leaves open is decided here by measurement: `docs/risk-map.md` has method and figures.
//!
//! Bounds: storage is lent by the caller and constant: 2.8 KB a tile of 16 x 16 cells (7 MB for 80 x 80 m of 0.1 m cells), 16 bytes a point of the largest
//! frame, 16 a pair of the alignment, and 229 KB of range image. A push broom's map aligns nothing and looks through nothing: it needs
//! 256 pairs and no image, and 64 x 64 cells take 59 KB with all that belongs to them but the stack. The work of a frame is
//! linear in its points and in the tiles of the window. No heap, no panic.
//!
//! Trade-off: floats are used between point and cell, restricted to operations that IEEE 754 rounds exactly, so that
//! results are the same bits on every target; what is stored in cells is integer.

mod align;
mod boxes;
mod classify;
mod config;
mod geometry;
mod impressions;
mod map;
mod marks;
mod plane;
mod project;
mod relief;
mod risk;
mod sight;
mod slope;
mod standing;
mod tile;
mod vectors;
mod window;

pub use align::{Alignment, Pair};
pub use boxes::MovingBox;
pub use config::TerrainConfig;
pub use geometry::Pose;
pub use map::{FrameReport, Refusal, SetUpError, Storage, TerrainMap};
pub use marks::Marks;
pub use project::{PointCounts, Sample};
pub use risk::{Decision, SLOW, STOP, advised_speed_mps, risk_of_step, risk_sigma};
pub use sight::{COLUMNS as IMAGE_COLUMNS, ROWS as IMAGE_ROWS, RangePixels};
pub use tile::{Cell, Class, TILE_CELLS, TILE_SIDE, Tile, TileKey, UNITS_PER_M};
pub use vectors::{AsBuilt, Vectors};
