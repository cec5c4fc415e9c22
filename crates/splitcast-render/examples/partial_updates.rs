//! Measures updates of a scene in which only a part moves, beside full builds.
//!
//! ```text
//! cargo run --release -p splitcast-render --example partial_updates -- [--rounds N] [--threads N] [INPUT ...]
//! ```
//!
//! The scene stands still in the middle frame of an input, but for a run of triangles,
//! as many percent as the table says, which moves on to the next frame and back in
//! steps. An input is a built-in scene or anything that holds meshes; without one, the
//! four built-in scenes are measured. Updates and builds take turns. Prints a table in
//! Markdown; times are medians of wall-clock time.

use std::ops::Range;
use std::time::{Duration, Instant};

use splitcast::{BuildOptions, KdTree, Mesh, Tracker, Update};
use splitcast_scene::{Frame, FrameSource, MeshSequence, builtin};

/// Whatever went wrong.
type Failure = Box<dyn std::error::Error + Send + Sync>;

/// Shares of the triangles that move, in percent.
const MOVING: [usize; 4] = [0, 1, 5, 20];

/// How far on the way to the next frame the moving part is, in turn.
const STEPS: [f32; 6] = [0.2, 0.4, 0.6, 0.8, 0.5, 0.1];

fn main() -> Result<(), Failure> {
    let (mut rounds, mut threads) = (24, 1);
    let mut inputs = Vec::new();
    let mut arguments = std::env::args().skip(1);
    while let Some(argument) = arguments.next() {
        let mut value = || arguments.next().ok_or(format!("{argument} needs a value"));
        match argument.as_str() {
            "--rounds" => rounds = value()?.parse()?,
            "--threads" => threads = value()?.parse()?,
            _ => inputs.push(argument),
        }
    }
    if inputs.is_empty() {
        inputs = builtin::names().map(String::from).collect();
    }
    let pool = rayon::ThreadPoolBuilder::new()
        .num_threads(threads)
        .build()?;
    println!(
        "| scene | triangles | moving | full build ms, {threads} thread(s) | update | ÷ full | update_dirty | ÷ full | kept | SAH ÷ full |"
    );
    println!("|---|---:|---:|---:|---:|---:|---:|---:|---:|---:|");
    for input in &inputs {
        let mut source: Box<dyn FrameSource> = match builtin::open(input) {
            Some(scene) => scene,
            None => Box::new(MeshSequence::open(input)?),
        };
        let middle = source.frame_count() / 2;
        let (still, next) = (source.frame(middle - 1)?, source.frame(middle)?);
        for percent in MOVING {
            pool.install(|| measure(input, &still, &next, percent, rounds))?;
        }
    }
    Ok(())
}

fn measure(
    name: &str,
    still: &Frame,
    next: &Frame,
    percent: usize,
    rounds: usize,
) -> Result<(), Failure> {
    let triangles = still.triangles.len();
    let first = triangles / 3;
    let mut moves = vec![false; still.positions.len()];
    for triangle in &still.triangles[first..first + triangles * percent / 100] {
        for &vertex in triangle {
            moves[vertex as usize] = true;
        }
    }
    // Neighbors that share a vertex with what moves change as well.
    let changes = |triangle: &usize| {
        still.triangles[*triangle]
            .iter()
            .any(|&v| moves[v as usize])
    };
    let changing: Vec<Range<usize>> = (0..triangles).filter(changes).map(|t| t..t + 1).collect();

    let options = BuildOptions::default();
    let mut finding = Tracker::new(&options)?;
    let mut told = Tracker::new(&options)?;
    let [mut builds, mut found, mut dirty] = [const { Vec::new() }; 3];
    let (mut kept, mut ratio) = (0.0, 0.0);
    for round in 0..rounds {
        let step = STEPS[round % STEPS.len()];
        let mut positions = still.positions.to_vec();
        for vertex in (0..positions.len()).filter(|&vertex| moves[vertex]) {
            let (from, to) = (still.positions[vertex], next.positions[vertex]);
            positions[vertex] = std::array::from_fn(|k| from[k] + step * (to[k] - from[k]));
        }
        let mesh = Mesh::new(&positions, &still.triangles)?;
        let started = Instant::now();
        let full = KdTree::build(mesh, &options)?;
        builds.push(started.elapsed());
        let Update { tree, report } = finding.update(mesh)?;
        found.push(report.time);
        dirty.push(told.update_dirty(mesh, &changing)?.report.time);
        kept = report.kept.references as f64 / tree.references().len() as f64;
        ratio = report.sah_cost / full.stats().traced_cost;
    }
    // The first update has nothing to go on.
    let [build, found, dirty] = [builds, found, dirty].map(|times| median(&times[1..]));
    println!(
        "| {name} | {triangles} | {percent} % | {build:.2} | {found:.2} | {:.2} | {dirty:.2} | {:.2} | {:.0} % | {ratio:.3} |",
        found / build,
        dirty / build,
        100.0 * kept
    );
    Ok(())
}

/// The median, in milliseconds.
fn median(times: &[Duration]) -> f64 {
    let mut times = times.to_vec();
    times.sort_unstable();
    times[times.len() / 2].as_secs_f64() * 1e3
}
