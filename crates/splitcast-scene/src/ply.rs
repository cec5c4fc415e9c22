//! Reading and writing PLY files.
//!
//! The format is Turk's ("The PLY polygon file format", 1994), in the three
//! bodies of its version 1.0: ASCII and binary of both byte orders, also
//! gzipped. Any scalar and list types, any order of elements, and unknown
//! elements and properties are accepted; `face` lists and `tristrips` become
//! triangles, `nx ny nz` and `red green blue` become normals and colours.
//!
//! The reader is our own rather than a parser crate's, for three things that
//! none of those looked at gives together: a bound on memory by the file's
//! size before anything is allocated, errors that name line or element and
//! byte, and plain binary files at the speed of memory. `ply-rs-bw` serves
//! the tests as a second opinion.

mod ascii;
mod binary;
mod body;
mod header;
mod layout;
mod records;
mod write;

use std::fs::File;
use std::io::{self, BufRead, BufReader, Read};
use std::path::Path;

use flate2::bufread::MultiGzDecoder;

use crate::{Frame, SceneError};
use ascii::Ascii;
use binary::Binary;
use body::{Extent, Spot};
use header::{Format, Header};
use records::{Fault, Source};

pub(crate) use body::{MAX_ELEMENTS, normalize};
pub use write::write_ply;

/// Bytes read at once: small enough to stay in the second-level cache while
/// they are decoded, which makes reading a file nearly as fast as copying it
/// (see the example `ply_speed`).
const BUFFER_BYTES: usize = 256 * 1024;

/// A compressed file may expand to this many times its size, and
/// [`EXPANSION_SLACK`] more. Deflate itself ends at 1032 times; meshes lie
/// between 2 and 20, flat grids in ASCII higher.
const MAX_EXPANSION: u64 = 128;

/// Lets small files of regular content pass.
const EXPANSION_SLACK: u64 = 64 * 1024;

/// Memory is reserved at once for this many times a compressed file's size.
const LIKELY_EXPANSION: u64 = 4;

/// Number of vertices and faces that a PLY file promises in its header.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Counts {
    pub(crate) vertices: u64,
    pub(crate) faces: u64,
}

/// Reads a PLY file, `.ply` or `.ply.gz`, told apart by content.
///
/// Faces of more than three corners are triangulated: convex ones as a fan
/// around their first corner, concave ones of up to 256 corners by ear
/// clipping. Positions that are NaN or infinite are kept as they stand;
/// whoever builds on them decides whether to refuse or to skip. Normals are
/// scaled to unit length, colours to bytes (floats from 0..1, `ushort` from
/// its whole range).
///
/// Memory is in proportion to the file: counts are checked against its size
/// first, and a compressed file may not expand beyond 128 times its size.
///
/// # Errors
/// [`SceneError`] with file and line, or file, element and byte, for
/// everything that breaks the format, and for a mesh without vertices or
/// without triangles.
pub fn read_ply(path: impl AsRef<Path>) -> Result<Frame, SceneError> {
    let path = path.as_ref();
    let (mut source, extent) = open(path)?;
    read_source(path, &mut source, extent)
}

/// Reads only the header's counts.
pub(crate) fn read_counts(path: &Path) -> Result<Counts, SceneError> {
    let (mut source, _) = open(path)?;
    let header = Header::read(path, &mut source, |error| io_error(path, error))?;
    let count = |name| header.element(name).map_or(0, |element| element.count);
    Ok(Counts {
        vertices: count("vertex"),
        faces: count("face"),
    })
}

/// Opens a file that is meant to be a mesh; only regular files are.
pub(crate) fn open_regular(path: &Path) -> Result<(File, u64), SceneError> {
    let io = |source| SceneError::Io {
        path: path.to_path_buf(),
        source,
    };
    // Asked first: opening a named pipe would wait for a writer.
    let metadata = std::fs::metadata(path).map_err(io)?;
    if !metadata.is_file() {
        let reason = "not a regular file; expected a mesh file";
        return Err(io(io::Error::new(io::ErrorKind::InvalidInput, reason)));
    }
    if metadata.len() == 0 {
        return Err(SceneError::EmptyFile {
            path: path.to_path_buf(),
        });
    }
    let file = File::open(path).map_err(io)?;
    Ok((file, metadata.len()))
}

fn open(path: &Path) -> Result<(Source<'static>, Extent), SceneError> {
    let (file, len) = open_regular(path)?;
    let capacity = len.min(BUFFER_BYTES as u64) as usize;
    let mut source: Source = BufReader::with_capacity(capacity, Box::new(file));
    let start = source.fill_buf().map_err(|error| io_error(path, error))?;
    if !start.starts_with(&[0x1f, 0x8b]) {
        let extent = Extent {
            limit: len,
            likely: len,
        };
        return Ok((source, extent));
    }
    let limit = len
        .saturating_mul(MAX_EXPANSION)
        .saturating_add(EXPANSION_SLACK);
    let decoder = Gunzip {
        decoder: MultiGzDecoder::new(source),
        left: limit,
        limit,
    };
    let extent = Extent {
        limit,
        likely: len.saturating_mul(LIKELY_EXPANSION),
    };
    Ok((
        BufReader::with_capacity(BUFFER_BYTES, Box::new(decoder)),
        extent,
    ))
}

/// Reads a file behind a buffer of any size.
fn read_source(path: &Path, source: &mut Source<'_>, extent: Extent) -> Result<Frame, SceneError> {
    let header = Header::read(path, source, |error| io_error(path, error))?;
    let extent = Extent {
        limit: extent.limit.saturating_sub(header.bytes),
        likely: extent.likely,
    };
    let to_error = |fault, spot: Spot<'_>| fault_error(path, fault, spot);
    match header.format {
        Format::Ascii => {
            let mut records = Ascii::new(source, &header);
            body::read_frame(path, &header, extent, &mut records, to_error)
        }
        Format::LittleEndian | Format::BigEndian => {
            let mut records = Binary::new(source, &header);
            body::read_frame(path, &header, extent, &mut records, to_error)
        }
    }
}

fn fault_error(path: &Path, fault: Fault, spot: Spot<'_>) -> SceneError {
    let path = path.to_path_buf();
    let place = spot.place;
    match fault {
        Fault::End => SceneError::Truncated {
            path,
            place,
            element: spot.element.name.clone(),
            missing: spot.element.count.saturating_sub(spot.index),
            count: spot.element.count,
        },
        Fault::Io(error) => io_error(&path, error),
        Fault::Value { found, expected } => SceneError::Value {
            path,
            place,
            found,
            expected,
        },
        Fault::Index { index, vertices } => SceneError::IndexOutOfRange {
            path,
            place,
            index,
            expected: format!(
                "0 to {} for {vertices} vertices",
                vertices.saturating_sub(1)
            ),
        },
        Fault::Corners { corners, limit } => SceneError::Polygon {
            path,
            place,
            corners,
            limit,
        },
        Fault::TooManyTriangles => SceneError::TooLarge {
            path,
            what: "triangles",
            limit: MAX_ELEMENTS,
        },
    }
}

fn io_error(path: &Path, error: io::Error) -> SceneError {
    let path = path.to_path_buf();
    match error.downcast::<GunzipError>() {
        Ok(GunzipError::Expansion(limit)) => SceneError::Expansion { path, limit },
        Ok(GunzipError::Damaged(source)) => SceneError::Gzip { path, source },
        Err(source) => SceneError::Io { path, source },
    }
}

/// A gzip decoder that stops at a number of bytes.
struct Gunzip {
    decoder: MultiGzDecoder<Source<'static>>,
    left: u64,
    limit: u64,
}

/// What can go wrong beyond the reading of the compressed bytes.
#[derive(Debug, thiserror::Error)]
enum GunzipError {
    #[error("expands to more than {0} bytes")]
    Expansion(u64),
    #[error("{0}")]
    Damaged(io::Error),
}

impl Read for Gunzip {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        let read = self
            .decoder
            .read(buffer)
            .map_err(|error| match error.kind() {
                io::ErrorKind::InvalidInput
                | io::ErrorKind::InvalidData
                | io::ErrorKind::UnexpectedEof => io::Error::other(GunzipError::Damaged(error)),
                _ => error,
            })?;
        self.left = self
            .left
            .checked_sub(read as u64)
            .ok_or_else(|| io::Error::other(GunzipError::Expansion(self.limit)))?;
        Ok(read)
    }
}

#[cfg(test)]
mod tests;
