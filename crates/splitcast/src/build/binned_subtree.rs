//! Builds a subtree by binning, in one piece of memory for each thread.
//!
//! References are partitioned without branches: each is stored everywhere, and
//! only the end of the side it belongs to moves on. The right side stays
//! where the node was (it cannot overtake the reading), the left side goes
//! behind the node, so the whole descent works at the hot end of one array. What
//! straddles the plane is set aside, and divided by it.

use std::ops::Range;

use fearless_simd::prelude::*;

use super::limits::Limits;
use super::plane_search::{SplitCandidate, find_split};
use super::straddlers::{divide, sort_by_side};
use super::subtree::OpenInner;
use super::{BuildOptions, NodeWriter, Reference, Subtree};
use crate::simd::{Kernel, dispatch};
use crate::{Aabb, Mesh};

/// Nodes with more references than this are split on their own, and their
/// children built at the same time.
const PARALLEL: usize = 4096;

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
        self,
        references: &mut Vec<Reference>,
        cell: Aabb,
        limits: Limits,
    ) -> Subtree {
        dispatch(Descent {
            binning: self,
            references,
            cell,
            limits,
        })
    }

    /// Builds the same subtree on all threads.
    pub(super) fn build_parallel(
        self,
        mut references: Vec<Reference>,
        cell: Aabb,
        limits: Limits,
    ) -> Subtree {
        if references.len() <= PARALLEL {
            return self.build(&mut references, cell, limits);
        }
        let mut writer = NodeWriter::default();
        let count = references.len();
        let Some((split, left)) = dispatch(Step {
            binning: self,
            references: &mut references,
            cell,
            limits: &limits,
        }) else {
            writer.leaf(references.iter().map(|reference| reference.triangle));
            return writer.finish();
        };
        let (left_cell, right_cell) = cell.split(split.axis, split.position);
        let limits = limits.below(1, count, left.len() + references.len());
        let (left, right) = rayon::join(
            || self.build_parallel(left, left_cell, limits),
            || self.build_parallel(references, right_cell, limits),
        );
        let inner = writer.open_inner(split.axis, split.position);
        writer.append(&left);
        writer.begin_right(inner);
        writer.append(&right);
        writer.finish()
    }

    /// Where to split a node, if that pays and is allowed.
    #[inline(always)]
    fn find_split<S: Simd>(
        &self,
        simd: S,
        references: &[Reference],
        cell: &Aabb,
        limits: &Limits,
    ) -> Option<SplitCandidate> {
        let count = references.len();
        // In the worst case every reference goes to both sides.
        if count <= self.min_split || !limits.allow(count, 2 * count) {
            return None;
        }
        find_split(simd, references, cell, &self.options.cost, self.weight)
    }
}

/// A single split: leaves the right side in `references` and gives the left one.
struct Step<'a> {
    binning: Binning<'a>,
    references: &'a mut Vec<Reference>,
    cell: Aabb,
    limits: &'a Limits,
}

impl Kernel for Step<'_> {
    type Output = Option<(SplitCandidate, Vec<Reference>)>;

    #[inline(always)]
    fn run<S: Simd>(self, simd: S) -> Self::Output {
        let Self {
            binning,
            references,
            cell,
            limits,
        } = self;
        let split = binning.find_split(simd, references, &cell, limits)?;
        let count = references.len();
        let (left, right) = partition(
            simd,
            references,
            &mut Vec::new(),
            binning.mesh,
            0..count,
            &split,
        );
        let left = references[count..count + left].to_vec();
        references.truncate(right);
        Some((split, left))
    }
}

/// A node that has not been written yet: a range of the working memory.
struct PendingNode {
    start: usize,
    count: usize,
    cell: Aabb,
    limits: Limits,
}

/// The whole way down.
struct Descent<'a> {
    binning: Binning<'a>,
    references: &'a mut Vec<Reference>,
    cell: Aabb,
    limits: Limits,
}

impl Kernel for Descent<'_> {
    type Output = Subtree;

    #[inline(always)]
    fn run<S: Simd>(self, simd: S) -> Subtree {
        let Self {
            binning,
            references,
            cell,
            limits,
        } = self;
        // Enough for most subtrees: leaves of a dozen references, two references a triangle.
        let count = references.len();
        let mut writer = NodeWriter::with_capacity(count / 3, 2 * count);
        let mut straddlers = Vec::new();
        let mut right_children: Vec<(OpenInner, PendingNode)> = Vec::new();
        let mut node = PendingNode {
            start: 0,
            count,
            cell,
            limits,
        };
        loop {
            let end = node.start + node.count;
            let members = &references[node.start..end];
            let Some(split) = binning.find_split(simd, members, &node.cell, &node.limits) else {
                writer.leaf(members.iter().map(|reference| reference.triangle));
                let Some((inner, right)) = right_children.pop() else {
                    return writer.finish();
                };
                writer.begin_right(inner);
                node = right;
                continue;
            };
            let (left, right) = partition(
                simd,
                references,
                &mut straddlers,
                binning.mesh,
                node.start..end,
                &split,
            );
            let (left_cell, right_cell) = node.cell.split(split.axis, split.position);
            let limits = node.limits.below(1, node.count, left + right);
            right_children.push((
                writer.open_inner(split.axis, split.position),
                PendingNode {
                    start: node.start,
                    count: right,
                    cell: right_cell,
                    limits,
                },
            ));
            node = PendingNode {
                start: end,
                count: left,
                cell: left_cell,
                limits,
            };
        }
    }
}

/// Sorts a node's references to both sides: the right ones to the node's own
/// start, the left ones behind its end. Gives the two counts.
#[inline(always)]
fn partition<S: Simd>(
    simd: S,
    references: &mut Vec<Reference>,
    straddlers: &mut Vec<Reference>,
    mesh: Mesh<'_>,
    node: Range<usize>,
    split: &SplitCandidate,
) -> (usize, usize) {
    let (end, count) = (node.end, node.len());
    if references.len() < end + count {
        references.resize(end + count, Reference::ZERO);
    }
    if straddlers.len() < count {
        straddlers.resize(count, Reference::ZERO);
    }
    let SplitCandidate { axis, position } = *split;
    let (own, behind) = references.split_at_mut(end);
    let own = &mut own[node.start..];
    let behind = &mut behind[..count];
    // A function of its own: in the middle of the kernel the loop runs out of registers.
    let sorted = simd.vectorize(
        #[inline(always)]
        || {
            sort_by_side(
                own,
                behind,
                &mut straddlers[..count],
                |reference| (reference.min[axis], reference.max[axis]),
                position,
            )
        },
    );
    let (mut left, mut right) = (sorted.left, sorted.right);
    let straddlers = &straddlers[..sorted.straddling];
    divide(
        simd,
        straddlers,
        mesh,
        axis,
        position,
        |left_part, right_part| {
            behind[left] = left_part;
            own[right] = right_part;
            left += usize::from(!left_part.is_empty());
            right += usize::from(!right_part.is_empty());
        },
    );
    (left, right)
}
