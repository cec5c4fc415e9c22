//! Min-max binning over all three axes, in parallel (Shevtsov, Soupikov &
//! Kapustin 2007): the fast full rebuild.
//!
//! Three phases keep all work in cache and off the upper levels:
//!
//! 1. a *top tree* over a sample of the triangles, down to buckets;
//! 2. every triangle is sorted into the buckets it overlaps ([`distribute`]);
//! 3. each bucket is finished on its own ([`Binning`]).
//!
//! Counts of a sample only choose planes; what lies where is decided for every
//! triangle, so sampling costs quality (little), never a hit. Small meshes are
//! a single bucket. All sizes below are fixed, so the tree does not depend on
//! the number of threads.

use rayon::prelude::*;

use super::binned_subtree::Binning;
use super::distribute::distribute;
use super::limits::Limits;
use super::references::bounds_of;
use super::{BuildOptions, NodeWriter, Reference, Subtree, Triangles};
use crate::Aabb;
use crate::kd_tree::NodeKind;

/// Triangles that one reference of the sample stands for.
const SAMPLE_STRIDE: usize = 8;

/// Triangles in a bucket, about: small enough for a second-level cache, large
/// enough that the top tree, which sees one in [`SAMPLE_STRIDE`], decides on
/// 128 of them or more.
const BUCKET: usize = 1024;

/// Meshes below this size are one bucket.
const SMALL_MESH: usize = 4 * BUCKET;

/// Builds a subtree over `triangles`; gives it with the box around them.
pub(super) fn build(
    triangles: &Triangles<'_>,
    limits: Limits,
    options: &BuildOptions,
) -> (Subtree, Aabb) {
    let binning = Binning {
        mesh: triangles.mesh(),
        weight: 1,
        min_split: options.min_split as usize,
        options,
    };
    if triangles.len() < SMALL_MESH {
        let mut references = triangles.references();
        let bounds = bounds_of(&references);
        return (binning.build(&mut references, bounds, limits), bounds);
    }
    let top = top_tree(triangles, limits, options);
    let buckets = distribute(triangles, &top);
    let bounds = buckets.bounds();
    let total = buckets.total();
    let subtrees: Vec<Subtree> = leaf_cells(&top, bounds)
        .par_iter()
        .enumerate()
        .map_init(Vec::new, |scratch, (bucket, &(cell, depth))| {
            scratch.clear();
            buckets.gather(bucket, scratch);
            let limits = limits.below(depth, triangles.len(), total);
            binning.build(scratch, cell, limits)
        })
        .collect();
    // Freeing takes its time, too.
    let (subtree, ()) = rayon::join(|| assemble(&top, &subtrees), || drop(buckets));
    (subtree, bounds)
}

/// The tree above the buckets, which are its leaves.
pub(super) fn top_tree(
    triangles: &Triangles<'_>,
    limits: Limits,
    options: &BuildOptions,
) -> Subtree {
    if triangles.len() < SMALL_MESH {
        let mut writer = NodeWriter::default();
        writer.leaf(std::iter::empty());
        return writer.finish();
    }
    let sample = sample(triangles);
    let bounds = bounds_of(&sample);
    let binning = Binning {
        mesh: triangles.mesh(),
        weight: SAMPLE_STRIDE as u32,
        // A reference of the sample is at least one triangle, so `min_split` holds as it is.
        min_split: (options.min_split as usize).max(BUCKET / SAMPLE_STRIDE),
        options,
    };
    binning.build_parallel(sample, bounds, limits)
}

/// Every [`SAMPLE_STRIDE`]th triangle, but for a scramble of the places, so
/// that no regular order of the mesh can hide parts of it.
fn sample(triangles: &Triangles<'_>) -> Vec<Reference> {
    (0..triangles.len() / SAMPLE_STRIDE)
        .into_par_iter()
        .with_min_len(BUCKET)
        .map(|chunk| {
            // As in Fibonacci hashing (Knuth, TAOCP 6.4): bits of a multiple of 2³²/φ.
            let scramble = (chunk as u32).wrapping_mul(0x9E37_79B9) >> 16;
            let place = scramble as usize % SAMPLE_STRIDE;
            triangles.reference(chunk * SAMPLE_STRIDE + place)
        })
        .collect()
}

/// Cells and depths of a subtree's leaves, in order.
pub(super) fn leaf_cells(top: &Subtree, bounds: Aabb) -> Vec<(Aabb, u32)> {
    let mut cells = Vec::new();
    let mut right_children = Vec::new();
    let (mut cell, mut depth) = (bounds, 0);
    for node in top.nodes() {
        match node.kind() {
            NodeKind::Inner { axis, position, .. } => {
                let (left, right) = cell.split(axis, position);
                depth += 1;
                right_children.push((right, depth));
                cell = left;
            }
            NodeKind::Leaf { .. } => {
                cells.push((cell, depth));
                if let Some(next) = right_children.pop() {
                    (cell, depth) = next;
                }
            }
        }
    }
    cells
}

/// Puts the buckets' subtrees in the place of the top tree's leaves.
fn assemble(top: &Subtree, subtrees: &[Subtree]) -> Subtree {
    let nodes = subtrees
        .iter()
        .map(|subtree| subtree.nodes().len())
        .sum::<usize>();
    let references = subtrees.iter().map(Subtree::reference_count).sum();
    let mut writer = NodeWriter::with_capacity(top.nodes().len() + nodes, references);
    let mut right_children = Vec::new();
    let mut buckets = subtrees.iter();
    for node in top.nodes() {
        match node.kind() {
            NodeKind::Inner { axis, position, .. } => {
                right_children.push(writer.open_inner(axis, position));
            }
            NodeKind::Leaf { .. } => {
                writer.append(
                    buckets
                        .next()
                        .expect("one subtree for each leaf of the top"),
                );
                if let Some(inner) = right_children.pop() {
                    writer.begin_right(inner);
                }
            }
        }
    }
    writer.finish()
}
