//! The body of a PLY file into a frame: elements in any order, of which
//! `vertex`, `face` and `tristrips` are kept.

use std::path::Path;
use std::sync::Arc;

use super::header::{Element, Format, Header, Kind};
use super::layout::{FaceLayout, VertexLayout, Vertices};
use super::records::{Fault, Records, Value};
use crate::polygon::Polygons;
use crate::{Frame, Place, SceneError};

/// Most vertices and most triangles of a frame: what the `int` of most files
/// can index.
pub(crate) const MAX_ELEMENTS: u64 = i32::MAX as u64;

/// Bytes that an index list of a face takes beyond its count: three corners,
/// since a face of fewer is refused.
const LEAST_CORNERS: u64 = 3;

/// How much body there can be.
#[derive(Clone, Copy, Debug)]
pub(super) struct Extent {
    /// Most bytes that can follow the header. Counts that need more are
    /// refused before anything is allocated.
    pub(super) limit: u64,
    /// Bytes for which memory may be reserved at once; vectors grow from
    /// there as values really come in.
    pub(super) likely: u64,
}

/// Reads the whole body.
pub(super) fn read_frame(
    path: &Path,
    header: &Header,
    extent: Extent,
    records: &mut impl Records,
    fault_to_error: impl Fn(Fault, Spot<'_>) -> SceneError,
) -> Result<Frame, SceneError> {
    let vertex = required_vertices(path, header)?;
    check_counts(path, header, extent.limit)?;
    let mut reader = BodyReader {
        records,
        extent,
        ascii: header.format == Format::Ascii,
        vertex_count: vertex.count as u32,
        triangles: Vec::new(),
        polygons: Polygons::default(),
        corners: Vec::new(),
    };
    let mut vertices = Vertices::default();
    for element in &header.elements {
        // Records of no bytes need no reading, however many are promised.
        if element.count == 0 || element.properties.is_empty() {
            continue;
        }
        let mut index = 0;
        let result = match &*element.name {
            "vertex" => {
                let layout = vertex_layout(path, element)?;
                vertices = Vertices::with_capacity(&layout, reader.room(element));
                reader.read_vertices(element, &layout, &mut vertices, &mut index)
            }
            "face" | "tristrips" => {
                let layout = face_layout(path, element)?;
                if element.name == "face" {
                    let room = reader.room(element);
                    reader.triangles.reserve_exact(room);
                    reader.read_faces(element, &layout, &mut index)
                } else {
                    reader.read_strips(element, &layout, &mut index)
                }
            }
            _ => reader.skip_element(element, &mut index),
        };
        result.map_err(|fault| {
            let place = reader.records.place(&element.name, index);
            fault_to_error(
                fault,
                Spot {
                    element,
                    index,
                    place,
                },
            )
        })?;
    }
    let surplus = reader.records.surplus().map_err(|fault| {
        let element = vertex;
        let place = reader.records.place("surplus", 0);
        fault_to_error(
            fault,
            Spot {
                element,
                index: 0,
                place,
            },
        )
    })?;
    if let Some(place) = surplus {
        return Err(SceneError::TrailingData {
            path: path.to_path_buf(),
            place,
        });
    }
    let (mut triangles, polygons) = (reader.triangles, reader.polygons);
    if triangles.is_empty() {
        return Err(SceneError::NoGeometry {
            path: path.to_path_buf(),
            what: "triangles",
        });
    }
    polygons.mend(&vertices.positions, &mut triangles);
    normalize(&mut vertices.normals);
    Ok(Frame {
        positions: vertices.positions,
        triangles: Arc::new(triangles),
        normals: (!vertices.normals.is_empty()).then_some(vertices.normals),
        colors: (!vertices.colors.is_empty()).then(|| Arc::new(vertices.colors)),
    })
}

/// Where a fault came up.
pub(super) struct Spot<'a> {
    pub(super) element: &'a Element,
    pub(super) index: u64,
    pub(super) place: Place,
}

/// Scales normals to unit length. Those that already have it to within the
/// rounding of a text file keep their bits, and those without a direction
/// (zero, or not finite) stay as they are.
pub(crate) fn normalize(normals: &mut [[f32; 3]]) {
    const ROUNDING: f64 = 1e-4;
    for normal in normals {
        let [x, y, z] = normal.map(f64::from);
        let square = x * x + y * y + z * z;
        let is_unit = (square - 1.0).abs() <= 2.0 * ROUNDING;
        if !is_unit && square > 0.0 && square.is_finite() {
            let length = square.sqrt();
            *normal = [x, y, z].map(|c| (c / length) as f32);
        }
    }
}

fn required_vertices<'a>(path: &Path, header: &'a Header) -> Result<&'a Element, SceneError> {
    let filled = |name| header.element(name).filter(|element| element.count > 0);
    let missing = |what| SceneError::NoGeometry {
        path: path.to_path_buf(),
        what,
    };
    let vertex = filled("vertex").ok_or(missing("vertices"))?;
    if filled("face").or(filled("tristrips")).is_none() {
        return Err(missing("triangles"));
    }
    Ok(vertex)
}

fn vertex_layout(path: &Path, element: &Element) -> Result<VertexLayout, SceneError> {
    VertexLayout::new(element).ok_or_else(|| SceneError::Header {
        path: path.to_path_buf(),
        line: element.line,
        reason: "element vertex lacks one of the properties x, y and z".into(),
    })
}

fn face_layout(path: &Path, element: &Element) -> Result<FaceLayout, SceneError> {
    FaceLayout::new(element).ok_or_else(|| SceneError::Header {
        path: path.to_path_buf(),
        line: element.line,
        reason: format!(
            "element {} lacks a list named vertex_indices or vertex_index",
            element.name
        ),
    })
}

/// Refuses counts that need more bytes than there can be.
fn check_counts(path: &Path, header: &Header, available: u64) -> Result<(), SceneError> {
    let ascii = header.format == Format::Ascii;
    let mut needed = 0_u64;
    for element in &header.elements {
        let (name, count) = (&element.name, element.count);
        needed = needed.saturating_add(count.saturating_mul(least_bytes(element, ascii)));
        // The last value of a text may stand without a blank behind it.
        if needed.saturating_sub(u64::from(ascii)) > available {
            return Err(SceneError::CountTooLarge {
                path: path.to_path_buf(),
                element: name.clone(),
                count,
                needed,
                available,
            });
        }
        if (name == "vertex" || name == "face") && count > MAX_ELEMENTS {
            return Err(SceneError::TooLarge {
                path: path.to_path_buf(),
                what: if name == "vertex" {
                    "vertices"
                } else {
                    "triangles"
                },
                limit: MAX_ELEMENTS,
            });
        }
    }
    Ok(())
}

/// Least bytes of one record.
fn least_bytes(element: &Element, ascii: bool) -> u64 {
    let list = match &*element.name {
        "face" => FaceLayout::new(element).map(|layout| layout.list),
        _ => None,
    };
    // In a text every value takes a digit and a blank.
    let size = |scalar: super::header::Scalar| if ascii { 2 } else { scalar.size() as u64 };
    let least = |(i, property): (usize, &super::header::Property)| match property.kind {
        Kind::Scalar(scalar) => size(scalar),
        Kind::List { count, item } if Some(i) == list => size(count) + LEAST_CORNERS * size(item),
        Kind::List { count, .. } => size(count),
    };
    element.properties.iter().enumerate().map(least).sum()
}

struct BodyReader<'a, R> {
    records: &'a mut R,
    extent: Extent,
    ascii: bool,
    vertex_count: u32,
    triangles: Vec<[u32; 3]>,
    polygons: Polygons,
    /// Scratch: the corners of one face or strip.
    corners: Vec<u32>,
}

impl<R: Records> BodyReader<'_, R> {
    /// Number of records for which memory may be reserved at once.
    fn room(&self, element: &Element) -> usize {
        let most = self.extent.likely / least_bytes(element, self.ascii).max(1);
        element.count.min(most) as usize
    }

    fn read_vertices(
        &mut self,
        element: &Element,
        layout: &VertexLayout,
        vertices: &mut Vertices,
        index: &mut u64,
    ) -> Result<(), Fault> {
        let mut values = [Value::Int(0); 9];
        while *index < element.count {
            let run = self
                .records
                .vertex_run(layout, element.count - *index, vertices)?;
            *index += run;
            if run > 0 {
                continue;
            }
            self.records.begin()?;
            for (property, slot) in element.properties.iter().zip(&layout.slots) {
                match (property.kind, slot) {
                    (Kind::Scalar(scalar), &Some(slot)) => {
                        values[slot] = self.records.scalar(scalar)?;
                    }
                    (kind, _) => self.skip_property(kind)?,
                }
            }
            self.records.end()?;
            vertices.push(layout, &values);
            *index += 1;
        }
        Ok(())
    }

    fn read_faces(
        &mut self,
        element: &Element,
        layout: &FaceLayout,
        index: &mut u64,
    ) -> Result<(), Fault> {
        // An outline around holes repeats two corners for each hole, and a
        // hole has at least three corners of its own.
        let most_corners = (2 * u64::from(self.vertex_count)).max(LEAST_CORNERS);
        while *index < element.count {
            let wanted = element.count - *index;
            let run = self.records.triangle_run(
                layout,
                wanted,
                self.vertex_count,
                &mut self.triangles,
            )?;
            *index += run;
            if run > 0 {
                continue;
            }
            self.records.begin()?;
            self.corners.clear();
            for (i, property) in element.properties.iter().enumerate() {
                if i != layout.list {
                    self.skip_property(property.kind)?;
                    continue;
                }
                let corners = self.list_len(layout)?;
                if corners < LEAST_CORNERS as i64 || corners as u64 > most_corners {
                    let limit = most_corners;
                    return Err(Fault::Corners { corners, limit });
                }
                for _ in 0..corners {
                    let corner = self.index(layout)?;
                    self.corners.push(self.checked(corner)?);
                }
            }
            self.records.end()?;
            if self.triangles.len() as u64 + self.corners.len() as u64 > MAX_ELEMENTS {
                return Err(Fault::TooManyTriangles);
            }
            match self.corners[..] {
                [a, b, c] => self.triangles.push([a, b, c]),
                _ => self.polygons.push(&self.corners, &mut self.triangles),
            }
            *index += 1;
        }
        Ok(())
    }

    /// Reads triangle strips: each vertex makes a triangle with the two
    /// before it, turned over every other time, until -1 starts anew. The
    /// degenerate triangles that stitch strips together are left out.
    fn read_strips(
        &mut self,
        element: &Element,
        layout: &FaceLayout,
        index: &mut u64,
    ) -> Result<(), Fault> {
        while *index < element.count {
            self.records.begin()?;
            for (i, property) in element.properties.iter().enumerate() {
                if i != layout.list {
                    self.skip_property(property.kind)?;
                    continue;
                }
                let len = self.list_len(layout)?;
                if len < 0 {
                    return Err(Fault::Value {
                        found: len.to_string(),
                        expected: "a number of strip vertices".into(),
                    });
                }
                let (mut last, mut held) = ([0; 2], 0_u64);
                for _ in 0..len {
                    let value = self.index(layout)?;
                    if value == -1 {
                        held = 0;
                        continue;
                    }
                    let vertex = self.checked(value)?;
                    let [a, b] = if held.is_multiple_of(2) {
                        last
                    } else {
                        [last[1], last[0]]
                    };
                    if held >= 2 && a != b && a != vertex && b != vertex {
                        if self.triangles.len() as u64 >= MAX_ELEMENTS {
                            return Err(Fault::TooManyTriangles);
                        }
                        self.triangles.push([a, b, vertex]);
                    }
                    last = [last[1], vertex];
                    held += 1;
                }
            }
            self.records.end()?;
            *index += 1;
        }
        Ok(())
    }

    fn skip_element(&mut self, element: &Element, index: &mut u64) -> Result<(), Fault> {
        while *index < element.count {
            self.records.begin()?;
            for property in &element.properties {
                self.skip_property(property.kind)?;
            }
            self.records.end()?;
            *index += 1;
        }
        Ok(())
    }

    fn skip_property(&mut self, kind: Kind) -> Result<(), Fault> {
        match kind {
            Kind::Scalar(scalar) => self.records.skip(1, scalar),
            Kind::List { count, item } => {
                let len = self.records.scalar(count)?.to_index();
                match len.and_then(|len| u64::try_from(len).ok()) {
                    Some(len) => self.records.skip(len, item),
                    None => Err(Fault::Value {
                        found: format!("a list of {} items", len.unwrap_or(-1)),
                        expected: "a number from 0".into(),
                    }),
                }
            }
        }
    }

    fn list_len(&mut self, layout: &FaceLayout) -> Result<i64, Fault> {
        // List counts are of integer types, so that there always is an index.
        Ok(self.records.scalar(layout.count)?.to_index().unwrap_or(-1))
    }

    fn index(&mut self, layout: &FaceLayout) -> Result<i64, Fault> {
        let value = self.records.scalar(layout.item)?;
        value.to_index().ok_or_else(|| Fault::Value {
            found: format!("index {}", value.to_f32()),
            expected: "a whole number".into(),
        })
    }

    fn checked(&self, index: i64) -> Result<u32, Fault> {
        match u32::try_from(index) {
            Ok(vertex) if vertex < self.vertex_count => Ok(vertex),
            _ => Err(Fault::Index {
                index,
                vertices: self.vertex_count,
            }),
        }
    }
}
