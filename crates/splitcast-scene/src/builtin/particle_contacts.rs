//! Contacts between particles of one thickness, found by spatial hashing.
//!
//! M. Teschner et al.: "Optimized Spatial Hashing for Collision Detection of
//! Deformable Objects", VMV 2003. The table is a counting sort by hashed
//! cell, so pairs come out in an order that depends on the positions only.

use glam::Vec3;

use super::xpbd::Particles;

/// Share of the relative motion of two touching particles that is taken away
/// in a substep; cloth on cloth slides, but not freely.
const CONTACT_FRICTION: f32 = 0.05;

/// Pairs of particles that are close enough to touch soon.
#[derive(Clone, Debug, Default)]
pub(super) struct ParticleContacts {
    pairs: Vec<[u32; 2]>,
    cell_starts: Vec<u32>,
    sorted: Vec<u32>,
}

impl ParticleContacts {
    /// Collects all pairs within `reach` metres of each other, except those
    /// that `may_touch` turns down (neighbours in the weave).
    pub(super) fn collect(
        &mut self,
        positions: &[Vec3],
        reach: f32,
        may_touch: impl Fn(u32, u32) -> bool,
    ) {
        let table_size = (2 * positions.len()).next_power_of_two();
        let mask = table_size - 1;
        let cell = |position: Vec3| (position / reach).floor().as_ivec3();
        let slot = |x: i32, y: i32, z: i32| {
            // The primes of Teschner et al., section 3.1.
            let hash = x.wrapping_mul(73_856_093)
                ^ y.wrapping_mul(19_349_663)
                ^ z.wrapping_mul(83_492_791);
            hash as u32 as usize & mask
        };

        self.cell_starts.clear();
        self.cell_starts.resize(table_size + 1, 0);
        for &position in positions {
            let c = cell(position);
            self.cell_starts[slot(c.x, c.y, c.z)] += 1;
        }
        let mut end = 0;
        for start in &mut self.cell_starts {
            end += *start;
            *start = end;
        }
        self.sorted.resize(positions.len(), 0);
        for (index, &position) in positions.iter().enumerate().rev() {
            let c = cell(position);
            let start = &mut self.cell_starts[slot(c.x, c.y, c.z)];
            *start -= 1;
            self.sorted[*start as usize] = index as u32;
        }

        self.pairs.clear();
        for (a, &position) in positions.iter().enumerate() {
            let c = cell(position);
            // Two of the 27 cells may share a slot; a slot is read once.
            let mut slots = [usize::MAX; 27];
            let mut count = 0;
            for x in c.x - 1..=c.x + 1 {
                for y in c.y - 1..=c.y + 1 {
                    for z in c.z - 1..=c.z + 1 {
                        let slot = slot(x, y, z);
                        if !slots[..count].contains(&slot) {
                            slots[count] = slot;
                            count += 1;
                        }
                    }
                }
            }
            for &slot in &slots[..count] {
                let range = self.cell_starts[slot] as usize..self.cell_starts[slot + 1] as usize;
                for &b in &self.sorted[range] {
                    if b as usize > a
                        && position.distance_squared(positions[b as usize]) < reach * reach
                        && may_touch(a as u32, b)
                    {
                        self.pairs.push([a as u32, b]);
                    }
                }
            }
        }
    }

    /// Parts every collected pair closer than `thickness` metres, with
    /// friction. Assumes equal masses.
    pub(super) fn resolve(&self, particles: &mut Particles, thickness: f32) {
        let positions = &mut particles.positions;
        let previous = &particles.previous;
        for &[a, b] in &self.pairs {
            let (a, b) = (a as usize, b as usize);
            let offset = positions[a] - positions[b];
            let distance_squared = offset.length_squared();
            if distance_squared >= thickness * thickness || distance_squared <= f32::MIN_POSITIVE {
                continue;
            }
            let distance = distance_squared.sqrt();
            let push = offset * (0.5 * (thickness - distance) / distance);
            let motion = (positions[a] - previous[a]) - (positions[b] - previous[b]);
            let drag = motion * (0.5 * CONTACT_FRICTION);
            positions[a] += push - drag;
            positions[b] -= push - drag;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A small reproducible scatter of points in a 1 m cube.
    fn scatter(count: u32) -> Vec<Vec3> {
        let unit = |bits: u32| (bits.wrapping_mul(2_654_435_761) >> 8) as f32 / (1 << 24) as f32;
        (0..count)
            .map(|i| Vec3::new(unit(3 * i + 1), unit(3 * i + 2), unit(3 * i + 3)) - 0.5)
            .collect()
    }

    #[test]
    fn hashing_finds_the_pairs_of_brute_force() {
        let points = scatter(400);
        let reach = 0.13;
        let mut contacts = ParticleContacts::default();
        contacts.collect(&points, reach, |a, b| (a + b) % 7 != 0);
        let mut found = contacts.pairs.clone();
        found.sort_unstable();
        let mut expected = Vec::new();
        for a in 0..points.len() {
            for b in a + 1..points.len() {
                if (a + b) % 7 != 0 && points[a].distance_squared(points[b]) < reach * reach {
                    expected.push([a as u32, b as u32]);
                }
            }
        }
        assert!(expected.len() > 500);
        assert_eq!(found, expected);
    }

    #[test]
    fn two_close_particles_are_parted_about_their_middle() {
        let mut particles = Particles::at_rest(vec![Vec3::ZERO, Vec3::X * 0.01], 1.0);
        let mut contacts = ParticleContacts::default();
        contacts.collect(&particles.positions, 0.05, |_, _| true);
        contacts.resolve(&mut particles, 0.04);
        assert!((particles.positions[0].x + 0.015).abs() < 1.0e-6);
        assert!((particles.positions[1].x - 0.025).abs() < 1.0e-6);
    }
}
