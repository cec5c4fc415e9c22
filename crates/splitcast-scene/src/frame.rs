//! One frame of an animated mesh, and the trait that yields frames.

use std::sync::Arc;

use crate::SceneError;

/// One frame of an animated triangle mesh.
///
/// Invariants, kept by every source of this crate: every index in
/// `triangles` is below `positions.len()`, and the optional attributes have
/// one entry per position.
#[derive(Clone, Debug, Default)]
pub struct Frame {
    /// Vertex positions, in the units of the source; y is up in built-in scenes.
    pub positions: Vec<[f32; 3]>,
    /// Vertex indices, counter-clockwise seen from outside. Shared between
    /// frames as long as the topology stays the same (compare with [`Arc::ptr_eq`]).
    pub triangles: Arc<Vec<[u32; 3]>>,
    /// Unit vertex normals, if the source has them; zero where it gives a
    /// vertex no direction.
    pub normals: Option<Vec<[f32; 3]>>,
    /// Vertex colours, sRGB, if the source has them.
    pub colors: Option<Arc<Vec<[u8; 3]>>>,
}

/// A sequence of frames that can be asked for one at a time.
///
/// Sources may be cheaper to read forwards (a simulation has to run through
/// every earlier frame), but any order gives the same frames.
pub trait FrameSource: Send {
    /// Short name for tables and logs, e.g. `horse` or a file's stem.
    fn name(&self) -> &str;

    /// Number of frames, at least one.
    fn frame_count(&self) -> usize;

    /// Frames per second at which the sequence is meant to play.
    fn frames_per_second(&self) -> f32 {
        25.0
    }

    /// Whether the last frame leads back into the first.
    fn is_periodic(&self) -> bool {
        false
    }

    /// Reads or computes frame `index`, counted from zero.
    ///
    /// # Errors
    /// [`SceneError::FrameOutOfRange`] past the end, or whatever kept the
    /// frame from being read; the source stays usable for other frames.
    fn frame(&mut self, index: usize) -> Result<Frame, SceneError>;
}
