//! Sorts all triangles into the leaves of a tree whose planes are known.
//!
//! Eight triangles at a time go down the tree like a packet of rays: a node
//! compares all their boxes with its plane at once. Neighbours in a mesh's order
//! are mostly neighbours in space, so a packet meets few nodes more than one
//! triangle would. What straddles a plane is cut by it, as in
//! [`divide`](super::straddlers::divide).

use fearless_simd::prelude::*;
use fearless_simd::{f32x8, mask32x8};
use rayon::prelude::*;

use super::straddlers::{Corners, Cut, LANES, Lanes, load_corners};
use super::{Reference, Subtree, Triangles};
use crate::Aabb;
use crate::kd_tree::{Node, NodeKind};
use crate::simd::{Kernel, dispatch};

/// Triangles that one task takes down: enough to pay for the task, few enough
/// that sixteen threads all have work on a mesh of 20,000 triangles.
const BATCH: usize = 1024;

/// The triangles of each leaf of a tree, in the order of the mesh.
pub(super) struct Buckets {
    batches: Vec<Batch>,
    /// For each bucket its runs, as (batch, first, count); bucket `b` owns
    /// `starts[b]..starts[b + 1]`.
    runs: Vec<(u32, u32, u32)>,
    starts: Vec<u32>,
}

/// What one task sorted.
struct Batch {
    references: Vec<Reference>,
    /// Runs of references in the same bucket: bucket, first, count.
    runs: Vec<(u32, u32, u32)>,
    bounds: Aabb,
}

/// Sorts all triangles into the leaves of `top`.
pub(super) fn distribute(triangles: &Triangles<'_>, top: &Subtree) -> Buckets {
    let leaf_numbers = number_leaves(top);
    // A binary tree has one leaf more than inner nodes.
    let buckets = top.nodes().len().div_ceil(2);
    let batches: Vec<Batch> = (0..triangles.len().div_ceil(BATCH))
        .into_par_iter()
        .map(|number| {
            dispatch(BatchDescent {
                triangles,
                first: number * BATCH,
                last: triangles.len().min((number + 1) * BATCH),
                nodes: top.nodes(),
                leaf_numbers: &leaf_numbers,
            })
        })
        .collect();
    let mut starts = vec![0u32; buckets + 1];
    for &(bucket, _, _) in batches.iter().flat_map(|batch| &batch.runs) {
        starts[bucket as usize + 1] += 1;
    }
    for bucket in 0..buckets {
        starts[bucket + 1] += starts[bucket];
    }
    let mut next = starts.clone();
    let mut runs = vec![(0, 0, 0); starts[buckets] as usize];
    for (number, batch) in batches.iter().enumerate() {
        for &(bucket, first, count) in &batch.runs {
            let slot = &mut next[bucket as usize];
            runs[*slot as usize] = (number as u32, first, count);
            *slot += 1;
        }
    }
    Buckets {
        batches,
        runs,
        starts,
    }
}

impl Buckets {
    /// The box around all triangles.
    pub(super) fn bounds(&self) -> Aabb {
        self.batches
            .iter()
            .fold(Aabb::EMPTY, |bounds, batch| bounds.union(&batch.bounds))
    }

    /// Number of references in all buckets.
    pub(super) fn total(&self) -> usize {
        self.batches
            .iter()
            .map(|batch| batch.references.len())
            .sum()
    }

    /// Appends the references of a bucket to `gathered`.
    pub(super) fn gather(&self, bucket: usize, gathered: &mut Vec<Reference>) {
        let runs = self.starts[bucket] as usize..self.starts[bucket + 1] as usize;
        for &(batch, first, count) in &self.runs[runs] {
            let run = first as usize..(first + count) as usize;
            gathered.extend_from_slice(&self.batches[batch as usize].references[run]);
        }
    }
}

impl Batch {
    /// Appends the marked triangles of a packet to a bucket.
    #[inline(always)]
    fn push<S: Simd>(
        &mut self,
        bucket: u32,
        numbers: &[u32; LANES],
        boxes: &Boxes<S>,
        mut active: u64,
    ) {
        let first = self.references.len() as u32;
        let min: [Lanes; 3] = [
            boxes.min[0].into(),
            boxes.min[1].into(),
            boxes.min[2].into(),
        ];
        let max: [Lanes; 3] = [
            boxes.max[0].into(),
            boxes.max[1].into(),
            boxes.max[2].into(),
        ];
        let count = active.count_ones();
        while active != 0 {
            let lane = active.trailing_zeros() as usize;
            active &= active - 1;
            self.references.push(Reference::new(
                [min[0][lane], min[1][lane], min[2][lane]],
                [max[0][lane], max[1][lane], max[2][lane]],
                numbers[lane],
            ));
        }
        match self.runs.last_mut() {
            Some(last) if last.0 == bucket => last.2 += count,
            _ => self.runs.push((bucket, first, count)),
        }
    }
}

/// For each node of `top` that is a leaf, its number among the leaves.
fn number_leaves(top: &Subtree) -> Vec<u32> {
    top.nodes()
        .iter()
        .scan(0, |leaves, node| {
            let number = *leaves;
            *leaves += u32::from(matches!(node.kind(), NodeKind::Leaf { .. }));
            Some(number)
        })
        .collect()
}

/// The boxes of a packet of triangles, by axis.
#[derive(Clone, Copy)]
struct Boxes<S: Simd> {
    min: [f32x8<S>; 3],
    max: [f32x8<S>; 3],
}

/// A packet with a node still to be visited.
struct Pending<S: Simd> {
    node: usize,
    /// A bit for each triangle that reaches the node.
    active: u64,
    boxes: Boxes<S>,
}

/// Takes the packets of one batch down the tree.
struct BatchDescent<'a, 'm> {
    triangles: &'a Triangles<'m>,
    first: usize,
    last: usize,
    nodes: &'a [Node],
    leaf_numbers: &'a [u32],
}

impl Kernel for BatchDescent<'_, '_> {
    type Output = Batch;

    #[inline(always)]
    fn run<S: Simd>(self, simd: S) -> Batch {
        let mut batch = Batch {
            // Few triangles meet more than one bucket.
            references: Vec::with_capacity((self.last - self.first) * 3 / 2),
            runs: Vec::with_capacity(BATCH / 8),
            bounds: Aabb::EMPTY,
        };
        let mut bounds = Boxes {
            min: [f32x8::splat(simd, f32::INFINITY); 3],
            max: [f32x8::splat(simd, f32::NEG_INFINITY); 3],
        };
        let mut pending: Vec<Pending<S>> = Vec::new();
        for first in (self.first..self.last).step_by(LANES) {
            let count = (self.last - first).min(LANES);
            let (numbers, corners) = self.load(first, count);
            let corners = load_corners(simd, &corners);
            let mut boxes = bounds;
            for k in 0..3 {
                let (a, b, c) = (corners[0][k], corners[1][k], corners[2][k]);
                boxes.min[k] = a.min(b).min(c);
                boxes.max[k] = a.max(b).max(c);
                bounds.min[k] = bounds.min[k].min(boxes.min[k]);
                bounds.max[k] = bounds.max[k].max(boxes.max[k]);
            }
            let active = (1 << count) - 1;
            self.descend(
                simd,
                active,
                boxes,
                &corners,
                &mut pending,
                |bucket, active, boxes| {
                    batch.push(bucket, &numbers, boxes, active);
                },
            );
        }
        for k in 0..3 {
            let (min, max): (Lanes, Lanes) = (bounds.min[k].into(), bounds.max[k].into());
            // Adding 0 turns -0 into 0: which of the two a minimum gives depends on the
            // instruction set.
            batch.bounds.min[k] = min.into_iter().fold(f32::INFINITY, f32::min) + 0.0;
            batch.bounds.max[k] = max.into_iter().fold(f32::NEG_INFINITY, f32::max) + 0.0;
        }
        batch
    }
}

impl BatchDescent<'_, '_> {
    /// Indices and corners (by corner, axis and lane) of a packet of `count`
    /// triangles; the lanes behind repeat the last.
    #[inline(always)]
    fn load(&self, first: usize, count: usize) -> ([u32; LANES], [[Lanes; 3]; 3]) {
        let mut numbers = [0; LANES];
        let mut corners = [[[0.0; LANES]; 3]; 3];
        for lane in 0..LANES {
            let number = self.triangles.triangle(first + lane.min(count - 1));
            numbers[lane] = number;
            let [a, b, c] = self.triangles.mesh().corners(number);
            for k in 0..3 {
                corners[0][k][lane] = a[k];
                corners[1][k][lane] = b[k];
                corners[2][k][lane] = c[k];
            }
        }
        (numbers, corners)
    }

    /// Takes a packet down the tree: calls `arrive` for each leaf it reaches.
    #[inline(always)]
    fn descend<S: Simd>(
        &self,
        simd: S,
        active: u64,
        boxes: Boxes<S>,
        corners: &Corners<S>,
        pending: &mut Vec<Pending<S>>,
        mut arrive: impl FnMut(u32, u64, &Boxes<S>),
    ) {
        let (mut node, mut active, mut boxes) = (0, active, boxes);
        loop {
            match self.nodes[node].kind() {
                NodeKind::Inner {
                    axis,
                    position,
                    right: right_node,
                } => {
                    let begins_left = boxes.min[axis].simd_lt(position).to_bitmask();
                    let ends_right = boxes.max[axis].simd_gt(position).to_bitmask();
                    let straddling = active & begins_left & ends_right;
                    let mut left = active & !ends_right;
                    let mut right = active & ends_right & !begins_left;
                    let mut right_boxes = boxes;
                    if straddling != 0 {
                        let parts = cut(simd, &boxes, corners, axis, position, straddling);
                        (boxes, right_boxes) = parts;
                        left |= straddling & !empty(&boxes);
                        right |= straddling & !empty(&right_boxes);
                    }
                    if left != 0 {
                        if right != 0 {
                            pending.push(Pending {
                                node: right_node,
                                active: right,
                                boxes: right_boxes,
                            });
                        }
                        (node, active) = (node + 1, left);
                        continue;
                    } else if right != 0 {
                        (node, active, boxes) = (right_node, right, right_boxes);
                        continue;
                    }
                }
                NodeKind::Leaf { .. } => arrive(self.leaf_numbers[node], active, &boxes),
            }
            let Some(next) = pending.pop() else {
                return;
            };
            Pending {
                node,
                active,
                boxes,
            } = next;
        }
    }
}

/// Cuts the straddling triangles of a packet; the boxes of the others stay.
#[inline(always)]
fn cut<S: Simd>(
    simd: S,
    boxes: &Boxes<S>,
    corners: &Corners<S>,
    axis: usize,
    position: f32,
    straddling: u64,
) -> (Boxes<S>, Boxes<S>) {
    let straddling = mask32x8::from_bitmask(simd, straddling);
    let cut = Cut::new(corners, axis, position);
    let (mut left, mut right) = (*boxes, *boxes);
    for k in 0..3 {
        let parts = cut.parts(corners, k);
        let (min, max) = (boxes.min[k], boxes.max[k]);
        left.min[k] = straddling.select(min.max(parts.left_min), min);
        left.max[k] = straddling.select(max.min(parts.left_max), max);
        right.min[k] = straddling.select(min.max(parts.right_min), min);
        right.max[k] = straddling.select(max.min(parts.right_max), max);
    }
    left.max[axis] = left.max[axis].min(position);
    right.min[axis] = right.min[axis].max(position);
    (left, right)
}

/// A bit for each box that nothing is left of.
#[inline(always)]
fn empty<S: Simd>(boxes: &Boxes<S>) -> u64 {
    let empty = |k: usize| boxes.min[k].simd_gt(boxes.max[k]);
    (empty(0) | empty(1) | empty(2)).to_bitmask()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Mesh;
    use crate::build::clip::clipped_bounds;
    use crate::build::references::bounds_of;
    use crate::build::{NodeWriter, NonFinite};

    /// Every bucket gets the triangles that reach into its cell, once, in order,
    /// also when a group is cut by every plane and when it is cut by none.
    #[test]
    fn buckets_hold_what_overlaps_their_cells() {
        let mut seed = 1_u32;
        let mut random = || {
            seed = seed.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            (seed >> 8) as f32 / (1 << 24) as f32
        };
        let mut positions = Vec::new();
        for triangle in 0..3000 {
            // First a soup of triangles all over the place, then small ones in order of place.
            let size = if triangle < 500 { 1.0 } else { 0.02 };
            let place = [triangle as f32 / 3000.0, random(), 0.5];
            for _ in 0..3 {
                positions.push(place.map(|x| x + size * (random() - 0.5)));
            }
        }
        let triangles: Vec<[u32; 3]> = (0..3000).map(|t| [3 * t, 3 * t + 1, 3 * t + 2]).collect();
        let mesh = Mesh::new(&positions, &triangles).expect("indices are in range");
        let triangles = Triangles::of(mesh, NonFinite::Reject).expect("all are finite");

        let mut writer = NodeWriter::default();
        let mut cells = Vec::new();
        write_grid(
            &mut writer,
            &mut cells,
            Aabb {
                min: [-1.0; 3],
                max: [2.0; 3],
            },
            7,
        );
        let top = writer.finish();
        let buckets = distribute(&triangles, &top);

        assert_eq!(buckets.bounds(), bounds_of(&triangles.references()));
        for (bucket, cell) in cells.iter().enumerate() {
            let mut gathered = Vec::new();
            buckets.gather(bucket, &mut gathered);
            let members: Vec<u32> = gathered.iter().map(|r| r.triangle).collect();
            let mut sorted = members.clone();
            sorted.sort_unstable();
            sorted.dedup();
            assert_eq!(
                sorted.len(),
                members.len(),
                "a triangle twice in one bucket"
            );
            for triangle in 0..3000 {
                if let Some(part) = clipped_bounds(&mesh.corners(triangle), cell) {
                    let touching = (0..3).any(|k| {
                        part.min[k] >= cell.max[k] - 1e-6 || part.max[k] <= cell.min[k] + 1e-6
                    });
                    assert!(
                        touching || sorted.binary_search(&triangle).is_ok(),
                        "{triangle} is missing in {bucket}"
                    );
                }
            }
        }
    }

    /// Halves the cell `levels` times, on one axis after the other.
    fn write_grid(writer: &mut NodeWriter, cells: &mut Vec<Aabb>, cell: Aabb, levels: usize) {
        if levels == 0 {
            writer.leaf(std::iter::empty());
            cells.push(cell);
            return;
        }
        let axis = levels % 3;
        let position = 0.5 * (cell.min[axis] + cell.max[axis]);
        let (left, right) = cell.split(axis, position);
        let inner = writer.open_inner(axis, position);
        write_grid(writer, cells, left, levels - 1);
        writer.begin_right(inner);
        write_grid(writer, cells, right, levels - 1);
    }
}
