//! Rays that are hard on descents: in split planes, and through hundreds of boxes.

mod suite;

use splitcast::{BuildOptions, Builder, KdTree, Mesh, NodeKind, Ray};
use suite::meshes::{Rng, Soup, bumpy_sphere, closed_box};
use suite::{Expectations, default_sets};

fn mesh(soup: &Soup) -> Mesh<'_> {
    Mesh::new(&soup.positions, &soup.triangles).expect("generated meshes are sound")
}

/// Rays from points of split planes: in the plane, along one of its axes, and out of it; some from
/// a surface in the plane.
fn rays_in_planes(tree: &KdTree<'_>, count: usize) -> Vec<Ray> {
    let mut planes = Vec::new();
    tree.visit(|visit| {
        if let NodeKind::Inner { axis, position, .. } = visit.kind {
            planes.push((axis, position, visit.cell));
        }
    });
    let mut rng = Rng(3);
    let mut rays = Vec::new();
    for k in 0..count {
        let (axis, position, cell) = planes[rng.below(planes.len())];
        let ends = [cell.min, cell.max];
        let mut origin: [f32; 3] =
            std::array::from_fn(|k| cell.min[k] + rng.unit() * (cell.max[k] - cell.min[k]));
        // Half of the points are on an edge of the cell.
        if rng.unit() < 0.5 {
            origin[(axis + 1) % 3] = ends[rng.below(2)][(axis + 1) % 3];
        }
        origin[axis] = position;
        let mut direction = rng.direction();
        match k % 4 {
            0 => direction[axis] = 0.0,
            1 => direction[axis] = -0.0,
            2 => {
                let along = (axis + 1 + rng.below(2)) % 3;
                direction = std::array::from_fn(|k| if k == along { direction[k] } else { 0.0 });
            }
            _ => (),
        }
        let ray = Ray::new(origin, direction);
        rays.push(if rng.unit() < 0.5 {
            ray.with_range(f32::NEG_INFINITY, f32::INFINITY)
        } else {
            ray
        });
    }
    rays
}

#[test]
fn rays_in_split_planes_equal_brute_force() {
    for (name, soup) in [
        ("bumpy sphere", bumpy_sphere(4, 0.0)),
        // All of its planes are full of triangles.
        ("closed box", closed_box(16)),
    ] {
        for options in default_sets() {
            let tree = KdTree::build(mesh(&soup), &options).expect("finite vertices");
            let expectations = Expectations::of(tree.mesh(), rays_in_planes(&tree, 300));
            expectations.check(&tree, &format!("{name} with {}", options.builder));
        }
    }
}

/// Boxes, each a little larger than the one before. Rays along +x from the middle get out of all but
/// the last.
fn nested_boxes(count: i32) -> Soup {
    let whole = closed_box(4);
    let is_open = |corner: [f32; 3]| corner == [1.0, 0.0, 0.0];
    let mut all = Soup::default();
    for shell in 0..count {
        let mut shape = whole.clone();
        if shell + 1 < count {
            let positions = &shape.positions;
            (shape.triangles).retain(|t| !t.iter().any(|&v| is_open(positions[v as usize])));
        }
        all.append(&shape.scaled(1.25f32.powi(shell - count / 2)));
    }
    all
}

/// From the middle, boxes wait in the order of their sizes, more of them than a descent has
/// room for without allocating.
#[test]
fn rays_through_hundreds_of_boxes_equal_brute_force() {
    let soup = nested_boxes(120);
    let mut rng = Rng(4);
    let rays = (0..150).map(|k| {
        let small = [0; 3].map(|_| 1e-7 * rng.signed());
        match k % 3 {
            0 => Ray::new(small, rng.direction()),
            // Out of the openings.
            1 => Ray::new(small, [1.0, 0.05 * rng.signed(), 0.05 * rng.signed()]),
            _ => {
                let origin = rng.direction().map(|x| 2e6 * x);
                Ray::new(origin, std::array::from_fn(|k| small[k] - origin[k]))
            }
        }
    });
    let expectations = Expectations::of(mesh(&soup), rays.collect());
    for builder in [Builder::Sweep, Builder::Binned] {
        let mut options = BuildOptions {
            builder,
            ..BuildOptions::default()
        };
        options.cost.intersection = 20.0;
        let tree = KdTree::build(mesh(&soup), &options).expect("finite vertices");
        expectations.check(&tree, &format!("nested boxes with {builder}"));
    }
}
