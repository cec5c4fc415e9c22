//! The measurement: every system follows the same frames and traces the same rays.
//!
//! A frame's systems take turns, in an order that shifts by one with every frame
//! and every round, so that a drift of the machine's speed hits all alike. On its
//! turn a system updates and then traces all sets of rays, as a renderer would:
//! its tree is as warm in the caches as its own update left it, and what the
//! system before it left there is gone.

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

/// One update, and the rays traced behind it.
#[derive(Clone, Debug, Serialize)]
pub struct UpdateSample {
    /// Number of the frame.
    pub frame: usize,
    /// Time of the update, until rays can be traced, and of giving memory back behind them.
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

    // Checks, the choice of modes and memory come before any time that counts.
    let first = PaddedFrame::read(source, sequence[0], None)?;
    let second = PaddedFrame::read(source, sequence[1], Some(&first))?;
    let stages = [
        Stage::new(&first, picture, &plan.rays)?,
        Stage::new(&second, picture, &plan.rays)?,
    ];
    for contender in &mut contenders {
        contender.prepare(&stages, plan);
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
            for turn in turns(contenders.len(), round + place) {
                contenders[turn].take_turn(&stage, place > 0);
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

/// All indices below `count`, starting with `first` and wrapping around.
fn turns(count: usize, first: usize) -> impl Iterator<Item = usize> {
    (0..count).map(move |turn| (first + turn) % count)
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
    truths: Vec<Truth>,
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
    output: TraceOutput,
    measurement: SystemMeasurement,
}

impl<'e> Contender<'e> {
    fn new(entry: &'e CatalogEntry, plan: &Plan) -> Self {
        Self {
            entry,
            clock: plan.clock,
            system: None,
            modes: vec![0; plan.rays.len()],
            output: TraceOutput::default(),
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
    fn prepare(&mut self, stages: &[Stage<'_>; 2], plan: &Plan) {
        let make = &self.entry.make;
        let mut output = std::mem::take(&mut self.output);
        self.guarded(|contender| {
            let (made, mut bytes) = held_by(|| make(plan.threads));
            let mut system = made?;
            let mut held_at_most = 0;
            for (place, stage) in stages.iter().enumerate() {
                let (tracer, held) = held_by(|| system.update(stage.frame));
                let tracer = tracer?;
                bytes += held;
                for (index, (set, truth)) in stage.sets.iter().zip(&stage.truths).enumerate() {
                    let modes = tracer.modes(set.kind);
                    if place == 0 {
                        contender.modes[index] =
                            fastest_mode(&*tracer, set, &mut output, plan.clock);
                        contender
                            .measurement
                            .modes
                            .push(modes[contender.modes[index]]);
                    }
                    output.clear(set);
                    trace(&*tracer, contender.modes[index], set, &mut output);
                    contender.measurement.agreement[index].add(
                        stage.frame.mesh,
                        set,
                        truth,
                        &output,
                    );
                }
                held_at_most = held_at_most.max(bytes);
                bytes += held_by(|| drop(tracer)).1;
            }
            let foreign = system.foreign_bytes();
            contender.measurement.bytes = held_at_most as usize + foreign;
            Ok(())
        });
        self.output = output;
    }

    /// Updates to a frame and traces its rays. What comes of it counts only if it is an update.
    fn take_turn(&mut self, stage: &Stage<'_>, counts: bool) {
        let Some(mut system) = self.system.take() else {
            return;
        };
        let mut output = std::mem::take(&mut self.output);
        self.system = self.guarded(|contender| {
            let clock = contender.clock;
            let started = clock();
            let tracer = system.update(stage.frame)?;
            let mut update = clock() - started;
            let mut traces = Vec::with_capacity(stage.sets.len());
            for (index, set) in stage.sets.iter().enumerate() {
                output.clear(set);
                let started = clock();
                trace(&*tracer, contender.modes[index], set, &mut output);
                traces.push(TraceSample {
                    rays: set.rays.len(),
                    ms: milliseconds(clock() - started),
                });
                contender.measurement.agreement[index].add(
                    stage.frame.mesh,
                    set,
                    &stage.truths[index],
                    &output,
                );
            }
            let sah_cost = (!traces.is_empty()).then(|| tracer.sah_cost()).flatten();
            let started = clock();
            drop(tracer);
            update += clock() - started;
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
        self.output = output;
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

/// The mode that takes the least time; every one is warmed up by its first trial.
fn fastest_mode(
    tracer: &dyn Tracer,
    set: &RaySet,
    output: &mut TraceOutput,
    clock: fn() -> Duration,
) -> usize {
    let modes = tracer.modes(set.kind).len();
    if modes < 2 {
        return 0;
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
    let fastest = (0..modes).min_by_key(|&mode| least[mode]);
    fastest.expect("there is at least one mode")
}

fn milliseconds(time: Duration) -> f64 {
    time.as_secs_f64() * 1e3
}
