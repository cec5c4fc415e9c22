//! Front-to-back descent of one ray, which every single-ray query shares: eight boxes at a time,
//! the nearest first (Wald, Benthin & Boulos 2008; Afra 2013).
//!
//! No hit depends on where boxes lie: a hit at `t` is a point `q` of the
//! triangle, `q` lies in the box of some block that holds the triangle, and the ray's
//! point at `t` is no farther from `q` than the errors of the triangle test.
//! Descent widens every box by at least as much on every axis, so that
//! it never drops the block of `q` while `t` is in range.

use std::ops::ControlFlow;

use fearless_simd::f32x8;
use fearless_simd::prelude::*;

use crate::aabb::upper;
use crate::wide::{Block, LANES, WideNode, WideTree};
use crate::{Aabb, Ray};

/// Widening of all boxes, relative to the reach, the distance
/// from the ray's origin to the farthest point of the tree. In units of 2⁻²⁴
/// of the reach, a hit's `t` is off by 1 at most, the distance to a plane by 5 and
/// [`SLOWEST`] adds less than 1; this is 16.
pub(super) const SLACK: f32 = 1.0 / (1 << 20) as f32;

/// Components of the direction count as no smaller than this share of the
/// largest. Keeps distances to planes finite for rays parallel to an axis, and
/// moves no point of the ray inside the tree by more than a fraction of the
/// slack.
pub(super) const SLOWEST: f32 = 1.0 / (1 << 30) as f32;

/// Directions whose largest component is at least this have distances to all planes.
pub(super) const SHORTEST: f32 = 1e-28;

/// Nodes that wait on the stack itself; more are rare.
const STACK: usize = 64;

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
    /// Tests the triangles of a block. `Break` ends the descent.
    fn visit(&mut self, block: &Block) -> ControlFlow<()>;

    /// Boxes that begin beyond this distance are of no interest any more.
    fn t_max(&self) -> f32;
}

/// Visits all blocks whose boxes the ray may meet between `t_min` and the visitor's `t_max`.
#[inline(always)]
pub(super) fn descend<S: Simd>(
    simd: S,
    wide: &WideTree,
    slabs: &Slabs,
    t_min: f32,
    visitor: &mut impl BlockVisitor,
) -> TraversalCounts {
    let mut counts = TraversalCounts::default();
    let slabs = slabs.lanes(simd, t_min);
    let nodes = wide.nodes();
    let mut stack: Stack<()> = Stack::new();
    let mut index = wide.root();
    loop {
        let node = &nodes[index as usize];
        counts.nodes += 1;
        let (near, mut met) = slabs.meet(simd, &node.bounds, visitor.t_max());
        if node.is_leaf() {
            while met != 0 {
                let lane = met.trailing_zeros() as usize % LANES;
                met &= met - 1;
                if near[lane] > visitor.t_max() {
                    continue;
                }
                for block in node.blocks(lane) {
                    counts.blocks += 1;
                    if visitor.visit(wide.block(block)).is_break() {
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
            (index, ()) = stack.push_but_nearest(node, &near, lane, met, |_| ());
            continue;
        }
        loop {
            let Some((waiting, near, ())) = stack.pop() else {
                return counts;
            };
            if near <= visitor.t_max() {
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

/// Distances along one ray to axis-aligned planes, with their slack.
#[derive(Clone, Copy, Debug)]
pub(super) struct Slabs {
    inverse: [f32; 3],
    /// The origin, moved away from the planes where the ray enters boxes, and from those where
    /// it leaves them.
    enter_from: [f32; 3],
    leave_from: [f32; 3],
}

impl Slabs {
    /// `reach` is the tree's from the ray's origin ([`Aabb::reach`]).
    #[inline(always)]
    pub(super) fn new(ray: &Ray, reach: f32) -> Self {
        let [x, y, z] = ray.direction;
        let fastest = upper(upper(x.abs(), y.abs()), z.abs());
        let slowest = fastest * SLOWEST;
        let slack = reach * SLACK;
        let mut slabs = Self {
            inverse: [0.0; 3],
            enter_from: [0.0; 3],
            leave_from: [0.0; 3],
        };
        for axis in 0..3 {
            let (origin, along) = (ray.origin[axis], ray.direction[axis]);
            slabs.inverse[axis] = upper(along.abs(), slowest).copysign(along).recip();
            if !slabs.inverse[axis].is_finite() {
                // A ray too short to tell distances by: no plane is ever in its way.
                slabs.inverse[axis] = 1.0;
                (slabs.enter_from[axis], slabs.leave_from[axis]) = (f32::MAX, f32::MIN);
                continue;
            }
            // At least the slack, even where the origin is far from 0.
            let (below, above) = ((origin - slack).next_down(), (origin + slack).next_up());
            (slabs.enter_from[axis], slabs.leave_from[axis]) = if slabs.inverse[axis] < 0.0 {
                (below, above)
            } else {
                (above, below)
            };
        }
        slabs
    }

    /// The part of a range that is inside a box; `None` if there is none.
    #[inline(always)]
    pub(super) fn clip(&self, bounds: &Aabb, t_min: f32, t_max: f32) -> Option<(f32, f32)> {
        let (mut enter, mut leave) = (t_min, t_max);
        for axis in 0..3 {
            let (mut near, mut far) = (bounds.min[axis], bounds.max[axis]);
            if self.inverse[axis] < 0.0 {
                (near, far) = (far, near);
            }
            // Both drop NaN.
            enter = upper(enter, (near - self.enter_from[axis]) * self.inverse[axis]);
            leave = crate::aabb::lower(leave, (far - self.leave_from[axis]) * self.inverse[axis]);
        }
        (enter <= leave).then_some((enter, leave))
    }

    /// The same in every lane.
    #[inline(always)]
    fn lanes<S: Simd>(&self, simd: S, t_min: f32) -> SlabLanes<S> {
        let splat = |[x, y, z]: [f32; 3]| {
            [
                f32x8::splat(simd, x),
                f32x8::splat(simd, y),
                f32x8::splat(simd, z),
            ]
        };
        let row = |axis: usize| 2 * axis + usize::from(self.inverse[axis] < 0.0);
        SlabLanes {
            enter_from: splat(self.enter_from),
            enter_scale: splat(self.inverse),
            leave_from: splat(self.leave_from),
            leave_scale: splat(self.inverse),
            enter_rows: [row(0), row(1), row(2)],
            also_enter: None,
            t_min: f32x8::splat(simd, t_min),
        }
    }
}

/// Where one ray, or a bundle of them, meets boxes: it enters one where
/// it has passed all of three planes, and leaves it at the first of three others. In every lane
/// the same.
#[derive(Clone, Copy)]
pub(super) struct SlabLanes<S: Simd> {
    /// A plane at `x` is passed at `(x - from) · scale`.
    enter_from: [f32x8<S>; 3],
    enter_scale: [f32x8<S>; 3],
    leave_from: [f32x8<S>; 3],
    leave_scale: [f32x8<S>; 3],
    /// Which rows of bounds are entered by; the others are left by.
    enter_rows: [usize; 3],
    /// For a bundle that is parallel to planes: the row of those on the other side, by which
    /// boxes are entered, too.
    also_enter: Option<(usize, f32x8<S>, f32x8<S>)>,
    t_min: f32x8<S>,
}

impl<S: Simd> SlabLanes<S> {
    /// Of a ray that goes nowhere.
    #[inline(always)]
    pub(super) fn nowhere(simd: S) -> Self {
        let zero = f32x8::splat(simd, 0.0);
        Self {
            enter_from: [zero; 3],
            enter_scale: [zero; 3],
            leave_from: [zero; 3],
            leave_scale: [zero; 3],
            enter_rows: [0, 2, 4],
            also_enter: None,
            t_min: zero,
        }
    }

    /// Of all rays with origins and directions in these boxes, where the first may enter and the
    /// last may leave, at distances from `t_min`, which is not below 0. `bounds` are the tree's.
    #[inline(always)]
    pub(super) fn of_intervals(
        simd: S,
        origins: &Aabb,
        directions: &Aabb,
        t_min: f32,
        bounds: &Aabb,
    ) -> Self {
        let slack = SLACK * upper(bounds.reach(origins.min), bounds.reach(origins.max));
        let splat = |x: f32| f32x8::splat(simd, x);
        let fastest = |axis: usize| upper(directions.min[axis].abs(), directions.max[axis].abs());
        let slowest = SLOWEST * upper(upper(fastest(0), fastest(1)), fastest(2));
        let mut slabs = Self {
            enter_from: [splat(0.0); 3],
            enter_scale: [splat(0.0); 3],
            leave_from: [splat(0.0); 3],
            leave_scale: [splat(0.0); 3],
            enter_rows: [0, 2, 4],
            also_enter: None,
            t_min: splat(t_min),
        };
        for axis in 0..3 {
            // Whoever starts nearest to a plane and is fastest gets there first.
            let (low, high) = (directions.min[axis], directions.max[axis]);
            let below = (origins.min[axis] - slack).next_down();
            let above = (origins.max[axis] + slack).next_up();
            if low > 0.0 {
                slabs.enter_from[axis] = splat(above);
                slabs.enter_scale[axis] = splat(upper(high, slowest).recip());
                slabs.leave_from[axis] = splat(below);
                slabs.leave_scale[axis] = splat(upper(low, slowest).recip());
            } else if high < 0.0 {
                slabs.enter_rows[axis] = 2 * axis + 1;
                slabs.enter_from[axis] = splat(below);
                slabs.enter_scale[axis] = splat(-upper(-low, slowest).recip());
                slabs.leave_from[axis] = splat(above);
                slabs.leave_scale[axis] = splat(-upper(-high, slowest).recip());
            } else {
                slabs.enter_from[axis] = splat(above);
                slabs.enter_scale[axis] = splat(upper(high, slowest).recip());
                slabs.leave_from[axis] = splat(f32::NEG_INFINITY);
                slabs.leave_scale[axis] = splat(1.0);
                let scale = -upper(-low, slowest).recip();
                slabs.also_enter = Some((2 * axis + 1, splat(below), splat(scale)));
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
        let enter_x = (row(x) - self.enter_from[0]) * self.enter_scale[0];
        let enter_y = (row(y) - self.enter_from[1]) * self.enter_scale[1];
        let enter_z = (row(z) - self.enter_from[2]) * self.enter_scale[2];
        let leave_x = (row(x ^ 1) - self.leave_from[0]) * self.leave_scale[0];
        let leave_y = (row(y ^ 1) - self.leave_from[1]) * self.leave_scale[1];
        let leave_z = (row(z ^ 1) - self.leave_from[2]) * self.leave_scale[2];
        let mut enter = enter_x.max(enter_y).max(enter_z.max(self.t_min));
        if let Some((other, from, scale)) = self.also_enter {
            enter = enter.max((row(other) - from) * scale);
        }
        let leave = leave_x
            .min(leave_y)
            .min(leave_z.min(f32x8::splat(simd, t_max)));
        // NaN, from overflow only, meets.
        let met = !enter.simd_gt(leave);
        (enter.into(), met.to_bitmask() as u32)
    }
}
