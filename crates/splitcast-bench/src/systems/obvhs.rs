//! obvhs: trees of boxes by locally ordered clustering and reinsertion, with two
//! children a node or, compressed, with eight.
//!
//! Triangles are copied in the order of the leaves, as its examples do, in the form that it
//! calls optimized for rays on a CPU. The other form, with edges of 16 bits, is not exact enough.

use glam::Vec3A;
use obvhs::aabb::Aabb;
use obvhs::bvh2::Bvh2;
use obvhs::bvh2::leaf_collapser::collapse;
use obvhs::bvh2::reinsertion::ReinsertionOptimizer;
use obvhs::cwbvh::{CwBvh, bvh2_to_cwbvh::bvh2_to_cwbvh};
use obvhs::ploc::PlocBuilder;
use obvhs::ray::{Ray as ObvhsRay, RayHit};
use obvhs::rt_triangle::RtTriangle;
use obvhs::splits::split_aabbs_preset;
use obvhs::triangle::Triangle;
use obvhs::{Boundable, BvhBuildParams};
use rayon::prelude::*;
use splitcast::{Mesh, Ray};

use super::{Catalog, bvh_cost};
use crate::system::{CatalogEntry, FrameMesh, HitChunk, RayChunk, System, SystemError, Tracer};

/// The name of the yardstick.
const MEDIUM: &str = "obvhs-medium";

/// What is traced, and how it is kept up to date.
#[derive(Clone, Copy, PartialEq)]
enum Way {
    /// Two children, rebuilt.
    Rebuild,
    /// Two children, refitted while the topology stays.
    Refit,
    /// Eight children, rebuilt.
    Compressed,
}

const SYSTEMS: [(&str, &str, Way, BvhBuildParams); 6] = [
    (
        "obvhs-fastest",
        "rebuilt by its fastest preset",
        Way::Rebuild,
        BvhBuildParams::fastest_build(),
    ),
    (
        MEDIUM,
        "rebuilt by its medium preset",
        Way::Rebuild,
        BvhBuildParams::medium_build(),
    ),
    (
        "obvhs-slowest",
        "rebuilt by its slowest preset, with spatial splits",
        Way::Rebuild,
        BvhBuildParams::very_slow_build(),
    ),
    (
        "obvhs-refit",
        "tree of the first frame by its medium preset, refitted",
        Way::Refit,
        BvhBuildParams::medium_build(),
    ),
    (
        "obvhs-cwbvh-fastest",
        "8 wide and compressed, rebuilt by its fastest preset",
        Way::Compressed,
        BvhBuildParams::fastest_build(),
    ),
    (
        "obvhs-cwbvh-medium",
        "8 wide and compressed, rebuilt by its medium preset",
        Way::Compressed,
        BvhBuildParams::medium_build(),
    ),
];

/// Adds every preset that is compared.
pub(super) fn add_to(catalog: &mut Catalog) {
    for (name, about, way, params) in SYSTEMS {
        catalog.entries.push(CatalogEntry {
            name: name.to_owned(),
            family: "obvhs",
            about: format!("obvhs 0.4, BVH, {about}"),
            yardstick: (name != MEDIUM).then(|| MEDIUM.to_owned()),
            make: Box::new(move |_| Ok(Box::new(Obvhs::new(way, params)))),
        });
    }
}

struct Obvhs {
    way: Way,
    builder: Builder,
    wide: CwBvh,
    /// Copies of triangles in the order of the leaves.
    leaves: Vec<RtTriangle>,
}

impl Obvhs {
    fn new(way: Way, params: BvhBuildParams) -> Self {
        Self {
            way,
            builder: Builder {
                params,
                triangles: Vec::new(),
                boxes: Vec::new(),
                ploc: PlocBuilder::new(),
                reinsertion: ReinsertionOptimizer::default(),
                tree: Bvh2::default(),
            },
            wide: CwBvh::default(),
            leaves: Vec::new(),
        }
    }
}

impl System for Obvhs {
    fn update<'s>(&'s mut self, frame: FrameMesh<'s>) -> Result<Box<dyn Tracer + 's>, SystemError> {
        let builder = &mut self.builder;
        builder.read(frame.mesh);
        if self.way == Way::Refit && frame.same_topology && !builder.tree.nodes.is_empty() {
            builder.refit();
        } else {
            builder.build();
            match self.way {
                Way::Rebuild => builder.collapse(),
                Way::Refit => {
                    builder.collapse();
                    // Parents before children make every refit one sweep.
                    builder.tree.reorder_in_stack_traversal_order();
                }
                Way::Compressed => {
                    let per_leaf = builder.params.max_prims_per_leaf.clamp(1, 3);
                    self.wide = bvh2_to_cwbvh(&builder.tree, per_leaf, true, false);
                }
            }
        }
        let indices = match self.way {
            Way::Compressed => &self.wide.primitive_indices,
            _ => &builder.tree.primitive_indices,
        };
        let triangles = &builder.triangles;
        (indices.par_iter())
            .map(|&index| RtTriangle::from(&triangles[index as usize]))
            .collect_into_vec(&mut self.leaves);
        let leaves = &self.leaves[..];
        Ok(match self.way {
            Way::Compressed => Box::new(Built {
                tree: &self.wide,
                leaves,
            }),
            _ => Box::new(Built {
                tree: &builder.tree,
                leaves,
            }),
        })
    }
}

/// Builds trees as the library's own helpers do, but keeps its memory.
struct Builder {
    params: BvhBuildParams,
    /// The frame's triangles.
    triangles: Vec<Triangle>,
    /// Boxes of parts of triangles, if they are split.
    boxes: Vec<Aabb>,
    ploc: PlocBuilder,
    reinsertion: ReinsertionOptimizer,
    tree: Bvh2,
}

impl Builder {
    fn read(&mut self, mesh: Mesh<'_>) {
        (0..mesh.triangles().len() as u32)
            .into_par_iter()
            .map(|index| {
                let [v0, v1, v2] = mesh.corners(index).map(Vec3A::from_array);
                Triangle { v0, v1, v2 }
            })
            .collect_into_vec(&mut self.triangles);
    }

    /// Clusters the triangles and improves on that.
    fn build(&mut self) {
        let mut indices = std::mem::take(&mut self.tree.primitive_indices);
        indices.clear();
        indices.extend(0..self.triangles.len() as u32);
        if self.params.pre_split {
            self.split(&mut indices);
            let boxes = std::mem::take(&mut self.boxes);
            self.cluster(&boxes, indices);
            self.boxes = boxes;
        } else {
            let triangles = std::mem::take(&mut self.triangles);
            self.cluster(&triangles, indices);
            self.triangles = triangles;
        }
        self.tree.uses_spatial_splits = self.params.pre_split;
        let ratio = self.params.reinsertion_batch_ratio;
        self.reinsertion.run(&mut self.tree, ratio, None);
    }

    /// Cuts the boxes of large triangles into pieces.
    fn split(&mut self, indices: &mut Vec<u32>) {
        self.boxes.clear();
        self.boxes.extend(self.triangles.iter().map(Triangle::aabb));
        let areas = || self.boxes.iter().map(Aabb::half_area);
        let average = areas().sum::<f32>() / self.triangles.len() as f32;
        let largest = areas().fold(0.0, f32::max);
        let triangles = &self.triangles;
        split_aabbs_preset(&mut self.boxes, indices, triangles, average, largest);
    }

    fn cluster<T: Boundable>(&mut self, primitives: &[T], indices: Vec<u32>) {
        self.ploc.build_with_bvh(
            &mut self.tree,
            self.params.ploc_search_distance,
            primitives,
            indices,
            self.params.sort_precision,
            self.params.search_depth_threshold,
        );
    }

    /// Joins leaves where that pays, and improves on the rest.
    fn collapse(&mut self) {
        let params = &self.params;
        let per_leaf = params.max_prims_per_leaf.clamp(1, 255);
        collapse(&mut self.tree, per_leaf, params.collapse_traversal_cost);
        let ratio = params.reinsertion_batch_ratio
            * params.post_collapse_reinsertion_batch_ratio_multiplier;
        self.reinsertion.run(&mut self.tree, ratio, None);
    }

    /// Gives the boxes of the tree the sizes of the frame.
    fn refit(&mut self) {
        let Bvh2 {
            nodes,
            primitive_indices,
            ..
        } = &mut self.tree;
        nodes.par_iter_mut().for_each(|node| {
            if node.is_leaf() {
                let first = node.first_index as usize;
                let held = &primitive_indices[first..first + node.prim_count as usize];
                let mut union = Aabb::empty();
                for &index in held {
                    union = union.union(&self.triangles[index as usize].aabb());
                }
                node.set_aabb(union);
            }
        });
        self.tree.refit_all();
    }
}

/// What both kinds of trees can do.
trait Tree: Sync {
    fn closest(&self, ray: ObvhsRay, test: impl FnMut(&ObvhsRay, usize) -> f32) -> RayHit;
    fn misses(&self, ray: ObvhsRay, test: impl FnMut(&ObvhsRay, usize) -> f32) -> bool;
    /// The triangle of each place in the leaves.
    fn indices(&self) -> &[u32];
    fn cost(&self) -> Option<f64>;
}

impl Tree for Bvh2 {
    #[inline(always)]
    fn closest(&self, ray: ObvhsRay, test: impl FnMut(&ObvhsRay, usize) -> f32) -> RayHit {
        let mut hit = RayHit::none();
        self.ray_traverse(ray, &mut hit, test);
        hit
    }

    #[inline(always)]
    fn misses(&self, ray: ObvhsRay, test: impl FnMut(&ObvhsRay, usize) -> f32) -> bool {
        self.ray_traverse_miss(ray, test)
    }

    fn indices(&self) -> &[u32] {
        &self.primitive_indices
    }

    fn cost(&self) -> Option<f64> {
        bvh_cost::sah_cost(self.nodes.iter().map(|node| bvh_cost::Node {
            min: node.aabb().min.to_array(),
            max: node.aabb().max.to_array(),
            triangles: node.prim_count as usize,
        }))
    }
}

impl Tree for CwBvh {
    #[inline(always)]
    fn closest(&self, ray: ObvhsRay, test: impl FnMut(&ObvhsRay, usize) -> f32) -> RayHit {
        let mut hit = RayHit::none();
        self.ray_traverse(ray, &mut hit, test);
        hit
    }

    #[inline(always)]
    fn misses(&self, ray: ObvhsRay, test: impl FnMut(&ObvhsRay, usize) -> f32) -> bool {
        self.ray_traverse_miss(ray, test)
    }

    fn indices(&self) -> &[u32] {
        &self.primitive_indices
    }

    /// Its boxes are rounded and packed.
    fn cost(&self) -> Option<f64> {
        None
    }
}

struct Built<'s, T> {
    tree: &'s T,
    leaves: &'s [RtTriangle],
}

impl<T: Tree> Tracer for Built<'_, T> {
    fn closest_hits(&self, _: usize, rays: RayChunk<'_>, mut hits: HitChunk<'_>) {
        hits.fill(rays.rays, |ray| {
            let test = |ray: &ObvhsRay, index: usize| self.leaves[index].intersect(ray);
            let hit = self.tree.closest(converted(ray), test);
            // Not every traversal tells by its result whether it hit.
            let triangle = self.tree.indices().get(hit.primitive_id as usize)?;
            Some((hit.t, *triangle))
        });
    }

    fn occluded(&self, _: usize, rays: RayChunk<'_>, occluded: &mut [bool]) {
        for (ray, occluded) in rays.rays.iter().zip(occluded) {
            let test = |ray: &ObvhsRay, index: usize| self.leaves[index].intersect(ray);
            *occluded = !self.tree.misses(converted(ray), test);
        }
    }

    fn sah_cost(&self) -> Option<f64> {
        self.tree.cost()
    }
}

fn converted(ray: &Ray) -> ObvhsRay {
    let origin = Vec3A::from_array(ray.origin);
    let direction = Vec3A::from_array(ray.direction);
    ObvhsRay::new(origin, direction, ray.t_min, ray.t_max)
}
