//! Exact SAH in O(N log N): a plane sweep over sorted events, with triangles
//! clipped to cells (Wald & Havran 2006, "On building fast kd-trees for ray
//! tracing, and on doing that in O(N log N)"). The measure of every other
//! builder's trees.
//!
//! The cost of a plane changes only where a triangle's box begins or ends, so
//! the best plane of a node is found by one pass over these [`EdgeEvent`]s in
//! order. They are sorted once, at the root. A split keeps the order of
//! whatever lies on one side of the plane; only triangles that straddle it are
//! clipped to both children, and their new events sorted and merged in.
//!
//! Nodes are built depth first. The lists of all nodes still to be built lie on
//! stacks, the current node on top: a split replaces it by its right child and
//! pushes the left one, so memory grows with the number of straddlers only.

mod event;
#[cfg(test)]
mod tests;

use rayon::prelude::*;

use self::event::{EdgeEvent, EventKind, MAX_EVENT_REFERENCES};
use super::clip::clipped_bounds;
use super::limits::Limits;
use super::references::bounds_of;
use super::{BuildOptions, NodeWriter, Reference, Subtree, Triangles};
use crate::{Aabb, CostModel, Mesh};

/// Nodes of this many triangles or more are shared among threads: their axes,
/// and their children if both are as large. Depends on the node alone, so that
/// the tree is the same on any number of threads. A node of this size takes
/// some milliseconds with all below it, a thousand times what a join costs.
const PARALLEL_TRIANGLES: usize = 2048;

/// The child that triangles lying in the split plane go to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum PlanarSide {
    Left,
    Right,
}

/// A plane that a node might be split by.
#[derive(Clone, Copy, Debug, PartialEq)]
struct SplitCandidate {
    axis: usize,
    position: f32,
    planar_side: PlanarSide,
    cost: f32,
    /// The triangles of both children together.
    references: u32,
}

/// Builds a subtree over `triangles`; gives it with the box around them.
pub(super) fn build(
    triangles: &Triangles<'_>,
    limits: Limits,
    options: &BuildOptions,
) -> (Subtree, Aabb) {
    let references = triangles.references();
    let bounds = bounds_of(&references);
    let mut sweep = Sweep::new(triangles.mesh(), options);
    if references.len() > MAX_EVENT_REFERENCES {
        // More than a tree can hold as well: the one leaf is refused where trees are made.
        sweep.writer.leaf(references.iter().map(|r| r.triangle));
    } else {
        sweep.push_root(&references);
        drop(references);
        sweep.recurse(NodeStart::default(), bounds, limits);
    }
    (sweep.writer.finish(), bounds)
}

/// Where a node's lists begin on the stacks; they end where the next node's
/// begin.
#[derive(Clone, Copy, Debug, Default)]
struct NodeStart {
    triangles: usize,
    events: [usize; 3],
}

/// Where a reference of a split node goes: its side of the plane and, unless it
/// goes to both, its index in that child.
#[derive(Clone, Copy, Debug)]
struct Placement {
    side: Side,
    index: u32,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Side {
    Left = 0,
    Right = 1,
    Both = 2,
}

/// The events of pending nodes on one axis.
#[derive(Debug, Default)]
struct AxisEvents {
    stack: Vec<EdgeEvent>,
    /// The children of the node being split, left and right.
    children: [ChildEvents; 2],
}

/// A child's events before they go on the stack. The lists live on between
/// splits for their memory.
#[derive(Debug, Default)]
struct ChildEvents {
    /// Events of references on this side only, in order.
    kept: Vec<EdgeEvent>,
    /// Events of references clipped to this side.
    clipped: Vec<EdgeEvent>,
}

/// A build in progress over one subtree.
struct Sweep<'a> {
    mesh: Mesh<'a>,
    options: &'a BuildOptions,
    writer: NodeWriter,
    /// The triangles of pending nodes; events name them by index from their node's start.
    triangles: Vec<u32>,
    axes: [AxisEvents; 3],
    /// Of the node being split.
    placements: Vec<Placement>,
    /// The triangles of its children, left and right.
    child_triangles: [Vec<u32>; 2],
}

impl<'a> Sweep<'a> {
    fn new(mesh: Mesh<'a>, options: &'a BuildOptions) -> Self {
        Self {
            mesh,
            options,
            writer: NodeWriter::default(),
            triangles: Vec::new(),
            axes: Default::default(),
            placements: Vec::new(),
            child_triangles: Default::default(),
        }
    }

    /// Pushes the root: the only time that all events are sorted.
    fn push_root(&mut self, references: &[Reference]) {
        self.triangles.extend(references.iter().map(|r| r.triangle));
        let axes = self.axes.each_mut();
        map_axes(references.len(), axes, |axis, AxisEvents { stack, .. }| {
            stack.reserve(2 * references.len());
            for (index, reference) in (0..).zip(references) {
                stack.extend(EdgeEvent::of_box(&reference.bounds(), axis, index));
            }
            stack.par_sort_unstable();
        });
    }

    /// Builds the node on top of the stacks and removes it.
    fn recurse(&mut self, start: NodeStart, cell: Aabb, limits: Limits) {
        let count = self.triangles.len() - start.triangles;
        let leaf_cost = self.options.cost.leaf(count as u32);
        let split = (count > self.options.min_split as usize)
            .then(|| self.find_split(start, &cell))
            .flatten()
            .filter(|split| {
                split.cost < leaf_cost && limits.allow(count, split.references as usize)
            });
        let Some(split) = split else {
            self.writer.leaf(self.triangles.drain(start.triangles..));
            for (AxisEvents { stack, .. }, start) in self.axes.iter_mut().zip(start.events) {
                stack.truncate(start);
            }
            return;
        };

        let [left_cell, right_cell] = split.cells(&cell);
        let left_start = self.split(start, &split, &[left_cell, right_cell]);
        let left_count = self.triangles.len() - left_start.triangles;
        let right_count = left_start.triangles - start.triangles;
        let limits = limits.below(1, count, left_count + right_count);
        let inner = self.writer.open_inner(split.axis, split.position);
        if left_count.min(right_count) < PARALLEL_TRIANGLES {
            self.recurse(left_start, left_cell, limits);
            self.writer.begin_right(inner);
            self.recurse(start, right_cell, limits);
        } else {
            let mut left = self.pop(left_start);
            let mut right = self.pop(start);
            rayon::join(
                || left.recurse(NodeStart::default(), left_cell, limits),
                || right.recurse(NodeStart::default(), right_cell, limits),
            );
            self.writer.append(&left.writer.finish());
            self.writer.begin_right(inner);
            self.writer.append(&right.writer.finish());
        }
    }

    /// The plane of least cost for the node on top of the stacks, the first of
    /// equals.
    fn find_split(&self, start: NodeStart, cell: &Aabb) -> Option<SplitCandidate> {
        let count = self.triangles.len() - start.triangles;
        map_axes(count, self.axes.each_ref(), |axis, events| {
            let events = &events.stack[start.events[axis]..];
            find_split_on_axis(axis, events, count as u32, cell, &self.options.cost)
        })
        .into_iter()
        .flatten()
        .reduce(|best, other| if other.cost < best.cost { other } else { best })
    }

    /// Replaces the node on top of the stacks by its right child, pushes the
    /// left one, and returns where that one starts.
    fn split(&mut self, start: NodeStart, split: &SplitCandidate, cells: &[Aabb; 2]) -> NodeStart {
        let count = self.triangles.len() - start.triangles;
        let events = &self.axes[split.axis].stack[start.events[split.axis]..];
        classify(events, count, split, &mut self.placements);
        self.place(start, cells);

        let [left, right] = &mut self.child_triangles;
        self.triangles.truncate(start.triangles);
        self.triangles.append(right);
        let left_triangles = self.triangles.len();
        self.triangles.append(left);
        let placements = &self.placements;
        let left_events = map_axes(count, self.axes.each_mut(), |axis, events| {
            events.split(start.events[axis], placements)
        });
        NodeStart {
            triangles: left_triangles,
            events: left_events,
        }
    }

    /// Gives every reference its index in the children, in the order that they
    /// have in the node, so that their events stay in order too. Straddlers are
    /// clipped to both cells.
    fn place(&mut self, start: NodeStart, cells: &[Aabb; 2]) {
        let triangles = &self.triangles[start.triangles..];
        for (placement, &triangle) in self.placements.iter_mut().zip(triangles) {
            if placement.side != Side::Both {
                let child = &mut self.child_triangles[placement.side as usize];
                placement.index = child.len() as u32;
                child.push(triangle);
                continue;
            }
            let corners = self.mesh.corners(triangle);
            for (side, (child, cell)) in self.child_triangles.iter_mut().zip(cells).enumerate() {
                let Some(bounds) = clipped_bounds(&corners, cell) else {
                    continue;
                };
                for (axis, events) in self.axes.iter_mut().enumerate() {
                    let events_of_box = EdgeEvent::of_box(&bounds, axis, child.len() as u32);
                    events.children[side].clipped.extend(events_of_box);
                }
                child.push(triangle);
            }
        }
    }

    /// Takes the node on top off the stacks, to be built on its own.
    fn pop(&mut self, start: NodeStart) -> Self {
        let mut popped = Self::new(self.mesh, self.options);
        popped.triangles = self.triangles.split_off(start.triangles);
        for axis in 0..3 {
            popped.axes[axis].stack = self.axes[axis].stack.split_off(start.events[axis]);
        }
        popped
    }
}

impl SplitCandidate {
    fn cells(&self, cell: &Aabb) -> [Aabb; 2] {
        cell.split(self.axis, self.position).into()
    }

    /// The side of a box that has `event`, as far as this event alone can say.
    fn side(&self, event: EdgeEvent) -> Side {
        let position = event.position();
        match event.kind() {
            EventKind::End if position <= self.position => Side::Left,
            EventKind::Start if position >= self.position => Side::Right,
            EventKind::Planar if position < self.position => Side::Left,
            EventKind::Planar if position > self.position => Side::Right,
            EventKind::Planar => match self.planar_side {
                PlanarSide::Left => Side::Left,
                PlanarSide::Right => Side::Right,
            },
            EventKind::End | EventKind::Start => Side::Both,
        }
    }
}

impl AxisEvents {
    /// Replaces the events from `start` by those of the right child, pushes
    /// those of the left one, and returns where they start.
    fn split(&mut self, start: usize, placements: &[Placement]) -> usize {
        let Self { stack, children } = self;
        let [left, right] = children;
        let count = stack.len() - start;
        for child in [&mut *left, &mut *right] {
            child.clipped.sort_unstable();
            if child.kept.len() < count {
                child.kept.resize(count, EdgeEvent::default());
            }
        }
        // Sides are as good as random on two of the axes: writing to both children and counting
        // on one costs less than a branch that is mispredicted every other time.
        let (mut left_count, mut right_count) = (0, 0);
        for &event in &stack[start..] {
            let Placement { side, index } = placements[event.reference()];
            let event = event.with_reference(index);
            left.kept[left_count] = event;
            left_count += usize::from(side == Side::Left);
            right.kept[right_count] = event;
            right_count += usize::from(side == Side::Right);
        }
        stack.truncate(start);
        merge(stack, &right.kept[..right_count], &right.clipped);
        right.clipped.clear();
        let left_start = stack.len();
        merge(stack, &left.kept[..left_count], &left.clipped);
        left.clipped.clear();
        left_start
    }
}

/// The plane of least cost across one axis, the first of equals; `None` if no
/// plane there divides the node.
fn find_split_on_axis(
    axis: usize,
    events: &[EdgeEvent],
    count: u32,
    cell: &Aabb,
    cost: &CostModel,
) -> Option<SplitCandidate> {
    let (min, max) = (cell.min[axis], cell.max[axis]);
    let shares = AreaShares::new(cell, axis)?;
    let mut best: Option<SplitCandidate> = None;
    let mut consider = |position: f32, planar_side, left_count: u32, right_count: u32| {
        let left = (shares.of_slab(min, position), left_count);
        let right = (shares.of_slab(position, max), right_count);
        let cost = cost.split(left, right);
        if best.is_none_or(|best| cost < best.cost) {
            best = Some(SplitCandidate {
                axis,
                position,
                planar_side,
                cost,
                references: left_count + right_count,
            });
        }
    };

    let (mut left, mut right) = (0, count);
    for group in events.chunk_by(|a, b| a.same_position(*b)) {
        let mut of_kind = [0; 3];
        for event in group {
            of_kind[event.kind() as usize] += 1;
        }
        let [ends, planar, starts] = of_kind;
        let position = group[0].position();
        right -= ends + planar;
        if position > min && position < max {
            consider(position, PlanarSide::Left, left + planar, right);
            if planar > 0 {
                consider(position, PlanarSide::Right, left, right + planar);
            }
        } else if planar > 0 {
            // A plane in the border of the cell cuts off a flat cell. That is worth a thought for
            // the triangles that fill it, and for nothing else: an empty one could be cut off again
            // and again.
            if position == min {
                consider(position, PlanarSide::Left, left + planar, right);
            } else {
                consider(position, PlanarSide::Right, left, right + planar);
            }
        }
        left += planar + starts;
    }
    best
}

/// The surface areas of slabs of a cell, as shares of the cell's. In double
/// precision, since squares of small lengths vanish in single precision.
struct AreaShares {
    /// Area of a slab without extent, over the cell's.
    flat: f64,
    /// What a unit of extent adds.
    per_length: f64,
}

impl AreaShares {
    /// `None` if the cell has no extent on `axis`, or no area.
    fn new(cell: &Aabb, axis: usize) -> Option<Self> {
        let extent = |k: usize| f64::from(cell.max[k % 3]) - f64::from(cell.min[k % 3]);
        let (length, u, v) = (extent(axis), extent(axis + 1), extent(axis + 2));
        let area = u * v + length * (u + v);
        (length > 0.0 && area > 0.0).then(|| Self {
            flat: u * v / area,
            per_length: (u + v) / area,
        })
    }

    /// The share of the slab between two planes.
    fn of_slab(&self, from: f32, to: f32) -> f32 {
        (self.flat + (f64::from(to) - f64::from(from)) * self.per_length) as f32
    }
}

/// Finds the side of every reference of a node from its events on the split's
/// axis. The indices are left open.
fn classify(
    events: &[EdgeEvent],
    count: usize,
    split: &SplitCandidate,
    placements: &mut Vec<Placement>,
) {
    placements.clear();
    placements.resize(
        count,
        Placement {
            side: Side::Both,
            index: 0,
        },
    );
    for &event in events {
        let side = split.side(event);
        if side != Side::Both {
            placements[event.reference()].side = side;
        }
    }
}

/// Appends two sorted lists as one, the second of which is usually far shorter.
fn merge(stack: &mut Vec<EdgeEvent>, mut long: &[EdgeEvent], short: &[EdgeEvent]) {
    stack.reserve(long.len() + short.len());
    for event in short {
        let before;
        (before, long) = long.split_at(long.partition_point(|other| other < event));
        stack.extend_from_slice(before);
        stack.push(*event);
    }
    stack.extend_from_slice(long);
}

/// Does the same on every axis, at once if the node of `count` triangles is
/// large.
fn map_axes<A: Send, R: Send>(
    count: usize,
    [x, y, z]: [A; 3],
    f: impl Fn(usize, A) -> R + Sync,
) -> [R; 3] {
    if count < PARALLEL_TRIANGLES {
        [f(0, x), f(1, y), f(2, z)]
    } else {
        let (x, (y, z)) = rayon::join(|| f(0, x), || rayon::join(|| f(1, y), || f(2, z)));
        [x, y, z]
    }
}
