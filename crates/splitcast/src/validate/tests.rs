//! A whole tree, and that tree broken in every way that has a name.

use super::*;
use crate::wide::{Cells, WideTree};
use crate::{BuildOptions, CostModel, Mesh, Node};

/// Three triangles in the box (0, 0, 0) to (4, 2, 1): one left of x = 2,
/// one across it, one inside the plane x = 2 that reaches from y = 0 to 2.
const POSITIONS: [[f32; 3]; 9] = [
    [0.0, 0.0, 0.0],
    [1.0, 2.0, 0.0],
    [0.0, 2.0, 1.0],
    [1.0, 0.0, 0.0],
    [4.0, 2.0, 0.0],
    [4.0, 0.0, 1.0],
    [2.0, 0.0, 0.0],
    [2.0, 2.0, 0.0],
    [2.0, 0.0, 1.0],
];
const TRIANGLES: [[u32; 3]; 3] = [[0, 1, 2], [3, 4, 5], [6, 7, 8]];

/// A tree of three leaves that is whole: x < 2, then y < 1 and y > 1.
#[derive(Clone)]
struct Parts {
    positions: [[f32; 3]; 9],
    bounds: Aabb,
    nodes: Vec<Node>,
    references: Vec<u32>,
    skipped: usize,
}

impl Parts {
    fn whole() -> Self {
        Self {
            positions: POSITIONS,
            bounds: Aabb::of_points(&POSITIONS),
            nodes: vec![
                Node::inner(0, 2.0, 2),
                Node::leaf(0, 2),
                Node::inner(1, 1.0, 4),
                Node::leaf(2, 2),
                Node::leaf(4, 2),
            ],
            references: vec![0, 1, 1, 2, 1, 2],
            skipped: 0,
        }
    }

    fn violations(&self) -> Vec<Violation> {
        let mesh = Mesh::new(&self.positions, &TRIANGLES).unwrap();
        let tree = KdTree::of_nodes(
            mesh,
            self.bounds,
            self.nodes.clone(),
            self.references.clone(),
            CostModel::default(),
            self.skipped,
        );
        let mut violations = Violations::default();
        tree.check_nodes(&mut violations);
        if !violations.list.is_empty() {
            return violations.list;
        }
        // Nodes that make sense have a wide form.
        let wide = WideTree::new(
            mesh,
            Cells::Disjoint(self.bounds),
            &self.nodes,
            &self.references,
        );
        tree.with_wide(wide).validate().err().unwrap_or_default()
    }
}

/// The violations of the whole tree after `damage`.
fn damaged(damage: impl FnOnce(&mut Parts)) -> Vec<Violation> {
    let mut parts = Parts::whole();
    damage(&mut parts);
    parts.violations()
}

#[test]
fn a_whole_tree_passes() {
    assert_eq!(damaged(|_| ()), []);
}

#[test]
fn planes_outside_their_cells_are_caught() {
    for position in [f32::NAN, f32::INFINITY, -0.5, 4.5] {
        let found = damaged(|parts| parts.nodes[0] = Node::inner(0, position, 2));
        assert!(
            matches!(
                found[0],
                Violation::SplitOutsideCell {
                    node: 0,
                    axis: 0,
                    min: 0.0,
                    max: 4.0,
                    ..
                }
            ),
            "{found:?}"
        );
    }
    // Inside the root's box, outside the node's own cell.
    let found = damaged(|parts| parts.nodes[2] = Node::inner(0, 1.0, 4));
    assert!(
        matches!(found[0], Violation::SplitOutsideCell { node: 2, .. }),
        "{found:?}"
    );
}

#[test]
fn lost_shared_and_looping_children_are_caught() {
    for right in [0, 1, 3, 4, 1000] {
        let found = damaged(|parts| parts.nodes[0] = Node::inner(0, 2.0, right));
        assert_eq!(
            found,
            [Violation::ChildOutOfOrder {
                node: 0,
                right,
                expected: 2
            }]
        );
    }
    let found = damaged(|parts| parts.nodes.truncate(4));
    assert_eq!(found[0], Violation::MissingChild { node: 2, nodes: 4 });
    let found = damaged(|parts| parts.nodes.push(Node::leaf(6, 0)));
    assert_eq!(found, [Violation::OrphanedNodes { first: 5 }]);
}

#[test]
fn trees_too_deep_for_the_stack_are_caught() {
    // A chain of planes through one point: a leaf on every left side.
    let chain = |length: usize| {
        damaged(|parts| {
            parts.nodes = (0..length)
                .flat_map(|i| [Node::inner(0, 0.0, 2 * i + 2), Node::leaf(0, 0)])
                .chain([Node::leaf(0, 3)])
                .collect();
            parts.references = vec![0, 1, 2];
        })
    };
    let most = MAX_DEPTH as usize;
    assert_eq!(chain(most), []);
    let found = chain(most + 1);
    assert!(matches!(found[0], Violation::TooDeep { depth, .. } if depth == most + 1));
}

#[test]
fn leaves_that_do_not_share_out_the_references_are_caught() {
    let found = damaged(|parts| parts.nodes[4] = Node::leaf(4, 3));
    assert_eq!(
        found[0],
        Violation::ReferencesOutOfRange {
            node: 4,
            first: 4,
            count: 3,
            references: 6
        }
    );
    let found = damaged(|parts| parts.nodes[4] = Node::leaf(3, 3));
    assert_eq!(
        found,
        [Violation::SharedReference {
            reference: 3,
            first: 3,
            second: 4
        }]
    );
    let found = damaged(|parts| parts.nodes[3] = Node::leaf(2, 1));
    assert_eq!(found, [Violation::UnownedReference { reference: 3 }]);
    let found = damaged(|parts| parts.references.push(0));
    assert_eq!(found, [Violation::UnownedReference { reference: 6 }]);
    let found = damaged(|parts| parts.references[5] = 3);
    assert_eq!(
        found,
        [Violation::TriangleOutOfRange {
            reference: 5,
            triangle: 3,
            triangles: 3
        }]
    );
}

#[test]
fn wrong_leaf_contents_are_caught() {
    let found = damaged(|parts| parts.references[1] = 0);
    assert_eq!(
        found[0],
        Violation::DuplicateReference {
            node: 1,
            triangle: 0
        }
    );
    assert!(
        matches!(
            found[1],
            Violation::MissingReference {
                node: 1,
                triangle: 1,
                ..
            }
        ),
        "{found:?}"
    );
    let found = damaged(|parts| parts.positions[0] = [f32::NAN; 3]);
    assert_eq!(
        found,
        [
            Violation::UntraceableTriangle {
                node: 1,
                triangle: 0
            },
            Violation::SkippedCount {
                reported: 0,
                expected: 1
            },
        ]
    );
    let found = damaged(|parts| parts.skipped = 2);
    assert_eq!(
        found,
        [Violation::SkippedCount {
            reported: 2,
            expected: 0
        }]
    );
    let found = damaged(|parts| parts.positions[4] = [4.5, 2.0, 0.0]);
    assert_eq!(found, [Violation::OutsideBounds { triangle: 1 }]);
}

#[test]
fn missing_triangles_are_caught_in_every_leaf() {
    // Take triangle 1, which overlaps all three leaves, from one after the other.
    for (node, reference) in [(1, 1), (3, 2), (4, 4)] {
        let found = damaged(|parts| {
            parts.references.remove(reference);
            parts.nodes = parts
                .nodes
                .iter()
                .enumerate()
                .map(|(index, leaf)| match leaf.kind() {
                    NodeKind::Leaf { first, count } => Node::leaf(
                        first - usize::from(first > reference),
                        count - usize::from(index == node),
                    ),
                    NodeKind::Inner { .. } => *leaf,
                })
                .collect();
        });
        let [
            Violation::MissingReference {
                node: leaf,
                triangle: 1,
                point,
            },
        ] = found[..]
        else {
            panic!("{found:?}");
        };
        assert_eq!(leaf, node);
        assert!((1.0..=4.0).contains(&point[0]), "{point:?}");
    }
}

#[test]
fn a_triangle_inside_a_plane_may_stand_on_either_side() {
    // Triangle 2 lies in x = 2: listed left only, or right in both leaves, or mixed.
    let with = |lists: [&[u32]; 3]| {
        damaged(|parts| {
            parts.references = lists.concat();
            let (a, b) = (lists[0].len(), lists[0].len() + lists[1].len());
            parts.nodes[1] = Node::leaf(0, a);
            parts.nodes[3] = Node::leaf(a, lists[1].len());
            parts.nodes[4] = Node::leaf(b, lists[2].len());
        })
    };
    assert_eq!(with([&[0, 1, 2], &[1], &[1]]), []);
    assert_eq!(with([&[0, 1], &[1, 2], &[2, 1]]), []);
    assert_eq!(with([&[0, 1, 2], &[1, 2], &[1, 2]]), []);
    let found = with([&[0, 1], &[1, 2], &[1]]);
    assert!(
        matches!(
            found[..],
            [Violation::MissingReference {
                node: 4,
                triangle: 2,
                ..
            }]
        ),
        "{found:?}"
    );
}

#[test]
fn reports_are_bounded_and_one_line_each() {
    let positions = vec![[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]];
    let triangles = vec![[0, 1, 2]; 1000];
    let mesh = Mesh::new(&positions, &triangles).unwrap();
    let built = KdTree::build(mesh, &BuildOptions::default()).unwrap();
    let empty = KdTree::of_nodes(
        mesh,
        built.bounds(),
        vec![Node::leaf(0, 0)],
        Vec::new(),
        built.cost_model(),
        0,
    );
    let found = empty.validate().unwrap_err();
    assert_eq!(found.len(), MAX_REPORTED);
    assert_eq!(
        found[0].to_string(),
        "triangle 0 overlaps the cell of leaf 0 near (0.33333334, 0.33333334, 0) \
         but is not listed there"
    );
}
