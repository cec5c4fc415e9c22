//! Builds a subtree on one thread, in one piece of memory.
//!
//! References are partitioned without branches: each is stored to both sides,
//! and only the ends of the sides it belongs to move on. The right side stays
//! where the node was (it cannot overtake the reading), the left side goes
//! behind the node, so the whole descent works at the hot end of one array.

use super::plane_search::{SplitCandidate, find_split, overlaps_left, overlaps_right};
use super::subtree::OpenInner;
use super::{BuildOptions, NodeWriter, Reference, Subtree};
use crate::Aabb;
use crate::simd::Kernel;

/// A subtree to be built by binning.
pub(super) struct BinnedSubtree<'a> {
    /// References that overlap `cell`; used as working memory.
    pub(super) references: &'a mut Vec<Reference>,
    pub(super) cell: Aabb,
    /// Levels that may be added.
    pub(super) levels: u32,
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
    levels: u32,
}

impl Kernel for BinnedSubtree<'_> {
    type Output = Subtree;

    #[inline(always)]
    fn run(self) -> Subtree {
        let mut writer = NodeWriter::default();
        let mut right_children: Vec<(OpenInner, PendingNode)> = Vec::new();
        let mut node = PendingNode {
            start: 0,
            count: self.references.len(),
            cell: self.cell,
            levels: self.levels,
        };
        loop {
            let end = node.start + node.count;
            let split = if node.levels == 0 || node.count <= self.min_split {
                None
            } else {
                let members = &self.references[node.start..end];
                find_split(members, &node.cell, &self.options.cost, self.weight)
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
            let (left, right) = partition(self.references, &node, &split);
            let (left_cell, right_cell) = node.cell.split(split.axis, split.position);
            let levels = node.levels - 1;
            right_children.push((
                writer.open_inner(split.axis, split.position),
                PendingNode {
                    start: node.start,
                    count: right,
                    cell: right_cell,
                    levels,
                },
            ));
            node = PendingNode {
                start: end,
                count: left,
                cell: left_cell,
                levels,
            };
        }
    }
}

/// Sorts a node's references to both sides: the right ones to the node's own
/// start, the left ones behind its end. Gives the two counts.
#[inline(always)]
fn partition(
    references: &mut Vec<Reference>,
    node: &PendingNode,
    split: &SplitCandidate,
) -> (usize, usize) {
    let end = node.start + node.count;
    if references.len() < end + node.count {
        references.resize(end + node.count, Reference::ZERO);
    }
    let (own, behind) = references.split_at_mut(end);
    let own = &mut own[node.start..];
    let behind = &mut behind[..own.len()];
    let (mut left, mut right) = (0, 0);
    for read in 0..own.len() {
        let goes_left = overlaps_left(&own[read], split.axis, split.position);
        let goes_right = overlaps_right(&own[read], split.axis, split.position);
        behind[left] = own[read];
        own[right] = own[read];
        left += usize::from(goes_left);
        right += usize::from(goes_right);
    }
    (left, right)
}
