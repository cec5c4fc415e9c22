//! Trees for the frames of a sequence, one after the other, with what the
//! builders `kalman` and `wiener` carry from frame to frame (Hussain & Grahn
//! 2008, Algorithms 1 and 2).
//!
//! ```text
//! predict ─► build, searching from the predictions ─► carry the filter over to the new splits ─► correct
//! ```
//!
//! The filter has a component for every inner node, in the order of the nodes. A split
//! keeps its component if it stands at the same place in the tree with the same
//! axis; all others start anew at the plane that was found.

use std::time::{Duration, Instant};

use crate::build::{self, Built, History, NodeRecord, Scratch};
use crate::filter::{KalmanFilter, KalmanModel, Predictor, VirtualObservations, WienerPredictor};
use crate::kd_tree::{Node, NodeKind};
use crate::{BuildError, BuildOptions, Builder, InitialState, KdTree, Mesh, OptionsError, Outcome};

/// Builds the trees of a sequence's frames, in order.
///
/// Works with every builder; those that do not track build each frame on its
/// own. Meshes may change in any way between frames, also in their number of
/// triangles: what is tracked is planes in space.
///
/// ```
/// use splitcast::{BuildOptions, Builder, Mesh, Ray, SequenceBuilder};
///
/// let options = BuildOptions { builder: Builder::Kalman, ..BuildOptions::default() };
/// let mut sequence = SequenceBuilder::new(&options)?;
/// let triangles = [[0, 1, 2]];
/// for frame in 0..3 {
///     let z = frame as f32;
///     let positions = [[0.0, 0.0, z], [1.0, 0.0, z], [0.0, 1.0, z]];
///     let tree = sequence.build(Mesh::new(&positions, &triangles)?)?;
///     let ray = Ray::new([0.25, 0.25, 10.0], [0.0, 0.0, -1.0]);
///     assert_eq!(tree.closest_hit(&ray).unwrap().t, 10.0 - z);
/// }
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug)]
pub struct SequenceBuilder {
    options: BuildOptions,
    /// Number of frames built since the beginning or the last reset.
    frames: u64,
    last: LastBuild,
    scratch: Scratch,
    tracking: Option<Tracking>,
}

/// What is kept of the last build.
#[derive(Clone, Debug, Default)]
struct LastBuild {
    stage: BuildStage,
    build_time: Duration,
    filter_time: Duration,
    /// Of searching builders only, as are the records.
    nodes: Vec<Node>,
    records: Vec<NodeRecord>,
    /// Virtual observations, by component.
    observations: Vec<f32>,
}

/// The filter and its components.
#[derive(Clone, Debug)]
struct Tracking {
    filter: Filter,
    observations: VirtualObservations,
    /// The component of each node of the last tree; anything for leaves.
    components: Vec<u32>,
}

/// The predictors to choose from.
#[derive(Clone, Debug)]
enum Filter {
    Kalman(KalmanFilter),
    Wiener(Box<WienerPredictor>),
}

/// Which of the paper's builds a tree came from.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum BuildStage {
    /// A build that tracks nothing.
    #[default]
    Full,
    /// The first build of a sequence that is tracked: searched from the extremes of every node.
    Initial,
    /// A later one: searched from predictions.
    Running,
}

/// What a build did; see [`SequenceBuilder::report`].
#[derive(Clone, Debug, PartialEq)]
pub struct BuildReport {
    /// Which of the paper's builds it was.
    pub stage: BuildStage,
    /// Time for the tree alone.
    pub build_time: Duration,
    /// Time for the filter: prediction, noise, carrying over and correction.
    pub filter_time: Duration,
    /// Cost evaluations in all nodes, those of leaves included: planes whose
    /// sides were counted. 0 for builders that do not search.
    pub evaluations: u64,
    /// Every split in the order of the tree's nodes; empty for builders that do
    /// not search.
    pub splits: Vec<SplitRecord>,
}

/// One split of a searching builder.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SplitRecord {
    /// Index of the node in [`KdTree::nodes`].
    pub node: u32,
    /// Steps from the root, which has depth 0.
    pub depth: u32,
    /// 0, 1 or 2 for x, y or z.
    pub axis: u32,
    /// Coordinate of the plane on that axis.
    pub position: f32,
    /// Where it was expected, if it was tracked: on the axis of the frame before, which is another
    /// if the outcome is [`Outcome::Turned`].
    pub predicted: Option<f32>,
    /// The virtual observation made of the position (z in Algorithm 1), if splits are tracked.
    pub observed: Option<f32>,
    /// References of the node.
    pub references: u32,
    /// Extent of the node's cell on the axis, above 0: the unit of errors.
    pub extent: f32,
    /// Planes whose sides were counted.
    pub evaluations: u32,
    /// What became of the prediction.
    pub outcome: Outcome,
}

impl SequenceBuilder {
    /// A builder that has seen nothing yet.
    ///
    /// # Errors
    /// [`OptionsError`] names the first option that is out of bounds.
    pub fn new(options: &BuildOptions) -> Result<Self, OptionsError> {
        options.validate()?;
        Ok(Self {
            options: *options,
            frames: 0,
            last: LastBuild::default(),
            scratch: Scratch::default(),
            tracking: None,
        })
    }

    /// The options that every frame is built with.
    pub fn options(&self) -> &BuildOptions {
        &self.options
    }

    /// Builds the tree of the next frame, on the current rayon thread pool.
    ///
    /// # Errors
    /// As [`KdTree::build`]. What is tracked stays as it was, and the next frame may be built.
    pub fn build<'m>(&mut self, mesh: Mesh<'m>) -> Result<KdTree<'m>, BuildError> {
        let started = Instant::now();
        // Predicting changes the filter, so a failed build must not see it.
        let mut tracking = self.tracking.clone();
        let predictions = tracking
            .as_mut()
            .map(|tracking| tracking.filter.predict().to_vec());
        let predicted = Instant::now();
        let history =
            (tracking.as_ref().zip(predictions.as_ref())).map(|(tracking, predictions)| History {
                nodes: &self.last.nodes,
                records: &self.last.records,
                components: &tracking.components,
                predictions,
            });
        let stage = match (self.options.builder, &history) {
            (Builder::Kalman | Builder::Wiener, Some(_)) => BuildStage::Running,
            (Builder::Kalman | Builder::Wiener, None) => BuildStage::Initial,
            _ => BuildStage::Full,
        };
        let Built { tree, records } =
            build::build(mesh, &self.options, history, &mut self.scratch)?;
        let built = Instant::now();

        self.tracking = if stage == BuildStage::Full {
            None
        } else {
            self.track(tracking, tree.nodes(), &records)?
        };
        let nodes = if records.is_empty() {
            Vec::new()
        } else {
            tree.nodes().to_vec()
        };
        let tracked = Instant::now();
        self.frames += 1;
        self.last = LastBuild {
            stage,
            build_time: built - predicted,
            filter_time: if stage == BuildStage::Full {
                Duration::ZERO
            } else {
                (predicted - started) + (tracked - built)
            },
            nodes,
            records,
            observations: std::mem::take(&mut self.last.observations),
        };
        Ok(tree)
    }

    /// Forgets every frame: the next build is an initial one.
    pub fn reset(&mut self) {
        self.frames = 0;
        self.last = LastBuild::default();
        self.tracking = None;
    }

    /// What the last successful build did.
    pub fn report(&self) -> BuildReport {
        let LastBuild {
            nodes,
            records,
            observations,
            ..
        } = &self.last;
        let mut component = 0;
        let splits = (0_u32..)
            .zip(nodes)
            .zip(records)
            .filter_map(|((node, kind), record)| {
                let NodeKind::Inner { axis, position, .. } = kind.kind() else {
                    return None;
                };
                component += 1;
                Some(SplitRecord {
                    node,
                    depth: record.depth,
                    axis: axis as u32,
                    position,
                    predicted: record.predicted.is_finite().then_some(record.predicted),
                    observed: observations.get(component - 1).copied(),
                    references: record.references,
                    extent: record.cell_extent,
                    evaluations: record.evaluations,
                    outcome: record.outcome,
                })
            });
        BuildReport {
            stage: self.last.stage,
            build_time: self.last.build_time,
            filter_time: self.last.filter_time,
            evaluations: records.iter().map(|r| u64::from(r.evaluations)).sum(),
            splits: splits.collect(),
        }
    }

    /// Brings the filter up to date with a new tree.
    fn track(
        &mut self,
        tracking: Option<Tracking>,
        nodes: &[Node],
        records: &[NodeRecord],
    ) -> Result<Option<Tracking>, OptionsError> {
        let options = &self.options.tracking;
        let mut positions = Vec::with_capacity(nodes.len() / 2);
        let mut sources = Vec::with_capacity(nodes.len() / 2);
        let mut components = Vec::with_capacity(nodes.len());
        for (node, record) in nodes.iter().zip(records) {
            components.push(positions.len() as u32);
            if let NodeKind::Inner { position, .. } = node.kind() {
                positions.push(position);
                sources.push(record.source);
            }
        }
        let zeros;
        let initial = match options.initial_state {
            InitialState::Loaded => &positions,
            InitialState::Zero => {
                zeros = vec![0.0; positions.len()];
                &zeros
            }
        };
        // A spread of positions takes two of them; until then every frame is the first one.
        let mut tracking = match tracking {
            Some(tracking) => Tracking {
                components,
                ..tracking
            },
            None if positions.len() < 2 => return Ok(None),
            None => {
                let mut filter = self.new_filter(&positions)?;
                filter.load(initial);
                filter.predict();
                for (component, source) in (0..).zip(&mut sources) {
                    *source = component;
                }
                Tracking {
                    filter,
                    observations: VirtualObservations::new(options.noise)?,
                    components,
                }
            }
        };
        let observations = tracking.observations.observe(self.frames, &positions);
        tracking.filter.carry_over(&sources, initial);
        tracking.filter.correct(observations);
        self.last.observations.clear();
        self.last.observations.extend_from_slice(observations);
        Ok(Some(tracking))
    }

    /// The filter of Algorithm 1, or its rival, for the splits of a first frame.
    fn new_filter(&self, positions: &[f32]) -> Result<Filter, OptionsError> {
        let options = &self.options.tracking;
        Ok(if self.options.builder == Builder::Wiener {
            Filter::Wiener(Box::new(WienerPredictor::new(options.wiener, 0)?))
        } else {
            let model: KalmanModel = options.noise.kalman_model(positions)?;
            let filter = KalmanFilter::new(model, 0);
            Filter::Kalman(filter.expect("variances are finite and not negative"))
        })
    }
}

impl Filter {
    fn predictor(&mut self) -> &mut dyn Predictor {
        match self {
            Self::Kalman(filter) => filter,
            Self::Wiener(filter) => filter.as_mut(),
        }
    }

    fn load(&mut self, initial: &[f32]) {
        self.predictor().load(initial);
    }

    fn predict(&mut self) -> &[f32] {
        self.predictor().predict()
    }

    fn carry_over(&mut self, sources: &[u32], initial: &[f32]) {
        self.predictor().carry_over(sources, initial);
    }

    fn correct(&mut self, observations: &[f32]) {
        self.predictor().correct(observations);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::filter::NoiseParameters;

    /// A bumpy sheet of `2 * n * n` triangles whose bumps have moved by `phase`.
    fn sheet(n: u32, phase: f32) -> (Vec<[f32; 3]>, Vec<[u32; 3]>) {
        let position = |i: u32, j: u32| {
            let (x, y) = (i as f32 / n as f32, j as f32 / n as f32);
            let (u, v) = (x - 0.3 - phase, y - 0.6 + phase);
            [x, y, u * v * (x - y) + 2.0]
        };
        let positions = (0..=n)
            .flat_map(|i| (0..=n).map(move |j| position(i, j)))
            .collect();
        let corner = |i, j| i * (n + 1) + j;
        let triangles = (0..n)
            .flat_map(|i| (0..n).map(move |j| (i, j)))
            .flat_map(|(i, j)| {
                let (a, b) = (corner(i, j), corner(i + 1, j));
                [[a, b, b + 1], [a, b + 1, a + 1]]
            })
            .collect();
        (positions, triangles)
    }

    fn options(builder: Builder) -> BuildOptions {
        BuildOptions {
            builder,
            ..BuildOptions::default()
        }
    }

    #[test]
    fn stages_follow_each_other() {
        let (positions, triangles) = sheet(40, 0.0);
        let mesh = Mesh::new(&positions, &triangles).unwrap();
        let mut sequence = SequenceBuilder::new(&options(Builder::Kalman)).unwrap();
        sequence.build(mesh).unwrap();
        let initial = sequence.report();
        assert_eq!(initial.stage, BuildStage::Initial);
        assert!(initial.splits.iter().all(|split| split.predicted.is_none()));
        sequence.build(mesh).unwrap();
        let running = sequence.report();
        assert_eq!(running.stage, BuildStage::Running);
        assert!(running.splits[0].predicted.is_some());
        sequence.reset();
        sequence.build(mesh).unwrap();
        assert_eq!(sequence.report().splits, initial.splits);
    }

    #[test]
    fn an_initial_build_is_a_normal_one() {
        let (positions, triangles) = sheet(50, 0.0);
        let mesh = Mesh::new(&positions, &triangles).unwrap();
        let search = KdTree::build(mesh, &options(Builder::Search)).unwrap();
        for builder in [Builder::Kalman, Builder::Wiener] {
            let tree = SequenceBuilder::new(&options(builder))
                .unwrap()
                .build(mesh)
                .unwrap();
            assert_eq!(tree.nodes(), search.nodes());
        }
    }

    #[test]
    fn a_still_scene_is_hardly_searched() {
        let (positions, triangles) = sheet(60, 0.0);
        let mesh = Mesh::new(&positions, &triangles).unwrap();
        for builder in [Builder::Kalman, Builder::Wiener] {
            let mut options = options(builder);
            options.tracking.noise.measurement = 0.0;
            let mut sequence = SequenceBuilder::new(&options).unwrap();
            let first = sequence.build(mesh).unwrap();
            let initial = sequence.report();
            for _ in 0..5 {
                let tree = sequence.build(mesh).unwrap();
                let running = sequence.report();
                let kept = [Outcome::Matched, Outcome::EmptySpace];
                let splits = running.splits.iter();
                let lost = splits
                    .filter(|split| !kept.contains(&split.outcome))
                    .count();
                // A plane may still be improved, which changes what its children hold.
                assert!(20 * lost < running.splits.len(), "{builder}: {lost} lost");
                let (now, before) = (running.evaluations, initial.evaluations);
                assert!(5 * now < before, "{builder}: {now} of {before}");
                let ratio = tree.stats().sah_cost / first.stats().sah_cost;
                assert!(ratio < 1.01, "{builder}: {ratio}");
            }
        }
    }

    #[test]
    fn predictions_lie_near_a_slow_motion() {
        let mut sequence = SequenceBuilder::new(&options(Builder::Kalman)).unwrap();
        for frame in 0..6 {
            let (positions, triangles) = sheet(40, 0.002 * frame as f32);
            sequence
                .build(Mesh::new(&positions, &triangles).unwrap())
                .unwrap();
        }
        let report = sequence.report();
        let tracked: Vec<_> = (report.splits.iter())
            .filter(|split| split.outcome == Outcome::Matched)
            .collect();
        assert!(2 * tracked.len() > report.splits.len());
        for split in tracked.iter().filter(|split| split.depth < 4) {
            let error = (split.predicted.unwrap() - split.position).abs();
            assert!(error < 0.2 * split.extent, "{split:?}");
        }
    }

    /// What was one leaf, since no plane divided it, has to be split when it comes apart.
    #[test]
    fn a_heap_that_comes_apart_is_split_again() {
        let (positions, triangles) = sheet(40, 0.0);
        let scaled = |scale: f32| -> Vec<[f32; 3]> {
            let toward = |p: &[f32; 3]| p.map(|x| 0.5 + scale * (x - 0.5));
            positions.iter().map(toward).collect()
        };
        for builder in [Builder::Kalman, Builder::Wiener] {
            let mut sequence = SequenceBuilder::new(&options(builder)).unwrap();
            for scale in [1.0, 1.0, 0.0, 0.0, 1.0, 1.0, 1e-6, 0.01, 0.1, 0.5, 1.0] {
                let positions = scaled(scale);
                let mesh = Mesh::new(&positions, &triangles).unwrap();
                let tree = sequence.build(mesh).unwrap();
                let normal = KdTree::build(mesh, &options(Builder::Search)).unwrap();
                let (cost, normal) = (tree.stats().sah_cost, normal.stats().sah_cost);
                assert!(
                    cost <= 1.15 * normal,
                    "{builder}, {scale}: {cost}, {normal}"
                );
            }
        }
    }

    /// A cluster that grows from a point beside a sheet at rest.
    #[test]
    fn what_grows_is_split_as_it_grows() {
        let (mut positions, mut triangles) = sheet(30, 0.0);
        let (cluster, more) = sheet(30, 0.3);
        let first = positions.len() as u32;
        triangles.extend(
            more.iter()
                .map(|corners| corners.map(|corner| corner + first)),
        );
        let mut sequence = SequenceBuilder::new(&options(Builder::Kalman)).unwrap();
        for frame in 0..12 {
            positions.truncate(first as usize);
            let scale = 0.1 * frame as f32;
            positions.extend(cluster.iter().map(|p| p.map(|x| 1.5 + scale * (x - 0.5))));
            let mesh = Mesh::new(&positions, &triangles).unwrap();
            let tree = sequence.build(mesh).unwrap();
            let normal = KdTree::build(mesh, &options(Builder::Search)).unwrap();
            let (cost, normal) = (tree.stats().sah_cost, normal.stats().sah_cost);
            assert!(cost <= 1.15 * normal, "frame {frame}: {cost}, {normal}");
        }
    }

    /// Algorithm 1 by hand, for the root's split, beside what the builder does.
    #[test]
    fn predictions_follow_the_filters_equations() {
        let mut options = options(Builder::Kalman);
        options.tracking.noise.process = 0.5;
        options.tracking.noise.measurement = 0.01;
        let mut sequence = SequenceBuilder::new(&options).unwrap();
        let (mut x, mut p, mut model) = (0.0, 0.0, None);
        let mut followed = 0;
        for frame in 0..8 {
            let (mut positions, triangles) = sheet(40, 0.0);
            for position in &mut positions {
                position[0] += 0.01 * frame as f32;
            }
            let mesh = Mesh::new(&positions, &triangles).unwrap();
            sequence.build(mesh).unwrap();
            let report = sequence.report();
            let root = report.splits[0];
            let model = *model.get_or_insert_with(|| {
                let initial: Vec<f32> = report.splits.iter().map(|split| split.position).collect();
                options.tracking.noise.kalman_model(&initial).unwrap()
            });
            if frame == 0 || !matches!(root.outcome, Outcome::Matched | Outcome::Drifted) {
                (x, p) = (f64::from(root.position), 0.0);
            } else {
                let predicted = f64::from(root.predicted.unwrap());
                assert!(
                    (predicted - x).abs() < 1e-5,
                    "frame {frame}: {predicted}, not {x}"
                );
                followed += 1;
            }
            let z = f64::from(root.observed.unwrap());
            assert!((z / f64::from(root.position) - 1.0).abs() < 0.06);
            let prior = p + f64::from(model.process_noise);
            let gain = prior / (prior + f64::from(model.measurement_noise));
            x += gain * (z - x);
            p = (1.0 - gain) * prior;
        }
        assert!(followed > 4, "{followed}");
    }

    #[test]
    fn any_number_of_threads_gives_the_same_trees() {
        for builder in [Builder::Search, Builder::Kalman, Builder::Wiener] {
            let run = |threads| {
                let pool = rayon::ThreadPoolBuilder::new()
                    .num_threads(threads)
                    .build()
                    .unwrap();
                let mut sequence = SequenceBuilder::new(&options(builder)).unwrap();
                let mut trees = Vec::new();
                for frame in 0..4 {
                    let (positions, triangles) = sheet(80, 0.01 * frame as f32);
                    let mesh = Mesh::new(&positions, &triangles).unwrap();
                    let tree = pool.install(|| sequence.build(mesh).unwrap());
                    trees.push((tree.nodes().to_vec(), tree.references().to_vec()));
                }
                (trees, sequence.report().splits)
            };
            assert_eq!(run(1), run(3), "{builder}");
        }
    }

    #[test]
    fn an_error_leaves_the_sequence_as_it_was() {
        let (mut positions, triangles) = sheet(20, 0.0);
        let mut sequence = SequenceBuilder::new(&options(Builder::Kalman)).unwrap();
        sequence
            .build(Mesh::new(&positions, &triangles).unwrap())
            .unwrap();
        let mut other = sequence.clone();
        let good = positions[5];
        positions[5][1] = f32::NAN;
        let failed = sequence.build(Mesh::new(&positions, &triangles).unwrap());
        assert!(matches!(failed, Err(BuildError::NonFinite { .. })));
        positions[5] = good;
        let mesh = Mesh::new(&positions, &triangles).unwrap();
        let (tree, expected) = (sequence.build(mesh).unwrap(), other.build(mesh).unwrap());
        assert_eq!(tree.nodes(), expected.nodes());
        assert_eq!(sequence.report().splits, other.report().splits);
    }

    #[test]
    fn frames_may_be_empty_and_change_in_size() {
        for builder in Builder::ALL {
            let mut sequence = SequenceBuilder::new(&options(*builder)).unwrap();
            for n in [0, 30, 1, 12, 0, 40, 3] {
                let (positions, triangles) = sheet(n, 0.1);
                let tree = sequence
                    .build(Mesh::new(&positions, &triangles).unwrap())
                    .unwrap();
                assert!(tree.validate().is_ok(), "{builder} with {n}");
            }
        }
    }

    #[test]
    fn noise_out_of_bounds_is_refused() {
        let mut options = options(Builder::Kalman);
        options.tracking.noise = NoiseParameters {
            measurement: f32::NAN,
            ..NoiseParameters::default()
        };
        let error = SequenceBuilder::new(&options).unwrap_err();
        assert!(
            error
                .to_string()
                .contains("tracking.noise.measurement is NaN"),
            "{error}"
        );
    }

    #[test]
    fn a_state_from_zero_moves_toward_the_planes() {
        let (positions, triangles) = sheet(40, 0.0);
        let mesh = Mesh::new(&positions, &triangles).unwrap();
        let mut options = options(Builder::Kalman);
        options.tracking.initial_state = InitialState::Zero;
        options.tracking.noise.process = 0.0;
        options.tracking.noise.measurement = 0.0;
        let mut sequence = SequenceBuilder::new(&options).unwrap();
        sequence.build(mesh).unwrap();
        let first = sequence.report().splits[0];
        sequence.build(mesh).unwrap();
        let split = sequence.report().splits[0];
        let share = split.predicted.unwrap() / first.position;
        // P⁻ = Q, so K = Q / (Q + R), and without noise Q = R.
        assert!((share - 0.5).abs() < 0.05, "{split:?}");
    }
}
