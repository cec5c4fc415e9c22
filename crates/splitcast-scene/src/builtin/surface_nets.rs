//! Surface nets (Gibson 1998): one vertex per lattice cell that the surface
//! passes through, one quad per lattice edge that it crosses, which gives
//! evenly sized faces; then the vertices are relaxed along the surface and
//! drawn onto it by Newton steps.

use glam::{IVec3, Vec3};
use rayon::prelude::*;

use super::edge_flips::flip_edges;
use super::implicit::{Body, Nearby, SLOPE};

/// Cells along the edge of a block: blocks far from the surface are skipped,
/// and within a block only the tubes nearby are looked at.
const BLOCK: i32 = 4;

/// Rounds of relaxation: enough that the lattice no longer shows.
const RELAXATIONS: usize = 12;

/// Cells that a vertex may move from where it began; it moves less than one.
const WANDERING: f32 = 1.5;

/// Newton steps at the end, each of which squares the error.
const PROJECTIONS: usize = 3;

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
    for round in 0..RELAXATIONS {
        let neighbors = Neighbors::new(positions.len(), &triangles);
        positions = relax(body, &nearby, &neighbors, &positions);
        if round % 4 == 3 {
            flip_edges(&positions, &mut triangles);
        }
    }
    let neighbors = Neighbors::new(positions.len(), &triangles);
    positions
        .par_iter_mut()
        .zip(&nearby)
        .for_each(|(position, nearby)| {
            for _ in 0..PROJECTIONS {
                *position += newton_step(body, nearby, *position).0;
            }
        });
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
        let blocks = (cells + BLOCK) / BLOCK;
        let size = blocks * BLOCK;
        let block_count = (blocks.x * blocks.y * blocks.z) as usize;
        // Half the diagonal of a block with one cell of margin all round,
        // since vertices wander a little when they are relaxed.
        let radius = 0.5 * 3.0f32.sqrt() * (BLOCK + 2) as f32 * cell;
        let everything = body.everything();
        let sampled: Vec<(Nearby, Vec<f32>)> = (0..block_count)
            .into_par_iter()
            .map(|index| {
                let first = block_at(index, blocks) * BLOCK;
                let center = origin + (first.as_vec3() + 0.5 * BLOCK as f32) * cell;
                let nearby = body.nearby(&everything, center, radius);
                let distance = body.distance(center, &nearby);
                if distance.abs() > SLOPE * radius {
                    return (Nearby::new(), vec![distance; BLOCK.pow(3) as usize]);
                }
                let values = lattice(IVec3::splat(BLOCK))
                    .map(|at| body.distance(origin + (first + at).as_vec3() * cell, &nearby))
                    .collect();
                (nearby, values)
            })
            .collect();

        let mut samples = vec![0.0; (size.x * size.y * size.z) as usize];
        let mut nearby = Vec::with_capacity(block_count);
        for (index, (list, values)) in sampled.into_iter().enumerate() {
            let first = block_at(index, blocks) * BLOCK;
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

/// One round of relaxation: every vertex moves half way to the mean of its
/// neighbors, but only along the surface, and one Newton step towards it.
fn relax(body: &Body, nearby: &[Nearby], neighbors: &Neighbors, positions: &[Vec3]) -> Vec<Vec3> {
    positions
        .par_iter()
        .enumerate()
        .map(|(index, &position)| {
            let around = neighbors.of(index);
            let mean = around
                .iter()
                .map(|&other| positions[other as usize])
                .sum::<Vec3>()
                / around.len() as f32;
            let (step, normal) = newton_step(body, &nearby[index], position);
            let pull = mean - position;
            position + step + 0.5 * (pull - normal * pull.dot(normal))
        })
        .collect()
}

/// The step to the surface and the unit normal.
fn newton_step(body: &Body, nearby: &Nearby, position: Vec3) -> (Vec3, Vec3) {
    let (distance, gradient) = body.distance_and_gradient(position, nearby);
    let slope_squared = gradient.length_squared().max(0.1);
    (
        gradient * (-distance / slope_squared),
        gradient / slope_squared.sqrt(),
    )
}

/// The `index`-th block.
fn block_at(index: usize, blocks: IVec3) -> IVec3 {
    let index = index as i32;
    IVec3::new(
        index % blocks.x,
        index / blocks.x % blocks.y,
        index / (blocks.x * blocks.y),
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
