//! Regions: the subtrees that a tracker keeps, or builds anew, as a whole.

use std::ops::Range;
use std::sync::Arc;

use super::changes::MeshHashes;
use super::subtree::expected_cost;
use super::{NodeWriter, Subtree};
use crate::kd_tree::{Node, NodeKind, Storage};
use crate::wide::LeafGroup;
use crate::wide::leaf::{self, LeafMemory};
use crate::{Aabb, CostModel, Mesh};

/// References of a region, at most, when it is made: a change makes work of no less than a
/// region, and a region costs 16 bytes and some 30 nanoseconds.
const REGION: usize = 192;

/// What is remembered of a region.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Region {
    /// Its node.
    pub(super) root: u32,
    /// Its expected cost times the area of its cell.
    pub(super) cost: f64,
    /// Whether it was built with large leaves, for lack of time.
    pub(super) coarse: bool,
}

/// The regions of a new subtree.
pub(super) struct Regions {
    /// In depth-first order; nodes count from the subtree's first.
    pub(super) regions: Vec<Region>,
    /// The leaves of each.
    pub(super) leaves: Vec<LeafGroup<'static>>,
    /// Expected cost of the planes between them, times the area of the subtree's cell.
    pub(super) planes_cost: f64,
}

/// A frame's tree as the next frame needs it.
#[derive(Clone, Debug)]
pub(crate) struct TrackedTree {
    /// Each region's leaves are a group of the wide form.
    pub(super) storage: Arc<Storage>,
    pub(super) bounds: Aabb,
    /// Number of triangles of the mesh.
    pub(super) triangles: usize,
    pub(super) hashes: MeshHashes,
    /// In depth-first order; every leaf is in one of them.
    pub(super) regions: Vec<Region>,
    /// Expected cost of a ray.
    pub(super) sah_cost: f64,
    /// The same for the last tree that was built as a whole.
    pub(super) full_sah_cost: f64,
    /// Triangles that have moved since, one that moved in two frames counted twice.
    pub(super) moved: usize,
}

impl TrackedTree {
    /// The nodes above the regions, which are its leaves, and the nodes of each region.
    pub(super) fn top(&self) -> (Subtree, Vec<Range<usize>>) {
        let mut writer = NodeWriter::default();
        let mut places = Vec::with_capacity(self.regions.len());
        let mut right_children = Vec::new();
        let mut regions = self
            .regions
            .iter()
            .map(|region| region.root as usize)
            .peekable();
        let mut index = 0;
        loop {
            match self.nodes()[index].kind() {
                NodeKind::Inner {
                    axis,
                    position,
                    right,
                } if regions.peek() != Some(&index) => {
                    right_children.push((writer.open_inner(axis, position), right));
                    index += 1;
                }
                _ => {
                    regions.next();
                    writer.leaf(std::iter::empty());
                    places.push(index..subtree_end(self.nodes(), index));
                    let Some((inner, right)) = right_children.pop() else {
                        return (writer.finish(), places);
                    };
                    writer.begin_right(inner);
                    index = right;
                }
            }
        }
    }

    fn nodes(&self) -> &[Node] {
        &self.storage.nodes
    }

    /// Where the references of a region are, given its nodes.
    pub(super) fn references_of(&self, nodes: Range<usize>) -> Range<usize> {
        references_of(&self.nodes()[nodes])
    }

    /// The triangles in the leaves of a region, given its nodes.
    pub(super) fn triangles_of(&self, nodes: Range<usize>) -> &[u32] {
        &self.storage.references[self.references_of(nodes)]
    }

    /// The expected cost over that of the last tree that was built as a whole.
    pub(super) fn sah_ratio(&self) -> f64 {
        if self.full_sah_cost > 0.0 {
            self.sah_cost / self.full_sah_cost
        } else {
            1.0
        }
    }

    /// Bytes allocated, but for the tree itself.
    pub(crate) fn bytes(&self) -> usize {
        self.regions.capacity() * size_of::<Region>() + self.hashes.bytes()
    }
}

/// The index behind the last node of a subtree.
fn subtree_end(nodes: &[Node], root: usize) -> usize {
    let mut last = root;
    while let NodeKind::Inner { right, .. } = nodes[last].kind() {
        last = right;
    }
    last + 1
}

/// Where the references of a subtree are.
fn references_of(nodes: &[Node]) -> Range<usize> {
    let mut leaves = nodes.iter().filter_map(|node| match node.kind() {
        NodeKind::Leaf { first, count } => Some(first..first + count),
        NodeKind::Inner { .. } => None,
    });
    let first = leaves.next().expect("a subtree has a leaf");
    let end = leaves.next_back().map_or(first.end, |last| last.end);
    first.start..end
}

/// Divides a new subtree into regions: its largest subtrees of no more than [`REGION`]
/// references.
pub(super) fn divide(
    mesh: Mesh<'_>,
    subtree: &Subtree,
    cell: Aabb,
    cost: &CostModel,
    coarse: bool,
    memory: &mut LeafMemory,
) -> Regions {
    let nodes = subtree.nodes();
    let mut regions = Vec::with_capacity(subtree.reference_count() * 2 / REGION + 1);
    let mut leaves = Vec::with_capacity(regions.capacity());
    let mut planes_cost = 0.0;
    let mut waiting = vec![(0, nodes.len(), cell)];
    while let Some((root, end, cell)) = waiting.pop() {
        let references = references_of(&nodes[root..end]);
        match nodes[root].kind() {
            NodeKind::Inner {
                axis,
                position,
                right,
            } if references.len() > REGION => {
                planes_cost += f64::from(cell.half_area()) * f64::from(cost.traversal);
                let (left_cell, right_cell) = cell.split(axis, position);
                waiting.push((right, end, right_cell));
                waiting.push((root + 1, right, left_cell));
            }
            _ => {
                let own = &nodes[root..end];
                regions.push(Region {
                    root: root as u32,
                    cost: expected_cost(own, cell, cost),
                    coarse,
                });
                leaves.push(leaf::group(mesh, own, subtree.references(), cell, memory));
            }
        }
    }
    Regions {
        regions,
        leaves,
        planes_cost,
    }
}
