//! parry3d: trees of boxes of a physics engine, rebuilt or refitted.
//!
//! Each leaf holds a triangle. While the topology stays, leaves get their new boxes in
//! place, and what is above them is rebuilt or refitted in the memory that there is.

use parry3d::bounding_volume::Aabb;
use parry3d::math::Vector;
use parry3d::partitioning::{
    Bvh, BvhBuildStrategy, BvhLeafUpdateStatus, BvhNode, BvhWorkspace, TraversalAction,
};
use parry3d::query::{Ray as ParryRay, RayCast};
use parry3d::shape::Triangle;
use rayon::prelude::*;
use splitcast::Ray;

use super::{Catalog, bvh_cost};
use crate::rays::RaySetKind;
use crate::system::{CatalogEntry, FrameMesh, HitChunk, RayChunk, System, SystemError, Tracer};

/// The name of the yardstick.
const REBUILD: &str = "parry-rebuild";

/// Adds both.
pub(super) fn add_to(catalog: &mut Catalog) {
    let systems = [
        (REBUILD, "rebuilt by binned surface areas", true),
        ("parry-refit", "tree of the first frame, refitted", false),
    ];
    for (name, about, rebuilds) in systems {
        catalog.entries.push(CatalogEntry {
            name: name.to_owned(),
            family: "parry",
            about: format!("parry3d 0.31, BVH, {about}"),
            yardstick: (name != REBUILD).then(|| REBUILD.to_owned()),
            make: Box::new(move |threads| {
                Ok(Box::new(Parry {
                    rebuilds,
                    threads,
                    tree: Bvh::new(),
                    workspace: BvhWorkspace::default(),
                    triangles: Vec::new(),
                    moves: Vec::new(),
                    statuses: Vec::new(),
                }))
            }),
        });
    }
}

struct Parry {
    rebuilds: bool,
    threads: usize,
    tree: Bvh,
    workspace: BvhWorkspace,
    triangles: Vec<Triangle>,
    /// Box, number and margin of each triangle, to move leaves on several threads.
    moves: Vec<(Aabb, u32, f32)>,
    statuses: Vec<BvhLeafUpdateStatus>,
}

/// Binned surface areas. The other strategy, clustering, takes three times as long, and
/// its trees are slower to trace.
const STRATEGY: BvhBuildStrategy = BvhBuildStrategy::Binned;

/// By how much boxes of leaves are larger than triangles.
const MARGIN: f32 = 0.0;

impl System for Parry {
    fn update<'s>(&'s mut self, frame: FrameMesh<'s>) -> Result<Box<dyn Tracer + 's>, SystemError> {
        let mesh = frame.mesh;
        (0..mesh.triangles().len() as u32)
            .into_par_iter()
            .map(|index| {
                let [a, b, c] = mesh.corners(index).map(Vector::from);
                Triangle::new(a, b, c)
            })
            .collect_into_vec(&mut self.triangles);
        if self.tree.is_empty() || !frame.same_topology {
            let boxes = self.triangles.iter().map(Triangle::local_aabb);
            self.tree = Bvh::from_iter(STRATEGY, boxes.enumerate());
        } else {
            self.move_leaves();
            if self.rebuilds {
                self.rebuild();
            } else {
                // The order of the nodes is right from when they were built. The other refit,
                // which brings them into it, would only copy them, and takes longer.
                self.tree.refit_without_opt();
            }
        }
        Ok(Box::new(Built {
            tree: &self.tree,
            triangles: &self.triangles,
        }))
    }
}

impl Parry {
    /// Gives the leaves their new boxes.
    fn move_leaves(&mut self) {
        let boxes = |(index, triangle): (usize, &Triangle)| (triangle.local_aabb(), index as u32);
        if self.threads == 1 {
            for (bounds, index) in self.triangles.iter().enumerate().map(boxes) {
                self.tree.insert_or_update_partially(bounds, index, MARGIN);
            }
        } else {
            (self.triangles.par_iter().enumerate().map(boxes))
                .map(|(bounds, index)| (bounds, index, MARGIN))
                .collect_into_vec(&mut self.moves);
            let (moves, statuses) = (&self.moves, &mut self.statuses);
            (self.tree).insert_or_update_batch_partially_parallel(moves, statuses);
        }
    }

    /// Builds anew over the leaves, and brings the nodes into the order of depth first.
    fn rebuild(&mut self) {
        self.tree.rebuild(&mut self.workspace, STRATEGY);
        match self.threads {
            1 => self.tree.refit(&mut self.workspace),
            _ => self.tree.refit_parallel(&mut self.workspace),
        }
    }
}

struct Built<'s> {
    tree: &'s Bvh,
    triangles: &'s [Triangle],
}

const OCCLUSION_MODES: [&str; 2] = ["any box first", "nearest box first"];

impl Tracer for Built<'_> {
    fn modes(&self, kind: RaySetKind) -> &'static [&'static str] {
        match kind.is_occlusion() {
            true => &OCCLUSION_MODES,
            false => &OCCLUSION_MODES[1..],
        }
    }

    fn closest_hits(&self, _: usize, rays: RayChunk<'_>, mut hits: HitChunk<'_>) {
        hits.fill(rays.rays, |ray| self.closest(ray));
    }

    fn occluded(&self, mode: usize, rays: RayChunk<'_>, occluded: &mut [bool]) {
        for (ray, occluded) in rays.rays.iter().zip(occluded) {
            *occluded = match mode {
                0 => self.is_any_hit(ray),
                _ => self.closest(ray).is_some(),
            };
        }
    }

    fn sah_cost(&self) -> Option<f64> {
        let cost = |bounds: Aabb, triangles| bvh_cost::Node {
            min: bounds.mins.into(),
            max: bounds.maxs.into(),
            triangles,
        };
        let mut nodes = vec![cost(self.tree.root_aabb(), 0)];
        self.tree.traverse(|node: &BvhNode| {
            nodes.push(cost(node.aabb(), usize::from(node.is_leaf())));
            TraversalAction::Continue
        });
        bvh_cost::sah_cost(nodes)
    }
}

impl Built<'_> {
    #[inline(always)]
    fn test(&self, cast: &ParryRay, ray: &Ray, index: u32, t_max: f32) -> Option<f32> {
        let t = self.triangles[index as usize].cast_local_ray(cast, t_max, true)?;
        (t >= ray.t_min).then_some(t)
    }

    fn closest(&self, ray: &Ray) -> Option<(f32, u32)> {
        let cast = converted(ray);
        let test = |index, closest| self.test(&cast, ray, index, closest);
        let (index, t) = self.tree.cast_ray(&cast, ray.t_max, test)?;
        Some((t, index))
    }

    fn is_any_hit(&self, ray: &Ray) -> bool {
        let cast = converted(ray);
        let mut hit = false;
        self.tree.traverse(|node: &BvhNode| {
            if node.cast_ray(&cast, ray.t_max) > ray.t_max {
                return TraversalAction::Prune;
            }
            if let Some(index) = node.leaf_data() {
                hit |= self.test(&cast, ray, index, ray.t_max).is_some();
            }
            match hit {
                true => TraversalAction::EarlyExit,
                false => TraversalAction::Continue,
            }
        });
        hit
    }
}

fn converted(ray: &Ray) -> ParryRay {
    ParryRay::new(ray.origin.into(), ray.direction.into())
}
