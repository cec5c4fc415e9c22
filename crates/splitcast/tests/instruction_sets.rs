//! Every query on every instruction set that the machine has. In a process of
//! its own, since what is forced holds for all threads.

mod suite;

use splitcast::{BuildOptions, KdTree, Mesh, NonFinite, SimdLevel, force_simd};
use suite::{Expectations, cases, default_sets};

#[test]
fn hits_are_the_same_bits_on_every_instruction_set() {
    for (name, soup) in cases::all() {
        let mesh = Mesh::new(&soup.positions, &soup.triangles).expect("a sound mesh");
        // Brute force, which does without.
        let expectations = Expectations::new(mesh);
        for options in default_sets() {
            let options = BuildOptions {
                non_finite: NonFinite::Skip,
                ..options
            };
            let tree = KdTree::build(mesh, &options).expect("bad triangles are skipped");
            for &level in SimdLevel::ALL.iter().filter(|level| level.is_available()) {
                force_simd(Some(level)).expect("it is available");
                expectations.check(&tree, &format!("{name} with {}, {level}", options.builder));
            }
        }
    }
}
