//! Trees for the frames of a sequence, one after the other, with what the
//! builders `kalman` and `wiener` carry from frame to frame (Hussain & Grahn
//! 2008, Algorithms 1 and 2).
//!
//! ```text
//! build, searching from the predictions ─► carry the filter over to the new splits ─► correct ─► predict
//! ```
//!
//! The filter has a component for every inner node, in the order of the nodes. A split
//! keeps its component if it stands at the same place in the tree with the same
//! axis; all others start anew at the plane that was found.

use std::time::{Duration, Instant};

use crate::build::{self, Built, History, NodeRecord, Scratch};
use crate::filter::{KalmanFilter, KalmanModel, Predictor, VirtualObservations, WienerPredictor};
use crate::kd_tree::{Node, NodeKind};
use crate::{
    BuildError, BuildOptions, Builder, InitialState, KdTree, Mesh, OptionsError, Outcome, Tracker,
};

/// Builds the trees of a sequence's frames, in order.
///
/// Works with every builder; those that do not track build each frame on its
/// own. Meshes may change in any way between frames, also in their number of
/// triangles: a filter tracks planes in space, and [`Builder::Tracked`] is a [`Tracker`].
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
    tracker: Tracker,
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
}

/// The filter, which has predicted the next frame already, and its components.
/// So a build only reads it, and one that fails leaves it as it was.
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
    /// Time for the filter: noise, carrying over, correction and the next prediction.
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
            tracker: Tracker::new(options)?,
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
        let history = self.tracking.as_ref().map(|tracking| History {
            nodes: &self.last.nodes,
            records: &self.last.records,
            components: &tracking.components,
            predictions: tracking.filter.predictions(),
        });
        let stage = match (self.options.builder, &history) {
            (Builder::Kalman | Builder::Wiener, Some(_)) => BuildStage::Running,
            (Builder::Kalman | Builder::Wiener, None) => BuildStage::Initial,
            _ => BuildStage::Full,
        };
        let started = Instant::now();
        let Built { tree, records } = if self.options.builder == Builder::Tracked {
            Built {
                tree: self.tracker.update(mesh)?.tree,
                records: Vec::new(),
            }
        } else {
            build::build(mesh, &self.options, history, &mut self.scratch)?
        };
        let built = Instant::now();
        let mut filter_time = Duration::ZERO;
        if stage != BuildStage::Full {
            self.track(tree.nodes(), &records)?;
            filter_time = built.elapsed();
        }
        let nodes = if records.is_empty() {
            Vec::new()
        } else {
            tree.nodes().to_vec()
        };
        self.frames += 1;
        self.last = LastBuild {
            stage,
            build_time: built - started,
            filter_time,
            nodes,
            records,
        };
        Ok(tree)
    }

    /// Forgets every frame: the next build is an initial one.
    pub fn reset(&mut self) {
        self.frames = 0;
        self.last = LastBuild::default();
        self.tracking = None;
        self.tracker.reset();
    }

    /// What the last successful build did.
    pub fn report(&self) -> BuildReport {
        let LastBuild { nodes, records, .. } = &self.last;
        let observations =
            (self.tracking.as_ref()).map_or(&[][..], |tracking| tracking.observations.last());
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

    /// Brings the filter up to date with a new tree, and has it predict the next one.
    fn track(&mut self, nodes: &[Node], records: &[NodeRecord]) -> Result<(), OptionsError> {
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
        let tracking = match &mut self.tracking {
            Some(tracking) => tracking,
            // A spread of positions takes two of them; until then every frame is the first one.
            None if positions.len() < 2 => return Ok(()),
            none => {
                let mut filter = Filter::new(&self.options, &positions)?;
                filter.load(initial);
                filter.predict();
                for (component, source) in (0..).zip(&mut sources) {
                    *source = component;
                }
                none.insert(Tracking {
                    filter,
                    observations: VirtualObservations::new(options.noise)?,
                    components: Vec::new(),
                })
            }
        };
        tracking.components = components;
        tracking.filter.carry_over(&sources, initial);
        let observations = tracking.observations.observe(self.frames, &positions);
        tracking.filter.correct(observations);
        tracking.filter.predict();
        Ok(())
    }
}

impl Filter {
    /// The filter of Algorithm 1, or its rival, for the splits of a first frame.
    fn new(options: &BuildOptions, positions: &[f32]) -> Result<Self, OptionsError> {
        let BuildOptions {
            builder, tracking, ..
        } = options;
        Ok(if *builder == Builder::Wiener {
            Self::Wiener(Box::new(WienerPredictor::new(tracking.wiener, 0)?))
        } else {
            let model: KalmanModel = tracking.noise.kalman_model(positions)?;
            let filter = KalmanFilter::new(model, 0);
            Self::Kalman(filter.expect("variances are finite and not negative"))
        })
    }

    /// Where planes are expected in the next frame, by component.
    fn predictions(&self) -> &[f32] {
        match self {
            Self::Kalman(filter) => filter.predictions(),
            Self::Wiener(filter) => filter.predictions(),
        }
    }

    fn predictor(&mut self) -> &mut dyn Predictor {
        match self {
            Self::Kalman(filter) => filter,
            Self::Wiener(filter) => filter.as_mut(),
        }
    }

    fn load(&mut self, initial: &[f32]) {
        self.predictor().load(initial);
    }

    fn predict(&mut self) {
        self.predictor().predict();
    }

    fn carry_over(&mut self, sources: &[u32], initial: &[f32]) {
        self.predictor().carry_over(sources, initial);
    }

    fn correct(&mut self, observations: &[f32]) {
        self.predictor().correct(observations);
    }
}
