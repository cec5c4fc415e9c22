use std::fmt::Write as _;

use proptest::prelude::*;

use super::*;

fn read(text: &[u8]) -> Result<Frame, SceneError> {
    read_lines(Path::new("mesh.obj"), text)
}

const SQUARE: &str = "# a square\no square\nv 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\n\
    vt 0 0\nvn 0 0 2\ng front\nusemtl paint\nf 1//1 2//1 3//1 4//1\n";

#[test]
fn every_way_to_name_a_corner() {
    let same = |text: &str| {
        let frame = read(text.as_bytes()).expect(text);
        assert_eq!(frame.positions[2], [1.0, 1.0, 0.0], "{text}");
        assert_eq!(*frame.triangles, [[0, 1, 2], [0, 2, 3]], "{text}");
        frame
    };
    let frame = same(SQUARE);
    assert_eq!(frame.normals.expect("normals")[..], [[0.0, 0.0, 1.0]; 4]);
    for face in [
        "f 1 2 3 4",
        "f 1/1 2/1 3/1 4/1",
        "f -4/-1/-1 -3/1/1 3/1/1 4/1/1",
        "f 1/ 2// 3/1/ 4\nl 1 2\np 1",
        "f 1 2 \\\n 3 4",
        "f 1 2 3\ng other\nf 1 3 4",
    ] {
        same(&SQUARE.replace("f 1//1 2//1 3//1 4//1", face));
    }
    same(&SQUARE.replace('\n', "\r\n"));
    same(&SQUARE.replace("v 0 1 0", "v 0 1 0 1.0"));
    // A face may stand before its vertices.
    let lines: Vec<&str> = SQUARE.lines().collect();
    let turned: Vec<&str> = lines.iter().rev().take(1).chain(&lines).copied().collect();
    let frame = read(turned.join("\n").as_bytes()).expect("a good file");
    assert_eq!(frame.triangles.len(), 4);
}

#[test]
fn attributes_count_only_where_every_vertex_has_them() {
    let colors = |text: &str| read(text.as_bytes()).expect(text).colors;
    let colored = SQUARE.replace(" 0\nv", " 0 1 0.5 -3\nv");
    assert_eq!(colors(&colored).expect("colours")[..], [[255, 128, 0]; 4]);
    assert!(colors(&colored.replace("v 0 1 0 1 0.5 -3", "v 0 1 0")).is_none());
    let odd = colored.replace("v 0 1 0 1 0.5 -3", "v 0 1 0 1 nan 7 0");
    assert_eq!(colors(&odd).expect("colours")[3], [0, 255, 0]);
    let normals = |text: &str| read(text.as_bytes()).expect(text).normals;
    let hard = format!("{SQUARE}vn 1 0 0\nf 1//2 2//2 3//2\n");
    assert!(normals(&hard).is_none());
    let copy = format!("{SQUARE}vn 0 0 2\nf 1//2 2//2 3//2\n");
    assert!(normals(&copy).is_some());
    let bare = format!("{SQUARE}f 1 2 3\n");
    assert!(normals(&bare).is_none());
    let unused = format!("v 9 9 9\n{}", SQUARE.replace("4//1", "5//1"));
    assert_eq!(normals(&unused).expect("normals")[3], [0.0; 3]);
}

#[test]
fn mistakes_are_named_with_file_and_line() {
    type Is = fn(&SceneError) -> bool;
    let face = "f 1//1 2//1 3//1 4//1";
    let cases: [(&str, &str, Is, &str); 16] = [
        (
            face,
            "f 1 2",
            |e| matches!(e, SceneError::Polygon { corners: 2, .. }),
            "line 11",
        ),
        (
            face,
            "f",
            |e| matches!(e, SceneError::Polygon { corners: 0, .. }),
            "line 11",
        ),
        (
            face,
            "f 1 2 5",
            |e| matches!(e, SceneError::IndexOutOfRange { index: 5, .. }),
            "line 11: index 5",
        ),
        (
            face,
            "f 1 2 0",
            |e| matches!(e, SceneError::IndexOutOfRange { index: 0, .. }),
            "1 to 4",
        ),
        (
            face,
            "f 1 2 -5",
            |e| matches!(e, SceneError::IndexOutOfRange { index: -5, .. }),
            "-1 to -4",
        ),
        (
            face,
            "f 1 2 9223372036854775807",
            |e| matches!(e, SceneError::IndexOutOfRange { .. }),
            "line 11",
        ),
        (
            face,
            "f 1 2 -9223372036854775808",
            |e| matches!(e, SceneError::IndexOutOfRange { .. }),
            "line 11",
        ),
        (
            face,
            "f 1//1 2//1 3//2",
            |e| matches!(e, SceneError::IndexOutOfRange { index: 2, .. }),
            "1 normals",
        ),
        (
            face,
            "f 1 2 x",
            |e| matches!(e, SceneError::Value { .. }),
            "line 11: found \"x\"",
        ),
        (
            face,
            "f 1 2 3/1/1/1",
            |e| matches!(e, SceneError::Value { .. }),
            "1/2/3",
        ),
        (
            face,
            "",
            |e| matches!(e, SceneError::NoGeometry { .. }),
            "no triangles",
        ),
        (
            "v 1 1 0",
            "v 1 1",
            |e| matches!(e, SceneError::Value { .. }),
            "line 5: found 2 values",
        ),
        (
            "v 1 1 0",
            "v 1 1 0 0 0 0 0 0",
            |e| matches!(e, SceneError::Value { .. }),
            "line 5",
        ),
        (
            "v 1 1 0",
            "v 1 1 0,5",
            |e| matches!(e, SceneError::Value { .. }),
            "line 5: found \"0,5\", expected a number",
        ),
        (
            "vn 0 0 2",
            "vn 0 0",
            |e| matches!(e, SceneError::Value { .. }),
            "line 8: found the end",
        ),
        (
            "# a square",
            "\0\0\0",
            |e| matches!(e, SceneError::NotAMesh { .. }),
            "line 1",
        ),
    ];
    for (from, to, is_kind, part) in cases {
        let error = read(SQUARE.replace(from, to).as_bytes()).expect_err(to);
        let message = error.to_string();
        assert!(is_kind(&error), "{to}: {message}");
        assert!(
            message.starts_with("mesh.obj: ") && message.contains(part),
            "{message}"
        );
        assert!(!message.chars().any(char::is_control), "{message:?}");
    }
    for text in ["", "hello\nworld\n", "{\"a\": 1}"] {
        let error = read(text.as_bytes()).expect_err(text);
        assert!(matches!(error, SceneError::NotAMesh { .. }), "{error}");
    }
    let faces = read(b"f 1 2 3\n").expect_err("no vertices");
    assert!(
        matches!(
            faces,
            SceneError::NoGeometry {
                what: "vertices",
                ..
            }
        ),
        "{faces}"
    );
}

proptest! {
    #[test]
    fn the_maintained_parser_agrees(
        positions in prop::collection::vec(prop::array::uniform3(-1e6_f32..1e6), 4..30),
        faces in prop::collection::vec(
            prop::collection::vec(any::<prop::sample::Index>(), 3..5), 1..60),
        relative in any::<bool>(),
    ) {
        let mut text = String::new();
        for [x, y, z] in &positions {
            writeln!(text, "v {x} {y} {z}").expect("memory");
        }
        for face in &faces {
            text.push('f');
            for corner in face {
                let corner = corner.index(positions.len()) as i64;
                let back = positions.len() as i64;
                let index = if relative { corner - back } else { corner + 1 };
                write!(text, " {index}").expect("memory");
            }
            text.push('\n');
        }
        let frame = read(text.as_bytes()).expect("a good file");
        let options = tobj::LoadOptions { triangulate: false, ..Default::default() };
        let (models, _) = tobj::load_obj_buf(&mut text.as_bytes(), &options, |_| {
            Ok(Default::default())
        }).expect("a good file");
        // It renumbers vertices by first use: compare where corners lie.
        let mesh = &models[0].mesh;
        let mut theirs = mesh.indices.iter().map(|&i| {
            let at = 3 * i as usize;
            [mesh.positions[at], mesh.positions[at + 1], mesh.positions[at + 2]]
        });
        let mut ours = frame.triangles.iter();
        for face in &faces {
            let sorted = |mut corners: Vec<[f32; 3]>| {
                corners.sort_by(|a, b| a.partial_cmp(b).expect("finite"));
                corners.dedup();
                corners
            };
            let triangles = ours.by_ref().take(face.len() - 2).flatten();
            let ours = triangles.map(|&i| frame.positions[i as usize]).collect();
            prop_assert_eq!(sorted(ours), sorted(theirs.by_ref().take(face.len()).collect()));
        }
        prop_assert!(ours.next().is_none() && theirs.next().is_none());
    }

    #[test]
    fn damaged_files_never_panic(
        changes in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..6),
        cut in any::<prop::sample::Index>(),
    ) {
        let mut bytes = SQUARE.replace("f 1", "f -1/1/1 1/1/1 2/1/1\nf 1").into_bytes();
        for (at, value) in changes {
            let at = at.index(bytes.len());
            bytes[at] = value;
        }
        bytes.truncate(bytes.len() - cut.index(20));
        match read(&bytes) {
            Ok(frame) => {
                let vertices = frame.positions.len() as u32;
                prop_assert!(frame.triangles.as_flattened().iter().all(|&i| i < vertices));
            }
            Err(error) => {
                prop_assert!(!error.to_string().chars().any(char::is_control));
            }
        }
    }
}
