//! Queries without a tree, for verification: every ray is tested against
//! every triangle, in time proportional to their number.
//!
//! They use the tree's own ray–triangle test (without its fast rejection), so
//! a [`KdTree`](crate::KdTree) query over the same mesh has to give the same
//! result to the last bit.

use super::{All, Any, Closest, HitSink, test_triangle};
use crate::traverse::triangle::ShearedRay;
use crate::{Hit, Mesh, Ray};

/// What [`KdTree::closest_hit`](crate::KdTree::closest_hit) has to give.
pub fn closest_hit(mesh: Mesh<'_>, ray: &Ray) -> Option<Hit> {
    let mut closest = Closest::new(ray);
    test_all(mesh, ray, &mut closest);
    closest.into_hit(mesh)
}

/// What [`KdTree::occluded`](crate::KdTree::occluded) has to give.
pub fn occluded(mesh: Mesh<'_>, ray: &Ray) -> bool {
    let mut any = Any::new(ray);
    test_all(mesh, ray, &mut any);
    any.found
}

/// What [`KdTree::all_hits`](crate::KdTree::all_hits) has to give.
pub fn all_hits(mesh: Mesh<'_>, ray: &Ray, hits: &mut Vec<Hit>) {
    let mut all = All::new(ray, hits);
    test_all(mesh, ray, &mut all);
    all.finish(mesh);
}

/// Tests all triangles that a builder would not leave out.
fn test_all(mesh: Mesh<'_>, ray: &Ray, sink: &mut impl HitSink) {
    if let Some(sheared) = ShearedRay::new(ray) {
        let mut traceable =
            (0..mesh.triangles().len() as u32).filter(|&triangle| mesh.is_traceable(triangle));
        // Whether the sink wanted more is of no interest: there is no more.
        let _ = traceable
            .try_for_each(|triangle| test_triangle(mesh, &sheared, ray.t_min, triangle, sink));
    }
}
