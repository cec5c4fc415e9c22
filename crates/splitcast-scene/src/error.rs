//! What can go wrong when frames are found, read or written.

use std::fmt;
use std::io;
use std::path::{Path, PathBuf};

/// Where in a mesh file something was found.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Place {
    /// A line of a text file, counted from one.
    Line(u64),
    /// An offset in a (decompressed) binary file.
    Byte(u64),
    /// An element of a binary file.
    Element {
        /// The header's name for the element, e.g. `vertex` or `face`.
        element: String,
        /// Which one, counted from zero.
        index: u64,
        /// Offset of its first byte from the start of the (decompressed) file.
        byte: u64,
    },
}

impl fmt::Display for Place {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Place::Line(line) => write!(f, "line {line}"),
            Place::Byte(byte) => write!(f, "byte {byte}"),
            Place::Element {
                element,
                index,
                byte,
            } => write!(f, "{element} {index} at byte {byte}"),
        }
    }
}

/// Why a scene or a frame could not be had. The message is one line and says
/// where, what was wrong, and what was expected or can be done.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum SceneError {
    /// A frame index past the end of the sequence.
    #[error("frame {index} is out of range: {name} has {count} frames, 0 to {}", count.saturating_sub(1))]
    FrameOutOfRange {
        /// Name of the source.
        name: String,
        /// The index asked for.
        index: usize,
        /// Number of frames of the source, at least one.
        count: usize,
    },

    /// A file or folder could not be opened or read.
    #[error("{}: cannot be read: {source}", shown(path))]
    Io {
        /// The file or folder.
        path: PathBuf,
        /// The operating system's reason.
        source: io::Error,
    },
    /// A file or folder could not be created or written; what stood there
    /// before is untouched.
    #[error(
        "{}: cannot be written: {source}; check the folder, its permissions and the free space",
        shown(path)
    )]
    Write {
        /// The file or folder.
        path: PathBuf,
        /// The operating system's reason.
        source: io::Error,
    },
    /// The thread that reads ahead could not be started.
    #[error(
        "the reading thread could not be started: {source}; free some memory or raise the limit of processes"
    )]
    Thread {
        /// The operating system's reason.
        source: io::Error,
    },

    /// Nothing stands at the path given as input.
    #[error(
        "{}: no such file or folder; expected a mesh file, a folder, a glob such as \"dir/*.ply\", or a pattern such as \"dir/frame_%04d.ply\"",
        shown(path)
    )]
    Missing {
        /// The input.
        path: PathBuf,
    },
    /// The file's name ends in no extension that can be read.
    #[error("{}: unknown extension; expected .ply, .ply.gz or .obj", shown(path))]
    UnknownExtension {
        /// The file.
        path: PathBuf,
    },
    /// A glob or a numbered pattern matched no mesh file.
    #[error(
        "{}: no mesh file matches; expected .ply, .ply.gz or .obj files, check the pattern and quote it against the shell",
        shown(pattern)
    )]
    NoMatch {
        /// The glob or pattern.
        pattern: PathBuf,
    },
    /// A glob or a numbered pattern that cannot be understood.
    #[error("{}: bad pattern: {reason}", shown(pattern))]
    BadPattern {
        /// The glob or pattern.
        pattern: PathBuf,
        /// What is wrong with it, and what was expected.
        reason: String,
    },
    /// A folder holds no mesh file.
    #[error(
        "{}: the folder holds no mesh file; expected .ply, .ply.gz or .obj files directly in it",
        shown(path)
    )]
    EmptyFolder {
        /// The folder.
        path: PathBuf,
    },

    /// A file of no bytes.
    #[error(
        "{}: the file is empty; expected a mesh, write or copy it again",
        shown(path)
    )]
    EmptyFile {
        /// The file.
        path: PathBuf,
    },
    /// The content is not what the extension says.
    #[error(
        "{}: not {format} file: {reason}; check the file or its extension",
        shown(path)
    )]
    NotAMesh {
        /// The file.
        path: PathBuf,
        /// The format with its article, e.g. `a PLY`.
        format: &'static str,
        /// What was found and what was expected.
        reason: String,
    },
    /// A PLY header that breaks the format or names no triangle mesh.
    #[error("{}: line {line}: bad PLY header: {reason}", shown(path))]
    Header {
        /// The file.
        path: PathBuf,
        /// Line of the header, counted from one.
        line: u64,
        /// What was found and what was expected.
        reason: String,
    },
    /// The header promises more elements than the file can hold.
    #[error(
        "{}: the header promises {count} {element} elements, at least {needed} bytes, but at most {available} can follow it; the count is wrong or the file is cut short",
        shown(path)
    )]
    CountTooLarge {
        /// The file.
        path: PathBuf,
        /// The element whose count first exceeds the file.
        element: String,
        /// The count promised.
        count: u64,
        /// Least number of bytes that all elements up to this one take.
        needed: u64,
        /// Bytes behind the header: the file's own, or for a compressed file
        /// the most it may expand to.
        available: u64,
    },
    /// The file ends before the last element.
    #[error(
        "{}: {place}: the file ends here, but {missing} of {count} {element} elements are still to come; the file is cut short, copy or export it again",
        shown(path)
    )]
    Truncated {
        /// The file.
        path: PathBuf,
        /// The element that is missing or incomplete.
        place: Place,
        /// Name of the element.
        element: String,
        /// How many are missing or incomplete.
        missing: u64,
        /// How many the header promised.
        count: u64,
    },
    /// The file goes on behind the last element that the header promised.
    #[error(
        "{}: {place}: the file goes on behind the last element of the header; a count in the header is too small, or two files were joined",
        shown(path)
    )]
    TrailingData {
        /// The file.
        path: PathBuf,
        /// Where the surplus starts.
        place: Place,
    },
    /// A value that cannot be understood.
    #[error("{}: {place}: found {found}, expected {expected}", shown(path))]
    Value {
        /// The file.
        path: PathBuf,
        /// Where it stands.
        place: Place,
        /// What was found, shortened and escaped.
        found: String,
        /// What should stand there.
        expected: String,
    },
    /// A face that names a vertex (or normal) that does not exist.
    #[error(
        "{}: {place}: index {index} is out of range, expected {expected}",
        shown(path)
    )]
    IndexOutOfRange {
        /// The file.
        path: PathBuf,
        /// The face.
        place: Place,
        /// The index as it stands in the file.
        index: i64,
        /// The range that would have been right.
        expected: String,
    },
    /// A face with too few corners, or with more than the mesh has use for.
    #[error(
        "{}: {place}: a face of {corners} corners, expected 3 to {limit}",
        shown(path)
    )]
    Polygon {
        /// The file.
        path: PathBuf,
        /// The face.
        place: Place,
        /// Number of corners found.
        corners: i64,
        /// Largest number accepted.
        limit: u64,
    },
    /// A mesh without vertices or without triangles.
    #[error(
        "{}: the mesh has no {what}; expected a surface of triangles or polygons, not an empty mesh or a point cloud",
        shown(path)
    )]
    NoGeometry {
        /// The file.
        path: PathBuf,
        /// `vertices` or `triangles`.
        what: &'static str,
    },
    /// More vertices or triangles than 31-bit indices address.
    #[error(
        "{}: more than {limit} {what}, the most a frame can hold; split the mesh",
        shown(path)
    )]
    TooLarge {
        /// The file.
        path: PathBuf,
        /// `vertices` or `triangles`.
        what: &'static str,
        /// The most that can be held.
        limit: u64,
    },
    /// Compressed data that are damaged.
    #[error(
        "{}: damaged gzip data: {source}; compress or copy the file again",
        shown(path)
    )]
    Gzip {
        /// The file.
        path: PathBuf,
        /// The decoder's reason.
        source: io::Error,
    },
    /// Compressed data that expand beyond all proportion.
    #[error(
        "{}: expands to more than {limit} bytes, out of proportion to its size; if the mesh is sound, unpack it with gunzip and read the .ply",
        shown(path)
    )]
    Expansion {
        /// The file.
        path: PathBuf,
        /// The most bytes that would have been accepted.
        limit: u64,
    },

    /// A frame handed to a writer breaks the invariants of [`crate::Frame`].
    #[error("{}: the frame cannot be written: {reason}", shown(path))]
    InvalidFrame {
        /// The file that was to be written.
        path: PathBuf,
        /// The invariant that is broken.
        reason: String,
    },
}

/// A path as it may stand in a one-line message: control characters escaped.
pub(crate) fn shown(path: &Path) -> String {
    let mut text = String::new();
    for c in path.to_string_lossy().chars() {
        if c.is_control() {
            text.extend(c.escape_default());
        } else {
            text.push(c);
        }
    }
    text
}

/// Bytes of a file as they may stand in a one-line message: quoted, escaped,
/// and cut after a few characters.
pub(crate) fn quoted(bytes: &[u8]) -> String {
    const LONGEST: usize = 24;
    let cut = &bytes[..bytes.len().min(LONGEST)];
    let dots = if cut.len() < bytes.len() { "..." } else { "" };
    format!("\"{}{dots}\"", cut.escape_ascii())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn messages_stay_on_one_line_whatever_the_names() {
        let error = SceneError::Missing {
            path: PathBuf::from("a\nb\u{1b}[31m.ply"),
        };
        let message = error.to_string();
        assert!(message.starts_with("a\\nb\\u{1b}[31m.ply: "), "{message}");
        assert!(!message.contains('\n'));
        assert_eq!(quoted(b"\x00\xffab\n"), r#""\x00\xffab\n""#);
        assert_eq!(quoted(&[b'a'; 40]).len(), 24 + 5);
    }
}
