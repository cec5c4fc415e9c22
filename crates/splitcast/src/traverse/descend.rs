//! Front-to-back descent of one ray: the loop that every single-ray query
//! shares (Havran 2000, the recursive algorithm with a fixed stack).
//!
//! No hit depends on where planes lie: a hit at `t` is a point `q` of the
//! triangle, `q` lies in some leaf that lists the triangle, and the ray's
//! point at `t` is no farther from `q` than the errors of the triangle test.
//! Descent widens every interval by at least as much on every axis, so that
//! it never drops the leaf of `q` while `t` is in range.

use std::ops::ControlFlow;

use crate::aabb::{lower, upper};
use crate::build::MAX_DEPTH;
use crate::kd_tree::NodeKind;
use crate::{KdTree, Ray};

/// Widening of all intervals in space, relative to the reach, the distance
/// from the ray's origin to the farthest point of the tree. In units of 2⁻²⁴
/// of the reach, a hit's `t` is off by 1 at most, the distance to a plane by 5 and
/// its interval's ends by 1, and [`SLOWEST`] adds less than 1; this is 16.
const SLACK: f32 = 1.0 / (1 << 20) as f32;

/// Components of the direction count as no smaller than this share of the
/// largest. Keeps distances to planes finite for rays parallel to an axis, and
/// moves no point of the ray inside the tree by more than a fraction of the
/// slack.
const SLOWEST: f32 = 1.0 / (1 << 30) as f32;

/// What a ray met on its way.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct TraversalCounts {
    /// Inner nodes visited.
    pub inner_nodes: u32,
    /// Leaves visited.
    pub leaves: u32,
    /// Triangles tested, a triangle met in two leaves counted twice.
    pub triangles: u32,
}

/// What a query does with the leaves that a ray meets, nearest first.
pub(super) trait LeafVisitor {
    /// Tests the triangles of a leaf: the first `count` of `references`, which
    /// other leaves' follow. `Break` ends the descent.
    fn visit(&mut self, references: &[u32], count: usize) -> ControlFlow<()>;

    /// Leaves that begin beyond this distance are of no interest any more.
    fn t_max(&self) -> f32;
}

/// Visits all leaves that a valid ray meets between `enter` and `exit`, its
/// [interval in the tree's box](PlaneDistances::clip_to_box), and within the
/// visitor's range.
#[inline(always)]
pub(super) fn descend(
    tree: &KdTree<'_>,
    planes: &PlaneDistances,
    (mut enter, mut exit): (f32, f32),
    visitor: &mut impl LeafVisitor,
) -> TraversalCounts {
    let mut counts = TraversalCounts::default();
    let nodes = tree.nodes();
    // Nodes still to be visited, and their intervals. Three arrays rather than one of tuples:
    // each is short enough to be cleared without a call.
    let mut waiting = [0u32; MAX_DEPTH as usize];
    let mut enters = [0.0f32; MAX_DEPTH as usize];
    let mut exits = [0.0f32; MAX_DEPTH as usize];
    let mut top = 0;
    let mut index = 0;
    loop {
        match nodes[index].kind() {
            NodeKind::Inner {
                axis,
                position,
                right,
            } => {
                counts.inner_nodes += 1;
                let left = index + 1;
                let (first, second) = if planes.inverse[axis] < 0.0 {
                    (right, left)
                } else {
                    (left, right)
                };
                let (low, high) = planes.to(axis, position);
                // NaN, from overflow only, makes every comparison fail: both sides are visited
                // over the whole interval.
                if high < enter {
                    index = second;
                } else if low > exit {
                    index = first;
                } else {
                    index = first;
                    waiting[top] = second as u32;
                    enters[top] = upper(enter, low);
                    exits[top] = exit;
                    top += 1;
                    exit = lower(exit, high);
                }
            }
            NodeKind::Leaf { first, count } => {
                counts.leaves += 1;
                counts.triangles += count as u32;
                let references = &tree.references()[first..];
                if visitor.visit(references, count).is_break() {
                    return counts;
                }
                loop {
                    if top == 0 {
                        return counts;
                    }
                    top -= 1;
                    if enters[top] <= visitor.t_max() {
                        index = waiting[top] as usize;
                        enter = enters[top];
                        exit = exits[top];
                        break;
                    }
                }
            }
        }
    }
}

/// Distances along one ray to axis-aligned planes, with their slack.
pub(super) struct PlaneDistances {
    origin: [f32; 3],
    inverse: [f32; 3],
    /// The slack in space, turned into one of distance on each axis.
    slack: [f32; 3],
}

impl PlaneDistances {
    /// `reach` is the tree's from the ray's origin ([`Aabb::reach`](crate::Aabb::reach)).
    #[inline(always)]
    pub(super) fn new(ray: &Ray, reach: f32) -> Self {
        let [x, y, z] = ray.direction;
        let fastest = upper(upper(x.abs(), y.abs()), z.abs());
        let slowest = fastest * SLOWEST;
        let slack = reach * SLACK;
        let inverse = [
            upper(x.abs(), slowest).copysign(x).recip(),
            upper(y.abs(), slowest).copysign(y).recip(),
            upper(z.abs(), slowest).copysign(z).recip(),
        ];
        Self {
            origin: ray.origin,
            inverse,
            slack: [
                inverse[0].abs() * slack,
                inverse[1].abs() * slack,
                inverse[2].abs() * slack,
            ],
        }
    }

    /// The earliest and the latest distance at which the ray may pass the plane.
    #[inline(always)]
    fn to(&self, axis: usize, position: f32) -> (f32, f32) {
        let t = (position - self.origin[axis]) * self.inverse[axis];
        (t - self.slack[axis], t + self.slack[axis])
    }

    /// The part of the ray's range inside the tree's box.
    #[inline(always)]
    pub(super) fn clip_to_box(&self, tree: &KdTree<'_>, ray: &Ray) -> Option<(f32, f32)> {
        let bounds = tree.bounds();
        let (mut enter, mut exit) = (ray.t_min, ray.t_max);
        for axis in 0..3 {
            let (mut near, mut far) = (bounds.min[axis], bounds.max[axis]);
            if self.inverse[axis] < 0.0 {
                std::mem::swap(&mut near, &mut far);
            }
            // Both drop NaN.
            enter = upper(enter, self.to(axis, near).0);
            exit = lower(exit, self.to(axis, far).1);
        }
        (enter <= exit).then_some((enter, exit))
    }
}
