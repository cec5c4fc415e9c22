//! The triangles of a tracked tree in clusters of up to eight neighbors: the blocks that rays are tested
//! against. They are formed once, and serve for as long as their triangles
//! stay close to each other.

use rayon::prelude::*;

use super::hierarchy::blocks_of;
use super::object_split;
use super::regions::Region;
use super::{Reference, Triangles};
use crate::kd_tree::{Listing, Node, NodeKind, Storage};
use crate::wide::refit::{refit_blocks, triangle_areas};
use crate::wide::{
    Block, Blocks, CHUNK, Cells, LANES, WideNode, WideTree, collapse, leaf_contents, wide_leaves,
};
use crate::{Aabb, Mesh};

/// Triangles of a leaf whose blocks fill a wide node.
const FULL_LEAF: usize = LANES * LANES;

/// One of so many blocks is looked at to tell what has become of all.
const SAMPLE_STRIDE: usize = 64;

/// Blocks of this sample that one task looks at.
const SAMPLE_TASK: usize = 64;

/// What a tracker knows of its tree's blocks, each by its index.
#[derive(Clone, Debug, Default)]
pub(super) struct Clusters {
    /// Around each block; empty where there is none.
    pub(super) boxes: Vec<Reference>,
    /// Half the areas of the boxes of each block's triangles, added up.
    areas: Vec<f32>,
    /// The area of each box, with the block's share of that of its leaf, over these, when the block was
    /// formed; 0 if it never was.
    formed: Vec<f32>,
    /// Number of triangles of each block.
    pub(super) sizes: Vec<u8>,
    /// Indices without a block.
    free: Vec<u32>,
    /// Each triangle's block; empty if nobody has asked since they changed.
    homes: Vec<u32>,
}

/// Blocks of triangles that follow each other in the mesh: the least that can be done, and all to be
/// formed anew.
pub(super) fn in_order(triangles: &Triangles<'_>) -> (Blocks, Clusters) {
    let mut clusters = Clusters::default();
    let all: Vec<u32> = (0..triangles.len())
        .map(|place| triangles.triangle(place))
        .collect();
    let block = |own: &[u32]| {
        let mut block = Block::ZERO;
        for (lane, triangle) in block.triangles.iter_mut().enumerate() {
            *triangle = own[lane.min(own.len() - 1)];
        }
        block
    };
    let list: Vec<Block> = all.chunks(LANES).map(block).collect();
    clusters.grow(list.len());
    let mut blocks = Blocks { list };
    for own in &mut clusters.boxes {
        *own = Reference::new([0.0; 3], [0.0; 3], own.triangle);
    }
    clusters.sizes.fill(LANES as u8);
    if let Some(last) = clusters.sizes.last_mut() {
        *last = (all.len() - all.len().next_multiple_of(LANES).saturating_sub(LANES)) as u8;
    }
    clusters.refit(triangles.mesh(), &mut blocks, None);
    (blocks, clusters)
}

/// A tree over triangles, each in one leaf, and what is to be known of its blocks. These are written over
/// `list`, whose memory serves again.
pub(super) fn form(triangles: &Triangles<'_>, list: Vec<Block>) -> (Storage, Clusters) {
    let (storage, mut clusters) = (formed(triangles, list), Clusters::default());
    let wide = &storage.wide;
    clusters.grow(wide.blocks.list.len());
    let areas = clusters.areas.par_chunks_mut(CHUNK);
    let sizes = clusters.sizes.par_chunks_mut(CHUNK);
    let own = areas.zip(sizes);
    let blocks = wide.blocks.list.par_chunks(CHUNK);
    blocks.zip(own).for_each(|(blocks, (areas, sizes))| {
        triangle_areas(blocks, areas);
        for (block, size) in blocks.iter().zip(sizes) {
            *size = block.size();
        }
    });
    for leaf in &wide.nodes()[..wide.leaf_count()] {
        let share = leaf_share(leaf);
        for lane in 0..LANES {
            for block in leaf.blocks(lane) {
                let bounds = leaf.bounds_of(lane);
                clusters.boxes[block] = Reference::new(bounds.min, bounds.max, block as u32);
                clusters.formed[block] = spread(&bounds, share, clusters.areas[block]);
            }
        }
    }
    let unused = clusters.boxes.iter().filter(|own| own.is_empty());
    clusters.free = unused.map(|own| own.triangle).collect();
    (storage, clusters)
}

/// A tree over triangles, whose leaves have as many as fill a wide node.
fn formed(triangles: &Triangles<'_>, list: Vec<Block>) -> Storage {
    let mut references = triangles.references();
    let subtree = object_split::sort(&mut references, FULL_LEAF);
    let (nodes, members) = (subtree.nodes(), subtree.references());
    let mesh = triangles.mesh();
    let (leaves, blocks) = wide_leaves(mesh, Cells::Overlapping, nodes, members, list);
    let contents = leaf_contents(&leaves);
    tree_of_blocks(nodes, leaves, &contents, blocks)
}

/// The tree of `nodes` above wide leaves with a block a lane, given the boxes around what is in these.
pub(super) fn tree_of_blocks(
    nodes: &[Node],
    leaves: Vec<WideNode>,
    contents: &[Aabb],
    blocks: Blocks,
) -> Storage {
    let (inner, (nodes, members)) =
        rayon::join(|| collapse(nodes, contents), || listed(nodes, &leaves));
    Storage {
        nodes,
        members,
        listing: Listing::Blocks(Default::default()),
        wide: WideTree::assemble(leaves, inner, blocks),
    }
}

/// Nodes whose leaves list the blocks in wide leaves, and these blocks.
fn listed(nodes: &[Node], leaves: &[WideNode]) -> (Vec<Node>, Vec<u32>) {
    let mut members = Vec::with_capacity(LANES * leaves.len());
    let mut leaves = leaves.iter();
    let list = |node: &Node| match node.kind() {
        NodeKind::Inner { .. } => *node,
        NodeKind::Leaf { .. } => {
            let first = members.len();
            let leaf = leaves.next().expect("a wide leaf for each leaf");
            let blocks = blocks_of(std::slice::from_ref(leaf));
            members.extend(blocks.map(|block| block as u32));
            Node::leaf(first, members.len() - first)
        }
    };
    let nodes = nodes.iter().map(list).collect();
    (nodes, members)
}

impl Clusters {
    /// Makes room for blocks of indices below `end`.
    fn grow(&mut self, end: usize) {
        let none = Aabb::EMPTY;
        for index in self.boxes.len()..end {
            self.boxes
                .push(Reference::new(none.min, none.max, index as u32));
        }
        self.areas.resize(self.boxes.len(), 0.0);
        self.formed.resize(self.boxes.len(), 0.0);
        self.sizes.resize(self.boxes.len(), 0);
    }

    /// Number of blocks.
    pub(super) fn count(&self) -> usize {
        self.boxes.len() - self.free.len()
    }

    /// Brings blocks up to date with the mesh: all, or those that `moved` marks.
    pub(super) fn refit(&mut self, mesh: Mesh<'_>, blocks: &mut Blocks, moved: Option<&[bool]>) {
        let boxes = self.boxes.par_chunks_mut(CHUNK);
        let areas = self.areas.par_chunks_mut(CHUNK);
        let chunks = (blocks.list.par_chunks_mut(CHUNK)).zip(boxes.zip(areas));
        chunks
            .enumerate()
            .for_each(|(index, (blocks, (boxes, areas)))| {
                let moved = moved.map(|moved| &moved[index * CHUNK..][..boxes.len()]);
                if moved.is_some_and(|moved| !moved.contains(&true)) {
                    return;
                }
                match moved {
                    None => refit_blocks(mesh, blocks, boxes, areas, |_| true),
                    Some(moved) => refit_blocks(mesh, blocks, boxes, areas, |place| moved[place]),
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

    /// What the area of a block and its share of that of its leaf should be: as it was when the block was
    /// formed, set against those of its triangles. The block may just have been given up.
    pub(super) fn expected(&self, index: usize) -> f32 {
        self.formed[index] * self.areas[index]
    }

    /// What all blocks come to.
    pub(super) fn sums(&self) -> Sums {
        let tasks = (0..self.boxes.len().div_ceil(CHUNK)).into_par_iter();
        let sums: Vec<Sums> = tasks
            .map(|chunk| {
                let end = self.boxes.len().min((chunk + 1) * CHUNK);
                let mut sums = Sums::default();
                for index in (chunk * CHUNK..end).filter(|&index| self.is_in_use(index)) {
                    sums.triangles += self.areas[index];
                    sums.expected += self.expected(index);
                }
                sums
            })
            .collect();
        // The same for any number of threads.
        Sums {
            triangles: sums.iter().map(|sums| sums.triangles).sum(),
            expected: sums.iter().map(|sums| sums.expected).sum(),
        }
    }

    /// Which share of a sample of the blocks will have come apart when they are brought up to date. With
    /// fewer triangles than there were, none.
    pub(super) fn share_apart(&self, mesh: Mesh<'_>, blocks: &Blocks) -> f64 {
        let count = mesh.triangles().len() as u32;
        let all = (0..self.boxes.len()).step_by(SAMPLE_STRIDE);
        let all = all.filter_map(|index| Some((index, blocks.find(index)?)));
        let sample = all.filter(|(index, block)| {
            self.is_in_use(*index) && block.triangles.iter().all(|&triangle| triangle < count)
        });
        let sample: Vec<(usize, &Block)> = sample.collect();
        let apart: usize = sample
            .par_chunks(SAMPLE_TASK)
            .map(|sample| {
                let mut blocks: Vec<Block> = sample.iter().map(|(_, block)| **block).collect();
                let boxes = sample.iter().map(|&(index, _)| self.boxes[index]);
                let mut boxes: Vec<Reference> = boxes.collect();
                let mut areas = vec![0.0; sample.len()];
                refit_blocks(mesh, &mut blocks, &mut boxes, &mut areas, |_| true);
                let is_apart = |&(place, &(index, _)): &(usize, &(usize, &Block))| {
                    boxes[place].bounds().half_area() > self.formed[index] * areas[place]
                };
                sample.iter().enumerate().filter(is_apart).count()
            })
            .sum();
        apart as f64 / sample.len().max(1) as f64
    }

    /// Whether there is a block of this index.
    pub(super) fn is_in_use(&self, index: usize) -> bool {
        !self.boxes[index].is_empty()
    }

    /// Takes the triangles from `count` on out of their blocks.
    pub(super) fn truncate(&mut self, blocks: &mut Blocks, count: usize) {
        self.homes.clear();
        for own in self.boxes.iter_mut().filter(|own| !own.is_empty()) {
            let index = own.triangle as usize;
            let gone = |triangle: u32| triangle as usize >= count;
            if !blocks
                .get(index)
                .triangles
                .iter()
                .any(|&triangle| gone(triangle))
            {
                continue;
            }
            let triangles = &mut blocks.list[index].triangles;
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
            self.sizes[index] = kept.len() as u8;
            kept.resize(LANES, *kept.last().unwrap_or(&stays));
            triangles.copy_from_slice(&kept);
        }
    }

    /// Forms blocks of triangles that are in none.
    pub(super) fn add(&mut self, mesh: Mesh<'_>, blocks: &mut Blocks, triangles: Vec<u32>) {
        self.homes.clear();
        self.put(blocks, &[form_blocks(mesh, triangles)]);
    }

    /// Forms the triangles of each region's blocks into new ones, which take the place of those. Gives the
    /// number of triangles.
    pub(super) fn form_anew(
        &mut self,
        mesh: Mesh<'_>,
        blocks: &mut Blocks,
        regions: &mut [Region],
    ) -> usize {
        self.homes.clear();
        let (counts, batches): (Vec<usize>, Vec<Vec<NewBlock>>) = regions
            .par_iter()
            .map(|region| {
                let old = region.blocks.iter();
                let triangles = old.flat_map(|&old| blocks.get(old as usize).distinct());
                let triangles: Vec<u32> = triangles.collect();
                (triangles.len(), form_blocks(mesh, triangles))
            })
            .unzip();
        for &old in regions.iter().rev().flat_map(|region| &region.blocks) {
            let none = Aabb::EMPTY;
            self.boxes[old as usize] = Reference::new(none.min, none.max, old);
            self.free.push(old);
        }
        let places = self.put(blocks, &batches);
        for ((region, formed), places) in regions.iter_mut().zip(&batches).zip(places) {
            region.sizes = leaf_sizes(formed);
            region.blocks = places;
        }
        counts.iter().sum()
    }

    /// Puts blocks where there is room, and says where.
    fn put(&mut self, blocks: &mut Blocks, batches: &[Vec<NewBlock>]) -> Vec<Vec<u32>> {
        let mut end = self.boxes.len();
        let mut places = Vec::with_capacity(batches.len());
        for batch in batches {
            let own = batch.iter().map(|_| {
                self.free.pop().unwrap_or_else(|| {
                    end += 1;
                    end as u32 - 1
                })
            });
            places.push(own.collect::<Vec<u32>>());
        }
        self.grow(end);
        if end > blocks.list.capacity() {
            // Vectors would take twice as much by themselves.
            (blocks.list).reserve_exact(end - blocks.list.len() + end / 16);
        }
        blocks.list.resize(end, Block::ZERO);
        // What goes into each chunk, so that these are filled side by side.
        let mut incoming: Vec<Vec<(usize, &NewBlock)>> = vec![Vec::new(); end.div_ceil(CHUNK)];
        for (&index, new) in places.iter().flatten().zip(batches.iter().flatten()) {
            incoming[index as usize / CHUNK].push((index as usize % CHUNK, new));
        }
        let boxes = self.boxes.par_chunks_mut(CHUNK);
        let areas = self.areas.par_chunks_mut(CHUNK);
        let formed = self.formed.par_chunks_mut(CHUNK);
        let sizes = self.sizes.par_chunks_mut(CHUNK);
        let own = boxes.zip(areas).zip(formed.zip(sizes));
        let chunks = (blocks.list.par_chunks_mut(CHUNK)).zip(own).zip(&incoming);
        chunks.for_each(|((blocks, ((boxes, areas), (formed, sizes))), incoming)| {
            for &(place, new) in incoming {
                blocks[place] = new.block;
                boxes[place] =
                    Reference::new(new.bounds.min, new.bounds.max, boxes[place].triangle);
                areas[place] = new.area;
                formed[place] = new.formed;
                sizes[place] = new.block.size();
            }
        });
        places
    }

    /// Bytes allocated.
    pub(super) fn bytes(&self) -> usize {
        self.boxes.capacity() * size_of::<Reference>()
            + (self.areas.capacity() + self.formed.capacity()) * size_of::<f32>()
            + (self.free.capacity() + self.homes.capacity()) * size_of::<u32>()
            + self.sizes.capacity()
    }
}

/// Sums over all blocks.
#[derive(Clone, Copy, Default)]
pub(super) struct Sums {
    /// Half the areas of all triangles' boxes.
    pub(super) triangles: f32,
    /// [`Clusters::expected`]
    pub(super) expected: f32,
}

/// A block that has no place yet.
struct NewBlock {
    block: Block,
    bounds: Aabb,
    /// Half the areas of the boxes of its triangles, added up.
    area: f32,
    /// [`spread`]
    formed: f32,
    /// Whether it is the first of a leaf.
    opens_leaf: bool,
}

/// Numbers of blocks of leaves, given all blocks in order.
fn leaf_sizes(blocks: &[NewBlock]) -> Vec<u8> {
    let leaves = blocks.chunk_by(|_, next| !next.opens_leaf);
    leaves.map(|leaf| leaf.len() as u8).collect()
}

/// Half the area of a block's box, with its share of that of its leaf, over those of its triangles' boxes; 0 if
/// these have none.
fn spread(bounds: &Aabb, share: f32, triangles: f32) -> f32 {
    let spread = (bounds.half_area() + share) / triangles;
    if spread.is_finite() { spread } else { 0.0 }
}

/// Half the area of a leaf's box, over the number of its blocks.
fn leaf_share(leaf: &WideNode) -> f32 {
    let blocks = blocks_of(std::slice::from_ref(leaf)).count();
    leaf.content().half_area() / blocks.max(1) as f32
}

/// Triangles in blocks of neighbors.
fn form_blocks(mesh: Mesh<'_>, triangles: Vec<u32>) -> Vec<NewBlock> {
    let wide = formed(&Triangles::these(mesh, triangles), Vec::new()).wide;
    let mut areas = vec![0.0; wide.blocks.list.len()];
    triangle_areas(&wide.blocks.list, &mut areas);
    let mut formed = Vec::with_capacity(areas.len());
    for leaf in &wide.nodes()[..wide.leaf_count()] {
        let share = leaf_share(leaf);
        for lane in 0..LANES {
            let bounds = leaf.bounds_of(lane);
            formed.extend(leaf.blocks(lane).map(|place| NewBlock {
                block: *wide.block(place),
                bounds,
                area: areas[place],
                formed: spread(&bounds, share, areas[place]),
                opens_leaf: lane == 0,
            }));
        }
    }
    formed
}
