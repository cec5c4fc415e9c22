//! Min-max binning over all three axes, in parallel (Shevtsov, Soupikov &
//! Kapustin 2007): the fast full rebuild.

use super::{BuildOptions, NodeWriter, Reference, Subtree};
use crate::{Aabb, CostModel};

/// Candidate planes an axis.
const PLANES: usize = 8;

/// Builds a subtree over `references`, which all overlap `bounds`.
pub(super) fn build(
    references: Vec<Reference>,
    bounds: Aabb,
    max_depth: u32,
    options: &BuildOptions,
) -> Subtree {
    let mut writer = NodeWriter::default();
    recurse(&mut writer, references, bounds, max_depth, options);
    writer.finish()
}

fn recurse(
    writer: &mut NodeWriter,
    references: Vec<Reference>,
    cell: Aabb,
    levels: u32,
    options: &BuildOptions,
) {
    let best = (levels > 0 && references.len() > options.min_split as usize)
        .then(|| find_split(&references, &cell, &options.cost))
        .flatten();
    let Some((axis, position)) = best else {
        writer.leaf(references.iter().map(|r| r.triangle));
        return;
    };
    let left: Vec<_> = references
        .iter()
        .copied()
        .filter(|r| r.min[axis] < position || r.max[axis] <= position)
        .collect();
    let right: Vec<_> = references
        .into_iter()
        .filter(|r| r.max[axis] > position)
        .collect();
    let (left_cell, right_cell) = cell.split(axis, position);
    let inner = writer.open_inner(axis, position);
    recurse(writer, left, left_cell, levels - 1, options);
    writer.begin_right(inner);
    recurse(writer, right, right_cell, levels - 1, options);
}

fn find_split(references: &[Reference], cell: &Aabb, cost: &CostModel) -> Option<(usize, f32)> {
    let mut best = (cost.leaf(references.len() as u32), None);
    let area = cell.half_area();
    for axis in 0..3 {
        for plane in 0..PLANES {
            let share = (plane + 1) as f32 / (PLANES + 1) as f32;
            let position = cell.min[axis] + share * (cell.max[axis] - cell.min[axis]);
            if !(position > cell.min[axis] && position < cell.max[axis]) {
                continue;
            }
            let left = references
                .iter()
                .filter(|r| r.min[axis] < position || r.max[axis] <= position)
                .count();
            let right = references.iter().filter(|r| r.max[axis] > position).count();
            let (left_cell, right_cell) = cell.split(axis, position);
            let c = cost.split(
                (left_cell.half_area() / area, left as u32),
                (right_cell.half_area() / area, right as u32),
            );
            if c < best.0 {
                best = (c, Some((axis, position)));
            }
        }
    }
    best.1
}
