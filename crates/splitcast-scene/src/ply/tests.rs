//! Every kind of file by hand, every kind of mistake, and any file at random.

use std::fmt::Write as _;
use std::io::{Cursor, Write as _};
use std::sync::Arc;

use flate2::{Compression, write::GzEncoder};
use proptest::prelude::*;

use super::*;
use crate::Place;

/// Reads bytes that are not compressed, through a buffer of any size: with a
/// tiny one no run of records ever fits, and all goes the general way.
fn read_through(bytes: &[u8], buffer: usize) -> Result<Frame, SceneError> {
    let mut source: Source<'_> = BufReader::with_capacity(buffer, Box::new(bytes));
    let len = bytes.len() as u64;
    let extent = Extent {
        limit: len,
        likely: len,
    };
    read_source(Path::new("mesh.ply"), &mut source, extent)
}

/// Reads bytes as a file, compressed or not.
fn read_file(bytes: &[u8]) -> Result<Frame, SceneError> {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("mesh.ply");
    std::fs::write(&path, bytes).expect("a file");
    read_ply(&path)
}

fn gzip(bytes: &[u8]) -> Vec<u8> {
    let mut encoder = GzEncoder::new(Vec::new(), Compression::default());
    encoder.write_all(bytes).expect("memory");
    encoder.finish().expect("memory")
}

/// A tetrahedron as ASCII.
const TETRAHEDRON: &str = "ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\n\
    property float y\nproperty float z\nelement face 4\nproperty list uchar int vertex_indices\n\
    end_header\n0.0 0.0 0.0\n1.0 0.0 0.0\n0.0 1.0 0.0\n0.0 0.0 1.0\n3 0 2 1\n3 0 1 3\n3 1 2 3\n3 2 0 3\n";

/// The same as binary, little-endian: 9 lines of header, 48 bytes of
/// vertices, 52 of faces.
fn binary_tetrahedron() -> Vec<u8> {
    let frame = read_through(TETRAHEDRON.as_bytes(), 64).expect("a good file");
    let mut bytes = Vec::new();
    write::encode(&frame, &mut bytes).expect("memory");
    bytes
}

#[test]
fn the_plainest_file() {
    let frame = read_file(TETRAHEDRON.as_bytes()).expect("a good file");
    assert_eq!(frame.positions[3], [0.0, 0.0, 1.0]);
    assert_eq!(
        *frame.triangles,
        [[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]]
    );
    assert!(frame.normals.is_none() && frame.colors.is_none());
    for bytes in [
        TETRAHEDRON.replace('\n', "\r\n").into_bytes(),
        TETRAHEDRON.replace('\n', "\r").into_bytes(),
        TETRAHEDRON.replace("\n3", " \n\n3").into_bytes(),
        TETRAHEDRON.trim_end().as_bytes().to_vec(),
        binary_tetrahedron(),
        [binary_tetrahedron(), b"\r\n\0".to_vec()].concat(),
        gzip(TETRAHEDRON.as_bytes()),
        gzip(&binary_tetrahedron()),
        // Two members, as `cat a.gz b.gz` leaves them.
        [
            gzip(&TETRAHEDRON.as_bytes()[..200]),
            gzip(&TETRAHEDRON.as_bytes()[200..]),
        ]
        .concat(),
    ] {
        let same = read_file(&bytes).expect("a good file");
        assert_eq!(
            (same.positions, same.triangles),
            (frame.positions.clone(), frame.triangles.clone())
        );
    }
}

#[test]
fn attributes_and_strangers_in_any_order() {
    let text = "ply\ncomment x\nformat ascii 1.0\nelement camera 1\nproperty list uint8 float w\nproperty char k\n\
        element face 2\nproperty uchar flags\nproperty list ushort short vertex_index\n\
        property list uchar float texcoord\nproperty float area\nelement nothing 4000000000\n\
        element vertex 4\nproperty uchar blue\nproperty double z\nproperty float ny\nproperty uchar red\n\
        property short x\nproperty list int int rings\nproperty float nx\nproperty uchar y\n\
        property float nz\nproperty uchar green\nproperty float alpha\nend_header\n\
        2 0.5 nan -3\n\
        255 4 0 1 2 3 8 0 0 0 0 0 0 0 0 1.5\n7 3 3 2 1 0 -0.25\n\
        1 0.5 0 2 -300 0 3 7 4 3 inf\n4 0.25 1 5 300 2 9 9 0 8 0 6 1\n\
        0 1e3 0 0 300 0 0 9 1 0 0\n9 -1e400 0 0 -300 0 0 9 0 0 0\n";
    let frame = read_through(text.as_bytes(), 32).expect("a good file");
    assert_eq!(frame.positions[0], [-300.0, 7.0, 0.5]);
    assert_eq!(frame.positions[3], [-300.0, 9.0, f32::NEG_INFINITY]);
    assert_eq!(*frame.triangles, [[0, 1, 2], [0, 2, 3], [3, 2, 1]]);
    let normals = frame.normals.expect("normals");
    assert_eq!(normals[0], [0.6, 0.0, 0.8]);
    assert_eq!(normals[3], [0.0; 3]);
    assert_eq!(frame.colors.expect("colours")[..2], [[2, 3, 1], [5, 6, 4]]);
}

#[test]
fn colours_of_every_type() {
    for (kind, values, color) in [
        ("uchar", "0 128 255", [0, 128, 255]),
        ("ushort", "0 32896 65535", [0, 128, 255]),
        ("float", "0 0.5 1.5", [0, 128, 255]),
        ("double", "nan 0.5 1", [0, 128, 255]),
        ("int", "-5 128 1000", [0, 128, 255]),
    ] {
        let text = TETRAHEDRON
            .replace(
                "property float z\n",
                &"property float z\nproperty K red\nproperty K green\nproperty K blue\n"
                    .replace('K', kind),
            )
            .replace("0.0 0.0 0.0\n", &format!("0.0 0.0 0.0 {values}\n"))
            .replace("1.0 0.0 0.0\n", &format!("1.0 0.0 0.0 {values}\n"))
            .replace("0.0 1.0 0.0\n", &format!("0.0 1.0 0.0 {values}\n"))
            .replace("0.0 0.0 1.0\n", &format!("0.0 0.0 1.0 {values}\n"));
        let frame = read_through(text.as_bytes(), 64).expect(kind);
        assert_eq!(frame.colors.expect("colours")[..], [color; 4], "{kind}");
    }
}

#[test]
fn polygons_and_strips_become_triangles() {
    let head = "ply\nformat ascii 1.0\nelement vertex 5\nproperty float x\nproperty float y\nproperty float z\n";
    let points = "0 0 0\n4 0 0\n1 1 0\n0 4 0\n-1 -1 0\n";
    // The dart's fan around its first corner is wrong from corner 1 or 3.
    let polygons = format!(
        "{head}element face 3\nproperty list int uint vertex_indices\nend_header\n{points}\
         4 1 2 3 0\n5 0 1 2 3 4\n3 0 1 2\n"
    );
    let frame = read_through(polygons.as_bytes(), 64).expect("a good file");
    assert_eq!(frame.triangles.len(), 2 + 3 + 1);
    assert_eq!(frame.triangles[5], [0, 1, 2]);
    let area = |t: &[u32; 3]| {
        let [a, b, c] = [0, 1, 2].map(|i| frame.positions[t[i] as usize]);
        (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
    };
    assert_eq!(frame.triangles[..2].iter().map(area).sum::<f32>(), 8.0);
    assert!(
        frame.triangles[..2].iter().all(|t| area(t) > 0.0),
        "{:?}",
        frame.triangles
    );
    let strips = format!(
        "{head}element tristrips 2\nproperty list int int vertex_indices\nend_header\n{points}\
         10 0 1 2 3 -1 4 0 1 1 3\n2 0 1\n"
    );
    let frame = read_through(strips.as_bytes(), 64).expect("a good file");
    assert_eq!(*frame.triangles, [[0, 1, 2], [2, 1, 3], [4, 0, 1]]);
}

/// One mistake: the file, its kind of error, and parts of the message.
type Mistake = (Vec<u8>, fn(&SceneError) -> bool, [&'static str; 2]);

fn mistakes() -> Vec<Mistake> {
    let ascii = |from: &str, to: &str| {
        assert!(TETRAHEDRON.contains(from), "{from}");
        TETRAHEDRON.replacen(from, to, 1).into_bytes()
    };
    let binary = binary_tetrahedron();
    let faces = binary.len() - 52;
    let patched = |at: usize, bytes: &[u8]| {
        let mut file = binary.clone();
        file[at..at + bytes.len()].copy_from_slice(bytes);
        file
    };
    let counted = |from: &str, to: &str| {
        let end = binary.len() - 100;
        let head = str::from_utf8(&binary[..end]).expect("a text header");
        assert!(head.contains(from), "{from}");
        [head.replacen(from, to, 1).as_bytes(), &binary[end..]].concat()
    };
    let whole = gzip(&binary);
    let mut damaged = whole.clone();
    let last = damaged.len() - 6;
    damaged[last] ^= 0x55;
    vec![
        (
            vec![],
            |e| matches!(e, SceneError::EmptyFile { .. }),
            ["mesh.ply: ", "empty"],
        ),
        (
            b"\x89PNG\r\n\x1a\n".to_vec(),
            |e| matches!(e, SceneError::NotAMesh { .. }),
            ["\"\\x89PNG\\r\\n", "\"ply\""],
        ),
        (
            ascii("float z", "float w"),
            |e| matches!(e, SceneError::Header { line: 3, .. }),
            ["line 3", "x, y and z"],
        ),
        (
            ascii("_indices", "_list"),
            |e| matches!(e, SceneError::Header { line: 7, .. }),
            ["line 7", "vertex_indices"],
        ),
        (
            ascii("vertex 4", "vertex 0"),
            |e| matches!(e, SceneError::NoGeometry { .. }),
            ["no vertices", "expected"],
        ),
        (
            ascii("face 4", "face 0"),
            |e| matches!(e, SceneError::NoGeometry { .. }),
            ["no triangles", "point cloud"],
        ),
        (
            ascii("element face", "element edge"),
            |e| matches!(e, SceneError::NoGeometry { .. }),
            ["no triangles", "point cloud"],
        ),
        (
            ascii("vertex 4", "vertex 4000000000"),
            |e| matches!(e, SceneError::CountTooLarge { .. }),
            ["4000000000 vertex", "24000000000 bytes"],
        ),
        (
            ascii("face 4", "face 18446744073709551615"),
            |e| matches!(e, SceneError::CountTooLarge { .. }),
            ["face elements", "at most 80"],
        ),
        (
            ascii("vertex 4", "vertex 5"),
            |e| matches!(e, SceneError::Value { .. }),
            ["line 14", "found \"1\", expected the end"],
        ),
        (
            ascii("3 2 0 3\n", ""),
            |e| {
                matches!(
                    e,
                    SceneError::Truncated {
                        missing: 1,
                        count: 4,
                        ..
                    }
                )
            },
            ["line 17", "1 of 4 face"],
        ),
        (
            ascii("3 2 0 3\n", "3 2 0"),
            |e| matches!(e, SceneError::Truncated { .. }),
            ["line 17", "cut short"],
        ),
        (
            ascii("0.0 1.0 0.0\n", "0 1\n"),
            |e| matches!(e, SceneError::Value { .. }),
            ["line 12", "the end of the line"],
        ),
        (
            ascii("0.0 1.0 0.0\n", "0 1 0,5\n"),
            |e| matches!(e, SceneError::Value { .. }),
            ["line 12", "\"0,5\", expected a value of type float"],
        ),
        (
            ascii("0.0 1.0 0.0\n", "0 1 \x1b[31m\n"),
            |e| matches!(e, SceneError::Value { .. }),
            ["line 12", "\"\\x1b[31m\""],
        ),
        (
            ascii("3 0 2 1", "3 0 2 4"),
            |e| matches!(e, SceneError::IndexOutOfRange { index: 4, .. }),
            ["line 14: index 4", "0 to 3"],
        ),
        (
            ascii("3 0 2 1", "3 0 2 -1"),
            |e| matches!(e, SceneError::IndexOutOfRange { index: -1, .. }),
            ["line 14: index -1", "0 to 3"],
        ),
        (
            ascii("3 0 2 1", "3 0 2 1.5"),
            |e| matches!(e, SceneError::Value { .. }),
            ["line 14", "type int"],
        ),
        (
            ascii("3 0 2 1", "1 0"),
            |e| matches!(e, SceneError::Polygon { corners: 1, .. }),
            ["line 14", "1 corners"],
        ),
        (
            ascii("3 0 2 1", "200 0 2 1"),
            |e| {
                matches!(
                    e,
                    SceneError::Polygon {
                        corners: 200,
                        limit: 8,
                        ..
                    }
                )
            },
            ["line 14", "3 to 8"],
        ),
        (
            ascii("3 0 2 1", "300 0 2 1"),
            |e| matches!(e, SceneError::Value { .. }),
            ["line 14", "type uchar"],
        ),
        (
            ascii("3 2 0 3\n", "3 2 0 3\n\n7\n"),
            |e| {
                matches!(
                    e,
                    SceneError::TrailingData {
                        place: Place::Line(19),
                        ..
                    }
                )
            },
            ["line 19", "too small"],
        ),
        (
            counted("vertex 4", "vertex 4000000000"),
            |e| matches!(e, SceneError::CountTooLarge { .. }),
            ["4000000000 vertex", "at most 100"],
        ),
        (
            counted("face 4", "face 5"),
            |e| matches!(e, SceneError::CountTooLarge { .. }),
            ["5 face elements", "113 bytes"],
        ),
        (
            binary[..binary.len() - 1].to_vec(),
            |e| matches!(e, SceneError::CountTooLarge { .. }),
            ["4 face elements", "cut short"],
        ),
        (
            counted("face 4", "face 3"),
            |e| {
                matches!(
                    e,
                    SceneError::TrailingData {
                        place: Place::Byte(_),
                        ..
                    }
                )
            },
            ["byte ", "too small"],
        ),
        (
            patched(faces + 13, &[4]),
            |e| matches!(e, SceneError::IndexOutOfRange { .. }),
            ["face 1 at byte ", "0 to 3"],
        ),
        (
            patched(faces + 39, &[4]),
            |e| matches!(e, SceneError::Truncated { missing: 1, .. }),
            ["face 3 at byte ", "1 of 4 face"],
        ),
        (
            patched(faces + 13, &[2]),
            |e| matches!(e, SceneError::Polygon { corners: 2, .. }),
            ["face 1 at byte ", "2 corners"],
        ),
        (
            patched(faces + 1, &[9, 0, 0, 0]),
            |e| matches!(e, SceneError::IndexOutOfRange { index: 9, .. }),
            ["face 0 at byte ", "index 9"],
        ),
        (
            patched(faces + 1, &[255; 4]),
            |e| matches!(e, SceneError::IndexOutOfRange { index: -1, .. }),
            ["face 0 at byte ", "index -1"],
        ),
        (
            whole[..whole.len() - 20].to_vec(),
            |e| matches!(e, SceneError::Gzip { .. }),
            ["damaged gzip", "again"],
        ),
        (
            damaged,
            |e| matches!(e, SceneError::Gzip { .. }),
            ["damaged gzip", "again"],
        ),
        (
            gzip(b""),
            |e| matches!(e, SceneError::EmptyFile { .. }),
            ["mesh.ply: ", "empty"],
        ),
        (
            gzip(&counted("vertex 4", "vertex 2000000000")),
            |e| matches!(e, SceneError::CountTooLarge { .. }),
            ["2000000000 vertex", "24000000000"],
        ),
        (
            bomb(),
            |e| matches!(e, SceneError::Expansion { .. }),
            ["gunzip", "out of proportion"],
        ),
    ]
}

/// 20 MB of blanks behind a header that does not say so.
fn bomb() -> Vec<u8> {
    gzip(&[TETRAHEDRON.as_bytes(), &vec![b' '; 20_000_000]].concat())
}

#[test]
fn mistakes_are_named_with_file_and_place_in_one_line() {
    for (i, (file, is_kind, parts)) in mistakes().into_iter().enumerate() {
        let error = read_file(&file).expect_err(parts[0]);
        let message = error.to_string();
        println!("{message}");
        assert!(is_kind(&error), "case {i}: {error:?}");
        for part in ["mesh.ply: "].iter().chain(&parts) {
            assert!(message.contains(part), "case {i}: {message} lacks {part}");
        }
        assert!(
            !message.chars().any(char::is_control),
            "case {i}: {message:?}"
        );
    }
}

#[test]
fn what_is_no_file_is_no_mesh() {
    let folder = tempfile::tempdir().expect("a folder");
    assert!(matches!(
        read_ply(folder.path()),
        Err(SceneError::Io { .. })
    ));
    let missing = read_ply(folder.path().join("none.ply")).expect_err("no file");
    assert!(
        missing.to_string().contains("none.ply: cannot be read"),
        "{missing}"
    );
}

#[test]
fn a_frame_that_breaks_its_invariants_is_not_written() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("mesh.ply");
    let good = read_through(TETRAHEDRON.as_bytes(), 64).expect("a good file");
    write_ply(&path, &good).expect("a writable folder");
    let before = std::fs::read(&path).expect("a file");
    let bad = [
        Frame::default(),
        Frame {
            normals: Some(vec![[0.0; 3]]),
            ..good.clone()
        },
        Frame {
            colors: Some(Arc::new(vec![[0; 3]; 5])),
            ..good.clone()
        },
        Frame {
            triangles: Arc::new(vec![[0, 1, 4]]),
            ..good.clone()
        },
    ];
    for frame in bad {
        let error = write_ply(&path, &frame).expect_err("a bad frame");
        assert!(matches!(error, SceneError::InvalidFrame { .. }), "{error}");
    }
    assert_eq!(std::fs::read(&path).expect("a file"), before);
    let error = write_ply(folder.path().join("none/mesh.ply"), &good).expect_err("no folder");
    assert!(
        error
            .to_string()
            .contains("none/mesh.ply: cannot be written"),
        "{error}"
    );
}

/// How a mesh is put into a file.
#[derive(Clone, Debug)]
struct Style {
    format: Format,
    /// Type of the list counts, and of the indices.
    count: header::Scalar,
    item: header::Scalar,
    /// Whether records have scalars besides, before and behind what is read.
    extras: bool,
    /// Whether coordinates are `double`.
    double: bool,
}

fn styles() -> impl Strategy<Value = Style> {
    use header::Scalar::{F32, F64, I8, I16, I32, U8, U16, U32};
    let formats =
        prop::sample::select(vec![Format::Ascii, Format::LittleEndian, Format::BigEndian]);
    let counts = prop::sample::select(vec![I8, U8, I16, U16, I32, U32]);
    let items = prop::sample::select(vec![I32, U32, I32, U32, I8, U8, I16, U16, F32, F64]);
    (formats, counts, items, any::<bool>(), any::<bool>()).prop_map(
        |(format, count, item, extras, double)| Style {
            format,
            count,
            item,
            extras,
            double,
        },
    )
}

/// Writes numbers in any format.
struct Encoder {
    format: Format,
    bytes: Vec<u8>,
}

impl Encoder {
    fn put(&mut self, scalar: header::Scalar, value: f64) {
        macro_rules! number {
            ($type:ty) => {{
                let value = value as $type;
                match self.format {
                    Format::Ascii => write!(self.bytes, "{value} ").expect("memory"),
                    Format::LittleEndian => self.bytes.extend(value.to_le_bytes()),
                    Format::BigEndian => self.bytes.extend(value.to_be_bytes()),
                }
            }};
        }
        match scalar {
            header::Scalar::I8 => number!(i8),
            header::Scalar::U8 => number!(u8),
            header::Scalar::I16 => number!(i16),
            header::Scalar::U16 => number!(u16),
            header::Scalar::I32 => number!(i32),
            header::Scalar::U32 => number!(u32),
            header::Scalar::F32 => number!(f32),
            header::Scalar::F64 => number!(f64),
        }
    }

    fn end(&mut self) {
        if self.format == Format::Ascii {
            self.bytes.push(b'\n');
        }
    }
}

/// A mesh with faces of any number of corners.
#[derive(Clone, Debug)]
struct Polygonal {
    positions: Vec<[f32; 3]>,
    faces: Vec<Vec<u32>>,
}

fn meshes() -> impl Strategy<Value = Polygonal> {
    let coordinate = -1e6_f32..1e6;
    let positions = prop::collection::vec(prop::array::uniform3(coordinate), 3..30);
    positions.prop_flat_map(|positions| {
        let corner = 0..positions.len() as u32;
        // Mostly triangles, so that there are runs of them.
        let face = prop_oneof![
            6 => prop::collection::vec(corner.clone(), 3),
            1 => prop::collection::vec(corner, 3..7),
        ];
        prop::collection::vec(face, 1..120).prop_map(move |faces| Polygonal {
            positions: positions.clone(),
            faces,
        })
    })
}

fn encode(mesh: &Polygonal, style: &Style) -> Vec<u8> {
    use header::Scalar::{F32, F64, I16, U8};
    let mut head = String::from("ply\nformat ");
    head.push_str(match style.format {
        Format::Ascii => "ascii",
        Format::LittleEndian => "binary_little_endian",
        Format::BigEndian => "binary_big_endian",
    });
    let extra = |head: &mut String, line: &str| {
        if style.extras {
            head.push_str(line);
        }
    };
    let coordinate = if style.double { F64 } else { F32 };
    write!(head, " 1.0\nelement vertex {}\n", mesh.positions.len()).expect("memory");
    extra(&mut head, "property uchar quality\n");
    for name in ["x", "y", "z"] {
        writeln!(head, "property {} {name}", coordinate.name()).expect("memory");
    }
    extra(&mut head, "property short group\n");
    writeln!(head, "element face {}", mesh.faces.len()).expect("memory");
    extra(&mut head, "property short material\n");
    let (count, item) = (style.count.name(), style.item.name());
    writeln!(head, "property list {count} {item} vertex_indices").expect("memory");
    extra(&mut head, "property uchar flags\n");
    head.push_str("end_header\n");
    let mut out = Encoder {
        format: style.format,
        bytes: head.into_bytes(),
    };
    for position in &mesh.positions {
        if style.extras {
            out.put(U8, 200.0);
        }
        for &value in position {
            out.put(coordinate, f64::from(value));
        }
        if style.extras {
            out.put(I16, -7.0);
        }
        out.end();
    }
    for face in &mesh.faces {
        if style.extras {
            out.put(I16, -300.0);
        }
        out.put(style.count, face.len() as f64);
        for &corner in face {
            out.put(style.item, f64::from(corner));
        }
        if style.extras {
            out.put(U8, 3.0);
        }
        out.end();
    }
    out.bytes
}

/// What the maintained parser makes of a file: vertices and faces.
fn second_opinion(bytes: &[u8]) -> (Vec<[f32; 3]>, Vec<Vec<u32>>) {
    use ply_rs_bw::parser::Parser;
    use ply_rs_bw::ply::{DefaultElement, Property};
    let parser = Parser::<DefaultElement>::new();
    let ply = parser
        .read_ply(&mut Cursor::new(bytes))
        .expect("a good file");
    let value = |property: &Property| match *property {
        Property::Float(value) => value,
        Property::Double(value) => value as f32,
        ref other => panic!("{other:?}"),
    };
    let list = |property: &Property| match property {
        Property::ListChar(list) => list.iter().map(|&i| i as u32).collect(),
        Property::ListUChar(list) => list.iter().map(|&i| i.into()).collect(),
        Property::ListShort(list) => list.iter().map(|&i| i as u32).collect(),
        Property::ListUShort(list) => list.iter().map(|&i| i.into()).collect(),
        Property::ListInt(list) => list.iter().map(|&i| i as u32).collect(),
        Property::ListUInt(list) => list.clone(),
        Property::ListFloat(list) => list.iter().map(|&i| i as u32).collect(),
        Property::ListDouble(list) => list.iter().map(|&i| i as u32).collect(),
        other => panic!("{other:?}"),
    };
    let point = |vertex: &DefaultElement| ["x", "y", "z"].map(|name| value(&vertex[name]));
    (
        ply.payload["vertex"].iter().map(point).collect(),
        ply.payload["face"]
            .iter()
            .map(|face| list(&face["vertex_indices"]))
            .collect(),
    )
}

fn bits(values: &[[f32; 3]]) -> Vec<[u32; 3]> {
    values.iter().map(|value| value.map(f32::to_bits)).collect()
}

proptest! {
    #[test]
    fn every_style_and_every_way_gives_the_same_bits(
        mesh in meshes(),
        style in styles(),
        buffer in 1..600_usize,
    ) {
        let bytes = encode(&mesh, &style);
        let frame = read_through(&bytes, buffer).expect("a good file");
        prop_assert_eq!(bits(&frame.positions), bits(&mesh.positions));
        let corners: usize = mesh.faces.iter().map(|face| face.len() - 2).sum();
        prop_assert_eq!(frame.triangles.len(), corners);
        for way in [1, 1 << 16] {
            let same = read_through(&bytes, way).expect("a good file");
            prop_assert_eq!(bits(&same.positions), bits(&frame.positions));
            prop_assert_eq!(&same.triangles, &frame.triangles);
        }
        let ascii = Style { format: Format::Ascii, ..style };
        let same = read_through(&encode(&mesh, &ascii), 64).expect("a good file");
        prop_assert_eq!(&same.triangles, &frame.triangles);
    }

    #[test]
    fn the_maintained_parser_agrees(mesh in meshes(), style in styles()) {
        let bytes = encode(&mesh, &style);
        let (positions, faces) = second_opinion(&bytes);
        let frame = read_through(&bytes, 512).expect("a good file");
        prop_assert_eq!(bits(&frame.positions), bits(&positions));
        let mut triangles = frame.triangles.iter();
        for face in faces {
            let mut corners: Vec<u32> =
                triangles.by_ref().take(face.len() - 2).flatten().copied().collect();
            let mut expected = face.clone();
            for list in [&mut corners, &mut expected] {
                list.sort_unstable();
                list.dedup();
            }
            prop_assert_eq!(corners, expected);
        }
        prop_assert!(triangles.next().is_none());
    }

    #[test]
    fn what_is_written_is_read_back_to_the_bit(
        positions in prop::collection::vec(prop::array::uniform3(any::<u32>()), 3..40),
        triangles in prop::collection::vec(prop::array::uniform3(0..3_u32), 1..200),
        with_normals in any::<bool>(),
        with_colors in any::<bool>(),
        buffer in 1..600_usize,
    ) {
        let frame = Frame {
            positions: positions.iter().map(|p| p.map(f32::from_bits)).collect(),
            triangles: Arc::new(triangles),
            normals: with_normals.then(|| {
                let unit = |i: usize| [[0.6, 0.0, -0.8], [0.0; 3], [0.577_35, 0.577_35, 0.577_35]][i % 3];
                (0..positions.len()).map(unit).collect()
            }),
            colors: with_colors.then(|| Arc::new(positions.iter().map(|p| p.map(|c| c as u8)).collect())),
        };
        let mut bytes = Vec::new();
        write::encode(&frame, &mut bytes).expect("memory");
        let back = read_through(&bytes, buffer).expect("a good file");
        prop_assert_eq!(bits(&back.positions), bits(&frame.positions));
        prop_assert_eq!(back.triangles, frame.triangles);
        prop_assert_eq!(back.normals, frame.normals);
        prop_assert_eq!(back.colors, frame.colors);
    }

    #[test]
    fn damaged_files_never_panic_nor_grow(
        mesh in meshes(),
        style in styles(),
        compressed in any::<bool>(),
        changes in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 0..5),
        cut in prop::option::of(any::<prop::sample::Index>()),
        buffer in 1..600_usize,
    ) {
        let mut bytes = encode(&mesh, &style);
        if compressed {
            bytes = gzip(&bytes);
        }
        for (at, value) in changes {
            let at = at.index(bytes.len());
            bytes[at] = value;
        }
        if let Some(cut) = cut {
            bytes.truncate(cut.index(bytes.len()));
        }
        let results = if compressed {
            vec![read_file(&bytes)]
        } else {
            vec![read_through(&bytes, buffer), read_through(&bytes, 1 << 16)]
        };
        for result in &results {
            match result {
                Ok(frame) => {
                    let vertices = frame.positions.len() as u32;
                    prop_assert!(frame.triangles.as_flattened().iter().all(|&i| i < vertices));
                    prop_assert!(frame.normals.as_ref().is_none_or(|n| n.len() == vertices as usize));
                }
                Err(error) => {
                    let message = error.to_string();
                    prop_assert!(message.contains("mesh.ply: "), "{}", message);
                    prop_assert!(!message.chars().any(char::is_control), "{:?}", message);
                }
            }
        }
        if let [one, other] = &results[..] {
            // Errors agree too, whichever way the record was read.
            let text = |result: &Result<Frame, SceneError>| match result {
                Ok(frame) => format!("{:?} {:?}", bits(&frame.positions), frame.triangles),
                Err(error) => error.to_string(),
            };
            prop_assert_eq!(text(one), text(other));
        }
    }
}
