//! A leaf's triangles in blocks of neighbors.

use std::cmp::Ordering;
use std::ops::Range;

use fearless_simd::prelude::*;
use fearless_simd::{f32x4, f32x8, f32x16, mask32x16};

use super::{Block, LANES, Leaf, WideNode};
use crate::simd::{Kernel, dispatch};
use crate::{Aabb, Mesh};

/// Times that a leaf's triangles are halved: once for each doubling of the lanes.
const HALVINGS: u32 = LANES.ilog2();

/// Triangles whose middles are compared at once.
const STRIDE: usize = 16;

/// Working memory for groups of leaves.
#[derive(Debug, Default)]
pub(crate) struct LeafMemory {
    /// The vertices of each triangle, read before their positions: memory answers all of them at once.
    vertices: Vec<[u32; 3]>,
    /// Corners of each triangle; fourth numbers mean nothing, as in what follows.
    corners: Vec<[[f32; 4]; 3]>,
    /// Lowest and highest corner of each box within the leaf's cell.
    boxes: Vec<[[f32; 4]; 2]>,
    order: Order,
    /// Both sides of a segment while it is sorted.
    sides: [Order; 2],
}

/// Triangles in an order. All arrays have room behind for whole vectors.
#[derive(Debug, Default)]
struct Order {
    /// Twice the middles of their boxes, by axis.
    middles: [Vec<f32>; 3],
    /// Their places in the leaf, as the bits of numbers that are never computed with.
    places: Vec<f32>,
}

/// Leaves in wide form. Puts down their blocks, the first of which has the index `base`.
pub(super) fn group(
    mesh: Mesh<'_>,
    leaves: &[Leaf],
    references: &[u32],
    memory: &mut LeafMemory,
    base: usize,
    blocks: &mut [Block],
) -> Vec<WideNode> {
    dispatch(Group {
        mesh,
        leaves,
        references,
        memory,
        base,
        blocks,
    })
}

/// The arguments of [`group`].
struct Group<'a> {
    mesh: Mesh<'a>,
    leaves: &'a [Leaf],
    references: &'a [u32],
    memory: &'a mut LeafMemory,
    base: usize,
    blocks: &'a mut [Block],
}

impl Kernel for Group<'_> {
    type Output = Vec<WideNode>;

    #[inline(always)]
    fn run<S: Simd>(self, simd: S) -> Self::Output {
        let Self {
            mesh,
            leaves,
            references,
            memory,
            mut base,
            mut blocks,
        } = self;
        let mut nodes = Vec::with_capacity(leaves.len());
        for leaf in leaves {
            let triangles = &references[leaf.references.clone()];
            memory.read(simd, mesh, triangles, &leaf.cell);
            let (own, others) = blocks.split_at_mut(leaf.blocks());
            nodes.push(node(simd, triangles, memory, base, own));
            (blocks, base) = (others, base + leaf.blocks());
        }
        nodes
    }
}

/// The wide node of a leaf over `triangles`. Puts down its blocks, the first of which has the index `base`.
#[inline(always)]
fn node<S: Simd>(
    simd: S,
    triangles: &[u32],
    memory: &mut LeafMemory,
    base: usize,
    blocks: &mut [Block],
) -> WideNode {
    let mut node = WideNode::EMPTY_LEAF;
    let mut made = 0;
    // Segments of the order in reverse, with how often each has been halved.
    let mut segments = [(0, triangles.len(), 0); LANES];
    let mut waiting = 1;
    let mut lane = 0;
    while waiting > 0 {
        waiting -= 1;
        let (start, end, halvings) = segments[waiting];
        let count = (end - start).div_ceil(LANES);
        if count == 0 {
            continue;
        }
        if halvings < HALVINGS && count > 1 {
            let left = count.div_ceil(2) * LANES;
            memory.halve(simd, start..end, left);
            segments[waiting] = (start + left, end, halvings + 1);
            segments[waiting + 1] = (start, start + left, halvings + 1);
            waiting += 2;
            continue;
        }
        node.set_bounds(lane, &memory.bounds_of(simd, start..end));
        node.first[lane] = (base + made) as u32;
        for first in (start..end).step_by(LANES) {
            blocks[made] = memory.block(simd, triangles, first..end);
            made += 1;
        }
        node.end[lane] = (base + made) as u32;
        lane += 1;
    }
    node
}

impl LeafMemory {
    /// Reads triangles and finds their boxes.
    #[inline(always)]
    fn read<S: Simd>(&mut self, simd: S, mesh: Mesh<'_>, triangles: &[u32], cell: &Aabb) {
        let (low, high) = (lanes(simd, &cell.min), lanes(simd, &cell.max));
        self.corners.clear();
        self.boxes.clear();
        self.order.make_room(triangles.len());
        for side in &mut self.sides {
            side.make_room(triangles.len());
        }
        self.vertices.clear();
        for &triangle in triangles {
            self.vertices.push(mesh.triangles()[triangle as usize]);
        }
        let positions = mesh.positions();
        for (first, four) in self.vertices.chunks(4).enumerate() {
            let mut middles = [[0.0; 4]; 4];
            for (k, middle) in middles.iter_mut().enumerate() {
                let [a, b, c] = four[k.min(four.len() - 1)];
                let a = lanes(simd, &positions[a as usize]);
                let b = lanes(simd, &positions[b as usize]);
                let c = lanes(simd, &positions[c as usize]);
                let min = a.min(b).min(c).max(low);
                let max = a.max(b).max(c).min(high);
                self.corners.push([a.into(), b.into(), c.into()]);
                self.boxes.push([min.into(), max.into()]);
                *middle = (min + max).into();
            }
            let [a, b, c, d] = &middles;
            let transposed = transposed(simd, [a, b, c, d]);
            let range = 4 * first..4 * first + 4;
            for axis in 0..3 {
                let middles: [f32; 4] = transposed[axis].into();
                self.order.middles[axis][range.clone()].copy_from_slice(&middles);
            }
        }
        for (place, bits) in self.order.places.iter_mut().enumerate() {
            *bits = f32::from_bits(place as u32);
        }
    }

    /// Brings the `count` lower ones of a segment to its front, on the axis on which it is
    /// spread most; `count` is neither none nor all. Of those in the same place, the first.
    #[inline(always)]
    fn halve<S: Simd>(&mut self, simd: S, segment: Range<usize>, count: usize) {
        let [x, y, z] = &self.order.middles;
        let ranges = [
            range_of(simd, &x[segment.start..], segment.len()),
            range_of(simd, &y[segment.start..], segment.len()),
            range_of(simd, &z[segment.start..], segment.len()),
        ];
        let spread = |axis: usize| ranges[axis].1 - ranges[axis].0;
        let axis = if spread(0) >= spread(1) && spread(0) >= spread(2) {
            0
        } else if spread(1) >= spread(2) {
            1
        } else {
            2
        };
        let keys = &self.order.middles[axis][segment.start..];
        let threshold = find_threshold(simd, keys, segment.len(), count, ranges[axis]);
        self.partition(simd, segment, axis, threshold);
    }

    /// Brings those below the threshold, and as many of those at it as it says, to the front.
    #[inline(always)]
    fn partition<S: Simd>(
        &mut self,
        simd: S,
        segment: Range<usize>,
        axis: usize,
        Threshold { value, mut equal }: Threshold,
    ) {
        let (mut lower, mut upper) = (0, 0);
        let [below, above] = &mut self.sides;
        for start in segment.clone().step_by(STRIDE) {
            let valid = valid(segment.end - start);
            let keys = load(simd, &self.order.middles[axis][start..]);
            let mut low = keys.simd_lt(value).to_bitmask() & valid;
            if equal > 0 {
                let mut at = keys.simd_eq(value).to_bitmask() & valid;
                while at != 0 && equal > 0 {
                    low |= at & at.wrapping_neg();
                    at &= at - 1;
                    equal -= 1;
                }
            }
            let high = !low & valid;
            let low_mask = mask32x16::from_bitmask(simd, low);
            let high_mask = mask32x16::from_bitmask(simd, high);
            for k in 0..4 {
                let values = load(simd, &self.order.array(k)[start..]);
                store(values.compress(low_mask), &mut below.array_mut(k)[lower..]);
                store(values.compress(high_mask), &mut above.array_mut(k)[upper..]);
            }
            lower += low.count_ones() as usize;
            upper += high.count_ones() as usize;
        }
        for k in 0..4 {
            let (low, high) = self.order.array_mut(k)[segment.clone()].split_at_mut(lower);
            low.copy_from_slice(&below.array(k)[..lower]);
            high.copy_from_slice(&above.array(k)[..upper]);
        }
    }

    /// The box around a segment.
    #[inline(always)]
    fn bounds_of<S: Simd>(&self, simd: S, segment: Range<usize>) -> Aabb {
        let mut min = f32x4::splat(simd, f32::INFINITY);
        let mut max = f32x4::splat(simd, f32::NEG_INFINITY);
        for place in &self.order.places[segment] {
            let [low, high] = self.boxes[place.to_bits() as usize];
            min = min.min(f32x4::simd_from(simd, low));
            max = max.max(f32x4::simd_from(simd, high));
        }
        let [a, b, c, _]: [f32; 4] = min.into();
        let [d, e, f, _]: [f32; 4] = max.into();
        Aabb {
            min: [a, b, c],
            max: [d, e, f],
        }
    }

    /// The block of the first eight triangles of a segment.
    #[inline(always)]
    fn block<S: Simd>(&self, simd: S, triangles: &[u32], segment: Range<usize>) -> Block {
        let mut places = [0; LANES];
        for (k, place) in places.iter_mut().enumerate() {
            // The last triangle fills up the block.
            let next = (segment.start + k).min(segment.end - 1);
            *place = self.order.places[next].to_bits() as usize;
        }
        let mut own = [0; LANES];
        for (k, own) in own.iter_mut().enumerate() {
            *own = triangles[places[k]];
        }
        let mut corners = [[[0.0; 4]; 3]; LANES];
        for (k, corners) in corners.iter_mut().enumerate() {
            *corners = self.corners[places[k]];
        }
        Block::of_corners(simd, &corners, own)
    }
}

impl Block {
    /// The block of triangles with these corners.
    #[inline(always)]
    pub(super) fn of_corners<S: Simd>(
        simd: S,
        corners: &[[[f32; 4]; 3]; LANES],
        triangles: [u32; LANES],
    ) -> Self {
        let a = points(simd, corners, 0);
        let b = points(simd, corners, 1);
        let c = points(simd, corners, 2);
        let mut block = Self {
            triangles,
            ..Self::ZERO
        };
        for axis in 0..3 {
            block.corners[0][axis] = a[axis].into();
            block.corners[1][axis] = b[axis].into();
            block.corners[2][axis] = c[axis].into();
        }
        block
    }
}

impl Order {
    /// Makes room for so many triangles.
    fn make_room(&mut self, count: usize) {
        let room = count + 2 * STRIDE;
        for k in 0..4 {
            let array = self.array_mut(k);
            if array.len() < room {
                array.resize(room, 0.0);
            }
        }
    }

    #[inline(always)]
    fn array(&self, k: usize) -> &[f32] {
        match k {
            3 => &self.places,
            axis => &self.middles[axis],
        }
    }

    #[inline(always)]
    fn array_mut(&mut self, k: usize) -> &mut Vec<f32> {
        match k {
            3 => &mut self.places,
            axis => &mut self.middles[axis],
        }
    }
}

/// What tells the lower side of a segment.
#[derive(Clone, Copy)]
struct Threshold {
    /// All below belong to it,
    value: f32,
    /// and so many of those that are equal.
    equal: usize,
}

/// What `count` of the first `total` keys, all in `range`, are below.
#[inline(always)]
fn find_threshold<S: Simd>(
    simd: S,
    keys: &[f32],
    total: usize,
    count: usize,
    range: (f32, f32),
) -> Threshold {
    // Fewer than `count` keys are below `low`, at least as many are below `high`.
    let (mut low, mut below_low) = (range.0, 0);
    let mut high = range.1.next_up();
    loop {
        let value = 0.5 * low + 0.5 * high;
        if value <= low || value >= high {
            // Nothing is between the two.
            return Threshold {
                value: low,
                equal: count - below_low,
            };
        }
        let mut below = 0;
        for start in (0..total).step_by(STRIDE) {
            let less = load(simd, &keys[start..]).simd_lt(value).to_bitmask();
            below += (less & valid(total - start)).count_ones() as usize;
        }
        match below.cmp(&count) {
            Ordering::Less => (low, below_low) = (value, below),
            Ordering::Equal => return Threshold { value, equal: 0 },
            Ordering::Greater => high = value,
        }
    }
}

/// The least and the greatest of the first `count` keys.
#[inline(always)]
fn range_of<S: Simd>(simd: S, keys: &[f32], count: usize) -> (f32, f32) {
    let mut min = f32x16::splat(simd, f32::INFINITY);
    let mut max = f32x16::splat(simd, f32::NEG_INFINITY);
    for start in (0..count).step_by(STRIDE) {
        let all = mask32x16::from_bitmask(simd, valid(count - start));
        let keys = load(simd, &keys[start..]);
        min = min.min(all.select(keys, min));
        max = max.max(all.select(keys, max));
    }
    (min.reduce_min(), max.reduce_max())
}

/// The lanes that hold one of `left` numbers.
#[inline(always)]
fn valid(left: usize) -> u64 {
    if left < STRIDE {
        (1 << left) - 1
    } else {
        (1 << STRIDE) - 1
    }
}

#[inline(always)]
fn load<S: Simd>(simd: S, numbers: &[f32]) -> f32x16<S> {
    f32x16::from_slice(simd, &numbers[..STRIDE])
}

#[inline(always)]
fn store<S: Simd>(vector: f32x16<S>, numbers: &mut [f32]) {
    vector.store_slice(&mut numbers[..STRIDE]);
}

#[inline(always)]
pub(super) fn lanes<S: Simd>(simd: S, [x, y, z]: &[f32; 3]) -> f32x4<S> {
    f32x4::simd_from(simd, [*x, *y, *z, 0.0])
}

/// One corner of each of eight triangles, by axis.
#[inline(always)]
fn points<S: Simd>(simd: S, triangles: &[[[f32; 4]; 3]; LANES], corner: usize) -> [f32x8<S>; 3] {
    let [a, b, c, d, e, f, g, h] = triangles;
    let [x, y, z] = transposed(simd, [&a[corner], &b[corner], &c[corner], &d[corner]]);
    let [other_x, other_y, other_z] =
        transposed(simd, [&e[corner], &f[corner], &g[corner], &h[corner]]);
    [x.combine(other_x), y.combine(other_y), z.combine(other_z)]
}

/// Four points as vectors of their x, y and z.
#[inline(always)]
fn transposed<S: Simd>(simd: S, [a, b, c, d]: [&[f32; 4]; 4]) -> [f32x4<S>; 3] {
    let a = f32x4::simd_from(simd, *a);
    let b = f32x4::simd_from(simd, *b);
    let c = f32x4::simd_from(simd, *c);
    let d = f32x4::simd_from(simd, *d);
    let (ac, bd) = (a.zip_low(c), b.zip_low(d));
    [
        ac.zip_low(bd),
        ac.zip_high(bd),
        a.zip_high(c).zip_low(b.zip_high(d)),
    ]
}
