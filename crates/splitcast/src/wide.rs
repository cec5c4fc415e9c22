//! The form of a tree that rays are traced through: nodes of eight boxes over blocks of eight
//! triangles.
//!
//! It is made from the kd-tree and says the same in another way. A leaf of the
//! kd-tree becomes one node: its triangles in blocks of eight neighbors, a box around the
//! part of each block that lies in the leaf's cell ([`leaf`]). Inner nodes are collapsed, three levels
//! into one and those that most rays meet first ([`collapse`]; Wald, Benthin & Boulos 2008). A
//! kd-tree's leaves may thus be large, which makes it fast to build: of the blocks in
//! a leaf, a ray tests those whose boxes it meets.

mod collapse;
pub(crate) mod leaf;

use std::borrow::Cow;
use std::ops::Range;
use std::sync::Arc;

use rayon::prelude::*;

use leaf::LeafMemory;

use crate::kd_tree::{Node, NodeKind};
use crate::{Aabb, Mesh};

/// Children of a node, and triangles of a block: one a lane.
pub(crate) const LANES: usize = 8;

/// Stands for the group of an inner node, which has none.
const INNER: u32 = u32::MAX;

/// References of a group of leaves, at most, unless it is a single leaf.
const GROUP: usize = 512;

/// A node: the boxes of up to eight children, lane by lane, and where those are. Four cache lines.
#[derive(Clone, Copy, Debug)]
#[repr(C, align(64))]
pub(crate) struct WideNode {
    /// Lowest and highest coordinates on x, on y and on z. Lanes without a child hold an empty
    /// box, which no ray meets.
    pub(crate) bounds: [[f32; LANES]; 6],
    /// Inner node: the children's indices. Leaf: each lane's first block; its last is before the
    /// next lane's.
    pub(crate) first: [u32; LANES],
    /// Leaf: the block after its last.
    pub(crate) end: u32,
    /// Leaf: the group that it is in.
    pub(crate) group: u32,
}

impl WideNode {
    /// A node without children.
    const EMPTY: Self = Self {
        bounds: [
            [f32::INFINITY; LANES],
            [f32::NEG_INFINITY; LANES],
            [f32::INFINITY; LANES],
            [f32::NEG_INFINITY; LANES],
            [f32::INFINITY; LANES],
            [f32::NEG_INFINITY; LANES],
        ],
        first: [0; LANES],
        end: 0,
        group: INNER,
    };

    fn set_bounds(&mut self, lane: usize, bounds: &Aabb) {
        for axis in 0..3 {
            self.bounds[2 * axis][lane] = bounds.min[axis];
            self.bounds[2 * axis + 1][lane] = bounds.max[axis];
        }
    }

    /// The box of a child.
    pub(crate) fn bounds_of(&self, lane: usize) -> Aabb {
        let row = |row: usize| self.bounds[row][lane];
        Aabb {
            min: [row(0), row(2), row(4)],
            max: [row(1), row(3), row(5)],
        }
    }

    /// The box around all children.
    pub(crate) fn content(&self) -> Aabb {
        let lowest = |row: &[f32; LANES]| row.iter().copied().fold(f32::INFINITY, f32::min);
        let highest = |row: &[f32; LANES]| row.iter().copied().fold(f32::NEG_INFINITY, f32::max);
        let [x0, x1, y0, y1, z0, z1] = &self.bounds;
        Aabb {
            min: [lowest(x0), lowest(y0), lowest(z0)],
            max: [highest(x1), highest(y1), highest(z1)],
        }
    }

    /// The group that a leaf's blocks are in; `None` for an inner node.
    #[inline(always)]
    pub(crate) fn group(&self) -> Option<usize> {
        (self.group != INNER).then_some(self.group as usize)
    }

    /// An inner node's child.
    #[inline(always)]
    pub(crate) fn child(&self, lane: usize) -> u32 {
        self.first[lane % LANES]
    }

    /// A leaf's blocks in a lane, among those of its group.
    #[inline(always)]
    pub(crate) fn blocks(&self, lane: usize) -> Range<usize> {
        let next = if lane + 1 < LANES {
            self.first[lane + 1]
        } else {
            self.end
        };
        self.first[lane % LANES] as usize..next as usize
    }
}

/// Eight triangles, lane by lane; the last of a lane's blocks may repeat a triangle. Five cache
/// lines.
#[derive(Clone, Copy, Debug)]
#[repr(C, align(64))]
pub(crate) struct Block {
    /// The first corner, by axis.
    pub(crate) corner: [[f32; LANES]; 3],
    /// From there to the second and to the third corner, rounded.
    pub(crate) edges: [[[f32; LANES]; 3]; 2],
    /// The triangles' indices in the mesh.
    pub(crate) triangles: [u32; LANES],
}

/// The leaves of a subtree of the kd-tree, in its order.
#[derive(Clone, Debug)]
pub(crate) struct LeafGroup<'l> {
    leaves: Cow<'l, [WideNode]>,
    blocks: Arc<Vec<Block>>,
}

/// What rays are traced through.
#[derive(Clone, Debug, Default)]
pub(crate) struct WideTree {
    /// First the leaves, in the order of the kd-tree's, then the inner nodes.
    pub(crate) nodes: Vec<WideNode>,
    pub(crate) root: u32,
    /// The first leaf and the blocks of each group.
    pub(crate) groups: Vec<(u32, Arc<Vec<Block>>)>,
}

impl WideTree {
    /// Makes the wide form of a kd-tree, on all threads.
    pub(crate) fn new(mesh: Mesh<'_>, bounds: Aabb, nodes: &[Node], references: &[u32]) -> Self {
        let groups: Vec<LeafGroup<'_>> = subtrees(nodes, bounds)
            .par_iter()
            .map_init(LeafMemory::default, |memory, &(root, end, cell)| {
                leaf::group(mesh, &nodes[root..end], references, cell, memory)
            })
            .collect();
        Self::assemble(nodes, groups)
    }

    /// Puts together groups of leaves, in the kd-tree's order, below new inner nodes.
    pub(crate) fn assemble(nodes: &[Node], leaf_groups: Vec<LeafGroup<'_>>) -> Self {
        // Half of the nodes are leaves, and a fifth as many new ones come above them.
        let mut wide = Vec::with_capacity(nodes.len() / 2 + nodes.len() / 8 + 2);
        let mut groups = Vec::with_capacity(leaf_groups.len());
        for (index, group) in leaf_groups.into_iter().enumerate() {
            groups.push((wide.len() as u32, group.blocks));
            wide.extend(group.leaves.iter().map(|&leaf| WideNode {
                group: index as u32,
                ..leaf
            }));
        }
        let root = collapse::collapse(nodes, &mut wide);
        Self {
            nodes: wide,
            root,
            groups,
        }
    }

    /// The leaves of a group, to be shared with another tree.
    pub(crate) fn group(&self, index: usize) -> LeafGroup<'_> {
        let (first, blocks) = &self.groups[index];
        let end = match self.groups.get(index + 1) {
            Some((next, _)) => *next as usize,
            None => self.leaf_count(),
        };
        LeafGroup {
            leaves: Cow::Borrowed(&self.nodes[*first as usize..end]),
            blocks: Arc::clone(blocks),
        }
    }

    /// Number of leaves: the nodes before the first inner one.
    fn leaf_count(&self) -> usize {
        if self.root == 0 {
            self.nodes.len()
        } else {
            self.root as usize
        }
    }

    /// Where a ray begins.
    #[inline(always)]
    pub(crate) fn root(&self) -> u32 {
        self.root
    }

    #[inline(always)]
    pub(crate) fn nodes(&self) -> &[WideNode] {
        &self.nodes
    }

    /// The blocks of a group of leaves.
    #[inline(always)]
    pub(crate) fn blocks(&self, group: usize) -> &[Block] {
        &self.groups[group].1
    }

    /// Bytes allocated.
    pub(crate) fn bytes(&self) -> usize {
        let blocks: usize = self.groups.iter().map(|(_, blocks)| blocks.len()).sum();
        self.nodes.capacity() * size_of::<WideNode>()
            + self.groups.capacity() * size_of::<(u32, Arc<Vec<Block>>)>()
            + blocks * size_of::<Block>()
    }
}

/// The largest subtrees of no more than [`GROUP`] references: first node, end, and cell.
fn subtrees(nodes: &[Node], bounds: Aabb) -> Vec<(usize, usize, Aabb)> {
    let mut found = Vec::new();
    let mut waiting = vec![(0, nodes.len(), bounds)];
    while let Some((root, end, cell)) = waiting.pop() {
        match nodes[root].kind() {
            NodeKind::Inner {
                axis,
                position,
                right,
            } if reference_count(&nodes[root..end]) > GROUP => {
                let (left_cell, right_cell) = cell.split(axis, position);
                waiting.push((right, end, right_cell));
                waiting.push((root + 1, right, left_cell));
            }
            _ => found.push((root, end, cell)),
        }
    }
    found
}

/// Number of references of a subtree, by those of its first and its last leaf.
fn reference_count(nodes: &[Node]) -> usize {
    let mut leaves = nodes.iter().filter_map(|node| match node.kind() {
        NodeKind::Leaf { first, count } => Some((first, count)),
        NodeKind::Inner { .. } => None,
    });
    let (first, count) = leaves.next().unwrap_or_default();
    leaves
        .next_back()
        .map_or(count, |(last, count)| last + count - first)
}
