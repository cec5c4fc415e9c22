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

use rayon::prelude::*;

use super::changes::MeshHashes;
use super::clusters::{self, Clusters};
use super::hierarchy::{self, Hierarchy, Touched, triangles};
use super::regions::{Condition, Growth, Region, survey};
use super::{BuildOptions, Triangles};
use crate::kd_tree::{Listing, Storage};
use crate::wide::{Block, LANES};
use crate::{Aabb, BuildError, CostModel, KdTree, Mesh};

/// If more than this share of the vertices may have moved, or of a sample of them, it is not looked into
/// which triangles have.
const MOST_OF_THE_VERTICES: f64 = 0.6;

/// Regions that have grown by this factor since their blocks were formed have come apart, and are formed
/// anew.
const APART: f32 = 2.0;

/// If more than this share of the triangles has come or gone, all is built anew.
const LARGEST_RECOUNT: f64 = 0.5;

/// If more than this share of the blocks is to be formed anew, all is built anew.
const LARGEST_CHANGE: f64 = 0.7;

/// When leaves together have grown by this factor, set against their blocks, the blocks of those that have
/// grown by more than all together are sorted into new ones.
const LARGEST_DRIFT: f32 = 1.12;

/// When inner nodes together have grown by this factor, set against the leaves, these are sorted into a new
/// hierarchy.
const LARGEST_SHIFT: f32 = 1.03;

/// A tree that is taken to be worse than a new one by this factor is built anew, but not within so many
/// frames of the last time.
const LARGEST_ROT: f32 = 1.08;
const REST: u32 = 4;

/// By which power of its wear a tree is taken to be worse, as long as nothing else is known.
const POWER: f32 = 1.6;

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
    /// Blocks and leaves, set against their triangles, since blocks were formed. Infinite if there was no time to form any
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
    /// How much worse it is taken to be than a new one.
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

/// How much worse a tree is than a new one. Its wear tells, but not in which measure, which is predicted from
/// what it was when the tree was last built anew.
#[derive(Clone, Copy, Debug)]
struct Rot {
    /// By how much blocks and leaves have grown ([`Innovation::blocks`]).
    wear: f32,
    /// Expected cost of a ray over the triangles' areas.
    effort: f32,
    /// The power of the wear by which the tree is taken to be worse.
    power: f32,
    /// Frames since all was built.
    frames: u32,
}

impl Rot {
    /// A new tree's.
    fn none(effort: f32) -> Self {
        Self {
            wear: 1.0,
            effort,
            power: POWER,
            frames: 0,
        }
    }

    /// By what factor the tree is taken to be worse than a new one; 1 if nothing is known of it.
    fn factor(&self) -> f32 {
        if self.wear.is_finite() {
            self.wear.powf(self.power)
        } else {
            1.0
        }
    }

    fn calls_for_building(&self) -> bool {
        self.frames >= REST && self.factor() > LARGEST_ROT
    }

    /// What was predicted is followed by a new tree's effort, which shows what it should have been.
    fn correct(&mut self, effort: f32) {
        let power = (self.effort / effort).ln() / self.wear.ln();
        if power.is_finite() {
            // As much is learned as is forgotten.
            self.power = 0.5 * self.power + 0.5 * power.clamp(0.2, 2.0 * POWER);
        }
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
    let cost = options.cost;
    let frame = Frame {
        triangles,
        budget,
        cost,
    };
    let (next, amounts, late) = match last {
        Some(last) => frame.follow(last, moved, hashes),
        None => frame.begin(hashes, Vec::new()),
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
    let (mut storage, clusters) = clusters::form(triangles, Vec::new());
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
    cost: CostModel,
}

impl<'m> Frame<'m> {
    /// Everything anew, in the memory of `list` where that serves. With a budget that does not allow it, only
    /// what makes a valid tree.
    fn begin(&self, hashes: MeshHashes, list: Vec<Block>) -> (TrackedTree, Amounts, usize) {
        let count = self.triangles.len();
        let forming = FORMING * (count / LANES) as u32;
        let late = !self.budget.allows(forming);
        let (storage, clusters, hierarchy) = if late {
            let (blocks, clusters) = clusters::in_order(&self.triangles);
            let (storage, hierarchy) = hierarchy::sort(&clusters.boxes, blocks);
            (storage, clusters, hierarchy)
        } else {
            let (mut storage, clusters) = clusters::form(&self.triangles, list);
            let hierarchy = Hierarchy::new(&mut storage.wide, &clusters.boxes);
            (storage, clusters, hierarchy)
        };
        let rebuilt = Amount {
            nodes: storage.nodes.len(),
            references: count,
        };
        let effort = hierarchy.costs(&storage.wide, &self.cost).sum() / clusters.sums().triangles;
        let tree = TrackedTree {
            bounds: hierarchy.bounds(&storage.wide),
            triangles: count,
            hashes,
            clusters,
            rot: Rot::none(effort),
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
        let rotten = tree.rot.calls_for_building();
        let recount = count.abs_diff(tree.triangles) as f64;
        let is_another = recount > LARGEST_RECOUNT * count.max(tree.triangles) as f64;
        let is_torn = || tree.clusters.share_apart(mesh, blocks) > MOST_OF_THE_BLOCKS;
        if self.allows_building() && (rotten || is_another || marks.is_none() && is_torn()) {
            let storage = Arc::try_unwrap(std::mem::take(&mut tree.storage));
            return self.begin_again(tree, storage.unwrap_or_default(), rotten);
        }
        // In place, if nobody has the last tree any more.
        let storage = std::mem::take(&mut tree.storage);
        let mut storage = Arc::try_unwrap(storage).unwrap_or_else(|shared| (*shared).clone());
        let (touched, mut changes) = if self.refit_blocks(&mut tree, &mut storage, marks) {
            storage = self.sort_all(&mut tree, storage);
            (Touched::All, Changes::sorted(count))
        } else {
            let boxes = &tree.clusters.boxes;
            let touched = tree.hierarchy.refit_leaves(&mut storage.wide, boxes, marks);
            (touched, Changes::default())
        };
        if !self.choose(&mut tree, &mut storage, &touched, &mut changes) {
            return self.begin_again(tree, storage, false);
        }
        let (storage, amounts) = self.arrange(&mut tree, storage, &touched, &mut changes);
        let work = tree.hierarchy.costs(&storage.wide, &self.cost).sum();
        let sums = tree.clusters.sums();
        tree.rot.effort = work / sums.triangles;
        // By how much blocks and leaves have grown since blocks were formed.
        let below = Growth {
            now: tree.hierarchy.area_below(&storage.wide),
            expected: sums.expected,
        };
        tree.rot.wear = below.factor();
        tree.rot.frames += 1;
        tree.bounds = tree.hierarchy.bounds(&storage.wide);
        tree.storage = Arc::new(storage);
        tree.late = changes.late > 0;
        (tree, amounts, changes.late.min(count))
    }

    /// Whether there is time to build everything anew.
    fn allows_building(&self) -> bool {
        self.budget
            .allows(FORMING * (self.triangles.len() / LANES) as u32)
    }

    /// [`Frame::begin`] when there was a tree, perhaps a rotten one.
    fn begin_again(
        &self,
        mut tree: TrackedTree,
        storage: Storage,
        rotten: bool,
    ) -> (TrackedTree, Amounts, usize) {
        let hashes = std::mem::take(&mut tree.hashes);
        let mut rot = tree.rot;
        let list = storage.wide.blocks.list;
        // Its memory serves again.
        drop(tree);
        let (mut tree, amounts, late) = self.begin(hashes, list);
        if rotten {
            rot.correct(tree.rot.effort);
        }
        tree.rot.power = rot.power;
        (tree, amounts, late)
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

    /// Chooses the regions that are to be done anew, and forms new blocks for those whose own have come
    /// apart. False if they are so many that all should be built anew.
    fn choose(
        &self,
        tree: &mut TrackedTree,
        storage: &mut Storage,
        touched: &Touched,
        changes: &mut Changes,
    ) -> bool {
        // What was put off is still to be done where nothing moves any more.
        let looked_at = if tree.late { &Touched::All } else { touched };
        let mut conditions = survey(storage, &tree.clusters, &tree.hierarchy, looked_at);
        // The worst come first, in case there is no time for all.
        let per_block = |condition: &Condition| {
            let excess = condition.all.now - condition.all.expected;
            excess / condition.blocks.max(1) as f32
        };
        conditions.sort_by(|a, b| per_block(b).total_cmp(&per_block(a)));
        let blocks = tree.clusters.count();
        let mut drift = Growth::default();
        let (mut apart, mut others) = (Vec::new(), Vec::new());
        let mut renewed = 0;
        for condition in conditions {
            drift.add(condition.nodes);
            if condition.all.factor() > APART {
                renewed += condition.blocks;
                apart.push(condition);
            } else {
                others.push(condition);
            }
        }
        if renewed as f64 > LARGEST_CHANGE * blocks as f64 && self.allows_building() {
            return false;
        }
        let sorting = SORTING * blocks as u32;
        let look = match self.budget.duration {
            Some(_) => REGIONS_A_LOOK * rayon::current_num_threads(),
            None => apart.len().max(1),
        };
        for chosen in apart.chunks(look) {
            let own: usize = chosen.iter().map(|condition| condition.blocks).sum();
            if self.budget.allows(FORMING * own as u32 + sorting) {
                let regions = chosen.par_iter();
                let regions = regions.map(|one| Region::of(storage, one.leaves.clone()));
                let mut regions: Vec<Region> = regions.collect();
                let (mesh, blocks) = (self.triangles.mesh(), &mut storage.wide.blocks);
                changes.formed += tree.clusters.form_anew(mesh, blocks, &mut regions);
                changes.regions.extend(regions);
            } else {
                changes.late += own * LANES;
            }
        }
        let drift = drift.factor();
        if drift > LARGEST_DRIFT {
            others.retain(|condition| condition.nodes.factor() > drift);
            if !self.budget.allows(sorting) {
                changes.late += usize::from(!others.is_empty());
                return true;
            }
            for Condition { leaves, .. } in &others {
                changes.sorted += triangles(&storage.wide, leaves.clone(), &tree.clusters.sizes);
            }
            let regions = others.into_par_iter();
            let regions = regions.map(|one| Region::of(storage, one.leaves));
            changes.regions.par_extend(regions);
        }
        true
    }

    /// Brings the nodes above the leaves up to date, with the regions that are to be done anew.
    fn arrange(
        &self,
        tree: &mut TrackedTree,
        mut storage: Storage,
        touched: &Touched,
        changes: &mut Changes,
    ) -> (Storage, Amounts) {
        let count = self.triangles.len();
        let sorting = SORTING * tree.clusters.count() as u32;
        let hierarchy = &mut tree.hierarchy;
        let (boxes, sizes) = (&tree.clusters.boxes, &tree.clusters.sizes);
        if changes.regions.is_empty() {
            hierarchy.refit_inner(&mut storage.wide);
            let settled = hierarchy.shift(&storage.wide) <= LARGEST_SHIFT;
            if changes.all_sorted || settled || !self.budget.allows(sorting) {
                storage.listing = Listing::Blocks(Default::default());
                changes.late += usize::from(!settled);
                let amounts = match changes.all_sorted {
                    true => changes.amounts(storage.nodes.len(), count),
                    false => touched.nodes(&storage, sizes, count),
                };
                return (storage, amounts);
            }
        }
        let stays = count.saturating_sub(changes.sorted + changes.formed);
        let mut amounts = touched.leaves(&storage.wide, &changes.regions, sizes, stays);
        storage = hierarchy.sort_leaves(storage, boxes, &changes.regions);
        if changes.all_sorted {
            let amounts = changes.amounts(storage.nodes.len(), count);
            return (storage, amounts);
        }
        amounts.rebuilt.references = changes.formed;
        amounts.searched = Amount {
            nodes: storage.nodes.len() - amounts.kept.nodes - amounts.moved.nodes,
            references: changes.sorted,
        };
        (storage, amounts)
    }

    /// Sorts all blocks into a new hierarchy.
    fn sort_all(&self, tree: &mut TrackedTree, storage: Storage) -> Storage {
        let (storage, hierarchy) = hierarchy::sort(&tree.clusters.boxes, storage.wide.blocks);
        tree.hierarchy = hierarchy;
        storage
    }
}

/// What is to change in a tree beyond its boxes.
#[derive(Default)]
struct Changes {
    /// Leaves that are to be made anew.
    regions: Vec<Region>,
    /// Triangles that are in new blocks.
    formed: usize,
    /// Triangles whose blocks are sorted into new leaves.
    sorted: usize,
    /// Whether all are.
    all_sorted: bool,
    /// How many there was no time for.
    late: usize,
}

impl Changes {
    /// After all blocks were sorted.
    fn sorted(count: usize) -> Self {
        Self {
            sorted: count,
            all_sorted: true,
            ..Self::default()
        }
    }

    /// What becomes of a tree whose blocks were all sorted, given its nodes and triangles.
    fn amounts(&self, nodes: usize, count: usize) -> Amounts {
        let formed = self.formed.min(count);
        let mut amounts = Amounts::default();
        amounts.rebuilt.references = formed;
        amounts.searched = Amount {
            nodes,
            references: count - formed,
        };
        amounts
    }
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

    fn quality(&self, cost: &CostModel) -> Quality {
        let wide = &self.storage.wide;
        let innovation = Innovation {
            blocks: self.rot.wear,
            leaves: self.hierarchy.drift(),
            nodes: self.hierarchy.shift(wide),
        };
        let costs = self.hierarchy.costs(wide, cost);
        let area = self.bounds.half_area();
        Quality {
            cost: match area > 0.0 {
                true => f64::from(costs.sum() / area),
                false => 0.0,
            },
            innovation,
            ratio: f64::from(self.rot.factor()),
        }
    }

    /// Bytes allocated, but for the tree itself.
    pub(crate) fn bytes(&self) -> usize {
        self.clusters.bytes() + self.hashes.bytes() + self.hierarchy.bytes()
    }
}
