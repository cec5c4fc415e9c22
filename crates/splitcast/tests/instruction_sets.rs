//! Every build and every query on every instruction set that the machine has.
//! One test in a process of its own, since what is forced holds for all threads.

mod suite;

use splitcast::{
    BuildOptions, Builder, KdTree, Mesh, NonFinite, SequenceBuilder, SimdLevel, force_simd,
};
use suite::meshes::sheet;
use suite::{Expectations, cases, default_sets};

#[test]
fn trees_and_hits_are_the_same_bits_on_every_instruction_set() {
    // Enough for every phase of a build.
    let sheet = sheet(60, 0.0);
    for options in default_sets() {
        build_everywhere(
            "sheet",
            Mesh::new(&sheet.positions, &sheet.triangles).unwrap(),
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
                let what = format!("{name} with {}, {level}", options.builder);
                expectations.check(&tree, &what);
                if options.builder == Builder::ALL[0] {
                    expectations.check_long_slices(&tree, &what);
                }
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
