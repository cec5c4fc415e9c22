//! Many rays that take different ways: one descent for all of them, in which each node is looked at once
//! for all rays that have come to it (Barringer & Akenine-Möller 2014, "Dynamic ray stream traversal").
//!
//! A stream holds up to 256 rays whose directions have the same signs and the same largest component. At a
//! node, every ray of a list is tested against the eight boxes, one ray after the other, which needs no
//! branches and waits for nothing; then rays are handed on to a list for each child, and the nearest
//! child is next. What a ray alone would spend on waiting for memory and on wrong guesses is shared.
//!
//! Distances are known up to their rounding errors ([`Nearest`]); hits are those of single rays, to
//! the last bit.

use std::marker::PhantomData;
use std::ops::RangeInclusive;

use fearless_simd::prelude::*;
use fearless_simd::{f32x4, f32x8, mask32x8, u8x16};

use super::completion::{Completion, Lines};
use super::descend::{ORDINARY, SLOWEST};
use super::intervals::RangeLanes;
use super::lanes::{ErrorScale, Passing, RayLanes, TriangleLanes, splat};
use super::nearest::{AnyHits, ClosestHits, NONE, Nearest, Query, exact_hit};
use super::packet::{GROUP, PACKET};
use super::strands::{ANYWHERE, SHORT, Strands};
use super::triangle::{frame_axes, largest_axis};
use crate::aabb::upper;
use crate::prefetch::prefetch;
use crate::simd::{Kernel, Vectors};
use crate::wide::{Blocks, LANES, WideNode, WideTree};
use crate::{Aabb, Hit, KdTree, Ray};

/// Rays of a stream: what a byte can number.
const STREAM: usize = 256;

/// Kinds of streams: eight combinations of signs, three largest components.
const KINDS: usize = 24;

/// Sizes of trees for whose rays nothing overflows or underflows, and how many sizes away from the middle
/// origins may be: what is farther away would widen the boxes for all.
const ORDINARY_SIZES: RangeInclusive<f32> = 1e-20..=1e12;
const FARTHEST_SIZES: f32 = 64.0;

/// Rays that are handed on to children at once: what fills a 64-bit register.
pub(super) const STEP: usize = 8;

/// A list of rays by their numbers in the stream.
type List = [u8; STREAM + STEP];

/// A ray of a stream: a cache line.
#[derive(Clone, Copy, Debug)]
#[repr(C, align(64))]
struct StreamRay {
    ray: Ray,
    /// One over the direction, finite.
    inverse: [f32; 3],
    /// The origin times that.
    offset: [f32; 3],
    /// Distances to the nearest hit.
    low: f32,
    high: f32,
}

impl StreamRay {
    const NOBODY: Self = Self {
        ray: Ray {
            origin: [0.0; 3],
            direction: [0.0; 3],
            t_min: 0.0,
            t_max: 0.0,
        },
        inverse: [0.0; 3],
        offset: [0.0; 3],
        low: 0.0,
        high: 0.0,
    };
}

/// Rays that wait for others of their kind.
pub(super) struct Streams<'q, 'm> {
    vectors: Vectors,
    tree: &'q KdTree<'m>,
    rays: &'q [Ray],
    /// The middle of the tree, and how far from there origins may be on each axis.
    middle: [f32; 3],
    farthest: f32,
    waiting: Vec<[u32; STREAM]>,
    counts: [usize; KINDS],
    stream: Box<Stream>,
}

/// Up to 256 rays and what they hit.
pub(super) struct Members {
    rays: [StreamRay; STREAM],
    places: [u32; STREAM],
}

/// A stream under way.
pub(super) struct Stream {
    members: Members,
    /// Which boxes each ray of a list meets.
    met: [u8; STREAM + STEP],
    /// The lists of the children of a node, for nodes at each depth.
    lists: Vec<[List; LANES]>,
    stack: Vec<Waiting>,
    strands: Strands,
}

/// A node that some rays have come to.
#[derive(Clone, Copy, Debug)]
struct Waiting {
    node: u32,
    /// Where their list is.
    depth: u32,
    lane: u8,
    count: u16,
}

/// How the rays of a stream meet boxes and triangles.
pub(super) struct Way<S: Simd> {
    /// By how much boxes are widened, towards where rays come from.
    slack: [f32x8<S>; 3],
    /// Which rows of bounds are entered by; the others are left by.
    enter_rows: [usize; 3],
    /// The sum of all directions.
    direction: [f32; 3],
    pub(super) errors: ErrorScale,
}

/// The planes by which eight boxes are entered and left, on each axis.
pub(super) struct Planes<S: Simd> {
    enter: [f32x8<S>; 3],
    leave: [f32x8<S>; 3],
}

impl<S: Simd> Way<S> {
    /// For rays whose directions have these signs, and this sum.
    #[inline(always)]
    fn new(simd: S, signs: [f32; 3], direction: [f32; 3], slack: f32, errors: ErrorScale) -> Self {
        // Boxes are entered by their lower planes forwards, by their upper ones backwards.
        let [x, y, z] = signs;
        Self {
            slack: splat(
                simd,
                [slack.copysign(x), slack.copysign(y), slack.copysign(z)],
            ),
            enter_rows: [
                usize::from(x.is_sign_negative()),
                2 + usize::from(y.is_sign_negative()),
                4 + usize::from(z.is_sign_negative()),
            ],
            direction,
            errors,
        }
    }

    /// Those of a node's children.
    #[inline(always)]
    pub(super) fn planes(&self, simd: S, node: &WideNode) -> Planes<S> {
        let [x, y, z] = self.enter_rows;
        Planes {
            enter: [
                row(simd, node, x) - self.slack[0],
                row(simd, node, y) - self.slack[1],
                row(simd, node, z) - self.slack[2],
            ],
            leave: [
                row(simd, node, x ^ 1) + self.slack[0],
                row(simd, node, y ^ 1) + self.slack[1],
                row(simd, node, z ^ 1) + self.slack[2],
            ],
        }
    }

    /// The lanes of `union`, nearest first as seen along all rays together, and their number.
    #[inline(always)]
    fn order(&self, simd: S, node: &WideNode, union: u8) -> ([u8; LANES], usize) {
        let [x, y, z] = self.direction;
        let keys = (row(simd, node, 0) + row(simd, node, 1)) * x
            + (row(simd, node, 2) + row(simd, node, 3)) * y
            + (row(simd, node, 4) + row(simd, node, 5)) * z;
        sorted(&keys.into(), union)
    }
}

impl<'q, 'm> Streams<'q, 'm> {
    /// For some of `rays`.
    pub(super) fn new(vectors: Vectors, tree: &'q KdTree<'m>, rays: &'q [Ray]) -> Self {
        let bounds = tree.bounds();
        let size = bounds.extent().into_iter().fold(0.0, upper);
        let largest = bounds.reach([0.0; 3]);
        let ordinary = ORDINARY_SIZES.contains(&size) && ORDINARY_SIZES.contains(&largest);
        let middle = |axis: usize| 0.5 * bounds.min[axis] + 0.5 * bounds.max[axis];
        Self {
            vectors,
            tree,
            rays,
            middle: [middle(0), middle(1), middle(2)],
            farthest: if ordinary {
                FARTHEST_SIZES * size
            } else {
                -1.0
            },
            waiting: vec![[0; STREAM]; KINDS],
            counts: [0; KINDS],
            stream: Box::new(Stream {
                members: Members {
                    rays: [StreamRay::NOBODY; STREAM],
                    places: [NONE; STREAM],
                },
                met: [0; STREAM + STEP],
                lists: Vec::new(),
                stack: Vec::new(),
                strands: Strands::default(),
            }),
        }
    }

    /// The kind of stream that a ray belongs to; `None` for those that have to go alone.
    #[inline(always)]
    fn kind(&self, ray: &Ray) -> Option<usize> {
        let [x, y, z] = ray.direction;
        let (a, b, c) = (x.abs(), y.abs(), z.abs());
        let axis = largest_axis(a, b, c);
        // NaN is in no range.
        let largest = [a, b, c][axis];
        let sound = ORDINARY.contains(&largest)
            && a <= largest
            && b <= largest
            && c <= largest
            && ray.t_min <= ray.t_max
            && ray.t_min.is_finite()
            && (ray.origin[0] - self.middle[0]).abs() <= self.farthest
            && (ray.origin[1] - self.middle[1]).abs() <= self.farthest
            && (ray.origin[2] - self.middle[2]).abs() <= self.farthest;
        let sign = |x: f32| (x.to_bits() >> 31) as usize;
        sound.then_some(8 * axis + sign(x) + 2 * sign(y) + 4 * sign(z))
    }

    /// Adds a ray by its number, unless it has to go alone. There is room for [`PACKET`] more after every
    /// [`trace`](Self::trace).
    #[inline(always)]
    pub(super) fn add(&mut self, ray: usize) -> bool {
        let Some(kind) = self.kind(&self.rays[ray]) else {
            return false;
        };
        self.waiting[kind][self.counts[kind] % STREAM] = ray as u32;
        self.counts[kind] += 1;
        true
    }

    /// Traces streams that are nearly full, or all. Answers are put down where the rays are in the slice.
    pub(super) fn trace<Q: StreamQuery>(&mut self, all: bool, answers: &mut [Q::Answer]) {
        let fewest = if all { 1 } else { STREAM - PACKET + 1 };
        for kind in 0..KINDS {
            if self.counts[kind] < fewest {
                continue;
            }
            let numbers = &self.waiting[kind][..self.counts[kind]];
            self.vectors.run(OneStream::<Q> {
                tree: self.tree,
                rays: self.rays,
                numbers,
                stream: &mut self.stream,
                query: PhantomData,
            });
            let (axes, blocks) = (frame_axes(kind / 8), &self.tree.wide().blocks);
            Q::answer(self.vectors, &self.stream, axes, blocks, numbers, answers);
            self.counts[kind] = 0;
        }
    }
}

/// The arguments of [`Streams::trace`] for one stream.
struct OneStream<'q, 'm, Q> {
    tree: &'q KdTree<'m>,
    rays: &'q [Ray],
    numbers: &'q [u32],
    stream: &'q mut Stream,
    query: PhantomData<Q>,
}

impl<Q: Query> Kernel for OneStream<'_, '_, Q> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd>(self, simd: S) {
        let Self {
            tree,
            rays,
            numbers,
            stream,
            ..
        } = self;
        let way = stream.read(simd, rays, numbers, &tree.bounds());
        stream.descend::<S, Q>(simd, tree.wide(), &way, numbers.len());
    }
}

/// What streams are asked.
pub(super) trait StreamQuery: Query {
    /// What is to be known of a ray.
    type Answer;

    /// Puts down answers for the rays of a stream, given their numbers in the slice; the last of `axes` is that of
    /// their directions' largest component.
    fn answer(
        vectors: Vectors,
        stream: &Stream,
        axes: [usize; 3],
        blocks: &Blocks,
        numbers: &[u32],
        answers: &mut [Self::Answer],
    );
}

impl StreamQuery for AnyHits {
    type Answer = bool;

    fn answer(
        _: Vectors,
        stream: &Stream,
        _: [usize; 3],
        _: &Blocks,
        numbers: &[u32],
        answers: &mut [bool],
    ) {
        for (&number, &place) in numbers.iter().zip(&stream.members.places) {
            answers[number as usize] = place != NONE;
        }
    }
}

impl StreamQuery for ClosestHits {
    type Answer = Option<Hit>;

    fn answer(
        vectors: Vectors,
        stream: &Stream,
        axes: [usize; 3],
        blocks: &Blocks,
        numbers: &[u32],
        answers: &mut [Option<Hit>],
    ) {
        // Those that hit, close together.
        let mut hit = [0; STREAM];
        let mut count = 0;
        for (k, &number) in numbers.iter().enumerate() {
            answers[number as usize] = None;
            hit[count % STREAM] = k as u8;
            count += usize::from(stream.members.places[k] != NONE);
        }
        for hit in hit[..count].chunks(GROUP) {
            let (mut origin, mut direction) = ([[0.0; GROUP]; 3], [[0.0; GROUP]; 3]);
            let mut places = [0; GROUP];
            for (lane, &k) in hit.iter().enumerate() {
                let ray = &stream.members.rays[usize::from(k)].ray;
                for axis in 0..3 {
                    origin[axis][lane] = ray.origin[axis];
                    direction[axis][lane] = ray.direction[axis];
                }
                places[lane] = stream.members.places[usize::from(k)];
            }
            let lines = Lines {
                origin: origin.each_ref(),
                direction: direction.each_ref(),
            };
            let all = (1 << hit.len()) - 1;
            let mut hits = [None; GROUP];
            let open = vectors.run(Completion {
                blocks,
                axes,
                lines,
                places: &places,
                hit: all,
                hits: &mut hits,
            });
            for (lane, &k) in hit.iter().enumerate() {
                let k = usize::from(k);
                answers[numbers[k] as usize] = match open >> lane & 1 {
                    0 => hits[lane],
                    _ => exact_hit(blocks, &stream.members.rays[k].ray, places[lane]),
                };
            }
        }
    }
}

impl Stream {
    /// Takes up rays, given by their numbers.
    #[inline(always)]
    fn read<S: Simd>(&mut self, simd: S, rays: &[Ray], numbers: &[u32], bounds: &Aabb) -> Way<S> {
        let mut ranges = RangeLanes::new(simd);
        for ((own, place), &number) in
            (self.members.rays.iter_mut().zip(&mut self.members.places)).zip(numbers)
        {
            let ray = rays[number as usize];
            let ([x, y, z], [u, v, w]) = (ray.origin, ray.direction);
            let origin = f32x4::simd_from(simd, [x, y, z, 0.0]);
            let along = f32x4::simd_from(simd, [u, v, w, 0.0]);
            let slowest = upper(upper(u.abs(), v.abs()), w.abs()) * SLOWEST;
            let inverse = f32x4::splat(simd, 1.0) / along.abs().max(slowest).copysign(along);
            let ([a, b, c, _], [d, e, f, _]): ([f32; 4], [f32; 4]) =
                (inverse.into(), (origin * inverse).into());
            *own = StreamRay {
                ray,
                inverse: [a, b, c],
                offset: [d, e, f],
                low: ray.t_max,
                high: ray.t_max,
            };
            *place = NONE;
            ranges.add(simd, &ray);
        }
        let intervals = ranges.intervals();
        let signs = rays[numbers[0] as usize].direction;
        let (slack, errors) = (intervals.slack(bounds), intervals.errors(bounds));
        Way::new(simd, signs, ranges.direction(), slack, errors)
    }

    #[inline(always)]
    fn descend<S: Simd, Q: Query>(&mut self, simd: S, wide: &WideTree, way: &Way<S>, count: usize) {
        let nodes = wide.nodes();
        self.stack.clear();
        if self.lists.is_empty() {
            self.lists.push([[0; STREAM + STEP]; LANES]);
        }
        for (k, number) in self.lists[0][0].iter_mut().enumerate() {
            *number = k as u8;
        }
        self.stack.push(Waiting {
            node: wide.root(),
            depth: 0,
            lane: 0,
            count: count as u16,
        });
        loop {
            let next = self.stack.pop();
            self.strands
                .advance::<S, Q>(simd, wide, way, &mut self.members, next.is_none());
            let Some(waiting) = next else {
                return;
            };
            let depth = waiting.depth as usize;
            if depth + 1 >= self.lists.len() {
                self.lists.push([[0; STREAM + STEP]; LANES]);
            }
            let (above, below) = self.lists.split_at_mut(depth + 1);
            let list = &above[depth][waiting.lane as usize % LANES];
            let count = (waiting.count as usize).min(STREAM);
            if count <= SHORT {
                self.strands
                    .add_node(waiting.node, bytes(&list[..STEP]), count);
                continue;
            }
            let node = &nodes[waiting.node as usize];
            let lists = &mut below[0];
            let planes = way.planes(simd, node);
            let mut union = 0;
            for (&number, met) in list[..count].iter().zip(&mut self.met) {
                *met = self.members.meet(simd, number, &planes).1.to_bitmask() as u8;
                union |= *met;
            }
            if union == 0 {
                continue;
            }
            self.met[count..count + STEP].fill(0);
            let counts = hand_on(simd, list, count, &self.met, union, lists);
            let (order, children) = way.order(simd, node, union);
            if node.is_leaf() {
                for &lane in &order[..children] {
                    prefetch(wide.block(node.blocks(usize::from(lane)).start));
                }
                for &lane in &order[..children] {
                    let lane = usize::from(lane) % LANES;
                    let list = &lists[lane][..counts[lane]];
                    for block in node.blocks(lane) {
                        if list.len() <= SHORT {
                            let list = bytes(&lists[lane][..STEP]);
                            self.strands.add_block(block, list, counts[lane]);
                        } else {
                            let errors = &way.errors;
                            self.members.visit::<S, Q>(
                                simd,
                                &wide.blocks,
                                block,
                                errors,
                                ANYWHERE,
                                list,
                            );
                        }
                    }
                }
            } else {
                for &lane in order[..children].iter().rev() {
                    prefetch(&nodes[node.child(usize::from(lane)) as usize]);
                    self.stack.push(Waiting {
                        node: node.child(usize::from(lane)),
                        depth: waiting.depth + 1,
                        lane,
                        count: counts[usize::from(lane) % LANES] as u16,
                    });
                }
            }
        }
    }
}

/// For each set of bytes among eight, their places, close together.
const PLACES: [[u8; STEP]; 256] = {
    let mut places = [[0; STEP]; 256];
    let mut set = 0;
    while set < 256 {
        let (mut place, mut count) = (0, 0);
        while place < STEP {
            if set >> place & 1 != 0 {
                places[set][count] = place as u8;
                count += 1;
            }
            place += 1;
        }
        set += 1;
    }
    places
};

/// Gives the rays of a list to the children that they meet, and says how many each child gets. `union` are the
/// children that any meets. Behind the list there is room for [`STEP`] more rays, which meet nothing.
#[inline(always)]
fn hand_on<S: Simd>(
    simd: S,
    list: &List,
    count: usize,
    met: &[u8; STREAM + STEP],
    union: u8,
    lists: &mut [List; LANES],
) -> [usize; LANES] {
    let mut counts = [0; LANES];
    for first in (0..count).step_by(STEP) {
        let eight = first..first + STEP;
        let met = bytes(&met[eight.clone()]);
        let numbers = Eight::new(simd, bytes(&list[eight]));
        let mut rest = union;
        while rest != 0 {
            let lane = rest.trailing_zeros() as usize % LANES;
            rest &= rest - 1;
            let (chosen, count) = numbers.choose(simd, met, lane);
            // What is behind those that are chosen is overwritten by what comes next.
            let place = counts[lane];
            lists[lane][place..place + STEP].copy_from_slice(&chosen.to_le_bytes());
            counts[lane] += count;
        }
    }
    counts
}

/// Up to eight rays by their numbers.
pub(super) struct Eight<S: Simd>(u8x16<S>);

impl<S: Simd> Eight<S> {
    /// Numbers by bytes, the first the lowest.
    #[inline(always)]
    pub(super) fn new(simd: S, numbers: u64) -> Self {
        Self(u8x16::simd_from(simd, u128::from(numbers).to_le_bytes()))
    }

    /// Those that meet the box in a lane, close together, and how many they are. `met` are the boxes
    /// that each meets, byte by byte.
    #[inline(always)]
    pub(super) fn choose(&self, simd: S, met: u64, lane: usize) -> (u64, usize) {
        // The lane's bit of every byte, then all of these in the highest byte.
        let bits = met >> lane & 0x0101_0101_0101_0101;
        let set = (bits.wrapping_mul(0x0102_0408_1020_4080) >> 56) as usize;
        let places = u128::from(u64::from_le_bytes(PLACES[set % 256])).to_le_bytes();
        let chosen = self.0.swizzle_dyn(u8x16::simd_from(simd, places));
        let chosen = u128::from_le_bytes(chosen.into()) as u64;
        (chosen, set.count_ones() as usize)
    }
}

/// Eight bytes, the first the lowest.
#[inline(always)]
fn bytes(bytes: &[u8]) -> u64 {
    u64::from_le_bytes(bytes.try_into().expect("there are eight"))
}

impl Members {
    /// Where a ray enters the boxes of a node's children, and which it meets within its range.
    #[inline(always)]
    pub(super) fn meet<S: Simd>(
        &self,
        simd: S,
        number: u8,
        Planes { enter, leave }: &Planes<S>,
    ) -> (f32x8<S>, mask32x8<S>) {
        let own = &self.rays[usize::from(number)];
        let [a, b, c]: [f32x8<S>; 3] = splat(simd, own.inverse);
        let [d, e, f]: [f32x8<S>; 3] = splat(simd, own.offset);
        let t_min = f32x8::splat(simd, own.ray.t_min);
        let t_max = f32x8::splat(simd, own.high);
        let first = (enter[0].mul_sub(a, d).max(enter[1].mul_sub(b, e)))
            .max(enter[2].mul_sub(c, f).max(t_min));
        let last = (leave[0].mul_sub(a, d).min(leave[1].mul_sub(b, e)))
            .min(leave[2].mul_sub(c, f).min(t_max));
        (first, first.simd_le(last))
    }

    /// Tests the rays of a list against the triangles of a block, which none reaches before `near`.
    #[inline(always)]
    pub(super) fn visit<S: Simd, Q: Query>(
        &mut self,
        simd: S,
        blocks: &Blocks,
        index: usize,
        errors: &ErrorScale,
        near: f32,
        list: &[u8],
    ) {
        let triangles = TriangleLanes::of_block(simd, blocks.get(index));
        let errors = errors.of(simd, &triangles);
        for &number in list {
            let mut nearest = self.nearest(number);
            if near > nearest.high {
                continue;
            }
            let ray = &self.rays[usize::from(number)].ray;
            let passing = Passing::new(&RayLanes::of_ray(simd, ray), &triangles, &errors);
            nearest.test_block::<S, Q>(simd, blocks, ray, index, &passing, &errors);
            self.set_nearest(number, nearest);
        }
    }

    #[inline(always)]
    fn nearest(&self, number: u8) -> Nearest {
        let StreamRay { low, high, .. } = self.rays[usize::from(number)];
        Nearest {
            low,
            high,
            place: self.places[usize::from(number)],
        }
    }

    #[inline(always)]
    fn set_nearest(&mut self, number: u8, Nearest { low, high, place }: Nearest) {
        let own = &mut self.rays[usize::from(number)];
        (own.low, own.high) = (low, high);
        self.places[usize::from(number)] = place;
    }
}

#[inline(always)]
fn row<S: Simd>(simd: S, node: &WideNode, row: usize) -> f32x8<S> {
    f32x8::simd_from(simd, node.bounds[row % 6])
}

/// The lanes of `union` by their keys, the lowest first, and their number.
#[inline(always)]
fn sorted(keys: &[f32; LANES], union: u8) -> ([u8; LANES], usize) {
    let mut order = [0; LANES];
    let mut count = 0;
    let mut rest = union;
    while rest != 0 {
        let lane = rest.trailing_zeros() as usize % LANES;
        rest &= rest - 1;
        let mut place = count;
        while place > 0 && keys[usize::from(order[place - 1]) % LANES] > keys[lane] {
            order[place] = order[place - 1];
            place -= 1;
        }
        order[place] = lane as u8;
        count += 1;
    }
    (order, count)
}
