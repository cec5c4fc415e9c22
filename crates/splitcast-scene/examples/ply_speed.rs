//! How fast a plain binary PLY file loads, against a copy of its bytes.
//!
//! ```text
//! cargo run --release -p splitcast-scene --example ply_speed
//! ```
//!
//! Writes a mesh of 500K vertices and 1M triangles to a temporary file, then
//! measures in turn, page cache warm: a memory-to-memory copy of the file's
//! bytes into a new vector, `std::fs::read`, and `read_ply`. Every result is
//! freed before the next measurement. Prints medians and the ratios to the
//! copy. Run it alone on the machine.

use std::hint::black_box;
use std::sync::Arc;
use std::time::{Duration, Instant};

use splitcast_scene::{Frame, read_ply, write_ply};

const COLUMNS: u32 = 1000;
const ROWS: u32 = 501;
const ROUNDS: usize = 41;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let plain = grid();
    measure("positions and triangles", &plain)?;
    let attributes = Frame {
        normals: Some(vec![[0.0, 1.0, 0.0]; plain.positions.len()]),
        colors: Some(Arc::new(vec![[200, 180, 40]; plain.positions.len()])),
        ..plain
    };
    measure("with normals and colours", &attributes)
}

fn measure(what: &str, frame: &Frame) -> Result<(), Box<dyn std::error::Error>> {
    let folder = tempfile::tempdir()?;
    let path = folder.path().join("grid.ply");
    write_ply(&path, frame)?;
    let bytes = std::fs::read(&path)?;
    println!(
        "{what}: {} vertices, {} triangles, {:.1} MB; medians of {ROUNDS} rounds",
        frame.positions.len(),
        frame.triangles.len(),
        bytes.len() as f64 / 1e6
    );
    let loaded = read_ply(&path)?;
    assert_eq!(loaded.positions, frame.positions);
    assert_eq!(loaded.triangles, frame.triangles);
    assert_eq!(loaded.normals, frame.normals);
    assert_eq!(loaded.colors, frame.colors);
    drop(loaded);

    let mut times = [const { Vec::new() }; 3];
    for _ in 0..ROUNDS {
        times[0].push(time(|| black_box(&bytes).to_vec()));
        times[1].push(time(|| std::fs::read(&path)));
        times[2].push(time(|| read_ply(&path)));
    }
    let [copy, read, load] = times.map(median);
    for (name, median) in [
        ("memory copy", copy),
        ("fs::read", read),
        ("read_ply", load),
    ] {
        println!(
            "  {name:<12} {:>7.2} ms  {:>5.2} GB/s  {:>5.2} x memory copy",
            median.as_secs_f64() * 1e3,
            bytes.len() as f64 / median.as_secs_f64() / 1e9,
            median.as_secs_f64() / copy.as_secs_f64()
        );
    }
    Ok(())
}

/// A wavy grid.
fn grid() -> Frame {
    let at = |row, column| row * COLUMNS + column;
    let positions = (0..ROWS * COLUMNS)
        .map(|i| {
            let (x, z) = ((i % COLUMNS) as f32 * 0.01, (i / COLUMNS) as f32 * 0.01);
            [x, (x * 3.0).sin() * (z * 2.0).cos(), z]
        })
        .collect();
    let cells = (0..ROWS - 1).flat_map(|row| (0..COLUMNS - 1).map(move |column| (row, column)));
    let triangles = cells
        .flat_map(|(r, c)| {
            let (a, b) = (at(r, c), at(r, c + 1));
            let (d, e) = (at(r + 1, c), at(r + 1, c + 1));
            [[a, d, b], [b, d, e]]
        })
        .collect();
    Frame {
        positions,
        triangles: Arc::new(triangles),
        ..Frame::default()
    }
}

/// Runs once, and frees the result off the clock.
fn time<T>(run: impl FnOnce() -> T) -> Duration {
    let start = Instant::now();
    let result = black_box(run());
    let taken = start.elapsed();
    drop(result);
    taken
}

fn median(mut times: Vec<Duration>) -> Duration {
    times.sort_unstable();
    times[times.len() / 2]
}
