//! Edge flips towards the intrinsic Delaunay triangulation (Bobenko and
//! Springborn 2007): an edge whose opposite angles add up to more than a half
//! turn is replaced by the other diagonal of its two triangles.

use std::collections::BTreeSet;

use glam::Vec3;

/// Passes over all edges; the rest mesh is near its fixed point after two.
const PASSES: usize = 3;

/// A flip is refused where the two new triangles would fold: the cosine
/// between their normals has to stay above this.
const LEAST_NORMAL_COSINE: f32 = 0.3;

/// One direction of an edge: its ends, then the triangle it belongs to.
type HalfEdge = (u32, u32, u32);

/// Flips edges of a closed, consistently oriented mesh; it stays closed,
/// oriented and of the same size.
pub(super) fn flip_edges(positions: &[Vec3], triangles: &mut [[u32; 3]]) {
    for _ in 0..PASSES {
        if !flip_once(positions, triangles) {
            return;
        }
    }
}

/// One pass in which no triangle takes part in two flips.
fn flip_once(positions: &[Vec3], triangles: &mut [[u32; 3]]) -> bool {
    let mut half_edges: Vec<HalfEdge> = triangles
        .iter()
        .zip(0..)
        .flat_map(|(&[a, b, c], index)| [(a, b, index), (b, c, index), (c, a, index)])
        .collect();
    half_edges.sort_unstable();
    let find = |from: u32, to: u32| {
        let at = half_edges.partition_point(|&(a, b, _)| (a, b) < (from, to));
        let &(a, b, triangle) = half_edges.get(at)?;
        ((a, b) == (from, to)).then_some(triangle)
    };
    let mut touched = vec![false; triangles.len()];
    let mut added = BTreeSet::new();
    for &(a, b, left) in half_edges.iter().filter(|(a, b, _)| a < b) {
        let Some(right) = find(b, a) else { continue };
        if touched[left as usize] || touched[right as usize] {
            continue;
        }
        let c = opposite(triangles[left as usize], a, b);
        let d = opposite(triangles[right as usize], a, b);
        let (low, high) = (c.min(d), c.max(d));
        let [pa, pb, pc, pd] = [a, b, c, d].map(|index| positions[index as usize]);
        if cotangent(pc, pa, pb) + cotangent(pd, pa, pb) >= -1e-3
            || find(c, d).is_some()
            || find(d, c).is_some()
            || folds(pa, pb, pc, pd)
            || !added.insert((low, high))
        {
            continue;
        }
        triangles[left as usize] = [a, d, c];
        triangles[right as usize] = [d, b, c];
        touched[left as usize] = true;
        touched[right as usize] = true;
    }
    !added.is_empty()
}

fn opposite(triangle: [u32; 3], a: u32, b: u32) -> u32 {
    let [p, q, r] = triangle;
    // The three ends sum to a, b and the one looked for, in any order.
    p.wrapping_add(q)
        .wrapping_add(r)
        .wrapping_sub(a)
        .wrapping_sub(b)
}

/// Cotangent of the angle at `apex` over the edge from `a` to `b`.
fn cotangent(apex: Vec3, a: Vec3, b: Vec3) -> f32 {
    let (to_a, to_b) = (a - apex, b - apex);
    to_a.dot(to_b) / to_a.cross(to_b).length().max(1e-12)
}

/// Whether the triangles `adc` and `dbc` would face too different ways.
fn folds(a: Vec3, b: Vec3, c: Vec3, d: Vec3) -> bool {
    let first = (d - a).cross(c - a).normalize_or_zero();
    let second = (b - d).cross(c - d).normalize_or_zero();
    first.dot(second) < LEAST_NORMAL_COSINE
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn flat_bipyramid_gets_its_short_edges() {
        // A long thin diamond doubled into a closed sheet, cut lengthwise on
        // top and crosswise below: only one cut is Delaunay, yet flipping
        // would repeat the other sheet's edge, so nothing may change.
        let positions = [
            Vec3::new(-4.0, 0.0, 0.0),
            Vec3::new(4.0, 0.0, 0.0),
            Vec3::new(0.0, 1.0, 0.0),
            Vec3::new(0.0, -1.0, 0.0),
        ];
        let mut triangles = [[0, 1, 2], [0, 3, 1], [0, 2, 3], [1, 3, 2]];
        flip_edges(&positions, &mut triangles);
        assert_eq!(triangles, [[0, 1, 2], [0, 3, 1], [0, 2, 3], [1, 3, 2]]);
    }

    #[test]
    fn long_diagonal_of_a_diamond_is_flipped() {
        let positions = [
            Vec3::new(-4.0, 0.0, 0.0),
            Vec3::new(4.0, 0.0, 0.0),
            Vec3::new(0.0, 1.0, 0.0),
            Vec3::new(0.0, -1.0, 0.0),
        ];
        let mut triangles = [[0, 1, 2], [1, 0, 3]];
        flip_edges(&positions, &mut triangles);
        assert_eq!(triangles, [[0, 3, 2], [3, 1, 2]]);
    }
}
