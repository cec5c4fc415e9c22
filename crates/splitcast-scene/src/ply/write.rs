//! Writing PLY files: binary, little-endian, plain.

use std::io::{self, Write};
use std::path::Path;

use crate::atomic::write_atomically;
use crate::{Frame, SceneError};

/// Bytes encoded before they are handed on.
const CHUNK_BYTES: usize = 64 * 1024;

/// Writes a frame as a binary little-endian PLY file, with its normals and
/// colours if it has them.
///
/// The file is written beside its place and then renamed: a failed or
/// interrupted write leaves what stood there untouched. The header depends on
/// the frame alone, so that equal frames give equal files.
///
/// # Errors
/// [`SceneError::Write`] if the file cannot be written, and
/// [`SceneError::InvalidFrame`] if the frame breaks its own invariants.
pub fn write_ply(path: impl AsRef<Path>, frame: &Frame) -> Result<(), SceneError> {
    let path = path.as_ref();
    check(frame).map_err(|reason| SceneError::InvalidFrame {
        path: path.to_path_buf(),
        reason,
    })?;
    write_atomically(path, |out| encode(frame, out)).map_err(|source| SceneError::Write {
        path: path.to_path_buf(),
        source,
    })
}

/// Encodes a frame whose invariants hold.
pub(super) fn encode(frame: &Frame, out: &mut dyn Write) -> io::Result<()> {
    let vertices = frame.positions.len();
    let mut header = format!("ply\nformat binary_little_endian 1.0\nelement vertex {vertices}\n");
    let mut properties = |kind: &str, names: [&str; 3]| {
        for name in names {
            header.push_str(&format!("property {kind} {name}\n"));
        }
    };
    properties("float", ["x", "y", "z"]);
    if frame.normals.is_some() {
        properties("float", ["nx", "ny", "nz"]);
    }
    if frame.colors.is_some() {
        properties("uchar", ["red", "green", "blue"]);
    }
    let faces = frame.triangles.len();
    header.push_str(&format!(
        "element face {faces}\nproperty list uchar int vertex_indices\nend_header\n"
    ));
    let mut chunk = header.into_bytes();
    for (i, position) in frame.positions.iter().enumerate() {
        chunk.extend(position.map(f32::to_le_bytes).as_flattened());
        if let Some(normals) = &frame.normals {
            chunk.extend(normals[i].map(f32::to_le_bytes).as_flattened());
        }
        if let Some(colors) = &frame.colors {
            chunk.extend(colors[i]);
        }
        flush_full(&mut chunk, out)?;
    }
    for triangle in frame.triangles.iter() {
        chunk.push(3);
        chunk.extend(triangle.map(u32::to_le_bytes).as_flattened());
        flush_full(&mut chunk, out)?;
    }
    out.write_all(&chunk)
}

fn flush_full(chunk: &mut Vec<u8>, out: &mut dyn Write) -> io::Result<()> {
    if chunk.len() >= CHUNK_BYTES {
        out.write_all(chunk)?;
        chunk.clear();
    }
    Ok(())
}

/// The invariants of [`Frame`], and that there is something to write.
fn check(frame: &Frame) -> Result<(), String> {
    let vertices = frame.positions.len();
    if vertices == 0 || frame.triangles.is_empty() {
        return Err("it has no vertices or no triangles".into());
    }
    let normals = frame.normals.as_ref().map_or(vertices, Vec::len);
    let colors = frame
        .colors
        .as_ref()
        .map_or(vertices, |colors| colors.len());
    for (count, what) in [(normals, "normals"), (colors, "colours")] {
        if count != vertices {
            return Err(format!(
                "{count} {what} for {vertices} vertices, expected one each"
            ));
        }
    }
    let limit = vertices.min(super::MAX_ELEMENTS as usize);
    let bad = |triangle: &[u32; 3]| triangle.iter().any(|&index| index as usize >= limit);
    match frame.triangles.iter().position(bad) {
        Some(i) => Err(format!(
            "triangle {i} names vertices {:?}, expected indices below {limit}",
            frame.triangles[i]
        )),
        None => Ok(()),
    }
}
