//! The figures of a scene: those of the paper for any scene, and what lies
//! below the root.

use splitcast_report::{Axis, Dash, Family, Plot, Role, Series};

use super::builds::{BuildFigures, FrameMeasurement, Level, Outcomes, SceneMeasurement, ratio};
use super::nodes::{AxisFrame, AxisTrack, NodeTrack, Prediction};
use super::paper::SAH_GOAL;
use super::settings::Contender;

/// Shown in place of what needs a second frame.
const NO_RUNNING_BUILD: &str =
    "one frame only: a running build, and with it a prediction, needs a second one";

/// Shown in place of a node's curves.
const NO_NODE: &str = "no frame has an inner node there";

/// Bands of depth that innovations are shown for.
const BANDS: [(usize, usize); 4] = [(0, 3), (4, 7), (8, 11), (12, usize::MAX)];

/// A plot with its caption and the name that its file has without the extension.
pub(crate) struct SceneFigure {
    pub(crate) file: String,
    pub(crate) plot: Plot,
    pub(crate) caption: String,
}

/// Figures of one scene, in the order of the page.
pub(crate) struct SceneFigures {
    /// Those of the paper's Figures 3 and 4: the root's costs and positions,
    /// and the time of builds.
    pub(crate) root: Vec<SceneFigure>,
    /// The same for nodes farther down.
    pub(crate) nodes: Vec<SceneFigure>,
    /// What all nodes do together.
    pub(crate) tree: Vec<SceneFigure>,
}

impl SceneFigures {
    /// The figures; `file` is the scene's name as it stands in file names.
    pub(crate) fn new(file: &str, scene: &SceneMeasurement, nodes: &[NodeTrack]) -> Self {
        let (mut root, mut below) = (Vec::new(), Vec::new());
        for node in nodes {
            let (figures, prefix) = if node.path.0.is_empty() {
                (&mut root, format!("figure3-{file}"))
            } else {
                (&mut below, format!("node-{}-{file}", node.path))
            };
            figures.extend(node_figures(&prefix, node));
        }
        root.push(build_time(format!("figure3-{file}-build-time"), scene));
        root.push(cost_ratio(format!("{file}-cost"), scene));
        Self {
            root,
            nodes: below,
            tree: vec![
                evaluations_by_level(format!("{file}-evaluations-by-depth"), scene),
                error_by_depth(format!("{file}-prediction-error-by-depth"), scene),
                innovation(format!("{file}-innovation"), scene),
                outcomes(format!("{file}-outcomes"), scene),
            ],
        }
    }

    /// All of them.
    pub(crate) fn iter(&self) -> impl Iterator<Item = &SceneFigure> {
        self.root.iter().chain(&self.nodes).chain(&self.tree)
    }
}

/// Cost curves and positions of a node, for each of its axes.
fn node_figures(prefix: &str, node: &NodeTrack) -> Vec<SceneFigure> {
    let name = node.path.in_words();
    if node.axes.is_empty() {
        return vec![SceneFigure {
            file: format!("{prefix}-cost"),
            plot: Plot::new(format!("Split cost, {name}")).no_data(NO_NODE),
            caption: format!("Trees of this scene have no {name} that is split."),
        }];
    }
    let costs = node.axes.iter().map(|axis| {
        let letter = letter(axis.axis);
        SceneFigure {
            file: format!("{prefix}-cost-{letter}"),
            plot: cost_curves(&name, axis),
            caption: format!(
                "Expected cost of splitting the {name} at each plane across {letter}, one curve a \
                 frame, darkest first. The lowest point of a curve is where the plane should be; \
                 how far it wanders from curve to curve is what there is to predict."
            ),
        }
    });
    let positions = node.axes.iter().map(|axis| {
        let letter = letter(axis.axis);
        let origin = if axis.is_tracked {
            "Planes and predictions are those of the tracked builds."
        } else {
            "The builds do not split this node across this axis in every frame, so the planes are \
             the lowest points of the cost curves, and the filters were run over them."
        };
        SceneFigure {
            file: format!("{prefix}-position-{letter}"),
            plot: positions(&name, axis),
            caption: format!(
                "Where the {name} is best split across {letter}, and where the filters had \
                 expected it. Marks are the virtual observations, the plane with measurement \
                 noise added. {origin}"
            ),
        }
    });
    costs.chain(positions).collect()
}

fn cost_curves(name: &str, axis: &AxisTrack) -> Plot {
    let letter = letter(axis.axis);
    let mut family = Family::new("frame");
    for frame in &axis.frames {
        let points = frame.curve.iter();
        family = family.curve(
            frame.frame as f64,
            points.map(|&(x, y)| (f64::from(x), f64::from(y))),
        );
    }
    Plot::new(format!("Split cost, {name}, {letter}"))
        .x(Axis::new(format!("position of the plane, {letter}")))
        .y(Axis::new("expected cost"))
        .family(family)
        .no_data(NO_NODE)
}

fn positions(name: &str, axis: &AxisTrack) -> Plot {
    let letter = letter(axis.axis);
    let predicted = |of: fn(&AxisFrame) -> Option<Prediction>| {
        points(&axis.frames, move |frame| Some(of(frame)?.predicted))
    };
    let observed = points(&axis.frames, |frame| frame.kalman?.observed);
    let actual = points(&axis.frames, |frame| frame.position);
    Plot::new(format!("Split position, {name}, {letter}"))
        .x(Axis::new("frame").whole())
        .y(Axis::new(format!("position of the plane, {letter}")))
        .series(Series::dots("observations", observed).role(Role::S7))
        .series(Series::line("actual", actual).role(Role::S1))
        .series(
            Series::line("kalman", predicted(|frame| frame.kalman))
                .role(Role::S2)
                .dash(Dash::Dashed),
        )
        .series(
            Series::line("wiener", predicted(|frame| frame.wiener))
                .role(Role::S3)
                .dash(Dash::Dotted),
        )
        .no_data(NO_NODE)
}

fn points<'a>(
    frames: &'a [AxisFrame],
    value: impl Fn(&AxisFrame) -> Option<f32> + 'a,
) -> impl Iterator<Item = (f64, f64)> + 'a {
    let value = move |frame| value(frame).map_or(f64::NAN, f64::from);
    frames
        .iter()
        .map(move |frame| (frame.frame as f64, value(frame)))
}

fn build_time(file: String, scene: &SceneMeasurement) -> SceneFigure {
    let time = |contender| {
        let builds = scene.builds(contender);
        builds.map(|(frame, build)| (frame.frame as f64, build.build_ms))
    };
    let mut plot = Plot::new("Build time")
        .x(Axis::new("frame").whole())
        .y(Axis::new("build time").unit("ms").include(0.0));
    for (contender, role, dash) in [
        (Contender::Normal, Role::S1, Dash::Solid),
        (Contender::Kalman, Role::S2, Dash::Solid),
        (Contender::Wiener, Role::S3, Dash::Dashed),
    ] {
        plot = plot.series(
            Series::line(contender.name(), time(contender))
                .role(role)
                .dash(dash),
        );
    }
    SceneFigure {
        file,
        plot,
        caption: "Time to build each frame’s tree, without the filter. The first frame of kalman \
                  and wiener is the initial build; all others start at the predictions."
            .to_owned(),
    }
}

fn cost_ratio(file: String, scene: &SceneMeasurement) -> SceneFigure {
    let cost = |contender| {
        running(scene, contender).map(|(frame, build)| {
            let normal = frame.build(Contender::Normal);
            let ratio = normal.and_then(|normal| ratio(build.sah_cost, normal.sah_cost));
            (frame.frame as f64, ratio.unwrap_or(f64::NAN))
        })
    };
    let frames = running(scene, Contender::Normal).map(|(frame, _)| (frame.frame as f64, SAH_GOAL));
    SceneFigure {
        file,
        plot: Plot::new("Cost of running trees")
            .x(Axis::new("frame").whole())
            .y(Axis::new("SAH cost over that of the normal tree").include(1.0))
            .no_data(NO_RUNNING_BUILD)
            .series(Series::line("kalman", cost(Contender::Kalman)).role(Role::S2))
            .series(
                Series::line("wiener", cost(Contender::Wiener))
                    .role(Role::S3)
                    .dash(Dash::Dashed),
            )
            .series(
                Series::line("goal", frames)
                    .role(Role::Muted)
                    .dash(Dash::Dotted),
            ),
        caption: "Expected cost of the tracked trees, relative to the normal tree of the same \
                  frame. A curve that rises with the frames would mean that planes are held on to \
                  for too long."
            .to_owned(),
    }
}

fn evaluations_by_level(file: String, scene: &SceneMeasurement) -> SceneFigure {
    let series = |contender: Contender| {
        let levels = running_levels(scene, contender).into_iter().enumerate();
        levels.map(|(depth, level)| {
            let mean = level.evaluations as f64 / level.splits as f64;
            (depth as f64, mean)
        })
    };
    SceneFigure {
        file,
        plot: Plot::new("Evaluations by depth")
            .x(Axis::new("depth").whole())
            .y(Axis::new("cost evaluations a split").include(0.0))
            .no_data(NO_RUNNING_BUILD)
            .series(Series::line("normal", series(Contender::Normal)).role(Role::S1))
            .series(Series::line("kalman", series(Contender::Kalman)).role(Role::S2))
            .series(
                Series::line("wiener", series(Contender::Wiener))
                    .role(Role::S3)
                    .dash(Dash::Dashed),
            ),
        caption: "How often the cost was evaluated to find a split, by depth, over all frames but \
                  the first. The distance between the curves is what predictions save."
            .to_owned(),
    }
}

fn error_by_depth(file: String, scene: &SceneMeasurement) -> SceneFigure {
    let series = |contender: Contender| {
        let levels = running_levels(scene, contender).into_iter().enumerate();
        levels.map(|(depth, level)| (depth as f64, level.error().unwrap_or(f64::NAN)))
    };
    SceneFigure {
        file,
        plot: Plot::new("Prediction error by depth")
            .x(Axis::new("depth").whole())
            .y(Axis::new("RMS error over the node’s extent").include(0.0))
            .no_data(NO_RUNNING_BUILD)
            .series(Series::line("kalman", series(Contender::Kalman)).role(Role::S2))
            .series(
                Series::line("wiener", series(Contender::Wiener))
                    .role(Role::S3)
                    .dash(Dash::Dashed),
            ),
        caption: "Difference of prediction and plane as a share of the node’s extent, by depth, \
                  over all frames but the first. Nodes get smaller with depth, and the \
                  motion does not."
            .to_owned(),
    }
}

fn innovation(file: String, scene: &SceneMeasurement) -> SceneFigure {
    let mut plot = Plot::new("Innovation")
        .x(Axis::new("frame").whole())
        .y(Axis::new("RMS innovation over the node’s extent").include(0.0))
        .no_data(NO_RUNNING_BUILD);
    for (from, to) in BANDS {
        let name = if to == usize::MAX {
            format!("depth {from} and more")
        } else {
            format!("depth {from} to {to}")
        };
        let value = |build: &BuildFigures| {
            let levels = build
                .levels
                .iter()
                .skip(from)
                .take((to - from).saturating_add(1));
            let mut band = Level::default();
            levels.for_each(|level| band.merge(level));
            band.innovation().unwrap_or(f64::NAN)
        };
        let builds = running(scene, Contender::Kalman);
        plot = plot.series(Series::line(
            name,
            builds.map(|(frame, build)| (frame.frame as f64, value(build))),
        ));
    }
    SceneFigure {
        file,
        plot,
        caption: "How far the observations of the Kalman filter lie from its predictions, as a \
                  share of the node’s extent, frame by frame and by depth. Noise around a level \
                  means that the filter follows; a trend means that it lags behind."
            .to_owned(),
    }
}

fn outcomes(file: String, scene: &SceneMeasurement) -> SceneFigure {
    type Share = fn(&Outcomes) -> u64;
    let all: [(&str, Share); 6] = [
        ("matched", |outcomes| outcomes.matched),
        ("empty space", |outcomes| outcomes.empty_space),
        ("drifted", |outcomes| outcomes.drifted),
        ("turned", |outcomes| outcomes.turned),
        ("outside", |outcomes| outcomes.outside),
        ("untracked", |outcomes| outcomes.untracked),
    ];
    let mut plot = Plot::new("What became of the predictions (kalman)")
        .x(Axis::new("frame").whole())
        .y(Axis::new("share of the splits").unit("%").include(0.0))
        .no_data(NO_RUNNING_BUILD);
    for (name, share) in all {
        let builds = running(scene, Contender::Kalman);
        plot = plot.series(Series::line(
            name,
            builds.map(|(frame, build)| {
                let outcomes = &build.outcomes;
                let share = 100.0 * share(outcomes) as f64 / outcomes.total() as f64;
                (frame.frame as f64, share)
            }),
        ));
    }
    SceneFigure {
        file,
        plot,
        caption: "Share of the splits by what became of their predictions. Matched: searched from \
                  the prediction. Empty space: cut off again where the content ends, without a \
                  search. Drifted: the axis is the same, but the cost had risen, so the search \
                  began at the extremes. Turned: the axis has changed. Outside: the \
                  prediction lay outside of the node. Untracked: no split stood there a frame \
                  before."
            .to_owned(),
    }
}

/// Builds of a contender in the frames that running builds are compared in;
/// none if there is only one frame.
fn running(
    scene: &SceneMeasurement,
    contender: Contender,
) -> impl Iterator<Item = (&FrameMeasurement, &BuildFigures)> {
    let is_running = |frame: &FrameMeasurement| frame.builds.iter().any(|build| build.running);
    scene
        .builds(contender)
        .filter(move |(frame, _)| is_running(frame))
}

/// Levels of all of those together.
fn running_levels(scene: &SceneMeasurement, contender: Contender) -> Vec<Level> {
    let mut all: Vec<Level> = Vec::new();
    for (_, build) in running(scene, contender) {
        if all.len() < build.levels.len() {
            all.resize(build.levels.len(), Level::default());
        }
        for (sum, level) in all.iter_mut().zip(&build.levels) {
            sum.merge(level);
        }
    }
    all
}

fn letter(axis: usize) -> char {
    ['x', 'y', 'z'][axis]
}
