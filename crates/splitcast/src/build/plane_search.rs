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

use super::cell_areas::CellAreas;
use super::descent::SplitCandidate;
use super::references::{Reference, content_bounds};
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

/// Nodes with more references than this look again for a better plane between
/// the neighbours of the best. Most of what that gains is gained near the root;
/// in small nodes few triangles lie between two planes.
const REFINED: usize = 128;

/// Where the second search puts its planes around the best of the first, in
/// distances between planes of the first.
const REFINED_PLACES: [f32; PLANES] = [
    -8.0 / 9.0,
    -6.0 / 9.0,
    -4.0 / 9.0,
    -2.0 / 9.0,
    2.0 / 9.0,
    4.0 / 9.0,
    6.0 / 9.0,
    8.0 / 9.0,
];

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
    let areas = CellAreas::new(cell);
    let leaf_cost = cost.leaf(count);
    if leaf_cost <= cost.traversal + cost.intersection {
        // Two filled sides cost at least this much, wherever the plane: only
        // cutting off empty space can help.
        let counts = SideCounts::of_empty_space(simd, count);
        return cheapest(simd, &areas, cost, &planes, &counts, leaf_cost).map(|best| best.split);
    }
    let stride = references.len().div_ceil(SAMPLE).max(1);
    let scale = count as f32 / references.len().div_ceil(stride) as f32;
    let counts = SideCounts::of(simd, references, stride, &planes).scaled(scale);
    let best = cheapest(simd, &areas, cost, &planes, &counts, leaf_cost)?;
    if references.len() <= REFINED {
        return Some(best.split);
    }
    let axis = best.split.axis;
    let step = (content.max[axis] - content.min[axis]) / (PLANES - 1) as f32;
    let planes = f32x8::simd_from(simd, REFINED_PLACES) * step + best.split.position;
    let zero = f32x8::splat(simd, 0.0);
    let (mut left, mut right) = (zero, zero);
    for reference in references.iter().step_by(stride) {
        tally(reference, axis, planes, &mut left, &mut right);
    }
    let costs = areas.split_costs(
        axis,
        cost,
        planes,
        (left * scale).floor(),
        (right * scale).floor(),
    );
    let (costs, planes): ([f32; PLANES], [f32; PLANES]) = (costs.into(), planes.into());
    let mut refined = best;
    for plane in 0..PLANES {
        if costs[plane] < refined.cost {
            refined.cost = costs[plane];
            refined.split.position = planes[plane] + 0.0;
        }
    }
    Some(refined.split)
}

/// Planes at equal distances from one end of the content to the other.
#[inline(always)]
fn spaced_planes<S: Simd>(simd: S, min: f32, max: f32) -> f32x8<S> {
    let planes = f32x8::simd_from(simd, PLACES) * (max - min) + min;
    // The outermost stand just outside the content, and so do all in flat content: what lies in a
    // plane would be counted on neither side.
    let planes = planes
        .simd_eq(min)
        .select(f32x8::splat(simd, min.next_down()), planes);
    let last = mask32x8::from_bitmask(simd, 1 << (PLANES - 1));
    last.select(f32x8::splat(simd, max.next_up()), planes)
}

/// For each plane of each axis the number of triangles that begin below and
/// that end above it. Whole numbers, in single precision, where adding to the
/// lanes that a comparison marks is one instruction.
struct SideCounts<S: Simd> {
    left: [f32x8<S>; 3],
    right: [f32x8<S>; 3],
}

impl<S: Simd> SideCounts<S> {
    /// Counts for the two outermost planes, known without counting; all other
    /// planes are given counts that rule them out.
    #[inline(always)]
    fn of_empty_space(simd: S, count: u32) -> Self {
        let mut first = [count as f32; PLANES];
        first[0] = 0.0;
        let mut last = [count as f32; PLANES];
        last[PLANES - 1] = 0.0;
        Self {
            left: [f32x8::simd_from(simd, first); 3],
            right: [f32x8::simd_from(simd, last); 3],
        }
    }

    /// Counts over every `stride`th reference.
    #[inline(always)]
    fn of(simd: S, references: &[Reference], stride: usize, planes: &[f32x8<S>; 3]) -> Self {
        let zero = f32x8::splat(simd, 0.0);
        let (mut left, mut right) = ([zero; 3], [zero; 3]);
        for reference in references.iter().step_by(stride) {
            for axis in 0..3 {
                tally(
                    reference,
                    axis,
                    planes[axis],
                    &mut left[axis],
                    &mut right[axis],
                );
            }
        }
        Self { left, right }
    }

    /// Counts times `scale`, rounded down.
    #[inline(always)]
    fn scaled(mut self, scale: f32) -> Self {
        if scale != 1.0 {
            for axis in 0..3 {
                self.left[axis] = (self.left[axis] * scale).floor();
                self.right[axis] = (self.right[axis] * scale).floor();
            }
        }
        self
    }
}

/// Counts a reference on the sides of each plane of an axis that it reaches.
#[inline(always)]
fn tally<S: Simd>(
    reference: &Reference,
    axis: usize,
    planes: f32x8<S>,
    left: &mut f32x8<S>,
    right: &mut f32x8<S>,
) {
    let begins = planes.simd_gt(reference.min[axis]);
    let ends = planes.simd_lt(reference.max[axis]);
    *left = begins.select(*left + 1.0, *left);
    *right = ends.select(*right + 1.0, *right);
}

/// A plane and what a split there costs.
#[derive(Clone, Copy)]
struct Best {
    split: SplitCandidate,
    cost: f32,
}

/// The plane at which a split costs least, if that is below `limit`.
#[inline(always)]
fn cheapest<S: Simd>(
    simd: S,
    areas: &CellAreas<'_>,
    cost: &CostModel,
    planes: &[f32x8<S>; 3],
    counts: &SideCounts<S>,
    limit: f32,
) -> Option<Best> {
    // First across the axes, all planes at once, then along the planes.
    let mut lowest = f32x8::splat(simd, limit);
    let mut lowest_axis = u32x8::splat(simd, 0);
    for axis in 0..3 {
        let costs = areas.split_costs(
            axis,
            cost,
            planes[axis],
            counts.left[axis],
            counts.right[axis],
        );
        let better = costs.simd_lt(lowest);
        lowest = better.select(costs, lowest);
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
        Best {
            split: SplitCandidate {
                axis,
                // Never -0, which instruction sets treat differently when they look for minima.
                position: positions[best] + 0.0,
            },
            cost: lowest[best],
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
        let left = references
            .iter()
            .filter(|r| r.min[axis] < position || r.max[axis] <= position)
            .count();
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
                    position: match place * (content.max[axis] - content.min[axis]) + content.min[axis] {
                        _ if place == 1.0 => content.max[axis].next_up(),
                        position if position == content.min[axis] => position.next_down(),
                        position => position,
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
                position: 0.9_f32.next_down()
            })
        );
    }

    #[test]
    fn a_wall_across_an_axis_is_cut_out_from_both_sides() {
        let corners = [[0.5, 0.0, 0.0], [0.5, 1.0, 0.0], [0.5, 0.0, 1.0]];
        let references: Vec<_> = (0..20)
            .map(|index| Reference::of_triangle(corners, index))
            .collect();
        let cost = CostModel {
            intersection: 10.0,
            ..CostModel::default()
        };
        let cell = Aabb {
            min: [0.0; 3],
            max: [1.0; 3],
        };
        let first = dispatch(Search(&references, cell, cost)).expect("half the cell is empty");
        assert_eq!((first.axis, first.position), (0, 0.5_f32.next_down()));
        let (_, rest) = cell.split(first.axis, first.position);
        let second = dispatch(Search(&references, rest, cost)).expect("nearly all is empty");
        assert_eq!((second.axis, second.position), (0, 0.5_f32.next_up()));
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
