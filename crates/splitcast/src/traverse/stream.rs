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

use std::ops::RangeInclusive;

use fearless_simd::prelude::*;
use fearless_simd::{f32x4, f32x8, f32x16, u8x16};

use super::descend::{ORDINARY, SLOWEST, Slabs, descend};
use super::intervals::RangeLanes;
use super::lanes::{ErrorScale, Passing, RayLanes, TriangleLanes, splat};
use super::nearest::{AnyHits, ClosestHits, NONE, Nearest, Query, exact_hit};
use super::packet::{GROUP, PACKET};
use super::triangle::{frame_axes, largest_axis};
use super::{NearestTester, completion};
use crate::aabb::upper;
use crate::prefetch::prefetch;
use crate::simd::{Kernel, dispatch};
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

/// Rays that a node is looked at for together, at least; fewer go on alone, each in its own order.
const FEWEST: usize = 4;

/// Rays that are handed on to children at once: what fills a 64-bit register.
const STEP: usize = 8;

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
struct Members {
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
struct Way {
    /// A direction with the signs of all.
    signs: [f32; 3],
    /// The sum of all directions.
    direction: [f32; 3],
    /// By how much boxes are widened.
    slack: f32,
    errors: ErrorScale,
}

impl<'q, 'm> Streams<'q, 'm> {
    /// For some of `rays`.
    pub(super) fn new(tree: &'q KdTree<'m>, rays: &'q [Ray]) -> Self {
        let bounds = tree.bounds();
        let size = bounds.extent().into_iter().fold(0.0, upper);
        let largest = bounds.reach([0.0; 3]);
        let ordinary = ORDINARY_SIZES.contains(&size) && ORDINARY_SIZES.contains(&largest);
        let middle = |axis: usize| 0.5 * bounds.min[axis] + 0.5 * bounds.max[axis];
        Self {
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
            dispatch(OneStream::<Q> {
                tree: self.tree,
                rays: self.rays,
                numbers: &self.waiting[kind][..self.counts[kind]],
                axes: frame_axes(kind / 8),
                stream: &mut self.stream,
                answers,
            });
            self.counts[kind] = 0;
        }
    }
}

/// The arguments of [`Streams::trace`] for one stream: a kernel of its own, since compilers take long for functions
/// as large as all kernels of a slice would make together.
struct OneStream<'q, 'm, Q: StreamQuery> {
    tree: &'q KdTree<'m>,
    rays: &'q [Ray],
    numbers: &'q [u32],
    axes: [usize; 3],
    stream: &'q mut Stream,
    answers: &'q mut [Q::Answer],
}

impl<Q: StreamQuery> Kernel for OneStream<'_, '_, Q> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd>(self, simd: S) {
        let Self {
            tree,
            rays,
            numbers,
            axes,
            stream,
            answers,
        } = self;
        let way = stream.read(simd, rays, numbers, &tree.bounds());
        stream.descend::<S, Q>(simd, tree.wide(), &way, numbers.len());
        Q::answer(simd, stream, axes, &tree.wide().blocks, numbers, answers);
    }
}

/// What streams are asked.
pub(super) trait StreamQuery: Query {
    /// What is to be known of a ray.
    type Answer;

    /// Puts down answers for the rays of a stream, given their numbers in the slice; the last of `axes` is that of
    /// their directions' largest component.
    fn answer<S: Simd>(
        simd: S,
        stream: &Stream,
        axes: [usize; 3],
        blocks: &Blocks,
        numbers: &[u32],
        answers: &mut [Self::Answer],
    );
}

impl StreamQuery for AnyHits {
    type Answer = bool;

    #[inline(always)]
    fn answer<S: Simd>(
        _: S,
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

    #[inline(always)]
    fn answer<S: Simd>(
        simd: S,
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
            let mut rows = [[0.0; GROUP]; 6];
            let mut places = [0; GROUP];
            for (lane, &k) in hit.iter().enumerate() {
                let ray = &stream.members.rays[usize::from(k)].ray;
                for axis in 0..3 {
                    rows[axis][lane] = ray.origin[axis];
                    rows[3 + axis][lane] = ray.direction[axis];
                }
                places[lane] = stream.members.places[usize::from(k)];
            }
            let [a, b, c, d, e, f] = rows;
            let origin = [
                f32x16::simd_from(simd, a),
                f32x16::simd_from(simd, b),
                f32x16::simd_from(simd, c),
            ];
            let direction = [
                f32x16::simd_from(simd, d),
                f32x16::simd_from(simd, e),
                f32x16::simd_from(simd, f),
            ];
            let all = (1 << hit.len()) - 1;
            let mut open = completion::complete(
                simd,
                blocks,
                axes,
                (origin, direction),
                &places,
                all,
                |lane, completed| {
                    answers[numbers[usize::from(hit[lane])] as usize] = Some(completed);
                },
            );
            while open != 0 {
                let lane = open.trailing_zeros() as usize % GROUP;
                open &= open - 1;
                let k = usize::from(hit[lane]);
                let ray = &stream.members.rays[k].ray;
                answers[numbers[k] as usize] = exact_hit(blocks, ray, places[lane]);
            }
        }
    }
}

impl Stream {
    /// Takes up rays, given by their numbers.
    #[inline(always)]
    fn read<S: Simd>(&mut self, simd: S, rays: &[Ray], numbers: &[u32], bounds: &Aabb) -> Way {
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
        Way {
            signs: rays[numbers[0] as usize].direction,
            direction: ranges.direction(),
            slack: intervals.slack(bounds),
            errors: intervals.errors(bounds),
        }
    }

    #[inline(always)]
    fn descend<S: Simd, Q: Query>(&mut self, simd: S, wide: &WideTree, way: &Way, count: usize) {
        let nodes = wide.nodes();
        // Boxes are entered by their lower planes forwards, by their upper ones backwards.
        let [x, y, z] = way.signs;
        let slack: [f32x8<S>; 3] = [
            f32x8::splat(simd, way.slack.copysign(x)),
            f32x8::splat(simd, way.slack.copysign(y)),
            f32x8::splat(simd, way.slack.copysign(z)),
        ];
        let (x, y, z) = (
            usize::from(x.is_sign_negative()),
            2 + usize::from(y.is_sign_negative()),
            4 + usize::from(z.is_sign_negative()),
        );
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
        while let Some(waiting) = self.stack.pop() {
            let depth = waiting.depth as usize;
            if depth + 1 >= self.lists.len() {
                self.lists.push([[0; STREAM + STEP]; LANES]);
            }
            let (above, below) = self.lists.split_at_mut(depth + 1);
            let list = &above[depth][waiting.lane as usize % LANES];
            let count = (waiting.count as usize).min(STREAM);
            let node = &nodes[waiting.node as usize];
            if count < FEWEST && !node.is_leaf() {
                for &number in &list[..count] {
                    self.members
                        .go_alone::<S, Q>(simd, wide, way, waiting.node, number);
                }
                continue;
            }
            let lists = &mut below[0];
            let union = {
                let enter = [
                    row(simd, node, x) - slack[0],
                    row(simd, node, y) - slack[1],
                    row(simd, node, z) - slack[2],
                ];
                let leave = [
                    row(simd, node, x ^ 1) + slack[0],
                    row(simd, node, y ^ 1) + slack[1],
                    row(simd, node, z ^ 1) + slack[2],
                ];
                let mut union = 0;
                for (&number, met) in list[..count].iter().zip(&mut self.met) {
                    let ray = &self.members.rays[usize::from(number)];
                    *met = ray.meet(simd, &enter, &leave);
                    union |= *met;
                }
                union
            };
            if union == 0 {
                continue;
            }
            if count < FEWEST {
                // Few rays at a leaf need neither lists nor an order.
                let mut rest = union;
                while rest != 0 {
                    let lane = rest.trailing_zeros() as usize;
                    rest &= rest - 1;
                    prefetch(wide.block(node.blocks(lane).start));
                }
                for (place, number) in list[..count].iter().enumerate() {
                    let mut met = self.met[place];
                    while met != 0 {
                        let lane = met.trailing_zeros() as usize;
                        met &= met - 1;
                        for block in node.blocks(lane) {
                            let list = std::slice::from_ref(number);
                            self.members.visit::<S, Q>(
                                simd,
                                &wide.blocks,
                                block,
                                &way.errors,
                                list,
                            );
                        }
                    }
                }
                continue;
            }
            self.met[count..count + STEP].fill(0);
            let counts = hand_on(simd, list, count, &self.met, union, lists);
            let (order, children) = order(simd, node, union, &way.direction);
            if node.is_leaf() {
                for &lane in &order[1..children] {
                    prefetch(wide.block(node.blocks(usize::from(lane)).start));
                }
                for &lane in &order[..children] {
                    let lane = usize::from(lane) % LANES;
                    for block in node.blocks(lane) {
                        let list = &lists[lane][..counts[lane]];
                        self.members
                            .visit::<S, Q>(simd, &wide.blocks, block, &way.errors, list);
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
        let numbers = u8x16::simd_from(simd, u128::from(bytes(&list[eight])).to_le_bytes());
        let mut rest = union;
        while rest != 0 {
            let lane = rest.trailing_zeros() as usize % LANES;
            rest &= rest - 1;
            // The lane's bit of every byte, then all of these in the highest byte.
            let bits = met >> lane & 0x0101_0101_0101_0101;
            let set = (bits.wrapping_mul(0x0102_0408_1020_4080) >> 56) as usize;
            let places = u128::from(u64::from_le_bytes(PLACES[set % 256])).to_le_bytes();
            let chosen = numbers.swizzle_dyn(u8x16::simd_from(simd, places));
            let chosen = u128::from_le_bytes(chosen.into()) as u64;
            // What is behind those that are chosen is overwritten by what comes next.
            let place = counts[lane];
            lists[lane][place..place + STEP].copy_from_slice(&chosen.to_le_bytes());
            counts[lane] += set.count_ones() as usize;
        }
    }
    counts
}

/// Eight bytes, the first the lowest.
#[inline(always)]
fn bytes(bytes: &[u8]) -> u64 {
    u64::from_le_bytes(bytes.try_into().expect("there are eight"))
}

impl Members {
    /// Takes a ray down from a node, alone.
    #[inline(always)]
    fn go_alone<S: Simd, Q: Query>(
        &mut self,
        simd: S,
        wide: &WideTree,
        way: &Way,
        node: u32,
        number: u8,
    ) {
        let own = &self.rays[usize::from(number)];
        let slabs = Slabs::of_inverse(&own.ray, own.inverse, own.offset, way.slack);
        let nearest = self.nearest(number);
        let mut tester =
            NearestTester::<S, Q>::new(simd, &wide.blocks, &own.ray, way.errors, nearest);
        descend(simd, wide, &slabs, node, &mut tester);
        let nearest = tester.nearest;
        self.set_nearest(number, nearest);
    }

    /// Tests the rays of a list against the triangles of a block.
    #[inline(always)]
    fn visit<S: Simd, Q: Query>(
        &mut self,
        simd: S,
        blocks: &Blocks,
        index: usize,
        errors: &ErrorScale,
        list: &[u8],
    ) {
        let triangles = TriangleLanes::of_block(simd, blocks.get(index));
        let errors = errors.of(simd, &triangles);
        for &number in list {
            let mut nearest = self.nearest(number);
            if Q::ANY && nearest.is_hit() {
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

impl StreamRay {
    /// The boxes that the ray meets within its range; `enter` and `leave` are the planes of eight.
    #[inline(always)]
    fn meet<S: Simd>(&self, simd: S, enter: &[f32x8<S>; 3], leave: &[f32x8<S>; 3]) -> u8 {
        let [a, b, c]: [f32x8<S>; 3] = splat(simd, self.inverse);
        let [d, e, f]: [f32x8<S>; 3] = splat(simd, self.offset);
        let t_min = f32x8::splat(simd, self.ray.t_min);
        let t_max = f32x8::splat(simd, self.high);
        let first = (enter[0].mul_sub(a, d).max(enter[1].mul_sub(b, e)))
            .max(enter[2].mul_sub(c, f).max(t_min));
        let last = (leave[0].mul_sub(a, d).min(leave[1].mul_sub(b, e)))
            .min(leave[2].mul_sub(c, f).min(t_max));
        first.simd_le(last).to_bitmask() as u8
    }
}

#[inline(always)]
fn row<S: Simd>(simd: S, node: &WideNode, row: usize) -> f32x8<S> {
    f32x8::simd_from(simd, node.bounds[row % 6])
}

/// The lanes of `union`, nearest first as seen along a direction, and their number.
#[inline(always)]
fn order<S: Simd>(
    simd: S,
    node: &WideNode,
    union: u8,
    direction: &[f32; 3],
) -> ([u8; LANES], usize) {
    let [x, y, z] = *direction;
    let keys = (row(simd, node, 0) + row(simd, node, 1)) * x
        + (row(simd, node, 2) + row(simd, node, 3)) * y
        + (row(simd, node, 4) + row(simd, node, 5)) * z;
    let keys: [f32; LANES] = keys.into();
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
