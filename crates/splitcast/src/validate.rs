//! Proof that a tree is whole.
//!
//! What queries rely on: nodes in depth-first order, planes inside their
//! cells, leaves that share out the references, and every point of every
//! triangle inside a leaf that holds the triangle. And what rays rely on: the wide form
//! that they are traced through says the same.

mod coverage;
#[cfg(test)]
mod tests;
mod wide;

use rayon::prelude::*;

use crate::build::MAX_DEPTH;
use crate::{Aabb, KdTree, NodeKind};
use coverage::{SortedLeaves, uncovered_parts};

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
    /// A node deeper than a tree may be.
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
    /// In a tree whose cells overlap, a triangle that is not in exactly one leaf.
    #[error("triangle {triangle} is in {times} leaves, expected 1")]
    NotInOneLeaf {
        /// The triangle.
        triangle: u32,
        /// Number of leaves that hold it.
        times: usize,
    },
    /// A leaf without a wide node that holds blocks.
    #[error("leaf {node} has no wide node with blocks of triangles")]
    NoWideLeaf {
        /// Index of the leaf.
        node: usize,
    },
    /// A lane of a leaf holds a block that is not there.
    #[error("leaf {node} holds block {index} in lane {lane}, which is not there")]
    NoBlock {
        /// Index of the leaf.
        node: usize,
        /// The lane of its wide node.
        lane: usize,
        /// The block's index.
        index: usize,
    },
    /// A triangle that a leaf holds but its blocks do not.
    #[error("leaf {node} holds triangle {triangle}, but none of its blocks does")]
    NotInBlocks {
        /// Index of the leaf.
        node: usize,
        /// The triangle.
        triangle: u32,
    },
    /// A triangle that a leaf's blocks hold but it does not.
    #[error("a block of leaf {node} holds triangle {triangle}, which the leaf does not hold")]
    ForeignInBlock {
        /// Index of the leaf.
        node: usize,
        /// The triangle.
        triangle: u32,
    },
    /// A corner or an edge in a block that is not the mesh's.
    #[error("a block of leaf {node} has triangle {triangle} in another place than the mesh")]
    MisplacedInBlock {
        /// Index of the leaf.
        node: usize,
        /// The triangle.
        triangle: u32,
    },
    /// A box around blocks that does not hold what they hold.
    #[error(
        "triangle {triangle} reaches out of the box around its block, \
         lane {lane} of the wide node of leaf {node}, within the leaf's cell"
    )]
    OutsideBlockBounds {
        /// Index of the leaf.
        node: usize,
        /// The lane of its wide node.
        lane: usize,
        /// The triangle.
        triangle: u32,
    },
    /// A wide node that holds blocks, but of no leaf.
    #[error("wide node {wide} holds blocks, but only the first {leaves} are leaves")]
    SurplusWideLeaf {
        /// Index of the wide node.
        wide: usize,
        /// Number of leaves of the kd-tree.
        leaves: usize,
    },
    /// A wide node with a child that does not exist.
    #[error("wide node {wide} has child {child} in lane {lane}, but there are only {nodes}")]
    WideChildOutOfRange {
        /// Index of the wide node.
        wide: usize,
        /// The lane.
        lane: usize,
        /// The child it names.
        child: usize,
        /// Number of wide nodes.
        nodes: usize,
    },
    /// A box around a child that does not hold the child's boxes.
    #[error("wide node {child} reaches out of its box in lane {lane} of wide node {wide}")]
    OutsideWideBounds {
        /// Index of the wide node with the box.
        wide: usize,
        /// The lane of the box.
        lane: usize,
        /// Index of the child.
        child: usize,
    },
    /// A wide node that no ray can reach although there is something to hit.
    #[error("wide node {wide} is not reached from the root")]
    LostWideNode {
        /// Index of the wide node; leaves come first, in the order of the kd-tree's.
        wide: usize,
    },
    /// A wide node that rays reach in several ways.
    #[error("wide node {wide} is reached {times} times from the root, expected once")]
    SharedWideNode {
        /// Index of the wide node; leaves come first, in the order of the kd-tree's.
        wide: usize,
        /// In how many ways it is reached.
        times: usize,
    },
}

impl KdTree<'_> {
    /// Checks everything that queries rely on, in time that grows with the
    /// number of references times the depth.
    ///
    /// # Errors
    /// The violations in the order of nodes, then of triangles; of each kind no more than 16.
    /// Leaves are searched for missing triangles only if the tree's
    /// structure is sound, and the wide form is compared with the tree only if nothing is wrong
    /// with that.
    pub fn validate(&self) -> Result<(), Vec<Violation>> {
        let mut violations = Violations::default();
        self.check_nodes(&mut violations);
        if violations.list.is_empty() {
            self.check_wide(&mut violations);
        }
        if violations.list.is_empty() {
            Ok(())
        } else {
            Err(violations.list)
        }
    }

    /// Checks the kd-tree without its wide form.
    fn check_nodes(&self, violations: &mut Violations) {
        self.check_structure(violations);
        self.check_leaf_ranges(violations);
        if violations.list.is_empty() {
            let leaves = SortedLeaves::new(self);
            self.check_leaf_contents(&leaves, violations);
            self.check_coverage(&leaves, violations);
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
                    // Where cells overlap, planes are of the past.
                    let inside = position >= min && position <= max;
                    if !inside && !self.cells_overlap() {
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
            let listed = leaves.of(first, count);
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
        if self.cells_overlap() {
            return self.check_listing(violations);
        }
        let found: Vec<Violation> = all
            .into_par_iter()
            .with_min_len(CHUNK)
            .filter(|&triangle| mesh.is_traceable(triangle))
            .flat_map_iter(|triangle| uncovered_parts(self, leaves, triangle))
            .collect();
        for violation in found {
            violations.report(violation);
        }
    }

    /// Where cells overlap, each triangle is to be in one leaf.
    fn check_listing(&self, violations: &mut Violations) {
        let mesh = self.mesh();
        let mut times = vec![0; mesh.triangles().len()];
        for &triangle in self.references() {
            times[triangle as usize] += 1;
        }
        for (triangle, &times) in (0..).zip(&times) {
            if times != usize::from(mesh.is_traceable(triangle)) {
                violations.report(Violation::NotInOneLeaf { triangle, times });
            }
        }
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
