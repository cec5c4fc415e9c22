//! Many rays that take much the same way: one descent for all of them.
//!
//! Rays are taken in groups of 16, which go down the tree as one, by an interval of origins and one of
//! directions: boxes are met where any ray of the intervals may meet them (interval arithmetic;
//! Boulos, Wald & Shirley 2006). Up to four groups share nodes, the order of children, and blocks.
//! At a block, triangles are sorted out by their boxes in the same way; what is left is tested 16 rays at a
//! time ([`lanes`](super::lanes)).
//!
//! Distances are known up to their rounding errors. Only where these leave open which
//! of two hits is nearer, or whether there is one, the exact test decides at once; otherwise it
//! completes the hits that remain. Hits are those of single rays, to the last bit.

use std::marker::PhantomData;

use fearless_simd::prelude::*;
use fearless_simd::{f32x4, f32x8, f32x16, mask32x16};

use super::completion::{Completion, Lines};
use super::descend::{SLOWEST, SlabLanes, Stack};
use super::intervals::{Intervals, RangeLanes};
use super::lanes::{ErrorLanes, ErrorScale, Passing, RayLanes, TriangleLanes, boxes_of};
use super::nearest::{NONE, Nearest, Query, exact_hit};
use super::triangle::frame_axes;
use crate::aabb::{lower, upper};
use crate::simd::{Kernel, Vectors};
use crate::wide::{Blocks, LANES, WideTree};
use crate::{Hit, KdTree, Ray};

/// Rays of a group: one a lane.
pub(super) const GROUP: usize = 16;

/// Groups of a packet.
const GROUPS: usize = 4;

/// Rays of a packet.
pub(super) const PACKET: usize = GROUP * GROUPS;

/// Hits that are faster completed one by one than in lanes.
const FEW: u32 = 3;

/// Rays that are faster tested one by one against the triangles of a block than together against one
/// after the other.
const SINGLY: u32 = 4;

/// One number for each ray of a group.
#[derive(Clone, Copy, Debug)]
#[repr(C, align(64))]
struct Numbers([f32; GROUP]);

impl Numbers {
    #[inline(always)]
    fn lanes<S: Simd>(&self, simd: S) -> f32x16<S> {
        f32x16::simd_from(simd, self.0)
    }
}

/// A group of rays, lane by lane.
#[derive(Clone, Copy, Debug)]
struct Group {
    origin: [Numbers; 3],
    direction: [Numbers; 3],
    t_min: Numbers,
    /// The nearest hit's distance is from `low` to `high`; the ray's `t_max` while there is none.
    /// Below all in lanes whose ray looks for nothing (any more).
    low: Numbers,
    high: Numbers,
    /// The places of what is hit.
    place: [u32; GROUP],
    /// On which axis directions have their largest component: the set of rays for each.
    largest: [u32; 3],
    /// One over the direction, finite.
    inverse: [Numbers; 3],
    /// The origin times that.
    offset: [Numbers; 3],
}

/// How the groups of a packet meet boxes and triangles.
struct Way<S: Simd> {
    slabs: [SlabLanes<S>; GROUPS],
    /// The highest distance that is of interest to any ray of each group.
    t_max: [f32; GROUPS],
    errors: ErrorScale,
}

/// The arguments of [`Packet::trace`].
struct OnePacket<'p, 'q, 'm, Q> {
    tree: &'p KdTree<'m>,
    rays: &'q [Ray],
    packet: &'p mut Packet<'q>,
    query: PhantomData<Q>,
}

impl<Q: Query> Kernel for OnePacket<'_, '_, '_, Q> {
    type Output = u32;

    #[inline(always)]
    fn run<S: Simd>(self, simd: S) -> u32 {
        self.packet.trace_by::<S, Q>(simd, self.tree, self.rays)
    }
}

/// A packet under way.
pub(super) struct Packet<'q> {
    vectors: Vectors,
    blocks: &'q Blocks,
    rays: &'q [Ray],
    groups: [Group; GROUPS],
    /// By how much boxes are widened for these rays.
    slack: f32,
}

impl<'q> Packet<'q> {
    /// A packet without rays.
    pub(super) fn new(vectors: Vectors, tree: &'q KdTree<'_>) -> Self {
        Self {
            vectors,
            blocks: &tree.wide().blocks,
            rays: &[],
            groups: [Group::NOBODY; GROUPS],
            slack: 0.0,
        }
    }

    /// Traces those of up to [`PACKET`] rays that are alike, group by group, and gives the set of
    /// their groups: bit by bit, the first the lowest.
    pub(super) fn trace<Q: Query>(&mut self, tree: &KdTree<'_>, rays: &'q [Ray]) -> u32 {
        self.vectors.run(OnePacket::<Q> {
            tree,
            rays,
            packet: self,
            query: PhantomData,
        })
    }

    /// [`trace`](Self::trace) with an instruction set.
    #[inline(always)]
    fn trace_by<S: Simd, Q: Query>(&mut self, simd: S, tree: &KdTree<'_>, rays: &'q [Ray]) -> u32 {
        let bounds = tree.bounds();
        let mut intervals = [Intervals::NONE; GROUPS];
        let mut all = Intervals::NONE;
        for (own, group) in intervals.iter_mut().zip(rays.chunks(GROUP)) {
            let mut ranges = RangeLanes::new(simd);
            for ray in group {
                ranges.add(simd, ray);
            }
            *own = ranges.intervals();
            all.join(own);
        }
        // Most packets that miss the mesh are seen to as a whole.
        if all.are_narrow(&bounds) {
            let slabs = SlabLanes::of_intervals(simd, &all, &bounds);
            let root = &tree.wide().nodes()[tree.wide().root() as usize];
            if slabs.meet(simd, &root.bounds, f32::INFINITY).1 == 0 {
                for group in &mut self.groups {
                    group.place = [NONE; GROUP];
                }
                return (1 << rays.len().div_ceil(GROUP)) - 1;
            }
        }
        let mut traced = 0;
        let mut narrow = Intervals::NONE;
        for (k, own) in intervals.iter().enumerate() {
            if own.are_narrow(&bounds) {
                traced |= 1 << k;
                narrow.join(own);
            }
        }
        if traced == 0 {
            return 0;
        }
        let mut way = Way {
            slabs: [SlabLanes::nowhere(simd); GROUPS],
            t_max: [f32::NEG_INFINITY; GROUPS],
            errors: narrow.errors(&bounds),
        };
        self.rays = rays;
        self.slack = narrow.slack(&bounds);
        for (k, rays) in rays.chunks(GROUP).enumerate() {
            if traced >> k & 1 != 0 {
                self.groups[k].read(simd, rays);
                way.slabs[k] = SlabLanes::of_intervals(simd, &intervals[k], &bounds);
                way.t_max[k] = self.groups[k].t_max(simd);
            }
        }
        self.descend::<S, Q>(simd, tree.wide(), &mut way, traced);
        traced
    }

    /// Whether a ray hits anything.
    #[inline(always)]
    pub(super) fn is_hit(&self, ray: usize) -> bool {
        self.groups[ray / GROUP].place[ray % GROUP] != NONE
    }

    /// Puts down what the rays of a group hit.
    pub(super) fn complete(&self, group: usize, hits: &mut [Option<Hit>]) {
        let rays = &self.groups[group];
        hits.fill(None);
        let mut hit = 0;
        for (lane, &place) in rays.place.iter().enumerate() {
            hit |= u32::from(place != NONE) << lane;
        }
        if hit == 0 {
            return;
        }
        let mut open = hit;
        if hit.count_ones() >= FEW
            && let Some(axis) = rays.largest.iter().position(|set| set & hit == hit)
        {
            let lines = Lines {
                origin: rays.origin.each_ref().map(|row| &row.0),
                direction: rays.direction.each_ref().map(|row| &row.0),
            };
            open = self.vectors.run(Completion {
                blocks: self.blocks,
                axes: frame_axes(axis),
                lines,
                places: &rays.place,
                hit,
                hits: &mut *hits,
            });
        }
        while open != 0 {
            let lane = open.trailing_zeros() as usize % GROUP;
            open &= open - 1;
            let ray = &self.rays[group * GROUP + lane];
            hits[lane] = exact_hit(self.blocks, ray, rays.place[lane]);
        }
    }

    #[inline(always)]
    fn descend<S: Simd, Q: Query>(
        &mut self,
        simd: S,
        wide: &WideTree,
        way: &mut Way<S>,
        mut groups: u32,
    ) {
        let nodes = wide.nodes();
        let mut stack: Stack<u32> = Stack::new();
        let mut index = wide.root();
        loop {
            let node = &nodes[index as usize];
            // Lane by lane the groups that meet its box, and where the first of them does.
            let mut by = [0u8; LANES];
            let mut near = [f32::INFINITY; LANES];
            let mut met = 0;
            let mut rest = groups;
            while rest != 0 {
                let k = rest.trailing_zeros() as usize % GROUPS;
                rest &= rest - 1;
                let (near_k, met_k) = way.slabs[k].meet(simd, &node.bounds, way.t_max[k]);
                met |= met_k;
                for lane in 0..LANES {
                    by[lane] |= ((met_k >> lane & 1) << k) as u8;
                    near[lane] = lower(near[lane], near_k[lane]);
                }
            }
            if node.is_leaf() {
                while met != 0 {
                    let lane = met.trailing_zeros() as usize % LANES;
                    met &= met - 1;
                    for block in node.blocks(lane) {
                        let by = u32::from(by[lane]);
                        let place = (&node.bounds, lane);
                        self.visit::<S, Q>(simd, block, place, way, by);
                    }
                }
                let [a, b, c, d] = way.t_max;
                if upper(upper(a, b), upper(c, d)) == f32::NEG_INFINITY {
                    return;
                }
            } else if met != 0 {
                let lane = met.trailing_zeros() as usize % LANES;
                met &= met - 1;
                if met == 0 {
                    groups = u32::from(by[lane]);
                    index = node.child(lane);
                } else {
                    (index, groups) =
                        stack.push_but_nearest(node, &near, lane, met, |lane| u32::from(by[lane]));
                }
                continue;
            }
            loop {
                let Some((waiting, near, by)) = stack.pop() else {
                    return;
                };
                let mut still = 0;
                for k in 0..GROUPS {
                    still |= u32::from(near <= way.t_max[k]) << k;
                }
                if by & still != 0 {
                    groups = by & still;
                    index = waiting;
                    break;
                }
            }
        }
    }

    /// Tests the rays of groups `by` against the triangles of a block, whose box is the one in
    /// a lane of `bounds`.
    #[inline(always)]
    fn visit<S: Simd, Q: Query>(
        &mut self,
        simd: S,
        index: usize,
        (bounds, lane): (&[[f32; LANES]; 6], usize),
        way: &mut Way<S>,
        by: u32,
    ) {
        let mut rays = [0; GROUPS];
        let mut any = 0;
        for k in 0..GROUPS {
            if by >> k & 1 != 0 {
                rays[k] = self.groups[k].meet(simd, bounds, lane, self.slack);
                any |= rays[k];
            }
        }
        if any == 0 {
            return;
        }
        let block = self.blocks.get(index);
        let triangles = TriangleLanes::of_block(simd, block);
        let errors = way.errors.of(simd, &triangles);
        for k in 0..GROUPS {
            let mut rays = rays[k];
            if rays.count_ones() > SINGLY {
                let boxes = boxes_of(simd, block);
                let rows = errors.rows();
                let mut candidates = way.slabs[k].meet(simd, &boxes, way.t_max[k]).1;
                while candidates != 0 {
                    let lane = candidates.trailing_zeros() as usize % LANES;
                    candidates &= candidates - 1;
                    let errors = ErrorLanes::of_row(simd, &rows, lane);
                    let triangle = TriangleLanes::of_lane(simd, block, lane);
                    let passing = Passing::new(&self.groups[k].lines(simd), &triangle, &errors);
                    self.test_group::<S, Q>(simd, k, (index, lane), &passing, &errors);
                }
            } else {
                while rays != 0 {
                    let ray = rays.trailing_zeros() as usize % GROUP;
                    rays &= rays - 1;
                    let line = RayLanes::of_ray(simd, &self.rays[k * GROUP + ray]);
                    let passing = Passing::new(&line, &triangles, &errors);
                    self.test_ray::<S, Q>(simd, (k, ray), index, &passing, &errors);
                }
            }
            way.t_max[k] = self.groups[k].t_max(simd);
        }
    }

    /// Tests the rays of a group against one triangle of a block, given how they pass it.
    #[inline(always)]
    fn test_group<S: Simd, Q: Query>(
        &mut self,
        simd: S,
        group: usize,
        (index, lane): (usize, usize),
        passing: &Passing<S, f32x16<S>>,
        errors: &ErrorLanes<f32x16<S>>,
    ) {
        if passing.missed.all_true() {
            return;
        }
        let rays = &self.groups[group];
        let distance = passing.distance(simd, errors);
        let (t_min, low, high) = (
            rays.t_min.lanes(simd),
            rays.low.lanes(simd),
            rays.high.lanes(simd),
        );
        let active = high.simd_gt(f32x16::splat(simd, f32::NEG_INFINITY));
        let possible = distance.possible(t_min, high) & !passing.missed & active;
        let mut possible = possible.to_bitmask() as u32;
        if possible == 0 {
            return;
        }
        let nearest = if Q::ANY { high } else { low };
        let sure = distance.surely_within(t_min, nearest).to_bitmask() as u32;
        let (lows, highs): ([f32; GROUP], [f32; GROUP]) =
            (distance.low.into(), distance.high.into());
        let place = (index * LANES + lane) as u32;
        while possible != 0 {
            let lane = possible.trailing_zeros() as usize % GROUP;
            possible &= possible - 1;
            if sure >> lane & 1 != 0 {
                let mut nearest = self.groups[group].nearest(lane);
                nearest.found::<Q>(place, lows[lane], highs[lane]);
                self.groups[group].set_nearest(lane, nearest);
            } else {
                self.decide::<Q>(group, lane, place);
            }
        }
    }

    /// Tests one ray against the triangles of a block.
    #[inline(always)]
    fn test_ray<S: Simd, Q: Query>(
        &mut self,
        simd: S,
        (group, lane): (usize, usize),
        index: usize,
        passing: &Passing<S, f32x8<S>>,
        errors: &ErrorLanes<f32x8<S>>,
    ) {
        let ray = &self.rays[group * GROUP + lane];
        let mut nearest = self.groups[group].nearest(lane);
        nearest.test_block::<S, Q>(simd, self.blocks, ray, index, passing, errors);
        self.groups[group].set_nearest(lane, nearest);
    }

    /// Takes a hit that may be there, or may be nearer than the nearest known, if it is.
    fn decide<Q: Query>(&mut self, group: usize, lane: usize, place: u32) {
        let mut nearest = self.groups[group].nearest(lane);
        nearest.decide::<Q>(self.blocks, &self.rays[group * GROUP + lane], place);
        self.groups[group].set_nearest(lane, nearest);
    }
}

impl Group {
    const NOBODY: Self = Self {
        origin: [Numbers([0.0; GROUP]); 3],
        direction: [Numbers([0.0; GROUP]); 3],
        t_min: Numbers([0.0; GROUP]),
        low: Numbers([f32::NEG_INFINITY; GROUP]),
        high: Numbers([f32::NEG_INFINITY; GROUP]),
        place: [NONE; GROUP],
        largest: [0; 3],
        inverse: [Numbers([0.0; GROUP]); 3],
        offset: [Numbers([0.0; GROUP]); 3],
    };

    /// Puts rays into lanes. Those that cannot hit anything look for nothing.
    #[inline(always)]
    fn read<S: Simd>(&mut self, simd: S, rays: &[Ray]) {
        let last = rays.len() - 1;
        for first in (0..rays.len()).step_by(4) {
            let four = [
                &rays[first],
                &rays[last.min(first + 1)],
                &rays[last.min(first + 2)],
                &rays[last.min(first + 3)],
            ];
            let mut rows = [[f32x4::splat(simd, 0.0); 4]; 2];
            for k in 0..4 {
                let [x, y, z] = four[k].origin;
                let [u, v, w] = four[k].direction;
                rows[0][k] = f32x4::simd_from(simd, [x, y, z, u]);
                rows[1][k] = f32x4::simd_from(simd, [v, w, four[k].t_min, four[k].t_max]);
            }
            let [x, y, z, u] = transposed(rows[0]);
            let [v, w, t_min, t_max] = transposed(rows[1]);
            let lanes = first..first + 4;
            x.store_slice(&mut self.origin[0].0[lanes.clone()]);
            y.store_slice(&mut self.origin[1].0[lanes.clone()]);
            z.store_slice(&mut self.origin[2].0[lanes.clone()]);
            u.store_slice(&mut self.direction[0].0[lanes.clone()]);
            v.store_slice(&mut self.direction[1].0[lanes.clone()]);
            w.store_slice(&mut self.direction[2].0[lanes.clone()]);
            t_min.store_slice(&mut self.t_min.0[lanes.clone()]);
            t_max.store_slice(&mut self.high.0[lanes]);
        }
        // As in `ShearedRay`.
        let (x, y, z) = (
            self.direction[0].lanes(simd).abs(),
            self.direction[1].lanes(simd).abs(),
            self.direction[2].lanes(simd).abs(),
        );
        let first = (x.simd_ge(y) & x.simd_ge(z)).to_bitmask() as u32;
        let second = y.simd_ge(z).to_bitmask() as u32 & !first;
        self.largest = [first, second, !first & !second];
        let largest = f32x16::splat(simd, f32::MAX);
        let numbers = mask32x16::from_bitmask(simd, (1 << rays.len()) - 1);
        let valid = x.max(y).max(z).simd_gt(0.0)
            & x.simd_le(largest)
            & y.simd_le(largest)
            & z.simd_le(largest)
            & self.origin[0].lanes(simd).abs().simd_le(largest)
            & self.origin[1].lanes(simd).abs().simd_le(largest)
            & self.origin[2].lanes(simd).abs().simd_le(largest)
            & self.t_min.lanes(simd).simd_le(self.high.lanes(simd))
            & numbers;
        let none = f32x16::splat(simd, f32::NEG_INFINITY);
        let t_max = valid.select(self.high.lanes(simd), none);
        self.high = Numbers(t_max.into());
        self.low = self.high;
        self.place = [NONE; GROUP];
        self.find_inverses(simd);
    }

    /// Prepares to [`meet`](Self::meet) boxes.
    #[inline(always)]
    fn find_inverses<S: Simd>(&mut self, simd: S) {
        let [x, y, z] = points(simd, &self.direction);
        let slowest = x.abs().max(y.abs()).max(z.abs()) * SLOWEST;
        for axis in 0..3 {
            let along = self.direction[axis].lanes(simd);
            let inverse = f32x16::splat(simd, 1.0) / along.abs().max(slowest).copysign(along);
            self.inverse[axis] = Numbers(inverse.into());
            self.offset[axis] = Numbers((self.origin[axis].lanes(simd) * inverse).into());
        }
    }

    #[inline(always)]
    fn lines<S: Simd>(&self, simd: S) -> RayLanes<f32x16<S>> {
        RayLanes {
            origin: points(simd, &self.origin),
            direction: points(simd, &self.direction),
        }
    }

    /// The rays that may meet the box in a lane of `bounds`.
    #[inline(always)]
    fn meet<S: Simd>(&self, simd: S, bounds: &[[f32; LANES]; 6], lane: usize, slack: f32) -> u32 {
        let high = self.high.lanes(simd);
        let (mut enter, mut leave) = (self.t_min.lanes(simd), high);
        for axis in 0..3 {
            let (inverse, offset) = (
                self.inverse[axis].lanes(simd),
                self.offset[axis].lanes(simd),
            );
            let first = f32x16::splat(simd, bounds[2 * axis][lane % LANES] - slack);
            let last = f32x16::splat(simd, bounds[2 * axis + 1][lane % LANES] + slack);
            let (first, last) = (
                first.mul_sub(inverse, offset),
                last.mul_sub(inverse, offset),
            );
            enter = enter.max(first.min(last));
            leave = leave.min(first.max(last));
        }
        let active = high.simd_gt(f32x16::splat(simd, f32::NEG_INFINITY));
        (!enter.simd_gt(leave) & active).to_bitmask() as u32
    }

    /// The highest distance that is of interest to any of the rays.
    #[inline(always)]
    fn t_max<S: Simd>(&self, simd: S) -> f32 {
        self.high.lanes(simd).reduce_max()
    }

    #[inline(always)]
    fn nearest(&self, lane: usize) -> Nearest {
        Nearest {
            low: self.low.0[lane],
            high: self.high.0[lane],
            place: self.place[lane],
        }
    }

    #[inline(always)]
    fn set_nearest(&mut self, lane: usize, nearest: Nearest) {
        self.low.0[lane] = nearest.low;
        self.high.0[lane] = nearest.high;
        self.place[lane] = nearest.place;
    }
}

#[inline(always)]
fn points<S: Simd>(simd: S, [x, y, z]: &[Numbers; 3]) -> [f32x16<S>; 3] {
    [x.lanes(simd), y.lanes(simd), z.lanes(simd)]
}

/// Columns instead of rows.
#[inline(always)]
fn transposed<S: Simd>([a, b, c, d]: [f32x4<S>; 4]) -> [f32x4<S>; 4] {
    let (ac, bd) = (a.zip_low(c), b.zip_low(d));
    let (ac_high, bd_high) = (a.zip_high(c), b.zip_high(d));
    [
        ac.zip_low(bd),
        ac.zip_high(bd),
        ac_high.zip_low(bd_high),
        ac_high.zip_high(bd_high),
    ]
}
