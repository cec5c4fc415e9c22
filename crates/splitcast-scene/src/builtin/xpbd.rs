//! Extended position-based dynamics: particles held by compliant distances.
//!
//! M. Macklin, M. Müller, N. Chentanez: "XPBD: Position-Based Simulation of
//! Compliant Constrained Dynamics", Motion in Games 2016. As in M. Macklin et
//! al.: "Small Steps in Physics Simulation", SCA 2019, every substep solves
//! each constraint once, so the Lagrange multipliers start from zero and need
//! no storage.
//!
//! Constraints are solved one after another in a fixed order (Gauss-Seidel),
//! with scalar `f32` arithmetic only: the same bits on every machine.

use glam::Vec3;

/// Point masses in structure-of-arrays form; all arrays have one length.
#[derive(Clone, Debug)]
pub(super) struct Particles {
    /// Positions in metres.
    pub(super) positions: Vec<Vec3>,
    /// Positions at the start of the current substep.
    pub(super) previous: Vec<Vec3>,
    /// Velocities in metres a second.
    pub(super) velocities: Vec<Vec3>,
    /// One over the mass, in 1/kg; zero pins a particle.
    pub(super) inverse_masses: Vec<f32>,
}

/// Two particles and the distance they want to keep.
#[derive(Clone, Copy, Debug)]
pub(super) struct DistanceConstraint {
    pub(super) particles: [u32; 2],
    /// Rest distance in metres.
    pub(super) rest: f32,
}

impl Particles {
    /// Particles at rest at `positions`, all of one `mass` in kg.
    pub(super) fn at_rest(positions: Vec<Vec3>, mass: f32) -> Self {
        let count = positions.len();
        Self {
            previous: positions.clone(),
            velocities: vec![Vec3::ZERO; count],
            inverse_masses: vec![1.0 / mass; count],
            positions,
        }
    }

    /// Starts a substep of `dt` seconds: free flight under `gravity`.
    pub(super) fn predict(&mut self, gravity: Vec3, dt: f32) {
        for (((position, previous), velocity), &inverse_mass) in (self.positions.iter_mut())
            .zip(&mut self.previous)
            .zip(&mut self.velocities)
            .zip(&self.inverse_masses)
        {
            *previous = *position;
            if inverse_mass > 0.0 {
                *velocity += gravity * dt;
                *position += *velocity * dt;
            }
        }
    }

    /// Ends a substep: velocities are what the corrected positions say.
    pub(super) fn update_velocities(&mut self, dt: f32) {
        let rate = 1.0 / dt;
        for ((velocity, &position), &previous) in self
            .velocities
            .iter_mut()
            .zip(&self.positions)
            .zip(&self.previous)
        {
            *velocity = (position - previous) * rate;
        }
    }

    /// One Gauss-Seidel pass over `constraints`, all of one `compliance` in
    /// metres per newton (zero: rigid), in a substep of `dt` seconds.
    pub(super) fn solve_distances(
        &mut self,
        constraints: &[DistanceConstraint],
        compliance: f32,
        dt: f32,
    ) {
        let scaled_compliance = compliance / (dt * dt);
        for constraint in constraints {
            let [a, b] = constraint.particles.map(|index| index as usize);
            let (weight_a, weight_b) = (self.inverse_masses[a], self.inverse_masses[b]);
            let weight = weight_a + weight_b + scaled_compliance;
            let offset = self.positions[a] - self.positions[b];
            let length = offset.length();
            // Coincident particles have no direction to part in, and two
            // pinned ones cannot move.
            if length <= f32::MIN_POSITIVE || weight_a + weight_b == 0.0 {
                continue;
            }
            let correction = offset * ((constraint.rest - length) / (weight * length));
            self.positions[a] += correction * weight_a;
            self.positions[b] -= correction * weight_b;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const GRAVITY: Vec3 = Vec3::new(0.0, -9.81, 0.0);

    /// A chain of `count` links of 10 cm under a pinned particle, let go
    /// stretched out downwards and damped until it hangs still.
    fn hanging_chain(count: usize, mass: f32, compliance: f32) -> Vec<Vec3> {
        let dt = 1.0e-3;
        let positions = (0..=count)
            .map(|i| Vec3::new(0.0, -0.1 * i as f32, 0.0))
            .collect();
        let mut particles = Particles::at_rest(positions, mass);
        particles.inverse_masses[0] = 0.0;
        let constraints: Vec<_> = (0..count as u32)
            .map(|i| DistanceConstraint {
                particles: [i, i + 1],
                rest: 0.1,
            })
            .collect();
        for _ in 0..6000 {
            particles.predict(GRAVITY, dt);
            particles.solve_distances(&constraints, compliance, dt);
            particles.update_velocities(dt);
            for velocity in &mut particles.velocities {
                *velocity *= 0.99;
            }
        }
        particles.positions
    }

    #[test]
    fn a_hanging_chain_stretches_as_hooke_says() {
        // Link i carries the weight of the particles below it, so it is longer
        // by compliance times (count - i) m g.
        let (count, mass, compliance) = (5, 0.2, 2.0e-3);
        let positions = hanging_chain(count, mass, compliance);
        for i in 0..count {
            let length = positions[i].distance(positions[i + 1]);
            let expected = 0.1 + compliance * (count - i) as f32 * mass * 9.81;
            assert!(
                (length - expected).abs() < 1.0e-4,
                "link {i}: {length} for {expected}"
            );
        }
    }

    #[test]
    fn a_spring_swings_at_its_natural_frequency() {
        // Frequency sqrt(k / m) = 2 pi at k = 1 / compliance, so one period is
        // one second; implicit damping of small steps may only shrink it.
        let mass = 0.5;
        let compliance = 1.0 / (mass * std::f32::consts::TAU * std::f32::consts::TAU);
        let dt = 2.5e-4;
        let mut particles = Particles::at_rest(vec![Vec3::ZERO, Vec3::X * 1.1], mass);
        particles.inverse_masses[0] = 0.0;
        let constraint = [DistanceConstraint {
            particles: [0, 1],
            rest: 1.0,
        }];
        let mut crossings = Vec::new();
        for step in 0..4000 {
            let before = particles.positions[1].x;
            particles.predict(Vec3::ZERO, dt);
            particles.solve_distances(&constraint, compliance, dt);
            particles.update_velocities(dt);
            if (before - 1.0) * (particles.positions[1].x - 1.0) < 0.0 {
                crossings.push(step as f32 * dt);
            }
        }
        assert_eq!(crossings.len(), 2, "{crossings:?}");
        assert!(
            (crossings[1] - crossings[0] - 0.5).abs() < 0.005,
            "{crossings:?}"
        );
    }

    #[test]
    fn free_constraints_keep_the_centre_of_mass() {
        let positions = vec![
            Vec3::ZERO,
            Vec3::new(0.3, 0.1, 0.0),
            Vec3::new(0.1, 0.5, 0.2),
        ];
        let centre = |points: &[Vec3]| points.iter().sum::<Vec3>() / 3.0;
        let mut particles = Particles::at_rest(positions, 1.0);
        let before = centre(&particles.positions);
        let constraints = [[0, 1], [1, 2], [0, 2]].map(|particles| DistanceConstraint {
            particles,
            rest: 0.25,
        });
        for _ in 0..50 {
            particles.solve_distances(&constraints, 0.0, 1.0e-3);
        }
        assert!(centre(&particles.positions).distance(before) < 1.0e-6);
        for constraint in constraints {
            let [a, b] = constraint
                .particles
                .map(|i| particles.positions[i as usize]);
            assert!((a.distance(b) - 0.25).abs() < 1.0e-4);
        }
    }

    #[test]
    fn coincident_and_pinned_particles_stay_finite() {
        let mut particles = Particles::at_rest(vec![Vec3::ONE; 2], 1.0);
        let constraint = [DistanceConstraint {
            particles: [0, 1],
            rest: 1.0,
        }];
        particles.solve_distances(&constraint, 0.0, 1.0e-3);
        particles.inverse_masses = vec![0.0; 2];
        particles.positions[1] = Vec3::ZERO;
        particles.solve_distances(&constraint, 0.0, 1.0e-3);
        assert_eq!(particles.positions, [Vec3::ONE, Vec3::ZERO]);
    }
}
