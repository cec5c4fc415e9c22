//! Which columns of the body a frame needs, and where they lie in a record.

use super::header::{Element, Kind, Scalar};
use super::records::Value;

/// Names of the vertex properties that are read, by slot: position, normal,
/// colour.
const SLOTS: [&str; 9] = ["x", "y", "z", "nx", "ny", "nz", "red", "green", "blue"];

/// The names under which faces and strips list their vertices.
const INDEX_LISTS: [&str; 2] = ["vertex_indices", "vertex_index"];

/// The columns of a vertex attribute of three.
pub(super) type Columns = [Column; 3];

/// A scalar column: its type, and the offset in a record of fixed size.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Column {
    pub(super) scalar: Scalar,
    pub(super) offset: usize,
}

/// How to read the `vertex` element.
#[derive(Debug)]
pub(super) struct VertexLayout {
    /// For each property of the element, the slot it fills.
    pub(super) slots: Vec<Option<usize>>,
    /// Bytes of a binary record, if no property is a list.
    pub(super) stride: Option<usize>,
    pub(super) position: Columns,
    pub(super) normal: Option<Columns>,
    pub(super) color: Option<Columns>,
}

impl VertexLayout {
    /// `None` if the element lacks one of `x`, `y` and `z` as a number.
    /// Normals and colours count only when all three parts are there.
    pub(super) fn new(element: &Element) -> Option<Self> {
        let mut offset = Some(0);
        let mut columns = [None; SLOTS.len()];
        let mut slots = Vec::with_capacity(element.properties.len());
        for property in &element.properties {
            let Kind::Scalar(scalar) = property.kind else {
                offset = None;
                slots.push(None);
                continue;
            };
            let slot = SLOTS.iter().position(|&name| name == property.name);
            if let Some(slot) = slot {
                columns[slot] = Some(Column {
                    scalar,
                    offset: offset.unwrap_or(0),
                });
            }
            slots.push(slot);
            offset = offset.map(|offset| offset + scalar.size());
        }
        let three =
            |first: usize| Some([columns[first]?, columns[first + 1]?, columns[first + 2]?]);
        Some(VertexLayout {
            slots,
            stride: offset,
            position: three(0)?,
            normal: three(3),
            color: three(6),
        })
    }
}

/// How to read the `face` or `tristrips` element.
#[derive(Debug)]
pub(super) struct FaceLayout {
    /// Which property lists the vertices.
    pub(super) list: usize,
    /// Types of the list's count and items.
    pub(super) count: Scalar,
    pub(super) item: Scalar,
    /// Bytes before and behind the list, if no other property is a list.
    pub(super) around: Option<(usize, usize)>,
}

impl FaceLayout {
    /// `None` if the element has no list of vertices.
    pub(super) fn new(element: &Element) -> Option<Self> {
        let properties = &element.properties;
        let (list, (count, item)) =
            properties
                .iter()
                .enumerate()
                .find_map(|(i, property)| match property.kind {
                    Kind::List { count, item } if INDEX_LISTS.contains(&&*property.name) => {
                        Some((i, (count, item)))
                    }
                    _ => None,
                })?;
        let bytes = |range: &[super::header::Property]| {
            range
                .iter()
                .try_fold(0, |sum, property| match property.kind {
                    Kind::Scalar(scalar) => Some(sum + scalar.size()),
                    Kind::List { .. } => None,
                })
        };
        Some(FaceLayout {
            list,
            count,
            item,
            around: bytes(&properties[..list]).zip(bytes(&properties[list + 1..])),
        })
    }
}

/// The columns of the vertices read so far.
#[derive(Debug, Default)]
pub(super) struct Vertices {
    pub(super) positions: Vec<[f32; 3]>,
    pub(super) normals: Vec<[f32; 3]>,
    pub(super) colors: Vec<[u8; 3]>,
}

impl Vertices {
    /// Empty columns with room for `room` vertices.
    pub(super) fn with_capacity(layout: &VertexLayout, room: usize) -> Self {
        let normals = if layout.normal.is_some() { room } else { 0 };
        let colors = if layout.color.is_some() { room } else { 0 };
        Vertices {
            positions: Vec::with_capacity(room),
            normals: Vec::with_capacity(normals),
            colors: Vec::with_capacity(colors),
        }
    }

    /// Appends a vertex, of which `values` has what the layout's slots name.
    pub(super) fn push(&mut self, layout: &VertexLayout, values: &[Value; SLOTS.len()]) {
        let three = |first: usize| [values[first], values[first + 1], values[first + 2]];
        self.positions.push(three(0).map(Value::to_f32));
        if layout.normal.is_some() {
            self.normals.push(three(3).map(Value::to_f32));
        }
        if let Some(columns) = &layout.color {
            let values = three(6);
            self.colors
                .push([0, 1, 2].map(|i| values[i].to_color(columns[i].scalar)));
        }
    }
}
