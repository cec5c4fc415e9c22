//! `splitcast reproduce`: the builds of Hussain & Grahn 2008, measured on any
//! scene, with their Table I and Figures 3 and 4.

mod builds;
mod figures;
mod measure;
mod nodes;
mod page;
mod paper;
mod rows;
mod scene;
mod settings;
mod survey;
mod terminal;
mod thumbnails;

use std::fs;
use std::io::{self, Write};
use std::path::{Path, PathBuf};

use serde::Serialize;
use splitcast_console::{to_json, warn};
use splitcast_render::check_writable;
use splitcast_report::Provenance;
use splitcast_scene::{builtin, write_atomically};

use crate::args::ReproduceArgs;
use crate::error::CliError;

use builds::SceneMeasurement;
use figures::SceneFigures;
use nodes::NodeTrack;
use page::{ScenePage, page};
use paper::PaperRow;
use rows::{BuilderRow, Row};
use scene::Scene;
pub(crate) use settings::NodePath;
use settings::{Contender, Settings};

/// The page's file name.
const PAGE: &str = "report.html";

/// What `table1.json` holds.
#[derive(Serialize)]
struct TableReport<'a> {
    machine: &'a Provenance,
    settings: &'a Settings,
    seed: u64,
    scenes: Vec<&'a Row>,
    builders: Vec<&'a BuilderRow>,
    paper: &'a [PaperRow],
}

/// What `measurements.json` holds.
#[derive(Serialize)]
struct Measurements<'a> {
    machine: &'a Provenance,
    settings: &'a Settings,
    scenes: &'a [Measured],
}

/// One scene with everything that was measured.
#[derive(Serialize)]
struct Measured {
    #[serde(flatten)]
    scene: SceneMeasurement,
    nodes: Vec<NodeTrack>,
}

/// Measures what the arguments ask for.
pub(crate) fn run(args: &ReproduceArgs) -> Result<(), CliError> {
    // What can be refused at once comes first, what takes time last.
    let settings = Settings::new(args)?;
    check_folder(&args.out)?;
    // A file in the folder that is yet to be made can be written when the folder can.
    if let Some(json) = &args.json
        && json.parent() != Some(&args.out)
    {
        check_writable(json)?;
    }
    let pool = rayon::ThreadPoolBuilder::new()
        .num_threads(settings.threads)
        .build()
        .map_err(|_| CliError::Threads(settings.threads))?;
    // Whatever is timed runs on a worker, so that no build waits for one to wake up.
    let rows = pool.install(|| reproduce(args, &settings))?;
    let mut out = io::stdout().lock();
    out.write_all(terminal::table_1(&rows).as_bytes())?;
    Ok(writeln!(out, "{}", args.out.join(PAGE).display())?)
}

fn reproduce(args: &ReproduceArgs, settings: &Settings) -> Result<Vec<Row>, CliError> {
    let inputs = if args.input.is_empty() {
        builtin::names().map(PathBuf::from).collect()
    } else {
        args.input.clone()
    };
    let builder = settings.builder(Contender::Normal)?;
    let scenes = inputs.iter();
    let scenes = scenes.map(|input| Scene::open(input, args.frames, &builder));
    // All of them, before an hour is spent on the first.
    let mut scenes: Vec<Scene> = scenes.collect::<Result<_, _>>()?;
    distinguish(&mut scenes);
    fs::create_dir_all(&args.out).map_err(|source| file_error(&args.out, source))?;
    check_writable(&args.out.join(PAGE))?;

    let results = Results {
        settings,
        provenance: Provenance::collect("splitcast", env!("CARGO_PKG_VERSION")),
        folder: &args.out,
        json: args.json.as_deref(),
    };
    let (mut measured, mut pages) = (Vec::new(), Vec::new());
    for mut scene in scenes {
        let file = file_name(&scene.name, &pages);
        let (scene_measured, scene_page) = measure_scene(&mut scene, settings, &file)?;
        for figure in scene_page.figures.iter() {
            let path = args.out.join(format!("{}.svg", figure.file));
            write(&path, figure.plot.to_standalone_svg().as_bytes())?;
        }
        measured.push(scene_measured);
        pages.push((file, scene_page));
        // After every scene: what was measured is kept if the next one fails.
        results.write(&measured, &pages)?;
    }
    Ok(pages.into_iter().flat_map(|(_, page)| page.rows).collect())
}

/// Numbers the scenes that have the name of an earlier one, so that rows can be told apart.
fn distinguish(scenes: &mut [Scene]) {
    for later in 1..scenes.len() {
        let (earlier, rest) = scenes.split_at_mut(later);
        let name = rest[0].name.clone();
        let mut number = 1;
        while earlier.iter().any(|scene| scene.name == rest[0].name) {
            number += 1;
            rest[0].name = format!("{name}-{number}");
        }
    }
}

fn measure_scene(
    scene: &mut Scene,
    settings: &Settings,
    file: &str,
) -> Result<(Measured, ScenePage), CliError> {
    let (measurement, survey) = measure::measure(scene, settings)?;
    let mut paths = vec![NodePath::root()];
    if settings.nodes.is_empty() {
        paths.extend(survey.choice());
    } else {
        paths.extend(settings.nodes.iter().cloned());
        paths.sort();
        paths.dedup();
    }
    let nodes = nodes::track(scene, settings, &paths)?;
    for node in nodes.iter().filter(|node| node.axes.is_empty()) {
        warn(&format!(
            "{}: no frame splits the {}",
            scene.name,
            node.path.in_words()
        ));
    }
    let thumbnails = thumbnails::render(scene, settings).unwrap_or_else(|error| {
        // Not worth losing what was measured.
        warn(&format!("{}: no pictures: {error}", scene.name));
        Vec::new()
    });
    let page = ScenePage {
        name: scene.name.clone(),
        rows: Row::of_scene(&measurement),
        builders: BuilderRow::of_scene(&measurement),
        notes: measurement.notes.clone(),
        thumbnails,
        figures: SceneFigures::new(file, &measurement, &nodes),
    };
    let measured = Measured {
        scene: measurement,
        nodes,
    };
    Ok((measured, page))
}

/// Where results go, and what they are labelled with.
struct Results<'a> {
    settings: &'a Settings,
    provenance: Provenance,
    folder: &'a Path,
    json: Option<&'a Path>,
}

impl Results<'_> {
    /// Writes tables, measurements and page, each whole or not at all.
    fn write(&self, measured: &[Measured], pages: &[(String, ScenePage)]) -> Result<(), CliError> {
        let pages = || pages.iter().map(|(_, page)| page);
        let rows = || pages().flat_map(|page| &page.rows);
        let table = to_json(&TableReport {
            machine: &self.provenance,
            settings: self.settings,
            seed: self.settings.seed,
            scenes: rows().collect(),
            builders: pages().flat_map(|page| &page.builders).collect(),
            paper: &paper::TABLE_1,
        });
        let measurements = to_json(&Measurements {
            machine: &self.provenance,
            settings: self.settings,
            scenes: measured,
        });
        let scenes: Vec<&ScenePage> = pages().collect();
        let html = page(&scenes, self.settings, &self.provenance);
        let to = |name: &str| self.folder.join(name);
        write(&to("table1.json"), table.as_bytes())?;
        write(&to("table1.csv"), &csv(rows(), &to("table1.csv"))?)?;
        write(&to("measurements.json"), measurements.as_bytes())?;
        write(&to(PAGE), html.as_bytes())?;
        match self.json {
            Some(json) => write(json, table.as_bytes()),
            None => Ok(()),
        }
    }
}

/// Rows as comma-separated values with a header (RFC 4180).
fn csv<'a>(rows: impl Iterator<Item = &'a Row>, path: &Path) -> Result<Vec<u8>, CliError> {
    let mut writer = csv::Writer::from_writer(Vec::new());
    let mut header = true;
    let failed = |error: csv::Error| file_error(path, io::Error::other(error));
    for row in rows {
        let (names, values): (Vec<_>, Vec<_>) = row.cells().into_iter().unzip();
        if std::mem::take(&mut header) {
            writer.write_record(names).map_err(failed)?;
        }
        writer.write_record(values).map_err(failed)?;
    }
    writer
        .into_inner()
        .map_err(|error| file_error(path, io::Error::other(error.to_string())))
}

/// Finds out whether files can be put into a folder that may not exist yet,
/// and leaves no trace.
fn check_folder(folder: &Path) -> Result<(), CliError> {
    let there = folder.ancestors().find(|path| path.exists());
    let there = there.unwrap_or(Path::new("."));
    Ok(check_writable(&there.join(PAGE))?)
}

/// A scene's name as it may stand in a file's, not taken by an earlier scene.
fn file_name(scene: &str, earlier: &[(String, ScenePage)]) -> String {
    let plain = |c: char| c.is_ascii_alphanumeric() || "-_".contains(c);
    let name: String = scene
        .chars()
        .map(|c| if plain(c) { c } else { '-' })
        .collect();
    let taken = |name: &str| earlier.iter().any(|(file, _)| file == name);
    if !taken(&name) {
        return name;
    }
    let numbered = (2..).map(|number| format!("{name}-{number}"));
    let mut free = numbered.filter(|name| !taken(name));
    free.next().expect("there are more numbers than scenes")
}

fn write(path: &Path, content: &[u8]) -> Result<(), CliError> {
    write_atomically(path, |out| out.write_all(content)).map_err(|source| file_error(path, source))
}

fn file_error(path: &Path, source: io::Error) -> CliError {
    CliError::File {
        path: path.to_owned(),
        source,
    }
}
