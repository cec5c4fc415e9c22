//! The workers that build and trace.

use std::num::NonZeroUsize;

use rayon::{ThreadPool, ThreadPoolBuilder};

use crate::error::CliError;

/// The number asked for, or one a processor.
pub(crate) fn number(asked: Option<NonZeroUsize>) -> usize {
    asked
        .or_else(|| std::thread::available_parallelism().ok())
        .map_or(1, usize::from)
}

/// Starts workers of one's own: what is timed runs on one of them, so that no build
/// waits for one to wake up.
pub(crate) fn start(number: usize) -> Result<ThreadPool, CliError> {
    let pool = ThreadPoolBuilder::new().num_threads(number).build();
    pool.map_err(|_| CliError::Threads(number))
}

/// Starts the workers that are used wherever no others are.
pub(crate) fn start_global(number: usize) -> Result<(), CliError> {
    let pool = ThreadPoolBuilder::new().num_threads(number);
    pool.build_global().map_err(|_| CliError::Threads(number))
}
