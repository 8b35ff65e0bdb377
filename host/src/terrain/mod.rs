//! The driving risk map on a desk: frames in, maps and pictures out, and the simulation that shows what it is worth.

mod behind;
pub mod conventional;
pub mod curve;
pub mod drive;
mod drive_folder;
pub mod evaluation;
pub mod frames;
pub mod geotiff;
pub mod ghosts;
mod las_frames;
mod laz_layers;
pub mod lidar;
pub mod map_files;
pub mod mapper;
mod pcd;
pub mod picture;
pub mod poses;
pub mod pushbroom;
pub mod raster;
pub mod scene;
pub mod source;
pub mod turns;
pub mod vectors;
pub mod velodyne;
