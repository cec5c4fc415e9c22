//! A frame's tree from that of the frame before.
//!
//! The tree is one of boxes around blocks of neighboring triangles ([`Clusters`]). What is carried over
//! from frame to frame is who is next to whom: which triangles share a block, and
//! which blocks a subtree ([`Hierarchy`]). It is predicted that what was close stays close. Where
//! nothing has moved, all stays as it is. Where something has, blocks and boxes are brought up
//! to date, which takes hardly longer than reading the triangles, and shows how good the
//! prediction was: when nodes have grown compared with the blocks in them, the blocks
//! are sorted into a new hierarchy, of an eighth as many members as there are triangles;
//! where blocks have grown compared with their triangles, new ones are formed.
//!
//! Boxes are always around all that is in them, so no hit depends on what is kept. Everything but a
//! budget gives the same tree with any number of threads.

use std::ops::Range;
use std::sync::Arc;
use std::time::{Duration, Instant};

use super::changes::MeshHashes;
use super::clusters::{self, Clusters};
use super::hierarchy::{self, Hierarchy, Touched};
use super::subtree::members_of;
use super::{BuildOptions, Triangles};
use crate::kd_tree::{Listing, Node, NodeKind, Storage};
use crate::wide::LANES;
use crate::{Aabb, BuildError, CostModel, KdTree, Mesh};

/// If more than this share of the vertices may have moved, or of a sample of them, it is not looked into
/// which triangles have.
const MOST_OF_THE_VERTICES: f64 = 0.6;

/// A hierarchy whose nodes have grown by this factor, set against the blocks, is sorted anew.
const LARGEST_DRIFT: f32 = 1.03;

/// When all blocks' boxes together have grown by this factor, set against their triangles, those that have
/// come apart are looked for.
const LARGEST_WEAR: f32 = 1.05;

/// Blocks of a subtree whose triangles are formed into new ones together, at most.
const REGION: usize = 64;

/// If more than this share of the blocks have come apart, all is built anew.
const LARGEST_CHANGE: f64 = 0.4;

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

/// How good a tree is.
#[derive(Clone, Copy)]
pub(crate) struct Quality {
    /// Expected cost of a ray.
    pub(crate) cost: f64,
    /// By how much nodes have grown, set against the blocks, since these were sorted.
    pub(crate) drift: f32,
    /// By how much blocks have grown, set against their triangles, since they were formed.
    pub(crate) wear: f32,
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
    /// Whether something was left undone for want of time.
    late: bool,
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
            storage: Arc::new(storage),
            triangles: count,
            hashes,
            clusters,
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
        let marks = match &dirty {
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
            Dirty::Some(marks) => Some(marks.clone()),
            Dirty::All => None,
        };
        // In place, if nobody has the last tree any more.
        let storage = std::mem::take(&mut tree.storage);
        let mut storage = Arc::try_unwrap(storage).unwrap_or_else(|shared| (*shared).clone());
        let blocks = &mut storage.wide.blocks;
        let recount = count != tree.triangles;
        if count < tree.triangles {
            tree.clusters.truncate(blocks, count);
        }
        tree.clusters.refit(mesh, blocks, marks.as_deref());
        if count > tree.triangles {
            let new = (tree.triangles as u32..count as u32).collect();
            tree.clusters.add(mesh, blocks, new);
        }
        tree.triangles = count;
        let (mut formed, mut late) = (0, 0);
        let (now, then) = tree.clusters.areas();
        if now > LARGEST_WEAR * then {
            let regions = regions(&storage.nodes, &storage.members);
            let mut apart = tree.clusters.apart(&regions);
            let total: usize = apart.iter().map(Vec::len).sum();
            let share = total as f64 / tree.clusters.count().max(1) as f64;
            if share > LARGEST_CHANGE && self.budget.allows(FORMING * (count / LANES) as u32) {
                let hashes = std::mem::take(&mut tree.hashes);
                // Their memory serves again.
                drop((tree, storage));
                return self.begin(hashes);
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
            for regions in apart.chunks(look) {
                let own: usize = regions.iter().map(Vec::len).sum();
                if self.budget.allows(FORMING * own as u32 + sorting) {
                    formed += tree.clusters.form_anew(mesh, blocks, regions);
                } else {
                    late += own * LANES;
                }
            }
        }
        let mut touched = Touched::All;
        let settled = !recount && formed == 0 && {
            touched =
                tree.hierarchy
                    .refit(&mut storage.wide, &tree.clusters.boxes, marks.as_deref());
            tree.hierarchy.drift(&storage.wide) <= LARGEST_DRIFT
        };
        let must = recount || formed > 0;
        let sorting = SORTING * tree.clusters.count() as u32;
        let mut amounts = Amounts::default();
        if must || !settled && self.budget.allows(sorting) {
            (storage, tree.hierarchy) = hierarchy::sort(&tree.clusters.boxes, storage.wide.blocks);
            amounts.rebuilt.references = formed.min(count);
            amounts.searched = Amount {
                nodes: storage.nodes.len(),
                references: count - amounts.rebuilt.references,
            };
        } else {
            storage.listing = Listing::Blocks(Default::default());
            amounts.moved = touched.amount(&storage);
            amounts.kept = Amount {
                nodes: storage.nodes.len() - amounts.moved.nodes,
                references: count - amounts.moved.references,
            };
            late += usize::from(!settled);
        }
        tree.bounds = tree.hierarchy.bounds(&storage.wide);
        tree.storage = Arc::new(storage);
        tree.late = late > 0;
        (tree, amounts, late.min(count))
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
        let (now, then) = self.clusters.areas();
        let wear = if then > 0.0 { now / then } else { 1.0 };
        let drift = self.hierarchy.drift(&self.storage.wide);
        let (nodes, blocks) = self.hierarchy.costs(&self.storage.wide, cost);
        let undrifted = nodes / f64::from(drift) + blocks;
        Quality {
            cost: nodes + blocks,
            drift,
            wear,
            ratio: if undrifted > 0.0 {
                (nodes + blocks) / undrifted * f64::from(wear)
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

/// The members of the largest subtrees of no more than [`REGION`], in order.
fn regions<'m>(nodes: &[Node], members: &'m [u32]) -> Vec<&'m [u32]> {
    let mut found = Vec::new();
    let mut waiting = vec![(0, nodes.len())];
    while let Some((root, end)) = waiting.pop() {
        let range = members_of(&nodes[root..end]);
        match nodes[root].kind() {
            NodeKind::Inner { right, .. } if range.len() > REGION => {
                waiting.push((right, end));
                waiting.push((root + 1, right));
            }
            _ => found.push(&members[range]),
        }
    }
    found
}
