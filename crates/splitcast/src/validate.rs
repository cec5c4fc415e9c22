//! Proof that a tree is whole.
//!
//! What queries rely on: nodes in depth-first order, planes inside their
//! cells, leaves that share out the references, and every point of every
//! triangle inside a leaf that holds the triangle. The last is checked by
//! clipping each triangle down the tree (Sutherland & Hodgman 1974) in double
//! precision, which follows no builder's way of sorting triangles into nodes.

use rayon::prelude::*;

use crate::build::MAX_DEPTH;
use crate::{Aabb, KdTree, NodeKind};

/// How far, relative to its largest coordinate, a triangle may reach into a
/// leaf without being listed there. Clipping errs by some units of 2⁻⁵²;
/// positions are known to 2⁻²⁴, and traversal widens intervals by more than
/// that (`traverse/descend.rs`), so that such a sliver is never missed.
const TOLERANCE: f64 = 1.0 / (1u64 << 40) as f64;

/// Violations of one kind that are reported at most: a broken tree can have
/// as many as it has references.
const MAX_REPORTED: usize = 16;

/// Triangles handled by one task.
const CHUNK: usize = 256;

/// A way in which a tree is not what queries rely on.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum Violation {
    /// A split plane lies outside the node's cell, or is not a number.
    #[error(
        "node {node} splits axis {axis} at {position}, expected a position \
         from {min} to {max}, the extent of its cell"
    )]
    SplitOutsideCell {
        /// Index of the node.
        node: usize,
        /// 0, 1 or 2 for x, y or z.
        axis: usize,
        /// Coordinate of the plane.
        position: f32,
        /// Lower end of the cell on that axis.
        min: f32,
        /// Upper end of the cell on that axis.
        max: f32,
    },
    /// A right child that does not follow its sibling's subtree: some node is
    /// lost, shared, or part of a cycle.
    #[error(
        "node {node} has its right child at {right}, expected {expected}, \
         right after its left subtree"
    )]
    ChildOutOfOrder {
        /// Index of the inner node.
        node: usize,
        /// The right child it names.
        right: usize,
        /// The right child in depth-first order.
        expected: usize,
    },
    /// An inner node without room for its children.
    #[error("node {node} is an inner node, but the nodes end at {nodes} before its children do")]
    MissingChild {
        /// Index of the inner node.
        node: usize,
        /// Number of nodes.
        nodes: usize,
    },
    /// Nodes after the end of the root's subtree.
    #[error("nodes from {first} on belong to no parent: the tree ends before them")]
    OrphanedNodes {
        /// The first such node.
        first: usize,
    },
    /// A node deeper than traversal's stack can hold.
    #[error("node {node} has depth {depth}, expected at most {MAX_DEPTH}")]
    TooDeep {
        /// Index of the node.
        node: usize,
        /// Its depth.
        depth: usize,
    },
    /// A leaf whose references do not exist.
    #[error(
        "leaf {node} owns references {first} to {}, but there are only {references}",
        first.saturating_add(*count)
    )]
    ReferencesOutOfRange {
        /// Index of the leaf.
        node: usize,
        /// Its first reference.
        first: usize,
        /// Its number of references.
        count: usize,
        /// Number of references in the tree.
        references: usize,
    },
    /// A reference that two leaves own.
    #[error("reference {reference} is owned by leaf {first} and by leaf {second}")]
    SharedReference {
        /// Index of the reference.
        reference: usize,
        /// Index of one leaf.
        first: usize,
        /// Index of the other leaf.
        second: usize,
    },
    /// A reference that no leaf owns.
    #[error("reference {reference} is owned by no leaf")]
    UnownedReference {
        /// Index of the reference.
        reference: usize,
    },
    /// A reference to a triangle that the mesh does not have.
    #[error("reference {reference} names triangle {triangle}, but there are only {triangles}")]
    TriangleOutOfRange {
        /// Index of the reference.
        reference: usize,
        /// The triangle it names.
        triangle: u32,
        /// Number of triangles in the mesh.
        triangles: usize,
    },
    /// A triangle that stands in a leaf more than once.
    #[error("leaf {node} holds triangle {triangle} more than once")]
    DuplicateReference {
        /// Index of the leaf.
        node: usize,
        /// The triangle.
        triangle: u32,
    },
    /// A triangle that is to be left out but stands in a leaf.
    #[error("leaf {node} holds triangle {triangle}, which has a corner that cannot be traced")]
    UntraceableTriangle {
        /// Index of the leaf.
        node: usize,
        /// The triangle.
        triangle: u32,
    },
    /// The count of triangles left out is wrong.
    #[error(
        "the tree reports {reported} skipped triangles, expected {expected}, \
         the number of those with a corner that cannot be traced"
    )]
    SkippedCount {
        /// What [`KdTree::skipped_triangles`] says.
        reported: usize,
        /// How many there are.
        expected: usize,
    },
    /// A triangle that sticks out of the tree's box.
    #[error("triangle {triangle} reaches out of the tree's bounds")]
    OutsideBounds {
        /// The triangle.
        triangle: u32,
    },
    /// A leaf that a triangle overlaps but is not listed in.
    #[error(
        "triangle {triangle} overlaps the cell of leaf {node} near ({}, {}, {}) \
         but is not listed there",
        point[0], point[1], point[2]
    )]
    MissingReference {
        /// Index of the leaf.
        node: usize,
        /// The triangle.
        triangle: u32,
        /// A point of the triangle inside the leaf's cell.
        point: [f32; 3],
    },
}

impl KdTree<'_> {
    /// Checks everything that queries rely on, in time that grows with the
    /// number of references times the depth.
    ///
    /// # Errors
    /// The violations in the order of nodes, then of triangles; of each kind no more than 16.
    /// Leaves are searched for missing triangles only if the tree's
    /// structure is sound.
    pub fn validate(&self) -> Result<(), Vec<Violation>> {
        let mut violations = Violations::default();
        self.check_structure(&mut violations);
        self.check_leaf_ranges(&mut violations);
        if violations.list.is_empty() {
            let leaves = SortedLeaves::new(self);
            self.check_leaf_contents(&leaves, &mut violations);
            self.check_coverage(&leaves, &mut violations);
        }
        if violations.list.is_empty() {
            Ok(())
        } else {
            Err(violations.list)
        }
    }

    /// One pass over the nodes in storage order, which is to be the depth-first order: an inner
    /// node's left child comes next, and whenever a leaf ends a left subtree, the right child
    /// that waits on top of the stack comes next.
    fn check_structure(&self, violations: &mut Violations) {
        let nodes = self.nodes();
        let mut waiting: Vec<(usize, usize, usize, Aabb)> = Vec::new();
        let (mut depth, mut cell) = (0, self.bounds());
        for (index, node) in nodes.iter().enumerate() {
            if depth > MAX_DEPTH as usize {
                violations.report(Violation::TooDeep { node: index, depth });
            }
            match node.kind() {
                NodeKind::Inner {
                    axis,
                    position,
                    right,
                } => {
                    let (min, max) = (cell.min[axis], cell.max[axis]);
                    if !(position >= min && position <= max) {
                        violations.report(Violation::SplitOutsideCell {
                            node: index,
                            axis,
                            position,
                            min,
                            max,
                        });
                    }
                    let (left_cell, right_cell) = cell.split(axis, position);
                    depth += 1;
                    waiting.push((index, right, depth, right_cell));
                    cell = left_cell;
                }
                NodeKind::Leaf { .. } => {
                    let Some((parent, right, right_depth, right_cell)) = waiting.pop() else {
                        if index + 1 < nodes.len() {
                            violations.report(Violation::OrphanedNodes { first: index + 1 });
                        }
                        return;
                    };
                    if index + 1 == nodes.len() {
                        waiting.push((parent, right, right_depth, right_cell));
                        break;
                    }
                    if right != index + 1 {
                        violations.report(Violation::ChildOutOfOrder {
                            node: parent,
                            right,
                            expected: index + 1,
                        });
                    }
                    (depth, cell) = (right_depth, right_cell);
                }
            }
        }
        if let Some(&(node, ..)) = waiting.last() {
            let nodes = nodes.len();
            violations.report(Violation::MissingChild { node, nodes });
        }
    }

    fn check_leaf_ranges(&self, violations: &mut Violations) {
        let references = self.references().len();
        let mut ranges = Vec::new();
        for (node, first, count) in self.leaves() {
            if first.checked_add(count).is_none_or(|end| end > references) {
                violations.report(Violation::ReferencesOutOfRange {
                    node,
                    first,
                    count,
                    references,
                });
            } else if count > 0 {
                ranges.push((first, first + count, node));
            }
        }
        ranges.sort_unstable();
        let (mut owned, mut owner) = (0, 0);
        for (first, end, node) in ranges {
            if first > owned {
                violations.report(Violation::UnownedReference { reference: owned });
            } else if first < owned {
                violations.report(Violation::SharedReference {
                    reference: first,
                    first: owner,
                    second: node,
                });
            }
            if end > owned {
                (owned, owner) = (end, node);
            }
        }
        if owned < references {
            violations.report(Violation::UnownedReference { reference: owned });
        }
        let triangles = self.mesh().triangles().len();
        for (reference, &triangle) in self.references().iter().enumerate() {
            if triangle as usize >= triangles {
                violations.report(Violation::TriangleOutOfRange {
                    reference,
                    triangle,
                    triangles,
                });
            }
        }
    }

    fn check_leaf_contents(&self, leaves: &SortedLeaves, violations: &mut Violations) {
        let mesh = self.mesh();
        for (node, first, count) in self.leaves() {
            let listed = &leaves.references[first..first + count];
            for pair in listed.windows(2).filter(|pair| pair[0] == pair[1]) {
                let triangle = pair[0];
                violations.report(Violation::DuplicateReference { node, triangle });
            }
            for &triangle in listed.iter().filter(|&&t| !mesh.is_traceable(t)) {
                violations.report(Violation::UntraceableTriangle { node, triangle });
            }
        }
    }

    fn check_coverage(&self, leaves: &SortedLeaves, violations: &mut Violations) {
        let mesh = self.mesh();
        let all = 0..mesh.triangles().len() as u32;
        let expected = all.clone().filter(|&t| !mesh.is_traceable(t)).count();
        let reported = self.skipped_triangles();
        if reported != expected {
            violations.report(Violation::SkippedCount { reported, expected });
        }
        let found: Vec<Violation> = all
            .into_par_iter()
            .with_min_len(CHUNK)
            .filter(|&triangle| mesh.is_traceable(triangle))
            .flat_map_iter(|triangle| self.uncovered_parts(leaves, triangle))
            .collect();
        for violation in found {
            violations.report(violation);
        }
    }

    /// What is wrong with the places in which one triangle is listed.
    fn uncovered_parts(&self, leaves: &SortedLeaves, triangle: u32) -> Vec<Violation> {
        let (corners, bounds) = (self.mesh().corners(triangle), self.bounds());
        let inside = |corner: &[f32; 3]| {
            (0..3).all(|axis| (bounds.min[axis]..=bounds.max[axis]).contains(&corner[axis]))
        };
        if !corners.iter().all(inside) {
            return vec![Violation::OutsideBounds { triangle }];
        }
        let largest = corners
            .as_flattened()
            .iter()
            .fold(0.0f32, |m, x| m.max(x.abs()));
        let search = Coverage {
            tree: self,
            leaves,
            triangle,
            tolerance: f64::from(largest) * TOLERANCE,
        };
        let mut missing = Vec::new();
        search.walk(
            0,
            corners.map(|corner| corner.map(f64::from)).to_vec(),
            &mut missing,
        );
        missing
            .into_iter()
            .map(|(node, part)| {
                let sum = |axis: usize| part.iter().map(|point| point[axis]).sum::<f64>();
                Violation::MissingReference {
                    node,
                    triangle,
                    point: [0, 1, 2].map(|axis| (sum(axis) / part.len() as f64) as f32),
                }
            })
            .collect()
    }

    /// Index, first reference and number of references of every leaf.
    fn leaves(&self) -> impl Iterator<Item = (usize, usize, usize)> {
        self.nodes()
            .iter()
            .enumerate()
            .filter_map(|(index, node)| match node.kind() {
                NodeKind::Leaf { first, count } => Some((index, first, count)),
                NodeKind::Inner { .. } => None,
            })
    }
}

/// A list that keeps no more than [`MAX_REPORTED`] of each kind.
#[derive(Default)]
struct Violations {
    list: Vec<Violation>,
}

impl Violations {
    fn report(&mut self, violation: Violation) {
        let kind = std::mem::discriminant(&violation);
        let same = |other: &&Violation| std::mem::discriminant(*other) == kind;
        if self.list.iter().filter(same).count() < MAX_REPORTED {
            self.list.push(violation);
        }
    }
}

/// The tree's references with each leaf's share sorted, for binary search.
struct SortedLeaves {
    references: Vec<u32>,
}

impl SortedLeaves {
    fn new(tree: &KdTree<'_>) -> Self {
        let mut references = tree.references().to_vec();
        for (_, first, count) in tree.leaves() {
            references[first..first + count].sort_unstable();
        }
        Self { references }
    }
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
                let listed = &self.leaves.references[first..first + count];
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{BuildOptions, CostModel, Mesh, Node};

    /// Three triangles in the box (0, 0, 0) to (4, 2, 1): one left of x = 2,
    /// one across it, one inside the plane x = 2 that reaches from y = 0 to 2.
    const POSITIONS: [[f32; 3]; 9] = [
        [0.0, 0.0, 0.0],
        [1.0, 2.0, 0.0],
        [0.0, 2.0, 1.0],
        [1.0, 0.0, 0.0],
        [4.0, 2.0, 0.0],
        [4.0, 0.0, 1.0],
        [2.0, 0.0, 0.0],
        [2.0, 2.0, 0.0],
        [2.0, 0.0, 1.0],
    ];
    const TRIANGLES: [[u32; 3]; 3] = [[0, 1, 2], [3, 4, 5], [6, 7, 8]];

    /// A tree of three leaves that is whole: x < 2, then y < 1 and y > 1.
    #[derive(Clone)]
    struct Parts {
        positions: [[f32; 3]; 9],
        bounds: Aabb,
        nodes: Vec<Node>,
        references: Vec<u32>,
        skipped: usize,
    }

    impl Parts {
        fn whole() -> Self {
            Self {
                positions: POSITIONS,
                bounds: Aabb::of_points(&POSITIONS),
                nodes: vec![
                    Node::inner(0, 2.0, 2),
                    Node::leaf(0, 2),
                    Node::inner(1, 1.0, 4),
                    Node::leaf(2, 2),
                    Node::leaf(4, 2),
                ],
                references: vec![0, 1, 1, 2, 1, 2],
                skipped: 0,
            }
        }

        fn violations(&self) -> Vec<Violation> {
            KdTree::from_parts(
                Mesh::new(&self.positions, &TRIANGLES).unwrap(),
                self.bounds,
                self.nodes.clone(),
                self.references.clone(),
                CostModel::default(),
                self.skipped,
            )
            .validate()
            .err()
            .unwrap_or_default()
        }
    }

    /// The violations of the whole tree after `damage`.
    fn damaged(damage: impl FnOnce(&mut Parts)) -> Vec<Violation> {
        let mut parts = Parts::whole();
        damage(&mut parts);
        parts.violations()
    }

    #[test]
    fn a_whole_tree_passes() {
        assert_eq!(damaged(|_| ()), []);
    }

    #[test]
    fn planes_outside_their_cells_are_caught() {
        for position in [f32::NAN, f32::INFINITY, -0.5, 4.5] {
            let found = damaged(|parts| parts.nodes[0] = Node::inner(0, position, 2));
            assert!(
                matches!(
                    found[0],
                    Violation::SplitOutsideCell {
                        node: 0,
                        axis: 0,
                        min: 0.0,
                        max: 4.0,
                        ..
                    }
                ),
                "{found:?}"
            );
        }
        // Inside the root's box, outside the node's own cell.
        let found = damaged(|parts| parts.nodes[2] = Node::inner(0, 1.0, 4));
        assert!(
            matches!(found[0], Violation::SplitOutsideCell { node: 2, .. }),
            "{found:?}"
        );
    }

    #[test]
    fn lost_shared_and_looping_children_are_caught() {
        for right in [0, 1, 3, 4, 1000] {
            let found = damaged(|parts| parts.nodes[0] = Node::inner(0, 2.0, right));
            assert_eq!(
                found,
                [Violation::ChildOutOfOrder {
                    node: 0,
                    right,
                    expected: 2
                }]
            );
        }
        let found = damaged(|parts| parts.nodes.truncate(4));
        assert_eq!(found[0], Violation::MissingChild { node: 2, nodes: 4 });
        let found = damaged(|parts| parts.nodes.push(Node::leaf(6, 0)));
        assert_eq!(found, [Violation::OrphanedNodes { first: 5 }]);
    }

    #[test]
    fn trees_too_deep_for_the_stack_are_caught() {
        // A chain of planes through one point: a leaf on every left side.
        let chain = |length: usize| {
            damaged(|parts| {
                parts.nodes = (0..length)
                    .flat_map(|i| [Node::inner(0, 0.0, 2 * i + 2), Node::leaf(0, 0)])
                    .chain([Node::leaf(0, 3)])
                    .collect();
                parts.references = vec![0, 1, 2];
            })
        };
        let most = MAX_DEPTH as usize;
        assert_eq!(chain(most), []);
        let found = chain(most + 1);
        assert!(matches!(found[0], Violation::TooDeep { depth, .. } if depth == most + 1));
    }

    #[test]
    fn leaves_that_do_not_share_out_the_references_are_caught() {
        let found = damaged(|parts| parts.nodes[4] = Node::leaf(4, 3));
        assert_eq!(
            found[0],
            Violation::ReferencesOutOfRange {
                node: 4,
                first: 4,
                count: 3,
                references: 6
            }
        );
        let found = damaged(|parts| parts.nodes[4] = Node::leaf(3, 3));
        assert_eq!(
            found,
            [Violation::SharedReference {
                reference: 3,
                first: 3,
                second: 4
            }]
        );
        let found = damaged(|parts| parts.nodes[3] = Node::leaf(2, 1));
        assert_eq!(found, [Violation::UnownedReference { reference: 3 }]);
        let found = damaged(|parts| parts.references.push(0));
        assert_eq!(found, [Violation::UnownedReference { reference: 6 }]);
        let found = damaged(|parts| parts.references[5] = 3);
        assert_eq!(
            found,
            [Violation::TriangleOutOfRange {
                reference: 5,
                triangle: 3,
                triangles: 3
            }]
        );
    }

    #[test]
    fn wrong_leaf_contents_are_caught() {
        let found = damaged(|parts| parts.references[1] = 0);
        assert_eq!(
            found[0],
            Violation::DuplicateReference {
                node: 1,
                triangle: 0
            }
        );
        assert!(
            matches!(
                found[1],
                Violation::MissingReference {
                    node: 1,
                    triangle: 1,
                    ..
                }
            ),
            "{found:?}"
        );
        let found = damaged(|parts| parts.positions[0] = [f32::NAN; 3]);
        assert_eq!(
            found,
            [
                Violation::UntraceableTriangle {
                    node: 1,
                    triangle: 0
                },
                Violation::SkippedCount {
                    reported: 0,
                    expected: 1
                },
            ]
        );
        let found = damaged(|parts| parts.skipped = 2);
        assert_eq!(
            found,
            [Violation::SkippedCount {
                reported: 2,
                expected: 0
            }]
        );
        let found = damaged(|parts| parts.positions[4] = [4.5, 2.0, 0.0]);
        assert_eq!(found, [Violation::OutsideBounds { triangle: 1 }]);
    }

    #[test]
    fn missing_triangles_are_caught_in_every_leaf() {
        // Take triangle 1, which overlaps all three leaves, from one after the other.
        for (node, reference) in [(1, 1), (3, 2), (4, 4)] {
            let found = damaged(|parts| {
                parts.references.remove(reference);
                parts.nodes = parts
                    .nodes
                    .iter()
                    .enumerate()
                    .map(|(index, leaf)| match leaf.kind() {
                        NodeKind::Leaf { first, count } => Node::leaf(
                            first - usize::from(first > reference),
                            count - usize::from(index == node),
                        ),
                        NodeKind::Inner { .. } => *leaf,
                    })
                    .collect();
            });
            let [
                Violation::MissingReference {
                    node: leaf,
                    triangle: 1,
                    point,
                },
            ] = found[..]
            else {
                panic!("{found:?}");
            };
            assert_eq!(leaf, node);
            assert!((1.0..=4.0).contains(&point[0]), "{point:?}");
        }
    }

    #[test]
    fn a_triangle_inside_a_plane_may_stand_on_either_side() {
        // Triangle 2 lies in x = 2: listed left only, or right in both leaves, or mixed.
        let with = |lists: [&[u32]; 3]| {
            damaged(|parts| {
                parts.references = lists.concat();
                let (a, b) = (lists[0].len(), lists[0].len() + lists[1].len());
                parts.nodes[1] = Node::leaf(0, a);
                parts.nodes[3] = Node::leaf(a, lists[1].len());
                parts.nodes[4] = Node::leaf(b, lists[2].len());
            })
        };
        assert_eq!(with([&[0, 1, 2], &[1], &[1]]), []);
        assert_eq!(with([&[0, 1], &[1, 2], &[2, 1]]), []);
        assert_eq!(with([&[0, 1, 2], &[1, 2], &[1, 2]]), []);
        let found = with([&[0, 1], &[1, 2], &[1]]);
        assert!(
            matches!(
                found[..],
                [Violation::MissingReference {
                    node: 4,
                    triangle: 2,
                    ..
                }]
            ),
            "{found:?}"
        );
    }

    #[test]
    fn reports_are_bounded_and_one_line_each() {
        let positions = vec![[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]];
        let triangles = vec![[0, 1, 2]; 1000];
        let mesh = Mesh::new(&positions, &triangles).unwrap();
        let built = KdTree::build(mesh, &BuildOptions::default()).unwrap();
        let empty = KdTree::from_parts(
            mesh,
            built.bounds(),
            vec![Node::leaf(0, 0)],
            Vec::new(),
            built.cost_model(),
            0,
        );
        let found = empty.validate().unwrap_err();
        assert_eq!(found.len(), MAX_REPORTED);
        assert_eq!(
            found[0].to_string(),
            "triangle 0 overlaps the cell of leaf 0 near (0.33333334, 0.33333334, 0) \
             but is not listed there"
        );
    }
}
