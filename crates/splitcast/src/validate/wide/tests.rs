//! A wide form that is whole, and that form broken in every way that has a name.

use super::*;
use crate::validate::MAX_REPORTED;
use crate::wide::WideTree;
use crate::{BuildOptions, Mesh};

/// Triangles lie apart from each other, so many a side: wide nodes on several levels.
const SIDE: usize = 8;

/// What there is to break.
#[derive(Clone, Copy, Debug)]
struct Places {
    /// Leaves of the kd-tree.
    leaves: usize,
    /// The node of its second leaf, and a triangle there.
    node: usize,
    triangle: u32,
    /// The root of the wide form.
    root: usize,
    /// The root's last lane with a child.
    last: usize,
}

/// What is wrong with a tree after `damage` to its wide form.
fn damaged(damage: impl FnOnce(&mut WideTree, Places)) -> (Vec<Violation>, Places) {
    let corners = [[0.1, 0.2, 0.3], [0.8, 0.3, 0.4], [0.2, 0.7, 0.9f32]];
    let positions: Vec<[f32; 3]> = (0..SIDE.pow(3))
        .map(|k| [k % SIDE, k / SIDE % SIDE, k / SIDE / SIDE])
        .flat_map(|place| corners.map(|c| std::array::from_fn(|k| c[k] + place[k] as f32)))
        .collect();
    let triangles: Vec<[u32; 3]> = (0..SIDE.pow(3) as u32)
        .map(|k| [3 * k, 3 * k + 1, 3 * k + 2])
        .collect();
    let mut options = BuildOptions::default();
    options.cost.leaf_width = 1;
    options.cost.intersection = 20.0;
    let mesh = Mesh::new(&positions, &triangles).expect("a sound mesh");
    let tree = KdTree::build(mesh, &options).expect("finite vertices");
    let mut wide = tree.wide().clone();
    let leaves: Vec<_> = tree.leaves().collect();
    let (node, first, count) = leaves[1];
    let root = wide.root() as usize;
    let with_child = |&lane: &usize| !wide.nodes[root].bounds_of(lane).is_empty();
    let places = Places {
        leaves: leaves.len(),
        node,
        triangle: tree.references()[first],
        root,
        last: (0..LANES).rfind(with_child).expect("the root has children"),
    };
    assert!(
        wide.nodes.len() > leaves.len() + LANES && count > 0,
        "{places:?}"
    );
    damage(&mut wide, places);
    let found = tree.with_wide(wide).validate().err().unwrap_or_default();
    (found, places)
}

/// The second leaf's first block.
fn block_of(wide: &mut WideTree) -> &mut Block {
    let first = wide.nodes[1].first[0] as usize;
    &mut wide.blocks.list[first]
}

#[test]
fn a_whole_form_passes() {
    assert_eq!(damaged(|_, _| ()).0, []);
}

#[test]
fn a_form_of_nothing_is_caught() {
    let (found, _) = damaged(|wide, _| *wide = WideTree::default());
    let missing = |violation: &&Violation| matches!(violation, Violation::NoWideLeaf { .. });
    assert_eq!(found.iter().filter(missing).count(), MAX_REPORTED);
}

#[test]
fn leaves_without_blocks_and_blocks_without_a_leaf_are_caught() {
    let (found, Places { node, .. }) = damaged(|wide, _| wide.nodes[1].end = [0; LANES]);
    assert!(found.contains(&Violation::NoWideLeaf { node }), "{found:?}");
    let (found, Places { leaves, root, .. }) = damaged(|wide, places| {
        wide.nodes[places.root].end[0] = 1;
    });
    assert_eq!(found[0], Violation::SurplusWideLeaf { wide: root, leaves });
}

#[test]
fn blocks_that_do_not_exist_are_caught() {
    for (first, end) in [
        (0, u32::MAX),
        (1 << 20, 1 << 20 | 1),
        (u32::MAX - 1, u32::MAX),
    ] {
        let (found, places) = damaged(|wide, _| {
            wide.nodes[1].first[0] = first;
            wide.nodes[1].end[0] = end;
        });
        let missing = |violation: &Violation| matches!(violation, Violation::NoBlock { node, lane: 0, .. } if *node == places.node);
        assert!(found.iter().any(missing), "{found:?}");
    }
}

#[test]
fn wrong_triangles_in_blocks_are_caught() {
    let (found, places) = damaged(|wide, _| {
        wide.nodes[1].first[0] = wide.nodes[1].end[0];
    });
    let Places { node, triangle, .. } = places;
    assert!(
        found.contains(&Violation::NotInBlocks { node, triangle }),
        "{found:?}"
    );
    // One from the other end of the mesh.
    let triangle = (SIDE.pow(3) - 1) as u32 - triangle;
    let (found, _) = damaged(|wide, _| block_of(wide).triangles[7] = triangle);
    assert!(
        found.contains(&Violation::ForeignInBlock { node, triangle }),
        "{found:?}"
    );
}

#[test]
fn misplaced_corners_are_caught() {
    let numbers: [fn(&mut Block) -> &mut f32; 3] = [
        |block| &mut block.corners[0][0][0],
        |block| &mut block.corners[1][1][0],
        |block| &mut block.corners[2][2][0],
    ];
    for number in numbers {
        for wrong in [f32::next_up, |_| f32::NAN] {
            let (found, places) = damaged(|wide, _| {
                let number = number(block_of(wide));
                *number = wrong(*number);
            });
            let [Violation::MisplacedInBlock { node, .. }] = found[..] else {
                panic!("{found:?}");
            };
            assert_eq!(node, places.node);
        }
    }
}

#[test]
fn boxes_that_are_too_small_are_caught() {
    for row in 0..6 {
        let smaller = [f32::next_up, f32::next_down][row % 2];
        for wrong in [smaller, |_| f32::NAN] {
            let (found, places) = damaged(|wide, _| {
                let bound = &mut wide.nodes[1].bounds[row][0];
                *bound = wrong(*bound);
            });
            let Violation::OutsideBlockBounds { node, lane, .. } = found[0] else {
                panic!("{found:?}");
            };
            assert_eq!((node, lane), (places.node, 0));
            let (found, places) = damaged(|wide, Places { root, last, .. }| {
                let bound = &mut wide.nodes[root].bounds[row][last];
                *bound = wrong(*bound);
            });
            let [Violation::OutsideWideBounds { wide, lane, .. }] = found[..] else {
                panic!("{found:?}");
            };
            assert_eq!((wide, lane), (places.root, places.last));
        }
    }
}

#[test]
fn lost_shared_and_looping_wide_nodes_are_caught() {
    let lost = |violation: &Violation| matches!(violation, Violation::LostWideNode { .. });
    let shared = |violation: &Violation| matches!(violation, Violation::SharedWideNode { .. });
    // The place of the root's first child is taken by the last.
    let (found, _) = damaged(|wide, Places { root, last, .. }| {
        wide.nodes[root].first[0] = wide.nodes[root].first[last];
    });
    assert!(
        found.iter().any(lost) && found.iter().any(shared),
        "{found:?}"
    );
    // A lane that no ray enters.
    let (found, _) = damaged(|wide, Places { root, last, .. }| {
        wide.nodes[root].bounds[0][last] = f32::INFINITY;
    });
    assert!(!found.is_empty() && found.iter().all(lost), "{found:?}");
    let (found, Places { root, .. }) = damaged(|wide, Places { root, .. }| {
        wide.nodes[root].first[0] = root as u32;
    });
    let twice = Violation::SharedWideNode {
        wide: root,
        times: 2,
    };
    assert!(found.contains(&twice), "{found:?}");
    let (found, _) = damaged(|wide, places| wide.nodes[places.root].first[0] = u32::MAX);
    assert!(
        matches!(found[0], Violation::WideChildOutOfRange { wide, lane: 0, .. } if wide == root),
        "{found:?}"
    );
    let (found, _) = damaged(|wide, _| wide.root = u32::MAX);
    let nowhere = u32::MAX as usize;
    assert_eq!(found[0], Violation::LostWideNode { wide: nowhere });
}
