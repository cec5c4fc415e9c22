//! What can go wrong when frames are read.

use std::path::PathBuf;

/// Why a scene or a frame could not be had. The message is one line and says
/// where, what was wrong, and what was expected.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum SceneError {
    /// A frame index past the end of the sequence.
    #[error("frame {index} is out of range: {name} has {count} frames, 0 to {}", count - 1)]
    FrameOutOfRange {
        /// Name of the source.
        name: String,
        /// The index asked for.
        index: usize,
        /// Number of frames of the source, at least one.
        count: usize,
    },
    /// A file could not be opened or read.
    #[error("{}: {source}", path.display())]
    Io {
        /// The file or folder.
        path: PathBuf,
        /// The operating system's reason.
        source: std::io::Error,
    },
}
