//! Building every frame of a scene with every contender, and taking the times.
//!
//! A round goes through all frames in order, each contender with a
//! `SequenceBuilder` of its own. Within a frame the contenders take turns, in an
//! order that shifts by one with every frame and every round, so that a drift of
//! the machine's speed hits all alike. Trees are the same in every round, which
//! is checked; times are medians over the rounds.

use std::time::{Duration, Instant};

use splitcast::{BuildReport, KdTree, SequenceBuilder};
use splitcast_console::{Progress, figure, median};
use splitcast_render::BenchmarkRays;

use super::builds::{BuildFigures, FrameMeasurement, SceneMeasurement};
use super::settings::{Contender, Settings};
use super::survey::Survey;
use crate::error::CliError;
use crate::fingerprint::Fingerprint;
use crate::scene::{FrameAt, Scene};
use crate::trees::build_tree;

/// Primary rays a side of the picture that trees are traced with.
pub(crate) const RAYS_A_SIDE: u32 = 256;

/// Measures a scene; a survey of its tracked trees comes with it.
pub(crate) fn measure(
    scene: &mut Scene,
    settings: &Settings,
) -> Result<(SceneMeasurement, Survey), CliError> {
    let contenders = settings.contenders();
    let frames = scene.measured.clone();
    let mut survey = Survey::default();
    let mut measured: Vec<FrameMeasurement> = Vec::with_capacity(frames.len());
    let mut samples = vec![vec![Samples::default(); contenders.len()]; frames.len()];
    let mut fingerprints = vec![vec![None; contenders.len()]; frames.len()];
    warm_up(scene, settings, &contenders)?;
    let mut progress = Progress::new("measuring", settings.rounds * frames.len());
    for round in 0..settings.rounds {
        let mut builders = builders(settings, &contenders)?;
        for (place, &index) in frames.iter().enumerate() {
            let frame = scene.frame(index)?;
            let at = FrameAt::new(scene, index, &frame);
            let turns = turns(contenders.len(), round + place);
            let trees = build_all(&at, &mut builders, &turns)?;
            let reports: Vec<BuildReport> = builders.iter().map(SequenceBuilder::report).collect();
            for (samples, report) in samples[place].iter_mut().zip(&reports) {
                samples.build.push(milliseconds(report.build_time));
                samples.filter.push(milliseconds(report.filter_time));
            }
            trace_all(&trees, &turns, &mut samples[place]);
            for (turn, tree) in trees.iter().enumerate() {
                check_same(&at, contenders[turn], tree, &mut fingerprints[place][turn])?;
            }
            if round == 0 {
                let mut builds = Vec::with_capacity(contenders.len());
                for (turn, (&contender, tree)) in contenders.iter().zip(&trees).enumerate() {
                    let report = &reports[turn];
                    if Contender::TRACKED.contains(&contender) {
                        survey.add(tree, report);
                    }
                    builds.push(BuildFigures::new(contender, tree, report));
                }
                measured.push(FrameMeasurement {
                    frame: at.number,
                    triangles: frame.triangles.len(),
                    skipped_triangles: trees[0].skipped_triangles(),
                    builds,
                });
            }
            progress.step(&message(&at, round, &contenders, &samples[place]));
        }
    }
    for (frame, samples) in measured.iter_mut().zip(samples) {
        for (build, samples) in frame.builds.iter_mut().zip(samples) {
            build.build_ms = middle(samples.build);
            build.filter_ms = middle(samples.filter);
            build.trace_ms = middle(samples.trace);
        }
    }
    let measurement = SceneMeasurement {
        scene: scene.name.clone(),
        triangles: measured.iter().map(|f| f.triangles).max().unwrap_or(0),
        notes: scene.notes.clone(),
        frames: measured,
    };
    Ok((measurement, survey))
}

/// Times of one contender in one frame, one a round, in milliseconds.
#[derive(Clone, Debug, Default)]
struct Samples {
    build: Vec<f64>,
    filter: Vec<f64>,
    trace: Vec<f64>,
}

/// Builds the first frame once with each contender, so that the first time
/// that counts is not that of cold code and fresh memory.
fn warm_up(
    scene: &mut Scene,
    settings: &Settings,
    contenders: &[Contender],
) -> Result<(), CliError> {
    let index = scene.measured[0];
    let frame = scene.frame(index)?;
    let at = FrameAt::new(scene, index, &frame);
    let mut builders = builders(settings, contenders)?;
    let turns = turns(contenders.len(), 0);
    let trees = build_all(&at, &mut builders, &turns)?;
    trace_all(&trees, &turns, &mut vec![Samples::default(); turns.len()]);
    Ok(())
}

fn builders(
    settings: &Settings,
    contenders: &[Contender],
) -> Result<Vec<SequenceBuilder>, CliError> {
    let contenders = contenders.iter();
    contenders
        .map(|&contender| settings.builder(contender))
        .collect()
}

/// All indices below `count`, starting with `first` and wrapping around.
fn turns(count: usize, first: usize) -> Vec<usize> {
    (0..count).map(|turn| (first + turn) % count).collect()
}

/// Builds a frame with every contender, in turn. The trees come in the order
/// of the builders. Reports are not looked at in between: they take memory, and
/// so would slow down the build behind them.
fn build_all<'f>(
    at: &FrameAt<'f>,
    builders: &mut [SequenceBuilder],
    turns: &[usize],
) -> Result<Vec<KdTree<'f>>, CliError> {
    let mut trees = Vec::with_capacity(turns.len());
    for &turn in turns {
        let tree = build_tree(at.frame, &mut builders[turn], at.number, &at.place)?;
        trees.push((turn, tree));
    }
    trees.sort_by_key(|&(turn, _)| turn);
    Ok(trees.into_iter().map(|(_, tree)| tree).collect())
}

/// Traces the same rays through every tree, in turn.
fn trace_all(trees: &[KdTree<'_>], turns: &[usize], samples: &mut [Samples]) {
    let rays = BenchmarkRays::new(&trees[0], RAYS_A_SIDE);
    for &turn in turns {
        let started = Instant::now();
        BenchmarkRays::trace(&trees[turn], &rays.primary);
        BenchmarkRays::trace(&trees[turn], &rays.diffuse);
        samples[turn].trace.push(milliseconds(started.elapsed()));
    }
}

/// Refuses to go on if a round built another tree than the one before: its
/// times would not be comparable.
fn check_same(
    at: &FrameAt<'_>,
    contender: Contender,
    tree: &KdTree<'_>,
    known: &mut Option<Fingerprint>,
) -> Result<(), CliError> {
    let mut fingerprint = Fingerprint::new();
    fingerprint.add_tree(tree);
    if *known.get_or_insert(fingerprint) == fingerprint {
        return Ok(());
    }
    Err(CliError::Frame {
        index: at.number,
        place: at.place.clone(),
        reason: format!(
            "two rounds built different trees with {}: please report this",
            contender.name()
        ),
    })
}

fn message(
    at: &FrameAt<'_>,
    round: usize,
    contenders: &[Contender],
    samples: &[Samples],
) -> String {
    let time = |wanted: Contender| {
        let index = contenders.iter().position(|&contender| contender == wanted);
        let last = index.and_then(|index| samples[index].build.last());
        last.map_or("-".to_owned(), |&ms| figure(ms))
    };
    format!(
        "frame {}, round {}, normal {} ms, kalman {} ms",
        at.number,
        round + 1,
        time(Contender::Normal),
        time(Contender::Kalman)
    )
}

fn milliseconds(time: Duration) -> f64 {
    time.as_secs_f64() * 1e3
}

fn middle(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    median(&values)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn everybody_has_one_turn_and_the_first_changes() {
        for first in 0..7 {
            let mut turns = turns(5, first);
            assert_eq!(turns[0], first % 5);
            turns.sort_unstable();
            assert_eq!(turns, [0, 1, 2, 3, 4]);
        }
    }
}
