//! Front-to-back descent of one ray, which every single-ray query shares: eight boxes at a time,
//! the nearest first (Wald, Benthin & Boulos 2008; Afra 2013).
//!
//! No hit depends on where boxes lie: a hit at `t` is a point `q` of the
//! triangle, `q` lies in the box of some block that holds the triangle, and the ray's
//! point at `t` is no farther from `q` than the errors of the triangle test.
//! Descent widens every box by at least as much on every axis, so that
//! it never drops the block of `q` while `t` is in range.

use std::ops::{ControlFlow, RangeInclusive};

use fearless_simd::f32x8;
use fearless_simd::prelude::*;

use super::intervals::Intervals;
use super::lanes::splat;
use crate::aabb::{lower, upper};
use crate::prefetch::prefetch;
use crate::wide::{Block, LANES, WideNode, WideTree};
use crate::{Aabb, Ray};

/// Widening of all boxes, relative to the reach, the distance
/// from the ray's origin to the farthest point of the tree. In units of 2⁻²⁴
/// of the reach, a hit's `t` is off by 1 at most, the distance to a plane by 5 and
/// [`SLOWEST`] adds less than 1; this is 16.
const SLACK: f32 = 1.0 / (1 << 20) as f32;

/// Components of the direction count as no smaller than this share of the
/// largest. Keeps distances to planes finite for rays parallel to an axis, and
/// moves no point of the ray inside the tree by more than a fraction of the
/// slack.
pub(super) const SLOWEST: f32 = 1.0 / (1 << 30) as f32;

/// Directions whose largest component is in this range have distances to planes without overflow or
/// underflow worth mentioning.
pub(super) const ORDINARY: RangeInclusive<f32> = 1.0 / (1u64 << 40) as f32..=(1u64 << 40) as f32;

/// Coordinates up to this, over the slowest component of an ordinary direction, do not overflow.
pub(super) const FARTHEST: f32 = 1e17;

/// What further roundings do, for each unit of the largest coordinate of origins and planes: a plane
/// at `x` is passed at `x / d - o / d`, where the quotients are rounded before
/// they are subtracted. Four units of 2⁻²⁴.
const ROUNDING_OF_PLACES: f32 = 1.0 / (1 << 22) as f32;

/// More than underflow does to distances, in lengths of ordinary directions.
const UNDERFLOW: f32 = 1e-31;

/// By how much boxes are widened on each axis for rays whose reach of the tree is no more than this
/// ([`Aabb::reach`]).
#[inline(always)]
pub(super) fn slack(bounds: &Aabb, reach: f32) -> f32 {
    reach * SLACK + (reach + bounds.reach([0.0; 3])) * ROUNDING_OF_PLACES + UNDERFLOW
}

/// Nodes that wait on the stack itself; more are rare. Fewer are cleared sooner.
const STACK: usize = 32;

/// What a ray met on its way.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct TraversalCounts {
    /// Nodes visited, each with up to eight boxes.
    pub nodes: u32,
    /// Blocks of eight triangles tested.
    pub blocks: u32,
}

/// What a query does with the blocks that a ray meets.
pub(super) trait BlockVisitor {
    /// Whether any hit will do, so that it does not matter what is visited first.
    const ANY: bool;

    /// Tests the triangles of the block of an index. `Break` ends the descent.
    fn visit(&mut self, index: usize, block: &Block) -> ControlFlow<()>;

    /// Boxes that begin beyond this distance are of no interest any more.
    fn t_max(&self) -> f32;
}

/// Visits all blocks below `root` whose boxes the ray may meet up to the visitor's `t_max`.
#[inline(always)]
pub(super) fn descend<S: Simd, V: BlockVisitor>(
    simd: S,
    wide: &WideTree,
    slabs: &Slabs,
    root: u32,
    visitor: &mut V,
) -> TraversalCounts {
    let mut counts = TraversalCounts::default();
    let lanes = slabs.lanes(simd);
    let nodes = wide.nodes();
    let mut stack: Stack<()> = Stack::new();
    let mut index = root;
    loop {
        let node = &nodes[index as usize];
        counts.nodes += 1;
        let (near, mut met) = lanes.meet(simd, &node.bounds, slabs.t_max(visitor.t_max()));
        if node.is_leaf() {
            let mut later = met & met.wrapping_sub(1);
            while later != 0 {
                prefetch(wide.block(node.blocks(later.trailing_zeros() as usize).start));
                later &= later - 1;
            }
            while met != 0 {
                let lane = met.trailing_zeros() as usize % LANES;
                met &= met - 1;
                if near[lane] > slabs.t_max(visitor.t_max()) {
                    continue;
                }
                for block in node.blocks(lane) {
                    counts.blocks += 1;
                    if visitor.visit(block, wide.block(block)).is_break() {
                        return counts;
                    }
                }
            }
        } else if met != 0 {
            let lane = met.trailing_zeros() as usize % LANES;
            met &= met - 1;
            if met == 0 {
                index = node.child(lane);
                continue;
            }
            let mut all = met;
            while all != 0 {
                prefetch(&nodes[node.child(all.trailing_zeros() as usize) as usize]);
                all &= all - 1;
            }
            if V::ANY {
                index = stack.push_but_one(node, lane, met);
            } else {
                (index, ()) = stack.push_but_nearest(node, &near, lane, met, |_| ());
            }
            continue;
        }
        loop {
            let Some((waiting, near, ())) = stack.pop() else {
                return counts;
            };
            if near <= slabs.t_max(visitor.t_max()) {
                index = waiting;
                break;
            }
        }
    }
}

/// Nodes that wait, where they are met, and a note on each.
pub(super) struct Stack<N> {
    nodes: [u32; STACK],
    nears: [f32; STACK],
    notes: [N; STACK],
    count: usize,
    /// What there was no room for.
    more: Vec<(u32, f32, N)>,
}

impl<N: Copy + Default> Stack<N> {
    #[inline(always)]
    pub(super) fn new() -> Self {
        Self {
            nodes: [0; STACK],
            nears: [0.0; STACK],
            notes: [N::default(); STACK],
            count: 0,
            more: Vec::new(),
        }
    }

    /// Lets the children in `lane` and in the lanes of `met` wait, nearest last, but for the
    /// nearest.
    #[inline(always)]
    pub(super) fn push_but_nearest(
        &mut self,
        node: &WideNode,
        near: &[f32; LANES],
        lane: usize,
        mut met: u32,
        note: impl Fn(usize) -> N,
    ) -> (u32, N) {
        let (mut nearest, mut distance, mut first_note) =
            (node.child(lane), near[lane], note(lane));
        let first = self.count;
        while met != 0 {
            let lane = met.trailing_zeros() as usize % LANES;
            met &= met - 1;
            let (mut child, mut t, mut own) = (node.child(lane), near[lane], note(lane));
            if t < distance {
                (own, first_note) = (first_note, own);
                (child, nearest) = (nearest, child);
                (t, distance) = (distance, t);
            }
            if self.count == STACK {
                // Their order costs time at most.
                self.more.push((child, t, own));
                continue;
            }
            let mut place = self.count;
            while place > first && self.nears[place - 1] < t {
                self.nears[place] = self.nears[place - 1];
                self.nodes[place] = self.nodes[place - 1];
                self.notes[place] = self.notes[place - 1];
                place -= 1;
            }
            self.nears[place] = t;
            self.nodes[place] = child;
            self.notes[place] = own;
            self.count += 1;
        }
        (nearest, first_note)
    }

    /// Lets the children in the lanes of `met` wait, in no order, but for the one in `lane`.
    #[inline(always)]
    fn push_but_one(&mut self, node: &WideNode, lane: usize, mut met: u32) -> u32 {
        while met != 0 {
            let lane = met.trailing_zeros() as usize % LANES;
            met &= met - 1;
            if self.count == STACK {
                self.more
                    .push((node.child(lane), f32::NEG_INFINITY, N::default()));
                continue;
            }
            self.nears[self.count] = f32::NEG_INFINITY;
            self.nodes[self.count] = node.child(lane);
            self.count += 1;
        }
        node.child(lane)
    }

    #[inline(always)]
    pub(super) fn pop(&mut self) -> Option<(u32, f32, N)> {
        if !self.more.is_empty() {
            return self.more.pop();
        }
        self.count = self.count.checked_sub(1)?;
        let top = self.count % STACK;
        Some((self.nodes[top], self.nears[top], self.notes[top]))
    }
}

/// Distances along one ray to axis-aligned planes, with their slack: a plane at `x` is passed at
/// `x · scale - enter` or `x · scale - leave`.
#[derive(Clone, Copy, Debug)]
pub(super) struct Slabs {
    scale: [f32; 3],
    enter: [f32; 3],
    leave: [f32; 3],
    t_min: f32,
    /// Infinite if the ray's range is not looked at, otherwise below all.
    least_t_max: f32,
}

/// Scale and offsets of an axis on which no plane is ever in a ray's way.
const OPEN: (f32, [f32; 2]) = (1.0, [f32::MAX, f32::MIN]);

impl Slabs {
    /// Those of a ray among boxes within `bounds`.
    #[inline(always)]
    pub(super) fn new(ray: &Ray, bounds: &Aabb) -> Self {
        let [x, y, z] = ray.direction;
        let fastest = upper(upper(x.abs(), y.abs()), z.abs());
        let ordinary = ORDINARY.contains(&fastest);
        // Distances to planes are those of another length then.
        let length = if ordinary { 1.0 } else { fastest };
        let slowest = fastest / length * SLOWEST;
        let slack = slack(bounds, bounds.reach(ray.origin));
        let mut slabs = Self {
            scale: [0.0; 3],
            enter: [0.0; 3],
            leave: [0.0; 3],
            t_min: if ordinary {
                ray.t_min
            } else {
                f32::NEG_INFINITY
            },
            least_t_max: if ordinary {
                f32::NEG_INFINITY
            } else {
                f32::INFINITY
            },
        };
        for axis in 0..3 {
            let along = match ordinary {
                true => ray.direction[axis],
                false => ray.direction[axis] / length,
            };
            let scale = upper(along.abs(), slowest).copysign(along).recip();
            let (offset, slack) = (ray.origin[axis] * scale, slack * scale.abs());
            let offsets = [offset + slack, offset - slack];
            let (scale, [enter, leave]) = finite_or_open(scale, offsets);
            (slabs.scale[axis], slabs.enter[axis], slabs.leave[axis]) = (scale, enter, leave);
        }
        slabs
    }

    /// The highest distance to planes that is of interest, given that of hits.
    #[inline(always)]
    fn t_max(&self, t_max: f32) -> f32 {
        upper(t_max, self.least_t_max)
    }

    /// Whether any of the ray up to `t_max` may be inside a box.
    #[inline(always)]
    pub(super) fn may_meet(&self, bounds: &Aabb, t_max: f32) -> bool {
        let (mut enter, mut leave) = (self.t_min, self.t_max(t_max));
        for axis in 0..3 {
            let (mut near, mut far) = (bounds.min[axis], bounds.max[axis]);
            if self.scale[axis] < 0.0 {
                (near, far) = (far, near);
            }
            // Both drop NaN.
            enter = upper(enter, near * self.scale[axis] - self.enter[axis]);
            leave = lower(leave, far * self.scale[axis] - self.leave[axis]);
        }
        enter <= leave
    }

    /// The same in every lane.
    #[inline(always)]
    fn lanes<S: Simd>(&self, simd: S) -> SlabLanes<S> {
        let scale = splat(simd, self.scale);
        let row = |axis: usize| 2 * axis + usize::from(self.scale[axis] < 0.0);
        SlabLanes {
            enter_scale: scale,
            enter: splat(simd, self.enter),
            leave_scale: scale,
            leave: splat(simd, self.leave),
            enter_rows: [row(0), row(1), row(2)],
            also_enter: None,
            t_min: f32x8::splat(simd, self.t_min),
        }
    }
}

/// Scale and offsets, unless these overflow.
#[inline(always)]
fn finite_or_open(scale: f32, offsets: [f32; 2]) -> (f32, [f32; 2]) {
    if offsets[0].is_finite() & offsets[1].is_finite() {
        (scale, offsets)
    } else {
        OPEN
    }
}

/// Where one ray, or a bundle of them, meets boxes: it enters one where
/// it has passed all of three planes, and leaves it at the first of three others. In every lane
/// the same.
#[derive(Clone, Copy)]
pub(super) struct SlabLanes<S: Simd> {
    /// A plane at `x` is passed at `x · scale - offset`.
    enter_scale: [f32x8<S>; 3],
    enter: [f32x8<S>; 3],
    leave_scale: [f32x8<S>; 3],
    leave: [f32x8<S>; 3],
    /// Which rows of bounds are entered by; the others are left by.
    enter_rows: [usize; 3],
    /// For a bundle that is parallel to planes: the row of those on the other side, by which
    /// boxes are entered, too, and their scale and offset.
    also_enter: Option<(usize, f32x8<S>, f32x8<S>)>,
    t_min: f32x8<S>,
}

impl<S: Simd> SlabLanes<S> {
    /// Of a ray that goes nowhere.
    #[inline(always)]
    pub(super) fn nowhere(simd: S) -> Self {
        let zero = f32x8::splat(simd, 0.0);
        Self {
            enter_scale: [zero; 3],
            enter: [zero; 3],
            leave_scale: [zero; 3],
            leave: [zero; 3],
            enter_rows: [0, 2, 4],
            also_enter: None,
            t_min: zero,
        }
    }

    /// Of all rays in these intervals, which are [narrow](Intervals::are_narrow): where the first may enter and the
    /// last may leave. `bounds` are the tree's.
    #[inline(always)]
    pub(super) fn of_intervals(simd: S, intervals: &Intervals, bounds: &Aabb) -> Self {
        let Intervals {
            origins,
            directions,
            t_min,
        } = intervals;
        let slack = intervals.slack(bounds);
        let splat = |x: f32| f32x8::splat(simd, x);
        let fastest = |axis: usize| upper(directions.min[axis].abs(), directions.max[axis].abs());
        let slowest = SLOWEST * upper(upper(fastest(0), fastest(1)), fastest(2));
        let mut slabs = Self::nowhere(simd);
        slabs.t_min = splat(*t_min);
        for axis in 0..3 {
            // Whoever starts nearest to a plane and is fastest gets there first.
            let (low, high) = (directions.min[axis], directions.max[axis]);
            let below = origins.min[axis] - slack;
            let above = origins.max[axis] + slack;
            let (forwards, backwards) = (low > 0.0, high < 0.0);
            // The scales by which planes are entered and left, and where from.
            let (first, last, [from, to]) = if backwards {
                (
                    -upper(-low, slowest).recip(),
                    -upper(-high, slowest).recip(),
                    [below, above],
                )
            } else {
                (
                    upper(high, slowest).recip(),
                    upper(low, slowest).recip(),
                    [above, below],
                )
            };
            let (enter, leave) = (from * first, to * last);
            if !(enter.is_finite() & leave.is_finite()) {
                let (scale, [enter, leave]) = OPEN;
                (slabs.enter_scale[axis], slabs.leave_scale[axis]) = (splat(scale), splat(scale));
                (slabs.enter[axis], slabs.leave[axis]) = (splat(enter), splat(leave));
                continue;
            }
            slabs.enter_rows[axis] = 2 * axis + usize::from(backwards);
            (slabs.enter_scale[axis], slabs.enter[axis]) = (splat(first), splat(enter));
            if forwards | backwards {
                (slabs.leave_scale[axis], slabs.leave[axis]) = (splat(last), splat(leave));
            } else {
                let (scale, [_, open]) = OPEN;
                (slabs.leave_scale[axis], slabs.leave[axis]) = (splat(scale), splat(open));
                let scale = -upper(-low, slowest).recip();
                slabs.also_enter = Some((2 * axis + 1, splat(scale), splat(below * scale)));
            }
        }
        slabs
    }

    /// Where boxes are entered, and the set of those that may be met before `t_max`.
    #[inline(always)]
    pub(super) fn meet(
        &self,
        simd: S,
        bounds: &[[f32; LANES]; 6],
        t_max: f32,
    ) -> ([f32; LANES], u32) {
        let row = |row: usize| f32x8::simd_from(simd, bounds[row % 6]);
        let [x, y, z] = self.enter_rows;
        let enter_x = row(x).mul_sub(self.enter_scale[0], self.enter[0]);
        let enter_y = row(y).mul_sub(self.enter_scale[1], self.enter[1]);
        let enter_z = row(z).mul_sub(self.enter_scale[2], self.enter[2]);
        let leave_x = row(x ^ 1).mul_sub(self.leave_scale[0], self.leave[0]);
        let leave_y = row(y ^ 1).mul_sub(self.leave_scale[1], self.leave[1]);
        let leave_z = row(z ^ 1).mul_sub(self.leave_scale[2], self.leave[2]);
        let mut enter = enter_x.max(enter_y).max(enter_z.max(self.t_min));
        if let Some((other, scale, offset)) = self.also_enter {
            enter = enter.max(row(other).mul_sub(scale, offset));
        }
        let leave = leave_x
            .min(leave_y)
            .min(leave_z.min(f32x8::splat(simd, t_max)));
        let met = enter.simd_le(leave);
        (enter.into(), met.to_bitmask() as u32)
    }
}
