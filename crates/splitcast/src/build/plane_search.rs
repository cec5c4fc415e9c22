//! The search for a node's split plane among evenly spaced candidates.
//!
//! Equal to binning (Shevtsov et al. 2007) with counts taken directly: a
//! reference begins below a plane or ends above it, and eight planes are
//! compared with its box at once. Eight counters in a register beat the
//! memory traffic of bins, and few planes suffice: between two of them the
//! cost of a node of many triangles hardly changes, and in small nodes eight
//! planes leave few triangles between them.

use super::references::{Reference, bounds_of};
use crate::{Aabb, CostModel};

/// Candidate planes an axis: one 256-bit register of single-precision values.
/// The outermost two stand where the node's content begins and ends, so that
/// they cut off empty space.
const PLANES: usize = 8;

/// Nodes with more references than this are searched by a sample of about
/// this many: the error of a count, about its square root, moves the chosen
/// plane by less than the distance between candidates.
const SAMPLE: usize = 1024;

/// A value for each candidate plane of each axis.
type Lanes<T> = [[T; PLANES]; 3];

/// A plane that splits a node.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct SplitCandidate {
    pub(super) axis: usize,
    pub(super) position: f32,
}

/// The best plane for a node of `references` in `cell`, if any plane costs
/// less than a leaf. Each reference stands for `weight` triangles.
#[inline(always)]
pub(super) fn find_split(
    references: &[Reference],
    cell: &Aabb,
    cost: &CostModel,
    weight: u32,
) -> Option<SplitCandidate> {
    let count = references.len() as u32 * weight;
    let content = content_bounds(references, cell);
    let planes = spaced_planes(&content);
    let leaf_cost = cost.leaf(count);
    let counts = if leaf_cost <= cost.traversal + cost.intersection {
        // Two filled sides cost at least this much, wherever the plane: only
        // cutting off empty space can help.
        SideCounts::of_empty_space(count)
    } else {
        let stride = references.len().div_ceil(SAMPLE).max(1);
        let scale = count as f32 / references.len().div_ceil(stride) as f32;
        SideCounts::of(references, stride, &planes).scaled(scale)
    };
    cheapest(cell, cost, &planes, &counts, leaf_cost)
}

/// Whether a reference belongs to the left of the plane. Every reference
/// belongs to one side at least; one that lies in the plane goes left.
#[inline(always)]
pub(super) fn overlaps_left(reference: &Reference, axis: usize, position: f32) -> bool {
    (reference.min[axis] < position) | (reference.max[axis] <= position)
}

/// Whether a reference belongs to the right of the plane.
#[inline(always)]
pub(super) fn overlaps_right(reference: &Reference, axis: usize, position: f32) -> bool {
    reference.max[axis] > position
}

/// The part of the cell that references take up.
#[inline(always)]
fn content_bounds(references: &[Reference], cell: &Aabb) -> Aabb {
    let mut content = bounds_of(references);
    for axis in 0..3 {
        content.min[axis] = content.min[axis].max(cell.min[axis]);
        content.max[axis] = content.max[axis].min(cell.max[axis]);
    }
    content
}

/// Planes at equal distances from one end of the content to the other.
#[inline(always)]
fn spaced_planes(content: &Aabb) -> Lanes<f32> {
    let mut planes = [[0.0; PLANES]; 3];
    for axis in 0..3 {
        let (min, max) = (content.min[axis], content.max[axis]);
        let step = (max - min) * (1.0 / (PLANES - 1) as f32);
        for plane in 0..PLANES {
            planes[axis][plane] = min + step * plane as f32;
        }
        // Exact, whatever the rounding of the step.
        planes[axis][PLANES - 1] = max;
    }
    planes
}

/// For each plane the number of triangles that begin below and that end above it.
struct SideCounts {
    left: Lanes<u32>,
    right: Lanes<u32>,
}

impl SideCounts {
    /// Counts for the two outermost planes, known without counting; all other
    /// planes are given counts that rule them out.
    #[inline(always)]
    fn of_empty_space(count: u32) -> Self {
        let mut left = [[count; PLANES]; 3];
        let mut right = [[count; PLANES]; 3];
        for axis in 0..3 {
            left[axis][0] = 0;
            right[axis][PLANES - 1] = 0;
        }
        Self { left, right }
    }

    /// Counts over every `stride`th reference.
    #[inline(always)]
    fn of(references: &[Reference], stride: usize, planes: &Lanes<f32>) -> Self {
        let mut left = [[0; PLANES]; 3];
        let mut right = [[0; PLANES]; 3];
        for reference in references.iter().step_by(stride) {
            for axis in 0..3 {
                let (min, max) = (reference.min[axis], reference.max[axis]);
                for plane in 0..PLANES {
                    left[axis][plane] += u32::from(min < planes[axis][plane]);
                    right[axis][plane] += u32::from(max > planes[axis][plane]);
                }
            }
        }
        Self { left, right }
    }

    /// Counts times `scale`, rounded down.
    #[inline(always)]
    fn scaled(mut self, scale: f32) -> Self {
        if scale != 1.0 {
            for side in [&mut self.left, &mut self.right] {
                for count in side.as_flattened_mut() {
                    *count = (*count as f32 * scale) as u32;
                }
            }
        }
        self
    }
}

/// The plane at which a split of the cell costs least, if that is below `limit`.
#[inline(always)]
fn cheapest(
    cell: &Aabb,
    cost: &CostModel,
    planes: &Lanes<f32>,
    counts: &SideCounts,
    limit: f32,
) -> Option<SplitCandidate> {
    let [x, y, z] = cell.extent();
    let inverse_area = cell.half_area().recip();
    // The area of a side grows linearly with its length: the faces across the axis and the
    // circumference along it, as shares of the cell's area.
    let faces = [
        y * z * inverse_area,
        z * x * inverse_area,
        x * y * inverse_area,
    ];
    let slopes = [
        (y + z) * inverse_area,
        (z + x) * inverse_area,
        (x + y) * inverse_area,
    ];
    // First across the axes, all planes at once, then along the planes.
    let mut lowest = [limit; PLANES];
    let mut lowest_axis = [0u32; PLANES];
    for axis in 0..3 {
        let (min, max) = (cell.min[axis], cell.max[axis]);
        for plane in 0..PLANES {
            let position = planes[axis][plane];
            let left = faces[axis] + slopes[axis] * (position - min);
            let right = faces[axis] + slopes[axis] * (max - position);
            let split = cost.split(
                (left, counts.left[axis][plane]),
                (right, counts.right[axis][plane]),
            );
            // A plane on the cell's border would leave a side as it is.
            let better = (split < lowest[plane]) & (position > min) & (position < max);
            lowest[plane] = if better { split } else { lowest[plane] };
            lowest_axis[plane] = if better {
                axis as u32
            } else {
                lowest_axis[plane]
            };
        }
    }
    let mut best = 0;
    for plane in 1..PLANES {
        best = if lowest[plane] < lowest[best] {
            plane
        } else {
            best
        };
    }
    if !(lowest[best] < limit) {
        return None;
    }
    let axis = lowest_axis[best] as usize;
    Some(SplitCandidate {
        axis,
        position: planes[axis][best],
    })
}
