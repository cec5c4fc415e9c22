//! Rows of the tables: medians over the frames, and the worst frame.

use serde::Serialize;

use super::builds::{BuildFigures, FrameMeasurement, SceneMeasurement, ratio};
use super::paper::{SAH_GOAL, row_for};
use super::settings::Contender;
use crate::column::{Column, Extreme};

/// A row of Table I: one scene with one filter. What cannot be told, such as a
/// running build of a single frame, is absent.
///
/// Medians are over the frames behind the first that has a tree. Ratios of two
/// builds are formed frame by frame before the median is taken, but
/// `reduction` is that of the medians, as in the paper.
#[derive(Clone, Debug, Serialize)]
pub(crate) struct Row {
    pub(crate) scene: String,
    /// `kalman` or `wiener`.
    pub(crate) filter: Contender,
    pub(crate) triangles: usize,
    /// Frames that were measured.
    pub(crate) frames: usize,
    /// Time of a build that knows nothing of earlier frames.
    pub(crate) normal_ms: Option<f64>,
    /// Time of the first frame's build, which loads the filter.
    pub(crate) initial_ms: Option<f64>,
    /// Time of a build that starts at the predictions, without the filter.
    pub(crate) running_ms: Option<f64>,
    /// How much less `running_ms` is than `normal_ms`, 0 to 1.
    pub(crate) reduction: Option<f64>,
    pub(crate) evaluations_per_split_normal: Option<f64>,
    pub(crate) evaluations_per_split_running: Option<f64>,
    /// Share of tracked splits whose axis is another than a frame before.
    pub(crate) orientation_mismatch_rate: Option<f64>,
    /// Root mean squared difference of prediction and split, over the extent
    /// of the node's cell; predictions that do not divide their node are left out.
    pub(crate) prediction_rmse_relative: Option<f64>,
    pub(crate) sah_ratio_to_sweep: Option<f64>,
    /// Time to trace the same rays, against the exact tree.
    pub(crate) trace_ratio_to_sweep: Option<f64>,
    /// Time of the filter, which `running_ms` is without.
    pub(crate) filter_overhead_ms: Option<f64>,
    pub(crate) sah_ratio_to_normal: Option<f64>,
    /// `running_ms` with the filter, as the median of the sums.
    pub(crate) running_with_filter_ms: Option<f64>,
    /// `reduction` if the filter counts as part of the running build.
    pub(crate) reduction_with_filter: Option<f64>,
    /// The paper's reduction for this scene, if it has one.
    pub(crate) reduction_goal: Option<f64>,
    pub(crate) sah_ratio_goal: f64,
    pub(crate) worst: Worst,
}

/// The worst frame by each figure.
#[derive(Clone, Debug, Serialize)]
pub(crate) struct Worst {
    pub(crate) normal_ms: Option<Extreme>,
    pub(crate) running_ms: Option<Extreme>,
    pub(crate) reduction: Option<Extreme>,
    pub(crate) evaluations_per_split_normal: Option<Extreme>,
    pub(crate) evaluations_per_split_running: Option<Extreme>,
    pub(crate) orientation_mismatch_rate: Option<Extreme>,
    pub(crate) prediction_rmse_relative: Option<Extreme>,
    pub(crate) sah_ratio_to_sweep: Option<Extreme>,
    pub(crate) trace_ratio_to_sweep: Option<Extreme>,
    pub(crate) filter_overhead_ms: Option<Extreme>,
    pub(crate) sah_ratio_to_normal: Option<Extreme>,
    pub(crate) running_with_filter_ms: Option<Extreme>,
}

impl Row {
    /// The row of a scene and a filter.
    pub(crate) fn new(scene: &SceneMeasurement, filter: Contender) -> Self {
        use Contender::{Normal, Sweep};
        let frames = scene.compared_frames();
        let running = |frame: &FrameMeasurement| frame.build(filter).cloned().filter(|b| b.running);
        let of = |figure: &dyn Fn(&FrameMeasurement) -> Option<f64>| {
            Column::new(frames.iter().map(|frame| (frame.frame, figure(frame))))
        };
        let of_running = |figure: &dyn Fn(&BuildFigures) -> Option<f64>| {
            of(&|frame| running(frame).as_ref().and_then(figure))
        };
        let against = |other: Contender, figure: &dyn Fn(&BuildFigures) -> f64| {
            of(&|frame| ratio(figure(&running(frame)?), figure(frame.build(other)?)))
        };
        let normal = of(&|frame| Some(frame.build(Normal)?.build_ms));
        let normal_evaluations = of(&|frame| frame.build(Normal)?.evaluations_per_split());
        let time = of_running(&|build| Some(build.build_ms));
        let filter_time = of_running(&|build| Some(build.filter_ms));
        let whole = of_running(&|build| Some(build.build_ms + build.filter_ms));
        let evaluations = of_running(&BuildFigures::evaluations_per_split);
        let mismatch = of_running(&|build| build.outcomes.mismatch_rate());
        let error = of_running(&BuildFigures::prediction_rmse);
        let sah_to_sweep = against(Sweep, &|build| build.sah_cost);
        let sah_to_normal = against(Normal, &|build| build.sah_cost);
        let trace_to_sweep = against(Sweep, &|build| build.trace_ms);
        let time_to_normal = against(Normal, &|build| build.build_ms);
        let less = |time: &Column| Some(1.0 - ratio(time.median?, normal.median?)?);
        let first = scene.builds(filter).find(|(_, build)| !build.running);
        Self {
            scene: scene.scene.clone(),
            filter,
            triangles: scene.triangles,
            frames: scene.frames.len(),
            normal_ms: normal.median,
            initial_ms: first.map(|(_, build)| build.build_ms),
            running_ms: time.median,
            reduction: less(&time),
            evaluations_per_split_normal: normal_evaluations.median,
            evaluations_per_split_running: evaluations.median,
            orientation_mismatch_rate: mismatch.median,
            prediction_rmse_relative: error.median,
            sah_ratio_to_sweep: sah_to_sweep.median,
            trace_ratio_to_sweep: trace_to_sweep.median,
            filter_overhead_ms: filter_time.median,
            sah_ratio_to_normal: sah_to_normal.median,
            running_with_filter_ms: whole.median,
            reduction_with_filter: less(&whole),
            reduction_goal: row_for(&scene.scene).map(|row| row.reduction),
            sah_ratio_goal: SAH_GOAL,
            worst: Worst {
                normal_ms: normal.most,
                running_ms: time.most,
                reduction: time_to_normal.most.map(|most| Extreme {
                    value: 1.0 - most.value,
                    ..most
                }),
                evaluations_per_split_normal: normal_evaluations.most,
                evaluations_per_split_running: evaluations.most,
                orientation_mismatch_rate: mismatch.most,
                prediction_rmse_relative: error.most,
                sah_ratio_to_sweep: sah_to_sweep.most,
                trace_ratio_to_sweep: trace_to_sweep.most,
                filter_overhead_ms: filter_time.most,
                sah_ratio_to_normal: sah_to_normal.most,
                running_with_filter_ms: whole.most,
            },
        }
    }

    /// Both rows of a scene.
    pub(crate) fn of_scene(scene: &SceneMeasurement) -> [Self; 2] {
        Contender::TRACKED.map(|filter| Self::new(scene, filter))
    }

    /// Whether the reduction is at least the paper's, to the whole percent
    /// that the paper gives.
    pub(crate) fn meets_reduction(&self) -> Option<bool> {
        Some((self.reduction? * 100.0).round() >= (self.reduction_goal? * 100.0).round())
    }

    /// Names and values for a line of CSV; what is absent is empty.
    pub(crate) fn cells(&self) -> Vec<(&'static str, String)> {
        let number = |value: Option<f64>| value.map_or(String::new(), |value| value.to_string());
        let worst = &self.worst;
        let worst_value = |extreme: Option<Extreme>| number(extreme.map(|extreme| extreme.value));
        vec![
            ("scene", self.scene.clone()),
            ("filter", self.filter.name().to_owned()),
            ("triangles", self.triangles.to_string()),
            ("frames", self.frames.to_string()),
            ("normal_ms", number(self.normal_ms)),
            ("initial_ms", number(self.initial_ms)),
            ("running_ms", number(self.running_ms)),
            ("reduction", number(self.reduction)),
            (
                "evaluations_per_split_normal",
                number(self.evaluations_per_split_normal),
            ),
            (
                "evaluations_per_split_running",
                number(self.evaluations_per_split_running),
            ),
            (
                "orientation_mismatch_rate",
                number(self.orientation_mismatch_rate),
            ),
            (
                "prediction_rmse_relative",
                number(self.prediction_rmse_relative),
            ),
            ("sah_ratio_to_sweep", number(self.sah_ratio_to_sweep)),
            ("trace_ratio_to_sweep", number(self.trace_ratio_to_sweep)),
            ("filter_overhead_ms", number(self.filter_overhead_ms)),
            ("sah_ratio_to_normal", number(self.sah_ratio_to_normal)),
            (
                "running_with_filter_ms",
                number(self.running_with_filter_ms),
            ),
            ("worst_normal_ms", worst_value(worst.normal_ms)),
            ("worst_running_ms", worst_value(worst.running_ms)),
            ("worst_reduction", worst_value(worst.reduction)),
            (
                "worst_evaluations_per_split_normal",
                worst_value(worst.evaluations_per_split_normal),
            ),
            (
                "worst_evaluations_per_split_running",
                worst_value(worst.evaluations_per_split_running),
            ),
            (
                "worst_orientation_mismatch_rate",
                worst_value(worst.orientation_mismatch_rate),
            ),
            (
                "worst_prediction_rmse_relative",
                worst_value(worst.prediction_rmse_relative),
            ),
            (
                "worst_sah_ratio_to_sweep",
                worst_value(worst.sah_ratio_to_sweep),
            ),
            (
                "worst_trace_ratio_to_sweep",
                worst_value(worst.trace_ratio_to_sweep),
            ),
            (
                "worst_filter_overhead_ms",
                worst_value(worst.filter_overhead_ms),
            ),
            (
                "worst_sah_ratio_to_normal",
                worst_value(worst.sah_ratio_to_normal),
            ),
            (
                "worst_running_with_filter_ms",
                worst_value(worst.running_with_filter_ms),
            ),
        ]
    }
}

/// A line of the second table: one builder on one scene, medians over the same
/// frames as in [`Row`]. Tracked builds count with their filter.
#[derive(Clone, Debug, Serialize)]
pub(crate) struct BuilderRow {
    pub(crate) scene: String,
    pub(crate) builder: Contender,
    pub(crate) build_ms: Option<f64>,
    pub(crate) build_ratio_to_normal: Option<f64>,
    pub(crate) evaluations: Option<f64>,
    pub(crate) sah_cost: Option<f64>,
    pub(crate) sah_ratio_to_sweep: Option<f64>,
    pub(crate) trace_ms: Option<f64>,
    pub(crate) references_per_triangle: Option<f64>,
}

impl BuilderRow {
    /// One row for each builder that was measured.
    pub(crate) fn of_scene(scene: &SceneMeasurement) -> Vec<Self> {
        let frames = scene.compared_frames();
        let builds = scene.frames.first().map_or(&[][..], |frame| &frame.builds);
        let row = |build: &BuildFigures| {
            let builder = build.contender;
            let of = |figure: &dyn Fn(&FrameMeasurement, &BuildFigures) -> Option<f64>| {
                let value = |frame| figure(frame, frame.build(builder)?);
                Column::new(frames.iter().map(|&frame| (frame.frame, value(frame)))).median
            };
            let time = |build: &BuildFigures| build.build_ms + build.filter_ms;
            Self {
                scene: scene.scene.clone(),
                builder,
                build_ms: of(&|_, build| Some(time(build))),
                build_ratio_to_normal: of(&|frame, build| {
                    ratio(time(build), time(frame.build(Contender::Normal)?))
                }),
                evaluations: of(&|_, build| Some(build.evaluations as f64).filter(|&n| n > 0.0)),
                sah_cost: of(&|_, build| Some(build.sah_cost)),
                sah_ratio_to_sweep: of(&|frame, build| {
                    ratio(build.sah_cost, frame.build(Contender::Sweep)?.sah_cost)
                }),
                trace_ms: of(&|_, build| Some(build.trace_ms)),
                references_per_triangle: of(&|frame, build| {
                    let triangles = frame.triangles - frame.skipped_triangles;
                    ratio(build.references as f64, triangles as f64)
                }),
            }
        };
        builds.iter().map(row).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::super::builds::Outcomes;
    use super::*;

    fn build(contender: Contender, running: bool, build_ms: f64, sah_cost: f64) -> BuildFigures {
        BuildFigures {
            contender,
            running,
            build_ms,
            filter_ms: 1.0,
            trace_ms: 2.0 * sah_cost,
            sah_cost,
            nodes: 9,
            references: 20,
            evaluations: 30,
            splits: 4,
            outcomes: Outcomes::default(),
            levels: Vec::new(),
        }
    }

    fn frame(frame: usize, running: bool, running_ms: f64, sah_cost: f64) -> FrameMeasurement {
        FrameMeasurement {
            frame,
            triangles: 10,
            skipped_triangles: 0,
            builds: vec![
                build(Contender::Normal, false, 100.0, 10.0),
                build(Contender::Kalman, running, running_ms, sah_cost),
                build(Contender::Sweep, false, 50.0, 8.0),
            ],
        }
    }

    fn scene(frames: Vec<FrameMeasurement>) -> SceneMeasurement {
        SceneMeasurement {
            scene: "horse".to_owned(),
            triangles: 10,
            notes: Vec::new(),
            frames,
        }
    }

    #[test]
    fn medians_leave_the_first_frame_out_and_worst_frames_are_named() {
        let scene = scene(vec![
            frame(5, false, 300.0, 99.0),
            frame(6, true, 20.0, 10.0),
            frame(7, true, 40.0, 10.4),
            frame(8, true, 21.0, 10.2),
        ]);
        let row = Row::new(&scene, Contender::Kalman);
        assert_eq!((row.initial_ms, row.running_ms), (Some(300.0), Some(21.0)));
        assert_eq!((row.reduction, row.frames), (Some(0.79), 4));
        assert_eq!(row.running_with_filter_ms, Some(22.0));
        assert_eq!(row.sah_ratio_to_normal, Some(1.02));
        assert_eq!(row.evaluations_per_split_running, Some(7.5));
        let worst = row.worst.reduction.unwrap();
        assert_eq!((worst.value, worst.frame), (0.6, 7));
        assert_eq!(row.meets_reduction(), Some(true));
        assert_eq!(row.orientation_mismatch_rate, None);
        assert_eq!(BuilderRow::of_scene(&scene).len(), 3);
    }

    #[test]
    fn one_frame_has_normal_and_initial_builds_only() {
        let row = Row::new(&scene(vec![frame(0, false, 300.0, 9.0)]), Contender::Kalman);
        assert_eq!((row.normal_ms, row.initial_ms), (Some(100.0), Some(300.0)));
        assert_eq!((row.running_ms, row.reduction), (None, None));
        assert_eq!(row.meets_reduction(), None);
        assert!(row.worst.running_ms.is_none());
        let cells = row.cells();
        assert_eq!(cells[6], ("running_ms", String::new()));
    }
}
