//! Measures the full builders side by side: build time, tree quality and trace
//! rate, on the middle frame of each scene.
//!
//! ```text
//! cargo run --release -p splitcast-render --example builders -- [--rounds N] [--threads N] [--simd NAME] [INPUT ...]
//! ```
//!
//! An input is a built-in scene or anything that holds meshes; without one, the
//! four built-in scenes are measured. Builders take turns within a round, so
//! that a drift of the machine's speed hits all alike. Rays are traced on one
//! thread. Prints a table in Markdown; times are medians of wall-clock time.

use std::time::Instant;

use splitcast::{BuildOptions, Builder, KdTree, Mesh, Ray, force_simd};
use splitcast_render::BenchmarkRays;
use splitcast_scene::{Frame, FrameSource, MeshSequence, builtin};

/// Whatever went wrong.
type Failure = Box<dyn std::error::Error + Send + Sync>;

/// Primary rays a side of the picture.
const SIDE: u32 = 384;

/// What was asked for on the command line.
struct Request {
    rounds: usize,
    threads: usize,
    inputs: Vec<String>,
}

fn main() -> Result<(), Failure> {
    let request = parse_arguments()?;
    let pool = rayon::ThreadPoolBuilder::new()
        .num_threads(request.threads)
        .build()?;
    println!(
        "| scene | triangles | builder | build ms, {} thread(s) | SAH cost | ÷ sweep | references a triangle | primary Mray/s | diffuse Mray/s |",
        request.threads
    );
    println!("|---|---:|---|---:|---:|---:|---:|---:|---:|");
    for input in &request.inputs {
        let frame = middle_frame(input)?;
        pool.install(|| measure(input, &frame, request.rounds))?;
    }
    Ok(())
}

fn parse_arguments() -> Result<Request, Failure> {
    let mut request = Request {
        rounds: 11,
        threads: 1,
        inputs: Vec::new(),
    };
    let mut arguments = std::env::args().skip(1);
    while let Some(argument) = arguments.next() {
        let mut value = || arguments.next().ok_or(format!("{argument} needs a value"));
        match argument.as_str() {
            "--rounds" => request.rounds = value()?.parse()?,
            "--threads" => request.threads = value()?.parse()?,
            "--simd" => force_simd(Some(value()?.parse()?))?,
            _ => request.inputs.push(argument),
        }
    }
    if request.inputs.is_empty() {
        request.inputs = builtin::names().map(String::from).collect();
    }
    Ok(request)
}

fn middle_frame(input: &str) -> Result<Frame, Failure> {
    let mut source: Box<dyn FrameSource> = match builtin::open(input) {
        Some(scene) => scene,
        None => Box::new(MeshSequence::open(input)?),
    };
    Ok(source.frame(source.frame_count() / 2)?)
}

fn measure(name: &str, frame: &Frame, rounds: usize) -> Result<(), Failure> {
    let mesh = Mesh::new(&frame.positions, &frame.triangles)?;
    let mut times = vec![Vec::new(); Builder::ALL.len()];
    let mut trees: Vec<Option<KdTree<'_>>> = vec![None; Builder::ALL.len()];
    for _ in 0..rounds.max(1) {
        for (index, &builder) in Builder::ALL.iter().enumerate() {
            let options = BuildOptions {
                builder,
                ..BuildOptions::default()
            };
            // The old tree goes first, as it does when frames follow each other.
            trees[index] = None;
            let start = Instant::now();
            let tree = KdTree::build(mesh, &options)?;
            times[index].push(start.elapsed().as_secs_f64() * 1e3);
            trees[index] = Some(tree);
        }
    }
    let reference = Builder::ALL.iter().position(|&b| b == Builder::Sweep);
    let stats = |tree: &Option<KdTree<'_>>| tree.as_ref().map(KdTree::stats);
    let reference = reference.and_then(|index| stats(&trees[index]));
    for (index, builder) in Builder::ALL.iter().enumerate() {
        let (Some(tree), Some(reference)) = (&trees[index], &reference) else {
            continue;
        };
        let stats = tree.stats();
        let (primary, diffuse) = trace_rates(tree);
        println!(
            "| {name} | {} | {builder} | {:.2} | {:.2} | {:.3} | {:.2} | {primary:.2} | {diffuse:.2} |",
            frame.triangles.len(),
            median(&mut times[index]),
            stats.sah_cost,
            stats.sah_cost / reference.sah_cost,
            stats.references as f64 / frame.triangles.len().max(1) as f64,
        );
    }
    Ok(())
}

/// Million rays a second, primary and diffuse.
fn trace_rates(tree: &KdTree<'_>) -> (f64, f64) {
    let rays = BenchmarkRays::new(tree, SIDE);
    let rate = |rays: &[Ray]| {
        let start = Instant::now();
        BenchmarkRays::trace(tree, rays);
        rays.len() as f64 / start.elapsed().as_secs_f64() / 1e6
    };
    (rate(&rays.primary), rate(&rays.diffuse))
}

fn median(values: &mut [f64]) -> f64 {
    values.sort_by(f64::total_cmp);
    values[values.len() / 2]
}
