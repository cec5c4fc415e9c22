use super::*;

/// A folder with a small mesh under each of the names.
fn folder(names: &[&str]) -> tempfile::TempDir {
    let folder = tempfile::tempdir().expect("a folder");
    for name in names {
        std::fs::write(folder.path().join(name), mesh(name)).expect("a file");
    }
    folder
}

fn mesh(name: &str) -> String {
    if name.ends_with(".obj") {
        return "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n".into();
    }
    "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\n\
     property float z\nelement face 1\nproperty list uchar int vertex_indices\nend_header\n\
     0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n"
        .into()
}

fn names(sequence: &MeshSequence) -> Vec<String> {
    let name = |path: &PathBuf| {
        path.file_name()
            .expect("a name")
            .to_string_lossy()
            .into_owned()
    };
    sequence.files().iter().map(name).collect()
}

fn messages(sequence: &MeshSequence) -> Vec<String> {
    let messages: Vec<_> = sequence
        .warnings()
        .iter()
        .map(ToString::to_string)
        .collect();
    assert!(messages.iter().all(|message| !message.contains('\n')));
    messages
}

#[test]
fn every_kind_of_input_finds_its_files_in_order() {
    let folder = folder(&[
        "run_2.ply",
        "run_10.ply",
        "run_1.ply",
        "notes.txt",
        ".hidden.ply",
        "x.obj",
    ]);
    let open = |input: &str| MeshSequence::open(folder.path().join(input)).expect(input);

    let one = open("run_10.ply");
    assert_eq!(
        (one.name(), names(&one)),
        ("run_10", vec!["run_10.ply".to_owned()])
    );
    assert!(one.warnings().is_empty());

    let all = open("");
    assert_eq!(
        names(&all),
        ["run_1.ply", "run_2.ply", "run_10.ply", "x.obj"]
    );
    let told = messages(&all);
    assert_eq!(told.len(), 2, "{told:?}");
    assert!(
        told[0].contains("3 .ply, 1 .obj") && told[1].contains("x.obj"),
        "{told:?}"
    );

    let glob = open("run_*");
    assert_eq!(glob.name(), "run");
    assert_eq!(names(&glob), ["run_1.ply", "run_2.ply", "run_10.ply"]);
    let told = messages(&glob);
    assert_eq!(told.len(), 1);
    assert!(
        told[0].starts_with("7 frames are missing between run_2.ply and run_10.ply"),
        "{told:?}"
    );

    let told = messages(&open("*"));
    assert!(
        told[0].starts_with("1 matches") && told[0].contains("notes.txt"),
        "{told:?}"
    );

    let pattern = open("run_%d.ply");
    assert_eq!(names(&pattern), ["run_1.ply", "run_2.ply", "run_10.ply"]);
}

#[test]
fn steps_are_no_gaps_but_holes_and_doubles_are_told() {
    let even = folder(&["0100_00.ply", "0110_00.ply", "0120_00.ply"]);
    let even = MeshSequence::open(even.path()).expect("three files");
    assert!(even.warnings().is_empty(), "{:?}", even.warnings());
    let odd = folder(&["f1.ply", "f01.ply", "f2.ply", "f5.ply"]);
    let told = messages(&MeshSequence::open(odd.path()).expect("four files"));
    assert_eq!(told.len(), 2, "{told:?}");
    assert!(
        told[0].contains("same number") && told[1].starts_with("2 frames"),
        "{told:?}"
    );
    let mixed = folder(&["a1_1.ply", "a1_2.ply", "a2_1.ply"]);
    let told = messages(&MeshSequence::open(mixed.path()).expect("three files"));
    assert!(told.len() == 1 && told[0].contains("a2_1.ply"), "{told:?}");
}

#[test]
fn differing_sizes_are_told_before_any_mesh_is_read() {
    let folder = folder(&["f1.ply", "f2.ply", "f3.ply"]);
    let larger = mesh("f2.ply").replace("vertex 3", "vertex 4");
    std::fs::write(folder.path().join("f2.ply"), larger).expect("a file");
    let mut sequence = MeshSequence::open(folder.path()).expect("three files");
    let told = messages(&sequence);
    assert!(
        told.len() == 1 && told[0].contains("3 to 4 vertices"),
        "{told:?}"
    );
    assert!(told[0].contains("f2.ply"), "{told:?}");
    // The second frame is broken, the others are still read.
    assert!(sequence.frame(1).is_err());
    assert!(sequence.frame(2).is_ok());
    assert!(matches!(
        sequence.frame(3),
        Err(SceneError::FrameOutOfRange {
            index: 3,
            count: 3,
            ..
        })
    ));
}

#[test]
fn equal_triangles_are_shared() {
    let folder = folder(&["f1.ply", "f2.obj", "f3.ply", "f4.ply"]);
    let turned = mesh("f3.ply").replace("3 0 1 2", "3 0 2 1");
    std::fs::write(folder.path().join("f3.ply"), turned).expect("a file");
    let mut sequence = MeshSequence::open(folder.path()).expect("four files");
    let triangles: Vec<_> = (0..4)
        .map(|i| sequence.frame(i).expect("a frame").triangles)
        .collect();
    assert!(Arc::ptr_eq(&triangles[0], &triangles[1]));
    assert!(!Arc::ptr_eq(&triangles[1], &triangles[2]));
    assert_eq!(*triangles[2], [[0, 2, 1]]);
}

#[test]
fn wrong_inputs_are_named_with_a_remedy() {
    let folder = folder(&["a.ply", "b.txt"]);
    std::fs::create_dir(folder.path().join("empty")).expect("a folder");
    std::fs::write(folder.path().join("empty/readme.md"), "").expect("a file");
    type Is = fn(&SceneError) -> bool;
    let cases: [(&str, Is, &str); 10] = [
        (
            "nothing.ply",
            |e| matches!(e, SceneError::Missing { .. }),
            "dir/*.ply",
        ),
        (
            "nothing/a_%d.ply",
            |e| matches!(e, SceneError::Missing { .. }),
            "nothing:",
        ),
        (
            "b.txt",
            |e| matches!(e, SceneError::UnknownExtension { .. }),
            ".ply.gz or .obj",
        ),
        (
            "a_%d.txt",
            |e| matches!(e, SceneError::UnknownExtension { .. }),
            ".ply.gz or .obj",
        ),
        (
            "empty",
            |e| matches!(e, SceneError::EmptyFolder { .. }),
            "empty:",
        ),
        (
            "*.obj",
            |e| matches!(e, SceneError::NoMatch { .. }),
            "*.obj:",
        ),
        ("b*", |e| matches!(e, SceneError::NoMatch { .. }), "b*:"),
        (
            "a_%04d.ply",
            |e| matches!(e, SceneError::NoMatch { .. }),
            "a_%04d.ply:",
        ),
        (
            "a_%f.ply",
            |e| matches!(e, SceneError::BadPattern { .. }),
            "%04d",
        ),
        (
            "[a.ply",
            |e| matches!(e, SceneError::BadPattern { .. }),
            "[a.ply:",
        ),
    ];
    for (input, is, part) in cases {
        let error = MeshSequence::open(folder.path().join(input)).expect_err(input);
        let message = error.to_string();
        assert!(is(&error), "{input}: {message}");
        assert!(
            message.contains(part) && !message.contains('\n'),
            "{input}: {message}"
        );
    }
    // A name that looks like a pattern, but exists.
    let odd = folder.path().join("a[1]%d.ply");
    std::fs::write(&odd, mesh("a.ply")).expect("a file");
    assert_eq!(MeshSequence::open(&odd).expect("one file").frame_count(), 1);
}

#[test]
fn what_is_exported_is_read_back() {
    let from = folder(&["pose_7.ply", "pose_8.obj", "pose_9.ply"]);
    let to = tempfile::tempdir().expect("a folder");
    let to = to.path().join("new/folder");
    let mut source = MeshSequence::open(from.path()).expect("three files");
    let mut told = Vec::new();
    let paths = crate::export(&mut source, &to, |index, path| {
        told.push((index, path.to_path_buf()));
    })
    .expect("a writable folder");
    assert_eq!(paths[2], to.join("pose_0002.ply"));
    assert_eq!(told.len(), 3);
    let mut back = MeshSequence::open(to.join("pose_%04d.ply")).expect("three files");
    assert_eq!(back.files(), paths);
    assert!(back.warnings().is_empty());
    for i in 0..3 {
        let (a, b) = (
            source.frame(i).expect("a frame"),
            back.frame(i).expect("a frame"),
        );
        assert_eq!((a.positions, a.triangles), (b.positions, b.triangles));
    }
    let blocked = crate::export(&mut source, from.path().join("pose_7.ply"), |_, _| {});
    assert!(matches!(blocked, Err(SceneError::Write { .. })));
}
