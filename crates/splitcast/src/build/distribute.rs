//! Sorts all triangles into the leaves of a tree whose planes are known.
//!
//! Neighbours in a mesh's order are mostly neighbours in space, so triangles
//! go down the tree in small groups. While the box around a group lies on one
//! side of the planes, a step costs two comparisons for all of them; from the
//! first plane that cuts the box on, the group's members are divided one by
//! one, without branches.

use fearless_simd::Simd;
use rayon::prelude::*;

use super::references::bounds_of_lanes;
use super::straddlers::{divide, sort_by_side};
use super::{Reference, Subtree, Triangles};
use crate::Aabb;
use crate::kd_tree::{Node, NodeKind};
use crate::simd::{Kernel, dispatch};

/// Triangles that go down together. The box around more would be cut by planes
/// earlier, fewer would leave more runs to gather.
const GROUP: usize = 64;

/// Groups that one task takes down: enough to pay for the task, few enough
/// that sixteen threads share a mesh of 20,000 triangles evenly.
const GROUPS_PER_TASK: usize = 16;

/// The triangles of each leaf of a tree, in the order of the mesh.
pub(super) struct Buckets {
    batches: Vec<Batch>,
    /// For each bucket its runs, as (batch, first, count); bucket `b` owns
    /// `starts[b]..starts[b + 1]`.
    runs: Vec<(u32, u32, u32)>,
    starts: Vec<u32>,
}

/// What one task sorted: for each group and bucket it meets, a run of references.
struct Batch {
    references: Vec<Reference>,
    /// Bucket, first, count.
    runs: Vec<(u32, u32, u32)>,
    bounds: Aabb,
}

/// Sorts all triangles into the leaves of `top`.
pub(super) fn distribute(triangles: &Triangles<'_>, top: &Subtree) -> Buckets {
    let leaf_numbers = number_leaves(top);
    let buckets = top.nodes().len().div_ceil(2); // A binary tree has one leaf more than inner nodes.
    let task = GROUP * GROUPS_PER_TASK;
    let batches: Vec<Batch> = (0..triangles.len().div_ceil(task))
        .into_par_iter()
        .map_init(Scratch::default, |scratch, number| {
            dispatch(BatchDescent {
                triangles,
                first: number * task,
                last: triangles.len().min((number + 1) * task),
                nodes: top.nodes(),
                leaf_numbers: &leaf_numbers,
                scratch,
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

/// Working memory of a task.
#[derive(Default)]
struct Scratch {
    members: Vec<Reference>,
    indices: Vec<u16>,
    straddlers: Vec<u16>,
    wholes: Vec<Reference>,
    /// Right children still to be visited: node, start, count.
    right_children: Vec<(usize, usize, usize)>,
}

/// Takes the groups of one batch down the tree.
struct BatchDescent<'a, 'm> {
    triangles: &'a Triangles<'m>,
    first: usize,
    last: usize,
    nodes: &'a [Node],
    leaf_numbers: &'a [u32],
    scratch: &'a mut Scratch,
}

impl Kernel for BatchDescent<'_, '_> {
    type Output = Batch;

    #[inline(always)]
    fn run<S: Simd>(mut self, simd: S) -> Batch {
        let mut batch = Batch {
            // Few triangles of a group meet more than one bucket.
            references: Vec::with_capacity((self.last - self.first) * 3 / 2),
            runs: Vec::with_capacity(4 * GROUPS_PER_TASK),
            bounds: Aabb::EMPTY,
        };
        for first in (self.first..self.last).step_by(GROUP) {
            let members = &mut self.scratch.members;
            members.clear();
            let places = first..self.last.min(first + GROUP);
            members.extend(places.map(|place| self.triangles.reference(place)));
            let bounds = bounds_of_lanes(simd, members);
            batch.bounds = batch.bounds.union(&bounds);
            let entry = enter(self.nodes, &bounds);
            self.descend(simd, entry, &mut batch);
        }
        batch
    }
}

impl BatchDescent<'_, '_> {
    /// Takes the group in `scratch` down from `node`. As in
    /// [`BinnedSubtree`](super::binned_subtree), a node's right side stays in
    /// place and its left side goes behind it.
    #[inline(always)]
    fn descend<S: Simd>(&mut self, simd: S, entry: usize, batch: &mut Batch) {
        let Scratch {
            members,
            indices,
            straddlers,
            wholes,
            right_children,
        } = &mut *self.scratch;
        indices.clear();
        indices.extend(0..members.len() as u16);
        let (mut node, mut start, mut count) = (entry, 0, members.len());
        loop {
            match self.nodes[node].kind() {
                NodeKind::Inner {
                    axis,
                    position,
                    right: right_node,
                } if count > 0 => {
                    let end = start + count;
                    if indices.len() < end + count {
                        indices.resize(end + count, 0);
                    }
                    if straddlers.len() < count {
                        straddlers.resize(count, 0);
                    }
                    let (own, behind) = indices.split_at_mut(end);
                    let own = &mut own[start..];
                    let behind = &mut behind[..count];
                    let sorted = sort_by_side(
                        own,
                        behind,
                        &mut straddlers[..count],
                        |&index| {
                            let reference = &members[index as usize];
                            (reference.min[axis], reference.max[axis])
                        },
                        position,
                    );
                    let (mut left, mut right) = (sorted.left, sorted.right);
                    wholes.clear();
                    let straddlers = straddlers[..sorted.straddling].iter();
                    wholes.extend(straddlers.map(|&index| members[index as usize]));
                    let mesh = self.triangles.mesh();
                    divide(
                        simd,
                        wholes,
                        mesh,
                        axis,
                        position,
                        |left_part, right_part| {
                            behind[left] = members.len() as u16;
                            own[right] = members.len() as u16 + 1;
                            left += usize::from(!left_part.is_empty());
                            right += usize::from(!right_part.is_empty());
                            members.extend([left_part, right_part]);
                        },
                    );
                    right_children.push((right_node, start, right));
                    (node, start, count) = (node + 1, end, left);
                    continue;
                }
                NodeKind::Leaf { .. } if count > 0 => {
                    let first = batch.references.len() as u32;
                    let run = &indices[start..start + count];
                    batch
                        .references
                        .extend(run.iter().map(|&index| members[index as usize]));
                    batch
                        .runs
                        .push((self.leaf_numbers[node], first, count as u32));
                }
                _ => {}
            }
            let Some(next) = right_children.pop() else {
                return;
            };
            (node, start, count) = next;
        }
    }
}

/// The deepest node whose cell holds the whole box.
#[inline(always)]
fn enter(nodes: &[Node], bounds: &Aabb) -> usize {
    let mut node = 0;
    while let NodeKind::Inner {
        axis,
        position,
        right,
    } = nodes[node].kind()
    {
        if bounds.max[axis] <= position {
            node += 1;
        } else if bounds.min[axis] >= position {
            node = right;
        } else {
            break;
        }
    }
    node
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
