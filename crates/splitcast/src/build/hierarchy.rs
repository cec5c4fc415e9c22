//! The nodes above the blocks of a tracked tree: sorting blocks into them, and keeping their boxes up to
//! date.

use rayon::prelude::*;

use super::{Amount, Reference, object_split};
use crate::kd_tree::{Listing, NodeKind, Storage};
use crate::wide::refit::{Tally, refit_inner, refit_leaves};
use crate::wide::{Blocks, LANES, WideNode, WideTree};
use crate::{Aabb, CostModel};

/// Leaves that one task refits.
const LEAVES: usize = 256;

/// What a tracker knows of its tree's nodes in their wide form.
#[derive(Clone, Debug, Default)]
pub(super) struct Hierarchy {
    /// Around each.
    contents: Vec<Reference>,
    tallies: Vec<Tally>,
    /// Each block's leaf; empty if nobody has asked since they were sorted.
    seats: Vec<u32>,
    /// What the nodes' areas were over those of the blocks when these were sorted.
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
    let subtree = object_split::sort(&mut members, LANES);
    let mut leaves = Vec::with_capacity(subtree.nodes().len() / 2 * 5 / 4 + 2);
    for node in subtree.nodes() {
        if let NodeKind::Leaf { first, count } = node.kind() {
            let mut leaf = WideNode::EMPTY_LEAF;
            for (lane, own) in members[first..first + count].iter().enumerate() {
                leaf.set_bounds(lane, &own.bounds());
                leaf.first[lane] = own.triangle;
                leaf.end[lane] = own.triangle + 1;
            }
            leaves.push(leaf);
        }
    }
    let mut wide = WideTree::assemble(subtree.nodes(), leaves, blocks);
    let hierarchy = Hierarchy::new(&mut wide, boxes);
    let listing = Listing::Blocks(Default::default());
    (subtree.into_storage(listing, wide), hierarchy)
}

impl Hierarchy {
    /// Of a tree that was sorted just now.
    pub(super) fn new(wide: &mut WideTree, boxes: &[Reference]) -> Self {
        let mut hierarchy = Self::default();
        hierarchy.refit(wide, boxes, None);
        hierarchy.sorted = hierarchy.overhead(wide);
        hierarchy
    }

    /// Brings boxes up to date with those of the blocks: all, or those above blocks that `moved`
    /// marks. Gives the leaves of these.
    pub(super) fn refit(
        &mut self,
        wide: &mut WideTree,
        boxes: &[Reference],
        moved: Option<&[bool]>,
    ) -> Touched {
        let leaf_count = wide.leaf_count();
        self.contents.resize(wide.nodes.len(), Reference::ZERO);
        self.tallies.resize(wide.nodes.len(), Tally::default());
        let touched = match moved {
            None => Touched::All,
            Some(moved) => Touched::Some(self.touched(wide, moved)),
        };
        let leaves = wide.nodes[..leaf_count].par_chunks_mut(LEAVES);
        let contents = self.contents[..leaf_count].par_chunks_mut(LEAVES);
        let tallies = self.tallies[..leaf_count].par_chunks_mut(LEAVES);
        let tasks = leaves.zip(contents).zip(tallies).enumerate();
        tasks.for_each(|(task, ((leaves, contents), tallies))| match &touched {
            Touched::All => refit_leaves(leaves, boxes, contents, tallies, |_| true),
            Touched::Some(touched) => {
                let touched = &touched[task * LEAVES..][..leaves.len()];
                refit_leaves(leaves, boxes, contents, tallies, |place| touched[place]);
            }
        });
        refit_inner(
            &mut wide.nodes,
            leaf_count,
            &mut self.contents,
            &mut self.tallies,
        );
        touched
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

    /// By how much the nodes have grown, set against the blocks, since these were sorted.
    pub(super) fn drift(&self, wide: &WideTree) -> f32 {
        if self.sorted > 0.0 {
            self.overhead(wide) / self.sorted
        } else {
            1.0
        }
    }

    /// The areas of the nodes over those of the blocks.
    fn overhead(&self, wide: &WideTree) -> f32 {
        let root = self.tallies[wide.root as usize];
        if root.blocks > 0.0 {
            root.nodes / root.blocks
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

    /// Expected cost of a ray that meets the box around all, in nodes and in blocks
    /// ([`TreeStats::traced_cost`](crate::TreeStats::traced_cost)).
    pub(super) fn costs(&self, wide: &WideTree, cost: &CostModel) -> (f64, f64) {
        let root = self.tallies[wide.root as usize];
        let area = self.contents[wide.root as usize].bounds().half_area();
        if area <= 0.0 {
            return (0.0, 0.0);
        }
        let each = |weight: f32, areas: f32| f64::from(weight) * f64::from(areas / area);
        let block = cost.leaf(LANES as u32);
        (each(cost.traversal, root.nodes), each(block, root.blocks))
    }

    /// Bytes allocated.
    pub(super) fn bytes(&self) -> usize {
        self.contents.capacity() * size_of::<Reference>()
            + self.tallies.capacity() * size_of::<Tally>()
            + self.seats.capacity() * size_of::<u32>()
    }
}

impl Touched {
    /// The nodes above the leaves, and the triangles in these.
    pub(super) fn amount(&self, storage: &Storage) -> Amount {
        let nodes = &storage.nodes;
        let triangles = |first: usize, count: usize| -> usize {
            let blocks = storage.members[first..first + count].iter();
            blocks
                .map(|&block| storage.wide.block(block as usize).distinct().count())
                .sum()
        };
        let Self::Some(touched) = self else {
            return Amount {
                nodes: nodes.len(),
                references: triangles(0, storage.members.len()),
            };
        };
        let mut leaves = touched.iter().rev();
        let mut moved = vec![false; nodes.len()];
        let mut amount = Amount::default();
        for (index, node) in nodes.iter().enumerate().rev() {
            moved[index] = match node.kind() {
                NodeKind::Inner { right, .. } => moved[index + 1] | moved[right],
                NodeKind::Leaf { first, count } => {
                    let moved = leaves.next().is_some_and(|touched| *touched);
                    if moved {
                        amount.references += triangles(first, count);
                    }
                    moved
                }
            };
            amount.nodes += usize::from(moved[index]);
        }
        amount
    }
}
