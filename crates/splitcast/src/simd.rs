//! Choosing the instruction set at run time.
//!
//! Kernels are written once, over vectors of fixed width, and compiled once
//! per instruction set; [`dispatch`] runs the best copy that the machine has.
//! All copies do the same IEEE operations in the same order (nothing is fused
//! or approximated), so all of them give the same bits.

use fearless_simd::{Level, Simd};

/// A piece of work that is compiled for every instruction set.
///
/// `run` and everything hot below it has to be `#[inline(always)]`: only code
/// inlined into the dispatching function is compiled with its features.
pub(crate) trait Kernel {
    /// What the work gives.
    type Output;

    /// Does the work.
    fn run<S: Simd>(self, simd: S) -> Self::Output;
}

/// Runs `kernel` with the widest instruction set of this machine. Costs an
/// indirect call, so dispatch whole phases, not single nodes or rays.
pub(crate) fn dispatch<K: Kernel>(kernel: K) -> K::Output {
    fearless_simd::dispatch!(Level::new(), simd => kernel.run(simd))
}
