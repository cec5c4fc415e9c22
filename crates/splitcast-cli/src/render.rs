//! `splitcast render`: read, build, trace and write, each frame in turn.
//!
//! Three threads work at the same time: one reads ahead, this one builds and
//! traces with all workers of the pool, and one encodes and writes.

use std::io::{self, Write};
use std::path::Path;
use std::time::Instant;

use splitcast::{Aabb, BuildOptions, Builder, SequenceBuilder};
use splitcast_console::{Input, Progress, Watched, count, figure, warn};
use splitcast_render::{
    Camera, Image, OutputOptions, OutputSpec, OutputThread, Perspective, RenderOptions, Renderer,
    Resumed, Settings, Shading, View, check_writable,
};
use splitcast_scene::{Frame, FrameSource, Prefetch, SequenceInfo};

use crate::args::{RenderArgs, non_finite_name};
use crate::error::CliError;
use crate::fingerprint::Fingerprint;
use crate::report::{FrameReport, Report, milliseconds};
use crate::summary::{megarays, summary};
use crate::threads;
use crate::trees::{build_tree, refuse_non_finite};

/// Renders what the arguments ask for.
pub(crate) fn run(args: &RenderArgs) -> Result<(), CliError> {
    let started = Instant::now();
    // What can be refused at once comes first, what takes time or memory last.
    let spec = OutputSpec::parse(&args.out)?;
    let options = render_options(args);
    options.validate()?;
    if let Some(json) = &args.json {
        check_writable(json)?;
    }
    // Built-in scenes are made by the workers too, so these have to stand first.
    let threads = threads::number(args.threads);
    threads::start_global(threads)?;
    let mut input = Input::open(&args.input)?;
    let frames = input.frame_range(args.frames)?;
    let mut output = OutputOptions {
        width: options.width,
        height: options.height,
        frames_per_second: args
            .fps
            .unwrap_or(f64::from(input.source.frames_per_second())),
        frames: frames.clone(),
        threads,
        resume: args.resume,
        settings: Settings::new(),
    };
    spec.check(&output)?;
    check_writable(&spec.frame_path(frames.start))?;

    let (info, content) = measure(input.source.as_mut())?;
    let build = BuildOptions {
        builder: args.builder,
        non_finite: args.non_finite,
        ..BuildOptions::default()
    };
    let mut builder =
        SequenceBuilder::new(&build).map_err(|error| CliError::Usage(error.to_string()))?;
    refuse_non_finite(&mut input, &info, frames.clone(), &build)?;
    let bounds = info.bounds.map_or(Aabb::EMPTY, |bounds| Aabb {
        min: bounds.min,
        max: bounds.max,
    });
    let view = perspective(args, &info.outline)?;
    let renderer = Renderer::new(Camera::new(&view)?, &bounds, options)?;
    output.settings = settings(args, &view, renderer.options(), &info.name, &content);
    let shows_tracking = shows_tracking(args);
    if shows_tracking {
        output.settings = output.settings.with("first frame", frames.start);
    }

    let sink = spec.open(output.clone())?;
    let resumed = sink.resumed().clone();
    tell_resumed(&args.out, args.resume, &resumed);
    let name = info.name.clone();
    let is_open = |&index: &usize| !sink.is_done(index);
    let todo: Vec<usize> = frames.clone().filter(is_open).collect();
    let visited: Vec<usize> = match todo.last() {
        Some(&last) if shows_tracking => (frames.start..=last).collect(),
        _ => todo.clone(),
    };
    let mut writer = OutputThread::new(sink);
    let mut progress = Progress::new("rendering", todo.len());
    let mut reports = Vec::with_capacity(todo.len());
    let place = |index| input.place(index);
    let places: Vec<String> = visited.iter().map(|&index| place(index)).collect();
    let mut finished = None;
    let frames_started = Instant::now();
    for (item, place) in Prefetch::new(input.source, visited).zip(places) {
        let rendered = item.map_err(CliError::from).and_then(|(index, frame)| {
            if todo.binary_search(&index).is_err() {
                build_tree(&frame, &mut builder, index, &place)?;
                return Ok(None);
            }
            let hand_over = || hand_over(&mut writer, finished.take());
            render_frame(&renderer, &mut builder, index, &frame, place, hand_over).map(Some)
        });
        if rendered.is_err() {
            // What was rendered before is kept, for --resume.
            hand_over(&mut writer, finished.take())?;
        }
        let Some((report, image)) = rendered? else {
            continue;
        };
        finished = Some((report.frame, image));
        progress.step(&progress_message(&report));
        reports.push(report);
    }
    hand_over(&mut writer, finished)?;
    progress.finish();
    for (report, times) in reports.iter_mut().zip(writer.finish()?) {
        report.tone_map_ms = milliseconds(times.tone_map);
        report.write_ms = milliseconds(times.write);
    }

    let report = Report {
        input: name,
        out: args.out.display().to_string(),
        version: env!("CARGO_PKG_VERSION"),
        builder: args.builder.name(),
        view: args.view.name(),
        quality: args.quality.name(),
        threads,
        width: output.width,
        height: output.height,
        samples_per_pixel: renderer.options().effective_samples_per_pixel(),
        frames_per_second: output.frames_per_second,
        wall_ms: milliseconds(started.elapsed()),
        frames_ms: milliseconds(frames_started.elapsed()),
        resumed_frames: resumed.whole,
        frames: reports,
    };
    if let Some(json) = &args.json {
        report.write(json)?;
    }
    Ok(io::stdout().lock().write_all(summary(&report).as_bytes())?)
}

fn render_options(args: &RenderArgs) -> RenderOptions {
    RenderOptions {
        width: args.size.0,
        height: args.size.1,
        samples_per_pixel: args.spp,
        quality: args.quality,
        view: args.view,
        shading: if args.flat {
            Shading::Flat
        } else {
            Shading::Smooth
        },
        ground: args.ground,
        up: args.up,
        exposure: args.exposure,
        ..RenderOptions::default()
    }
}

/// Goes through the whole input once: camera and ground have to suit every
/// frame, also when only some are rendered.
fn measure(source: &mut dyn FrameSource) -> Result<(SequenceInfo, String), CliError> {
    let mut progress = Progress::new("measuring", source.frame_count());
    let mut fingerprint = Fingerprint::new();
    let mut watched = Watched {
        source,
        watch: |frame: &Frame| {
            fingerprint.add(frame);
            progress.step("");
        },
    };
    let info = SequenceInfo::measure(&mut watched)?;
    Ok((info, fingerprint.digits()))
}

/// Whether pictures show what a builder has carried over from the frames before, so that
/// it has to see them even if they are rendered already. All other pictures depend on
/// their own frame alone.
fn shows_tracking(args: &RenderArgs) -> bool {
    let shows_tree = !matches!(args.view, View::Beauty | View::Normals);
    let tracks = !matches!(
        args.builder,
        Builder::Binned | Builder::Search | Builder::Sweep
    );
    shows_tree && tracks
}

fn perspective(args: &RenderArgs, outline: &[[f32; 3]]) -> Result<Perspective, CliError> {
    let aspect = args.size.0 as f32 / args.size.1 as f32;
    let framing = Perspective::framing(outline, args.up, aspect, args.fov)?;
    Ok(Perspective {
        eye: args.eye.unwrap_or(framing.eye),
        look_at: args.look_at.unwrap_or(framing.look_at),
        ..framing
    })
}

/// Everything that a frame's pixels depend on.
fn settings(
    args: &RenderArgs,
    view: &Perspective,
    options: &RenderOptions,
    name: &str,
    content: &str,
) -> Settings {
    let vector = |[x, y, z]: [f32; 3]| format!("{x},{y},{z}");
    Settings::new()
        .with("version", env!("CARGO_PKG_VERSION"))
        .with("input", name)
        .with("size", format!("{}x{}", options.width, options.height))
        .with("spp", options.effective_samples_per_pixel())
        .with("quality", options.quality)
        .with("view", options.view)
        .with("shading", options.shading)
        .with("ground", if options.ground { "on" } else { "off" })
        .with("exposure", options.exposure)
        .with("builder", args.builder)
        .with("non-finite", non_finite_name(args.non_finite))
        .with("input's content", content)
        .with("eye", vector(view.eye))
        .with("look-at", vector(view.look_at))
        .with("up", vector(view.up))
        .with("fov", view.vertical_fov_degrees)
}

fn tell_resumed(out: &Path, resume: bool, resumed: &Resumed) {
    if !resume {
        return;
    }
    if let Some(difference) = &resumed.difference {
        warn(&format!(
            "{}: {} of the earlier run not kept: {difference}",
            out.display(),
            count(resumed.stale, "frame"),
        ));
    } else if resumed.whole.is_empty() {
        warn(&format!(
            "{}: nothing to resume, every frame is rendered",
            out.display()
        ));
    }
}

/// Renders a frame. The picture before it is handed over between building and
/// tracing: encoding it would compete for the processors with a build of some
/// milliseconds, and spoil its time.
fn render_frame(
    renderer: &Renderer,
    builder: &mut SequenceBuilder,
    index: usize,
    frame: &Frame,
    place: String,
    hand_over: impl FnOnce() -> Result<(), CliError>,
) -> Result<(FrameReport, Image), CliError> {
    let started = Instant::now();
    let tree = build_tree(frame, builder, index, &place)?;
    let built = Instant::now();
    hand_over()?;
    let tracing = Instant::now();
    let (image, stats) = renderer.render(&tree, frame)?;
    let traced = Instant::now();
    let tree_stats = tree.stats();
    let report = FrameReport {
        frame: index,
        triangles: frame.triangles.len(),
        skipped_triangles: tree.skipped_triangles(),
        build_ms: milliseconds(built - started),
        trace_ms: milliseconds(traced - tracing),
        // Known when it is written.
        tone_map_ms: 0.0,
        write_ms: 0.0,
        rays: stats.rays,
        nodes: tree_stats.nodes,
        references: tree_stats.references,
        sah_cost: tree_stats.sah_cost,
        bytes: tree_stats.bytes,
    };
    Ok((report, image))
}

/// Passes a finished picture on to be encoded and written.
fn hand_over(writer: &mut OutputThread, finished: Option<(usize, Image)>) -> Result<(), CliError> {
    if let Some((index, image)) = finished {
        writer.write(index, image)?;
    }
    Ok(())
}

fn progress_message(report: &FrameReport) -> String {
    format!(
        "frame {}, build {} ms, trace {} ms, {} M rays/s",
        report.frame,
        figure(report.build_ms),
        figure(report.trace_ms),
        figure(megarays(report))
    )
}
