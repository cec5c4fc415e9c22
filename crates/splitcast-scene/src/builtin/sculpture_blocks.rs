//! A sculpture sorted into cubic blocks, each with only the parts that have a
//! say in it: distances near the surface at a fraction of the work.

use glam::{UVec3, Vec3};
use rayon::prelude::*;

use super::implicit::SLOPE;
use super::sculpture::Sculpture;

/// Half the diagonal of a block over its edge.
const HALF_DIAGONAL: f32 = 0.87;

/// The blocks that cover a sculpture.
#[derive(Clone, Debug)]
pub(super) struct SculptureBlocks {
    origin: Vec3,
    /// Edge of a block in metres.
    edge: f32,
    counts: UVec3,
    blocks: Vec<Block>,
}

/// The distance from the middle of a block that is far outside, or the parts
/// that matter in one that may hold some of the surface.
#[derive(Clone, Debug)]
enum Block {
    Far(f32),
    Near(Sculpture),
}

impl SculptureBlocks {
    /// Sorts `body` into blocks with edges of `edge` metres.
    pub(super) fn new(body: &Sculpture, edge: f32) -> Self {
        let (least, greatest) = body.bounds();
        let origin = least - edge;
        let counts = ((greatest - least) / edge).as_uvec3() + 3;
        let blocks = (0..counts.element_product())
            .into_par_iter()
            .map(|i| {
                let cell = UVec3::new(i, i / counts.x, i / (counts.x * counts.y)) % counts;
                let centre = origin + (cell.as_vec3() + 0.5) * edge;
                let distance = body.distance(centre);
                // Distances grow by up to the slope a metre.
                let radius = HALF_DIAGONAL * edge;
                if distance > SLOPE * radius {
                    Block::Far(distance)
                } else {
                    Block::Near(body.near(centre, radius, distance + SLOPE * radius))
                }
            })
            .collect();
        Self {
            origin,
            edge,
            counts,
            blocks,
        }
    }

    /// The distance of the sculpture at `point`, or some positive distance
    /// where the surface is more than a block away.
    pub(super) fn distance(&self, point: Vec3) -> f32 {
        let cell = ((point - self.origin) / self.edge).as_uvec3();
        let cell = cell.min(self.counts - 1);
        let index = cell.x + self.counts.x * (cell.y + self.counts.y * cell.z);
        match &self.blocks[index as usize] {
            Block::Far(distance) => *distance,
            Block::Near(parts) => parts.distance(point),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::figurines::dragon;
    use super::super::random::Random;
    use super::*;

    #[test]
    fn blocks_give_the_distances_of_the_whole() {
        let dragon = dragon();
        let blocks = SculptureBlocks::new(&dragon, 0.07);
        let (least, greatest) = dragon.bounds();
        let mut random = Random::new(3);
        let mut near = 0;
        for _ in 0..30_000 {
            let point = least + (greatest - least) * random.vector();
            let exact = dragon.distance(point);
            let found = blocks.distance(point);
            if exact < 0.01 {
                assert!(
                    (found - exact).abs() < 1.0e-6,
                    "{found} for {exact} at {point}"
                );
                near += 1;
            } else {
                assert!(found > 0.0, "{point}");
            }
        }
        assert!(near > 500, "{near}");
    }
}
