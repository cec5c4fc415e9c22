//! Asking for memory before it is needed: the only unsafe code of this crate.

/// The size of a cache line, in bytes.
const LINE: usize = 64;

/// Has all of a value brought into the first cache, without waiting for it.
#[inline(always)]
pub(crate) fn prefetch<T>(value: &T) {
    for line in 0..size_of::<T>().div_ceil(LINE) {
        let address = (&raw const *value).cast::<i8>().wrapping_add(line * LINE);
        #[cfg(target_arch = "x86_64")]
        // SAFETY: a hint that may name any address; SSE is part of every x86-64 machine.
        unsafe {
            use std::arch::x86_64::{_MM_HINT_T0, _mm_prefetch};
            _mm_prefetch::<_MM_HINT_T0>(address);
        }
        #[cfg(target_arch = "aarch64")]
        // SAFETY: a hint that may name any address, and changes neither memory nor flags.
        unsafe {
            std::arch::asm!(
                "prfm pldl1keep, [{address}]",
                address = in(reg) address,
                options(nostack, preserves_flags, readonly)
            );
        }
        #[cfg(not(any(target_arch = "x86_64", target_arch = "aarch64")))]
        let _ = address;
    }
}
