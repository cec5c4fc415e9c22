//! Skinned animals: how one is put together, and how it yields frames.
//!
//! Animals face +x and stand on y = 0; their right side is z > 0.

use std::sync::Arc;

use glam::Vec3;

use super::BuiltinScene;
use super::check_frame_index;
use super::implicit::{Body, Part};
use super::skeleton::{Pose, Skeleton};
use super::skinning::Skin;
use super::surface_nets;
use crate::vertex_normals;
use crate::{Frame, FrameSource, SceneError};

/// Poses a skeleton at a phase of the whole cycle, 0 to 1.
pub(super) type Gait = fn(&mut Pose<'_>, f64);

/// Gives a rest position its colour, from the colour its part has there.
pub(super) type Paint = fn(Vec3, [u8; 3]) -> [u8; 3];

/// Bones and the flesh on them, while an animal is put together.
///
/// What exists on both sides is described on the right; the bones of the two
/// sides end in `.r` and `.l`.
#[derive(Default)]
pub(super) struct Rig {
    pub(super) skeleton: Skeleton,
    body: Body,
}

impl Rig {
    /// Adds a chain of bones on both sides, one name a bone.
    pub(super) fn bone_pairs(&mut self, names: &[&str], parent: &str, joints: &[[f64; 3]]) {
        for (side, sign) in [("r", 1.0), ("l", -1.0)] {
            let mut parent = parent.to_owned();
            for (name, ends) in names.iter().zip(joints.windows(2)) {
                let name = format!("{name}.{side}");
                let [head, tail] = [ends[0], ends[1]].map(|[x, y, z]| [x, y, z * sign]);
                self.skeleton.bone(&name, &parent, head, tail);
                parent = name;
            }
        }
    }

    /// Adds a part in the middle, carried by the bones whose names start so.
    pub(super) fn add(&mut self, part: Part, bones: &[&str], softness: f32, color: [u8; 3]) {
        let bones = self.skeleton.ids(bones);
        assert!(!bones.is_empty(), "a part needs a bone");
        self.body.parts.push(part.on(bones, softness, color));
    }

    /// Adds a part on both sides; bone names that end in a dot get their side.
    pub(super) fn add_pair(&mut self, part: Part, bones: &[&str], softness: f32, color: [u8; 3]) {
        for (side, part) in [("r", part.clone()), ("l", part.mirrored())] {
            let sided: Vec<String> = bones
                .iter()
                .map(|name| {
                    if name.ends_with('.') {
                        format!("{name}{side}")
                    } else {
                        (*name).to_owned()
                    }
                })
                .collect();
            let sided: Vec<&str> = sided.iter().map(String::as_str).collect();
            self.add(part, &sided, softness, color);
        }
    }

    /// Meshes the body with cells of edge `cell` and binds it to the bones.
    pub(super) fn skin(&self, cell: f32, paint: Paint) -> Skin {
        Skin::bind(
            surface_nets::mesh(&self.body, cell),
            &self.body,
            &self.skeleton,
            paint,
        )
    }
}

/// An animal that moves: a source of frames.
pub(super) struct Animal {
    name: &'static str,
    frames: usize,
    frames_per_second: f32,
    skeleton: Skeleton,
    skin: Skin,
    gait: Gait,
}

impl Animal {
    /// The animal of a scene: its rig, meshed with cells of edge `cell`.
    pub(super) fn new(scene: &BuiltinScene, rig: Rig, cell: f32, paint: Paint, gait: Gait) -> Self {
        Self {
            name: scene.name,
            frames: scene.frames,
            frames_per_second: scene.frames_per_second,
            skin: rig.skin(cell, paint),
            skeleton: rig.skeleton,
            gait,
        }
    }
}

impl FrameSource for Animal {
    fn name(&self) -> &str {
        self.name
    }

    fn frame_count(&self) -> usize {
        self.frames
    }

    fn frames_per_second(&self) -> f32 {
        self.frames_per_second
    }

    fn is_periodic(&self) -> bool {
        true
    }

    fn frame(&mut self, index: usize) -> Result<Frame, SceneError> {
        check_frame_index(self.name, index, self.frames)?;
        let mut pose = Pose::new(&self.skeleton);
        (self.gait)(&mut pose, index as f64 / self.frames as f64);
        let positions = self.skin.posed(&pose);
        let normals = vertex_normals(&positions, &self.skin.triangles);
        Ok(Frame {
            positions,
            triangles: Arc::clone(&self.skin.triangles),
            normals: Some(normals),
            colors: Some(Arc::clone(&self.skin.colors)),
        })
    }
}

#[cfg(test)]
mod tests {
    use std::collections::HashSet;
    use std::sync::LazyLock;

    use super::*;
    use crate::builtin::{BuiltinScene, elephant, horse};

    const ANIMALS: [BuiltinScene; 2] = [horse::SCENE, elephant::SCENE];

    /// All frames of both animals, made once for all tests.
    static FRAMES: LazyLock<[Vec<Frame>; 2]> =
        LazyLock::new(|| ANIMALS.map(|scene| frames(&scene)));

    fn frames(scene: &BuiltinScene) -> Vec<Frame> {
        let mut source = (scene.open)();
        let frame = |index| source.frame(index).expect("the frame is in range");
        (0..scene.frames).map(frame).collect()
    }

    fn animals() -> impl Iterator<Item = (BuiltinScene, &'static [Frame])> {
        ANIMALS.into_iter().zip(FRAMES.iter().map(Vec::as_slice))
    }

    fn corners(frame: &Frame, triangle: &[u32; 3]) -> [Vec3; 3] {
        triangle.map(|index| frame.positions[index as usize].into())
    }

    #[test]
    fn counts_are_the_listed_ones_and_near_the_papers() {
        for (scene, paper) in ANIMALS.iter().zip([16_800.0, 84_600.0]) {
            let mut source = (scene.open)();
            let frame = source.frame(0).expect("there is a first frame");
            assert_eq!(frame.triangles.len(), scene.triangles, "{}", scene.name);
            assert!((scene.triangles as f64 / paper - 1.0).abs() < 0.02);
            assert_eq!(source.name(), scene.name);
            assert_eq!(source.frame_count(), scene.frames);
            assert_eq!(scene.frames, 48);
            assert_eq!(source.frames_per_second(), scene.frames_per_second);
            assert_eq!(source.is_periodic(), scene.periodic);
        }
    }

    #[test]
    fn surface_is_closed_oriented_and_in_one_piece() {
        for (scene, frames) in animals() {
            let frame = &frames[0];
            let mut edges = HashSet::new();
            for &[a, b, c] in frame.triangles.iter() {
                for edge in [(a, b), (b, c), (c, a)] {
                    assert!(edges.insert(edge), "{}: {edge:?} twice", scene.name);
                }
            }
            assert!(edges.iter().all(|&(a, b)| edges.contains(&(b, a))));
            // A closed surface in one piece that has no handles.
            let euler = frame.positions.len() as i64 - edges.len() as i64 / 2
                + frame.triangles.len() as i64;
            assert_eq!(euler, 2, "{}", scene.name);
        }
    }

    #[test]
    fn every_frame_is_sound() {
        for (scene, frames) in animals() {
            for (index, frame) in frames.iter().enumerate() {
                let at = format!("{} frame {index}", scene.name);
                assert!(Arc::ptr_eq(&frame.triangles, &frames[0].triangles));
                let normals = frame.normals.as_ref().expect("animals have normals");
                let colors = frame.colors.as_ref().expect("animals have colours");
                assert_eq!(normals.len(), frame.positions.len());
                assert_eq!(colors.len(), frame.positions.len());
                assert!(
                    frame
                        .positions
                        .iter()
                        .flatten()
                        .all(|value| value.is_finite()),
                    "{at}"
                );
                for normal in normals {
                    assert!((Vec3::from(*normal).length() - 1.0).abs() < 1e-5, "{at}");
                }
                let mut volume = 0.0;
                let mut folded = 0;
                for triangle in frame.triangles.iter() {
                    let [a, b, c] = corners(frame, triangle);
                    let doubled_area = (b - a).cross(c - a);
                    let area = 0.5 * doubled_area.length();
                    assert!(area > 1e-7, "{at}: {triangle:?} has area {area}");
                    volume += f64::from(a.dot(b.cross(c))) / 6.0;
                    let normal: Vec3 = triangle
                        .iter()
                        .map(|&i| Vec3::from(normals[i as usize]))
                        .sum();
                    folded += usize::from(doubled_area.dot(normal) < 0.0);
                }
                // Creases of skin may turn a triangle over, but only a few.
                assert!(
                    folded * 1000 < frame.triangles.len(),
                    "{at}: {folded} folded"
                );
                assert!(volume > 0.3, "{at}: volume {volume} m3");
            }
        }
    }

    #[test]
    fn triangles_at_rest_are_even() {
        for (scene, frames) in animals() {
            let frame = &frames[0];
            let mut areas: Vec<f32> = frame
                .triangles
                .iter()
                .map(|triangle| {
                    let [a, b, c] = corners(frame, triangle);
                    0.5 * (b - a).cross(c - a).length()
                })
                .collect();
            areas.sort_by(f32::total_cmp);
            let part = |share: f64| areas[(share * (areas.len() - 1) as f64) as usize];
            let median = part(0.5);
            assert!(part(0.01) > 0.25 * median, "{}: slivers", scene.name);
            assert!(part(0.99) < 2.5 * median, "{}: giants", scene.name);
        }
    }

    #[test]
    fn motion_is_smooth_through_the_end_of_the_cycle() {
        for (scene, frames) in animals() {
            let step = |from: usize| {
                let to = &frames[(from + 1) % scene.frames];
                let moved = frames[from].positions.iter().zip(&to.positions);
                let squares = moved.map(|(a, b)| Vec3::from(*a).distance_squared((*b).into()));
                (squares.sum::<f32>() / to.positions.len() as f32).sqrt()
            };
            let steps: Vec<f32> = (0..scene.frames).map(step).collect();
            let mean = steps.iter().sum::<f32>() / steps.len() as f32;
            for (index, step) in steps.iter().enumerate() {
                assert!(
                    (0.4..2.0).contains(&(step / mean)),
                    "{} {index}: {step}",
                    scene.name
                );
            }
        }
    }

    #[test]
    fn any_order_gives_the_same_bits() {
        let scene = &ANIMALS[0];
        let forwards = &FRAMES[0];
        let mut source = (scene.open)();
        for index in [47, 3, 20, 3, 0] {
            let frame = source.frame(index).expect("the frame is in range");
            let bits = |frame: &Frame| -> Vec<u32> {
                frame
                    .positions
                    .iter()
                    .flatten()
                    .map(|v| v.to_bits())
                    .collect()
            };
            assert_eq!(bits(&frame), bits(&forwards[index]));
            assert_eq!(frame.triangles, forwards[index].triangles);
            assert_eq!(frame.colors, forwards[index].colors);
        }
    }

    #[test]
    fn frames_past_the_end_are_refused() {
        for scene in &ANIMALS {
            let refusal = (scene.open)().frame(48).expect_err("there are 48 frames");
            assert_eq!(
                refusal.to_string(),
                format!(
                    "frame 48 is out of range: {} has 48 frames, 0 to 47",
                    scene.name
                )
            );
        }
    }

    #[test]
    fn feet_reach_the_ground_and_stay_above_it() {
        for (scene, frames) in animals() {
            let lowest: Vec<f32> = frames
                .iter()
                .map(|frame| {
                    frame
                        .positions
                        .iter()
                        .map(|p| p[1])
                        .fold(f32::INFINITY, f32::min)
                })
                .collect();
            assert!(
                lowest.iter().all(|y| *y > -0.01),
                "{} {lowest:?}",
                scene.name
            );
            // Elephants never leave the ground; a gallop has one suspension.
            let aloft = lowest.iter().filter(|y| **y > 0.03).count();
            let expected = if scene.name == "horse" { 6..16 } else { 0..1 };
            assert!(
                expected.contains(&aloft),
                "{}: {aloft} frames aloft",
                scene.name
            );
        }
    }
}
