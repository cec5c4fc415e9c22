//! Front-to-back descent of one ray: the loop that every single-ray query
//! shares (Havran 2000, the recursive algorithm with a fixed stack).
//!
//! Distances to planes carry rounding errors of a few units in the last
//! place, the triangle test others. Intervals are therefore widened by
//! [`SLACK`] wherever a subtree would be dropped: near a plane both sides are
//! visited, so that no hit depends on where planes lie.

use std::ops::ControlFlow;

use crate::build::MAX_DEPTH;
use crate::kd_tree::NodeKind;
use crate::{KdTree, Ray};

/// Relative widening of distances. A plane's distance `(s - o) * (1 / d)` is
/// off by at most 1.5 units of 2⁻²³ and the triangle test's by a few more;
/// 2⁻²⁰ covers both with room and costs no measurable visits.
const SLACK: f32 = 9.536_743e-7;

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
    /// Tests the triangles of a leaf. `Break` ends the descent.
    fn visit(&mut self, references: &[u32]) -> ControlFlow<()>;

    /// Leaves that begin beyond this distance are of no interest any more.
    fn t_max(&self) -> f32;
}

/// Visits all leaves that the ray meets within its range and the visitor's.
pub(super) fn descend(
    tree: &KdTree<'_>,
    ray: &Ray,
    visitor: &mut impl LeafVisitor,
) -> TraversalCounts {
    let mut counts = TraversalCounts::default();
    let inverse = ray.direction.map(f32::recip);
    let Some((mut enter, mut exit)) = clip_to_box(tree, ray, inverse) else {
        return counts;
    };
    let nodes = tree.nodes();
    let mut stack = [(0, 0.0, 0.0); MAX_DEPTH as usize];
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
                // The sign of the inverse, not of the direction: it also orders -0.
                let (first, second) = if inverse[axis] < 0.0 {
                    (right, left)
                } else {
                    (left, right)
                };
                let t = (position - ray.origin[axis]) * inverse[axis];
                // A ray that runs inside the plane has t = 0 · ∞ = NaN: no comparison holds, and
                // both sides are visited over the whole interval.
                let (wide, narrow) = (t * (1.0 + SLACK), t * (1.0 - SLACK));
                let (low, high) = (wide.min(narrow), wide.max(narrow));
                if high < enter {
                    index = second;
                } else if low > exit {
                    index = first;
                } else {
                    index = first;
                    stack[top] = (second, low.max(enter), exit);
                    top += 1;
                    exit = high.min(exit);
                }
            }
            NodeKind::Leaf { first, count } => {
                counts.leaves += 1;
                counts.triangles += count as u32;
                if visitor
                    .visit(&tree.references()[first..first + count])
                    .is_break()
                {
                    return counts;
                }
                loop {
                    if top == 0 {
                        return counts;
                    }
                    top -= 1;
                    (index, enter, exit) = stack[top];
                    if enter <= visitor.t_max() {
                        break;
                    }
                }
            }
        }
    }
}

/// The part of the ray's range inside the tree's box, widened by the slack.
fn clip_to_box(tree: &KdTree<'_>, ray: &Ray, inverse: [f32; 3]) -> Option<(f32, f32)> {
    let bounds = tree.bounds();
    let (mut enter, mut exit) = (ray.t_min, ray.t_max);
    for axis in 0..3 {
        let (min, max, origin) = (bounds.min[axis], bounds.max[axis], ray.origin[axis]);
        if inverse[axis].is_finite() {
            let (a, b) = (
                (min - origin) * inverse[axis],
                (max - origin) * inverse[axis],
            );
            let (near, far) = (a.min(b), a.max(b));
            enter = enter.max(near - near.abs() * SLACK);
            exit = exit.min(far + far.abs() * SLACK);
        } else if origin < min || origin > max {
            return None;
        }
    }
    (enter <= exit).then_some((enter, exit))
}
