//! Builds a subtree on one thread, in one piece of memory.
//!
//! References are partitioned without branches: each is stored everywhere, and
//! only the end of the side it belongs to moves on. The right side stays
//! where the node was (it cannot overtake the reading), the left side goes
//! behind the node, so the whole descent works at the hot end of one array. What
//! straddles the plane is set aside, and divided by it.

use fearless_simd::prelude::*;

use super::limits::Limits;
use super::plane_search::{SplitCandidate, find_split};
use super::straddlers::{divide, sort_by_side};
use super::subtree::OpenInner;
use super::{BuildOptions, NodeWriter, Reference, Subtree};
use crate::simd::Kernel;
use crate::{Aabb, Mesh};

/// A subtree to be built by binning.
pub(super) struct BinnedSubtree<'a> {
    /// References that overlap `cell`; used as working memory.
    pub(super) references: &'a mut Vec<Reference>,
    pub(super) mesh: Mesh<'a>,
    pub(super) cell: Aabb,
    pub(super) limits: Limits,
    /// Triangles that each reference stands for: above 1 for a sample.
    pub(super) weight: u32,
    /// Nodes of this many references or fewer become leaves without a search.
    pub(super) min_split: usize,
    pub(super) options: &'a BuildOptions,
}

/// A node that has not been written yet: a range of the working memory.
struct PendingNode {
    start: usize,
    count: usize,
    cell: Aabb,
    limits: Limits,
}

impl Kernel for BinnedSubtree<'_> {
    type Output = Subtree;

    #[inline(always)]
    fn run<S: Simd>(self, simd: S) -> Subtree {
        // Enough for most subtrees: leaves of a dozen references, two references a triangle.
        let count = self.references.len();
        let mut writer = NodeWriter::with_capacity(count / 3, 2 * count);
        let mut straddlers = Vec::new();
        let mut right_children: Vec<(OpenInner, PendingNode)> = Vec::new();
        let mut node = PendingNode {
            start: 0,
            count,
            cell: self.cell,
            limits: self.limits,
        };
        loop {
            let end = node.start + node.count;
            // In the worst case every reference goes to both sides.
            let may_split =
                node.count > self.min_split && node.limits.allow(node.count, 2 * node.count);
            let split = if !may_split {
                None
            } else {
                let members = &self.references[node.start..end];
                find_split(simd, members, &node.cell, &self.options.cost, self.weight)
            };
            let Some(split) = split else {
                let members = &self.references[node.start..end];
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
                self.references,
                &mut straddlers,
                self.mesh,
                &node,
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
    node: &PendingNode,
    split: &SplitCandidate,
) -> (usize, usize) {
    let end = node.start + node.count;
    if references.len() < end + node.count {
        references.resize(end + node.count, Reference::ZERO);
    }
    if straddlers.len() < node.count {
        straddlers.resize(node.count, Reference::ZERO);
    }
    let SplitCandidate { axis, position } = *split;
    let (own, behind) = references.split_at_mut(end);
    let own = &mut own[node.start..];
    let behind = &mut behind[..node.count];
    // A function of its own: in the middle of the kernel the loop runs out of registers.
    let sorted = simd.vectorize(
        #[inline(always)]
        || {
            sort_by_side(
                own,
                behind,
                &mut straddlers[..node.count],
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
