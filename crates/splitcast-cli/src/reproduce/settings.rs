//! What a run of `splitcast reproduce` is made with.

use std::fmt;
use std::str::FromStr;

use serde::{Serialize, Serializer};
use splitcast::filter::NoiseParameters;
use splitcast::{
    BuildOptions, Builder, CostModel, MAX_DEPTH, Orientation, SearchOptions, SequenceBuilder,
    TrackingOptions,
};

use crate::args::{ReproduceArgs, non_finite_name};
use crate::error::CliError;

/// When to stop splitting, which the paper leaves open: at leaves of about 14 triangles, as kd-trees
/// have where every triangle of a leaf is tested. (Rays here meet boxes within leaves, so the
/// library's own are larger.)
const COST: CostModel = CostModel {
    traversal: 1.0,
    intersection: 0.8,
    leaf_width: 8,
    empty_bonus: 0.0,
};

/// A builder that is measured.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub(crate) enum Contender {
    /// The paper's normal build: nothing is known from earlier frames.
    Normal,
    /// The same, with axes chosen as the tracked builds choose them. Only
    /// measured if that differs: it tells what the filter saves from what the
    /// choice of axes does.
    NormalSameAxes,
    /// Tracked with the Kalman filter.
    Kalman,
    /// Tracked with the Wiener predictor.
    Wiener,
    /// The exact build.
    Sweep,
    /// The fast rebuild.
    Binned,
}

impl Contender {
    /// The tracked builds, which make the rows of Table I.
    pub(crate) const TRACKED: [Self; 2] = [Self::Kalman, Self::Wiener];

    /// Name in tables and figures.
    pub(crate) fn name(self) -> &'static str {
        match self {
            Self::Normal => "normal",
            Self::NormalSameAxes => "normal with the axes of running builds",
            Self::Kalman => "kalman",
            Self::Wiener => "wiener",
            Self::Sweep => "sweep",
            Self::Binned => "binned",
        }
    }
}

/// A node's place in a tree: the way to it from the root, in letters L and R.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize)]
pub(crate) struct NodePath(pub(crate) String);

impl NodePath {
    pub(crate) fn root() -> Self {
        Self(String::new())
    }

    /// Words for captions.
    pub(crate) fn in_words(&self) -> String {
        match self.0.len() {
            0 => "root".to_owned(),
            depth => format!("node {} at depth {depth}", self.0),
        }
    }
}

impl fmt::Display for NodePath {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(if self.0.is_empty() { "root" } else { &self.0 })
    }
}

impl FromStr for NodePath {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        let path = text.to_ascii_uppercase();
        if path == "ROOT" {
            return Ok(Self::root());
        }
        if path.is_empty() || path.chars().any(|c| c != 'L' && c != 'R') {
            return Err(
                "write the way from the root in letters L and R, such as LRL, or root".to_owned(),
            );
        }
        if path.len() > MAX_DEPTH as usize {
            return Err(format!("trees have at most {MAX_DEPTH} levels"));
        }
        Ok(Self(path))
    }
}

/// Everything that the figures depend on but the input.
#[derive(Clone, Debug, Serialize)]
pub(crate) struct Settings {
    pub(crate) rounds: usize,
    pub(crate) threads: usize,
    pub(crate) seed: u64,
    pub(crate) noise_process: f32,
    pub(crate) noise_measurement: f32,
    #[serde(serialize_with = "as_text")]
    pub(crate) orientation_normal: Orientation,
    #[serde(serialize_with = "as_text")]
    pub(crate) orientation_running: Orientation,
    pub(crate) frames: Option<String>,
    pub(crate) non_finite: &'static str,
    /// Nodes asked for with `--node`; without any, two are chosen.
    pub(crate) nodes: Vec<NodePath>,
    /// All of it as the library has it, in Rust's notation.
    #[serde(rename = "build_options", serialize_with = "as_notation")]
    base: BuildOptions,
}

impl Settings {
    /// The settings that the arguments ask for.
    pub(crate) fn new(args: &ReproduceArgs) -> Result<Self, CliError> {
        let defaults = BuildOptions::default();
        let known = defaults.tracking.noise;
        let noise = NoiseParameters {
            process: args.noise_process.unwrap_or(known.process),
            measurement: args.noise_measurement.unwrap_or(known.measurement),
            seed: args.seed.unwrap_or(known.seed),
        };
        noise.validate().map_err(|error| {
            CliError::Usage(format!("--noise-process or --noise-measurement: {error}"))
        })?;
        let normal = args.orientation_normal;
        let running = args.orientation_running;
        let search = SearchOptions {
            orientation: normal.unwrap_or(defaults.search.orientation),
            ..defaults.search
        };
        let tracking = TrackingOptions {
            orientation: running.unwrap_or(defaults.tracking.orientation),
            noise,
            ..defaults.tracking
        };
        let base = BuildOptions {
            cost: COST,
            non_finite: args.non_finite,
            search,
            tracking,
            ..defaults
        };
        base.validate()
            .map_err(|error| CliError::Usage(error.to_string()))?;
        let frames = args.frames.map(|range| {
            let end = range.end.map_or(String::new(), |end| end.to_string());
            format!("{}:{end}", range.start)
        });
        Ok(Self {
            rounds: args.rounds.get(),
            threads: args.threads.get(),
            seed: noise.seed,
            noise_process: noise.process,
            noise_measurement: noise.measurement,
            orientation_normal: search.orientation,
            orientation_running: tracking.orientation,
            frames,
            non_finite: non_finite_name(args.non_finite),
            nodes: args.node.clone(),
            base,
        })
    }

    /// Everything that is measured, in the order of tables.
    pub(crate) fn contenders(&self) -> Vec<Contender> {
        let mut all = vec![Contender::Normal];
        if self.orientation_normal != self.orientation_running {
            all.push(Contender::NormalSameAxes);
        }
        all.extend(Contender::TRACKED);
        all.extend([Contender::Sweep, Contender::Binned]);
        all
    }

    /// What a contender's trees are built with.
    pub(crate) fn options(&self, contender: Contender) -> BuildOptions {
        let mut options = self.base;
        options.builder = match contender {
            Contender::Normal | Contender::NormalSameAxes => Builder::Search,
            Contender::Kalman => Builder::Kalman,
            Contender::Wiener => Builder::Wiener,
            Contender::Sweep => Builder::Sweep,
            Contender::Binned => Builder::Binned,
        };
        if contender == Contender::NormalSameAxes {
            options.search.orientation = self.orientation_running;
        }
        options
    }

    /// A builder for a contender's trees that has seen nothing yet.
    pub(crate) fn builder(&self, contender: Contender) -> Result<SequenceBuilder, CliError> {
        SequenceBuilder::new(&self.options(contender))
            .map_err(|error| CliError::Usage(error.to_string()))
    }

    /// Terms and values for the page, those of the builders included.
    pub(crate) fn definitions(&self) -> Vec<(&'static str, String)> {
        let (search, tracking, cost) = (self.base.search, self.base.tracking, self.base.cost);
        let (wiener, noise) = (tracking.wiener, tracking.noise);
        vec![
            ("Rounds", self.rounds.to_string()),
            ("Threads", self.threads.to_string()),
            (
                "Frames",
                self.frames.clone().unwrap_or_else(|| "all".to_owned()),
            ),
            ("Seed", noise.seed.to_string()),
            (
                "Noise",
                format!(
                    "p(w) {} and p(v) {} of the position, standard deviations",
                    noise.process, noise.measurement
                ),
            ),
            (
                "Choice of axes",
                format!(
                    "{} in normal builds, {} in tracked ones",
                    search.orientation, tracking.orientation
                ),
            ),
            (
                "Normal search",
                format!(
                    "to {:.1e} of the node’s extent, at most {} evaluations an axis",
                    search.tolerance, search.max_evaluations
                ),
            ),
            (
                "Tracked search",
                format!(
                    "first step {} of the extent, a further one if it promises {} of the cost; \
                     the axis is looked into again beyond a drift of {}",
                    tracking.step, tracking.gain, tracking.drift
                ),
            ),
            (
                "Wiener predictor",
                format!(
                    "order {}, forgetting {}, noise {}",
                    wiener.order, wiener.forgetting, wiener.noise
                ),
            ),
            (
                "Cost model",
                format!(
                    "traversal {}, intersection {} for each block of {}, empty bonus {}",
                    cost.traversal, cost.intersection, cost.leaf_width, cost.empty_bonus
                ),
            ),
        ]
    }
}

fn as_text<S: Serializer>(value: &impl fmt::Display, serializer: S) -> Result<S::Ok, S::Error> {
    serializer.collect_str(value)
}

fn as_notation<S: Serializer>(value: &impl fmt::Debug, serializer: S) -> Result<S::Ok, S::Error> {
    serializer.collect_str(&format_args!("{value:?}"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn paths_are_read_in_either_case() {
        assert_eq!("lRl".parse(), Ok(NodePath("LRL".to_owned())));
        assert_eq!("root".parse(), Ok(NodePath::root()));
        assert_eq!(NodePath::root().to_string(), "root");
        for bad in ["", "LX", "0", &"L".repeat(61)] {
            assert!(bad.parse::<NodePath>().is_err(), "{bad}");
        }
    }
}
