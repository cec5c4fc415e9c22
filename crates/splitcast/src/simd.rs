//! Choosing the instruction set at run time.
//!
//! Kernels are written once, over arrays of lanes in safe code, and compiled
//! once per instruction set: [`dispatch`] runs the best copy that the machine
//! has. All copies do the same IEEE operations in the same order (nothing is
//! fused or reassociated), so all of them give the same bits.

/// A piece of work that is compiled for every instruction set.
///
/// `run` and everything hot below it has to be `#[inline(always)]`: only code
/// inlined into the dispatching function is compiled with its features.
pub(crate) trait Kernel {
    /// What the work gives.
    type Output;

    /// Does the work.
    fn run(self) -> Self::Output;
}

/// Runs `kernel` with the widest instruction set of this machine. Costs an
/// indirect call, so dispatch whole phases, not single nodes or rays.
#[cfg(target_arch = "x86_64")]
pub(crate) fn dispatch<K: Kernel>(kernel: K) -> K::Output {
    #[target_feature(enable = "avx512f,avx512bw,avx512dq,avx512vl,bmi1,bmi2,lzcnt,popcnt")]
    fn avx512<K: Kernel>(kernel: K) -> K::Output {
        kernel.run()
    }
    #[target_feature(enable = "avx2,bmi1,bmi2,lzcnt,popcnt")]
    fn avx2<K: Kernel>(kernel: K) -> K::Output {
        kernel.run()
    }
    let bits = is_x86_feature_detected!("bmi1")
        && is_x86_feature_detected!("bmi2")
        && is_x86_feature_detected!("lzcnt")
        && is_x86_feature_detected!("popcnt");
    if bits
        && is_x86_feature_detected!("avx512f")
        && is_x86_feature_detected!("avx512bw")
        && is_x86_feature_detected!("avx512dq")
        && is_x86_feature_detected!("avx512vl")
    {
        // SAFETY: every feature that `avx512` enables was just detected.
        unsafe { avx512(kernel) }
    } else if bits && is_x86_feature_detected!("avx2") {
        // SAFETY: every feature that `avx2` enables was just detected.
        unsafe { avx2(kernel) }
    } else {
        kernel.run()
    }
}

/// Runs `kernel`; what the compiler may assume anyway (NEON on AArch64) is all there is.
#[cfg(not(target_arch = "x86_64"))]
pub(crate) fn dispatch<K: Kernel>(kernel: K) -> K::Output {
    kernel.run()
}
