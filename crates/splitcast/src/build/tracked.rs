//! A frame's tree from that of the frame before.
//!
//! A tree falls into regions ([`TrackedTree`]). Where nothing has moved, a region is kept
//! as it is; the others are built anew, below the planes between the regions, which stay.
//! When much has moved, or those planes have become worse than new ones, all is built
//! anew.
//!
//! What may have moved is sorted in against the planes that are there, so no hit
//! depends on what is kept. Everything but a budget gives the same tree with any number
//! of threads.

use std::ops::Range;
use std::sync::Arc;
use std::time::{Duration, Instant};

use rayon::prelude::*;

use super::binned::{leaf_cells, top_tree};
use super::binned_subtree::Binning;
use super::changes::MeshHashes;
use super::distribute::distribute;
use super::limits::Limits;
use super::regions::{Region, Regions, TrackedTree, divide};
use super::straddlers::cut_to_cell;
use super::{BuildOptions, NodeWriter, Reference, Subtree, Triangles};
use crate::kd_tree::NodeKind;
use crate::wide::WideTree;
use crate::{Aabb, BuildError, KdTree, Mesh};

/// If more than this share of the triangles may have moved, all is built anew: with their
/// neighbors, and the looking for them, it would take as long.
const LARGEST_CHANGE: f64 = 0.4;

/// If more than this share of the vertices may have moved, it is not looked into which triangles
/// have.
const MOST_OF_THE_VERTICES: f64 = 0.6;

/// A tree whose expected cost has risen by this factor is built anew once half of
/// its triangles have moved.
const LARGEST_DRIFT: f64 = 1.05;

/// Planes between regions, and the box around all, serve until triangles have moved so many times, on
/// average, however well they do.
const LONGEST: usize = 8;

/// Factor by which the box around all may grow.
const LARGEST_GROWTH: f32 = 1.2;

/// Leaves of regions that there is no time for: about two levels less than usual.
const COARSE_LEAF: u32 = 512;

/// Time that such a region takes, of one built as usual.
const COARSE_TIME: f64 = 0.5;

/// Regions that each thread builds between two looks at the clock.
const REGIONS_A_LOOK: usize = 4;

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
    /// For the next frame; nothing if triangles had to be skipped.
    pub(crate) tracked: Option<TrackedTree>,
    pub(crate) kept: Amount,
    pub(crate) rebuilt: Amount,
    pub(crate) coarse: Amount,
    /// Time spent on building regions.
    pub(crate) building: Duration,
    pub(crate) sah_cost: f64,
    /// Over that of the last tree that was built as a whole.
    pub(crate) sah_ratio: f64,
}

/// Makes a frame's tree.
pub(crate) fn update<'m>(
    mesh: Mesh<'m>,
    options: &BuildOptions,
    last: Option<&TrackedTree>,
    moved: &Moved<'_>,
    budget: Budget,
) -> Result<TrackedUpdate<'m>, BuildError> {
    let triangles = Triangles::of(mesh, options.non_finite)?;
    let frame = Frame {
        mesh,
        options,
        limits: Limits::of_tree(options.depth_bound(triangles.len()), triangles.len()),
        triangles,
        budget,
    };
    let last = last.filter(|_| frame.triangles.skipped() == 0);
    let moved = match last {
        // Numbers need not mean the triangles that they meant before.
        Some(last) if last.triangles != frame.triangles.len() => &Moved::Unknown,
        _ => moved,
    };
    let hashes = match (last, moved) {
        (Some(last), Moved::Only(ranges)) => last.hashes.with_changes(mesh, ranges),
        _ => MeshHashes::of(mesh),
    };
    let plan = match last.and_then(|last| frame.change(last, moved, &hashes)) {
        Some(Change::Nothing(last)) => return Ok(frame.same(last)),
        Some(Change::Regions(plan)) => plan,
        None => frame.build_all(),
    };
    frame.assemble(plan, hashes)
}

/// The frame that a tree is made for.
struct Frame<'a, 'm> {
    mesh: Mesh<'m>,
    options: &'a BuildOptions,
    limits: Limits,
    triangles: Triangles<'m>,
    budget: Budget,
}

/// What a tree is to be put together from.
struct Plan<'t> {
    /// The planes between regions.
    top: Subtree,
    bounds: Aabb,
    /// One for each leaf of the top.
    parts: Vec<Part>,
    /// Where the kept parts are: the last tree, and each region's nodes there.
    last: Option<(&'t TrackedTree, Vec<Range<usize>>)>,
    /// Triangles that have moved since a tree was built as a whole.
    moved: usize,
    /// Time spent on building regions.
    building: Duration,
}

/// What becomes of a region.
enum Part {
    /// It stays as it was in the last tree.
    Kept,
    Built(Subtree, Regions),
}

/// What has changed since the last frame.
enum Change<'t> {
    Nothing(&'t TrackedTree),
    Regions(Plan<'t>),
}

/// A region to be built.
struct Task {
    /// Its leaf of the top.
    leaf: usize,
    cell: Aabb,
    depth: u32,
    /// Whether it was built with large leaves in the last frame.
    late: bool,
}

impl<'m> Frame<'_, 'm> {
    /// Everything anew.
    fn build_all<'t>(&self) -> Plan<'t> {
        let top = top_tree(&self.triangles, self.limits, self.options);
        let members = distribute(&self.triangles, &top);
        let bounds = members.bounds();
        let tasks = tasks(&top, bounds);
        let started = Instant::now();
        let gather = |leaf, gathered: &mut Vec<_>| members.gather(leaf, gathered);
        let built = self.build_regions(tasks, gather, members.total());
        let building = started.elapsed();
        Plan {
            top,
            bounds,
            parts: built.into_iter().map(|(_, part)| part).collect(),
            last: None,
            moved: 0,
            building,
        }
    }

    /// The last tree once more.
    fn same(&self, last: &TrackedTree) -> TrackedUpdate<'m> {
        TrackedUpdate {
            tree: KdTree::from_storage(
                self.mesh,
                last.bounds,
                Arc::clone(&last.storage),
                self.options.cost,
                0,
            ),
            tracked: Some(last.clone()),
            kept: Amount {
                nodes: last.storage.nodes.len(),
                references: last.storage.references.len(),
            },
            rebuilt: Amount::default(),
            coarse: Amount::default(),
            building: Duration::ZERO,
            sah_cost: last.sah_cost,
            sah_ratio: last.sah_ratio(),
        }
    }

    /// Only what has changed; `None` if all had better be built anew.
    fn change<'t>(
        &self,
        last: &'t TrackedTree,
        moved: &Moved<'_>,
        hashes: &MeshHashes,
    ) -> Option<Change<'t>> {
        let count = self.triangles.len();
        // What is new, or gone, counts as having moved.
        let common = count.min(last.triangles);
        let mut may_have_moved = vec![false; count.max(last.triangles)];
        may_have_moved[common..].fill(true);
        match moved {
            Moved::Only(ranges) => {
                for range in *ranges {
                    let end = range.end.min(common);
                    may_have_moved[range.start.min(end)..end].fill(true);
                }
            }
            Moved::Unknown => {
                let changes = hashes.changes_since(&last.hashes);
                let coarse = last.regions.iter().any(|region| region.coarse);
                if changes.is_empty() && count == last.triangles && !coarse {
                    return Some(Change::Nothing(last));
                }
                if changes.share_of_vertices() > MOST_OF_THE_VERTICES {
                    return None;
                }
                changes.mark(self.mesh, &mut may_have_moved[..common]);
            }
        }
        let (top, places) = last.top();
        let residents = |leaf: usize| last.triangles_of(places[leaf].clone());
        let touched: Vec<bool> = (0..places.len())
            .into_par_iter()
            .map(|leaf| (residents(leaf).iter()).any(|&triangle| may_have_moved[triangle as usize]))
            .collect();
        let present = 0..count as u32;
        let movers: Vec<u32> = present.filter(|&t| may_have_moved[t as usize]).collect();
        let moved = last.moved + movers.len();
        let drifted = moved > count / 2 && last.sah_cost > LARGEST_DRIFT * last.full_sah_cost;
        let too_many = movers.len() as f64 > LARGEST_CHANGE * count as f64;
        if drifted || too_many || moved > LONGEST * count {
            return None;
        }
        let arrived = distribute(&Triangles::these(self.mesh, movers), &top);
        let bounds = last.bounds.union(&arrived.bounds());
        if bounds.half_area() > LARGEST_GROWTH * last.bounds.half_area() {
            return None;
        }
        let changes: Vec<bool> = (0..places.len())
            .into_par_iter()
            .map_init(Vec::new, |arrivals, leaf| {
                let mut arrives = || {
                    arrivals.clear();
                    arrived.gather(leaf, arrivals);
                    let mut residents = residents(leaf).to_vec();
                    residents.sort_unstable();
                    (arrivals.iter()).any(|new| residents.binary_search(&new.triangle).is_err())
                };
                last.regions[leaf].coarse || touched[leaf] || arrived.any(leaf) && arrives()
            })
            .collect();
        if !changes.contains(&true) && bounds == last.bounds && count == last.triangles {
            return Some(Change::Nothing(last));
        }
        let mut tasks = tasks(&top, bounds);
        tasks.retain(|task| changes[task.leaf]);
        for task in &mut tasks {
            task.late = last.regions[task.leaf].coarse;
        }
        let cells = leaf_cells(&top, bounds);
        let gather =
            |leaf: usize, gathered: &mut Vec<_>| {
                let stays = |triangle: &u32| !may_have_moved[*triangle as usize];
                let mut staying: Vec<u32> = residents(leaf).iter().copied().filter(stays).collect();
                // A triangle is in several leaves of a region.
                staying.sort_unstable();
                staying.dedup();
                gathered.extend(staying.iter().map(|&triangle| {
                    Reference::of_triangle(self.mesh.corners(triangle), triangle)
                }));
                cut_to_cell(self.mesh, gathered, &cells[leaf].0);
                arrived.gather(leaf, gathered);
            };
        let started = Instant::now();
        let built = self.build_regions(tasks, gather, last.storage.references.len());
        let building = started.elapsed();
        let mut parts: Vec<Part> = places.iter().map(|_| Part::Kept).collect();
        for (leaf, part) in built {
            parts[leaf] = part;
        }
        Some(Change::Regions(Plan {
            top,
            bounds,
            parts,
            last: Some((last, places)),
            moved,
            building,
        }))
    }

    /// Builds regions, in the order of their leaves. With a budget, the ones that were not
    /// built as well as they should in the last frame come first, and then the ones that rays
    /// meet the most of.
    fn build_regions(
        &self,
        mut tasks: Vec<Task>,
        gather: impl Fn(usize, &mut Vec<Reference>) + Sync,
        total: usize,
    ) -> Vec<(usize, Part)> {
        let build = |task: &Task, coarse: bool, (references, memory): &mut (Vec<_>, _)| {
            references.clear();
            gather(task.leaf, references);
            let least = if coarse { COARSE_LEAF } else { 0 };
            let binning = Binning {
                mesh: self.mesh,
                weight: 1,
                min_split: self.options.min_split.max(least) as usize,
                options: self.options,
            };
            let triangles = self.triangles.len().min(total);
            let limits = self.limits.below(task.depth, triangles, total);
            let subtree = binning.build(references, task.cell, limits);
            let cost = &self.options.cost;
            let regions = divide(self.mesh, &subtree, task.cell, cost, coarse, memory);
            (task.leaf, Part::Built(subtree, regions))
        };
        let Some(duration) = self.budget.duration else {
            return tasks
                .par_iter()
                .map_init(Default::default, |memory, task| build(task, false, memory))
                .collect();
        };
        tasks.sort_by(|a, b| {
            let area = |task: &Task| task.cell.half_area();
            b.late.cmp(&a.late).then(area(b).total_cmp(&area(a)))
        });
        let started = Instant::now();
        let mut built = Vec::with_capacity(tasks.len());
        for batch in tasks.chunks(REGIONS_A_LOOK * rayon::current_num_threads()) {
            let each = started.elapsed().div_f64(built.len().max(1) as f64);
            let rest = each.mul_f64((tasks.len() - built.len()) as f64 * COARSE_TIME);
            let coarse = self.budget.started.elapsed() + rest > duration;
            let batch = batch
                .par_iter()
                .map_init(Default::default, |memory, task| build(task, coarse, memory));
            built.par_extend(batch);
        }
        built.sort_unstable_by_key(|(leaf, _)| *leaf);
        built
    }

    /// Puts the tree together.
    fn assemble(
        &self,
        plan: Plan<'_>,
        hashes: MeshHashes,
    ) -> Result<TrackedUpdate<'m>, BuildError> {
        let Plan {
            top,
            bounds,
            parts,
            last,
            moved,
            building,
        } = plan;
        let cost_model = self.options.cost;
        let size = |(leaf, part): (usize, &Part)| match (part, &last) {
            (Part::Built(subtree, _), _) => (subtree.nodes().len(), subtree.reference_count()),
            (Part::Kept, Some((last, places))) => {
                let nodes = places[leaf].clone();
                (nodes.len(), last.references_of(nodes).len())
            }
            (Part::Kept, None) => (0, 0),
        };
        let (nodes, references) = (parts.iter().enumerate().map(size))
            .fold((top.nodes().len(), 0), |(a, b), (c, d)| (a + c, b + d));
        let mut writer = NodeWriter::with_capacity(nodes, references);
        let mut regions = Vec::with_capacity(parts.len());
        let mut leaves = Vec::with_capacity(parts.len());
        let (mut kept, mut rebuilt, mut coarse) = <(Amount, Amount, Amount)>::default();
        let planes = if last.is_some() {
            &mut kept
        } else {
            &mut rebuilt
        };
        planes.nodes += top.nodes().len() / 2;
        let mut cost = top.planes_cost(bounds, &cost_model);
        let mut right_children = Vec::new();
        let mut cells = leaf_cells(&top, bounds).into_iter();
        let mut parts = parts.into_iter().enumerate();
        for node in top.nodes() {
            if let NodeKind::Inner { axis, position, .. } = node.kind() {
                right_children.push(writer.open_inner(axis, position));
                continue;
            }
            let both = parts.next().zip(cells.next());
            let ((leaf, part), (cell, _)) = both.expect("one for each leaf of the top");
            let root = writer.len();
            let (own, amount) = match (part, &last) {
                (Part::Built(subtree, own), _) => {
                    writer.append(&subtree);
                    let coarsely = own.regions.first().is_some_and(|region| region.coarse);
                    (own, if coarsely { &mut coarse } else { &mut rebuilt })
                }
                (Part::Kept, Some((last, places))) => {
                    let nodes = places[leaf].clone();
                    let references = last.references_of(nodes.clone());
                    let storage = &last.storage;
                    writer.append_part(&storage.nodes, nodes, &storage.references, references);
                    leaves.push(storage.wide.group(leaf));
                    let mut region = Region {
                        root: 0,
                        ..last.regions[leaf]
                    };
                    if bounds != last.bounds {
                        region.cost = writer.expected_cost(root.0, cell, &cost_model);
                    }
                    let own = Regions {
                        regions: vec![region],
                        leaves: Vec::new(),
                        planes_cost: 0.0,
                    };
                    (own, &mut kept)
                }
                (Part::Kept, None) => unreachable!("nothing is kept without a last tree"),
            };
            let end = writer.len();
            amount.nodes += end.0 - root.0;
            amount.references += end.1 - root.1;
            cost += own.planes_cost;
            leaves.extend(own.leaves);
            for region in own.regions {
                cost += region.cost;
                regions.push(Region {
                    root: root.0 as u32 + region.root,
                    ..region
                });
            }
            if let Some(inner) = right_children.pop() {
                writer.begin_right(inner);
            }
        }
        regions.shrink_to_fit();
        let skipped = self.triangles.skipped();
        let subtree = writer.finish();
        subtree.check_size()?;
        let wide = WideTree::assemble(subtree.nodes(), leaves);
        let storage = Arc::new(subtree.into_storage(wide));
        let shared = Arc::clone(&storage);
        let tree = KdTree::from_storage(self.mesh, bounds, shared, cost_model, skipped);
        let area = f64::from(bounds.half_area());
        let sah_cost = if area > 0.0 { cost / area } else { 0.0 };
        let full_sah_cost = last.map_or(sah_cost, |(last, _)| last.full_sah_cost);
        let tracked = TrackedTree {
            storage,
            bounds,
            triangles: self.triangles.len(),
            hashes,
            regions,
            sah_cost,
            full_sah_cost,
            moved,
        };
        Ok(TrackedUpdate {
            tree,
            sah_ratio: tracked.sah_ratio(),
            tracked: (skipped == 0).then_some(tracked),
            kept,
            rebuilt,
            coarse,
            building,
            sah_cost,
        })
    }
}

/// A task for each leaf of a tree, in order.
fn tasks(top: &Subtree, bounds: Aabb) -> Vec<Task> {
    let task = |(leaf, (cell, depth))| Task {
        leaf,
        cell,
        depth,
        late: false,
    };
    leaf_cells(top, bounds)
        .into_iter()
        .enumerate()
        .map(task)
        .collect()
}
