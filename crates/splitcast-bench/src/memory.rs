//! How much memory a system holds: an allocator that counts while it is asked to.

use std::alloc::{GlobalAlloc, Layout, System};
use std::sync::atomic::{AtomicBool, AtomicIsize, Ordering};
use std::sync::{Mutex, PoisonError};

/// Passes everything on to the system's allocator. While nothing is counted, that
/// costs one load of a flag that never changes, so times are not touched.
struct Counting;

static COUNTS: AtomicBool = AtomicBool::new(false);
static HELD: AtomicIsize = AtomicIsize::new(0);

#[global_allocator]
static ALLOCATOR: Counting = Counting;

fn count(change: isize) {
    if COUNTS.load(Ordering::Relaxed) {
        HELD.fetch_add(change, Ordering::Relaxed);
    }
}

// SAFETY: every call goes to the system's allocator unchanged, whose promises these are.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        count(layout.size() as isize);
        // SAFETY: the caller keeps the contract of `alloc`.
        unsafe { System.alloc(layout) }
    }

    unsafe fn alloc_zeroed(&self, layout: Layout) -> *mut u8 {
        count(layout.size() as isize);
        // SAFETY: the caller keeps the contract of `alloc_zeroed`.
        unsafe { System.alloc_zeroed(layout) }
    }

    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        count(-(layout.size() as isize));
        // SAFETY: the caller keeps the contract of `dealloc`.
        unsafe { System.dealloc(pointer, layout) }
    }

    unsafe fn realloc(&self, pointer: *mut u8, layout: Layout, new_size: usize) -> *mut u8 {
        count(new_size as isize - layout.size() as isize);
        // SAFETY: the caller keeps the contract of `realloc`.
        unsafe { System.realloc(pointer, layout, new_size) }
    }
}

/// Counts as long as it lives, and not any longer if there is a panic.
struct WhileCounting;

impl WhileCounting {
    fn new() -> Self {
        COUNTS.store(true, Ordering::SeqCst);
        Self
    }
}

impl Drop for WhileCounting {
    fn drop(&mut self) {
        COUNTS.store(false, Ordering::SeqCst);
    }
}

/// Runs `work` and tells by how many bytes it changed what all threads hold of
/// Rust's heap. One call waits for another.
pub(crate) fn held_by<R>(work: impl FnOnce() -> R) -> (R, isize) {
    static ONE_AT_A_TIME: Mutex<()> = Mutex::new(());
    // A panic in `work` leaves nothing behind.
    let _guard = ONE_AT_A_TIME.lock().unwrap_or_else(PoisonError::into_inner);
    HELD.store(0, Ordering::Relaxed);
    let counting = WhileCounting::new();
    let result = work();
    drop(counting);
    (result, HELD.load(Ordering::Relaxed))
}

#[cfg(test)]
mod tests {
    use super::*;

    // What is counted is tested in a program of its own, `tests/memory.rs`.
    #[test]
    fn a_panic_ends_the_counting() {
        let panic = std::panic::catch_unwind(|| held_by(|| panic!("on purpose")));
        assert!(panic.is_err() && !COUNTS.load(Ordering::SeqCst));
    }
}
