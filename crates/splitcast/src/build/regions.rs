//! Which parts of a tracked tree have grown beyond what was predicted of them.

use std::ops::Range;

use rayon::prelude::*;

use super::clusters::Clusters;
use super::hierarchy::{Hierarchy, Touched, blocks_of};
use crate::kd_tree::{Node, NodeKind, Storage};

/// Leaves of a region, at most.
const LEAVES: usize = 8;

/// Leaves next to each other that give way to others.
pub(super) struct Region {
    pub(super) leaves: Range<usize>,
    /// What the others are made of.
    pub(super) blocks: Vec<u32>,
    /// How many of these each of the others takes, in order. If it says nothing, they are to be sorted.
    pub(super) sizes: Vec<u8>,
}

impl Region {
    /// Leaves that give way to others of the same blocks.
    pub(super) fn of(storage: &Storage, leaves: Range<usize>) -> Self {
        let blocks = blocks_of(&storage.wide.nodes()[leaves.clone()]);
        Self {
            blocks: blocks.map(|block| block as u32).collect(),
            leaves,
            sizes: Vec::new(),
        }
    }
}

/// The leaves of a small subtree, and half the areas of their boxes and of those of their blocks, added up.
#[derive(Clone, Debug)]
pub(super) struct Condition {
    pub(super) leaves: Range<usize>,
    pub(super) blocks: usize,
    /// Leaves and blocks now, and as triangles of the present sizes had them when their blocks were formed.
    pub(super) all: Growth,
    /// Leaves now, and as blocks of the present sizes had them when the leaves were made.
    pub(super) nodes: Growth,
}

/// What an area is, and what it was expected to be.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Growth {
    pub(super) now: f32,
    pub(super) expected: f32,
}

impl Growth {
    pub(super) fn add(&mut self, other: Self) {
        self.now += other.now;
        self.expected += other.expected;
    }

    /// By what factor it is too large. Infinite if nothing was expected.
    pub(super) fn factor(self) -> f32 {
        if self.now > 0.0 {
            self.now / self.expected
        } else {
            1.0
        }
    }
}

/// The condition of each region in which something may have moved. A region is a largest
/// subtree of up to [`LEAVES`] leaves.
pub(super) fn survey(
    storage: &Storage,
    clusters: &Clusters,
    hierarchy: &Hierarchy,
    touched: &Touched,
) -> Vec<Condition> {
    let condition = |leaves: Range<usize>| {
        if !leaves.clone().any(|leaf| touched.contains(leaf)) {
            return None;
        }
        let mut nodes = Growth::default();
        let mut all = Growth::default();
        let mut blocks = 0;
        for leaf in leaves.clone() {
            let own = hierarchy.growth_of(leaf);
            nodes.add(own);
            all.now += own.now + hierarchy.blocks_of(leaf);
            for block in blocks_of(&storage.wide.nodes()[leaf..leaf + 1]) {
                all.expected += clusters.expected(block);
                blocks += 1;
            }
        }
        Some(Condition {
            leaves,
            blocks,
            all,
            nodes,
        })
    };
    let all = regions(&storage.nodes).into_par_iter().with_min_len(32);
    all.filter_map(condition).collect()
}

/// The leaves of the largest subtrees of no more than [`LEAVES`], in order.
fn regions(nodes: &[Node]) -> Vec<Range<usize>> {
    let mut found = Vec::with_capacity(nodes.len() / LEAVES + 1);
    let mut waiting = vec![(0, nodes.len(), 0)];
    while let Some((root, end, first)) = waiting.pop() {
        let leaves_of = |nodes: usize| nodes.div_ceil(2);
        let count = leaves_of(end - root);
        match nodes[root].kind() {
            NodeKind::Inner { right, .. } if count > LEAVES => {
                waiting.push((right, end, first + leaves_of(right - root - 1)));
                waiting.push((root + 1, right, first));
            }
            _ => found.push(first..first + count),
        }
    }
    found
}
