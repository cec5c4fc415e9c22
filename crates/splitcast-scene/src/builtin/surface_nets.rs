//! Surface nets (Gibson 1998): one vertex for each sheet of the surface in a
//! lattice cell, one quad for each lattice edge that it crosses, which gives
//! evenly sized faces; then the vertices are relaxed along the surface and
//! drawn onto it by Newton steps. Sheets are told apart as in dual marching
//! cubes (Nielson 2004), so that no edge gets more than two faces where the
//! surface folds close to itself.

use glam::{IVec3, Vec3};
use rayon::prelude::*;

use super::edge_flips::flip_edges;
use super::implicit::{Body, Nearby, SLOPE};

/// Cells along the edge of a block: blocks far from the surface are skipped,
/// and within a block only the pieces nearby are looked at.
const BLOCK: i32 = 3;

/// Blocks along the edge of a region, the same a level up.
const REGION: i32 = 4;

/// Rounds of relaxation, so that the lattice no longer shows: each moves the
/// vertices a few times, draws them to the surface and flips edges.
const ROUNDS: usize = 3;

/// Moves along the surface in one round.
const MOVES: usize = 4;

/// Newton steps at the end, each of which squares the error.
const PROJECTIONS: usize = 2;

/// Cells that a vertex may move from where it began; enough for
/// the relaxation, since pieces are sorted out with some slack.
const WANDERING: f32 = 1.0;

/// A closed surface, counter-clockwise seen from outside.
pub(super) struct Surface {
    pub(super) positions: Vec<Vec3>,
    pub(super) triangles: Vec<[u32; 3]>,
    pub(super) neighbors: Neighbors,
    /// Index of the nearest part of the body, per vertex.
    pub(super) parts: Vec<usize>,
}

/// Vertices joined to each vertex by an edge, in one array.
pub(super) struct Neighbors {
    starts: Vec<u32>,
    vertices: Vec<u32>,
}

impl Neighbors {
    /// Both directions of every edge appear once in a closed, consistently
    /// oriented mesh, so each triangle gives each of its corners one neighbor.
    fn new(vertex_count: usize, triangles: &[[u32; 3]]) -> Self {
        let mut starts = vec![0u32; vertex_count + 1];
        for &[a, b, c] in triangles {
            for vertex in [a, b, c] {
                starts[vertex as usize + 1] += 1;
            }
        }
        for index in 0..vertex_count {
            starts[index + 1] += starts[index];
        }
        let mut cursor = starts.clone();
        let mut vertices = vec![0; triangles.len() * 3];
        for &[a, b, c] in triangles {
            for (from, to) in [(a, b), (b, c), (c, a)] {
                vertices[cursor[from as usize] as usize] = to;
                cursor[from as usize] += 1;
            }
        }
        Self { starts, vertices }
    }

    /// The neighbors of one vertex.
    pub(super) fn of(&self, vertex: usize) -> &[u32] {
        &self.vertices[self.starts[vertex] as usize..self.starts[vertex + 1] as usize]
    }
}

/// The surface of `body`, meshed with cells of edge `cell` metres.
pub(super) fn mesh(body: &Body, cell: f32) -> Surface {
    let grid = Grid::sample(body, cell);
    let vertices = grid.vertices();
    let mut triangles = grid.triangles(&vertices);
    let Vertices {
        mut positions,
        cells,
        ..
    } = vertices;
    let nearby: Vec<Nearby> = positions
        .par_iter()
        .zip(cells)
        .map(|(position, at)| body.nearby(grid.nearby(at), *position, WANDERING * cell))
        .collect();
    for _ in 0..ROUNDS {
        let neighbors = Neighbors::new(positions.len(), &triangles);
        for _ in 0..MOVES {
            positions = relax(&neighbors, &triangles, &positions);
        }
        project(body, &nearby, &mut positions, 1);
        flip_edges(&positions, &mut triangles);
    }
    project(body, &nearby, &mut positions, PROJECTIONS);
    flip_edges(&positions, &mut triangles);
    let neighbors = Neighbors::new(positions.len(), &triangles);
    let parts = positions
        .par_iter()
        .zip(&nearby)
        .map(|(position, nearby)| body.nearest_part(*position, nearby))
        .collect();
    Surface {
        positions,
        triangles,
        neighbors,
        parts,
    }
}

/// Distance samples at the lattice points, in blocks.
struct Grid {
    origin: Vec3,
    cell: f32,
    /// Lattice points along each axis.
    size: IVec3,
    blocks: IVec3,
    samples: Vec<f32>,
    nearby: Vec<Nearby>,
}

impl Grid {
    fn sample(body: &Body, cell: f32) -> Self {
        let (low, high) = body.bounds();
        let origin = low - 2.0 * cell;
        let cells = ((high - low) / cell).ceil().as_ivec3() + 4;
        let regions = (cells + REGION * BLOCK) / (REGION * BLOCK);
        let blocks = regions * REGION;
        let size = blocks * BLOCK;
        // Half the diagonal of a cube of cells, with half a cell of margin.
        let radius = |edge: i32| 0.5 * 3.0f32.sqrt() * (edge + 1) as f32 * cell;
        let everything = body.everything();
        let of_regions: Vec<Nearby> = (0..(regions.x * regions.y * regions.z) as usize)
            .into_par_iter()
            .map(|index| {
                let edge = REGION * BLOCK;
                let middle = (at_index(index, regions) * edge).as_vec3() + 0.5 * edge as f32;
                body.nearby(&everything, origin + middle * cell, radius(edge))
            })
            .collect();
        let sampled: Vec<(Nearby, Vec<f32>)> = (0..(blocks.x * blocks.y * blocks.z) as usize)
            .into_par_iter()
            .map(|index| {
                let block = at_index(index, blocks);
                let first = block * BLOCK;
                let center = origin + (first.as_vec3() + 0.5 * BLOCK as f32) * cell;
                let of_region = &of_regions[linear(block / REGION, regions)];
                let distance = body.distance(center, of_region);
                if distance.abs() > SLOPE * radius(BLOCK) {
                    return (Nearby::new(), vec![distance; BLOCK.pow(3) as usize]);
                }
                let nearby = body.nearby(of_region, center, radius(BLOCK));
                let values = lattice(IVec3::splat(BLOCK))
                    .map(|at| body.distance(origin + (first + at).as_vec3() * cell, &nearby))
                    .collect();
                (nearby, values)
            })
            .collect();

        let mut samples = vec![0.0; (size.x * size.y * size.z) as usize];
        let mut nearby = Vec::with_capacity(sampled.len());
        for (index, (list, values)) in sampled.into_iter().enumerate() {
            let first = at_index(index, blocks) * BLOCK;
            for (at, value) in lattice(IVec3::splat(BLOCK)).zip(values) {
                samples[linear(first + at, size)] = value;
            }
            nearby.push(list);
        }
        Self {
            origin,
            cell,
            size,
            blocks,
            samples,
            nearby,
        }
    }

    fn value(&self, at: IVec3) -> f32 {
        self.samples[linear(at, self.size)]
    }

    fn nearby(&self, at: IVec3) -> &Nearby {
        &self.nearby[linear(at / BLOCK, self.blocks)]
    }

    /// One vertex for each sheet in each cell: the mean of its crossings.
    fn vertices(&self) -> Vertices {
        let mut vertices = Vertices {
            positions: Vec::new(),
            cells: Vec::new(),
            crossed: Vec::new(),
            crossed_at: vec![u32::MAX; self.samples.len()],
        };
        for at in lattice(self.size - 1) {
            let values = Cell(std::array::from_fn(|corner| {
                self.value(at + corner_offset(corner))
            }));
            let Some(sheets) = values.sheets() else {
                continue;
            };
            vertices.crossed_at[linear(at, self.size)] = vertices.crossed.len() as u32;
            let mut vertex_of_edge = [u32::MAX; 12];
            for root in (0..12).filter(|&edge| sheets[edge] == edge) {
                let edges = || (0..12).filter(|&edge| sheets[edge] == root);
                let sum: Vec3 = edges().map(|edge| values.crossing(edge)).sum();
                let mean = sum / edges().count() as f32;
                edges().for_each(|edge| vertex_of_edge[edge] = vertices.positions.len() as u32);
                vertices
                    .positions
                    .push(self.origin + (at.as_vec3() + mean) * self.cell);
                vertices.cells.push(at);
            }
            vertices.crossed.push(vertex_of_edge);
        }
        vertices
    }

    /// Two triangles per crossed lattice edge, cut along the shorter diagonal.
    fn triangles(&self, vertices: &Vertices) -> Vec<[u32; 3]> {
        let mut triangles = Vec::new();
        for at in lattice(self.size - 2) {
            let at = at + 1;
            let inside = self.value(at) < 0.0;
            for axis in 0..3 {
                if inside == (self.value(at + IVec3::AXES[axis]) < 0.0) {
                    continue;
                }
                let (u, v) = (IVec3::AXES[(axis + 1) % 3], IVec3::AXES[(axis + 2) % 3]);
                let mut quad = [(1, 1), (0, 1), (0, 0), (1, 0)].map(|(i, j)| {
                    let cell = linear(at - u * i - v * j, self.size);
                    let crossed = vertices.crossed_at[cell] as usize;
                    vertices.crossed[crossed][edge_index(axis, i as usize, j as usize)]
                });
                if !inside {
                    quad.reverse();
                }
                let [a, b, c, d] = quad;
                let diagonal = |p: u32, q: u32| {
                    vertices.positions[p as usize].distance_squared(vertices.positions[q as usize])
                };
                if diagonal(a, c) <= diagonal(b, d) {
                    triangles.extend([[a, b, c], [a, c, d]]);
                } else {
                    triangles.extend([[a, b, d], [b, c, d]]);
                }
            }
        }
        triangles
    }
}

/// The vertices of a grid, and how to find them.
struct Vertices {
    positions: Vec<Vec3>,
    /// The cell of each vertex.
    cells: Vec<IVec3>,
    /// For each crossed cell, the vertex of each of its edges' sheets.
    crossed: Vec<[u32; 12]>,
    /// Index into `crossed` by the linear index of the cell.
    crossed_at: Vec<u32>,
}

/// The samples at the corners of a cell; bits 0 to 2 of a corner's index are
/// its x, y and z.
struct Cell([f32; 8]);

impl Cell {
    /// For each edge the first edge of its sheet, 12 where the surface does
    /// not cross it; `None` if it crosses none.
    fn sheets(&self) -> Option<[usize; 12]> {
        let inside = self.0.map(|value| value < 0.0);
        if inside == [inside[0]; 8] {
            return None;
        }
        let mut sheets: [usize; 12] = std::array::from_fn(|edge| {
            let [from, to] = edge_corners(edge);
            if inside[from] == inside[to] { 12 } else { edge }
        });
        for (normal, side) in (0..3).flat_map(|normal| [(normal, 0), (normal, 1)]) {
            let (u, v) = ((normal + 1) % 3, (normal + 2) % 3);
            // Around the face: edge k lies between corners k and k + 1.
            let corners = [0, 1 << u, 1 << u | 1 << v, 1 << v].map(|at| at | side << normal);
            let edges = [
                edge_index(u, 0, side),
                edge_index(v, side, 1),
                edge_index(u, 1, side),
                edge_index(v, side, 0),
            ];
            let crossed: Vec<usize> = edges.into_iter().filter(|&e| sheets[e] < 12).collect();
            if let [first, second] = crossed[..] {
                join(&mut sheets, first, second);
            } else if crossed.len() == 4 {
                // Both neighbors of the face see the same samples, and both
                // keep its two inner corners apart.
                for corner in (0..4).filter(|&corner| inside[corners[corner]]) {
                    join(&mut sheets, edges[corner], edges[(corner + 3) % 4]);
                }
            }
        }
        Some(sheets)
    }

    /// Where the surface crosses an edge, in cells.
    fn crossing(&self, edge: usize) -> Vec3 {
        let [from, to] = edge_corners(edge);
        let t = self.0[from] / (self.0[from] - self.0[to]);
        corner_offset(from)
            .as_vec3()
            .lerp(corner_offset(to).as_vec3(), t)
    }
}

/// Makes two sheets one, under the lower of their edges.
fn join(sheets: &mut [usize; 12], a: usize, b: usize) {
    let (low, high) = (sheets[a].min(sheets[b]), sheets[a].max(sheets[b]));
    for sheet in sheets.iter_mut().filter(|sheet| **sheet == high) {
        *sheet = low;
    }
}

/// The edge of a cell along `axis`, at 0 or 1 on each of the next two axes.
fn edge_index(axis: usize, next: usize, last: usize) -> usize {
    axis * 4 + next + 2 * last
}

/// The corners at both ends of an edge.
fn edge_corners(edge: usize) -> [usize; 2] {
    let axis = edge / 4;
    let from = (edge & 1) << ((axis + 1) % 3) | (edge >> 1 & 1) << ((axis + 2) % 3);
    [from, from | 1 << axis]
}

fn corner_offset(corner: usize) -> IVec3 {
    IVec3::new(
        corner as i32 & 1,
        corner as i32 >> 1 & 1,
        corner as i32 >> 2,
    )
}

/// One move: every vertex goes half way to the mean of its neighbors, but only along
/// the surface.
fn relax(neighbors: &Neighbors, triangles: &[[u32; 3]], positions: &[Vec3]) -> Vec<Vec3> {
    let mut normals = vec![Vec3::ZERO; positions.len()];
    for triangle in triangles {
        let [a, b, c] = triangle.map(|index| positions[index as usize]);
        let doubled_area = (b - a).cross(c - a);
        for &index in triangle {
            normals[index as usize] += doubled_area;
        }
    }
    positions
        .iter()
        .zip(normals)
        .enumerate()
        .map(|(index, (&position, normal))| {
            let around = neighbors.of(index);
            let sum: Vec3 = around.iter().map(|&other| positions[other as usize]).sum();
            let pull = sum / around.len() as f32 - position;
            position + 0.5 * pull.reject_from_normalized(normal.normalize_or(Vec3::Y))
        })
        .collect()
}

/// Takes Newton steps towards the surface.
fn project(body: &Body, nearby: &[Nearby], positions: &mut [Vec3], steps: usize) {
    positions
        .par_iter_mut()
        .zip(nearby)
        .for_each(|(position, nearby)| {
            for _ in 0..steps {
                let (distance, gradient) = body.distance_and_gradient(*position, nearby);
                // Where blends flatten the field, a full step would overshoot.
                let slope_squared = gradient.length_squared().max(0.1);
                *position -= gradient * (distance / slope_squared);
            }
        });
}

/// The place in a grid that has the given index.
fn at_index(index: usize, size: IVec3) -> IVec3 {
    let index = index as i32;
    IVec3::new(
        index % size.x,
        index / size.x % size.y,
        index / (size.x * size.y),
    )
}

fn linear(at: IVec3, size: IVec3) -> usize {
    ((at.z * size.y + at.y) * size.x + at.x) as usize
}

/// Every lattice point from the origin up to but without `size`, x fastest.
fn lattice(size: IVec3) -> impl Iterator<Item = IVec3> {
    (0..size.z).flat_map(move |z| {
        (0..size.y).flat_map(move |y| (0..size.x).map(move |x| IVec3::new(x, y, z)))
    })
}

#[cfg(test)]
mod tests {
    use std::collections::HashSet;

    use super::*;
    use crate::builtin::implicit::Part;

    fn ball(center: [f32; 3], radius: f32) -> Part {
        Part::ellipsoid(center, [1.0, 0.0, 0.0], Vec3::Z, [radius; 3], 1e-3)
    }

    /// Vertices less edges plus faces, once every edge has two faces.
    fn euler_characteristic(surface: &Surface) -> i64 {
        let mut edges = HashSet::new();
        for &[a, b, c] in &surface.triangles {
            for edge in [(a, b), (b, c), (c, a)] {
                assert!(edges.insert(edge), "{edge:?} twice");
            }
        }
        assert!(edges.iter().all(|&(a, b)| edges.contains(&(b, a))));
        surface.positions.len() as i64 - edges.len() as i64 / 2 + surface.triangles.len() as i64
    }

    #[test]
    fn ball_has_its_radius_and_its_volume() {
        let body = Body {
            parts: vec![ball([0.1, 1.0, -0.2], 0.5)],
        };
        let surface = mesh(&body, 0.05);
        assert_eq!(euler_characteristic(&surface), 2);
        for position in &surface.positions {
            let radius = position.distance(Vec3::new(0.1, 1.0, -0.2));
            assert!((radius - 0.5).abs() < 1e-5, "{radius}");
        }
        let volume: f32 = surface
            .triangles
            .iter()
            .map(|triangle| {
                let [a, b, c] = triangle.map(|index| surface.positions[index as usize]);
                a.dot(b.cross(c)) / 6.0
            })
            .sum();
        let exact = 4.0 / 3.0 * std::f32::consts::PI * 0.125;
        assert!((volume / exact - 1.0).abs() < 0.01, "{volume} for {exact}");
    }

    #[test]
    fn sheets_in_one_cell_stay_apart() {
        // Two balls in a gap of a fifth of a cell, at many places of the grid.
        for step in 0..12 {
            let tilt = 0.013 * step as f32;
            let gap = Vec3::new(0.51, 3.0 * tilt, tilt).normalize() * 0.51;
            let second = Vec3::new(0.0, 1.0, 0.0) + gap;
            let body = Body {
                parts: vec![ball([0.0, 1.0, 0.0], 0.25), ball(second.into(), 0.25)],
            };
            let surface = mesh(&body, 0.05);
            assert!(
                [2, 4].contains(&euler_characteristic(&surface)),
                "tilt {tilt}"
            );
        }
    }

    #[test]
    fn neighbors_are_the_ends_of_the_edges() {
        let neighbors = Neighbors::new(4, &[[0, 1, 2], [0, 3, 1], [0, 2, 3], [1, 3, 2]]);
        for vertex in 0..4 {
            let mut around = neighbors.of(vertex).to_vec();
            around.sort_unstable();
            let others: Vec<u32> = (0..4).filter(|&other| other != vertex as u32).collect();
            assert_eq!(around, others);
        }
    }
}
