//! Whether every point of a triangle lies in a leaf that lists it.
//!
//! The triangle is clipped down the tree (Sutherland & Hodgman 1974) in double
//! precision, which follows no builder's way of sorting triangles into nodes.

use super::Violation;
use crate::{KdTree, NodeKind};

/// How far, relative to its largest coordinate, a triangle may reach into a
/// leaf without being listed there. Clipping errs by some units of 2⁻⁵²;
/// positions are known to 2⁻²⁴, and traversal widens intervals by more than
/// that (`traverse/descend.rs`), so that such a sliver is never missed.
const TOLERANCE: f64 = 1.0 / (1u64 << 40) as f64;

/// The tree's references with each leaf's share sorted, for binary search.
pub(super) struct SortedLeaves {
    references: Vec<u32>,
}

impl SortedLeaves {
    pub(super) fn new(tree: &KdTree<'_>) -> Self {
        let mut references = tree.references().to_vec();
        for (_, first, count) in tree.leaves() {
            references[first..first + count].sort_unstable();
        }
        Self { references }
    }

    /// The triangles of one leaf.
    pub(super) fn of(&self, first: usize, count: usize) -> &[u32] {
        &self.references[first..first + count]
    }
}

/// What is wrong with the places in which one triangle is listed.
pub(super) fn uncovered_parts(
    tree: &KdTree<'_>,
    leaves: &SortedLeaves,
    triangle: u32,
) -> Vec<Violation> {
    let (corners, bounds) = (tree.mesh().corners(triangle), tree.bounds());
    let inside = |corner: &[f32; 3]| {
        (0..3).all(|axis| (bounds.min[axis]..=bounds.max[axis]).contains(&corner[axis]))
    };
    if !corners.iter().all(inside) {
        return vec![Violation::OutsideBounds { triangle }];
    }
    let coordinates = corners.as_flattened().iter();
    let largest = coordinates.fold(0.0f32, |largest, x| largest.max(x.abs()));
    let search = Coverage {
        tree,
        leaves,
        triangle,
        tolerance: f64::from(largest) * TOLERANCE,
    };
    let whole = corners.map(|corner| corner.map(f64::from)).to_vec();
    let mut missing = Vec::new();
    search.walk(0, whole, &mut missing);
    let violations = missing.into_iter().map(|(node, part)| {
        let sum = |axis: usize| part.iter().map(|point| point[axis]).sum::<f64>();
        Violation::MissingReference {
            node,
            triangle,
            point: [0, 1, 2].map(|axis| (sum(axis) / part.len() as f64) as f32),
        }
    });
    violations.collect()
}

/// A convex planar polygon.
type Polygon = Vec<[f64; 3]>;

/// The search for parts of one triangle that no leaf with the triangle covers.
struct Coverage<'s, 'm> {
    tree: &'s KdTree<'m>,
    leaves: &'s SortedLeaves,
    triangle: u32,
    tolerance: f64,
}

impl Coverage<'_, '_> {
    /// Appends the leaves below `node` that `part` overlaps and that do not list the triangle.
    fn walk(&self, node: usize, part: Polygon, missing: &mut Vec<(usize, Polygon)>) {
        match self.tree.nodes()[node].kind() {
            NodeKind::Leaf { first, count } => {
                let listed = self.leaves.of(first, count);
                if listed.binary_search(&self.triangle).is_err() {
                    missing.push((node, part));
                }
            }
            NodeKind::Inner {
                axis,
                position,
                right,
            } => {
                let plane = f64::from(position);
                let reaches = |sign: f64| {
                    let reach = part.iter().map(|point| sign * (point[axis] - plane));
                    reach.fold(f64::NEG_INFINITY, f64::max) > self.tolerance
                };
                let left = node + 1;
                match (reaches(-1.0), reaches(1.0)) {
                    (true, true) => {
                        self.walk(left, clip(&part, axis, plane, -1.0), missing);
                        self.walk(right, clip(&part, axis, plane, 1.0), missing);
                    }
                    (true, false) => self.walk(left, part, missing),
                    (false, true) => self.walk(right, part, missing),
                    // In the plane: either side will do, even one for each part.
                    (false, false) => {
                        let mut missing_left = Vec::new();
                        self.walk(left, part, &mut missing_left);
                        for (_, part) in missing_left {
                            self.walk(right, part, missing);
                        }
                    }
                }
            }
        }
    }
}

/// The part of a polygon on the side of the plane to which `sign` points.
fn clip(polygon: &[[f64; 3]], axis: usize, plane: f64, sign: f64) -> Polygon {
    let mut clipped = Polygon::with_capacity(polygon.len() + 1);
    let height = |point: [f64; 3]| sign * (point[axis] - plane);
    let mut previous = polygon[polygon.len() - 1];
    for &point in polygon {
        let (before, here) = (height(previous), height(point));
        if (before < 0.0 && here > 0.0) || (before > 0.0 && here < 0.0) {
            let share = before / (before - here);
            let mut crossing: [f64; 3] =
                std::array::from_fn(|k| previous[k] + share * (point[k] - previous[k]));
            crossing[axis] = plane;
            clipped.push(crossing);
        }
        if here >= 0.0 {
            clipped.push(point);
        }
        previous = point;
    }
    clipped
}
