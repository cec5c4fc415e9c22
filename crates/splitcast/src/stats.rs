//! What a tree looks like and what it is expected to cost.

use crate::{Aabb, KdTree, NodeKind};

/// Figures of one tree, from [`KdTree::stats`].
#[derive(Clone, Debug, Default, PartialEq)]
pub struct TreeStats {
    /// Expected cost of a ray that meets the root's box, under the tree's own
    /// [`CostModel`](crate::CostModel): every inner node's traversal cost and
    /// every leaf's cost, weighted with the node's share of the root's surface
    /// area (MacDonald & Booth 1990). Trees over one mesh can be compared by
    /// it if their cost models are the same. 0 for a root box without area,
    /// which no ray meets.
    pub sah_cost: f64,
    /// The same for what rays are traced through: a traversal for each node of
    /// up to eight boxes, and the tests of a whole block for each block of up to eight triangles,
    /// weighted with the areas of the boxes around them. Kd-trees with disjoint and with overlapping
    /// cells can be compared by it.
    pub traced_cost: f64,
    /// Nodes of both kinds.
    pub nodes: usize,
    /// Nodes with two children.
    pub inner_nodes: usize,
    /// Nodes without children, the empty ones included.
    pub leaves: usize,
    /// Leaves that hold no triangle.
    pub empty_leaves: usize,
    /// Entries of all leaves together.
    pub references: usize,
    /// References over triangles in the tree: 1 if none was split, 0 for an
    /// empty tree.
    pub references_per_triangle: f64,
    /// Depth of the deepest leaf; the root has depth 0.
    pub max_depth: u32,
    /// Number of leaves at each depth, from 0 to `max_depth`.
    pub depth_histogram: Vec<usize>,
    /// Number of leaves of each size, from 0 to the largest leaf's.
    pub leaf_size_histogram: Vec<usize>,
    /// Memory of the tree: its own size and what it has allocated. The mesh is
    /// borrowed and not counted.
    pub bytes: usize,
}

impl KdTree<'_> {
    /// Walks the whole tree and sums it up.
    pub fn stats(&self) -> TreeStats {
        let cost = self.cost_model();
        let root_area = half_area(&self.bounds());
        let mut stats = TreeStats {
            nodes: self.nodes().len(),
            references: self.references().len(),
            bytes: self.bytes(),
            ..TreeStats::default()
        };
        let mut weighted_cost = 0.0;
        self.visit(|node| {
            let area = half_area(&node.cell);
            match node.kind {
                NodeKind::Inner { .. } => {
                    stats.inner_nodes += 1;
                    weighted_cost += f64::from(cost.traversal) * area;
                }
                NodeKind::Leaf { count, .. } => {
                    stats.leaves += 1;
                    stats.empty_leaves += usize::from(count == 0);
                    stats.max_depth = stats.max_depth.max(node.depth);
                    count_one(&mut stats.depth_histogram, node.depth as usize);
                    count_one(&mut stats.leaf_size_histogram, count);
                    weighted_cost += f64::from(cost.leaf(count as u32)) * area;
                }
            }
        });
        if root_area > 0.0 {
            stats.sah_cost = weighted_cost / root_area;
        }
        if root_area > 0.0 {
            stats.traced_cost = self.wide().weighted_cost(&cost) / root_area;
        }
        let triangles = self.mesh().triangles().len() - self.skipped_triangles();
        if triangles > 0 {
            stats.references_per_triangle = stats.references as f64 / triangles as f64;
        }
        stats
    }
}

/// [`Aabb::half_area`] in double precision: the sum over many thousand nodes
/// is to be exact enough to compare trees that differ by little.
fn half_area(bounds: &Aabb) -> f64 {
    let [x, y, z]: [f64; 3] = std::array::from_fn(|axis| {
        (f64::from(bounds.max[axis]) - f64::from(bounds.min[axis])).max(0.0)
    });
    x * y + y * z + z * x
}

fn count_one(histogram: &mut Vec<usize>, value: usize) {
    if histogram.len() <= value {
        histogram.resize(value + 1, 0);
    }
    histogram[value] += 1;
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::kd_tree::Storage;
    use crate::{BuildOptions, CostModel, Mesh, Node};

    /// Two triangles in the box (0, 0, 0) to (2, 1, 1), one on either side of x = 1.
    const POSITIONS: [[f32; 3]; 6] = [
        [0.0, 0.0, 0.0],
        [1.0, 1.0, 0.0],
        [0.0, 1.0, 1.0],
        [1.0, 0.0, 0.0],
        [2.0, 1.0, 0.0],
        [2.0, 0.0, 1.0],
    ];
    const TRIANGLES: [[u32; 3]; 2] = [[0, 1, 2], [3, 4, 5]];

    #[test]
    fn the_cost_is_the_sum_of_the_definition() {
        let cost = CostModel {
            traversal: 1.0,
            intersection: 3.0,
            leaf_width: 1,
            empty_bonus: 0.0,
        };
        let tree = KdTree::of_nodes(
            Mesh::new(&POSITIONS, &TRIANGLES).unwrap(),
            Aabb::of_points(&POSITIONS),
            vec![Node::inner(0, 1.0, 2), Node::leaf(0, 1), Node::leaf(1, 1)],
            vec![0, 1],
            cost,
            0,
        );
        let stats = tree.stats();
        // Half areas: the root's 2 + 1 + 2 = 5, each child's 3.
        assert_eq!(stats.sah_cost, 1.0 + 2.0 * 3.0 * (3.0 / 5.0));
        assert_eq!((stats.nodes, stats.inner_nodes, stats.leaves), (3, 1, 2));
        assert_eq!((stats.references, stats.empty_leaves), (2, 0));
        assert_eq!(stats.references_per_triangle, 1.0);
        assert_eq!(stats.depth_histogram, [0, 2]);
        assert_eq!(stats.leaf_size_histogram, [0, 2]);
        assert_eq!(stats.max_depth, 1);
        assert_eq!(
            stats.bytes,
            size_of::<KdTree<'_>>()
                + size_of::<Storage>()
                + 3 * size_of::<Node>()
                + 2 * size_of::<u32>()
        );
    }

    #[test]
    fn an_empty_tree_costs_nothing() {
        let mesh = Mesh::new(&[], &[]).unwrap();
        let stats = KdTree::build(mesh, &BuildOptions::default())
            .unwrap()
            .stats();
        assert_eq!((stats.sah_cost, stats.references_per_triangle), (0.0, 0.0));
        assert_eq!((stats.leaves, stats.empty_leaves), (1, 1));
    }
}
