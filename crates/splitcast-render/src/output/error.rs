//! What can go wrong between a finished picture and its file.

use std::io;
use std::path::{Path, PathBuf};

/// Why an output could not be opened or written. The message is one line that
/// names the place, what was wrong, and the remedy.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum OutputError {
    /// The file name does not say a format this crate writes.
    #[error(
        "{}: unknown output format: give a name that ends in .mp4, .apng, .png or .exr, for example film.mp4 or frame_%04d.png",
        path.display()
    )]
    UnknownExtension {
        /// The name as given.
        path: PathBuf,
    },
    /// A frame number pattern that cannot be followed.
    #[error("{}: bad pattern: {reason}, as in frame_%04d.png", path.display())]
    Pattern {
        /// The name as given.
        path: PathBuf,
        /// What is wrong with its pattern.
        reason: String,
    },
    /// Several frames, but a name for one picture only.
    #[error(
        "{}: a single picture cannot hold {count} frames: ask for one frame, or number the files with {}",
        path.display(),
        example.display()
    )]
    SingleFile {
        /// The name as given.
        path: PathBuf,
        /// How many frames are to be written.
        count: usize,
        /// The same name with a pattern in it.
        example: PathBuf,
    },
    /// No frames at all.
    #[error("{}: there are no frames to write: ask for at least one", path.display())]
    NoFrames {
        /// The name as given.
        path: PathBuf,
    },
    /// A picture size the format cannot hold.
    #[error("{}: size {width}x{height} {reason}", path.display())]
    Size {
        /// The name as given.
        path: PathBuf,
        /// Width asked for, in pixels.
        width: u32,
        /// Height asked for, in pixels.
        height: u32,
        /// The limit that is broken, and a size that keeps it.
        reason: String,
    },
    /// A frame rate the format cannot hold.
    #[error("{}: {rate} frames per second cannot be played: choose a rate from 1 to 1000", path.display())]
    FrameRate {
        /// The name as given.
        path: PathBuf,
        /// The rate asked for.
        rate: f64,
    },
    /// The target cannot be written; nothing was rendered yet.
    #[error("{}: cannot be written: {reason}", path.display())]
    Unwritable {
        /// The file or folder in the way.
        path: PathBuf,
        /// Why, and the remedy.
        reason: String,
    },
    /// Reading or writing failed on the way.
    #[error("{}: {}", path.display(), explain(source))]
    Io {
        /// The file that was being read or written.
        path: PathBuf,
        /// The operating system's reason.
        source: io::Error,
    },
    /// An encoder gave up.
    #[error("{}: frame {frame} could not be encoded: {reason}", path.display())]
    Encode {
        /// The file that was being written.
        path: PathBuf,
        /// The frame that was being encoded.
        frame: usize,
        /// The encoder's own words.
        reason: String,
    },
    /// A picture that is not to be part of an animation could not be encoded.
    #[error("the picture of {width}x{height} pixels could not be encoded: {reason}")]
    Picture {
        /// Pixels in a row.
        width: u32,
        /// Rows.
        height: u32,
        /// The encoder's own words.
        reason: String,
    },
    /// A picture that does not have the size the output was opened with, or
    /// comes out of turn: a mistake of the calling program.
    #[error("{}: frame {frame} does not fit: {reason}", path.display())]
    Misuse {
        /// The output.
        path: PathBuf,
        /// The frame that was handed over.
        frame: usize,
        /// What was expected.
        reason: String,
    },
}

impl OutputError {
    /// Whether the request itself is at fault, so that no retry can help.
    #[must_use]
    pub fn is_usage(&self) -> bool {
        matches!(
            self,
            Self::UnknownExtension { .. }
                | Self::Pattern { .. }
                | Self::SingleFile { .. }
                | Self::NoFrames { .. }
                | Self::Size { .. }
                | Self::FrameRate { .. }
        )
    }

    pub(crate) fn io(path: &Path, source: io::Error) -> Self {
        Self::Io {
            path: path.to_owned(),
            source,
        }
    }
}

/// The system's reason, with the remedy for those a person can mend.
pub(crate) fn explain(error: &io::Error) -> String {
    let remedy = match error.kind() {
        io::ErrorKind::StorageFull | io::ErrorKind::QuotaExceeded => {
            "no space left on the disk: free some and resume, or write elsewhere"
        }
        io::ErrorKind::PermissionDenied => {
            "permission denied: change the rights or write elsewhere"
        }
        io::ErrorKind::ReadOnlyFilesystem => "the file system is read-only: write elsewhere",
        io::ErrorKind::NotFound => "no such file or folder: create the folder first",
        _ => return error.to_string(),
    };
    remedy.to_owned()
}
