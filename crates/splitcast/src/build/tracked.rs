//! A frame's tree from that of the frame before.
//!
//! The tree is one of boxes around blocks of neighboring triangles ([`Clusters`]). What is carried over
//! from frame to frame is who is next to whom: which triangles share a block, which blocks
//! a leaf, and which leaves a subtree ([`Hierarchy`]). It is predicted that what was close stays close.
//! Where nothing has moved, all stays as it is. Where something has, blocks and boxes are brought up
//! to date, which takes hardly longer than reading the triangles, and shows on each level how good
//! the prediction was: by how much boxes have grown, compared with those in them. Where blocks
//! have, their triangles are formed into new ones; where leaves have, their blocks are sorted into
//! new ones; and when the nodes above have, the leaves are sorted into a new hierarchy, of a
//! fiftieth as many members as there are triangles.
//!
//! Boxes are always around all that is in them, so no hit depends on what is kept. Everything but a
//! budget gives the same tree with any number of threads.

use std::ops::Range;
use std::sync::Arc;
use std::time::{Duration, Instant};

use super::changes::MeshHashes;
use super::clusters::{self, Clusters};
use rayon::prelude::*;

use super::hierarchy::{self, Costs, Hierarchy, Region, blocks_of, regions, triangles};
use super::{BuildOptions, Triangles};
use crate::kd_tree::{Listing, Storage};
use crate::wide::LANES;
use crate::{Aabb, BuildError, CostModel, KdTree, Mesh};

/// If more than this share of the vertices may have moved, or of a sample of them, it is not looked into
/// which triangles have.
const MOST_OF_THE_VERTICES: f64 = 0.6;

/// When leaves together have grown by this factor, set against their blocks, the blocks of those that have
/// grown by more than all together are sorted into new ones.
const LARGEST_DRIFT: f32 = 1.05;

/// When inner nodes together have grown by this factor, set against the leaves, these are sorted into a new
/// hierarchy.
const LARGEST_SHIFT: f32 = 1.03;

/// After how many times that only leaves are sorted all blocks are: at first, at least and at most.
const PATIENCE: [u32; 3] = [8, 4, 64];

/// If sorting all blocks saves rays this factor of the way to them, it pays to do so more often; if
/// less than the second, less often.
const GAINS: [f32; 2] = [1.05, 1.02];

/// When all blocks' boxes together have grown by this factor, set against their triangles, those that have
/// come apart are looked for.
const LARGEST_WEAR: f32 = 1.05;

/// If more than this share of the blocks are in regions that have come apart, all is built anew.
const LARGEST_CHANGE: f64 = 0.7;

/// If more than this share of a sample of the blocks have come apart, it is not looked into which have.
const MOST_OF_THE_BLOCKS: f64 = 0.4;

/// Regions that each thread forms between two looks at the clock.
const REGIONS_A_LOOK: usize = 4;

/// Guesses for a budget, before there is anything to go by: time to sort a block, and to build
/// one anew with its triangles.
const SORTING: Duration = Duration::from_nanos(150);
const FORMING: Duration = Duration::from_nanos(2000);

/// What may have moved since the last frame.
pub(crate) enum Moved<'a> {
    /// To be found out.
    Unknown,
    /// No triangle but these.
    Only(&'a [Range<usize>]),
}

/// When an update should be done.
#[derive(Clone, Copy)]
pub(crate) struct Budget {
    pub(crate) started: Instant,
    /// Without one, everything is done that should be.
    pub(crate) duration: Option<Duration>,
}

impl Budget {
    /// Whether there is time for something that takes so long.
    fn allows(&self, time: Duration) -> bool {
        self.duration
            .is_none_or(|duration| self.started.elapsed() + time <= duration)
    }
}

/// A part of a tree.
#[derive(Clone, Copy, Default)]
pub(crate) struct Amount {
    pub(crate) nodes: usize,
    pub(crate) references: usize,
}

/// What became of the parts of a tree.
#[derive(Clone, Copy, Default)]
pub(crate) struct Amounts {
    /// Nothing in them has moved.
    pub(crate) kept: Amount,
    /// Their boxes were brought up to date.
    pub(crate) moved: Amount,
    /// They were sorted into a new hierarchy.
    pub(crate) searched: Amount,
    /// They were built anew.
    pub(crate) rebuilt: Amount,
}

/// What an update gives.
pub(crate) struct TrackedUpdate<'m> {
    pub(crate) tree: KdTree<'m>,
    pub(crate) amounts: Amounts,
    /// Triangles in blocks that there was no time to form anew.
    pub(crate) late: usize,
    pub(crate) quality: Quality,
}

/// By what factor boxes have grown, set against those in them, since it was predicted that they would
/// not: since they were last sorted or formed. 1 is a perfect prediction, and less is better than it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Innovation {
    /// Blocks, set against their triangles. Infinite if there was no time to form any
    /// ([`Tracker::update_within`](crate::Tracker::update_within)).
    pub blocks: f32,
    /// Leaves, set against their blocks.
    pub leaves: f32,
    /// Inner nodes, set against the leaves.
    pub nodes: f32,
}

impl Default for Innovation {
    /// All as predicted.
    fn default() -> Self {
        Self {
            blocks: 1.0,
            leaves: 1.0,
            nodes: 1.0,
        }
    }
}

/// How good a tree is.
#[derive(Clone, Copy)]
pub(crate) struct Quality {
    /// Expected cost of a ray.
    pub(crate) cost: f64,
    pub(crate) innovation: Innovation,
    /// The cost over what it would be without either.
    pub(crate) ratio: f64,
}

/// A frame's tree as the next frame needs it.
#[derive(Clone, Debug)]
pub(crate) struct TrackedTree {
    storage: Arc<Storage>,
    bounds: Aabb,
    /// Number of triangles of the mesh.
    triangles: usize,
    hashes: MeshHashes,
    clusters: Clusters,
    hierarchy: Hierarchy,
    rot: Rot,
    /// Whether something was left undone for want of time.
    late: bool,
}

/// How well it goes without sorting all blocks: what is predicted of that from how it was before.
#[derive(Clone, Copy, Debug)]
struct Rot {
    /// Times that only leaves were sorted since.
    times: u32,
    /// How many are enough.
    patience: u32,
    /// Nodes a block that a ray was to meet when nodes were last sorted.
    effort: f32,
}

impl Rot {
    fn new(effort: f32) -> Self {
        Self {
            times: 0,
            patience: PATIENCE[0],
            effort,
        }
    }

    /// All blocks were sorted, which shows whether it was time.
    fn all_sorted(&mut self, effort: f32) {
        let gain = self.effort / effort;
        let [_, least, most] = PATIENCE;
        if gain > GAINS[0] {
            self.patience = (self.patience / 2).max(least);
        } else if gain < GAINS[1] {
            self.patience = (self.patience * 2).min(most);
        }
        (self.times, self.effort) = (0, effort);
    }
}

/// Which blocks may have moved.
enum Dirty {
    None,
    Some(Vec<bool>),
    All,
}

/// Makes a frame's tree. If it cannot, `tracked` stays as it is.
pub(crate) fn update<'m>(
    mesh: Mesh<'m>,
    options: &BuildOptions,
    tracked: &mut Option<TrackedTree>,
    moved: &Moved<'_>,
    budget: Budget,
) -> Result<TrackedUpdate<'m>, BuildError> {
    let triangles = Triangles::of(mesh, options.non_finite)?;
    let skipped = triangles.skipped();
    let last = tracked.take().filter(|_| skipped == 0);
    let hashes = match (&last, moved) {
        (Some(last), Moved::Only(ranges)) => last.hashes.with_changes(mesh, ranges),
        (Some(last), Moved::Unknown) => {
            let sample = MeshHashes::sample_of(mesh);
            if sample.share_of_sample(&last.hashes) > MOST_OF_THE_VERTICES {
                sample
            } else {
                MeshHashes::of(mesh)
            }
        }
        (None, _) => MeshHashes::of(mesh),
    };
    let frame = Frame { triangles, budget };
    let (next, amounts, late) = match last {
        Some(last) => frame.follow(last, moved, hashes),
        None => frame.begin(hashes),
    };
    let shared = Arc::clone(&next.storage);
    let update = TrackedUpdate {
        tree: KdTree::from_storage(mesh, next.bounds, shared, options.cost, skipped),
        amounts,
        late,
        quality: next.quality(&options.cost),
    };
    *tracked = (skipped == 0).then_some(next);
    Ok(update)
}

/// A tree that is not to be tracked.
pub(super) fn build<'m>(triangles: &Triangles<'m>, options: &BuildOptions) -> KdTree<'m> {
    let (mut storage, clusters) = clusters::form(triangles);
    let hierarchy = Hierarchy::new(&mut storage.wide, &clusters.boxes);
    let bounds = hierarchy.bounds(&storage.wide);
    KdTree::from_storage(
        triangles.mesh(),
        bounds,
        Arc::new(storage),
        options.cost,
        triangles.skipped(),
    )
}

/// The frame that a tree is made for.
struct Frame<'m> {
    triangles: Triangles<'m>,
    budget: Budget,
}

impl<'m> Frame<'m> {
    /// Everything anew. With a budget that does not allow it, only what makes a valid tree.
    fn begin(&self, hashes: MeshHashes) -> (TrackedTree, Amounts, usize) {
        let count = self.triangles.len();
        let forming = FORMING * (count / LANES) as u32;
        let late = !self.budget.allows(forming);
        let (storage, clusters, hierarchy) = if late {
            let (blocks, clusters) = clusters::in_order(&self.triangles);
            let (storage, hierarchy) = hierarchy::sort(&clusters.boxes, blocks);
            (storage, clusters, hierarchy)
        } else {
            let (mut storage, clusters) = clusters::form(&self.triangles);
            let hierarchy = Hierarchy::new(&mut storage.wide, &clusters.boxes);
            (storage, clusters, hierarchy)
        };
        let rebuilt = Amount {
            nodes: storage.nodes.len(),
            references: count,
        };
        let tree = TrackedTree {
            bounds: hierarchy.bounds(&storage.wide),
            triangles: count,
            hashes,
            clusters,
            rot: Rot::new(hierarchy.effort(&storage.wide)),
            storage: Arc::new(storage),
            hierarchy,
            late,
        };
        let amounts = Amounts {
            rebuilt,
            ..Amounts::default()
        };
        (tree, amounts, if late { count } else { 0 })
    }

    /// What becomes of the last tree.
    fn follow(
        &self,
        mut tree: TrackedTree,
        moved: &Moved<'_>,
        hashes: MeshHashes,
    ) -> (TrackedTree, Amounts, usize) {
        let mesh = self.triangles.mesh();
        let count = self.triangles.len();
        let dirty = tree.dirty(mesh, moved, &hashes);
        tree.hashes = hashes;
        let marks = match dirty {
            Dirty::None if !tree.late => {
                let amounts = Amounts {
                    kept: Amount {
                        nodes: tree.storage.nodes.len(),
                        references: count,
                    },
                    ..Amounts::default()
                };
                return (tree, amounts, 0);
            }
            Dirty::None => Some(vec![false; tree.clusters.boxes.len()]),
            Dirty::Some(marks) => Some(marks),
            Dirty::All => None,
        };
        let marks = marks.as_deref();
        let blocks = &tree.storage.wide.blocks;
        let torn = marks.is_none()
            && tree.clusters.share_apart(mesh, blocks) > MOST_OF_THE_BLOCKS
            && self.allows_building();
        // In place, if nobody has the last tree any more.
        let storage = std::mem::take(&mut tree.storage);
        if torn {
            return self.begin_again(tree, storage);
        }
        let mut storage = Arc::try_unwrap(storage).unwrap_or_else(|shared| (*shared).clone());
        let recount = self.refit_blocks(&mut tree, &mut storage, marks);
        let Some(changes) = self.form_anew(&mut tree, &mut storage) else {
            return self.begin_again(tree, storage);
        };
        let (storage, amounts, late) = match recount {
            true => {
                let (storage, amounts) = self.sort_all(&mut tree, storage, &changes);
                (storage, amounts, changes.late)
            }
            false => self.sort_anew(&mut tree, storage, marks, changes),
        };
        tree.bounds = tree.hierarchy.bounds(&storage.wide);
        tree.storage = Arc::new(storage);
        tree.late = late > 0;
        (tree, amounts, late.min(count))
    }

    /// Whether there is time to build everything anew.
    fn allows_building(&self) -> bool {
        self.budget
            .allows(FORMING * (self.triangles.len() / LANES) as u32)
    }

    /// [`Frame::begin`] when there was a tree, whose memory serves again.
    fn begin_again<T>(&self, mut tree: TrackedTree, storage: T) -> (TrackedTree, Amounts, usize) {
        let hashes = std::mem::take(&mut tree.hashes);
        drop((tree, storage));
        self.begin(hashes)
    }

    /// Brings blocks up to date with the mesh. Gives whether it has another number of triangles.
    fn refit_blocks(
        &self,
        tree: &mut TrackedTree,
        storage: &mut Storage,
        marks: Option<&[bool]>,
    ) -> bool {
        let (mesh, count) = (self.triangles.mesh(), self.triangles.len());
        let blocks = &mut storage.wide.blocks;
        if count < tree.triangles {
            tree.clusters.truncate(blocks, count);
        }
        tree.clusters.refit(mesh, blocks, marks);
        if count > tree.triangles {
            let new = (tree.triangles as u32..count as u32).collect();
            tree.clusters.add(mesh, blocks, new);
        }
        let recount = count != tree.triangles;
        tree.triangles = count;
        recount
    }

    /// Forms those blocks anew that have come apart. `None` if they are so many that all should be.
    fn form_anew(&self, tree: &mut TrackedTree, storage: &mut Storage) -> Option<Changes> {
        let mut changes = Changes::default();
        if tree.clusters.wear() <= LARGEST_WEAR {
            return Some(changes);
        }
        let mut apart = tree.apart(storage);
        let total: usize = apart.iter().map(|region| region.blocks.len()).sum();
        let share = total as f64 / tree.clusters.count().max(1) as f64;
        if share > LARGEST_CHANGE && self.allows_building() {
            return None;
        }
        let sorting = SORTING * tree.clusters.count() as u32;
        let look = if self.budget.duration.is_some() {
            REGIONS_A_LOOK * rayon::current_num_threads()
        } else {
            apart.len().max(1)
        };
        // The ones that were put off come first in the next frame.
        let turn = apart.len() / 2 * usize::from(tree.late);
        apart.rotate_left(turn);
        let blocks = &mut storage.wide.blocks;
        while !apart.is_empty() {
            let mut regions: Vec<Region> = apart.drain(..look.min(apart.len())).collect();
            let own: usize = regions.iter().map(|region| region.blocks.len()).sum();
            if self.budget.allows(FORMING * own as u32 + sorting) {
                let mesh = self.triangles.mesh();
                changes.formed += tree.clusters.form_anew(mesh, blocks, &mut regions);
                changes.regions.extend(regions);
            } else {
                changes.late += own * LANES;
            }
        }
        Some(changes)
    }

    /// Brings the nodes above the blocks up to date, and sorts those anew that have grown.
    fn sort_anew(
        &self,
        tree: &mut TrackedTree,
        mut storage: Storage,
        marks: Option<&[bool]>,
        mut changes: Changes,
    ) -> (Storage, Amounts, usize) {
        let count = self.triangles.len();
        let sorting = SORTING * tree.clusters.count() as u32;
        let (hierarchy, boxes) = (&mut tree.hierarchy, &tree.clusters.boxes);
        let sizes = &tree.clusters.sizes;
        let touched = hierarchy.refit_leaves(&mut storage.wide, boxes, marks);
        hierarchy.leave_out(&changes.regions);
        let mut searched = 0;
        let growth = hierarchy.drift();
        if growth > LARGEST_DRIFT {
            let loose = hierarchy.loose(&storage.nodes, growth);
            if !self.budget.allows(sorting) {
                changes.late += usize::from(!loose.is_empty());
            } else {
                for leaves in loose {
                    searched += triangles(&storage.wide, leaves.clone(), sizes);
                    let blocks = blocks_of(&storage.wide.nodes()[leaves.clone()]);
                    let blocks = blocks.map(|block| block as u32).collect();
                    changes.regions.push(Region { leaves, blocks });
                }
            }
        }
        if changes.regions.is_empty() {
            hierarchy.refit_inner(&mut storage.wide);
            let settled = hierarchy.shift(&storage.wide) <= LARGEST_SHIFT;
            if settled || !self.budget.allows(sorting) {
                storage.listing = Listing::Blocks(Default::default());
                let amounts = touched.nodes(&storage, sizes, count);
                return (storage, amounts, changes.late + usize::from(!settled));
            }
        }
        tree.rot.times += 1;
        if tree.rot.times > tree.rot.patience && self.budget.allows(sorting) {
            let (storage, amounts) = self.sort_all(tree, storage, &changes);
            return (storage, amounts, changes.late);
        }
        let stays = count - searched - changes.formed.min(count);
        let mut amounts = touched.leaves(&storage.wide, &changes.regions, sizes, stays);
        storage = hierarchy.sort_leaves(storage, boxes, &changes.regions);
        tree.rot.effort = hierarchy.effort(&storage.wide);
        amounts.rebuilt.references = changes.formed;
        amounts.searched = Amount {
            nodes: storage.nodes.len() - amounts.kept.nodes - amounts.moved.nodes,
            references: searched,
        };
        (storage, amounts, changes.late)
    }

    /// Sorts all blocks into a new hierarchy.
    fn sort_all(
        &self,
        tree: &mut TrackedTree,
        storage: Storage,
        changes: &Changes,
    ) -> (Storage, Amounts) {
        let (storage, hierarchy) = hierarchy::sort(&tree.clusters.boxes, storage.wide.blocks);
        tree.rot.all_sorted(hierarchy.effort(&storage.wide));
        tree.hierarchy = hierarchy;
        let count = self.triangles.len();
        let formed = changes.formed.min(count);
        let mut amounts = Amounts::default();
        amounts.rebuilt.references = formed;
        amounts.searched = Amount {
            nodes: storage.nodes.len(),
            references: count - formed,
        };
        (storage, amounts)
    }
}

/// What is to change in a tree beyond its boxes.
#[derive(Default)]
struct Changes {
    /// Leaves that are to be made anew.
    regions: Vec<Region>,
    /// Triangles that are in new blocks.
    formed: usize,
    /// How many there was no time for.
    late: usize,
}

impl TrackedTree {
    /// What has moved since this frame.
    fn dirty(&mut self, mesh: Mesh<'_>, moved: &Moved<'_>, hashes: &MeshHashes) -> Dirty {
        let count = mesh.triangles().len();
        if count != self.triangles {
            return Dirty::All;
        }
        let mut marks = vec![false; self.clusters.boxes.len()];
        match moved {
            Moved::Only(ranges) => {
                let homes = self.clusters.homes(&self.storage.wide.blocks, count);
                for range in *ranges {
                    let end = range.end.min(count);
                    for &home in &homes[range.start.min(end)..end] {
                        marks[home as usize] = true;
                    }
                }
            }
            Moved::Unknown => {
                if !hashes.are_complete() || !self.hashes.are_complete() {
                    return Dirty::All;
                }
                let changes = hashes.changes_since(&self.hashes);
                if changes.is_empty() {
                    return Dirty::None;
                }
                if changes.share_of_vertices() > MOST_OF_THE_VERTICES {
                    return Dirty::All;
                }
                let mut moved = vec![false; count];
                changes.mark(mesh, &mut moved);
                let homes = self.clusters.homes(&self.storage.wide.blocks, count);
                for (moved, &home) in moved.iter().zip(homes) {
                    marks[home as usize] |= moved;
                }
            }
        }
        if marks.contains(&true) {
            Dirty::Some(marks)
        } else {
            Dirty::None
        }
    }

    /// The regions whose blocks have come apart.
    fn apart(&self, storage: &Storage) -> Vec<Region> {
        let wide = &storage.wide;
        let find = |leaves: Range<usize>| {
            let blocks = || blocks_of(&wide.nodes()[leaves.clone()]);
            let in_use = |index: &usize| self.clusters.is_in_use(*index);
            self.clusters.are_apart(blocks()).then(|| Region {
                blocks: (blocks().filter(in_use).map(|block| block as u32)).collect(),
                leaves: leaves.clone(),
            })
        };
        let found = regions(&storage.nodes).into_par_iter().filter_map(find);
        found.collect()
    }

    fn quality(&self, cost: &CostModel) -> Quality {
        let wide = &self.storage.wide;
        let innovation = Innovation {
            blocks: self.clusters.wear(),
            leaves: self.hierarchy.drift(),
            nodes: self.hierarchy.shift(wide),
        };
        let Costs {
            inner,
            leaves,
            blocks,
        } = self.hierarchy.costs(wide, cost);
        let [a, b, c] = [innovation.nodes, innovation.leaves, innovation.blocks].map(f64::from);
        let cost = inner + leaves + blocks;
        let expected = (((inner / a) + leaves) / b + blocks) / c;
        Quality {
            cost,
            innovation,
            ratio: if expected > 0.0 && expected.is_finite() {
                cost / expected
            } else {
                1.0
            },
        }
    }

    /// Bytes allocated, but for the tree itself.
    pub(crate) fn bytes(&self) -> usize {
        self.clusters.bytes() + self.hashes.bytes() + self.hierarchy.bytes()
    }
}
