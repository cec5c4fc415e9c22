//! bvh: trees of boxes by binned surface areas, rebuilt for every frame.
//!
//! Its update of moved shapes is left out: after an update of all shapes traversal is slow
//! and soon overflows the iterator's fixed stack. Its test of a ray against a triangle sees
//! one side only and takes small triangles for none, so another is used.

use std::cell::Cell;

use bvh::aabb::{Aabb, Bounded, IntersectsAabb};
use bvh::bounding_hierarchy::{BHShape, BoundingHierarchy};
use bvh::bvh::{Bvh, BvhNode};
use bvh::ray::Ray as BvhRay;
use nalgebra::{Point3, Vector3};
use rayon::prelude::*;
use splitcast::{Mesh, Ray};

use super::triangle_test::Triangle;
use super::{Catalog, bvh_cost};
use crate::rays::RaySetKind;
use crate::system::{CatalogEntry, FrameMesh, HitChunk, RayChunk, System, SystemError, Tracer};

/// Adds the one system.
pub(super) fn add_to(catalog: &mut Catalog) {
    catalog.entries.push(CatalogEntry {
        name: "bvh".to_owned(),
        family: "bvh",
        about: "bvh 0.13, BVH, rebuilt by binned surface areas".to_owned(),
        yardstick: None,
        make: Box::new(|threads| {
            Ok(Box::new(Rebuilt {
                threads,
                shapes: Vec::new(),
            }))
        }),
    });
}

/// A triangle as the library takes it.
struct Shape {
    bounds: Aabb<f32, 3>,
    triangle: Triangle,
    index: u32,
    node: usize,
}

impl Shape {
    fn new(mesh: Mesh<'_>, index: u32) -> Self {
        let bounds = mesh.triangle_bounds(index);
        Self {
            bounds: Aabb::with_bounds(bounds.min.into(), bounds.max.into()),
            triangle: Triangle::new(mesh.corners(index)),
            index,
            node: 0,
        }
    }
}

impl Bounded<f32, 3> for Shape {
    fn aabb(&self) -> Aabb<f32, 3> {
        self.bounds
    }
}

impl BHShape<f32, 3> for Shape {
    fn set_bh_node_index(&mut self, node: usize) {
        self.node = node;
    }

    fn bh_node_index(&self) -> usize {
        self.node
    }
}

struct Rebuilt {
    threads: usize,
    shapes: Vec<Shape>,
}

impl System for Rebuilt {
    fn update<'s>(&'s mut self, frame: FrameMesh<'s>) -> Result<Box<dyn Tracer + 's>, SystemError> {
        let mesh = frame.mesh;
        (0..mesh.triangles().len() as u32)
            .into_par_iter()
            .map(|index| Shape::new(mesh, index))
            .collect_into_vec(&mut self.shapes);
        let tree = match self.threads {
            1 => Bvh::build(&mut self.shapes),
            _ => Bvh::build_par(&mut self.shapes),
        };
        Ok(Box::new(Built {
            tree,
            shapes: &self.shapes,
        }))
    }
}

struct Built<'s> {
    tree: Bvh<f32, 3>,
    shapes: &'s [Shape],
}

const CLOSEST_MODES: [&str; 3] = ["all boxes in reach", "all boxes", "nearest box first"];

impl Tracer for Built<'_> {
    fn modes(&self, kind: RaySetKind) -> &'static [&'static str] {
        // Which hit comes first does not matter to occlusion.
        match kind.is_occlusion() {
            true => &CLOSEST_MODES[..2],
            false => &CLOSEST_MODES,
        }
    }

    fn closest_hits(&self, mode: usize, rays: RayChunk<'_>, mut hits: HitChunk<'_>) {
        hits.fill(rays.rays, |ray| match mode {
            0 => self.closest_in_reach(ray),
            1 => self.closest_of_all(ray),
            _ => self.closest_in_order(ray),
        });
    }

    fn occluded(&self, mode: usize, rays: RayChunk<'_>, occluded: &mut [bool]) {
        for (ray, occluded) in rays.rays.iter().zip(occluded) {
            *occluded = match mode {
                0 => self.is_any_hit(ray, &Reach::new(ray)),
                _ => self.is_any_hit(ray, &converted(ray)),
            };
        }
    }

    fn sah_cost(&self) -> Option<f64> {
        let node = |bounds: &Aabb<f32, 3>, triangles| bvh_cost::Node {
            min: bounds.min.into(),
            max: bounds.max.into(),
            triangles,
        };
        let children = self.tree.nodes.iter().flat_map(|parent| match parent {
            BvhNode::Node {
                child_l_index,
                child_l_aabb,
                child_r_index,
                child_r_aabb,
                ..
            } => {
                let child = |index: usize, bounds| {
                    let is_leaf = matches!(self.tree.nodes[index], BvhNode::Leaf { .. });
                    Some(node(bounds, usize::from(is_leaf)))
                };
                [
                    child(*child_l_index, child_l_aabb),
                    child(*child_r_index, child_r_aabb),
                ]
            }
            BvhNode::Leaf { .. } => [None, None],
        });
        let mut bounds = Aabb::empty();
        for shape in self.shapes {
            bounds.join_mut(&shape.bounds);
        }
        let root = node(&bounds, usize::from(self.shapes.len() == 1));
        let nodes = std::iter::once(root).chain(children.flatten());
        bvh_cost::sah_cost(nodes)
    }
}

impl Built<'_> {
    /// Goes through the boxes in the tree's order, up to the closest hit so far.
    fn closest_in_reach(&self, ray: &Ray) -> Option<(f32, u32)> {
        let reach = Reach::new(ray);
        let mut closest = Closest::new(ray);
        for shape in self.tree.traverse_iterator(&reach, self.shapes) {
            closest.test(shape);
            reach.t_max.set(closest.ray.t_max);
        }
        closest.found
    }

    /// Goes through all boxes that the ray passes, by the library's vectorized test.
    fn closest_of_all(&self, ray: &Ray) -> Option<(f32, u32)> {
        let passing = converted(ray);
        let mut closest = Closest::new(ray);
        for shape in self.tree.traverse_iterator(&passing, self.shapes) {
            closest.test(shape);
        }
        closest.found
    }

    fn is_any_hit(&self, ray: &Ray, query: &impl IntersectsAabb<f32, 3>) -> bool {
        let mut boxes = self.tree.traverse_iterator(query, self.shapes);
        boxes.any(|shape| shape.triangle.hit(ray).is_some())
    }

    /// Goes through the boxes by their distance, until they start behind the closest hit.
    fn closest_in_order(&self, ray: &Ray) -> Option<(f32, u32)> {
        let in_order = converted(ray);
        let mut closest = Closest::new(ray);
        for shape in self.tree.nearest_traverse_iterator(&in_order, self.shapes) {
            let ends = in_order.intersection_slice_for_aabb(&shape.bounds);
            if ends.is_some_and(|(near, _)| near > closest.ray.t_max) {
                break;
            }
            closest.test(shape);
        }
        closest.found
    }
}

/// The closest hit so far, behind which the ray ends.
struct Closest {
    ray: Ray,
    found: Option<(f32, u32)>,
}

impl Closest {
    fn new(ray: &Ray) -> Self {
        Self {
            ray: *ray,
            found: None,
        }
    }

    #[inline(always)]
    fn test(&mut self, shape: &Shape) {
        if let Some(t) = shape.triangle.hit(&self.ray) {
            self.ray.t_max = t;
            self.found = Some((t, shape.index));
        }
    }
}

/// Asks for boxes that start before a distance.
struct Reach {
    ray: BvhRay<f32, 3>,
    t_max: Cell<f32>,
}

impl Reach {
    fn new(ray: &Ray) -> Self {
        Self {
            ray: converted(ray),
            t_max: Cell::new(ray.t_max),
        }
    }
}

impl IntersectsAabb<f32, 3> for Reach {
    fn intersects_aabb(&self, bounds: &Aabb<f32, 3>) -> bool {
        let ends = self.ray.intersection_slice_for_aabb(bounds);
        ends.is_some_and(|(near, _)| near <= self.t_max.get())
    }
}

/// The ray from its origin on. Its direction has unit length, and is left as it is.
fn converted(ray: &Ray) -> BvhRay<f32, 3> {
    let direction = Vector3::from(ray.direction);
    BvhRay {
        origin: Point3::from(ray.origin),
        direction,
        inv_direction: direction.map(f32::recip),
    }
}
