//! Reading Wavefront OBJ files.
//!
//! What a mesh needs of the format (Wavefront, "Object files", Advanced
//! Visualizer manual, appendix B): `v` with optional colours, `vn`, and `f`
//! with positive or negative indices; lines may go on behind a backslash.
//! Groups, materials, texture coordinates, lines and curves are passed over.
//!
//! The reader is our own: the maintained crate (`tobj`) numbers vertices anew
//! for each group, so that seams open between groups and vertices no longer
//! stand in the file's order, names no line in its errors, and accepts faces
//! of one corner. It serves the tests as a second opinion.

use std::io::{BufRead, BufReader};
use std::path::Path;
use std::sync::Arc;

use crate::error::quoted;
use crate::ply::{MAX_ELEMENTS, normalize, open_regular};
use crate::polygon::Polygons;
use crate::{Frame, Place, SceneError};

/// Bytes read at once.
const BUFFER_BYTES: usize = 256 * 1024;

/// Marks a vertex that no face has given a normal yet.
const NO_NORMAL: u32 = u32::MAX;

/// Reads an OBJ file.
///
/// Vertices keep the file's order, so that they correspond from frame to
/// frame. Polygons become triangles as in [`crate::read_ply`]. Colours are
/// kept if every vertex has them (`v x y z r g b`, from 0 to 1). Normals are
/// kept if every corner has one and the corners at a vertex agree; vertices
/// that no face uses then get a normal of zero. Positions that are NaN or
/// infinite are kept as they stand.
///
/// # Errors
/// [`SceneError`] with file and line for everything that breaks the format,
/// and for a mesh without vertices or without triangles.
pub fn read_obj(path: impl AsRef<Path>) -> Result<Frame, SceneError> {
    let path = path.as_ref();
    let (file, _) = open_regular(path)?;
    read_lines(path, BufReader::with_capacity(BUFFER_BYTES, file))
}

fn read_lines(path: &Path, mut reader: impl BufRead) -> Result<Frame, SceneError> {
    let mut mesh = Mesh::default();
    let (mut text, mut number) = (Vec::new(), 0_u64);
    loop {
        text.clear();
        let first = number + 1;
        let more = read_logical_line(&mut reader, &mut text, &mut number).map_err(|source| {
            SceneError::Io {
                path: path.to_path_buf(),
                source,
            }
        })?;
        if !more {
            break;
        }
        let line = Line {
            path,
            number: first,
        };
        if text.contains(&0) {
            return Err(not_obj(
                path,
                format!("line {first} holds binary data, expected text"),
            ));
        }
        mesh.read(&line, &text)?;
    }
    mesh.finish(path)
}

/// Appends a line and those it goes on in, without their ends. False at the
/// end of the file.
fn read_logical_line(
    reader: &mut impl BufRead,
    text: &mut Vec<u8>,
    number: &mut u64,
) -> std::io::Result<bool> {
    loop {
        if reader.read_until(b'\n', text)? == 0 {
            return Ok(!text.is_empty());
        }
        *number += 1;
        text.truncate(text.trim_ascii_end().len());
        if text.pop_if(|last| *last == b'\\').is_none() {
            return Ok(true);
        }
        text.push(b' ');
    }
}

fn not_obj(path: &Path, reason: String) -> SceneError {
    SceneError::NotAMesh {
        path: path.to_path_buf(),
        format: "an OBJ",
        reason,
    }
}

/// Where errors are placed.
struct Line<'a> {
    path: &'a Path,
    number: u64,
}

impl Line<'_> {
    fn value(&self, found: String, expected: &str) -> SceneError {
        SceneError::Value {
            path: self.path.to_path_buf(),
            place: Place::Line(self.number),
            found,
            expected: expected.to_owned(),
        }
    }

    fn out_of_range(&self, index: i64, count: usize, what: &str) -> SceneError {
        SceneError::IndexOutOfRange {
            path: self.path.to_path_buf(),
            place: Place::Line(self.number),
            index,
            expected: format!("1 to {count} for {count} {what}, or -1 to -{count}"),
        }
    }
}

#[derive(Default)]
struct Mesh {
    positions: Vec<[f32; 3]>,
    colors: Vec<[u8; 3]>,
    normals: Vec<[f32; 3]>,
    triangles: Vec<[u32; 3]>,
    polygons: Polygons,
    /// For each vertex that a face has named, the normal it got first.
    vertex_normals: Vec<u32>,
    /// Pairs of normals that corners of one vertex got.
    disputes: Vec<[u32; 2]>,
    /// Whether a corner came without a normal.
    bare_corner: bool,
    /// The highest vertex and normal that faces have named, from zero, with
    /// the line: faces may stand before what they name.
    highest_vertex: Option<(u32, u64)>,
    highest_normal: Option<(u32, u64)>,
    /// Scratch: the corners of a face.
    corners: Vec<u32>,
}

impl Mesh {
    fn read(&mut self, line: &Line<'_>, text: &[u8]) -> Result<(), SceneError> {
        let mut words = text
            .split(u8::is_ascii_whitespace)
            .filter(|word| !word.is_empty());
        match words.next() {
            Some(b"v") => self.read_vertex(line, words),
            Some(b"vn") => {
                let mut normal = [0.0; 3];
                for value in &mut normal {
                    *value = number(line, words.next())?;
                }
                self.normals.push(normal);
                self.limit(line, self.normals.len(), "normals")
            }
            Some(b"f") => self.read_face(line, words),
            _ => Ok(()),
        }
    }

    fn read_vertex<'a>(
        &mut self,
        line: &Line<'_>,
        words: impl Iterator<Item = &'a [u8]>,
    ) -> Result<(), SceneError> {
        // x y z, perhaps a weight (which only curves use), perhaps colours.
        let (mut values, mut count) = ([0.0; 7], 0);
        for word in words {
            if count == values.len() {
                return Err(line.value("more than 7 values".into(), "x y z [w] [r g b]"));
            }
            values[count] = number(line, Some(word))?;
            count += 1;
        }
        if count < 3 || count == 5 {
            return Err(line.value(format!("{count} values"), "x y z [w] [r g b]"));
        }
        if count >= 6 {
            let color = &values[count - 3..count];
            // Casts saturate and send NaN to 0.
            self.colors
                .push([0, 1, 2].map(|i| (color[i] * 255.0).round() as u8));
        }
        self.positions.push([values[0], values[1], values[2]]);
        self.limit(line, self.positions.len(), "vertices")
    }

    fn read_face<'a>(
        &mut self,
        line: &Line<'_>,
        words: impl Iterator<Item = &'a [u8]>,
    ) -> Result<(), SceneError> {
        self.corners.clear();
        for word in words {
            let mut parts = word.split(|&byte| byte == b'/');
            let vertex = parts.next().unwrap_or_default();
            let vertex = index(line, vertex, word, self.positions.len(), "vertices")?;
            // The texture coordinate is not used, but has to be a number.
            if let Some(texture) = parts.next().filter(|part| !part.is_empty()) {
                parse::<i64>(line, texture, word)?;
            }
            let normal = match parts.next().filter(|part| !part.is_empty()) {
                Some(part) => Some(index(line, part, word, self.normals.len(), "normals")?),
                None => None,
            };
            if parts.next().is_some() {
                return Err(line.value(quoted(word), "a corner such as 1, 1/2, 1//3 or 1/2/3"));
            }
            self.corners.push(vertex);
            raise(&mut self.highest_vertex, vertex, line.number);
            self.note_normal(vertex, normal, line.number);
        }
        let corners = self.corners.len();
        if corners < 3 {
            return Err(SceneError::Polygon {
                path: line.path.to_path_buf(),
                place: Place::Line(line.number),
                corners: corners as i64,
                limit: MAX_ELEMENTS,
            });
        }
        self.polygons.push(&self.corners, &mut self.triangles);
        self.limit(line, self.triangles.len(), "triangles")
    }

    fn note_normal(&mut self, vertex: u32, normal: Option<u32>, line: u64) {
        let Some(normal) = normal else {
            self.bare_corner = true;
            return;
        };
        raise(&mut self.highest_normal, normal, line);
        if self.bare_corner {
            return;
        }
        let slot = vertex as usize;
        // Only as far as there are vertices: an index may be a lie.
        if slot >= self.vertex_normals.len() {
            self.vertex_normals.resize(self.positions.len(), NO_NORMAL);
        }
        match self.vertex_normals.get_mut(slot) {
            Some(known) if *known == NO_NORMAL => *known = normal,
            Some(known) if *known != normal => self.disputes.push([*known, normal]),
            Some(_) => {}
            // A face before its vertices: too rare to be followed up.
            None => self.bare_corner = true,
        }
    }

    fn limit(&self, line: &Line<'_>, count: usize, what: &'static str) -> Result<(), SceneError> {
        if count as u64 > MAX_ELEMENTS {
            return Err(SceneError::TooLarge {
                path: line.path.to_path_buf(),
                what,
                limit: MAX_ELEMENTS,
            });
        }
        Ok(())
    }

    fn finish(mut self, path: &Path) -> Result<Frame, SceneError> {
        if self.positions.is_empty() && self.triangles.is_empty() {
            return Err(not_obj(
                path,
                "it has no line \"v x y z\" and no line \"f a b c\"".into(),
            ));
        }
        for (what, filled) in [
            ("vertices", !self.positions.is_empty()),
            ("triangles", !self.triangles.is_empty()),
        ] {
            if !filled {
                return Err(SceneError::NoGeometry {
                    path: path.to_path_buf(),
                    what,
                });
            }
        }
        for (highest, count, what) in [
            (self.highest_vertex, self.positions.len(), "vertices"),
            (self.highest_normal, self.normals.len(), "normals"),
        ] {
            if let Some((index, number)) = highest
                && index as usize >= count
            {
                return Err(Line { path, number }.out_of_range(i64::from(index) + 1, count, what));
            }
        }
        self.polygons.mend(&self.positions, &mut self.triangles);
        let normals = self.per_vertex_normals();
        let colored = self.colors.len() == self.positions.len();
        Ok(Frame {
            positions: self.positions,
            triangles: Arc::new(self.triangles),
            normals,
            colors: colored.then(|| Arc::new(self.colors)),
        })
    }

    /// Every index is in range by now.
    fn per_vertex_normals(&mut self) -> Option<Vec<[f32; 3]>> {
        let of = |index: u32| self.normals[index as usize];
        if self.bare_corner || self.disputes.iter().any(|&[a, b]| of(a) != of(b)) {
            return None;
        }
        self.vertex_normals.resize(self.positions.len(), NO_NORMAL);
        let pick = |&index: &u32| {
            if index == NO_NORMAL {
                [0.0; 3]
            } else {
                of(index)
            }
        };
        let mut normals: Vec<_> = self.vertex_normals.iter().map(pick).collect();
        normalize(&mut normals);
        Some(normals)
    }
}

/// Keeps the highest index, with the first line that names it.
fn raise(highest: &mut Option<(u32, u64)>, index: u32, line: u64) {
    if highest.is_none_or(|(known, _)| index > known) {
        *highest = Some((index, line));
    }
}

fn number(line: &Line<'_>, word: Option<&[u8]>) -> Result<f32, SceneError> {
    let Some(word) = word else {
        return Err(line.value("the end of the line".into(), "a number"));
    };
    str::from_utf8(word)
        .ok()
        .and_then(|text| text.parse().ok())
        .ok_or_else(|| line.value(quoted(word), "a number"))
}

/// An index counted from one, or from the end of what stands so far with -1,
/// as an index counted from zero.
fn index(
    line: &Line<'_>,
    part: &[u8],
    word: &[u8],
    count: usize,
    what: &str,
) -> Result<u32, SceneError> {
    let value: i64 = parse(line, part, word)?;
    let from_zero = if value < 0 {
        value.checked_add(count as i64)
    } else {
        value.checked_sub(1)
    };
    from_zero
        .filter(|index| (0..MAX_ELEMENTS as i64).contains(index))
        .map(|index| index as u32)
        .ok_or_else(|| line.out_of_range(value, count, what))
}

fn parse<T: std::str::FromStr>(line: &Line<'_>, part: &[u8], word: &[u8]) -> Result<T, SceneError> {
    str::from_utf8(part)
        .ok()
        .and_then(|text| text.parse().ok())
        .ok_or_else(|| line.value(quoted(word), "a corner such as 1, 1/2, 1//3 or 1/2/3"))
}

#[cfg(test)]
mod tests;
