//! The running build of Hussain & Grahn 2008 (Algorithm 2): where the tree of
//! the frame before had a split, the search starts at its predicted plane.
//!
//! The orientation of a split is looked into anew when its cost, against that of
//! a leaf, has risen since it was last searched from the extremes
//! ([`TrackingOptions::drift`]). Three evaluations around a good prediction
//! are all that is made; a bad one is left downhill in steps that grow by the golden ratio.

use fearless_simd::prelude::*;

use super::line_search::{LineSearch, Sample, Stop};
use super::search::{NodeSearch, Orientation};
use crate::OptionsError;
use crate::aabb::lower;
use crate::filter::{NEW_COMPONENT, NoiseParameters, WienerParameters};
use crate::kd_tree::{Node, NodeKind};

/// Factor by which steps grow that leave a bad prediction.
const GROWTH: f32 = 1.618_034;

/// Steps that are made downhill before a search gives up on its prediction's neighbourhood.
const MAX_STEPS: u32 = 6;

/// Evaluations that may follow once a minimum is bracketed.
const REFINEMENTS: u32 = 8;

/// What the state of a filter is when a split begins to be tracked.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum InitialState {
    /// The position that was found, as in the paper's conclusion ("load it with
    /// initial split plan locations").
    #[default]
    Loaded,
    /// 0, as printed in Algorithm 1: the first predictions lie between the
    /// origin and the plane.
    Zero,
}

/// How splits are tracked from frame to frame, by the builders `kalman` and
/// `wiener`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TrackingOptions {
    /// How running builds find an axis where they have to.
    pub orientation: Orientation,
    /// Distance of the first evaluations from the prediction, as a share of the node's
    /// extent, above 0 and at most 0.5.
    pub step: f32,
    /// Rise of a split's cost, relative to a leaf's, at which its orientation
    /// is looked into anew: a factor of at least 1. Lower values track the
    /// tree more closely and build slower.
    pub drift: f32,
    /// Share of the cost that a parabola has to promise for another evaluation,
    /// from 0 to 1.
    pub gain: f32,
    /// The filter's state when a split begins to be tracked.
    pub initial_state: InitialState,
    /// Noise of Algorithm 1.
    pub noise: NoiseParameters,
    /// Parameters of the builder `wiener`.
    pub wiener: WienerParameters,
}

impl Default for TrackingOptions {
    fn default() -> Self {
        Self {
            orientation: Orientation::Probes,
            step: 0.06,
            drift: 1.1,
            gain: 0.02,
            initial_state: InitialState::Loaded,
            noise: NoiseParameters::default(),
            wiener: WienerParameters::default(),
        }
    }
}

impl TrackingOptions {
    pub(super) fn validate(&self) -> Result<(), OptionsError> {
        let ranges = [
            (
                "tracking.step",
                self.step,
                self.step > 0.0 && self.step <= 0.5,
                "above 0 and at most 0.5",
            ),
            (
                "tracking.drift",
                self.drift,
                self.drift >= 1.0 && self.drift.is_finite(),
                "a finite number of at least 1",
            ),
            (
                "tracking.gain",
                self.gain,
                (0.0..=1.0).contains(&self.gain),
                "from 0 to 1",
            ),
        ];
        for (field, value, valid, expected) in ranges {
            if !valid {
                return Err(OptionsError::OutOfRange {
                    field,
                    value,
                    expected,
                });
            }
        }
        self.noise.validate()?;
        self.wiener.validate()?;
        Ok(())
    }
}

/// What became of a tracked split.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub enum Outcome {
    /// The search started at the prediction. (If the cost had risen, the axes
    /// were probed as well, and the prediction beat every probe.)
    Matched,
    /// The plane cuts off empty space, as it did before: it stands where the content ends,
    /// wherever it was expected, and takes no search.
    EmptySpace,
    /// The prediction was given up, since the split costs more than it did or nothing pays
    /// around it, and the node searched from its extremes; the axis is the same as before.
    Drifted,
    /// The node was searched from the extremes, and the axis has changed: the
    /// filter starts anew. The prediction is one for the axis before.
    Turned,
    /// The prediction does not divide the node (it lies outside of the cell, or has nothing on
    /// one side): searched from the extremes, with the same axis. The filter starts anew.
    Outside,
    /// No split stood here a frame before.
    Untracked,
}

/// One node of a build, in the order of the tree's nodes.
#[derive(Clone, Copy, Debug)]
pub(crate) struct NodeRecord {
    pub(crate) depth: u32,
    /// References of the node; of a leaf that was not searched again, those
    /// it had when it was last searched.
    pub(crate) references: u32,
    pub(crate) evaluations: u32,
    /// Where the plane was expected; NaN if it was not tracked.
    pub(crate) predicted: f32,
    /// Extent of the content on the split's axis when the node was last
    /// searched from its extremes.
    extent: f32,
    /// Extent of the cell on the split's axis.
    pub(crate) cell_extent: f32,
    /// Cost over the cost of a leaf, the lowest since the last search from the extremes.
    cost_share: f32,
    /// The filter's component in the frame before, or [`NEW_COMPONENT`].
    pub(crate) source: u32,
    pub(crate) outcome: Outcome,
    /// The empty side (0 or 1) of a plane just outside the content.
    empty_side: Option<u8>,
}

impl NodeRecord {
    /// A leaf that was not searched.
    #[inline(always)]
    pub(super) fn new(references: u32, depth: u32) -> Self {
        Self {
            depth,
            references,
            evaluations: 0,
            predicted: f32::NAN,
            extent: 0.0,
            cell_extent: 0.0,
            cost_share: 0.0,
            source: NEW_COMPONENT,
            outcome: Outcome::Untracked,
            empty_side: None,
        }
    }

    /// Writes down a split that was found from its prediction.
    #[inline(always)]
    pub(super) fn follow(&mut self, split: &TrackedSplit, cost_share: f32) {
        self.outcome = Outcome::Matched;
        self.source = split.component;
        self.extent = split.extent;
        self.cost_share = cost_share;
    }

    /// Writes down a plane that cuts off the same side as before.
    #[inline(always)]
    pub(super) fn cut_again(&mut self, split: &TrackedSplit, empty_side: usize, cost_share: f32) {
        self.follow(split, cost_share);
        self.outcome = Outcome::EmptySpace;
        self.empty_side = Some(empty_side as u8);
    }

    /// Writes down a split of a node whose content was looked at as a whole.
    #[inline(always)]
    pub(super) fn settle(
        &mut self,
        leaf_cost: f32,
        axis: usize,
        sample: Sample,
        extent: f32,
        lost: Option<(TrackedSplit, Lost)>,
    ) {
        self.extent = extent;
        self.cost_share = sample.cost / leaf_cost;
        self.empty_side = sample
            .counts
            .iter()
            .position(|&count| count == 0)
            .map(|side| side as u8);
        if let Some((split, lost)) = lost {
            self.outcome = match lost {
                _ if axis != split.axis => Outcome::Turned,
                Lost::Outside => Outcome::Outside,
                Lost::Drifted => Outcome::Drifted,
            };
            if self.outcome == Outcome::Drifted {
                self.source = split.component;
            }
        }
    }
}

/// The tree of the frame before, and where its planes are expected now.
#[derive(Clone, Copy)]
pub(crate) struct History<'a> {
    pub(crate) nodes: &'a [Node],
    pub(crate) records: &'a [NodeRecord],
    /// The filter's component of every inner node; anything for leaves.
    pub(crate) components: &'a [u32],
    /// Predicted positions, by component.
    pub(crate) predictions: &'a [f32],
}

/// What the history knows of a node.
#[derive(Clone, Copy)]
pub(super) enum Tracked {
    Split(TrackedSplit),
    /// A split that cut off empty space.
    EmptySpace {
        axis: usize,
        /// The end of the content that it stood at: 0 below, 1 above.
        end: usize,
        split: TrackedSplit,
    },
    Leaf {
        /// References of the leaf when it was last searched.
        searched_at: u32,
    },
}

/// A split of the frame before.
#[derive(Clone, Copy)]
pub(super) struct TrackedSplit {
    pub(super) axis: usize,
    pub(super) predicted: f32,
    extent: f32,
    pub(super) cost_share: f32,
    component: u32,
    left: u32,
    right: u32,
}

impl History<'_> {
    pub(super) fn root(&self) -> Option<u32> {
        (!self.nodes.is_empty()).then_some(0)
    }

    #[inline(always)]
    pub(super) fn node(&self, node: u32) -> Tracked {
        let index = node as usize;
        let record = &self.records[index];
        match self.nodes[index].kind() {
            NodeKind::Leaf { .. } => Tracked::Leaf {
                searched_at: record.references,
            },
            NodeKind::Inner { axis, right, .. } => {
                let component = self.components[index];
                let split = TrackedSplit {
                    axis,
                    predicted: self.predictions[component as usize],
                    extent: record.extent,
                    cost_share: record.cost_share,
                    component,
                    left: node + 1,
                    right: right as u32,
                };
                match record.empty_side {
                    None => Tracked::Split(split),
                    Some(end) => Tracked::EmptySpace {
                        axis,
                        end: usize::from(end),
                        split,
                    },
                }
            }
        }
    }
}

impl Tracked {
    /// The history of the children.
    #[inline(always)]
    pub(super) fn children(self) -> (Option<u32>, Option<u32>) {
        match self {
            Self::Split(split) | Self::EmptySpace { split, .. } => {
                (Some(split.left), Some(split.right))
            }
            Self::Leaf { .. } => (None, None),
        }
    }
}

/// What became of a prediction before a node was searched from its extremes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Lost {
    /// The split costs more than it did, or does not pay any more.
    Drifted,
    /// The prediction does not divide the node's content.
    Outside,
}

/// Three planes around a prediction.
#[derive(Clone, Copy)]
pub(super) struct Neighbourhood {
    axis: usize,
    low: Sample,
    middle: Sample,
    high: Sample,
    extent: f32,
    step: f32,
}

impl Neighbourhood {
    /// Evaluates the predicted plane of a node and one on either side; `None` if the
    /// prediction does not divide the node's content.
    #[inline(always)]
    pub(super) fn of_prediction<S: Simd>(
        node: &mut NodeSearch<'_, S>,
        split: &TrackedSplit,
        options: &TrackingOptions,
    ) -> Option<Self> {
        let TrackedSplit {
            axis, predicted, ..
        } = *split;
        let (min, max) = (node.cell.min[axis], node.cell.max[axis]);
        if !(predicted > min && predicted < max) {
            return None;
        }
        let extent = split.extent.min(max - min);
        let step = options.step * extent;
        let positions = [predicted, predicted - step, predicted + step];
        let [middle, low, high] = node.evaluate_three(axis, positions);
        (middle.counts[0] > 0 && middle.counts[1] > 0).then_some(Self {
            axis,
            low,
            middle,
            high,
            extent,
            step,
        })
    }

    /// The lowest cost seen.
    #[inline(always)]
    pub(super) fn lowest_cost(&self) -> f32 {
        lower(self.middle.cost, lower(self.low.cost, self.high.cost))
    }

    /// Goes downhill from here, in steps that grow by the golden ratio, until a
    /// minimum is bracketed, and then by parabolas as long as they promise enough.
    #[inline(always)]
    pub(super) fn search<S: Simd>(
        self,
        node: &mut NodeSearch<'_, S>,
        options: &TrackingOptions,
    ) -> Sample {
        let Self {
            axis,
            mut low,
            mut middle,
            mut high,
            extent,
            mut step,
        } = self;
        let (min, max) = (node.cell.min[axis], node.cell.max[axis]);
        for _ in 0..MAX_STEPS {
            step *= GROWTH;
            if low.cost < middle.cost && low.cost <= high.cost {
                let position = low.position - step;
                if position <= min || low.counts[0] == 0 {
                    return low;
                }
                let next = node.evaluate(axis, position);
                (low, middle, high) = (next, low, middle);
            } else if high.cost < middle.cost {
                let position = high.position + step;
                if position >= max || high.counts[1] == 0 {
                    return high;
                }
                let next = node.evaluate(axis, position);
                (low, middle, high) = (middle, high, next);
            } else {
                break;
            }
        }
        if low.cost < middle.cost || high.cost < middle.cost {
            return if low.cost <= high.cost { low } else { high };
        }
        let stop = Stop {
            tolerance: (0.5 * options.step * extent).max(f32::MIN_POSITIVE),
            budget: REFINEMENTS,
        };
        let mut search = LineSearch::around(low, middle, high, stop);
        let mut found = middle;
        while search.promised_gain() > options.gain * found.cost
            && let Some(position) = search.propose()
        {
            search.tell(node.evaluate(axis, position));
            found = search.best().unwrap_or(found);
        }
        found
    }
}
