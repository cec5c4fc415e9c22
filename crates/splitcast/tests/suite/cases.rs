//! Named meshes that are hard on builders or on rays.

use super::meshes::{Rng, Soup, bumpy_sphere, sphere};

/// Every case.
pub(crate) fn all() -> Vec<(String, Soup)> {
    let named = |name: &str, soup: Soup| (name.to_string(), soup);
    let mut cases = vec![
        named("empty", Soup::default()),
        named("positions without triangles", positions_only()),
        named("single triangle", single_triangle()),
        named("quad", grid(1)),
        named("cube", cube()),
        named("grid of axis-aligned planes", plane_grid()),
        named("flat mesh", grid(24)),
        named(
            "flat mesh, tilted",
            grid(24).mapped(|[x, y, _]| [x, y, 0.3 * x - 0.7 * y]),
        ),
        named("flat mesh on end", grid(24).mapped(|[x, y, _]| [2.5, x, y])),
        named("parallel sheets", parallel_sheets()),
        named("coincident triangles", coincident(single_triangle(), 300)),
        named("coincident cubes", coincident(cube(), 20)),
        named("all positions equal", collapsed([0.7, -3.0, 11.0])),
        named("all positions at zero", collapsed([0.0; 3])),
        named("all on a line", collinear()),
        named("needles", needles(300, 1e-3)),
        named("slivers", needles(300, 1e-7)),
        named("fan around a vertex", fan()),
        named("nested spheres", nested_spheres()),
        named("clusters, huge and tiny triangles", clusters()),
        named("long thin triangles", long_thin()),
        named("repeated indices", repeated_indices()),
        named("triangles without area", mixed_with_zero_area()),
        named("non-finite positions", non_finite()),
        named("sphere", sphere(3)),
        named("far sphere", sphere(3).moved([1e5, -3e4, 2e5])),
        named(
            "far tiny sphere",
            sphere(3).scaled(0.05).moved([1e4, 0.0, -1e4]),
        ),
        named("coordinates about 1e-15", soup(300, 0.2, 11).scaled(1e-15)),
        named("coordinates about 1e-30", soup(100, 0.2, 12).scaled(1e-30)),
        named("coordinates about 1e11", soup(300, 0.2, 13).scaled(1e11)),
        named(
            "coordinates up to the limit",
            soup(100, 0.5, 14).scaled(6e11),
        ),
    ];
    for (count, size) in [
        (10, 2.0),
        (100, 0.5),
        (1000, 0.5),
        (1000, 0.03),
        (3000, 0.1),
    ] {
        let soup = soup(count, size, count as u64);
        cases.push((format!("soup of {count} triangles of {size}"), soup));
    }
    for seed in 0..3 {
        let soup = soup_on_grid(400, 7, seed);
        cases.push((format!("soup on a grid, seed {seed}"), soup));
    }
    cases
}

/// A few frames of a deforming closed body of one topology.
pub(crate) fn animation() -> Vec<Soup> {
    (0..4)
        .map(|frame| bumpy_sphere(4, 0.4 * frame as f32))
        .collect()
}

/// `count` triangles of about the given size in the cube from -1 to 1.
pub(crate) fn soup(count: usize, size: f32, seed: u64) -> Soup {
    let mut rng = Rng(seed);
    let mut soup = Soup::default();
    for _ in 0..count {
        let middle = rng.in_cube();
        soup.push([0; 3].map(|_| {
            let offset = rng.in_cube();
            std::array::from_fn(|axis| middle[axis] + size * offset[axis])
        }));
    }
    soup
}

/// Triangles between the points of a small integer grid: shared planes, edges and vertices
/// everywhere, some triangles without area.
fn soup_on_grid(count: usize, side: usize, seed: u64) -> Soup {
    let mut rng = Rng(seed);
    let mut soup = Soup::default();
    for _ in 0..count {
        soup.push([0; 3].map(|_| [0; 3].map(|_| rng.below(side) as f32)));
    }
    soup
}

fn single_triangle() -> Soup {
    Soup {
        positions: vec![[0.1, 0.2, 0.3], [1.3, 0.1, 0.7], [0.4, 1.7, -0.2]],
        triangles: vec![[0, 1, 2]],
    }
}

fn positions_only() -> Soup {
    Soup {
        triangles: Vec::new(),
        ..single_triangle()
    }
}

/// A square of `2 · side²` triangles in z = 0 with integer corners.
fn grid(side: u32) -> Soup {
    let width = side + 1;
    let mut soup = Soup::default();
    for y in 0..width {
        soup.positions
            .extend((0..width).map(|x| [x as f32, y as f32, 0.0]));
    }
    for y in 0..side {
        for x in 0..side {
            let corner = y * width + x;
            soup.triangles.push([corner, corner + 1, corner + width]);
            soup.triangles
                .push([corner + 1, corner + width + 1, corner + width]);
        }
    }
    soup
}

fn cube() -> Soup {
    Soup {
        positions: (0..8)
            .map(|i| [0, 1, 2].map(|axis| (i >> axis & 1) as f32))
            .collect(),
        triangles: vec![
            [0, 2, 3],
            [0, 3, 1],
            [4, 5, 7],
            [4, 7, 6],
            [0, 1, 5],
            [0, 5, 4],
            [2, 6, 7],
            [2, 7, 3],
            [0, 4, 6],
            [0, 6, 2],
            [1, 3, 7],
            [1, 7, 5],
        ],
    }
}

/// Sheets across all three axes through all integers from 0 to 4: every face, edge and vertex
/// in a plane that a builder likes.
fn plane_grid() -> Soup {
    let mut all = Soup::default();
    for axis in 0..3 {
        for plane in 0..=4 {
            all.append(&grid(4).mapped(|mut p| {
                p[2] = plane as f32;
                p.rotate_left(axis);
                p
            }));
        }
    }
    all
}

/// Sheets at distances from one rounding to a quarter.
fn parallel_sheets() -> Soup {
    let mut all = Soup::default();
    for exponent in 2..24 {
        let height = 1.0 + 0.5f32.powi(exponent);
        all.append(&grid(3).mapped(|[x, y, _]| [x, y, height]));
    }
    all
}

fn coincident(soup: Soup, times: usize) -> Soup {
    let triangles = soup.triangles.repeat(times);
    Soup { triangles, ..soup }
}

fn collapsed(point: [f32; 3]) -> Soup {
    grid(8).mapped(|_| point)
}

fn collinear() -> Soup {
    let mut rng = Rng(5);
    soup(200, 0.3, 5).mapped(|_| {
        let along = rng.signed();
        [along, 2.0 * along, -4.0 * along]
    })
}

/// Triangles of length about 1 and the given width.
fn needles(count: usize, width: f32) -> Soup {
    let mut rng = Rng(6);
    let mut soup = Soup::default();
    for _ in 0..count {
        let (start, along, aside) = (rng.in_cube(), rng.direction(), rng.direction());
        let at = |x: f32, y: f32| std::array::from_fn(|k| start[k] + x * along[k] + y * aside[k]);
        soup.push([at(0.0, 0.0), at(1.0, 0.0), at(rng.unit(), width)]);
    }
    soup
}

fn fan() -> Soup {
    let mut soup = Soup {
        positions: vec![[0.3, 0.3, 1.0]],
        triangles: Vec::new(),
    };
    let spokes = 500;
    for i in 0..spokes {
        let angle = i as f32 / spokes as f32 * std::f32::consts::TAU;
        soup.positions
            .push([angle.cos(), angle.sin(), 0.1 * (5.0 * angle).sin()]);
        soup.triangles.push([0, i + 1, (i + 1) % spokes + 1]);
    }
    soup
}

fn nested_spheres() -> Soup {
    let mut all = Soup::default();
    for radius in [1.0, 0.999, 0.9, 0.5, 0.1, 0.01, 1e-4] {
        all.append(&sphere(2).scaled(radius));
    }
    all
}

fn clusters() -> Soup {
    let mut all = soup(20, 30.0, 7);
    let mut rng = Rng(8);
    for seed in 0..8 {
        let place = rng.in_cube().map(|x| 10.0 * x);
        all.append(&soup(100, 0.1, seed).scaled(0.01).moved(place));
    }
    all.append(&soup(100, 0.1, 9).scaled(1e-5));
    all
}

/// Each spans the whole scene across the diagonal of many cells.
fn long_thin() -> Soup {
    let mut rng = Rng(10);
    let mut soup = Soup::default();
    for _ in 0..200 {
        let [a, b] = [0, 1].map(|_| rng.direction().map(|x| 5.0 * x));
        let c = std::array::from_fn(|k| b[k] + 0.02 * rng.signed());
        soup.push([a, b, c]);
    }
    soup
}

fn repeated_indices() -> Soup {
    let mut soup = sphere(2);
    for (i, triangle) in soup.triangles.iter_mut().enumerate() {
        match i % 5 {
            0 => triangle[1] = triangle[0],
            1 => *triangle = [triangle[2]; 3],
            _ => (),
        }
    }
    soup
}

/// Triangles without area lie on the edges of others.
fn mixed_with_zero_area() -> Soup {
    let mut all = sphere(2);
    for triangle in sphere(2).triangles {
        let [a, b, _] = triangle.map(|vertex| all.positions[vertex as usize]);
        all.push([a, b, std::array::from_fn(|k| 0.5 * (a[k] + b[k]))]);
    }
    all
}

/// A sphere some of whose vertices are of no use.
fn non_finite() -> Soup {
    let bad = [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, 2e12, -f32::MAX];
    let mut soup = sphere(3);
    for (i, &value) in bad.iter().enumerate() {
        soup.positions[7 + 11 * i][i % 3] = value;
    }
    soup
}
