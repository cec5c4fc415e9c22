//! tinybvh: trees of boxes in C++, through the binding tinybvh-rs, if asked for.
//!
//! The binding compiles for the machine it is built on. It offers the tree with eight
//! children, the fastest to trace, only where Rust's code is compiled for AVX2 as well.

use super::Catalog;

#[cfg(all(feature = "tinybvh", target_feature = "avx2"))]
mod trees;

#[cfg(all(feature = "tinybvh", target_feature = "avx2"))]
pub(super) fn add_to(catalog: &mut Catalog) {
    trees::add_to(catalog);
}

/// Adds the reason why there is nothing to add.
#[cfg(not(all(feature = "tinybvh", target_feature = "avx2")))]
pub(super) fn add_to(catalog: &mut Catalog) {
    let reason = if cfg!(feature = "tinybvh") {
        "its trees need AVX2; set RUSTFLAGS=\"-C target-cpu=native\", which all others run with, too"
    } else {
        "not built in; add --features tinybvh (needs a C++20 compiler)"
    };
    catalog.missing.push(format!("tinybvh: {reason}"));
}
