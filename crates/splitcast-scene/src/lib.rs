//! Animated triangle meshes for Splitcast: where frames come from.
//!
//! A [`FrameSource`] yields one [`Frame`] at a time, whether it is read from
//! files or made by a built-in scene, so that a renderer never holds more
//! than a few frames in memory.
//!
//! This crate knows nothing of trees or rays: positions are `[f32; 3]`,
//! triangles `[u32; 3]`, colours sRGB bytes.
//!
//! ```no_run
//! use splitcast_scene::{FrameSource, MeshSequence, Prefetch};
//!
//! let sequence = MeshSequence::open("gallop/frame_%04d.ply")?;
//! for warning in sequence.warnings() {
//!     eprintln!("warning: {warning}");
//! }
//! let frames = 0..sequence.frame_count();
//! for item in Prefetch::new(Box::new(sequence), frames) {
//!     let (index, frame) = item?;
//!     println!("frame {index}: {} triangles", frame.triangles.len());
//! }
//! # Ok::<(), splitcast_scene::SceneError>(())
//! ```

mod atomic;
pub mod builtin;
mod error;
mod export;
mod frame;
mod info;
mod number_pattern;
mod obj;
mod outline;
mod ply;
mod polygon;
mod prefetch;
mod sequence;
mod vertex_normals;

pub use atomic::write_atomically;
pub use error::{Place, SceneError};
pub use export::export;
pub use frame::{Frame, FrameSource};
pub use info::{Bounds, FrameInfo, Motion, SequenceInfo};
pub use number_pattern::NumberPattern;
pub use obj::read_obj;
pub use ply::{read_ply, write_ply};
pub use prefetch::Prefetch;
pub use sequence::{MeshSequence, SequenceWarning, read_mesh};
pub use vertex_normals::vertex_normals;
