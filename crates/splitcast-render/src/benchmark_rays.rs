//! Rays to measure trees with: those of a picture, and those that light sends on.
//!
//! Which triangle a ray hits does not depend on the tree, so the rays made with
//! one tree over a mesh are the same as those made with any other.

use splitcast::{KdTree, Ray};

/// Rays of two kinds. Trace both and take the time:
///
/// ```
/// use splitcast::{BuildOptions, KdTree, Mesh};
/// use splitcast_render::BenchmarkRays;
///
/// let positions = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]];
/// let mesh = Mesh::new(&positions, &[[0, 1, 2]])?;
/// let tree = KdTree::build(mesh, &BuildOptions::default())?;
/// let rays = BenchmarkRays::new(&tree, 16);
/// assert_eq!(rays.primary.len(), 256);
/// let hits = BenchmarkRays::trace(&tree, &rays.primary);
/// assert_eq!(hits, rays.diffuse.len());
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug, Default)]
pub struct BenchmarkRays {
    /// One ray for each pixel of a square picture that shows the whole mesh
    /// in three-quarter view. They are coherent: neighbours take much the same way.
    pub primary: Vec<Ray>,
    /// One ray from every hit of those into the half space above the surface,
    /// towards which way is random: about cosine-distributed, and incoherent.
    pub diffuse: Vec<Ray>,
}

impl BenchmarkRays {
    /// Rays for the mesh of `tree`, `side` times `side` of them primary. None
    /// if there is nothing to hit.
    pub fn new(tree: &KdTree<'_>, side: u32) -> Self {
        let bounds = tree.bounds();
        if bounds.is_empty() {
            return Self::default();
        }
        let center: [f32; 3] = std::array::from_fn(|k| 0.5 * (bounds.min[k] + bounds.max[k]));
        let size = bounds.extent().iter().map(|x| x * x).sum::<f32>().sqrt();
        let eye = [
            center[0] + 0.6 * size,
            center[1] + 0.4 * size,
            center[2] + 0.9 * size,
        ];
        let primary = |pixel| {
            let (x, y) = (pixel % side, pixel / side);
            let (x, y) = (x as f32 / side as f32 - 0.5, y as f32 / side as f32 - 0.5);
            // A plane across the view through the center, a little larger than the mesh.
            let target = [
                center[0] + 0.9 * size * x,
                center[1] - 0.9 * size * y,
                center[2] - 0.6 * size * x,
            ];
            Ray::new(eye, std::array::from_fn(|k| target[k] - eye[k]))
        };
        let primary: Vec<Ray> = (0..side * side).map(primary).collect();
        let mut seed = 1_u32;
        let mut random = || {
            seed = seed.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            (seed >> 8) as f32 / (1 << 23) as f32 - 1.0
        };
        let diffuse = primary.iter().filter_map(|ray| {
            let hit = tree.closest_hit(ray)?;
            let incoming = ray.direction;
            let facing = (hit.normal.iter().zip(incoming))
                .map(|(n, d)| n * d)
                .sum::<f32>()
                > 0.0;
            let normal = if facing {
                hit.normal.map(|x| -x)
            } else {
                hit.normal
            };
            // A point of the unit cube added to the normal: cosine-distributed, near enough.
            let direction = normal.map(|x| x + 0.99 * random());
            Some(Ray::new(ray.at(hit.t), direction).with_range(1e-4, f32::INFINITY))
        });
        let diffuse = diffuse.collect();
        Self { primary, diffuse }
    }

    /// Traces rays one after the other on this thread, and says how many hit.
    pub fn trace(tree: &KdTree<'_>, rays: &[Ray]) -> usize {
        let hits = rays.iter().filter(|ray| tree.closest_hit(ray).is_some());
        // Nobody may care for the number, but the work has to be done.
        std::hint::black_box(hits.count())
    }
}

#[cfg(test)]
mod tests {
    use splitcast::{BuildOptions, Builder, Mesh};

    use super::*;

    #[test]
    fn every_tree_gives_the_same_rays() {
        let positions = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.5]];
        let mesh = Mesh::new(&positions, &[[0, 1, 2], [0, 2, 1]]).unwrap();
        let rays = |builder| {
            let options = BuildOptions {
                builder,
                ..BuildOptions::default()
            };
            BenchmarkRays::new(&KdTree::build(mesh, &options).unwrap(), 24)
        };
        let (binned, sweep) = (rays(Builder::Binned), rays(Builder::Sweep));
        assert!(!binned.diffuse.is_empty());
        let origins = |rays: &[Ray]| rays.iter().map(|ray| ray.origin).collect::<Vec<_>>();
        assert_eq!(origins(&binned.primary), origins(&sweep.primary));
        assert_eq!(origins(&binned.diffuse), origins(&sweep.diffuse));
    }

    #[test]
    fn nothing_gives_no_rays() {
        let mesh = Mesh::new(&[], &[]).unwrap();
        let tree = KdTree::build(mesh, &BuildOptions::default()).unwrap();
        let rays = BenchmarkRays::new(&tree, 8);
        assert!(rays.primary.is_empty() && rays.diffuse.is_empty());
    }
}
