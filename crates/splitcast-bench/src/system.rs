//! What is compared: one trait for whatever follows a mesh and traces rays.
//!
//! A system is added by one file under `systems` that implements [`System`]
//! and its [`Tracer`], and by its entries in the catalog.

use splitcast::{Mesh, Ray};

use crate::rays::{LANES, RayBlock, RaySetKind};

/// Follows a mesh from frame to frame.
///
/// Everything that has to happen before the first ray can be traced at full
/// speed belongs into [`update`](System::update), whose time is taken: copies of vertices,
/// leaf blocks, wide nodes. What can be reused from frame to frame (memory,
/// builders, devices) should be, as a careful user of the library would do.
pub trait System: Send {
    /// Brings the structure up to date with the next frame and returns what traces it.
    ///
    /// Runs on a worker of the rayon pool that has as many threads as the
    /// measurement; parallel work of the system has to keep to that number.
    /// The time until the result is dropped again counts as update, too.
    ///
    /// # Errors
    /// What the library refuses; the system is left out of the scene from then on.
    fn update<'s>(&'s mut self, frame: FrameMesh<'s>) -> Result<Box<dyn Tracer + 's>, SystemError>;

    /// Bytes that the system holds outside of Rust's heap, where the harness cannot see them.
    fn foreign_bytes(&self) -> usize {
        0
    }
}

/// The mesh of a frame, as all systems get it.
#[derive(Clone, Copy, Debug)]
pub struct FrameMesh<'m> {
    /// Positions and triangles.
    pub mesh: Mesh<'m>,
    /// The mesh's positions and one more without a meaning, for libraries that
    /// share a buffer and read 16 bytes at every position.
    pub padded_positions: &'m [[f32; 3]],
    /// Whether the triangles are those of the frame before, so that only
    /// positions moved. Of no meaning to a system that has seen no frame.
    pub same_topology: bool,
}

/// Traces rays against the frame of the last update. Several threads call it at once.
pub trait Tracer: Sync {
    /// The ways in which rays of this kind can be traced, at least one. The
    /// fastest is found out before measuring and used from then on.
    fn modes(&self, kind: RaySetKind) -> &'static [&'static str] {
        let _ = kind;
        &["single rays"]
    }

    /// Finds the closest hit of each ray in the given one of the modes.
    fn closest_hits(&self, mode: usize, rays: RayChunk<'_>, hits: HitChunk<'_>);

    /// Finds out about each ray whether anything is hit between its ends.
    fn occluded(&self, mode: usize, rays: RayChunk<'_>, occluded: &mut [bool]);

    /// Expected cost by the surface area heuristic, where the tree can be read. In
    /// units of the system's own: compared over time and with its relatives only.
    fn sah_cost(&self) -> Option<f64> {
        None
    }
}

/// A part of a set of rays, in two forms of which a system reads one.
#[derive(Clone, Copy, Debug)]
pub struct RayChunk<'r> {
    /// One ray after the other.
    pub rays: &'r [Ray],
    /// The same in blocks, lane by lane; the last block may have lanes without a ray.
    pub blocks: &'r [RayBlock],
}

/// Where the closest hits of a chunk go: a place for every lane of its blocks,
/// in their order. Those behind the last ray are not looked at.
#[derive(Debug)]
pub struct HitChunk<'h> {
    /// Distance along the ray, infinite where nothing is hit.
    pub t: &'h mut [f32],
    /// The triangle that is hit; any number where nothing is.
    pub triangle: &'h mut [u32],
}

impl HitChunk<'_> {
    /// Puts down what each ray hits, as distance and triangle.
    #[inline(always)]
    pub fn fill(&mut self, rays: &[Ray], mut closest: impl FnMut(&Ray) -> Option<(f32, u32)>) {
        for ((ray, t), triangle) in rays.iter().zip(&mut *self.t).zip(&mut *self.triangle) {
            (*t, *triangle) = closest(ray).unwrap_or((f32::INFINITY, u32::MAX));
        }
    }

    /// The lanes of block `block`.
    pub fn block(&mut self, block: usize) -> (&mut [f32; LANES], &mut [u32; LANES]) {
        let lanes = block * LANES..(block + 1) * LANES;
        let t = (&mut self.t[lanes.clone()]).try_into();
        let triangle = (&mut self.triangle[lanes]).try_into();
        (
            t.expect("a block has that many lanes"),
            triangle.expect("a block has that many lanes"),
        )
    }
}

/// Why a system cannot go on with a scene, in one line.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{0}")]
pub struct SystemError(pub String);

/// A system that can be measured, before it is made.
pub struct CatalogEntry {
    /// Name in tables, such as `embree-refit`; unique.
    pub name: String,
    /// The library, such as `embree`; selects all of its systems.
    pub family: &'static str,
    /// Library, version and what the system does, in a line.
    pub about: String,
    /// The system of the same family that rebuilds its tree well for every frame:
    /// the yardstick of quality over time. A system that is its own needs none.
    pub yardstick: Option<String>,
    /// Makes the system.
    pub make: MakeSystem,
}

/// Makes a system for so many threads. Called on a worker of the pool.
pub type MakeSystem = Box<dyn Fn(usize) -> Result<Box<dyn System>, SystemError> + Send + Sync>;
