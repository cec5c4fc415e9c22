//! The search for a node's split plane among evenly spaced candidates.
//!
//! Equal to binning (Shevtsov et al. 2007) with counts taken directly: a
//! reference begins below a plane or ends above it, and eight planes are
//! compared with its box at once. Eight counters in a register beat the
//! memory traffic of bins, and few planes suffice: between two of them the
//! cost of a node of many triangles hardly changes, and in small nodes eight
//! planes leave few triangles between them.

use fearless_simd::prelude::*;
use fearless_simd::{f32x8, mask32x8, u32x8};

use super::references::{Reference, bounds_of_lanes};
use crate::{Aabb, CostModel};

/// Candidate planes an axis: one 256-bit register of single-precision values.
/// The outermost two stand where the node's content begins and ends, so that
/// they cut off empty space.
const PLANES: usize = 8;

/// How far along the content each plane stands.
const PLACES: [f32; PLANES] = {
    let mut places = [0.0; PLANES];
    let mut plane = 0;
    while plane < PLANES {
        places[plane] = plane as f32 / (PLANES - 1) as f32;
        plane += 1;
    }
    places
};

/// Nodes with more references than this are searched by a sample of about
/// this many: the error of a count, about its square root, moves the chosen
/// plane by less than the distance between candidates.
const SAMPLE: usize = 1024;

/// A plane that splits a node.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct SplitCandidate {
    pub(super) axis: usize,
    pub(super) position: f32,
}

/// The best plane for a node of `references` in `cell`, if any plane costs
/// less than a leaf. Each reference stands for `weight` triangles.
#[inline(always)]
pub(super) fn find_split<S: Simd>(
    simd: S,
    references: &[Reference],
    cell: &Aabb,
    cost: &CostModel,
    weight: u32,
) -> Option<SplitCandidate> {
    let count = references.len() as u32 * weight;
    let content = content_bounds(simd, references, cell);
    let planes = [
        spaced_planes(simd, content.min[0], content.max[0]),
        spaced_planes(simd, content.min[1], content.max[1]),
        spaced_planes(simd, content.min[2], content.max[2]),
    ];
    let leaf_cost = cost.leaf(count);
    let counts = if leaf_cost <= cost.traversal + cost.intersection {
        // Two filled sides cost at least this much, wherever the plane: only
        // cutting off empty space can help.
        SideCounts::of_empty_space(simd, count)
    } else {
        let stride = references.len().div_ceil(SAMPLE).max(1);
        let scale = count as f32 / references.len().div_ceil(stride) as f32;
        SideCounts::of(simd, references, stride, &planes).scaled(scale)
    };
    cheapest(simd, cell, cost, &planes, &counts, leaf_cost)
}

/// The part of the cell that references take up.
#[inline(always)]
fn content_bounds<S: Simd>(simd: S, references: &[Reference], cell: &Aabb) -> Aabb {
    let mut content = bounds_of_lanes(simd, references);
    for axis in 0..3 {
        content.min[axis] = content.min[axis].max(cell.min[axis]);
        content.max[axis] = content.max[axis].min(cell.max[axis]);
    }
    content
}

/// Planes at equal distances from one end of the content to the other.
#[inline(always)]
fn spaced_planes<S: Simd>(simd: S, min: f32, max: f32) -> f32x8<S> {
    let planes = f32x8::simd_from(simd, PLACES) * (max - min) + min;
    // The last one exactly, whatever the rounding.
    let last = mask32x8::from_bitmask(simd, 1 << (PLANES - 1));
    last.select(f32x8::splat(simd, max), planes)
}

/// For each plane of each axis the number of triangles that begin below and
/// that end above it.
struct SideCounts<S: Simd> {
    left: [u32x8<S>; 3],
    right: [u32x8<S>; 3],
}

impl<S: Simd> SideCounts<S> {
    /// Counts for the two outermost planes, known without counting; all other
    /// planes are given counts that rule them out.
    #[inline(always)]
    fn of_empty_space(simd: S, count: u32) -> Self {
        let mut first = [count; PLANES];
        first[0] = 0;
        let mut last = [count; PLANES];
        last[PLANES - 1] = 0;
        Self {
            left: [u32x8::simd_from(simd, first); 3],
            right: [u32x8::simd_from(simd, last); 3],
        }
    }

    /// Counts over every `stride`th reference.
    #[inline(always)]
    fn of(simd: S, references: &[Reference], stride: usize, planes: &[f32x8<S>; 3]) -> Self {
        let zero = u32x8::splat(simd, 0);
        let (mut left, mut right) = ([zero; 3], [zero; 3]);
        for reference in references.iter().step_by(stride) {
            for axis in 0..3 {
                let begins = planes[axis].simd_gt(reference.min[axis]);
                let ends = planes[axis].simd_lt(reference.max[axis]);
                left[axis] = begins.select(left[axis] + 1, left[axis]);
                right[axis] = ends.select(right[axis] + 1, right[axis]);
            }
        }
        Self { left, right }
    }

    /// Counts times `scale`, rounded down.
    #[inline(always)]
    fn scaled(mut self, scale: f32) -> Self {
        if scale != 1.0 {
            for counts in self.left.iter_mut().chain(&mut self.right) {
                *counts = u32x8::truncate_from(f32x8::float_from(*counts) * scale);
            }
        }
        self
    }
}

/// The plane at which a split of the cell costs least, if that is below `limit`.
#[inline(always)]
fn cheapest<S: Simd>(
    simd: S,
    cell: &Aabb,
    cost: &CostModel,
    planes: &[f32x8<S>; 3],
    counts: &SideCounts<S>,
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
    let mut lowest = f32x8::splat(simd, limit);
    let mut lowest_axis = u32x8::splat(simd, 0);
    for axis in 0..3 {
        let (min, max) = (cell.min[axis], cell.max[axis]);
        let position = planes[axis];
        let left = (position - min) * slopes[axis] + faces[axis];
        let right = (max - position) * slopes[axis] + faces[axis];
        let split = cost.split_lanes((left, counts.left[axis]), (right, counts.right[axis]));
        // A plane on the cell's border would leave a side as it is.
        let divides = position.simd_gt(min) & position.simd_lt(max);
        let better = split.simd_lt(lowest) & divides;
        lowest = better.select(split, lowest);
        lowest_axis = better.select(u32x8::splat(simd, axis as u32), lowest_axis);
    }
    let lowest: [f32; PLANES] = lowest.into();
    let lowest_axis: [u32; PLANES] = lowest_axis.into();
    let mut best = 0;
    for plane in 1..PLANES {
        best = if lowest[plane] < lowest[best] {
            plane
        } else {
            best
        };
    }
    (lowest[best] < limit).then(|| {
        let axis = lowest_axis[best] as usize;
        let positions: [f32; PLANES] = planes[axis].into();
        SplitCandidate {
            axis,
            // Never -0, which instruction sets treat differently when they look for minima.
            position: positions[best] + 0.0,
        }
    })
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::simd::{Kernel, dispatch};

    struct Search<'a>(&'a [Reference], Aabb, CostModel);

    impl Kernel for Search<'_> {
        type Output = Option<SplitCandidate>;

        #[inline(always)]
        fn run<S: Simd>(self, simd: S) -> Self::Output {
            find_split(simd, self.0, &self.1, &self.2, 1)
        }
    }

    /// What a split costs by the scalar formula and a count of every reference.
    fn cost_of(
        split: SplitCandidate,
        references: &[Reference],
        cell: &Aabb,
        cost: &CostModel,
    ) -> f32 {
        let SplitCandidate { axis, position } = split;
        let left = references.iter().filter(|r| r.min[axis] < position).count();
        let right = references.iter().filter(|r| r.max[axis] > position).count();
        let (left_cell, right_cell) = cell.split(axis, position);
        cost.split(
            (left_cell.half_area() / cell.half_area(), left as u32),
            (right_cell.half_area() / cell.half_area(), right as u32),
        )
    }

    fn references() -> impl Strategy<Value = Vec<Reference>> {
        let coordinate = || prop_oneof![(0..=8).prop_map(|x| x as f32 / 8.0), 0.0_f32..1.0];
        let corners = prop::array::uniform3(prop::array::uniform3(coordinate()));
        prop::collection::vec(corners, 1..200).prop_map(|triangles| {
            (0..)
                .zip(triangles)
                .map(|(index, corners)| Reference::of_triangle(corners, index))
                .collect()
        })
    }

    proptest! {
        #[test]
        fn no_candidate_is_cheaper(
            references in references(),
            intersection in prop_oneof![Just(0.3_f32), Just(1.0), Just(4.0)],
            leaf_width in prop_oneof![Just(1_u32), Just(8)],
            empty_bonus in prop_oneof![Just(0.0_f32), Just(0.3)],
        ) {
            let cost = CostModel { traversal: 1.0, intersection, leaf_width, empty_bonus };
            let cell = Aabb { min: [-0.25, 0.0, 0.25], max: [1.0, 1.5, 0.75] };
            let leaf_cost = cost.leaf(references.len() as u32);
            let content = Aabb {
                min: [0, 1, 2].map(|k| references.iter().map(|r| r.min[k]).fold(9.0, f32::min).max(cell.min[k])),
                max: [0, 1, 2].map(|k| references.iter().map(|r| r.max[k]).fold(-9.0, f32::max).min(cell.max[k])),
            };
            let cheapest = (0..3)
                .flat_map(|axis| PLACES.map(|place| (axis, place)))
                .map(|(axis, place)| SplitCandidate {
                    axis,
                    position: if place == 1.0 {
                        content.max[axis]
                    } else {
                        place * (content.max[axis] - content.min[axis]) + content.min[axis]
                    },
                })
                .filter(|s| s.position > cell.min[s.axis] && s.position < cell.max[s.axis])
                .map(|split| cost_of(split, &references, &cell, &cost))
                .fold(leaf_cost, f32::min);
            let found = dispatch(Search(&references, cell, cost));
            let found_cost = found.map_or(leaf_cost, |split| cost_of(split, &references, &cell, &cost));
            prop_assert!((found_cost - cheapest).abs() <= 1e-5 * cheapest, "{found_cost} {cheapest} {found:?}");
            if let Some(split) = found {
                prop_assert!(split.position > cell.min[split.axis] && split.position < cell.max[split.axis]);
            }
        }
    }

    #[test]
    fn empty_space_is_cut_off_at_the_content() {
        let references = [Reference::of_triangle(
            [[0.9, 0.0, 0.0], [1.0, 1.0, 0.0], [1.0, 0.0, 1.0]],
            0,
        )];
        let cell = Aabb {
            min: [0.0; 3],
            max: [1.0; 3],
        };
        let cost = CostModel {
            intersection: 10.0,
            ..CostModel::default()
        };
        let split = dispatch(Search(&references, cell, cost));
        assert_eq!(
            split,
            Some(SplitCandidate {
                axis: 0,
                position: 0.9
            })
        );
    }

    #[test]
    fn nothing_divides_a_flat_cell_across() {
        let corners = [[0.0, 0.0, 0.5], [1.0, 0.0, 0.5], [0.0, 1.0, 0.5]];
        let references: Vec<_> = (0..100)
            .map(|index| Reference::of_triangle(corners, index))
            .collect();
        let cell = Aabb {
            min: [0.0, 0.0, 0.5],
            max: [1.0, 1.0, 0.5],
        };
        assert_eq!(
            dispatch(Search(&references, cell, CostModel::default())),
            None
        );
        let point = Aabb {
            min: [0.5; 3],
            max: [0.5; 3],
        };
        assert_eq!(
            dispatch(Search(&references, point, CostModel::default())),
            None
        );
    }
}
