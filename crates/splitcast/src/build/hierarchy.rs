//! The nodes above the blocks of a tracked tree: sorting blocks into leaves and these into a hierarchy,
//! and keeping their boxes up to date.

use std::ops::Range;

use rayon::prelude::*;

use super::clusters::tree_of_blocks;
use super::regions::{Growth, Region};
use super::tracked::Amounts;
use super::{Amount, Reference, object_split};
use crate::kd_tree::{Node, NodeKind, Storage};
use crate::wide::refit::{Tally, refit_inner, refit_leaves};
use crate::wide::{Blocks, LANES, WideNode, WideTree, leaf_contents};
use crate::{Aabb, CostModel};

/// Leaves that one task refits.
const LEAVES: usize = 256;

/// What a tracker knows of its tree's nodes in their wide form.
#[derive(Clone, Debug, Default)]
pub(super) struct Hierarchy {
    /// Around each.
    contents: Vec<Reference>,
    tallies: Vec<Tally>,
    /// The area of each leaf over those of its blocks, when it was made.
    spreads: Vec<f32>,
    /// Each block's leaf; empty if nobody has asked since they were sorted.
    seats: Vec<u32>,
    /// What the inner nodes' areas were over those of the leaves when these were sorted.
    sorted: f32,
}

/// The leaves in which something may have moved.
pub(super) enum Touched {
    All,
    Some(Vec<bool>),
}

/// Sorts blocks, given the boxes of those that are in use, into a new hierarchy.
pub(super) fn sort(boxes: &[Reference], blocks: Blocks) -> (Storage, Hierarchy) {
    let in_use = boxes.iter().filter(|own| !own.is_empty());
    let mut members: Vec<Reference> = in_use.copied().collect();
    let (nodes, leaves) = into_leaves(&mut members);
    let contents = leaf_contents(&leaves);
    let mut storage = tree_of_blocks(&nodes, leaves, &contents, blocks);
    let hierarchy = Hierarchy::new(&mut storage.wide, boxes);
    (storage, hierarchy)
}

/// Sorts blocks into leaves that hold one a lane, and nodes above them.
fn into_leaves(members: &mut [Reference]) -> (Vec<Node>, Vec<WideNode>) {
    let subtree = object_split::sort(members, LANES);
    let mut leaves = Vec::with_capacity(subtree.nodes().len() / 2 * 5 / 4 + 2);
    for node in subtree.nodes() {
        if let NodeKind::Leaf { first, count } = node.kind() {
            leaves.push(leaf_of(&members[first..first + count]));
        }
    }
    (subtree.into_nodes(), leaves)
}

/// The leaf of some blocks, one a lane.
fn leaf_of(blocks: &[Reference]) -> WideNode {
    let mut leaf = WideNode::EMPTY_LEAF;
    for (lane, own) in blocks.iter().enumerate() {
        leaf.set_bounds(lane, &own.bounds());
        leaf.first[lane] = own.triangle;
        leaf.end[lane] = own.triangle + 1;
    }
    leaf
}

/// The blocks of leaves with one a lane, in order.
pub(super) fn blocks_of(leaves: &[WideNode]) -> impl Iterator<Item = usize> {
    let lanes = |leaf: &WideNode| leaf.first.into_iter().zip(leaf.end);
    let blocks = leaves.iter().flat_map(lanes);
    blocks.flat_map(|(first, end)| first as usize..end as usize)
}

impl Hierarchy {
    /// Of a tree that was sorted just now.
    pub(super) fn new(wide: &mut WideTree, boxes: &[Reference]) -> Self {
        let mut hierarchy = Self::default();
        hierarchy.refit_leaves(wide, boxes, None);
        hierarchy.spreads = hierarchy.tallies.iter().map(Tally::spread).collect();
        hierarchy.refit_inner(wide);
        hierarchy.sorted = hierarchy.overhead(wide);
        hierarchy
    }

    /// Brings the boxes of leaves up to date with those of the blocks: all, or those with blocks that
    /// `moved` marks. Gives these.
    pub(super) fn refit_leaves(
        &mut self,
        wide: &mut WideTree,
        boxes: &[Reference],
        moved: Option<&[bool]>,
    ) -> Touched {
        let leaf_count = wide.leaf_count();
        self.contents.resize(leaf_count, Reference::ZERO);
        self.tallies.resize(leaf_count, Tally::default());
        let touched = match moved {
            None => Touched::All,
            Some(moved) => Touched::Some(self.touched(wide, moved)),
        };
        let leaves = wide.nodes[..leaf_count].par_chunks_mut(LEAVES);
        let contents = self.contents.par_chunks_mut(LEAVES);
        let tallies = self.tallies.par_chunks_mut(LEAVES);
        let tasks = leaves.zip(contents).zip(tallies).enumerate();
        tasks.for_each(|(task, ((leaves, contents), tallies))| match &touched {
            Touched::All => refit_leaves(leaves, boxes, contents, tallies, |_| true),
            Touched::Some(touched) => {
                let touched = &touched[task * LEAVES..][..leaves.len()];
                refit_leaves(leaves, boxes, contents, tallies, |place| touched[place]);
            }
        });
        touched
    }

    /// Brings the boxes of inner nodes up to date with those of the leaves.
    pub(super) fn refit_inner(&mut self, wide: &mut WideTree) {
        let leaf_count = wide.leaf_count();
        self.contents.resize(wide.nodes.len(), Reference::ZERO);
        self.tallies.resize(wide.nodes.len(), Tally::default());
        let (contents, tallies) = (&mut self.contents, &mut self.tallies);
        refit_inner(&mut wide.nodes, leaf_count, contents, tallies);
    }

    /// The leaves of blocks that `moved` marks.
    fn touched(&mut self, wide: &WideTree, moved: &[bool]) -> Vec<bool> {
        let leaves = &wide.nodes[..wide.leaf_count()];
        if self.seats.is_empty() {
            self.seats.resize(moved.len(), 0);
            for (place, leaf) in leaves.iter().enumerate() {
                for block in (0..LANES).flat_map(|lane| leaf.blocks(lane)) {
                    self.seats[block] = place as u32;
                }
            }
        }
        let mut touched = vec![false; leaves.len()];
        for (_, &seat) in moved.iter().zip(&self.seats).filter(|(moved, _)| **moved) {
            touched[seat as usize] = true;
        }
        touched
    }

    /// Sorts leaves into a new hierarchy, those of `regions` not before their blocks have been sorted
    /// into new ones.
    pub(super) fn sort_leaves(
        &mut self,
        storage: Storage,
        boxes: &[Reference],
        regions: &[Region],
    ) -> Storage {
        let leaf_count = storage.wide.leaf_count();
        let WideTree {
            nodes: mut leaves,
            blocks,
            ..
        } = storage.wide;
        leaves.truncate(leaf_count);
        self.contents.truncate(leaf_count);
        self.tallies.truncate(leaf_count);
        let mut stays = vec![true; leaf_count];
        for region in regions {
            stays[region.leaves.clone()].fill(false);
        }
        let made: Vec<NewLeaves> = regions
            .par_iter()
            .map(|region| NewLeaves::of(boxes, region))
            .collect();
        for new in made {
            self.spreads.extend(new.tallies.iter().map(Tally::spread));
            self.contents.extend(new.contents);
            self.tallies.extend(new.tallies);
            leaves.extend(new.leaves);
        }
        for (place, content) in self.contents.iter_mut().enumerate() {
            content.triangle = place as u32;
        }
        let old = self.contents[..leaf_count].iter().zip(stays);
        let old = old.filter(|(_, stays)| *stays).map(|(content, _)| content);
        let mut members: Vec<Reference> =
            (old.chain(&self.contents[leaf_count..])).copied().collect();
        let subtree = object_split::sort(&mut members, 1);
        let order = subtree.references();
        let sorted = in_order(&leaves, order, subtree.nodes().len() * 5 / 8 + 2);
        self.contents = in_order(&self.contents, order, 0);
        self.tallies = in_order(&self.tallies, order, 0);
        self.spreads = in_order(&self.spreads, order, 0);
        self.seats.clear();
        let contents: Vec<Aabb> = self.contents.iter().map(Reference::bounds).collect();
        let mut storage = tree_of_blocks(subtree.nodes(), sorted, &contents, blocks);
        self.refit_inner(&mut storage.wide);
        self.sorted = self.overhead(&storage.wide);
        storage
    }

    /// The area of a leaf now, and what it should be: what it was when the leaf was made, set against that of its
    /// blocks.
    pub(super) fn growth_of(&self, leaf: usize) -> Growth {
        let tally = &self.tallies[leaf];
        Growth {
            now: tally.leaves,
            expected: self.spreads[leaf] * tally.blocks,
        }
    }

    /// The areas of a leaf's blocks.
    pub(super) fn blocks_of(&self, leaf: usize) -> f32 {
        self.tallies[leaf].blocks
    }

    /// The areas of all leaves and blocks.
    pub(super) fn area_below(&self, wide: &WideTree) -> f32 {
        let root = self.tallies[wide.root as usize];
        root.leaves + root.blocks
    }

    /// By how much leaves have grown since they were made, set against their blocks.
    pub(super) fn drift(&self) -> f32 {
        let mut all = Growth::default();
        for leaf in 0..self.spreads.len() {
            all.add(self.growth_of(leaf));
        }
        all.factor()
    }

    /// By how much inner nodes have grown, set against the leaves, since these were sorted.
    pub(super) fn shift(&self, wide: &WideTree) -> f32 {
        if self.sorted > 0.0 {
            self.overhead(wide) / self.sorted
        } else {
            1.0
        }
    }

    /// The areas of the inner nodes over those of the leaves.
    fn overhead(&self, wide: &WideTree) -> f32 {
        let root = self.tallies[wide.root as usize];
        if root.leaves > 0.0 {
            root.inner / root.leaves
        } else {
            0.0
        }
    }

    /// The box around all.
    pub(super) fn bounds(&self, wide: &WideTree) -> Aabb {
        let Aabb { min, max } = self.contents[wide.root as usize].bounds();
        // Never -0, which instruction sets treat differently when they look for minima.
        Aabb {
            min: min.map(|x| x + 0.0),
            max: max.map(|x| x + 0.0),
        }
    }

    /// Expected cost of a ray that meets the box around all, times half the area of that
    /// ([`TreeStats::traced_cost`](crate::TreeStats::traced_cost)).
    pub(super) fn costs(&self, wide: &WideTree, cost: &CostModel) -> Costs {
        let root = self.tallies[wide.root as usize];
        Costs {
            inner: cost.traversal * root.inner,
            leaves: cost.traversal * root.leaves,
            blocks: cost.leaf(LANES as u32) * root.blocks,
        }
    }

    /// Bytes allocated.
    pub(super) fn bytes(&self) -> usize {
        self.contents.capacity() * size_of::<Reference>()
            + self.tallies.capacity() * size_of::<Tally>()
            + self.spreads.capacity() * size_of::<f32>()
            + self.seats.capacity() * size_of::<u32>()
    }
}

/// What is expected to be spent on each level.
#[derive(Clone, Copy, Default)]
pub(super) struct Costs {
    pub(super) inner: f32,
    pub(super) leaves: f32,
    pub(super) blocks: f32,
}

impl Costs {
    pub(super) fn sum(&self) -> f32 {
        self.inner + self.leaves + self.blocks
    }
}

/// Leaves that have no place yet.
struct NewLeaves {
    leaves: Vec<WideNode>,
    contents: Vec<Reference>,
    tallies: Vec<Tally>,
}

impl NewLeaves {
    /// Those of a region.
    fn of(boxes: &[Reference], region: &Region) -> Self {
        let own = region.blocks.iter().map(|&block| boxes[block as usize]);
        let mut members: Vec<Reference> = own.collect();
        let mut leaves = Vec::with_capacity(region.sizes.len());
        let mut rest = &members[..];
        for &size in &region.sizes {
            let (own, others) = rest.split_at(usize::from(size));
            leaves.push(leaf_of(own));
            rest = others;
        }
        if leaves.is_empty() {
            (_, leaves) = into_leaves(&mut members);
        }
        let mut contents = vec![Reference::ZERO; leaves.len()];
        let mut tallies = vec![Tally::default(); leaves.len()];
        refit_leaves(&mut leaves, boxes, &mut contents, &mut tallies, |_| true);
        Self {
            leaves,
            contents,
            tallies,
        }
    }
}

/// Some of the values, in the order given, and room for others.
fn in_order<T: Copy + Send + Sync>(values: &[T], order: &[u32], room: usize) -> Vec<T> {
    let mut sorted = Vec::with_capacity(room.max(order.len()));
    let places = order.par_iter().with_min_len(LEAVES);
    sorted.par_extend(places.map(|&place| values[place as usize]));
    sorted
}

impl Touched {
    pub(super) fn contains(&self, leaf: usize) -> bool {
        match self {
            Self::All => true,
            Self::Some(touched) => touched[leaf],
        }
    }

    /// What becomes of the leaves of a tree, but those of `regions`. `sizes` are the numbers of
    /// triangles of the blocks, and `count` that of the leaves that are told of.
    pub(super) fn leaves(
        &self,
        wide: &WideTree,
        regions: &[Region],
        sizes: &[u8],
        count: usize,
    ) -> Amounts {
        let mut stays = vec![true; wide.leaf_count()];
        for region in regions {
            stays[region.leaves.clone()].fill(false);
        }
        let (mut moved, mut kept) = (Amount::default(), Amount::default());
        for (leaf, _) in stays.iter().enumerate().filter(|(_, stays)| **stays) {
            match self {
                Self::All => moved.nodes += 1,
                Self::Some(touched) if touched[leaf] => {
                    moved.nodes += 1;
                    moved.references += triangles(wide, leaf..leaf + 1, sizes);
                }
                Self::Some(_) => kept.nodes += 1,
            }
        }
        if let Self::All = self {
            moved.references = count;
        }
        kept.references = count - moved.references;
        Amounts {
            kept,
            moved,
            ..Amounts::default()
        }
    }

    /// What becomes of all nodes of a tree whose boxes follow what they are around.
    pub(super) fn nodes(&self, storage: &Storage, sizes: &[u8], count: usize) -> Amounts {
        let mut amounts = self.leaves(&storage.wide, &[], sizes, count);
        let mut leaf = storage.wide.leaf_count();
        let mut moved = vec![false; storage.nodes.len()];
        for (index, node) in storage.nodes.iter().enumerate().rev() {
            let NodeKind::Inner { right, .. } = node.kind() else {
                leaf -= 1;
                moved[index] = self.contains(leaf);
                continue;
            };
            moved[index] = moved[index + 1] | moved[right];
            let share = match moved[index] {
                true => &mut amounts.moved,
                false => &mut amounts.kept,
            };
            share.nodes += 1;
        }
        amounts
    }
}

/// Number of triangles in leaves, given those of the blocks.
pub(super) fn triangles(wide: &WideTree, leaves: Range<usize>, sizes: &[u8]) -> usize {
    let blocks = blocks_of(&wide.nodes[leaves]);
    blocks.map(|block| usize::from(sizes[block])).sum()
}
