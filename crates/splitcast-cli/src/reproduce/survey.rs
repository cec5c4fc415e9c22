//! Which nodes below the root are worth showing: those that every tree has.

use std::cmp::Reverse;
use std::collections::{BTreeMap, HashMap};

use splitcast::{BuildReport, KdTree, NodeKind, SplitRecord};

use super::settings::NodePath;

/// Depths of which one node each is shown unless others are asked for.
const DEPTHS: [u32; 2] = [4, 8];

/// Inner nodes at [`DEPTHS`] that every tree seen so far has.
#[derive(Debug, Default)]
pub(crate) struct Survey {
    common: Option<BTreeMap<NodePath, Common>>,
}

#[derive(Debug)]
struct Common {
    axis: u32,
    references: u32,
    /// Trees in which the axis is another than in the first.
    turned: usize,
}

impl Survey {
    /// Takes in one more tree and the report of its build.
    pub(crate) fn add(&mut self, tree: &KdTree<'_>, report: &BuildReport) {
        let splits = report.splits.iter();
        let splits = splits.filter(|split| DEPTHS.contains(&split.depth));
        let splits: HashMap<usize, &SplitRecord> =
            splits.map(|split| (split.node as usize, split)).collect();
        let mut here = BTreeMap::new();
        collect(tree, 0, &mut String::new(), &splits, &mut here);
        match &mut self.common {
            None => self.common = Some(here),
            Some(common) => common.retain(|path, known| {
                let found = here.get(path);
                known.turned += usize::from(found.is_some_and(|found| found.axis != known.axis));
                found.is_some()
            }),
        }
    }

    /// For each depth the node whose axis changes least; among those the one
    /// with the most triangles in the first frame.
    pub(crate) fn choice(&self) -> Vec<NodePath> {
        let common = self.common.iter().flatten();
        let at = |depth: u32| {
            let nodes = common.clone();
            let nodes = nodes.filter(|(path, _)| path.0.len() == depth as usize);
            nodes.min_by_key(|(_, node)| (node.turned, Reverse(node.references)))
        };
        DEPTHS
            .into_iter()
            .filter_map(|depth| at(depth).map(|(path, _)| path.clone()))
            .collect()
    }
}

/// Collects the splits below node `index`, whose path is `path`.
fn collect(
    tree: &KdTree<'_>,
    index: usize,
    path: &mut String,
    splits: &HashMap<usize, &SplitRecord>,
    found: &mut BTreeMap<NodePath, Common>,
) {
    let NodeKind::Inner { right, .. } = tree.nodes()[index].kind() else {
        return;
    };
    if let Some(split) = splits.get(&index) {
        let common = Common {
            axis: split.axis,
            references: split.references,
            turned: 0,
        };
        found.insert(NodePath(path.clone()), common);
    }
    if DEPTHS.iter().all(|&depth| path.len() >= depth as usize) {
        return;
    }
    for (letter, child) in [('L', index + 1), ('R', right)] {
        path.push(letter);
        collect(tree, child, path, splits, found);
        path.pop();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_choice_is_steady_first_and_large_second() {
        let node = |path: &str, turned, references| {
            let common = Common {
                axis: 0,
                references,
                turned,
            };
            (NodePath(path.to_owned()), common)
        };
        let survey = Survey {
            common: Some(BTreeMap::from([
                node("LLLL", 3, 900),
                node("LLLR", 0, 40),
                node("LRLR", 0, 50),
                node("RRRRRRRR", 7, 2),
            ])),
        };
        let choice: Vec<String> = survey.choice().iter().map(NodePath::to_string).collect();
        assert_eq!(choice, ["LRLR", "RRRRRRRR"]);
        assert!(Survey::default().choice().is_empty());
    }
}
