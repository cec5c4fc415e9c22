//! Every builder and every query over every case, against brute force.

mod suite;

use proptest::prelude::*;
use rayon::prelude::*;
use splitcast::{
    BuildError, BuildOptions, Builder, CostModel, KdTree, Mesh, NonFinite, OptionsError, Preset,
};
use suite::meshes::{Soup, bumpy_sphere, sheet, sphere};
use suite::{Suite, cases, check_mesh, default_sets, option_sets};

fn mesh(soup: &Soup) -> Mesh<'_> {
    Mesh::new(&soup.positions, &soup.triangles).expect("generated meshes are sound")
}

#[test]
fn every_case_equals_brute_force() {
    cases::all().par_iter().for_each(|(name, soup)| {
        check_mesh(name, &soup.positions, &soup.triangles);
    });
}

#[test]
fn every_frame_of_an_animation_equals_brute_force() {
    let mut suite = Suite::new(&option_sets());
    for (frame, soup) in cases::animation().iter().enumerate() {
        suite.check_next(&format!("frame {frame}"), &soup.positions, &soup.triangles);
    }
}

/// Nothing that was tracked is of any use from one frame to the next.
#[test]
fn a_sequence_of_unrelated_meshes_equals_brute_force() {
    let mut suite = Suite::new(&default_sets());
    for (name, soup) in cases::all() {
        // Not skipped with the default options, but refused; see below.
        if !name.contains("finite") {
            suite.check_next(&name, &soup.positions, &soup.triangles);
        }
    }
}

#[test]
fn trees_do_not_depend_on_the_number_of_threads() {
    let soups = [
        bumpy_sphere(6, 0.3),
        cases::soup(20_000, 0.05, 3),
        sheet(60, 0.0),
    ];
    for (soup, &builder) in soups
        .iter()
        .flat_map(|s| Builder::ALL.iter().map(move |b| (s, b)))
    {
        for &preset in Preset::ALL {
            let options = BuildOptions {
                builder,
                ..BuildOptions::preset(preset)
            };
            let build = |threads| {
                let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build();
                let pool = pool.expect("a pool of a few threads");
                pool.install(|| KdTree::build(mesh(soup), &options).expect("finite vertices"))
            };
            let one = build(1);
            for threads in [2, 3, 7] {
                let several = build(threads);
                assert_eq!(one.bounds(), several.bounds());
                assert!(
                    one.nodes() == several.nodes(),
                    "{builder}, {preset:?}, {threads} threads"
                );
                assert!(
                    one.references() == several.references(),
                    "{builder}, {preset:?}"
                );
            }
        }
    }
}

#[test]
fn non_finite_vertices_are_named_or_skipped_and_counted() {
    for &builder in Builder::ALL {
        for bad in [f32::NAN, f32::INFINITY, -f32::INFINITY, 1.1e12] {
            let mut soup = sphere(2);
            soup.positions[20][1] = bad;
            let touched = |t: &&[u32; 3]| t.contains(&20);
            let expected = soup.triangles.iter().filter(touched).count();
            let first = soup.triangles.iter().position(|t| t.contains(&20)).unwrap();
            let mut options = BuildOptions {
                builder,
                ..BuildOptions::default()
            };
            match KdTree::build(mesh(&soup), &options) {
                Err(BuildError::NonFinite {
                    triangle,
                    vertex,
                    position,
                }) => {
                    assert_eq!((triangle, vertex), (first, 20));
                    assert_eq!(
                        position.map(f32::to_bits),
                        soup.positions[20].map(f32::to_bits)
                    );
                }
                other => panic!("expected the vertex to be named, got {other:?}"),
            }
            options.non_finite = NonFinite::Skip;
            let tree = KdTree::build(mesh(&soup), &options).expect("bad triangles are skipped");
            assert_eq!(tree.skipped_triangles(), expected);
            // A bad position that no triangle uses harms nobody.
            soup.triangles.retain(|t| !t.contains(&20));
            options.non_finite = NonFinite::Reject;
            let tree = KdTree::build(mesh(&soup), &options).expect("no triangle is bad");
            assert_eq!(tree.skipped_triangles(), 0);
        }
    }
}

#[test]
fn every_option_out_of_bounds_is_named() {
    let with_cost = |change: fn(&mut CostModel)| {
        let mut options = BuildOptions::default();
        change(&mut options.cost);
        options
    };
    let with = |change: fn(&mut BuildOptions)| {
        let mut options = BuildOptions::default();
        change(&mut options);
        options
    };
    let wrong = [
        (with_cost(|c| c.traversal = 0.0), "cost.traversal"),
        (with_cost(|c| c.traversal = f32::NAN), "cost.traversal"),
        (with_cost(|c| c.intersection = -1.0), "cost.intersection"),
        (
            with_cost(|c| c.intersection = f32::INFINITY),
            "cost.intersection",
        ),
        (with_cost(|c| c.leaf_width = 0), "cost.leaf_width"),
        (with_cost(|c| c.leaf_width = 3), "cost.leaf_width"),
        (with_cost(|c| c.leaf_width = 128), "cost.leaf_width"),
        (with_cost(|c| c.empty_bonus = 1.0), "cost.empty_bonus"),
        (with_cost(|c| c.empty_bonus = -0.1), "cost.empty_bonus"),
        (with_cost(|c| c.empty_bonus = f32::NAN), "cost.empty_bonus"),
        (
            BuildOptions {
                max_depth: Some(splitcast::MAX_DEPTH + 1),
                ..BuildOptions::default()
            },
            "max_depth",
        ),
        (with(|o| o.search.tolerance = 0.0), "search.tolerance"),
        (with(|o| o.search.tolerance = f32::NAN), "search.tolerance"),
        (
            with(|o| o.search.max_evaluations = 0),
            "search.max_evaluations",
        ),
        (with(|o| o.tracking.step = 0.6), "tracking.step"),
        (with(|o| o.tracking.drift = 0.9), "tracking.drift"),
        (with(|o| o.tracking.drift = f32::INFINITY), "tracking.drift"),
        (with(|o| o.tracking.gain = -0.1), "tracking.gain"),
        (
            with(|o| o.tracking.noise.process = -1.0),
            "tracking.noise.process",
        ),
        (
            with(|o| o.tracking.noise.measurement = 11.0),
            "tracking.noise.measurement",
        ),
        (with(|o| o.tracking.wiener.order = 0), "tracking."),
    ];
    let soup = sphere(0);
    for (options, field) in wrong {
        let error = match KdTree::build(mesh(&soup), &options) {
            Err(BuildError::Options(error)) => error,
            other => panic!("expected {field} to be refused, got {other:?}"),
        };
        let error: OptionsError = error;
        let text = error.to_string();
        assert!(text.starts_with(field) && !text.contains('\n'), "{text}");
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 48, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn random_soups_equal_brute_force(
        corners in proptest::collection::vec(proptest::array::uniform9(coordinate()), 1..60),
        scale in -12i32..12,
        shift in prop_oneof![Just(0.0f32), -1e4f32..1e4],
    ) {
        let mut soup = Soup::default();
        for c in corners {
            soup.push([[c[0], c[1], c[2]], [c[3], c[4], c[5]], [c[6], c[7], c[8]]]);
        }
        let soup = soup.moved([shift, 0.0, -shift]).scaled(10f32.powi(scale));
        check_mesh("random soup", &soup.positions, &soup.triangles);
    }
}

/// Mostly a few values that coincide, else anything from -1 to 1.
fn coordinate() -> impl Strategy<Value = f32> {
    prop_oneof![
        2 => prop::sample::select(vec![0.0f32, -0.0, 0.25, 0.5, 1.0, -1.0]),
        3 => -1.0f32..1.0,
    ]
}

#[test]
fn the_suite_covers_every_builder_and_preset() {
    let sets = option_sets();
    for builder in Builder::ALL {
        assert!(sets.iter().filter(|o| o.builder == *builder).count() >= Preset::ALL.len() + 5);
    }
}
