//! The triangles of a tracked tree in clusters of up to eight neighbors: the blocks that rays are tested
//! against. They are formed once, and serve for as long as their triangles
//! stay close to each other.

use std::sync::Arc;

use rayon::prelude::*;

use super::object_split;
use super::{Reference, Triangles};
use crate::kd_tree::{Listing, Node, NodeKind, Storage};
use crate::wide::refit::{refit_blocks, triangle_areas};
use crate::wide::{Block, Blocks, CHUNK, Cells, LANES, WideTree};
use crate::{Aabb, Mesh};

/// Triangles of a leaf whose blocks fill a wide node.
const FULL_LEAF: usize = LANES * LANES;

/// Blocks that are formed anew at once. Two thousand neighbors sort nearly as well as all.
pub(super) const BATCH: usize = 512;

/// One block in so many tells how all do.
const SAMPLE: usize = 16;

/// A block whose box has grown by this factor, set against its triangles, has come apart.
const APART: f32 = 1.4;

/// What a tracker knows of its tree's blocks, each by its index.
#[derive(Clone, Debug, Default)]
pub(super) struct Clusters {
    /// Around each block; empty where there is none.
    pub(super) boxes: Vec<Reference>,
    /// The area of each box over those of the triangles' boxes, when the block was formed.
    spread: Vec<f32>,
    /// Indices without a block.
    free: Vec<u32>,
    /// Each triangle's block; empty if nobody has asked since they changed.
    homes: Vec<u32>,
}

/// How blocks do.
#[derive(Clone, Copy, Debug)]
pub(super) struct Wear {
    /// By how much more boxes have grown than their triangles, as a factor.
    pub(super) growth: f32,
}

/// A tree over triangles, each in one leaf, and what is to be known of its blocks.
pub(super) fn form(triangles: &Triangles<'_>) -> (Storage, Clusters) {
    let mut references = triangles.references();
    let subtree = object_split::sort(&mut references, FULL_LEAF);
    let wide = WideTree::new(
        triangles.mesh(),
        Cells::Overlapping,
        subtree.nodes(),
        subtree.references(),
    );
    let storage = by_blocks(subtree.nodes(), wide);
    let clusters = Clusters::of(&storage.wide);
    (storage, clusters)
}

/// The tree of wide leaves with a block a lane.
fn by_blocks(nodes: &[Node], wide: WideTree) -> Storage {
    let mut members = Vec::with_capacity(wide.blocks.end());
    let mut leaves = wide.nodes().iter();
    let list = |node: &Node| match node.kind() {
        NodeKind::Inner { .. } => *node,
        NodeKind::Leaf { .. } => {
            let first = members.len();
            let leaf = leaves.next().expect("a wide leaf for each leaf");
            members.extend((0..LANES).flat_map(|lane| leaf.blocks(lane)).map(|b| b as u32));
            Node::leaf(first, members.len() - first)
        }
    };
    Storage {
        nodes: nodes.iter().map(list).collect(),
        members,
        listing: Listing::Blocks(Default::default()),
        wide,
    }
}

impl Clusters {
    /// What is to be known of the blocks of new leaves.
    fn of(wide: &WideTree) -> Self {
        let mut clusters = Self::default();
        clusters.grow(wide.blocks.end());
        for leaf in &wide.nodes()[..wide.leaf_count()] {
            for lane in 0..LANES {
                for block in leaf.blocks(lane) {
                    let Aabb { min, max } = leaf.bounds_of(lane);
                    clusters.boxes[block] = Reference::new(min, max, block as u32);
                }
            }
        }
        let spread = |own: &Reference| spread(own, &wide.blocks);
        clusters.boxes.par_iter().map(spread).collect_into_vec(&mut clusters.spread);
        let unused = clusters.boxes.iter().filter(|own| own.is_empty());
        clusters.free = unused.map(|own| own.triangle).collect();
        clusters
    }

    /// Makes room for blocks of indices below `end`.
    fn grow(&mut self, end: usize) {
        let none = Aabb::EMPTY;
        for index in self.boxes.len()..end {
            self.boxes.push(Reference::new(none.min, none.max, index as u32));
        }
        self.spread.resize(end, 0.0);
    }

    /// Number of blocks.
    pub(super) fn count(&self) -> usize {
        self.boxes.len() - self.free.len()
    }

    /// Brings blocks up to date with the mesh: all, or those that `moved` marks.
    pub(super) fn refit(&mut self, mesh: Mesh<'_>, blocks: &mut Blocks, moved: Option<&[bool]>) {
        let chunks = blocks.chunks.par_iter_mut().zip(self.boxes.par_chunks_mut(CHUNK));
        chunks.enumerate().for_each(|(index, (chunk, boxes))| match moved {
            None => {
                let chunk: &mut Vec<Block> = Arc::make_mut(chunk);
                refit_blocks(mesh, chunk, boxes, |_| true);
            },
            Some(moved) => {
                let moved = &moved[index * CHUNK..][..boxes.len()];
                if moved.contains(&true) {
                    let chunk: &mut Vec<Block> = Arc::make_mut(chunk);
                    refit_blocks(mesh, chunk, boxes, |place| moved[place]);
                }
            }
        });
    }

    /// Each triangle's block.
    pub(super) fn homes(&mut self, blocks: &Blocks, triangles: usize) -> &[u32] {
        if self.homes.is_empty() {
            self.homes.resize(triangles, 0);
            for own in self.boxes.iter().filter(|own| !own.is_empty()) {
                for triangle in blocks.get(own.triangle as usize).triangles {
                    self.homes[triangle as usize] = own.triangle;
                }
            }
        }
        &self.homes
    }

    /// How much blocks have come apart, by a sample.
    pub(super) fn wear(&self, blocks: &Blocks) -> Wear {
        let sample = self.boxes.iter().step_by(SAMPLE).filter(|own| !own.is_empty());
        let (mut now, mut formed) = (0.0, 0.0);
        for own in sample {
            let index = own.triangle as usize;
            now += own.bounds().half_area();
            formed += self.spread[index] * triangle_areas(blocks.get(index));
        }
        let growth = if formed > 0.0 { now / formed } else { 1.0 };
        Wear { growth }
    }

    /// Of `members`, those that have come apart.
    pub(super) fn apart(&self, members: &[u32], blocks: &Blocks) -> Vec<u32> {
        let is_apart = |&&block: &&u32| {
            let index = block as usize;
            let own = &self.boxes[index];
            spread(own, blocks) > APART * self.spread[index]
        };
        members.par_iter().with_min_len(BATCH).filter(is_apart).copied().collect()
    }

    /// Takes the triangles from `count` on out of their blocks.
    pub(super) fn truncate(&mut self, blocks: &mut Blocks, count: usize) {
        self.homes.clear();
        for own in self.boxes.iter_mut().filter(|own| !own.is_empty()) {
            let index = own.triangle as usize;
            let gone = |triangle: u32| triangle as usize >= count;
            if !blocks.get(index).triangles.iter().any(|&triangle| gone(triangle)) {
                continue;
            }
            let chunk = Arc::make_mut(&mut blocks.chunks[index / CHUNK]);
            let triangles = &mut chunk[index % CHUNK].triangles;
            let Some(&stays) = triangles.iter().find(|&&triangle| !gone(triangle)) else {
                *own = Reference::new(Aabb::EMPTY.min, Aabb::EMPTY.max, own.triangle);
                self.free.push(own.triangle);
                continue;
            };
            // Those that fill up a block come last.
            let mut kept: Vec<u32> = Vec::with_capacity(LANES);
            for &triangle in triangles.iter().filter(|&&triangle| !gone(triangle)) {
                if !kept.contains(&triangle) {
                    kept.push(triangle);
                }
            }
            kept.resize(LANES, *kept.last().unwrap_or(&stays));
            triangles.copy_from_slice(&kept);
        }
    }

    /// Forms blocks of triangles that are in none.
    pub(super) fn add(&mut self, mesh: Mesh<'_>, blocks: &mut Blocks, triangles: Vec<u32>) {
        self.homes.clear();
        let formed = form_blocks(mesh, triangles);
        self.put(blocks, formed);
    }

    /// Forms the triangles of some blocks into new ones.
    pub(super) fn form_anew(&mut self, mesh: Mesh<'_>, blocks: &mut Blocks, olds: &[u32]) {
        self.homes.clear();
        let batches: Vec<Vec<(Block, Aabb)>> = olds
            .par_chunks(BATCH)
            .map(|batch| {
                let triangles = batch.iter().flat_map(|&old| blocks.get(old as usize).distinct());
                form_blocks(mesh, triangles.collect())
            })
            .collect();
        for &old in olds.iter().rev() {
            let none = Aabb::EMPTY;
            self.boxes[old as usize] = Reference::new(none.min, none.max, old);
            self.free.push(old);
        }
        for formed in batches {
            self.put(blocks, formed);
        }
    }

    /// Puts blocks where there is room.
    fn put(&mut self, blocks: &mut Blocks, formed: Vec<(Block, Aabb)>) {
        for (block, bounds) in formed {
            let index = match self.free.pop() {
                Some(index) => index as usize,
                None => self.boxes.len(),
            };
            if index >= blocks.chunks.len() * CHUNK {
                blocks.chunks.push(Arc::default());
            }
            let chunk = Arc::make_mut(&mut blocks.chunks[index / CHUNK]);
            if index % CHUNK < chunk.len() {
                chunk[index % CHUNK] = block;
            } else {
                chunk.resize(index % CHUNK + 1, block);
            }
            if index >= self.boxes.len() {
                self.grow(index + 1);
            }
            let own = Reference::new(bounds.min, bounds.max, index as u32);
            self.boxes[index] = own;
            self.spread[index] = spread(&own, blocks);
        }
    }

    /// Bytes allocated.
    pub(super) fn bytes(&self) -> usize {
        self.boxes.capacity() * size_of::<Reference>()
            + self.spread.capacity() * size_of::<f32>()
            + (self.free.capacity() + self.homes.capacity()) * size_of::<u32>()
    }
}

/// Triangles in blocks of neighbors, on this thread, with the boxes around them.
fn form_blocks(mesh: Mesh<'_>, triangles: Vec<u32>) -> Vec<(Block, Aabb)> {
    let mut references = Triangles::these(mesh, triangles).references();
    let subtree = object_split::sort(&mut references, FULL_LEAF);
    let wide = WideTree::new(mesh, Cells::Overlapping, subtree.nodes(), subtree.references());
    let leaves = wide.nodes()[..wide.leaf_count()].iter();
    leaves
        .flat_map(|leaf| {
            let blocks = (0..LANES).flat_map(|lane| leaf.blocks(lane).map(move |b| (lane, b)));
            blocks.map(|(lane, block)| (*wide.block(block), leaf.bounds_of(lane)))
        })
        .collect()
}

/// The area of a block's box over those of its triangles' boxes; 0 if these have none.
fn spread(own: &Reference, blocks: &Blocks) -> f32 {
    if own.is_empty() {
        return 0.0;
    }
    let areas = triangle_areas(blocks.get(own.triangle as usize));
    let spread = own.bounds().half_area() / areas;
    if spread.is_finite() { spread } else { 0.0 }
}
