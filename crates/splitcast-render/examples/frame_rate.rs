//! Measures how many pictures a second a motion can be shown in: its trees updated, the pictures traced
//! and brought to a display's bytes. Nothing is encoded beside them.
//!
//! ```text
//! cargo run --release -p splitcast-render --example frame_rate -- [--rounds N] [--threads N] [--size N] [--quality NAME] [INPUT ...]
//! ```
//!
//! An input is a built-in scene or anything that holds meshes; without one, the four
//! built-in scenes are measured. Pictures are 16 by 9, `--size` is their height. All
//! frames are played in their order, `--rounds` times. Prints a table in Markdown; times
//! are medians over all pictures, of wall-clock time.

use std::time::{Duration, Instant};

use splitcast::{Aabb, BuildOptions, Mesh, Tracker};
use splitcast_render::{Camera, Perspective, Quality, RenderOptions, Renderer};
use splitcast_scene::{Frame, FrameSource, MeshSequence, SequenceInfo, builtin};

/// Whatever went wrong.
type Failure = Box<dyn std::error::Error + Send + Sync>;

/// The vertical field of view in degrees, that of the command line.
const FIELD_OF_VIEW: f32 = 24.0;

fn main() -> Result<(), Failure> {
    let (mut rounds, mut threads, mut height) = (5, 2, 720);
    let mut quality = Quality::Preview;
    let mut inputs = Vec::new();
    let mut arguments = std::env::args().skip(1);
    while let Some(argument) = arguments.next() {
        let mut value = || arguments.next().ok_or(format!("{argument} needs a value"));
        match argument.as_str() {
            "--rounds" => rounds = value()?.parse()?,
            "--threads" => threads = value()?.parse()?,
            "--size" => height = value()?.parse()?,
            "--quality" => quality = value()?.parse()?,
            _ => inputs.push(argument),
        }
    }
    if inputs.is_empty() {
        inputs = builtin::names().map(String::from).collect();
    }
    let options = RenderOptions {
        width: height * 16 / 9,
        height,
        quality,
        ..RenderOptions::default()
    };
    let pool = rayon::ThreadPoolBuilder::new()
        .num_threads(threads)
        .build()?;
    println!(
        "| scene | triangles | update ms, {threads} thread(s) | picture ms | Mray | frames/s |"
    );
    println!("|---|---:|---:|---:|---:|---:|");
    for input in &inputs {
        let mut source: Box<dyn FrameSource> = match builtin::open(input) {
            Some(scene) => scene,
            None => Box::new(MeshSequence::open(input)?),
        };
        let info = SequenceInfo::measure(source.as_mut())?;
        let frames: Result<Vec<_>, _> =
            (0..source.frame_count()).map(|i| source.frame(i)).collect();
        pool.install(|| measure(input, &info, &frames?, &options, rounds))?;
    }
    Ok(())
}

fn measure(
    name: &str,
    info: &SequenceInfo,
    frames: &[Frame],
    options: &RenderOptions,
    rounds: usize,
) -> Result<(), Failure> {
    let aspect = options.width as f32 / options.height as f32;
    let view = Perspective::framing(&info.outline, options.up, aspect, FIELD_OF_VIEW)?;
    let bounds = info.bounds.as_ref().map_or(Aabb::EMPTY, |bounds| Aabb {
        min: bounds.min,
        max: bounds.max,
    });
    let renderer = Renderer::new(Camera::new(&view)?, &bounds, options.clone())?;
    let mut tracker = Tracker::new(&BuildOptions::default())?;
    let [mut updates, mut pictures, mut totals] = [const { Vec::new() }; 3];
    let mut rays = 0;
    for frame in frames.iter().cycle().take(rounds.max(1) * frames.len()) {
        let mesh = Mesh::new(&frame.positions, &frame.triangles)?;
        let started = Instant::now();
        let update = tracker.update(mesh)?;
        let updated = Instant::now();
        let (bytes, stats) = renderer.render_srgb8(&update.tree, frame)?;
        let shown = Instant::now();
        std::hint::black_box(bytes);
        updates.push(updated - started);
        pictures.push(shown - updated);
        totals.push(shown - started);
        rays += stats.rays;
    }
    println!(
        "| {name} | {} | {:.2} | {:.2} | {:.2} | {:.1} |",
        frames.first().map_or(0, |frame| frame.triangles.len()),
        median(&mut updates),
        median(&mut pictures),
        rays as f64 / totals.len().max(1) as f64 / 1e6,
        1e3 / median(&mut totals),
    );
    Ok(())
}

/// In milliseconds.
fn median(values: &mut [Duration]) -> f64 {
    values.sort();
    let middle = values.get(values.len() / 2).copied();
    middle.unwrap_or_default().as_secs_f64() * 1e3
}
