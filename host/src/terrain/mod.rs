//! The driving risk map on a desk: frames in, maps and pictures out, and the simulation that shows what it is worth.

pub mod drive;
pub mod frames;
pub mod lidar;
pub mod mapper;
pub mod picture;
pub mod raster;
pub mod scene;
