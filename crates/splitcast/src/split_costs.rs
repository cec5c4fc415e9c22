//! What splits of a node would cost elsewhere: the curves that builders search.

use crate::build::{CellAreas, Reference, count_sides_anywhere};
use crate::{KdTree, NodeKind};

impl KdTree<'_> {
    /// The SAH cost (equation 4 of Hussain & Grahn 2008, under the tree's own
    /// [`CostModel`](crate::CostModel)) of splitting a node across `axis` at
    /// each of `positions`, given that a ray enters it: one value a position,
    /// infinite for planes that do not divide the node's cell. Triangles count
    /// with their whole boxes. Takes time in proportion to triangles × positions.
    ///
    /// # Panics
    /// If there is no such node or axis.
    pub fn split_costs(&self, node: usize, axis: usize, positions: &[f32]) -> Vec<f32> {
        assert!(node < self.nodes().len(), "the tree has no node {node}");
        assert!(axis < 3, "there is no axis {axis}");
        let mut cell = self.bounds();
        self.visit(|visit| {
            if visit.index == node {
                cell = visit.cell;
            }
        });
        let references = self.subtree_references(node);
        let areas = CellAreas::new(&cell);
        let cost = |&position: &f32| {
            let counts = count_sides_anywhere(&references, axis, position);
            areas.split_cost(axis, &self.cost_model(), position, counts)
        };
        positions.iter().map(cost).collect()
    }

    /// The boxes of all triangles in the leaves below a node, each once.
    fn subtree_references(&self, node: usize) -> Vec<Reference> {
        let mut triangles = Vec::new();
        // A subtree is a run of nodes with one leaf more than it has inner nodes.
        let mut open = 1;
        for node in &self.nodes()[node..] {
            if open == 0 {
                break;
            }
            match node.kind() {
                NodeKind::Inner { .. } => open += 1,
                NodeKind::Leaf { first, count } => {
                    triangles.extend_from_slice(&self.references()[first..first + count]);
                    open -= 1;
                }
            }
        }
        triangles.sort_unstable();
        triangles.dedup();
        let mesh = self.mesh();
        let reference = |&triangle: &u32| Reference::of_triangle(mesh.corners(triangle), triangle);
        triangles.iter().map(reference).collect()
    }
}

#[cfg(test)]
mod tests {
    use crate::{BuildOptions, Builder, KdTree, Mesh, NodeKind};

    /// Two squares of two triangles each, at x from 0 to 1 and from 3 to 4.
    fn squares() -> (Vec<[f32; 3]>, Vec<[u32; 3]>) {
        let square = |x: f32| {
            [
                [x, 0.0, 0.0],
                [x + 1.0, 0.0, 0.0],
                [x, 1.0, 1.0],
                [x + 1.0, 1.0, 1.0],
            ]
        };
        let positions = [square(0.0), square(3.0)].concat();
        (positions, vec![[0, 1, 2], [1, 3, 2], [4, 5, 6], [5, 7, 6]])
    }

    #[test]
    fn costs_are_those_of_the_formula() {
        let (positions, triangles) = squares();
        let mesh = Mesh::new(&positions, &triangles).unwrap();
        let mut options = BuildOptions {
            builder: Builder::Search,
            ..BuildOptions::default()
        };
        options.cost.intersection = 1.0;
        options.cost.leaf_width = 1;
        let tree = KdTree::build(mesh, &options).unwrap();
        let costs = tree.split_costs(0, 0, &[-1.0, 0.5, 2.0, 4.0]);
        // The box is 4 by 1 by 1; half its area is 9. Left of x = 0.5 stands half an area of 2, with
        // two triangles, right of it 8, with all four; at x = 2 there are two and two on 5 and 5.
        assert_eq!(costs[0], f32::INFINITY);
        assert!(
            (costs[1] - (1.0 + (2.0 * 2.0 + 8.0 * 4.0) / 9.0)).abs() < 1e-5,
            "{costs:?}"
        );
        assert!(
            (costs[2] - (1.0 + (5.0 * 2.0 + 5.0 * 2.0) / 9.0)).abs() < 1e-5,
            "{costs:?}"
        );
        assert_eq!(costs[3], f32::INFINITY);
    }

    #[test]
    fn the_chosen_plane_is_at_the_bottom_of_its_curve() {
        let (positions, triangles) = squares();
        let mesh = Mesh::new(&positions, &triangles).unwrap();
        let mut options = BuildOptions {
            builder: Builder::Search,
            ..BuildOptions::default()
        };
        options.cost.intersection = 4.0;
        options.cost.leaf_width = 1;
        let tree = KdTree::build(mesh, &options).unwrap();
        let NodeKind::Inner { axis, position, .. } = tree.nodes()[0].kind() else {
            panic!("the root is split");
        };
        let curve: Vec<f32> = (1..100).map(|i| 0.04 * i as f32).collect();
        let [chosen] = tree.split_costs(0, axis, &[position])[..] else {
            panic!("one cost a position");
        };
        for axis in 0..3 {
            for cost in tree.split_costs(0, axis, &curve) {
                assert!(cost >= chosen - 0.05, "{cost} < {chosen}");
            }
        }
    }
}
