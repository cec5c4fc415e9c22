//! The measuring itself: fake systems with known delays, on a clock of their own,
//! and with wrong hits.

use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;

use splitcast::{Aabb, BuildOptions, KdTree};
use splitcast_bench::{
    CatalogEntry, Figure, FrameMesh, HitChunk, Picture, Plan, Ratio, RayChunk, RaySetKind, Row,
    SceneMeasurement, System, SystemError, Tracer, measure, pool, wall_clock,
};
use splitcast_render::{Camera, DEFAULT_FOV_DEGREES, Perspective};
use splitcast_scene::{Frame, FrameSource, SceneError};

const SIZE: (u32, u32) = (50, 34);

/// What fake systems say that they hold outside of the heap.
const FOREIGN_BYTES: usize = 1 << 36;

/// A square of bumps that rises from frame to frame.
struct Bumps {
    frames: usize,
}

const SIDE: u32 = 12;

impl FrameSource for Bumps {
    fn name(&self) -> &str {
        "bumps"
    }

    fn frame_count(&self) -> usize {
        self.frames
    }

    fn frame(&mut self, index: usize) -> Result<Frame, SceneError> {
        let position = |i: u32| {
            let (x, z) = ((i % SIDE) as f32, (i / SIDE) as f32);
            [x, (x * 1.3).sin() * (z * 0.9 + index as f32).cos(), z]
        };
        let corner = |i: u32| i / (SIDE - 1) * SIDE + i % (SIDE - 1);
        let quads = (0..(SIDE - 1) * (SIDE - 1)).map(corner);
        let triangles = quads.flat_map(|i| [[i, i + SIDE, i + 1], [i + 1, i + SIDE, i + SIDE + 1]]);
        Ok(Frame {
            positions: (0..SIDE * SIDE).map(position).collect(),
            triangles: Arc::new(triangles.collect()),
            ..Frame::default()
        })
    }
}

fn picture() -> Picture {
    let corners = [[0.0, -1.0, 0.0], [SIDE as f32, 1.0, SIDE as f32]];
    let aspect = SIZE.0 as f32 / SIZE.1 as f32;
    let view =
        Perspective::framing(&corners, [0.0, 1.0, 0.0], aspect, DEFAULT_FOV_DEGREES).unwrap();
    Picture {
        camera: Camera::new(&view).unwrap(),
        width: SIZE.0,
        height: SIZE.1,
        bounds: Aabb::of_points(&corners),
    }
}

/// A clock that only moves when a fake system says so. In microseconds.
static CLOCK: AtomicU64 = AtomicU64::new(0);

fn clock() -> Duration {
    Duration::from_micros(CLOCK.load(Ordering::SeqCst))
}

fn pass(microseconds: u64) {
    CLOCK.fetch_add(microseconds, Ordering::SeqCst);
}

/// What a fake system does wrong.
#[derive(Clone, Copy, PartialEq)]
enum Fault {
    None,
    /// Misses what one ray of each chunk hits.
    Miss,
    /// Hits at once where one ray of each chunk hits nothing.
    Phantom,
    /// Says that every hit is one triangle's.
    WrongTriangle,
    /// Refuses the third frame.
    Refuses,
    /// Panics at the third frame.
    Panics,
}

/// In microseconds on the fake clock.
#[derive(Clone, Copy)]
struct Delays {
    /// Of the update of frame `n`: so much times `n`.
    update: u64,
    /// Of giving back a tree.
    drop: u64,
    /// Of tracing a chunk in the first mode; the second takes half of it.
    trace: u64,
}

const AT_ONCE: Delays = Delays {
    update: 0,
    drop: 0,
    trace: 0,
};

/// A tree of ours with delays.
struct Fake {
    delays: Delays,
    fault: Fault,
    frames: u64,
}

struct FakeTracer<'s> {
    tree: KdTree<'s>,
    delays: Delays,
    fault: Fault,
}

impl System for Fake {
    fn update<'s>(&'s mut self, frame: FrameMesh<'s>) -> Result<Box<dyn Tracer + 's>, SystemError> {
        assert_eq!(frame.same_topology, self.frames > 0);
        assert_eq!(
            frame.padded_positions.len(),
            frame.mesh.positions().len() + 1
        );
        pass(self.delays.update * self.frames);
        self.frames += 1;
        match self.fault {
            Fault::Refuses if self.frames == 3 => {
                return Err(SystemError("that is enough".to_owned()));
            }
            Fault::Panics if self.frames == 3 => panic!("that was too much"),
            _ => {}
        }
        Ok(Box::new(FakeTracer {
            tree: KdTree::build(frame.mesh, &BuildOptions::default()).unwrap(),
            delays: self.delays,
            fault: self.fault,
        }))
    }

    fn foreign_bytes(&self) -> usize {
        FOREIGN_BYTES
    }
}

impl Drop for FakeTracer<'_> {
    fn drop(&mut self) {
        pass(self.delays.drop);
    }
}

impl Tracer for FakeTracer<'_> {
    fn modes(&self, _: RaySetKind) -> &'static [&'static str] {
        &["slowly", "fast"]
    }

    fn closest_hits(&self, mode: usize, rays: RayChunk<'_>, mut hits: HitChunk<'_>) {
        pass(self.delays.trace / (1 + mode as u64));
        let mut fault = self.fault;
        hits.fill(rays.rays, |ray| {
            let hit = self.tree.closest_hit(ray).map(|hit| (hit.t, hit.triangle));
            match (fault, hit) {
                (Fault::Miss, Some(_)) => {
                    fault = Fault::None;
                    None
                }
                (Fault::Phantom, None) => {
                    fault = Fault::None;
                    Some((1e-3, 0))
                }
                (Fault::WrongTriangle, Some((t, _))) => Some((t, 0)),
                _ => hit,
            }
        });
    }

    fn occluded(&self, mode: usize, rays: RayChunk<'_>, occluded: &mut [bool]) {
        pass(self.delays.trace / (1 + mode as u64));
        for (ray, occluded) in rays.rays.iter().zip(&mut *occluded) {
            *occluded = self.tree.occluded(ray);
        }
        // Shadows of this scene are all lit or not; one answer is turned around.
        if matches!(self.fault, Fault::Miss | Fault::Phantom) {
            occluded[rays.rays.len() / 2] ^= true;
        }
    }
}

fn fake(name: &str, delays: Delays, fault: Fault) -> CatalogEntry {
    CatalogEntry {
        name: name.to_owned(),
        family: "fake",
        about: String::new(),
        yardstick: None,
        make: Box::new(move |_| {
            Ok(Box::new(Fake {
                delays,
                fault,
                frames: 0,
            }))
        }),
    }
}

fn run(entries: &[CatalogEntry], frames: usize, plan: &Plan) -> SceneMeasurement {
    let mut steps = 0;
    let measured = pool(plan.threads).unwrap().install(|| {
        let mut step = || steps += 1;
        measure(&mut Bumps { frames }, entries, &picture(), plan, &mut step)
    });
    assert_eq!(steps, plan.steps(frames));
    measured.unwrap()
}

fn plan(every: usize, rounds: usize) -> Plan {
    Plan {
        rays: RaySetKind::ALL.to_vec(),
        threads: 1,
        every,
        rounds,
        clock: wall_clock,
    }
}

#[test]
fn known_delays_are_measured_exactly() {
    let delays = |update, trace| Delays {
        update,
        drop: 5,
        trace,
    };
    let entries = [
        fake("splitcast-fake", delays(100, 40), Fault::None),
        fake("fake-peer", delays(50, 80), Fault::None),
    ];
    let plan = Plan {
        clock,
        ..plan(2, 2)
    };
    let measured = run(&entries, 6, &plan);
    assert_eq!((measured.frames, measured.threads), (6, 1));
    let triangles = 2 * (SIDE - 1) * (SIDE - 1);
    assert_eq!(measured.triangles, triangles as usize);
    let rows = Row::of_scene(&measured, &plan.rays);
    for (row, (update, trace)) in rows.iter().zip([(100.0, 40.0), (50.0, 80.0)]) {
        // Frames 1 to 5 of both rounds; those before the first are no updates.
        assert_eq!(row.samples, 10);
        let near = |a: f64, b: f64| assert!((a - b).abs() < 1e-9, "{a} instead of {b}");
        near(row.update_ms.median, (3.0 * update + 5.0) / 1e3);
        near(row.update_ms.worst, (5.0 * update + 5.0) / 1e3);
        near(row.update_ms.p95, row.update_ms.worst);
        // Rays are traced in frames 1, 3 and 5, in the mode that takes half the time.
        assert_eq!(row.traced, 6);
        for kind in RaySetKind::ALL {
            assert_eq!(row.modes[kind.name()], "fast");
            near(
                row.frame_ms[kind.name()],
                (3.0 * update + 5.0 + trace / 2.0) / 1e3,
            );
        }
        // One chunk of rays: the whole picture.
        near(
            row.mrays["primary"],
            f64::from(SIZE.0 * SIZE.1) / (trace / 2.0),
        );
        assert!(row.agrees);
        // What is foreign is told; what else is held depends on the tests beside this one.
        assert!(row.bytes.abs_diff(FOREIGN_BYTES) < FOREIGN_BYTES / 2);
    }
    let ratios = Ratio::of_rows(&rows, &plan.rays);
    let update = &ratios[0];
    assert_eq!((update.figure, update.rays), (Figure::Update, None));
    assert!((update.ratio - 305.0 / 155.0).abs() < 1e-9);
    let trace = ratios.iter().find(|r| r.rays == Some("ao")).unwrap();
    assert!((trace.ratio - 0.5).abs() < 1e-9);
}

#[test]
fn wrong_hits_are_caught() {
    let entries = [
        fake("right", AT_ONCE, Fault::None),
        fake("misses", AT_ONCE, Fault::Miss),
        fake("phantoms", AT_ONCE, Fault::Phantom),
        fake("triangles", AT_ONCE, Fault::WrongTriangle),
    ];
    for threads in [1, 2] {
        let plan = Plan {
            threads,
            ..plan(1, 1)
        };
        let measured = run(&entries, 3, &plan);
        let rows = Row::of_scene(&measured, &plan.rays);
        let agree: Vec<bool> = rows.iter().map(|row| row.agrees).collect();
        assert_eq!(agree, [true, false, false, false]);
        let bad = |system: usize| {
            let sets = measured.systems[system].agreement.iter();
            let bad = sets.filter(|set| !set.agrees());
            bad.map(|set| set.kind).collect::<Vec<_>>()
        };
        use RaySetKind::{Ao, Diffuse, Primary, Random, Shadow};
        assert_eq!(bad(1), [Primary, Shadow, Ao, Diffuse, Random]);
        assert_eq!(bad(2), [Primary, Shadow, Ao, Diffuse, Random]);
        assert_eq!(bad(3), [Primary, Diffuse, Random]);
    }
}

#[test]
fn systems_that_fail_do_not_end_the_measurement() {
    let entries = [
        fake("refuses", AT_ONCE, Fault::Refuses),
        fake("panics", AT_ONCE, Fault::Panics),
        fake("goes-on", AT_ONCE, Fault::None),
    ];
    let measured = run(&entries, 4, &plan(1, 1));
    let told = |system: usize| {
        let system = &measured.systems[system];
        (system.updates.len(), system.failure.as_deref())
    };
    // Frames 0 and 1 were followed, and the first is no update.
    assert_eq!(told(0), (1, Some("that is enough")));
    assert_eq!(told(1), (1, Some("panicked: that was too much")));
    assert_eq!(told(2), (3, None));
}

#[test]
fn a_single_frame_stands_still() {
    let entries = [fake("still", AT_ONCE, Fault::None)];
    let measured = run(&entries, 1, &plan(7, 3));
    assert_eq!(measured.systems[0].updates.len(), 3);
    assert!(
        measured.systems[0]
            .updates
            .iter()
            .all(|update| update.traces.len() == 5)
    );
}

#[test]
fn delays_of_the_wall_clock_are_not_shorter_than_they_are() {
    struct Sleeper(Fake);
    impl System for Sleeper {
        fn update<'s>(
            &'s mut self,
            frame: FrameMesh<'s>,
        ) -> Result<Box<dyn Tracer + 's>, SystemError> {
            std::thread::sleep(Duration::from_millis(3));
            self.0.update(frame)
        }
    }
    let make = || {
        Sleeper(Fake {
            delays: AT_ONCE,
            fault: Fault::None,
            frames: 0,
        })
    };
    let entry = CatalogEntry {
        make: Box::new(move |_| Ok(Box::new(make()))),
        ..fake("sleeper", AT_ONCE, Fault::None)
    };
    let measured = run(&[entry], 3, &plan(1, 1));
    assert!(
        measured.systems[0]
            .updates
            .iter()
            .all(|update| update.update_ms >= 3.0)
    );
}
