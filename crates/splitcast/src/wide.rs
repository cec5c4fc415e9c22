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
pub(crate) mod refit;

use std::ops::Range;

use rayon::prelude::*;

pub(crate) use collapse::{Inner, collapse, contents, leaf_contents};
use leaf::LeafMemory;

use crate::kd_tree::{Node, NodeKind};
use crate::{Aabb, CostModel, Mesh};

/// Children of a node, and triangles of a block: one a lane.
pub(crate) const LANES: usize = 8;

/// Blocks that one task makes or brings up to date.
pub(crate) const CHUNK: usize = 256;

/// A node: the boxes of up to eight children, lane by lane, and where those are. Four cache lines.
#[derive(Clone, Copy, Debug)]
#[repr(C, align(64))]
pub(crate) struct WideNode {
    /// Lowest and highest coordinates on x, on y and on z. Lanes without a child hold an empty
    /// box, which no ray meets.
    pub(crate) bounds: [[f32; LANES]; 6],
    /// Inner node: the children's indices. Leaf: each lane's first block.
    pub(crate) first: [u32; LANES],
    /// Inner node: zeros. Leaf: the block after each lane's last, which is not 0 in the first lane.
    pub(crate) end: [u32; LANES],
}

impl WideNode {
    /// A node without children.
    pub(crate) const EMPTY: Self = Self {
        bounds: [
            [f32::INFINITY; LANES],
            [f32::NEG_INFINITY; LANES],
            [f32::INFINITY; LANES],
            [f32::NEG_INFINITY; LANES],
            [f32::INFINITY; LANES],
            [f32::NEG_INFINITY; LANES],
        ],
        first: [0; LANES],
        end: [0; LANES],
    };

    /// A leaf without blocks.
    pub(crate) const EMPTY_LEAF: Self = {
        let mut leaf = Self::EMPTY;
        (leaf.first[0], leaf.end[0]) = (1, 1);
        leaf
    };

    pub(crate) fn set_bounds(&mut self, lane: usize, bounds: &Aabb) {
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

    /// Whether the children are blocks.
    #[inline(always)]
    pub(crate) fn is_leaf(&self) -> bool {
        self.end[0] > 0
    }

    /// An inner node's child.
    #[inline(always)]
    pub(crate) fn child(&self, lane: usize) -> u32 {
        self.first[lane % LANES]
    }

    /// A leaf's blocks in a lane.
    #[inline(always)]
    pub(crate) fn blocks(&self, lane: usize) -> Range<usize> {
        self.first[lane % LANES] as usize..self.end[lane % LANES] as usize
    }
}

/// Eight triangles, lane by lane; the last ones may be the same. Five cache
/// lines.
#[derive(Clone, Copy, Debug)]
#[repr(C, align(64))]
pub(crate) struct Block {
    /// The corners, each by axis.
    pub(crate) corners: [[[f32; LANES]; 3]; 3],
    /// The triangles' indices in the mesh.
    pub(crate) triangles: [u32; LANES],
}

impl Block {
    /// A block that nobody has filled.
    pub(crate) const ZERO: Self = Self {
        corners: [[[0.0; LANES]; 3]; 3],
        triangles: [0; LANES],
    };

    /// The triangles, each once.
    pub(crate) fn distinct(&self) -> impl Iterator<Item = u32> {
        // What fills up a block repeats its last.
        let [first, ..] = self.triangles;
        let others = self.triangles.windows(2).filter(|pair| pair[0] != pair[1]);
        std::iter::once(first).chain(others.map(|pair| pair[1]))
    }

    /// The corners of the triangle in a lane.
    #[inline(always)]
    pub(crate) fn corners_of(&self, lane: usize) -> [[f32; 3]; 3] {
        let corner = |k: usize| {
            let [x, y, z] = &self.corners[k];
            [x[lane % LANES], y[lane % LANES], z[lane % LANES]]
        };
        [corner(0), corner(1), corner(2)]
    }

    /// The number of these.
    pub(crate) fn size(&self) -> u8 {
        self.distinct().count() as u8
    }
}

/// What rays are traced through.
#[derive(Clone, Debug, Default)]
pub(crate) struct WideTree {
    /// First the leaves, in the order of the kd-tree's, then the inner nodes.
    pub(crate) nodes: Vec<WideNode>,
    pub(crate) root: u32,
    /// The nodes of the kd-tree that the inner nodes stand for.
    pub(crate) origins: Vec<u32>,
    pub(crate) blocks: Blocks,
}

/// Blocks by their indices. A triangle's place is its block's index times eight, and its lane.
#[derive(Clone, Debug, Default)]
pub(crate) struct Blocks {
    pub(crate) list: Vec<Block>,
}

impl Blocks {
    #[inline(always)]
    pub(crate) fn get(&self, index: usize) -> &Block {
        &self.list[index]
    }

    /// The block and the lane of a place.
    #[inline(always)]
    pub(crate) fn at(&self, place: u32) -> (&Block, usize) {
        let place = place as usize;
        (self.get(place / LANES), place % LANES)
    }

    /// The block of an index, if there is one.
    pub(crate) fn find(&self, index: usize) -> Option<&Block> {
        self.list.get(index)
    }
}

/// Where the leaves of a kd-tree are.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Cells {
    /// In disjoint cells, given the root's: of a triangle, what lies in the cell counts.
    Disjoint(Aabb),
    /// Anywhere: each triangle is in one leaf, whole.
    Overlapping,
}

impl WideTree {
    /// Makes the wide form of a kd-tree, on all threads.
    pub(crate) fn new(mesh: Mesh<'_>, cells: Cells, nodes: &[Node], references: &[u32]) -> Self {
        let (leaves, blocks) = wide_leaves(mesh, cells, nodes, references, Vec::new());
        let inner = collapse(nodes, &leaf_contents(&leaves));
        Self::assemble(leaves, inner, blocks)
    }

    /// Puts inner nodes behind leaves.
    pub(crate) fn assemble(leaves: Vec<WideNode>, inner: Inner, blocks: Blocks) -> Self {
        let mut nodes = leaves;
        nodes.extend(inner.nodes);
        Self {
            nodes,
            root: inner.root,
            origins: inner.origins,
            blocks,
        }
    }

    /// Number of leaves: the nodes before the first inner one.
    pub(crate) fn leaf_count(&self) -> usize {
        self.nodes.len() - self.origins.len()
    }

    /// Expected cost of a ray that meets the box around all, times the area of that
    /// ([`TreeStats::traced_cost`](crate::TreeStats::traced_cost)).
    pub(crate) fn weighted_cost(&self, cost: &CostModel) -> f64 {
        let mut sum = 0.0;
        for node in &self.nodes {
            sum += f64::from(cost.traversal) * f64::from(node.content().half_area());
            for lane in (0..LANES).filter(|_| node.is_leaf()) {
                let work = cost.leaf((node.blocks(lane).len() * LANES) as u32);
                sum += f64::from(work) * f64::from(node.bounds_of(lane).half_area());
            }
        }
        sum
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

    #[inline(always)]
    pub(crate) fn block(&self, index: usize) -> &Block {
        self.blocks.get(index)
    }

    /// Bytes allocated.
    pub(crate) fn bytes(&self) -> usize {
        self.nodes.capacity() * size_of::<WideNode>()
            + self.origins.capacity() * size_of::<u32>()
            + self.blocks.list.capacity() * size_of::<Block>()
    }
}

/// The leaves of a kd-tree in wide form, in order, and their blocks, which are written over what is in `list`.
pub(crate) fn wide_leaves(
    mesh: Mesh<'_>,
    cells: Cells,
    nodes: &[Node],
    references: &[u32],
    mut list: Vec<Block>,
) -> (Vec<WideNode>, Blocks) {
    let leaves = leaves(nodes, cells);
    let groups = groups(&leaves);
    let count: usize = groups.iter().map(|group| group.blocks).sum();
    // Neither too little memory, which would be copied, nor too much to hold on to.
    if !(count..=count + count / 4).contains(&list.capacity()) {
        list = Vec::with_capacity(count);
    }
    list.truncate(count);
    list.par_extend(rayon::iter::repeat_n(Block::ZERO, count - list.len()));
    let (mut tasks, mut rest, mut base) = (Vec::with_capacity(groups.len()), &mut list[..], 0);
    for group in &groups {
        let (own, others) = rest.split_at_mut(group.blocks);
        tasks.push((&leaves[group.leaves.clone()], base, own));
        (rest, base) = (others, base + group.blocks);
    }
    let made: Vec<Vec<WideNode>> = tasks
        .into_par_iter()
        .map_init(LeafMemory::default, |memory, (leaves, base, blocks)| {
            leaf::group(mesh, leaves, references, memory, base, blocks)
        })
        .collect();
    // Half of the nodes are leaves, and a fifth as many new ones come above them.
    let mut wide = Vec::with_capacity(leaves.len() + leaves.len() / 4 + 2);
    wide.extend(made.into_iter().flatten());
    (wide, Blocks { list })
}

/// A leaf of a kd-tree.
pub(crate) struct Leaf {
    /// Where its references are.
    pub(crate) references: Range<usize>,
    /// What of its triangles counts.
    pub(crate) cell: Aabb,
}

/// The leaves of a kd-tree, in order.
fn leaves(nodes: &[Node], cells: Cells) -> Vec<Leaf> {
    let mut found = Vec::with_capacity(nodes.len() / 2 + 1);
    let mut right_cells = Vec::new();
    let mut cell = match cells {
        Cells::Disjoint(bounds) => bounds,
        Cells::Overlapping => Aabb::EVERYTHING,
    };
    for node in nodes {
        match node.kind() {
            NodeKind::Inner { axis, position, .. } => {
                if let Cells::Disjoint(_) = cells {
                    let (left, right) = cell.split(axis, position);
                    right_cells.push(right);
                    cell = left;
                }
            }
            NodeKind::Leaf { first, count } => {
                found.push(Leaf {
                    references: first..first + count,
                    cell,
                });
                cell = right_cells.pop().unwrap_or(cell);
            }
        }
    }
    found
}

impl Leaf {
    /// Number of blocks.
    fn blocks(&self) -> usize {
        self.references.len().div_ceil(LANES)
    }
}

/// A run of leaves.
struct Group {
    leaves: Range<usize>,
    /// Number of blocks of all.
    blocks: usize,
}

/// Runs of leaves with as many blocks as one task makes, or single leaves of more.
fn groups(leaves: &[Leaf]) -> Vec<Group> {
    let mut groups = Vec::new();
    let (mut start, mut blocks) = (0, 0);
    for (index, leaf) in leaves.iter().enumerate() {
        if blocks > 0 && blocks + leaf.blocks() > CHUNK {
            groups.push(Group {
                leaves: start..index,
                blocks,
            });
            (start, blocks) = (index, 0);
        }
        blocks += leaf.blocks();
    }
    groups.push(Group {
        leaves: start..leaves.len(),
        blocks,
    });
    groups
}
