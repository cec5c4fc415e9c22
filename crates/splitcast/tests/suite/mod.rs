//! The shared correctness suite: any mesh, every builder, every query, held
//! against brute force to the last bit.
//!
//! Tests of other crates take it in with
//! `#[path = "../../splitcast/tests/suite/mod.rs"] mod suite;` and hand their
//! meshes to [`check_mesh`].

#![allow(
    dead_code,
    reason = "every test that takes the suite in uses a part of it"
)]

pub(crate) mod cases;
pub(crate) mod edits;
pub(crate) mod meshes;
pub(crate) mod rays;
mod slices;

use splitcast::{
    BuildOptions, Builder, Hit, KdTree, Mesh, NonFinite, Preset, Ray, SequenceBuilder, Violation,
    reference,
};

use slices::Slices;

/// Triangle tests that brute force may take per mesh: about a tenth of a second.
const BRUTE_FORCE_TESTS: usize = 1_000_000;

/// Every builder with every preset, and with bounds that make it stop early or never.
pub(crate) fn option_sets() -> Vec<BuildOptions> {
    let mut sets = Vec::new();
    for &builder in Builder::ALL {
        for &preset in Preset::ALL {
            let options = BuildOptions {
                builder,
                non_finite: NonFinite::Skip,
                ..BuildOptions::preset(preset)
            };
            sets.push(options);
        }
        let base = sets[sets.len() - 1];
        for max_depth in [0, 1, 5] {
            sets.push(BuildOptions {
                max_depth: Some(max_depth),
                ..base
            });
        }
        sets.push(BuildOptions {
            min_split: 40,
            ..base
        });
        // Splitting is nearly free: trees as deep as they get.
        let mut deep = base;
        deep.cost.intersection = 20.0;
        deep.cost.leaf_width = 1;
        deep.cost.empty_bonus = 0.9;
        deep.max_depth = Some(24);
        sets.push(deep);
    }
    sets
}

/// Builds trees over the mesh in every way and checks each of them: it is
/// whole, and all queries over all kinds of rays give what brute force gives. Twice, since
/// builders that track do something else in a second frame.
///
/// # Panics
/// If anything is wrong; the message names mesh, options and ray.
pub(crate) fn check_mesh(name: &str, positions: &[[f32; 3]], triangles: &[[u32; 3]]) {
    let mut suite = Suite::new(&option_sets());
    suite.check_next(name, positions, triangles);
    suite.check_next(&format!("{name}, again"), positions, triangles);
}

/// The frames of a sequence, built in many ways, each with its own memory of
/// the frames before.
pub(crate) struct Suite {
    builders: Vec<SequenceBuilder>,
}

impl Suite {
    pub(crate) fn new(option_sets: &[BuildOptions]) -> Self {
        let builder = |options| SequenceBuilder::new(options).expect("options within bounds");
        Self {
            builders: option_sets.iter().map(builder).collect(),
        }
    }

    /// Builds the next frame in every way and checks each tree; see [`check_mesh`].
    pub(crate) fn check_next(
        &mut self,
        name: &str,
        positions: &[[f32; 3]],
        triangles: &[[u32; 3]],
    ) {
        let mesh = Mesh::new(positions, triangles).unwrap_or_else(|e| panic!("{name}: {e}"));
        let expectations = Expectations::new(mesh);
        for (index, builder) in self.builders.iter_mut().enumerate() {
            let options = *builder.options();
            let tree = builder
                .build(mesh)
                .unwrap_or_else(|e| panic!("{name} with {options:?}: {e}"));
            check_whole(name, &tree, &options);
            let what = format!("{name} with {options:?}");
            expectations.check(&tree, &what);
            if index == 0 {
                expectations.check_long_slices(&tree, &what);
            }
        }
    }
}

/// Every builder with its default options.
pub(crate) fn default_sets() -> Vec<BuildOptions> {
    let with = |&builder: &Builder| BuildOptions {
        builder,
        ..BuildOptions::default()
    };
    Builder::ALL.iter().map(with).collect()
}

/// Panics if a tree is not whole or its figures do not add up.
pub(crate) fn check_whole(name: &str, tree: &KdTree<'_>, options: &BuildOptions) {
    if let Err(violations) = tree.validate() {
        let lines: Vec<String> = violations.iter().map(Violation::to_string).collect();
        panic!("{name} with {options:?}:\n{}", lines.join("\n"));
    }
    let stats = tree.stats();
    assert_eq!(stats.nodes, tree.nodes().len(), "{name}");
    assert_eq!(stats.nodes, stats.inner_nodes + stats.leaves, "{name}");
    assert_eq!(stats.leaves, stats.inner_nodes + 1, "{name}");
    assert_eq!(
        stats.depth_histogram.iter().sum::<usize>(),
        stats.leaves,
        "{name}"
    );
    let sizes = stats.leaf_size_histogram.iter().enumerate();
    let references: usize = sizes.map(|(size, leaves)| size * leaves).sum();
    assert_eq!(references, tree.references().len(), "{name}");
    assert!(stats.sah_cost.is_finite(), "{name}: {stats:?}");
    // Where cells overlap, leaves of 64 triangles are reached whatever the options say.
    let bound = options.max_depth.filter(|_| !tree.cells_overlap());
    if let Some(bound) = bound {
        assert!(
            stats.max_depth <= bound,
            "{name}: {} > {bound}",
            stats.max_depth
        );
    }
}

/// Rays over a mesh, with what brute force says of each.
pub(crate) struct Expectations {
    list: Vec<(Ray, Option<Hit>, Vec<Hit>)>,
    slices: Vec<Slices>,
}

impl Expectations {
    pub(crate) fn new(mesh: Mesh<'_>) -> Self {
        let count = BRUTE_FORCE_TESTS / mesh.triangles().len().max(1);
        Self::of_rays(mesh, count.clamp(100, 500))
    }

    /// The same with about so many rays that may hit something; with few, they are asked about one
    /// by one only.
    pub(crate) fn of_rays(mesh: Mesh<'_>, count: usize) -> Self {
        Self::of(mesh, rays::all_kinds(mesh, count))
    }

    /// The same with these rays.
    pub(crate) fn of(mesh: Mesh<'_>, rays: Vec<Ray>) -> Self {
        // Brute force takes its time over large meshes.
        let packets = (rays.len() / 100).min(3);
        let packets = packets.min(60_000 / mesh.triangles().len().max(1));
        let slices = slices::all(mesh, packets, &rays);
        let list = rays.into_iter().map(|ray| {
            let mut all = Vec::new();
            reference::all_hits(mesh, &ray, &mut all);
            let closest = reference::closest_hit(mesh, &ray);
            let occluded = reference::occluded(mesh, &ray);
            check_consistent(mesh, &ray, closest, occluded, &all);
            (ray, closest, all)
        });
        Self {
            list: list.collect(),
            slices,
        }
    }

    /// Number of rays that hit something.
    pub(crate) fn hits(&self) -> usize {
        self.list.iter().filter(|(_, hit, _)| hit.is_some()).count()
    }

    /// Panics if any query disagrees with brute force in a single bit.
    pub(crate) fn check(&self, tree: &KdTree<'_>, what: &str) {
        let mut found = Vec::new();
        for (ray, closest, all) in &self.list {
            let hit = tree.closest_hit(ray);
            assert_eq!(
                hit.map(bits),
                closest.map(bits),
                "closest hit of {ray:?} on {what}"
            );
            assert_eq!(
                tree.occluded(ray),
                closest.is_some(),
                "occlusion of {ray:?} on {what}"
            );
            tree.all_hits(ray, &mut found);
            assert!(
                found
                    .iter()
                    .copied()
                    .map(bits)
                    .eq(all.iter().copied().map(bits)),
                "all hits of {ray:?} on {what}: {found:?}, expected {all:?}"
            );
            check_choices(tree, ray, all, what);
        }
        slices::check(&self.slices, tree, tree.nodes().len(), what);
    }

    /// Panics if any ray of a long slice is not answered as brute force does; of another length with each of many trees.
    pub(crate) fn check_long_slices(&self, tree: &KdTree<'_>, what: &str) {
        slices::check_long(&self.slices, tree, tree.nodes().len() / 2, what);
    }
}

/// Panics if a query that lets some hits through finds anything but the first of those.
fn check_choices(tree: &KdTree<'_>, ray: &Ray, all: &[Hit], what: &str) {
    let is_hit = |hit: &Hit| {
        let place = all.binary_search_by(|one| {
            let order = one.t.total_cmp(&hit.t);
            order.then(one.triangle.cmp(&hit.triangle))
        });
        let known = place.is_ok_and(|place| bits(all[place]) == bits(*hit));
        assert!(known, "{hit:?} of {ray:?} on {what}");
    };
    let chosen_by = |hit: &Hit| hit.triangle % 3 == 1 || hit.u > hit.v;
    let chosen = tree.closest_hit_where(ray, |hit| {
        is_hit(hit);
        chosen_by(hit)
    });
    assert_eq!(
        chosen.map(bits),
        all.iter().copied().find(chosen_by).map(bits),
        "chosen hit of {ray:?} on {what}"
    );
    let last = all.last().map(|hit| hit.triangle);
    let occluded = tree.occluded_where(ray, |hit| {
        is_hit(hit);
        Some(hit.triangle) == last
    });
    assert_eq!(
        occluded,
        last.is_some(),
        "chosen occlusion of {ray:?} on {what}"
    );
}

/// A hit as the bits of its numbers.
pub(crate) fn bits(hit: Hit) -> (u32, [u32; 6]) {
    let [x, y, z] = hit.normal;
    (
        hit.triangle,
        [hit.t, hit.u, hit.v, x, y, z].map(f32::to_bits),
    )
}

/// What has to hold of the hits of one ray whatever finds them.
fn check_consistent(mesh: Mesh<'_>, ray: &Ray, closest: Option<Hit>, occluded: bool, all: &[Hit]) {
    assert_eq!(occluded, closest.is_some(), "{ray:?}");
    assert_eq!(all.first().copied().map(bits), closest.map(bits), "{ray:?}");
    for pair in all.windows(2) {
        assert!(
            (pair[0].t, pair[0].triangle) < (pair[1].t, pair[1].triangle),
            "{ray:?}"
        );
    }
    let mut triangles: Vec<u32> = all.iter().map(|hit| hit.triangle).collect();
    triangles.sort_unstable();
    assert!(
        triangles.windows(2).all(|pair| pair[0] != pair[1]),
        "{ray:?}"
    );
    for hit in all {
        let weights = [1.0 - hit.u - hit.v, hit.u, hit.v];
        assert!(hit.t >= ray.t_min && hit.t <= ray.t_max, "{ray:?}: {hit:?}");
        assert!(
            weights.iter().all(|w| (0.0..=1.0).contains(w)),
            "{ray:?}: {hit:?}"
        );
        let length = hit.normal.iter().map(|x| x * x).sum::<f32>();
        assert!((length - 1.0).abs() < 1e-6, "{ray:?}: {hit:?}");
        // The two ways to the point of the hit meet.
        let corners = mesh.corners(hit.triangle);
        let mut apart = 0.0f64;
        let mut reach = 0.0f64;
        // What the steps of the smallest distances come to.
        let mut step = 0.0f64;
        for axis in 0..3 {
            let origin = f64::from(ray.origin[axis]);
            let along = f64::from(hit.t) * f64::from(ray.direction[axis]);
            step = step.max(f64::from(f32::from_bits(1)) * f64::from(ray.direction[axis].abs()));
            let on_triangle = (0..3).map(|k| f64::from(weights[k]) * f64::from(corners[k][axis]));
            apart = apart.max((origin + along - on_triangle.sum::<f64>()).abs());
            for corner in corners {
                reach = reach.max((f64::from(corner[axis]) - origin).abs());
                reach = reach.max(f64::from(corner[axis]).abs());
            }
        }
        assert!(
            apart <= reach * 1e-6 + step,
            "{ray:?}: {hit:?} is {apart} off"
        );
    }
}
