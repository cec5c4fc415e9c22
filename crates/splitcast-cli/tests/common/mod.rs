//! A folder of one's own, small meshes in it, and the binary run there.

// Every test binary has its own copy of this module and uses its own part of it.
#![allow(dead_code)]

use std::fmt::Write;
use std::fs;
use std::path::{Path, PathBuf};

use assert_cmd::Command;
use serde_json::Value;

/// Flags that make a frame take milliseconds.
pub(crate) const SMALL: &[&str] = &[
    "--size",
    "32x18",
    "--spp",
    "1",
    "--quality",
    "draft",
    "--threads",
    "2",
];

/// A temporary folder that commands run in.
pub(crate) struct Place {
    folder: tempfile::TempDir,
}

/// What a command left behind.
pub(crate) struct Outcome {
    pub(crate) code: i32,
    pub(crate) stdout: String,
    pub(crate) stderr: String,
}

impl Place {
    pub(crate) fn new() -> Self {
        Self {
            folder: tempfile::tempdir().expect("a temporary folder"),
        }
    }

    pub(crate) fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    pub(crate) fn write(&self, name: &str, content: impl AsRef<[u8]>) {
        let path = self.path(name);
        fs::create_dir_all(path.parent().expect("a folder")).expect("a folder");
        fs::write(path, content).expect("a file");
    }

    /// `count` frames of a tetrahedron that moves and turns a little, as ASCII PLY.
    pub(crate) fn write_frames(&self, folder: &str, count: usize) {
        for index in 0..count {
            let x = 0.3 * index as f32;
            self.write(&format!("{folder}/frame_{index:02}.ply"), tetrahedron(x));
        }
    }

    /// `count` frames of a sheet that moves.
    pub(crate) fn write_sheets(&self, folder: &str, count: usize) {
        for frame in 0..count {
            let phase = 0.05 * frame as f32;
            self.write(&format!("{folder}/sheet_{frame}.ply"), sheet(16, phase));
        }
    }

    /// What a file holds as JSON.
    pub(crate) fn json(&self, name: &str) -> Value {
        let bytes = fs::read(self.path(name)).expect("a file");
        serde_json::from_slice(&bytes).expect("JSON")
    }

    pub(crate) fn run(&self, args: &[&str]) -> Outcome {
        let output = Command::cargo_bin("splitcast")
            .expect("the binary")
            .current_dir(self.folder.path())
            .args(args)
            .timeout(std::time::Duration::from_secs(300))
            .output()
            .expect("the binary starts");
        Outcome {
            code: output.status.code().expect("an exit code, no signal"),
            stdout: String::from_utf8(output.stdout).expect("UTF-8"),
            stderr: String::from_utf8(output.stderr).expect("UTF-8"),
        }
    }

    /// Runs `render` with [`SMALL`] and more flags.
    pub(crate) fn render(&self, args: &[&str]) -> Outcome {
        self.run(&[&["render"], SMALL, args].concat())
    }

    /// Names and bytes of a folder's files, in order; folders have no bytes.
    pub(crate) fn contents(&self, folder: &str) -> Vec<(String, Vec<u8>)> {
        let entries = fs::read_dir(self.path(folder)).expect("a folder");
        let mut files: Vec<_> = entries
            .map(|entry| {
                let path = entry.expect("an entry").path();
                let name = path
                    .file_name()
                    .expect("a name")
                    .to_string_lossy()
                    .into_owned();
                let bytes = if path.is_dir() {
                    Vec::new()
                } else {
                    fs::read(&path).expect("a file")
                };
                (name, bytes)
            })
            .collect();
        files.sort();
        files
    }

    pub(crate) fn exists(&self, name: &str) -> bool {
        Path::exists(&self.path(name))
    }
}

impl Outcome {
    /// Asserts success and gives what was printed.
    pub(crate) fn success(self) -> Self {
        assert_eq!(self.code, 0, "{}", self.stderr);
        self
    }
}

/// A tetrahedron at `x` as ASCII PLY.
pub(crate) fn tetrahedron(x: f32) -> String {
    let vertices = [
        [0.0, 0.0, 0.0],
        [1.0, 0.0, 0.2 * x],
        [0.0, 1.0, 0.0],
        [0.2, 0.1, 1.0],
    ];
    let mut text = header(4, 4);
    for [a, b, c] in vertices {
        text.push_str(&format!("{} {b} {c}\n", a + x));
    }
    text + "3 0 2 1\n3 0 1 3\n3 1 2 3\n3 0 3 2\n"
}

/// A bumpy sheet of `2 * n * n` triangles whose bumps move with `phase`, as ASCII PLY.
pub(crate) fn sheet(n: u32, phase: f32) -> String {
    let mut text = header(u64::from((n + 1) * (n + 1)), u64::from(2 * n * n));
    for i in 0..=n {
        for j in 0..=n {
            let (x, y) = (i as f32 / n as f32, j as f32 / n as f32);
            let z = 0.4 * (7.0 * x + phase).sin() * (5.0 * y - phase).cos();
            writeln!(text, "{} {y} {z}", x + 0.1 * phase).unwrap();
        }
    }
    for i in 0..n {
        for j in 0..n {
            let (a, b) = (i * (n + 1) + j, (i + 1) * (n + 1) + j);
            writeln!(text, "3 {a} {b} {}", b + 1).unwrap();
            writeln!(text, "3 {a} {} {}", b + 1, a + 1).unwrap();
        }
    }
    text
}

/// The header of an ASCII PLY.
pub(crate) fn header(vertices: u64, faces: u64) -> String {
    format!(
        "ply\nformat ascii 1.0\nelement vertex {vertices}\n\
         property float x\nproperty float y\nproperty float z\n\
         element face {faces}\nproperty list uchar int vertex_indices\nend_header\n"
    )
}
