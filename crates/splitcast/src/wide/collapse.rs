//! Inner nodes of eight children from those of two.

use rayon::prelude::*;

use super::{LANES, WideNode, WideTree};
use crate::Aabb;
use crate::kd_tree::{Node, NodeKind};

/// Leaves, or inner nodes, that one task looks at.
const TASK: usize = 64;

/// What becomes of a node of the kd-tree.
#[derive(Clone, Copy)]
struct Place {
    /// The box around what rays can hit below it.
    content: Aabb,
    /// A leaf's wide node.
    leaf: u32,
}

/// The nodes above the leaves of a kd-tree in wide form.
pub(crate) struct Inner {
    /// Indices count from the leaves on.
    pub(super) nodes: Vec<WideNode>,
    pub(super) root: u32,
    /// The nodes of the kd-tree that these stand for.
    pub(super) origins: Vec<u32>,
}

/// The inner nodes above the wide leaves of a kd-tree, given the boxes around what is in these.
pub(crate) fn collapse(nodes: &[Node], leaf_contents: &[Aabb]) -> Inner {
    let places = places(nodes, leaf_contents);
    let mut inner = Inner {
        nodes: Vec::new(),
        root: 0,
        origins: Vec::new(),
    };
    if let NodeKind::Leaf { .. } = nodes[0].kind() {
        return inner;
    }
    inner.root = leaf_contents.len() as u32;
    inner.nodes.push(WideNode::EMPTY);
    inner.origins.push(0);
    let mut level = 0..1;
    while !level.is_empty() {
        let origins = inner.origins[level.clone()].par_iter().with_min_len(TASK);
        let found: Vec<([u32; LANES], usize)> = origins
            .map(|&origin| children(nodes, &places, origin))
            .collect();
        for (index, (children, count)) in level.clone().zip(found) {
            for (lane, &child) in children[..count].iter().enumerate() {
                let place = &places[child as usize];
                let first = match nodes[child as usize].kind() {
                    NodeKind::Leaf { .. } => place.leaf,
                    NodeKind::Inner { .. } => {
                        inner.origins.push(child);
                        inner.nodes.push(WideNode::EMPTY);
                        inner.root + inner.nodes.len() as u32 - 1
                    }
                };
                let node = &mut inner.nodes[index];
                node.set_bounds(lane, &place.content);
                node.first[lane] = first;
            }
        }
        level = level.end..inner.origins.len();
    }
    inner
}

/// The boxes around what is in leaves.
pub(crate) fn leaf_contents(leaves: &[WideNode]) -> Vec<Aabb> {
    let leaves = leaves.par_iter().with_min_len(TASK);
    leaves.map(WideNode::content).collect()
}

/// The box around what rays can hit below every node of a kd-tree.
pub(crate) fn contents(nodes: &[Node], wide: &WideTree) -> Vec<Aabb> {
    let places = places(nodes, &leaf_contents(&wide.nodes[..wide.leaf_count()]));
    places.iter().map(|place| place.content).collect()
}

/// The content of every node, from below: children come after their parents.
fn places(nodes: &[Node], leaf_contents: &[Aabb]) -> Vec<Place> {
    let nothing = Place {
        content: Aabb::EMPTY,
        leaf: 0,
    };
    let mut places = vec![nothing; nodes.len()];
    let mut leaf = leaf_contents.len();
    for (index, node) in nodes.iter().enumerate().rev() {
        places[index] = match node.kind() {
            NodeKind::Inner { right, .. } => Place {
                content: places[index + 1].content.union(&places[right].content),
                leaf: 0,
            },
            NodeKind::Leaf { .. } => {
                leaf -= 1;
                Place {
                    content: leaf_contents[leaf],
                    leaf: leaf as u32,
                }
            }
        };
    }
    places
}

/// The nodes below `root` that become the children of its wide node: again and again, the one of
/// the largest box gives way to its own children.
fn children(nodes: &[Node], places: &[Place], root: u32) -> ([u32; LANES], usize) {
    let mut children = [root; LANES];
    // Box areas of those that can give way, 0 of others.
    let mut areas = [0.0; LANES];
    let mut count = 1;
    let mut widest = 0;
    loop {
        let NodeKind::Inner { right, .. } = nodes[children[widest] as usize].kind() else {
            unreachable!("leaves have no area here");
        };
        let left = children[widest] + 1;
        count -= 1;
        children[widest] = children[count];
        areas[widest] = areas[count];
        for child in [left, right as u32] {
            let content = &places[child as usize].content;
            if content.is_empty() {
                continue;
            }
            children[count] = child;
            areas[count] = match nodes[child as usize].kind() {
                NodeKind::Inner { .. } => content.half_area().max(f32::MIN_POSITIVE),
                NodeKind::Leaf { .. } => 0.0,
            };
            count += 1;
        }
        let largest = (0..count).max_by(|&a, &b| areas[a].total_cmp(&areas[b]));
        match largest {
            Some(lane) if areas[lane] > 0.0 && count < LANES => widest = lane,
            _ => return (children, count),
        }
    }
}
