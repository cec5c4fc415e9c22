//! The measurement: every system follows the same frames and traces the same rays.
//!
//! A frame's systems take turns in an order that rotates, so that a drift of the
//! machine's speed hits all alike. On its turn a system updates and then traces all
//! sets of rays, as a renderer would: its tree is as warm in the caches as its own
//! update left it, and what the system before it left there is gone. What it found
//! is compared when its turn is over.

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::{Arc, LazyLock};
use std::time::{Duration, Instant};

use serde::Serialize;
use splitcast::{BuildOptions, KdTree, Mesh};
use splitcast_scene::{Frame, FrameSource, SceneError};

use crate::check::{Agreement, Truth};
use crate::memory::held_by;
use crate::rays::{Picture, RaySet, RaySetKind, ray_sets};
use crate::system::{CatalogEntry, FrameMesh, System, SystemError, Tracer};
use crate::workers::{TraceOutput, trace};

/// How often each mode of a system is tried before the fastest is chosen.
const TRIALS: usize = 3;

/// What is measured, but for the systems.
#[derive(Clone, Debug)]
pub struct Plan {
    /// Sets of rays, in the order in which they are traced.
    pub rays: Vec<RaySetKind>,
    /// Threads of the pool, for systems that start threads of their own.
    pub threads: usize,
    /// Rays are traced in each `every`-th frame, updates are made in all.
    pub every: usize,
    /// How often the whole sequence is gone through.
    pub rounds: usize,
    /// Time since a moment that does not change: [`wall_clock`], unless the
    /// measurement itself is measured.
    pub clock: fn() -> Duration,
}

/// Time since it was first asked for.
pub fn wall_clock() -> Duration {
    static START: LazyLock<Instant> = LazyLock::new(Instant::now);
    START.elapsed()
}

/// Why a scene cannot be measured.
#[derive(Debug, thiserror::Error)]
pub enum MeasureError {
    /// A frame cannot be had.
    #[error(transparent)]
    Scene(#[from] SceneError),
    /// No tree can be built over a frame, so nothing can be compared.
    #[error("frame {frame}: {reason}")]
    Frame {
        /// Its number.
        frame: usize,
        /// What is wrong with it.
        reason: String,
    },
}

/// All systems on one scene with one number of threads.
#[derive(Clone, Debug, Serialize)]
pub struct SceneMeasurement {
    /// Name of the scene.
    pub scene: String,
    /// Threads.
    pub threads: usize,
    /// Triangles of the largest frame.
    pub triangles: usize,
    /// Frames of the sequence.
    pub frames: usize,
    /// The systems, in the catalog's order.
    pub systems: Vec<SystemMeasurement>,
}

/// One system on one scene.
#[derive(Clone, Debug, Serialize)]
pub struct SystemMeasurement {
    /// Its name.
    pub name: String,
    /// The mode that each set was traced in, in the order of the sets.
    pub modes: Vec<&'static str>,
    /// Most bytes that it held after one of the first two updates, the mesh itself not counted.
    pub bytes: usize,
    /// Updates of all frames but the first, in the order in which they were made.
    pub updates: Vec<UpdateSample>,
    /// Whether it found what is there, set by set.
    pub agreement: Vec<Agreement>,
    /// Why it gave up, if it did. Samples from before are kept.
    pub failure: Option<String>,
}

impl SystemMeasurement {
    /// Whether the system followed all frames with right hits.
    pub fn is_sound(&self) -> bool {
        self.failure.is_none() && self.agreement.iter().all(Agreement::agrees)
    }
}

/// One update, and the rays traced behind it.
#[derive(Clone, Debug, Serialize)]
pub struct UpdateSample {
    /// Number of the frame.
    pub frame: usize,
    /// Time of the update, until rays can be traced, and of giving memory back afterwards.
    pub update_ms: f64,
    /// Times of the sets in their order; empty if none was traced.
    pub traces: Vec<TraceSample>,
    /// Expected cost of the tree, if it can be read and rays were traced.
    pub sah_cost: Option<f64>,
}

/// One set of rays, traced.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct TraceSample {
    /// Number of rays.
    pub rays: usize,
    /// Time.
    pub ms: f64,
}

impl TraceSample {
    /// Million rays a second; none where there was no ray.
    pub fn megarays(&self) -> Option<f64> {
        (self.rays > 0).then(|| self.rays as f64 / self.ms / 1e3)
    }
}

impl Plan {
    /// How many steps the measurement of a sequence of so many frames takes.
    pub fn steps(&self, frames: usize) -> usize {
        1 + self.rounds * frames.max(2)
    }
}

/// Measures systems on a scene, on the current rayon pool. `step` is called
/// behind each step.
///
/// A sequence of one frame is taken for one that stands still for two.
///
/// # Errors
/// [`MeasureError`]; systems that fail do not end the measurement.
///
/// # Panics
/// If rays are to be traced in each 0th frame.
pub fn measure(
    source: &mut dyn FrameSource,
    entries: &[CatalogEntry],
    picture: &Picture,
    plan: &Plan,
    step: &mut dyn FnMut(),
) -> Result<SceneMeasurement, MeasureError> {
    let frames = source.frame_count();
    let mut sequence: Vec<usize> = (0..frames).collect();
    if frames == 1 {
        sequence.push(0);
    }
    let mut contenders: Vec<Contender> = entries
        .iter()
        .map(|entry| Contender::new(entry, plan))
        .collect();
    let mut largest = 0;
    // One for each set, shared by all: what a system finds is looked at when its turn is over.
    let mut outputs: Vec<TraceOutput> = Vec::new();
    outputs.resize_with(plan.rays.len(), TraceOutput::default);

    // Checks, the choice of modes and memory come before any time that counts.
    let first = PaddedFrame::read(source, sequence[0], None)?;
    let second = PaddedFrame::read(source, sequence[1], Some(&first))?;
    let stages = [
        Stage::new(&first, picture, &plan.rays)?,
        Stage::new(&second, picture, &plan.rays)?,
    ];
    for contender in &mut contenders {
        contender.prepare(&stages, &mut outputs, plan);
    }
    drop(stages);
    step();

    for round in 0..plan.rounds {
        for contender in &mut contenders {
            contender.restart(plan.threads);
        }
        let mut before = None;
        for (place, &index) in sequence.iter().enumerate() {
            let frame = PaddedFrame::read(source, index, before.as_ref())?;
            largest = largest.max(frame.triangles.len());
            // Behind the first frame, which is not an update, every so many.
            let is_traced = place % plan.every == 1 % plan.every && place > 0;
            let kinds = if is_traced { &plan.rays[..] } else { &[] };
            let stage = Stage::new(&frame, picture, kinds)?;
            for turn in turns(contenders.len(), round, place) {
                contenders[turn].take_turn(&stage, &mut outputs, place > 0);
            }
            before = Some(frame);
            step();
        }
    }
    Ok(SceneMeasurement {
        scene: source.name().to_owned(),
        threads: plan.threads,
        triangles: largest,
        frames,
        systems: contenders
            .into_iter()
            .map(|contender| contender.measurement)
            .collect(),
    })
}

/// An order of all indices below `count`: the first one moves on by one with every frame and
/// round, and from frame to frame they follow each other in other steps, so that nobody is always
/// behind the same one.
fn turns(count: usize, round: usize, place: usize) -> impl Iterator<Item = usize> {
    // Steps without a divisor in common with the count reach everybody.
    let steps = || (1..count.max(2)).filter(move |&step| gcd(step, count) == 1);
    let (first, number) = (round + place, steps().count().max(1));
    let step = steps().nth(first.wrapping_mul(7) % number).unwrap_or(1);
    (0..count).map(move |turn| (first + turn * step) % count)
}

fn gcd(a: usize, b: usize) -> usize {
    if b == 0 { a } else { gcd(b, a % b) }
}

/// A frame as it is handed to the systems.
struct PaddedFrame {
    number: usize,
    /// With one more at the end.
    positions: Vec<[f32; 3]>,
    triangles: Arc<Vec<[u32; 3]>>,
    same_topology: bool,
}

impl PaddedFrame {
    fn read(
        source: &mut dyn FrameSource,
        number: usize,
        before: Option<&Self>,
    ) -> Result<Self, SceneError> {
        let Frame {
            mut positions,
            triangles,
            ..
        } = source.frame(number)?;
        positions.push([0.0; 3]);
        let same_topology = before.is_some_and(|before| {
            Arc::ptr_eq(&before.triangles, &triangles) || before.triangles == triangles
        });
        Ok(Self {
            number,
            positions,
            triangles,
            same_topology,
        })
    }
}

/// A frame with the rays for it and what they hit.
struct Stage<'f> {
    number: usize,
    frame: FrameMesh<'f>,
    sets: Vec<RaySet>,
    truths: Vec<Truth<'f>>,
}

impl<'f> Stage<'f> {
    fn new(
        frame: &'f PaddedFrame,
        picture: &Picture,
        kinds: &[RaySetKind],
    ) -> Result<Self, MeasureError> {
        let number = frame.number;
        let refused = |reason: String| MeasureError::Frame {
            frame: number,
            reason,
        };
        let padded = &frame.positions[..];
        let mesh = Mesh::new(&padded[..padded.len() - 1], &frame.triangles)
            .map_err(|error| refused(error.to_string()))?;
        let (mut sets, mut truths) = (Vec::new(), Vec::new());
        if !kinds.is_empty() {
            let tree = KdTree::build(mesh, &BuildOptions::default())
                .map_err(|error| refused(error.to_string()))?;
            sets = ray_sets(kinds, picture, &tree, number);
            truths = sets.iter().map(|set| Truth::new(set, &tree)).collect();
        }
        Ok(Self {
            number,
            frame: FrameMesh {
                mesh,
                padded_positions: padded,
                same_topology: frame.same_topology,
            },
            sets,
            truths,
        })
    }
}

/// A system with what was measured of it.
struct Contender<'e> {
    entry: &'e CatalogEntry,
    clock: fn() -> Duration,
    /// None once it failed.
    system: Option<Box<dyn System>>,
    /// The mode of each set.
    modes: Vec<usize>,
    measurement: SystemMeasurement,
}

impl<'e> Contender<'e> {
    fn new(entry: &'e CatalogEntry, plan: &Plan) -> Self {
        Self {
            entry,
            clock: plan.clock,
            system: None,
            modes: vec![0; plan.rays.len()],
            measurement: SystemMeasurement {
                name: entry.name.clone(),
                modes: Vec::new(),
                bytes: 0,
                updates: Vec::new(),
                agreement: plan.rays.iter().map(|&kind| Agreement::new(kind)).collect(),
                failure: None,
            },
        }
    }

    /// Makes the system anew, so that a round knows nothing of the one before.
    fn restart(&mut self, threads: usize) {
        self.system = None;
        if self.measurement.failure.is_none() {
            let make = &self.entry.make;
            self.system = self.guarded(|_| make(threads));
        }
    }

    /// Follows two frames with a fresh system: takes its memory, chooses its
    /// modes, checks its hits. Warms everything up, too.
    fn prepare(&mut self, stages: &[Stage<'_>; 2], outputs: &mut [TraceOutput], plan: &Plan) {
        let make = &self.entry.make;
        self.guarded(|contender| {
            let (made, mut held) = held_by(|| make(plan.threads));
            let mut system = made?;
            let mut trials = vec![Vec::new(); plan.rays.len()];
            for stage in stages {
                let (tracer, change) = held_by(|| system.update(stage.frame));
                let tracer = tracer?;
                held += change;
                let (choices, sets) = (&mut contender.modes, stage.sets.iter());
                for (index, set) in sets.enumerate() {
                    try_modes(
                        &*tracer,
                        set,
                        &mut outputs[index],
                        plan.clock,
                        &mut trials[index],
                    );
                    choices[index] = fastest(&trials[index]);
                    outputs[index].clear(set);
                    trace(&*tracer, choices[index], set, &mut outputs[index]);
                }
                let modes = |(set, &mode): (&RaySet, &usize)| tracer.modes(set.kind)[mode];
                contender.measurement.modes =
                    stage.sets.iter().zip(&contender.modes).map(modes).collect();
                let ((), change) = held_by(|| drop(tracer));
                let bytes = held.max(0) as usize + system.foreign_bytes();
                held += change;
                contender.measurement.bytes = contender.measurement.bytes.max(bytes);
                contender.judge(stage, outputs);
            }
            Ok(())
        });
    }

    /// Updates to a frame and traces its rays. What comes of it counts only if it is an update.
    fn take_turn(&mut self, stage: &Stage<'_>, outputs: &mut [TraceOutput], counts: bool) {
        let Some(mut system) = self.system.take() else {
            return;
        };
        // Before the update, so that what it leaves in the caches is still there when rays come.
        for (set, output) in stage.sets.iter().zip(&mut *outputs) {
            output.clear(set);
        }
        self.system = self.guarded(|contender| {
            let clock = contender.clock;
            let started = clock();
            let tracer = system.update(stage.frame)?;
            let mut update = clock() - started;
            let mut traces = Vec::with_capacity(stage.sets.len());
            for (index, (set, output)) in stage.sets.iter().zip(&mut *outputs).enumerate() {
                let started = clock();
                trace(&*tracer, contender.modes[index], set, output);
                traces.push(TraceSample {
                    rays: set.rays.len(),
                    ms: milliseconds(clock() - started),
                });
            }
            let sah_cost = (!traces.is_empty()).then(|| tracer.sah_cost()).flatten();
            let started = clock();
            drop(tracer);
            update += clock() - started;
            contender.judge(stage, outputs);
            if counts {
                contender.measurement.updates.push(UpdateSample {
                    frame: stage.number,
                    update_ms: milliseconds(update),
                    traces,
                    sah_cost,
                });
            }
            Ok(system)
        });
    }

    /// Compares what the system found with what is there.
    fn judge(&mut self, stage: &Stage<'_>, outputs: &[TraceOutput]) {
        let found = stage.sets.iter().zip(&stage.truths).zip(outputs);
        for (agreement, ((set, truth), output)) in self.measurement.agreement.iter_mut().zip(found)
        {
            agreement.add(set, truth, output);
        }
    }

    /// Runs what may fail, or panic inside of a library; notes why it did.
    fn guarded<R>(&mut self, work: impl FnOnce(&mut Self) -> Result<R, SystemError>) -> Option<R> {
        let outcome = catch_unwind(AssertUnwindSafe(|| work(self)));
        let failure = match outcome {
            Ok(Ok(result)) => return Some(result),
            Ok(Err(error)) => error.to_string(),
            Err(panic) => {
                let text = panic.downcast_ref::<String>().map(String::as_str);
                let text = text.or_else(|| panic.downcast_ref::<&str>().copied());
                format!("panicked: {}", text.unwrap_or("no message"))
            }
        };
        self.measurement.failure = Some(failure);
        None
    }
}

/// Adds the least of some trials to the time of each mode. Every one is warmed up by its first.
fn try_modes(
    tracer: &dyn Tracer,
    set: &RaySet,
    output: &mut TraceOutput,
    clock: fn() -> Duration,
    times: &mut Vec<Duration>,
) {
    let modes = tracer.modes(set.kind).len();
    times.resize(modes, Duration::ZERO);
    if modes < 2 {
        return;
    }
    let mut least = vec![Duration::MAX; modes];
    for _ in 0..TRIALS {
        for (mode, least) in least.iter_mut().enumerate() {
            output.clear(set);
            let started = clock();
            trace(tracer, mode, set, output);
            *least = (clock() - started).min(*least);
        }
    }
    times
        .iter_mut()
        .zip(least)
        .for_each(|(time, least)| *time += least);
}

fn fastest(times: &[Duration]) -> usize {
    let modes = 0..times.len();
    let fastest = modes.min_by_key(|&mode| times[mode]);
    fastest.expect("there is at least one mode")
}

fn milliseconds(time: Duration) -> f64 {
    time.as_secs_f64() * 1e3
}

#[cfg(test)]
mod tests {
    use std::collections::HashSet;

    use super::*;

    #[test]
    fn everybody_has_one_turn_goes_first_and_follows_others() {
        for count in 1..25 {
            let (mut firsts, mut pairs) = (HashSet::new(), HashSet::new());
            for place in 0..2 * count * count {
                let order: Vec<usize> = turns(count, 3, place).collect();
                let all: HashSet<usize> = order.iter().copied().collect();
                assert_eq!((order.len(), all.len()), (count, count));
                firsts.insert(order[0]);
                pairs.extend(order.windows(2).map(|pair| (pair[0], pair[1])));
            }
            assert_eq!(firsts.len(), count);
            let steps = (1..count).filter(|&step| gcd(step, count) == 1).count();
            assert_eq!(pairs.len(), count * steps, "of {count} systems");
        }
    }
}
