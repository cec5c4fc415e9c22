//! What comes of the measurements: rows of the tables, and how we stand to the best peer.

use std::collections::BTreeMap;

use serde::Serialize;
use splitcast_console::{median, percentile};

use crate::measure::{SceneMeasurement, SystemMeasurement, UpdateSample};
use crate::rays::RaySetKind;

/// One system on one scene with one number of threads.
#[derive(Clone, Debug, Serialize)]
pub struct Row {
    /// Name of the scene.
    pub scene: String,
    /// Name of the system.
    pub system: String,
    /// Threads.
    pub threads: usize,
    /// Time of an update.
    pub update_ms: Spread,
    /// Million rays a second by set of rays: the median of the frames that were traced.
    pub mrays: BySet,
    /// Time of an update and one set of rays in the same frame, by that set: median.
    pub frame_ms: BySet,
    /// Memory of the system, the mesh not counted.
    pub bytes: usize,
    /// Updates that were measured.
    pub samples: usize,
    /// Frames of those in which rays were traced.
    pub traced: usize,
    /// Median expected cost of the tree in the system's own units, if it can be read.
    pub sah_cost: Option<f64>,
    /// The way in which each set was traced.
    pub modes: BTreeMap<&'static str, &'static str>,
    /// Whether all hits that were checked are right.
    pub agrees: bool,
    /// Why the system gave up, if it did: the figures are of the frames before.
    pub failure: Option<String>,
}

/// A figure for each set of rays that was traced, by its name.
pub type BySet = BTreeMap<&'static str, f64>;

/// Where a figure lies over the frames.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Spread {
    /// The middle.
    pub median: f64,
    /// The least figure that 95 % of the frames do not exceed.
    pub p95: f64,
    /// The largest.
    pub worst: f64,
}

impl Spread {
    /// Of at least one figure.
    pub(crate) fn of(figures: impl Iterator<Item = f64>) -> Option<Self> {
        let mut sorted: Vec<f64> = figures.collect();
        sorted.sort_by(f64::total_cmp);
        Some(Self {
            worst: *sorted.last()?,
            median: median(&sorted),
            p95: percentile(&sorted, 0.95),
        })
    }
}

impl Row {
    /// The rows of a scene; systems without a single sample have none.
    pub fn of_scene(scene: &SceneMeasurement, kinds: &[RaySetKind]) -> Vec<Self> {
        let systems = scene.systems.iter();
        systems
            .filter_map(|system| Self::new(scene, system, kinds))
            .collect()
    }

    fn new(
        scene: &SceneMeasurement,
        system: &SystemMeasurement,
        kinds: &[RaySetKind],
    ) -> Option<Self> {
        let updates = &system.updates;
        let traced = || updates.iter().filter(|update| !update.traces.is_empty());
        let by_set = |figure: &dyn Fn(&UpdateSample, usize) -> Option<f64>| -> BySet {
            let sets = kinds.iter().enumerate();
            let medians = sets.filter_map(|(set, kind)| {
                let figures = traced().filter_map(|update| figure(update, set));
                Some((kind.name(), Spread::of(figures)?.median))
            });
            medians.collect()
        };
        Some(Self {
            scene: scene.scene.clone(),
            system: system.name.clone(),
            threads: scene.threads,
            update_ms: Spread::of(updates.iter().map(|update| update.update_ms))?,
            mrays: by_set(&|update, set| update.traces[set].megarays()),
            frame_ms: by_set(&|update, set| {
                let trace = &update.traces[set];
                (trace.rays > 0).then_some(update.update_ms + trace.ms)
            }),
            bytes: system.bytes,
            samples: updates.len(),
            traced: traced().count(),
            sah_cost: Spread::of(traced().filter_map(|update| update.sah_cost))
                .map(|spread| spread.median),
            modes: kinds
                .iter()
                .map(|kind| kind.name())
                .zip(system.modes.iter().copied())
                .collect(),
            agrees: system.agreement.iter().all(|agreement| agreement.agrees()),
            failure: system.failure.clone(),
        })
    }

    /// Whether the system followed all frames with right hits. Only then is it compared.
    pub fn is_sound(&self) -> bool {
        self.agrees && self.failure.is_none()
    }

    /// The system's name, and what is wrong with it.
    pub fn label(&self) -> String {
        match (&self.failure, self.agrees) {
            (Some(_), _) => format!("{} (gave up)", self.system),
            (None, false) => format!("{} (wrong hits)", self.system),
            (None, true) => self.system.clone(),
        }
    }

    /// Whether the system is one of ours.
    pub fn is_ours(&self) -> bool {
        self.system.starts_with(OURS)
    }
}

/// How the names of our systems begin.
const OURS: &str = "splitcast-";

/// Our best system against the best peer by one figure.
#[derive(Clone, Debug, Serialize)]
pub struct Ratio {
    /// Name of the scene.
    pub scene: String,
    /// Threads.
    pub threads: usize,
    /// What is compared.
    pub figure: Figure,
    /// The set of rays, unless updates alone are compared.
    pub rays: Option<&'static str>,
    /// The best of our systems.
    pub ours: String,
    /// The best of the others.
    pub peer: String,
    /// Our time over the peer's: below 1 is ahead.
    pub ratio: f64,
}

/// What a [`Ratio`] compares.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Figure {
    /// Median time of an update.
    Update,
    /// Median time of a ray of a set.
    Trace,
    /// Median time of both in one frame.
    Frame,
}

impl Ratio {
    /// All ratios of the rows of one scene and number of threads. Systems that
    /// gave up or have wrong hits do not take part. None where either side is missing.
    pub fn of_rows(rows: &[Row], kinds: &[RaySetKind]) -> Vec<Self> {
        let ratio = |(figure, rays): (Figure, Option<&'static str>)| {
            Self::new(rows, figure, rays, |row| match (figure, rays) {
                (Figure::Trace, Some(kind)) => row.mrays.get(kind).map(|rate| 1.0 / rate),
                (Figure::Frame, Some(kind)) => row.frame_ms.get(kind).copied(),
                _ => Some(row.update_ms.median),
            })
        };
        Self::figures(kinds).filter_map(ratio).collect()
    }

    /// What is compared, in the order of tables: updates, tracing each set, and both.
    pub(crate) fn figures(
        kinds: &[RaySetKind],
    ) -> impl Iterator<Item = (Figure, Option<&'static str>)> {
        let sets = |figure| kinds.iter().map(move |kind| (figure, Some(kind.name())));
        std::iter::once((Figure::Update, None))
            .chain(sets(Figure::Trace))
            .chain(sets(Figure::Frame))
    }

    /// A line for each scene and number of threads, with a ratio in each place of
    /// [`figures`](Self::figures) that has one.
    pub(crate) fn lines<'r>(
        ratios: &'r [Self],
        kinds: &[RaySetKind],
    ) -> Vec<Vec<Option<&'r Self>>> {
        let scenes = ratios.chunk_by(|a, b| (&a.scene, a.threads) == (&b.scene, b.threads));
        let line = |scene: &'r [Self]| {
            let find = |figure| {
                scene
                    .iter()
                    .find(|ratio| (ratio.figure, ratio.rays) == figure)
            };
            Self::figures(kinds).map(find).collect()
        };
        scenes.map(line).collect()
    }

    fn new(
        rows: &[Row],
        figure: Figure,
        rays: Option<&'static str>,
        time: impl Fn(&Row) -> Option<f64>,
    ) -> Option<Self> {
        let best = |ours: bool| {
            let side = rows
                .iter()
                .filter(|row| row.is_sound() && row.is_ours() == ours);
            let times = side.filter_map(|row| Some((row, time(row)?)));
            times.min_by(|a, b| a.1.total_cmp(&b.1))
        };
        let ((ours, our_time), (peer, peer_time)) = (best(true)?, best(false)?);
        Some(Self {
            scene: ours.scene.clone(),
            threads: ours.threads,
            figure,
            rays,
            ours: ours.system.clone(),
            peer: peer.system.clone(),
            ratio: our_time / peer_time,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::measure::TraceSample;

    fn system(name: &str, frames: &[(f64, f64)]) -> SystemMeasurement {
        let update = |(frame, &(update_ms, ms)): (usize, &(f64, f64))| UpdateSample {
            frame,
            update_ms,
            traces: if ms > 0.0 {
                vec![TraceSample { rays: 1000, ms }]
            } else {
                Vec::new()
            },
            sah_cost: None,
        };
        SystemMeasurement {
            name: name.to_owned(),
            modes: vec!["single rays"],
            bytes: 7,
            updates: frames.iter().enumerate().map(update).collect(),
            agreement: Vec::new(),
            failure: None,
        }
    }

    fn scene(systems: Vec<SystemMeasurement>) -> SceneMeasurement {
        SceneMeasurement {
            scene: "scene".to_owned(),
            threads: 1,
            triangles: 1,
            frames: 4,
            systems,
        }
    }

    const KINDS: [RaySetKind; 1] = [RaySetKind::Primary];

    #[test]
    fn figures_are_medians_over_the_frames() {
        let frames = [(1.0, 0.0), (2.0, 0.5), (4.0, 0.0), (9.0, 0.25), (3.0, 1.0)];
        let rows = Row::of_scene(&scene(vec![system("splitcast-a", &frames)]), &KINDS);
        let row = &rows[0];
        let spread = Spread {
            median: 3.0,
            p95: 9.0,
            worst: 9.0,
        };
        assert_eq!(row.update_ms, spread);
        assert_eq!((row.samples, row.traced, row.bytes), (5, 3, 7));
        // 1000 rays in half a millisecond are two million a second.
        assert_eq!(row.mrays["primary"], 2.0);
        // Of 2.5, 9.25 and 4 ms.
        assert_eq!(row.frame_ms["primary"], 4.0);
    }

    #[test]
    fn the_best_of_each_side_are_compared() {
        let systems = vec![
            system("splitcast-slow", &[(8.0, 1.0)]),
            system("splitcast-fast", &[(4.0, 2.0)]),
            system("peer-update", &[(2.0, 9.0)]),
            system("peer-trace", &[(20.0, 0.5)]),
            system("peer-idle", &[]),
        ];
        let rows = Row::of_scene(&scene(systems), &KINDS);
        assert_eq!(rows.len(), 4);
        let ratios = Ratio::of_rows(&rows, &KINDS);
        let told: Vec<_> = (ratios.iter())
            .map(|r| (r.figure, &r.ours[..], &r.peer[..], r.ratio))
            .collect();
        let expected = [
            (Figure::Update, "splitcast-fast", "peer-update", 2.0),
            (Figure::Trace, "splitcast-slow", "peer-trace", 2.0),
            (Figure::Frame, "splitcast-fast", "peer-update", 6.0 / 11.0),
        ];
        assert_eq!(told, expected);
    }

    #[test]
    fn wrong_hits_and_half_a_run_win_nothing() {
        let mut cheat = system("peer-cheat", &[(0.1, 0.1)]);
        let mut wrong = crate::check::Agreement::new(RaySetKind::Primary);
        wrong.hits = 1;
        cheat.agreement.push(wrong);
        let mut quitter = system("peer-quitter", &[(0.1, 0.1)]);
        quitter.failure = Some("too much".to_owned());
        let systems = vec![system("splitcast-a", &[(1.0, 1.0)]), cheat, quitter];
        let rows = Row::of_scene(&scene(systems), &KINDS);
        let labels: Vec<String> = rows.iter().map(Row::label).collect();
        let expected = [
            "splitcast-a",
            "peer-cheat (wrong hits)",
            "peer-quitter (gave up)",
        ];
        assert_eq!(labels, expected);
        assert!(Ratio::of_rows(&rows, &KINDS).is_empty());
    }
}
