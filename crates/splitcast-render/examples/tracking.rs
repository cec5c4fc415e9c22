//! Measures trackers beyond what `splitcast track` shows.
//!
//! ```text
//! cargo run --release -p splitcast-render --example tracking -- quality [--threads N] [INPUT ...]
//! cargo run --release -p splitcast-render --example tracking -- growth [--threads N]
//! cargo run --release -p splitcast-render --example tracking -- endurance [--threads N] [INPUT ...]
//! ```
//!
//! `quality`: how long rays take through the tracked tree of each frame, over what they take
//! through a `binned` and through a new `tracked` one; trees take turns, and the best of five counts.
//! `growth`: updates of a deforming body of 10 thousand to 4 million triangles. `endurance`:
//! 10,000 frames, forwards and backwards through an input. Inputs are built-in scenes or anything that holds
//! meshes; without one, the four built-in scenes are measured. Prints tables in Markdown.

use std::time::Instant;

use splitcast::{BuildOptions, Builder, Hit, KdTree, Mesh, Ray, Tracker};
use splitcast_render::BenchmarkRays;
use splitcast_scene::{Frame, FrameSource, MeshSequence, builtin};

/// Whatever went wrong.
type Failure = Box<dyn std::error::Error + Send + Sync>;

/// Primary rays a side of the picture.
const SIDE: u32 = 384;

/// Times that each tree is traced; the fastest counts.
const TURNS: usize = 5;

/// Frames of an endurance run, and how many a row of its table is about.
const FRAMES: usize = 10_000;
const STRETCH: usize = 1000;

fn main() -> Result<(), Failure> {
    let mut threads = 1;
    let mut words = Vec::new();
    let mut arguments = std::env::args().skip(1);
    while let Some(argument) = arguments.next() {
        if argument == "--threads" {
            threads = arguments.next().ok_or("--threads needs a value")?.parse()?;
        } else {
            words.push(argument);
        }
    }
    let mut words = words.into_iter();
    let what = words.next().unwrap_or_default();
    let mut inputs: Vec<String> = words.collect();
    if inputs.is_empty() {
        inputs = builtin::names().map(String::from).collect();
    }
    let pool = rayon::ThreadPoolBuilder::new()
        .num_threads(threads)
        .build()?;
    pool.install(|| match what.as_str() {
        "quality" => quality(&inputs),
        "growth" => growth(),
        "endurance" => endurance(&inputs),
        _ => Err("expected one of: quality, growth, endurance".into()),
    })
}

fn open(input: &str) -> Result<Vec<Frame>, Failure> {
    let mut source: Box<dyn FrameSource> = match builtin::open(input) {
        Some(scene) => scene,
        None => Box::new(MeshSequence::open(input)?),
    };
    let frames = (0..source.frame_count()).map(|frame| source.frame(frame));
    Ok(frames.collect::<Result<_, _>>()?)
}

fn quality(inputs: &[String]) -> Result<(), Failure> {
    println!(
        "| scene | frames | rays | ÷ binned, median | worst | ÷ new tracked, median | worst |"
    );
    println!("|---|---:|---|---:|---:|---:|---:|");
    for input in inputs {
        let mut tracker = Tracker::new(&BuildOptions::default())?;
        // By kind of rays, then by what is compared with.
        let mut ratios: [[Vec<f64>; 2]; 2] = Default::default();
        let frames = open(input)?;
        for frame in &frames {
            let mesh = Mesh::new(&frame.positions, &frame.triangles)?;
            let tracked = tracker.update(mesh)?.tree;
            let build = |builder| {
                let options = BuildOptions {
                    builder,
                    ..BuildOptions::default()
                };
                KdTree::build(mesh, &options)
            };
            let trees = [tracked, build(Builder::Binned)?, build(Builder::Tracked)?];
            let rays = BenchmarkRays::new(&trees[1], SIDE);
            for (kind, rays) in [rays.primary, rays.diffuse].iter().enumerate() {
                let [tracked, binned, new] = times(&trees, rays);
                ratios[kind][0].push(tracked / binned);
                ratios[kind][1].push(tracked / new);
            }
        }
        for (kind, ratios) in ["primary", "diffuse"].iter().zip(&mut ratios) {
            let [binned, new] = ratios.each_mut().map(|ratios| spread(ratios));
            println!(
                "| {input} | {} | {kind} | {:.2} | {:.2} | {:.2} | {:.2} |",
                frames.len(),
                binned.0,
                binned.1,
                new.0,
                new.1
            );
        }
    }
    Ok(())
}

/// Seconds that the rays take through each tree.
fn times(trees: &[KdTree<'_>; 3], rays: &[Ray]) -> [f64; 3] {
    let mut best = [f64::INFINITY; 3];
    let mut hits: Vec<Option<Hit>> = vec![None; rays.len()];
    for _ in 0..TURNS {
        for (tree, best) in trees.iter().zip(&mut best) {
            let start = Instant::now();
            tree.closest_hits(rays, &mut hits);
            *best = best.min(start.elapsed().as_secs_f64());
        }
    }
    best
}

fn growth() -> Result<(), Failure> {
    println!("| triangles | update ms | ns a triangle | exponent | new tree ms |");
    println!("|---:|---:|---:|---:|---:|");
    let mut last: Option<(f64, f64)> = None;
    for rows in [50, 100, 200, 400, 800, 1000] {
        let triangles = body_triangles(rows);
        let mut tracker = Tracker::new(&BuildOptions::default())?;
        let mut times = Vec::new();
        for frame in 0..24 {
            let positions = body_positions(rows, 0.02 * frame as f32);
            let mesh = Mesh::new(&positions, &triangles)?;
            let start = Instant::now();
            let update = tracker.update(mesh)?;
            times.push(start.elapsed().as_secs_f64() * 1e3);
            drop(update);
        }
        let new = times.remove(0);
        let (update, _) = spread(&mut times);
        let count = triangles.len() as f64;
        let exponent = last.map_or(String::from("-"), |(fewer, faster)| {
            format!("{:.2}", (update / faster).ln() / (count / fewer).ln())
        });
        println!(
            "| {} | {update:.2} | {:.1} | {exponent} | {new:.1} |",
            triangles.len(),
            update * 1e6 / count
        );
        last = Some((count, update));
    }
    Ok(())
}

/// A closed body of `rows` bands, each of twice as many squares.
fn body_triangles(rows: u32) -> Vec<[u32; 3]> {
    let columns = 2 * rows;
    let mut triangles = Vec::with_capacity((2 * rows * columns) as usize);
    for row in 0..rows {
        for column in 0..columns {
            let corner =
                |down: u32, right: u32| (row + down) * columns + (column + right) % columns;
            triangles.push([corner(0, 0), corner(1, 0), corner(0, 1)]);
            triangles.push([corner(1, 0), corner(1, 1), corner(0, 1)]);
        }
    }
    triangles
}

/// Waves run over it as `time` goes on.
fn body_positions(rows: u32, time: f32) -> Vec<[f32; 3]> {
    let columns = 2 * rows;
    let mut positions = Vec::with_capacity(((rows + 1) * columns) as usize);
    for row in 0..=rows {
        for column in 0..columns {
            let polar = std::f32::consts::PI * row as f32 / rows as f32;
            let around = std::f32::consts::TAU * column as f32 / columns as f32;
            let wave = (5.0 * polar + 3.0 * time).sin() * (4.0 * around - 2.0 * time).sin();
            let radius = 1.0 + 0.2 * wave * polar.sin();
            positions.push([
                radius * polar.sin() * around.cos(),
                radius * polar.cos(),
                radius * polar.sin() * around.sin(),
            ]);
        }
    }
    positions
}

fn endurance(inputs: &[String]) -> Result<(), Failure> {
    println!(
        "| scene | frames until | update ms, median | SAH ÷ new, median | worst | tree MB | tracker MB |"
    );
    println!("|---|---:|---:|---:|---:|---:|---:|");
    for input in inputs {
        let frames = open(input)?;
        let new_costs = frames.iter().map(|frame| {
            let mesh = Mesh::new(&frame.positions, &frame.triangles)?;
            let options = BuildOptions {
                builder: Builder::Tracked,
                ..BuildOptions::default()
            };
            Ok(KdTree::build(mesh, &options)?.stats().traced_cost)
        });
        let new_costs: Vec<f64> = new_costs.collect::<Result<_, Failure>>()?;
        let there_and_back: Vec<usize> = (0..frames.len())
            .chain((1..frames.len().saturating_sub(1)).rev())
            .collect();
        let mut tracker = Tracker::new(&BuildOptions::default())?;
        let (mut times, mut ratios) = (Vec::new(), Vec::new());
        for (done, &place) in (1..=FRAMES).zip(there_and_back.iter().cycle()) {
            let frame = &frames[place];
            let mesh = Mesh::new(&frame.positions, &frame.triangles)?;
            let update = tracker.update(mesh)?;
            times.push(update.report.time.as_secs_f64() * 1e3);
            ratios.push(update.report.sah_cost / new_costs[place]);
            if done % STRETCH == 0 {
                let (time, _) = spread(&mut times);
                let (ratio, worst) = spread(&mut ratios);
                let megabytes = |bytes: usize| bytes as f64 / 1e6;
                println!(
                    "| {input} | {done} | {time:.2} | {ratio:.3} | {worst:.3} | {:.2} | {:.2} |",
                    megabytes(update.tree.stats().bytes),
                    megabytes(update.report.tracker_bytes)
                );
                times.clear();
                ratios.clear();
            }
        }
    }
    Ok(())
}

/// The median and the largest.
fn spread(values: &mut [f64]) -> (f64, f64) {
    values.sort_by(f64::total_cmp);
    (values[values.len() / 2], values[values.len() - 1])
}
