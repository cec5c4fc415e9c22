//! From inside, every ray meets a closed surface: also one aimed exactly at a vertex or an edge,
//! also where positions are so coarse that the surface is a heap of steps.

mod suite;

use splitcast::{BuildOptions, Builder, KdTree, Mesh, Ray};
use suite::bits;
use suite::meshes::{Rng, Soup, bumpy_sphere, closed_box, sphere};
use suite::rays::invalid;

/// Where differences of positions lose most of their bits.
const OFFSET: [f32; 3] = [148_376.0, 1234.0, -223_423.0];

/// A closed surface around a point.
struct Body {
    name: &'static str,
    soup: Soup,
    middle: [f32; 3],
}

impl Body {
    fn new(name: &'static str, soup: Soup, middle: [f32; 3]) -> Self {
        Self {
            name,
            soup: soup.moved(middle),
            middle,
        }
    }

    fn tree(&self, builder: Builder) -> KdTree<'_> {
        let Soup {
            positions,
            triangles,
        } = &self.soup;
        let mesh = Mesh::new(positions, triangles).expect("generated meshes are sound");
        let options = BuildOptions {
            builder,
            ..BuildOptions::default()
        };
        KdTree::build(mesh, &options).expect("finite vertices")
    }

    /// The distance from the middle to the nearest vertex.
    fn inner_radius(&self) -> f32 {
        let vertices = self.soup.triangles.iter().flatten();
        let distances = vertices.map(|&vertex| {
            let p = self.soup.positions[vertex as usize];
            let square = |k: usize| (p[k] - self.middle[k]).powi(2);
            (square(0) + square(1) + square(2)).sqrt()
        });
        distances.fold(f32::INFINITY, f32::min)
    }

    /// Three times so many rays from inside: at vertices, at points of edges, and anywhere.
    fn rays(&self, count: usize) -> Vec<Ray> {
        let mut rng = Rng(9);
        let radius = 0.5 * self.inner_radius();
        let mut rays = Vec::with_capacity(3 * count);
        for k in 0..3 * count {
            let triangle = self.soup.triangles[rng.below(self.soup.triangles.len())];
            let corners = triangle.map(|vertex| self.soup.positions[vertex as usize]);
            let first = rng.below(3);
            let (a, b) = (corners[first], corners[(first + 1) % 3]);
            let offset = rng.direction().map(|x| radius * x);
            let origin: [f32; 3] = if rng.unit() < 0.5 {
                self.middle
            } else {
                std::array::from_fn(|axis| self.middle[axis] + offset[axis])
            };
            let share = if k % 2 == 0 { 0.5 } else { rng.unit() };
            let direction = match k / count {
                0 => std::array::from_fn(|axis| a[axis] - origin[axis]),
                1 => {
                    std::array::from_fn(|axis| a[axis] + share * (b[axis] - a[axis]) - origin[axis])
                }
                _ => rng.direction(),
            };
            rays.push(Ray::new(origin, direction));
        }
        rays
    }

    /// Panics if a ray gets out, whatever query is asked.
    fn check(&self, builder: Builder, count: usize) {
        let (tree, rays) = (self.tree(builder), self.rays(count));
        let mut hits = vec![None; rays.len()];
        tree.closest_hits(&rays, &mut hits);
        let mut occluded = vec![false; rays.len()];
        tree.occluded_rays(&rays, &mut occluded);
        for (k, ray) in rays.iter().enumerate() {
            let place = || format!("{}, {builder}: {ray:?}", self.name);
            let hit = tree.closest_hit(ray);
            assert!(hit.is_some(), "{} got out", place());
            assert!(tree.occluded(ray), "{} got out", place());
            assert_eq!(hits[k].map(bits), hit.map(bits), "{}", place());
            assert!(occluded[k], "{} got out", place());
        }
    }
}

#[test]
fn closed_meshes_are_watertight_whatever_the_builder() {
    let bodies = [
        Body::new("sphere", sphere(5), [0.0; 3]),
        Body::new("bumpy sphere", bumpy_sphere(5, 0.0), [0.0; 3]),
        Body::new("far sphere", sphere(5).scaled(100.0), OFFSET),
        Body::new("far coarse sphere", sphere(5), OFFSET),
    ];
    for body in &bodies {
        for &builder in Builder::ALL {
            body.check(builder, 3000);
        }
    }
}

/// Triangles are no smaller than the steps between positions: one that is rounded to a line
/// leaves its neighbors' edges without each other.
#[test]
fn large_closed_meshes_are_watertight_wherever_they_are() {
    let (bumpy, grid) = (bumpy_sphere(7, 0.0), closed_box(40));
    // 100 000 of their sizes away, where numbers are a 64th apart.
    let afar = [2e5, -2e5, 2e5];
    let bodies = [
        Body::new("bumpy sphere", bumpy.clone(), [0.0; 3]),
        Body::new("far bumpy sphere", bumpy.scaled(100.0), OFFSET),
        Body::new("farthest bumpy sphere", bumpy_sphere(4, 0.0), afar),
        Body::new("box", grid.clone(), [0.0; 3]),
        Body::new("far box", grid.clone(), OFFSET),
        Body::new("farthest box", grid, afar),
    ];
    for body in &bodies {
        body.check(Builder::default(), 10_000);
    }
}

#[test]
fn invalid_rays_get_out_of_a_closed_mesh() {
    for middle in [[0.0; 3], OFFSET] {
        let body = Body::new("bumpy sphere", bumpy_sphere(4, 0.0), middle);
        for &builder in Builder::ALL {
            let tree = body.tree(builder);
            // As bad as they are, from inside; in a slice between good ones.
            let from_inside = |mut ray: Ray| {
                for axis in 0..3 {
                    if ray.origin[axis].is_finite() {
                        ray.origin[axis] += middle[axis];
                    }
                }
                ray
            };
            let bad: Vec<Ray> = invalid().into_iter().map(from_inside).collect();
            let good = Ray::new(middle, [0.3, 0.2, 0.1]);
            let mixed: Vec<Ray> = bad.iter().flat_map(|&ray| [ray, good, good]).collect();
            let mut hits = vec![None; mixed.len()];
            tree.closest_hits(&mixed, &mut hits);
            let mut occluded = vec![false; mixed.len()];
            tree.occluded_rays(&mixed, &mut occluded);
            for (k, ray) in mixed.iter().enumerate() {
                let is_good = k % 3 != 0;
                assert_eq!(tree.closest_hit(ray).is_some(), is_good, "{ray:?}");
                assert_eq!(tree.occluded(ray), is_good, "{ray:?}");
                assert_eq!(hits[k].is_some(), is_good, "{ray:?}");
                assert_eq!(occluded[k], is_good, "{ray:?}");
            }
        }
    }
}
