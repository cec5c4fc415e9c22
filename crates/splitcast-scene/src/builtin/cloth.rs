//! A square cloth of particles that falls, drapes, folds and rubs.
//!
//! Stretch, shear and bending are compliant distances (see [`super::xpbd`]):
//! along the weave, along both diagonals of a quad, and over two quads.
//! Layers of cloth are kept apart by particles of one thickness (see
//! [`super::particle_contacts`]). A turning ball and the ground push back and
//! rub by Coulomb's law, air resists motion across the cloth.

use glam::Vec3;

use super::particle_contacts::ParticleContacts;
use super::xpbd::{DistanceConstraint, Particles};

const GRAVITY: Vec3 = Vec3::new(0.0, -9.81, 0.0);

/// Particle diameter over rest spacing. Below one, so that neighbours at rest
/// do not touch; above 0.71, or a particle could slip through a quad.
const THICKNESS: f32 = 0.9;

/// Substeps between two searches for contact pairs.
const SUBSTEPS_PER_SEARCH: usize = 5;

/// What the cloth is made of and how finely it is simulated.
#[derive(Clone, Copy, Debug)]
pub(super) struct ClothSettings {
    /// Quads along one side, at least 2.
    pub(super) quads: usize,
    /// Length of a side in metres.
    pub(super) side: f32,
    /// Mass of the cloth in kg per square metre.
    pub(super) density: f32,
    /// Compliances in metres per newton along the weave, the diagonals, and
    /// across two quads.
    pub(super) stretch_compliance: f32,
    pub(super) shear_compliance: f32,
    pub(super) bending_compliance: f32,
    /// Force of the air on a square metre moving across itself at 1 m/s, in
    /// newtons.
    pub(super) air_drag: f32,
    /// Share of the velocity lost a second, whatever its direction.
    pub(super) damping: f32,
    /// Substeps of one call of [`Cloth::advance`].
    pub(super) substeps: usize,
}

/// A ball that turns about the vertical through its centre.
#[derive(Clone, Copy, Debug)]
pub(super) struct TurningBall {
    pub(super) centre: Vec3,
    /// Distance kept by the particles, in metres: radius and clearance.
    pub(super) radius: f32,
    /// Coulomb coefficient of friction against the cloth.
    pub(super) friction: f32,
}

/// The ground, a plane of constant height.
#[derive(Clone, Copy, Debug)]
pub(super) struct Ground {
    /// Height kept by the particles, in metres.
    pub(super) height: f32,
    /// Coulomb coefficient of friction against the cloth.
    pub(super) friction: f32,
}

/// The cloth and its state.
#[derive(Clone, Debug)]
pub(super) struct Cloth {
    settings: ClothSettings,
    particles: Particles,
    stretch: Vec<DistanceConstraint>,
    shear: Vec<DistanceConstraint>,
    bending: Vec<DistanceConstraint>,
    contacts: ParticleContacts,
}

impl Cloth {
    /// A cloth at rest with particle (row, column) at
    /// `place(row / quads, column / quads)`; distances at rest are those of
    /// the flat square, not of the placement.
    pub(super) fn new(settings: ClothSettings, place: impl Fn(f32, f32) -> Vec3) -> Self {
        let count = settings.quads + 1;
        let step = 1.0 / settings.quads as f32;
        let positions: Vec<Vec3> = (0..count * count)
            .map(|i| place((i / count) as f32 * step, (i % count) as f32 * step))
            .collect();
        let mass = settings.density * settings.side * settings.side / positions.len() as f32;
        let spacing = settings.side * step;
        let links = |offset| grid_links(count, offset, spacing);
        Self {
            stretch: [links([0, 1]), links([1, 0])].concat(),
            shear: [links([1, 1]), links([1, -1])].concat(),
            bending: [links([0, 2]), links([2, 0])].concat(),
            particles: Particles::at_rest(positions, mass),
            contacts: ParticleContacts::default(),
            settings,
        }
    }

    /// Particle positions in rows of `quads + 1`.
    pub(super) fn positions(&self) -> &[Vec3] {
        &self.particles.positions
    }

    /// Advances by `duration` seconds; `spin` gives the ball's angular
    /// velocity in radians a second at a time from 0 to `duration`.
    pub(super) fn advance(
        &mut self,
        duration: f32,
        ball: &TurningBall,
        spin: impl Fn(f32) -> f32,
        ground: &Ground,
    ) {
        let dt = duration / self.settings.substeps as f32;
        let spacing = self.settings.side / self.settings.quads as f32;
        let thickness = THICKNESS * spacing;
        for substep in 0..self.settings.substeps {
            if substep % SUBSTEPS_PER_SEARCH == 0 {
                self.find_contacts(thickness);
            }
            self.resist_air(dt);
            let particles = &mut self.particles;
            particles.predict(GRAVITY, dt);
            particles.solve_distances(&self.stretch, self.settings.stretch_compliance, dt);
            particles.solve_distances(&self.shear, self.settings.shear_compliance, dt);
            particles.solve_distances(&self.bending, self.settings.bending_compliance, dt);
            self.contacts.resolve(particles, thickness);
            let angular_velocity = spin(substep as f32 * dt);
            collide(particles, ball, angular_velocity, ground, dt);
            particles.update_velocities(dt);
            limit_speed(particles, 0.5 * thickness / dt);
        }
    }

    /// Pairs that may come to touch before the next search: half as far again
    /// as the thickness covers ordinary motion, and what comes faster is
    /// found by a later search before layers have passed.
    fn find_contacts(&mut self, thickness: f32) {
        let count = (self.settings.quads + 1) as u32;
        self.contacts
            .collect(&self.particles.positions, 1.5 * thickness, |a, b| {
                // Weave neighbours are held by their own constraints.
                let rows = (a / count).abs_diff(b / count);
                let columns = (a % count).abs_diff(b % count);
                rows > 1 || columns > 1
            });
    }

    /// Slows motion along the surface normal by the drag of the air, and all
    /// motion by the damping.
    fn resist_air(&mut self, dt: f32) {
        let count = self.settings.quads + 1;
        let air = self.settings.air_drag / self.settings.density * dt;
        let keep = 1.0 - self.settings.damping * dt;
        let Particles {
            positions,
            velocities,
            ..
        } = &mut self.particles;
        for row in 0..count {
            let (above, below) = (row.saturating_sub(1), (row + 1).min(count - 1));
            for column in 0..count {
                let (left, right) = (column.saturating_sub(1), (column + 1).min(count - 1));
                let normal = (positions[below * count + column]
                    - positions[above * count + column])
                    .cross(positions[row * count + right] - positions[row * count + left]);
                let velocity = &mut velocities[row * count + column];
                let across = velocity.dot(normal);
                // Never more than the whole of the motion across the cloth.
                let share = air.min(1.0) * across / normal.length_squared().max(f32::MIN_POSITIVE);
                *velocity = (*velocity - normal * share) * keep;
            }
        }
    }
}

/// Links between all particles (row, column) and (row, column) + `offset` of
/// a grid of `count` by `count`, independent ones first: no two neighbours in
/// the list share a particle, so the solver's operations overlap, and no
/// direction is favoured.
fn grid_links(count: usize, offset: [isize; 2], spacing: f32) -> Vec<DistanceConstraint> {
    let rest = spacing * ((offset[0] * offset[0] + offset[1] * offset[1]) as f32).sqrt();
    let reach = offset[0].max(offset[1].abs()) as usize;
    let mut colors = [Vec::new(), Vec::new()];
    for row in 0..count {
        for column in 0..count {
            let (Some(to_row), Some(to_column)) = (
                row.checked_add_signed(offset[0]),
                column.checked_add_signed(offset[1]),
            ) else {
                continue;
            };
            if to_row >= count || to_column >= count {
                continue;
            }
            let along = if offset[0] == 0 { column } else { row };
            colors[along / reach % 2].push(DistanceConstraint {
                particles: [
                    (row * count + column) as u32,
                    (to_row * count + to_column) as u32,
                ],
                rest,
            });
        }
    }
    colors.concat()
}

/// Pushes particles out of ball and ground and rubs them: a contact takes
/// back sliding against the surface, up to friction times the push.
fn collide(
    particles: &mut Particles,
    ball: &TurningBall,
    angular_velocity: f32,
    ground: &Ground,
    dt: f32,
) {
    for (position, &previous) in particles.positions.iter_mut().zip(&particles.previous) {
        let offset = *position - ball.centre;
        let distance_squared = offset.length_squared();
        if distance_squared < ball.radius * ball.radius {
            let distance = distance_squared.sqrt().max(f32::MIN_POSITIVE);
            let normal = offset / distance;
            let depth = ball.radius - distance;
            *position += normal * depth;
            let surface = Vec3::new(normal.z, 0.0, -normal.x) * (ball.radius * angular_velocity);
            *position -= friction(
                *position - previous - surface * dt,
                normal,
                ball.friction * depth,
            );
        }
        if position.y < ground.height {
            let depth = ground.height - position.y;
            position.y = ground.height;
            *position -= friction(*position - previous, Vec3::Y, ground.friction * depth);
        }
    }
}

/// The part of `sliding` along the surface that friction takes back, at most
/// `limit` long.
fn friction(sliding: Vec3, normal: Vec3, limit: f32) -> Vec3 {
    let tangential = sliding - normal * sliding.dot(normal);
    let length = tangential.length();
    if length <= limit {
        tangential
    } else {
        tangential * (limit / length)
    }
}

/// Keeps a particle from passing another one unseen within a substep.
fn limit_speed(particles: &mut Particles, limit: f32) {
    for velocity in &mut particles.velocities {
        let speed_squared = velocity.length_squared();
        if speed_squared > limit * limit {
            *velocity *= limit / speed_squared.sqrt();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const GROUND: Ground = Ground {
        height: 0.01,
        friction: 0.5,
    };

    /// A ball that is nowhere near.
    const NO_BALL: TurningBall = TurningBall {
        centre: Vec3::new(0.0, -100.0, 0.0),
        radius: 1.0,
        friction: 0.0,
    };

    fn settings(quads: usize) -> ClothSettings {
        ClothSettings {
            quads,
            side: 1.0,
            density: 0.3,
            stretch_compliance: 0.0,
            shear_compliance: 1.0e-4,
            bending_compliance: 0.05,
            air_drag: 0.0,
            damping: 0.0,
            substeps: 40,
        }
    }

    fn flat(height: f32) -> impl Fn(f32, f32) -> Vec3 {
        move |u, v| Vec3::new(u - 0.5, height, v - 0.5)
    }

    fn centre(cloth: &Cloth) -> Vec3 {
        cloth.positions().iter().sum::<Vec3>() / cloth.positions().len() as f32
    }

    #[test]
    fn links_reach_every_pair_once() {
        let links = grid_links(5, [1, -1], 1.0);
        assert_eq!(links.len(), 16);
        assert!(links.iter().all(|link| link.rest == 2.0f32.sqrt()));
        let mut pairs: Vec<_> = grid_links(5, [0, 2], 0.1)
            .iter()
            .map(|link| link.particles)
            .collect();
        assert_eq!(pairs.len(), 15);
        pairs.sort_unstable();
        pairs.dedup();
        assert_eq!(pairs.len(), 15);
        assert!(pairs.iter().all(|[a, b]| b - a == 2));
    }

    #[test]
    fn a_free_cloth_falls_by_the_law_of_galileo() {
        let mut cloth = Cloth::new(settings(8), flat(10.0));
        cloth.advance(0.4, &NO_BALL, |_| 0.0, &GROUND);
        let fallen = 10.0 - centre(&cloth).y;
        assert!((fallen - 0.5 * 9.81 * 0.16).abs() < 0.03, "{fallen}");
    }

    #[test]
    fn air_holds_a_flat_cloth_at_its_terminal_speed() {
        // Weight density * g against drag * speed. The fall is around zero
        // height, where positions are precise enough for small steps.
        let bottomless = Ground {
            height: -100.0,
            ..GROUND
        };
        let drag = ClothSettings {
            air_drag: 1.0,
            ..settings(8)
        };
        let mut cloth = Cloth::new(drag, flat(2.0));
        for _ in 0..30 {
            cloth.advance(0.05, &NO_BALL, |_| 0.0, &bottomless);
        }
        let speed = -cloth.particles.velocities[40].y;
        assert!((speed - 0.3 * 9.81).abs() < 0.1, "{speed}");
    }

    #[test]
    fn a_sliding_cloth_stops_where_coulomb_says() {
        let mut cloth = Cloth::new(settings(8), flat(GROUND.height));
        cloth.particles.velocities.fill(Vec3::X);
        for _ in 0..10 {
            cloth.advance(0.04, &NO_BALL, |_| 0.0, &GROUND);
        }
        // v^2 / (2 mu g), reached after v / (mu g) = 0.2 s.
        let slid = centre(&cloth).x;
        assert!((slid - 1.0 / 9.81).abs() < 0.01, "{slid}");
        assert!(cloth.particles.velocities.iter().all(|v| v.length() < 0.01));
    }

    #[test]
    fn a_turning_ball_takes_the_cloth_along() {
        let ball = TurningBall {
            centre: Vec3::new(0.0, 2.0, 0.0),
            radius: 0.5,
            friction: 0.6,
        };
        let mut cloth = Cloth::new(settings(20), flat(2.51));
        for _ in 0..20 {
            cloth.advance(0.04, &ball, |_| 2.0, &GROUND);
        }
        let middle = 10 * 21 + 13;
        let arm = cloth.positions()[middle] - ball.centre;
        let around = Vec3::Y.cross(arm).normalize();
        let turning = cloth.particles.velocities[middle].dot(around) / arm.with_y(0.0).length();
        assert!((turning - 2.0).abs() < 0.3, "{turning}");
        for position in cloth.positions() {
            assert!(position.distance(ball.centre) > ball.radius - 1.0e-4);
        }
    }

    #[test]
    fn layers_stay_apart_when_a_cloth_falls_in_a_heap() {
        // Let down on its lower edge, the cloth folds to and fro.
        let mut cloth = Cloth::new(settings(20), |u, v| {
            Vec3::new(u - 0.5, 0.05 + v, 0.02 * v * (1.0 - v) + 0.003 * u)
        });
        for _ in 0..20 {
            cloth.advance(0.04, &NO_BALL, |_| 0.0, &GROUND);
        }
        let positions = cloth.positions();
        assert!(
            positions
                .iter()
                .all(|p| p.is_finite() && p.y >= GROUND.height)
        );
        let spacing = 1.0 / 20.0;
        let mut least = f32::MAX;
        for a in 0..positions.len() {
            for b in a + 1..positions.len() {
                if (a / 21).abs_diff(b / 21) > 1 || (a % 21).abs_diff(b % 21) > 1 {
                    least = least.min(positions[a].distance(positions[b]));
                }
            }
        }
        assert!(least > 0.6 * THICKNESS * spacing, "{least}");
    }
}
