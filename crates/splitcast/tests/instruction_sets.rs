//! Every build and every query on every instruction set that the machine has.
//! One test in a process of its own, since what is forced holds for all threads.

mod suite;

use splitcast::{BuildOptions, KdTree, Mesh, NonFinite, SequenceBuilder, SimdLevel, force_simd};
use suite::{Expectations, cases, default_sets};

#[test]
fn trees_and_hits_are_the_same_bits_on_every_instruction_set() {
    let (positions, triangles) = sheet(60);
    for options in default_sets() {
        build_everywhere(
            "sheet",
            Mesh::new(&positions, &triangles).unwrap(),
            &options,
        );
    }
    for (name, soup) in cases::all() {
        let mesh = Mesh::new(&soup.positions, &soup.triangles).expect("a sound mesh");
        // Brute force, which does without.
        let expectations = Expectations::new(mesh);
        for options in default_sets() {
            let options = BuildOptions {
                non_finite: NonFinite::Skip,
                ..options
            };
            let tree = build_everywhere(&name, mesh, &options);
            for &level in SimdLevel::ALL.iter().filter(|level| level.is_available()) {
                force_simd(Some(level)).expect("it is available");
                expectations.check(&tree, &format!("{name} with {}, {level}", options.builder));
            }
        }
    }
}

/// Builds a tree with every instruction set and compares them, and those of
/// a second frame, for builders that track.
fn build_everywhere<'m>(name: &str, mesh: Mesh<'m>, options: &BuildOptions) -> KdTree<'m> {
    let build = || {
        let mut sequence = SequenceBuilder::new(options).expect("options within bounds");
        sequence.build(mesh).expect("bad triangles are skipped");
        sequence.build(mesh).expect("bad triangles are skipped")
    };
    force_simd(None).expect("always possible");
    let best = build();
    for &level in SimdLevel::ALL.iter().filter(|level| level.is_available()) {
        force_simd(Some(level)).expect("it is available");
        let tree = build();
        assert_eq!(tree.nodes(), best.nodes(), "{name}, {level}");
        assert_eq!(tree.references(), best.references(), "{name}, {level}");
        assert_eq!(tree.bounds(), best.bounds(), "{name}, {level}");
    }
    best
}

/// A wavy sheet of `2 * n * n` triangles: enough for every phase of a build.
fn sheet(n: u32) -> (Vec<[f32; 3]>, Vec<[u32; 3]>) {
    let position = |i: u32, j: u32| {
        let (x, y) = (i as f32 / n as f32, j as f32 / n as f32);
        // Polynomials only: the same on every platform.
        [x, y, (x - 0.3) * (y - 0.6) * (x - y)]
    };
    let positions = (0..=n)
        .flat_map(|i| (0..=n).map(move |j| position(i, j)))
        .collect();
    let triangles = (0..n)
        .flat_map(|i| (0..n).map(move |j| i * (n + 1) + j))
        .flat_map(|a| [[a, a + n + 1, a + n + 2], [a, a + n + 2, a + 1]])
        .collect();
    (positions, triangles)
}
