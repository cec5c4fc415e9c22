//! The pieces a tree is put together from.
//!
//! Builders write nodes in depth-first order, left child right after its
//! parent. Parallel builders write disjoint subtrees on their own and join them
//! in that same order, so that the result does not depend on the threads.

use std::sync::Arc;

use crate::kd_tree::{KdTree, Listing, MAX_REFERENCES, Node, NodeKind, Storage};
use crate::wide::{Cells, WideTree};
use crate::{Aabb, BuildError, CostModel, Mesh};

/// A finished subtree; child and reference indices count from its own start.
#[derive(Debug, Default)]
pub(crate) struct Subtree {
    nodes: Vec<Node>,
    references: Vec<u32>,
}

/// An inner node whose right child has not been written yet.
#[must_use]
#[derive(Debug)]
pub(crate) struct OpenInner {
    index: usize,
    axis: usize,
    position: f32,
}

/// Writes a subtree node by node, depth first.
#[derive(Debug, Default)]
pub(crate) struct NodeWriter {
    subtree: Subtree,
}

impl NodeWriter {
    /// A writer with room for so many nodes and references.
    pub(crate) fn with_capacity(nodes: usize, references: usize) -> Self {
        Self {
            subtree: Subtree {
                nodes: Vec::with_capacity(nodes),
                references: Vec::with_capacity(references),
            },
        }
    }

    /// Writes a leaf over `triangles`.
    pub(crate) fn leaf(&mut self, triangles: impl Iterator<Item = u32>) {
        let Subtree { nodes, references } = &mut self.subtree;
        let first = references.len();
        references.extend(triangles);
        nodes.push(Node::leaf(first, references.len() - first));
    }

    /// Starts an inner node; its left child is to be written next.
    pub(crate) fn open_inner(&mut self, axis: usize, position: f32) -> OpenInner {
        let index = self.subtree.nodes.len();
        self.subtree.nodes.push(Node::inner(axis, position, 0));
        OpenInner {
            index,
            axis,
            position,
        }
    }

    /// Says that the left child is complete and the right one comes next.
    pub(crate) fn begin_right(&mut self, inner: OpenInner) {
        let right = self.subtree.nodes.len();
        self.subtree.nodes[inner.index] = Node::inner(inner.axis, inner.position, right);
    }

    /// Appends a subtree that was written elsewhere.
    pub(crate) fn append(&mut self, other: &Subtree) {
        let Subtree { nodes, references } = &mut self.subtree;
        let (node_base, reference_base) = (nodes.len(), references.len());
        references.extend_from_slice(&other.references);
        nodes.extend(other.nodes.iter().map(|node| match node.kind() {
            NodeKind::Inner {
                axis,
                position,
                right,
            } => Node::inner(axis, position, right + node_base),
            NodeKind::Leaf { first, count } => Node::leaf(first + reference_base, count),
        }));
    }

    /// The subtree written so far.
    pub(crate) fn finish(self) -> Subtree {
        self.subtree
    }
}

impl Subtree {
    /// Number of references in all leaves.
    pub(crate) fn reference_count(&self) -> usize {
        self.references.len()
    }

    /// Triangle indices; every leaf owns a range of them.
    pub(crate) fn references(&self) -> &[u32] {
        &self.references
    }

    /// All nodes, depth first.
    pub(crate) fn nodes(&self) -> &[Node] {
        &self.nodes
    }

    /// All nodes, depth first, for those who keep nothing else.
    pub(crate) fn into_nodes(self) -> Vec<Node> {
        self.nodes
    }

    /// Makes the whole tree of this subtree.
    pub(crate) fn into_tree(
        self,
        mesh: Mesh<'_>,
        bounds: Aabb,
        cost: CostModel,
        skipped_triangles: usize,
    ) -> Result<KdTree<'_>, BuildError> {
        self.check_size()?;
        let cells = Cells::Disjoint(bounds);
        let wide = WideTree::new(mesh, cells, &self.nodes, &self.references);
        Ok(KdTree::from_storage(
            mesh,
            bounds,
            Arc::new(self.into_storage(Listing::Triangles, wide)),
            cost,
            skipped_triangles,
        ))
    }

    /// Whether indices can be as high as they would have to be in the whole tree.
    pub(crate) fn check_size(&self) -> Result<(), BuildError> {
        if self.references.len() > MAX_REFERENCES || self.nodes.len() > MAX_REFERENCES {
            return Err(BuildError::TooManyReferences {
                limit: MAX_REFERENCES,
            });
        }
        Ok(())
    }

    /// The whole tree, with its wide form.
    pub(crate) fn into_storage(self, listing: Listing, wide: WideTree) -> Storage {
        Storage {
            nodes: self.nodes,
            members: self.references,
            listing,
            wide,
        }
    }
}
