//! `cloth-ball`: a cloth falls over a turning ball and is wound up by it.
//!
//! After the ClothBall animation of the UNC dynamic scene collection, at its
//! size. The cloth is simulated at half the resolution it is shown in (see
//! [`super::cloth`]) and refined by [`subdivide_grid`]; points that the
//! refinement moved into the ball or the ground are put back on the surface.
//!
//! Frames come from one forward simulation. Its coarse states are kept as
//! they are reached, 120 kB each, so that a frame once passed is had again
//! without simulating, and every order of access gives the same bits.

use std::sync::Arc;

use glam::Vec3;

use super::cloth::{Cloth, ClothSettings, Ground, TurningBall};
use super::curve::sin_cos;
use super::geodesic_sphere::geodesic_sphere;
use super::grid_subdivision::subdivide_grid;
use super::{BuiltinScene, check_frame_index};
use crate::vertex_normals;
use crate::{Frame, FrameSource, SceneError};

pub(super) const SCENE: BuiltinScene = BuiltinScene {
    name: "cloth-ball",
    description: "a cloth falls over a ball, which turns and winds it up",
    // 92.5K for the paper's 92.2K.
    triangles: 8 * SIMULATED_QUADS * SIMULATED_QUADS
        + 20 * (BALL_FREQUENCY * BALL_FREQUENCY) as usize,
    frames: 73,
    frames_per_second: 25.0,
    periodic: false,
    open: || Box::new(ClothBall::new(SIMULATED_QUADS, BALL_FREQUENCY)),
};

/// Quads along a side of the simulated cloth; the shown one has twice as many.
const SIMULATED_QUADS: usize = 100;
const BALL_FREQUENCY: u32 = 25;

const CLOTH_SIDE: f32 = 2.9;
const BALL_RADIUS: f32 = 0.5;
const BALL_CENTRE: Vec3 = Vec3::new(0.0, 0.52, 0.0);
/// Height of the cloth at the start, just clear of the ball.
const DROP_HEIGHT: f32 = 1.16;

/// How far simulated particles and shown points stay off ball and ground.
/// The first allows for what the refinement takes off a curved cloth.
const PARTICLE_CLEARANCE: f32 = 0.008;
const SHOWN_CLEARANCE: f32 = 0.004;

/// The ball begins to turn when the cloth lies on it, and reaches its full
/// speed (radians a second) over some time (seconds).
const SPIN_START: f32 = 0.5;
const SPIN_UP: f32 = 0.6;
const SPIN: f32 = 2.3;

/// The running simulation and every coarse cloth it has gone through.
struct ClothBall {
    cloth: Cloth,
    /// Coarse particle positions of frames 0, 1, ...
    states: Vec<Vec<Vec3>>,
    ball_positions: Vec<Vec3>,
    triangles: Arc<Vec<[u32; 3]>>,
    colors: Arc<Vec<[u8; 3]>>,
    simulated_quads: usize,
}

impl ClothBall {
    fn new(simulated_quads: usize, ball_frequency: u32) -> Self {
        let cloth = Cloth::new(settings(simulated_quads), place);
        let (ball_positions, ball_triangles) = geodesic_sphere(ball_frequency);
        let shown_quads = 2 * simulated_quads;
        let cloth_points = ((shown_quads + 1) * (shown_quads + 1)) as u32;
        let mut triangles = grid_triangles(shown_quads as u32);
        triangles.extend(
            ball_triangles
                .iter()
                .map(|t| t.map(|index| index + cloth_points)),
        );
        let mut colors: Vec<_> = (0..cloth_points as usize)
            .map(|i| {
                let step = 1.0 / shown_quads as f32;
                let (row, column) = (i / (shown_quads + 1), i % (shown_quads + 1));
                tartan(row as f32 * step, column as f32 * step)
            })
            .collect();
        colors.extend(ball_positions.iter().map(|&direction| gores(direction)));
        Self {
            states: vec![cloth.positions().to_vec()],
            cloth,
            ball_positions,
            triangles: Arc::new(triangles),
            colors: Arc::new(colors),
            simulated_quads,
        }
    }

    /// Simulates up to and including frame `index`.
    fn simulate_to(&mut self, index: usize) {
        let ball = TurningBall {
            centre: BALL_CENTRE,
            radius: BALL_RADIUS + PARTICLE_CLEARANCE,
            friction: 1.2,
        };
        let ground = Ground {
            height: PARTICLE_CLEARANCE,
            friction: 0.9,
        };
        let duration = 1.0 / SCENE.frames_per_second;
        while self.states.len() <= index {
            let start = (self.states.len() - 1) as f32 * duration;
            self.cloth
                .advance(duration, &ball, |time| spin(start + time), &ground);
            self.states.push(self.cloth.positions().to_vec());
        }
    }
}

impl FrameSource for ClothBall {
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
        self.simulate_to(index);
        let mut points = subdivide_grid(&self.states[index], self.simulated_quads + 1);
        for point in &mut points {
            *point = keep_off(*point);
        }
        let time = index as f64 / f64::from(SCENE.frames_per_second);
        let (sin, cos) = sin_cos(spin_angle(time) / std::f64::consts::TAU);
        let (sin, cos) = (sin as f32, cos as f32);
        points.extend(self.ball_positions.iter().map(|p| {
            let turned = Vec3::new(cos * p.x + sin * p.z, p.y, cos * p.z - sin * p.x);
            BALL_CENTRE + turned * BALL_RADIUS
        }));
        let positions: Vec<[f32; 3]> = points.iter().map(Vec3::to_array).collect();
        Ok(Frame {
            normals: Some(vertex_normals(&positions, &self.triangles)),
            positions,
            triangles: Arc::clone(&self.triangles),
            colors: Some(Arc::clone(&self.colors)),
        })
    }
}

/// Heavy cotton: does not stretch, shears a little, bends softly.
fn settings(quads: usize) -> ClothSettings {
    ClothSettings {
        quads,
        side: CLOTH_SIDE,
        density: 0.35,
        stretch_compliance: 0.0,
        shear_compliance: 1.0e-4,
        bending_compliance: 0.05,
        air_drag: 0.5,
        damping: 0.3,
        substeps: 40,
    }
}

/// Where the cloth starts: turned and off the centre, since a symmetric drape
/// looks made up, with a ripple of a few millimetres from which folds grow.
fn place(row: f32, column: f32) -> Vec3 {
    // A turn by the angle of the 5-12-13 triangle, 22.6 degrees.
    let (sin, cos) = (5.0 / 13.0, 12.0 / 13.0);
    let (u, v) = ((row - 0.5) * CLOTH_SIDE, (column - 0.5) * CLOTH_SIDE);
    let wave = |turns: f32| sin_cos(f64::from(turns)).0 as f32;
    let ripple = 0.004 * (wave(1.1 * u + 0.3 * v) + wave(0.5 * u - v));
    Vec3::new(
        cos * u + sin * v + 0.05,
        DROP_HEIGHT + ripple,
        cos * v - sin * u - 0.03,
    )
}

/// Angular velocity of the ball in radians a second at `time`.
fn spin(time: f32) -> f32 {
    let s = ((time - SPIN_START) / SPIN_UP).clamp(0.0, 1.0);
    SPIN * s * s * (3.0 - 2.0 * s)
}

/// Angle of the ball in radians at `time`: the integral of [`spin`].
fn spin_angle(time: f64) -> f64 {
    let (start, up) = (f64::from(SPIN_START), f64::from(SPIN_UP));
    let s = ((time - start) / up).clamp(0.0, 1.0);
    let full = (time - start - up).max(0.0);
    f64::from(SPIN) * (up * s * s * s * (1.0 - 0.5 * s) + full)
}

/// Moves a shown point out of ball and ground.
fn keep_off(mut point: Vec3) -> Vec3 {
    let offset = point - BALL_CENTRE;
    let distance = offset.length();
    let least = BALL_RADIUS + SHOWN_CLEARANCE;
    if distance < least {
        point = BALL_CENTRE + offset * (least / distance.max(f32::MIN_POSITIVE));
    }
    point.y = point.y.max(SHOWN_CLEARANCE);
    point
}

/// Triangles of a grid of quads, facing up for rows along x and columns along
/// z; diagonals alternate, so that folds have no preferred direction.
fn grid_triangles(quads: u32) -> Vec<[u32; 3]> {
    let count = quads + 1;
    let mut triangles = Vec::with_capacity(2 * (quads * quads) as usize);
    for row in 0..quads {
        for column in 0..quads {
            let a = row * count + column;
            let (b, c, d) = (a + 1, a + count, a + count + 1);
            if (row + column) % 2 == 0 {
                triangles.extend([[a, b, d], [a, d, c]]);
            } else {
                triangles.extend([[a, b, c], [b, d, c]]);
            }
        }
    }
    triangles
}

/// A tartan: the same bands along both threads, mixed where they cross.
fn tartan(u: f32, v: f32) -> [u8; 3] {
    const RED: [u8; 3] = [178, 34, 40];
    const NAVY: [u8; 3] = [24, 38, 78];
    const CREAM: [u8; 3] = [240, 228, 200];
    let thread = |t: f32| {
        // Six repeats of: wide red, navy band split by a cream line.
        let phase = (t * 6.0).fract();
        match phase {
            p if (0.62..0.68).contains(&p) || (0.82..0.88).contains(&p) => CREAM,
            p if (0.55..0.95).contains(&p) => NAVY,
            _ => RED,
        }
    };
    let (warp, weft) = (thread(u), thread(v));
    std::array::from_fn(|i| ((u16::from(warp[i]) + u16::from(weft[i])) / 2) as u8)
}

/// Beach-ball gores around the axis, with plain caps at the poles.
fn gores(direction: Vec3) -> [u8; 3] {
    const LIGHT: [f32; 3] = [246.0, 240.0, 226.0];
    const DARK: [f32; 3] = [234.0, 150.0, 38.0];
    // The fourfold angle by complex multiplication: eight gores, with edges as
    // soft as the mesh can show.
    let (x, z) = (direction.x, direction.z);
    let (x, z) = (x * x - z * z, 2.0 * x * z);
    let wave = 2.0 * x * z / (x * x + z * z).max(f32::MIN_POSITIVE).sqrt();
    let share = (0.5 + 4.0 * wave).clamp(0.0, 1.0);
    std::array::from_fn(|i| (LIGHT[i] + (DARK[i] - LIGHT[i]) * share) as u8)
}

#[cfg(test)]
mod tests {
    use std::sync::OnceLock;

    use super::*;

    const SMALL_QUADS: usize = 40;

    /// All frames of a small version, simulated once for all tests.
    fn small_run() -> &'static [Frame] {
        static RUN: OnceLock<Vec<Frame>> = OnceLock::new();
        RUN.get_or_init(|| {
            let mut scene = ClothBall::new(SMALL_QUADS, 4);
            let frames = (0..SCENE.frames).map(|i| scene.frame(i).expect("in range"));
            frames.collect()
        })
    }

    fn cloth_points(frame: &Frame) -> impl Iterator<Item = Vec3> {
        let side = 2 * SMALL_QUADS + 1;
        frame.positions[..side * side]
            .iter()
            .map(|&p| Vec3::from(p))
    }

    #[test]
    fn the_full_scene_has_the_size_it_states() {
        let frame = (SCENE.open)().frame(0).expect("in range");
        assert_eq!(frame.triangles.len(), SCENE.triangles);
        assert!((SCENE.triangles as f32 / 92_200.0 - 1.0).abs() < 0.02);
        let count = frame.positions.len();
        assert_eq!(frame.normals.expect("has normals").len(), count);
        assert_eq!(frame.colors.expect("has colours").len(), count);
        let largest = frame.triangles.iter().flatten().max();
        assert_eq!(largest, Some(&(count as u32 - 1)));
    }

    #[test]
    fn any_order_of_access_gives_the_same_bits() {
        let mut scene = ClothBall::new(SMALL_QUADS, 4);
        for index in [40, 3, 72, 0, 40] {
            let frame = scene.frame(index).expect("in range");
            assert_eq!(
                frame.positions,
                small_run()[index].positions,
                "frame {index}"
            );
            assert_eq!(frame.normals, small_run()[index].normals, "frame {index}");
        }
    }

    #[test]
    fn the_cloth_stays_out_of_ball_and_ground() {
        for (i, frame) in small_run().iter().enumerate() {
            for point in cloth_points(frame) {
                assert!(point.is_finite());
                assert!(
                    point.distance(BALL_CENTRE) > BALL_RADIUS,
                    "frame {i}: {point}"
                );
                assert!(point.y > 0.0, "frame {i}: {point}");
            }
        }
    }

    #[test]
    fn the_cloth_hardly_stretches() {
        let side = 2 * SMALL_QUADS + 1;
        let rest = CLOTH_SIDE / (side - 1) as f32;
        for (i, frame) in small_run().iter().enumerate().step_by(8) {
            let points: Vec<Vec3> = cloth_points(frame).collect();
            let mut stretches: Vec<f32> = (0..side * side)
                .flat_map(|p| {
                    let right = (p % side + 1 < side).then(|| points[p].distance(points[p + 1]));
                    let down = points.get(p + side).map(|q| points[p].distance(*q));
                    right.into_iter().chain(down)
                })
                .map(|length| length / rest - 1.0)
                .collect();
            stretches.sort_by(f32::total_cmp);
            let at = |share: f32| stretches[(share * (stretches.len() - 1) as f32) as usize];
            assert!(at(0.5).abs() < 0.02, "frame {i}: median {}", at(0.5));
            assert!(at(0.999) < 0.10, "frame {i}: most {}", at(0.999));
        }
    }

    /// Edges of the mesh that pass through a triangle which they do not touch.
    fn crossings(points: &[Vec3], triangles: &[[u32; 3]]) -> usize {
        let boxes: Vec<(Vec3, Vec3)> = (triangles.iter())
            .map(|t| {
                let [a, b, c] = t.map(|index| points[index as usize]);
                (a.min(b).min(c), a.max(b).max(c))
            })
            .collect();
        let mut count = 0;
        for (i, from) in triangles.iter().enumerate() {
            for (j, through) in triangles.iter().enumerate() {
                let apart =
                    boxes[i].0.cmpgt(boxes[j].1).any() || boxes[j].0.cmpgt(boxes[i].1).any();
                if apart || from.iter().any(|index| through.contains(index)) {
                    continue;
                }
                let [p, q, r] = through.map(|index| points[index as usize]);
                for k in 0..3 {
                    let [a, b] = [from[k], from[(k + 1) % 3]].map(|index| points[index as usize]);
                    // Signed volumes: the ends on two sides of the plane, the
                    // line on the same side of all three edges.
                    let side = |u: Vec3, v: Vec3, w: Vec3, x: Vec3| {
                        (v - u).dot((w - u).cross(x - u)) > 0.0
                    };
                    count += usize::from(
                        side(a, p, q, r) != side(b, p, q, r)
                            && side(a, b, p, q) == side(a, b, q, r)
                            && side(a, b, q, r) == side(a, b, r, p),
                    );
                }
            }
        }
        count
    }

    #[test]
    fn the_cloth_does_not_pass_through_itself() {
        let cloth_triangles = 8 * SMALL_QUADS * SMALL_QUADS;
        for (i, frame) in small_run().iter().enumerate().step_by(24) {
            let points: Vec<Vec3> = cloth_points(frame).collect();
            let triangles = &frame.triangles[..cloth_triangles];
            assert_eq!(crossings(&points, triangles), 0, "frame {i}");
        }
        // The check itself: a cloth with one corner pulled through its middle.
        let mut points: Vec<Vec3> = cloth_points(&small_run()[0]).collect();
        let middle = points[points.len() / 2 + 3];
        points[0] = middle - Vec3::Y * 0.1;
        points[1] = middle + Vec3::Y * 0.1;
        assert!(crossings(&points, &small_run()[0].triangles[..cloth_triangles]) > 0);
    }

    #[test]
    fn the_ball_winds_the_cloth_up() {
        // The top of the cloth goes round with the ball, its corners stay
        // behind on the ground.
        let azimuth = |frame: usize, point: usize| {
            let at = Vec3::from(small_run()[frame].positions[point]) - BALL_CENTRE;
            at.z.atan2(at.x)
        };
        let side = 2 * SMALL_QUADS + 1;
        let near_top = (SMALL_QUADS + 5) * side + SMALL_QUADS;
        let turned = |point: usize| {
            let steps = (20..72).map(|frame| {
                let step = azimuth(frame, point) - azimuth(frame + 1, point);
                (step / std::f32::consts::TAU - (step / std::f32::consts::TAU).round())
                    * std::f32::consts::TAU
            });
            steps.sum::<f32>()
        };
        let ball = (spin_angle(72.0 / 25.0) - spin_angle(20.0 / 25.0)) as f32;
        let (top, corner) = (turned(near_top), turned(0));
        assert!(top > 0.5 * ball, "{top} of {ball}");
        assert!(corner < top - 0.5, "{corner} for {top}");
    }

    #[test]
    fn the_angle_is_the_integral_of_the_spin() {
        let steps = 20_000;
        let dt = 2.88 / steps as f32;
        let sum: f64 = (0..steps)
            .map(|i| f64::from(spin((i as f32 + 0.5) * dt) * dt))
            .sum();
        assert!((sum - spin_angle(2.88)).abs() < 1.0e-3);
    }

    #[test]
    fn frames_past_the_end_are_an_error() {
        let mut scene = ClothBall::new(4, 1);
        let error = scene.frame(73).expect_err("out of range").to_string();
        assert!(
            error.contains("cloth-ball") && error.contains("73"),
            "{error}"
        );
        assert!(scene.frame(1).is_ok());
    }
}
