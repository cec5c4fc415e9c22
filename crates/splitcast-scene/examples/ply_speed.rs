//! How fast a plain binary PLY file loads, against a copy of its bytes.
//!
//! ```text
//! cargo run --release -p splitcast-scene --example ply_speed
//! ```
//!
//! Writes a mesh of 500K vertices and 1M triangles to a temporary file, then
//! measures in turn, page cache warm: a memory-to-memory copy of the file's
//! bytes into a new vector, `std::fs::read`, and `read_ply`. Every result is
//! freed before the next measurement. Prints medians and best times with their
//! ratios to the copy. On a busy machine only the best times mean anything:
//! the longer run is the more likely to be interrupted.

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
    for sorted in &mut times {
        sorted.sort_unstable();
    }
    let (best, median) = (0, ROUNDS / 2);
    for (name, taken) in ["memory copy", "fs::read", "read_ply"].iter().zip(&times) {
        let ms = |place: usize| taken[place].as_secs_f64() * 1e3;
        let ratio = |place: usize| ms(place) / (times[0][place].as_secs_f64() * 1e3);
        println!(
            "  {name:<12} median {:>6.2} ms = {:>4.2} x copy   best {:>6.2} ms = {:>4.2} x copy",
            ms(median),
            ratio(median),
            ms(best),
            ratio(best),
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
