//! Short lists of rays on their way down, several at a time: while one waits for memory, others are looked at.
//!
//! A list of up to eight rays fills a register. On a strand, its nodes and blocks are visited depth first, the
//! nearest first; strands take turns, one node or block each. Memory is asked for
//! when something is put on a strand, a round before it is read.

use fearless_simd::f32x8;
use fearless_simd::prelude::*;

use super::nearest::Query;
use super::stream::{Eight, Members, STEP, Way};
use crate::prefetch::prefetch;
use crate::wide::{LANES, WideNode, WideTree};

/// Rays of a short list, at most.
pub(super) const SHORT: usize = STEP;

/// Lists that take turns.
const STRANDS: usize = 8;

/// The bit of a place that tells blocks from nodes; indices of either are smaller.
const BLOCK: u32 = 1 << 31;

/// Before all distances, but not before those of rays that look for nothing any more.
pub(super) const ANYWHERE: f32 = f32::MIN;

/// A list of rays that has come to a node or a block.
#[derive(Clone, Copy, Debug)]
struct Visit {
    /// The index of a node, or that of a block and [`BLOCK`].
    place: u32,
    /// No ray gets there before this distance.
    near: f32,
    /// The rays by their numbers in the stream, byte by byte.
    list: u64,
    count: u32,
}

/// Short lists under way.
#[derive(Debug, Default)]
pub(super) struct Strands {
    /// What is left to visit on each, last first.
    stacks: [Vec<Visit>; STRANDS],
    /// Lists that wait for a strand, the first in front of `next` gone.
    waiting: Vec<Visit>,
    next: usize,
}

impl Strands {
    /// Adds a list that has come to a node.
    #[inline(always)]
    pub(super) fn add_node(&mut self, node: u32, list: u64, count: usize) {
        self.add(node, list, count);
    }

    /// Adds a list that has come to a block.
    #[inline(always)]
    pub(super) fn add_block(&mut self, block: usize, list: u64, count: usize) {
        self.add(block as u32 | BLOCK, list, count);
    }

    #[inline(always)]
    fn add(&mut self, place: u32, list: u64, count: usize) {
        self.waiting.push(Visit {
            place,
            near: ANYWHERE,
            list,
            count: count as u32,
        });
    }

    /// Goes on for as long as there is something to do on every strand; with `all` until nothing is left
    /// to do.
    #[inline(always)]
    pub(super) fn advance<S: Simd, Q: Query>(
        &mut self,
        simd: S,
        wide: &WideTree,
        way: &Way<S>,
        members: &mut Members,
        all: bool,
    ) {
        if self.waiting.len() < STRANDS && !all {
            return;
        }
        let (mut strand, mut idle) = (0, 0);
        while idle < STRANDS {
            strand = (strand + 1) % STRANDS;
            let Some(visit) = self.stacks[strand].pop().or_else(|| self.next()) else {
                if !all {
                    break;
                }
                idle += 1;
                continue;
            };
            idle = 0;
            self.visit::<S, Q>(simd, wide, way, members, strand, visit);
        }
        self.waiting.clear();
        self.next = 0;
    }

    /// The next list that waits for a strand.
    #[inline(always)]
    fn next(&mut self) -> Option<Visit> {
        let visit = self.waiting.get(self.next).copied();
        self.next += usize::from(visit.is_some());
        visit
    }

    /// Visits a node or a block; what is to be visited next comes on the same strand.
    #[inline(always)]
    fn visit<S: Simd, Q: Query>(
        &mut self,
        simd: S,
        wide: &WideTree,
        way: &Way<S>,
        members: &mut Members,
        strand: usize,
        visit: Visit,
    ) {
        let numbers = visit.list.to_le_bytes();
        let list = &numbers[..(visit.count as usize).min(SHORT)];
        // Most lists end as single rays, which take less without loops.
        let one = &numbers[..1];
        if visit.place & BLOCK != 0 {
            let (blocks, errors, near) = (&wide.blocks, &way.errors, visit.near);
            let block = (visit.place & !BLOCK) as usize;
            if visit.count == 1 {
                members.visit::<S, Q>(simd, blocks, block, errors, near, one);
            } else {
                members.visit::<S, Q>(simd, blocks, block, errors, near, list);
            }
            return;
        }
        let node = &wide.nodes()[visit.place as usize];
        let planes = way.planes(simd, node);
        let stack = &mut self.stacks[strand];
        if visit.count == 1 {
            let (near, meets) = members.meet(simd, one[0], &planes);
            let union = meets.to_bitmask() as u8;
            push_children::<Q>(stack, wide, node, &near.into(), union, |_| (visit.list, 1));
            return;
        }
        let none = f32x8::splat(simd, f32::INFINITY);
        let (mut near, mut met, mut union) = (none, [0; STEP], 0);
        for (&number, met) in list.iter().zip(&mut met) {
            let (first, meets) = members.meet(simd, number, &planes);
            near = near.min(meets.select(first, none));
            *met = meets.to_bitmask() as u8;
            union |= *met;
        }
        let met = u64::from_le_bytes(met);
        let numbers = Eight::new(simd, visit.list);
        push_children::<Q>(stack, wide, node, &near.into(), union, |lane| {
            numbers.choose(simd, met, lane)
        });
    }
}

/// Puts the children of a node in the lanes of `union` on a stack, the nearest last if it matters.
/// `chosen` gives the list of each and its length.
#[inline(always)]
fn push_children<Q: Query>(
    stack: &mut Vec<Visit>,
    wide: &WideTree,
    node: &WideNode,
    near: &[f32; LANES],
    union: u8,
    chosen: impl Fn(usize) -> (u64, usize),
) {
    if union == 0 {
        return;
    }
    let (mut nearest, mut distance) = (usize::MAX, f32::INFINITY);
    let mut rest = union;
    while rest != 0 {
        let lane = rest.trailing_zeros() as usize % LANES;
        rest &= rest - 1;
        let (list, count) = chosen(lane);
        let near = near[lane];
        nearest = if near < distance {
            stack.len()
        } else {
            nearest
        };
        distance = if near < distance { near } else { distance };
        let mut push = |place| {
            stack.push(Visit {
                place,
                near,
                list,
                count: count as u32,
            });
        };
        if node.is_leaf() {
            for block in node.blocks(lane) {
                prefetch(wide.block(block));
                push(block as u32 | BLOCK);
            }
        } else {
            let child = node.child(lane);
            prefetch(&wide.nodes()[child as usize]);
            push(child);
        }
    }
    // The order of the others hardly matters, and finding it takes more than it gives.
    let last = stack.len().saturating_sub(1);
    if !Q::ANY && nearest < last {
        stack.swap(nearest, last);
    }
}
