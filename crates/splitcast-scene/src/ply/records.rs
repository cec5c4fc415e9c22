//! What an ASCII and a binary body have in common: records of values.

use std::io::{self, BufReader, Read};

use super::header::Scalar;
use super::layout::{FaceLayout, VertexLayout, Vertices};
use crate::Place;

/// Bytes of a PLY file, decompressed, behind a buffer.
pub(super) type Source<'a> = BufReader<Box<dyn Read + 'a>>;

/// One number of a body, as exact as the file has it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Value {
    Int(i64),
    Float(f32),
    Double(f64),
}

impl Value {
    /// The nearest coordinate; infinite where a `double` is too large.
    pub(super) fn to_f32(self) -> f32 {
        match self {
            Value::Int(value) => value as f32,
            Value::Float(value) => value,
            Value::Double(value) => value as f32,
        }
    }

    /// The value as an index, if it is a whole number.
    pub(super) fn to_index(self) -> Option<i64> {
        // Whole f64 up to 2^53 are exact; no index is larger.
        let whole = |value: f64| {
            (value.fract() == 0.0 && value.abs() <= (1_u64 << 53) as f64).then_some(value as i64)
        };
        match self {
            Value::Int(value) => Some(value),
            Value::Float(value) => whole(f64::from(value)),
            Value::Double(value) => whole(value),
        }
    }

    /// The value of a colour channel: floats run from 0 to 1, `ushort` over
    /// its whole range, all other integers from 0 to 255. What lies outside
    /// is clamped, and NaN becomes 0.
    pub(super) fn to_color(self, scalar: Scalar) -> u8 {
        match self {
            Value::Int(value) if scalar == Scalar::U16 => ((value * 255 + 32767) / 65535) as u8,
            Value::Int(value) => value.clamp(0, 255) as u8,
            // Casts saturate and send NaN to 0.
            Value::Float(value) => (value * 255.0).round() as u8,
            Value::Double(value) => (value * 255.0).round() as u8,
        }
    }
}

/// Why a record could not be read; the reader of the element adds the place.
#[derive(Debug)]
pub(super) enum Fault {
    /// The body ends within or before the record.
    End,
    Io(io::Error),
    Value {
        found: String,
        expected: String,
    },
    Index {
        index: i64,
        vertices: u32,
    },
    Corners {
        corners: i64,
        limit: u64,
    },
    TooManyTriangles,
}

impl From<io::Error> for Fault {
    fn from(error: io::Error) -> Self {
        match error.kind() {
            io::ErrorKind::UnexpectedEof => Fault::End,
            _ => Fault::Io(error),
        }
    }
}

/// A body, read record by record and value by value.
pub(super) trait Records {
    /// Starts the next record.
    fn begin(&mut self) -> Result<(), Fault>;

    /// The next value of the record.
    fn scalar(&mut self, scalar: Scalar) -> Result<Value, Fault>;

    /// Passes over `count` values of the record.
    fn skip(&mut self, count: u64, scalar: Scalar) -> Result<(), Fault>;

    /// Ends the record, of which every value must have been read.
    fn end(&mut self) -> Result<(), Fault>;

    /// Where the current record starts.
    fn place(&self, element: &str, index: u64) -> Place;

    /// Where the body goes on, if it does so with more than blanks.
    fn surplus(&mut self) -> Result<Option<Place>, Fault>;

    /// Reads up to `wanted` vertices at once where the layout allows, and
    /// returns how many; with 0 the caller reads the next one by itself.
    fn vertex_run(
        &mut self,
        _layout: &VertexLayout,
        _wanted: u64,
        _vertices: &mut Vertices,
    ) -> Result<u64, Fault> {
        Ok(0)
    }

    /// Reads up to `wanted` faces at once, as long as they are triangles with
    /// indices below `vertices`, and returns how many; with 0 the caller
    /// reads the next one by itself, and finds out what is wrong with it.
    fn triangle_run(
        &mut self,
        _layout: &FaceLayout,
        _wanted: u64,
        _vertices: u32,
        _triangles: &mut Vec<[u32; 3]>,
    ) -> Result<u64, Fault> {
        Ok(0)
    }
}
