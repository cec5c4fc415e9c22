//! Surface nets (Gibson 1998): one vertex per lattice cell that the surface
//! passes through, one quad per lattice edge that it crosses, which gives
//! evenly sized faces; then the vertices are relaxed along the surface and
//! drawn onto it by Newton steps.

use glam::{IVec3, Vec3};
use rayon::prelude::*;

use super::edge_flips::flip_edges;
use super::implicit::{Body, Nearby, SLOPE};

/// Cells along the edge of a block: blocks far from the surface are skipped,
/// and within a block only the pieces nearby are looked at.
const BLOCK: i32 = 4;

/// Blocks along the edge of a region, the same a level up.
const REGION: i32 = 4;

/// Rounds of relaxation, so that the lattice no longer shows: each moves the
/// vertices a few times, draws them to the surface and flips edges.
const ROUNDS: usize = 3;

/// Moves along the surface in one round.
const MOVES: usize = 4;

/// Newton steps at the end, each of which squares the error.
const PROJECTIONS: usize = 2;

/// Cells that a vertex may move from where it began; it moves less than one.
const WANDERING: f32 = 1.5;

/// Cell corners in the order of their bits x, y, z.
const CORNERS: [IVec3; 8] = [
    IVec3::new(0, 0, 0),
    IVec3::new(1, 0, 0),
    IVec3::new(0, 1, 0),
    IVec3::new(1, 1, 0),
    IVec3::new(0, 0, 1),
    IVec3::new(1, 0, 1),
    IVec3::new(0, 1, 1),
    IVec3::new(1, 1, 1),
];

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
    let (mut positions, cells) = grid.vertices();
    let mut triangles = grid.triangles(&positions);
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

    /// The crossed cells, in lattice order.
    fn crossed_cells(&self) -> impl Iterator<Item = IVec3> {
        lattice(self.size - 1).filter(|at| {
            let inside = CORNERS.map(|corner| self.value(*at + corner) < 0.0);
            inside.contains(&true) && inside.contains(&false)
        })
    }

    /// One vertex per crossed cell: the mean of the crossings of its edges.
    fn vertices(&self) -> (Vec<Vec3>, Vec<IVec3>) {
        let cells: Vec<IVec3> = self.crossed_cells().collect();
        let positions = cells
            .iter()
            .map(|at| self.origin + (at.as_vec3() + self.crossing_mean(*at)) * self.cell)
            .collect();
        (positions, cells)
    }

    fn crossing_mean(&self, at: IVec3) -> Vec3 {
        let values = CORNERS.map(|corner| self.value(at + corner));
        let mut sum = Vec3::ZERO;
        let mut count = 0.0;
        for from in 0..8usize {
            for axis in [1, 2, 4] {
                let to = from | axis;
                if to == from || (values[from] < 0.0) == (values[to] < 0.0) {
                    continue;
                }
                let t = values[from] / (values[from] - values[to]);
                let (start, end) = (CORNERS[from].as_vec3(), CORNERS[to].as_vec3());
                sum += start + (end - start) * t;
                count += 1.0;
            }
        }
        sum / count
    }

    /// Two triangles per crossed lattice edge, cut along the shorter diagonal.
    fn triangles(&self, positions: &[Vec3]) -> Vec<[u32; 3]> {
        let mut vertex_of = vec![u32::MAX; self.samples.len()];
        for (index, at) in self.crossed_cells().enumerate() {
            vertex_of[linear(at, self.size)] = index as u32;
        }
        let mut triangles = Vec::new();
        for at in lattice(self.size - 2) {
            let at = at + 1;
            let inside = self.value(at) < 0.0;
            for axis in 0..3 {
                let unit = |axis: usize| IVec3::AXES[axis % 3];
                if inside == (self.value(at + unit(axis)) < 0.0) {
                    continue;
                }
                let (u, v) = (unit(axis + 1), unit(axis + 2));
                let mut quad =
                    [at - u - v, at - v, at, at - u].map(|c| vertex_of[linear(c, self.size)]);
                if !inside {
                    quad.reverse();
                }
                let [a, b, c, d] = quad;
                let diagonal =
                    |p: u32, q: u32| positions[p as usize].distance_squared(positions[q as usize]);
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

/// Every vertex moves half way to the mean of its neighbors, but only along
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
