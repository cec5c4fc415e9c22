//! Pictures of animated meshes: camera, light, tiles, and image and video output.

mod adaptive;
mod camera;
mod color_map;
mod debug_view;
mod error;
mod ground;
mod image;
mod legend;
mod options;
mod renderer;
mod sampling;
mod shade;
mod sky;
mod smooth_normals;
mod srgb;
mod stage;
mod surface;
mod tiles;
mod tone_map;

pub use camera::{Camera, DEFAULT_FOV_DEGREES, Perspective};
pub use error::RenderError;
pub use image::Image;
pub use options::{
    MAX_PIXELS, MAX_SAMPLES_PER_PIXEL, MAX_SIDE, Quality, RenderOptions, Shading, View,
};
pub use renderer::{RenderStats, Renderer};
pub use tone_map::{ToneCurve, to_srgb8};
