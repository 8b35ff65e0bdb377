//! The driving risk map on a desk: frames in, maps and pictures out, and the simulation that shows what it is worth.

pub mod conventional;
pub mod curve;
pub mod drive;
pub mod evaluation;
pub mod frames;
pub mod ghosts;
pub mod lidar;
pub mod mapper;
pub mod picture;
pub mod raster;
pub mod scene;
