//! Ray tracing of animated triangle meshes on the CPU, with kd-trees that
//! follow the surface area heuristic (SAH).
//!
//! Build a [`KdTree`] over borrowed positions and triangles, then ask it for
//! hits:
//!
//! ```
//! use splitcast::{BuildOptions, KdTree, Mesh, Ray};
//!
//! let positions = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]];
//! let triangles = [[0, 1, 2]];
//! let mesh = Mesh::new(&positions, &triangles)?;
//! let tree = KdTree::build(mesh, &BuildOptions::default())?;
//!
//! let ray = Ray::new([0.25, 0.25, 1.0], [0.0, 0.0, -1.0]);
//! let hit = tree.closest_hit(&ray).expect("the ray points at the triangle");
//! assert_eq!(hit.triangle, 0);
//! assert_eq!(hit.t, 1.0);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! A tree never moves a hit: whatever planes a builder chooses, every triangle
//! stands in every leaf that it overlaps, or whole in a single one
//! ([`KdTree::cells_overlap`]), so only the cost of a ray depends on
//! them. Trees are immutable and `Send + Sync`; any number of threads may
//! trace one. Rays that take much the same way are traced faster as a slice
//! ([`KdTree::closest_hits`], [`KdTree::occluded_rays`]).
//!
//! For a mesh that moves, a [`Tracker`] makes each frame's tree from the last one
//! in a fraction of the time of a build.
//!
//! Builds run on the current rayon thread pool and give the same tree on any
//! number of threads and on every instruction set; so do updates, but for those with a
//! time budget.

mod aabb;
mod build;
mod error;
pub mod filter;
mod kd_tree;
mod mesh;
mod prefetch;
mod ray;
mod sah;
mod sequence;
mod simd;
mod split_costs;
mod stats;
mod tracker;
mod traverse;
mod validate;
mod wide;

pub use aabb::Aabb;
pub use build::{
    BuildOptions, Builder, InitialState, Innovation, MAX_DEPTH, NonFinite, Orientation, Outcome,
    ParseBuilderError, ParseOrientationError, Preset, SearchOptions, TrackingOptions,
};
pub use error::{BuildError, MeshError, OptionsError};
pub use kd_tree::{KdTree, Node, NodeKind, NodeVisit};
pub use mesh::Mesh;
pub use ray::{Hit, Ray};
pub use sah::CostModel;
pub use sequence::{BuildReport, BuildStage, SequenceBuilder, SplitRecord};
pub use simd::{Kernel, SimdError, SimdLevel, dispatch, force_simd};
pub use stats::TreeStats;
pub use tracker::{Share, Tracker, Update, UpdateReport};
pub use traverse::{RayPacket, TraversalCounts, reference};
pub use validate::Violation;
