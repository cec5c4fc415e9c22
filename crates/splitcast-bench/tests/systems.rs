//! Every system that is there finds what brute force finds, on a mesh that moves
//! and whose triangles change on the way.

use std::f32::consts::TAU;
use std::sync::Arc;

use splitcast::{Aabb, BuildOptions, KdTree, Mesh, Ray, reference};
use splitcast_bench::{
    Catalog, FrameMesh, HitChunk, LANES, Picture, Plan, RayChunk, RaySet, RaySetKind, measure,
    pool, ray_sets, wall_clock,
};
use splitcast_render::{Camera, Perspective};
use splitcast_scene::{Frame, FrameSource, SceneError};

/// Sections of the torus, and corners of each.
const SECTIONS: u32 = 28;
const CORNERS: u32 = 14;

const FRAMES: usize = 5;

/// The first frame with the second topology, so that there are updates in both.
const CHANGE: usize = 2;

/// A torus that is bent and swells; from a frame on with holes, and triangles in another order.
struct Torus {
    whole: Arc<Vec<[u32; 3]>>,
    pierced: Arc<Vec<[u32; 3]>>,
}

impl Torus {
    fn new() -> Self {
        let vertex = |section: u32, corner: u32| section % SECTIONS * CORNERS + corner % CORNERS;
        let mut whole = Vec::new();
        for section in 0..SECTIONS {
            for corner in 0..CORNERS {
                let [a, b] = [vertex(section, corner), vertex(section, corner + 1)];
                let [c, d] = [vertex(section + 1, corner), vertex(section + 1, corner + 1)];
                whole.extend([[a, c, b], [b, c, d]]);
            }
        }
        let kept = whole.iter().rev().enumerate();
        let kept = kept.filter(|(index, _)| index % 7 != 0);
        let pierced = kept.map(|(_, &triangle)| triangle).collect();
        Self {
            whole: Arc::new(whole),
            pierced: Arc::new(pierced),
        }
    }

    fn positions(frame: usize) -> Vec<[f32; 3]> {
        let time = frame as f32 * 0.3;
        let vertices = (0..SECTIONS).flat_map(|section| (0..CORNERS).map(move |c| (section, c)));
        let vertices = vertices.map(|(section, corner)| {
            let (around, across) = (
                section as f32 / SECTIONS as f32 * TAU,
                corner as f32 / CORNERS as f32 * TAU,
            );
            let thickness = 0.4 + 0.15 * (3.0 * around + time).sin();
            let radius = 1.0 + thickness * across.cos();
            [
                radius * around.cos(),
                thickness * across.sin() + 0.4 * time * around.cos().powi(2),
                radius * around.sin(),
            ]
        });
        vertices.collect()
    }
}

impl FrameSource for Torus {
    fn name(&self) -> &str {
        "torus"
    }

    fn frame_count(&self) -> usize {
        FRAMES
    }

    fn frame(&mut self, index: usize) -> Result<Frame, SceneError> {
        let triangles = if index < CHANGE {
            &self.whole
        } else {
            &self.pierced
        };
        Ok(Frame {
            positions: Self::positions(index),
            triangles: Arc::clone(triangles),
            normals: None,
            colors: None,
        })
    }
}

fn picture() -> Picture {
    let (width, height) = (48, 32);
    let points: Vec<[f32; 3]> = (0..FRAMES).flat_map(Torus::positions).collect();
    let aspect = width as f32 / height as f32;
    let view = Perspective::framing(&points, [0.0, 1.0, 0.0], aspect, 24.0).unwrap();
    let fold = |from: f32, better: fn(f32, f32) -> f32| {
        std::array::from_fn(|axis| points.iter().map(|p| p[axis]).fold(from, better))
    };
    Picture {
        camera: Camera::new(&view).unwrap(),
        width,
        height,
        bounds: Aabb {
            min: fold(f32::INFINITY, f32::min),
            max: fold(f32::NEG_INFINITY, f32::max),
        },
    }
}

fn check_all(threads: usize) {
    let plan = Plan {
        clock: wall_clock,
        rays: RaySetKind::ALL.to_vec(),
        threads,
        every: 1,
        rounds: 1,
    };
    let catalog = Catalog::new();
    let work = || {
        let mut torus = Torus::new();
        let (entries, picture) = (&catalog.entries[..], picture());
        measure(&mut torus, entries, &picture, &plan, &mut || ())
    };
    let measured = pool(threads).unwrap().install(work).unwrap();
    assert_eq!(measured.systems.len(), catalog.entries.len());
    for system in &measured.systems {
        let name = &system.name;
        assert_eq!(system.failure, None, "{name}");
        assert_eq!(system.updates.len(), FRAMES - 1, "{name}");
        for agreement in &system.agreement {
            assert!(agreement.hits_expected > 0, "{name}: {agreement:?}");
            assert!(agreement.agrees(), "{name}: {agreement:?}");
        }
        for cost in system.updates.iter().filter_map(|update| update.sah_cost) {
            assert!(cost.is_finite() && cost > 1.0, "{name} costs {cost}");
        }
    }
}

/// One after the other, since only one measurement can count memory at a time.
#[test]
fn all_agree_with_brute_force_on_one_thread_and_on_two() {
    check_all(1);
    check_all(2);
}

/// The measurement only uses the fastest mode of each system; the others have to be right, too.
#[test]
fn every_mode_finds_what_brute_force_finds() {
    let mut torus = Torus::new();
    let Frame {
        mut positions,
        triangles,
        ..
    } = torus.frame(0).unwrap();
    let count = positions.len();
    positions.push([0.0; 3]);
    let mesh = Mesh::new(&positions[..count], &triangles).unwrap();
    let frame = FrameMesh {
        mesh,
        padded_positions: &positions,
        same_topology: false,
    };
    let tree = KdTree::build(mesh, &BuildOptions::default()).unwrap();
    // A number of rays that fills no whole number of blocks.
    let odd = |mut set: RaySet| {
        set.rays.truncate(set.rays.len() / LANES * LANES - 5);
        RaySet::new(set.kind, set.rays)
    };
    let sets = ray_sets(&RaySetKind::ALL, &picture(), &tree, 0);
    let sets: Vec<RaySet> = sets.into_iter().map(odd).collect();
    for entry in &Catalog::new().entries {
        let mut system = (entry.make)(1).unwrap();
        let tracer = system.update(frame).unwrap();
        for set in &sets {
            for (mode, name) in tracer.modes(set.kind).iter().enumerate() {
                let lanes = set.blocks.len() * LANES;
                let rays = RayChunk {
                    rays: &set.rays,
                    blocks: &set.blocks,
                };
                let (mut t, mut triangle) = (vec![f32::NAN; lanes], vec![u32::MAX; lanes]);
                let mut occluded = vec![false; lanes];
                if set.kind.is_occlusion() {
                    tracer.occluded(mode, rays, &mut occluded);
                } else {
                    let (t, triangle) = (&mut t[..], &mut triangle[..]);
                    tracer.closest_hits(mode, rays, HitChunk { t, triangle });
                }
                let is_wrong = |&(index, ray): &(usize, &Ray)| match set.kind.is_occlusion() {
                    true => occluded[index] != reference::occluded(mesh, ray),
                    false => match reference::closest_hit(mesh, ray) {
                        // A distance that is not a number is near nothing.
                        Some(hit) => {
                            let reach = 1e-4 * hit.t.max(1.0);
                            !(hit.t - reach..=hit.t + reach).contains(&t[index])
                        }
                        None => t[index] != f32::INFINITY,
                    },
                };
                let wrong = set.rays.iter().enumerate().filter(is_wrong).count();
                // A ray that grazes an edge is a matter of rounding.
                let at_most = set.rays.len() / 1000;
                assert!(
                    wrong <= at_most,
                    "{wrong} of {}, {}, {name}",
                    set.kind,
                    entry.name
                );
            }
        }
    }
}

#[test]
fn systems_have_names_of_their_own_and_yardsticks_of_their_family() {
    let catalog = Catalog::new();
    let entries = &catalog.entries;
    for (index, entry) in entries.iter().enumerate() {
        assert!(
            entries[..index]
                .iter()
                .all(|other| other.name != entry.name)
        );
        let Some(yardstick) = &entry.yardstick else {
            continue;
        };
        let found = entries.iter().find(|other| other.name == *yardstick);
        assert_eq!(found.unwrap().family, entry.family);
        assert_eq!(found.unwrap().yardstick, None);
    }
}

/// Loading a library must not move the threads that are made later onto one processor.
#[test]
fn looking_for_systems_leaves_the_threads_where_they_are() {
    let before = core_affinity::get_core_ids();
    let catalog = Catalog::new();
    for entry in &catalog.entries {
        // What cannot be made says so elsewhere.
        let _ = (entry.make)(2);
    }
    assert_eq!(core_affinity::get_core_ids(), before);
}
