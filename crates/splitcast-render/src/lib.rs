//! Pictures of animated meshes: camera, light, tiles, and image and video output.
//!
//! A [`Perspective`] says where the camera stands, or frames a whole motion;
//! a [`Renderer`] holds camera, light and ground for that motion and turns
//! frames with their trees into an [`Image`]; [`to_srgb8`] makes display bytes
//! of it:
//!
//! ```
//! use splitcast::{Aabb, BuildOptions, KdTree, Mesh};
//! use splitcast_render::{
//!     Camera, DEFAULT_FOV_DEGREES, Perspective, RenderOptions, Renderer, to_srgb8,
//! };
//! use splitcast_scene::Frame;
//!
//! let frame = Frame {
//!     positions: vec![[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]],
//!     triangles: vec![[0, 1, 2]].into(),
//!     ..Frame::default()
//! };
//! // With more frames, the points of all of them: camera and ground then stand still.
//! let points = &frame.positions;
//! let options = RenderOptions {
//!     width: 64,
//!     height: 36,
//!     ..RenderOptions::default()
//! };
//! let aspect = options.width as f32 / options.height as f32;
//! let view = Perspective::framing(points, options.up, aspect, DEFAULT_FOV_DEGREES)?;
//! let renderer = Renderer::new(Camera::new(&view)?, &Aabb::of_points(points), options)?;
//!
//! let tree = KdTree::build(
//!     Mesh::new(&frame.positions, &frame.triangles)?,
//!     &BuildOptions::default(),
//! )?;
//! let (image, stats) = renderer.render(&tree, &frame)?;
//! assert_eq!(to_srgb8(&image).len(), 64 * 36 * 3);
//! assert!(stats.rays >= 64 * 36);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! Pictures are deterministic: every sample depends on its pixel and the seed
//! alone, so the number of threads, and how frames are divided among runs,
//! change nothing.

mod adaptive;
mod benchmark_rays;
mod camera;
mod color_map;
mod coverage;
mod debug_view;
mod error;
mod ground;
mod image;
mod lanes;
mod legend;
mod options;
mod output;
mod preview;
mod reach;
mod renderer;
mod sampling;
mod shade;
mod sky;
mod srgb;
mod stage;
mod surface;
mod tiles;
mod tone_map;

pub use benchmark_rays::BenchmarkRays;
pub use camera::{Camera, DEFAULT_FOV_DEGREES, Perspective};
pub use error::RenderError;
pub use image::Image;
pub use options::{
    MAX_PIXELS, MAX_SAMPLES_PER_PIXEL, MAX_SIDE, Quality, RenderOptions, Shading, View,
};
pub use output::{
    FrameSink, OutputError, OutputFormat, OutputOptions, OutputSpec, OutputThread, Resumed,
    Settings, WriteTimes, check_writable, encode_png,
};
pub use renderer::{RenderStats, Renderer};
pub use tone_map::{ToneCurve, to_srgb8};
