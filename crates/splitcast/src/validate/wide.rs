//! Whether the wide form of a tree says what the kd-tree says.

#[cfg(test)]
mod tests;

use super::{Violation, Violations};
use crate::wide::{Block, LANES, WideNode};
use crate::{Aabb, KdTree, NodeKind};

impl KdTree<'_> {
    /// Compares the wide form with a kd-tree that is sound.
    pub(super) fn check_wide(&self, violations: &mut Violations) {
        let mut leaves = 0;
        self.visit(|visit| {
            if let NodeKind::Leaf { first, count } = visit.kind {
                let mut triangles = self.references()[first..first + count].to_vec();
                triangles.sort_unstable();
                let leaf = Leaf {
                    node: visit.index,
                    // What counts of its triangles.
                    cell: if self.cells_overlap() {
                        Aabb::EVERYTHING
                    } else {
                        visit.cell
                    },
                    triangles,
                };
                self.check_wide_leaf(leaves, &leaf, violations);
                leaves += 1;
            }
        });
        self.check_wide_inner(leaves, violations);
    }

    /// Compares a leaf with its wide node, the one at `index`.
    fn check_wide_leaf(&self, index: usize, leaf: &Leaf, violations: &mut Violations) {
        let wide = self.wide();
        let node = leaf.node;
        let found = wide.nodes.get(index);
        let Some(wide_node) = found.filter(|found| found.is_leaf()) else {
            return violations.report(Violation::NoWideLeaf { node });
        };
        let mut held = Vec::new();
        for lane in 0..LANES {
            let range = wide_node.blocks(lane);
            for index in range {
                let Some(block) = wide.blocks.find(index) else {
                    violations.report(Violation::NoBlock { node, lane, index });
                    break;
                };
                held.extend(block.triangles);
                self.check_block(leaf, (wide_node, lane), block, violations);
            }
        }
        held.sort_unstable();
        for &triangle in &leaf.triangles {
            if held.binary_search(&triangle).is_err() {
                violations.report(Violation::NotInBlocks { node, triangle });
            }
        }
    }

    /// Looks at the triangles in a block of a lane.
    fn check_block(
        &self,
        leaf: &Leaf,
        (wide_node, lane): (&WideNode, usize),
        block: &Block,
        violations: &mut Violations,
    ) {
        let node = leaf.node;
        let bounds = wide_node.bounds_of(lane);
        for (place, &triangle) in block.triangles.iter().enumerate() {
            if leaf.triangles.binary_search(&triangle).is_err() {
                violations.report(Violation::ForeignInBlock { node, triangle });
                continue;
            }
            let [a, b, c] = self.mesh().corners(triangle);
            let placed = (0..3).all(|axis| {
                let numbers = [
                    (block.corners[0][axis][place], a[axis]),
                    (block.corners[1][axis][place], b[axis]),
                    (block.corners[2][axis][place], c[axis]),
                ];
                numbers.iter().all(|(found, expected)| found == expected)
            });
            if !placed {
                violations.report(Violation::MisplacedInBlock { node, triangle });
            }
            let part = intersection(&self.mesh().triangle_bounds(triangle), &leaf.cell);
            if !holds(&bounds, &part) {
                violations.report(Violation::OutsideBlockBounds {
                    node,
                    lane,
                    triangle,
                });
            }
        }
    }

    /// Goes to all wide nodes that rays can reach; the first `leaves` are leaves.
    fn check_wide_inner(&self, leaves: usize, violations: &mut Violations) {
        let wide = self.wide();
        let nodes = wide.nodes();
        let mut reached = vec![0; nodes.len().max(leaves)];
        let mut waiting = Vec::new();
        match reached.get_mut(wide.root as usize) {
            Some(times) => {
                *times = 1;
                waiting.push(wide.root as usize);
            }
            None => violations.report(Violation::LostWideNode {
                wide: wide.root as usize,
            }),
        }
        while let Some(index) = waiting.pop() {
            let Some(node) = nodes.get(index) else {
                continue;
            };
            if node.is_leaf() {
                if index >= leaves {
                    violations.report(Violation::SurplusWideLeaf {
                        wide: index,
                        leaves,
                    });
                }
                continue;
            }
            for lane in 0..LANES {
                let bounds = node.bounds_of(lane);
                if bounds.is_empty() {
                    continue;
                }
                let child = node.child(lane) as usize;
                let Some(child_node) = nodes.get(child) else {
                    violations.report(Violation::WideChildOutOfRange {
                        wide: index,
                        lane,
                        child,
                        nodes: nodes.len(),
                    });
                    continue;
                };
                let inside = |k: usize| holds(&bounds, &child_node.bounds_of(k));
                if !(0..LANES).all(inside) {
                    violations.report(Violation::OutsideWideBounds {
                        wide: index,
                        lane,
                        child,
                    });
                }
                reached[child] += 1;
                if reached[child] == 1 {
                    waiting.push(child);
                }
            }
        }
        for (index, &times) in reached.iter().enumerate() {
            // Where there is nothing to hit, no ray need go.
            let content = |node: &WideNode| (0..LANES).any(|k| !node.bounds_of(k).is_empty());
            let needed = nodes.get(index).is_some_and(content);
            if times > 1 {
                violations.report(Violation::SharedWideNode { wide: index, times });
            } else if times == 0 && needed {
                violations.report(Violation::LostWideNode { wide: index });
            }
        }
    }
}

/// A leaf of the kd-tree.
struct Leaf {
    node: usize,
    cell: Aabb,
    /// Sorted.
    triangles: Vec<u32>,
}

/// What is in both boxes.
fn intersection(a: &Aabb, b: &Aabb) -> Aabb {
    Aabb {
        min: std::array::from_fn(|axis| a.min[axis].max(b.min[axis])),
        max: std::array::from_fn(|axis| a.max[axis].min(b.max[axis])),
    }
}

/// Whether `part` is inside `whole`, or nothing; never, if that is not a number anywhere.
fn holds(whole: &Aabb, part: &Aabb) -> bool {
    part.is_empty()
        || (0..3).all(|axis| part.min[axis] >= whole.min[axis] && part.max[axis] <= whole.max[axis])
}
