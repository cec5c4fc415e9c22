//! Bounds on how far a tree may grow, whatever its cost model says.

/// Bound on the references of a tree, for each triangle. Where slivers of every
/// length meet in a corner, each split pays for itself by the SAH, yet halves
/// none of them: 20,000 grew to 26 million references in a minute without this
/// bound. Scanned and simulated meshes have 2 to 10 references a triangle,
/// random needles through the whole scene 35 to 84.
pub(super) const MAX_GROWTH: f32 = 128.0;

/// Meshes of fewer triangles are allowed as many references as if they had
/// this many.
const MIN_GROWTH_TRIANGLES: usize = 32;

/// How much may still be added below a node. Depends on the node and its
/// ancestors alone (on the mesh, below a top tree), so that subtrees can be built in any order: children get
/// equal shares for each of their references, and none depends on what becomes
/// of the other.
#[derive(Clone, Copy, Debug)]
pub(super) struct Limits {
    levels: u32,
    /// References that the leaves may have, for each reference of the node; at
    /// least 1.
    growth: f32,
}

impl Limits {
    /// The limits of a tree over so many triangles.
    pub(super) fn of_tree(max_depth: u32, triangles: usize) -> Self {
        let allowed = MIN_GROWTH_TRIANGLES.max(triangles) as f32 / triangles.max(1) as f32;
        Self {
            levels: max_depth,
            growth: MAX_GROWTH * allowed,
        }
    }

    /// Whether a node of `count` references may be split into children that
    /// together have `total`.
    #[inline(always)]
    pub(super) fn allow(&self, count: usize, total: usize) -> bool {
        self.levels > 0 && total as f32 <= self.growth * count as f32
    }

    /// Whether a node of `count` references may be split wherever the plane: in the
    /// worst case every reference goes to both sides. No node of `min_split` or fewer may.
    #[inline(always)]
    pub(super) fn allow_any(&self, count: usize, min_split: usize) -> bool {
        count > min_split && self.allow(count, 2 * count)
    }

    /// What is left for nodes `levels` below one of `count` references, which
    /// together have `total`.
    #[inline(always)]
    pub(super) fn below(&self, levels: u32, count: usize, total: usize) -> Self {
        Self {
            levels: self.levels.saturating_sub(levels),
            growth: self.growth * (count as f32 / total.max(1) as f32),
        }
    }
}
