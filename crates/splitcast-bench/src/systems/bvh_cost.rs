//! One measure for all trees of boxes whose nodes can be read.

/// What a node costs.
pub(super) struct Node {
    /// Corners of its box.
    pub(super) min: [f32; 3],
    pub(super) max: [f32; 3],
    /// Triangles of a leaf, 0 for an inner node.
    pub(super) triangles: usize,
}

/// Expected cost of a ray by the surface area heuristic: a visit of an inner node costs 1,
/// a test of a triangle 1. The root has to come first. None for a tree that no ray meets.
pub(super) fn sah_cost(nodes: impl IntoIterator<Item = Node>) -> Option<f64> {
    let mut nodes = nodes.into_iter().map(|node| {
        let [x, y, z] = [0, 1, 2].map(|axis| f64::from(node.max[axis] - node.min[axis]));
        (x * y + y * z + z * x, node.triangles.max(1) as f64)
    });
    let (root_area, root_tests) = nodes.next().filter(|(area, _)| *area > 0.0)?;
    let rest = nodes.map(|(area, tests)| area * tests).sum::<f64>() / root_area;
    Some(root_tests + rest)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn leaves_count_by_area_and_triangles() {
        let node = |max, triangles| Node {
            min: [0.0; 3],
            max,
            triangles,
        };
        // Areas 3, 1 and 2, as the root's half holds.
        let tree = [
            node([1.0, 1.0, 1.0], 0),
            node([1.0, 1.0, 0.0], 4),
            node([1.0, 1.0, 0.5], 1),
        ];
        let cost = sah_cost(tree).expect("the root has an area");
        assert!((cost - (1.0 + 4.0 / 3.0 + 2.0 / 3.0)).abs() < 1e-9);
        assert_eq!(sah_cost([]), None);
        assert_eq!(sah_cost([node([1.0, 0.0, 0.0], 3)]), None);
    }
}
