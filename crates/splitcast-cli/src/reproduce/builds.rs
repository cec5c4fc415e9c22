//! Figures of builds: what was measured, without any presentation.

use serde::Serialize;
use splitcast::{BuildReport, BuildStage, KdTree, Outcome, SplitRecord};

use super::settings::Contender;

/// One scene, frame by frame.
#[derive(Clone, Debug, Serialize)]
pub(crate) struct SceneMeasurement {
    pub(crate) scene: String,
    /// The most triangles of any frame.
    pub(crate) triangles: usize,
    pub(crate) notes: Vec<String>,
    pub(crate) frames: Vec<FrameMeasurement>,
}

impl SceneMeasurement {
    /// One contender's builds in the order of the frames, each with its frame.
    pub(crate) fn builds(
        &self,
        contender: Contender,
    ) -> impl Iterator<Item = (&FrameMeasurement, &BuildFigures)> {
        let frames = self.frames.iter();
        frames.filter_map(move |frame| Some((frame, frame.build(contender)?)))
    }

    /// The frames that tracked builds followed another frame in, or all if
    /// there are none: what medians are taken over.
    pub(crate) fn compared_frames(&self) -> Vec<&FrameMeasurement> {
        let running = |frame: &&FrameMeasurement| frame.builds.iter().any(|build| build.running);
        let found: Vec<_> = self.frames.iter().filter(running).collect();
        if found.is_empty() {
            self.frames.iter().collect()
        } else {
            found
        }
    }
}

/// One frame, built by all contenders.
#[derive(Clone, Debug, Serialize)]
pub(crate) struct FrameMeasurement {
    /// Its number in the input, from 0.
    pub(crate) frame: usize,
    pub(crate) triangles: usize,
    /// Triangles left out because of a vertex that is not finite.
    pub(crate) skipped_triangles: usize,
    pub(crate) builds: Vec<BuildFigures>,
}

impl FrameMeasurement {
    /// The build of one contender, if it took part.
    pub(crate) fn build(&self, contender: Contender) -> Option<&BuildFigures> {
        self.builds
            .iter()
            .find(|build| build.contender == contender)
    }
}

/// One build.
#[derive(Clone, Debug, Serialize)]
pub(crate) struct BuildFigures {
    pub(crate) contender: Contender,
    /// Whether it followed the build of an earlier frame.
    pub(crate) running: bool,
    /// Time to build the tree, without the filter; median over the rounds.
    pub(crate) build_ms: f64,
    /// Time of the filter: prediction, carrying over, correction.
    pub(crate) filter_ms: f64,
    /// Time to trace the benchmark's rays.
    pub(crate) trace_ms: f64,
    pub(crate) sah_cost: f64,
    pub(crate) nodes: usize,
    pub(crate) references: usize,
    /// Evaluations of the cost in all nodes, those that became leaves included.
    pub(crate) evaluations: u64,
    /// Splits that the builder has reported: none for `sweep` and `binned`.
    pub(crate) splits: u64,
    pub(crate) outcomes: Outcomes,
    /// By depth, the root first.
    pub(crate) levels: Vec<Level>,
}

impl BuildFigures {
    /// Figures of a tree and of how it was built; times are to follow.
    pub(crate) fn new(contender: Contender, tree: &KdTree<'_>, report: &BuildReport) -> Self {
        let stats = tree.stats();
        let mut levels: Vec<Level> = Vec::new();
        let mut outcomes = Outcomes::default();
        for split in &report.splits {
            let depth = split.depth as usize;
            if levels.len() <= depth {
                levels.resize(depth + 1, Level::default());
            }
            levels[depth].add(split);
            outcomes.add(split.outcome);
        }
        Self {
            contender,
            running: matches!(report.stage, BuildStage::Running),
            build_ms: 0.0,
            filter_ms: 0.0,
            trace_ms: 0.0,
            sah_cost: stats.sah_cost,
            nodes: stats.nodes,
            references: stats.references,
            evaluations: report.evaluations,
            splits: report.splits.len() as u64,
            outcomes,
            levels,
        }
    }

    /// Evaluations for each split of the tree.
    pub(crate) fn evaluations_per_split(&self) -> Option<f64> {
        ratio(self.evaluations as f64, self.splits as f64)
    }

    /// Root of the mean squared error of predictions, relative to extents.
    pub(crate) fn prediction_rmse(&self) -> Option<f64> {
        let mut all = Level::default();
        self.levels.iter().for_each(|level| all.merge(level));
        all.error()
    }
}

/// What became of the splits of one tree.
#[derive(Clone, Copy, Debug, Default, Serialize)]
pub(crate) struct Outcomes {
    pub(crate) matched: u64,
    pub(crate) empty_space: u64,
    pub(crate) drifted: u64,
    pub(crate) turned: u64,
    pub(crate) outside: u64,
    pub(crate) untracked: u64,
}

impl Outcomes {
    /// Share of the splits that were known from the frame before and have
    /// another axis now.
    pub(crate) fn mismatch_rate(&self) -> Option<f64> {
        ratio(self.turned as f64, (self.total() - self.untracked) as f64)
    }

    /// All splits.
    pub(crate) fn total(&self) -> u64 {
        self.matched + self.empty_space + self.drifted + self.turned + self.outside + self.untracked
    }

    fn add(&mut self, outcome: Outcome) {
        *match outcome {
            Outcome::Matched => &mut self.matched,
            Outcome::Drifted => &mut self.drifted,
            Outcome::Turned => &mut self.turned,
            Outcome::Outside => &mut self.outside,
            Outcome::EmptySpace => &mut self.empty_space,
            Outcome::Untracked => &mut self.untracked,
            other => unreachable!("the core has an outcome that this table lacks: {other:?}"),
        } += 1;
    }
}

/// All splits of one depth. Errors are relative to the extent of the node's
/// cell, along the axis of the split.
#[derive(Clone, Copy, Debug, Default, Serialize)]
pub(crate) struct Level {
    pub(crate) splits: u64,
    pub(crate) evaluations: u64,
    /// Splits whose search started at the prediction.
    pub(crate) matched: u64,
    /// Extents of the nodes' cells along the axes of their splits, summed.
    pub(crate) extent: f64,
    /// Splits whose prediction was of use: the same axis, inside of the node.
    pub(crate) predictions: u64,
    /// Squared differences of prediction and split, summed.
    pub(crate) squared_error: f64,
    /// Predictions that a virtual observation was made for.
    pub(crate) innovations: u64,
    /// Squared differences of observation and prediction, summed.
    pub(crate) squared_innovation: f64,
}

impl Level {
    /// Root of the mean squared error of predictions.
    pub(crate) fn error(&self) -> Option<f64> {
        Some(ratio(self.squared_error, self.predictions as f64)?.sqrt())
    }

    /// Root of the mean squared innovation.
    pub(crate) fn innovation(&self) -> Option<f64> {
        Some(ratio(self.squared_innovation, self.innovations as f64)?.sqrt())
    }

    /// Takes in other splits.
    pub(crate) fn merge(&mut self, other: &Self) {
        self.splits += other.splits;
        self.evaluations += other.evaluations;
        self.matched += other.matched;
        self.extent += other.extent;
        self.predictions += other.predictions;
        self.squared_error += other.squared_error;
        self.innovations += other.innovations;
        self.squared_innovation += other.squared_innovation;
    }

    fn add(&mut self, split: &SplitRecord) {
        self.splits += 1;
        self.evaluations += u64::from(split.evaluations);
        let extent = f64::from(split.extent);
        self.matched += u64::from(split.outcome == Outcome::Matched);
        self.extent += extent;
        let is_of_use = matches!(split.outcome, Outcome::Matched | Outcome::Drifted);
        let Some(predicted) = split.predicted.filter(|_| is_of_use && extent > 0.0) else {
            return;
        };
        let relative = |value: f32| (f64::from(value) - f64::from(predicted)) / extent;
        self.predictions += 1;
        self.squared_error += relative(split.position).powi(2);
        if let Some(observed) = split.observed {
            self.innovations += 1;
            self.squared_innovation += relative(observed).powi(2);
        }
    }
}

/// `a / b`, if that says anything.
pub(crate) fn ratio(a: f64, b: f64) -> Option<f64> {
    Some(a / b).filter(|_| b > 0.0 && a.is_finite())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn split(outcome: Outcome, predicted: Option<f32>) -> SplitRecord {
        SplitRecord {
            node: 0,
            depth: 0,
            axis: 0,
            position: 2.0,
            predicted,
            observed: predicted.map(|x| x + 1.0),
            references: 10,
            extent: 4.0,
            evaluations: 5,
            outcome,
        }
    }

    #[test]
    fn errors_are_relative_to_the_extent_and_count_where_predictions_were_used() {
        let mut level = Level::default();
        level.add(&split(Outcome::Matched, Some(1.0)));
        level.add(&split(Outcome::Turned, Some(99.0)));
        level.add(&split(Outcome::Untracked, None));
        assert_eq!((level.splits, level.evaluations), (3, 15));
        assert_eq!((level.predictions, level.error()), (1, Some(0.25)));
        assert_eq!(level.innovation(), Some(0.25));
        assert_eq!(Level::default().error(), None);
    }

    #[test]
    fn the_mismatch_rate_leaves_new_splits_out() {
        let mut outcomes = Outcomes::default();
        assert_eq!(outcomes.mismatch_rate(), None);
        for outcome in [
            Outcome::Matched,
            Outcome::Outside,
            Outcome::Drifted,
            Outcome::Turned,
            Outcome::Untracked,
        ] {
            outcomes.add(outcome);
        }
        assert_eq!(outcomes.mismatch_rate(), Some(0.25));
        assert_eq!(outcomes.total(), 5);
    }
}
