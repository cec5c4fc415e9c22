//! `splitcast track`: what a tracker's updates take, and how good their trees are.

mod frames;
mod table;

use std::io::{self, Write};

use serde::Serialize;
use splitcast::BuildOptions;
use splitcast_console::{to_json, write_file};
use splitcast_render::check_writable;
use splitcast_report::Provenance;

use crate::args::{TrackArgs, non_finite_name};
use crate::error::CliError;
use crate::scene::Scene;
use crate::threads;

use frames::{FrameFigures, REFERENCE, measure};

/// What `--json` writes.
#[derive(Serialize)]
struct TrackReport {
    machine: Provenance,
    /// Version of the program.
    version: &'static str,
    /// Name of the scene or sequence.
    input: String,
    /// The most triangles of any frame.
    triangles: usize,
    threads: usize,
    non_finite: &'static str,
    /// The builder that every frame was rebuilt with, if any.
    reference: Option<&'static str>,
    /// What a reader of the figures has to know, such as which frames are left out.
    notes: Vec<String>,
    /// The frames that were tracked, in order.
    frames: Vec<FrameFigures>,
}

/// Tracks what the arguments ask for.
pub(crate) fn run(args: &TrackArgs) -> Result<(), CliError> {
    // What can be refused at once comes first, what takes time last.
    if let Some(json) = &args.json {
        check_writable(json)?;
    }
    let threads = threads::number(args.threads);
    let report = threads::start(threads)?.install(|| track(args, threads))?;
    if let Some(json) = &args.json {
        write_file(json, to_json(&report).as_bytes())?;
    }
    Ok(io::stdout()
        .lock()
        .write_all(table::text(&report).as_bytes())?)
}

fn track(args: &TrackArgs, threads: usize) -> Result<TrackReport, CliError> {
    let options = BuildOptions {
        non_finite: args.non_finite,
        ..BuildOptions::default()
    };
    let mut scene = Scene::open(&args.input, args.frames, &options)?;
    let frames = measure(&mut scene, &options, args.reference)?;
    Ok(TrackReport {
        machine: Provenance::collect("splitcast", env!("CARGO_PKG_VERSION")),
        version: env!("CARGO_PKG_VERSION"),
        triangles: scene.info.triangles().1,
        input: scene.name,
        threads,
        non_finite: non_finite_name(args.non_finite),
        reference: args.reference.then(|| REFERENCE.name()),
        notes: scene.notes,
        frames,
    })
}
