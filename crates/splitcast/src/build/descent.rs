//! The way from references to a subtree, for every builder that sorts boxes
//! into nodes: a [`SplitPolicy`] says where to split, the descent does the rest,
//! in one piece of memory for each thread.
//!
//! References are partitioned without branches: each is stored everywhere, and
//! only the end of the side it belongs to moves on. The right side stays
//! where the node was (it cannot overtake the reading), the left side goes
//! behind the node, so the whole descent works at the hot end of one array. What
//! straddles the plane is set aside, and goes to both sides.

use std::ops::Range;

use fearless_simd::prelude::*;

use super::limits::Limits;
use super::straddlers::{divide, sort_by_side, sort_to_both_sides};
use super::subtree::OpenInner;
use super::{NodeWriter, Reference, Subtree};
use crate::simd::{Kernel, dispatch};
use crate::{Aabb, Mesh};

/// Nodes with more references than this are split on their own, and their
/// children built at the same time.
const PARALLEL: usize = 4096;

/// A plane that splits a node.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct SplitCandidate {
    pub(super) axis: usize,
    pub(super) position: f32,
}

/// Decides where nodes are split. It is asked once for every node, depth first.
pub(super) trait SplitPolicy: Sized + Send {
    /// What the policy knows of a node beforehand, handed down from its parent.
    type Place: Copy + Send + Sync;

    /// Whether what straddles a plane is cut by it. Otherwise it goes to both sides with
    /// its whole box.
    const CUTS: bool;

    /// Where to split a node of `members` in `cell`; `None` for a leaf. A split that
    /// `limits` would not allow in the worst case must not be chosen.
    fn choose<S: Simd>(
        &mut self,
        simd: S,
        members: &[Reference],
        cell: &Aabb,
        limits: &Limits,
        place: Self::Place,
    ) -> Option<Split<Self::Place>>;

    /// A policy of the same kind for a subtree that is built elsewhere.
    fn fork(&self) -> Self;

    /// Takes back what was forked for the next subtree, in depth-first order.
    fn absorb(&mut self, other: Self);
}

/// A decision of a [`SplitPolicy`].
pub(super) struct Split<P> {
    pub(super) plane: SplitCandidate,
    /// What is known of the children.
    pub(super) left: P,
    pub(super) right: P,
}

/// A node that has not been written yet.
#[derive(Clone, Copy)]
pub(super) struct NodeStart<P> {
    pub(super) cell: Aabb,
    pub(super) limits: Limits,
    pub(super) place: P,
}

impl<P: Copy> NodeStart<P> {
    /// The two children, right after a node of `count` references was split
    /// into `total`.
    #[inline(always)]
    fn children(&self, split: &Split<P>, count: usize, total: usize) -> (Self, Self) {
        let (left, right) = self.cell.split(split.plane.axis, split.plane.position);
        let limits = self.limits.below(1, count, total);
        let child = |cell, place| Self {
            cell,
            limits,
            place,
        };
        (child(left, split.left), child(right, split.right))
    }
}

/// Builds a subtree over `references`, which overlap the node's cell, on this
/// thread. They are working memory, and worthless afterwards.
pub(super) fn build<P: SplitPolicy>(
    policy: &mut P,
    mesh: Mesh<'_>,
    references: &mut Vec<Reference>,
    node: NodeStart<P::Place>,
) -> Subtree {
    dispatch(Descent {
        policy,
        mesh,
        references,
        node,
    })
}

/// Builds the same subtree on all threads.
pub(super) fn build_parallel<P: SplitPolicy>(
    policy: &mut P,
    mesh: Mesh<'_>,
    references: &mut Vec<Reference>,
    node: NodeStart<P::Place>,
) -> Subtree {
    // Passing pieces between threads costs some copying.
    if references.len() <= PARALLEL || rayon::current_num_threads() == 1 {
        return build(policy, mesh, references, node);
    }
    let mut writer = NodeWriter::default();
    let count = references.len();
    let step = dispatch(Step {
        policy: &mut *policy,
        mesh,
        references: &mut *references,
        node: &node,
    });
    let Some((split, mut left)) = step else {
        writer.leaf(references.iter().map(|reference| reference.triangle));
        return writer.finish();
    };
    let (left_node, right_node) = node.children(&split, count, left.len() + references.len());
    let (mut left_policy, mut right_policy) = (policy.fork(), policy.fork());
    let (left, right) = rayon::join(
        || build_parallel(&mut left_policy, mesh, &mut left, left_node),
        || build_parallel(&mut right_policy, mesh, references, right_node),
    );
    policy.absorb(left_policy);
    policy.absorb(right_policy);
    let inner = writer.open_inner(split.plane.axis, split.plane.position);
    writer.append(&left);
    writer.begin_right(inner);
    writer.append(&right);
    writer.finish()
}

/// A single split: leaves the right side in `references` and gives the left one.
struct Step<'a, P: SplitPolicy> {
    policy: &'a mut P,
    mesh: Mesh<'a>,
    references: &'a mut Vec<Reference>,
    node: &'a NodeStart<P::Place>,
}

impl<P: SplitPolicy> Kernel for Step<'_, P> {
    type Output = Option<(Split<P::Place>, Vec<Reference>)>;

    #[inline(always)]
    fn run<S: Simd>(self, simd: S) -> Self::Output {
        let Self {
            policy,
            mesh,
            references,
            node,
        } = self;
        let split = policy.choose(simd, references, &node.cell, &node.limits, node.place)?;
        let count = references.len();
        let (left, right) = partition::<S, P>(
            simd,
            references,
            &mut Vec::new(),
            mesh,
            0..count,
            &split.plane,
        );
        let left = references[count..count + left].to_vec();
        references.truncate(right);
        Some((split, left))
    }
}

/// The whole way down.
struct Descent<'a, P: SplitPolicy> {
    policy: &'a mut P,
    mesh: Mesh<'a>,
    references: &'a mut Vec<Reference>,
    node: NodeStart<P::Place>,
}

impl<P: SplitPolicy> Kernel for Descent<'_, P> {
    type Output = Subtree;

    #[inline(always)]
    fn run<S: Simd>(self, simd: S) -> Subtree {
        let Self {
            policy,
            mesh,
            references,
            mut node,
        } = self;
        // Enough for most subtrees: leaves of a dozen references, two references a triangle.
        let total = references.len();
        references.reserve(2 * total);
        let mut writer = NodeWriter::with_capacity(total / 3, 2 * total);
        let mut straddlers = Vec::new();
        let mut right_children: Vec<(OpenInner, Range<usize>, NodeStart<P::Place>)> = Vec::new();
        let mut range = 0..total;
        loop {
            let members = &references[range.clone()];
            let choice = policy.choose(simd, members, &node.cell, &node.limits, node.place);
            let Some(split) = choice else {
                writer.leaf(members.iter().map(|reference| reference.triangle));
                let Some((inner, right_range, right)) = right_children.pop() else {
                    return writer.finish();
                };
                writer.begin_right(inner);
                (range, node) = (right_range, right);
                continue;
            };
            let (left, right) = partition::<S, P>(
                simd,
                references,
                &mut straddlers,
                mesh,
                range.clone(),
                &split.plane,
            );
            let (left_node, right_node) = node.children(&split, range.len(), left + right);
            right_children.push((
                writer.open_inner(split.plane.axis, split.plane.position),
                range.start..range.start + right,
                right_node,
            ));
            range = range.end..range.end + left;
            node = left_node;
        }
    }
}

/// Sorts a node's references to both sides: the right ones to the node's own
/// start, the left ones behind its end. Gives the two counts.
#[inline(always)]
fn partition<S: Simd, P: SplitPolicy>(
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
    let SplitCandidate { axis, position } = *split;
    let (own, behind) = references.split_at_mut(end);
    let own = &mut own[node.start..];
    let behind = &mut behind[..count];
    let extent = |reference: &Reference| (reference.min[axis], reference.max[axis]);
    // Functions of their own: in the middle of the kernel the loops run out of registers.
    if !P::CUTS {
        return simd.vectorize(
            #[inline(always)]
            || sort_to_both_sides(own, behind, extent, position),
        );
    }
    if straddlers.len() < count {
        straddlers.resize(count, Reference::ZERO);
    }
    let sorted = simd.vectorize(
        #[inline(always)]
        || sort_by_side(own, behind, &mut straddlers[..count], extent, position),
    );
    let (mut left, mut right) = (sorted.left, sorted.right);
    divide(
        simd,
        &straddlers[..sorted.straddling],
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
