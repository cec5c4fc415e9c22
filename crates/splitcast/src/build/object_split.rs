//! Sorting boxes into a binary tree, each to one side of every plane: to that of its center.
//!
//! Planes are chosen by binning the centers (Wald 2007): the costs of a split are those of the boxes
//! around what would be on each side. Nothing is on both, so a tree has as many
//! members as there are boxes, but cells overlap: what it gives is a spatial kd-tree (Ooi,
//! McDonell & Sacks-Davis 1987), whose nodes are planes with a box around the content of each side.

use std::ops::Range;

use fearless_simd::prelude::*;
use fearless_simd::{f32x4, f32x8, mask32x4};

use super::descent::SplitCandidate;
use super::subtree::OpenInner;
use super::{NodeWriter, Reference, Subtree};
use crate::simd::{Kernel, dispatch};

/// Bins of an axis.
const BINS: usize = 16;

/// Bins of an axis in nodes of few members, where most of the time goes into comparing planes.
const FEW_BINS: usize = 8;

/// Nodes of so many members have [`FEW_BINS`].
const FEW: usize = 64;

/// Nodes of more members are searched by a sample of about this many.
const SAMPLE: usize = 1024;

/// Nodes of more members have their sides sorted at the same time.
const PARALLEL: usize = 2048;

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
    let mut writer = NodeWriter::default();
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
        let found = if members.len() <= FEW {
            centers.find_split::<S, FEW_BINS>(simd, members, stride)
        } else {
            centers.find_split::<S, BINS>(simd, members, stride)
        };
        if let Some((plane, threshold, bins)) = found {
            let left = centers.partition(members, &plane, threshold, bins);
            if left > 0 && left < members.len() {
                return (left, plane);
            }
        }
    }
    centers.halve(members)
}

/// Where the centers of boxes are; coordinates are doubled, to save a product.
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

    /// Bins for each unit of length; none where all centers are in one place.
    fn scale(&self, axis: usize, bins: usize) -> f32 {
        let extent = self.max[axis] - self.min[axis];
        let scale = bins as f32 * (1.0 - f32::EPSILON) / extent;
        if scale.is_finite() { scale } else { 0.0 }
    }

    /// The cheapest plane, and the bin that it is in front of, if there is any.
    #[inline(always)]
    fn find_split<S: Simd, const N: usize>(
        &self,
        simd: S,
        members: &[Reference],
        stride: usize,
    ) -> Option<(SplitCandidate, f32, usize)> {
        let scale = [self.scale(0, N), self.scale(1, N), self.scale(2, N), 0.0];
        // Lowest corners with their signs reversed, then highest: both grow by the same operation.
        let empty = f32x8::splat(simd, f32::NEG_INFINITY);
        let mut boxes = [[[f32::NEG_INFINITY; 8]; N]; 3];
        let mut counts = [[0_u32; N]; 3];
        let (first, per_unit) = (f32x4::simd_from(simd, self.min), f32x4::simd_from(simd, scale));
        for member in members.iter().step_by(stride) {
            let (low, high) = member.lanes();
            let (low, high) = (f32x4::simd_from(simd, low), f32x4::simd_from(simd, high));
            let bounds = (-low).combine(high);
            let places: [f32; 4] = ((center(simd, member) - first) * per_unit).into();
            for axis in 0..3 {
                // A center that the sample did not see may be outside; NaN goes first.
                let bin = (places[axis] as usize).min(N - 1);
                let own = &mut boxes[axis][bin];
                *own = f32x8::simd_from(simd, *own).max(bounds).into();
                counts[axis][bin] += 1;
            }
        }
        let mut best = (f32::INFINITY, 0, 0);
        for axis in 0..3 {
            if scale[axis] == 0.0 {
                continue;
            }
            let mut right_costs = [0.0; N];
            let (mut bounds, mut count) = (empty, 0);
            for bin in (1..N).rev() {
                bounds = bounds.max(f32x8::simd_from(simd, boxes[axis][bin]));
                count += counts[axis][bin];
                right_costs[bin] = half_area(bounds) * count as f32;
            }
            let all = count + counts[axis][0];
            let (mut bounds, mut count) = (empty, 0);
            for bin in 1..N {
                bounds = bounds.max(f32x8::simd_from(simd, boxes[axis][bin - 1]));
                count += counts[axis][bin - 1];
                // Areas of sides without members are NaN, and never the least.
                let cost = half_area(bounds) * count as f32 + right_costs[bin];
                if cost < best.0 && count > 0 && count < all {
                    best = (cost, axis, bin);
                }
            }
        }
        let (cost, axis, bin) = best;
        (cost < f32::INFINITY).then(|| {
            let position = 0.5 * (self.min[axis] + bin as f32 / scale[axis]) + 0.0;
            (SplitCandidate { axis, position }, bin as f32, N)
        })
    }

    /// Brings the members of the bins in front of `threshold` to the front.
    #[inline(always)]
    fn partition(
        &self,
        members: &mut [Reference],
        plane: &SplitCandidate,
        threshold: f32,
        bins: usize,
    ) -> usize {
        let axis = plane.axis;
        let (first, scale) = (self.min[axis], self.scale(axis, bins));
        let mut left = 0;
        for place in 0..members.len() {
            let member = members[place];
            let center = member.min[axis] + member.max[axis];
            members[place] = members[left];
            members[left] = member;
            left += usize::from((center - first) * scale < threshold);
        }
        left
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

/// Half the surface area of a box, given as in [`Centers::find_split`].
#[inline(always)]
fn half_area<S: Simd>(bounds: f32x8<S>) -> f32 {
    let (minus_low, high) = bounds.split();
    let [x, y, z, _]: [f32; 4] = (high + minus_low).into();
    x * y + (x + y) * z
}
