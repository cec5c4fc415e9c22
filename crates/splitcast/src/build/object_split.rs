//! Sorting boxes into a binary tree, each to one side of every plane: to that of its center.
//!
//! Planes are chosen by binning the centers (Wald 2007): the costs of a split are those of the boxes
//! around what would be on each side. Nothing is on both, so a tree has as many
//! members as there are boxes, but cells overlap: what it gives is a spatial kd-tree (Ooi,
//! McDonell & Sacks-Davis 1987), whose nodes are planes with a box around the content of each side.

use std::ops::Range;

use fearless_simd::prelude::*;
use fearless_simd::{f32x4, f32x8, f32x16, mask32x4, mask32x16, u32x4};

use super::descent::SplitCandidate;
use super::subtree::OpenInner;
use super::{NodeWriter, Reference, Subtree};
use crate::simd::{Kernel, dispatch};

/// Bins of an axis.
const BINS: usize = 16;

/// Planes of an axis that small nodes are tried with, all in one register with those of the other two.
const PLANES: usize = 5;

/// Nodes of so many members are small: to sort them into bins takes less time than to go through these.
const SMALL: usize = 96;

/// Nodes of more members are searched by a sample of about this many.
const SAMPLE: usize = 400;

/// Nodes of more members have their sides sorted at the same time.
const PARALLEL: usize = 512;

/// Levels beyond those that halving needs, before it is resorted to.
const SPARE_LEVELS: u32 = 24;

/// Sorts `references` into a tree with leaves of `most` at most, whose order is the one they are
/// in afterwards. Depends on nothing but them.
pub(super) fn sort(references: &mut [Reference], most: usize) -> Subtree {
    let levels = references.len().div_ceil(most).max(1).ilog2() + SPARE_LEVELS;
    sort_below(references, most, levels)
}

fn sort_below(references: &mut [Reference], most: usize, levels: u32) -> Subtree {
    if references.len() <= PARALLEL || rayon::current_num_threads() == 1 {
        return dispatch(Descent {
            references,
            most,
            levels,
        });
    }
    let (left_count, plane) = dispatch(Step {
        references,
        most,
        levels,
    });
    let (left, right) = references.split_at_mut(left_count);
    let (left, right) = rayon::join(
        || sort_below(left, most, levels - 1),
        || sort_below(right, most, levels - 1),
    );
    let nodes = 1 + left.nodes().len() + right.nodes().len();
    let mut writer = NodeWriter::with_capacity(nodes, references.len());
    let inner = writer.open_inner(plane.axis, plane.position);
    writer.append(&left);
    writer.begin_right(inner);
    writer.append(&right);
    writer.finish()
}

/// A single split.
struct Step<'a> {
    references: &'a mut [Reference],
    most: usize,
    levels: u32,
}

impl Kernel for Step<'_> {
    type Output = (usize, SplitCandidate);

    #[inline(always)]
    fn run<S: Simd>(self, simd: S) -> Self::Output {
        split(simd, self.references, self.most, self.levels)
    }
}

/// The whole way down.
struct Descent<'a> {
    references: &'a mut [Reference],
    most: usize,
    levels: u32,
}

impl Kernel for Descent<'_> {
    type Output = Subtree;

    #[inline(always)]
    fn run<S: Simd>(self, simd: S) -> Subtree {
        let Self {
            references,
            most,
            mut levels,
        } = self;
        let total = references.len();
        let mut writer = NodeWriter::with_capacity(4 * total / most + 1, total);
        let mut right_children: Vec<(OpenInner, Range<usize>, u32)> = Vec::new();
        let mut range = 0..total;
        loop {
            let members = &mut references[range.clone()];
            if members.len() <= most {
                writer.leaf(members.iter().map(|member| member.triangle));
                let Some((inner, right, right_levels)) = right_children.pop() else {
                    return writer.finish();
                };
                writer.begin_right(inner);
                (range, levels) = (right, right_levels);
                continue;
            }
            let (left, plane) = split(simd, members, most, levels);
            levels -= 1;
            let middle = range.start + left;
            right_children.push((
                writer.open_inner(plane.axis, plane.position),
                middle..range.end,
                levels,
            ));
            range = range.start..middle;
        }
    }
}

/// Brings the members on the left of the best plane to the front: gives their number, which is
/// neither none nor all, and the plane.
#[inline(always)]
fn split<S: Simd>(
    simd: S,
    members: &mut [Reference],
    most: usize,
    levels: u32,
) -> (usize, SplitCandidate) {
    let stride = members.len().div_ceil(SAMPLE);
    let centers = Centers::of(simd, members, stride);
    let halvings = members.len().div_ceil(most).next_power_of_two().ilog2();
    if levels > halvings {
        let found = if members.len() <= SMALL {
            centers.find_among_few(simd, members, most)
        } else {
            centers.find_by_bins(simd, members, stride)
        };
        if let Some((axis, position)) = found {
            let left = partition(members, axis, position);
            if left > 0 && left < members.len() {
                let position = 0.5 * position + 0.0;
                return (left, SplitCandidate { axis, position });
            }
        }
    }
    centers.halve(members)
}

/// Brings the members whose centers are on the left of a plane to the front, and gives their
/// number.
#[inline(always)]
fn partition(members: &mut [Reference], axis: usize, position: f32) -> usize {
    let mut left = 0;
    for place in 0..members.len() {
        let member = members[place];
        members.swap(place, left);
        left += usize::from(member.min[axis] + member.max[axis] < position);
    }
    left
}

/// Where the centers of boxes are. Their coordinates, and those of planes between them, are doubled here,
/// to save a product.
struct Centers {
    min: [f32; 4],
    max: [f32; 4],
}

impl Centers {
    #[inline(always)]
    fn of<S: Simd>(simd: S, members: &[Reference], stride: usize) -> Self {
        let mut min = f32x4::splat(simd, f32::INFINITY);
        let mut max = f32x4::splat(simd, f32::NEG_INFINITY);
        for member in members.iter().step_by(stride) {
            let center = center(simd, member);
            min = min.min(center);
            max = max.max(center);
        }
        Self {
            min: min.into(),
            max: max.into(),
        }
    }

    /// The cheapest of a few planes, by trying all.
    #[inline(always)]
    fn find_among_few<S: Simd>(
        &self,
        simd: S,
        members: &[Reference],
        most: usize,
    ) -> Option<(usize, f32)> {
        // A lane for each plane of each axis; the last has none, and nothing is on its left.
        let mut planes = [f32::NEG_INFINITY; 16];
        for axis in 0..3 {
            let step = (self.max[axis] - self.min[axis]) / (PLANES + 1) as f32;
            for plane in 0..PLANES {
                planes[axis * PLANES + plane] = self.min[axis] + (plane + 1) as f32 * step;
            }
        }
        let positions = f32x16::simd_from(simd, planes);
        let of_y = mask32x16::from_bitmask(simd, 0b11111 << PLANES);
        let of_z = mask32x16::from_bitmask(simd, 0b11111 << (2 * PLANES));
        let lowest = f32x16::splat(simd, f32::NEG_INFINITY);
        let (zero, one) = (f32x16::splat(simd, 0.0), f32x16::splat(simd, 1.0));
        // Lowest coordinates with their signs reversed, then highest: all grow alike.
        let mut left = [lowest; 6];
        let mut right = [lowest; 6];
        let mut left_count = zero;
        for member in members {
            let [a, b, c] = member.min;
            let [d, e, f] = member.max;
            let center = of_y.select(
                f32x16::splat(simd, b + e),
                of_z.select(f32x16::splat(simd, c + f), f32x16::splat(simd, a + d)),
            );
            let on_left = center.simd_lt(positions);
            left_count += on_left.select(one, zero);
            let bounds = [-a, -b, -c, d, e, f];
            for k in 0..6 {
                let bound = f32x16::splat(simd, bounds[k]);
                left[k] = left[k].max(on_left.select(bound, lowest));
                right[k] = right[k].max(on_left.select(lowest, bound));
            }
        }
        let right_count = members.len() as f32 - left_count;
        // Areas of sides without members are infinite, their costs not numbers.
        // A leaf costs as much as what it has room for: there had better be few, and full.
        let most = most as f32;
        let left_work = left_count + (left_count / most).ceil() * most;
        let right_work = right_count + (right_count / most).ceil() * most;
        let costs = areas(&left) * left_work + areas(&right) * right_work;
        let costs: [f32; 16] = costs.into();
        let (mut best, mut least) = (0, f32::INFINITY);
        for (lane, &cost) in costs.iter().enumerate() {
            (best, least) = if cost < least {
                (lane, cost)
            } else {
                (best, least)
            };
        }
        (least < f32::INFINITY).then_some((best / PLANES, planes[best]))
    }

    /// The cheapest of evenly spaced planes, by bins.
    #[inline(always)]
    fn find_by_bins<S: Simd>(
        &self,
        simd: S,
        members: &[Reference],
        stride: usize,
    ) -> Option<(usize, f32)> {
        let mut scale = [0.0; 4];
        for axis in 0..3 {
            let bins_a_unit = BINS as f32 / (self.max[axis] - self.min[axis]);
            scale[axis] = if bins_a_unit.is_finite() {
                bins_a_unit
            } else {
                0.0
            };
        }
        let empty = f32x8::splat(simd, f32::NEG_INFINITY);
        // Lowest corners with their signs reversed, then highest: all grow alike.
        let mut boxes = [[[f32::NEG_INFINITY; 8]; BINS]; 3];
        let mut counts = [[0_u32; BINS]; 3];
        let (first, per_unit) = (
            f32x4::simd_from(simd, self.min),
            f32x4::simd_from(simd, scale),
        );
        let last = f32x4::splat(simd, (BINS - 1) as f32);
        for member in members.iter().step_by(stride) {
            let (low, high) = member.lanes();
            let (low, high) = (f32x4::simd_from(simd, low), f32x4::simd_from(simd, high));
            let bounds = (-low).combine(high);
            let places = ((center(simd, member) - first) * per_unit).min(last);
            let places: [u32; 4] = places.to_int::<u32x4<S>>().into();
            for axis in 0..3 {
                let bin = places[axis] as usize % BINS;
                let own = &mut boxes[axis][bin];
                *own = f32x8::simd_from(simd, *own).max(bounds).into();
                counts[axis][bin] += 1;
            }
        }
        let (mut least, mut best) = (f32::INFINITY, None);
        for axis in 0..3 {
            let mut right_costs = [0.0; BINS];
            let (mut bounds, mut count) = (empty, 0);
            for bin in (1..BINS).rev() {
                bounds = bounds.max(f32x8::simd_from(simd, boxes[axis][bin]));
                count += counts[axis][bin];
                right_costs[bin] = half_area(bounds) * count as f32;
            }
            let (mut bounds, mut count) = (empty, 0);
            for bin in 1..BINS {
                bounds = bounds.max(f32x8::simd_from(simd, boxes[axis][bin - 1]));
                count += counts[axis][bin - 1];
                // Areas of sides without members are infinite, their costs not numbers.
                let cost = half_area(bounds) * count as f32 + right_costs[bin];
                if cost < least {
                    least = cost;
                    best = Some((axis, self.min[axis] + bin as f32 / scale[axis]));
                }
            }
        }
        best
    }

    /// Divides the members into halves, along the axis on which their centers are spread most.
    fn halve(&self, members: &mut [Reference]) -> (usize, SplitCandidate) {
        let spread = |axis: usize| self.max[axis] - self.min[axis];
        let axis = if spread(0) >= spread(1) && spread(0) >= spread(2) {
            0
        } else if spread(1) >= spread(2) {
            1
        } else {
            2
        };
        let center = |member: &Reference| member.min[axis] + member.max[axis];
        let middle = members.len() / 2;
        let order = |a: &Reference, b: &Reference| {
            (center(a).total_cmp(&center(b))).then(a.triangle.cmp(&b.triangle))
        };
        let (_, first_right, _) = members.select_nth_unstable_by(middle, order);
        let position = 0.5 * center(first_right) + 0.0;
        (middle, SplitCandidate { axis, position })
    }
}

/// Twice the center of a box, and 0.
#[inline(always)]
fn center<S: Simd>(simd: S, member: &Reference) -> f32x4<S> {
    let (low, high) = member.lanes();
    let (low, high) = (f32x4::simd_from(simd, low), f32x4::simd_from(simd, high));
    // The fourth numbers are no coordinates, and slow to compute with.
    let coordinates = mask32x4::from_bitmask(simd, 0b111);
    let zero = f32x4::splat(simd, 0.0);
    coordinates.select(low, zero) + coordinates.select(high, zero)
}

/// Half the surface areas of boxes, given by their lowest coordinates with signs reversed and their
/// highest.
#[inline(always)]
fn areas<S: Simd>(bounds: &[f32x16<S>; 6]) -> f32x16<S> {
    let [a, b, c, d, e, f] = *bounds;
    let (x, y, z) = (a + d, b + e, c + f);
    x * y + (x + y) * z
}

/// Half the surface area of one.
#[inline(always)]
fn half_area<S: Simd>(bounds: f32x8<S>) -> f32 {
    let (minus_low, high) = bounds.split();
    let [x, y, z, _]: [f32; 4] = (high + minus_low).into();
    x * y + (x + y) * z
}
