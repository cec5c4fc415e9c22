//! Trees with two children, built or refitted and then widened to eight.
//!
//! The binding offers less than the library. Of its builders there is the one without vector
//! instructions, whose trees are those of the other but take about twice as long; from 50,000
//! triangles on it starts threads of its own, which stay on the processor that the calling
//! thread is pinned to. There is no test for occlusion, so closest hits are asked for instead,
//! and there are no indices, so every triangle has vertices of its own.

use rayon::prelude::*;
use splitcast::{Mesh, Ray};
use tinybvh_rs::{Error, INFINITE, Intersector, Ray as TinyRay, bvh, bvh8_cpu, mbvh};

use super::super::Catalog;
use crate::system::{CatalogEntry, FrameMesh, HitChunk, RayChunk, System, SystemError, Tracer};

/// The name of the yardstick.
const REBUILD: &str = "tinybvh-rebuild";

/// Triangles that a leaf of the wide tree holds at most.
const PER_LEAF: u32 = 4;

/// What the library reads of a ray's mask where instances are traced; all bits allow all.
const ALL_INSTANCES: u32 = 0xffff;

/// Adds both.
pub(super) fn add_to(catalog: &mut Catalog) {
    let systems = [
        (REBUILD, "rebuilt by its builder without SIMD", true),
        ("tinybvh-refit", "tree of the first frame, refitted", false),
    ];
    for (name, about, rebuilds) in systems {
        catalog.entries.push(CatalogEntry {
            name: name.to_owned(),
            family: "tinybvh",
            about: format!("tinybvh 1.6 (tinybvh-rs 0.1.0-beta.3), BVH, {about}, 8 wide"),
            yardstick: (name != REBUILD).then(|| REBUILD.to_owned()),
            make: Box::new(move |_| {
                Ok(Box::new(Trees {
                    rebuilds,
                    corners: Vec::new(),
                    built: None,
                }))
            }),
        });
    }
}

struct Trees {
    rebuilds: bool,
    corners: Vec<Corners>,
    built: Option<Built>,
}

/// The corners of a triangle, aligned as the library reads them; the binding does not ask for it.
#[derive(Clone, Copy)]
#[repr(C, align(16))]
struct Corners([[f32; 4]; 3]);

impl Corners {
    fn flattened(corners: &[Self]) -> &[[f32; 4]] {
        let first = corners.as_ptr().cast();
        // SAFETY: the struct is nothing but three of these, without padding, and the
        // vertices are borrowed as the triangles are.
        unsafe { std::slice::from_raw_parts(first, 3 * corners.len()) }
    }
}

const _: () = assert!(size_of::<Corners>() == 3 * size_of::<[f32; 4]>());

/// The three stages of a tree, of which the last is traced.
struct Built {
    binary: bvh::BVHData,
    wide: mbvh::BVHData,
    traced: bvh8_cpu::BVH,
}

// SAFETY: the library's trees own their memory and do not know which thread uses them.
unsafe impl Send for Built {}
// SAFETY: all that is done through a shared reference are queries, which in the library are
// `const`, without anything `mutable` or static that they would write.
unsafe impl Sync for Built {}

impl System for Trees {
    fn update<'s>(&'s mut self, frame: FrameMesh<'s>) -> Result<Box<dyn Tracer + 's>, SystemError> {
        self.read(frame.mesh);
        let before = self.built.take().filter(|_| frame.same_topology);
        let built = self.follow(before).map_err(error)?;
        Ok(Box::new(&*self.built.insert(built)))
    }

    fn foreign_bytes(&self) -> usize {
        self.built.as_ref().map_or(0, Built::bytes)
    }
}

impl Trees {
    fn read(&mut self, mesh: Mesh<'_>) {
        (0..mesh.triangles().len() as u32)
            .into_par_iter()
            .map(|index| Corners(mesh.corners(index).map(|[x, y, z]| [x, y, z, 0.0])))
            .collect_into_vec(&mut self.corners);
    }

    /// Takes the memory of the trees before, and, to refit them, the trees themselves.
    fn follow(&self, before: Option<Built>) -> Result<Built, Error> {
        let vertices = Corners::flattened(&self.corners).into();
        let Some(before) = before else {
            let mut binary = bvh::BVH::new(vertices)?;
            binary.split_leaves(PER_LEAF);
            let wide = mbvh::BVH::new(&binary);
            let traced = bvh8_cpu::BVH::new(&wide)?;
            let wide = wide.data();
            return Ok(Built {
                binary: binary.data(),
                wide,
                traced,
            });
        };
        let mut binary = before.binary.bvh(vertices)?;
        if self.rebuilds {
            binary = binary.build(vertices)?;
            binary.split_leaves(PER_LEAF);
        } else {
            binary.refit();
        }
        let wide = before.wide.convert(&binary);
        let traced = before.traced.convert(&wide)?;
        let wide = wide.data();
        Ok(Built {
            binary: binary.data(),
            wide,
            traced,
        })
    }
}

impl Tracer for &Built {
    fn closest_hits(&self, _: usize, rays: RayChunk<'_>, mut hits: HitChunk<'_>) {
        hits.fill(rays.rays, |ray| self.closest(ray));
    }

    fn occluded(&self, _: usize, rays: RayChunk<'_>, occluded: &mut [bool]) {
        for (ray, occluded) in rays.rays.iter().zip(occluded) {
            *occluded = self.closest(ray).is_some();
        }
    }

    fn sah_cost(&self) -> Option<f64> {
        Some(self.binary.sah_cost(0).into())
    }
}

/// A ray as the library aligns it; the binding aligns less.
#[repr(align(64))]
struct Aligned(TinyRay);

impl Built {
    /// What the library allocates for the nodes and triangles that there are. It tells no sizes.
    fn bytes(&self) -> usize {
        /// Of the wide tree that is traced: boxes, children and order of a node; four
        /// triangles of a leaf, filled up to whole lines of the cache.
        const TRACED_NODE: usize = 256;
        const TRACED_LEAF: usize = 192;
        /// Of the binary tree, for each triangle: two nodes, its number, its box.
        const TRIANGLE: usize = 2 * size_of::<bvh::Node>() + 4 + 32;
        let binary = self.binary.indices().len() * TRIANGLE;
        let nodes = self.binary.nodes().len() * 3 / 2;
        let leaves = self.wide.leaf_count(0) as usize;
        let traced = self.wide.nodes().len() * TRACED_NODE + leaves * TRACED_LEAF;
        binary + nodes * size_of::<mbvh::Node>() + traced
    }

    #[inline(always)]
    fn closest(&self, ray: &Ray) -> Option<(f32, u32)> {
        // Rays of the library start at their origin, and end before its idea of infinity.
        let length = (ray.t_max - ray.t_min).min(INFINITE);
        let mut traced = Aligned(TinyRay {
            origin: ray.at(ray.t_min),
            padding_0: ALL_INSTANCES,
            dir: ray.direction,
            r_d: ray.direction.map(safe_inverse),
            ..TinyRay::default()
        });
        traced.0.hit.t = length;
        self.traced.intersect(&mut traced.0);
        let hit = traced.0.hit;
        (hit.t < length).then_some((ray.t_min + hit.t, hit.prim))
    }
}

/// The inverse as the library takes it: finite.
fn safe_inverse(x: f32) -> f32 {
    /// Below, directions count as parallel to the axis.
    const LEAST: f32 = 1e-12;
    if x.abs() > LEAST {
        1.0 / x
    } else {
        INFINITE.copysign(x)
    }
}

fn error(error: Error) -> SystemError {
    SystemError(error.to_string())
}
