//! What each query promises, on meshes small enough to know the answer, and
//! against a ray–triangle test of another kind.

use proptest::prelude::*;
use splitcast::{BuildOptions, Hit, KdTree, Mesh, Ray, reference};

/// A right triangle in z = 0 that runs counter-clockwise seen from +z.
const POSITIONS: [[f32; 3]; 3] = [[0.0, 0.0, 0.0], [2.0, 0.0, 0.0], [0.0, 2.0, 0.0]];

fn with_tree<R>(
    positions: &[[f32; 3]],
    triangles: &[[u32; 3]],
    check: impl FnOnce(&KdTree<'_>) -> R,
) -> R {
    let mesh = Mesh::new(positions, triangles).expect("a sound mesh");
    check(&KdTree::build(mesh, &BuildOptions::default()).expect("finite vertices"))
}

#[test]
fn a_hit_says_where_and_on_which_side_it_is() {
    with_tree(&POSITIONS, &[[0, 1, 2]], |tree| {
        let expected = Hit {
            t: 3.0,
            u: 0.25,
            v: 0.5,
            triangle: 0,
            normal: [0.0, 0.0, 1.0],
        };
        let above = Ray::new([0.5, 1.0, 3.0], [0.0, 0.0, -1.0]);
        assert_eq!(tree.closest_hit(&above), Some(expected));
        // Seen from behind: the normal stays.
        let below = Ray::new([0.5, 1.0, -3.0], [0.0, 0.0, 1.0]);
        assert_eq!(tree.closest_hit(&below), Some(expected));
        // `t` counts in lengths of the direction.
        let long = Ray::new([0.5, 1.0, 3.0], [0.0, 0.0, -8.0]);
        let hit = tree.closest_hit(&long).expect("the same hit");
        assert_eq!(hit.t, 0.375);
    });
    with_tree(&POSITIONS, &[[0, 2, 1]], |tree| {
        let hit = tree.closest_hit(&Ray::new([0.5, 1.0, 3.0], [0.0, 0.0, -1.0]));
        let hit = hit.expect("the same triangle, wound the other way");
        assert_eq!((hit.u, hit.v, hit.normal), (0.5, 0.25, [0.0, 0.0, -1.0]));
    });
}

#[test]
fn corners_have_a_weight_of_one_and_belong_to_the_triangle() {
    with_tree(&POSITIONS, &[[0, 1, 2]], |tree| {
        for (corner, weights) in [(0, (0.0, 0.0)), (1, (1.0, 0.0)), (2, (0.0, 1.0))] {
            let [x, y, _] = POSITIONS[corner];
            let hit = tree.closest_hit(&Ray::new([x, y, 1.0], [0.0, 0.0, -1.0]));
            let hit = hit.expect("corners count");
            assert_eq!((hit.u, hit.v), weights);
        }
        for (x, y) in [(-1e-30, 0.5), (0.5, -1e-30), (1.0f32.next_up(), 1.0)] {
            let beside = Ray::new([x, y, 1.0], [0.0, 0.0, -1.0]);
            assert_eq!(tree.closest_hit(&beside), None);
            assert!(!tree.occluded(&beside));
        }
    });
}

#[test]
fn ranges_include_their_ends() {
    with_tree(&POSITIONS, &[[0, 1, 2]], |tree| {
        let ray = Ray::new([0.5, 0.5, 3.0], [0.0, 0.0, -1.0]);
        let found = |t_min, t_max| {
            let ray = ray.with_range(t_min, t_max);
            let mut all = Vec::new();
            tree.all_hits(&ray, &mut all);
            let hit = tree.closest_hit(&ray);
            assert_eq!(tree.occluded(&ray), hit.is_some());
            assert_eq!(all, Vec::from_iter(hit));
            hit.is_some()
        };
        assert!(found(3.0, 3.0) && found(0.0, 3.0) && found(3.0, f32::INFINITY));
        assert!(!found(0.0, 3.0f32.next_down()) && !found(3.0f32.next_up(), f32::INFINITY));
        // Behind the origin.
        let ray = Ray::new([0.5, 0.5, -3.0], [0.0, 0.0, -1.0]);
        assert_eq!(tree.closest_hit(&ray), None);
        let hit = tree.closest_hit(&ray.with_range(-3.0, 0.0));
        assert_eq!(hit.expect("a negative range").t, -3.0);
        // On the surface.
        let ray = Ray::new([0.5, 0.5, 0.0], [0.0, 1.0, -1.0]);
        assert_eq!(
            tree.closest_hit(&ray).expect("at the origin").t.to_bits(),
            0
        );
    });
}

#[test]
fn all_hits_come_in_order_and_the_lowest_triangle_wins_a_tie() {
    // Sheets at z = 0, 1, 2 in reverse, the middle one twice.
    let sheet = |z: f32| POSITIONS.map(|[x, y, _]| [x, y, z]);
    let positions = [sheet(2.0), sheet(1.0), sheet(0.0)].concat();
    let triangles = [[0, 1, 2], [3, 4, 5], [5, 4, 3], [6, 7, 8]];
    with_tree(&positions, &triangles, |tree| {
        let ray = Ray::new([0.5, 0.5, -1.0], [0.0, 0.0, 1.0]);
        let mut hits = vec![tree.closest_hit(&ray).expect("the sheet at z = 0"); 7];
        assert_eq!(hits[0].triangle, 3);
        tree.all_hits(&ray, &mut hits);
        let found: Vec<(f32, u32)> = hits.iter().map(|hit| (hit.t, hit.triangle)).collect();
        assert_eq!(found, [(1.0, 3), (2.0, 1), (2.0, 2), (3.0, 0)]);
        let hit = tree.closest_hit(&ray.with_range(1.5, 9.0));
        assert_eq!(hit.expect("the middle sheets").triangle, 1);
        tree.all_hits(&ray.with_range(f32::NAN, 1.0), &mut hits);
        assert_eq!(hits, []);
    });
}

#[test]
fn rays_inside_a_triangles_plane_and_triangles_without_area_are_no_hits() {
    let triangles = [[0, 1, 2]];
    with_tree(&POSITIONS, &triangles, |tree| {
        let inside = Ray::new([-1.0, 0.5, 0.0], [1.0, 0.0, 0.0]);
        let tilted = Ray::new([-1.0, -1.0, 0.0], [0.3, 0.7, 0.0]);
        for ray in [inside, tilted] {
            assert_eq!(tree.closest_hit(&ray), None);
        }
    });
    for triangle in [[0, 1, 1], [0, 0, 0], [2, 1, 2]] {
        with_tree(&POSITIONS, &[triangle], |tree| {
            let ray = Ray::new([1.0, 0.0, 1.0], [0.0, 0.0, -1.0]);
            assert!(!tree.occluded(&ray));
        });
    }
    // Corners on a line that no axis is parallel to, tested by rays through it.
    let line = [[0.1, 0.2, 0.3], [0.2, 0.4, 0.6], [0.4, 0.8, 1.2]];
    with_tree(&line, &[[0, 1, 2]], |tree| {
        for k in 0..100 {
            let target = line[1].map(|x| x * (1.0 + k as f32 / 100.0));
            let direction = [target[0] - 1.0, target[1] + 0.3, target[2] - 0.7];
            assert!(!tree.occluded(&Ray::new([1.0, -0.3, 0.7], direction)));
        }
    });
}

#[test]
fn invalid_rays_take_no_step() {
    with_tree(&POSITIONS, &[[0, 1, 2]], |tree| {
        let ray = Ray::new([0.5, 0.5, 3.0], [0.0, 0.0, -1.0]);
        let no_direction = Ray {
            direction: [0.0; 3],
            ..ray
        };
        let lost = Ray {
            origin: [0.5, f32::NAN, 3.0],
            ..ray
        };
        for ray in [no_direction, lost, ray.with_range(2.0, 1.0)] {
            let (hit, counts) = tree.closest_hit_counted(&ray);
            assert_eq!((hit, counts), (None, Default::default()));
        }
        assert_eq!(tree.closest_hit_counted(&ray).1.blocks, 1);
    });
}

#[test]
fn trees_can_be_shared_between_threads() {
    fn shareable<T: Send + Sync>() {}
    shareable::<KdTree<'static>>();
}

proptest! {
    /// Cramer's rule in double precision (Möller & Trumbore 1997) agrees wherever a ray passes
    /// clear of the edges and not along the plane.
    #[test]
    fn another_test_agrees_away_from_edges(
        corners in prop::array::uniform3(prop::array::uniform3(-1.0f32..1.0)),
        origin in prop::array::uniform3(-2.0f32..2.0),
        direction in prop::array::uniform3(-1.0f32..1.0),
    ) {
        let subtract = |p: [f64; 3], q: [f64; 3]| [p[0] - q[0], p[1] - q[1], p[2] - q[2]];
        let dot = |p: [f64; 3], q: [f64; 3]| p[0] * q[0] + p[1] * q[1] + p[2] * q[2];
        let cross = |p: [f64; 3], q: [f64; 3]| [
            p[1] * q[2] - p[2] * q[1],
            p[2] * q[0] - p[0] * q[2],
            p[0] * q[1] - p[1] * q[0],
        ];
        let [a, b, c] = corners.map(|corner| corner.map(f64::from));
        let (o, d) = (origin.map(f64::from), direction.map(f64::from));
        let (ab, ac, ao) = (subtract(b, a), subtract(c, a), subtract(o, a));
        let p = cross(d, ac);
        let determinant = dot(ab, p);
        prop_assume!(determinant.abs() > 1e-4);
        let u = dot(ao, p) / determinant;
        let q = cross(ao, ab);
        let v = dot(d, q) / determinant;
        let t = dot(ac, q) / determinant;
        let nearest_edge = u.min(v).min(1.0 - u - v);
        prop_assume!(nearest_edge.abs() > 1e-6);

        let mesh = Mesh::new(&corners, &[[0, 1, 2]]).unwrap();
        let ray = Ray::new(origin, direction).with_range(f32::NEG_INFINITY, f32::INFINITY);
        let hit = reference::closest_hit(mesh, &ray);
        prop_assert_eq!(hit.is_some(), nearest_edge > 0.0);
        if let Some(hit) = hit {
            let near = |x: f32, y: f64| (f64::from(x) - y).abs() <= 1e-6 * y.abs().max(1.0);
            prop_assert!(near(hit.u, u) && near(hit.v, v) && near(hit.t, t), "{:?}", hit);
            let along = dot(hit.normal.map(f64::from), cross(ab, ac));
            let length = dot(cross(ab, ac), cross(ab, ac)).sqrt();
            prop_assert!((along / length - 1.0).abs() < 1e-6);
        }
    }
}
