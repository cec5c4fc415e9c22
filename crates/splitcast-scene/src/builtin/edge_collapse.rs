//! Simplification of the surfaces between materials by edge collapse.
//!
//! H. Hoppe et al.: "Mesh Optimization", SIGGRAPH 1993, with the link
//! condition of T. Dey et al.: "Topology Preserving Edge Contraction", 1999.
//! Short edges and edges in flat places go first, which takes away the
//! slivers that marching leaves and keeps what is finely modelled.
//!
//! Surfaces, the seams in which three or more materials meet, and the ends of
//! seams are kept as such: a vertex moves only within its own kind or onto a
//! less free one, so that pieces stay closed and go on fitting.

use std::cmp::Reverse;
use std::collections::BinaryHeap;

use glam::Vec3;

use super::marching_tetrahedra::{MaterialSurface, OUTSIDE, insert_sorted};

/// Cost of a flat, plain edge against one with normals at right angles, or
/// colours a whole channel apart.
const FLATNESS_GAIN: f32 = 0.04;

/// A triangle may turn by at most 60 degrees in a collapse.
const LEAST_COSINE: f32 = 0.5;

/// Number of triangles when each piece has its own: those between two pieces
/// count twice.
pub(super) fn piece_triangles(surface: &MaterialSurface) -> usize {
    surface.sides.iter().map(weight).sum()
}

/// Collapses edges until [`piece_triangles`] is at most `target`, or no edge
/// may be collapsed any more. `colors` of the vertices, each channel from 0 to
/// 1, are kept apart where they differ.
pub(super) fn collapse_edges(
    surface: &MaterialSurface,
    colors: Vec<Vec3>,
    target: usize,
) -> MaterialSurface {
    let mut collapser = Collapser::new(surface, colors);
    let mut count = piece_triangles(surface);
    while count > target {
        let Some(Reverse((_, a, b, stamp))) = collapser.queue.pop() else {
            break;
        };
        if stamp == collapser.stamp(a, b) && collapser.may_collapse(a, b) {
            count -= collapser.collapse(a, b);
        }
    }
    collapser.finish()
}

/// How often a triangle counts.
fn weight(sides: &[u32; 2]) -> usize {
    if sides.contains(&OUTSIDE) { 1 } else { 2 }
}

struct Collapser {
    positions: Vec<Vec3>,
    normals: Vec<Vec3>,
    colors: Vec<Vec3>,
    triangles: Vec<[u32; 3]>,
    sides: Vec<[u32; 2]>,
    /// Triangles around every vertex, in no special but fixed order.
    around: Vec<Vec<u32>>,
    /// Materials around every vertex, sorted: the fewer, the freer.
    materials: Vec<Vec<u32>>,
    /// Changes of every vertex; a queued edge with an old sum is stale.
    versions: Vec<u32>,
    /// Edges by cost (the bits of a non-negative float sort as it does).
    queue: BinaryHeap<Reverse<(u32, u32, u32, u32)>>,
}

impl Collapser {
    fn new(surface: &MaterialSurface, colors: Vec<Vec3>) -> Self {
        let count = surface.positions.len();
        let mut around = vec![Vec::new(); count];
        let mut normals = vec![Vec3::ZERO; count];
        for (i, (triangle, sides)) in surface.triangles.iter().zip(&surface.sides).enumerate() {
            let [a, b, c] = triangle.map(|vertex| surface.positions[vertex as usize]);
            let normal = (b - a).cross(c - a);
            for &vertex in triangle {
                around[vertex as usize].push(i as u32);
                // The look of a seam is that of the outer surface.
                let share = if sides.contains(&OUTSIDE) { 1.0 } else { 0.01 };
                normals[vertex as usize] += normal * share;
            }
        }
        let mut collapser = Self {
            positions: surface.positions.clone(),
            normals: normals.into_iter().map(Vec3::normalize_or_zero).collect(),
            colors,
            triangles: surface.triangles.clone(),
            sides: surface.sides.clone(),
            around,
            materials: surface.vertex_materials(),
            versions: vec![0; count],
            queue: BinaryHeap::new(),
        };
        for i in 0..collapser.triangles.len() {
            let [a, b, c] = collapser.triangles[i];
            for [from, to] in [[a, b], [b, c], [c, a]] {
                // Surfaces are closed, so every edge is also met the other
                // way round.
                if from < to {
                    collapser.enqueue(from, to);
                }
            }
        }
        collapser
    }

    fn enqueue(&mut self, a: u32, b: u32) {
        // The freer vertex moves onto the other.
        let freedom = |v: u32| (self.materials[v as usize].len(), v);
        let (a, b) = if freedom(a) <= freedom(b) {
            (a, b)
        } else {
            (b, a)
        };
        let bend = 1.0 - self.normals[a as usize].dot(self.normals[b as usize]);
        let length = self.positions[a as usize].distance_squared(self.positions[b as usize]);
        let contrast = self.colors[a as usize].distance_squared(self.colors[b as usize]);
        let cost = length * (FLATNESS_GAIN + bend.max(0.0) + contrast);
        self.queue
            .push(Reverse((cost.to_bits(), a, b, self.stamp(a, b))));
    }

    fn stamp(&self, a: u32, b: u32) -> u32 {
        self.versions[a as usize].wrapping_add(self.versions[b as usize])
    }

    /// Whether moving `a` onto `b` keeps kinds, topology and orientation.
    fn may_collapse(&self, a: u32, b: u32) -> bool {
        let (mut shared, mut along) = (0, Vec::new());
        for &i in &self.around[a as usize] {
            if self.triangles[i as usize].contains(&b) {
                shared += 1;
                insert_sorted(&mut along, self.sides[i as usize]);
            }
        }
        // A broken face keeps a row of vertices of its own along the seam:
        // edges between two points of a hollow surface would stick out of it.
        let is_outer = |v: u32| self.materials[v as usize].contains(&OUTSIDE);
        if is_outer(a) != is_outer(b) {
            return false;
        }
        // The edge must be of the kind of the vertex that gives way.
        if shared < 2 || along != self.materials[a as usize] {
            return false;
        }
        // Link condition: neighbours in common are those across the edge.
        let neighbours = self.neighbours(a);
        let of_b = self.neighbours(b);
        let common = neighbours
            .iter()
            .filter(|v| of_b.binary_search(v).is_ok())
            .count();
        if common != shared {
            return false;
        }
        let target = self.target(a, b);
        self.stays_upright(a, b, target) && self.stays_upright(b, a, target)
    }

    /// Whether the triangles of `moved` without `other` keep facing their way
    /// when it goes to `target`, and repeat no triangle.
    fn stays_upright(&self, moved: u32, other: u32, target: Vec3) -> bool {
        for &i in &self.around[moved as usize] {
            let triangle = self.triangles[i as usize];
            if triangle.contains(&other) {
                continue;
            }
            let before = triangle.map(|vertex| self.positions[vertex as usize]);
            let after: [Vec3; 3] = std::array::from_fn(|k| {
                if triangle[k] == moved {
                    target
                } else {
                    before[k]
                }
            });
            let [old, new] = [before, after].map(|[p, q, r]| (q - p).cross(r - p));
            let scale = (old.length_squared() * new.length_squared()).sqrt();
            if old.dot(new) <= LEAST_COSINE * scale || new.length_squared() == 0.0 {
                return false;
            }
            let repeats = self.around[other as usize].iter().any(|&j| {
                let there = self.triangles[j as usize];
                triangle
                    .iter()
                    .all(|vertex| *vertex == moved || there.contains(vertex))
            });
            if repeats {
                return false;
            }
        }
        true
    }

    /// Where the merged vertex lies: between two of a kind, else at `b`.
    fn target(&self, a: u32, b: u32) -> Vec3 {
        let [from, to] = [a, b].map(|vertex| self.positions[vertex as usize]);
        if self.materials[a as usize] == self.materials[b as usize] {
            (from + to) * 0.5
        } else {
            to
        }
    }

    /// Merges `a` into `b`; the triangles lost, as [`piece_triangles`] counts.
    fn collapse(&mut self, a: u32, b: u32) -> usize {
        self.positions[b as usize] = self.target(a, b);
        let mut lost = 0;
        for i in std::mem::take(&mut self.around[a as usize]) {
            let triangle = self.triangles[i as usize];
            if triangle.contains(&b) {
                lost += weight(&self.sides[i as usize]);
                for vertex in triangle {
                    self.around[vertex as usize].retain(|&j| j != i);
                }
                // Dead triangles are all of one vertex.
                self.triangles[i as usize] = [b; 3];
            } else {
                self.triangles[i as usize] = triangle.map(|v| if v == a { b } else { v });
                self.around[b as usize].push(i);
            }
        }
        self.versions[a as usize] += 1;
        self.versions[b as usize] += 1;
        for neighbour in self.neighbours(b) {
            self.enqueue(b, neighbour);
        }
        lost
    }

    /// Vertices that share an edge with `vertex`, sorted.
    fn neighbours(&self, vertex: u32) -> Vec<u32> {
        let mut result: Vec<u32> = (self.around[vertex as usize].iter())
            .flat_map(|&i| self.triangles[i as usize])
            .filter(|&other| other != vertex)
            .collect();
        result.sort_unstable();
        result.dedup();
        result
    }

    /// The living triangles over the vertices that they use.
    fn finish(self) -> MaterialSurface {
        let mut result = MaterialSurface::default();
        let mut numbers = vec![u32::MAX; self.positions.len()];
        for (triangle, sides) in self.triangles.iter().zip(&self.sides) {
            if triangle[0] == triangle[1] {
                continue;
            }
            let triangle = triangle.map(|vertex| {
                let number = &mut numbers[vertex as usize];
                if *number == u32::MAX {
                    *number = result.positions.len() as u32;
                    result.positions.push(self.positions[vertex as usize]);
                }
                *number
            });
            result.triangles.push(triangle);
            result.sides.push(*sides);
        }
        result
    }
}

#[cfg(test)]
mod tests {
    use super::super::marching_tetrahedra::tests::{closed_volumes, sliced_ball};
    use super::*;

    #[test]
    fn simplified_pieces_stay_closed_and_keep_their_shape() {
        let surface = sliced_ball(4, 0.1);
        let before = closed_volumes(&surface);
        let target = piece_triangles(&surface) / 5;
        let gray = vec![Vec3::splat(0.5); surface.positions.len()];
        let simple = collapse_edges(&surface, gray, target);
        let count = piece_triangles(&simple);
        // A collapse takes at most two triangles and a seam's worth more.
        assert!(
            count <= target && count + 8 > target,
            "{count} for {target}"
        );
        for (old, new) in before.iter().zip(closed_volumes(&simple)) {
            assert!((old - new).abs() < 0.02 * old.abs(), "{old} became {new}");
        }
    }

    #[test]
    fn it_ends_when_nothing_more_may_go() {
        let surface = sliced_ball(3, 0.4);
        let gray = vec![Vec3::splat(0.5); surface.positions.len()];
        let simple = collapse_edges(&surface, gray, 0);
        assert!(!simple.triangles.is_empty());
        closed_volumes(&simple);
    }

    #[test]
    fn borders_of_colour_are_kept() {
        let surface = sliced_ball(1, 0.1);
        let painted: Vec<Vec3> = (surface.positions.iter())
            .map(|p| Vec3::splat(f32::from(p.y > 0.0)))
            .collect();
        let plain = vec![Vec3::ZERO; painted.len()];
        let target = surface.triangles.len() / 20;
        let near_border = |surface: &MaterialSurface| {
            surface
                .positions
                .iter()
                .filter(|p| p.y.abs() < 0.06)
                .count()
        };
        let with = near_border(&collapse_edges(&surface, painted, target));
        let without = near_border(&collapse_edges(&surface, plain, target));
        assert!(2 * with > 3 * without, "{with} vertices for {without}");
    }
}
