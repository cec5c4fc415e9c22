//! Breaks a sculpture into closed pieces that fit each other exactly.
//!
//! Pieces are the cells of a Voronoi diagram whose sites are densest where
//! the blow falls; a little noise roughens the faces between them. A cell
//! that holds several unconnected parts of the body gives several pieces.
//! The surfaces come from [`material_surface`]; they are then evened out
//! along themselves, with vertices shared between pieces moved once, so that
//! the fit is kept to the bit.

use glam::Vec3;
use rayon::prelude::*;

use super::edge_collapse::collapse_edges;
use super::marching_tetrahedra::{
    Lattice, MaterialSurface, OUTSIDE, insert_sorted, material_surface,
};
use super::random::Random;
use super::sculpture::Sculpture;
use super::sculpture_blocks::SculptureBlocks;
use super::value_noise::value_noise;
use crate::vertex_normals;

/// Rounds of evening out the triangles; more changes little.
const FAIRING_ROUNDS: usize = 5;

/// Lattice points that make a piece; with fewer it would hardly have a volume.
const LEAST_POINTS: u32 = 30;

/// How deep vertices of broken faces stay below the surface, in spacings.
const INNER_CLEARANCE: f32 = 0.15;

/// A body in closed pieces. Vertices at sharp edges and on seams are repeated,
/// so that each has one normal and one colour.
#[derive(Clone, Debug, Default)]
pub(super) struct BrokenBody {
    pub(super) positions: Vec<Vec3>,
    pub(super) normals: Vec<Vec3>,
    pub(super) colors: Vec<[u8; 3]>,
    pub(super) triangles: Vec<[u32; 3]>,
    /// First vertex and first triangle of every piece, and the ends of all.
    pub(super) starts: Vec<[usize; 2]>,
}

impl BrokenBody {
    /// Adds the pieces of another body after those of this one.
    pub(super) fn append(&mut self, other: Self) {
        let [vertices, triangles] = [self.positions.len(), self.triangles.len()];
        self.positions.extend(other.positions);
        self.normals.extend(other.normals);
        self.colors.extend(other.colors);
        let shifted = other
            .triangles
            .iter()
            .map(|t| t.map(|index| index + vertices as u32));
        self.triangles.extend(shifted);
        // The end of the last piece here is the start of the first there.
        self.starts.pop();
        let shifted = other
            .starts
            .iter()
            .map(|[v, t]| [v + vertices, t + triangles]);
        self.starts.extend(shifted);
    }
}

/// Where and how a body breaks.
#[derive(Clone, Debug)]
pub(super) struct Fracture {
    /// Voronoi sites; a single one leaves the body whole.
    pub(super) sites: Vec<Vec3>,
    /// Colour of the broken faces.
    pub(super) color: [u8; 3],
}

impl Fracture {
    /// Sites for about `count` cells of `body`, packed more densely towards
    /// `focus`: each is the best of some random candidates, the one farthest
    /// from the others for the size a cell should have there (D. Mitchell:
    /// "Spectrally Optimal Sampling for Distribution Ray Tracing", 1991).
    pub(super) fn around(
        body: &Sculpture,
        focus: Vec3,
        count: usize,
        color: [u8; 3],
        random: &mut Random,
    ) -> Self {
        const CANDIDATES: usize = 24;
        let (least, greatest) = body.bounds();
        let mut sites: Vec<Vec3> = Vec::with_capacity(count);
        while sites.len() < count {
            let mut best = (f32::MIN, focus);
            let mut tried = 0;
            while tried < CANDIDATES {
                let candidate = least + (greatest - least) * random.vector();
                if body.distance(candidate) > 0.0 {
                    continue;
                }
                tried += 1;
                let size = 0.25 + candidate.distance(focus);
                let gap = sites
                    .iter()
                    .map(|s| s.distance(candidate))
                    .fold(f32::MAX, f32::min);
                if gap / size > best.0 {
                    best = (gap / size, candidate);
                }
            }
            sites.push(best.1);
        }
        Self { sites, color }
    }

    /// Breaks `body`, meshed on a lattice of `spacing` metres and simplified
    /// to at most `triangles` in all pieces together.
    pub(super) fn apply(&self, body: &Sculpture, spacing: f32, triangles: usize) -> BrokenBody {
        let (least, greatest) = body.bounds();
        let lattice = Lattice::covering(least, greatest, spacing);
        let blocks = SculptureBlocks::new(body, 4.0 * spacing);
        let distances: Vec<f32> = (0..lattice.len())
            .into_par_iter()
            .map(|i| blocks.distance(lattice.point(i)))
            .collect();
        let cells: Vec<u32> = (distances.par_iter().enumerate())
            .map(|(i, &distance)| {
                if distance < 0.0 {
                    self.cell(lattice.point(i)) + 1
                } else {
                    OUTSIDE
                }
            })
            .collect();
        let (materials, cells) = connected_pieces(&lattice, &cells);
        let mut surface = material_surface(&lattice, &materials, |a, b, point| {
            if a == OUTSIDE {
                return -distances[point as usize];
            }
            let position = roughened(lattice.point(point as usize));
            let [to_a, to_b] =
                [a, b].map(|m| position.distance(self.sites[cells[m as usize] as usize - 1]));
            to_a - to_b
        });
        even_out(&mut surface, &blocks, spacing);
        let colors = (surface.positions.par_iter())
            .map(|&position| Vec3::from(body.color(position).map(f32::from)) / 255.0)
            .collect();
        surface = collapse_edges(&surface, colors, triangles);
        even_out(&mut surface, &blocks, spacing);
        split(&surface, cells.len() as u32, body, spacing, self.color)
    }

    /// The site nearest to `point`, as the noise has it.
    fn cell(&self, point: Vec3) -> u32 {
        let point = roughened(point);
        let mut best = (f32::MAX, 0);
        for (i, site) in self.sites.iter().enumerate() {
            let distance = site.distance_squared(point);
            if distance < best.0 {
                best = (distance, i as u32);
            }
        }
        best.1
    }
}

/// Shifts `point` by up to two centimetres of smooth noise, which makes broken
/// faces uneven.
fn roughened(point: Vec3) -> Vec3 {
    // Three far apart cuts through the noise serve as three noises.
    let bumps = |frequency: f32| {
        let at = point * frequency;
        Vec3::from([0.0, 40.5, 81.0].map(|shift| value_noise(at + shift)))
    };
    point + bumps(9.0) * 0.020 + bumps(31.0) * 0.005
}

/// Numbers the connected parts of equal cells from one, in order of their
/// first lattice points: a material per point, and the cell of each material.
/// Crumbs of few points go to the largest neighbour, or outside if alone.
fn connected_pieces(lattice: &Lattice, cells: &[u32]) -> (Vec<u32>, Vec<u32>) {
    let mut parts = DisjointSets::new(cells.len());
    for_each_inner_edge(lattice, cells, |a, b| {
        if cells[a as usize] == cells[b as usize] {
            parts.join(a, b);
        }
    });
    let roots: Vec<u32> = (0..cells.len() as u32).map(|i| parts.root(i)).collect();
    let mut sizes = vec![0u32; cells.len()];
    for &root in &roots {
        sizes[root as usize] += 1;
    }
    let is_crumb = |root: u32| sizes[root as usize] < LEAST_POINTS;
    // The size and root of the largest neighbour of every crumb.
    let mut neighbours = vec![(0, 0); cells.len()];
    for_each_inner_edge(lattice, cells, |a, b| {
        for [from, to] in [[a, b], [b, a]] {
            let [root, other] = [from, to].map(|point| roots[point as usize]);
            if is_crumb(root) && !is_crumb(other) {
                let best = &mut neighbours[root as usize];
                *best = (*best).max((sizes[other as usize], other));
            }
        }
    });

    let mut materials = vec![OUTSIDE; cells.len()];
    let mut cell_of = vec![OUTSIDE];
    let mut numbers = vec![OUTSIDE; cells.len()];
    for (i, &root) in roots.iter().enumerate() {
        if cells[i] == OUTSIDE {
            continue;
        }
        let root = match (is_crumb(root), neighbours[root as usize]) {
            (false, _) => root,
            (true, (0, _)) => continue,
            (true, (_, neighbour)) => neighbour,
        };
        let number = &mut numbers[root as usize];
        if *number == OUTSIDE {
            *number = cell_of.len() as u32;
            cell_of.push(cells[root as usize]);
        }
        materials[i] = *number;
    }
    (materials, cell_of)
}

/// Visits the lattice edges between points of the body; most come repeatedly.
fn for_each_inner_edge(lattice: &Lattice, cells: &[u32], mut visit: impl FnMut(u32, u32)) {
    lattice.for_each_tetrahedron(|points| {
        for i in 0..4 {
            for j in i + 1..4 {
                let [a, b] = [points[i], points[j]];
                if cells[a as usize] != OUTSIDE && cells[b as usize] != OUTSIDE {
                    visit(a, b);
                }
            }
        }
    });
}

/// Disjoint sets of numbers, each named by its least (R. Tarjan, "Efficiency
/// of a Good But Not Linear Set Union Algorithm", 1975, with path halving).
struct DisjointSets {
    parents: Vec<u32>,
}

impl DisjointSets {
    fn new(count: usize) -> Self {
        Self {
            parents: (0..count as u32).collect(),
        }
    }

    fn root(&mut self, mut i: u32) -> u32 {
        while self.parents[i as usize] != i {
            self.parents[i as usize] = self.parents[self.parents[i as usize] as usize];
            i = self.parents[i as usize];
        }
        i
    }

    fn join(&mut self, a: u32, b: u32) {
        let (a, b) = (self.root(a), self.root(b));
        self.parents[a.max(b) as usize] = a.min(b);
    }
}

/// Moves vertices towards the middle of their neighbours of the same kind:
/// those on the outer surface along it, those on seams along the seam. Points
/// where seams meet stay.
fn even_out(surface: &mut MaterialSurface, body: &SculptureBlocks, spacing: f32) {
    let materials = surface.vertex_materials();
    let links = links_within_kind(surface, &materials);
    for _ in 0..FAIRING_ROUNDS {
        let mut sums = vec![(Vec3::ZERO, 0.0f32); surface.positions.len()];
        for &[vertex, neighbour] in &links {
            let sum = &mut sums[vertex as usize];
            sum.0 += surface.positions[neighbour as usize];
            sum.1 += 1.0;
        }
        let mut normals = vec![Vec3::ZERO; surface.positions.len()];
        for (triangle, sides) in surface.triangles.iter().zip(&surface.sides) {
            if sides.contains(&OUTSIDE) {
                let [a, b, c] = triangle.map(|vertex| surface.positions[vertex as usize]);
                let normal = (b - a).cross(c - a);
                for &vertex in triangle {
                    normals[vertex as usize] += if sides[0] == OUTSIDE { -normal } else { normal };
                }
            }
        }
        surface
            .positions
            .par_iter_mut()
            .enumerate()
            .for_each(|(i, position)| {
                let (sum, count) = sums[i];
                let mut shift = if count > 0.0 {
                    (sum / count - *position) * 0.5
                } else {
                    Vec3::ZERO
                };
                if materials[i][0] == OUTSIDE {
                    let normal = normals[i].normalize_or_zero();
                    shift -= normal * shift.dot(normal);
                    // Short of the whole way where thin parts bend the distance.
                    let distance = body.distance(*position + shift);
                    shift -= normal * distance.clamp(-0.25 * spacing, 0.25 * spacing);
                } else if body.distance(*position + shift) > -INNER_CLEARANCE * spacing {
                    // Broken faces must not come out of a hollow surface.
                    shift = Vec3::ZERO;
                }
                *position += shift;
            });
    }
}

/// Pairs of a vertex and a neighbour over an edge of the vertex's own kind,
/// which is to say between the same materials.
fn links_within_kind(surface: &MaterialSurface, materials: &[Vec<u32>]) -> Vec<[u32; 2]> {
    let mut edges: Vec<([u32; 2], [u32; 2])> = Vec::with_capacity(3 * surface.triangles.len());
    for (&[a, b, c], &sides) in surface.triangles.iter().zip(&surface.sides) {
        edges.extend([[a, b], [b, c], [c, a]].map(|[p, q]| ([p.min(q), p.max(q)], sides)));
    }
    edges.sort_unstable();
    let mut links = Vec::with_capacity(edges.len());
    for group in edges.chunk_by(|a, b| a.0 == b.0) {
        let mut kind = Vec::new();
        for &(_, sides) in group {
            insert_sorted(&mut kind, sides);
        }
        let [a, b] = group[0].0;
        for link in [[a, b], [b, a]] {
            if materials[link[0] as usize] == kind {
                links.push(link);
            }
        }
    }
    links
}

/// Gives every piece its own vertices, one for each pair of a surface vertex
/// and the material on the other side.
fn split(
    surface: &MaterialSurface,
    material_count: u32,
    body: &Sculpture,
    spacing: f32,
    broken: [u8; 3],
) -> BrokenBody {
    // Triangle corners as (piece, other side, triangle, flipped), by piece.
    let mut faces: Vec<(u32, u32, usize, bool)> = Vec::with_capacity(2 * surface.sides.len());
    for (i, &[from, to]) in surface.sides.iter().enumerate() {
        faces.push((from, to, i, false));
        faces.push((to, from, i, true));
    }
    faces.retain(|face| face.0 != OUTSIDE);
    faces.sort_unstable();

    let mut result = BrokenBody::default();
    let mut sources: Vec<(u32, bool)> = Vec::new();
    // The vertex that a surface vertex has in the current piece and side.
    let mut known = vec![(u32::MAX, u32::MAX, 0); surface.positions.len()];
    let mut faces = faces.into_iter().peekable();
    for piece in 1..material_count {
        result.starts.push([sources.len(), result.triangles.len()]);
        while let Some((_, other, i, flipped)) = faces.next_if(|face| face.0 == piece) {
            let [a, b, c] = surface.triangles[i];
            let corners = if flipped { [a, c, b] } else { [a, b, c] };
            result.triangles.push(corners.map(|vertex| {
                let entry = &mut known[vertex as usize];
                if (entry.0, entry.1) != (piece, other) {
                    *entry = (piece, other, sources.len() as u32);
                    sources.push((vertex, other == OUTSIDE));
                }
                entry.2
            }));
        }
    }
    result.starts.push([sources.len(), result.triangles.len()]);

    result.positions = sources
        .iter()
        .map(|&(vertex, _)| surface.positions[vertex as usize])
        .collect();
    let raw: Vec<[f32; 3]> = result.positions.iter().map(Vec3::to_array).collect();
    let mesh_normals = vertex_normals(&raw, &result.triangles);
    (result.normals, result.colors) = (sources.par_iter().enumerate())
        .map(|(i, &(_, outer))| {
            let position = result.positions[i];
            if outer {
                (body.normal(position, 0.5 * spacing), body.color(position))
            } else {
                (Vec3::from(mesh_normals[i]), broken)
            }
        })
        .unzip();
    result
}

#[cfg(test)]
mod tests {
    use super::super::sculpture::Style;
    use super::*;

    /// A dumbbell, 1 m long.
    fn body() -> Sculpture {
        let style = Style {
            blend: 0.05,
            color: [200, 100, 50],
        };
        let mut body = Sculpture::default();
        body.round_cone([Vec3::X * -0.4, Vec3::X * -0.3], [0.2, 0.2], style);
        body.round_cone([Vec3::X * -0.3, Vec3::X * 0.3], [0.06, 0.06], style);
        body.round_cone([Vec3::X * 0.3, Vec3::X * 0.4], [0.2, 0.2], style);
        body
    }

    #[test]
    fn the_same_seed_breaks_a_body_the_same_way() {
        let broken = || {
            let fracture = Fracture::around(&body(), Vec3::X, 9, [1, 2, 3], &mut Random::new(5));
            fracture.apply(&body(), 0.03, 4000)
        };
        let (first, second) = (broken(), broken());
        assert_eq!(first.positions, second.positions);
        assert_eq!(first.normals, second.normals);
        assert_eq!(first.triangles, second.triangles);
        assert!(first.starts.len() > 9);
        assert!(first.triangles.len() <= 4000);
    }

    #[test]
    fn unconnected_parts_of_a_cell_become_pieces() {
        // The middle site takes the bar; the outer cell has a part on each side.
        let fracture = Fracture {
            sites: vec![Vec3::ZERO, Vec3::Y * 9.0],
            color: [1, 2, 3],
        };
        let mut cells = Vec::new();
        let lattice = Lattice::covering(Vec3::splat(-0.6), Vec3::splat(0.6), 0.05);
        for i in 0..lattice.len() {
            let point = lattice.point(i);
            let far = u32::from(point.x.abs() > 0.2);
            cells.push(if body().distance(point) < 0.0 {
                1 + far
            } else {
                OUTSIDE
            });
        }
        let (materials, cell_of) = connected_pieces(&lattice, &cells);
        assert_eq!(cell_of.len(), 4);
        assert_eq!(cell_of.iter().filter(|&&cell| cell == 2).count(), 2);
        for (material, cell) in materials.iter().zip(&cells) {
            assert_eq!(cell_of[*material as usize], *cell);
        }
        assert_eq!(fracture.cell(Vec3::X * 0.1), 0);
    }

    #[test]
    fn crumbs_go_to_their_neighbour_or_away() {
        let lattice = Lattice::covering(Vec3::ZERO, Vec3::ONE, 0.1);
        let cells: Vec<u32> = (0..lattice.len())
            .map(|i| {
                let point = lattice.point(i);
                if point.distance(Vec3::splat(0.9)) < 0.08 {
                    3
                } else if point.max_element() > 0.6 || point.min_element() < 0.0 {
                    OUTSIDE
                } else if point.distance(Vec3::splat(0.3)) < 0.1 {
                    2
                } else {
                    1
                }
            })
            .collect();
        let (materials, cell_of) = connected_pieces(&lattice, &cells);
        assert_eq!(cell_of, [OUTSIDE, 1]);
        for (&material, &cell) in materials.iter().zip(&cells) {
            assert_eq!(material, u32::from(cell == 1 || cell == 2));
        }
    }

    #[test]
    fn normals_are_those_of_the_body_or_of_the_break() {
        let fracture = Fracture {
            sites: vec![Vec3::X * -0.1, Vec3::X * 0.1],
            color: [1, 2, 3],
        };
        let broken = fracture.apply(&body(), 0.03, 100_000);
        assert_eq!(broken.starts.len(), 3);
        for (i, &position) in broken.positions.iter().enumerate() {
            assert!((broken.normals[i].length() - 1.0).abs() < 1.0e-4);
            if broken.colors[i] == fracture.color {
                // The cut is across the bar, give or take the noise.
                assert!(broken.normals[i].x.abs() > 0.5);
            } else {
                let distance = body().distance(position);
                assert!(distance.abs() < 0.003, "{distance} at {position}");
            }
        }
    }
}
