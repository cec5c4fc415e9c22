//! `splitcast scenes`: what is built in, and its export as mesh files.

use std::io::{self, Write};
use std::path::Path;

use serde::Serialize;
use splitcast_console::table::{
    self,
    Align::{Left, Right},
};
use splitcast_console::{Progress, scene_names, to_json};
use splitcast_scene::builtin;

use crate::error::CliError;

#[derive(Serialize)]
struct SceneList {
    scenes: Vec<Scene>,
}

#[derive(Serialize)]
struct Scene {
    name: &'static str,
    triangles: usize,
    frames: usize,
    frames_per_second: f32,
    periodic: bool,
    description: &'static str,
}

/// Prints the built-in scenes.
pub(crate) fn list(json: bool) -> Result<(), CliError> {
    let scenes: Vec<Scene> = builtin::list()
        .iter()
        .map(|scene| Scene {
            name: scene.name,
            triangles: scene.triangles,
            frames: scene.frames,
            frames_per_second: scene.frames_per_second,
            periodic: scene.periodic,
            description: scene.description,
        })
        .collect();
    let text = if json {
        to_json(&SceneList { scenes })
    } else {
        let rows: Vec<Vec<String>> = scenes
            .iter()
            .map(|scene| {
                vec![
                    scene.name.to_owned(),
                    table::grouped(scene.triangles),
                    scene.frames.to_string(),
                    format!(
                        "{}{}",
                        if scene.periodic { "loop: " } else { "" },
                        scene.description
                    ),
                ]
            })
            .collect();
        table::layout(
            &[
                ("name", Left),
                ("triangles", Right),
                ("frames", Right),
                ("description", Left),
            ],
            &rows,
        )
    };
    Ok(io::stdout().lock().write_all(text.as_bytes())?)
}

/// Writes a built-in scene into a folder as PLY files.
pub(crate) fn export(name: &str, folder: &Path) -> Result<(), CliError> {
    let mut source = builtin::open(name).ok_or_else(|| {
        CliError::Usage(format!(
            "{name}: no such built-in scene; expected one of: {}",
            scene_names()
        ))
    })?;
    let mut progress = Progress::new("exporting", source.frame_count());
    let files = splitcast_scene::export(source.as_mut(), folder, |_, _| progress.step(""))?;
    progress.finish();
    let (first, last) = (&files[0], &files[files.len() - 1]);
    Ok(writeln!(
        io::stdout().lock(),
        "{} frames: {} to {}",
        files.len(),
        first.display(),
        last.file_name().unwrap_or_default().to_string_lossy()
    )?)
}
