//! Trees for the frames of an animation, each made from the one before.

use std::ops::Range;
use std::time::{Duration, Instant};

use crate::build::{self, Amount, Budget, Innovation, Moved, TrackedTree, TrackedUpdate};
use crate::{BuildError, BuildOptions, Builder, KdTree, Mesh, OptionsError};

/// Keeps a tree over a deforming mesh: give it frame after frame.
///
/// The first update builds; later ones carry over what still holds. A tree
/// answers every query like one that was built anew, whatever was predicted.
/// Trees are values of their own: the last one can be traced, on any thread,
/// while the next is prepared, and an update that fails changes nothing.
///
/// ```
/// use splitcast::{BuildOptions, Mesh, Ray, Tracker};
/// let triangles = [[0, 1, 2]];
/// let mut positions = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]];
/// let mut tracker = Tracker::new(&BuildOptions::default())?;
/// for _ in 0..3 {
///     positions[2][1] += 0.1;
///     let update = tracker.update(Mesh::new(&positions, &triangles)?)?;
///     let hit = update.tree.closest_hit(&Ray::new([0.2, 0.2, 1.0], [0.0, 0.0, -1.0]));
///     assert_eq!(hit.map(|hit| hit.t), Some(1.0));
/// }
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug)]
pub struct Tracker {
    options: BuildOptions,
    frames: u64,
    last: Option<TrackedTree>,
}

/// What an update gives.
#[derive(Clone, Debug)]
pub struct Update<'m> {
    /// The tree over the frame's mesh.
    pub tree: KdTree<'m>,
    /// What was done to get it.
    pub report: UpdateReport,
}

/// What an update did.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct UpdateReport {
    /// Number of the update, from 0.
    pub frame: u64,
    /// Time from the call to the tree.
    pub time: Duration,
    /// Parts of the tree that are as they were.
    pub kept: Share,
    /// Parts in which something moved, and whose boxes follow it.
    pub moved: Share,
    /// Parts that were sorted anew.
    pub searched: Share,
    /// Parts that were built anew, down to the blocks of neighboring triangles.
    pub rebuilt: Share,
    /// Triangles for whose blocks there was no time ([`Tracker::update_within`]).
    pub late: usize,
    /// Expected cost of a ray ([`TreeStats::traced_cost`](crate::TreeStats::traced_cost)).
    pub sah_cost: f64,
    /// By what factor the tree is taken to be worse than a new one, predicted from how far blocks
    /// and leaves have grown, and what that meant when all was last built anew; 1 if nothing is
    /// known. Above 1.08 all is built anew.
    pub sah_ratio: f64,
    /// How much the mesh differs from what was predicted of it, on each level of the tree.
    pub innovation: Innovation,
    /// Memory that the tracker holds from this update to the next, without the
    /// tree, which it shares, in bytes.
    pub tracker_bytes: usize,
}

/// A part of a tree.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Share {
    /// Nodes of both kinds.
    pub nodes: usize,
    /// References in leaves.
    pub references: usize,
}

impl From<Amount> for Share {
    fn from(Amount { nodes, references }: Amount) -> Self {
        Self { nodes, references }
    }
}

impl Tracker {
    /// A tracker that has seen no frame. [`BuildOptions::builder`] does not
    /// matter to it.
    ///
    /// # Errors
    /// Names the first option that is out of its bounds.
    pub fn new(options: &BuildOptions) -> Result<Self, OptionsError> {
        options.validate()?;
        Ok(Self {
            options: BuildOptions {
                builder: Builder::Binned,
                ..*options
            },
            frames: 0,
            last: None,
        })
    }

    /// The options that were given.
    pub fn options(&self) -> &BuildOptions {
        &self.options
    }

    /// Makes the tree of the next frame. Anything may have changed, also the
    /// number of vertices and triangles.
    ///
    /// # Errors
    /// As [`KdTree::build`]; the tracker is then as if it had not been called.
    pub fn update<'m>(&mut self, mesh: Mesh<'m>) -> Result<Update<'m>, BuildError> {
        self.advance(mesh, &Moved::Unknown, None)
    }

    /// [`Tracker::update`] for a frame in which only the triangles in `dirty` have moved
    /// since the last update, which saves hashing the mesh and looking for what has moved.
    ///
    /// Where a triangle outside of these ranges has moved, rays may miss it. With
    /// another number of triangles than in the last frame, what has moved is
    /// found out, as [`Tracker::update`] does.
    ///
    /// # Errors
    /// As [`Tracker::update`].
    pub fn update_dirty<'m>(
        &mut self,
        mesh: Mesh<'m>,
        dirty: &[Range<usize>],
    ) -> Result<Update<'m>, BuildError> {
        self.advance(mesh, &Moved::Only(dirty), None)
    }

    /// [`Tracker::update`] that spends about `budget` at most, if boxes can be brought up to date within
    /// it. The tree is valid at once; what there was no time to sort or to form anew
    /// comes in the next updates. The tree depends on the machine's speed.
    ///
    /// # Errors
    /// As [`Tracker::update`].
    pub fn update_within<'m>(
        &mut self,
        mesh: Mesh<'m>,
        budget: Duration,
    ) -> Result<Update<'m>, BuildError> {
        self.advance(mesh, &Moved::Unknown, Some(budget))
    }

    /// Forgets all frames.
    pub fn reset(&mut self) {
        self.frames = 0;
        self.last = None;
    }

    fn advance<'m>(
        &mut self,
        mesh: Mesh<'m>,
        moved: &Moved<'_>,
        budget: Option<Duration>,
    ) -> Result<Update<'m>, BuildError> {
        let budget = Budget {
            started: Instant::now(),
            duration: budget,
        };
        let TrackedUpdate {
            tree,
            amounts,
            late,
            quality,
        } = build::update(mesh, &self.options, &mut self.last, moved, budget)?;
        let time = budget.started.elapsed();
        let report = UpdateReport {
            frame: self.frames,
            time,
            kept: amounts.kept.into(),
            moved: amounts.moved.into(),
            searched: amounts.searched.into(),
            rebuilt: amounts.rebuilt.into(),
            late,
            sah_cost: quality.cost,
            sah_ratio: quality.ratio,
            innovation: quality.innovation,
            tracker_bytes: size_of::<Self>() + self.last.as_ref().map_or(0, TrackedTree::bytes),
        };
        self.frames += 1;
        Ok(Update { tree, report })
    }
}
