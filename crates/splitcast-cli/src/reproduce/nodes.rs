//! Chosen nodes of the tracked trees, frame by frame: the curve of their split
//! cost, the plane that was found, and what the filters had predicted.
//!
//! A tracked build predicts a node's plane on one axis. On the others, the
//! predictors are run here over the optima of the cost curve, so that two axes
//! can be shown as in Figures 3 and 4 of Hussain & Grahn 2008.

use std::cmp::Reverse;

use serde::Serialize;
use splitcast::filter::{KalmanFilter, Predictor, VirtualObservations, WienerPredictor};
use splitcast::{Aabb, BuildReport, KdTree, NodeKind, Outcome, SplitRecord, TrackingOptions};
use splitcast_console::Progress;

use super::settings::{Contender, NodePath, Settings};
use crate::error::CliError;
use crate::scene::Scene;
use crate::trees::build_tree;

/// Planes along an axis at which a cost curve is evaluated.
const CURVE_POINTS: usize = 81;

/// Planes between two neighbours of the curve's lowest point.
const REFINED_POINTS: usize = 33;

/// A node through the frames in which the tracked tree has it.
#[derive(Clone, Debug, Serialize)]
pub(crate) struct NodeTrack {
    pub(crate) path: NodePath,
    /// Two axes for the root, the usual split axis for other nodes; none if
    /// no frame has the node.
    pub(crate) axes: Vec<AxisTrack>,
}

/// A node's planes across one axis.
#[derive(Clone, Debug, Default, Serialize)]
pub(crate) struct AxisTrack {
    /// 0, 1 or 2 for x, y or z.
    pub(crate) axis: usize,
    /// Whether planes and predictions are those of the tracked build. If not,
    /// the planes are optima of the cost curves, and predictions come from
    /// filters run over them.
    pub(crate) is_tracked: bool,
    pub(crate) frames: Vec<AxisFrame>,
}

/// One frame of an [`AxisTrack`].
#[derive(Clone, Debug, Default, Serialize)]
pub(crate) struct AxisFrame {
    pub(crate) frame: usize,
    /// Planes and the expected cost of splitting there, where it is finite.
    pub(crate) curve: Vec<(f32, f32)>,
    /// The plane.
    pub(crate) position: Option<f32>,
    pub(crate) kalman: Option<Prediction>,
    pub(crate) wiener: Option<Prediction>,
}

/// What a filter made of a plane's past.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub(crate) struct Prediction {
    pub(crate) predicted: f32,
    /// The virtual observation that the filter was corrected with.
    pub(crate) observed: Option<f32>,
}

/// Builds the scene once more with both filters and follows the nodes.
pub(crate) fn track(
    scene: &mut Scene,
    settings: &Settings,
    paths: &[NodePath],
) -> Result<Vec<NodeTrack>, CliError> {
    let mut kalman = settings.builder(Contender::Kalman)?;
    let mut wiener = settings.builder(Contender::Wiener)?;
    let mut sightings: Vec<Vec<Sighting>> = vec![Vec::new(); paths.len()];
    let mut initial = Vec::new();
    let frames = scene.measured.clone();
    let mut progress = Progress::new("following nodes", frames.len());
    for &index in &frames {
        let frame = scene.frame(index)?;
        let (number, place) = (scene.number(index), scene.place(index));
        let a = build_tree(&frame, &mut kalman, number, &place)?;
        let b = build_tree(&frame, &mut wiener, number, &place)?;
        let (kalman_report, wiener_report) = (kalman.report(), wiener.report());
        if initial.is_empty() {
            let splits = kalman_report.splits.iter();
            initial = splits.map(|split| split.position).collect();
        }
        for (path, seen) in paths.iter().zip(&mut sightings) {
            let (kalman, wiener) = ((&a, &kalman_report), (&b, &wiener_report));
            seen.extend(Sighting::new(number, path, kalman, wiener));
        }
        progress.step("");
    }
    let extent = scene.info.bounds.map_or([0.0; 3], |bounds| {
        [0, 1, 2].map(|axis| bounds.max[axis] - bounds.min[axis])
    });
    let tracking = settings.options(Contender::Kalman).tracking;
    let tracks = paths.iter().zip(sightings).map(|(path, seen)| {
        let axes = if path.0.is_empty() {
            two_longest(extent)
        } else {
            usual_axis(&seen).into_iter().collect()
        };
        NodeTrack {
            path: path.clone(),
            axes: (axes.into_iter())
                .filter_map(|axis| axis_track(axis, &seen, &initial, &tracking))
                .collect(),
        }
    });
    Ok(tracks.collect())
}

/// A node in one frame.
#[derive(Clone, Debug)]
struct Sighting {
    frame: usize,
    /// Where it splits in the tree of the Kalman filter.
    split: Option<SplitRecord>,
    /// Where it splits in that of the Wiener predictor.
    wiener: Option<SplitRecord>,
    /// One for each axis.
    curves: [CostCurve; 3],
}

/// Costs of splitting a node across one axis.
#[derive(Clone, Debug)]
struct CostCurve {
    /// Planes and costs.
    points: Vec<(f32, f32)>,
    /// The plane of the lowest cost, searched more closely.
    optimum: Option<f32>,
}

impl Sighting {
    fn new(
        frame: usize,
        path: &NodePath,
        (kalman, kalman_report): (&KdTree<'_>, &BuildReport),
        (wiener, wiener_report): (&KdTree<'_>, &BuildReport),
    ) -> Option<Self> {
        let (node, cell) = find(kalman, path)?;
        let split = |node: usize, report: &BuildReport| {
            let mut splits = report.splits.iter();
            splits.find(|split| split.node as usize == node).copied()
        };
        Some(Self {
            frame,
            split: split(node, kalman_report),
            wiener: find(wiener, path).and_then(|(node, _)| split(node, wiener_report)),
            curves: [0, 1, 2].map(|axis| cost_curve(kalman, node, &cell, axis)),
        })
    }
}

/// The inner node at the end of a path, with its cell.
fn find(tree: &KdTree<'_>, path: &NodePath) -> Option<(usize, Aabb)> {
    let (mut index, mut cell) = (0, tree.bounds());
    for letter in path.0.chars() {
        let NodeKind::Inner {
            axis,
            position,
            right,
        } = tree.nodes()[index].kind()
        else {
            return None;
        };
        let (left_cell, right_cell) = cell.split(axis, position);
        (index, cell) = match letter {
            'L' => (index + 1, left_cell),
            _ => (right, right_cell),
        };
    }
    matches!(tree.nodes()[index].kind(), NodeKind::Inner { .. }).then_some((index, cell))
}

/// Cost at planes across the whole cell, and the best of them, searched once
/// more between its neighbours.
fn cost_curve(tree: &KdTree<'_>, node: usize, cell: &Aabb, axis: usize) -> CostCurve {
    let curve = |from: f32, to: f32, count: usize| -> Vec<(f32, f32)> {
        let position = |i| from + (to - from) * (i as f32 / (count - 1) as f32);
        let positions: Vec<f32> = (0..count).map(position).collect();
        let costs = tree.split_costs(node, axis, &positions);
        let points = positions.into_iter().zip(costs);
        points.filter(|(_, cost)| cost.is_finite()).collect()
    };
    let lowest = |points: &[(f32, f32)]| {
        let best = points.iter().enumerate();
        let best = best.min_by(|(_, a), (_, b)| a.1.total_cmp(&b.1));
        best.map(|(index, _)| index)
    };
    let coarse = curve(cell.min[axis], cell.max[axis], CURVE_POINTS);
    let optimum = lowest(&coarse).map(|best| {
        let from = coarse[best.saturating_sub(1)].0;
        let to = coarse[(best + 1).min(coarse.len() - 1)].0;
        let fine = curve(from, to, REFINED_POINTS);
        lowest(&fine).map_or(coarse[best].0, |best| fine[best].0)
    });
    CostCurve {
        points: coarse,
        optimum,
    }
}

/// The two axes along which the motion reaches farthest, in their order.
fn two_longest(extent: [f32; 3]) -> Vec<usize> {
    let shortest = (0..3).min_by(|&a, &b| extent[a].total_cmp(&extent[b]));
    (0..3).filter(|&axis| Some(axis) != shortest).collect()
}

/// The axis that the node is split across most often.
fn usual_axis(seen: &[Sighting]) -> Option<usize> {
    let splits = || seen.iter().filter_map(|sighting| sighting.split.as_ref());
    let times = |axis: usize| splits().filter(|split| split.axis as usize == axis).count();
    (0..3)
        .max_by_key(|&axis| (times(axis), Reverse(axis)))
        .filter(|&axis| times(axis) > 0)
}

fn axis_track(
    axis: usize,
    seen: &[Sighting],
    initial: &[f32],
    tracking: &TrackingOptions,
) -> Option<AxisTrack> {
    let on_axis = |split: &Option<SplitRecord>| split.filter(|s| s.axis as usize == axis);
    let is_tracked = seen.iter().all(|s| on_axis(&s.split).is_some());
    let mut frames: Vec<AxisFrame> = Vec::with_capacity(seen.len());
    for sighting in seen {
        let CostCurve { points, optimum } = &sighting.curves[axis];
        let split = on_axis(&sighting.split);
        frames.push(AxisFrame {
            frame: sighting.frame,
            curve: points.clone(),
            position: if is_tracked {
                split.as_ref().map(|split| split.position)
            } else {
                *optimum
            },
            kalman: split.as_ref().and_then(prediction),
            wiener: on_axis(&sighting.wiener).as_ref().and_then(prediction),
        });
    }
    if !is_tracked {
        run_filters(&mut frames, initial, tracking)?;
    }
    (!frames.is_empty()).then_some(AxisTrack {
        axis,
        is_tracked,
        frames,
    })
}

/// What was predicted of a split, if it was for the axis that it has.
fn prediction(split: &SplitRecord) -> Option<Prediction> {
    let predicted = split
        .predicted
        .filter(|_| split.outcome != Outcome::Turned)?;
    Some(Prediction {
        predicted,
        observed: split.observed,
    })
}

/// Predicts the positions with both filters, with the model that the tracked
/// build takes from the splits of the first tree.
fn run_filters(
    frames: &mut [AxisFrame],
    initial: &[f32],
    tracking: &TrackingOptions,
) -> Option<()> {
    // The build has taken the same parameters, so they are valid.
    let model = tracking.noise.kalman_model(initial).ok()?;
    let mut kalman = KalmanFilter::new(model, 0).ok()?;
    let mut wiener = WienerPredictor::new(tracking.wiener, 0).ok()?;
    let positions: Vec<Option<f32>> = frames.iter().map(|frame| frame.position).collect();
    let run = |predictor: &mut dyn Predictor| {
        let observations = VirtualObservations::new(tracking.noise).ok()?;
        Some(predictions(predictor, observations, &positions))
    };
    let (kalman, wiener) = (run(&mut kalman)?, run(&mut wiener)?);
    for ((frame, kalman), wiener) in frames.iter_mut().zip(kalman).zip(wiener) {
        (frame.kalman, frame.wiener) = (kalman, wiener);
    }
    Some(())
}

/// One prediction for each position but the first that is known.
fn predictions(
    predictor: &mut dyn Predictor,
    mut observations: VirtualObservations,
    positions: &[Option<f32>],
) -> Vec<Option<Prediction>> {
    let mut made = Vec::with_capacity(positions.len());
    for (frame, &position) in positions.iter().enumerate() {
        let Some(position) = position else {
            made.push(None);
            continue;
        };
        let is_first = predictor.is_empty();
        if is_first {
            predictor.load(&[position]);
        }
        let predicted = predictor.predict()[0];
        let observed = observations.observe(frame as u64, &[position])[0];
        predictor.correct(&[observed]);
        let prediction = Prediction {
            predicted,
            observed: Some(observed),
        };
        made.push((!is_first).then_some(prediction));
    }
    made
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_shortest_axis_is_left_out() {
        assert_eq!(two_longest([1.0, 2.0, 3.0]), [1, 2]);
        assert_eq!(two_longest([3.0, 1.0, 2.0]), [0, 2]);
        assert_eq!(two_longest([0.0; 3]), [1, 2]);
    }

    #[test]
    fn predictions_begin_behind_the_first_position_and_pass_over_gaps() {
        let mut wiener = WienerPredictor::new(Default::default(), 0).unwrap();
        let exact = splitcast::filter::NoiseParameters {
            process: 0.0,
            measurement: 0.0,
            seed: 0,
        };
        let observations = VirtualObservations::new(exact).unwrap();
        let made = predictions(
            &mut wiener,
            observations,
            &[None, Some(1.0), Some(2.0), None, Some(3.0)],
        );
        let expected = |predicted, observed| {
            Some(Prediction {
                predicted,
                observed: Some(observed),
            })
        };
        assert_eq!(made[..4], [None, None, expected(1.0, 2.0), None]);
        assert!(made[4].is_some());
    }
}
