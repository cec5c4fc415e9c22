//! `splitcast reproduce`: the builds of Hussain & Grahn 2008, measured on any
//! scene, with their Table I and Figures 3 and 4.

mod builds;
mod figures;
mod measure;
mod nodes;
mod page;
mod paper;
mod rows;
mod settings;
mod survey;
mod terminal;
mod thumbnails;

use std::io::{self, Write};
use std::path::{Path, PathBuf};

use serde::Serialize;
use splitcast_console::{
    FileError, ResultFolder, count, distinct_names, to_json, warn, write_file,
};
use splitcast_report::Provenance;
use splitcast_scene::builtin;

use crate::args::ReproduceArgs;
use crate::error::CliError;
use crate::scene::Scene;
use crate::threads;

use builds::SceneMeasurement;
use figures::SceneFigures;
use nodes::NodeTrack;
use page::{ScenePage, page};
use paper::PaperRow;
use rows::{BuilderRow, Row};
pub(crate) use settings::NodePath;
use settings::{Contender, Settings};

/// The names of the files in the folder, beside those of figures.
const TABLE: &str = "table1.json";
const CSV: &str = "table1.csv";
const MEASUREMENTS: &str = "measurements.json";
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
    let folder = ResultFolder::check(&args.out, &[CSV, MEASUREMENTS, PAGE], args.json.as_deref())?;
    let pool = threads::start(settings.threads)?;
    let rows = pool.install(|| reproduce(args, &settings, &folder))?;
    let mut out = io::stdout().lock();
    out.write_all(terminal::table_1(&rows).as_bytes())?;
    Ok(writeln!(out, "{}", args.out.join(PAGE).display())?)
}

fn reproduce(
    args: &ReproduceArgs,
    settings: &Settings,
    folder: &ResultFolder,
) -> Result<Vec<Row>, CliError> {
    let inputs = if args.input.is_empty() {
        builtin::names().map(PathBuf::from).collect()
    } else {
        args.input.clone()
    };
    let options = settings.options(Contender::Normal);
    let scenes = inputs.iter();
    let scenes = scenes.map(|input| {
        let mut scene = Scene::open(input, args.frames, &options)?;
        annotate(&mut scene)?;
        Ok(scene)
    });
    // All of them, before an hour is spent on the first.
    let mut scenes: Vec<Scene> = scenes.collect::<Result<_, CliError>>()?;
    let names = distinct_names(scenes.iter().map(|scene| scene.name.clone()));
    for (scene, name) in scenes.iter_mut().zip(names) {
        scene.name = name;
    }
    folder.create()?;

    let results = Results {
        settings,
        provenance: Provenance::collect("splitcast", env!("CARGO_PKG_VERSION")),
        folder,
        json: args.json.as_deref(),
    };
    let (mut measured, mut pages) = (Vec::new(), Vec::new());
    let files = distinct_names(scenes.iter().map(|scene| file_name(&scene.name)));
    for (mut scene, file) in scenes.into_iter().zip(files) {
        let (scene_measured, scene_page) = measure_scene(&mut scene, settings, &file)?;
        for figure in scene_page.figures.iter() {
            let name = format!("{}.svg", figure.file);
            folder.write(&name, figure.plot.to_standalone_svg().as_bytes())?;
        }
        measured.push(scene_measured);
        pages.push(scene_page);
        // After every scene: what was measured is kept if the next one fails.
        results.write(&measured, &pages)?;
    }
    Ok(pages.into_iter().flat_map(|page| page.rows).collect())
}

/// Adds what a reader of running builds has to know.
fn annotate(scene: &mut Scene) -> Result<(), CliError> {
    if let [only] = scene.measured[..] {
        scene.notes.push(format!(
            "Only frame {} is measured, so there is no running build, and every figure of one \
             is missing.",
            scene.number(only)
        ));
    }
    let changes = scene.topology_changes()?;
    if let Some(&first) = changes.first() {
        scene.notes.push(format!(
            "The triangles change {}, first at frame {}. Tracking goes on across such a \
             change, since it follows planes and not vertices.",
            count(changes.len(), "time"),
            scene.number(first)
        ));
    }
    Ok(())
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
    folder: &'a ResultFolder,
    json: Option<&'a Path>,
}

impl Results<'_> {
    /// Writes tables, measurements and page, each whole or not at all.
    fn write(&self, measured: &[Measured], pages: &[ScenePage]) -> Result<(), CliError> {
        let rows = || pages.iter().flat_map(|page| &page.rows);
        let table = to_json(&TableReport {
            machine: &self.provenance,
            settings: self.settings,
            seed: self.settings.seed,
            scenes: rows().collect(),
            builders: pages.iter().flat_map(|page| &page.builders).collect(),
            paper: &paper::TABLE_1,
        });
        let measurements = to_json(&Measurements {
            machine: &self.provenance,
            settings: self.settings,
            scenes: measured,
        });
        let scenes: Vec<&ScenePage> = pages.iter().collect();
        let html = page(&scenes, self.settings, &self.provenance);
        let csv = csv(rows())
            .map_err(|error| FileError::new(&self.folder.path(CSV), io::Error::other(error)))?;
        self.folder.write(TABLE, table.as_bytes())?;
        self.folder.write(CSV, &csv)?;
        self.folder.write(MEASUREMENTS, measurements.as_bytes())?;
        self.folder.write(PAGE, html.as_bytes())?;
        if let Some(json) = self.json {
            write_file(json, table.as_bytes())?;
        }
        Ok(())
    }
}

/// Rows as comma-separated values with a header (RFC 4180).
fn csv<'a>(rows: impl Iterator<Item = &'a Row>) -> Result<Vec<u8>, csv::Error> {
    let mut writer = csv::Writer::from_writer(Vec::new());
    let mut header = true;
    for row in rows {
        let (names, values): (Vec<_>, Vec<_>) = row.cells().into_iter().unzip();
        if std::mem::take(&mut header) {
            writer.write_record(names)?;
        }
        writer.write_record(values)?;
    }
    let bytes = writer.into_inner();
    Ok(bytes.map_err(csv::IntoInnerError::into_error)?)
}

/// A scene's name as it may stand in a file's.
fn file_name(scene: &str) -> String {
    let plain = |c: char| c.is_ascii_alphanumeric() || "-_".contains(c);
    let plain = |c: char| if plain(c) { c } else { '-' };
    scene.chars().map(plain).collect()
}
