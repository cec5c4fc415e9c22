//! Binary bodies of both byte orders, with a fast path for records of fixed
//! size.
//!
//! The fast path decodes what the read buffer holds, many records at once;
//! the record that straddles the buffer's end, and every record that is not
//! of the expected size, goes the general way, value by value. So any file
//! may be read by either, record for record, to the same bits.

use std::io::{BufRead, Read};

use super::header::{Format, Header, Scalar};
use super::layout::{Column, Columns, FaceLayout, VertexLayout, Vertices};
use super::records::{Fault, Records, Source, Value};
use crate::Place;

/// Faces that are decoded before their counts and indices are judged: enough
/// to keep the test out of the inner loop, few enough that a mesh of mixed
/// triangles and quads loses little where a run breaks off.
const FACE_BLOCK: usize = 64;

/// Bytes of a triangle as most files have it: a count of one byte, and three
/// indices of four.
const PLAIN_FACE: usize = 13;

/// A binary body.
pub(super) struct Binary<'a, 's> {
    source: &'a mut Source<'s>,
    big_endian: bool,
    /// Bytes of the file consumed so far.
    offset: u64,
    /// Offset at which the current record starts.
    record: u64,
}

impl<'a, 's> Binary<'a, 's> {
    /// Starts behind the header.
    pub(super) fn new(source: &'a mut Source<'s>, header: &Header) -> Self {
        Binary {
            source,
            big_endian: header.format == Format::BigEndian,
            offset: header.bytes,
            record: header.bytes,
        }
    }

    fn bytes<const N: usize>(&mut self) -> Result<[u8; N], Fault> {
        let mut bytes = [0; N];
        self.source.read_exact(&mut bytes)?;
        self.offset += N as u64;
        Ok(bytes)
    }

    fn consume(&mut self, bytes: usize) {
        self.source.consume(bytes);
        self.offset += bytes as u64;
    }
}

impl Records for Binary<'_, '_> {
    fn begin(&mut self) -> Result<(), Fault> {
        self.record = self.offset;
        Ok(())
    }

    fn scalar(&mut self, scalar: Scalar) -> Result<Value, Fault> {
        let big_endian = self.big_endian;
        Ok(match scalar.size() {
            1 => decode(&self.bytes::<1>()?, scalar, big_endian),
            2 => decode(&self.bytes::<2>()?, scalar, big_endian),
            4 => decode(&self.bytes::<4>()?, scalar, big_endian),
            _ => decode(&self.bytes::<8>()?, scalar, big_endian),
        })
    }

    fn skip(&mut self, count: u64, scalar: Scalar) -> Result<(), Fault> {
        let mut left = count.saturating_mul(scalar.size() as u64);
        while left > 0 {
            let held = self.source.fill_buf()?.len();
            if held == 0 {
                return Err(Fault::End);
            }
            let step = left.min(held as u64);
            self.consume(step as usize);
            left -= step;
        }
        Ok(())
    }

    fn end(&mut self) -> Result<(), Fault> {
        Ok(())
    }

    fn place(&self, element: &str, index: u64) -> Place {
        Place::Element {
            element: element.to_owned(),
            index,
            byte: self.record,
        }
    }

    fn surplus(&mut self) -> Result<Option<Place>, Fault> {
        loop {
            let held = self.source.fill_buf()?;
            if held.is_empty() {
                return Ok(None);
            }
            // Some writers end with a line end or pad with zeros.
            let blank = |byte: &u8| *byte == 0 || byte.is_ascii_whitespace();
            if !held.iter().all(blank) {
                return Ok(Some(Place::Byte(self.offset)));
            }
            let len = held.len();
            self.consume(len);
        }
    }

    fn vertex_run(
        &mut self,
        layout: &VertexLayout,
        wanted: u64,
        vertices: &mut Vertices,
    ) -> Result<u64, Fault> {
        let Some(stride) = layout.stride else {
            return Ok(0);
        };
        let held = self.source.fill_buf()?;
        let count = wanted.min((held.len() / stride) as u64) as usize;
        let run = &held[..count * stride];
        let big = self.big_endian;
        read_points(run, stride, &layout.position, big, &mut vertices.positions);
        if let Some(columns) = &layout.normal {
            read_points(run, stride, columns, big, &mut vertices.normals);
        }
        if let Some(columns) = &layout.color {
            read_colors(run, stride, columns, big, &mut vertices.colors);
        }
        self.consume(count * stride);
        Ok(count as u64)
    }

    fn triangle_run(
        &mut self,
        layout: &FaceLayout,
        wanted: u64,
        vertices: u32,
        triangles: &mut Vec<[u32; 3]>,
    ) -> Result<u64, Fault> {
        let (Some((before, behind)), Scalar::I32 | Scalar::U32) = (layout.around, layout.item)
        else {
            return Ok(0);
        };
        let count = layout.count.size();
        let stride = before + count + 12 + behind;
        let held = self.source.fill_buf()?;
        let whole = wanted.min((held.len() / stride) as u64) as usize;
        let read = match self.big_endian {
            false => read_triangles::<false>,
            true => read_triangles::<true>,
        };
        let mut done = 0;
        if stride == PLAIN_FACE {
            for block in held[..whole * stride].as_chunks().0.chunks(FACE_BLOCK) {
                let good = read(block, vertices, triangles);
                done += good;
                if good < block.len() {
                    break;
                }
            }
        } else {
            let mut plain = [[0; PLAIN_FACE]; FACE_BLOCK];
            for block in held[..whole * stride].chunks(FACE_BLOCK * stride) {
                let len = block.len() / stride;
                for (record, plain) in block.chunks_exact(stride).zip(&mut plain) {
                    let (head, indices) = record[before..].split_at(count);
                    plain[0] = plain_count(head, self.big_endian);
                    plain[1..].copy_from_slice(&indices[..12]);
                }
                let good = read(&plain[..len], vertices, triangles);
                done += good;
                if good < len {
                    break;
                }
            }
        }
        self.consume(done * stride);
        Ok(done as u64)
    }
}

/// The number at the start of `bytes`.
fn decode(bytes: &[u8], scalar: Scalar, big_endian: bool) -> Value {
    macro_rules! number {
        ($type:ty) => {{
            let mut raw = [0; size_of::<$type>()];
            raw.copy_from_slice(&bytes[..size_of::<$type>()]);
            if big_endian {
                <$type>::from_be_bytes(raw)
            } else {
                <$type>::from_le_bytes(raw)
            }
        }};
    }
    match scalar {
        Scalar::I8 => Value::Int(number!(i8).into()),
        Scalar::U8 => Value::Int(number!(u8).into()),
        Scalar::I16 => Value::Int(number!(i16).into()),
        Scalar::U16 => Value::Int(number!(u16).into()),
        Scalar::I32 => Value::Int(number!(i32).into()),
        Scalar::U32 => Value::Int(number!(u32).into()),
        Scalar::F32 => Value::Float(number!(f32)),
        Scalar::F64 => Value::Double(number!(f64)),
    }
}

/// Appends three columns of a run of records.
fn read_points(
    run: &[u8],
    stride: usize,
    columns: &Columns,
    big_endian: bool,
    out: &mut Vec<[f32; 3]>,
) {
    let first = columns[0].offset;
    let adjacent = columns
        .iter()
        .enumerate()
        .all(|(i, c)| c.scalar == Scalar::F32 && c.offset == first + 4 * i);
    match (adjacent, big_endian) {
        (true, false) => read_adjacent::<false>(run, stride, first, out),
        (true, true) => read_adjacent::<true>(run, stride, first, out),
        (false, _) => {
            let [x, y, z] = *columns;
            let read = |record: &[u8], column: Column| {
                decode(&record[column.offset..], column.scalar, big_endian).to_f32()
            };
            out.extend(
                run.chunks_exact(stride)
                    .map(|r| [read(r, x), read(r, y), read(r, z)]),
            );
        }
    }
}

/// Appends the colours of a run of records.
fn read_colors(
    run: &[u8],
    stride: usize,
    columns: &Columns,
    big_endian: bool,
    out: &mut Vec<[u8; 3]>,
) {
    let [r, g, b] = *columns;
    let records = run.chunks_exact(stride);
    if columns.iter().all(|column| column.scalar == Scalar::U8) {
        out.extend(records.map(|record| [record[r.offset], record[g.offset], record[b.offset]]));
    } else {
        let read = |record: &[u8], column: Column| {
            decode(&record[column.offset..], column.scalar, big_endian).to_color(column.scalar)
        };
        out.extend(records.map(|record| [read(record, r), read(record, g), read(record, b)]));
    }
}

/// Appends three floats in a row from each record.
fn read_adjacent<const BIG_ENDIAN: bool>(
    run: &[u8],
    stride: usize,
    first: usize,
    out: &mut Vec<[f32; 3]>,
) {
    let point = |bytes: &[u8]| {
        let [x, y, z] = words::<BIG_ENDIAN>(bytes);
        [f32::from_bits(x), f32::from_bits(y), f32::from_bits(z)]
    };
    if stride == 12 {
        out.extend(run.as_chunks::<12>().0.iter().map(|record| point(record)));
    } else {
        out.extend(
            run.chunks_exact(stride)
                .map(|record| point(&record[first..first + 12])),
        );
    }
}

/// A list count in one byte; 0 where it does not fit.
fn plain_count(bytes: &[u8], big_endian: bool) -> u8 {
    let split = if big_endian {
        bytes.split_last()
    } else {
        bytes.split_first()
    };
    match split {
        Some((&low, high)) if high.iter().all(|&byte| byte == 0) => low,
        _ => 0,
    }
}

/// Appends the leading records that are triangles with indices below
/// `vertices`, and returns how many there are.
fn read_triangles<const BIG_ENDIAN: bool>(
    block: &[[u8; PLAIN_FACE]],
    vertices: u32,
    out: &mut Vec<[u32; 3]>,
) -> usize {
    let triangle = |record: &[u8; PLAIN_FACE]| words::<BIG_ENDIAN>(&record[1..]);
    let start = out.len();
    // Three plain loops over a block in the first-level cache, each of which
    // the compiler turns into vector code.
    out.extend(block.iter().map(triangle));
    let new = &out[start..];
    let largest = new.as_flattened().iter().fold(0, |max, &i| i.max(max));
    let odd = block.iter().fold(0, |odd, record| odd | (record[0] ^ 3));
    if odd != 0 || largest >= vertices {
        let sound = |(record, triangle): (&[u8; PLAIN_FACE], &[u32; 3])| {
            record[0] == 3 && triangle.iter().all(|&index| index < vertices)
        };
        let good = block
            .iter()
            .zip(new)
            .take_while(|&pair| sound(pair))
            .count();
        out.truncate(start + good);
    }
    out.len() - start
}

/// The three words at the start of a slice of twelve bytes.
#[inline(always)]
fn words<const BIG_ENDIAN: bool>(bytes: &[u8]) -> [u32; 3] {
    let word = |at: usize| {
        let word = [bytes[at], bytes[at + 1], bytes[at + 2], bytes[at + 3]];
        if BIG_ENDIAN {
            u32::from_be_bytes(word)
        } else {
            u32::from_le_bytes(word)
        }
    };
    // Spelled out, as are the columns above: `array::map` leaves a call for
    // each record.
    [word(0), word(4), word(8)]
}
