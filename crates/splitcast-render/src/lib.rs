//! Pictures of animated meshes: camera, light, tiles, and image and video output.

mod image;

pub use image::Image;
