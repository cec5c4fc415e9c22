//! A frame's tree from that of the frame before.
//!
//! The tree is one of boxes around blocks of neighboring triangles ([`Clusters`]). What is carried over
//! from frame to frame is who is next to whom: which triangles share a block, and
//! which blocks a subtree. Where nothing has moved, all stays as it is. Where something has, blocks
//! and boxes are brought up to date, which takes hardly longer than reading the triangles. When boxes
//! have grown compared with what is in them, blocks are sorted into a new hierarchy, of an eighth as
//! many members as there are triangles; blocks that have come apart themselves are formed
//! anew.
//!
//! Boxes are always around all that is in them, so no hit depends on what is kept. Everything but a
//! budget gives the same tree with any number of threads.

use std::ops::Range;
use std::sync::Arc;
use std::time::{Duration, Instant};

use rayon::prelude::*;

use super::changes::MeshHashes;
use super::clusters::{self, Clusters};
use super::object_split;
use super::{BuildOptions, NonFinite, Reference, Triangles};
use crate::kd_tree::{Listing, NodeKind, Storage};
use crate::wide::refit::{Tally, refit_inner, refit_leaves};
use crate::wide::{LANES, WideNode, WideTree};
use crate::{Aabb, BuildError, KdTree, Mesh};

/// If more than this share of the vertices may have moved, it is not looked into which triangles
/// have.
const MOST_OF_THE_VERTICES: f64 = 0.6;

/// A hierarchy whose nodes have grown by this factor, set against the blocks, is sorted anew.
const LARGEST_DRIFT: f32 = 1.03;

/// When all blocks' boxes together have grown by this factor, those that have come apart are looked
/// for.
const LARGEST_WEAR: f32 = 1.05;

/// If more than this share of the blocks have come apart, all is built anew.
const LARGEST_CHANGE: f64 = 0.4;

/// Leaves that one task refits.
const LEAVES: usize = 256;

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
    /// Without one, every region is built as well as any.
    pub(crate) duration: Option<Duration>,
}

/// A part of a tree.
#[derive(Clone, Copy, Default)]
pub(crate) struct Amount {
    pub(crate) nodes: usize,
    pub(crate) references: usize,
}

/// What an update gives.
pub(crate) struct TrackedUpdate<'m> {
    pub(crate) tree: KdTree<'m>,
    pub(crate) kept: Amount,
    pub(crate) moved: Amount,
    pub(crate) searched: Amount,
    pub(crate) rebuilt: Amount,
    pub(crate) sah_cost: f64,
    pub(crate) sah_ratio: f64,
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
    /// How worn the blocks were when they were last looked through.
    wear: f32,
}

/// What a tracker knows of its tree's nodes in their wide form.
#[derive(Clone, Debug, Default)]
struct Hierarchy {
    /// Around each.
    contents: Vec<Reference>,
    tallies: Vec<Tally>,
    /// Each block's leaf; empty if nobody has asked since they were sorted.
    seats: Vec<u32>,
    /// What the nodes' areas were over those of the blocks when these were sorted.
    sorted: f32,
}

/// Which blocks may have moved.
enum Dirty {
    None,
    Some(Vec<bool>),
    All,
}

/// Makes a frame's tree.
pub(crate) fn update<'m>(
    mesh: Mesh<'m>,
    options: &BuildOptions,
    tracked: &mut Option<TrackedTree>,
    moved: &Moved<'_>,
    budget: Budget,
) -> Result<TrackedUpdate<'m>, BuildError> {
    let triangles = Triangles::of(mesh, options.non_finite)?;
    let skipped = triangles.skipped();
    let _ = budget;
    // From here on nothing fails.
    let last = tracked.take().filter(|_| skipped == 0);
    let hashes = match (&last, moved) {
        (Some(last), Moved::Only(ranges)) => last.hashes.with_changes(mesh, ranges),
        _ => MeshHashes::of(mesh),
    };
    let count = triangles.len();
    let (next, done) = match last {
        Some(mut last) => {
            let dirty = last.dirty(mesh, moved, &hashes);
            last.hashes = hashes;
            let done = last.follow(mesh, &triangles, dirty);
            (last, done)
        }
        None => {
            let next = TrackedTree::new(&triangles, hashes);
            let done = Done::Rebuilt(count);
            (next, done)
        }
    };
    let shared = Arc::clone(&next.storage);
    let tree = KdTree::from_storage(mesh, next.bounds, shared, options.cost, skipped);
    let nodes = next.storage.nodes.len();
    let all = Amount { nodes, references: count };
    let mut update = TrackedUpdate {
        tree,
        kept: Amount::default(),
        moved: Amount::default(),
        searched: Amount::default(),
        rebuilt: Amount::default(),
        sah_cost: next.sah_cost(options),
        sah_ratio: next.sah_ratio(options),
    };
    match done {
        Done::Kept => update.kept = all,
        Done::Moved(dirty) => {
            let _ = dirty;
            update.moved = all
        }
        Done::Sorted(formed) => {
            update.searched = Amount {
                nodes,
                references: count - formed.min(count),
            };
            update.rebuilt.references = formed.min(count);
        }
        Done::Rebuilt(_) => update.rebuilt = all,
    }
    if skipped == 0 {
        *tracked = Some(next);
    }
    Ok(update)
}

enum Done {
    Kept,
    Moved(usize),
    Sorted(usize),
    Rebuilt(usize),
}

impl TrackedTree {
    /// All anew.
    fn new(triangles: &Triangles<'_>, hashes: MeshHashes) -> Self {
        let (storage, clusters) = clusters::form(triangles);
        let mut tree = Self {
            storage: Arc::default(),
            bounds: Aabb::EMPTY,
            triangles: triangles.len(),
            hashes,
            clusters,
            hierarchy: Hierarchy::default(),
            wear: 1.0,
        };
        let mut storage = storage;
        tree.hierarchy.refit(&mut storage.wide, &tree.clusters.boxes, None);
        tree.hierarchy.sorted = tree.hierarchy.overhead(&storage.wide);
        tree.bounds = tree.hierarchy.bounds(&storage.wide);
        tree.storage = Arc::new(storage);
        tree
    }

    /// What has moved since this frame.
    fn dirty(&mut self, mesh: Mesh<'_>, moved: &Moved<'_>, hashes: &MeshHashes) -> Dirty {
        let count = mesh.triangles().len();
        if count != self.triangles {
            return Dirty::All;
        }
        let mut marks;
        match moved {
            Moved::Only(ranges) => {
                marks = vec![false; self.clusters.boxes.len()];
                let homes = self.clusters.homes(&self.storage.wide.blocks, count);
                for range in *ranges {
                    let end = range.end.min(count);
                    for &home in &homes[range.start.min(end)..end] {
                        marks[home as usize] = true;
                    }
                }
            }
            Moved::Unknown => {
                let changes = hashes.changes_since(&self.hashes);
                if changes.is_empty() {
                    return Dirty::None;
                }
                if changes.share_of_vertices() > MOST_OF_THE_VERTICES {
                    return Dirty::All;
                }
                let mut moved = vec![false; count];
                changes.mark(mesh, &mut moved);
                marks = vec![false; self.clusters.boxes.len()];
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

    /// Goes on to the next frame.
    fn follow(&mut self, mesh: Mesh<'_>, triangles: &Triangles<'_>, dirty: Dirty) -> Done {
        let count = triangles.len();
        let marks = match &dirty {
            Dirty::None => return Done::Kept,
            Dirty::Some(marks) => Some(&marks[..]),
            Dirty::All => None,
        };
        let storage = std::mem::take(&mut self.storage);
        let mut storage = Arc::try_unwrap(storage).unwrap_or_else(|shared| (*shared).clone());
        let trace = std::env::var("TT").is_ok();
        let s = Instant::now();
        let Storage { members, wide, .. } = &mut storage;
        let mut formed = 0;
        if count < self.triangles {
            self.clusters.truncate(&mut wide.blocks, count);
        }
        self.clusters.refit(mesh, &mut wide.blocks, marks);
        let t0 = s.elapsed().as_secs_f64() * 1e3;
        if count > self.triangles {
            let new: Vec<u32> = (self.triangles as u32..count as u32).collect();
            self.clusters.add(mesh, &mut wide.blocks, new);
        }
        let recount = count != self.triangles;
        self.triangles = count;
        let wear = self.clusters.wear(&wide.blocks).growth;
        let t1 = s.elapsed().as_secs_f64() * 1e3;
        if wear > LARGEST_WEAR * self.wear.max(1.0) {
            let apart = self.clusters.apart(members, &wide.blocks);
            let share = apart.len() as f64 / self.clusters.count().max(1) as f64;
            if trace { eprintln!("wear {wear} apart {share}"); }
            if share > LARGEST_CHANGE {
                let hashes = std::mem::take(&mut self.hashes);
                *self = Self::new(triangles, hashes);
                return Done::Rebuilt(count);
            }
            formed = apart.len() * LANES;
            self.clusters.form_anew(mesh, &mut wide.blocks, &apart);
            self.wear = self.clusters.wear(&wide.blocks).growth;
        }
        let t2 = s.elapsed().as_secs_f64() * 1e3;
        let mut drift = f32::INFINITY;
        let keep = formed == 0 && !recount && {
            self.hierarchy.refit(wide, &self.clusters.boxes, marks);
            drift = self.hierarchy.overhead(wide) / self.hierarchy.sorted;
            drift <= LARGEST_DRIFT
        };
        let t3 = s.elapsed().as_secs_f64() * 1e3;
        if !keep {
            storage = self.sort(storage);
        } else {
            storage.listing = Listing::Blocks(Default::default());
        }
        let t4 = s.elapsed().as_secs_f64() * 1e3;
        if trace { eprintln!("refit {t0:.3} wear {:.3} form {:.3} hier {:.3} sort {:.3} drift {drift:.3} wear {wear:.3} blocks {}", t1-t0, t2-t1, t3-t2, t4-t3, self.clusters.count()); }
        self.bounds = self.hierarchy.bounds(&storage.wide);
        self.storage = Arc::new(storage);
        if keep { Done::Moved(count) } else { Done::Sorted(formed) }
    }

    /// Sorts the blocks into a new hierarchy.
    fn sort(&mut self, storage: Storage) -> Storage {
        let trace = std::env::var("TT").is_ok();
        let s = Instant::now();
        let boxes = self.clusters.boxes.iter();
        let mut boxes: Vec<Reference> = boxes.filter(|own| !own.is_empty()).copied().collect();
        let subtree = object_split::sort(&mut boxes, LANES);
        let t0 = s.elapsed().as_secs_f64() * 1e3;
        let mut leaves = Vec::with_capacity(subtree.nodes().len() / 2 * 5 / 4 + 2);
        for node in subtree.nodes() {
            if let NodeKind::Leaf { first, count } = node.kind() {
                let mut leaf = WideNode::EMPTY;
                for (lane, own) in boxes[first..first + count].iter().enumerate() {
                    leaf.set_bounds(lane, &own.bounds());
                    leaf.first[lane] = own.triangle;
                    leaf.end[lane] = own.triangle + 1;
                }
                leaves.push(leaf);
            }
        }
        let t1 = s.elapsed().as_secs_f64() * 1e3;
        let wide = WideTree::assemble(subtree.nodes(), leaves, storage.wide.blocks);
        let t2 = s.elapsed().as_secs_f64() * 1e3;
        let mut storage = subtree.into_storage(Listing::Blocks(Default::default()), wide);
        self.hierarchy = Hierarchy::default();
        self.hierarchy.refit(&mut storage.wide, &self.clusters.boxes, None);
        self.hierarchy.sorted = self.hierarchy.overhead(&storage.wide);
        let t3 = s.elapsed().as_secs_f64() * 1e3;
        if trace { eprintln!("   split {t0:.3} leaves {:.3} collapse {:.3} tally {:.3}", t1-t0, t2-t1, t3-t2); }
        storage
    }

    fn sah_cost(&self, options: &BuildOptions) -> f64 {
        self.hierarchy.cost(&self.storage.wide, options)
    }

    fn sah_ratio(&self, options: &BuildOptions) -> f64 {
        let _ = options;
        1.0
    }

    /// Bytes allocated, but for the tree itself.
    pub(crate) fn bytes(&self) -> usize {
        self.clusters.bytes()
            + self.hashes.bytes()
            + self.hierarchy.contents.capacity() * size_of::<Reference>()
            + self.hierarchy.tallies.capacity() * size_of::<Tally>()
            + self.hierarchy.seats.capacity() * size_of::<u32>()
    }
}

impl Hierarchy {
    /// Brings boxes up to date with those of the blocks: all, or those above blocks that `moved` marks.
    fn refit(&mut self, wide: &mut WideTree, boxes: &[Reference], moved: Option<&[bool]>) {
        let leaf_count = wide.leaf_count();
        let total = wide.nodes.len();
        self.contents.resize(total, Reference::ZERO);
        self.tallies.resize(total, Tally::default());
        let touched = moved.map(|moved| {
            if self.seats.is_empty() {
                self.seats.resize(boxes.len(), 0);
                for (leaf, node) in wide.nodes[..leaf_count].iter().enumerate() {
                    for block in (0..LANES).flat_map(|lane| node.blocks(lane)) {
                        self.seats[block] = leaf as u32;
                    }
                }
            }
            let mut touched = vec![false; leaf_count];
            for (&moved, &seat) in moved.iter().zip(&self.seats) {
                touched[seat as usize] |= moved;
            }
            touched
        });
        let leaves = wide.nodes[..leaf_count].par_chunks_mut(LEAVES);
        let contents = self.contents[..leaf_count].par_chunks_mut(LEAVES);
        let tallies = self.tallies[..leaf_count].par_chunks_mut(LEAVES);
        let tasks = leaves.zip(contents).zip(tallies).enumerate();
        tasks.for_each(|(task, ((leaves, contents), tallies))| match &touched {
            None => refit_leaves(leaves, boxes, contents, tallies, |_| true),
            Some(touched) => {
                let touched = &touched[task * LEAVES..][..leaves.len()];
                refit_leaves(leaves, boxes, contents, tallies, |place| touched[place]);
            }
        });
        refit_inner(&mut wide.nodes, leaf_count, &mut self.contents, &mut self.tallies);
    }

    /// The areas of the nodes over those of the blocks.
    fn overhead(&self, wide: &WideTree) -> f32 {
        let root = self.tallies[wide.root as usize];
        if root.blocks > 0.0 { root.nodes / root.blocks } else { 0.0 }
    }

    fn bounds(&self, wide: &WideTree) -> Aabb {
        let Aabb { min, max } = self.contents[wide.root as usize].bounds();
        // Never -0, which instruction sets treat differently when they look for minima.
        Aabb { min: min.map(|x| x + 0.0), max: max.map(|x| x + 0.0) }
    }

    fn cost(&self, wide: &WideTree, options: &BuildOptions) -> f64 {
        let root = self.tallies[wide.root as usize];
        let area = self.contents[wide.root as usize].bounds().half_area();
        let cost = &options.cost;
        let sum = f64::from(cost.traversal * root.nodes) + f64::from(cost.leaf(LANES as u32) * root.blocks);
        if area > 0.0 { sum / f64::from(area) } else { 0.0 }
    }
}
