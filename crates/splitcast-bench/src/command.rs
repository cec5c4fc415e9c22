//! The command: measures what the arguments ask for and writes the results down.

use std::io::{self, Write};
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use serde::Serialize;
use splitcast::Aabb;
use splitcast_console::{
    Excerpt, FileError, Input, InputError, ProgramError, Progress, ResultFolder, count,
    distinct_names, exit, parse_command_line, table, to_json, warn, write_file,
};
use splitcast_render::{Camera, DEFAULT_FOV_DEGREES, OutputError, Perspective, RenderError};
use splitcast_report::Provenance;
use splitcast_scene::{FrameSource, SceneError, SequenceInfo, builtin};

use crate::args::Args;
use crate::measure::{MeasureError, Plan, SceneMeasurement, measure, wall_clock};
use crate::page;
use crate::rays::{Picture, RaySetKind};
use crate::results::{Ratio, Row};
use crate::systems::{Catalog, Missing};
use crate::terminal;
use crate::workers::pool;

/// Frames in which rays are traced, and updates that are made, if nothing else is asked for.
const SAMPLES: usize = 10;

/// The names of the files in the folder.
const RESULTS: &str = "results.json";
const FRAMES: &str = "frames.json";
const PAGE: &str = "report.html";

/// What is up in a picture.
const UP: [f32; 3] = [0.0, 1.0, 0.0];

/// Why the command ended early.
#[derive(Debug, thiserror::Error)]
enum CommandError {
    #[error("{0}")]
    Usage(String),
    #[error(transparent)]
    Input(#[from] InputError),
    #[error(transparent)]
    Scene(#[from] SceneError),
    #[error("{place}: {source}")]
    Measure {
        place: String,
        source: Box<MeasureError>,
    },
    #[error("{place}: frame {frame} cannot be measured: {reason}")]
    Frame {
        /// The frame's file, or the scene's name.
        place: String,
        frame: usize,
        reason: &'static str,
    },
    #[error(transparent)]
    Picture(#[from] RenderError),
    #[error(transparent)]
    Output(#[from] OutputError),
    #[error(transparent)]
    File(#[from] FileError),
    #[error("the {0} threads could not be started: choose fewer with --threads")]
    Threads(usize),
    #[error("standard output: {0}")]
    Stdout(#[from] io::Error),
}

impl ProgramError for CommandError {
    fn is_usage(&self) -> bool {
        match self {
            Self::Usage(_) => true,
            Self::Input(error) => error.is_usage(),
            Self::Output(error) => error.is_usage(),
            _ => false,
        }
    }

    fn of_stdout(&self) -> Option<&io::Error> {
        match self {
            Self::Stdout(error) => Some(error),
            _ => None,
        }
    }
}

/// Runs the command with the arguments of the process.
pub fn main() -> ExitCode {
    let args = match parse_command_line::<Args>() {
        Ok(args) => args,
        Err(code) => return code,
    };
    exit(run(&args))
}

/// What a run is made with.
#[derive(Clone, Debug, Serialize)]
pub(crate) struct Settings {
    pub(crate) size: (u32, u32),
    pub(crate) threads: Vec<usize>,
    pub(crate) every: Option<usize>,
    pub(crate) rounds: Option<usize>,
}

/// A system that took part.
#[derive(Clone, Debug, Serialize)]
pub(crate) struct SystemInfo {
    pub(crate) name: String,
    pub(crate) family: &'static str,
    pub(crate) about: String,
    pub(crate) yardstick: Option<String>,
}

/// Everything that a run found out.
pub(crate) struct Report {
    pub(crate) machine: Provenance,
    pub(crate) settings: Settings,
    pub(crate) kinds: Vec<RaySetKind>,
    pub(crate) systems: Vec<SystemInfo>,
    pub(crate) missing: Vec<String>,
    pub(crate) scenes: Vec<SceneMeasurement>,
    pub(crate) rows: Vec<Row>,
    pub(crate) ratios: Vec<Ratio>,
}

fn run(args: &Args) -> Result<(), CommandError> {
    let catalog = Catalog::new();
    let mut out = io::stdout().lock();
    if args.list {
        for entry in &catalog.entries {
            writeln!(out, "{}: {}", entry.name, entry.about)?;
        }
        for missing in &catalog.missing {
            writeln!(out, "{missing}")?;
        }
        return Ok(());
    }
    let catalog = catalog.choose(&args.systems).map_err(CommandError::Usage)?;
    let mut threads: Vec<usize> = args.threads.iter().map(|threads| threads.get()).collect();
    threads.sort_unstable();
    threads.dedup();
    let mut kinds = RaySetKind::ALL.to_vec();
    kinds.retain(|kind| args.rays.is_empty() || args.rays.contains(kind));
    let folder = ResultFolder::check(&args.out, &[FRAMES, PAGE], args.json.as_deref())?;
    let inputs = if args.input.is_empty() {
        builtin::names().map(PathBuf::from).collect()
    } else {
        args.input.clone()
    };
    // All of them, before an hour is spent on the first.
    let scenes = inputs.iter().map(|input| Scene::open(input, args.size));
    let mut scenes: Vec<Scene> = scenes.collect::<Result<_, _>>()?;
    let names = distinct_names(scenes.iter().map(|scene| scene.name.clone()));
    for (scene, name) in scenes.iter_mut().zip(names) {
        scene.name = name;
    }
    folder.create()?;
    for missing in &catalog.missing {
        warn(&missing.to_string());
    }
    let mut report = Report {
        machine: Provenance::collect("splitcast-bench", env!("CARGO_PKG_VERSION")),
        settings: Settings {
            size: args.size,
            threads: threads.clone(),
            every: args.every.map(usize::from),
            rounds: args.rounds.map(usize::from),
        },
        kinds,
        systems: Vec::new(),
        missing: catalog.missing.iter().map(Missing::to_string).collect(),
        scenes: Vec::new(),
        rows: Vec::new(),
        ratios: Vec::new(),
    };
    for entry in &catalog.entries {
        writeln!(out, "{}: {}", entry.name, entry.about)?;
        report.systems.push(SystemInfo {
            name: entry.name.clone(),
            family: entry.family,
            about: entry.about.clone(),
            yardstick: entry.yardstick.clone(),
        });
    }
    for scene in &mut scenes {
        for &threads in &threads {
            let measured = scene.measure(&catalog, &report.kinds, args, threads)?;
            let rows = Row::of_scene(&measured, &report.kinds);
            let text = scene_text(&measured, &rows, &report.kinds);
            report.ratios.extend(Ratio::of_rows(&rows, &report.kinds));
            report.rows.extend(rows);
            report.scenes.push(measured);
            // After every scene, and before anything is printed: what was measured is kept if
            // the next one fails, or if nobody reads on.
            report.write(&folder, args.json.as_deref())?;
            out.write_all(text.as_bytes())?;
        }
    }
    if !report.ratios.is_empty() {
        write!(out, "\n{}", terminal::ratios(&report.ratios, &report.kinds))?;
    }
    Ok(writeln!(out, "{}", folder.path(PAGE).display())?)
}

/// What is printed of a scene.
fn scene_text(measured: &SceneMeasurement, rows: &[Row], kinds: &[RaySetKind]) -> String {
    let mut text = format!(
        "\n{}, {} triangles, {}, {}\n{}{}\n",
        measured.scene,
        table::grouped(measured.triangles),
        count(measured.frames, "frame"),
        count(measured.threads, "thread"),
        terminal::systems(rows, kinds),
        terminal::LEGEND,
    );
    for line in troubles(measured) {
        text.push_str(&line);
        text.push('\n');
    }
    text
}

/// What went wrong with systems, in a line each.
pub(crate) fn troubles(scene: &SceneMeasurement) -> Vec<String> {
    let mut lines = Vec::new();
    for system in &scene.systems {
        if let Some(failure) = &system.failure {
            lines.push(format!("{} gave up: {failure}", system.name));
        }
        for wrong in system
            .agreement
            .iter()
            .filter(|agreement| !agreement.agrees())
        {
            lines.push(format!("{} disagrees on {wrong}", system.name));
        }
    }
    lines
}

/// An input that is ready to be measured.
struct Scene {
    name: String,
    place: PathBuf,
    frames: Excerpt,
    picture: Picture,
}

impl Scene {
    fn open(place: &Path, (width, height): (u32, u32)) -> Result<Self, CommandError> {
        let input = Input::open(place)?;
        let range = 0..input.source.frame_count();
        let mut frames = Excerpt::new(input, range);
        let info = SequenceInfo::measure(&mut frames)?;
        for (frame, counts) in info.frames.iter().enumerate() {
            let reason = match counts {
                counts if counts.triangles == 0 => "it has no triangles",
                counts if counts.non_finite > 0 => {
                    "it has vertices at NaN or infinity, which libraries treat differently"
                }
                _ => continue,
            };
            return Err(CommandError::Frame {
                place: frames.place(frame),
                frame,
                reason,
            });
        }
        let aspect = width as f32 / height as f32;
        let view = Perspective::framing(&info.outline, UP, aspect, DEFAULT_FOV_DEGREES)?;
        let bounds = info.bounds.map(|bounds| [bounds.min, bounds.max]);
        let picture = Picture {
            camera: Camera::new(&view)?,
            width,
            height,
            bounds: Aabb::of_points(bounds.as_ref().map_or(&[], |corners| &corners[..])),
        };
        Ok(Self {
            name: info.name,
            place: place.to_owned(),
            frames,
            picture,
        })
    }

    fn measure(
        &mut self,
        catalog: &Catalog,
        kinds: &[RaySetKind],
        args: &Args,
        threads: usize,
    ) -> Result<SceneMeasurement, CommandError> {
        let updates = self.frames.frame_count().max(2) - 1;
        let plan = Plan {
            rays: kinds.to_vec(),
            threads,
            every: args.every.map_or(updates.div_ceil(SAMPLES), usize::from),
            rounds: args.rounds.map_or(SAMPLES.div_ceil(updates), usize::from),
            clock: wall_clock,
        };
        let pool = pool(threads).map_err(|_| CommandError::Threads(threads))?;
        let mut progress = Progress::new("measuring", plan.steps(self.frames.frame_count()));
        let message = format!("{}, {}", self.name, count(threads, "thread"));
        let (frames, picture) = (&mut self.frames, &self.picture);
        let mut step = || progress.step(&message);
        let measured = pool
            .install(|| measure(frames, &catalog.entries, picture, &plan, &mut step))
            .map_err(|source| CommandError::Measure {
                place: self.place.display().to_string(),
                source: Box::new(source),
            })?;
        Ok(SceneMeasurement {
            scene: self.name.clone(),
            ..measured
        })
    }
}

/// What `results.json` and the file of `--json` hold.
#[derive(Serialize)]
struct Results<'a> {
    machine: &'a Provenance,
    settings: &'a Settings,
    systems: &'a [SystemInfo],
    missing: &'a [String],
    results: &'a [Row],
    ratios: &'a [Ratio],
    /// Systems that gave up or disagree, in words.
    troubles: Vec<String>,
}

impl Report {
    /// Writes results, frames and page, each whole or not at all.
    fn write(&self, folder: &ResultFolder, json: Option<&Path>) -> Result<(), CommandError> {
        let troubles = self.scenes.iter().flat_map(|scene| {
            let place = format!("{}, {}", scene.scene, count(scene.threads, "thread"));
            troubles(scene)
                .into_iter()
                .map(move |line| format!("{place}: {line}"))
        });
        let results = to_json(&Results {
            machine: &self.machine,
            settings: &self.settings,
            systems: &self.systems,
            missing: &self.missing,
            results: &self.rows,
            ratios: &self.ratios,
            troubles: troubles.collect(),
        });
        folder.write(RESULTS, results.as_bytes())?;
        let frames = serde_json::to_string(&self.scenes)
            .expect("structures with named fields can always be written as JSON");
        folder.write(FRAMES, frames.as_bytes())?;
        folder.write(PAGE, page::page(self).as_bytes())?;
        if let Some(json) = json {
            write_file(json, results.as_bytes())?;
        }
        Ok(())
    }
}
