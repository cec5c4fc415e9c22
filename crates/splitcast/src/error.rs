//! Typed errors. Every message is one line that names the place, what was
//! wrong, and what was expected.

use crate::build::MAX_DEPTH;
use crate::filter::{NoiseError, WienerError};

/// Why positions and triangles do not make a mesh.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum MeshError {
    /// A triangle refers to a vertex that is not there.
    #[error("triangle {triangle} uses vertex {index}, but the mesh has only {positions} vertices")]
    IndexOutOfRange {
        /// The first such triangle.
        triangle: usize,
        /// The index it holds.
        index: u32,
        /// Number of positions.
        positions: usize,
    },
    /// More triangles than a 32-bit index can name.
    #[error(
        "the mesh has {triangles} triangles, at most {} are supported",
        u32::MAX
    )]
    TooManyTriangles {
        /// Number of triangles.
        triangles: usize,
    },
}

/// Why no tree was built.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum BuildError {
    /// A triangle has a corner at NaN, at infinity, or farther out than
    /// single precision can trace.
    #[error(
        "vertex {vertex} of triangle {triangle} is at ({}, {}, {}): \
         coordinates must be finite and within ±1e12 (such triangles can be skipped on request)",
        position[0], position[1], position[2]
    )]
    NonFinite {
        /// Index of the first triangle concerned.
        triangle: usize,
        /// Index of the vertex in the mesh.
        vertex: u32,
        /// Its position.
        position: [f32; 3],
    },
    /// An option is out of its bounds.
    #[error(transparent)]
    Options(#[from] OptionsError),
    /// More leaf references than the 30-bit fields of a node can count.
    #[error(
        "the tree needs more than {limit} references: raise min_split, or lower cost.intersection or max_depth"
    )]
    TooManyReferences {
        /// The largest number supported.
        limit: usize,
    },
}

/// Which build option is out of its bounds.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum OptionsError {
    /// A cost that has to be finite and above zero.
    #[error("{field} is {value}, expected a finite number above 0")]
    NotPositive {
        /// Path of the field, as in `cost.traversal`.
        field: &'static str,
        /// Its value.
        value: f32,
    },
    /// A number that has to lie in a range.
    #[error("{field} is {value}, expected {expected}")]
    OutOfRange {
        /// Path of the field, as in `search.tolerance`.
        field: &'static str,
        /// Its value.
        value: f32,
        /// The range, in words.
        expected: &'static str,
    },
    /// The noise of a filter is out of its bounds.
    #[error("tracking.{0}")]
    Noise(#[from] NoiseError),
    /// A parameter of the Wiener predictor is out of its bounds.
    #[error("tracking.{0}")]
    Wiener(#[from] WienerError),
    /// A block size that is not a power of two up to 64.
    #[error("cost.leaf_width is {value}, expected a power of two from 1 to 64")]
    LeafWidth {
        /// Its value.
        value: u32,
    },
    /// An empty-space bonus outside [0, 1).
    #[error("cost.empty_bonus is {value}, expected 0 or more and below 1")]
    EmptyBonus {
        /// Its value.
        value: f32,
    },
    /// A depth bound above [`MAX_DEPTH`].
    #[error("max_depth is {value}, expected 0 to {MAX_DEPTH}")]
    MaxDepth {
        /// Its value.
        value: u32,
    },
}
