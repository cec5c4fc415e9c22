//! The search build of Hussain & Grahn 2008 (their "normal" build, the method
//! of their 2007 paper): at every node the SAH cost is minimised along an axis
//! by golden section search with parabolic interpolation ([`LineSearch`]), from
//! the extremes of the node. Each evaluation is a counting pass over the node's references.
//!
//! Where a tree of the frame before is at hand ([`History`]), nodes that were
//! tracked are searched from their predicted plane instead ([`super::running`]).
//!
//! As in the paper, what straddles a plane goes to both sides with its whole
//! box. Two planes need no counting: those where the node's content begins and ends, which
//! cut off empty space.

use std::fmt;
use std::str::FromStr;

use fearless_simd::prelude::*;

use super::cell_areas::CellAreas;
use super::counts::{count_on_all_axes, count_sides, count_three};
use super::descent::{self, NodeStart, Split, SplitCandidate, SplitPolicy};
use super::limits::Limits;
use super::line_search::{GOLDEN, LineSearch, Sample, Stop};
use super::references::{bounds_of, content_bounds};
use super::running::{History, Lost, Neighbourhood, NodeRecord, Tracked};
use super::{BuildOptions, Reference, Subtree, Triangles};
use crate::aabb::lower;
use crate::{Aabb, CostModel, OptionsError};

/// How a searching builder finds the axis of a split (`OptSplitOrient` of Hussain &
/// Grahn 2008, Algorithm 2).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum Orientation {
    /// Searches all three axes and takes the best.
    #[default]
    AllAxes,
    /// Makes the first two golden section evaluations on each axis, and goes on with the
    /// axis of the lowest one. If none of them is below the cost of a leaf, nothing is split.
    Probes,
    /// Takes the longest side of the box around the node's content.
    Longest,
}

impl Orientation {
    /// Every way to find an axis.
    pub const ALL: &'static [Self] = &[Self::AllAxes, Self::Probes, Self::Longest];

    /// The name used on command lines and in tables.
    pub fn name(self) -> &'static str {
        match self {
            Self::AllAxes => "all-axes",
            Self::Probes => "probes",
            Self::Longest => "longest",
        }
    }
}

impl fmt::Display for Orientation {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

/// A name that no [`Orientation`] has.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("no orientation is called '{name}', expected one of: {}", Orientation::ALL.iter().map(|o| o.name()).collect::<Vec<_>>().join(", "))]
pub struct ParseOrientationError {
    /// The name that was asked for.
    pub name: String,
}

impl FromStr for Orientation {
    type Err = ParseOrientationError;

    fn from_str(name: &str) -> Result<Self, Self::Err> {
        Self::ALL
            .iter()
            .copied()
            .find(|orientation| orientation.name() == name)
            .ok_or_else(|| ParseOrientationError { name: name.into() })
    }
}

/// How planes are searched from the extremes of a node, by the builders
/// `search`, `kalman` and `wiener`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SearchOptions {
    /// How the axis is found.
    pub orientation: Orientation,
    /// Where a search ends, as a share of the node's extent, above 0 and at
    /// most 0.5. The default is √ε of single precision, the textbook's choice; higher
    /// values build faster and find planes less exactly.
    pub tolerance: f32,
    /// Cost evaluations on one axis, at least 1, after which a search ends in any case.
    pub max_evaluations: u32,
}

impl Default for SearchOptions {
    fn default() -> Self {
        Self {
            orientation: Orientation::AllAxes,
            tolerance: 3.452_67e-4,
            max_evaluations: 40,
        }
    }
}

impl SearchOptions {
    pub(super) fn validate(&self) -> Result<(), OptionsError> {
        let Self {
            tolerance,
            max_evaluations,
            ..
        } = *self;
        if !(tolerance > 0.0 && tolerance <= 0.5) {
            return Err(OptionsError::OutOfRange {
                field: "search.tolerance",
                value: tolerance,
                expected: "above 0 and at most 0.5",
            });
        }
        if max_evaluations == 0 {
            return Err(OptionsError::OutOfRange {
                field: "search.max_evaluations",
                value: 0.0,
                expected: "at least 1",
            });
        }
        Ok(())
    }
}

/// Builds a subtree over `triangles`, from the extremes or with what a
/// `history` predicts; gives it with the box around them and a record for each node.
/// `references` is working memory.
pub(super) fn build(
    triangles: &Triangles<'_>,
    limits: Limits,
    options: &BuildOptions,
    history: Option<History<'_>>,
    references: &mut Vec<Reference>,
) -> (Subtree, Aabb, Vec<NodeRecord>) {
    triangles.references_into(references);
    let bounds = bounds_of(references);
    let root = NodeStart {
        cell: bounds,
        limits,
        place: Place {
            tracked: history.and_then(|history| history.root()),
            depth: 0,
        },
    };
    let mut search = Search {
        options,
        history,
        records: Vec::with_capacity(references.len() / 4),
    };
    let subtree = descent::build_parallel(&mut search, triangles.mesh(), references, root);
    (subtree, bounds, search.records)
}

/// What is known of a node before it is searched.
#[derive(Clone, Copy)]
struct Place {
    /// The node of the history that stood here.
    tracked: Option<u32>,
    depth: u32,
}

/// The policy: search, and keep a record of it.
struct Search<'a> {
    options: &'a BuildOptions,
    history: Option<History<'a>>,
    records: Vec<NodeRecord>,
}

impl SplitPolicy for Search<'_> {
    type Place = Place;

    const CUTS: bool = false;

    #[inline(always)]
    fn choose<S: Simd>(
        &mut self,
        simd: S,
        members: &[Reference],
        cell: &Aabb,
        limits: &Limits,
        place: Place,
    ) -> Option<Split<Place>> {
        let count = members.len();
        let mut record = NodeRecord::new(count as u32, place.depth);
        if !limits.allow_any(count, self.options.min_split as usize) {
            self.records.push(record);
            return None;
        }
        let tracked = match (&self.history, place.tracked) {
            (Some(history), Some(node)) => Some(history.node(node)),
            _ => None,
        };
        let mut node = NodeSearch::new(simd, members, cell, &self.options.cost);
        let plane = self.find_split(&mut node, tracked, &mut record);
        record.evaluations = node.evaluations;
        if let Some(SplitCandidate { axis, .. }) = plane {
            record.cell_extent = cell.max[axis] - cell.min[axis];
        }
        self.records.push(record);
        let (left, right) = match tracked {
            Some(tracked) => tracked.children(),
            None => (None, None),
        };
        let depth = place.depth + 1;
        Some(Split {
            plane: plane?,
            left: Place {
                tracked: left,
                depth,
            },
            right: Place {
                tracked: right,
                depth,
            },
        })
    }

    fn fork(&self) -> Self {
        Self {
            options: self.options,
            history: self.history,
            records: Vec::new(),
        }
    }

    fn absorb(&mut self, other: Self) {
        self.records.extend_from_slice(&other.records);
    }
}

impl Search<'_> {
    /// The plane of a node, from its prediction where that serves.
    #[inline(always)]
    fn find_split<S: Simd>(
        &self,
        node: &mut NodeSearch<'_, S>,
        tracked: Option<Tracked>,
        record: &mut NodeRecord,
    ) -> Option<SplitCandidate> {
        let BuildOptions {
            cost,
            search,
            tracking,
            ..
        } = self.options;
        // Two filled sides cost at least this much, wherever the plane: only
        // cutting off empty space can help.
        let least_cost = cost.traversal + cost.intersection;
        let hopeless = node.leaf_cost <= least_cost;
        // A leaf that has not grown stays one, if it is so small that a split can save little.
        // A large one may have been a heap in which no plane paid, and have come apart since.
        if let Some(Tracked::Leaf { searched_at }) = tracked
            && (hopeless || (node.count <= searched_at && node.leaf_cost <= 2.0 * least_cost))
        {
            record.references = searched_at;
            return None;
        }
        // Where the split is tracked: its history, and the planes around its prediction.
        let mut near = None;
        let mut lost = None;
        if let Some(Tracked::Split(split)) = tracked
            && !hopeless
        {
            record.predicted = split.predicted;
            near = Neighbourhood::of_prediction(node, &split, tracking);
            lost = Some((split, Lost::Outside));
            if let Some(neighbourhood) = near {
                let expected = split.cost_share * node.leaf_cost;
                if neighbourhood.lowest_cost() <= tracking.drift * expected {
                    let found = neighbourhood.search(node, tracking);
                    if found.cost < node.leaf_cost {
                        let cost_share = lower(split.cost_share, found.cost / node.leaf_cost);
                        record.follow(&split, cost_share);
                        return Some(plane(split.axis, found));
                    }
                }
                lost = Some((split, Lost::Drifted));
            }
        }

        let content = content_bounds(node.simd, node.members, node.cell);
        let ends = node.ends(&content);
        if let Some(Tracked::EmptySpace { axis, end, split }) = tracked {
            let again = ends[axis][end];
            record.predicted = split.predicted;
            if again.cost < node.leaf_cost {
                record.cut_again(&split, end, again.cost / node.leaf_cost);
                return Some(plane(axis, again));
            }
            lost = Some((split, Lost::Drifted));
        }
        let mut best = Best::below(node.leaf_cost);
        for axis in 0..3 {
            best.take(axis, Some(ends[axis][0]));
            best.take(axis, Some(ends[axis][1]));
        }
        let orientation = if self.history.is_some() {
            tracking.orientation
        } else {
            search.orientation
        };
        match orientation {
            _ if hopeless => {}
            Orientation::AllAxes => {
                for axis in 0..3 {
                    let found = node.search_axis(&content, axis, ends[axis], &[], search);
                    best.take(axis, found);
                }
            }
            Orientation::Longest => {
                let axis = longest(content.extent());
                let found = node.search_axis(&content, axis, ends[axis], &[], search);
                best.take(axis, found);
            }
            Orientation::Probes => {
                let probes = node.probe(&content);
                let mut axis = 0;
                for other in 1..3 {
                    if lower_cost(&probes[other]) < lower_cost(&probes[axis]) {
                        axis = other;
                    }
                }
                let lowest = lower_cost(&probes[axis]);
                if let (Some(neighbourhood), Some((split, _))) = (near, lost)
                    && neighbourhood.lowest_cost() <= lowest
                {
                    // The orientation is still the same.
                    let found = neighbourhood.search(node, tracking);
                    if found.cost < best.limit {
                        record.follow(&split, found.cost / node.leaf_cost);
                        return Some(plane(split.axis, found));
                    }
                } else if lowest < node.leaf_cost {
                    let ends = ends[axis];
                    let found = node.search_axis(&content, axis, ends, &probes[axis], search);
                    best.take(axis, found);
                }
            }
        }
        let (axis, found) = best.plane?;
        record.settle(node.leaf_cost, axis, found, content.extent()[axis], lost);
        Some(plane(axis, found))
    }
}

#[inline(always)]
fn plane(axis: usize, sample: Sample) -> SplitCandidate {
    SplitCandidate {
        axis,
        // Never -0, which instruction sets treat differently when they look for minima.
        position: sample.position + 0.0,
    }
}

#[inline(always)]
fn longest(extent: [f32; 3]) -> usize {
    let mut axis = 0;
    for other in 1..3 {
        if extent[other] > extent[axis] {
            axis = other;
        }
    }
    axis
}

#[inline(always)]
fn lower_cost([a, b]: &[Sample; 2]) -> f32 {
    lower(a.cost, b.cost)
}

/// The best plane so far that costs less than a limit.
struct Best {
    limit: f32,
    plane: Option<(usize, Sample)>,
}

impl Best {
    #[inline(always)]
    fn below(limit: f32) -> Self {
        Self { limit, plane: None }
    }

    #[inline(always)]
    fn take(&mut self, axis: usize, sample: Option<Sample>) {
        if let Some(sample) = sample
            && sample.cost < self.limit
        {
            self.limit = sample.cost;
            self.plane = Some((axis, sample));
        }
    }
}

/// A node while it is searched.
pub(super) struct NodeSearch<'a, S: Simd> {
    pub(super) simd: S,
    pub(super) members: &'a [Reference],
    pub(super) cell: &'a Aabb,
    pub(super) count: u32,
    pub(super) leaf_cost: f32,
    cost: &'a CostModel,
    areas: CellAreas<'a>,
    /// Planes counted so far.
    evaluations: u32,
}

impl<'a, S: Simd> NodeSearch<'a, S> {
    #[inline(always)]
    fn new(simd: S, members: &'a [Reference], cell: &'a Aabb, cost: &'a CostModel) -> Self {
        let count = members.len() as u32;
        Self {
            simd,
            members,
            cell,
            count,
            leaf_cost: cost.leaf(count),
            cost,
            areas: CellAreas::new(cell),
            evaluations: 0,
        }
    }

    /// Counts the sides of a plane.
    #[inline(always)]
    pub(super) fn evaluate(&mut self, axis: usize, position: f32) -> Sample {
        self.evaluations += 1;
        let counts = count_sides(self.simd, self.members, axis, position);
        self.sample(axis, position, counts)
    }

    /// Counts the sides of three planes on an axis in one pass.
    #[inline(always)]
    pub(super) fn evaluate_three(&mut self, axis: usize, positions: [f32; 3]) -> [Sample; 3] {
        self.evaluations += 3;
        let counts = count_three(self.simd, self.members, axis, positions);
        let mut samples = [Sample::ZERO; 3];
        for plane in 0..3 {
            samples[plane] = self.sample(axis, positions[plane], counts[plane]);
        }
        samples
    }

    #[inline(always)]
    fn sample(&self, axis: usize, position: f32, counts: [u32; 2]) -> Sample {
        Sample {
            position,
            cost: self.areas.split_cost(axis, self.cost, position, counts),
            counts,
        }
    }

    /// The planes just outside the content, below and above, which need no counting. (What lies
    /// in a plane would be counted on neither side.)
    #[inline(always)]
    fn ends(&self, content: &Aabb) -> [[Sample; 2]; 3] {
        let mut ends = [[Sample::ZERO; 2]; 3];
        for axis in 0..3 {
            let (min, max) = (content.min[axis].next_down(), content.max[axis].next_up());
            ends[axis] = [
                self.sample(axis, min, [0, self.count]),
                self.sample(axis, max, [self.count, 0]),
            ];
        }
        ends
    }

    /// The first two golden section evaluations on each axis.
    #[inline(always)]
    fn probe(&mut self, content: &Aabb) -> [[Sample; 2]; 3] {
        self.evaluations += 6;
        let mut positions = [[0.0; 3]; 2];
        for axis in 0..3 {
            let (min, max) = (content.min[axis], content.max[axis]);
            positions[0][axis] = min + GOLDEN * (max - min);
            positions[1][axis] = max - GOLDEN * (max - min);
        }
        let counts = count_on_all_axes(self.simd, self.members, positions);
        let mut samples = [[Sample::ZERO; 2]; 3];
        for axis in 0..3 {
            for probe in 0..2 {
                let (position, counts) = (positions[probe][axis], counts[probe][axis]);
                samples[axis][probe] = self.sample(axis, position, counts);
            }
        }
        samples
    }

    /// Searches an axis from end to end, but for evaluations that are known already.
    #[inline(always)]
    fn search_axis(
        &mut self,
        content: &Aabb,
        axis: usize,
        [low, high]: [Sample; 2],
        known: &[Sample],
        options: &SearchOptions,
    ) -> Option<Sample> {
        let extent = content.max[axis] - content.min[axis];
        let stop = Stop {
            tolerance: (options.tolerance * extent).max(f32::MIN_POSITIVE),
            budget: options.max_evaluations,
        };
        let mut search = LineSearch::between(low, high, stop);
        for &sample in known {
            search.tell(sample);
        }
        while let Some(position) = search.propose() {
            search.tell(self.evaluate(axis, position));
        }
        search.best()
    }
}
