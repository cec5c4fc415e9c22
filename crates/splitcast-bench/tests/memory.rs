//! Memory as it is measured: what a system and its tracer hold together. A program of
//! its own, since all threads count.

use std::sync::Arc;

use splitcast::Aabb;
use splitcast_bench::{
    CatalogEntry, FrameMesh, HitChunk, Picture, Plan, RayChunk, System, SystemError, Tracer,
    measure, pool, wall_clock,
};
use splitcast_render::{Camera, DEFAULT_FOV_DEGREES, Perspective};
use splitcast_scene::{Frame, FrameSource, SceneError};

const SYSTEM: usize = 64 << 20;
const TRACER: usize = 32 << 20;
const FOREIGN: usize = 16 << 20;
const SLACK: usize = 1 << 20;

struct Triangle;

impl FrameSource for Triangle {
    fn name(&self) -> &str {
        "triangle"
    }

    fn frame_count(&self) -> usize {
        2
    }

    fn frame(&mut self, _: usize) -> Result<Frame, SceneError> {
        Ok(Frame {
            positions: vec![[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]],
            triangles: Arc::new(vec![[0, 1, 2]]),
            ..Frame::default()
        })
    }
}

struct Holder(Vec<u8>);

struct Held(#[allow(dead_code, reason = "it is there to be held")] Vec<u8>);

impl System for Holder {
    fn update<'s>(&'s mut self, _: FrameMesh<'s>) -> Result<Box<dyn Tracer + 's>, SystemError> {
        // What is given back before the end of the update does not count.
        drop(std::hint::black_box(vec![1_u8; 4 * SYSTEM]));
        self.0.resize(SYSTEM, 1);
        self.0.shrink_to_fit();
        Ok(Box::new(Held(vec![1; TRACER])))
    }

    fn foreign_bytes(&self) -> usize {
        FOREIGN
    }
}

impl Tracer for Held {
    fn closest_hits(&self, _: usize, _: RayChunk<'_>, _: HitChunk<'_>) {}

    fn occluded(&self, _: usize, _: RayChunk<'_>, _: &mut [bool]) {}
}

#[test]
fn what_system_and_tracer_hold_counts() {
    let corners = [[0.0, 0.0, 0.0], [1.0, 1.0, 0.0]];
    let view = Perspective::framing(&corners, [0.0, 1.0, 0.0], 1.0, DEFAULT_FOV_DEGREES);
    let picture = Picture {
        camera: Camera::new(&view.unwrap()).unwrap(),
        width: 4,
        height: 4,
        bounds: Aabb::of_points(&corners),
    };
    let entry = CatalogEntry {
        name: "holder".to_owned(),
        family: "holder",
        about: String::new(),
        yardstick: None,
        make: Box::new(|_| Ok(Box::new(Holder(Vec::new())))),
    };
    let plan = Plan {
        rays: Vec::new(),
        threads: 1,
        every: 1,
        rounds: 1,
        clock: wall_clock,
    };
    let measured = pool(1)
        .unwrap()
        .install(|| measure(&mut Triangle, &[entry], &picture, &plan, &mut || ()));
    let bytes = measured.unwrap().systems[0].bytes;
    assert!(
        bytes.abs_diff(SYSTEM + TRACER + FOREIGN) < SLACK,
        "{bytes} bytes"
    );
}
