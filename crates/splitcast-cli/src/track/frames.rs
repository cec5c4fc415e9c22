//! One tracker over all frames of a scene, beside a rebuild of each if asked for.
//!
//! A frame is read before either is timed, and the trees are looked at after both.
//! The two take turns in who goes first, so that neither always finds the
//! frame in the caches.

use std::time::{Duration, Instant};

use serde::Serialize;
use splitcast::{BuildError, BuildOptions, Builder, KdTree, Mesh, Tracker, Update};
use splitcast_console::{Progress, figure};

use crate::error::CliError;
use crate::report::milliseconds;
use crate::scene::{FrameAt, Scene};
use crate::trees::{mesh, refused};

/// What updates are compared with.
pub(crate) const REFERENCE: Builder = Builder::Binned;

/// One update. The shares `kept`, `moved`, `searched` and `rebuilt` are numbers
/// of references.
#[derive(Clone, Debug, Serialize)]
pub(crate) struct FrameFigures {
    /// Its frame's number in the input, from 0.
    pub(crate) frame: usize,
    pub(crate) triangles: usize,
    /// Triangles left out because of a vertex that is not finite.
    pub(crate) skipped_triangles: usize,
    /// Time from the call to the tree.
    pub(crate) update_ms: f64,
    /// Time to build the same frame anew, if that was done.
    pub(crate) rebuild_ms: Option<f64>,
    /// Expected cost of a ray by the surface area heuristic.
    pub(crate) sah_cost: f64,
    /// The cost over that of a rebuild: measured if there was one, otherwise as the
    /// tracker estimates it. Absent if no ray meets the mesh.
    pub(crate) sah_ratio: Option<f64>,
    /// The tracker's estimate.
    pub(crate) sah_ratio_estimate: f64,
    pub(crate) kept: usize,
    pub(crate) moved: usize,
    pub(crate) searched: usize,
    pub(crate) rebuilt: usize,
    /// Triangle references in the tree's leaves.
    pub(crate) references: usize,
    /// Nodes of the tree.
    pub(crate) nodes: usize,
    /// Memory of the tree and of what the tracker holds beside it.
    pub(crate) bytes: usize,
}

impl FrameFigures {
    /// Time of the update over that of the rebuild.
    pub(crate) fn time_ratio(&self) -> Option<f64> {
        let rebuild = self.rebuild_ms.filter(|&ms| ms > 0.0)?;
        Some(self.update_ms / rebuild)
    }

    /// A number of references over that of the whole tree.
    pub(crate) fn share(&self, references: usize) -> Option<f64> {
        (self.references > 0).then(|| references as f64 / self.references as f64)
    }
}

/// Tracks a scene, and rebuilds its frames with [`REFERENCE`] if asked to.
pub(crate) fn measure(
    scene: &mut Scene,
    options: &BuildOptions,
    with_reference: bool,
) -> Result<Vec<FrameFigures>, CliError> {
    let frames = scene.measured.clone();
    let mut tracker = Tracker::new(options).map_err(|error| CliError::Usage(error.to_string()))?;
    // The first time that counts is not to be that of cold code and fresh memory.
    let first = scene.frame(frames[0])?;
    let at = FrameAt::new(scene, frames[0], &first);
    let reference_first = |turn: usize| with_reference.then_some(turn % 2 == 1);
    measure_frame(&at, &mut tracker.clone(), reference_first(0))?;
    let mut progress = Progress::new("tracking", frames.len());
    let mut figures = Vec::with_capacity(frames.len());
    for (turn, &index) in frames.iter().enumerate() {
        let frame = scene.frame(index)?;
        let at = FrameAt::new(scene, index, &frame);
        let measured = measure_frame(&at, &mut tracker, reference_first(turn))?;
        progress.step(&message(&measured));
        figures.push(measured);
    }
    Ok(figures)
}

/// Updates the tracker to a frame. With `reference_first`, the frame is rebuilt
/// as well, before the update or after it.
fn measure_frame(
    at: &FrameAt<'_>,
    tracker: &mut Tracker,
    reference_first: Option<bool>,
) -> Result<FrameFigures, CliError> {
    let mesh = mesh(at.frame, at.number, &at.place)?;
    let (update, rebuilt) = update_and_rebuild(mesh, tracker, reference_first)
        .map_err(|error| refused(&error, at.number, &at.place))?;
    let Update { tree, report } = update;
    let stats = tree.stats();
    let estimate = report.sah_ratio;
    let sah_ratio = match &rebuilt {
        Some((_, rebuilt)) => stats.sah_cost / rebuilt.stats().sah_cost,
        None => estimate,
    };
    Ok(FrameFigures {
        frame: at.number,
        triangles: at.frame.triangles.len(),
        skipped_triangles: tree.skipped_triangles(),
        update_ms: milliseconds(report.time),
        rebuild_ms: rebuilt.map(|(time, _)| milliseconds(time)),
        sah_cost: stats.sah_cost,
        sah_ratio: Some(sah_ratio).filter(|ratio| ratio.is_finite()),
        sah_ratio_estimate: estimate,
        kept: report.kept.references,
        moved: report.moved.references,
        searched: report.searched.references,
        rebuilt: report.rebuilt.references,
        references: stats.references,
        nodes: stats.nodes,
        bytes: stats.bytes + report.tracker_bytes,
    })
}

/// The update, and the tree of a rebuild with the time that it took.
fn update_and_rebuild<'m>(
    mesh: Mesh<'m>,
    tracker: &mut Tracker,
    reference_first: Option<bool>,
) -> Result<(Update<'m>, Option<(Duration, KdTree<'m>)>), BuildError> {
    let options = BuildOptions {
        builder: REFERENCE,
        ..*tracker.options()
    };
    let rebuild = || {
        let started = Instant::now();
        let tree = KdTree::build(mesh, &options);
        tree.map(|tree| (started.elapsed(), tree))
    };
    Ok(match reference_first {
        None => (tracker.update(mesh)?, None),
        Some(false) => (tracker.update(mesh)?, Some(rebuild()?)),
        Some(true) => {
            let rebuilt = rebuild()?;
            (tracker.update(mesh)?, Some(rebuilt))
        }
    })
}

fn message(figures: &FrameFigures) -> String {
    let rebuild = figures
        .rebuild_ms
        .map_or(String::new(), |ms| format!(", rebuild {} ms", figure(ms)));
    format!(
        "frame {}, update {} ms{rebuild}",
        figures.frame,
        figure(figures.update_ms)
    )
}
