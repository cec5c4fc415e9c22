//! Choosing the instruction set at run time.
//!
//! Kernels are written once, over vectors of fixed width, and compiled once
//! per instruction set; [`dispatch`] runs the best copy that the machine has.
//! All copies do the same IEEE operations in the same order (nothing is approximated, and
//! fused only where error bounds allow for either), so all of them give the same results to
//! the last bit.

use std::fmt;
use std::str::FromStr;
use std::sync::atomic::{AtomicU8, Ordering};

use fearless_simd::{Level, Simd};

/// What [`force_simd`] has asked for: the place in [`SimdLevel::ALL`] and 1, or
/// 0 for nothing.
static FORCED: AtomicU8 = AtomicU8::new(0);

/// An instruction set that the hot parts of this crate are compiled for.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub enum SimdLevel {
    /// No instructions beyond what the compiler assumes anyway.
    Scalar,
    /// SSE2, part of every x86-64 machine.
    Sse,
    /// AVX2 (x86-64-v3).
    Avx2,
    /// AVX-512 as on Ice Lake, Zen 4 and later.
    Avx512,
    /// NEON, part of every AArch64 machine.
    Neon,
}

impl SimdLevel {
    /// Every level, whether this machine has it or not.
    pub const ALL: &'static [Self] = &[
        Self::Scalar,
        Self::Sse,
        Self::Avx2,
        Self::Avx512,
        Self::Neon,
    ];

    /// The name used on command lines and in tables.
    pub fn name(self) -> &'static str {
        match self {
            Self::Scalar => "scalar",
            Self::Sse => "sse",
            Self::Avx2 => "avx2",
            Self::Avx512 => "avx512",
            Self::Neon => "neon",
        }
    }

    /// Whether this machine has the instruction set.
    pub fn is_available(self) -> bool {
        self.level().is_some()
    }

    /// The library's token that proves the instruction set is there.
    fn level(self) -> Option<Level> {
        let best = Level::new();
        match self {
            Self::Scalar => Some(Level::fallback()),
            #[cfg(target_arch = "x86_64")]
            Self::Sse => best.as_sse2().map(Level::Sse2),
            #[cfg(target_arch = "x86_64")]
            Self::Avx2 => best.as_avx2().map(Level::Avx2),
            #[cfg(target_arch = "x86_64")]
            Self::Avx512 => best.as_avx512().map(Level::Avx512),
            #[cfg(target_arch = "aarch64")]
            Self::Neon => best.as_neon().map(Level::Neon),
            _ => {
                let _ = best;
                None
            }
        }
    }
}

impl fmt::Display for SimdLevel {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

/// Why an instruction set cannot be used.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum SimdError {
    /// A name that no instruction set has.
    #[error("no instruction set is called '{name}', expected one of: {}", names(|_| true))]
    Unknown {
        /// The name that was asked for.
        name: String,
    },
    /// The machine lacks it.
    #[error(
        "this machine has no {level}, expected one of: {}",
        names(SimdLevel::is_available)
    )]
    Unavailable {
        /// What was asked for.
        level: SimdLevel,
    },
}

impl FromStr for SimdLevel {
    type Err = SimdError;

    fn from_str(name: &str) -> Result<Self, Self::Err> {
        Self::ALL
            .iter()
            .copied()
            .find(|level| level.name() == name)
            .ok_or_else(|| SimdError::Unknown { name: name.into() })
    }
}

/// Makes the whole process use one instruction set, or the best that the
/// machine has again (`None`, the default). For tests and measurements: results
/// are the same bits with any.
///
/// # Errors
/// [`SimdError::Unavailable`] if the machine lacks it; nothing changes then.
pub fn force_simd(level: Option<SimdLevel>) -> Result<(), SimdError> {
    let forced = match level {
        None => 0,
        Some(level) if level.is_available() => {
            let place = SimdLevel::ALL.iter().position(|&other| other == level);
            place.map_or(0, |place| place as u8 + 1)
        }
        Some(level) => return Err(SimdError::Unavailable { level }),
    };
    FORCED.store(forced, Ordering::Relaxed);
    Ok(())
}

/// A piece of work that is compiled for every instruction set.
///
/// `run` and everything hot below it has to be `#[inline(always)]`: only code
/// inlined into the dispatching function is compiled with its features.
/// Vectors are those of the crate `fearless_simd`.
pub trait Kernel {
    /// What the work gives.
    type Output;

    /// Does the work.
    fn run<S: Simd>(self, simd: S) -> Self::Output;
}

/// Runs `kernel` with the widest instruction set of this machine, or the one
/// asked for. Costs an indirect call, so dispatch whole phases, not single
/// nodes or rays.
#[inline(never)] // Kernels that call others stay small: compilers take long for large functions.
pub fn dispatch<K: Kernel>(kernel: K) -> K::Output {
    match level() {
        Level::Fallback(simd) => compiled_for(simd, kernel),
        level => Vectors(level).run(kernel),
    }
}

/// The instruction set that kernels run with.
fn level() -> Level {
    let forced = usize::from(FORCED.load(Ordering::Relaxed));
    forced
        .checked_sub(1)
        .and_then(|place| SimdLevel::ALL[place].level())
        .unwrap_or_else(Level::new)
}

/// An instruction set with vectors, for kernels that pay only with these. There is no scalar copy of them,
/// which takes compilers several times as long as any other.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Vectors(Level);

impl Vectors {
    /// That of [`dispatch`], if it has vectors.
    pub(crate) fn chosen() -> Option<Self> {
        match level() {
            Level::Fallback(_) => None,
            level => Some(Self(level)),
        }
    }

    /// Runs a kernel, for less than [`dispatch`] costs.
    #[inline(always)]
    pub(crate) fn run<K: Kernel>(self, kernel: K) -> K::Output {
        // Every copy takes time to compile: machines with SSE4.2 and nothing better make do with SSE2.
        match self.0 {
            #[cfg(target_arch = "x86_64")]
            Level::Avx512(simd) => compiled_for(simd, kernel),
            #[cfg(target_arch = "x86_64")]
            Level::Avx2(simd) => compiled_for(simd, kernel),
            #[cfg(target_arch = "x86_64")]
            level => compiled_for(level.as_sse2().expect("part of every such machine"), kernel),
            #[cfg(target_arch = "aarch64")]
            level => compiled_for(level.as_neon().expect("part of every such machine"), kernel),
            #[cfg(not(any(target_arch = "x86_64", target_arch = "aarch64")))]
            _ => compiled_for(fearless_simd::Fallback::new(), kernel),
        }
    }
}

/// `kernel`'s copy for one instruction set.
#[inline(always)]
fn compiled_for<S: Simd, K: Kernel>(simd: S, kernel: K) -> K::Output {
    simd.vectorize(
        #[inline(always)]
        || kernel.run(simd),
    )
}

/// The names of the levels that `filter` lets through, for error messages.
fn names(filter: impl Fn(SimdLevel) -> bool) -> String {
    let levels = SimdLevel::ALL.iter().filter(|level| filter(**level));
    levels
        .map(|level| level.name())
        .collect::<Vec<_>>()
        .join(", ")
}
