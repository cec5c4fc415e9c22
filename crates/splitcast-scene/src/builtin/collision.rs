//! `collision`: a clay rabbit falls onto a porcelain dragon and shatters it.
//!
//! After the Bunny-Dragon animation of the UNC dynamic scene collection, at
//! its size and number of frames, with figurines of our own (see
//! [`super::figurines`]). The dragon is broken beforehand into closed pieces
//! that fit exactly (see [`super::fracture`]), so every frame has the same
//! triangles; from the blow on they are rigid bodies. The whole motion is
//! computed when the scene is opened, as poses only, and frames may be had in
//! any order.

use std::sync::Arc;

use glam::{Mat3, Vec3};

use super::figurines::{dragon, rabbit};
use super::fracture::{BrokenBody, Fracture};
use super::random::Random;
use super::rigid_body::{Pose, RigidBody};
use super::sculpture::Sculpture;
use super::{BuiltinScene, check_frame_index};
use crate::{Frame, FrameSource, SceneError};

pub(super) const SCENE: BuiltinScene = BuiltinScene {
    name: "collision",
    description: "a clay rabbit falls onto a porcelain dragon and shatters it",
    // The number that the simplification ends at; the paper's has 252.5K.
    triangles: 252_500,
    frames: 16,
    frames_per_second: 16.0,
    periodic: false,
    open: || Box::new(Collision::new()),
};

/// Triangles left of each body after simplification, and the lattice spacings
/// in metres on which they are first meshed: half the thickness of a wing.
const DRAGON_TRIANGLES: usize = 204_500;
const RABBIT_TRIANGLES: usize = 48_000;
const DRAGON_SPACING: f32 = 0.0165;
const RABBIT_SPACING: f32 = 0.0105;

/// Voronoi cells of the dragon, most of them near the blow.
const CELLS: usize = 64;
const BLOW: Vec3 = Vec3::new(0.02, 0.50, 0.02);
const BROKEN_COLOR: [u8; 3] = [228, 216, 192];

const STEPS_PER_FRAME: usize = 80;
const SEED: u64 = 0x5eed_0c01_1151_0004;

/// Both bodies as one mesh, and how its pieces move.
struct Collision {
    /// The rabbit first, then the pieces of the dragon.
    mesh: BrokenBody,
    /// Centre of mass at rest of every body.
    rest_centres: Vec<Vec3>,
    /// Poses of all bodies in every frame; none where a body still rests.
    poses: Vec<Vec<Option<Pose>>>,
    triangles: Arc<Vec<[u32; 3]>>,
    colors: Arc<Vec<[u8; 3]>>,
}

impl Collision {
    fn new() -> Self {
        let mut random = Random::new(SEED);
        let (rabbit, dragon) = (rabbit(), dragon());
        let whole = Fracture {
            sites: vec![Vec3::ZERO],
            color: BROKEN_COLOR,
        };
        let mut mesh = whole.apply(&rabbit, RABBIT_SPACING, RABBIT_TRIANGLES);
        let fracture = Fracture::around(&dragon, BLOW, CELLS, BROKEN_COLOR, &mut random);
        mesh.append(fracture.apply(&dragon, DRAGON_SPACING, DRAGON_TRIANGLES));

        let mut bodies: Vec<RigidBody> = (mesh.starts.windows(2))
            .map(|ends| {
                let [[first, triangle], [last, triangle_end]] = [ends[0], ends[1]];
                let triangles = &mesh.triangles[triangle..triangle_end];
                RigidBody::from_mesh(&mesh.positions[first..last], triangles, first)
            })
            .collect();
        Self {
            rest_centres: bodies.iter().map(|body| body.rest_centre).collect(),
            poses: simulate(&mut bodies, &rabbit, &dragon, &mut random),
            triangles: Arc::new(std::mem::take(&mut mesh.triangles)),
            colors: Arc::new(std::mem::take(&mut mesh.colors)),
            mesh,
        }
    }
}

impl FrameSource for Collision {
    fn name(&self) -> &str {
        SCENE.name
    }

    fn frame_count(&self) -> usize {
        SCENE.frames
    }

    fn frames_per_second(&self) -> f32 {
        SCENE.frames_per_second
    }

    fn frame(&mut self, index: usize) -> Result<Frame, SceneError> {
        check_frame_index(SCENE.name, index, SCENE.frames)?;
        let mut positions = Vec::with_capacity(self.mesh.positions.len());
        let mut normals = Vec::with_capacity(self.mesh.positions.len());
        for (body, pose) in self.poses[index].iter().enumerate() {
            let vertices = self.mesh.starts[body][0]..self.mesh.starts[body + 1][0];
            let (rest, rest_normals) = (
                &self.mesh.positions[vertices.clone()],
                &self.mesh.normals[vertices],
            );
            if let Some(pose) = pose {
                let centre = self.rest_centres[body];
                positions.extend(rest.iter().map(|&p| pose.apply(p - centre).to_array()));
                normals.extend(rest_normals.iter().map(|&n| (pose.rotation * n).to_array()));
            } else {
                positions.extend(rest.iter().map(Vec3::to_array));
                normals.extend(rest_normals.iter().map(Vec3::to_array));
            }
        }
        Ok(Frame {
            positions,
            triangles: Arc::clone(&self.triangles),
            normals: Some(normals),
            colors: Some(Arc::clone(&self.colors)),
        })
    }
}

/// Poses of all bodies, the first being the rabbit, in every frame.
fn simulate(
    bodies: &mut [RigidBody],
    rabbit: &Sculpture,
    dragon: &Sculpture,
    random: &mut Random,
) -> Vec<Vec<Option<Pose>>> {
    let dt = 1.0 / (SCENE.frames_per_second * STEPS_PER_FRAME as f32);
    let (hare, pieces) = bodies.split_first_mut().expect("the rabbit is a body");
    throw(hare);
    let mut broken = false;
    let mut poses = Vec::with_capacity(SCENE.frames);
    for _ in 0..SCENE.frames {
        let mut frame = vec![Some(hare.pose)];
        frame.extend(pieces.iter().map(|piece| broken.then_some(piece.pose)));
        poses.push(frame);
        for _ in 0..STEPS_PER_FRAME {
            hare.fly(dt);
            hare.meet_ground();
            if !broken {
                let touches = |&feeler: &Vec3| dragon.distance(hare.pose.apply(feeler)) < 0.0;
                broken = hare.feelers.iter().any(touches);
                if broken {
                    burst(hare, pieces, random);
                }
                continue;
            }
            for piece in &mut *pieces {
                piece.fly(dt);
                piece.meet_ground();
                let pose = hare.pose;
                let centre = hare.rest_centre;
                piece.meet(hare, |point| {
                    let local = pose.unapply(point) + centre;
                    let depth = -rabbit.distance(local);
                    (depth > 0.0).then(|| (depth, pose.rotation * rabbit.normal(local, 1.0e-3)))
                });
            }
        }
    }
    poses
}

/// Puts the rabbit above the dragon, nose down, and lets it go.
fn throw(hare: &mut RigidBody) {
    // A turn by the angle of the 3-4-5 triangle about z, nose down.
    hare.pose.rotation =
        Mat3::from_cols(Vec3::new(0.8, -0.6, 0.0), Vec3::new(0.6, 0.8, 0.0), Vec3::Z);
    hare.pose.centre = BLOW + Vec3::new(-0.22, 1.45, 0.06);
    hare.velocity = Vec3::new(0.55, -3.0, -0.1);
    hare.spin = Vec3::new(0.4, 0.3, -1.2);
}

/// The blow: pieces fly off and the rabbit is slowed.
fn burst(hare: &mut RigidBody, pieces: &mut [RigidBody], random: &mut Random) {
    /// Greatest speed of pieces, in m/s, and the distance from the blow, in
    /// metres, of those that get it: nearer ones are slower, or they would run
    /// into those around them.
    const SPEED: f32 = 2.8;
    const RANGE: f32 = 0.45;
    hare.velocity *= 0.45;
    hare.spin *= 2.0;
    for piece in pieces {
        let offset = piece.pose.centre - BLOW;
        let distance = offset.length();
        let near = distance / RANGE;
        let falloff = 2.0 * near / (1.0 + near * near);
        let outward = (offset + Vec3::Y * 0.10).normalize();
        let scatter = random.vector() - 0.5;
        piece.velocity =
            (outward + scatter * 0.3) * (SPEED * falloff * (0.7 + 0.6 * random.unit()));
        // Small pieces tumble faster.
        let tumble = (random.vector() - 0.5) * (2.0 * falloff / piece.reach.max(0.05));
        piece.spin = tumble;
    }
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;
    use std::sync::{Mutex, OnceLock};

    use super::*;

    /// The scene, opened once for all tests.
    fn scene() -> std::sync::MutexGuard<'static, Collision> {
        static OPENED: OnceLock<Mutex<Collision>> = OnceLock::new();
        let scene = OPENED.get_or_init(|| Mutex::new(Collision::new()));
        scene
            .lock()
            .unwrap_or_else(|poisoned| poisoned.into_inner())
    }

    /// Triangles over vertices joined where they coincide to the bit.
    fn welded(scene: &Collision) -> Vec<[u32; 3]> {
        let mut numbers = BTreeMap::new();
        let names: Vec<u32> = (scene.mesh.positions.iter())
            .map(|p| {
                let next = numbers.len() as u32;
                *numbers
                    .entry(p.to_array().map(f32::to_bits))
                    .or_insert(next)
            })
            .collect();
        scene
            .triangles
            .iter()
            .map(|t| t.map(|index| names[index as usize]))
            .collect()
    }

    fn assert_closed(triangles: &[[u32; 3]]) {
        let mut edges: Vec<[u32; 2]> = (triangles.iter())
            .flat_map(|&[a, b, c]| [[a, b], [b, c], [c, a]])
            .collect();
        edges.sort_unstable();
        assert!(
            edges.windows(2).all(|pair| pair[0] != pair[1]),
            "edge used twice"
        );
        for &[a, b] in &edges {
            assert!(edges.binary_search(&[b, a]).is_ok(), "edge {a} {b} is open");
        }
    }

    #[test]
    fn it_has_the_size_it_states() {
        let mut scene = scene();
        assert_eq!(scene.triangles.len(), SCENE.triangles);
        assert!((SCENE.triangles as f32 / 252_500.0 - 1.0).abs() < 0.02);
        let pieces = scene.rest_centres.len() - 1;
        assert!((50..150).contains(&pieces), "{pieces} pieces");
        for index in 0..SCENE.frames {
            let frame = scene.frame(index).expect("in range");
            assert_eq!(frame.positions.len(), scene.mesh.positions.len());
            assert!(frame.positions.iter().flatten().all(|x| x.is_finite()));
            let lowest = frame
                .positions
                .iter()
                .map(|p| p[1])
                .fold(f32::MAX, f32::min);
            assert!(lowest > -0.03, "frame {index} goes down to {lowest}");
        }
        assert!(scene.frame(SCENE.frames).is_err());
    }

    #[test]
    fn every_piece_is_closed_and_solid() {
        let scene = scene();
        let triangles = welded(&scene);
        for ends in scene.mesh.starts.windows(2) {
            let [first, last] = [ends[0][1], ends[1][1]];
            assert_closed(&triangles[first..last]);
            let volume: f32 = (scene.triangles[first..last].iter())
                .map(|t| {
                    let [a, b, c] = t.map(|index| scene.mesh.positions[index as usize]);
                    a.dot(b.cross(c)) / 6.0
                })
                .sum();
            assert!(volume > 0.0);
        }
    }

    #[test]
    fn the_whole_dragon_has_no_gaps() {
        // Broken faces come in pairs that face each other and cover each other
        // exactly; what is left is the closed skin of the dragon.
        let scene = scene();
        let triangles = &welded(&scene)[scene.mesh.starts[1][1]..];
        let turned = |&[a, b, c]: &[u32; 3]| {
            let least = a.min(b).min(c);
            if a == least {
                [a, b, c]
            } else if b == least {
                [b, c, a]
            } else {
                [c, a, b]
            }
        };
        let all: std::collections::BTreeSet<_> = triangles.iter().map(turned).collect();
        let skin: Vec<[u32; 3]> = (triangles.iter())
            .filter(|&&[a, b, c]| !all.contains(&turned(&[a, c, b])))
            .copied()
            .collect();
        assert!(skin.len() < triangles.len() && skin.len() > triangles.len() / 3);
        assert_closed(&skin);
    }

    #[test]
    fn pieces_rest_until_the_blow_and_then_move_as_wholes() {
        let mut scene = scene();
        let rest: Vec<[f32; 3]> = scene.mesh.positions.iter().map(Vec3::to_array).collect();
        let dragon = scene.mesh.starts[1][0];
        let first = scene.frame(0).expect("in range");
        assert_eq!(first.positions[dragon..], rest[dragon..]);
        assert!(Arc::ptr_eq(
            &first.triangles,
            &scene.frame(9).expect("in range").triangles
        ));

        let last = scene.frame(SCENE.frames - 1).expect("in range");
        let mut far = 0;
        for (body, ends) in scene.mesh.starts.windows(2).enumerate() {
            let vertices = ends[0][0]..ends[1][0];
            let moved = |i: usize| Vec3::from(last.positions[i]).distance(Vec3::from(rest[i]));
            far += usize::from(body > 0 && moved(vertices.start) > 0.2);
            for i in vertices.clone().step_by(101) {
                let before = Vec3::from(rest[i]).distance(Vec3::from(rest[vertices.start]));
                let after = Vec3::from(last.positions[i])
                    .distance(Vec3::from(last.positions[vertices.start]));
                assert!((before - after).abs() < 1.0e-4);
            }
        }
        assert!(far > 40, "{far} pieces moved");
    }
}
