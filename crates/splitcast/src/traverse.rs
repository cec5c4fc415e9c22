//! Rays through the tree.

mod descend;
mod triangle;

use std::ops::ControlFlow;

pub use descend::TraversalCounts;

use crate::{Hit, KdTree, Ray};
use descend::{LeafVisitor, descend};
use triangle::ShearedRay;

impl KdTree<'_> {
    /// The nearest hit along the ray within its range; of hits at the same
    /// distance, the one on the triangle with the lowest index.
    pub fn closest_hit(&self, ray: &Ray) -> Option<Hit> {
        self.closest_hit_counted(ray).0
    }

    /// [`KdTree::closest_hit`], and what it took.
    pub fn closest_hit_counted(&self, ray: &Ray) -> (Option<Hit>, TraversalCounts) {
        struct Closest<'t, 'm> {
            tree: &'t KdTree<'m>,
            sheared: ShearedRay,
            t_min: f32,
            t_max: f32,
            hit: Option<Hit>,
        }
        impl LeafVisitor for Closest<'_, '_> {
            fn visit(&mut self, references: &[u32]) -> ControlFlow<()> {
                for &triangle in references {
                    let corners = self.tree.mesh().corners(triangle);
                    if let Some((t, u, v)) = self.sheared.intersect(&corners)
                        && t >= self.t_min
                        && t <= self.t_max
                        && self
                            .hit
                            .is_none_or(|hit| t < hit.t || triangle < hit.triangle)
                    {
                        self.t_max = t;
                        self.hit = Some(Hit { t, u, v, triangle });
                    }
                }
                ControlFlow::Continue(())
            }

            fn t_max(&self) -> f32 {
                self.t_max
            }
        }
        let Some(sheared) = ShearedRay::new(ray) else {
            return (None, TraversalCounts::default());
        };
        let mut closest = Closest {
            tree: self,
            sheared,
            t_min: ray.t_min,
            t_max: ray.t_max,
            hit: None,
        };
        let counts = descend(self, ray, &mut closest);
        (closest.hit, counts)
    }

    /// Whether anything is hit along the ray within its range. Cheaper than
    /// [`KdTree::closest_hit`]: the first hit found will do.
    pub fn occluded(&self, ray: &Ray) -> bool {
        struct Any<'t, 'm> {
            tree: &'t KdTree<'m>,
            sheared: ShearedRay,
            t_min: f32,
            t_max: f32,
            occluded: bool,
        }
        impl LeafVisitor for Any<'_, '_> {
            fn visit(&mut self, references: &[u32]) -> ControlFlow<()> {
                for &triangle in references {
                    let corners = self.tree.mesh().corners(triangle);
                    if let Some((t, _, _)) = self.sheared.intersect(&corners)
                        && t >= self.t_min
                        && t <= self.t_max
                    {
                        self.occluded = true;
                        return ControlFlow::Break(());
                    }
                }
                ControlFlow::Continue(())
            }

            fn t_max(&self) -> f32 {
                self.t_max
            }
        }
        let Some(sheared) = ShearedRay::new(ray) else {
            return false;
        };
        let mut any = Any {
            tree: self,
            sheared,
            t_min: ray.t_min,
            t_max: ray.t_max,
            occluded: false,
        };
        descend(self, ray, &mut any);
        any.occluded
    }
}
