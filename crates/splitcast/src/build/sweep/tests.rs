//! The sweep against a search that tries every plane and counts anew for each,
//! and trees whose shape can be told beforehand.

use proptest::prelude::*;

use super::*;
use crate::build::limits::MAX_GROWTH;
use crate::{Builder, KdTree, Node, NodeKind};

/// A triangle soup that owns its vertices.
#[derive(Clone, Debug, Default)]
struct Soup {
    positions: Vec<[f32; 3]>,
    triangles: Vec<[u32; 3]>,
}

impl Soup {
    fn of(corners: impl IntoIterator<Item = [[f32; 3]; 3]>) -> Self {
        let mut soup = Self::default();
        for triangle in corners {
            let first = soup.positions.len() as u32;
            soup.positions.extend(triangle);
            soup.triangles.push([first, first + 1, first + 2]);
        }
        soup
    }

    /// Two triangles.
    fn add_quad(&mut self, origin: [f32; 3], u: [f32; 3], v: [f32; 3]) {
        let at = |s: f32, t: f32| std::array::from_fn(|k| origin[k] + s * u[k] + t * v[k]);
        let first = self.positions.len() as u32;
        self.positions
            .extend([at(0.0, 0.0), at(1.0, 0.0), at(1.0, 1.0), at(0.0, 1.0)]);
        self.triangles.push([first, first + 1, first + 2]);
        self.triangles.push([first, first + 2, first + 3]);
    }

    /// Twelve triangles around a cube.
    fn add_cube(&mut self, [x, y, z]: [f32; 3], size: f32) {
        let axes = [[size, 0.0, 0.0], [0.0, size, 0.0], [0.0, 0.0, size]];
        for k in 0..3 {
            let (u, v) = (axes[(k + 1) % 3], axes[(k + 2) % 3]);
            self.add_quad([x, y, z], u, v);
            self.add_quad([x + axes[k][0], y + axes[k][1], z + axes[k][2]], u, v);
        }
    }

    fn mesh(&self) -> Mesh<'_> {
        Mesh::new(&self.positions, &self.triangles).unwrap()
    }

    fn tree(&self, options: &BuildOptions) -> KdTree<'_> {
        KdTree::build(self.mesh(), options).unwrap()
    }

    fn bounds(&self) -> Aabb {
        Aabb::of_points(&self.positions)
    }

    /// The part of the soup in `cell`, as a build would have it there.
    fn references_in(&self, cell: &Aabb) -> Vec<Reference> {
        let mesh = self.mesh();
        (0..self.triangles.len() as u32)
            .filter_map(|triangle| {
                let bounds = clipped_bounds(&mesh.corners(triangle), cell)?;
                let mut reference = Reference::ZERO;
                (reference.min, reference.max) = (bounds.min, bounds.max);
                reference.triangle = triangle;
                Some(reference)
            })
            .collect()
    }
}

/// Costs that the shapes below are told by, whatever the presets become.
fn options(leaf_width: u32) -> BuildOptions {
    BuildOptions {
        builder: Builder::Sweep,
        cost: CostModel {
            traversal: 1.0,
            intersection: 1.5,
            leaf_width,
            empty_bonus: 0.2,
        },
        min_split: 1,
        ..BuildOptions::default()
    }
}

fn coordinate() -> impl Strategy<Value = f32> {
    prop_oneof![(-4..=4).prop_map(|x| x as f32 / 4.0), -1.0_f32..1.0]
}

fn point() -> impl Strategy<Value = [f32; 3]> {
    prop::array::uniform3(coordinate())
}

/// Triangles of which many are degenerate, share planes, or lie in one plane.
fn soup(triangles: usize) -> impl Strategy<Value = Soup> {
    let flat = (point(), point(), point(), 0..3_usize).prop_map(|(a, mut b, mut c, axis)| {
        (b[axis], c[axis]) = (a[axis], a[axis]);
        [a, b, c]
    });
    let triangle = prop_oneof![2 => prop::array::uniform3(point()), 1 => flat];
    prop::collection::vec(triangle, 1..=triangles).prop_map(Soup::of)
}

fn cell() -> impl Strategy<Value = Aabb> {
    (point(), point()).prop_map(|(a, b)| Aabb::of_points(&[a, b]))
}

/// The least cost over all planes at borders of boxes, with planar triangles
/// on either side, straight from the definition.
fn least_cost(boxes: &[Aabb], cell: &Aabb, cost: &CostModel) -> Option<f32> {
    let mut best: Option<f32> = None;
    for axis in 0..3 {
        if cell.extent()[axis] == 0.0 {
            continue;
        }
        for position in boxes.iter().flat_map(|b| [b.min[axis], b.max[axis]]) {
            for planar_left in [true, false] {
                let planar = |b: &Aabb| b.min[axis] == position && b.max[axis] == position;
                let goes_left = |b: &&Aabb| b.min[axis] < position || planar(b) && planar_left;
                let goes_right = |b: &&Aabb| b.max[axis] > position || planar(b) && !planar_left;
                let left_count = boxes.iter().filter(goes_left).count() as u32;
                let right_count = boxes.iter().filter(goes_right).count() as u32;
                let (left, right) = cell.split(axis, position);
                let useless = left.extent()[axis] == 0.0 && left_count == 0
                    || right.extent()[axis] == 0.0 && right_count == 0;
                let area = cell.half_area();
                if useless || area == 0.0 {
                    continue;
                }
                let cost = cost.split(
                    (left.half_area() / area, left_count),
                    (right.half_area() / area, right_count),
                );
                best = Some(best.map_or(cost, |best| best.min(cost)));
            }
        }
    }
    best
}

/// Boxes of a node's references from its events.
fn boxes_of(sweep: &Sweep<'_>, start: NodeStart, end: NodeStart) -> Vec<(u32, Aabb)> {
    let triangles = &sweep.triangles[start.triangles..end.triangles];
    let mut boxes: Vec<_> = triangles.iter().map(|&t| (t, Aabb::EMPTY)).collect();
    for axis in 0..3 {
        let events = &sweep.axes[axis].stack[start.events[axis]..end.events[axis]];
        assert!(events.is_sorted_by(|a, b| a < b), "{events:?}");
        for event in events {
            let bounds = &mut boxes[event.reference()].1;
            if event.kind() != EventKind::End {
                assert_eq!(bounds.min[axis], f32::INFINITY);
                bounds.min[axis] = event.position();
            }
            if event.kind() != EventKind::Start {
                assert_eq!(bounds.max[axis], f32::NEG_INFINITY);
                bounds.max[axis] = event.position();
            }
        }
    }
    assert!(boxes.iter().all(|(_, bounds)| !bounds.is_empty()));
    boxes
}

fn end_of(sweep: &Sweep<'_>) -> NodeStart {
    NodeStart {
        triangles: sweep.triangles.len(),
        events: sweep.axes.each_ref().map(|axis| axis.stack.len()),
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(600))]

    #[test]
    fn finds_the_least_cost_of_all_planes(
        soup in soup(24),
        cell in prop::option::of(cell()),
        width in prop::sample::select(vec![1, 2, 8]),
    ) {
        let cell = cell.unwrap_or(soup.bounds());
        let options = options(width);
        let references = soup.references_in(&cell);
        let boxes: Vec<_> = references.iter().map(Reference::bounds).collect();
        let mut sweep = Sweep::new(soup.mesh(), &options);
        sweep.push_root(&references);
        let found = sweep.find_split(NodeStart::default(), &cell).map(|split| split.cost);
        let expected = least_cost(&boxes, &cell, &options.cost);
        match (found, expected) {
            (Some(found), Some(expected)) => {
                prop_assert!((found - expected).abs() <= 1e-5 * expected, "{found} {expected}");
            }
            _ => prop_assert_eq!(found, expected),
        }
    }

    #[test]
    fn children_are_what_sorting_anew_would_give(soup in soup(24), cell in prop::option::of(cell())) {
        let cell = cell.unwrap_or(soup.bounds());
        let options = options(1);
        let mut sweep = Sweep::new(soup.mesh(), &options);
        sweep.push_root(&soup.references_in(&cell));
        let root = NodeStart::default();
        let Some(split) = sweep.find_split(root, &cell) else {
            return Ok(());
        };
        let parent = boxes_of(&sweep, root, end_of(&sweep));
        let cells = split.cells(&cell);
        let left = sweep.split(root, &split, &cells);
        let children = [boxes_of(&sweep, left, end_of(&sweep)), boxes_of(&sweep, root, left)];

        for (side, (child, cell)) in children.iter().zip(&cells).enumerate() {
            for (triangle, bounds) in child {
                let fresh = clipped_bounds(&soup.mesh().corners(*triangle), cell).unwrap();
                for k in 0..3 {
                    prop_assert!(bounds.min[k] >= cell.min[k] && bounds.max[k] <= cell.max[k]);
                    prop_assert!((bounds.min[k] - fresh.min[k]).abs() <= 1e-6);
                    prop_assert!((bounds.max[k] - fresh.max[k]).abs() <= 1e-6);
                }
            }
            let expected: Vec<u32> = parent
                .iter()
                .filter(|(_, bounds)| {
                    let (min, max) = (bounds.min[split.axis], bounds.max[split.axis]);
                    let planar = min == split.position && max == split.position;
                    if side == 0 {
                        min < split.position || planar && split.planar_side == PlanarSide::Left
                    } else {
                        max > split.position || planar && split.planar_side == PlanarSide::Right
                    }
                })
                .map(|&(triangle, _)| triangle)
                .collect();
            let found: Vec<u32> = child.iter().map(|&(triangle, _)| triangle).collect();
            prop_assert_eq!(found, expected);
        }
    }

    #[test]
    fn trees_are_whole(
        soup in soup(60),
        width in prop::sample::select(vec![1, 8]),
        scale in prop::sample::select(vec![1.0_f32, 1e11, 1e-20]),
    ) {
        let mut soup = soup;
        for x in soup.positions.iter_mut().flatten() {
            *x *= scale;
        }
        let tree = soup.tree(&options(width));
        prop_assert_eq!(tree.validate(), Ok(()));
    }
}

/// The depth-first list of a tree's nodes without indices.
fn outline(tree: &KdTree<'_>) -> Vec<String> {
    let show = |node: &Node| match node.kind() {
        NodeKind::Inner { axis, position, .. } => format!("{}={position}", ["x", "y", "z"][axis]),
        NodeKind::Leaf { first, count } => {
            format!("{:?}", &tree.references()[first..first + count])
        }
    };
    tree.nodes().iter().map(show).collect()
}

#[test]
fn separate_cubes_come_apart() {
    let mut soup = Soup::default();
    for cube in 0..64 {
        let at = |bits: u32| (cube >> bits & 3) as f32;
        soup.add_cube([at(0), at(2), at(4)], 0.25);
    }
    // A leaf of twelve costs more than one plane, less than cutting the cube open.
    let tree = soup.tree(&options(16));
    assert_eq!(tree.validate(), Ok(()));
    let mut cubes = 0;
    tree.visit(|node| {
        if let NodeKind::Leaf { first, count } = node.kind
            && count > 0
        {
            let leaf = &tree.references()[first..first + count];
            let cube = leaf[0] / 12;
            assert_eq!(leaf, Vec::from_iter(12 * cube..12 * cube + 12));
            assert!(node.cell.extent().iter().all(|&x| x == 0.25), "{node:?}");
            cubes += 1;
        }
    });
    assert_eq!(cubes, 64);
}

#[test]
fn a_floor_is_cut_off_as_a_flat_cell() {
    // Eight triangles fill the lower border of the cell, one reaches to its upper corner.
    let mut soup = Soup::default();
    for k in 0..4 {
        soup.add_quad([k as f32, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 4.0, 0.0]);
    }
    let spike = Soup::of([[[1.0, 1.0, 0.0], [1.1, 1.0, 0.0], [1.0, 1.0, 4.0]]]);
    soup.triangles.push([16, 17, 18]);
    soup.positions.extend(spike.positions);
    let tree = soup.tree(&BuildOptions {
        max_depth: Some(1),
        ..options(1)
    });
    assert_eq!(outline(&tree), ["z=0", "[0, 1, 2, 3, 4, 5, 6, 7]", "[8]"]);
    assert_eq!(tree.validate(), Ok(()));
}

#[test]
fn empty_space_is_cut_off_once() {
    // The box of the whole is that of both triangles; the left one leaves most of it empty.
    let soup = Soup::of([
        [[0.0, 0.0, 0.0], [1.0, 0.0, 0.1], [0.0, 1.0, 0.2]],
        [[8.0, 0.0, 0.0], [9.0, 0.0, 0.1], [8.0, 1.0, 9.0]],
    ]);
    let tree = soup.tree(&options(1));
    assert_eq!(tree.validate(), Ok(()));
    let outline = outline(&tree);
    let mut planes: Vec<_> = outline.iter().filter(|node| node.contains('=')).collect();
    let all = planes.len();
    planes.sort();
    planes.dedup();
    assert_eq!(planes.len(), all, "{outline:?}");
}

#[test]
fn everything_in_one_place_is_one_leaf() {
    let point = Soup::of([[[1.0, 2.0, 3.0]; 3]; 100]);
    let segment = Soup::of([[[0.0; 3], [0.0, 0.0, 1.0], [0.0, 0.0, 0.5]]; 100]);
    let triangle = Soup::of([[[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 1.0]]; 100]);
    for soup in [point, segment, triangle, Soup::default()] {
        let tree = soup.tree(&options(1));
        assert_eq!(tree.nodes().len(), 1);
        assert_eq!(tree.references().len(), soup.triangles.len());
        assert_eq!(tree.validate(), Ok(()));
    }
}

#[test]
fn both_zeros_are_one_place() {
    let triangle = |z: f32| [[0.0, 0.0, z], [1.0, -0.0, z], [-0.0, 1.0, z]];
    let soup = Soup::of([triangle(-0.0), triangle(0.0), triangle(1.0)]);
    let tree = soup.tree(&BuildOptions {
        max_depth: Some(1),
        ..options(1)
    });
    assert_eq!(outline(&tree), ["z=0", "[0, 1]", "[2]"]);
}

#[test]
fn bounds_on_depth_and_leaves_hold() {
    let mut soup = Soup::default();
    for cube in 0..64 {
        soup.add_cube([cube as f32, 0.0, 0.0], 0.5);
    }
    let tree = soup.tree(&BuildOptions {
        max_depth: Some(3),
        ..options(1)
    });
    tree.visit(|node| assert!(node.depth <= 3));
    assert_eq!(tree.validate(), Ok(()));
    let tree = soup.tree(&BuildOptions {
        min_split: 100,
        ..options(1)
    });
    let mut parents = 0;
    tree.visit(|node| parents += usize::from(matches!(node.kind, NodeKind::Inner { .. })));
    assert!((7..16).contains(&parents), "{parents}");
    assert_eq!(tree.validate(), Ok(()));
}

#[test]
fn references_stay_in_proportion() {
    // Slivers of every length around one corner, which all splits toward it cut again.
    let mut state = 1_u32;
    let mut random = || {
        // The linear congruential generator of Numerical Recipes.
        state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        10_f32.powf(-20.0 * (state >> 8) as f32 / (1 << 24) as f32)
    };
    let mut corners = || [0; 3].map(|_| [0; 3].map(|_| random()));
    let soup = Soup::of((0..1000).map(|_| corners()));
    for &builder in Builder::ALL {
        let tree = soup.tree(&BuildOptions {
            builder,
            ..options(1)
        });
        assert!(tree.references().len() <= 1000 * MAX_GROWTH as usize);
        assert_eq!(tree.validate(), Ok(()));
    }
}

#[test]
fn any_number_of_threads_builds_the_same_tree() {
    // A wavy sheet, large enough for several levels of joins.
    let side = 2 * (PARALLEL_TRIANGLES as f32).sqrt() as u32;
    let mut soup = Soup::default();
    for y in 0..=side {
        for x in 0..=side {
            let (x, y) = (x as f32, y as f32);
            soup.positions.push([x, y, (x * x + 3.0 * x * y) % 17.0]);
        }
    }
    for y in 0..side {
        for x in 0..side {
            let at = |x, y| y * (side + 1) + x;
            soup.triangles.push([at(x, y), at(x + 1, y), at(x, y + 1)]);
            soup.triangles
                .push([at(x + 1, y + 1), at(x + 1, y), at(x, y + 1)]);
        }
    }
    assert!(soup.triangles.len() > 4 * PARALLEL_TRIANGLES);
    let build = |threads| {
        let pool = rayon::ThreadPoolBuilder::new()
            .num_threads(threads)
            .build()
            .unwrap();
        pool.install(|| soup.tree(&options(8)))
    };
    let tree = build(1);
    assert_eq!(tree.validate(), Ok(()));
    for threads in [2, 5] {
        let other = build(threads);
        assert_eq!(other.nodes(), tree.nodes());
        assert_eq!(other.references(), tree.references());
    }
}
