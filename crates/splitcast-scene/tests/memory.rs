//! No file makes its reader take memory out of proportion.

use std::io::Write;

use flate2::{Compression, write::GzEncoder};
use peak_alloc::PeakAlloc;
use splitcast_scene::{FrameSource, MeshSequence, read_mesh};

#[global_allocator]
static MEMORY: PeakAlloc = PeakAlloc;

/// Buffers and bookkeeping of any read, however small the file.
const FIXED: usize = 2 << 20;

/// The most memory that reading a file may take, for each byte of it. The
/// worst honest file has coordinates and indices of one byte, which take four.
const FOR_EACH_BYTE: usize = 16;

/// The same for a compressed file, which may expand 128 times.
const FOR_EACH_PACKED_BYTE: usize = 128 * FOR_EACH_BYTE;

// One test, since the peak is that of the whole process.
#[test]
fn memory_stays_in_proportion_to_the_file() {
    let header = |format: &str, vertices: u64, faces: u64| {
        format!(
            "ply\nformat {format} 1.0\nelement vertex {vertices}\nproperty float x\n\
             property float y\nproperty float z\nelement face {faces}\n\
             property list int int vertex_indices\nend_header\n"
        )
        .into_bytes()
    };
    let binary = "binary_little_endian";
    let zeros = |mut bytes: Vec<u8>, count: usize| {
        bytes.resize(bytes.len() + count, 0);
        bytes
    };
    let huge_list = [
        header(binary, 1, 1),
        vec![0; 12],
        vec![0xff, 0xff, 0xff, 0x7f],
        vec![0; 64],
    ];
    let files: Vec<(&str, Vec<u8>)> = vec![
        ("vertices.ply", header(binary, 4_000_000_000, 1)),
        ("vertices_ascii.ply", header("ascii", 4_000_000_000, 1)),
        ("faces.ply", zeros(header(binary, 1, 4_000_000_000), 1000)),
        ("most.ply", header("ascii", u64::MAX, u64::MAX)),
        ("list.ply", huge_list.concat()),
        ("vertices.ply.gz", gzip(&header(binary, 2_000_000_000, 1))),
        (
            "faces.ply.gz",
            gzip(&zeros(header(binary, 1, 100_000), 1000)),
        ),
        (
            "bomb.ply.gz",
            gzip(&zeros(header(binary, 2_000_000, 1), 64 << 20)),
        ),
        (
            "comment.ply",
            [b"ply\ncomment ".to_vec(), vec![b'x'; 8 << 20]].concat(),
        ),
        (
            "comment.ply.gz",
            gzip(&[b"ply\ncomment ".to_vec(), vec![b'x'; 64 << 20]].concat()),
        ),
        (
            "index.obj",
            b"v 0 0 0\nf 1//2000000000 2000000000//1 1//1\n".to_vec(),
        ),
        (
            "corners.obj",
            [b"v 0 0 0\nf".to_vec(), b" 1".repeat(1 << 20)].concat(),
        ),
        (
            "normals.obj",
            [b"vn 0 0 1\n".repeat(100), b"v 0 0 0\n".repeat(1 << 17)].concat(),
        ),
    ];
    let folder = tempfile::tempdir().expect("a folder");
    for (name, bytes) in files {
        let path = folder.path().join(name);
        std::fs::write(&path, &bytes).expect("a file");
        let packed = name.ends_with(".gz");
        let each = if packed {
            FOR_EACH_PACKED_BYTE
        } else {
            FOR_EACH_BYTE
        };
        let limit = FIXED + each * bytes.len();
        drop(bytes);
        let before = MEMORY.current_usage();
        MEMORY.reset_peak_usage();
        let result = read_mesh(&path);
        let peak = MEMORY.peak_usage() - before;
        assert!(
            peak <= limit,
            "{name}: {peak} bytes, expected at most {limit}"
        );
        match result {
            // The one file that is a mesh, if a strange one.
            Ok(frame) => assert_eq!((name, frame.positions.len()), ("corners.obj", 1)),
            Err(error) => assert!(error.to_string().contains(name), "{error}"),
        }
        MEMORY.reset_peak_usage();
        let sequence = MeshSequence::open(&path).expect("a file that is there");
        assert_eq!(sequence.frame_count(), 1);
        let peak = MEMORY.peak_usage() - before;
        assert!(
            peak <= FIXED,
            "{name}: {peak} bytes to open, expected at most {FIXED}"
        );
    }
}

fn gzip(bytes: &[u8]) -> Vec<u8> {
    let mut encoder = GzEncoder::new(Vec::new(), Compression::best());
    encoder.write_all(bytes).expect("memory");
    encoder.finish().expect("memory")
}
