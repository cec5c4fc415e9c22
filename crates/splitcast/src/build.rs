//! Building trees: the options all builders share, and the way from a mesh to
//! a [`KdTree`].

mod binned;
mod binned_subtree;
mod cell_areas;
mod changes;
mod clip;
mod clusters;
mod counts;
mod descent;
mod distribute;
mod hierarchy;
mod limits;
mod line_search;
mod object_split;
mod plane_search;
mod references;
mod regions;
mod running;
mod search;
mod straddlers;
mod subtree;
mod sweep;
mod tracked;

use std::fmt;
use std::str::FromStr;

use crate::kd_tree::KdTree;
use crate::{BuildError, CostModel, Mesh, OptionsError};

pub(crate) use cell_areas::CellAreas;
pub(crate) use counts::count_sides_anywhere;
use limits::Limits;
pub(crate) use references::{Reference, Triangles};
pub(crate) use running::{History, NodeRecord};
pub use running::{InitialState, Outcome, TrackingOptions};
pub use search::{Orientation, ParseOrientationError, SearchOptions};
pub(crate) use subtree::{NodeWriter, Subtree};
pub use tracked::Innovation;
pub(crate) use tracked::{Amount, Budget, Moved, TrackedTree, TrackedUpdate, update};

/// The greatest depth that a tree may have.
pub const MAX_DEPTH: u32 = 60;

/// Positions farther out than this overflow the ray–triangle test, whose
/// largest term is a sum of products of three coordinates: 6 · (2e12)³ < 2¹²⁸.
pub(crate) const MAX_COORDINATE: f32 = 1e12;

/// The algorithm that chooses split planes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub enum Builder {
    /// A tree whose cells overlap ([`KdTree::cells_overlap`]), with each triangle in one leaf; planes by
    /// binning the centers of triangles (Wald 2007). From a sequence's second frame on, what
    /// still holds is carried over, if a [`Tracker`](crate::Tracker) or a
    /// [`SequenceBuilder`](crate::SequenceBuilder) sees every frame. Leaves hold up to 64 triangles,
    /// whatever [`BuildOptions`] say of depth, leaf size and costs.
    Tracked,
    /// Min-max binning over all three axes, in parallel (Shevtsov et al.
    /// 2007): the fast full rebuild.
    #[default]
    Binned,
    /// [`Builder::Search`] in a sequence's first frame; from then on the search
    /// starts at the planes that a Kalman filter predicts (Hussain & Grahn
    /// 2008), if a [`SequenceBuilder`](crate::SequenceBuilder) carries it along.
    Kalman,
    /// The same with a Wiener predictor.
    Wiener,
    /// Golden section search with parabolic interpolation at every node
    /// (Hussain & Grahn 2007), the "normal" build of their 2008 paper.
    Search,
    /// Exact SAH over all planes, with triangles clipped to cells (Wald &
    /// Havran 2006): the reference for quality.
    Sweep,
}

impl Builder {
    /// Every builder, fastest first.
    pub const ALL: &'static [Self] = &[
        Self::Tracked,
        Self::Binned,
        Self::Kalman,
        Self::Wiener,
        Self::Search,
        Self::Sweep,
    ];

    /// The name used on command lines and in tables.
    pub fn name(self) -> &'static str {
        match self {
            Self::Tracked => "tracked",
            Self::Binned => "binned",
            Self::Kalman => "kalman",
            Self::Wiener => "wiener",
            Self::Search => "search",
            Self::Sweep => "sweep",
        }
    }
}

impl fmt::Display for Builder {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

/// A name that no builder has.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("no builder is called '{name}', expected one of: {}", Builder::ALL.iter().map(|b| b.name()).collect::<Vec<_>>().join(", "))]
pub struct ParseBuilderError {
    /// The name that was asked for.
    pub name: String,
}

impl FromStr for Builder {
    type Err = ParseBuilderError;

    fn from_str(name: &str) -> Result<Self, Self::Err> {
        Self::ALL
            .iter()
            .copied()
            .find(|builder| builder.name() == name)
            .ok_or_else(|| ParseBuilderError { name: name.into() })
    }
}

/// What to do with triangles that have a NaN, infinite or absurdly far corner
/// (any coordinate beyond ±1e12).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum NonFinite {
    /// Refuse the mesh and name the first such vertex.
    #[default]
    Reject,
    /// Leave such triangles out and count them in
    /// [`KdTree::skipped_triangles`].
    Skip,
}

/// Ready-made options, from the fastest build to the best tree.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum Preset {
    /// Large leaves: for meshes that change every frame and are hit by few rays.
    FastestBuild,
    /// For meshes that change every frame and are hit by many rays.
    #[default]
    Balanced,
    /// For meshes that are built once and traced for long.
    BestTree,
}

impl Preset {
    /// Every preset, fastest build first.
    pub const ALL: &'static [Self] = &[Self::FastestBuild, Self::Balanced, Self::BestTree];
}

/// How to build a tree. Start from a preset and change what matters:
///
/// ```
/// use splitcast::{BuildOptions, Preset};
/// let options = BuildOptions {
///     max_depth: Some(20),
///     ..BuildOptions::preset(Preset::FastestBuild)
/// };
/// # assert!(options.validate().is_ok());
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BuildOptions {
    /// The algorithm that chooses split planes.
    pub builder: Builder,
    /// What the tree is optimised for.
    pub cost: CostModel,
    /// Nodes this deep become leaves (the root has depth 0), at most
    /// [`MAX_DEPTH`]. `None` stands for `8 + 1.3 · log2(triangles)` (Havran
    /// 2000), which hardly ever cuts a useful split.
    pub max_depth: Option<u32>,
    /// Nodes of this many triangles or fewer become leaves without a search.
    /// The default of 1 leaves the decision to the cost; higher values build
    /// faster and trace slower.
    pub min_split: u32,
    /// What to do with non-finite vertices.
    pub non_finite: NonFinite,
    /// How the builders `search`, `kalman` and `wiener` search.
    pub search: SearchOptions,
    /// How the builders `kalman` and `wiener` track.
    pub tracking: TrackingOptions,
}

impl Default for BuildOptions {
    fn default() -> Self {
        Self::preset(Preset::default())
    }
}

impl BuildOptions {
    /// The options of a preset.
    pub fn preset(preset: Preset) -> Self {
        let balanced = Self {
            builder: Builder::Binned,
            cost: CostModel::default(),
            max_depth: None,
            min_split: 1,
            non_finite: NonFinite::Reject,
            search: SearchOptions::default(),
            tracking: TrackingOptions::default(),
        };
        match preset {
            Preset::FastestBuild => Self {
                cost: CostModel {
                    intersection: 0.05,
                    ..balanced.cost
                },
                min_split: 128,
                ..balanced
            },
            Preset::Balanced => balanced,
            Preset::BestTree => Self {
                builder: Builder::Sweep,
                cost: CostModel {
                    intersection: 0.4,
                    empty_bonus: 0.2,
                    ..balanced.cost
                },
                ..balanced
            },
        }
    }

    /// Checks every field against its bounds.
    ///
    /// # Errors
    /// [`OptionsError`] names the first field that is out of bounds.
    pub fn validate(&self) -> Result<(), OptionsError> {
        self.cost.validate()?;
        self.search.validate()?;
        self.tracking.validate()?;
        match self.max_depth {
            Some(value) if value > MAX_DEPTH => Err(OptionsError::MaxDepth { value }),
            _ => Ok(()),
        }
    }

    /// The depth bound for a mesh of `triangles` triangles.
    fn depth_bound(&self, triangles: usize) -> u32 {
        self.max_depth.unwrap_or_else(|| {
            let levels = 8.0 + 1.3 * (triangles.max(1) as f64).log2();
            (levels as u32).min(MAX_DEPTH)
        })
    }
}

/// A tree, and what a searching builder wrote down about each of its nodes
/// (nothing, from the others).
pub(crate) struct Built<'m> {
    pub(crate) tree: KdTree<'m>,
    pub(crate) records: Vec<NodeRecord>,
}

/// Working memory that searching builders keep between frames: new memory costs
/// a twentieth of their time. The others do well without.
#[derive(Clone, Debug, Default)]
pub(crate) struct Scratch {
    references: Vec<Reference>,
}

/// Builds a tree over `mesh`; the one entry for every builder. A `history`
/// makes a searching builder start from its predictions.
pub(crate) fn build<'m>(
    mesh: Mesh<'m>,
    options: &BuildOptions,
    history: Option<History<'_>>,
    scratch: &mut Scratch,
) -> Result<Built<'m>, BuildError> {
    options.validate()?;
    let triangles = Triangles::of(mesh, options.non_finite)?;
    if options.builder == Builder::Tracked {
        let tree = tracked::build(&triangles, options);
        let records = Vec::new();
        return Ok(Built { tree, records });
    }
    let max_depth = options.depth_bound(triangles.len());
    let limits = Limits::of_tree(max_depth, triangles.len());
    let without_records = |(subtree, bounds)| (subtree, bounds, Vec::new());
    let (subtree, bounds, records) = match options.builder {
        Builder::Tracked | Builder::Binned => {
            without_records(binned::build(&triangles, limits, options))
        }
        Builder::Sweep => without_records(sweep::build(&triangles, limits, options)),
        Builder::Search | Builder::Kalman | Builder::Wiener => search::build(
            &triangles,
            limits,
            options,
            history,
            &mut scratch.references,
        ),
    };
    let tree = subtree.into_tree(mesh, bounds, options.cost, triangles.skipped())?;
    Ok(Built { tree, records })
}
