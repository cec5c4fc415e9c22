//! kdtree-ray: the only other kd-tree among the libraries, rebuilt for every frame.
//!
//! It lists all triangles in the leaves that a ray passes, from which the closest
//! hit has to be found; neither order nor an end of the ray can be had. It builds on threads
//! of its own, as many as there are processors; beside a single thread they share its one.

use cgmath::Vector3;
use kdtree_ray::{AABB, Bounded, KDTree};
use splitcast::{Aabb, Ray};

use super::Catalog;
use super::triangle_test::Triangle;
use crate::system::{CatalogEntry, FrameMesh, HitChunk, RayChunk, System, SystemError, Tracer};

/// Adds the one system.
pub(super) fn add_to(catalog: &mut Catalog) {
    catalog.entries.push(CatalogEntry {
        name: "kdtree-ray".to_owned(),
        family: "kdtree-ray",
        about: "kdtree-ray 1.2, kd-tree, rebuilt by surface areas".to_owned(),
        yardstick: None,
        make: Box::new(|_| Ok(Box::<Rebuilt>::default())),
    });
}

/// A triangle's box as the library takes it.
struct Bounds(Aabb);

impl Bounded for Bounds {
    fn bound(&self) -> AABB {
        AABB::new(self.0.min.into(), self.0.max.into())
    }
}

#[derive(Default)]
struct Rebuilt {
    bounds: Vec<Bounds>,
    triangles: Vec<Triangle>,
}

impl System for Rebuilt {
    fn update<'s>(&'s mut self, frame: FrameMesh<'s>) -> Result<Box<dyn Tracer + 's>, SystemError> {
        let mesh = frame.mesh;
        let indices = 0..mesh.triangles().len() as u32;
        if indices.is_empty() {
            return Err(SystemError("panics on a mesh without triangles".to_owned()));
        }
        self.bounds.clear();
        let bounds = indices
            .clone()
            .map(|index| Bounds(mesh.triangle_bounds(index)));
        self.bounds.extend(bounds);
        self.triangles.clear();
        let triangles = indices.map(|index| Triangle::new(mesh.corners(index)));
        self.triangles.extend(triangles);
        Ok(Box::new(Built {
            tree: KDTree::build(&self.bounds),
            triangles: &self.triangles,
        }))
    }
}

struct Built<'s> {
    tree: KDTree,
    triangles: &'s [Triangle],
}

impl Built<'_> {
    /// Numbers of all triangles that a ray may hit.
    fn candidates(&self, ray: &Ray) -> Vec<usize> {
        let origin = Vector3::from(ray.origin);
        self.tree.intersect(&origin, &Vector3::from(ray.direction))
    }
}

impl Tracer for Built<'_> {
    fn closest_hits(&self, _: usize, rays: RayChunk<'_>, mut hits: HitChunk<'_>) {
        hits.fill(rays.rays, |ray| {
            let mut ray = *ray;
            let mut closest = None;
            for index in self.candidates(&ray) {
                if let Some(t) = self.triangles[index].hit(&ray) {
                    ray.t_max = t;
                    closest = Some((t, index as u32));
                }
            }
            closest
        });
    }

    fn occluded(&self, _: usize, rays: RayChunk<'_>, occluded: &mut [bool]) {
        for (ray, occluded) in rays.rays.iter().zip(occluded) {
            let mut candidates = self.candidates(ray).into_iter();
            *occluded = candidates.any(|index| self.triangles[index].hit(ray).is_some());
        }
    }
}
