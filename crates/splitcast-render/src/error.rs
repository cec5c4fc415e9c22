//! Typed errors. Every message is one line that names the field, its value,
//! and what was expected.

use crate::options::{MAX_PIXELS, MAX_SAMPLES_PER_PIXEL, MAX_SIDE};

/// Why a camera, a renderer or a picture could not be made.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum RenderError {
    /// A side of the picture is zero or too long.
    #[error("image size is {width}x{height}, expected each side from 1 to {MAX_SIDE}")]
    ImageSize {
        /// Pixels in a row.
        width: u32,
        /// Rows.
        height: u32,
    },
    /// More pixels than are worth holding in memory.
    #[error(
        "image size {width}x{height} has {} million pixels, at most {} million are supported: \
         render a smaller picture or several crops",
        u64::from(*width) * u64::from(*height) / 1_000_000, MAX_PIXELS / 1_000_000
    )]
    TooManyPixels {
        /// Pixels in a row.
        width: u32,
        /// Rows.
        height: u32,
    },
    /// No samples, or more than the sampler can number.
    #[error("samples per pixel is {value}, expected 1 to {MAX_SAMPLES_PER_PIXEL}")]
    SamplesPerPixel {
        /// Its value.
        value: u32,
    },
    /// A coordinate that is NaN, infinite, or too far out to trace.
    #[error(
        "{field} is ({}, {}, {}), expected finite coordinates within ±1e12",
        value[0], value[1], value[2]
    )]
    Coordinates {
        /// Name of the field, as in `eye`.
        field: &'static str,
        /// Its value.
        value: [f32; 3],
    },
    /// A number outside its range.
    #[error("{field} is {value}, expected {expected}")]
    OutOfRange {
        /// Name of the field.
        field: &'static str,
        /// Its value.
        value: f32,
        /// The range, in words.
        expected: &'static str,
    },
    /// A direction without a length.
    #[error("{field} is (0, 0, 0), expected a direction such as (0, 1, 0)")]
    ZeroDirection {
        /// Name of the field, as in `up`.
        field: &'static str,
    },
    /// The camera stands on the point that it looks at.
    #[error(
        "eye and look-at are both at ({}, {}, {}): move one of them",
        position[0], position[1], position[2]
    )]
    EyeAtTarget {
        /// The point.
        position: [f32; 3],
    },
    /// The camera looks along its own up direction.
    #[error(
        "up is ({}, {}, {}), parallel to the view from eye to look-at: \
         choose an up that is at an angle to it",
        up[0], up[1], up[2]
    )]
    UpAlongView {
        /// The up direction.
        up: [f32; 3],
    },
    /// A name that no quality, view or shading has.
    #[error("no {kind} is called '{name}', expected one of: {expected}")]
    UnknownName {
        /// What was to be named, as in `quality`.
        kind: &'static str,
        /// The name that was asked for.
        name: String,
        /// All names there are.
        expected: String,
    },
    /// The tree was built over another mesh than the frame's.
    #[error(
        "the tree has {tree_positions} vertices and {tree_triangles} triangles, \
         the frame {frame_positions} and {frame_triangles}: build the tree over this frame"
    )]
    FrameMismatch {
        /// Vertices of the tree's mesh.
        tree_positions: usize,
        /// Triangles of the tree's mesh.
        tree_triangles: usize,
        /// Vertices of the frame.
        frame_positions: usize,
        /// Triangles of the frame.
        frame_triangles: usize,
    },
    /// A vertex attribute without one value per vertex.
    #[error("the frame has {values} {attribute} for {positions} vertices, expected one a vertex")]
    AttributeLength {
        /// `normals` or `colors`.
        attribute: &'static str,
        /// Number of values.
        values: usize,
        /// Number of vertices.
        positions: usize,
    },
}
