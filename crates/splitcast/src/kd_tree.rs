//! The kd-tree: nodes of 8 bytes in depth-first order, leaves over a shared
//! list of triangle references.

use std::sync::{Arc, OnceLock};

use crate::build::Scratch;
use crate::wide::{WideTree, contents};
use crate::{Aabb, BuildError, BuildOptions, CostModel, Mesh, build};

/// Indices of nodes and references have 30 bits.
pub(crate) const MAX_REFERENCES: usize = (1 << 30) - 1;

/// Marks a leaf in the two low bits of [`Node::tagged`]; 0, 1 and 2 are the axes.
const LEAF: u32 = 3;

/// A node of the tree in 8 bytes; [`Node::kind`] unpacks it.
///
/// An inner node's left child follows it directly, so only the right child's
/// index is stored.
#[derive(Clone, Copy, PartialEq, Eq)]
#[repr(C)]
pub struct Node {
    /// Inner node: the bits of the split position. Leaf: its first reference.
    payload: u32,
    /// Low two bits: split axis, or 3 for a leaf. The rest: the right child's
    /// index, or the number of references.
    tagged: u32,
}

/// What a [`Node`] holds.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum NodeKind {
    /// A plane across `axis` at `position`. The left child, the cell with the
    /// lower coordinates, is the next node.
    Inner {
        /// 0, 1 or 2 for x, y or z.
        axis: usize,
        /// Coordinate of the plane on that axis.
        position: f32,
        /// Index of the right child.
        right: usize,
    },
    /// A range of [`KdTree::references`].
    Leaf {
        /// Index of the first reference.
        first: usize,
        /// Number of references.
        count: usize,
    },
}

impl Node {
    pub(crate) fn inner(axis: usize, position: f32, right: usize) -> Self {
        debug_assert!(axis < 3);
        Self {
            payload: position.to_bits(),
            tagged: (right as u32) << 2 | axis as u32,
        }
    }

    pub(crate) fn leaf(first: usize, count: usize) -> Self {
        Self {
            payload: first as u32,
            tagged: (count as u32) << 2 | LEAF,
        }
    }

    /// Unpacks the node.
    #[inline(always)]
    pub fn kind(self) -> NodeKind {
        let tag = self.tagged & 3;
        let value = (self.tagged >> 2) as usize;
        if tag == LEAF {
            NodeKind::Leaf {
                first: self.payload as usize,
                count: value,
            }
        } else {
            NodeKind::Inner {
                axis: tag as usize,
                position: f32::from_bits(self.payload),
                right: value,
            }
        }
    }
}

impl std::fmt::Debug for Node {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        self.kind().fmt(f)
    }
}

/// A node met by [`KdTree::visit`], with its place in the tree.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct NodeVisit {
    /// Index of the node.
    pub index: usize,
    /// Steps from the root, which has depth 0.
    pub depth: u32,
    /// The box of space that the node stands for.
    pub cell: Aabb,
    /// What the node holds.
    pub kind: NodeKind,
}

/// What a tree is made of.
#[derive(Clone, Debug, Default)]
pub(crate) struct Storage {
    /// In depth-first order, not empty.
    pub(crate) nodes: Vec<Node>,
    /// What the leaves own ranges of.
    pub(crate) members: Vec<u32>,
    pub(crate) listing: Listing,
    /// The same tree as rays are traced through it.
    pub(crate) wide: WideTree,
}

/// What the members of leaves are.
#[derive(Clone, Debug, Default)]
pub(crate) enum Listing {
    /// Triangles. Cells are disjoint, and a leaf has all triangles that reach into its own.
    #[default]
    Triangles,
    /// Blocks of the wide form: each triangle is in one leaf, and cells, the boxes around what
    /// is in them, overlap. The same in terms of triangles is found when somebody asks.
    Blocks(OnceLock<(Vec<Node>, Vec<u32>)>),
}

impl Storage {
    /// Nodes whose leaves own ranges of triangles, and these.
    fn listed(&self) -> (&[Node], &[u32]) {
        match &self.listing {
            Listing::Triangles => (&self.nodes, &self.members),
            Listing::Blocks(listed) => {
                let (nodes, triangles) = listed.get_or_init(|| self.list());
                (nodes, triangles)
            }
        }
    }

    fn list(&self) -> (Vec<Node>, Vec<u32>) {
        let mut triangles = Vec::with_capacity(self.members.len() * 8);
        let list = |node: &Node| match node.kind() {
            NodeKind::Inner { .. } => *node,
            NodeKind::Leaf { first, count } => {
                let start = triangles.len();
                for &block in &self.members[first..first + count] {
                    triangles.extend(self.wide.block(block as usize).distinct());
                }
                Node::leaf(start, triangles.len() - start)
            }
        };
        (self.nodes.iter().map(list).collect(), triangles)
    }
}

/// A kd-tree over a borrowed triangle mesh.
///
/// Immutable, `Send + Sync`: any number of threads may trace it. The mesh
/// stays borrowed for as long as the tree lives, so a tree cannot be traced
/// against positions that have moved on.
#[derive(Clone, Debug)]
pub struct KdTree<'m> {
    mesh: Mesh<'m>,
    bounds: Aabb,
    /// Shared with the tracker that made the tree, which starts the next one from it.
    storage: Arc<Storage>,
    cost: CostModel,
    skipped_triangles: usize,
}

impl<'m> KdTree<'m> {
    /// Builds a tree over `mesh`, on the current rayon thread pool.
    ///
    /// Any mesh will do: flat, degenerate and coincident triangles, or none
    /// at all.
    ///
    /// # Errors
    /// [`BuildError::NonFinite`] names the first vertex that cannot be traced,
    /// unless [`NonFinite::Skip`](crate::NonFinite::Skip) asks to leave its
    /// triangles out; [`BuildError::Options`] names an option out of bounds;
    /// [`BuildError::TooManyReferences`] if the tree outgrows its 30-bit indices.
    pub fn build(mesh: Mesh<'m>, options: &BuildOptions) -> Result<Self, BuildError> {
        Ok(build::build(mesh, options, None, &mut Scratch::default())?.tree)
    }

    /// Puts a tree together, perhaps of what another is made of, if that was built over a mesh
    /// whose triangles are in the same places.
    pub(crate) fn from_storage(
        mesh: Mesh<'m>,
        bounds: Aabb,
        storage: Arc<Storage>,
        cost: CostModel,
        skipped_triangles: usize,
    ) -> Self {
        debug_assert!(!storage.nodes.is_empty());
        Self {
            mesh,
            bounds,
            storage,
            cost,
            skipped_triangles,
        }
    }

    /// A tree of any nodes, which need not make sense, for tests. It cannot be traced.
    #[cfg(test)]
    pub(crate) fn of_nodes(
        mesh: Mesh<'m>,
        bounds: Aabb,
        nodes: Vec<Node>,
        references: Vec<u32>,
        cost: CostModel,
        skipped_triangles: usize,
    ) -> Self {
        let storage = Arc::new(Storage {
            nodes,
            members: references,
            listing: Listing::Triangles,
            wide: WideTree::default(),
        });
        Self::from_storage(mesh, bounds, storage, cost, skipped_triangles)
    }

    /// The same tree, traced through another wide form, which need not make sense, for tests.
    #[cfg(test)]
    pub(crate) fn with_wide(self, wide: WideTree) -> Self {
        let storage = Arc::new(Storage {
            wide,
            ..(*self.storage).clone()
        });
        Self { storage, ..self }
    }

    /// What rays are traced through.
    #[inline(always)]
    pub(crate) fn wide(&self) -> &WideTree {
        &self.storage.wide
    }

    /// The mesh that the tree was built over.
    pub fn mesh(&self) -> Mesh<'m> {
        self.mesh
    }

    /// The box around everything that a ray can hit; empty for an empty mesh.
    pub fn bounds(&self) -> Aabb {
        self.bounds
    }

    /// The cost model that the tree was built for.
    pub fn cost_model(&self) -> CostModel {
        self.cost
    }

    /// All nodes in depth-first order; the root is the first. Never empty.
    pub fn nodes(&self) -> &[Node] {
        self.storage.listed().0
    }

    /// Triangle indices; every leaf owns a range of them.
    pub fn references(&self) -> &[u32] {
        self.storage.listed().1
    }

    /// Whether cells may overlap, as in the trees of a [`Tracker`](crate::Tracker): each triangle is in
    /// one leaf, and a node's cell is the box around what is in its leaves (a spatial
    /// kd-tree; Ooi, McDonell & Sacks-Davis 1987). The planes of such a tree are those by which
    /// triangles were sorted, perhaps in an earlier frame.
    ///
    /// Otherwise a node's cell is one of the two halves of its parent's, and a leaf has all triangles
    /// that reach into its own.
    pub fn cells_overlap(&self) -> bool {
        matches!(self.storage.listing, Listing::Blocks(_))
    }

    /// Triangles left out because a corner was not finite; not zero only with
    /// [`NonFinite::Skip`](crate::NonFinite::Skip).
    pub fn skipped_triangles(&self) -> usize {
        self.skipped_triangles
    }

    /// Bytes of the tree itself and of what it has allocated.
    pub(crate) fn bytes(&self) -> usize {
        size_of::<Self>()
            + size_of::<Storage>()
            + self.storage.nodes.capacity() * size_of::<Node>()
            + self.storage.members.capacity() * size_of::<u32>()
            + self.storage.wide.bytes()
    }

    /// Visits every node depth first, left before right.
    pub fn visit(&self, mut visitor: impl FnMut(NodeVisit)) {
        let nodes = self.nodes();
        // Where cells are not told by planes.
        let contents = self.cells_overlap().then(|| contents(nodes, self.wide()));
        let mut stack = vec![(0, 0, self.bounds)];
        while let Some((index, depth, cell)) = stack.pop() {
            let kind = nodes[index].kind();
            visitor(NodeVisit {
                index,
                depth,
                cell,
                kind,
            });
            if let NodeKind::Inner {
                axis,
                position,
                right,
            } = kind
            {
                let (left_cell, right_cell) = match &contents {
                    None => cell.split(axis, position),
                    Some(contents) => (contents[index + 1], contents[right]),
                };
                stack.push((right, depth + 1, right_cell));
                stack.push((index + 1, depth + 1, left_cell));
            }
        }
    }
}
