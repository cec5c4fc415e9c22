//! Subtrees by binning: planes from [`find_split`], boxes cut at every plane.

use fearless_simd::prelude::*;

use super::descent::{self, NodeStart, Split, SplitPolicy};
use super::limits::Limits;
use super::plane_search::find_split;
use super::{BuildOptions, Reference, Subtree};
use crate::{Aabb, Mesh};

/// How subtrees are built by binning.
#[derive(Clone, Copy)]
pub(super) struct Binning<'a> {
    pub(super) mesh: Mesh<'a>,
    /// Triangles that each reference stands for: above 1 for a sample.
    pub(super) weight: u32,
    /// Nodes of this many references or fewer become leaves without a search.
    pub(super) min_split: usize,
    pub(super) options: &'a BuildOptions,
}

impl Binning<'_> {
    /// Builds a subtree over `references`, which overlap `cell`, on this thread.
    /// They are working memory, and worthless afterwards.
    pub(super) fn build(
        mut self,
        references: &mut Vec<Reference>,
        cell: Aabb,
        limits: Limits,
    ) -> Subtree {
        let mesh = self.mesh;
        descent::build(&mut self, mesh, references, start(cell, limits))
    }

    /// Builds the same subtree on all threads.
    pub(super) fn build_parallel(
        mut self,
        mut references: Vec<Reference>,
        cell: Aabb,
        limits: Limits,
    ) -> Subtree {
        let mesh = self.mesh;
        descent::build_parallel(&mut self, mesh, &mut references, start(cell, limits))
    }
}

impl SplitPolicy for Binning<'_> {
    type Place = ();

    const CUTS: bool = true;

    #[inline(always)]
    fn choose<S: Simd>(
        &mut self,
        simd: S,
        members: &[Reference],
        cell: &Aabb,
        limits: &Limits,
        (): (),
    ) -> Option<Split<()>> {
        if !limits.allow_any(members.len(), self.min_split) {
            return None;
        }
        let plane = find_split(simd, members, cell, &self.options.cost, self.weight)?;
        Some(Split {
            plane,
            left: (),
            right: (),
        })
    }

    fn fork(&self) -> Self {
        *self
    }

    fn absorb(&mut self, _: Self) {}
}

fn start(cell: Aabb, limits: Limits) -> NodeStart<()> {
    NodeStart {
        cell,
        limits,
        place: (),
    }
}
