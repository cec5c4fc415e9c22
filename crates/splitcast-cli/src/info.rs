//! `splitcast info`: what an input holds.

use std::fmt::Write as _;
use std::io::{self, Write};
use std::path::Path;

use serde::Serialize;
use splitcast_console::table::{self, Align::Right};
use splitcast_console::{Input, to_json};
use splitcast_scene::SequenceInfo;

use crate::error::CliError;

#[derive(Serialize)]
struct InfoReport {
    input: String,
    frames_per_second: f32,
    periodic: bool,
    /// Least and greatest coordinates over the whole motion; absent if no
    /// vertex is finite.
    bounds: Option<[[f32; 3]; 2]>,
    constant_topology: bool,
    /// Frames whose triangles differ from those of the frame before.
    topology_changes: Vec<usize>,
    normals: bool,
    colors: bool,
    frames: Vec<FrameReport>,
}

#[derive(Serialize)]
struct FrameReport {
    frame: usize,
    vertices: usize,
    triangles: usize,
    non_finite_vertices: usize,
    /// Mean way of the vertices since the frame before, as a fraction of the
    /// diagonal of the first frame's box.
    mean_step: Option<f64>,
    /// The longest way of any vertex, likewise.
    max_step: Option<f64>,
}

/// Prints what `input` holds, as text or JSON.
pub(crate) fn run(input: &Path, json: bool) -> Result<(), CliError> {
    let mut input = Input::open(input)?;
    let info = SequenceInfo::measure(input.source.as_mut())?;
    let text = if json {
        to_json(&report(&info))
    } else {
        text(&info)
    };
    Ok(io::stdout().lock().write_all(text.as_bytes())?)
}

fn report(info: &SequenceInfo) -> InfoReport {
    let frames = info.frames.iter().enumerate();
    InfoReport {
        input: info.name.clone(),
        frames_per_second: info.frames_per_second,
        periodic: info.is_periodic,
        bounds: info.bounds.map(|bounds| [bounds.min, bounds.max]),
        constant_topology: info.topology_changes.is_empty(),
        topology_changes: info.topology_changes.clone(),
        normals: info.has_normals,
        colors: info.has_colors,
        frames: frames
            .map(|(index, frame)| FrameReport {
                frame: index,
                vertices: frame.vertices,
                triangles: frame.triangles,
                non_finite_vertices: frame.non_finite,
                mean_step: frame.motion.map(|motion| motion.mean_step),
                max_step: frame.motion.map(|motion| motion.max_step),
            })
            .collect(),
    }
}

fn text(info: &SequenceInfo) -> String {
    let yes_no = |yes| if yes { "yes" } else { "no" };
    let mut lines = vec![
        ("input", info.name.clone()),
        (
            "frames",
            format!(
                "{} at {} a second{}",
                info.frames.len(),
                info.frames_per_second,
                if info.is_periodic { ", a loop" } else { "" }
            ),
        ),
        ("vertices", range(info.vertices())),
        ("triangles", range(info.triangles())),
        (
            "bounds",
            match info.bounds {
                Some(bounds) => format!("{} to {}", vector(bounds.min), vector(bounds.max)),
                None => "none, no vertex is finite".to_owned(),
            },
        ),
        (
            "motion",
            match info.motion() {
                Some(motion) => format!(
                    "{} of the first frame's diagonal a frame on average, {} at most",
                    percent(motion.mean_step),
                    percent(motion.max_step)
                ),
                None => "none, no two frames correspond".to_owned(),
            },
        ),
        (
            "topology",
            match info.topology_changes.as_slice() {
                [] => "constant".to_owned(),
                changes => format!(
                    "changes {} times, first at frame {}",
                    changes.len(),
                    changes[0]
                ),
            },
        ),
        ("normals", yes_no(info.has_normals).to_owned()),
        ("colours", yes_no(info.has_colors).to_owned()),
    ];
    let non_finite: usize = info.frames.iter().map(|frame| frame.non_finite).sum();
    if non_finite > 0 {
        let frames = info
            .frames
            .iter()
            .filter(|frame| frame.non_finite > 0)
            .count();
        lines.push((
            "not finite",
            format!("{non_finite} vertices in {frames} frames; render them with --non-finite skip"),
        ));
    }
    let mut text = String::new();
    for (name, value) in lines {
        writeln!(text, "{name:<10} {value}").expect("writing to a string cannot fail");
    }
    if info.frames.len() > 1 {
        text.push('\n');
        text.push_str(&frame_table(info));
    }
    text
}

fn frame_table(info: &SequenceInfo) -> String {
    let step = |step: Option<f64>| step.map_or("-".to_owned(), percent);
    let rows: Vec<Vec<String>> = info
        .frames
        .iter()
        .enumerate()
        .map(|(index, frame)| {
            vec![
                index.to_string(),
                table::grouped(frame.vertices),
                table::grouped(frame.triangles),
                step(frame.motion.map(|motion| motion.mean_step)),
                step(frame.motion.map(|motion| motion.max_step)),
            ]
        })
        .collect();
    table::layout(
        &[
            ("frame", Right),
            ("vertices", Right),
            ("triangles", Right),
            ("mean step", Right),
            ("max step", Right),
        ],
        &rows,
    )
}

fn range((least, most): (usize, usize)) -> String {
    if least == most {
        table::grouped(least)
    } else {
        format!("{} to {}", table::grouped(least), table::grouped(most))
    }
}

fn vector([x, y, z]: [f32; 3]) -> String {
    format!("({x}, {y}, {z})")
}

fn percent(fraction: f64) -> String {
    format!("{:.2} %", 100.0 * fraction)
}
